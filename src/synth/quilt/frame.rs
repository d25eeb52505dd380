//! The texture space of each face: which way the sample lies on it, and what lies across its edges.
//!
//! Source: \[MK03\] 3.2.1: the similarity between a face and the exemplar has the rotation of the vector field, averaged
//! over the face's vertices, and a scale. Read as: up vectors are averaged as they stand in space and laid into the face's
//! plane; the scale is the mean of the vertices'. Where several directions are equivalent (symmetry) those of a face are
//! turned to its first vertex', and a face is turned to the neighbour from which it is reached. A face also knows where it
//! lies on the grid of texels that begins at the origin of space: whoever places it there resamples nothing where a wall
//! lies along the axes.
//! Unaware of: what is in the exemplar.

use std::collections::VecDeque;

use crate::field::{Field, Symmetry};
use crate::mesh::TriMesh;
use crate::numerics::vec::{Vec2, Vec3, vec2};

/// No face is on the other side of an edge.
pub const BORDER: u32 = u32::MAX;

/// The faces of a mesh laid flat, each in its own texture space: texels, x right, y down.
#[derive(Clone, Debug, PartialEq)]
pub struct Facets {
    /// Offsets of a face's corners from its first one: similar to the face.
    pub local: Vec<[Vec2; 3]>,
    /// The edge (three times the face and the number of the corner it starts at) on the other side of a face's edge from
    /// corner k to the next, or [`BORDER`]. Edges of more than two faces, or of two that disagree in winding, are borders.
    pub across: Vec<[u32; 3]>,
    /// Where each face's first corner lies between the texels of a grid through the origin of space: 0..1 of a texel.
    pub phase: Vec<Vec2>,
}

impl Facets {
    /// Lays the faces of a mesh flat by a field over its vertices.
    pub fn new(mesh: &TriMesh, field: &Field, symmetry: Symmetry) -> Self {
        let across = adjacency(mesh);
        let normal = |f: usize| mesh.area_vector(f).normalized().unwrap_or(Vec3 { x: 0.0, y: 0.0, z: 1.0 });
        let mut up: Vec<Vec3> = (0..mesh.faces.len()).map(|f| face_up(mesh, field, symmetry, f, normal(f))).collect();
        if symmetry.directions() > 1 {
            agree(mesh, &across, symmetry, &normal, &mut up);
        }
        let flat = |f: usize, e: Vec3| {
            let scale = mesh.faces[f].iter().map(|v| f64::from(field.scale[*v as usize])).sum::<f64>() / 3.0;
            vec2(e.dot(up[f].cross(normal(f))) * scale, -(e.dot(up[f]) * scale))
        };
        let local = |f: usize| {
            let [a, b, c] = mesh.corners(f);
            [Vec2::ZERO, flat(f, b - a), flat(f, c - a)]
        };
        let phase = |f: usize| {
            let at = flat(f, mesh.corners(f)[0]);
            vec2(at.x - at.x.floor(), at.y - at.y.floor())
        };
        let faces = || 0..mesh.faces.len();
        Facets { local: faces().map(local).collect(), phase: faces().map(phase).collect(), across }
    }

    /// Number of faces.
    pub fn len(&self) -> usize {
        self.local.len()
    }

    /// True if there is no face.
    pub fn is_empty(&self) -> bool {
        self.local.is_empty()
    }

    /// The face and the number of its edge on the other side of an edge.
    pub fn opposite(&self, face: usize, edge: usize) -> Option<(usize, usize)> {
        let e = self.across[face][edge];
        (e != BORDER).then_some((e as usize / 3, e as usize % 3))
    }

    /// The ends of an edge, in the face's texture space.
    pub fn edge(&self, face: usize, edge: usize) -> [Vec2; 2] {
        [self.local[face][edge], self.local[face][(edge + 1) % 3]]
    }

    /// The middle of an edge, in the face's texture space.
    pub fn middle(&self, face: usize, edge: usize) -> Vec2 {
        let [a, b] = self.edge(face, edge);
        (a + b) * 0.5
    }

    /// The centre of a face, in its texture space.
    pub fn centre(&self, face: usize) -> Vec2 {
        (self.local[face][1] + self.local[face][2]) * (1.0 / 3.0)
    }

    /// How the texture space across an edge is turned against this face's, in radians from x towards y: the edge's
    /// direction there minus here.
    pub fn turn(&self, face: usize, edge: usize) -> f64 {
        let Some((g, j)) = self.opposite(face, edge) else { return 0.0 };
        let ([a, b], [d, c]) = (self.edge(face, edge), self.edge(g, j));
        let (here, there) = (b - a, c - d);
        // Edges run against each other.
        let there = -there;
        crate::numerics::det::atan2(here.cross(there), here.dot(there))
    }
}

/// Up in the plane of a face.
fn face_up(mesh: &TriMesh, field: &Field, symmetry: Symmetry, f: usize, n: Vec3) -> Vec3 {
    let ups = mesh.faces[f].map(|v| field.up[v as usize].reject(n));
    let sum = ups[1..].iter().fold(ups[0], |s, u| s + nearest(*u, ups[0], n, symmetry));
    let flat = |v: Vec3| v.reject(n).normalized().filter(|_| v.length() > 1e-3);
    flat(sum).or_else(|| flat(ups[0])).unwrap_or_else(|| n.any_perpendicular())
}

/// The direction among those equivalent to `up` that is nearest to `to`, all in the plane of normal `n`.
fn nearest(up: Vec3, to: Vec3, n: Vec3, symmetry: Symmetry) -> Vec3 {
    let (mut best, mut next) = (up, up);
    for _ in 1..symmetry.directions() {
        next = if symmetry.directions() == 2 { -next } else { n.cross(next) };
        if next.dot(to) > best.dot(to) {
            best = next;
        }
    }
    best
}

/// Turns each face's up to its neighbour's, breadth first from the lowest face of each component.
fn agree(mesh: &TriMesh, across: &[[u32; 3]], symmetry: Symmetry, normal: &impl Fn(usize) -> Vec3, up: &mut [Vec3]) {
    let mut done = vec![false; up.len()];
    let mut queue = VecDeque::new();
    for first in 0..up.len() {
        if !done[first] {
            done[first] = true;
            queue.push_back(first);
        }
        while let Some(f) = queue.pop_front() {
            for (k, &e) in across[f].iter().enumerate().filter(|(_, e)| **e != BORDER) {
                let g = e as usize / 3;
                if std::mem::replace(&mut done[g], true) {
                    continue;
                }
                let p = mesh.corners(f);
                let along = (p[(k + 1) % 3] - p[k]).normalized().unwrap_or(up[f]);
                // Unfolded along the edge.
                let unfolded = along * up[f].dot(along) + normal(g).cross(along) * up[f].dot(normal(f).cross(along));
                up[g] = nearest(up[g], unfolded, normal(g), symmetry);
                queue.push_back(g);
            }
        }
    }
}

fn adjacency(mesh: &TriMesh) -> Vec<[u32; 3]> {
    let mut edges: Vec<(u32, u32, u32)> = Vec::with_capacity(3 * mesh.faces.len());
    for (f, face) in mesh.faces.iter().enumerate() {
        for k in 0..3 {
            let (a, b) = (face[k], face[(k + 1) % 3]);
            edges.push((a.min(b), a.max(b), 3 * f as u32 + k as u32));
        }
    }
    edges.sort_unstable();
    let mut across = vec![[BORDER; 3]; mesh.faces.len()];
    for same in edges.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
        if let [(.., e), (.., o)] = *same {
            let start = |e: u32| mesh.faces[e as usize / 3][e as usize % 3];
            if start(e) != start(o) && e / 3 != o / 3 {
                across[e as usize / 3][e as usize % 3] = o;
                across[o as usize / 3][o as usize % 3] = e;
            }
        }
    }
    across
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Topology, zoo};
    use crate::numerics::vec::vec3;

    fn field(m: &TriMesh, symmetry: Symmetry) -> Field {
        let (topo, normals) = (Topology::new(m), m.vertex_normals());
        let up = crate::field::orientation(m, &topo, &normals, &[], &[], &[], symmetry).unwrap();
        Field { scale: vec![8.0; up.len()], up }
    }

    #[test]
    fn every_laid_out_face_is_similar_to_its_face() {
        for (name, m) in zoo::all() {
            for symmetry in [Symmetry::One, Symmetry::Two, Symmetry::Four] {
                let facets = Facets::new(&m, &field(&m, symmetry), symmetry);
                for f in (0..m.faces.len()).filter(|f| m.area(*f) > 1e-9) {
                    let (p, q) = (m.corners(f), facets.local[f]);
                    for k in 0..3 {
                        let (real, flat) = ((p[(k + 1) % 3] - p[k]).length(), (q[(k + 1) % 3] - q[k]).length());
                        assert!((flat - 8.0 * real).abs() < 1e-9 * (1.0 + flat), "{name} {f}: {flat} {real}");
                    }
                    let turning = (q[1] - q[0]).cross(q[2] - q[0]);
                    assert!(turning < 0.0, "{name}: counter-clockwise where y points down");
                }
                for f in 0..facets.len() {
                    for k in 0..3 {
                        if let Some((g, j)) = facets.opposite(f, k) {
                            assert_eq!(facets.opposite(g, j), Some((f, k)), "{name}");
                            // Half a turn is half a turn back.
                            let sum = facets.turn(f, k) + facets.turn(g, j);
                            assert!(sum.abs() < 1e-9 || (sum.abs() - std::f64::consts::TAU).abs() < 1e-9, "{name}");
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn equivalent_directions_agree_over_a_plane() {
        let m = zoo::plane(4, 3);
        let up: Vec<Vec3> = (0..m.positions.len())
            .map(|v| [vec3(0., 1., 0.), vec3(1., 0., 0.), vec3(0., -1., 0.), vec3(-1., 0., 0.)][v * 7 % 4])
            .collect();
        let facets = Facets::new(&m, &Field { scale: vec![1.0; up.len()], up }, Symmetry::Four);
        let turned = (0..facets.len()).flat_map(|f| (0..3).map(move |k| (f, k))).map(|(f, k)| facets.turn(f, k).abs());
        assert!(turned.fold(0.0, f64::max) < 1e-9);
    }
}
