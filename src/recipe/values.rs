//! A validated recipe: plain values, ready for the kernels.
//!
//! Numbers are within their ranges, names are resolved, defaults are filled in, combinations make sense and can be
//! done by this version. Lengths in mesh units, angles in radians, directions of unit length.
//! Unaware of: TOML, what the files hold.

use super::FramePattern;
use super::words::{
    AlignTo, AtlasFilter, Blend, CanvasDebug, CanvasOrder, Compression, ImageFormat, MapFile, NormalY, RemoteMode,
    Shading, SingularityKind, TextonFeatures, TileShape, Unwrap, WalkOrder,
};
use crate::numerics::vec::Vec3;
use crate::texture::MapKind;
use std::path::PathBuf;

/// One asset: what is textured, from which sample, how, and what is written.
#[derive(Clone, Debug, PartialEq)]
pub struct Recipe {
    /// The stem of the recipe's file; a plain file name.
    pub name: String,
    /// The recipe's file, as it was given.
    pub path: PathBuf,
    /// The sample.
    pub exemplar: Exemplar,
    /// How the sample is analysed.
    pub analysis: Analysis,
    /// How the texture is made from it.
    pub synthesis: Synthesis,
    /// What is textured, and what is written.
    pub target: Target,
}

/// What a recipe textures.
#[derive(Clone, Debug, PartialEq)]
#[allow(clippy::large_enum_variant, reason = "there is one per recipe")]
pub enum Target {
    /// A mesh.
    Mesh(MeshBake),
    /// A flat image.
    Canvas(Canvas),
}

/// A file that a recipe names.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FileRef {
    /// The key that names it, such as `exemplar.normal`.
    pub key: String,
    /// The path as written.
    pub written: String,
    /// The path resolved against the recipe's folder, `.` and `..` taken out by name alone.
    pub path: PathBuf,
    /// Where it is named, `file:line:column`, for messages.
    pub place: String,
}

/// Maps of one sample, or of several with the same maps.
#[derive(Clone, Debug, PartialEq)]
pub struct Exemplar {
    /// The files of the maps, or their patterns, in the order of [`MapFile`], at least one. No map is in two files.
    pub maps: Vec<ExemplarMap>,
    /// Black and white: where the features are.
    pub feature_mask: Option<FileRef>,
    /// The sample wraps in both directions.
    pub tileable: bool,
    /// Which way the normal map's green channel points.
    pub normal_y: NormalY,
    /// White where texels may be copied from; canvases only.
    pub mask: Option<FileRef>,
    /// What is where, in the colours of the canvas' guide; all samples have one or none.
    pub guide: Option<FileRef>,
    /// Further samples; canvases only.
    pub more: Vec<Sample>,
    /// Weight of each map in the similarity, all positive, in the order of [`MapKind`]; maps left out weigh nothing.
    pub importance: Vec<(MapKind, f64)>,
}

/// A sample of several.
#[derive(Clone, Debug, PartialEq)]
pub struct Sample {
    /// The files of the maps in the order of [`MapFile`], at least one. No map is in two files.
    pub maps: Vec<ExemplarMap>,
    /// Black and white: where the features are.
    pub feature_mask: Option<FileRef>,
    /// Which way the normal map's green channel points.
    pub normal_y: NormalY,
    /// White where texels may be copied from.
    pub mask: Option<FileRef>,
    /// What is where, in the colours of the canvas' guide.
    pub guide: Option<FileRef>,
}

impl Exemplar {
    /// All samples, at least one.
    pub fn samples(&self) -> Vec<Sample> {
        let Exemplar { maps, feature_mask, tileable: _, normal_y, mask, guide, more, importance: _ } = self.clone();
        let mut samples = vec![Sample { maps, feature_mask, normal_y, mask, guide }];
        samples.extend(more);
        samples
    }
}

impl Sample {
    /// The maps that its files say it holds, in order; an alpha channel may add one.
    pub fn kinds(&self) -> Vec<MapKind> {
        let mut kinds: Vec<MapKind> = self.maps.iter().flat_map(|m| m.map.kinds()).copied().collect();
        kinds.extend(self.feature_mask.as_ref().map(|_| MapKind::FeatureMask));
        kinds.sort_unstable();
        kinds
    }
}

/// A map of the sample.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ExemplarMap {
    /// Which.
    pub map: MapFile,
    /// Its file; of a flipbook, a file whose name is a pattern.
    pub file: FileRef,
    /// That pattern: all maps of a flipbook have one, those of a still none.
    pub frames: Option<FramePattern>,
}

/// The parameters of the analysis; what is not `textons` is the jump map's (\[ZG02\] section 2).
#[derive(Clone, Debug, PartialEq)]
pub struct Analysis {
    /// Sides of the neighbourhoods in texels, odd, finest pyramid level first; at least one.
    pub neighbourhoods: Vec<u32>,
    /// Jumps per texel, k.
    pub jumps: u32,
    /// Share of the variance that the reduced neighbourhoods keep, 0 < v <= 1.
    pub variance: f64,
    /// Leniency of Eq. 1.
    pub alpha: f64,
    /// Candidates per jump, beta.
    pub diversity: u32,
    /// Radius of the Poisson disc in texels; `None`: from the exemplar's size.
    pub min_distance: Option<f64>,
    /// Textons instead of a jump map.
    pub textons: Option<Textons>,
    /// A tile instead of either; meshes only.
    pub tile: Option<TileKeys>,
}

/// A material-space tile (\[MST09\] section 1).
#[derive(Clone, Debug, PartialEq)]
pub struct TileKeys {
    /// Layers, at least one per key and at least two.
    pub layers: u32,
    /// The keys after the exemplar, with its maps.
    pub keys: Vec<Sample>,
    /// What it is written as.
    pub shape: TileShape,
}

/// The texton method's parameters (\[MK03\] section 3).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Textons {
    /// Side of the window in texels, odd.
    pub window: u32,
    /// Number of textons; `None`: the square root of the number of texels.
    pub count: Option<u32>,
    /// What is clustered.
    pub features: TextonFeatures,
    /// Orientations in which textons are known.
    pub rotations: u32,
    /// Places that are ranked for each piece.
    pub candidates: u32,
    /// Continuity error above which edges are blended.
    pub blend_threshold: f64,
}

/// How the texture is made, on meshes and canvases alike.
#[derive(Clone, Debug, PartialEq)]
pub struct Synthesis {
    /// Seed of every random number.
    pub seed: u64,
    /// Mean distance between jumps, in exemplar sides.
    pub patch: f64,
    /// Correction passes over all neighbours.
    pub refine: u32,
    /// How patches meet.
    pub blend: Blend,
}

/// A flat image.
#[derive(Clone, Debug, PartialEq)]
pub struct Canvas {
    /// Texels per row and rows; `None`: those of the guide, of the picture to fill or of the sources.
    pub size: Option<[u32; 2]>,
    /// The output wraps in both directions.
    pub tileable: bool,
    /// Frames to make of a flipbook; `None`: as many as the exemplar has.
    pub frames: Option<u32>,
    /// The first frame of a flipbook follows the last.
    pub looped: bool,
    /// In which order texels are synthesised.
    pub order: CanvasOrder,
    /// What is wanted where.
    pub guide: Option<CanvasGuide>,
    /// White where the first sample is to be filled in.
    pub inpaint: Option<FileRef>,
    /// Sources to apply again; then there is no guide and nothing to fill in.
    pub sources: Option<FileRef>,
    /// Kernel by which patches are blended, if they are.
    pub blend_kernel: BlendSize,
    /// The maps to write, at least one.
    pub maps: Vec<MapOutput>,
    /// How hard PNG files are squeezed.
    pub compression: Compression,
    /// Pictures of how it came about, each once.
    pub debug: Vec<CanvasDebug>,
}

/// Side of a kernel by which patches are blended (\[ZG02\] section 3.1).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BlendSize {
    /// 3 x 3 texels.
    Three,
    /// 5 x 5 texels.
    Five,
}

/// What is wanted where on a canvas.
#[derive(Clone, Debug, PartialEq)]
pub struct CanvasGuide {
    /// A picture of the canvas.
    pub file: FileRef,
    /// What differences count against seams.
    pub weight: f64,
}

/// A map to write.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MapOutput {
    /// Which.
    pub map: MapFile,
    /// Its file format.
    pub format: ImageFormat,
}

/// A textured mesh and at least one thing to write of it.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshBake {
    /// The mesh's file: .glb, .gltf or .obj.
    pub mesh: FileRef,
    /// Only the primitives of these materials; `None`: all.
    pub materials: Option<Vec<String>>,
    /// Simplifications that take their texture from the mesh, finest first.
    pub lods: Vec<FileRef>,
    /// How large the sample lies on the surface.
    pub scale: Scale,
    /// In which order vertices are visited.
    pub order: WalkOrder,
    /// Power of the blend weights, 1 or more.
    pub sharpness: u32,
    /// Which way the sample lies.
    pub field: Field,
    /// A UV unwrap with finished maps.
    pub atlas: Option<Atlas>,
    /// Texture coordinates and weights for a shader.
    pub uv_sets: Option<UvSets>,
    /// Golden views.
    pub renders: Vec<Render>,
}

/// How large the sample lies on the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Scale {
    /// So many exemplar texels per mesh unit.
    TexelsPerUnit(f64),
    /// From the mesh's size (\[MK03\] Eq. 1).
    Auto,
}

/// In how many directions the sample looks the same.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Symmetry {
    /// In one.
    One,
    /// In two: upside down.
    Two,
    /// In four: quarter turns.
    Four,
    /// It has no preferred direction.
    Isotropic,
}

/// Constraints on the orientation and the scale over a surface.
#[derive(Clone, Debug, PartialEq)]
pub struct Field {
    /// In how many directions the sample looks the same.
    pub symmetry: Symmetry,
    /// "Up" of the sample at points.
    pub orientation: Vec<Orientation>,
    /// Points around which the orientation turns.
    pub singularities: Vec<Singularity>,
    /// Lines of the surface that the orientation is drawn to, each once.
    pub align: Vec<AlignTo>,
    /// Local factors on the scale.
    pub scale: Vec<ScalePoint>,
    /// The material axis at points; empty but for material space.
    pub material: Vec<MaterialPoint>,
}

/// "Up" of the sample at a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Orientation {
    /// The point; the nearest of the surface counts.
    pub at: Vec3,
    /// The direction, of unit length.
    pub up: Vec3,
    /// Acts only within this geodesic distance.
    pub radius: Option<f64>,
}

/// A point around which the orientation turns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Singularity {
    /// The point; the nearest of the surface counts.
    pub at: Vec3,
    /// What it looks like.
    pub kind: Singular,
    /// Acts only within this geodesic distance.
    pub radius: Option<f64>,
}

/// What the orientation does around a singularity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Singular {
    /// One turn of a known look.
    Kind(SingularityKind),
    /// So many turns, a multiple of 1/symmetry other than 0.
    Index(f64),
}

/// A local factor on the scale.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScalePoint {
    /// The point; the nearest of the surface counts.
    pub at: Vec3,
    /// Multiplies the texels per unit.
    pub factor: f64,
    /// Acts only within this geodesic distance.
    pub radius: Option<f64>,
}

/// A position on the material axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MaterialPoint {
    /// The point; the nearest of the surface counts.
    pub at: Vec3,
    /// 0 at the first key, 1 at the last.
    pub value: f64,
    /// Acts only within this geodesic distance.
    pub radius: Option<f64>,
}

/// A UV unwrap with finished maps.
#[derive(Clone, Debug, PartialEq)]
pub struct Atlas {
    /// How large it is.
    pub size: AtlasSize,
    /// Texels around each chart; `None`: enough for every mip level.
    pub gutter: Option<u32>,
    /// The maps to write, at least one.
    pub maps: Vec<MapOutput>,
    /// How hard PNG files are squeezed.
    pub compression: Compression,
    /// The gutter and the files are made for mip levels.
    pub mips: bool,
    /// Where its texture coordinates come from.
    pub layout: Layout,
    /// Correction passes over its texels.
    pub refine: u32,
    /// How the sample is interpolated between its texels.
    pub filter: AtlasFilter,
}

/// How large an atlas is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AtlasSize {
    /// Its side in texels.
    Side(u32),
    /// Its texels per mesh unit, from which the side follows.
    TexelsPerUnit(f64),
}

/// Where an atlas' texture coordinates come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layout {
    /// A library lays it out.
    Unwrap(Unwrap),
    /// The mesh's own TEXCOORD_0.
    KeepUv,
}

/// Texture coordinates and weights for a shader.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UvSets {
    /// Texels within which corners may share a vertex.
    pub weld: f64,
}

/// A golden view.
#[derive(Clone, Debug, PartialEq)]
pub struct Render {
    /// Its name, unique in the recipe: `turntable-4` or `camera`; further ones of the same name carry their shading
    /// (`camera-normal`) or, if that is taken, a number (`camera-2`).
    pub name: String,
    /// From where.
    pub view: View,
    /// Side of the picture in pixels.
    pub size: u32,
    /// What it shows.
    pub shading: Shading,
}

/// Where a golden view is taken from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum View {
    /// So many views around the mesh.
    Turntable(u32),
    /// One view.
    Camera {
        /// Place of the eye.
        eye: Vec3,
        /// The point looked at; not the eye.
        target: Vec3,
        /// Vertical field of view in radians.
        fov: f64,
    },
}

/// What holds for every recipe of a project, from `kiln.toml`.
#[derive(Clone, Debug, Default)]
pub struct Project {
    /// Tables merged under each recipe.
    pub defaults: super::Defaults,
    /// Where artefacts are kept.
    pub cache: Cache,
}

/// Where artefacts are kept.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Cache {
    /// The folder, resolved against the folder of `kiln.toml`; `None`: kiln's own choice.
    pub path: Option<FileRef>,
    /// The cache is trimmed to so many bytes; `None`: no bound.
    pub max_size: Option<u64>,
    /// Who is asked beside.
    pub remote: Remote,
}

/// A server of the Remote Execution API.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Remote {
    /// `grpc://host:port` or `grpcs://host:port`; `None`: nobody is asked.
    pub url: Option<String>,
    /// The server's instance.
    pub instance: String,
    /// Whether results are stored there.
    pub mode: RemoteMode,
    /// Whether workers do steps.
    pub execute: bool,
    /// Longest time for an answer, in seconds.
    pub timeout: u64,
    /// Longest time for a step on a worker, in seconds.
    pub execute_timeout: u64,
    /// What kind of machine a worker has to be: names and values.
    pub platform: Vec<(String, String)>,
}

impl Default for Remote {
    fn default() -> Self {
        Remote {
            url: None,
            instance: String::new(),
            mode: RemoteMode::ReadWrite,
            execute: false,
            timeout: 10,
            execute_timeout: 600,
            platform: Vec::new(),
        }
    }
}
