//! Eigenvalues and leading eigenvectors of a real symmetric matrix.
//!
//! Source: Householder reduction to tridiagonal form, then QL with implicit shifts (Golub, Van Loan: Matrix
//! Computations, sections 8.3.1 and 8.3.3). Only the wanted vectors are formed: the rotations of the QL sweeps are
//! recorded and applied backwards to the wanted columns of the identity, n^2 m work instead of n^3.
//! Unaware of: where the matrix comes from.

use super::par;

/// All eigenvalues, largest first, and the eigenvectors of the first of them.
#[derive(Clone, Debug, PartialEq)]
pub struct Eigen {
    /// Eigenvalues, descending.
    pub values: Vec<f64>,
    /// Unit eigenvectors of the leading values, one row of n components each. The component of largest magnitude (the
    /// first of equals) is positive.
    pub vectors: Vec<Vec<f64>>,
}

/// Rows of the matrix per parallel task; below that many rows the work is not worth a task.
const ROWS_PER_TASK: usize = 128;

/// Decomposes the symmetric matrix `a` (n rows of n finite values; only its symmetry is relied on, not checked).
/// `keep` sees the eigenvalues, largest first, and says how many eigenvectors to form (more than n means n).
/// Panics if `a` does not have n * n values.
pub fn symmetric(mut a: Vec<f64>, n: usize, keep: impl FnOnce(&[f64]) -> usize) -> Eigen {
    assert_eq!(a.len(), n * n, "a square matrix");
    if n == 0 {
        return Eigen { values: vec![], vectors: vec![] };
    }
    // Scaled to magnitude one, so that no square over- or underflows.
    let scale = a.iter().fold(0.0f64, |m, v| m.max(v.abs()));
    if scale > 0.0 {
        a.iter_mut().for_each(|v| *v /= scale);
    }
    let (mut diagonal, mut off, reflectors) = tridiagonalise(&mut a, n);
    let rotations = implicit_ql(&mut diagonal, &mut off);

    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|&i, &j| diagonal[j].total_cmp(&diagonal[i]).then(i.cmp(&j)));
    let values: Vec<f64> = order.iter().map(|&i| diagonal[i] * scale).collect();
    let wanted = keep(&values).min(n);
    let vectors = par::map_chunks(wanted, 8, |range| form_vectors(&order[range], n, &rotations, &reflectors)).concat();
    Eigen { values, vectors }
}

/// Scalar product in a fixed order of eight lanes.
pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut lanes = [0.0; 8];
    let (ca, cb) = (a.chunks_exact(8), b.chunks_exact(8));
    let tail: f64 = ca.remainder().iter().zip(cb.remainder()).fold(0.0, |s, (x, y)| s + x * y);
    for (x, y) in ca.zip(cb) {
        for i in 0..8 {
            lanes[i] += x[i] * y[i];
        }
    }
    let [p, q, r, s, t, u, v, w] = lanes;
    ((p + t) + (q + u)) + ((r + v) + (s + w)) + tail
}

/// A reflection I - v v^T with |v|^2 = 2 (or v = 0), acting on components `first..`.
struct Reflector {
    first: usize,
    v: Vec<f64>,
}

/// The reflector that turns `x` into a multiple of its first axis, and that multiple.
fn reflector(x: &[f64], first: usize) -> (Reflector, f64) {
    let norm = dot(x, x).sqrt();
    let mut v = x.to_vec();
    if norm == 0.0 {
        return (Reflector { first, v }, 0.0);
    }
    // The sign that does not cancel.
    let alpha = if x[0] > 0.0 { -norm } else { norm };
    v[0] -= alpha;
    let scale = (2.0 / dot(&v, &v)).sqrt();
    v.iter_mut().for_each(|c| *c *= scale);
    (Reflector { first, v }, alpha)
}

/// Reduces `a` to diagonal and off-diagonal (`off[i]` couples i and i + 1) by the returned reflections, in order.
fn tridiagonalise(a: &mut [f64], n: usize) -> (Vec<f64>, Vec<f64>, Vec<Reflector>) {
    let mut off = vec![0.0; n];
    let mut reflectors = Vec::with_capacity(n.saturating_sub(2));
    for k in 0..n.saturating_sub(2) {
        let first = k + 1;
        let (h, alpha) = reflector(&a[k * n + first..(k + 1) * n], first);
        off[k] = alpha;
        let trailing = &mut a[first * n..];
        let m = n - first;
        // A' = A - v w^T - w v^T with p = A v, w = p - (p.v / 2) v.
        let mut w = vec![0.0; m];
        {
            let (trailing, v) = (&*trailing, &h.v);
            par::for_rows(&mut w, ROWS_PER_TASK, |task, out| {
                for (i, o) in out.iter_mut().enumerate() {
                    let row = (task * ROWS_PER_TASK + i) * n;
                    *o = dot(&trailing[row + first..row + n], v);
                }
            });
        }
        let half = 0.5 * dot(&w, &h.v);
        w.iter_mut().zip(&h.v).for_each(|(w, v)| *w -= half * v);
        par::for_rows(trailing, ROWS_PER_TASK * n, |task, rows| {
            for (i, row) in rows.chunks_exact_mut(n).enumerate() {
                let (vi, wi) = (h.v[task * ROWS_PER_TASK + i], w[task * ROWS_PER_TASK + i]);
                for ((a, v), w) in row[first..].iter_mut().zip(&h.v).zip(&w) {
                    *a -= vi * w + wi * v;
                }
            }
        });
        reflectors.push(h);
    }
    if n >= 2 {
        off[n - 2] = a[(n - 2) * n + n - 1];
    }
    ((0..n).map(|i| a[i * n + i]).collect(), off, reflectors)
}

/// A plane rotation of axes `axis` and `axis + 1`.
struct Rotation {
    axis: u32,
    c: f64,
    s: f64,
}

/// Turns the tridiagonal matrix into its eigenvalues in `d`; `e` is used up. Returns the rotations in order.
fn implicit_ql(d: &mut [f64], e: &mut [f64]) -> Vec<Rotation> {
    let n = d.len();
    let mut rotations = Vec::with_capacity(n * n);
    for l in 0..n {
        // Convergence is cubic; finite input needs about two sweeps per value. The bound only guards against a hang.
        for _ in 0..100 {
            let negligible =
                |i: usize| e[i].abs() <= f64::EPSILON * (d[i].abs() + d[i + 1].abs()).max(f64::MIN_POSITIVE);
            let m = (l..n - 1).find(|&i| negligible(i)).unwrap_or(n - 1);
            if m == l {
                break;
            }
            sweep(d, e, l, m, &mut rotations);
        }
    }
    rotations
}

/// One QL sweep with implicit shift over the unreduced block `l..=m`.
fn sweep(d: &mut [f64], e: &mut [f64], l: usize, m: usize, rotations: &mut Vec<Rotation>) {
    let g = (d[l + 1] - d[l]) / (2.0 * e[l]);
    let r = (g * g + 1.0).sqrt();
    let mut g = d[m] - d[l] + e[l] / (g + if g >= 0.0 { r } else { -r });
    let (mut s, mut c, mut p) = (1.0, 1.0, 0.0);
    for i in (l..m).rev() {
        let (f, b) = (s * e[i], c * e[i]);
        let r = (f * f + g * g).sqrt();
        e[i + 1] = r;
        if r == 0.0 {
            // The block splits here.
            d[i + 1] -= p;
            e[m] = 0.0;
            return;
        }
        (s, c) = (f / r, g / r);
        g = d[i + 1] - p;
        let r = (d[i] - g) * s + 2.0 * c * b;
        p = s * r;
        d[i + 1] = g + p;
        g = c * r - b;
        rotations.push(Rotation { axis: i as u32, c, s });
    }
    d[l] -= p;
    e[l] = g;
    e[m] = 0.0;
}

/// Eigenvectors of the eigenvalues at `columns`: reflections times rotations times those columns of the identity.
fn form_vectors(columns: &[usize], n: usize, rotations: &[Rotation], reflectors: &[Reflector]) -> Vec<Vec<f64>> {
    let m = columns.len();
    let mut y = vec![0.0; n * m];
    for (j, &column) in columns.iter().enumerate() {
        y[column * m + j] = 1.0;
    }
    for r in rotations.iter().rev() {
        let at = r.axis as usize * m;
        let (upper, lower) = y[at..at + 2 * m].split_at_mut(m);
        for (a, b) in upper.iter_mut().zip(lower) {
            (*a, *b) = (r.c * *a + r.s * *b, r.c * *b - r.s * *a);
        }
    }
    let mut vectors: Vec<Vec<f64>> = (0..m).map(|j| (0..n).map(|i| y[i * m + j]).collect()).collect();
    for v in &mut vectors {
        for h in reflectors.iter().rev() {
            let part = &mut v[h.first..];
            let t = dot(part, &h.v);
            part.iter_mut().zip(&h.v).for_each(|(x, h)| *x -= t * h);
        }
        let largest = v.iter().fold(0.0f64, |best, &x| if x.abs() > best.abs() { x } else { best });
        if largest < 0.0 {
            v.iter_mut().for_each(|x| *x = -*x);
        }
    }
    vectors
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::rng::Key;

    fn random_symmetric(n: usize, rank: usize) -> Vec<f64> {
        let key = Key::new(5).with(n as u64);
        let x: Vec<f64> = (0..n * rank).map(|i| key.unit(i as u64) - 0.5).collect();
        let mut a = vec![0.0; n * n];
        for i in 0..n {
            for j in 0..n {
                a[i * n + j] = (0..rank).map(|r| x[i * rank + r] * x[j * rank + r]).sum();
            }
        }
        a
    }

    /// Largest |A v - lambda v| and largest departure of the vectors from orthonormality.
    fn residuals(a: &[f64], n: usize, e: &Eigen) -> (f64, f64) {
        let (mut residual, mut skew) = (0.0f64, 0.0f64);
        for (i, v) in e.vectors.iter().enumerate() {
            for r in 0..n {
                residual = residual.max((dot(&a[r * n..(r + 1) * n], v) - e.values[i] * v[r]).abs());
            }
            for (j, w) in e.vectors.iter().enumerate() {
                skew = skew.max((dot(v, w) - f64::from(u8::from(i == j))).abs());
            }
        }
        (residual, skew)
    }

    #[test]
    fn two_by_two_by_hand() {
        let e = symmetric(vec![2.0, 1.0, 1.0, 2.0], 2, |_| 2);
        assert!((e.values[0] - 3.0).abs() < 1e-15 && (e.values[1] - 1.0).abs() < 1e-15, "{:?}", e.values);
        let h = 0.5f64.sqrt();
        assert!((e.vectors[0][0] - h).abs() < 1e-15 && (e.vectors[0][1] - h).abs() < 1e-15);
        assert!((e.vectors[1][0] + e.vectors[1][1]).abs() < 1e-15);
    }

    #[test]
    fn vectors_solve_the_equation_for_full_and_deficient_rank() {
        for (n, rank) in [(1, 1), (2, 2), (3, 1), (5, 5), (40, 40), (150, 20), (300, 300)] {
            let a = random_symmetric(n, rank);
            let e = symmetric(a.clone(), n, |_| n);
            let (residual, skew) = residuals(&a, n, &e);
            assert!(residual < 1e-11 * e.values[0].max(1.0) && skew < 1e-11, "n {n} rank {rank}: {residual} {skew}");
            let trace: f64 = (0..n).map(|i| a[i * n + i]).sum();
            assert!((trace - e.values.iter().sum::<f64>()).abs() < 1e-10 * trace);
            assert!(e.values.windows(2).all(|w| w[0] >= w[1]));
            assert!(e.values[rank.min(n - 1)..].iter().skip(usize::from(rank == n)).all(|v| v.abs() < 1e-10));
        }
    }

    #[test]
    fn known_spectrum_of_the_path_laplacian() {
        // Eigenvalues 2 - 2 cos(pi j / n), j = 0..n.
        let n = 64;
        let mut a = vec![0.0; n * n];
        for i in 0..n - 1 {
            for (r, c, v) in [(i, i, 1.0), (i + 1, i + 1, 1.0), (i, i + 1, -1.0), (i + 1, i, -1.0)] {
                a[r * n + c] += v;
            }
        }
        let e = symmetric(a, n, |_| 0);
        for (j, v) in e.values.iter().rev().enumerate() {
            let want = 2.0 - 2.0 * crate::numerics::det::cos(std::f64::consts::PI * j as f64 / n as f64);
            assert!((v - want).abs() < 1e-13, "{j}: {v} {want}");
        }
    }

    #[test]
    fn degenerate_matrices_give_finite_answers() {
        let zero = symmetric(vec![0.0; 9], 3, |_| 3);
        assert_eq!(zero.values, [0.0; 3]);
        let identity = symmetric(vec![1e200, 0.0, 0.0, 1e200], 2, |_| 2);
        assert_eq!(identity.values, [1e200; 2]);
        assert_eq!(identity.vectors, [[1.0, 0.0], [0.0, 1.0]]);
        let rank_one = symmetric(vec![1.0; 16], 4, |_| 4);
        assert!((rank_one.values[0] - 4.0).abs() < 1e-14 && rank_one.values[1..].iter().all(|v| v.abs() < 1e-14));
    }

    #[test]
    fn same_bits_for_any_thread_count() {
        let a = random_symmetric(300, 300);
        let run = |jobs| par::install(jobs, || symmetric(a.clone(), 300, |_| 20));
        assert_eq!(run(1), run(3));
    }
}
