//! Tiny meshes by property, for the tests of every mesh kernel; and a reader for the larger ones in `../shared`.

use super::{Part, Surface, TriMesh};
use crate::numerics::det;
use crate::numerics::vec::{Vec3, vec3};

/// A mesh from plain numbers.
pub(crate) fn mesh(positions: &[[f64; 3]], faces: &[[u32; 3]]) -> TriMesh {
    TriMesh { positions: positions.iter().map(|&p| p.into()).collect(), faces: faces.to_vec() }
}

/// A surface of one part with flat normals.
pub(crate) fn surface(mesh: TriMesh) -> Surface {
    let normal = |f: usize| mesh.area_vector(f).normalized().unwrap_or(vec3(0., 0., 1.));
    let corner_normals = (0..mesh.faces.len()).flat_map(|f| [normal(f); 3]).collect();
    let (v, f) = (mesh.positions.len() as u32, mesh.faces.len() as u32);
    let to_world = [[1., 0., 0., 0.], [0., 1., 0., 0.], [0., 0., 1., 0.]];
    let part = Part { mesh: 0, primitive: 0, vertices: 0..v, faces: 0..f, to_world };
    Surface { mesh, corner_normals, has_normals: false, corner_uvs: vec![], parts: vec![part] }
}

/// Every mesh of the zoo by name, but for those without any area.
pub(crate) fn all() -> Vec<(&'static str, TriMesh)> {
    vec![
        ("tetrahedron", tetrahedron()),
        ("fan", fan()),
        ("hourglass", hourglass()),
        ("moebius", moebius(24)),
        ("torus", torus(24, 12)),
        ("plane", plane(5, 4)),
        ("sliver", sliver()),
        ("zero-area face", zero_area_face()),
        ("two components", two_components()),
        ("cube", cube()),
        ("icosphere", icosphere(2)),
        ("three faces at an edge", book()),
        ("two-sided", two_sided()),
    ]
}

pub(crate) fn tetrahedron() -> TriMesh {
    mesh(&[[1., 1., 1.], [1., -1., -1.], [-1., 1., -1.], [-1., -1., 1.]], &[[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]])
}

/// Six triangles around an inner vertex, open.
pub(crate) fn fan() -> TriMesh {
    let mut positions = vec![vec3(0., 0., 0.3)];
    positions.extend((0..6).map(|i| circle(i, 6, 1.0)));
    TriMesh { positions, faces: (0..6).map(|i| [0, 1 + i, 1 + (i + 1) % 6]).collect() }
}

/// Two open cones that meet in one vertex.
pub(crate) fn hourglass() -> TriMesh {
    let mut positions = vec![Vec3::ZERO];
    positions.extend((0..6).map(|i| circle(i, 6, 1.0) + vec3(0., 0., 1.)));
    positions.extend((0..6).map(|i| circle(i, 6, 1.0) - vec3(0., 0., 1.)));
    let up = (0..6).map(|i| [0, 1 + (i + 1) % 6, 1 + i]);
    let down = (0..6).map(|i| [0, 7 + i, 7 + (i + 1) % 6]);
    TriMesh { positions, faces: up.chain(down).collect() }
}

/// A band of `n` quads with half a twist.
pub(crate) fn moebius(n: u32) -> TriMesh {
    let point = |i: u32, side: f64| {
        let a = std::f64::consts::TAU * f64::from(i) / f64::from(n);
        let r = 1.0 + side * 0.3 * det::cos(a / 2.0);
        vec3(r * det::cos(a), r * det::sin(a), side * 0.3 * det::sin(a / 2.0))
    };
    let positions = (0..n).flat_map(|i| [point(i, 1.0), point(i, -1.0)]).collect();
    let quad = |i: u32| {
        let (a, b) = (2 * i, 2 * i + 1);
        let (c, d) = if i + 1 == n { (1, 0) } else { (2 * i + 2, 2 * i + 3) };
        [[a, b, d], [a, d, c]]
    };
    TriMesh { positions, faces: (0..n).flat_map(quad).collect() }
}

/// A torus of radii 1 and 0.4 about the z axis.
pub(crate) fn torus(major: u32, minor: u32) -> TriMesh {
    let point = |i: u32, j: u32| {
        let a = std::f64::consts::TAU * f64::from(i) / f64::from(major);
        let b = std::f64::consts::TAU * f64::from(j) / f64::from(minor);
        let r = 1.0 + 0.4 * det::cos(b);
        vec3(r * det::cos(a), r * det::sin(a), 0.4 * det::sin(b))
    };
    let at = |i: u32, j: u32| (i % major) * minor + j % minor;
    let quad = |i, j| [[at(i, j), at(i + 1, j), at(i + 1, j + 1)], [at(i, j), at(i + 1, j + 1), at(i, j + 1)]];
    TriMesh {
        positions: (0..major).flat_map(|i| (0..minor).map(move |j| point(i, j))).collect(),
        faces: (0..major).flat_map(|i| (0..minor).flat_map(move |j| quad(i, j))).collect(),
    }
}

/// A flat grid of `w` x `h` unit squares in the plane z = 0, seen from +z.
pub(crate) fn plane(w: u32, h: u32) -> TriMesh {
    let at = |x: u32, y: u32| y * (w + 1) + x;
    let quad = |x, y| [[at(x, y), at(x + 1, y), at(x + 1, y + 1)], [at(x, y), at(x + 1, y + 1), at(x, y + 1)]];
    TriMesh {
        positions: (0..=h).flat_map(|y| (0..=w).map(move |x| vec3(f64::from(x), f64::from(y), 0.))).collect(),
        faces: (0..h).flat_map(|y| (0..w).flat_map(move |x| quad(x, y))).collect(),
    }
}

/// A needle beside a good triangle.
pub(crate) fn sliver() -> TriMesh {
    mesh(&[[0., 0., 0.], [1., 0., 0.], [0.5, 1., 0.], [0.5, -1e-5, 0.]], &[[0, 1, 2], [1, 0, 3]])
}

/// A square with a face on its diagonal that has no area.
pub(crate) fn zero_area_face() -> TriMesh {
    mesh(&[[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.], [0.5, 0.5, 0.]], &[[0, 1, 2], [0, 2, 3], [0, 4, 2]])
}

pub(crate) fn two_components() -> TriMesh {
    let (mut a, b) = (tetrahedron(), icosphere(1));
    let n = a.positions.len() as u32;
    a.positions.extend(b.positions.iter().map(|&p| p + vec3(5., 0., 0.)));
    a.faces.extend(b.faces.iter().map(|f| f.map(|v| v + n)));
    a
}

/// The cube from -1 to 1 as 12 triangles.
pub(crate) fn cube() -> TriMesh {
    let positions = (0..8).map(|i| [i & 1, i >> 1 & 1, i >> 2].map(|b| f64::from(b) * 2.0 - 1.0).into()).collect();
    let quads = [[0u32, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]]
        .map(|[a, b, c, d]| [[a, b, c], [a, c, d]]);
    TriMesh { positions, faces: quads.into_iter().flatten().collect() }
}

/// The unit sphere: an icosahedron halved `levels` times.
pub(crate) fn icosphere(levels: u32) -> TriMesh {
    let g = (1.0 + 5f64.sqrt()) / 2.0;
    let p = [
        [-1., g, 0.],
        [1., g, 0.],
        [-1., -g, 0.],
        [1., -g, 0.],
        [0., -1., g],
        [0., 1., g],
        [0., -1., -g],
        [0., 1., -g],
        [g, 0., -1.],
        [g, 0., 1.],
        [-g, 0., -1.],
        [-g, 0., 1.],
    ];
    let f = "0 11 5 0 5 1 0 1 7 0 7 10 0 10 11 1 5 9 5 11 4 11 10 2 10 7 6 7 1 8 \
             3 9 4 3 4 2 3 2 6 3 6 8 3 8 9 4 9 5 2 4 11 6 2 10 8 6 7 9 8 1";
    let f: Vec<u32> = f.split_whitespace().map(|n| n.parse().unwrap()).collect();
    let mut m = mesh(&p, &f.chunks(3).map(|c| [c[0], c[1], c[2]]).collect::<Vec<_>>());
    for _ in 0..levels {
        m = super::subdivide::quarter(&m);
    }
    m.positions.iter_mut().for_each(|p| *p = p.normalized().unwrap());
    m
}

/// Three pages at one spine: a non-manifold edge.
pub(crate) fn book() -> TriMesh {
    mesh(
        &[[0., 0., 0.], [0., 1., 0.], [1., 0.5, 0.], [-1., 0.5, 0.5], [-1., 0.5, -0.5]],
        &[[1, 0, 2], [0, 1, 3], [0, 1, 4]],
    )
}

/// A sheet of two triangles, each with a twin of the other winding on the same vertices.
pub(crate) fn two_sided() -> TriMesh {
    mesh(&[[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]], &[[0, 1, 2], [0, 2, 1], [0, 3, 2], [0, 2, 3]])
}

fn circle(i: u32, n: u32, radius: f64) -> Vec3 {
    let (s, c) = det::sin_cos(std::f64::consts::TAU * f64::from(i) / f64::from(n));
    vec3(radius * c, radius * s, 0.0)
}

/// A mesh of `../shared/data/meshes/obj` (positions and faces only); says so and gives `None` where it is absent.
pub(crate) fn obj(name: &str) -> Option<TriMesh> {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data/meshes/obj").join(name);
    let Ok(text) = std::fs::read_to_string(&path) else {
        println!("skipped: no {}", path.display());
        return None;
    };
    let (mut positions, mut faces) = (vec![], vec![]);
    for line in text.lines() {
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => {
                let p: Vec<f64> = words.take(3).map(|w| w.parse().unwrap()).collect();
                positions.push(vec3(p[0], p[1], p[2]));
            }
            Some("f") => {
                let n = positions.len() as i64;
                let index = |w: &str| {
                    let i: i64 = w.split('/').next().unwrap().parse().unwrap();
                    if i < 0 { (n + i) as u32 } else { (i - 1) as u32 }
                };
                let f: Vec<u32> = words.map(index).collect();
                faces.extend((2..f.len()).map(|k| [f[0], f[k - 1], f[k]]));
            }
            _ => {}
        }
    }
    Some(TriMesh { positions, faces })
}
