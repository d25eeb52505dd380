//! The part of a scene that is to be textured, in world units: what `io` reads and everything else works on.

use std::ops::Range;

use super::TriMesh;
use crate::numerics::vec::Vec3;
use crate::texture::Uv;

/// One primitive of the input document within a [`Surface`].
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    /// Index of the mesh in the document.
    pub mesh: u32,
    /// Index of the primitive in that mesh.
    pub primitive: u32,
    /// Its vertices in [`Surface::mesh`], in the order of the document.
    pub vertices: Range<u32>,
    /// Its faces in [`Surface::mesh`], in the order of the document.
    pub faces: Range<u32>,
    /// Object to world, the upper 3x4 of the matrix by rows. A mesh shown by several nodes is baked as the first shows
    /// it; a skinned one as it is stored.
    pub to_world: [[f64; 4]; 3],
}

/// All primitives to be textured, concatenated, with the triangles of the document in order.
///
/// Vertices are as stored (not welded). Where a node mirrors, the corners here are swapped (0, 2, 1) so that winding is
/// counter-clockwise from outside in the world.
#[derive(Clone, Debug, PartialEq)]
pub struct Surface {
    /// Positions in world units and triangles.
    pub mesh: TriMesh,
    /// Unit shading normal in world space at each corner (3 per face): the document's, or smooth up to creases.
    pub corner_normals: Vec<Vec3>,
    /// True if the document had normals for every part.
    pub has_normals: bool,
    /// The document's TEXCOORD sets at each corner, for those sets that every part has.
    pub corner_uvs: Vec<Vec<Uv>>,
    /// The primitives.
    pub parts: Vec<Part>,
}

/// The mesh that texture is synthesised on: welded, without faces of no area, large triangles subdivided.
#[derive(Clone, Debug, PartialEq)]
pub struct SynthesisMesh {
    /// The welded, subdivided mesh in world units.
    pub mesh: TriMesh,
    /// For each of its faces the face of the [`Surface`] that it lies in.
    pub parent: Vec<u32>,
    /// Barycentric coordinates of each face's three corners in the parent.
    pub parent_bary: Vec<[[f32; 3]; 3]>,
}
