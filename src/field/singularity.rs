//! Where a field has no direction: faces around which it turns.
//!
//! Source: the index of a cross field on a triangle, as in Ray et al. 2008 (N-Symmetry Direction Field Design). Going
//! around a face counter-clockwise the field turns against parallel transport by the edges' differences, each less than
//! half a period; transport itself turns by the area that the normals enclose on the sphere, known up to whole turns.
//! Of these the one nearest to the face's share of the angle defects of its vertices is taken, so that over a closed
//! surface the areas sum to 2 pi times the Euler characteristic (Gauss, Bonnet) even where a coarse mesh folds; the
//! differences cancel, and the indices sum to the characteristic too (Poincaré, Hopf).

use std::f64::consts::TAU;

use super::Symmetry;
use super::tangent::{frames, transports};
use crate::mesh::{Excerpt, Topology, TriMesh};
use crate::numerics::csr::Complex;
use crate::numerics::vec::Vec3;
use crate::numerics::{det, par};

/// The singular faces of a field and their indices, by face: 1 for a source, sink or vortex, multiples of 1/2 and 1/4
/// for symmetry two and four, negative for saddles.
pub fn singularities(
    mesh: &TriMesh,
    topo: &Topology,
    normals: &[Vec3],
    up: &[Vec3],
    symmetry: Symmetry,
) -> Vec<(u32, f64)> {
    let n = symmetry.directions();
    let frames = frames(normals);
    let carry = transports(mesh, topo, normals, &frames);
    let z: Vec<Complex> = up.iter().zip(&frames).map(|(u, f)| f.complex(*u).power(n)).collect();
    // How far the field at j is turned from that at i carried to j; antisymmetric to the bit.
    let turn = |i: u32, j: u32| {
        let forward = |a: u32, b: u32| {
            let Some(h) = topo.find(a, b) else { return 0.0 };
            let d = (carry[h].power(n) * z[a as usize]).conj() * z[b as usize];
            det::atan2(d.im, d.re)
        };
        if i < j { forward(i, j) } else { -forward(j, i) }
    };
    let areas = turning_areas(mesh, topo, normals);
    let indices = par::map(mesh.faces.len(), |f| {
        let [a, b, c] = mesh.faces[f];
        let turns = (turn(a, b) + turn(b, c) + turn(c, a) + f64::from(n) * areas[f]) / TAU;
        turns.round() / f64::from(n)
    });
    (0..).zip(indices).filter(|&(_, index)| index != 0.0).collect()
}

/// What [`singularities`] finds where the field differs at the vertices `changed` (ascending) only, from what it found
/// `before`: looks at their faces alone.
pub fn singularities_again(
    (mesh, topo, normals): (&TriMesh, &Topology, &[Vec3]),
    up: &[Vec3],
    symmetry: Symmetry,
    changed: &[u32],
    before: &[(u32, f64)],
) -> Vec<(u32, f64)> {
    let differs = |f: u32| mesh.faces[f as usize].iter().any(|v| changed.binary_search(v).is_ok());
    // With all faces at the corners of those that differ: these have the angles around them.
    let corners = Excerpt::new(mesh, topo, changed).vertices;
    let piece = Excerpt::new(mesh, topo, &corners);
    let again = singularities(&piece.mesh, &piece.topo, &piece.of(normals), &piece.of(up), symmetry);
    let again = again.into_iter().map(|(f, index)| (piece.faces[f as usize], index)).filter(|&(f, _)| differs(f));
    let mut found: Vec<_> = before.iter().copied().filter(|&(f, _)| !differs(f)).chain(again).collect();
    found.sort_unstable_by_key(|&(f, _)| f);
    found
}

/// By how much transport around each face turns a vector: the area that its normals enclose on the sphere, of the values
/// a whole turn apart the one nearest to its share of the angle defects. Over a closed component they sum to 2 pi times
/// the Euler characteristic.
pub(super) fn turning_areas(mesh: &TriMesh, topo: &Topology, normals: &[Vec3]) -> Vec<f64> {
    let curvature = face_curvatures(mesh, topo);
    par::map(mesh.faces.len(), |f| {
        let area = solid_angle(mesh.faces[f].map(|v| normals[v as usize]));
        area - ((area - curvature[f]) / TAU).round() * TAU
    })
}

/// A singular point of a field: singular faces that touch, as one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Singularity {
    /// Mean of the faces' centres.
    pub at: Vec3,
    /// Sum of the faces' indices.
    pub index: f64,
    /// The first of the faces.
    pub face: u32,
}

/// The singular faces that [`singularities`] found as points: faces that share a vertex count as one point, and as none
/// if their indices cancel. By first face.
pub fn singular_points(mesh: &TriMesh, found: &[(u32, f64)]) -> Vec<Singularity> {
    let mut corners: Vec<(u32, usize)> =
        found.iter().enumerate().flat_map(|(i, f)| mesh.faces[f.0 as usize].map(|v| (v, i))).collect();
    corners.sort_unstable();
    let mut group: Vec<usize> = (0..found.len()).collect();
    let first = |group: &[usize], mut i: usize| {
        while group[i] != i {
            i = group[i];
        }
        i
    };
    for pair in corners.windows(2).filter(|w| w[0].0 == w[1].0) {
        let (a, b) = (first(&group, pair[0].1), first(&group, pair[1].1));
        group[a.max(b)] = a.min(b);
    }
    let mut points = vec![];
    for i in (0..found.len()).filter(|&i| group[i] == i) {
        let members: Vec<_> = (i..found.len()).filter(|&j| first(&group, j) == i).map(|j| found[j]).collect();
        let index: f64 = members.iter().map(|m| m.1).sum();
        let corners = members.iter().flat_map(|m| mesh.corners(m.0 as usize));
        let at = corners.fold(Vec3::ZERO, |s, p| s + p) / (3 * members.len()) as f64;
        if index != 0.0 {
            points.push(Singularity { at, index, face: found[i].0 });
        }
    }
    points
}

/// Each face's share of its vertices' angle defects, by its share of their angles. Vertices whose faces do not close up
/// have none.
fn face_curvatures(mesh: &TriMesh, topo: &Topology) -> Vec<f64> {
    let angles: Vec<[f64; 3]> = par::map(mesh.faces.len(), |f| {
        let p = mesh.corners(f);
        std::array::from_fn(|k| {
            let (a, b) = (p[(k + 1) % 3] - p[k], p[(k + 2) % 3] - p[k]);
            det::atan2(a.cross(b).length(), a.dot(b))
        })
    });
    let mut sum = vec![0.0; topo.vertex_count()];
    for (face, angles) in mesh.faces.iter().zip(&angles) {
        face.iter().zip(angles).for_each(|(&v, a)| sum[v as usize] += a);
    }
    let per_angle = |v: u32| {
        let closed = topo.faces(v).len() == topo.neighbours(v).len() && sum[v as usize] > 0.0;
        if closed { TAU / sum[v as usize] - 1.0 } else { 0.0 }
    };
    let of = |f: usize| mesh.faces[f].iter().zip(angles[f]).map(|(&v, a)| a * per_angle(v)).sum();
    par::map(mesh.faces.len(), of)
}

/// Signed area of the spherical triangle of three unit vectors (Van Oosterom, Strackee 1983).
fn solid_angle([a, b, c]: [Vec3; 3]) -> f64 {
    2.0 * det::atan2(a.dot(b.cross(c)), 1.0 + a.dot(b) + b.dot(c) + c.dot(a))
}

#[cfg(test)]
mod tests {
    use super::super::{OrientationConstraint, orientation};
    use super::*;
    use crate::mesh::check::census;
    use crate::mesh::{PrepareParams, prepare, zoo};
    use crate::numerics::vec::vec3;

    #[test]
    fn indices_of_closed_meshes_sum_to_the_euler_characteristic() {
        let mut meshes: Vec<(&str, TriMesh)> = vec![
            ("icosphere", zoo::icosphere(3)),
            ("torus", zoo::torus(30, 16)),
            ("tetrahedron", zoo::tetrahedron()),
            ("cube", zoo::cube()),
            ("two components", zoo::two_components()),
        ];
        meshes.extend(["spot", "cheburashka", "bob"].iter().filter_map(|n| Some((*n, zoo::obj(&format!("{n}.obj"))?))));
        for (name, m) in meshes {
            let topo = Topology::new(&m);
            let (normals, euler) = (m.vertex_normals(), census(&m, &topo).euler);
            let tilted = OrientationConstraint { at: m.positions[0], up: vec3(0.2, 0.9, -0.3), radius: None };
            for symmetry in [Symmetry::One, Symmetry::Two, Symmetry::Four] {
                for anchors in [vec![], vec![tilted]] {
                    let up = orientation(&m, &topo, &normals, &anchors, &[], &[], symmetry).unwrap();
                    let found = singularities(&m, &topo, &normals, &up, symmetry);
                    let sum: f64 = found.iter().map(|s| s.1).sum();
                    println!("{name} {symmetry:?}: {} singular faces", found.len());
                    assert_eq!(sum, euler as f64, "{name} {symmetry:?} {found:?}");
                }
            }
        }
    }

    #[test]
    fn a_cube_with_quarter_turns_has_its_eight_corners() {
        let prepared = prepare(&zoo::surface(zoo::cube()), &PrepareParams::new(160.0, [64, 64]));
        let m = prepared.unwrap().mesh;
        let (topo, normals) = (Topology::new(&m), m.vertex_normals());
        let up = orientation(&m, &topo, &normals, &[], &[], &[], Symmetry::Four).unwrap();
        let found = singularities(&m, &topo, &normals, &up, Symmetry::Four);
        assert_eq!(found.len(), 8, "{found:?}");
        assert!(found.iter().all(|s| s.1 == 0.25));
    }

    #[test]
    fn looking_again_around_what_changed_finds_all() {
        for (name, m) in zoo::all() {
            let (topo, normals) = (Topology::new(&m), m.vertex_normals());
            let ground = (&m, &topo, &normals[..]);
            for symmetry in [Symmetry::One, Symmetry::Four] {
                let mut up = orientation(&m, &topo, &normals, &[], &[], &[], symmetry).unwrap();
                let before = singularities(&m, &topo, &normals, &up, symmetry);
                // Turned by angles that have nothing to do with each other.
                let changed: Vec<u32> = (0..up.len() as u32).filter(|v| v % 7 < 2).collect();
                for &v in &changed {
                    let (u, n) = (up[v as usize], normals[v as usize]);
                    let (s, c) = det::sin_cos(f64::from(v) * 2.5);
                    up[v as usize] = u * c + n.cross(u) * s;
                }
                let again = singularities_again(ground, &up, symmetry, &changed, &before);
                assert_eq!(again, singularities(&m, &topo, &normals, &up, symmetry), "{name} {symmetry:?}");
                assert!(name != "icosphere" || again != before, "{symmetry:?}");
            }
        }
    }

    #[test]
    fn an_eighth_of_the_sphere() {
        let octant = [vec3(1., 0., 0.), vec3(0., 1., 0.), vec3(0., 0., 1.)];
        assert!((solid_angle(octant) - std::f64::consts::FRAC_PI_2).abs() < 1e-15);
    }
}
