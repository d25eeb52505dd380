//! Material space: a tile that is periodic in (s, t) and changes smoothly from one material to another along m.
//!
//! Source: [MST09] section 1. In: the maps of key exemplars and their feature masks. Out: a [`Tile`].
//! Unaware of: meshes, files, recipes.

mod mask;
mod stack;

pub use mask::Mask;
pub use stack::Tile;
