//! From a recipe to steps of a graph.
//!
//! Nothing is computed here but what the graph's shape needs: which files a glTF refers to, which maps there are.

mod canvas;
mod flipbook;
mod mesh;
mod tile;

use std::path::{Path, PathBuf};

use crate::build::{Graph, InputId, StepId};
use crate::disk::Disk;
use crate::exemplar::AnalysisParams;
use crate::io::SampleType;
use crate::io::image_file::{Compression, Transfer};
use crate::io::image_set::{NormalY, Options, Slot};
use crate::io::image_strips::Container;
use crate::recipe::{self, Canvas, FileRef, ImageFormat, MapFile, MapOutput, Recipe, Sample, Target, Word};
use crate::texture::{MapKind, Wrap};

use super::analyse::Analyse;
use super::encode::Encode;
use super::flipbook::frame_number;
use super::maps::Maps;
use super::rasterise::ImageSpec;
use super::scenes::Scenes;

/// What a recipe became in the graph.
#[derive(Clone, Debug)]
pub struct Planned {
    /// The recipe's name.
    pub name: String,
    /// The recipe's file.
    pub recipe: PathBuf,
    /// Files that would change the plan if they were there.
    pub absent: Vec<PathBuf>,
    /// Its output files, in the order of planning.
    pub outputs: Vec<PathBuf>,
    /// Its steps in an order in which each comes after those it reads; shared ones included.
    pub steps: Vec<StepId>,
}

/// A recipe that cannot be planned: one of its files cannot be looked into.
#[derive(Clone, Debug)]
pub struct PlanError(pub String);

impl std::fmt::Display for PlanError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for PlanError {}

/// Adds the steps of a recipe. Outputs go to `out/<recipe>/` below `out`.
pub fn add(
    graph: &mut Graph,
    recipe: &Recipe,
    out: &Path,
    disk: &dyn Disk,
    scenes: &mut Scenes,
) -> Result<Planned, PlanError> {
    let folder = out.join(&recipe.name);
    let planned = Planned {
        name: recipe.name.clone(),
        recipe: recipe.path.clone(),
        absent: Vec::new(),
        outputs: Vec::new(),
        steps: Vec::new(),
    };
    let mut planner = Planner { graph, recipe, disk, scenes, folder, planned };
    // What can fail comes first, so that a recipe that can't be baked leaves no steps behind.
    if let (Target::Canvas(canvas), true) = (&recipe.target, recipe.exemplar.maps.iter().any(|m| m.frames.is_some())) {
        let (files, frames) = planner.frame_files()?;
        planner.flipbook(canvas, files, frames)?;
        return Ok(planner.planned);
    }
    planner.check_files()?;
    match &recipe.target {
        Target::Mesh(bake) => {
            let files = std::iter::once(&bake.mesh).chain(&bake.lods);
            let scenes = files.map(|file| planner.scene(file, bake)).collect::<Result<Vec<_>, _>>()?;
            planner.mesh(bake, scenes);
        }
        Target::Canvas(canvas) => planner.canvas(canvas),
    }
    Ok(planner.planned)
}

/// Adds steps for one recipe.
struct Planner<'a, 'd> {
    graph: &'a mut Graph,
    recipe: &'a Recipe,
    disk: &'a dyn Disk,
    scenes: &'a mut Scenes<'d>,
    folder: PathBuf,
    planned: Planned,
}

impl Planner<'_, '_> {
    fn step(&mut self, step: impl crate::build::Step + 'static, inputs: &[InputId]) -> StepId {
        let id = self.graph.add_step(Box::new(step), inputs);
        self.planned.steps.push(id);
        id
    }

    fn output(&mut self, step: StepId, file: &str) {
        let path = self.folder.join(file);
        self.graph.add_output(step, &path);
        self.planned.outputs.push(path);
    }

    fn name(&self) -> String {
        self.recipe.name.clone()
    }

    /// Checks that the samples' files, and those of a canvas, are there.
    fn check_files(&self) -> Result<(), PlanError> {
        let mut samples = self.recipe.exemplar.samples();
        samples.extend(self.recipe.analysis.tile.iter().flat_map(|tile| tile.keys.clone()));
        let of_sample = |s: &'_ Sample| -> Vec<FileRef> {
            let optional = [&s.feature_mask, &s.mask, &s.guide];
            s.maps.iter().map(|m| &m.file).chain(optional.into_iter().flatten()).cloned().collect()
        };
        let mut files: Vec<FileRef> = samples.iter().flat_map(of_sample).collect();
        if let Target::Canvas(Canvas { guide, inpaint, sources, .. }) = &self.recipe.target {
            files.extend(guide.iter().map(|g| &g.file).chain(inpaint).chain(sources).cloned());
        }
        for file in files {
            let (path, key, place) = (file.path.display(), &file.key, &file.place);
            match self.disk.stamp(&file.path) {
                Ok(Some(_)) => {}
                Ok(None) => {
                    return Err(PlanError(format!("{path}: there is no such file (named as {key} in {place})")));
                }
                Err(e) => return Err(PlanError(format!("{path}: {e} (named as {key} in {place})"))),
            }
        }
        Ok(())
    }

    /// What the files of a sample are, in their order.
    fn slots(sample: &Sample) -> (Vec<Slot>, Options) {
        let slot = |map: MapFile| match map {
            MapFile::Orm => Slot::Orm,
            single => Slot::Map(single.kinds()[0]),
        };
        let mut slots: Vec<Slot> = sample.maps.iter().map(|m| slot(m.map)).collect();
        if sample.feature_mask.is_some() {
            slots.push(Slot::Map(MapKind::FeatureMask));
        }
        let normal_y = match sample.normal_y {
            recipe::NormalY::Up => NormalY::Up,
            recipe::NormalY::Down => NormalY::Down,
        };
        (slots, Options { normal_y })
    }

    /// Decodes the files of a sample, counted from 0.
    fn maps(&mut self, number: usize, sample: &Sample) -> StepId {
        let (slots, options) = Self::slots(sample);
        let files = sample.maps.iter().map(|m| &m.file).chain(&sample.feature_mask);
        let inputs: Vec<InputId> = files.map(|f| self.graph.add_file(&f.path)).collect();
        let recipe = self.name();
        let recipe = if number == 0 { recipe } else { format!("{recipe}/sample {}", number + 1) };
        self.step(Maps { recipe, slots, options }, &inputs)
    }

    /// Analyses the maps of one sample, or a sheet of several.
    fn analyse(&mut self, maps: StepId, stacked: bool) -> StepId {
        let (recipe, params) = (self.name(), self.analysis());
        self.step(Analyse { recipe, params, stacked }, &[maps.into()])
    }

    fn analysis(&self) -> AnalysisParams {
        let recipe::Analysis { neighbourhoods, jumps, variance, alpha, diversity, min_distance, textons: _, tile: _ } =
            self.recipe.analysis.clone();
        let importance = self.recipe.exemplar.importance.iter().copied().collect();
        let wrap = if self.recipe.exemplar.tileable { Wrap::Repeat } else { Wrap::Clamp };
        AnalysisParams { neighbourhoods, jumps, diversity, variance, alpha, min_distance, importance, wrap }
    }

    /// Encodes the files of a bundle as outputs `<name>.<map>.<ext>`, of a flipbook `<name>.<map>.<frame>.<ext>`.
    fn encode(
        &mut self,
        name: &str,
        files: &[MapOutput],
        compression: recipe::Compression,
        bundle: StepId,
        frame: Option<u32>,
    ) {
        for output in files {
            let frame = frame.map(|t| format!(".{}", frame_number(t))).unwrap_or_default();
            let image = format!("{}{frame}", output.map.name());
            let (container, ext) = container(output, compression);
            let file = format!("{name}.{image}.{ext}");
            let step = Encode { recipe: name.to_string(), image, container };
            let step = self.step(step, &[bundle.into()]);
            self.output(step, &file);
        }
    }
}

fn image_spec(output: &MapOutput) -> ImageSpec {
    let depth = match output.format {
        ImageFormat::Png16 => SampleType::U16,
        ImageFormat::Exr => SampleType::F32,
        _ => SampleType::U8,
    };
    ImageSpec { file: output.map, depth }
}

fn container(output: &MapOutput, compression: recipe::Compression) -> (Container, &'static str) {
    if output.format == ImageFormat::Exr {
        return (Container::Exr, "exr");
    }
    let srgb = output.map.kinds()[0].is_srgb();
    let transfer = if srgb { Transfer::Srgb } else { Transfer::Unstated };
    (Container::Png { transfer, compression: squeeze(compression) }, "png")
}

fn squeeze(compression: recipe::Compression) -> Compression {
    match compression {
        recipe::Compression::Fast => Compression::Fast,
        recipe::Compression::Best => Compression::Best,
    }
}
