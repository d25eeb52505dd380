//! What is asked of an orientation field at points of the surface: anchors and singularities.
//!
//! Source: `[ZG03]` section 3. Unaware of: how fields are solved.

use super::{Error, Which, site};
use crate::mesh::TriMesh;
use crate::numerics::vec::Vec3;

/// `up` must leave the normal by at least this (sine of the angle).
const LEAST_TANGENT: f64 = 1e-3;

/// An anchor: "up" of the sample at a point of the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OrientationConstraint {
    /// Acts at the point of the surface nearest to this.
    pub at: Vec3,
    /// Up there, of any length; its tangential part counts.
    pub up: Vec3,
    /// Acts only within this geodesic distance (along edges), in world units; `None`: on the whole component.
    pub radius: Option<f64>,
}

/// What the field does around a singular point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SingularityKind {
    /// Up points away from it.
    Source,
    /// Up points towards it.
    Sink,
    /// Up runs around it, counter-clockwise seen from outside.
    Vortex,
    /// Up turns so many times around it, counter-clockwise: a multiple of one over the symmetry's directions, not 0, at
    /// most 8 either way. Which way it points is left open.
    Index(f64),
}

impl SingularityKind {
    /// Turns of up around it.
    pub fn index(self) -> f64 {
        match self {
            SingularityKind::Index(index) => index,
            _ => 1.0,
        }
    }
}

/// A singular point of the field. With a direction (all but [`SingularityKind::Index`]) it holds a small disc around a
/// vertex (at least its 1-ring), not the vertex itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SingularityConstraint {
    /// Sits at the point of the surface nearest to this.
    pub at: Vec3,
    /// What the field does around it.
    pub kind: SingularityKind,
    /// Acts only within this geodesic distance (along edges), in world units; `None`: on the whole component.
    pub radius: Option<f64>,
}

/// Sites of the singularities, then of the anchors.
pub(super) fn sites(
    mesh: &TriMesh,
    anchors: &[OrientationConstraint],
    singularities: &[SingularityConstraint],
) -> Result<Vec<site::Site>, Error> {
    let rings =
        singularities.iter().enumerate().map(|(index, s)| (Which { list: "singularity", index }, s.at, s.radius));
    let points = anchors.iter().enumerate().map(|(index, a)| (Which { list: "orientation", index }, a.at, a.radius));
    let wanted: Vec<_> = rings.chain(points).collect();
    if wanted.is_empty() {
        return Ok(vec![]);
    }
    site::sites(mesh, &wanted)
}

/// The unit tangential part of an anchor's vector.
pub(super) fn tangential(which: Which, up: Vec3, normal: Vec3) -> Result<Vec3, Error> {
    if !up.is_finite() {
        return Err(Error::NotFinite(which));
    }
    let largest = up.x.abs().max(up.y.abs()).max(up.z.abs());
    let unit = (up / largest).normalized().ok_or(Error::UpIsZero(which))?;
    let part = unit.reject(normal);
    if part.length() < LEAST_TANGENT {
        return Err(Error::UpIsNormal { which, up, normal });
    }
    part.normalized().ok_or(Error::UpIsNormal { which, up, normal })
}
