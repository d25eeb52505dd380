//! Fields over the vertices of a mesh: which way is up, how large, and what that makes of each edge.
//!
//! Source: `[ZG03]` sections 3, 4.2.2 and 4.2.4. In: a mesh, its normals, constraints at points of the surface. Out:
//! "up" and scale per vertex ([`orientation()`], [`scale`]), and from these an offset in texels per half-edge
//! ([`edge_offsets`]). Unaware of: what is in the exemplar, files.

use crate::numerics::vec::Vec3;

mod edge_offset;
mod error;
mod orientation;
mod relax;
mod scalar;
mod singularity;
mod site;
mod tangent;

pub use edge_offset::{edge_offsets, validity_boxes};
pub use error::{Error, Which};
pub use orientation::{OrientationConstraint, SingularityConstraint, SingularityKind, orientation};
pub use scalar::{ScalarConstraint, interpolate, scale};
pub use singularity::singularities;

/// The orientation and scale of the sample at each vertex (`[ZG03]` section 3).
#[derive(Clone, Debug, PartialEq)]
pub struct Field {
    /// Unit vector in the tangent plane of each vertex: "up" of the sample.
    pub up: Vec<Vec3>,
    /// Texels per world unit at each vertex, positive.
    pub scale: Vec<f32>,
}

/// After which turns the sample looks the same.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Symmetry {
    /// A full turn only.
    One,
    /// Half a turn: up and down are the same.
    Two,
    /// A quarter turn.
    Four,
    /// Any. Treated as [`Symmetry::One`]: `[ZG03]` 3 assigns random directions, but then the offsets of neighbouring
    /// edges disagree and the sample is torn; a smooth field costs little and tears nothing.
    Isotropic,
}

impl Symmetry {
    /// Number of directions that are equivalent.
    pub fn directions(self) -> u32 {
        match self {
            Symmetry::One | Symmetry::Isotropic => 1,
            Symmetry::Two => 2,
            Symmetry::Four => 4,
        }
    }
}
