//! Why a field cannot be made.

use std::fmt;

use crate::numerics::vec::Vec3;

/// A constraint by its list and its place in it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Which {
    /// "orientation", "singularity", "scale" ...
    pub list: &'static str,
    /// Place in the list, from 0.
    pub index: usize,
}

impl fmt::Display for Which {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} constraint {}", self.list, self.index)
    }
}

/// Why a field cannot be made.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Error {
    /// There is no surface to put a constraint on.
    NoFaces,
    /// A number of a constraint is NaN or infinite.
    NotFinite(Which),
    /// The point of a constraint is nowhere near the surface.
    TooFar {
        /// The constraint.
        which: Which,
        /// Distance to the nearest point of the surface.
        distance: f64,
        /// The largest allowed: the diagonal of the mesh's bounding box.
        limit: f64,
    },
    /// `up` is the zero vector.
    UpIsZero(Which),
    /// `up` points straight out of (or into) the surface.
    UpIsNormal {
        /// The constraint.
        which: Which,
        /// Its vector.
        up: Vec3,
        /// The normal of the surface there.
        normal: Vec3,
    },
    /// The radius is not positive.
    Radius {
        /// The constraint.
        which: Which,
        /// Its radius.
        radius: f64,
    },
    /// A scale factor is outside its range.
    Factor {
        /// The constraint.
        which: Which,
        /// Its factor.
        factor: f64,
    },
    /// The mean scale is not a positive number that single precision holds.
    Scale(f64),
    /// A singularity of given index.
    IndexNotYet {
        /// The constraint.
        which: Which,
        /// Its index.
        index: f64,
    },
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let v = |v: &Vec3| format!("[{}, {}, {}]", v.x, v.y, v.z);
        match self {
            Error::NoFaces => write!(f, "the mesh has no triangles to constrain"),
            Error::NotFinite(w) => write!(f, "{w} has a number that is NaN or infinite"),
            Error::TooFar { which, distance, limit } => write!(
                f,
                "{which} is {distance} units from the surface; at most {limit} (the mesh's diagonal) is taken as meant"
            ),
            Error::UpIsZero(w) => write!(f, "{w}: up is the zero vector; it must have a direction"),
            Error::UpIsNormal { which, up, normal } => write!(
                f,
                "{which}: up = {} points straight out of the surface, whose normal there is {}; it must lie along it",
                v(up),
                v(normal)
            ),
            Error::Radius { which, radius } => write!(f, "{which}: the radius is {radius}; it must be positive"),
            Error::Factor { which, factor } => {
                write!(f, "{which}: the factor is {factor}; it must be in 0.001..=1000")
            }
            Error::Scale(s) => write!(f, "the scale is {s} texels per unit; it must be in 1e-30..=1e30"),
            Error::IndexNotYet { which, index } => write!(
                f,
                "{which}: index = {index} is not supported yet; use kind = \"source\", \"sink\" or \"vortex\""
            ),
        }
    }
}

impl std::error::Error for Error {}
