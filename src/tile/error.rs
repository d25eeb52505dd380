//! Why a tile cannot be made.

use crate::texture::MapKind;
use std::fmt;

/// Why a tile, or one of its keys, cannot be made. Keys are counted from 1, along the material axis.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Error {
    /// There is no key.
    NoKeys,
    /// Too few layers for the keys, or too many.
    Layers {
        /// Layers asked for.
        found: u32,
        /// Fewest: two, and one per key.
        least: u32,
        /// Most.
        most: u32,
    },
    /// A key is of another size than the first.
    Sizes {
        /// The key.
        key: usize,
        /// Its size in texels.
        found: [u32; 2],
        /// The first key's.
        first: [u32; 2],
    },
    /// A key has other maps than the first.
    Maps {
        /// The key.
        key: usize,
        /// Its maps.
        found: Vec<MapKind>,
        /// The first key's.
        first: Vec<MapKind>,
    },
    /// A side is too short, or there are too many texels in all layers.
    Size {
        /// Texels per row, rows, layers.
        found: [u32; 3],
        /// Shortest side.
        least_side: u32,
        /// Most texels in all layers.
        most_texels: u64,
    },
    /// A mask marks everything or nothing, or no features are found where none are given.
    Mask {
        /// The key.
        key: usize,
        /// True if it is on everywhere, false if off.
        on: bool,
        /// Whether it was found in the maps rather than given.
        found: bool,
    },
    /// A value of a map is not a number, or infinite.
    Value {
        /// The key.
        key: usize,
        /// The map.
        map: MapKind,
        /// Column and row.
        texel: [u32; 2],
        /// The value.
        value: f32,
    },
}

impl std::error::Error for Error {}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names = |kinds: &[MapKind]| kinds.iter().map(|k| k.name()).collect::<Vec<_>>().join(", ");
        match self {
            Error::NoKeys => f.write_str("a tile needs a key exemplar, and there is none"),
            Error::Layers { found, least, most } => {
                write!(f, "layers = {found}, expected {least}..={most}: at least two, and one for each key exemplar")
            }
            Error::Sizes { key, found: [w, h], first: [fw, fh] } => {
                write!(f, "key {key} is {w}x{h} texels, and key 1 is {fw}x{fh}: the keys of a tile are of one size")
            }
            Error::Maps { key, found, first } => write!(
                f,
                "key {key} has {}, and key 1 has {}: the keys of a tile have the same maps",
                names(found),
                names(first)
            ),
            Error::Size { found: [w, h, n], least_side, most_texels } => write!(
                f,
                "a tile of {n} layers of {w}x{h} texels, expected sides of at least {least_side} and at most {most_texels} \
                 texels in all layers"
            ),
            Error::Mask { key, on: _, found: true } => write!(
                f,
                "no features are found in key {key}, which looks the same everywhere: paint a feature mask for it"
            ),
            Error::Mask { key, on, found: false } => {
                let on = if *on { "on" } else { "off" };
                write!(
                    f,
                    "the feature mask of key {key} is {on} everywhere: it must be on inside features, off between"
                )
            }
            Error::Value { key, map, texel: [x, y], value } => {
                write!(f, "key {key}: {} is {value} at ({x}, {y}), expected finite values", map.name())
            }
        }
    }
}
