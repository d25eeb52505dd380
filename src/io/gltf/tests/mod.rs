//! Tests over real files: `../shared/data` beside the project. With `KILN_TEST_OUT` set to a folder, what is written
//! lands there too, for a look with other tools.

mod atlas;
mod preserve;
mod uvsets;

use std::path::{Path, PathBuf};

use serde_json::Value;

use super::refs::list;
use super::*;
use crate::io::SceneError;
use crate::mesh::Surface;
use crate::numerics::vec::Vec3;
use crate::texture::Uv;

/// The folder of real files, if it is there.
fn data(folder: &str) -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data").join(folder);
    if !path.is_dir() {
        println!("skipped: no {}", path.display());
    }
    path.is_dir().then_some(path)
}

/// All scenes below a folder, sorted.
fn scenes(folder: &str) -> Vec<PathBuf> {
    let mut out = Vec::new();
    let mut stack: Vec<PathBuf> = data(folder).into_iter().collect();
    while let Some(at) = stack.pop() {
        for entry in std::fs::read_dir(at).unwrap().map(|e| e.unwrap().path()) {
            match entry.extension().and_then(|e| e.to_str()) {
                _ if entry.is_dir() => stack.push(entry),
                Some("glb" | "gltf" | "obj") => out.push(entry),
                _ => {}
            }
        }
    }
    out.sort();
    out
}

fn read(path: &Path) -> Result<Document, SceneError> {
    let folder = path.parent().unwrap().to_path_buf();
    let name = path.file_name().unwrap().to_str().unwrap();
    let bytes = std::fs::read(path).unwrap();
    let files = crate::io::scene::external_files(name, &bytes)?;
    Document::parse(name, &bytes, &mut |file| {
        assert!(files.iter().any(|f| f == file), "{file} is not listed");
        std::fs::read(folder.join(file)).map_err(|e| e.to_string())
    })
}

fn scene(path: &str) -> Option<(Document, Surface)> {
    let doc = read(&data("meshes")?.join(path)).unwrap();
    let surface = doc.surface(None).unwrap();
    Some((doc, surface))
}

/// Reads what was written: it needs no other file.
fn again(glb: &[u8]) -> Document {
    Document::parse("out.glb", glb, &mut |f| Err(format!("{f} is asked for"))).unwrap()
}

fn dump(name: &Path, kind: &str, glb: &[u8]) {
    if let Some(folder) = std::env::var_os("KILN_TEST_OUT") {
        let stem = name.file_name().unwrap().to_str().unwrap().replace('.', "_");
        std::fs::write(Path::new(&folder).join(format!("{stem}.{kind}.glb")), glb).unwrap();
    }
}

/// A white PNG of one texel.
const PNG: [u8; 69] = [
    0x89, 0x50, 0x4e, 0x47, 0x0d, 0x0a, 0x1a, 0x0a, 0, 0, 0, 0x0d, 0x49, 0x48, 0x44, 0x52, 0, 0, 0, 1, 0, 0, 0, 1, 8,
    2, 0, 0, 0, 0x90, 0x77, 0x53, 0xde, 0, 0, 0, 0x0c, 0x49, 0x44, 0x41, 0x54, 0x78, 0x9c, 0x63, 0xf8, 0xff, 0xff,
    0x3f, 0, 5, 0xfe, 2, 0xfe, 0x0d, 0xef, 0x46, 0xb8, 0, 0, 0, 0, 0x49, 0x45, 0x4e, 0x44, 0xae, 0x42, 0x60, 0x82,
];

fn maps(uses: &[Use]) -> BakedMaps {
    let image =
        |&usage: &Use| BakedImage { usage, mime: "image/png".into(), bytes: PNG.to_vec(), name: format!("{usage:?}") };
    BakedMaps {
        material_name: "Baked".into(),
        images: uses.iter().map(image).collect(),
        alpha: AlphaMode::Opaque,
        repeats: false,
    }
}

/// A point's coordinates in a made-up atlas; with `seams` each face is an island.
fn atlas_uv(surface: &Surface, seams: bool) -> Vec<Uv> {
    let corner = |c: usize| {
        let p = surface.mesh.corners(c / 3)[c % 3];
        let island = if seams { (c / 3) as f32 * 1e-3 } else { 0.0 };
        Uv { u: (p.x + 0.3 * p.z) as f32 + island, v: (p.y - 0.2 * p.z) as f32 }
    };
    (0..3 * surface.mesh.faces.len()).map(corner).collect()
}

fn tangents(surface: &Surface) -> Vec<[f32; 4]> {
    let tangent = |n: &Vec3| {
        let [x, y, z] = n.any_perpendicular().to_f32();
        [x, y, z, 1.0]
    };
    surface.corner_normals.iter().map(tangent).collect()
}

/// The corners of all faces; they must not move by a bit.
fn corners(surface: &Surface) -> Vec<[Vec3; 3]> {
    (0..surface.mesh.faces.len()).map(|f| surface.mesh.corners(f)).collect()
}

#[test]
fn broken_scenes_are_refused_at_once_and_in_one_line() {
    for path in scenes("broken") {
        let start = std::time::Instant::now();
        let fault = read(&path).and_then(|doc| doc.surface(None)).expect_err(&path.display().to_string()).to_string();
        assert!(!fault.is_empty() && !fault.contains('\n') && fault.len() < 400, "{}: {fault}", path.display());
        assert!(start.elapsed().as_secs_f64() < 1.0, "{}", path.display());
    }
    let Some(folder) = data("broken") else { return };
    for (file, part) in [
        ("accessor_missing.glb", "meshes[0].primitives[0].attributes.POSITION: 99"),
        ("bad_version.glb", "version 7"),
        ("data_uri_bad_base64.gltf", "base64"),
        ("index_count_not_3n.glb", "2003 corners"),
        ("index_is_float.glb", "componentType 5126"),
        ("index_out_of_range.glb", "60000"),
        ("nan_position.glb", "element 5 is NaN"),
        ("node_cycle_of_two.glb", "ancestor"),
        ("unknown_required_extension.glb", "EXT_nobody_knows"),
        ("uri_climbs_out.gltf", "climbs out"),
        ("uri_http.gltf", "offline"),
        ("uv_is_vec3.glb", "TEXCOORD_0: found type VEC3"),
    ] {
        let fault = read(&folder.join(file)).unwrap_err().to_string();
        assert!(fault.contains(part), "{file}: {fault}");
    }
}

#[test]
fn compressed_views_equal_their_fallback() {
    let Some((doc, surface)) = scene("gltf/MeshoptFallback/meshopt-fallback.gltf") else { return };
    let folder = data("meshes").unwrap().join("gltf/MeshoptFallback");
    let fallback = std::fs::read(folder.join("meshopt-fallback.fallback.bin")).unwrap();
    // The codec may turn triangles; and this file's fallback holds normals before the filter (its validator says so).
    let decoded: Vec<u8> = doc.buffers[2..].concat();
    assert_eq!(decoded[..400], fallback[..400]);
    let triangles = |bytes: &[u8]| -> Vec<[u8; 3]> {
        let indices: Vec<u8> = bytes.chunks(2).map(|b| b[0]).collect();
        let least_first = |t: &[u8]| {
            let k = (0..3).min_by_key(|&k| t[k]).unwrap();
            [t[k], t[(k + 1) % 3], t[(k + 2) % 3]]
        };
        indices.chunks(3).map(least_first).collect()
    };
    assert_eq!(triangles(&decoded[600..]), triangles(&fallback[600..]));
    // The first part is a cube.
    for c in surface.parts[0].faces.clone() {
        let flat = surface.mesh.area_vector(c as usize).normalized().unwrap();
        assert!((0..3).all(|k| (surface.corner_normals[3 * c as usize + k] - flat).length() < 1e-6));
    }
    assert_eq!(surface.mesh.faces.len(), 60);
    let (doc, packed) = scene("gltf/CheburashkaMeshopt/cheburashka_meshopt.glb").unwrap();
    let (_, plain) = scene("glb/cheburashka.glb").unwrap();
    assert_eq!(packed.mesh.faces.len(), plain.mesh.faces.len());
    let (a, b) = (packed.mesh.bounds(), plain.mesh.bounds());
    assert!((a.0 - b.0).length() < 1e-3 && (a.1 - b.1).length() < 1e-3, "{a:?} {b:?}");
    assert!(list(&doc.root, "extensionsRequired").iter().all(|e| e == "KHR_mesh_quantization"));
}

#[test]
fn damaged_files_never_panic() {
    use crate::numerics::rng::Key;
    for file in
        ["glb/bob.glb", "gltf/MeshoptBox/BoxMeshopt.glb", "gltf/SimpleSkin/SimpleSkin.gltf", "obj/negative-indices.obj"]
    {
        let Some(path) = data("meshes").map(|d| d.join(file)) else { return };
        let bytes = std::fs::read(&path).unwrap();
        for round in 0..400u64 {
            let key = Key::new(1).with_str("damage").with(round);
            let mut spoilt = bytes.clone();
            for k in 0..1 + round % 4 {
                let draw = |what: u64| key.bits(8 * k + what);
                // Mostly in the JSON, which comes first; digits are likelier than others to still parse.
                let end = if round % 3 == 0 { spoilt.len() } else { spoilt.len().min(1500) } as u64;
                let at = (draw(0) % end) as usize;
                spoilt[at] = if spoilt[at].is_ascii_digit() { b'0' + (draw(1) % 10) as u8 } else { draw(1) as u8 };
            }
            let name = path.file_name().unwrap().to_str().unwrap();
            let parsed = Document::parse(name, &spoilt, &mut |_| Err("no files".into()));
            let Ok((doc, surface)) = parsed.and_then(|d| d.surface(None).map(|s| (d, s))) else { continue };
            let uv = atlas_uv(&surface, false);
            write_atlas(&doc, &surface, &AtlasCorners { uv: &uv, tangents: None }, &maps(&[])).unwrap();
        }
    }
}

/// A document of one buffer: accessors are (component type, type, normalized, bytes).
fn made(mut root: Value, accessors: &[(u32, &str, bool, Vec<u8>)]) -> Document {
    let (mut bin, mut views, mut list) = (Vec::<u8>::new(), Vec::new(), Vec::new());
    for (kind, shape, normalized, bytes) in accessors {
        let component = [1, 1, 2, 2, 4, 4, 4][(*kind - 5120) as usize];
        let width = ["SCALAR", "VEC2", "VEC3", "VEC4"].iter().position(|s| s == shape).unwrap() + 1;
        let mut view = serde_json::json!({"buffer": 0, "byteOffset": bin.len(), "byteLength": bytes.len()});
        let size = component * width;
        if size % 4 != 0 && *shape != "SCALAR" {
            view["byteStride"] = (size + 4 - size % 4).into();
        }
        let stride = view["byteStride"].as_u64().map_or(size, |s| s as usize);
        let count = (bytes.len() + stride - size) / stride;
        list.push(serde_json::json!({"bufferView": views.len(), "componentType": kind, "type": shape, "count": count,
            "normalized": normalized}));
        views.push(view);
        bin.extend_from_slice(bytes);
        bin.resize(bin.len().next_multiple_of(4), 0);
    }
    root["asset"] = serde_json::json!({"version": "2.0"});
    root["accessors"] = list.into();
    root["bufferViews"] = views.into();
    root["buffers"] = serde_json::json!([{"byteLength": bin.len()}]);
    let mut whole = container::Bin::default();
    whole.push(bin);
    again(&container::join(&root, whole).unwrap())
}

fn f32s(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

/// Two triangles of a unit square, positions first, then indices.
fn square() -> [(u32, &'static str, bool, Vec<u8>); 2] {
    let indices: Vec<u8> = [0u16, 1, 2, 0, 2, 3].iter().flat_map(|i| i.to_le_bytes()).collect();
    [(5126, "VEC3", false, f32s(&[0., 0., 0., 1., 0., 0., 1., 1., 0., 0., 1., 0.])), (5123, "SCALAR", false, indices)]
}

#[test]
fn materials_are_chosen_by_name() {
    let Some((doc, all)) = scene("gltf/Mob/mob.glb") else { return };
    let names = doc.summary().materials;
    let one = doc.surface(Some(&names[1..2])).unwrap();
    assert!(one.parts.len() == 1 && one.mesh.faces.len() < all.mesh.faces.len());
    let wrong = format!("{}x", names[1]);
    let text = doc.surface(Some(&[wrong])).unwrap_err().to_string();
    assert!(text.contains(&format!("did you mean \"{}\"?", names[1])) && text.contains(&names[2]), "{text}");
}
