//! Alignment: drawing the field to lines of the surface, so that it runs along or across them.
//!
//! Source: Knöppel et al. 2013, section 5 (alignment to principal curvature by a linear term); the curvature tensor is
//! that of Cohen-Steiner and Morvan 2003: each edge bends the surface across itself by its dihedral angle times its
//! length. A line says a cross of four directions (along, across), a fourth power; of these each vertex takes the one
//! nearest to the field without alignment. Unaware of: constraints.

use super::relax::Guide;
use super::tangent::Frame;
use crate::mesh::{Topology, TriMesh};
use crate::numerics::csr::Complex;
use crate::numerics::{det, par};

/// Lines that a field can be aligned to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Alignment {
    /// Edges at which the surface folds by more than 40 degrees.
    Creases,
    /// Edges with a face on one side only.
    Boundary,
    /// The directions in which the surface bends most and least.
    Curvature,
}

/// Edges that fold by more than this are creases.
const CREASE_DEG: f64 = 40.0;
/// Strength against smoothness: lines rule to this part of the alignment length beside them.
const STRENGTH: f64 = 10.0;

/// What lines say at a vertex: a cross as the fourth power of its directions, its absolute value a weight.
///
/// `lengths` is the length per vertex over which alignment competes with smoothness.
pub(super) fn crosses(
    mesh: &TriMesh,
    topo: &Topology,
    frames: &[Frame],
    to: &[Alignment],
    lengths: &[f64],
) -> Vec<Complex> {
    let has = |a| to.contains(&a);
    let least = det::cos(CREASE_DEG.to_radians());
    let of = |v: usize| {
        let (mut lines, mut bends) = (Complex::ZERO, Complex::ZERO);
        let faces = topo.faces(v as u32);
        for &n in topo.neighbours(v as u32) {
            let edge = mesh.positions[n as usize] - mesh.positions[v];
            let Some(along) = frames[v].complex(edge).unit() else { continue };
            let half = edge.length() * 0.5;
            let mut sides = faces.iter().filter(|&&f| mesh.faces[f as usize].contains(&n));
            let (Some(&first), second) = (sides.next(), sides.next()) else { continue };
            let Some(&second) = second else {
                if has(Alignment::Boundary) {
                    lines += along.power(4) * half;
                }
                continue;
            };
            let [a, b] = [first, second].map(|f| mesh.area_vector(f as usize).normalized());
            let (Some(a), Some(b)) = (a, b) else { continue };
            let (c, s) = (a.dot(b), a.cross(b).dot(edge));
            if has(Alignment::Creases) && c < least {
                lines += along.power(4) * half;
            }
            if has(Alignment::Curvature) {
                // Only the sign relative to the other edges matters: which of the two faces is on the left.
                let [p, q, r] = mesh.faces[first as usize];
                let forward = [(p, q), (q, r), (r, p)].contains(&(v as u32, n));
                let fold = det::atan2(a.cross(b).length(), c) * if (s > 0.0) == forward { 1.0 } else { -1.0 };
                bends += along.power(2) * (fold * half);
            }
        }
        let area: f64 = faces.iter().map(|&f| mesh.area(f as usize) / 3.0).sum();
        let length = lengths[v].max(f64::MIN_POSITIVE);
        // Difference of the principal curvatures over the alignment length; from one on it counts in full.
        let bent = if area > 0.0 { bends.norm2().sqrt() / area * length } else { 0.0 };
        let bends = bends.unit().map_or(Complex::ZERO, |b| b.power(2) * (area / length * bent.min(1.0)));
        (lines + bends) * (STRENGTH / length)
    };
    par::map(topo.vertex_count(), of)
}

/// The guide that draws a vertex to the direction of a cross nearest to `now`, the n-th power of its direction.
pub(super) fn towards(cross: Complex, n: u32, now: Complex) -> Guide {
    let (Some(direction), Some(now)) = (cross.unit(), now.unit()) else { return Guide::default() };
    let weight = cross.norm2().sqrt();
    let (s, c) = det::sin_cos(det::atan2(direction.im, direction.re) / 4.0);
    let mut arm = Complex { re: c, im: s };
    let mut best = arm.power(n);
    for _ in 1..4 {
        arm = Complex { re: -arm.im, im: arm.re };
        let power = arm.power(n);
        let nearness = |z: Complex| z.re * now.re + z.im * now.im;
        if nearness(power) > nearness(best) {
            best = power;
        }
    }
    Guide { weight, pull: best * weight }
}

#[cfg(test)]
mod tests {
    use super::super::{Symmetry, orientation};
    use super::*;
    use crate::mesh::zoo;
    use crate::numerics::vec::{Vec3, vec3};

    /// Turned about the z axis by an angle that is no symmetry of anything here.
    fn turned(p: Vec3) -> Vec3 {
        let (s, c) = det::sin_cos(0.5);
        vec3(p.x * c - p.y * s, p.x * s + p.y * c, p.z)
    }

    fn aligned(m: &TriMesh, to: &[Alignment], symmetry: Symmetry) -> Vec<Vec3> {
        orientation(m, &Topology::new(m), &m.vertex_normals(), &[], &[], to, symmetry).unwrap()
    }

    /// Share of the vectors within 6 degrees of one of the axes, or of their opposites.
    fn along(up: &[Vec3], axes: &[Vec3]) -> f64 {
        let near = |u: &&Vec3| axes.iter().any(|a| u.dot(*a).abs() > 0.9945);
        up.iter().filter(near).count() as f64 / up.len() as f64
    }

    #[test]
    fn a_turned_square_follows_its_boundary() {
        let mut m = zoo::plane(20, 20);
        m.positions.iter_mut().for_each(|p| *p = turned(*p));
        let axes = [turned(vec3(1., 0., 0.)), turned(vec3(0., 1., 0.))];
        for symmetry in [Symmetry::One, Symmetry::Two, Symmetry::Four] {
            assert!(along(&aligned(&m, &[], symmetry), &axes) < 0.1, "the world's up");
            let up = aligned(&m, &[Alignment::Boundary], symmetry);
            let border: Vec<Vec3> = (1..20).map(|i| up[i]).collect();
            assert!(along(&border, &axes) == 1.0, "{symmetry:?}");
            assert_eq!(aligned(&m, &[Alignment::Creases], symmetry), aligned(&m, &[], symmetry), "no creases");
        }
    }

    #[test]
    fn a_turned_roof_follows_its_ridge() {
        let mut m = zoo::plane(20, 20);
        let fold = |p: Vec3| vec3(p.x, p.y, -(p.x - 10.0).abs());
        m.positions.iter_mut().for_each(|p| *p = turned(fold(*p)));
        let up = aligned(&m, &[Alignment::Creases], Symmetry::One);
        let ridge: Vec<Vec3> = (3..18).map(|y| up[y * 21 + 10]).collect();
        let axes = [turned(vec3(0., 1., 0.)), turned(vec3(1., 0., 0.))];
        assert_eq!(along(&ridge, &axes), 1.0, "{ridge:?}");
    }

    #[test]
    fn a_turned_arch_follows_its_curvature() {
        let mut m = zoo::plane(24, 24);
        let bend = |p: Vec3| {
            let (s, c) = det::sin_cos((p.x - 12.0) / 10.0);
            vec3(10.0 * s, p.y, 10.0 * c)
        };
        m.positions.iter_mut().for_each(|p| *p = turned(bend(*p)));
        let up = aligned(&m, &[Alignment::Curvature], Symmetry::Four);
        let axis = turned(vec3(0., 1., 0.));
        let normals = m.vertex_normals();
        let good = |(u, n): (&Vec3, &Vec3)| u.dot(axis).abs() > 0.99 || u.dot(axis.cross(*n)).abs() > 0.99;
        let share = up.iter().zip(&normals).filter(|p| good(*p)).count() as f64 / up.len() as f64;
        assert!(share > 0.9, "{share}");
    }
}
