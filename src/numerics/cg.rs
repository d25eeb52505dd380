//! Preconditioned conjugate gradients for Hermitian positive definite matrices, in a fixed order of operations.
//!
//! Source: Hestenes, Stiefel 1952; Saad, Iterative Methods for Sparse Linear Systems, algorithm 9.1.

use super::csr::{Complex, Csr};
use super::par;

/// When to stop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stop {
    /// Length of the residual relative to that of the right-hand side.
    pub tolerance: f64,
    /// Most iterations.
    pub iterations: usize,
}

/// How a solve ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outcome {
    /// Iterations made.
    pub iterations: usize,
    /// Length of the residual relative to that of the right-hand side (0 for a right-hand side of zero).
    pub residual: f64,
}

/// The inner product, conjugate-linear in `a`: sums over fixed chunks, folded in order.
pub fn dot(a: &[Complex], b: &[Complex]) -> Complex {
    let part =
        |r: std::ops::Range<usize>| a[r.clone()].iter().zip(&b[r]).fold(Complex::ZERO, |s, (x, y)| s + x.conj() * *y);
    par::map_chunks(a.len().min(b.len()), 8192, part).into_iter().fold(Complex::ZERO, |s, p| s + p)
}

/// `y = s y + x`.
fn scale_add(y: &mut [Complex], s: f64, x: &[Complex]) {
    y.iter_mut().zip(x).for_each(|(y, x)| *y = *y * s + *x);
}

/// `y += s x`.
fn add_scaled(y: &mut [Complex], s: f64, x: &[Complex]) {
    y.iter_mut().zip(x).for_each(|(y, x)| *y += *x * s);
}

/// Solves `A x = b` from the starting value in `x`. `precondition(r, z)` writes into `z` the product of `r` with an
/// approximate inverse of A, Hermitian positive definite. Stops early, with what it has, where arithmetic breaks down
/// (A is not positive definite).
pub fn solve(
    a: &Csr,
    b: &[Complex],
    x: &mut [Complex],
    mut precondition: impl FnMut(&[Complex], &mut [Complex]),
    stop: Stop,
) -> Outcome {
    let n = b.len();
    let scale = dot(b, b).re.sqrt();
    let mut r = vec![Complex::ZERO; n];
    a.multiply(x, &mut r);
    r.iter_mut().zip(b).for_each(|(r, b)| *r = *b - *r);
    let mut residual = dot(&r, &r).re.sqrt();
    let goal = stop.tolerance * scale;
    let (mut z, mut p, mut ap) = (vec![Complex::ZERO; n], vec![Complex::ZERO; n], vec![Complex::ZERO; n]);
    let (mut rz, mut iterations) = (0.0, 0);
    while residual > goal && iterations < stop.iterations {
        precondition(&r, &mut z);
        let next = dot(&r, &z).re;
        scale_add(&mut p, if iterations == 0 { 0.0 } else { next / rz }, &z);
        rz = next;
        a.multiply(&p, &mut ap);
        let curvature = dot(&p, &ap).re;
        if !(curvature > 0.0 && rz > 0.0 && (rz / curvature).is_finite()) {
            break;
        }
        let step = rz / curvature;
        add_scaled(x, step, &p);
        add_scaled(&mut r, -step, &ap);
        residual = dot(&r, &r).re.sqrt();
        iterations += 1;
    }
    Outcome { iterations, residual: if scale > 0.0 { residual / scale } else { 0.0 } }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::csr::complex;

    #[test]
    fn solves_a_small_hermitian_system_in_as_many_steps_as_unknowns() {
        let rows = [
            [complex(4., 0.), complex(1., 1.), Complex::ZERO],
            [complex(1., -1.), complex(3., 0.), complex(0., -1.)],
            [Complex::ZERO, complex(0., 1.), complex(2., 0.)],
        ];
        let a = Csr::from_rows(3, 3, |i, e| e.extend((0..3).map(|c| (c as u32, rows[i][c]))));
        let want = [complex(1., 2.), complex(-1., 0.5), complex(3., -2.)];
        let mut b = [Complex::ZERO; 3];
        a.multiply(&want, &mut b);
        let mut x = [Complex::ZERO; 3];
        let out = solve(&a, &b, &mut x, |r, z| z.copy_from_slice(r), Stop { tolerance: 1e-12, iterations: 9 });
        assert!(out.iterations <= 4 && out.residual < 1e-12, "{out:?}");
        assert!(x.iter().zip(&want).all(|(a, b)| (*a - *b).norm2() < 1e-20));
    }

    #[test]
    fn a_matrix_that_is_not_positive_definite_ends_the_solve() {
        let a = Csr::from_rows(2, 2, |i, e| e.push((i as u32, complex(-1.0, 0.0))));
        let mut x = [Complex::ZERO; 2];
        let b = [Complex::ONE; 2];
        let out = solve(&a, &b, &mut x, |r, z| z.copy_from_slice(r), Stop { tolerance: 1e-9, iterations: 9 });
        assert_eq!((out.iterations, out.residual, x), (0, 1.0, [Complex::ZERO; 2]));
    }
}
