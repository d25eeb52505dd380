//! `[field]`: which way the sample lies on the surface, and how large.

use super::ranges::{each, within};
use crate::recipe::limits;
use crate::recipe::words::{AlignTo, SingularityKind};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

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
