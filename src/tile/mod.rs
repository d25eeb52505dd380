//! Material space: a tile that is periodic in (s, t) and changes smoothly from one material to another along m.
//!
//! Source: \[MST09\] section 1. In: the maps of key exemplars and their feature masks. Out: a [`Tile`].
//! Unaware of: meshes, files, recipes.

mod constrained;
mod distance;
mod error;
mod features;
mod layers;
mod make;
#[cfg(test)]
mod make_tests;
mod mask;
mod morph;
#[cfg(test)]
mod morph_tests;
mod planes;
mod pyramid;
mod seamless;
mod stack;

pub use error::Error;
pub use features::find_features;
pub use make::{KeyReport, KeyTile, LayerReport, TileParams, TileReport, make};
pub use mask::Mask;
pub use seamless::{Seamless, seamless};
pub use stack::Tile;
