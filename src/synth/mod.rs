//! Synthesis: walks through the jump map that give every output pixel or mesh vertex an address in the exemplar.
//!
//! ```text
//!   image    flat images, [ZG02]            seam_metric   what a seam shows
//!   mesh     vertices and texels, [ZG03]    usage         how evenly the sample is used
//!   quilt    faces by textons, [MK03]       box_mean      running means
//!   volume   flipbooks
//! ```
//!
//! The corrections ([`image::refine`], [`mesh::refine`], [`volume::refine`]) go beyond the papers: passes, from coarse to fine,
//! in which every neighbour is known. Without them the result is the published method's.
//! Unaware of: how the jump map or the offsets were made, what the outputs are used for, files.

mod box_mean;
mod error;
pub mod image;
pub mod mesh;
pub mod quilt;
pub mod seam_metric;
mod usage;
pub mod volume;

#[cfg(test)]
mod testing;

pub use error::{Error, MAX_PIXELS};
