//! The recipe as written: serde types of every table and key, from which the JSON Schema is derived.
//!
//! Source: the recipe format, version 1. The doc comments are the descriptions that editors show, so they speak to
//! the recipe's author. Keys without a default are marked `required`; serde still takes them as absent, because
//! [`super::shape`] has reported them by then and the remaining faults should be found too.
//! Unaware of: which combinations make sense, which features exist yet: see [`super::validate`].

use super::limits;
use super::words::{
    AlignTo, AtlasFilter, Blend, CanvasDebug, CanvasOrder, Compression, ImageFormat, MapFile, Method, NormalY,
    RemoteMode, Shading, SingularityKind, TextonFeatures, TileShape, Unwrap, WalkOrder,
};
use schemars::{JsonSchema, Schema};
use serde::{Deserialize, Serialize};
use std::ops::RangeInclusive;

/// Sets the range of a number.
fn within<T: Serialize>(range: RangeInclusive<T>) -> impl FnMut(&mut Schema) {
    move |schema| {
        schema.insert("minimum".into(), serde_json::json!(range.start()));
        schema.insert("maximum".into(), serde_json::json!(range.end()));
    }
}

/// Sets the range of each number of an array.
fn each<T: Serialize>(range: RangeInclusive<T>) -> impl FnMut(&mut Schema) {
    let mut inner = within(range);
    move |schema| {
        if let Some(items) = schema.get_mut("items").and_then(|items| items.try_into().ok()) {
            inner(items);
        }
    }
}

/// Odd numbers only.
fn odd(schema: &mut Schema) {
    schema.insert("not".into(), serde_json::json!({ "multipleOf": 2 }));
}

/// Odd numbers only, in an array.
fn each_odd(schema: &mut Schema) {
    if let Some(items) = schema.get_mut("items").and_then(|items| items.try_into().ok()) {
        odd(items);
    }
}

/// At least one item or character.
fn filled(schema: &mut Schema) {
    let key = if schema.get("items").is_some() { "minItems" } else { "minLength" };
    schema.insert(key.into(), 1.into());
}

/// A kiln recipe: one textured asset.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
#[schemars(extend("required" = ["exemplar"]))]
pub struct Recipe {
    /// Recipe format.
    #[schemars(extend("const" = 1))]
    pub kiln: u32,
    /// The mesh to cover. Exactly one of `[mesh]` and `[canvas]`.
    pub mesh: Option<Mesh>,
    /// A flat image instead of a mesh.
    pub canvas: Option<Canvas>,
    /// Maps of one sample, all the same size; analysed together, synthesised once.
    pub exemplar: Option<Exemplar>,
    /// How the sample is analysed.
    pub analysis: Analysis,
    /// Which way the sample lies on the surface, and how large.
    pub field: Option<Field>,
    /// How the texture is made from the sample.
    pub synthesis: Synthesis,
    /// A UV unwrap with finished maps. Omit when not wanted.
    pub atlas: Option<Atlas>,
    /// Texture coordinates and blend weights for a shader; the sample stays the only texture. Omit when not wanted.
    pub uv_sets: Option<UvSets>,
    /// Golden views by the built-in renderer.
    #[schemars(length(max = limits::RENDERS))]
    pub render: Vec<Render>,
}

impl Default for Recipe {
    fn default() -> Self {
        Recipe {
            kiln: 1,
            mesh: None,
            canvas: None,
            exemplar: None,
            analysis: Analysis::default(),
            field: None,
            synthesis: Synthesis::default(),
            atlas: None,
            uv_sets: None,
            render: Vec::new(),
        }
    }
}

/// The mesh to cover.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
#[schemars(extend("required" = ["path"]))]
pub struct Mesh {
    /// A .glb, .gltf or .obj file, relative to the recipe.
    #[schemars(transform = filled)]
    pub path: Option<String>,
    /// Only the primitives of these materials; the others pass through untouched. Default: all.
    #[schemars(transform = filled)]
    pub materials: Option<Vec<String>>,
    /// Simplifications of the mesh, finest first: they are baked as well, with the texture that the mesh has there, so
    /// that a change of level does not change the picture. jump-map, texton.
    #[schemars(length(max = limits::LODS))]
    pub lods: Vec<String>,
}

/// A flat image instead of a mesh.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Canvas {
    /// Width and height in texels. May be left out where `guide`, `inpaint` or `sources` says it.
    #[schemars(transform = each(limits::CANVAS_SIDE))]
    pub size: Option<[u32; 2]>,
    /// The output wraps in both directions.
    pub tileable: bool,
    /// Frames to make of a flipbook. Default: as many as the exemplar has.
    #[schemars(transform = within(limits::FRAMES))]
    pub frames: Option<u32>,
    /// The first frame of a flipbook follows the last.
    #[serde(rename = "loop")]
    pub looped: bool,
    /// In which order texels are synthesised.
    pub order: CanvasOrder,
    /// What is wanted where: a picture of the canvas in the colours of the exemplar's `guide`. If the exemplar has none,
    /// light and dark are followed: any picture of the canvas will do.
    #[schemars(transform = filled)]
    pub guide: Option<String>,
    /// What differences from the guide count against seams. Default: 1.
    #[schemars(transform = within(limits::GUIDE_WEIGHT))]
    pub guide_weight: Option<f64>,
    /// A picture of the first sample's size, white where texture is to be filled in. The canvas is that sample, which
    /// stays as it is elsewhere.
    #[schemars(transform = filled)]
    pub inpaint: Option<String>,
    /// Source coordinates of a synthesis, as `debug` writes them: it is applied again, to these maps. Nothing is analysed.
    #[schemars(transform = filled)]
    pub sources: Option<String>,
    /// Side of the kernel, in texels, by which patches are blended where `blend` of `[synthesis]` is "linear".
    #[schemars(extend("enum" = [3, 5]))]
    pub blend_kernel: u32,
    /// Maps to write. Default: what the exemplar has.
    #[schemars(transform = filled)]
    pub maps: Option<Vec<MapFile>>,
    /// File format of the maps: one for all, or a table of one per map.
    pub format: Formats,
    /// How hard PNG files are squeezed.
    pub compression: Compression,
    /// Pictures of how it came about, written beside the maps: "patches" colours each texel by its place in the exemplar,
    /// "sources" has that place as numbers of 16 bits, "jumps" shows where patches begin.
    pub debug: Vec<CanvasDebug>,
}

impl Default for Canvas {
    fn default() -> Self {
        Canvas {
            size: None,
            tileable: false,
            frames: None,
            looped: false,
            order: CanvasOrder::Hilbert,
            guide: None,
            guide_weight: None,
            inpaint: None,
            sources: None,
            blend_kernel: 3,
            maps: None,
            format: Formats::default(),
            compression: Compression::Fast,
            debug: Vec::new(),
        }
    }
}

/// Maps of one sample, all the same size.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Exemplar {
    /// Colour: sRGB, in EXR linear.
    #[schemars(transform = filled)]
    pub base_color: Option<String>,
    /// The base colour of a flipbook: a pattern of consecutive files counted from 0 or 1, such as "smoke_%04d.png". The
    /// other maps are patterns, too.
    #[schemars(transform = filled)]
    pub frames: Option<String>,
    /// Tangent-space normals.
    #[schemars(transform = filled)]
    pub normal: Option<String>,
    /// Which way the green channel of `normal` points: "up" is OpenGL, "down" DirectX.
    pub normal_y: NormalY,
    /// Roughness, linear, one channel.
    #[schemars(transform = filled)]
    pub roughness: Option<String>,
    /// Metalness, linear, one channel.
    #[schemars(transform = filled)]
    pub metallic: Option<String>,
    /// Ambient occlusion, linear, one channel.
    #[schemars(transform = filled)]
    pub occlusion: Option<String>,
    /// Height, linear, one channel.
    #[schemars(transform = filled)]
    pub height: Option<String>,
    /// Opacity, linear, one channel.
    #[schemars(transform = filled)]
    pub opacity: Option<String>,
    /// Occlusion, roughness and metalness packed into red, green and blue.
    #[schemars(transform = filled)]
    pub orm: Option<String>,
    /// Light given off: sRGB, in EXR linear.
    #[schemars(transform = filled)]
    pub emissive: Option<String>,
    /// Black and white: where the features are. Weighs in the analysis and steers the morph; never an output.
    #[schemars(transform = filled)]
    pub feature_mask: Option<String>,
    /// White where texels may be copied from, black where not. Those are still looked at. Default: all may.
    #[schemars(transform = filled)]
    pub mask: Option<String>,
    /// What is where on the sample, in the colours of the canvas' `guide`.
    #[schemars(transform = filled)]
    pub guide: Option<String>,
    /// Further samples with the same maps, of any size: the output is mixed of all.
    #[schemars(length(max = limits::SAMPLES))]
    pub more: Vec<Sample>,
    /// The sample itself wraps in both directions: it has no borders.
    pub tileable: bool,
    /// Weight of each map in the similarity of texels. Default: 1 for base_color, height and feature_mask.
    pub importance: Option<Importance>,
}

impl Default for Exemplar {
    fn default() -> Self {
        Exemplar {
            base_color: None,
            frames: None,
            normal: None,
            normal_y: NormalY::Up,
            roughness: None,
            metallic: None,
            occlusion: None,
            height: None,
            opacity: None,
            orm: None,
            emissive: None,
            feature_mask: None,
            mask: None,
            guide: None,
            more: Vec::new(),
            tileable: false,
            importance: None,
        }
    }
}

/// Maps of a further sample or key, all the same size; the same ones as those of `[exemplar]`.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Sample {
    /// Colour: sRGB, in EXR linear.
    #[schemars(transform = filled)]
    pub base_color: Option<String>,
    /// Tangent-space normals.
    #[schemars(transform = filled)]
    pub normal: Option<String>,
    /// Which way the green channel of `normal` points: "up" is OpenGL, "down" DirectX.
    pub normal_y: NormalY,
    /// Roughness, linear, one channel.
    #[schemars(transform = filled)]
    pub roughness: Option<String>,
    /// Metalness, linear, one channel.
    #[schemars(transform = filled)]
    pub metallic: Option<String>,
    /// Ambient occlusion, linear, one channel.
    #[schemars(transform = filled)]
    pub occlusion: Option<String>,
    /// Height, linear, one channel.
    #[schemars(transform = filled)]
    pub height: Option<String>,
    /// Opacity, linear, one channel.
    #[schemars(transform = filled)]
    pub opacity: Option<String>,
    /// Occlusion, roughness and metalness packed into red, green and blue.
    #[schemars(transform = filled)]
    pub orm: Option<String>,
    /// Light given off: sRGB, in EXR linear.
    #[schemars(transform = filled)]
    pub emissive: Option<String>,
    /// Black and white: where the features are.
    #[schemars(transform = filled)]
    pub feature_mask: Option<String>,
    /// White where texels may be copied from, black where not. Those are still looked at. Default: all may.
    #[schemars(transform = filled)]
    pub mask: Option<String>,
    /// What is where on the sample, in the colours of the canvas' `guide`.
    #[schemars(transform = filled)]
    pub guide: Option<String>,
}

impl Default for Sample {
    fn default() -> Self {
        Sample {
            base_color: None,
            normal: None,
            normal_y: NormalY::Up,
            roughness: None,
            metallic: None,
            occlusion: None,
            height: None,
            opacity: None,
            orm: None,
            emissive: None,
            feature_mask: None,
            mask: None,
            guide: None,
        }
    }
}

/// Weight of each map in the similarity of texels; maps left out weigh nothing.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Importance {
    /// Weight of the base colour.
    #[schemars(transform = within(limits::IMPORTANCE))]
    pub base_color: Option<f64>,
    /// Weight of the normal.
    #[schemars(transform = within(limits::IMPORTANCE))]
    pub normal: Option<f64>,
    /// Weight of the roughness.
    #[schemars(transform = within(limits::IMPORTANCE))]
    pub roughness: Option<f64>,
    /// Weight of the metalness.
    #[schemars(transform = within(limits::IMPORTANCE))]
    pub metallic: Option<f64>,
    /// Weight of the occlusion.
    #[schemars(transform = within(limits::IMPORTANCE))]
    pub occlusion: Option<f64>,
    /// Weight of the height.
    #[schemars(transform = within(limits::IMPORTANCE))]
    pub height: Option<f64>,
    /// Weight of the opacity.
    #[schemars(transform = within(limits::IMPORTANCE))]
    pub opacity: Option<f64>,
    /// Weight of the emission.
    #[schemars(transform = within(limits::IMPORTANCE))]
    pub emissive: Option<f64>,
    /// Weight of the feature mask.
    #[schemars(transform = within(limits::IMPORTANCE))]
    pub feature_mask: Option<f64>,
}

/// How the sample is analysed.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Analysis {
    /// Method: "jump-map" walks similar texels, "texton" quilts clusters, "material-space" builds a tile.
    pub method: Method,
    /// jump-map: sides of the neighbourhoods in texels, finest pyramid level first.
    #[schemars(length(min = *limits::LEVELS.start(), max = *limits::LEVELS.end()),
               transform = each(limits::NEIGHBOURHOOD), transform = each_odd)]
    pub neighbourhoods: Vec<u32>,
    /// jump-map: jumps per texel, k.
    #[schemars(transform = within(limits::JUMPS))]
    pub jumps: u32,
    /// jump-map: share of the variance that the reduced neighbourhoods keep.
    #[schemars(transform = within(limits::VARIANCE))]
    pub variance: f64,
    /// jump-map: leniency towards jumps that fit less well.
    #[schemars(transform = within(limits::ALPHA))]
    pub alpha: f64,
    /// jump-map: candidates per jump, beta.
    #[schemars(transform = within(limits::DIVERSITY))]
    pub diversity: u32,
    /// jump-map: least distance in texels between the jumps of one texel. Default: from the exemplar's size.
    #[schemars(transform = within(limits::MIN_DISTANCE))]
    pub min_distance: Option<f64>,
    /// texton: side of the window in texels.
    #[schemars(transform = within(limits::WINDOW), transform = odd)]
    pub window: u32,
    /// texton: number of textons, or "auto", the square root of the number of texels.
    pub count: Count,
    /// texton: what is clustered.
    pub features: TextonFeatures,
    /// texton: orientations in which neighbours that lie turned are compared; 1 compares them as they lie.
    #[schemars(transform = within(limits::ROTATIONS))]
    pub rotations: u32,
    /// material-space: layers of the tile, those of the keys among them.
    #[schemars(transform = within(limits::LAYERS))]
    pub layers: u32,
    /// material-space: the further key exemplars along the material axis, after `[exemplar]`: of its size, with its maps.
    /// Without any, the layers are many tiles of `[exemplar]` whose features are in the same places: they hide its period.
    #[schemars(length(max = limits::KEYS))]
    pub key: Vec<Sample>,
    /// material-space: what the tile is written as: "3d" or, for runtimes without 3D textures, "2d-array".
    pub tile: TileShape,
}

impl Default for Analysis {
    fn default() -> Self {
        Analysis {
            method: Method::JumpMap,
            neighbourhoods: vec![9, 5, 3],
            jumps: 3,
            variance: 0.97,
            alpha: 1.1,
            diversity: 5,
            min_distance: None,
            window: 11,
            count: Count::Word(Auto::Auto),
            features: TextonFeatures::Window,
            rotations: 1,
            layers: 8,
            key: Vec::new(),
            tile: TileShape::Volume,
        }
    }
}

/// The word "auto".
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[schemars(inline)]
pub enum Auto {
    /// Chosen by kiln.
    #[serde(rename = "auto")]
    Auto,
}

/// A number of textons, or "auto".
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(untagged)]
#[schemars(inline)]
pub enum Count {
    /// The number.
    Number(#[schemars(transform = within(limits::TEXTONS))] u32),
    /// Square root of the number of texels.
    Word(Auto),
}

/// Texels per mesh unit, or "auto".
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(untagged)]
#[schemars(inline)]
pub enum Scale {
    /// The number.
    Number(#[schemars(transform = within(limits::SCALE))] f64),
    /// From the mesh's area.
    Word(Auto),
}

/// Which way the sample lies on the surface, and how large.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Field {
    /// In how many directions the sample looks the same: 1, 2, 4, or "isotropic" if it has no preferred direction.
    pub symmetry: Symmetry,
    /// "Up" of the sample at points of the surface.
    pub orientation: Vec<Orientation>,
    /// Where the orientation turns around a point. Those without `radius` are all that a surface gets: on a closed one
    /// their indices (1 for each `kind`) must sum to its Euler characteristic, such as 2 for a sphere and 0 for a torus.
    pub singularities: Vec<Singularity>,
    /// Draw the orientation along or across lines of the surface: any of "creases", "boundary" and "curvature".
    pub align: Vec<AlignTo>,
    /// Local factors on the scale of `[synthesis]`.
    pub scale: Vec<ScalePoint>,
    /// The material axis at points of the surface.
    pub material: Vec<MaterialPoint>,
}

impl Default for Field {
    fn default() -> Self {
        Field {
            symmetry: Symmetry::Ways(1),
            orientation: Vec::new(),
            singularities: Vec::new(),
            align: Vec::new(),
            scale: Vec::new(),
            material: Vec::new(),
        }
    }
}

/// 1, 2, 4 or "isotropic".
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(untagged)]
#[schemars(inline)]
pub enum Symmetry {
    /// In so many directions the sample looks the same.
    Ways(#[schemars(extend("enum" = [1, 2, 4]))] u32),
    /// No preferred direction.
    Word(Isotropic),
}

/// The word "isotropic".
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[schemars(inline)]
pub enum Isotropic {
    /// No preferred direction.
    #[serde(rename = "isotropic")]
    Isotropic,
}

/// "Up" of the sample at a point of the surface.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
#[schemars(extend("required" = ["at", "up"]))]
pub struct Orientation {
    /// The point, in mesh units; the nearest of the surface counts.
    #[schemars(transform = each(limits::COORDINATE))]
    pub at: Option<[f64; 3]>,
    /// The direction, of any length but 0.
    #[schemars(transform = each(limits::COORDINATE))]
    pub up: Option<[f64; 3]>,
    /// Acts only within this geodesic distance, in mesh units. Default: everywhere.
    #[schemars(transform = within(limits::RADIUS))]
    pub radius: Option<f64>,
}

/// A point around which the orientation turns.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
#[schemars(extend("required" = ["at"]))]
pub struct Singularity {
    /// The point, in mesh units; the nearest of the surface counts.
    #[schemars(transform = each(limits::COORDINATE))]
    pub at: Option<[f64; 3]>,
    /// What it looks like. Exactly one of `kind` and `index`.
    pub kind: Option<SingularityKind>,
    /// Turns of the orientation around it, a multiple of 1/symmetry but not 0: negative ones are saddles.
    #[schemars(transform = within(limits::INDEX))]
    pub index: Option<f64>,
    /// Acts only within this geodesic distance, in mesh units. Default: everywhere.
    #[schemars(transform = within(limits::RADIUS))]
    pub radius: Option<f64>,
}

/// A local factor on the scale.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
#[schemars(extend("required" = ["at", "factor"]))]
pub struct ScalePoint {
    /// The point, in mesh units; the nearest of the surface counts.
    #[schemars(transform = each(limits::COORDINATE))]
    pub at: Option<[f64; 3]>,
    /// Multiplies the texels per mesh unit.
    #[schemars(transform = within(limits::FACTOR))]
    pub factor: Option<f64>,
    /// Acts only within this geodesic distance, in mesh units. Default: everywhere.
    #[schemars(transform = within(limits::RADIUS))]
    pub radius: Option<f64>,
}

/// The material axis at a point.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
#[schemars(extend("required" = ["at", "value"]))]
pub struct MaterialPoint {
    /// The point, in mesh units; the nearest of the surface counts.
    #[schemars(transform = each(limits::COORDINATE))]
    pub at: Option<[f64; 3]>,
    /// Position on the material axis: 0 is the first exemplar, 1 the last.
    #[schemars(transform = within(0.0..=1.0))]
    pub value: Option<f64>,
    /// Acts only within this geodesic distance, in mesh units. Default: everywhere.
    #[schemars(transform = within(limits::RADIUS))]
    pub radius: Option<f64>,
}

/// How the texture is made from the sample.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Synthesis {
    /// Texels per mesh unit (world units: node transforms count), or "auto".
    pub scale: Scale,
    /// Another seed gives another texture of the same kind.
    #[schemars(transform = within(limits::SEED))]
    pub seed: u64,
    /// In which order vertices are visited and the triangles of `[uv_sets]` written. texton: the latter alone; pieces grow
    /// by how much of their border is finished, which leaves the fewest seams.
    pub order: WalkOrder,
    /// Mean distance between jumps, in exemplar sides; 1.0 to 1.5 is usual. texton: size of the pieces; at 1 they reach a
    /// sixteenth of the exemplar's shorter side around their middle.
    #[schemars(transform = within(limits::PATCH))]
    pub patch: f64,
    /// Correction passes over all neighbours; 0 is the published method (texton: one triangle at a time).
    #[schemars(transform = within(limits::REFINE))]
    pub refine: u32,
    /// How patches meet.
    pub blend: Blend,
    /// texton: places of the sample that are ranked for each piece, m.
    #[schemars(transform = within(limits::CANDIDATES))]
    pub candidates: u32,
    /// texton: edges are blended where the mean difference of the colours (0..1 per channel, as displayed) on their two
    /// sides is greater.
    #[schemars(transform = within(limits::BLEND_THRESHOLD))]
    pub blend_threshold: f64,
    /// Power to which the weights of patches are raised where they meet: the higher, the narrower the blend. Meshes only.
    #[schemars(transform = within(limits::SHARPNESS))]
    pub sharpness: u32,
}

impl Default for Synthesis {
    fn default() -> Self {
        Synthesis {
            scale: Scale::Word(Auto::Auto),
            seed: 1,
            order: WalkOrder::RegionGrowing,
            patch: 1.0,
            refine: 2,
            blend: Blend::Linear,
            candidates: 64,
            blend_threshold: 0.02,
            sharpness: 1,
        }
    }
}

/// A UV unwrap with finished maps.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Atlas {
    /// Side of the atlas in texels. At most one of `size` and `texels_per_unit`; default: 2048.
    #[schemars(transform = within(limits::ATLAS_SIDE))]
    pub size: Option<u32>,
    /// Atlas texels per mesh unit, from which the size follows.
    #[schemars(transform = within(limits::SCALE))]
    pub texels_per_unit: Option<f64>,
    /// Several pages, as UDIM tiles.
    pub udim: bool,
    /// Texels around each chart. Default: enough for every mip level.
    #[schemars(transform = within(limits::GUTTER))]
    pub gutter: Option<u32>,
    /// Maps to write. Default: what the exemplar has.
    #[schemars(transform = filled)]
    pub maps: Option<Vec<MapFile>>,
    /// File format of the maps: one for all, or a table of one per map.
    pub format: Formats,
    /// How hard PNG files are squeezed.
    pub compression: Compression,
    /// The gutter and the files are made for mip levels.
    pub mips: bool,
    /// The library that lays the atlas out. Default: "uvunwrap".
    pub unwrap: Option<Unwrap>,
    /// Instead of `unwrap`: the mesh's own texture coordinates; 0 is TEXCOORD_0.
    #[schemars(transform = within(limits::KEEP_UV))]
    pub keep_uv: Option<u32>,
    /// jump-map, texton: correction passes over the texels of the atlas, across the borders of its charts, after those of
    /// `synthesis.refine`, so that patches need not meet along the edges of triangles. Places come from a jump map, with
    /// textons too. What UV sets hold does not change.
    #[schemars(transform = within(limits::REFINE))]
    pub refine: u32,
    /// How the sample is interpolated between its texels: "linear" is softer, and what UV sets show.
    pub filter: AtlasFilter,
}

impl Default for Atlas {
    fn default() -> Self {
        Atlas {
            size: None,
            texels_per_unit: None,
            udim: false,
            gutter: None,
            maps: None,
            format: Formats::default(),
            compression: Compression::Fast,
            mips: true,
            unwrap: None,
            keep_uv: None,
            refine: 0,
            filter: AtlasFilter::Cubic,
        }
    }
}

/// One format for all maps, or one per map.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(untagged)]
#[schemars(inline)]
pub enum Formats {
    /// For all maps.
    One(ImageFormat),
    /// Per map; the maps left out are "png".
    PerMap(FormatPerMap),
}

impl Default for Formats {
    fn default() -> Self {
        Formats::One(ImageFormat::Png)
    }
}

/// A file format per map; the maps left out are "png".
#[derive(Clone, Copy, Debug, Default, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct FormatPerMap {
    /// Format of the base colour.
    pub base_color: Option<ImageFormat>,
    /// Format of the normal map.
    pub normal: Option<ImageFormat>,
    /// Format of the roughness map.
    pub roughness: Option<ImageFormat>,
    /// Format of the metalness map.
    pub metallic: Option<ImageFormat>,
    /// Format of the occlusion map.
    pub occlusion: Option<ImageFormat>,
    /// Format of the height map.
    pub height: Option<ImageFormat>,
    /// Format of the opacity map.
    pub opacity: Option<ImageFormat>,
    /// Format of the packed map.
    pub orm: Option<ImageFormat>,
    /// Format of the emission map.
    pub emissive: Option<ImageFormat>,
}

/// Texture coordinates and blend weights for a shader.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct UvSets {
    /// Texels within which corners may share a vertex.
    #[schemars(transform = within(limits::WELD))]
    pub weld: f64,
}

impl Default for UvSets {
    fn default() -> Self {
        UvSets { weld: 0.25 }
    }
}

/// Golden views by the built-in renderer.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Render {
    /// "turntable-N": N views around the mesh. At most one of `view` and `camera`; default: "turntable-4".
    #[schemars(extend("pattern" = "^turntable-[1-9][0-9]{0,2}$"))]
    pub view: Option<String>,
    /// A single view from a given place.
    pub camera: Option<Camera>,
    /// Side of the picture in pixels.
    #[schemars(transform = within(limits::RENDER_SIDE))]
    pub size: u32,
    /// What the picture shows.
    pub shading: Shading,
}

impl Default for Render {
    fn default() -> Self {
        Render { view: None, camera: None, size: 512, shading: Shading::Lit }
    }
}

/// Where a view is taken from.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
#[schemars(extend("required" = ["eye", "target"]))]
pub struct Camera {
    /// Place of the eye, in mesh units.
    #[schemars(transform = each(limits::COORDINATE))]
    pub eye: Option<[f64; 3]>,
    /// The point looked at.
    #[schemars(transform = each(limits::COORDINATE))]
    pub target: Option<[f64; 3]>,
    /// Vertical field of view in degrees.
    #[schemars(transform = within(limits::FOV_DEG))]
    pub fov_deg: f64,
}

impl Default for Camera {
    fn default() -> Self {
        Camera { eye: None, target: None, fov_deg: 40.0 }
    }
}

/// `kiln.toml`: what holds for every recipe of a project.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Project {
    /// Any recipe table, merged under each recipe.
    pub defaults: Option<Recipe>,
    /// Where artefacts are kept.
    pub cache: Cache,
}

/// Where artefacts are kept.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Cache {
    /// Folder, relative to `kiln.toml`. Default: chosen by kiln.
    #[schemars(transform = filled)]
    pub path: Option<String>,
    /// The cache is trimmed to so many bytes. Default: no bound.
    #[schemars(range(min = 0))]
    pub max_size: Option<u64>,
    /// A server of the Remote Execution API v2 that is asked for what is not in the folder: "grpc://host:port", or
    /// "grpcs://host:port" for TLS. A token goes into the environment variable KILN_REMOTE_HEADER, as "name: value".
    #[schemars(transform = filled)]
    pub remote: Option<String>,
    /// The server's instance. Default: its default one.
    pub remote_instance: String,
    /// Whether results are stored there, too. Default: "read-write".
    pub remote_mode: Option<RemoteMode>,
    /// Have long steps done by the server's workers. Default: false.
    pub remote_execute: bool,
    /// Longest time for an answer, in seconds. Default: 10.
    #[schemars(transform = within(limits::REMOTE_TIMEOUT))]
    pub remote_timeout: Option<u64>,
    /// Longest time for a step on a worker, waiting for one included, in seconds. Default: 600.
    #[schemars(transform = within(limits::REMOTE_TIMEOUT))]
    pub remote_execute_timeout: Option<u64>,
    /// What kind of machine a worker has to be, in the server's own words, such as ["OSFamily=linux", "ISA=x86-64"].
    pub remote_platform: Vec<String>,
}
