//! Multigrid by smoothed aggregation: the preconditioner that makes conjugate gradients need a few dozen iterations on
//! Laplacians of any size.
//!
//! Source: Vaněk, Mandel, Brezina 1996: Algebraic Multigrid by Smoothed Aggregation. The near kernel is the vector
//! whose entries differ by the phases of the matrix: member i of an aggregate is -a_ij / |a_ij| times its root j, so
//! Laplacians of tangent vectors coarsen as well as real ones. One V-cycle with a forward Gauss-Seidel sweep before and
//! a backward one after the correction is Hermitian. Everything but the matrix products of the caller runs on one
//! thread.

use super::csr::{Complex, Csr};
use super::par;

/// Strong coupling: |a_ij|^2 > STRONG^2 a_ii a_jj (the paper's 0.08 on the finest level, for all).
const STRONG: f64 = 0.08;
/// At most this many unknowns are solved densely.
const DENSE: usize = 120;

/// A hierarchy of ever coarser matrices.
#[derive(Clone, Debug)]
pub struct Multigrid {
    levels: Vec<Level>,
    bottom: Bottom,
}

#[derive(Clone, Debug)]
struct Level {
    a: Csr,
    inverse_diagonal: Vec<f64>,
    prolong: Csr,
    restrict: Csr,
}

/// The coarsest matrix: factored, or swept where it does not coarsen any further.
#[derive(Clone, Debug)]
enum Bottom {
    Factor(Cholesky),
    Sweeps(Csr, Vec<f64>),
}

impl Multigrid {
    /// Builds the hierarchy of a Hermitian positive definite matrix.
    pub fn new(a: Csr) -> Self {
        let mut levels = vec![];
        let mut a = a;
        while a.rows() > DENSE {
            let diagonal = diagonal(&a);
            let prolong = prolongation(&a, &diagonal);
            if prolong.columns() * 4 > a.rows() * 3 {
                break;
            }
            let restrict = prolong.adjoint();
            let coarse = restrict.product(&a.product(&prolong));
            levels.push(Level { inverse_diagonal: inverse(&diagonal), a, prolong, restrict });
            a = coarse;
        }
        let bottom = if a.rows() <= DENSE {
            Bottom::Factor(Cholesky::new(&a))
        } else {
            let d = inverse(&diagonal(&a));
            Bottom::Sweeps(a, d)
        };
        Multigrid { levels, bottom }
    }

    /// The matrix that was given.
    pub fn matrix(&self) -> &Csr {
        match (self.levels.first(), &self.bottom) {
            (Some(level), _) => &level.a,
            (None, Bottom::Factor(f)) => &f.a,
            (None, Bottom::Sweeps(a, _)) => a,
        }
    }

    /// One V-cycle from zero: an approximate solution `x` of `A x = b`.
    pub fn cycle(&self, b: &[Complex], x: &mut [Complex]) {
        self.descend(0, b, x);
    }

    fn descend(&self, depth: usize, b: &[Complex], x: &mut [Complex]) {
        let Some(level) = self.levels.get(depth) else {
            match &self.bottom {
                Bottom::Factor(f) => f.solve(b, x),
                Bottom::Sweeps(a, d) => {
                    x.fill(Complex::ZERO);
                    for _ in 0..2 {
                        sweep(a, d, b, x, 0..b.len());
                        sweep(a, d, b, x, (0..b.len()).rev());
                    }
                }
            }
            return;
        };
        let n = b.len();
        let mut fine = vec![Complex::ZERO; n];
        first_sweep(&level.a, &level.inverse_diagonal, b, x, &mut fine);
        let mut coarse_b = vec![Complex::ZERO; level.prolong.columns()];
        level.restrict.multiply(&fine, &mut coarse_b);
        let mut coarse_x = vec![Complex::ZERO; coarse_b.len()];
        self.descend(depth + 1, &coarse_b, &mut coarse_x);
        level.prolong.multiply(&coarse_x, &mut fine);
        x.iter_mut().zip(&fine).for_each(|(x, f)| *x += *f);
        sweep(&level.a, &level.inverse_diagonal, b, x, (0..n).rev());
    }
}

fn diagonal(a: &Csr) -> Vec<f64> {
    (0..a.rows()).map(|i| a.row(i).find(|&(c, _)| c == i).map_or(0.0, |(_, v)| v.re)).collect()
}

fn inverse(diagonal: &[f64]) -> Vec<f64> {
    diagonal.iter().map(|&d| if d > 0.0 { 1.0 / d } else { 0.0 }).collect()
}

/// One Gauss-Seidel sweep over the rows in the given order.
fn sweep(a: &Csr, inverse: &[f64], b: &[Complex], x: &mut [Complex], order: impl Iterator<Item = usize>) {
    for i in order {
        let rest = a.row(i).fold(b[i], |s, (c, v)| s - v * x[c]);
        x[i] += rest * inverse[i];
    }
}

/// A forward Gauss-Seidel sweep from zero, and the residual it leaves: the first needs only what stands before the
/// diagonal, the second what stands behind.
fn first_sweep(a: &Csr, inverse: &[f64], b: &[Complex], x: &mut [Complex], residual: &mut [Complex]) {
    for i in 0..b.len() {
        let rest = a.row(i).take_while(|&(c, _)| c < i).fold(b[i], |s, (c, v)| s - v * x[c]);
        x[i] = rest * inverse[i];
        // A row without a diagonal is not solved for.
        residual[i] = if inverse[i] == 0.0 { rest } else { Complex::ZERO };
    }
    const CHUNK: usize = 2048;
    let x = &*x;
    par::for_rows(residual, CHUNK, |chunk, part| {
        for (k, r) in part.iter_mut().enumerate() {
            let i = chunk * CHUNK + k;
            *r = a.row(i).filter(|&(c, _)| c > i).fold(*r, |s, (c, v)| s - v * x[c]);
        }
    });
}

/// The smoothed prolongation (I - omega D^-1 A) P of the aggregates' P.
fn prolongation(a: &Csr, diagonal: &[f64]) -> Csr {
    let (of, phase, count) = aggregates(a, diagonal);
    // Gershgorin's bound on the largest eigenvalue of D^-1 A.
    let row_sum = |i: usize| a.row(i).map(|(_, v)| v.norm2().sqrt()).sum::<f64>() / diagonal[i].max(f64::MIN_POSITIVE);
    let bound = (0..a.rows()).map(row_sum).fold(1.0, f64::max);
    let omega = 4.0 / (3.0 * bound);
    let mut sum = vec![Complex::ZERO; count];
    Csr::from_rows(a.rows(), count, |i, entries| {
        let mut add = |g: u32, v: Complex| {
            match entries.iter().any(|&(c, _)| c == g) {
                true => sum[g as usize] += v,
                false => {
                    entries.push((g, Complex::ZERO));
                    sum[g as usize] = v;
                }
            };
        };
        if of[i] != NONE {
            add(of[i], phase[i]);
        }
        for (j, v) in a.row(i).filter(|&(j, _)| of[j] != NONE) {
            add(of[j], v * phase[j] * (-omega / diagonal[i].max(f64::MIN_POSITIVE)));
        }
        entries.iter_mut().for_each(|(c, v)| *v = sum[*c as usize]);
    })
}

const NONE: u32 = u32::MAX;

/// For each unknown its aggregate and its phase relative to the aggregate's root; and the number of aggregates.
/// Unknowns coupled to nothing have none: the sweeps solve them.
fn aggregates(a: &Csr, diagonal: &[f64]) -> (Vec<u32>, Vec<Complex>, usize) {
    let n = a.rows();
    let strong =
        |i: usize, j: usize, v: Complex| i != j && v.norm2() > STRONG * STRONG * diagonal[i].abs() * diagonal[j].abs();
    let (mut of, mut phase) = (vec![NONE; n], vec![Complex::ONE; n]);
    let mut count = 0u32;
    // Whole strong neighbourhoods that are still free.
    for i in 0..n {
        let mut neighbours = a.row(i).filter(|&(j, v)| strong(i, j, v)).peekable();
        if of[i] != NONE || neighbours.peek().is_none() || neighbours.any(|(j, _)| of[j] != NONE) {
            continue;
        }
        of[i] = count;
        for (j, v) in a.row(i).filter(|&(j, v)| strong(i, j, v)) {
            of[j] = count;
            phase[j] = (-v.conj()).unit().unwrap_or(Complex::ONE);
        }
        count += 1;
    }
    // The rest joins the strongest neighbour's, as of the first pass.
    let first = of.clone();
    for i in 0..n {
        if first[i] != NONE {
            continue;
        }
        let mut best: Option<(usize, Complex)> = None;
        for (j, v) in a.row(i).filter(|&(j, v)| strong(i, j, v) && first[j] != NONE) {
            if best.is_none_or(|(_, b)| v.norm2() > b.norm2()) {
                best = Some((j, v));
            }
        }
        if let Some((j, v)) = best {
            of[i] = first[j];
            phase[i] = (-v).unit().unwrap_or(Complex::ONE) * phase[j];
        } else if a.row(i).any(|(j, v)| j != i && v != Complex::ZERO) {
            of[i] = count;
            count += 1;
        }
    }
    (of, phase, count as usize)
}

/// The factor L of A = L L^H of a small dense matrix.
#[derive(Clone, Debug)]
struct Cholesky {
    a: Csr,
    n: usize,
    l: Vec<Complex>,
}

impl Cholesky {
    fn new(a: &Csr) -> Self {
        let n = a.rows();
        let mut l = vec![Complex::ZERO; n * n];
        for i in 0..n {
            for (c, v) in a.row(i).filter(|&(c, _)| c <= i) {
                l[i * n + c] = v;
            }
        }
        let largest = (0..n).map(|i| l[i * n + i].re).fold(0.0, f64::max);
        for j in 0..n {
            let sum = (0..j).map(|k| l[j * n + k].norm2()).sum::<f64>();
            // A pivot lost to rounding: a large one in its place leaves that unknown (nearly) alone.
            let d = l[j * n + j].re - sum;
            let d = if d > largest * 1e-14 { d } else { largest.max(f64::MIN_POSITIVE) };
            let d = d.sqrt();
            l[j * n + j] = Complex { re: d, im: 0.0 };
            for i in j + 1..n {
                let s = (0..j).fold(l[i * n + j], |s, k| s - l[i * n + k] * l[j * n + k].conj());
                l[i * n + j] = s * (1.0 / d);
            }
        }
        Cholesky { a: a.clone(), n, l }
    }

    fn solve(&self, b: &[Complex], x: &mut [Complex]) {
        let (n, l) = (self.n, &self.l);
        for i in 0..n {
            let s = (0..i).fold(b[i], |s, k| s - l[i * n + k] * x[k]);
            x[i] = s * (1.0 / l[i * n + i].re);
        }
        for i in (0..n).rev() {
            let s = (i + 1..n).fold(x[i], |s, k| s - l[k * n + i].conj() * x[k]);
            x[i] = s * (1.0 / l[i * n + i].re);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::cg::{Outcome, Stop, solve};
    use crate::numerics::csr::complex;
    use crate::numerics::det;
    use crate::numerics::rng::Key;

    /// Laplacian of a w x w grid in turned bases, held at one corner.
    fn grid(w: usize) -> Csr {
        let turn = |i: usize| {
            let (s, c) = det::sin_cos(Key::new(5).with(i as u64).unit(0) * 6.0);
            complex(c, s)
        };
        Csr::from_rows(w * w, w * w, |i, e| {
            let (x, y) = (i % w, i / w);
            let mut near = vec![];
            if x > 0 {
                near.push(i - 1);
            }
            if x + 1 < w {
                near.push(i + 1);
            }
            if y > 0 {
                near.push(i - w);
            }
            if y + 1 < w {
                near.push(i + w);
            }
            e.push((i as u32, complex(near.len() as f64 + if i == 0 { 1.0 } else { 0.0 }, 0.0)));
            e.extend(near.iter().map(|&j| (j as u32, -(turn(i) * turn(j).conj()))));
        })
    }

    fn run(w: usize) -> Outcome {
        let multigrid = Multigrid::new(grid(w));
        let want: Vec<_> = (0..w * w).map(|i| complex((i % 7) as f64, (i % 5) as f64)).collect();
        let mut b = vec![Complex::ZERO; w * w];
        multigrid.matrix().multiply(&want, &mut b);
        let mut x = vec![Complex::ZERO; w * w];
        let stop = Stop { tolerance: 1e-10, iterations: 200 };
        let out = solve(multigrid.matrix(), &b, &mut x, |r, z| multigrid.cycle(r, z), stop);
        let error = x.iter().zip(&want).map(|(a, b)| (*a - *b).norm2()).fold(0.0, f64::max);
        assert!(error < 1e-8, "{w}: {error} {out:?}");
        out
    }

    #[test]
    fn iterations_hardly_grow_with_the_grid() {
        assert!(run(8).iterations <= 2, "a factored matrix is solved at once");
        let (small, large) = (run(32).iterations, run(128).iterations);
        assert!(small <= 20 && large <= 30, "{small} {large}");
    }

    #[test]
    fn uncoupled_unknowns_are_solved_too() {
        let a = Csr::from_rows(500, 500, |i, e| e.push((i as u32, complex(1.0 + i as f64, 0.0))));
        let m = Multigrid::new(a);
        let (b, mut x) = (vec![Complex::ONE; 500], vec![Complex::ZERO; 500]);
        m.cycle(&b, &mut x);
        assert!(x.iter().enumerate().all(|(i, x)| (x.re * (1.0 + i as f64) - 1.0).abs() < 1e-12));
    }
}
