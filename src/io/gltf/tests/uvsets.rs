//! UV-set bakes.

use super::*;
use crate::mesh::{SynthesisMesh, TriMesh};
use crate::texture::texel;
use crate::uvset::{Blend, UvSets};

/// The surface with every face cut into four at the middles of its edges, welded by position.
pub(super) fn subdivided(surface: &Surface) -> SynthesisMesh {
    let parts = [
        [[1., 0., 0.], [0.5, 0.5, 0.], [0.5, 0., 0.5]],
        [[0.5, 0.5, 0.], [0., 1., 0.], [0., 0.5, 0.5]],
        [[0.5, 0., 0.5], [0., 0.5, 0.5], [0., 0., 1.]],
        [[0.5, 0.5, 0.], [0., 0.5, 0.5], [0.5, 0., 0.5]],
    ];
    let mut out = SynthesisMesh { mesh: TriMesh::default(), parent: Vec::new(), parent_bary: Vec::new() };
    let mut points: Vec<Vec3> = Vec::new();
    for f in 0..surface.mesh.faces.len() {
        for bary in parts {
            out.parent.push(f as u32);
            out.parent_bary.push(bary);
            let [a, b, c] = surface.mesh.corners(f);
            points.extend(bary.map(|[x, y, z]| a * f64::from(x) + b * f64::from(y) + c * f64::from(z)));
        }
    }
    let key = |p: &Vec3| [p.x, p.y, p.z].map(|v| (v + 0.0).to_bits());
    let mut keys: Vec<_> = points.iter().map(key).collect();
    keys.sort_unstable();
    keys.dedup();
    let index: Vec<u32> = points.iter().map(|p| keys.binary_search(&key(p)).unwrap() as u32).collect();
    out.mesh.positions = keys.iter().map(|k| Vec3::from(k.map(f64::from_bits))).collect();
    out.mesh.faces = index.chunks(3).map(|f| [f[0], f[1], f[2]]).collect();
    out
}

pub(super) fn uv_sets(synthesis: &SynthesisMesh) -> UvSets {
    let n = 3 * synthesis.mesh.faces.len();
    let point = |c: usize| synthesis.mesh.positions[synthesis.mesh.faces[c / 3][c % 3] as usize];
    let set = |s: usize| {
        (0..n).map(|c| texel(20.0 * s as f32 + point(c).x as f32 + (c / 12 % 3) as f32, point(c).y as f32)).collect()
    };
    let weight = |c: usize| std::array::from_fn(|s| f32::from(u8::from(s == c % 3)));
    UvSets {
        exemplar_size: [128, 64],
        sets: (0..3).map(set).collect(),
        weights: (0..n).map(weight).collect(),
        blend: Blend::Variance,
        sharpness: 1,
        material: vec![],
    }
}

pub(super) fn plain(maps: &BakedMaps) -> UvSetOutput<'_> {
    UvSetOutput {
        weld_texels: 0.25,
        maps,
        mean_color: None,
        means: &[],
        repeat_weights_in_uv: false,
        triangles: TriangleOrder::Input,
        material_space: None,
        edge_metric: &[],
    }
}

#[test]
fn uv_sets_carry_the_synthesis_mesh_of_every_scene() {
    for path in scenes("meshes") {
        let Ok((doc, surface)) = read(&path).and_then(|d| d.surface(None).map(|s| (d, s))) else { continue };
        if surface.mesh.faces.len() > 30_000 {
            continue;
        }
        let name = path.display();
        let synthesis = subdivided(&surface);
        let sets = uv_sets(&synthesis);
        let maps = maps(&[Use::BaseColor, Use::Normal]);
        let means = [("base_color".into(), vec![0.1, 0.2, 0.3])];
        let output = UvSetOutput {
            mean_color: Some([0.1, 0.2, 0.3]),
            means: &means,
            repeat_weights_in_uv: true,
            ..plain(&maps)
        };
        let glb = write_uv_sets(&doc, &surface, &synthesis, &sets, &output).unwrap();
        dump(&path, "uvsets", &glb);
        let back = again(&glb);
        let now = back.surface(None).unwrap();
        assert_eq!(now.mesh.faces.len(), synthesis.mesh.faces.len(), "{name}");
        assert_eq!(now.corner_uvs.len(), surface.corner_uvs.len() + 4, "{name}");
        // Parts are in order and faces within them too.
        let (lo, hi) = surface.mesh.bounds();
        let size = (hi - lo).length();
        for f in 0..now.mesh.faces.len() {
            for k in 0..3 {
                let d = now.mesh.corners(f)[k] - synthesis.mesh.corners(f)[k];
                assert!(d.length() <= 1e-6 * (size + hi.length()), "{name}: {d:?}");
                let (t, uv) = (sets.sets[1][3 * f + k], now.corner_uvs[1][3 * f + k]);
                assert!((uv.u * 128.0 - t.x).abs() <= 0.2501 && (uv.v * 64.0 - t.y).abs() <= 0.2501, "{name}");
                let w = now.corner_uvs[3][3 * f + k];
                assert_eq!([w.u, w.v, 1.0 - w.u - w.v], sets.weights[3 * f + k][..3], "{name}");
            }
        }
        // No cracks: points that are one in the synthesis mesh are one in each mesh of the output.
        let mut seen: Vec<(u32, u32, [u64; 3])> = Vec::new();
        for part in &now.parts {
            for f in part.faces.clone() {
                for k in 0..3 {
                    let p = now.mesh.corners(f as usize)[k];
                    seen.push((
                        part.mesh,
                        synthesis.mesh.faces[f as usize][k],
                        [p.x, p.y, p.z].map(|v| (v + 0.0).to_bits()),
                    ));
                }
            }
        }
        seen.sort_unstable();
        seen.dedup();
        assert!(seen.windows(2).all(|w| (w[0].0, w[0].1) != (w[1].0, w[1].1)), "{name}: a crack");
        let material = &list(&back.root, "materials")[0];
        assert_eq!(material["extras"]["kiln"]["sets"], 3);
        assert!(list(&back.root, "extensionsUsed").contains(&"KILN_uv_sets".into()));
        assert!(!list(&back.root, "extensionsRequired").contains(&"KILN_uv_sets".into()));
    }
}

#[test]
fn influences_of_a_skin_are_merged_between_vertices() {
    let [positions, indices] = square();
    let joints = (5121, "VEC4", false, vec![1, 2, 3, 4, 5, 6, 7, 1, 1, 2, 3, 4, 1, 2, 3, 4]);
    let weights = (5121, "VEC4", true, vec![155, 50, 30, 20, 100, 80, 50, 25, 155, 50, 30, 20, 155, 50, 30, 20]);
    let colors = (5121, "VEC3", true, vec![10, 20, 30, 0, 20, 20, 31, 0, 0, 0, 0, 0, 9, 9, 9]);
    let root = serde_json::json!({
        "meshes": [{"primitives": [{"indices": 1,
            "attributes": {"POSITION": 0, "JOINTS_0": 2, "WEIGHTS_0": 3, "COLOR_0": 4}}]}],
    });
    let doc = made(root, &[positions, indices, joints, weights, colors]);
    let surface = doc.surface(None).unwrap();
    let synthesis = subdivided(&surface);
    let sets = uv_sets(&synthesis);
    let baked = BakedMaps::default();
    let output = UvSetOutput { weld_texels: 100.0, ..plain(&baked) };
    let back = again(&write_uv_sets(&doc, &surface, &synthesis, &sets, &output).unwrap());
    let attributes = &back.root["meshes"][0]["primitives"][0]["attributes"];
    let read = |name: &str| {
        let a = &back.accessors[refs::index(attributes, name).unwrap()];
        (a.packed(&back.buffers), a.format.size())
    };
    let (at, stride) = read("POSITION");
    let find = |p: [f32; 3]| at.chunks(stride).position(|b| b == f32s(&p)).unwrap();
    let of = |name: &str, i: usize| {
        let (bytes, size) = read(name);
        bytes[i * size..(i + 1) * size].to_vec()
    };
    // A corner is as it was; between the first two, joint 1 has 77.5 + 12.5, 5 has 50, 6 has 40, then 2 and 7 have 25.
    let corner = find([1., 0., 0.]);
    assert_eq!((of("JOINTS_0", corner), of("WEIGHTS_0", corner)), (vec![5, 6, 7, 1], vec![100, 80, 50, 25]));
    let middle = find([0.5, 0., 0.]);
    assert_eq!(of("JOINTS_0", middle), [1, 5, 6, 2]);
    let weights = of("WEIGHTS_0", middle);
    assert_eq!(weights.iter().map(|&w| u32::from(w)).sum::<u32>(), 255);
    assert_eq!(weights, [112, 62, 50, 31]);
    assert_eq!(of("COLOR_0", middle), [15, 20, 31]);
    let kiln: Vec<u8> = read("_KILN_WEIGHTS").0;
    assert!(kiln.chunks(4).all(|w| w.iter().map(|&w| u32::from(w)).sum::<u32>() == 255));
}

#[test]
fn triangles_for_a_cache_are_the_same_in_another_order() {
    use crate::synth::mesh::rendering_sequence::{CACHE, acmr};
    for path in scenes("meshes") {
        let Ok((doc, surface)) = read(&path).and_then(|d| d.surface(None).map(|s| (d, s))) else { continue };
        if !(500..10_000).contains(&surface.mesh.faces.len()) {
            continue;
        }
        let synthesis = subdivided(&surface);
        let (sets, maps) = (uv_sets(&synthesis), maps(&[Use::BaseColor]));
        let written = |triangles| {
            let output = UvSetOutput { weld_texels: 100.0, triangles, ..plain(&maps) };
            again(&write_uv_sets(&doc, &surface, &synthesis, &sets, &output).unwrap()).surface(None).unwrap()
        };
        let [before, after] = [TriangleOrder::Input, TriangleOrder::Cache].map(written);
        let triangles = |s: &crate::mesh::Surface| {
            let corner = |f: usize, k: usize| {
                let (p, uv) = (s.mesh.corners(f)[k], s.corner_uvs[0][3 * f + k]);
                [p.x.to_bits(), p.y.to_bits(), p.z.to_bits(), u64::from(uv.u.to_bits()), u64::from(uv.v.to_bits())]
            };
            let mut all: Vec<_> = (0..s.mesh.faces.len()).map(|f| [0, 1, 2].map(|k| corner(f, k))).collect();
            all.sort_unstable();
            all
        };
        assert_eq!(triangles(&before), triangles(&after), "{}", path.display());
        assert_eq!(before.mesh.positions.len(), after.mesh.positions.len());
        let ratio = |s: &crate::mesh::Surface| acmr(&s.mesh.faces, s.mesh.positions.len(), CACHE);
        println!("{}: {:.3} to {:.3}", path.display(), ratio(&before), ratio(&after));
        assert!(ratio(&after) <= ratio(&before) * 1.05, "{}", path.display());
    }
}

#[test]
fn the_measure_of_a_triangles_edge_is_at_all_its_corners_and_keeps_vertices_apart() {
    let [positions, indices] = square();
    let root = serde_json::json!({ "meshes": [{"primitives": [{"indices": 1, "attributes": {"POSITION": 0}}]}] });
    let doc = made(root, &[positions, indices]);
    let surface = doc.surface(None).unwrap();
    let synthesis = subdivided(&surface);
    let (sets, baked) = (uv_sets(&synthesis), BakedMaps::default());
    let faces = synthesis.mesh.faces.len();
    let metric: Vec<[f32; 2]> = (0..3 * faces).map(|c| [(c / 3) as f32, 2.5]).collect();
    let output = UvSetOutput { weld_texels: 100.0, edge_metric: &metric, ..plain(&baked) };
    let back = again(&write_uv_sets(&doc, &surface, &synthesis, &sets, &output).unwrap());
    let primitive = &back.root["meshes"][0]["primitives"][0];
    let read = |a: usize| back.accessors[a].packed(&back.buffers);
    let edge = read(refs::index(&primitive["attributes"], "_KILN_EDGE").unwrap());
    assert_eq!(edge.len(), 8 * 3 * faces, "no two triangles share a vertex");
    let values: Vec<[f32; 2]> = bytemuck::pod_collect_to_vec(&edge);
    for f in back.surface(None).unwrap().mesh.faces {
        assert!(f.iter().all(|v| values[*v as usize] == values[f[0] as usize]));
    }
    assert_eq!(back.root["materials"][0]["extensions"]["KILN_uv_sets"]["edge"], "_KILN_EDGE");
    let short = UvSetOutput { edge_metric: &metric[1..], ..output };
    let fault = write_uv_sets(&doc, &surface, &synthesis, &sets, &short).unwrap_err().to_string();
    assert!(fault.contains("edge measures"), "{fault}");
}

#[test]
fn in_material_space_triangles_with_one_look_up_are_a_primitive_with_one_set() {
    let [positions, indices] = square();
    let normals = (5126, "VEC3", false, f32s(&[0.0, 0.0, 1.0].repeat(4)));
    let uvs = (5126, "VEC2", false, f32s(&[0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0, 1.0]));
    let root = serde_json::json!({
        "materials": [{"name": "Stone"}, {"name": "Gilt", "emissiveTexture": {"index": 0}}],
        "textures": [{}],
        "extensionsUsed": ["KHR_materials_variants"],
        "extensions": {"KHR_materials_variants": {"variants": [{"name": "plain"}, {"name": "gilt"}]}},
        "meshes": [{"name": "M", "primitives": [
            {"indices": 1, "material": 0, "extras": {"kept": 1}, "attributes": {"POSITION": 0, "NORMAL": 2, "TEXCOORD_0": 3},
             "targets": [{"POSITION": 2}],
             "extensions": {"KHR_materials_variants": {"mappings": [
                {"variants": [0], "material": 0}, {"variants": [1], "material": 1}]}}},
            {"mode": 1, "attributes": {"POSITION": 0}},
        ]}],
    });
    let doc = made(root, &[positions, indices, normals, uvs]);
    let surface = doc.surface(None).unwrap();
    let synthesis = subdivided(&surface);
    let mut sets = uv_sets(&synthesis);
    // Only the second triangle of the input blends.
    let faces = synthesis.mesh.faces.len();
    sets.weights[..3 * faces / 2].fill([1.0, 0.0, 0.0, 0.0]);
    let values: Vec<f32> = (0..3 * faces).map(|c| (synthesis.mesh.faces[c / 3][c % 3] % 3) as f32 / 2.0).collect();
    let space = MaterialSpace { values: &values, layers: 4, tile: "m.tile.ktx2" };
    let baked = BakedMaps::default();
    let output = UvSetOutput { material_space: Some(space), ..plain(&baked) };
    let back = again(&write_uv_sets(&doc, &surface, &synthesis, &sets, &output).unwrap());
    let primitives = list(&back.root["meshes"][0], "primitives");
    assert_eq!(primitives.len(), 3);
    assert_eq!(primitives[1]["mode"], 1, "what was not baked keeps its place");
    for (p, count, name, shown) in [(0, 1, "Stone", 0..faces / 2), (2, 3, "Stone (3 sets)", faces / 2..faces)] {
        let (primitive, shown): (&Value, Vec<usize>) = (&primitives[p], shown.collect());
        let material = |of: &Value| &list(&back.root, "materials")[refs::index(of, "material").unwrap()];
        let kiln = &material(primitive)["extensions"]["KILN_uv_sets"];
        assert_eq!((&kiln["sets"], &material(primitive)["name"]), (&count.into(), &name.into()));
        assert_eq!((&kiln["material"], &kiln["layers"]), (&"_KILN_MATERIAL".into(), &4.into()));
        assert_eq!(primitive["extras"]["kept"], 1);
        assert_eq!(list(primitive, "targets").len(), 1);
        // The input's coordinates follow the sets, and the other variant's material follows them.
        let names: Vec<&str> = primitive["attributes"].as_object().unwrap().keys().map(String::as_str).collect();
        let coordinates: Vec<&str> = names.iter().filter(|n| n.starts_with("TEXCOORD_")).copied().collect();
        assert_eq!(coordinates, ["TEXCOORD_0", "TEXCOORD_1", "TEXCOORD_2", "TEXCOORD_3"][..=count]);
        let mappings = list(&primitive["extensions"]["KHR_materials_variants"], "mappings");
        assert_eq!(mappings[0]["material"], primitive["material"]);
        assert_eq!(material(&mappings[1])["emissiveTexture"]["texCoord"], count);
        // Every corner looks up what it did.
        let read = |name: &str| {
            let a = &back.accessors[refs::index(&primitive["attributes"], name).unwrap()];
            let (size, unit) = (a.format.component.size(), a.format.component.unit());
            let numbers = a.packed(&back.buffers).chunks(size).map(|b| a.format.component.read(b) / unit).collect();
            (numbers, a.format.size() / size)
        };
        let corners: Vec<u32> = triangles::triangles(&back, primitive).concat();
        assert_eq!(corners.len(), 3 * shown.len());
        let same = |name: &str, expected: &dyn Fn(usize) -> Vec<f64>| {
            let (numbers, n): (Vec<f64>, usize) = read(name);
            for (k, &v) in corners.iter().enumerate() {
                let found = &numbers[v as usize * n..(v as usize + 1) * n];
                assert_eq!(found, expected(3 * shown[k / 3] + k % 3), "{name} of corner {k} of primitive {p}");
            }
        };
        for s in 0..count {
            let uv = |c: usize| vec![f64::from(sets.sets[s][c].x / 128.0), f64::from(sets.sets[s][c].y / 64.0)];
            same(&format!("TEXCOORD_{s}"), &uv);
        }
        same("_KILN_WEIGHTS", &|c| sets.weights[c].map(f64::from).to_vec());
        same("_KILN_MATERIAL", &|c| vec![f64::from(values[c])]);
    }
}
