//! Shading normals where a scene has none: smooth, but for creases.
//!
//! Source: angle-weighted normals (Thuermer, Wuethrich 1998) over groups of faces that meet at edges flatter than
//! the crease angle, as modelling programs group them.
//! In: a mesh whose vertices may be split. Out: a unit normal per corner.
//! Reads as: corners at equal positions belong to one vertex. Around it faces are joined across shared edges; a group
//! shares one normal, so a fan of thousands costs no more than sorting it.

use crate::mesh::TriMesh;
use crate::numerics::det;
use crate::numerics::vec::{Vec3, vec3};

/// Cosine of 60 degrees: faces whose normals differ by more meet in a crease.
const CREASE_COS: f64 = 0.5;
/// Faces at one edge that each face is compared with; more than two meet only where the surface branches.
const EDGE_LOOKBACK: usize = 8;

/// Unit normals of all corners. A corner of a face without area takes the normal of its vertex, or +z.
pub(super) fn smooth_normals(mesh: &TriMesh) -> Vec<Vec3> {
    let welded = weld(&mesh.positions);
    let corner_vertex = |c: usize| welded[mesh.faces[c / 3][c % 3] as usize];
    let face_normals: Vec<Option<Vec3>> = (0..mesh.faces.len()).map(|f| mesh.area_vector(f).normalized()).collect();
    let mut order: Vec<u32> = (0..3 * mesh.faces.len() as u32).collect();
    order.sort_by_key(|&c| (corner_vertex(c as usize), c));
    let mut out = vec![vec3(0.0, 0.0, 1.0); order.len()];
    for corners in order.chunk_by(|&a, &b| corner_vertex(a as usize) == corner_vertex(b as usize)) {
        let groups = group(corners, &face_normals, corner_vertex);
        let mut sums = vec![Vec3::ZERO; corners.len()];
        let mut total = Vec3::ZERO;
        for (i, &c) in corners.iter().enumerate() {
            let (face, k) = (c as usize / 3, c as usize % 3);
            let Some(n) = face_normals[face] else { continue };
            let p = mesh.corners(face);
            let (a, b) = (p[(k + 1) % 3] - p[k], p[(k + 2) % 3] - p[k]);
            let weighted = n * det::atan2(a.cross(b).length(), a.dot(b));
            sums[groups[i]] += weighted;
            total += weighted;
        }
        for (i, &c) in corners.iter().enumerate() {
            let flat = face_normals[c as usize / 3];
            // Opposite faces may cancel each other.
            let own = flat.and_then(|_| sums[groups[i]].normalized()).or(flat);
            out[c as usize] = own.or(total.normalized()).unwrap_or(vec3(0.0, 0.0, 1.0));
        }
    }
    out
}

/// For each vertex the lowest one at the same position.
fn weld(positions: &[Vec3]) -> Vec<u32> {
    // Adding zero turns -0 into 0.
    let key = |v: u32| [0, 1, 2].map(|i| (positions[v as usize][i] + 0.0).to_bits());
    let mut order: Vec<u32> = (0..positions.len() as u32).collect();
    order.sort_unstable_by_key(|&v| (key(v), v));
    let mut out = vec![0; positions.len()];
    for same in order.chunk_by(|&a, &b| key(a) == key(b)) {
        same.iter().for_each(|&v| out[v as usize] = same[0]);
    }
    out
}

/// For each corner at one vertex the place of the group's first corner.
fn group(corners: &[u32], normals: &[Option<Vec3>], vertex: impl Fn(usize) -> u32) -> Vec<usize> {
    fn root(parent: &mut [usize], mut i: usize) -> usize {
        while parent[i] != i {
            parent[i] = parent[parent[i]];
            i = parent[i];
        }
        i
    }
    let mut spokes: Vec<(u32, usize)> = Vec::with_capacity(2 * corners.len());
    for (i, &c) in corners.iter().enumerate().filter(|(_, c)| normals[**c as usize / 3].is_some()) {
        let (face, k) = (c as usize / 3 * 3, c as usize % 3);
        spokes.extend([(vertex(face + (k + 1) % 3), i), (vertex(face + (k + 2) % 3), i)]);
    }
    spokes.sort_unstable();
    let mut parent: Vec<usize> = (0..corners.len()).collect();
    for edge in spokes.chunk_by(|a, b| a.0 == b.0) {
        for (j, &(_, a)) in edge.iter().enumerate() {
            for &(_, b) in &edge[j.saturating_sub(EDGE_LOOKBACK)..j] {
                let normal = |i: usize| normals[corners[i] as usize / 3];
                if let (Some(x), Some(y)) = (normal(a), normal(b))
                    && x.dot(y) >= CREASE_COS
                {
                    let (ra, rb) = (root(&mut parent, a), root(&mut parent, b));
                    parent[ra.max(rb)] = ra.min(rb);
                }
            }
        }
    }
    (0..corners.len()).map(|i| root(&mut parent, i)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A roof of two rectangles whose slopes differ by `degrees`, its vertices split along the ridge.
    fn roof(degrees: f64) -> TriMesh {
        let (s, c) = det::sin_cos(degrees.to_radians() / 2.0);
        let p = |x: f64, z: f64| vec3(x, z, -x.abs() * s / c);
        let positions = vec![p(-1., 0.), p(0., 0.), p(0., 1.), p(-1., 1.), p(0., 0.), p(1., 0.), p(1., 1.), p(0., 1.)];
        TriMesh { positions, faces: vec![[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]] }
    }

    #[test]
    fn flat_edges_are_smooth_and_steep_ones_are_creases() {
        let up = vec3(0.0, 0.0, 1.0);
        let n = smooth_normals(&roof(40.0));
        assert!((n[1] - n[6]).length() < 1e-12 && n[1].x.abs() < 1e-12, "the ridge points up: {:?}", n[1]);
        assert!(n[0].x < -0.3 && n[7].x > 0.3);
        let mesh = roof(80.0);
        let n = smooth_normals(&mesh);
        for (c, &n) in n.iter().enumerate() {
            let flat = mesh.area_vector(c / 3).normalized().unwrap();
            assert!((n - flat).length() < 1e-12 && n.dot(up) > 0.5);
        }
    }

    #[test]
    fn a_fan_of_many_faces_and_one_without_area() {
        let n = 20_000u32;
        let angle = |i: u32| det::sin_cos(f64::from(i) / f64::from(n) * std::f64::consts::TAU);
        let mut positions = vec![Vec3::ZERO];
        positions.extend((0..n).map(|i| vec3(angle(i).1, angle(i).0, 0.0)));
        let mut faces: Vec<[u32; 3]> = (0..n).map(|i| [0, 1 + i, 1 + (i + 1) % n]).collect();
        faces.push([0, 1, 1]);
        for normal in smooth_normals(&TriMesh { positions, faces }) {
            assert!((normal - vec3(0.0, 0.0, 1.0)).length() < 1e-9);
        }
    }
}
