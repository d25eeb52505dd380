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
    /// The index of a singularity is none that the field can have.
    Index {
        /// The constraint.
        which: Which,
        /// Its index.
        index: f64,
        /// Directions that are equivalent: indices are multiples of its inverse.
        directions: u32,
    },
    /// The indices on a closed surface do not sum to its Euler characteristic.
    Indices {
        /// The first singularity on it.
        which: Which,
        /// Number of singularities on it.
        count: usize,
        /// Sum of their indices.
        sum: f64,
        /// The Euler characteristic.
        euler: i64,
    },
    /// Two constraints want different things at one vertex.
    Contradiction {
        /// The earlier.
        first: Which,
        /// The later.
        second: Which,
        /// The vertex that both act at.
        at: Vec3,
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
            Error::Index { which, index, directions } => write!(
                f,
                "{which}: the index is {index}; it must be a multiple of 1/{directions} other than 0 and at most 8, since \
                 the field has {directions} equivalent direction(s)"
            ),
            Error::Indices { which, count, sum, euler } => {
                let others = if *count > 1 { format!(" and {} more on it", count - 1) } else { String::new() };
                let missing = *euler as f64 - sum;
                write!(
                    f,
                    "the indices of the singularities on a closed surface must sum to its Euler characteristic, here \
                     {euler}; those of {which}{others} sum to {sum}: add singularities of index {missing} in all, or give \
                     a `radius` to those that are to act only nearby"
                )
            }
            Error::Contradiction { first, second, at } => write!(
                f,
                "{first} and {second} contradict each other: both act at the vertex {}, and want different things there; \
                 move one of them or leave it out",
                v(at)
            ),
        }
    }
}

impl std::error::Error for Error {}
