//! What the tests of this module and of `render` share: small meshes, a reader of OBJ, corner coordinates made up.

use super::{Atlas, Coverage, Filter, Inputs, TexelSources, bake_map, tangents};
use crate::mesh::{Surface, SynthesisMesh, TriMesh};
use crate::numerics::rng::Key;
use crate::numerics::vec::{Vec3, vec3};
use crate::texture::{MapKind, Texture, Uv, texel};
use crate::uvset::{Blend, UvSets};

/// A surface on a page, with everything that a bake needs but the coordinates.
pub(super) struct Bench {
    pub surface: Surface,
    pub synthesis: SynthesisMesh,
    pub atlas: Atlas,
    pub tangents: Vec<[f32; 4]>,
    pub coverage: Coverage,
}

impl Bench {
    /// With a gutter of so many texels.
    pub fn new(surface: Surface, synthesis: SynthesisMesh, atlas: Atlas, gutter: u32) -> Bench {
        let tangents = tangents(&surface, &atlas);
        let coverage = Coverage::new(&surface, &synthesis, &atlas, &tangents, gutter).expect("they belong together");
        Bench { surface, synthesis, atlas, tangents, coverage }
    }

    /// A map, from the corner coordinates or from places of its own.
    pub fn bake(&self, sets: &UvSets, sources: Option<&TexelSources>, kind: MapKind, map: &Texture) -> Texture {
        let Bench { surface, synthesis, atlas, tangents, coverage } = self;
        let inputs = Inputs { surface, synthesis, atlas, coverage, tangents, sets, sources, filter: Filter::Linear };
        bake_map(&inputs, kind, map).expect("they belong together")
    }
}

/// A surface without document: one part-less mesh with smooth normals.
pub(crate) fn surface(positions: Vec<Vec3>, faces: Vec<[u32; 3]>) -> Surface {
    let mesh = TriMesh { positions, faces };
    let smooth = mesh.vertex_normals();
    let corner_normals = mesh.faces.iter().flatten().map(|&v| smooth[v as usize]).collect();
    Surface { mesh, corner_normals, has_normals: false, corner_uvs: Vec::new(), parts: Vec::new() }
}

/// A unit square in the plane z = 0 of n x n cells, with its own UVs (v down, so y up is v down reversed).
pub(crate) fn plane(n: u32) -> Surface {
    let at = |i: u32| f64::from(i) / f64::from(n);
    let positions = (0..=n).flat_map(|y| (0..=n).map(move |x| vec3(at(x), at(y), 0.0))).collect();
    let mut faces = Vec::new();
    for (x, y) in (0..n).flat_map(|y| (0..n).map(move |x| (x, y))) {
        let v = |dx: u32, dy: u32| (y + dy) * (n + 1) + x + dx;
        faces.extend([[v(0, 0), v(1, 0), v(1, 1)], [v(0, 0), v(1, 1), v(0, 1)]]);
    }
    let mut s = surface(positions, faces);
    let uv = |v: u32| s.mesh.positions[v as usize];
    let set = s.mesh.faces.iter().flatten().map(|&v| Uv { u: uv(v).x as f32, v: 1.0 - uv(v).y as f32 }).collect();
    s.corner_uvs = vec![set];
    s
}

/// A cube of side 2 around the origin, 12 triangles, hard edges.
pub(crate) fn cube() -> Surface {
    let positions: Vec<Vec3> = (0..8)
        .map(|i| vec3(f64::from(i & 1) * 2.0 - 1.0, f64::from(i >> 1 & 1) * 2.0 - 1.0, f64::from(i >> 2) * 2.0 - 1.0))
        .collect();
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let faces: Vec<[u32; 3]> = quads.iter().flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]).collect();
    let mut s = surface(positions, faces);
    for f in 0..12 {
        let n = s.mesh.area_vector(f).normalized().unwrap_or(vec3(0.0, 0.0, 1.0));
        s.corner_normals[3 * f..3 * f + 3].fill(n);
    }
    s
}

/// A sphere of radius 1: an octahedron subdivided `n` times.
pub(crate) fn sphere(n: u32) -> Surface {
    let mut p: Vec<Vec3> = [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]]
        .map(|[x, y, z]| vec3(f64::from(x), f64::from(y), f64::from(z)))
        .to_vec();
    let mut faces = vec![[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]];
    for _ in 0..n {
        let mut middle = std::collections::BTreeMap::new();
        let mut mid = |a: u32, b: u32, p: &mut Vec<Vec3>| {
            *middle.entry((a.min(b), a.max(b))).or_insert_with(|| {
                let m = p[a as usize] + p[b as usize];
                p.push(m / m.length());
                p.len() as u32 - 1
            })
        };
        let split = |f: &[u32; 3]| {
            let [a, b, c] = *f;
            let (ab, bc, ca) = (mid(a, b, &mut p), mid(b, c, &mut p), mid(c, a, &mut p));
            [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
        };
        faces = faces.iter().flat_map(split).collect();
    }
    surface(p, faces)
}

/// The surface as its own synthesis mesh, welded.
pub(crate) fn synthesis(surface: &Surface) -> SynthesisMesh {
    let welded = super::border::weld(&surface.mesh.positions);
    let faces = surface.mesh.faces.iter().map(|f| f.map(|v| welded[v as usize])).collect();
    let n = surface.mesh.faces.len();
    SynthesisMesh {
        mesh: TriMesh { positions: surface.mesh.positions.clone(), faces },
        parent: (0..n as u32).collect(),
        parent_bary: vec![[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]; n],
    }
}

/// Each face split in `n * n` of equal size, to test parents: T-junction free as all are split alike.
pub(crate) fn refined(surface: &Surface, n: u32) -> SynthesisMesh {
    let base = synthesis(surface);
    let mut out = SynthesisMesh { mesh: TriMesh::default(), parent: vec![], parent_bary: vec![] };
    let b = |i: u32, j: u32| [(n - i - j) as f32 / n as f32, i as f32 / n as f32, j as f32 / n as f32];
    for f in 0..base.mesh.faces.len() {
        let p = base.mesh.corners(f);
        let mut add = |tri: [[f32; 3]; 3]| {
            let at = out.mesh.positions.len() as u32;
            for c in tri {
                let [x, y, z] = c.map(f64::from);
                out.mesh.positions.push(p[0] * x + p[1] * y + p[2] * z);
            }
            out.mesh.faces.push([at, at + 1, at + 2]);
            out.parent.push(f as u32);
            out.parent_bary.push(tri);
        };
        for i in 0..n {
            for j in 0..n - i {
                add([b(i, j), b(i + 1, j), b(i, j + 1)]);
                if i + j + 1 < n {
                    add([b(i + 1, j), b(i + 1, j + 1), b(i, j + 1)]);
                }
            }
        }
    }
    let welded = super::border::weld(&out.mesh.positions);
    out.mesh.faces.iter_mut().flatten().for_each(|v| *v = welded[*v as usize]);
    out
}

/// Corner coordinates as a walk would leave them: around each vertex a flat piece of the sample at a random place and
/// angle; three sets, of weight one at their vertex. Continuous over the surface.
pub(crate) fn scattered(mesh: &TriMesh, size: [u32; 2], texels_per_unit: f64, blend: Blend) -> UvSets {
    let normals = mesh.vertex_normals();
    let key = Key::new(7).with_str("scattered");
    let place = |v: u32, p: Vec3| {
        let (n, key) = (normals[v as usize], key.with(u64::from(v)));
        let (s, c) = crate::numerics::det::sin_cos(key.unit(0) * std::f64::consts::TAU);
        let (t, d) = (n.any_perpendicular(), p - mesh.positions[v as usize]);
        let (x, y) = (d.dot(t) * texels_per_unit, d.dot(n.cross(t)) * texels_per_unit);
        let at = [1, 2].map(|i| (0.2 + 0.6 * key.unit(i)) * f64::from(size[i as usize - 1]));
        texel((at[0] + c * x - s * y) as f32, (at[1] - s * x - c * y) as f32)
    };
    let mut sets = vec![Vec::new(); 3];
    for face in &mesh.faces {
        for (s, set) in sets.iter_mut().enumerate() {
            set.extend(face.map(|v| place(face[s], mesh.positions[v as usize])));
        }
    }
    let weights = (0..mesh.faces.len() * 3).map(|c| std::array::from_fn(|s| f32::from(u8::from(s == c % 3)))).collect();
    UvSets { exemplar_size: size, sets, weights, blend, sharpness: 1, material: vec![] }
}

/// One set: the sample laid flat over x and y, `texels_per_unit` texels a unit, y up.
pub(crate) fn flat_set(mesh: &TriMesh, size: [u32; 2], texels_per_unit: f64) -> UvSets {
    let corner = |v: &u32| {
        let p = mesh.positions[*v as usize];
        texel((p.x * texels_per_unit) as f32, (f64::from(size[1]) - p.y * texels_per_unit) as f32)
    };
    let set: Vec<_> = mesh.faces.iter().flatten().map(corner).collect();
    let weights = vec![[1.0, 0.0, 0.0, 0.0]; set.len()];
    UvSets { exemplar_size: size, sets: vec![set], weights, blend: Blend::Linear, sharpness: 1, material: vec![] }
}

/// A mesh of the shared data, if it is there: positions and triangulated faces of an OBJ.
pub(crate) fn shared_mesh(name: &str) -> Option<Surface> {
    let path = format!("{}/../shared/data/meshes/obj/{name}.obj", env!("CARGO_MANIFEST_DIR"));
    let Ok(text) = std::fs::read_to_string(&path) else {
        println!("skipped: no {path}");
        return None;
    };
    let (mut positions, mut faces) = (Vec::new(), Vec::new());
    for line in text.lines() {
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => {
                let p: Vec<f64> = words.filter_map(|w| w.parse().ok()).collect();
                positions.push(vec3(p[0], p[1], p[2]));
            }
            Some("f") => {
                let corner = |w: &str| w.split('/').next().and_then(|i| i.parse::<u32>().ok());
                let c: Vec<u32> = words.filter_map(corner).map(|i| i - 1).collect();
                faces.extend((1..c.len() - 1).map(|k| [c[0], c[k], c[k + 1]]));
            }
            _ => {}
        }
    }
    Some(surface(positions, faces))
}
