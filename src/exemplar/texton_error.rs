//! Why textons cannot be made.

use std::fmt;

use super::Error;

/// Why textons cannot be made. Every value is what was found.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum TextonError {
    /// The side of the window is even or out of range.
    Window {
        /// The side in texels.
        side: u32,
        /// The largest side.
        max: u32,
    },
    /// The window is larger than the exemplar.
    TooSmall {
        /// Size of the exemplar in texels.
        size: (u32, u32),
        /// The side of the window.
        window: u32,
    },
    /// The number of textons is out of range.
    Count {
        /// Textons asked for.
        found: u32,
        /// Most textons.
        max: u32,
    },
    /// There are fewer texels than textons.
    FewTexels {
        /// Texels of the exemplar.
        texels: u64,
        /// Textons asked for.
        count: u32,
    },
    /// The number of orientations is out of range.
    Rotations {
        /// Orientations asked for.
        found: u32,
        /// Most orientations.
        max: u32,
    },
    /// What any analysis asks of the maps.
    Maps(Error),
}

impl std::error::Error for TextonError {}

impl From<Error> for TextonError {
    fn from(e: Error) -> Self {
        TextonError::Maps(e)
    }
}

impl fmt::Display for TextonError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            TextonError::Window { side, max } => {
                write!(f, "window = {side}, expected an odd number of texels in 3..={max}")
            }
            TextonError::TooSmall { size: (w, h), window } => {
                write!(f, "the exemplar is {w}x{h} texels, a texton's window needs at least {window}x{window}")
            }
            TextonError::Count { found, max } => write!(f, "count = {found} textons, expected 1..={max}"),
            TextonError::FewTexels { texels, count } => write!(
                f,
                "count = {count} textons of an exemplar of {texels} texels: expected at most one per texel; \"auto\" takes \
                 the square root"
            ),
            TextonError::Rotations { found, max } => write!(f, "rotations = {found}, expected 1..={max}"),
            TextonError::Maps(e) => e.fmt(f),
        }
    }
}
