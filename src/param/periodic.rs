//! Periodic coordinates: angles at the vertices that change along each edge as wanted, up to whole turns.
//!
//! Source: `[MST09]` 2.3, Eq. 3 and F_PGP; Ray et al. 2006 (Periodic Global Parameterization). In: the wanted change along
//! each edge. Out: per vertex two complex numbers of absolute value 1 whose angles are s and t.
//! Reads as: the matrix of Eq. 3 turns [cos, sin] by -alpha; it must turn by +alpha, as a flat grid shows. The printed
//! weight of an edge, the area of its triangles, draws the coordinates askew wherever triangles are not all alike; with
//! cotangents the sum is the energy of the surface's own gradients (Ray et al. 2006), and a third fewer triangles need
//! three look-ups: at 20 periods to the diagonal 10.6 % for 15.5 % of rocker-arm.
//!
//! The paper locks one vertex of the whole and takes the angles of the least squares solution. Where the wanted changes
//! do not close up around triangles, that solution dies away from the locked vertex, faster than any solver follows:
//! its angles are noise after a few dozen periods. So it is only the start, and is then relaxed again a few times, every
//! vertex drawn to the angle that it has, with absolute value 1 (diffusion and projection in turn: Merriman, Bence,
//! Osher 1992 for maps to the circle).
//!
//! Where a sample looks the same after a half or quarter turn, s at one vertex continues as -s or t at the next: the
//! numbers of all the directions that mix are solved for together, on as many sheets as there are such directions.
//! Unaware of: triangles, positions.

use super::guide::Guide;
use crate::field::Symmetry;
use crate::mesh::Topology;
use crate::numerics::cg::{self, Stop};
use crate::numerics::csr::{Complex, Csr, complex};
use crate::numerics::multigrid::Multigrid;
use crate::numerics::{det, par};

/// Rounds of relaxing after the start. None leaves a fifth more triangles distorted; what more than these save, `settle`
/// saves sooner.
const ROUNDS: usize = 3;
/// How many periods of disorder a round evens out. On rocker-arm, cheburashka and the bunny with 20 periods to the
/// diagonal 0.5 leaves 1 % more triangles distorted than 1, and 2 as many.
const REACH: f64 = 1.0;
const START: Stop = Stop { tolerance: 1e-4, iterations: 100 };
const ROUND: Stop = Stop { tolerance: 1e-3, iterations: 100 };

/// s and t of a vertex as complex numbers of absolute value 1.
pub type Phases = [Complex; 2];

/// The directions that mix with each other: right, down, left, up by their number of quarter turns.
fn sheets(symmetry: Symmetry) -> &'static [&'static [usize]] {
    match symmetry {
        Symmetry::One | Symmetry::Isotropic => &[&[0], &[1]],
        Symmetry::Two => &[&[0, 2], &[1, 3]],
        Symmetry::Four => &[&[0, 1, 2, 3]],
    }
}

/// Where a vertex is among the unknowns.
const LOCKED: u32 = u32::MAX;

/// The sparse system of some vertices on some sheets, all else locked.
struct System<'a> {
    guide: &'a Guide,
    topo: &'a Topology,
    open: &'a [u32],
    row: &'a [u32],
    sheets: &'a [usize],
    /// Place of each direction among the sheets.
    place: [usize; 4],
}

impl<'a> System<'a> {
    fn new(guide: &'a Guide, topo: &'a Topology, open: &'a [u32], row: &'a [u32], sheets: &'a [usize]) -> Self {
        let mut place = [0; 4];
        sheets.iter().enumerate().for_each(|(i, &k)| place[k] = i);
        System { guide, topo, open, row, sheets, place }
    }

    /// The matrix of F_PGP, and `pull` on the diagonal; `right` becomes what locked vertices bring.
    fn matrix(&self, pull: &[f64], z: &[Phases], right: &mut Vec<Complex>) -> Csr {
        let n = self.sheets.len();
        right.clear();
        right.resize(self.open.len() * n, Complex::ZERO);
        let rotations = self.rotations();
        Csr::from_rows(self.open.len() * n, self.open.len() * n, |r, entries| {
            let (v, sheet) = (self.open[r / n], self.sheets[r % n]);
            let mut diagonal = pull[r / n];
            for h in self.topo.half_edges(v) {
                let (weight, quarters) = (self.guide.weights[h], self.guide.quarters[h] as usize);
                diagonal += weight;
                // What the neighbour's direction says of ours: turned back along the edge.
                let back = turned(rotations[h], sheet).conj() * weight;
                let target = self.topo.target(h) as usize;
                let theirs = (sheet + 4 - quarters) % 4;
                if self.row[target] == LOCKED {
                    right[r] += back * direction(&z[target], theirs);
                } else {
                    entries.push((self.row[target] * n as u32 + self.place[theirs] as u32, -back));
                }
            }
            entries.push((r as u32, complex(diagonal, 0.0)));
        })
    }

    /// The change along each half-edge as two turns.
    fn rotations(&self) -> Vec<Phases> {
        par::map(self.guide.steps.len(), |h| {
            let step = self.guide.steps[h];
            [turn(step.x), turn(step.y)]
        })
    }
}

/// The number whose angle is so many periods.
pub(super) fn turn(periods: f64) -> Complex {
    let (s, c) = det::sin_cos(std::f64::consts::TAU * (periods - periods.round()));
    complex(c, s)
}

/// The change along a direction: that of right or down, or its opposite.
fn turned(rotation: Phases, direction: usize) -> Complex {
    if direction < 2 { rotation[direction] } else { rotation[direction - 2].conj() }
}

/// The number of a direction: s, t, -s, -t.
fn direction(z: &Phases, direction: usize) -> Complex {
    turned(*z, direction)
}

/// Solves for the vertices `open` (ascending), all others locked at `z`. With `start` F_PGP alone first, from what is
/// locked: there must be a locked vertex in each component. Without, `z` is the start.
pub(super) fn solve(guide: &Guide, topo: &Topology, open: &[u32], symmetry: Symmetry, start: bool, z: &mut [Phases]) {
    let mut row = vec![LOCKED; topo.vertex_count()];
    open.iter().enumerate().for_each(|(i, &v)| row[v as usize] = i as u32);
    let solved = |sheets: &[usize]| {
        let system = System::new(guide, topo, open, &row, sheets);
        relaxed(&system, start, z)
    };
    let groups = sheets(symmetry);
    let columns = match groups {
        [first, second] => {
            let (a, b) = par::join(|| solved(first), || solved(second));
            [a, b].concat()
        }
        _ => groups.iter().flat_map(|g| solved(g)).collect(),
    };
    for (direction, column) in columns.into_iter().filter(|(d, _)| *d < 2) {
        open.iter().zip(column).for_each(|(&v, value)| z[v as usize][direction] = value);
    }
}

/// Absolute value 1; 1 where there is no direction.
fn unit(z: Complex) -> Complex {
    z.unit().unwrap_or(Complex::ONE)
}

/// The directions of a group and their values at the open vertices.
fn relaxed(system: &System<'_>, start: bool, z: &[Phases]) -> Vec<(usize, Vec<Complex>)> {
    let n = system.sheets.len();
    let mut x: Vec<Complex> =
        system.open.iter().flat_map(|&v| system.sheets.iter().map(move |&d| direction(&z[v as usize], d))).collect();
    let mut b = vec![];
    if start {
        let multigrid = Multigrid::new(system.matrix(&vec![0.0; system.open.len()], z, &mut b));
        x.fill(Complex::ZERO);
        cg::solve(multigrid.matrix(), &b, &mut x, |r, z| multigrid.cycle(r, z), START);
        x.iter_mut().for_each(|x| *x = unit(*x));
    }
    let pull = par::map(system.open.len(), |i| {
        let of = |h: usize| {
            let step = system.guide.steps[h];
            system.guide.weights[h] * step.dot(step)
        };
        system.topo.half_edges(system.open[i]).map(of).sum::<f64>() / (2.0 * REACH * REACH)
    });
    let multigrid = Multigrid::new(system.matrix(&pull, z, &mut b));
    for _ in 0..ROUNDS {
        let right: Vec<Complex> = x.iter().zip(&b).enumerate().map(|(r, (x, b))| *b + *x * pull[r / n]).collect();
        cg::solve(multigrid.matrix(), &right, &mut x, |r, z| multigrid.cycle(r, z), ROUND);
        x.iter_mut().for_each(|x| *x = unit(*x));
    }
    (0..n).map(|i| (system.sheets[i], x.iter().skip(i).step_by(n).copied().collect())).collect()
}

#[cfg(test)]
mod tests {
    use super::super::guide::Wanted;
    use super::super::tests::Laid;
    use super::*;
    use crate::mesh::zoo;

    #[test]
    fn the_matrix_is_hermitian_on_all_sheets() {
        for symmetry in [Symmetry::One, Symmetry::Two, Symmetry::Four] {
            let l = Laid::new(zoo::icosphere(2), &[], symmetry, 32.0);
            let wanted =
                Wanted { mesh: &l.mesh, topo: &l.topo, normals: &l.normals, field: &l.field, symmetry, tile: [64, 64] };
            let guide = wanted.guide();
            let n = l.mesh.positions.len();
            let open: Vec<u32> = (0..n as u32).collect();
            for group in sheets(symmetry) {
                let system = System::new(&guide, &l.topo, &open, &open, group);
                let a = system.matrix(&vec![0.5; n], &vec![[Complex::ONE; 2]; n], &mut vec![]);
                let h = a.adjoint();
                for i in 0..a.rows() {
                    for ((c, x), (d, y)) in a.row(i).zip(h.row(i)) {
                        assert!(c == d && (x - y).norm2() < 1e-24, "{symmetry:?} row {i}");
                    }
                }
            }
        }
    }
}
