//! Triangle meshes: what they are, how vertices meet, how the synthesis mesh is made.
//!
//! Winding is counter-clockwise seen from outside. An edge vector of (i, j) points from i to j.

pub mod check;
mod excerpt;
pub mod nearest;
mod prepare;
mod sheets;
mod subdivide;
mod surface;
mod topology;
mod trimesh;
mod weld;
#[cfg(test)]
pub(crate) mod zoo;

pub(crate) use excerpt::Excerpt;
pub use prepare::{Error, PrepareParams, prepare};
pub use surface::{Part, Surface, SynthesisMesh};
pub use topology::Topology;
pub use trimesh::TriMesh;
