//! Synthesis: walks through the jump map that give every output pixel or mesh vertex an address in the exemplar.
//!
//! Flat images (\[ZG02\] section 3): an [`image_order`], the [`image_walk`], then [`image_copy`]. Meshes (\[ZG03\] section
//! 4): [`sites`] where triangles are small, a [`vertex_order`] or a [`rendering_sequence`], the [`vertex_walk`], then [`corner`] (or [`layers`]) turns addresses of
//! vertices into coordinates of corners.
//! [`image_refine`] and [`vertex_refine`] go beyond the papers: passes, from coarse to fine, in which every neighbour is
//! known. Without them the result is the published method's. [`texel_refine`] does the same for the texels of an atlas.
//! Meshes by textons (\[MK03\] 3.2 and 3.3): faces are laid flat ([`quilt_frame`]), placed ([`quilt`], by [`texton_string`])
//! and blended over their edges ([`quilt_blend`]).
//! Flipbooks: the same in space and time, [`volume_walk`], [`volume_refine`], [`volume_copy`].
//! Unaware of: how the jump map or the offsets were made, what the outputs are used for, files.

mod board;
mod box_mean;
pub mod corner;
mod error;
pub mod guide;
pub mod guide_light;
mod hierarchy;
mod hole_shifts;
pub mod image_canvas;
pub mod image_copy;
pub mod image_order;
pub mod image_refine;
pub mod image_walk;
mod image_window;
pub mod layers;
pub mod lod;
pub mod mixture;
pub mod quilt;
pub mod quilt_blend;
mod quilt_cut;
pub mod quilt_frame;
mod quilt_patch;
mod quilt_seam;
pub mod rendering_sequence;
mod room;
pub mod seam_metric;
pub mod sites;
pub mod source_map;
pub mod source_strips;
mod surface_cells;
mod surface_window;
pub mod texel_refine;
pub mod texton_string;
mod usage;
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
