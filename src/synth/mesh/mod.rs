//! Meshes (\[ZG03\] section 4): [`sites`] where triangles are small, an [`order`] or a [`rendering_sequence`], the [`walk`], the
//! correction ([`refine`]); then [`corner`] (or [`layers`]) turns addresses of vertices into coordinates of corners, and [`lod`]
//! carries them to simpler meshes. [`texel_refine`] corrects the texels of an atlas.
//! Unaware of: how the jump map or the offsets were made, recipes, files.

mod cells;
pub mod corner;
pub(super) mod hierarchy;
pub mod layers;
pub mod lod;
pub mod order;
pub mod refine;
pub mod rendering_sequence;
pub(super) mod room;
pub mod sites;
pub mod texel_refine;
pub mod walk;
mod window;
