//! Every broken file of the development data: one clear sentence that names the file, an exit code of 1 or 2, no panic,
//! bounded time, and no output left behind.

mod common;

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use common::{Project, shared};

/// Not broken after all, or broken where kiln does not look: these may bake.
const MAY_WORK: &[&str] = &["flat.png", "image_png_named.jpg", "CesiumLogoFlat.png"];

fn below(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).expect("the broken files").flatten() {
        let path = entry.path();
        if path.is_dir() { below(&path, found) } else { found.push(path) }
    }
    found.sort();
}

/// A recipe in which `broken` stands where its kind belongs.
fn recipe(broken: &Path, good_mesh: &Path, good_map: &Path) -> Option<String> {
    let name = broken.file_name()?.to_str()?;
    let (mut mesh, mut maps) = (good_mesh.to_path_buf(), format!("base_color = {good_map:?}"));
    match broken.extension()?.to_str()? {
        "glb" | "gltf" | "obj" => mesh = broken.to_path_buf(),
        "png" | "jpg" if broken.parent().is_some_and(|p| p.ends_with("set_size_mismatch")) => {
            let other = broken.with_file_name(if name == "albedo.png" { "normal.png" } else { "albedo.png" });
            maps = format!("base_color = {broken:?}\nnormal = {other:?}");
        }
        "png" | "jpg" if name.starts_with("mask") => maps += &format!("\nfeature_mask = {broken:?}"),
        "png" | "jpg" => maps = format!("base_color = {broken:?}"),
        _ => return None,
    }
    Some(format!("[mesh]\npath = {mesh:?}\n[exemplar]\n{maps}\n[synthesis]\nscale = 60.0\n[atlas]\nsize = 64\n"))
}

#[test]
fn broken_files_get_a_sentence() {
    let Some(folder) = shared("broken") else { return };
    let (Some(mesh), Some(map)) = (shared("meshes/glb/bob.glb"), shared("textures/leopard_128.png")) else { return };
    let mut files = Vec::new();
    below(&folder, &mut files);
    let (mut tried, mut wrong) = (0, Vec::new());
    for file in files {
        let Some(recipe) = recipe(&file, &mesh, &map) else { continue };
        tried += 1;
        let project = Project::new();
        project.write("recipes/broken.toml", recipe);
        let begun = Instant::now();
        let ran = project.kiln(&["bake", "-q"]);
        let took = begun.elapsed();
        let name = file.file_name().and_then(|n| n.to_str()).unwrap_or_default();
        let lenient = MAY_WORK.contains(&name) || file.parent().is_some_and(|p| p.ends_with("khronos-validator"));
        let mut complain = |what: &str| wrong.push(format!("{}: {what}\n{}", file.display(), ran.err));
        if took > Duration::from_secs(30) {
            complain(&format!("took {took:?}"));
        }
        if ran.err.contains("panicked") || !(0..=2).contains(&ran.code) {
            complain("a panic or a crash");
        } else if ran.code == 0 {
            if !lenient {
                complain("baked as if nothing were wrong");
            }
        } else {
            let pair = file.parent().is_some_and(|p| p.ends_with("set_size_mismatch"));
            let names_it = ran.err.contains(name) || (pair && ran.err.contains("normal.png"));
            if !names_it || ran.err.lines().count() > 12 {
                complain("no clear sentence that names the file");
            }
            if !project.files("out").is_empty() {
                complain("left an output behind");
            }
        }
    }
    assert!(tried > 80, "only {tried} broken files were tried");
    assert!(wrong.is_empty(), "{} of {tried}:\n{}", wrong.len(), wrong.join("\n"));
}

#[test]
fn an_exemplar_of_one_colour_bakes_to_that_colour() {
    let (Some(flat), Some(mesh)) = (shared("broken/flat.png"), shared("meshes/glb/bob.glb")) else { return };
    let project = Project::new();
    project.write("recipes/flat.toml", recipe(&flat, &mesh, &flat).expect("a recipe"));
    project.kiln(&["bake"]).expect(0);
    let decode = |bytes: Vec<u8>| {
        let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().expect("a PNG");
        let mut data = vec![0; reader.output_buffer_size().expect("a size")];
        let info = reader.next_frame(&mut data).expect("a frame");
        data.truncate(info.buffer_size());
        data.chunks(3).map(<[u8]>::to_vec).collect::<std::collections::BTreeSet<_>>()
    };
    let colors = decode(project.read("out/flat/flat.base_color.png"));
    assert_eq!(colors.len(), 1, "{colors:?}");
}
