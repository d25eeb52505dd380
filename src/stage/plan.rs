//! From a recipe to steps of a graph.
//!
//! Nothing is computed here but what the graph's shape needs: which files a glTF refers to, which maps there are.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::bake::{Extent, Library, UnwrapParams, default_gutter_px};
use crate::build::{Graph, InputId, StepId};
use crate::disk::Disk;
use crate::exemplar::{AnalysisParams, TextonFeatures, TextonParams};
use crate::field::{
    Alignment, OrientationConstraint, ScalarConstraint, SingularityConstraint, SingularityKind, Symmetry,
};
use crate::io::SampleType;
use crate::io::gltf::TriangleOrder;
use crate::io::image_file::{Compression, Transfer};
use crate::io::image_set::{NormalY, Options, Slot};
use crate::io::image_strips::Container;
use crate::io::ktx2::Shape;
use crate::recipe::limits::FLIPBOOK_TEXELS;
use crate::recipe::{
    self, Canvas, ExemplarMap, FileRef, ImageFormat, MapFile, MapOutput, MeshBake, Recipe, Sample, Target, Word,
};
use crate::synth::image_copy::BlendKernel;
use crate::synth::image_order::ImageOrder;
use crate::synth::quilt::QuiltParams;
use crate::synth::vertex_walk::VertexWalkParams;
use crate::synth::volume_copy::VolumeKernel;
use crate::synth::volume_walk::VolumeWalkParams;
use crate::texture::{MapKind, Wrap};
use crate::tile::TileParams;
use crate::uvset::Blend;

use super::analyse::Analyse;
use super::canvas::{PaintImage, ReadSources, WalkImage};
use super::encode::Encode;
use super::field::{LayAreas, LayField};
use super::flipbook::{AnalyseFlipbook, CopyFrame, ReadFlipbook, WalkFlipbook, frame_number};
use super::glb::{AtlasGlb, UvSetsGlb};
use super::lod::TakeFromFinest;
use super::maps::Maps;
use super::material_space::{FollowAreas, Parametrise, PlaceInTile};
use super::painting::Picture;
use super::prepare::{Prepare, Scale};
use super::rasterise::{ImageSpec, Rasterise};
use super::render::{RenderField, RenderSingularities, RenderView};
use super::report::{CanvasReport, Report};
use super::scenes::Scenes;
use super::sheet::{Form, Stack};
use super::surface::{ReadSurface, SceneFiles};
use super::synthesise::{Order, Synthesise};
use super::texton::AnalyseTextons;
use super::texton_quilt::{BlendMesh, BlendParams, BlendSets, QuiltFaces};
use super::tile::{MakeTile, ReportTile, TileStrip, TileTexture};
use super::unwrap::{Layout, Unwrap};

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

    /// The files of a flipbook's frames, map by map, and how many frames there are.
    fn frame_files(&self) -> Result<(Vec<PathBuf>, u32), PlanError> {
        let (mut files, mut first) = (Vec::new(), None);
        for map in &self.recipe.exemplar.maps {
            let FileRef { key, path, place, .. } = &map.file;
            let fail = |why: String| PlanError(format!("{}: {why} (named as {key} in {place})", path.display()));
            let Some(pattern) = &map.frames else { return Err(fail("is no pattern".into())) };
            let folder = path.parent().unwrap_or(Path::new(""));
            let listed = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
            let there = self.disk.list(listed).map_err(|e| fail(e.to_string()))?;
            let beside = there.iter().filter(|file| file.parent() == Some(listed));
            let names = beside.filter_map(|file| file.file_name()?.to_str());
            let frames = pattern.frames(names).map_err(|e| fail(e.to_string()))?;
            let first = first.get_or_insert_with(|| frames.clone());
            if *first != frames {
                let [found, wanted] = [&frames, first].map(|f| format!("{} to {}", f.start(), f.end()));
                return Err(fail(format!("has frames {found}, but the first map has {wanted}")));
            }
            files.extend(frames.map(|frame| folder.join(pattern.name(frame))));
        }
        Ok((files, first.map_or(0, |f| f.count() as u32)))
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

    /// A flat image.
    fn canvas(&mut self, canvas: &Canvas) {
        let samples = self.recipe.exemplar.samples();
        let (maps, form) = self.sheet(canvas, &samples);
        let (walk, analyse) = match &canvas.sources {
            Some(file) => {
                let file = self.graph.add_file(&file.path);
                (self.step(ReadSources { recipe: self.name(), samples: form }, &[file, maps.into()]), None)
            }
            None => {
                let analyse = self.analyse(maps, form.stacked);
                (self.walk(canvas, &samples, [analyse, maps], form), Some(analyse))
            }
        };
        let kernel = match (self.recipe.synthesis.blend, canvas.blend_kernel) {
            (recipe::Blend::None, _) => BlendKernel::None,
            (_, recipe::BlendSize::Three) => BlendKernel::Three,
            (_, recipe::BlendSize::Five) => BlendKernel::Five,
        };
        let mut paint = |image: &str, picture: Picture, (container, ext): (Container, &str)| {
            let original = self.original(canvas, &samples[0], picture);
            let (recipe, image) = (self.name(), image.to_string());
            let file = format!("{recipe}.{image}.{ext}");
            let paint = PaintImage { recipe, image, picture, kernel, container, samples: form };
            let inputs: Vec<InputId> = [walk.into(), maps.into()].into_iter().chain(original).collect();
            let step = self.step(paint, &inputs);
            self.output(step, &file);
        };
        for file in &canvas.maps {
            let ImageSpec { file: map, depth } = image_spec(file);
            paint(map.name(), Picture::Map(map, depth), container(file, canvas.compression));
        }
        for picture in &canvas.debug {
            let png = Container::Png { transfer: Transfer::Unstated, compression: squeeze(canvas.compression) };
            paint(picture.name(), Picture::Debug(*picture), (png, "png"));
        }
        let inputs: Vec<InputId> = [walk].into_iter().chain(analyse).map(InputId::from).collect();
        let report = self.step(CanvasReport { recipe: self.name() }, &inputs);
        self.output(report, "report.json");
    }

    /// The file that a map of a sample which is filled in comes from.
    fn original(&mut self, canvas: &Canvas, sample: &Sample, picture: Picture) -> Option<InputId> {
        let Picture::Map(map, _) = picture else { return None };
        // A normal map that is turned over is another picture.
        if canvas.inpaint.is_none() || (map == MapFile::Normal && sample.normal_y == recipe::NormalY::Down) {
            return None;
        }
        let file = sample.maps.iter().find(|m| m.map == map)?;
        Some(self.graph.add_file(&file.file.path))
    }

    /// The samples of a canvas: the maps of a single one, or a sheet of all.
    fn sheet(&mut self, canvas: &Canvas, samples: &[Sample]) -> (StepId, Form) {
        let maps: Vec<StepId> = samples.iter().enumerate().map(|(i, s)| self.maps(i, s)).collect();
        if samples.len() == 1 && samples[0].mask.is_none() && canvas.inpaint.is_none() {
            return (maps[0], self.form(false));
        }
        let masks = samples.iter().map(|s| s.mask.is_some()).collect();
        let mut inputs: Vec<InputId> = maps.into_iter().map(InputId::from).collect();
        let files = samples.iter().flat_map(|s| &s.mask).chain(&canvas.inpaint);
        inputs.extend(files.map(|f| self.graph.add_file(&f.path)));
        let stack = Stack { recipe: self.name(), masks, inpaint: canvas.inpaint.is_some() };
        (self.step(stack, &inputs), self.form(true))
    }

    fn form(&self, stacked: bool) -> Form {
        Form { stacked, wrap: if self.recipe.exemplar.tileable { Wrap::Repeat } else { Wrap::Clamp } }
    }

    /// Chooses the sources of a canvas.
    fn walk(&mut self, canvas: &Canvas, samples: &[Sample], [analyse, maps]: [StepId; 2], form: Form) -> StepId {
        let order = image_order(canvas.order);
        let recipe::Synthesis { seed, patch, refine, blend: _ } = self.recipe.synthesis;
        let importance: BTreeMap<_, _> = self.recipe.exemplar.importance.iter().copied().collect();
        let (size, tileable) = (canvas.size, canvas.tileable);
        let guide_weight = canvas.guide.as_ref().map(|g| g.weight);
        let recipe = self.name();
        let walk =
            WalkImage { recipe, size, order, patch, seed, tileable, refine, importance, samples: form, guide_weight };
        let mut inputs = vec![analyse.into(), maps.into()];
        if let Some(guide) = &canvas.guide {
            let files = std::iter::once(&guide.file).chain(samples.iter().flat_map(|s| &s.guide));
            inputs.extend(files.map(|f| self.graph.add_file(&f.path)));
        }
        self.step(walk, &inputs)
    }

    /// A flat image in many frames.
    fn flipbook(&mut self, canvas: &Canvas, files: Vec<PathBuf>, exemplar_frames: u32) -> Result<(), PlanError> {
        // What else a canvas may have is refused for flipbooks.
        let Canvas { size, tileable, frames, looped, order, maps, compression, .. } = canvas;
        let [width, height] = size.ok_or_else(|| PlanError("a flipbook needs `canvas.size`".into()))?;
        let frames = frames.unwrap_or(exemplar_frames);
        let texels = u64::from(width) * u64::from(height) * u64::from(frames);
        if texels > FLIPBOOK_TEXELS {
            let path = self.recipe.path.display();
            return Err(PlanError(format!(
                "{path}: {frames} frames of {width} x {height}, as many as the exemplar has, are {texels} texels, and a \
                 flipbook may have {FLIPBOOK_TEXELS}; lower `canvas.size` or give `canvas.frames`"
            )));
        }
        let (slots, options) = Self::slots(&self.recipe.exemplar.samples()[0]);
        let files: Vec<InputId> = files.into_iter().map(|f| self.graph.add_file(f)).collect();
        let read = self.step(ReadFlipbook { recipe: self.name(), slots, frames: exemplar_frames, options }, &files);
        let analyse = AnalyseFlipbook { recipe: self.name(), params: self.analysis() };
        let analyse = self.step(analyse, &[read.into()]);
        let recipe::Synthesis { seed, patch, refine, blend } = self.recipe.synthesis;
        let importance = self.recipe.exemplar.importance.iter().copied().collect();
        let (size, order) = ([width, height, frames], image_order(*order));
        let params = VolumeWalkParams { size, order, patch, seed, tileable: *tileable, looped: *looped };
        let walk = WalkFlipbook { recipe: self.name(), params, refine, importance };
        let walk = self.step(walk, &[analyse.into(), read.into()]);
        // Refining mends cuts in time; to dissolve them as well would only blur. Mean difference of pixels next to each
        // other on smoke (the sample's 18.0): blended in space 17.1, in time as well 16.8. Without refining, frames change
        // by 32.0 and 29.5 (the sample's by 29.1).
        let kernel = match blend {
            recipe::Blend::None => VolumeKernel::None,
            _ if refine > 0 => VolumeKernel::Space,
            _ => VolumeKernel::SpaceTime,
        };
        for frame in 0..frames {
            let copy = CopyFrame { recipe: self.name(), frame, images: maps.iter().map(image_spec).collect(), kernel };
            let copy = self.step(copy, &[walk.into(), read.into()]);
            self.encode(&self.name(), maps, *compression, copy, Some(frame));
        }
        Ok(())
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

    /// The scene's files as inputs.
    fn scene(&mut self, file: &FileRef, bake: &MeshBake) -> Result<Scene, PlanError> {
        let FileRef { key, path, place, .. } = file;
        let fail = |why: String| PlanError(format!("{}: {why} (named as {key} in {place})", path.display()));
        let mut uris = self.scenes.files(path).map_err(fail)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        // A picture that is not there matters only if its material is kept; the reader says so then.
        let (disk, absent) = (self.disk, &mut self.planned.absent);
        uris.retain(|uri| {
            let path = folder.join(uri);
            let there = !is_picture(uri) || matches!(disk.stamp(&path), Ok(Some(_)));
            absent.extend((!there).then_some(path));
            there
        });
        if let Some(gone) = uris.iter().find(|uri| matches!(self.disk.stamp(&folder.join(uri)), Ok(None))) {
            return Err(fail(format!("it refers to `{gone}`, and there is no such file beside it")));
        }
        let mut inputs = vec![self.graph.add_file(path)];
        inputs.extend(uris.iter().map(|uri| self.graph.add_file(folder.join(uri))));
        Ok((SceneFiles { uris, materials: bake.materials.clone() }, inputs))
    }

    /// The tile of material space, and its files.
    fn tile(&mut self, from: &recipe::TileKeys) -> StepId {
        let recipe::TileKeys { layers, keys, shape } = from;
        let keys: Vec<Sample> = self.recipe.exemplar.samples().into_iter().chain(keys.iter().cloned()).collect();
        let maps: Vec<InputId> = keys.iter().enumerate().map(|(i, key)| self.maps(i, key).into()).collect();
        let importance = self.recipe.exemplar.importance.iter().copied().collect();
        let seed = self.recipe.synthesis.seed;
        let params = TileParams { layers: *layers, seed, importance, ..TileParams::default() };
        let (recipe, tileable) = (self.name(), self.recipe.exemplar.tileable);
        let tile = self.step(MakeTile { recipe: recipe.clone(), params, tileable }, &maps);
        let shape = match shape {
            recipe::TileShape::Volume => Shape::Volume,
            recipe::TileShape::Array => Shape::Array,
        };
        for (i, ExemplarMap { map, .. }) in keys[0].maps.iter().enumerate() {
            // The first map, the colour where there is one, is the tile; the others are told by their names.
            let file =
                if i == 0 { format!("{recipe}.tile.ktx2") } else { format!("{recipe}.tile.{}.ktx2", map.name()) };
            let texture = self.step(TileTexture { recipe: recipe.clone(), map: *map, shape }, &[tile.into()]);
            self.output(texture, &file);
        }
        for map in keys[0].maps.iter().map(|m| Some(m.map)).chain([None]) {
            let strip = self.step(TileStrip { recipe: recipe.clone(), map }, &[tile.into()]);
            let name = map.map_or(MapKind::FeatureMask.name(), |m| m.name());
            self.output(strip, &format!("{recipe}.tile.{name}.png"));
        }
        tile
    }

    /// A textured mesh and its simplifications: the finest is synthesised, the others take from it.
    fn mesh(&mut self, bake: &MeshBake, scenes: Vec<Scene>) {
        let textons = self.recipe.analysis.textons;
        let keys = self.recipe.analysis.tile.clone();
        let tile = keys.as_ref().map(|keys| self.tile(keys));
        if let (Some(tile), None, None, true) = (tile, &bake.atlas, &bake.uv_sets, bake.renders.is_empty()) {
            let report = self.step(ReportTile { recipe: self.name() }, &[tile.into()]);
            self.output(report, "report.json");
            return;
        }
        // A tile is both what is looked up and what is known of it.
        let (maps, analyse) = match (tile, textons) {
            (Some(tile), _) => (tile, tile),
            (None, textons) => {
                let samples = self.recipe.exemplar.samples();
                let maps = self.maps(0, &samples[0]);
                let analyse = match textons {
                    None => self.analyse(maps, false),
                    Some(textons) => self.analyse_textons(maps, &textons),
                };
                (maps, analyse)
            }
        };
        let max_factor = bake.field.scale.iter().fold(1.0, |m: f64, c| m.max(c.factor));
        // The published method takes triangles as they are, as long as there is room for a choice of places.
        let max_span_share = match textons {
            _ if keys.is_some() => Some(PERIOD_SHARE),
            Some(_) if self.recipe.synthesis.refine == 0 => Some(0.25),
            _ => None,
        };
        let mut finest = None;
        for (level, scene) in scenes.into_iter().enumerate() {
            let name = if level == 0 { self.name() } else { format!("{}.lod{level}", self.recipe.name) };
            let surface = self.step(ReadSurface { recipe: name.clone(), scene: scene.0.clone() }, &scene.1);
            let mut inputs = vec![surface.into(), maps.into()];
            inputs.extend(finest.map(|(prepare, _)| InputId::from(prepare)));
            let scale = match (bake.scale, finest) {
                (_, Some(_)) => Scale::Same,
                (recipe::Scale::TexelsPerUnit(s), None) => Scale::Fixed(s),
                (recipe::Scale::Auto, None) => Scale::Auto,
            };
            let prepare = self.step(Prepare { recipe: name.clone(), scale, max_factor, max_span_share }, &inputs);
            let laid = match finest {
                None => self.synthesise(bake, [prepare, analyse, maps]),
                Some((finest, synthesised)) => {
                    let inputs = [finest, synthesised, prepare].map(InputId::from);
                    let synthesise = self.step(TakeFromFinest { recipe: name.clone() }, &inputs);
                    LaidOut { prepare, synthesise, field: None, coordinates: None }
                }
            };
            finest = finest.or(Some((laid.prepare, laid.synthesise)));
            self.level(bake, name, scene, Level { maps, analyse, surface, laid });
        }
    }

    /// The field and what is laid along it; of synthesis mesh, analysis and maps.
    fn synthesise(&mut self, bake: &MeshBake, [prepare, analyse, maps]: [StepId; 3]) -> LaidOut {
        let recipe = self.name();
        let keys = self.recipe.analysis.tile.clone();
        let (laid, symmetry) = lay_field(&recipe, &bake.field);
        let everywhere = without_areas(&bake.field);
        // In material space what acts nearby is solved for itself, from the field of all else.
        let areas = keys.is_some() && everywhere != bake.field;
        let (field, without) = match areas {
            false => {
                let field = self.step(laid, &[prepare.into()]);
                (field, field)
            }
            true => {
                let without = self.step(lay_field(&recipe, &everywhere).0, &[prepare.into()]);
                (self.step(LayAreas(laid), &[prepare, without].map(InputId::from)), without)
            }
        };
        let importance: BTreeMap<_, _> = self.recipe.exemplar.importance.iter().copied().collect();
        let order = match bake.order {
            recipe::WalkOrder::RegionGrowing => Order::RegionGrowing,
            recipe::WalkOrder::RenderingSequence => Order::RenderingSequence,
        };
        let inputs = [prepare, field, analyse, maps];
        let mut coordinates = None;
        let (prepare, synthesise) = match (&keys, self.recipe.analysis.textons) {
            (Some(keys), _) => {
                let (placed, laid) = self.place_in_tile(keys, &bake.field, prepare, [without, field]);
                coordinates = Some(laid);
                (prepare, placed)
            }
            (None, None) => (prepare, self.walk_vertices(bake.sharpness, order, symmetry, importance, inputs)),
            (None, Some(textons)) => self.quilt_faces(&textons, symmetry, importance, inputs),
        };
        LaidOut { prepare, synthesise, field: Some(field), coordinates }
    }

    /// What comes out of one level of detail.
    fn level(&mut self, bake: &MeshBake, recipe: String, (scene, files): Scene, level: Level) {
        let Level { maps, analyse, surface, laid } = level;
        let LaidOut { prepare, synthesise, field, coordinates } = laid;
        let mut atlas_steps = None;
        if let Some(atlas) = &bake.atlas {
            let (layout, gutter_px) = layout(atlas);
            let unwrap = self.step(Unwrap { recipe: recipe.clone(), layout }, &[surface.into()]);
            let images = atlas.maps.iter().map(image_spec).collect();
            let inputs = [surface, prepare, synthesise, unwrap, maps].map(InputId::from);
            let bundle = self.step(Rasterise { recipe: recipe.clone(), images, gutter_px, side: side(atlas) }, &inputs);
            self.encode(&recipe, &atlas.maps, atlas.compression, bundle, None);
            let glb = AtlasGlb { recipe: recipe.clone(), scene: scene.clone() };
            let inputs = [&files[..], &[surface, unwrap, bundle].map(InputId::from)].concat();
            let glb = self.step(glb, &inputs);
            self.output(glb, &format!("{recipe}.glb"));
            atlas_steps = Some((unwrap, bundle));
        }
        if let Some(uv_sets) = &bake.uv_sets {
            let triangles = match bake.order {
                recipe::WalkOrder::RegionGrowing => TriangleOrder::Input,
                recipe::WalkOrder::RenderingSequence => TriangleOrder::Cache,
            };
            let glb = UvSetsGlb { recipe: recipe.clone(), scene, weld_texels: uv_sets.weld, triangles };
            let inputs = [&files[..], &[surface, prepare, synthesise, maps].map(InputId::from)].concat();
            let glb = self.step(glb, &inputs);
            self.output(glb, &format!("{recipe}.uvsets.glb"));
        }
        let mut inputs = [surface, prepare, synthesise, maps].map(InputId::from).to_vec();
        inputs.extend(atlas_steps.iter().flat_map(|(unwrap, bundle)| [InputId::from(*unwrap), InputId::from(*bundle)]));
        // `name` for the finest, `name.lod1` for the first simplification.
        let suffix = recipe.strip_prefix(&self.recipe.name).unwrap_or_default().to_string();
        for view in &bake.renders {
            let (recipe, view) = (recipe.clone(), view.clone());
            let path = format!("render/{}{suffix}.png", view.name);
            let render = match (view.shading, field) {
                (recipe::Shading::Field, Some(field)) => {
                    let inputs = [surface, prepare, field].map(InputId::from);
                    self.step(RenderField { recipe, view }, &inputs)
                }
                // Levels of detail have no field of their own.
                (recipe::Shading::Field | recipe::Shading::Singularities, None) => continue,
                (recipe::Shading::Singularities, Some(field)) => {
                    // Refused without a tile.
                    let inputs = [surface, prepare, field, coordinates.unwrap_or(field)].map(InputId::from);
                    self.step(RenderSingularities { recipe, view }, &inputs)
                }
                _ => self.step(RenderView { recipe, view }, &inputs),
            };
            self.output(render, &path);
        }
        inputs[3] = analyse.into();
        if let Some(field) = field {
            inputs.insert(4, field.into());
        }
        inputs.extend(coordinates.map(InputId::from));
        let report = self.step(Report { recipe, has_field: field.is_some() }, &inputs);
        self.output(report, &format!("report{suffix}.json"));
    }

    /// Lays periodic coordinates over the prepared mesh and its fields (without what acts nearby, and with it), and places
    /// it in the tile. Gives where it lies, and
    /// the coordinates.
    fn place_in_tile(
        &mut self,
        keys: &recipe::TileKeys,
        from: &recipe::Field,
        prepare: StepId,
        [first, field]: [StepId; 2],
    ) -> (StepId, StepId) {
        let recipe = self.name();
        let mut laid = self.step(Parametrise { recipe: recipe.clone() }, &[prepare, first].map(InputId::from));
        if first != field {
            let inputs = [prepare, laid, first, field].map(InputId::from);
            laid = self.step(FollowAreas { recipe: recipe.clone() }, &inputs);
        }
        let value = |&recipe::MaterialPoint { at, value, radius }: &_| ScalarConstraint { at, value, radius };
        let material: Vec<ScalarConstraint> = from.material.iter().map(value).collect();
        let wandering = (keys.keys.is_empty() && material.is_empty()).then_some(self.recipe.synthesis.seed);
        let placed = self.step(PlaceInTile { recipe, material, wandering }, &[prepare, laid].map(InputId::from));
        (placed, laid)
    }

    /// Analyses the sample into textons.
    fn analyse_textons(&mut self, maps: StepId, from: &recipe::Textons) -> StepId {
        let AnalysisParams { importance, wrap, .. } = self.analysis();
        // The others belong to the quilt.
        let recipe::Textons { window, count, features, rotations, candidates: _, blend_threshold: _ } = *from;
        let features = match features {
            recipe::TextonFeatures::Window => TextonFeatures::Window,
            recipe::TextonFeatures::FilterBank => TextonFeatures::FilterBank,
        };
        let params = TextonParams { window, count, features, rotations, importance, wrap };
        self.step(AnalyseTextons { recipe: self.name(), params }, &[maps.into()])
    }

    /// Walks the vertices; of synthesis mesh, field, jump map and maps.
    fn walk_vertices(
        &mut self,
        sharpness: u32,
        order: Order,
        symmetry: Symmetry,
        importance: BTreeMap<MapKind, f64>,
        inputs: [StepId; 4],
    ) -> StepId {
        let recipe::Synthesis { seed, patch, refine, blend } = self.recipe.synthesis;
        let walk = VertexWalkParams { patch, seed, ..VertexWalkParams::default() };
        let blend = uv_blend(blend);
        let synthesise =
            Synthesise { recipe: self.name(), walk, symmetry, order, blend, sharpness, refine, importance };
        self.step(synthesise, &inputs.map(InputId::from))
    }

    /// Quilts the faces and blends their edges; of synthesis mesh, field, textons and maps. Gives the mesh with divided
    /// faces, in the place of the prepared one, and what lies on it.
    fn quilt_faces(
        &mut self,
        from: &recipe::Textons,
        symmetry: Symmetry,
        importance: BTreeMap<MapKind, f64>,
        [prepare, field, analyse, maps]: [StepId; 4],
    ) -> (StepId, StepId) {
        let recipe::Synthesis { seed, patch, refine, blend } = self.recipe.synthesis;
        let params = QuiltParams { seed, candidates: from.candidates, refine, reach: patch * PIECE_REACH };
        let quilt = QuiltFaces { recipe: self.name(), params, symmetry };
        let quilt = self.step(quilt, &[prepare, field, analyse].map(InputId::from));
        let blend = uv_blend(blend);
        let params = BlendParams { symmetry, blend, threshold: from.blend_threshold, importance };
        let inputs = [prepare, field, quilt, maps].map(InputId::from);
        let mesh = self.step(BlendMesh { recipe: self.name(), params: params.clone() }, &inputs);
        let sets = self.step(BlendSets { recipe: self.name(), params }, &inputs);
        (mesh, sets)
    }
}

/// Part of a tile's side that an edge may take: half as many triangles are shown by three look-ups as at a half.
const PERIOD_SHARE: f64 = 0.125;

/// The field without what acts only nearby.
fn without_areas(field: &recipe::Field) -> recipe::Field {
    let mut field = field.clone();
    field.orientation.retain(|c| c.radius.is_none());
    field.singularities.retain(|c| c.radius.is_none());
    field.scale.retain(|c| c.radius.is_none());
    field
}

/// How far a piece of a quilt reaches around its first triangle, in exemplar sides, where `patch` is 1.
const PIECE_REACH: f64 = 0.0625;

fn uv_blend(blend: recipe::Blend) -> Blend {
    match blend {
        recipe::Blend::Linear => Blend::Linear,
        recipe::Blend::Variance => Blend::Variance,
        recipe::Blend::None => Blend::Nearest,
    }
}

/// A scene's files, and they as inputs.
type Scene = (SceneFiles, Vec<InputId>);

/// The steps that the outputs of a level are made from.
struct Level {
    maps: StepId,
    analyse: StepId,
    surface: StepId,
    laid: LaidOut,
}

/// The mesh on which a result lies, the result, and what it followed.
struct LaidOut {
    prepare: StepId,
    synthesise: StepId,
    field: Option<StepId>,
    /// Periodic coordinates, of a tile's bake.
    coordinates: Option<StepId>,
}

fn is_picture(uri: &str) -> bool {
    let lower = uri.to_ascii_lowercase();
    [".png", ".jpg", ".jpeg", ".webp", ".ktx2", ".dds", ".avif"].iter().any(|ext| lower.ends_with(ext))
}

fn image_order(order: recipe::CanvasOrder) -> ImageOrder {
    match order {
        recipe::CanvasOrder::Scanline => ImageOrder::Scanline,
        recipe::CanvasOrder::Serpentine => ImageOrder::Serpentine,
        recipe::CanvasOrder::Hilbert => ImageOrder::Hilbert,
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

/// Side of the page in texels; a guess where the layout decides.
fn side(atlas: &recipe::Atlas) -> u32 {
    match atlas.size {
        recipe::AtlasSize::Side(side) => side,
        recipe::AtlasSize::TexelsPerUnit(_) => 1024,
    }
}

fn layout(atlas: &recipe::Atlas) -> (Layout, u32) {
    let side = side(atlas);
    let extent = match atlas.size {
        recipe::AtlasSize::Side(side) => Extent::Page(side),
        recipe::AtlasSize::TexelsPerUnit(density) => Extent::TexelsPerUnit(density),
    };
    // Without mip levels nothing looks further than the next texel.
    let enough = if atlas.mips { default_gutter_px(side) } else { 2 };
    let gutter_px = atlas.gutter.unwrap_or(enough);
    let layout = match atlas.layout {
        recipe::Layout::KeepUv => Layout::Keep { set: 0, size: side },
        recipe::Layout::Unwrap(library) => {
            let library = match library {
                recipe::Unwrap::Uvunwrap => Library::Uvunwrap,
                recipe::Unwrap::Xatlas => Library::Xatlas,
            };
            Layout::New(UnwrapParams { extent, gutter_px, library })
        }
    };
    (layout, gutter_px)
}

fn lay_field(recipe: &str, from: &recipe::Field) -> (LayField, Symmetry) {
    // The material axis is no part of the field.
    let recipe::Field { symmetry, orientation, singularities, align: lines, scale, material: _ } = from;
    let symmetry = match symmetry {
        recipe::Symmetry::One => Symmetry::One,
        recipe::Symmetry::Two => Symmetry::Two,
        recipe::Symmetry::Four => Symmetry::Four,
        recipe::Symmetry::Isotropic => Symmetry::Isotropic,
    };
    let anchor = |&recipe::Orientation { at, up, radius }: &_| OrientationConstraint { at, up, radius };
    let singular = |&recipe::Singularity { at, kind, radius }: &_| {
        let kind = match kind {
            recipe::Singular::Kind(recipe::SingularityKind::Source) => SingularityKind::Source,
            recipe::Singular::Kind(recipe::SingularityKind::Sink) => SingularityKind::Sink,
            recipe::Singular::Kind(recipe::SingularityKind::Vortex) => SingularityKind::Vortex,
            recipe::Singular::Index(index) => SingularityKind::Index(index),
        };
        SingularityConstraint { at, kind, radius }
    };
    let align = |line: &recipe::AlignTo| match line {
        recipe::AlignTo::Creases => Alignment::Creases,
        recipe::AlignTo::Boundary => Alignment::Boundary,
        recipe::AlignTo::Curvature => Alignment::Curvature,
    };
    let factor = |&recipe::ScalePoint { at, factor, radius }: &_| ScalarConstraint { at, value: factor, radius };
    let field = LayField {
        recipe: recipe.to_string(),
        symmetry,
        orientation: orientation.iter().map(anchor).collect(),
        singularities: singularities.iter().map(singular).collect(),
        align: lines.iter().map(align).collect(),
        scale: scale.iter().map(factor).collect(),
    };
    (field, symmetry)
}
