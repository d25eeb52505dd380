//! Flipbooks: images in space and time, by a [`walk`], its correction ([`refine`]) and a [`copy`].
//! Unaware of: how the jump map was made, recipes, files.

pub mod copy;
mod field;
pub mod refine;
pub mod walk;
