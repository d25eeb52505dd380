//! The outputs of a recipe as they are on disk now, and the steps behind them, as a golden book would have them.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::build::{Digest, Report};
use crate::disk::{Disk, Real};
use crate::golden::book::{Book, Kind, Output, Step};
use crate::golden::digest::{digest_bytes, digest_glb, digest_pixels};
use crate::golden::quality;
use crate::io::Pixels;
use crate::io::image_file::{Limits, decode_pixels};
use crate::recipe::{ExemplarMap, MapFile, Recipe, Word};
use crate::stage::plan::Planned;

use super::{OUTPUT_LIMIT, OWN_IMAGES, failed};
use crate::cli::Stop;
use crate::cli::project::{Loaded, OUT};

/// The outputs of one recipe as they are on disk now.
pub(super) struct Baked {
    /// What a book would hold, but for figures that have to be measured.
    pub book: Book,
    /// Decoded images by output name.
    pub images: BTreeMap<String, Pixels>,
    /// Steps of the book whose artefacts are outputs as well.
    pub output_steps: Vec<String>,
    /// Steps of the book that analyse a sample.
    pub analyses: Vec<String>,
    /// Texels of maps per texel of the sample.
    scale: f64,
}

/// What is known of a run: artefacts of its steps by their full names, and digests of input files, each read once.
pub(super) struct Known<'a> {
    pub artefacts: BTreeMap<&'a str, String>,
    files: RefCell<BTreeMap<PathBuf, Option<String>>>,
}

impl<'a> Known<'a> {
    pub fn of(report: &'a Report) -> Known<'a> {
        let artefacts = report.steps.iter().filter_map(|s| Some((s.name.as_str(), s.artefact.as_ref()?.to_string())));
        Known { artefacts: artefacts.collect(), files: RefCell::default() }
    }

    /// `None` if it cannot be read any more.
    fn digest(&self, path: &Path) -> Option<String> {
        let mut known = self.files.borrow_mut();
        let read = || Some(Digest::of(&Real.read(path, OUTPUT_LIMIT).ok()?).to_string());
        known.entry(path.to_path_buf()).or_insert_with(read).clone()
    }
}

impl Baked {
    /// Reads the outputs of a recipe and names their content.
    pub fn read(planned: &Planned, loaded: &Loaded, known: &Known) -> Result<Baked, Stop> {
        let folder = Path::new(OUT).join(&planned.name);
        let (mut outputs, mut images) = (Vec::new(), BTreeMap::new());
        let (mut seams, mut scale) = (BTreeMap::new(), 1.0);
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
                (seams, scale) = told(&bytes);
            }
            outputs.push(Output { name, kind, size, channels, blake3, tolerance: None, quality: BTreeMap::new() });
        }
        // The seams were measured on the base colour.
        for output in outputs.iter_mut().filter(|o| o.kind == Kind::Map && o.name.contains(".base_color.")) {
            output.quality = seams.clone();
        }
        let mut baked = Baked { book: Book::default(), images, output_steps: vec![], analyses: vec![], scale };
        let steps = baked.steps(planned, loaded, known);
        baked.book = Book::new(outputs, steps);
        Ok(baked)
    }

    /// The recipe's steps with their artefacts. A step shared between recipes bears the name of the first, so only what
    /// follows the recipe's name is kept.
    fn steps(&mut self, planned: &Planned, loaded: &Loaded, known: &Known) -> Vec<Step> {
        let mut steps: Vec<Step> = Vec::new();
        for id in &planned.steps {
            let name = loaded.graph.name(*id);
            let (Some(artefact), described) = (known.artefacts.get(name), loaded.graph.described(*id)) else {
                continue;
            };
            let name = short(name).to_string();
            if steps.iter().any(|s| s.name == name) {
                continue;
            }
            if described.is_output {
                self.output_steps.push(name.clone());
            }
            if described.kind.starts_with("analyse") {
                self.analyses.push(name.clone());
            }
            let mut params = BTreeMap::new();
            for (key, value) in described.params {
                // Of several of one name, the second is `name 2`.
                let spelled = (2..).map(|n| format!("{key} {n}"));
                let free = std::iter::once(key.clone()).chain(spelled).find(|k| !params.contains_key(k));
                params.extend(free.map(|k| (k, value.clone())));
            }
            let file = |path: &&Path| Some((path.to_string_lossy().replace('\\', "/"), known.digest(path)?));
            let files = described.files.iter().filter_map(file).collect();
            steps.push(Step { name, artefact: artefact.clone(), revision: Some(described.revision), params, files });
        }
        steps
    }

    /// All figures of an output: those of its seams, and how it stands to the sample if it is the map that shows it.
    pub fn figures(&self, recipe: &Recipe, output: &Output) -> BTreeMap<String, f64> {
        let mut figures = output.quality.clone();
        let (Some(map), Some(image)) = (main_map(recipe), self.images.get(&output.name)) else { return figures };
        if output.kind == Kind::Map && output.name.starts_with(&format!("{}.{}.", recipe.name, map.map.name())) {
            figures.extend(quality::measure(&samples(recipe, map.map), image, self.scale));
        }
        figures
    }
}

/// A step's name without that of its recipe.
pub(super) fn short(name: &str) -> &str {
    name.split_once('/').map_or(name, |(_, rest)| rest)
}

/// The atlas' figures in a `report.json`, and how many of its texels lie on one of the sample's.
fn told(bytes: &[u8]) -> (BTreeMap<String, f64>, f64) {
    let report: serde_json::Value = serde_json::from_slice(bytes).unwrap_or_default();
    let figures = report.pointer("/atlas/quality").and_then(serde_json::Value::as_object);
    let figures = figures.into_iter().flatten().filter_map(|(k, v)| Some((k.clone(), v.as_f64()?))).collect();
    let density = |of: &str| report.pointer(&format!("/{of}/texels_per_unit")).and_then(serde_json::Value::as_f64);
    let scale = density("atlas").zip(density("synthesis")).map_or(1.0, |(atlas, sample)| atlas / sample);
    (figures, scale)
}

/// The map that figures are measured on: the base colour, or else the first that is no normal map.
fn main_map(recipe: &Recipe) -> Option<&ExemplarMap> {
    let maps = &recipe.exemplar.maps;
    let color = maps.iter().find(|m| m.map == MapFile::BaseColor);
    color.or_else(|| maps.iter().find(|m| m.map != MapFile::Normal))
}

/// A map of all samples, of a flipbook its frames; without what cannot be read.
fn samples(recipe: &Recipe, map: MapFile) -> Vec<Pixels> {
    let of = |sample: &crate::recipe::Sample| -> Vec<PathBuf> {
        let Some(map) = sample.maps.iter().find(|m| m.map == map) else { return Vec::new() };
        let path = &map.file.path;
        let Some(pattern) = &map.frames else { return vec![path.clone()] };
        let folder = path.parent().unwrap_or(Path::new(""));
        let listed = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
        let there = Real.list(listed).unwrap_or_default();
        let names = there.iter().filter(|f| f.parent() == Some(listed)).filter_map(|f| f.file_name()?.to_str());
        let frames = pattern.frames(names).into_iter().flatten();
        frames.map(|frame| folder.join(pattern.name(frame))).collect()
    };
    let files = recipe.exemplar.samples().iter().flat_map(of).collect::<Vec<_>>();
    let read = |path: &PathBuf| decode_pixels(&Real.read(path, OUTPUT_LIMIT).ok()?, &Limits::default()).ok();
    files.iter().filter_map(read).collect()
}
