//! Periodic coordinates settled: plain numbers once the whole periods along edges are known, and as few triangles beyond
//! the bound as can be.
//!
//! Source: `[MST09]` 2.3 and 3. In: angles at vertices, and the field's own change along each edge. Out: angles near them.
//! With p the whole periods that bring an edge's change nearest to the wanted one (`recover`), s minimises
//! `sum w |s_j + p - s_i - alpha|^2`: the energy of F_PGP without its cosines, which take a change that is half a period
//! off for right. A line that ends is still drawn out over a disc of nearly half a period across. It must be somewhere,
//! but not so wide: weights are solved for again and again, each edge's that of its triangles, which weigh the more the
//! further they are from what is wanted, and hardly anything once they are well beyond the bound and so blended from
//! three look-ups in any case (iteratively reweighted least squares).
//! Unaware of: how the angles were found.

use super::curl::quarter_turns;
use super::guide::{Guide, Wanted};
use super::periodic::{Phases, turn};
use super::{recover, singular};
use crate::numerics::cg::{self, Stop};
use crate::numerics::csr::{Complex, Csr, complex};
use crate::numerics::multigrid::Multigrid;
use crate::numerics::par;
use crate::numerics::vec::{Vec2, Vec3, vec2};

/// Rounds, each with its weights. Of armadillo at 20 periods to the diagonal none leaves 10.7 % of triangles with three
/// look-ups, rounds without weights 10.6 %, these 9.0 %.
const ROUNDS: usize = 4;
/// A triangle with nothing to put right weighs as if it were so far from what is wanted, as a share of its square.
const LEAST: f64 = 0.01;
/// Triangles that are further from it, likewise, are given up, and weigh so much.
const GIVEN_UP: f64 = 0.8;
const LEFT: f64 = 0.1;
const STOP: Stop = Stop { tolerance: 1e-2, iterations: 100 };

/// Settles the vertices `open` (ascending), all others locked at `z`; in each component one is locked. `guide` is the
/// field's, with its curl.
pub(super) fn settle(wanted: &Wanted<'_>, guide: &Guide, open: &[u32], z: &mut [Phases]) {
    if open.is_empty() {
        return;
    }
    let mut row = vec![u32::MAX; z.len()];
    open.iter().enumerate().for_each(|(i, &v)| row[v as usize] = i as u32);
    let mut at: Vec<Vec2> = par::map(z.len(), |v| recover::periods(&z[v]));
    let gradients = par::map(wanted.mesh.faces.len(), |f| wanted.gradients(f, wanted.mesh.faces[f][0]));
    for _ in 0..ROUNDS {
        let changes = recover::changes(guide, wanted.topo, &at);
        let weights = weights(wanted, guide, &gradients, &at, &changes);
        let right = par::map(open.len(), |i| {
            let half_edges = wanted.topo.half_edges(open[i]);
            let rest = half_edges.fold(Vec2::ZERO, |sum, h| sum + (changes[h] - guide.steps[h]) * weights[h]);
            complex(rest.x, rest.y)
        });
        let multigrid = Multigrid::new(matrix(wanted, guide, open, &row, &weights));
        let mut moved = vec![Complex::ZERO; open.len()];
        cg::solve(multigrid.matrix(), &right, &mut moved, |r, z| multigrid.cycle(r, z), STOP);
        for (&v, moved) in open.iter().zip(&moved) {
            let there = at[v as usize] + vec2(moved.re, moved.im);
            at[v as usize] = there - vec2(there.x.round(), there.y.round());
        }
    }
    open.iter().for_each(|&v| z[v as usize] = [turn(at[v as usize].x), turn(at[v as usize].y)]);
}

/// Weights of edges: their cotangent weights times the mean weight of their triangles, which have wanted `gradients` in
/// the frames of their first corners.
fn weights(wanted: &Wanted<'_>, guide: &Guide, gradients: &[[Vec3; 2]], at: &[Vec2], changes: &[Vec2]) -> Vec<f64> {
    let (mesh, topo) = (wanted.mesh, wanted.topo);
    let faces = par::map(mesh.faces.len(), |f| {
        let (corners, _) = recover::corners(guide, topo, at, changes, mesh.faces[f]);
        let off = singular::off(mesh, f, &gradients[f], &corners);
        if off > GIVEN_UP { LEFT } else { (off + LEAST).sqrt() }
    });
    let of = |v: u32, h: usize| {
        let n = topo.target(h);
        let shared = topo.faces(v).iter().filter(|&&f| mesh.faces[f as usize].contains(&n));
        let (sum, count) = shared.fold((0.0, 0.0), |(sum, count), &f| (sum + faces[f as usize], count + 1.0));
        guide.weights[h] * sum / f64::max(count, 1.0)
    };
    let rows = par::map_chunks(topo.vertex_count(), 1024, |r| {
        r.flat_map(|v| topo.half_edges(v as u32).map(move |h| of(v as u32, h))).collect::<Vec<_>>()
    });
    rows.into_iter().flatten().collect()
}

/// The Laplacian of the coordinates s + i t of open vertices, with quarter turns along edges.
fn matrix(wanted: &Wanted<'_>, guide: &Guide, open: &[u32], row: &[u32], weights: &[f64]) -> Csr {
    Csr::from_rows(open.len(), open.len(), |r, entries| {
        let mut diagonal = 0.0;
        for h in wanted.topo.half_edges(open[r]) {
            diagonal += weights[h];
            let target = row[wanted.topo.target(h) as usize];
            if target != u32::MAX {
                entries.push((target, quarter_turns(guide.quarters[h]) * -weights[h]));
            }
        }
        entries.push((r as u32, complex(diagonal, 0.0)));
    })
}

#[cfg(test)]
mod tests {
    use super::super::tests::Laid;
    use super::super::{curl, periodic};
    use super::*;
    use crate::field::Symmetry;
    use crate::mesh::zoo;

    #[test]
    fn fewer_triangles_are_beyond_the_bound_and_what_is_locked_stays() {
        for symmetry in [Symmetry::One, Symmetry::Four] {
            let l = Laid::new(zoo::icosphere(4), &[], symmetry, 150.0);
            let Laid { mesh, topo, normals, field, .. } = &l;
            let wanted = Wanted { mesh, topo, normals, field, symmetry, tile: [64, 64] };
            let guide = wanted.guide();
            let mut even = guide.clone();
            curl::lessen(&wanted, &mut even, &|_| true);
            let open: Vec<u32> = (1..normals.len() as u32).collect();
            let mut z = vec![[Complex::ONE; 2]; normals.len()];
            periodic::solve(&even, topo, &open, symmetry, true, &mut z);
            let beyond = |z: &[Phases]| {
                let at: Vec<Vec2> = z.iter().map(recover::periods).collect();
                let changes = recover::changes(&guide, topo, &at);
                let corners = |f: usize| recover::corners(&guide, topo, &at, &changes, mesh.faces[f]).0;
                (0..mesh.faces.len()).filter(|&f| singular::distorted(&wanted, f, &corners(f))).count()
            };
            let before = beyond(&z);
            settle(&wanted, &guide, &open, &mut z);
            assert!(beyond(&z) * 10 < before * 9, "{symmetry:?}: {} of {before}", beyond(&z));
            let (half, settled) = (open[open.len() / 2..].to_vec(), z.clone());
            settle(&wanted, &guide, &half, &mut z);
            assert!(z[..half[0] as usize] == settled[..half[0] as usize] && z != settled);
        }
    }
}
