//! What can be wrong with an exemplar, its analysis parameters or a stored analysis.

use crate::texture::MapKind;
use std::fmt;

/// Why an exemplar cannot be analysed, or a stored jump map not be read.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Error {
    /// The list of neighbourhoods is empty or too long.
    Levels {
        /// Levels asked for.
        found: usize,
        /// Most levels.
        max: usize,
    },
    /// A neighbourhood's side is even or too large.
    Neighbourhood {
        /// The side in texels.
        size: u32,
        /// Largest side.
        max: u32,
    },
    /// Neighbourhoods times channels give too long vectors.
    Dimensions {
        /// Components of a vector.
        found: usize,
        /// Most components.
        max: usize,
    },
    /// A side of the exemplar is shorter than the finest neighbourhood.
    TooSmall {
        /// Size in texels.
        size: (u32, u32),
        /// Shortest side.
        min: u32,
    },
    /// The exemplar has too long sides or too many texels.
    TooLarge {
        /// Size in texels.
        size: (u64, u64),
        /// Longest side.
        max_side: u32,
        /// Most texels.
        max_texels: u64,
    },
    /// A flipbook of too few frames, or with too many texels in all of them.
    Flipbook {
        /// Texels per row, rows, frames.
        size: [u32; 3],
        /// Most texels in all frames.
        max_texels: u64,
    },
    /// Number of jumps k out of range.
    Jumps {
        /// The number.
        found: u32,
        /// Largest number.
        max: u32,
    },
    /// Diversity beta out of range.
    Diversity {
        /// The number.
        found: u32,
        /// Largest number.
        max: u32,
    },
    /// Share of variance out of range.
    Variance(f64),
    /// Leniency alpha out of range.
    Alpha(f64),
    /// Minimum distance of matches out of range.
    MinDistance {
        /// The distance in texels.
        found: f64,
        /// Largest distance for this exemplar.
        max: f64,
    },
    /// A map's importance is negative, not a number or too large.
    Importance {
        /// The map.
        map: MapKind,
        /// Its importance.
        weight: f64,
        /// Largest importance.
        max: f64,
    },
    /// No map of the exemplar has an importance above zero.
    NothingToCompare {
        /// The maps that it has.
        maps: Vec<MapKind>,
    },
    /// A texel holds NaN, an infinity or a monstrous value.
    Value {
        /// The map.
        map: MapKind,
        /// Column.
        x: u32,
        /// Row.
        y: u32,
        /// The value.
        value: f32,
        /// Largest magnitude.
        max: f32,
    },
    /// The analysis would take too much memory.
    Memory {
        /// Bytes needed.
        bytes: u64,
        /// Most bytes.
        max: u64,
    },
    /// A sheet of no samples.
    NoSamples,
    /// A sample has other maps than the first.
    SampleMaps {
        /// Its number, from 1.
        sample: usize,
        /// Its maps.
        found: Vec<MapKind>,
        /// Those of the first.
        expected: Vec<MapKind>,
    },
    /// A mask is not of its sample's size.
    MaskSize {
        /// The sample's number, from 1.
        sample: usize,
        /// Size of the mask in texels.
        found: (u32, u32),
        /// Size of the sample in texels.
        size: (u32, u32),
    },
    /// A mask leaves no texel.
    MaskEmpty {
        /// The sample's number, from 1.
        sample: usize,
    },
    /// What the masks leave is nowhere as wide as a neighbourhood.
    MaskNarrow {
        /// The side of the finest neighbourhood.
        side: u32,
    },
    /// An exemplar that wraps has several samples.
    WrapOfSeveral {
        /// Their number.
        samples: usize,
    },
    /// Stored bytes are not a jump map, or are damaged: what is wrong with them.
    Damaged(&'static str),
}

impl std::error::Error for Error {}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        const GIB: f64 = (1u64 << 30) as f64;
        match self {
            Error::Levels { found, max } => write!(f, "{found} neighbourhoods, expected 1..={max}"),
            Error::Neighbourhood { size, max } => {
                write!(f, "neighbourhood of {size} texels, expected an odd size in 1..={max}")
            }
            Error::Dimensions { found, max } => {
                write!(f, "the neighbourhoods of all maps have {found} values, at most {max} can be compared")
            }
            Error::TooSmall { size: (w, h), min } => {
                write!(f, "the exemplar is {w}x{h} texels, the finest neighbourhood needs at least {min}x{min}")
            }
            Error::TooLarge { size: (w, h), max_side, max_texels } => write!(
                f,
                "the exemplar is {w}x{h} texels, at most {max_side} per side and {max_texels} in all can be analysed"
            ),
            Error::Flipbook { size: [w, h, frames], max_texels } => write!(
                f,
                "the flipbook has {frames} frames of {w}x{h} texels; it needs 2 frames at least, and at most {max_texels} \
                 texels in all of them can be analysed"
            ),
            Error::Jumps { found, max } => write!(f, "jumps = {found}, expected 1..={max}"),
            Error::Diversity { found, max } => write!(f, "diversity = {found}, expected 1..={max}"),
            Error::Variance(v) => write!(f, "variance = {v}, expected above 0 and at most 1"),
            Error::Alpha(v) => write!(f, "alpha = {v}, expected a finite number above 1"),
            Error::MinDistance { found, max } => {
                write!(f, "min_distance = {found} texels, expected 1..={max} for this exemplar")
            }
            Error::Importance { map, weight, max } => {
                write!(f, "importance of {} = {weight}, expected 0..={max}", map.name())
            }
            Error::NothingToCompare { maps } => {
                write!(f, "no map has an importance above 0; the exemplar has {}", names(maps))
            }
            Error::Value { map, x, y, value, max } => write!(
                f,
                "texel ({x}, {y}) of {} holds {value}, expected a number between -{max} and {max}",
                map.name()
            ),
            Error::Memory { bytes, max } => write!(
                f,
                "the analysis would take {:.1} GiB, at most {} are allowed; lower variance, jumps or diversity, or use a \
                 smaller exemplar",
                *bytes as f64 / GIB,
                *max as f64 / GIB
            ),
            Error::NoSamples => write!(f, "no sample to analyse"),
            Error::SampleMaps { sample, found, expected } => write!(
                f,
                "sample {sample} has the maps {}, but sample 1 has {}: all samples need the same maps",
                names(found),
                names(expected)
            ),
            Error::MaskSize { sample, found: (mw, mh), size: (w, h) } => {
                write!(f, "the mask of sample {sample} is {mw}x{mh} texels, the sample is {w}x{h}")
            }
            Error::MaskEmpty { sample } => write!(f, "the mask of sample {sample} excludes every texel"),
            Error::MaskNarrow { side } => {
                write!(f, "the masks leave no neighbourhood of {side}x{side} texels whole")
            }
            Error::WrapOfSeveral { samples } => write!(f, "an exemplar that wraps is one sample, found {samples}"),
            Error::Damaged(what) => write!(f, "not a whole jump map: {what}"),
        }
    }
}

fn names(maps: &[MapKind]) -> String {
    maps.iter().map(|m| m.name()).collect::<Vec<_>>().join(", ")
}
