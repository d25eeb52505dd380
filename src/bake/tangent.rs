//! Tangents of the atlas as every engine computes them: MikkTSpace.
//!
//! In: world positions, corner normals, atlas UVs. Out: per corner the unit tangent in the world and the sign of the
//! bitangent, `B = w * cross(N, T)`. MikkTSpace wants v up, as glTF's specification says: v is flipped here.

use super::atlas::Atlas;
use crate::mesh::Surface;
use crate::numerics::det;
use bevy_mikktspace::{Geometry, Ops, TangentSpace, generate_tangents};

/// Arithmetic with the same bits everywhere: the crate's own uses the platform's `acos`.
struct FixedOps;

impl Ops for FixedOps {
    fn sqrt(x: f32) -> f32 {
        x.sqrt()
    }

    fn acos(x: f32) -> f32 {
        det::acos(f64::from(x)) as f32
    }
}

struct Input<'a> {
    surface: &'a Surface,
    atlas: &'a Atlas,
    tangents: Vec<[f32; 4]>,
}

impl Geometry<FixedOps> for Input<'_> {
    fn num_faces(&self) -> usize {
        self.surface.mesh.faces.len()
    }

    fn num_vertices_of_face(&self, _: usize) -> usize {
        3
    }

    fn position(&self, face: usize, vert: usize) -> [f32; 3] {
        self.surface.mesh.positions[self.surface.mesh.faces[face][vert] as usize].to_f32()
    }

    fn normal(&self, face: usize, vert: usize) -> [f32; 3] {
        self.surface.corner_normals[3 * face + vert].to_f32()
    }

    fn tex_coord(&self, face: usize, vert: usize) -> [f32; 2] {
        let uv = self.atlas.corner_uv[3 * face + vert];
        [uv.u, 1.0 - uv.v]
    }

    fn set_tangent(&mut self, found: Option<TangentSpace>, face: usize, vert: usize) {
        if let Some(t) = found.map(|t| t.tangent_encoded()).filter(|t| t.iter().all(|x| x.is_finite())) {
            self.tangents[3 * face + vert] = t;
        }
    }
}

/// MikkTSpace tangents in the world, one per corner of the surface: a unit vector and the bitangent's sign (1 or -1).
/// Corners of triangles without area in space or on the page take their neighbours' or any perpendicular to the normal.
pub fn tangents(surface: &Surface, atlas: &Atlas) -> Vec<[f32; 4]> {
    let any = |n: &crate::numerics::vec::Vec3| {
        let [x, y, z] = n.any_perpendicular().to_f32();
        [x, y, z, 1.0]
    };
    let tangents = surface.corner_normals.iter().map(any).collect();
    let mut input = Input { surface, atlas, tangents };
    match generate_tangents(&mut input) {
        Ok(()) => input.tangents,
        // The error type has no values.
        Err(_) => input.tangents,
    }
}
