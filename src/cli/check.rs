//! `kiln check` and `kiln accept`: bake, then compare with `golden/`, or make it golden.
//!
//! `golden/<recipe>.toml` is the book; beside it, in `golden/<recipe>/`, lies a small picture of every image: renders
//! whole, maps as thumbnails. `.kiln/golden/` keeps the accepted files of this machine under their digests, so that a
//! mismatch can be shown in full where the outputs were accepted here.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::build::Report;
use crate::disk::{Disk, Real};
use crate::golden::book::{Book, Kind, Outcome, Output, Step, Tolerance, compare_book, first_differing_step};
use crate::golden::compare::{compare, triptych};
use crate::golden::digest::{digest_bytes, digest_glb, digest_pixels};
use crate::golden::report::{Entry, Status, html, junit};
use crate::golden::thumbnail;
use crate::io::Pixels;
use crate::io::image_file::{Compression, Limits, Transfer, decode_pixels, encode_png};
use crate::stage::plan::Planned;

use super::args::{Accept, Check, Format, Global};
use super::bake::{build, write};
use super::project::{self, GOLDEN, Loaded, OUT, OWN};
use super::{Done, Stop};

/// Largest output that is read back, in bytes.
const OUTPUT_LIMIT: u64 = 4 << 30;
/// Outputs may be larger than what is taken from strangers: the file was bounded before.
const OWN_IMAGES: Limits = Limits { max_side: u32::MAX, max_bytes: OUTPUT_LIMIT };
/// Side of the thumbnails of maps.
const THUMB: u32 = 96;
/// Side of a panel of expected / difference / actual.
const PANEL: u32 = 512;

/// The outputs of one recipe as they are on disk now.
struct Baked {
    book: Book,
    /// Decoded images by output name.
    images: BTreeMap<String, Pixels>,
}

fn failed(what: impl std::fmt::Display) -> Stop {
    Stop::Failed(what.to_string())
}

/// Reads the outputs of a recipe and names their content.
fn read_baked(planned: &Planned, loaded: &Loaded, report: &Report) -> Result<Baked, Stop> {
    let folder = Path::new(OUT).join(&planned.name);
    let (mut outputs, mut images) = (Vec::new(), BTreeMap::new());
    let mut quality = BTreeMap::new();
    for path in &planned.outputs {
        let say = |e: &dyn std::fmt::Display| failed(format!("{}: {e}", path.display()));
        let bytes = Real.read(path, OUTPUT_LIMIT).map_err(|e| say(&e))?;
        let name = path.strip_prefix(&folder).unwrap_or(path).to_string_lossy().replace('\\', "/");
        let kind = match path.extension().and_then(|e| e.to_str()) {
            Some("png" | "exr") if name.starts_with("render/") => Kind::Render,
            Some("png" | "exr") => Kind::Map,
            Some("glb") => Kind::Mesh,
            _ => Kind::File,
        };
        let (mut size, mut channels) = (None, None);
        let blake3 = match kind {
            Kind::Map | Kind::Render => {
                let pixels = decode_pixels(&bytes, &OWN_IMAGES).map_err(|e| say(&e))?;
                (size, channels) = (Some([pixels.width, pixels.height]), Some(pixels.channels));
                let digest = digest_pixels(&pixels);
                images.insert(name.clone(), pixels);
                digest
            }
            Kind::Mesh => digest_glb(&bytes).map_err(|e| say(&e))?,
            Kind::File => digest_bytes(&bytes),
        };
        if name == "report.json" {
            quality = figures(&bytes);
        }
        outputs.push(Output { name, kind, size, channels, blake3, tolerance: None, quality: BTreeMap::new() });
    }
    // The figures were measured on the base colour.
    for output in outputs.iter_mut().filter(|o| o.kind == Kind::Map && o.name.contains(".base_color.")) {
        output.quality = quality.clone();
    }
    Ok(Baked { book: Book::new(outputs, steps(planned, loaded, report)), images })
}

/// The atlas' figures of quality in a `report.json`.
fn figures(bytes: &[u8]) -> BTreeMap<String, f64> {
    let report: serde_json::Value = serde_json::from_slice(bytes).unwrap_or_default();
    let figures = report.pointer("/atlas/quality").and_then(serde_json::Value::as_object);
    figures.into_iter().flatten().filter_map(|(k, v)| Some((k.clone(), v.as_f64()?))).collect()
}

/// The recipe's steps with their artefacts. A step shared between recipes bears the name of the first, so only what
/// follows the recipe's name is kept.
fn steps(planned: &Planned, loaded: &Loaded, report: &Report) -> Vec<Step> {
    let artefacts: BTreeMap<&str, String> =
        report.steps.iter().filter_map(|s| Some((s.name.as_str(), s.artefact.as_ref()?.to_string()))).collect();
    let named = planned.steps.iter().map(|id| loaded.graph.name(*id));
    named
        .filter_map(|name| {
            let short = name.split_once('/').map_or(name, |(_, rest)| rest);
            Some(Step { name: short.to_string(), artefact: artefacts.get(name)?.clone() })
        })
        .collect()
}

fn book_path(recipe: &str) -> PathBuf {
    Path::new(GOLDEN).join(format!("{recipe}.toml"))
}

/// The small picture of an output beside the book.
fn picture_path(recipe: &str, output: &str) -> PathBuf {
    Path::new(GOLDEN).join(recipe).join(output).with_extension("png")
}

/// The accepted file on this machine.
fn copy_path(digest: &str) -> PathBuf {
    Path::new(OWN).join("golden").join(digest)
}

fn read_book(recipe: &str) -> Result<Option<Book>, Stop> {
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

/// What is kept beside the book: renders, and whatever has a tolerance to be judged by, whole; else a thumbnail.
fn picture(kind: Kind, tolerance: Option<&Tolerance>, pixels: &Pixels) -> Pixels {
    if kind == Kind::Render || tolerance.is_some() { pixels.clone() } else { thumbnail(pixels, THUMB) }
}

fn png(pixels: &Pixels) -> Result<Vec<u8>, Stop> {
    encode_png(pixels, Compression::Best, Transfer::Unstated).map_err(failed)
}

/// `kiln check`.
pub(super) fn check(global: &Global, check: &Check) -> Result<Done, Stop> {
    let mut loaded = project::load(global, &check.recipes.recipes)?;
    if global.dry_run {
        return super::plan::show(global, &loaded, false);
    }
    // Nothing that is remembered is trusted: a step whose revision was forgotten shows.
    loaded.options.force = true;
    // One recipe that fails does not hide how the others stand.
    loaded.options.keep_going = true;
    let report = build(global, &loaded)?;
    let mut success = report.is_success() && loaded.broken.is_empty();
    let mut entries = Vec::new();
    for (recipe, why) in &loaded.broken {
        entries.push(failure(recipe, why));
    }
    for planned in &loaded.planned {
        if is_built(planned, &loaded, &report) {
            entries.extend(judge(planned, &loaded, &report)?);
        } else {
            entries.push(failure(&planned.name, "could not be baked"));
        }
    }
    if let Some(path) = &check.report {
        write(path, html(&entries).as_bytes())?;
    }
    if let Some(path) = &check.junit {
        write(path, junit(&entries).as_bytes())?;
    }
    success &= !entries.iter().any(|e| e.status.is_failure());
    Ok(Done { text: verdicts(global, &entries), success })
}

/// A recipe without outputs to compare.
fn failure(recipe: &str, why: &str) -> Entry {
    let (recipe, output) = (recipe.to_string(), "bake".to_string());
    Entry { recipe, output, status: Status::Failed, message: why.to_string(), picture: None }
}

/// Whether all steps of a recipe were done.
fn is_built(planned: &Planned, loaded: &Loaded, report: &Report) -> bool {
    let all = steps(planned, loaded, report);
    all.len() == planned.steps.len()
}

/// Compares the outputs of one recipe with its book.
fn judge(planned: &Planned, loaded: &Loaded, report: &Report) -> Result<Vec<Entry>, Stop> {
    let recipe = &planned.name;
    let baked = read_baked(planned, loaded, report)?;
    let expected = read_book(recipe)?.unwrap_or_default();
    let step = first_differing_step(&expected, &baked.book).map(|s| s.name.clone());
    let mut entries = Vec::new();
    for verdict in compare_book(&expected, &baked.book) {
        let entry = |status, message: String, picture| Entry {
            recipe: recipe.clone(),
            output: verdict.name.clone(),
            status,
            message,
            picture,
        };
        let accept = format!("accept it by: kiln accept {recipe}");
        let image = baked.images.get(&verdict.name);
        entries.push(match &verdict.outcome {
            Outcome::Same => entry(Status::Same, String::new(), None),
            Outcome::New => {
                entry(Status::New, format!("not accepted yet; {accept}"), image.map(|p| thumbnail(p, PANEL)))
            }
            Outcome::Missing => entry(Status::Missing, format!("no longer an output; {accept}"), None),
            Outcome::Different { expected, actual } => {
                let (status, said, shown) = difference(recipe, expected, actual, image);
                let mut message = vec![said];
                message.extend(step.as_ref().map(|s| format!("first step that differs: {s}")));
                if let Some(shown) = &shown {
                    let path = Path::new(OWN).join("check").join(recipe).join(&verdict.name).with_extension("png");
                    write(&path, &png(shown)?)?;
                    message.push(format!("expected, difference, actual: {}", path.display()));
                }
                message.push(accept);
                entry(status, message.join("\n"), shown)
            }
        });
    }
    Ok(entries)
}

/// How an output differs: in figures, and as expected / difference / actual as far as the expected one is still there.
fn difference(recipe: &str, old: &Output, new: &Output, image: Option<&Pixels>) -> (Status, String, Option<Pixels>) {
    let Some(actual) = image else {
        return (Status::Different, "the content differs".into(), None);
    };
    let decode = |path: PathBuf| {
        let bytes = Real.read(&path, OUTPUT_LIMIT).ok()?;
        decode_pixels(&bytes, &OWN_IMAGES).ok()
    };
    if let Some(expected) = decode(copy_path(&old.blake3)).filter(|p| digest_pixels(p) == old.blake3) {
        return match compare(&expected, actual) {
            Ok(d) => {
                let tolerated = old.tolerance.as_ref().is_some_and(|t| t.allows(&d));
                let status = if tolerated { Status::Tolerated } else { Status::Different };
                (status, d.to_string(), Some(triptych(&expected, actual, PANEL)))
            }
            Err(unlike) => (Status::Different, unlike.to_string(), Some(triptych(&expected, actual, PANEL))),
        };
    }
    if let (Some([w, h]), Some([now_w, now_h])) = (old.size, new.size)
        && (w, h) != (now_w, now_h)
    {
        let said = format!("expected {w}x{h}, found {now_w}x{now_h}");
        return (Status::Different, said, Some(thumbnail(actual, PANEL)));
    }
    let small = thumbnail(actual, THUMB);
    match decode(picture_path(recipe, &old.name)) {
        None => {
            (Status::Different, "the content differs; the accepted picture is not here".into(), Some(small.clone()))
        }
        Some(expected) => {
            let whole = digest_pixels(&expected) == old.blake3;
            let shown = if whole { actual } else { &small };
            let unjudged =
                if old.tolerance.is_some() { "; accept again to keep what its tolerance is judged by" } else { "" };
            let said = match compare(&expected, shown) {
                Ok(d) if whole => d.to_string(),
                Ok(d) => format!("the content differs; its thumbnail {d}{unjudged}"),
                Err(_) => format!("the content differs{unjudged}"),
            };
            let within = |d| old.tolerance.as_ref().is_some_and(|t| t.allows(&d));
            let tolerated = whole && compare(&expected, shown).is_ok_and(within);
            let status = if tolerated { Status::Tolerated } else { Status::Different };
            (status, said, Some(triptych(&expected, shown, PANEL)))
        }
    }
}

fn verdicts(global: &Global, entries: &[Entry]) -> String {
    let bad = entries.iter().filter(|e| e.status.is_failure()).count();
    if global.format == Format::Json {
        let list: Vec<_> = entries
            .iter()
            .map(|e| {
                serde_json::json!({"recipe": e.recipe, "output": e.output, "status": e.status.name(), "message": e.message})
            })
            .collect();
        return format!("{}\n", serde_json::json!({"version": 1, "outputs": list}));
    }
    let mut text = String::new();
    for e in entries.iter().filter(|e| e.status != Status::Same || global.verbose > 0) {
        text += &format!("{:9} {}/{}\n", e.status.name(), e.recipe, e.output);
        for line in e.message.lines() {
            text += &format!("          {line}\n");
        }
    }
    if !global.quiet {
        text += &match bad {
            0 => format!("{} outputs are as accepted\n", entries.len()),
            n => format!("{n} of {} outputs are not as accepted\n", entries.len()),
        };
    }
    text
}

/// `kiln accept`.
pub(super) fn accept(global: &Global, accept: &Accept) -> Result<Done, Stop> {
    if std::env::var_os("CI").is_some_and(|v| !v.is_empty()) && !accept.force {
        let why = "accept does nothing where CI is set: a person looks and accepts; --force overrides";
        return Err(Stop::Usage(why.into()));
    }
    let names: Vec<PathBuf> = accept.names.iter().map(PathBuf::from).collect();
    let loaded = project::load(global, &names)?;
    if global.dry_run {
        return super::plan::show(global, &loaded, false);
    }
    let report = build(global, &loaded)?;
    if !report.is_success() || !loaded.broken.is_empty() {
        return Err(Stop::Failed("nothing was accepted: not everything could be baked".into()));
    }
    let mut text = String::new();
    for planned in &loaded.planned {
        let recipe = &planned.name;
        let baked = read_baked(planned, &loaded, &report)?;
        let old = read_book(recipe)?.unwrap_or_default();
        let changed = compare_book(&old, &baked.book).iter().filter(|v| v.outcome != Outcome::Same).count();
        store(recipe, &baked, &old)?;
        text += &format!("{recipe}: {} outputs accepted, {changed} of them changed\n", baked.book.outputs.len());
    }
    Done::ok(if global.quiet { String::new() } else { text })
}

/// Writes the book, its pictures and this machine's copies; pictures of outputs that are gone go too.
fn store(recipe: &str, baked: &Baked, old: &Book) -> Result<(), Stop> {
    for output in &baked.book.outputs {
        let Some(pixels) = baked.images.get(&output.name) else { continue };
        let tolerance = old.outputs.iter().find(|o| o.name == output.name).and_then(|o| o.tolerance.as_ref());
        write(&picture_path(recipe, &output.name), &png(&picture(output.kind, tolerance, pixels))?)?;
        let file = Path::new(OUT).join(recipe).join(&output.name);
        let bytes = Real.read(&file, OUTPUT_LIMIT).map_err(|e| failed(format!("{}: {e}", file.display())))?;
        write(&copy_path(&output.blake3), &bytes)?;
    }
    for gone in old.outputs.iter().filter(|o| baked.book.outputs.iter().all(|n| n.name != o.name)) {
        let path = picture_path(recipe, &gone.name);
        Real.remove(&path).map_err(|e| failed(format!("{}: {e}", path.display())))?;
    }
    let book = baked.book.clone().accepted_over(old);
    write(&book_path(recipe), book.to_toml().map_err(failed)?.as_bytes())
}
