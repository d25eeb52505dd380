//! Synthesis: walks through the jump map that give every output pixel or mesh vertex an address in the exemplar.
//!
//! Flat images (\[ZG02\] section 3): an [`image_order`], the [`image_walk`], then [`image_copy`]. Meshes (\[ZG03\] section
//! 4): [`sites`] where triangles are small, a [`vertex_order`] or a [`rendering_sequence`], the [`vertex_walk`], then [`corner`] (or [`layers`]) turns addresses of
//! vertices into coordinates of corners.
//! [`image_refine`] and [`vertex_refine`] go beyond the papers: passes, from coarse to fine, in which every neighbour is
//! known. Without them the result is the published method's.
//! Flipbooks: the same in space and time, [`volume_walk`], [`volume_refine`], [`volume_copy`].
//! Unaware of: how the jump map or the offsets were made, what the outputs are used for, files.

mod board;
pub mod corner;
mod error;
pub mod guide;
mod hierarchy;
pub mod image_canvas;
pub mod image_copy;
pub mod image_order;
pub mod image_refine;
pub mod image_walk;
mod image_window;
pub mod layers;
pub mod lod;
pub mod rendering_sequence;
mod room;
mod seam;
pub mod seam_metric;
pub mod sites;
pub mod source_map;
pub mod source_strips;
pub mod vertex_order;
pub mod vertex_refine;
pub mod vertex_walk;
pub mod volume_copy;
mod volume_field;
pub mod volume_refine;
pub mod volume_walk;

#[cfg(test)]
mod testing;

pub use error::{Error, MAX_PIXELS};
