//! From a recipe to steps of a graph.
//!
//! Nothing is computed here but what the graph's shape needs: which files a glTF refers to, which maps there are.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::bake::{Extent, Library, UnwrapParams, default_gutter_px};
use crate::build::{Graph, InputId, StepId};
use crate::disk::Disk;
use crate::exemplar::AnalysisParams;
use crate::field::{OrientationConstraint, ScalarConstraint, SingularityConstraint, SingularityKind, Symmetry};
use crate::io::SampleType;
use crate::io::image_file::{Compression, Transfer};
use crate::io::image_set::{NormalY, Options, Slot};
use crate::io::image_strips::Container;
use crate::io::scene::external_files;
use crate::recipe::limits::FLIPBOOK_TEXELS;
use crate::recipe::{self, Canvas, FileRef, ImageFormat, MapFile, MapOutput, MeshBake, Recipe, Target, Word};
use crate::synth::image_copy::BlendKernel;
use crate::synth::image_order::ImageOrder;
use crate::synth::image_walk::ImageWalkParams;
use crate::synth::vertex_walk::VertexWalkParams;
use crate::synth::volume_copy::VolumeKernel;
use crate::synth::volume_walk::VolumeWalkParams;
use crate::texture::{MapKind, Wrap};
use crate::uvset::Blend;

use super::analyse::Analyse;
use super::canvas::{PaintImage, WalkImage};
use super::encode::Encode;
use super::field::LayField;
use super::flipbook::{AnalyseFlipbook, CopyFrame, ReadFlipbook, WalkFlipbook, frame_number};
use super::glb::{AtlasGlb, UvSetsGlb};
use super::lod::TakeFromFinest;
use super::maps::Maps;
use super::painting::Picture;
use super::prepare::{Prepare, Scale};
use super::rasterise::{ImageSpec, Rasterise};
use super::render::RenderView;
use super::report::{CanvasReport, Report};
use super::surface::{ReadSurface, SceneFiles};
use super::synthesise::{Order, Synthesise};
use super::unwrap::{Layout, Unwrap};

/// Largest scene file that planning reads, in bytes.
const SCENE_LIMIT: u64 = 1 << 31;

/// What a recipe became in the graph.
#[derive(Clone, Debug)]
pub struct Planned {
    /// The recipe's name.
    pub name: String,
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
pub fn add(graph: &mut Graph, recipe: &Recipe, out: &Path, disk: &dyn Disk) -> Result<Planned, PlanError> {
    let folder = out.join(&recipe.name);
    let planned = Planned { name: recipe.name.clone(), outputs: Vec::new(), steps: Vec::new() };
    let mut planner = Planner { graph, recipe, disk, folder, planned };
    // What can fail comes first, so that a recipe that can't be baked leaves no steps behind.
    if let (Target::Canvas(canvas), true) = (&recipe.target, recipe.exemplar.maps.iter().any(|m| m.frames.is_some())) {
        let (files, frames) = planner.frame_files()?;
        planner.flipbook(canvas, files, frames)?;
        return Ok(planner.planned);
    }
    let maps = planner.map_files()?;
    match &recipe.target {
        Target::Mesh(bake) => {
            let files = std::iter::once(&bake.mesh).chain(&bake.lods);
            let scenes = files.map(|file| planner.scene(file, bake)).collect::<Result<Vec<_>, _>>()?;
            planner.mesh(bake, scenes, maps);
        }
        Target::Canvas(canvas) => planner.canvas(canvas, maps),
    }
    Ok(planner.planned)
}

/// Adds steps for one recipe.
struct Planner<'a> {
    graph: &'a mut Graph,
    recipe: &'a Recipe,
    disk: &'a dyn Disk,
    folder: PathBuf,
    planned: Planned,
}

impl Planner<'_> {
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

    /// The exemplar's files, all of which are there.
    fn map_files(&self) -> Result<Vec<PathBuf>, PlanError> {
        let exemplar = &self.recipe.exemplar;
        let files = exemplar.maps.iter().map(|m| &m.file).chain(&exemplar.feature_mask);
        files
            .map(|file| match self.disk.stamp(&file.path) {
                Ok(Some(_)) => Ok(file.path.clone()),
                Ok(None) => {
                    let (path, key, place) = (file.path.display(), &file.key, &file.place);
                    Err(PlanError(format!("{path}: there is no such file (named as {key} in {place})")))
                }
                Err(e) => {
                    Err(PlanError(format!("{}: {e} (named as {} in {})", file.path.display(), file.key, file.place)))
                }
            })
            .collect()
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

    /// What the exemplar's files are, in their order.
    fn slots(&self) -> (Vec<Slot>, Options) {
        let exemplar = &self.recipe.exemplar;
        let slot = |map: MapFile| match map {
            MapFile::Orm => Slot::Orm,
            single => Slot::Map(single.kinds()[0]),
        };
        let mut slots: Vec<Slot> = exemplar.maps.iter().map(|m| slot(m.map)).collect();
        if exemplar.feature_mask.is_some() {
            slots.push(Slot::Map(MapKind::FeatureMask));
        }
        let normal_y = match exemplar.normal_y {
            recipe::NormalY::Up => NormalY::Up,
            recipe::NormalY::Down => NormalY::Down,
        };
        (slots, Options { normal_y })
    }

    /// Decodes the exemplar's files.
    fn maps(&mut self, files: Vec<PathBuf>) -> StepId {
        let (slots, options) = self.slots();
        let inputs: Vec<InputId> = files.into_iter().map(|f| self.graph.add_file(f)).collect();
        let recipe = self.name();
        self.step(Maps { recipe, slots, options }, &inputs)
    }

    fn analyse(&mut self, maps: StepId) -> StepId {
        let (recipe, params) = (self.name(), self.analysis());
        self.step(Analyse { recipe, params }, &[maps.into()])
    }

    fn analysis(&self) -> AnalysisParams {
        let recipe::Analysis { neighbourhoods, jumps, variance, alpha, diversity, min_distance } =
            self.recipe.analysis.clone();
        let importance = self.recipe.exemplar.importance.iter().copied().collect();
        let wrap = if self.recipe.exemplar.tileable { Wrap::Repeat } else { Wrap::Clamp };
        AnalysisParams { neighbourhoods, jumps, diversity, variance, alpha, min_distance, importance, wrap }
    }

    /// A flat image.
    fn canvas(&mut self, canvas: &Canvas, files: Vec<PathBuf>) {
        let maps = self.maps(files);
        let analyse = self.analyse(maps);
        // Frames and a loop are refused where the exemplar is a still.
        let Canvas {
            width,
            height,
            tileable,
            frames: _,
            looped: _,
            order,
            blend_kernel,
            maps: files,
            compression,
            debug,
        } = canvas;
        let order = image_order(*order);
        let recipe::Synthesis { seed, patch, refine, blend } = self.recipe.synthesis;
        let importance: BTreeMap<_, _> = self.recipe.exemplar.importance.iter().copied().collect();
        let params = ImageWalkParams { size: [*width, *height], order, patch, seed, tileable: *tileable };
        let walk = WalkImage { recipe: self.name(), params, refine, importance };
        let walk = self.step(walk, &[analyse.into(), maps.into()]);
        let kernel = match (blend, blend_kernel) {
            (recipe::Blend::None, _) => BlendKernel::None,
            (_, recipe::BlendSize::Three) => BlendKernel::Three,
            (_, recipe::BlendSize::Five) => BlendKernel::Five,
        };
        let mut paint = |image: &str, picture: Picture, (container, ext): (Container, &str)| {
            let paint = PaintImage { recipe: self.name(), image: image.to_string(), picture, kernel, container };
            let file = format!("{}.{image}.{ext}", self.recipe.name);
            let step = self.step(paint, &[walk.into(), maps.into()]);
            self.output(step, &file);
        };
        for file in files {
            let ImageSpec { file: map, depth } = image_spec(file);
            paint(map.name(), Picture::Map(map, depth), container(file, *compression));
        }
        for picture in debug {
            let png = Container::Png { transfer: Transfer::Unstated, compression: squeeze(*compression) };
            paint(picture.name(), Picture::Debug(*picture), (png, "png"));
        }
        let report = self.step(CanvasReport { recipe: self.name() }, &[analyse.into(), walk.into()]);
        self.output(report, "report.json");
    }

    /// A flat image in many frames.
    fn flipbook(&mut self, canvas: &Canvas, files: Vec<PathBuf>, exemplar_frames: u32) -> Result<(), PlanError> {
        // Pictures of the walk and other blend kernels are refused for flipbooks.
        let Canvas { width, height, tileable, frames, looped, order, blend_kernel: _, maps, compression, debug: _ } =
            canvas;
        let frames = frames.unwrap_or(exemplar_frames);
        let texels = u64::from(*width) * u64::from(*height) * u64::from(frames);
        if texels > FLIPBOOK_TEXELS {
            let path = self.recipe.path.display();
            return Err(PlanError(format!(
                "{path}: {frames} frames of {width} x {height}, as many as the exemplar has, are {texels} texels, and a \
                 flipbook may have {FLIPBOOK_TEXELS}; lower `canvas.size` or give `canvas.frames`"
            )));
        }
        let (slots, options) = self.slots();
        let files: Vec<InputId> = files.into_iter().map(|f| self.graph.add_file(f)).collect();
        let read = self.step(ReadFlipbook { recipe: self.name(), slots, frames: exemplar_frames, options }, &files);
        let analyse = AnalyseFlipbook { recipe: self.name(), params: self.analysis() };
        let analyse = self.step(analyse, &[read.into()]);
        let recipe::Synthesis { seed, patch, refine, blend } = self.recipe.synthesis;
        let importance = self.recipe.exemplar.importance.iter().copied().collect();
        let (size, order) = ([*width, *height, frames], image_order(*order));
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
        let bytes = self.disk.read(path, SCENE_LIMIT).map_err(|e| fail(e.to_string()))?;
        let label = path.to_string_lossy();
        let mut uris = external_files(super::file_name(&label), &bytes).map_err(|e| fail(e.to_string()))?;
        let folder = path.parent().unwrap_or(Path::new(""));
        // A picture that is not there matters only if its material is kept; the reader says so then.
        uris.retain(|uri| !is_picture(uri) || matches!(self.disk.stamp(&folder.join(uri)), Ok(Some(_))));
        if let Some(gone) = uris.iter().find(|uri| matches!(self.disk.stamp(&folder.join(uri)), Ok(None))) {
            return Err(fail(format!("it refers to `{gone}`, and there is no such file beside it")));
        }
        let mut inputs = vec![self.graph.add_file(path)];
        inputs.extend(uris.iter().map(|uri| self.graph.add_file(folder.join(uri))));
        Ok((SceneFiles { uris, materials: bake.materials.clone() }, inputs))
    }

    /// A textured mesh and its simplifications: the finest is synthesised, the others take from it.
    fn mesh(&mut self, bake: &MeshBake, scenes: Vec<Scene>, maps: Vec<PathBuf>) {
        let maps = self.maps(maps);
        let analyse = self.analyse(maps);
        let max_factor = bake.field.scale.iter().fold(1.0, |m: f64, c| m.max(c.factor));
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
            let prepare = self.step(Prepare { recipe: name.clone(), scale, max_factor }, &inputs);
            let synthesise = match finest {
                None => self.synthesise(bake, prepare, analyse, maps),
                Some((finest, synthesised)) => {
                    let inputs = [finest, synthesised, prepare].map(InputId::from);
                    self.step(TakeFromFinest { recipe: name.clone() }, &inputs)
                }
            };
            finest = finest.or(Some((prepare, synthesise)));
            self.level(bake, name, scene, Level { maps, analyse, surface, prepare, synthesise });
        }
    }

    /// The field and the walk.
    fn synthesise(&mut self, bake: &MeshBake, prepare: StepId, analyse: StepId, maps: StepId) -> StepId {
        let recipe = self.name();
        let (field, symmetry) = lay_field(&recipe, &bake.field);
        let field = self.step(field, &[prepare.into()]);
        let recipe::Synthesis { seed, patch, refine, blend } = self.recipe.synthesis;
        let importance: BTreeMap<_, _> = self.recipe.exemplar.importance.iter().copied().collect();
        let order = match bake.order {
            recipe::WalkOrder::RegionGrowing => Order::RegionGrowing,
            recipe::WalkOrder::RenderingSequence => Order::RenderingSequence,
        };
        let blend = match blend {
            recipe::Blend::Linear => Blend::Linear,
            recipe::Blend::Variance => Blend::Variance,
            recipe::Blend::None => Blend::Nearest,
        };
        let walk = VertexWalkParams { patch, seed, ..VertexWalkParams::default() };
        let sharpness = bake.sharpness;
        let synthesise = Synthesise { recipe, walk, symmetry, order, blend, sharpness, refine, importance };
        self.step(synthesise, &[prepare, field, analyse, maps].map(InputId::from))
    }

    /// What comes out of one level of detail.
    fn level(&mut self, bake: &MeshBake, recipe: String, (scene, files): Scene, level: Level) {
        let Level { maps, analyse, surface, prepare, synthesise } = level;
        let mut atlas_steps = None;
        if let Some(atlas) = &bake.atlas {
            let (layout, gutter_px) = layout(atlas);
            let unwrap = self.step(Unwrap { recipe: recipe.clone(), layout }, &[surface.into()]);
            let images = atlas.maps.iter().map(image_spec).collect();
            let inputs = [surface, prepare, synthesise, unwrap, maps].map(InputId::from);
            let bundle = self.step(Rasterise { recipe: recipe.clone(), images, gutter_px }, &inputs);
            self.encode(&recipe, &atlas.maps, atlas.compression, bundle, None);
            let glb = AtlasGlb { recipe: recipe.clone(), scene: scene.clone() };
            let inputs = [&files[..], &[surface, unwrap, bundle].map(InputId::from)].concat();
            let glb = self.step(glb, &inputs);
            self.output(glb, &format!("{recipe}.glb"));
            atlas_steps = Some((unwrap, bundle));
        }
        if let Some(uv_sets) = &bake.uv_sets {
            let glb = UvSetsGlb { recipe: recipe.clone(), scene, weld_texels: uv_sets.weld };
            let inputs = [&files[..], &[surface, prepare, synthesise, maps].map(InputId::from)].concat();
            let glb = self.step(glb, &inputs);
            self.output(glb, &format!("{recipe}.uvsets.glb"));
        }
        let mut inputs = [surface, prepare, synthesise, maps].map(InputId::from).to_vec();
        inputs.extend(atlas_steps.iter().flat_map(|(unwrap, bundle)| [InputId::from(*unwrap), InputId::from(*bundle)]));
        // `name` for the finest, `name.lod1` for the first simplification.
        let suffix = recipe.strip_prefix(&self.recipe.name).unwrap_or_default().to_string();
        for view in &bake.renders {
            let file = format!("render/{}{suffix}.png", view.name);
            let render = self.step(RenderView { recipe: recipe.clone(), view: view.clone() }, &inputs);
            self.output(render, &file);
        }
        inputs[3] = analyse.into();
        let report = self.step(Report { recipe }, &inputs);
        self.output(report, &format!("report{suffix}.json"));
    }
}

/// A scene's files, and they as inputs.
type Scene = (SceneFiles, Vec<InputId>);

/// The steps that the outputs of a level are made from.
struct Level {
    maps: StepId,
    analyse: StepId,
    surface: StepId,
    prepare: StepId,
    synthesise: StepId,
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

fn layout(atlas: &recipe::Atlas) -> (Layout, u32) {
    let (extent, side) = match atlas.size {
        recipe::AtlasSize::Side(side) => (Extent::Page(side), side),
        recipe::AtlasSize::TexelsPerUnit(density) => (Extent::TexelsPerUnit(density), 1024),
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
    let recipe::Field { symmetry, orientation, singularities, scale } = from;
    let symmetry = match symmetry {
        recipe::Symmetry::One => Symmetry::One,
        recipe::Symmetry::Two => Symmetry::Two,
        recipe::Symmetry::Four => Symmetry::Four,
        recipe::Symmetry::Isotropic => Symmetry::Isotropic,
    };
    let anchor = |&recipe::Orientation { at, up, radius }: &_| OrientationConstraint { at, up, radius };
    let singular = |&recipe::Singularity { at, kind, radius }: &_| {
        let kind = match kind {
            recipe::SingularityKind::Source => SingularityKind::Source,
            recipe::SingularityKind::Sink => SingularityKind::Sink,
            recipe::SingularityKind::Vortex => SingularityKind::Vortex,
        };
        SingularityConstraint { at, kind, radius }
    };
    let factor = |&recipe::ScalePoint { at, factor, radius }: &_| ScalarConstraint { at, value: factor, radius };
    let field = LayField {
        recipe: recipe.to_string(),
        symmetry,
        orientation: orientation.iter().map(anchor).collect(),
        singularities: singularities.iter().map(singular).collect(),
        scale: scale.iter().map(factor).collect(),
    };
    (field, symmetry)
}
