//! What lies in `golden/`: books, pictures beside them, and this machine's own copies of what was accepted.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use crate::disk::{Disk, Real};
use crate::golden::book::{Book, Kind, Outcome, Tolerance, compare_book};
use crate::golden::thumbnail;
use crate::io::Pixels;
use crate::io::image_file::{Compression, Transfer, decode_pixels, encode_png};
use crate::recipe::Recipe;

use super::baked::Baked;
use super::{OUTPUT_LIMIT, OWN_IMAGES, THUMB, failed};
use crate::cli::Stop;
use crate::cli::bake::write;
use crate::cli::project::{self, GOLDEN, OUT, OWN};

fn book_path(recipe: &str) -> PathBuf {
    Path::new(GOLDEN).join(format!("{recipe}.toml"))
}

/// The small picture of an output beside the book.
pub(super) fn picture_path(recipe: &str, output: &str) -> PathBuf {
    Path::new(GOLDEN).join(recipe).join(output).with_extension("png")
}

/// The folder of accepted files on this machine.
fn copies() -> PathBuf {
    Path::new(OWN).join("golden")
}

/// The accepted file of a digest on this machine.
pub(super) fn copy_path(digest: &str) -> PathBuf {
    copies().join(digest)
}

/// A recipe's book, if there is one.
pub(super) fn read_book(recipe: &str) -> Result<Option<Book>, Stop> {
    let path = book_path(recipe);
    match Real.read(&path, 16 << 20) {
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => Ok(None),
        Err(e) => Err(failed(format!("{}: {e}", path.display()))),
        Ok(bytes) => {
            let text = String::from_utf8_lossy(&bytes);
            Book::from_toml(&text).map(Some).map_err(|e| Stop::Usage(format!("{}: {e}", path.display())))
        }
    }
}

/// An image of golden/ or of this machine's copies.
pub(super) fn read_image(path: &Path) -> Option<Pixels> {
    decode_pixels(&Real.read(path, OUTPUT_LIMIT).ok()?, &OWN_IMAGES).ok()
}

/// A picture as a file.
pub(super) fn png(pixels: &Pixels) -> Result<Vec<u8>, Stop> {
    encode_png(pixels, Compression::Best, Transfer::Unstated).map_err(failed)
}

/// What is kept beside the book: renders, and whatever has a tolerance to be judged by, whole; else a thumbnail.
fn picture(kind: Kind, tolerance: Option<&Tolerance>, pixels: &Pixels) -> Pixels {
    if kind == Kind::Render || tolerance.is_some() { pixels.clone() } else { thumbnail(pixels, THUMB) }
}

/// Accepts outputs: writes the book, its pictures and this machine's copies; pictures of outputs that are gone go too.
pub(super) fn store(recipe: &Recipe, baked: &Baked, old: &Book, accepted: impl Fn(&str) -> bool) -> Result<(), Stop> {
    let name = &recipe.name;
    let mut book = baked.book.accepted_over(old, &accepted);
    for verdict in compare_book(old, &baked.book) {
        let is_same = verdict.outcome == Outcome::Same;
        if !is_same && !accepted(&verdict.name) {
            continue;
        }
        let Some(output) = book.outputs.iter_mut().find(|o| o.name == verdict.name) else {
            let path = picture_path(name, &verdict.name);
            Real.remove(&path).map_err(|e| failed(format!("{}: {e}", path.display())))?;
            continue;
        };
        let before = old.output(&verdict.name).map(|o| &o.quality).filter(|q| is_same && q.contains_key("swd"));
        output.quality = before.cloned().unwrap_or_else(|| baked.figures(recipe, output));
        let file = Path::new(OUT).join(name).join(&output.name);
        if let Some(pixels) = baked.images.get(&output.name) {
            let path = picture_path(name, &output.name);
            write(&path, &png(&picture(output.kind, output.tolerance.as_ref(), pixels))?)?;
        }
        if output.kind != Kind::File {
            let bytes = Real.read(&file, OUTPUT_LIMIT).map_err(|e| failed(format!("{}: {e}", file.display())))?;
            write(&copy_path(&output.blake3), &bytes)?;
        }
    }
    write(&book_path(name), book.to_toml().map_err(failed)?.as_bytes())
}

/// A golden that belongs to nothing.
pub(super) struct Stale {
    pub file: PathBuf,
    /// The recipe that it was of.
    pub recipe: String,
    pub why: String,
}

/// Books of recipes that are gone, and pictures that no book names.
pub(super) fn stale() -> Result<Vec<Stale>, Stop> {
    let golden = Path::new(GOLDEN);
    // Where there are no recipes at all this is an error: the wrong folder is no reason to throw every golden away.
    let recipes = project::all(&Real)?;
    let recipes: BTreeSet<&str> = recipes.iter().filter_map(|f| f.file_stem()?.to_str()).collect();
    let mut found = Vec::new();
    // Pictures of one recipe are listed together.
    let mut last: (String, Result<Option<Book>, Stop>) = (String::new(), Ok(None));
    for file in Real.list(golden).map_err(|e| failed(format!("{GOLDEN}: {e}")))? {
        let below = file.strip_prefix(golden).unwrap_or(&file);
        let hidden = below.iter().any(|part| part.as_encoded_bytes().starts_with(b"."));
        let extension = below.extension().and_then(|e| e.to_str());
        let Some(first) = below.iter().next().and_then(|part| part.to_str()).filter(|_| !hidden) else { continue };
        let in_folder = below.iter().count() > 1;
        let recipe = if in_folder { first } else { first.strip_suffix(".toml").unwrap_or(first) };
        let is_picture = in_folder && extension == Some("png");
        let is_book = !in_folder && extension == Some("toml");
        let why = if !is_picture && !is_book {
            continue;
        } else if !recipes.contains(recipe) {
            format!("there is no recipe `{recipe}` in recipes/")
        } else if is_book {
            continue;
        } else {
            if last.0 != recipe {
                last = (recipe.to_string(), read_book(recipe));
            }
            match &last.1 {
                Ok(Some(book)) if book.outputs.iter().all(|o| picture_path(recipe, &o.name) != file) => {
                    format!("{} names no such output", book_path(recipe).display())
                }
                Ok(None) => format!("there is no {}", book_path(recipe).display()),
                // A book that cannot be read says so elsewhere.
                _ => continue,
            }
        };
        let recipe = recipe.to_string();
        found.push(Stale { file, recipe, why });
    }
    Ok(found)
}

/// This machine's copies of what no book holds any more.
pub(super) fn stale_copies() -> Result<Vec<PathBuf>, Stop> {
    let mut held = BTreeSet::new();
    for file in Real.list(Path::new(GOLDEN)).unwrap_or_default() {
        let is_book = file.parent() == Some(Path::new(GOLDEN)) && file.extension().is_some_and(|e| e == "toml");
        if let Some(recipe) = file.file_stem().and_then(|s| s.to_str()).filter(|_| is_book) {
            held.extend(read_book(recipe)?.into_iter().flat_map(|b| b.outputs).map(|o| o.blake3));
        }
    }
    let mut copies = Real.list(&copies()).map_err(failed)?;
    copies.retain(|f| f.file_name().and_then(|n| n.to_str()).is_some_and(|n| !held.contains(n)));
    Ok(copies)
}
