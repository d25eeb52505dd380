//! `kiln init`: a commented recipe to start from.

use std::path::{Component, Path, PathBuf};

use crate::disk::{Disk, Real};
use crate::io::image_file::{Limits, decode_pixels};
use crate::io::named;
use crate::io::scene::Document;
use crate::recipe::{MapFile, Starter, guess_map, is_feature_mask, template};

use super::args::{Global, Init};
use super::{Done, Stop};

/// Largest file that is looked into, in bytes.
const LIMIT: u64 = 1 << 31;
/// How many times the sample goes into the longest side of the mesh, as a first guess.
const REPEATS: f64 = 3.0;

/// Writes or prints the recipe.
pub(super) fn run(global: &Global, args: &Init) -> Result<Done, Stop> {
    let folder = match &args.output {
        Some(file) => file.parent().unwrap_or(Path::new("")).to_path_buf(),
        None => PathBuf::from("recipes"),
    };
    let (mut maps, mut mask): (Vec<(MapFile, PathBuf)>, Option<PathBuf>) = (Vec::new(), None);
    for file in pictures(&args.exemplar)? {
        let stem = file.file_stem().and_then(|s| s.to_str()).unwrap_or_default().to_string();
        if is_feature_mask(&stem) {
            mask.get_or_insert(file);
            continue;
        }
        let map = guess_map(&stem).or((args.exemplar.len() == 1).then_some(MapFile::BaseColor));
        match map {
            Some(map) if maps.iter().all(|(m, _)| *m != map) => maps.push((map, file)),
            _ => {}
        }
    }
    if maps.is_empty() {
        let names = args.exemplar.iter().map(|p| p.display().to_string()).collect::<Vec<_>>().join(", ");
        let known = "base_color, normal, roughness, metallic, occlusion, height, emissive, opacity, orm";
        return Err(Stop::Usage(format!("{names}: no picture there is named like a map; expected names with {known}")));
    }
    // A single map and its parts are never both there.
    if maps.iter().any(|(m, _)| *m == MapFile::Orm) {
        maps.retain(|(m, _)| !matches!(m, MapFile::Occlusion | MapFile::Roughness | MapFile::Metallic));
    }
    let scale = guess_scale(&args.mesh, &maps[0].1)?;
    let written: Vec<(MapFile, String)> = maps.iter().map(|(m, p)| (*m, relative(&folder, p))).collect();
    let (mesh, mask) = (relative(&folder, &args.mesh), mask.map(|p| relative(&folder, &p)));
    let text = template(&Starter { mesh: &mesh, maps: &written, feature_mask: mask.as_deref(), scale });
    let Some(file) = &args.output else { return Done::ok(text) };
    if !matches!(Real.stamp(file), Ok(None)) {
        return Err(Stop::Usage(format!("{} is there already; kiln init does not overwrite", file.display())));
    }
    if global.dry_run {
        return Done::ok(format!("would write {}\n", file.display()));
    }
    super::bake::write(file, text.as_bytes())?;
    Done::ok(format!("{}\n", file.display()))
}

/// The files given, and the pictures of the folders given.
fn pictures(given: &[PathBuf]) -> Result<Vec<PathBuf>, Stop> {
    let mut files = Vec::new();
    for path in given {
        match Real.stamp(path) {
            Ok(Some(_)) => files.push(path.clone()),
            Ok(None) => return Err(Stop::Usage(format!("{}: there is no such file or folder", path.display()))),
            Err(e) if e.kind() == std::io::ErrorKind::IsADirectory => {
                let below = Real.list(path).map_err(|e| Stop::Failed(format!("{}: {e}", path.display())))?;
                let is_picture = |p: &PathBuf| {
                    let ext = p.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
                    matches!(ext.as_deref(), Some("png" | "jpg" | "jpeg" | "exr")) && p.parent() == Some(path)
                };
                files.extend(below.into_iter().filter(is_picture));
            }
            Err(e) => return Err(Stop::Failed(format!("{}: {e}", path.display()))),
        }
    }
    Ok(files)
}

/// Texels per unit at which the sample fits a few times into the mesh, to two digits; `None` for a mesh without extent.
fn guess_scale(mesh: &Path, picture: &Path) -> Result<Option<f64>, Stop> {
    let read = |path: &Path| Real.read(path, LIMIT).map_err(|e| Stop::Failed(format!("{}: {e}", path.display())));
    let folder = mesh.parent().unwrap_or(Path::new(""));
    let mut resolve = |uri: &str| Real.read(&folder.join(uri), LIMIT).map_err(|e| e.to_string());
    let name = mesh.display().to_string();
    let document = Document::parse(&name, &read(mesh)?, &mut resolve).map_err(|e| Stop::Failed(named(&name, &e)))?;
    let surface = document.surface(None).map_err(|e| Stop::Failed(named(&name, &e)))?;
    let pixels = decode_pixels(&read(picture)?, &Limits::default())
        .map_err(|e| Stop::Failed(format!("{}: {e}", picture.display())))?;
    let (low, high) = surface.mesh.bounds();
    let longest = (high.x - low.x).max(high.y - low.y).max(high.z - low.z);
    let scale = REPEATS * f64::from(pixels.width.min(pixels.height)) / longest;
    if !scale.is_normal() {
        return Ok(None);
    }
    // As a number of two digits, so that it reads well.
    Ok(format!("{scale:.1e}").parse().ok())
}

/// `path` as seen from `folder`, by name alone, with forward slashes.
fn relative(folder: &Path, path: &Path) -> String {
    if path.is_absolute() != folder.is_absolute() {
        return path.to_string_lossy().replace('\\', "/");
    }
    let parts = |p: &Path| -> Vec<String> {
        let names = p.components().filter(|c| !matches!(c, Component::CurDir));
        names.map(|c| c.as_os_str().to_string_lossy().into_owned()).collect()
    };
    let (from, to) = (parts(folder), parts(path));
    let shared = from.iter().zip(&to).take_while(|(a, b)| a == b).count();
    let up = std::iter::repeat_n("..".to_string(), from.len() - shared);
    up.chain(to[shared..].iter().cloned()).collect::<Vec<_>>().join("/")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_are_written_as_the_recipe_sees_them() {
        let see = |folder: &str, path: &str| relative(Path::new(folder), Path::new(path));
        assert_eq!(see("recipes", "statue.glb"), "../statue.glb");
        assert_eq!(see("recipes", "recipes/assets/a.png"), "assets/a.png");
        assert_eq!(see("", "a/b.png"), "a/b.png");
        assert_eq!(see("recipes", "/data/a.png"), "/data/a.png");
    }
}
