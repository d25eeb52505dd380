//! The wanted changes with less curl: what does not close up around triangles is what lines must end for.
//!
//! Source: Ray et al. 2006 (Periodic Global Parameterization), section 4: the field's norm is changed so that its curl is
//! as small as can be; here the changes along edges themselves. In: the wanted change along each edge. Out: changes near
//! them that wind less around triangles.
//! With x the changes along edges and D x what is left over around faces, minimises over e
//! `sum |D (x + e)|^2 / (A / L^2) + sum w |e|^2` with A the area of a face in tiles and w the cotangent weights: curl is
//! evened out over L periods, and opposite curls within that distance cancel instead of ending a line here and beginning
//! it anew there.
//! Unaware of: angles.

use super::guide::{Guide, Wanted};
use crate::numerics::cg::{self, Stop};
use crate::numerics::csr::{Complex, Csr, complex};
use crate::numerics::par;
use crate::numerics::vec::{Vec2, vec2};

/// L. More of it ends fewer lines and stretches more of the surface: of armadillo at 20 periods to the diagonal, 0 leaves
/// 11.8 % of triangles with three look-ups and winds around 130, 0.35: 10.5 % and 90, 0.7: 11.1 % and 66.
const REACH: f64 = 0.35;
/// Edges opposite to right angles weigh nothing, and would take all there is.
const LEAST_WEIGHT: f64 = 0.1;
const STOP: Stop = Stop { tolerance: 1e-3, iterations: 200 };

/// i to a power: a turn by quarters.
pub(super) fn quarter_turns(quarters: u8) -> Complex {
    match quarters % 4 {
        0 => Complex::ONE,
        1 => complex(0.0, 1.0),
        2 => -Complex::ONE,
        _ => complex(0.0, -1.0),
    }
}

/// An edge of a face: its half-edge from the lower end, and by what the change along it counts around the face, in the
/// frame of the face's first corner.
type Side = (usize, Complex);

/// Sides of each face; `None` where the field itself turns, or an edge is missing.
fn sides(wanted: &Wanted<'_>, guide: &Guide, face: usize) -> Option<[Side; 3]> {
    let [a, b, c] = wanted.mesh.faces[face];
    let topo = wanted.topo;
    let (ab, bc, ac) = (topo.find(a, b)?, topo.find(b, c)?, topo.find(a, c)?);
    if !(guide.quarters[ab] + guide.quarters[bc] + 4 - guide.quarters[ac]).is_multiple_of(4) {
        return None;
    }
    let side = |u: u32, v: u32, h: usize, sign: Complex| {
        // From the upper end it is the opposite, as that end sees it.
        if u < v { Some((h, sign)) } else { Some((topo.find(v, u)?, -(sign * quarter_turns(guide.quarters[h])))) }
    };
    let onwards = quarter_turns(guide.quarters[ab]);
    Some([side(a, b, ab, Complex::ONE)?, side(b, c, bc, onwards)?, side(a, c, ac, -Complex::ONE)?])
}

/// Changes the steps of edges that have an open end, per vertex; the others stay.
pub(super) fn lessen(wanted: &Wanted<'_>, guide: &mut Guide, open: &dyn Fn(u32) -> bool) {
    let (mesh, topo) = (wanted.mesh, wanted.topo);
    let faces = par::map(mesh.faces.len(), |f| sides(wanted, guide, f));
    // The faces at each edge, by its half-edge from the lower end, and its factor; none if it may not change.
    let mut at: Vec<Vec<(u32, Complex)>> = vec![vec![]; topo.half_edge_count()];
    for (f, sides) in faces.iter().enumerate() {
        for &(h, factor) in sides.iter().flatten() {
            at[h].push((f as u32, factor));
        }
    }
    let edges = || (0..topo.vertex_count() as u32).flat_map(|v| topo.half_edges(v).map(move |h| (v, h)));
    edges().filter(|&(v, h)| !open(v) && !open(topo.target(h))).for_each(|(_, h)| at[h].clear());
    let give = |h: usize| 1.0 / guide.weights[h].max(LEAST_WEIGHT);
    let number = |step: Vec2| complex(step.x, step.y);

    let [w, h] = wanted.tile.map(f64::from);
    let hold = par::map(mesh.faces.len(), |f| {
        let size: f64 = mesh.faces[f].iter().map(|&v| 1.0 / f64::from(wanted.field.scale[v as usize])).sum();
        let tiles = mesh.area(f) * (3.0 / size) * (3.0 / size) / (w * h);
        (tiles / (REACH * REACH)).max(f64::MIN_POSITIVE)
    });
    let curl: Vec<Complex> = par::map(faces.len(), |f| {
        let around = |sum: Complex, &(h, factor): &Side| sum + factor * number(guide.steps[h]);
        faces[f].iter().flatten().fold(Complex::ZERO, around)
    });
    let mut diagonal = vec![0.0; faces.len()];
    let matrix = Csr::from_rows(faces.len(), faces.len(), |f, entries| {
        entries.push((f as u32, complex(hold[f], 0.0)));
        for &(h, factor) in faces[f].iter().flatten() {
            for &(g, other) in &at[h] {
                let value = factor * other.conj() * give(h);
                match entries.iter_mut().find(|e| e.0 == g) {
                    Some(entry) => entry.1 += value,
                    None => entries.push((g, value)),
                }
            }
        }
        diagonal[f] = entries[0].1.re;
    });
    let mut pressure = vec![Complex::ZERO; faces.len()];
    let precondition = |r: &[Complex], z: &mut [Complex]| {
        z.iter_mut().zip(r).zip(&diagonal).for_each(|((z, r), d)| *z = *r * (1.0 / d));
    };
    cg::solve(&matrix, &curl, &mut pressure, precondition, STOP);

    for (v, h) in edges().filter(|&(_, h)| !at[h].is_empty()) {
        let push = at[h].iter().fold(Complex::ZERO, |sum, (f, factor)| sum + factor.conj() * pressure[*f as usize]);
        let change = push * -give(h);
        guide.steps[h] += vec2(change.re, change.im);
        if let Some(back) = topo.find(topo.target(h), v) {
            guide.steps[back] = guide.seen(back, -guide.steps[h]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::guide::from_turned;
    use super::super::tests::Laid;
    use super::*;
    use crate::field::{OrientationConstraint, Symmetry};
    use crate::mesh::zoo;
    use crate::numerics::vec::vec3;

    fn wanted(l: &Laid) -> Wanted<'_> {
        let Laid { mesh, topo, normals, field, symmetry } = l;
        Wanted { mesh, topo, normals, field, symmetry: *symmetry, tile: [64, 64] }
    }

    /// Sum of what is left over around faces.
    fn curl(w: &Wanted<'_>, guide: &Guide) -> f64 {
        let around = |f: usize| {
            let number = |h: usize| complex(guide.steps[h].x, guide.steps[h].y);
            let sum = |s: [Side; 3]| s.iter().fold(Complex::ZERO, |sum, (h, k)| sum + *k * number(*h));
            sides(w, guide, f).map_or(0.0, |s| sum(s).norm2().sqrt())
        };
        (0..w.mesh.faces.len()).map(around).sum()
    }

    #[test]
    fn there_is_less_of_it_whatever_the_frames() {
        // An odd direction: no two of its quarter turns are equally near to a neighbour's.
        let (at, up) = (vec3(0.2, 0.3, 0.9), vec3(0.7, 0.1, -0.4));
        let anchor = OrientationConstraint { at, up, radius: None };
        let mut l = Laid::new(zoo::icosphere(4), &[anchor], Symmetry::Four, 30.0);
        let all = |_| true;
        let closed = |l: &Laid| {
            let (w, mut guide) = (wanted(l), wanted(l).guide());
            let before = curl(&w, &guide);
            lessen(&w, &mut guide, &all);
            (guide.clone(), [before, curl(&w, &guide)])
        };
        let (plain, [before, after]) = closed(&l);
        assert!(after < 0.8 * before && after > 0.0, "{before} {after}");
        // The same with every vertex's frame turned by quarters of its own.
        let turn = |v: usize| v * 7 % 4;
        for v in 0..l.field.up.len() {
            (0..turn(v)).for_each(|_| l.field.up[v] = l.normals[v].cross(l.field.up[v]));
        }
        let (turned, _) = closed(&l);
        for v in 0..l.field.up.len() {
            for h in l.topo.half_edges(v as u32) {
                let seen = from_turned(turned.steps[h], turn(v) as u8);
                // The field itself turns no more exactly.
                assert!((seen - plain.steps[h]).length() < 1e-4);
                let back = l.topo.find(l.topo.target(h), v as u32).expect("there and back");
                assert!((plain.seen(h, -plain.steps[back]) - plain.steps[h]).length() < 1e-12);
            }
        }
    }

    #[test]
    fn what_closes_up_and_what_is_locked_stays() {
        let l = Laid::new(zoo::icosphere(3), &[], Symmetry::One, 100.0);
        let (w, before) = (wanted(&l), wanted(&l).guide());
        let mut guide = before.clone();
        let open = |v: u32| l.mesh.positions[v as usize].y > 0.5;
        lessen(&w, &mut guide, &open);
        for v in 0..l.mesh.positions.len() as u32 {
            for h in l.topo.half_edges(v) {
                let free = open(v) || open(l.topo.target(h));
                assert!(free || guide.steps[h] == before.steps[h]);
            }
        }
        assert_ne!(guide.steps, before.steps);
        let mut l = Laid::new(zoo::plane(9, 7), &[], Symmetry::One, 9.0);
        l.field.up.fill(vec3(0.6, 0.8, 0.0));
        let (w, before) = (wanted(&l), wanted(&l).guide());
        let mut guide = before.clone();
        lessen(&w, &mut guide, &|_| true);
        assert!(guide.steps.iter().zip(&before.steps).all(|(a, b)| (*a - *b).length() < 1e-12));
    }
}
