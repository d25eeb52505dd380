//! glTF in and out.

mod accessor;
mod atlas;
mod container;
mod document;
mod edit;
mod interpolate;
mod material;
mod meshopt;
mod meshopt_filter;
mod nodes;
mod normals;
mod pieces;
mod primitive;
mod refs;
mod summary;
mod surface;
mod triangles;
mod uri;
mod uvsets;
mod validate;

pub use atlas::{AtlasCorners, write_atlas};
pub use document::Document;
pub(super) use document::{external_files, parts};
pub use material::{AlphaMode, BakedImage, BakedMaps, Use};
pub use summary::Summary;
pub use uvsets::{MaterialSpace, TriangleOrder, UvSetOutput, write_uv_sets};

#[cfg(test)]
mod tests;
