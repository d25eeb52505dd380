//! Tangent planes: a basis at each vertex, and how a tangent vector is carried to the next.
//!
//! A tangent vector is a complex number in its vertex's basis. It is carried along an edge by the smallest rotation
//! that turns one normal into the other: parallel transport on the surface that the normals describe. Unlike transport
//! by the angles of the 1-ring (Knöppel et al. 2013) that needs no manifold.

use crate::mesh::{Topology, TriMesh};
use crate::numerics::csr::{Complex, complex};
use crate::numerics::par;
use crate::numerics::vec::Vec3;

/// An orthonormal basis of a tangent plane, counter-clockwise seen from outside.
#[derive(Clone, Copy, Debug)]
pub(super) struct Frame {
    x: Vec3,
    y: Vec3,
}

impl Frame {
    pub fn new(normal: Vec3) -> Self {
        let x = normal.any_perpendicular();
        Frame { x, y: normal.cross(x) }
    }

    /// The tangential part of a vector.
    pub fn complex(&self, v: Vec3) -> Complex {
        complex(v.dot(self.x), v.dot(self.y))
    }

    pub fn vector(&self, z: Complex) -> Vec3 {
        self.x * z.re + self.y * z.im
    }
}

pub(super) fn frames(normals: &[Vec3]) -> Vec<Frame> {
    par::map(normals.len(), |v| Frame::new(normals[v]))
}

/// What turns a tangent vector at a vertex into one at its neighbour, per half-edge: a number of absolute value 1, and
/// exactly the conjugate for the opposite half-edge.
pub(super) fn transports(mesh: &TriMesh, topo: &Topology, normals: &[Vec3], frames: &[Frame]) -> Vec<Complex> {
    let along = |a: usize, b: usize| {
        let edge = mesh.positions[b] - mesh.positions[a];
        let image = turn(frames[a].x, normals[a], normals[b], edge);
        frames[b].complex(image).unit().unwrap_or(Complex::ONE)
    };
    let of = |v: usize| {
        let row = topo.neighbours(v as u32).iter().map(move |&n| n as usize);
        row.map(move |n| if v < n { along(v, n) } else { along(n, v).conj() })
    };
    let rows = par::map_chunks(topo.vertex_count(), 1024, |r| r.flat_map(of).collect::<Vec<_>>());
    rows.into_iter().flatten().collect()
}

/// `v`, perpendicular to `from`, turned by the smallest rotation that takes `from` to `to` (unit vectors). Opposite
/// normals are folded about the axis across the edge, as if it ran around a rim.
fn turn(v: Vec3, from: Vec3, to: Vec3, edge: Vec3) -> Vec3 {
    let c = 1.0 + from.dot(to);
    if c > 1e-9 {
        return v - (from + to) * (to.dot(v) / c);
    }
    let axis = from.cross(edge).normalized().unwrap_or(from.any_perpendicular());
    axis * (2.0 * axis.dot(v)) - v
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::zoo;
    use crate::numerics::vec::vec3;

    #[test]
    fn carrying_keeps_lengths_and_comes_back() {
        for (name, m) in zoo::all() {
            let (topo, normals) = (Topology::new(&m), m.vertex_normals());
            let r = transports(&m, &topo, &normals, &frames(&normals));
            assert_eq!(r.len(), topo.half_edge_count());
            for v in 0..topo.vertex_count() as u32 {
                for h in topo.half_edges(v) {
                    let back = topo.find(topo.target(h), v).unwrap();
                    assert!((r[h].norm2() - 1.0).abs() < 1e-14, "{name}");
                    assert_eq!(r[h], r[back].conj(), "{name}");
                }
            }
        }
    }

    #[test]
    fn a_vector_along_a_fold_stays_and_one_across_turns_with_it() {
        let (x, y, z) = (vec3(1., 0., 0.), vec3(0., 1., 0.), vec3(0., 0., 1.));
        assert_eq!(turn(y, z, x, x), y);
        assert_eq!(turn(x, z, x, x), -z);
        assert_eq!(turn(x, z, -z, x), -x, "around the rim of a disc");
        assert_eq!(turn(y, z, -z, x), y);
    }
}
