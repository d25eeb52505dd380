//! Fields over the vertices of a mesh: which way is up, how large, and what that makes of each edge.
//!
//! Source: `[ZG03]` sections 3, 4.2.2 and 4.2.4. In: a mesh, its normals, constraints at points of the surface. Out:
//! "up" and scale per vertex ([`orientation()`], [`scale`]), and from these an offset in texels per half-edge
//! ([`edge_offsets`]). Unaware of: what is in the exemplar, files.

use crate::numerics::vec::Vec3;

mod align;
mod constraint;
mod edge_offset;
mod error;
mod orientation;
#[cfg(test)]
mod orientation_tests;
mod prescribe;
mod relax;
mod scalar;
mod singularity;
mod site;
mod tangent;

pub use align::Alignment;
pub use constraint::{OrientationConstraint, SingularityConstraint, SingularityKind};
pub use edge_offset::{edge_offsets, validity_boxes};
pub use error::{Error, Which};
pub use orientation::{orientation, orientation_in_areas};
pub(crate) use relax::cotangent_weights;
pub use scalar::{Elsewhere, ScalarConstraint, components_without, interpolate, scale};
pub use singularity::{Singularity, singular_points, singularities, singularities_again};

/// The orientation and scale of the sample at each vertex (`[ZG03]` section 3).
#[derive(Clone, Debug, PartialEq)]
pub struct Field {
    /// Unit vector in the tangent plane of each vertex: "up" of the sample.
    pub up: Vec<Vec3>,
    /// Texels per world unit at each vertex, positive.
    pub scale: Vec<f32>,
}

/// A finished field and what is worth knowing of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Laid {
    /// Per vertex.
    pub field: Field,
    /// Unit normal of each vertex, which `field.up` is perpendicular to.
    pub normals: Vec<Vec3>,
    /// After which turns the sample looks the same.
    pub symmetry: Symmetry,
    /// The faces around which the orientation turns, and their indices, as [`singularities`] finds them.
    pub turning: Vec<(u32, f64)>,
    /// Where the orientation has no direction.
    pub singularities: Vec<Singularity>,
    /// The mesh's Euler characteristic if all its edges have two faces that agree on the outside: what the indices of the
    /// singularities sum to.
    pub euler: Option<i64>,
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
    /// Any. One direction counts, as for [`Symmetry::One`], but nobody's wishes: the default, evened out over a few rings
    /// without solving anything. `[ZG03]` 3 assigns random directions, but then the offsets of neighbouring edges
    /// disagree and the sample is torn.
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
