//! Why a surface cannot be parametrised.

use std::fmt;

/// Why a surface cannot be parametrised.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Error {
    /// Two things that belong together have different lengths.
    Mismatch {
        /// What was counted.
        what: &'static str,
        /// How many there are.
        found: usize,
        /// How many there should be.
        expected: usize,
    },
    /// A side of the tile is 0.
    Tile([u32; 2]),
    /// A tile that is not square cannot be turned by a quarter.
    NotSquare([u32; 2]),
    /// The scale at a vertex is not a positive number.
    Scale {
        /// The vertex.
        vertex: usize,
        /// Its scale.
        scale: f32,
    },
    /// A vertex's direction is not a unit vector.
    Direction {
        /// The vertex.
        vertex: usize,
    },
    /// A material is not a number in 0..=1.
    Material {
        /// Place in the list of constraints.
        index: usize,
        /// What it is.
        value: f64,
    },
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Error::Mismatch { what, found, expected } => write!(f, "there are {found} {what}, expected {expected}"),
            Error::Tile([w, h]) => write!(f, "the tile is {w} x {h} texels; it needs at least one"),
            Error::NotSquare([w, h]) => write!(
                f,
                "the tile is {w} x {h} texels and cannot be turned by a quarter as symmetry = 4 wants; take a square one, \
                 or symmetry 1 or 2"
            ),
            Error::Scale { vertex, scale } => {
                write!(f, "the scale at vertex {vertex} is {scale} texels per unit; it must be a positive number")
            }
            Error::Direction { vertex } => write!(f, "the field at vertex {vertex} has no direction"),
            Error::Material { index, value } => {
                write!(f, "material constraint {index}: the value is {value}; it must be in 0..=1")
            }
        }
    }
}

impl std::error::Error for Error {}
