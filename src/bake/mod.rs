//! From corner coordinates to finished maps: unwrap, rasterise, shade, close the seams, dilate.
//!
//! ```text
//! Surface --unwrap--> Atlas --tangents--> MikkTSpace basis
//!                       |
//! SynthesisMesh --------+--> Coverage (which face lies under each texel, where the gutter's texels look)
//!                                |
//!                                |--> TexelGraph .. corrected elsewhere .. TexelSources
//! UvSets, exemplar map ----------+--> bake_map: shade, stitch the seams, dilate --> Texture
//! ```
//!
//! Source: \[MK03\] section 3.3.1 (an atlas rendered from corner coordinates). Works on any
//! [`UvSets`](crate::uvset::UvSets); never asks which method made them.
//!
//! Values that live on both sides of a UV seam are compared in a space where they are comparable: colours as they will be
//! stored (sRGB), normals by how far they lean, turned from the one side's basis into the other's.
//!
//! Unaware of: files, recipes, image formats.

mod atlas;
mod border;
mod coverage;
mod dilate;
mod error;
mod gutter;
mod lie;
mod map;
mod mip;
mod orm;
mod seam;
mod shade;
mod stitch;
mod tangent;
mod texel_graph;
mod texel_sources;
mod unwrap;
#[cfg(feature = "xatlas")]
mod xatlas;

#[cfg(test)]
pub(crate) mod testing;
#[cfg(test)]
mod tests;

pub use atlas::{Atlas, NO_CHART};
pub use coverage::Coverage;
pub use error::Error;
pub use map::{Inputs, bake_map, bake_tile};
pub use mip::{mip_chain, next_mip};
pub use orm::pack_orm;
pub use seam::{SeamError, seam_error};
pub use shade::{FaceSets, Filter, Pyramid, Sampled};
pub use tangent::tangents;
pub use texel_graph::TexelGraph;
pub use texel_sources::{MAX_NODES, TexelSources};
pub use unwrap::{Extent, Library, UnwrapParams, default_gutter_px, unwrap, unwrap_watched};
