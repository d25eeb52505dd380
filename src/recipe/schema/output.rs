//! `[atlas]`, `[uv_sets]` and `[render]`: what is made.

use super::ranges::{each, filled, within};
use crate::recipe::limits;
use crate::recipe::words::{AtlasFilter, Compression, ImageFormat, MapFile, Shading, Unwrap};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

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
