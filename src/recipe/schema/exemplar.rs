//! `[exemplar]` and `[analysis]`: the sample and how it is looked at.

use super::Auto;
use super::ranges::{each, each_odd, filled, odd, within};
use crate::recipe::limits;
use crate::recipe::words::{Method, NormalY, TextonFeatures, TileShape};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

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
