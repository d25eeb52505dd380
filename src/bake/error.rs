//! What can be wrong with the input of a bake.

use std::fmt;

/// Why a surface cannot be unwrapped or a map cannot be baked.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Error {
    /// Nothing to texture: no triangle has an area.
    NoArea {
        /// Triangles of the surface.
        faces: usize,
    },
    /// A page side outside the allowed range.
    PageSize {
        /// What was asked for.
        size: u32,
    },
    /// A density that is no positive number.
    Density {
        /// What was asked for, in texels per world unit.
        texels_per_unit: f64,
    },
    /// The atlas would be larger than allowed.
    TooLarge {
        /// The side that the charts need at least, in texels.
        side: f64,
    },
    /// The gutter leaves no room on the page.
    Gutter {
        /// What was asked for, in texels.
        gutter_px: u32,
        /// Side of the page in texels.
        size: u32,
    },
    /// The charts do not share one page.
    DoesNotFit {
        /// Number of charts.
        charts: u32,
        /// Side of the page in texels.
        size: u32,
        /// Gutter in texels.
        gutter_px: u32,
    },
    /// The mesh has no such TEXCOORD set.
    NoUvSet {
        /// The set asked for.
        set: usize,
        /// How many sets every primitive has.
        available: usize,
    },
    /// A kept UV lies outside 0..1 or is no number.
    UvOutside {
        /// Triangle of the surface.
        face: usize,
        /// The coordinate found.
        uv: [f32; 2],
    },
    /// Kept UVs lie on top of each other.
    UvOverlap {
        /// Share of the covered texels that belong to more than one triangle.
        share: f64,
    },
    /// More texels to be corrected than fit into memory.
    TooManyNodes {
        /// How many there are.
        found: usize,
    },
    /// Two inputs do not belong together.
    Mismatch {
        /// What was counted.
        what: &'static str,
        /// How many there are.
        found: usize,
        /// How many there should be.
        expected: usize,
    },
    /// The unwrapping library refused.
    Library {
        /// What it said.
        message: String,
    },
    /// The library is not part of this build.
    NotBuilt,
    /// The caller's watch asked to stop.
    Cancelled,
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        use super::unwrap::{MAX_SIDE, MIN_SIDE};
        match self {
            Error::NoArea { faces } => {
                write!(f, "none of the {faces} triangles has an area: there is nothing to unwrap")
            }
            Error::PageSize { size } => write!(f, "atlas size = {size}, expected {MIN_SIDE}..={MAX_SIDE}"),
            Error::Density { texels_per_unit } => {
                write!(f, "texels_per_unit = {texels_per_unit}, expected a positive number")
            }
            Error::TooLarge { side } => {
                write!(
                    f,
                    "the atlas would be {side:.0} texels wide, at most {MAX_SIDE} are allowed: lower texels_per_unit"
                )
            }
            Error::Gutter { gutter_px, size } => {
                write!(f, "gutter = {gutter_px} texels on a page of {size}, expected at most {}", size / 8)
            }
            Error::DoesNotFit { charts, size, gutter_px } => write!(
                f,
                "{charts} charts with a gutter of {gutter_px} texels do not fit a page of {size}: raise the size or lower \
                 the gutter"
            ),
            Error::NoUvSet { set, available: 0 } => {
                write!(
                    f,
                    "the mesh has no TEXCOORD_{set}: not every primitive has texture coordinates; let kiln unwrap it"
                )
            }
            Error::NoUvSet { set, available } => {
                write!(f, "the mesh has no TEXCOORD_{set}: every primitive has the sets 0..{available}")
            }
            Error::UvOutside { face, uv } => write!(
                f,
                "triangle {face} has the texture coordinate ({}, {}), expected 0..=1: coordinates that tile cannot be \
                 baked to; let kiln unwrap the mesh",
                uv[0], uv[1]
            ),
            Error::UvOverlap { share } => write!(
                f,
                "{:.1} % of the used texels belong to more than one triangle (mirrored or stacked UVs), at most {:.0} % \
                 are allowed: let kiln unwrap the mesh",
                share * 100.0,
                super::atlas::MAX_OVERLAP * 100.0
            ),
            Error::TooManyNodes { found } => write!(
                f,
                "the atlas has {found} places to correct, at most {} are; a smaller atlas or a smaller scale has fewer",
                super::MAX_NODES
            ),
            Error::Mismatch { what, found, expected } => write!(f, "{what}: found {found}, expected {expected}"),
            Error::Library { message } => write!(f, "the UV unwrapper refused the mesh: {message}"),
            Error::NotBuilt => write!(
                f,
                "this kiln was built without xatlas: use unwrap = \"uvunwrap\", or build with `--features xatlas` \
                 (needs a C++ compiler and libclang)"
            ),
            Error::Cancelled => write!(f, "unwrapping was cancelled"),
        }
    }
}

impl std::error::Error for Error {}
