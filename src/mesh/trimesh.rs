//! An indexed triangle mesh in world units.

use crate::numerics::vec::{Vec3, vec3};

/// Positions and triangles. Every index is below the number of positions (whoever builds a mesh sees to it).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TriMesh {
    /// Vertex positions in world units, all finite.
    pub positions: Vec<Vec3>,
    /// Three vertex indices per triangle, counter-clockwise from outside.
    pub faces: Vec<[u32; 3]>,
}

impl TriMesh {
    /// The three corner positions of a face.
    pub fn corners(&self, face: usize) -> [Vec3; 3] {
        self.faces[face].map(|v| self.positions[v as usize])
    }

    /// Twice the area times the unit normal; zero for a face without area.
    pub fn area_vector(&self, face: usize) -> Vec3 {
        let [a, b, c] = self.corners(face);
        (b - a).cross(c - a)
    }

    /// Area of a face.
    pub fn area(&self, face: usize) -> f64 {
        self.area_vector(face).length() * 0.5
    }

    /// Smallest and largest corner of the bounding box of all positions; zeros for a mesh without vertices.
    pub fn bounds(&self) -> (Vec3, Vec3) {
        let Some(&first) = self.positions.first() else { return (Vec3::ZERO, Vec3::ZERO) };
        self.positions.iter().fold((first, first), |(lo, hi), p| {
            (vec3(lo.x.min(p.x), lo.y.min(p.y), lo.z.min(p.z)), vec3(hi.x.max(p.x), hi.y.max(p.y), hi.z.max(p.z)))
        })
    }

    /// Unit vertex normals: face normals weighted by the angle at the vertex, summed in face order. A vertex without a
    /// face of positive area gets +z.
    pub fn vertex_normals(&self) -> Vec<Vec3> {
        let mut sums = vec![Vec3::ZERO; self.positions.len()];
        for (f, face) in self.faces.iter().enumerate() {
            let Some(n) = self.area_vector(f).normalized() else { continue };
            let p = self.corners(f);
            for i in 0..3 {
                let (a, b) = (p[(i + 1) % 3] - p[i], p[(i + 2) % 3] - p[i]);
                let angle = crate::numerics::det::atan2(a.cross(b).length(), a.dot(b));
                sums[face[i] as usize] += n * angle;
            }
        }
        sums.into_iter().map(|s| s.normalized().unwrap_or(vec3(0.0, 0.0, 1.0))).collect()
    }
}
