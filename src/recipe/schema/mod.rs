//! The recipe as written: serde types of every table and key, from which the JSON Schema is derived.
//!
//! Source: the recipe format, version 1. The doc comments are the descriptions that editors show, so they speak to
//! the recipe's author. Keys without a default are marked `required`; serde still takes them as absent, because
//! [`super::shape`] has reported them by then and the remaining faults should be found too.
//! Unaware of: which combinations make sense, which features exist yet: see [`super::validate`].

mod exemplar;
mod field;
mod output;
mod project;
mod ranges;

pub use exemplar::{Analysis, Count, Exemplar, Importance, Sample};
pub use field::{Field, Isotropic, MaterialPoint, Orientation, ScalePoint, Singularity, Symmetry};
pub use output::{Atlas, Camera, FormatPerMap, Formats, Render, UvSets};
pub use project::{Cache, Project};

use super::limits;
use super::words::{Blend, CanvasDebug, CanvasOrder, Compression, MapFile, WalkOrder};
use ranges::{each, filled, within};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

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

/// The word "auto".
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[schemars(inline)]
pub enum Auto {
    /// Chosen by kiln.
    #[serde(rename = "auto")]
    Auto,
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
