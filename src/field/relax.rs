//! Relaxation: the smoothest complex numbers on the vertices that agree with those held.
//!
//! Minimises the sum over edges (i, j) of w |z_j - r z_i|^2, plus over vertices of weight |z|^2 - 2 Re(conj(pull) z). r
//! carries values from i to j (1 for plain numbers), w are the cotangent weights (Pinkall, Polthier 1993), clamped
//! positive so that the matrix is definite on any triangles. First everywhere, by the constraints without radius; then
//! within each constraint of given radius in turn, everything outside of it held (`[MST09]` 2.1, effect area).

use std::collections::BTreeMap;

use super::site::{Site, reach};
use crate::mesh::{Topology, TriMesh};
use crate::numerics::cg::{self, Outcome, Stop};
use crate::numerics::csr::{Complex, Csr, complex};
use crate::numerics::multigrid::Multigrid;

/// Cotangent weights are kept within these; an equilateral triangle's edges have 0.58.
const WEIGHTS: [f64; 2] = [1e-2, 1e2];
/// Far from the constraints values may be small, and are then only directions: hence so exact.
const STOP: Stop = Stop { tolerance: 1e-7, iterations: 200 };

/// How values at neighbours are coupled, per half-edge.
pub(super) struct Coupling {
    pub weights: Vec<f64>,
    /// What carries a value from the half-edge's vertex to its target.
    pub transport: Vec<Complex>,
}

/// What a vertex is drawn to: the minimum of weight |z|^2 - 2 Re(conj(pull) z).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Guide {
    pub weight: f64,
    pub pull: Complex,
}

/// A constraint: where, and what its vertices are held at.
pub(super) struct Pin {
    pub site: Site,
    pub held: Vec<(u32, Complex)>,
}

/// Half the sum of the cotangents opposite to each edge, clamped; the same for both half-edges.
pub(crate) fn cotangent_weights(mesh: &TriMesh, topo: &Topology) -> Vec<f64> {
    let mut weights = vec![0.0; topo.half_edge_count()];
    for (f, face) in mesh.faces.iter().enumerate() {
        let p = mesh.corners(f);
        for k in 0..3 {
            let (i, j) = ((k + 1) % 3, (k + 2) % 3);
            let (a, b) = (p[i] - p[k], p[j] - p[k]);
            let cotangent = a.dot(b) / a.cross(b).length();
            if !cotangent.is_finite() {
                continue;
            }
            for h in [topo.find(face[i], face[j]), topo.find(face[j], face[i])].into_iter().flatten() {
                weights[h] += 0.5 * cotangent;
            }
        }
    }
    weights.iter_mut().for_each(|w| *w = w.clamp(WEIGHTS[0], WEIGHTS[1]));
    weights
}

/// The disc of a site with the value of its vertex carried over it.
pub(super) fn disc(mesh: &TriMesh, topo: &Topology, coupling: &Coupling, site: &Site, value: Complex) -> Pin {
    let mut held = BTreeMap::new();
    for r in reach(mesh, topo, site.vertex, site.disc) {
        let before = r.back.and_then(|h| Some(coupling.transport[h].conj() * *held.get(&topo.target(h))?));
        held.insert(r.vertex, before.unwrap_or(value));
    }
    Pin { site: *site, held: held.into_iter().collect() }
}

/// Relaxes all vertices with `free` set, held by the pins without radius (the later one where two meet) and drawn to
/// `guide`; then the area of each pin with one, in order, drawn to `local`.
pub(super) fn relax(
    mesh: &TriMesh,
    topo: &Topology,
    coupling: &Coupling,
    pins: &[Pin],
    free: &[bool],
    [guide, local]: [&[Guide]; 2],
    z: &mut [Complex],
) {
    let mut held = vec![false; z.len()];
    for &(v, value) in pins.iter().filter(|p| p.site.radius.is_none()).flat_map(|p| &p.held) {
        (z[v as usize], held[v as usize]) = (value, true);
    }
    let open: Vec<u32> = (0..z.len() as u32).filter(|&v| free[v as usize] && !held[v as usize]).collect();
    solve(topo, coupling, &open, guide, z);
    for pin in pins {
        let Some(radius) = pin.site.radius else { continue };
        let mut area: Vec<u32> = reach(mesh, topo, pin.site.vertex, radius).iter().map(|r| r.vertex).collect();
        area.sort_unstable();
        for &(v, value) in pin.held.iter().filter(|(v, _)| area.binary_search(v).is_ok()) {
            (z[v as usize], held[v as usize]) = (value, true);
        }
        area.retain(|&v| !held[v as usize]);
        solve(topo, coupling, &area, local, z);
    }
}

/// Solves for the vertices `open` (ascending), all others held at `z`.
pub(super) fn solve(topo: &Topology, coupling: &Coupling, open: &[u32], guide: &[Guide], z: &mut [Complex]) -> Outcome {
    const HELD: u32 = u32::MAX;
    let mut row = vec![HELD; z.len()];
    open.iter().enumerate().for_each(|(i, &v)| row[v as usize] = i as u32);
    let mut b = vec![Complex::ZERO; open.len()];
    let a = Csr::from_rows(open.len(), open.len(), |i, entries| {
        let v = open[i];
        let mut diagonal = guide[v as usize].weight;
        b[i] = guide[v as usize].pull;
        for h in topo.half_edges(v) {
            let n = topo.target(h) as usize;
            let from_n = coupling.transport[h].conj() * coupling.weights[h];
            diagonal += coupling.weights[h];
            if row[n] == HELD {
                b[i] += from_n * z[n];
            } else {
                entries.push((row[n], -from_n));
            }
        }
        entries.push((i as u32, complex(diagonal, 0.0)));
    });
    let multigrid = Multigrid::new(a);
    let mut x = vec![Complex::ZERO; open.len()];
    let outcome = cg::solve(multigrid.matrix(), &b, &mut x, |r, z| multigrid.cycle(r, z), STOP);

    open.iter().zip(&x).for_each(|(&v, x)| z[v as usize] = *x);
    outcome
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::zoo;

    #[test]
    fn cotangents_of_a_square_are_right() {
        let m = zoo::plane(1, 1);
        let topo = Topology::new(&m);
        let w = cotangent_weights(&m, &topo);
        assert!((w[topo.find(0, 1).unwrap()] - 0.5).abs() < 1e-15);
        assert_eq!(w[topo.find(0, 3).unwrap()], WEIGHTS[0], "the diagonal sees right angles: 0, clamped");
    }

    #[test]
    fn a_linear_function_is_harmonic_on_any_triangles() {
        let m = zoo::plane(6, 5);
        let topo = Topology::new(&m);
        let ones = vec![Complex::ONE; topo.half_edge_count()];
        let coupling = Coupling { weights: cotangent_weights(&m, &topo), transport: ones };
        let want: Vec<_> = m.positions.iter().map(|p| complex(2.0 * p.x - p.y, p.y)).collect();
        let border = |v: usize| [0.0, 6.0].contains(&m.positions[v].x) || [0.0, 5.0].contains(&m.positions[v].y);
        let open: Vec<u32> = (0..want.len() as u32).filter(|&v| !border(v as usize)).collect();
        let mut z = want.clone();
        open.iter().for_each(|&v| z[v as usize] = Complex::ZERO);
        let guide = vec![Guide::default(); z.len()];
        let outcome = solve(&topo, &coupling, &open, &guide, &mut z);
        assert!(outcome.residual <= STOP.tolerance);
        assert!(z.iter().zip(&want).all(|(a, b)| (*a - *b).norm2() < 1e-14));
    }
}
