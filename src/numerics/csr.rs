//! Sparse matrices of complex numbers in compressed rows.
//!
//! Complex because a tangent vector is one complex number in the basis of its vertex, and carrying it to a neighbour is
//! a multiplication; real problems set the imaginary parts to zero. Rows are sorted by column without repeats.

use std::ops::{Add, AddAssign, Mul, Neg, Sub, SubAssign};

use super::par;

/// A complex number, f64.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Complex {
    /// Real part.
    pub re: f64,
    /// Imaginary part.
    pub im: f64,
}

/// Builds a [`Complex`].
pub const fn complex(re: f64, im: f64) -> Complex {
    Complex { re, im }
}

impl Complex {
    /// 0.
    pub const ZERO: Complex = complex(0.0, 0.0);
    /// 1.
    pub const ONE: Complex = complex(1.0, 0.0);

    /// The complex conjugate.
    pub fn conj(self) -> Self {
        complex(self.re, -self.im)
    }

    /// The square of the absolute value.
    pub fn norm2(self) -> f64 {
        self.re * self.re + self.im * self.im
    }

    /// The number of absolute value 1 in the same direction; `None` for zero, subnormal and not finite absolute values.
    pub fn unit(self) -> Option<Self> {
        // Scaled first, so that the squares of small numbers do not vanish.
        let m = self.re.abs().max(self.im.abs());
        if !m.is_normal() {
            return None;
        }
        let s = complex(self.re / m, self.im / m);
        Some(s * (1.0 / s.norm2().sqrt()))
    }

    /// The n-th power by repeated multiplication, n >= 1.
    pub fn power(self, n: u32) -> Self {
        (1..n).fold(self, |z, _| z * self)
    }
}

impl Add for Complex {
    type Output = Complex;
    fn add(self, o: Complex) -> Complex {
        complex(self.re + o.re, self.im + o.im)
    }
}
impl Sub for Complex {
    type Output = Complex;
    fn sub(self, o: Complex) -> Complex {
        complex(self.re - o.re, self.im - o.im)
    }
}
impl Neg for Complex {
    type Output = Complex;
    fn neg(self) -> Complex {
        complex(-self.re, -self.im)
    }
}
impl Mul for Complex {
    type Output = Complex;
    fn mul(self, o: Complex) -> Complex {
        complex(self.re * o.re - self.im * o.im, self.re * o.im + self.im * o.re)
    }
}
impl Mul<f64> for Complex {
    type Output = Complex;
    fn mul(self, s: f64) -> Complex {
        complex(self.re * s, self.im * s)
    }
}
impl AddAssign for Complex {
    fn add_assign(&mut self, o: Complex) {
        *self = *self + o;
    }
}
impl SubAssign for Complex {
    fn sub_assign(&mut self, o: Complex) {
        *self = *self - o;
    }
}

/// A sparse matrix in compressed rows.
#[derive(Clone, Debug, PartialEq)]
pub struct Csr {
    columns: usize,
    starts: Vec<usize>,
    cols: Vec<u32>,
    values: Vec<Complex>,
}

impl Csr {
    /// Builds row by row: `row(i, &mut entries)` appends the entries (column, value) of row `i`, in any order and
    /// without repeats. Panics on a column outside.
    pub fn from_rows(rows: usize, columns: usize, mut row: impl FnMut(usize, &mut Vec<(u32, Complex)>)) -> Self {
        let (mut starts, mut cols, mut values) = (Vec::with_capacity(rows + 1), vec![], vec![]);
        starts.push(0);
        let mut entries = vec![];
        for i in 0..rows {
            entries.clear();
            row(i, &mut entries);
            entries.sort_unstable_by_key(|&(c, _)| c);
            debug_assert!(entries.windows(2).all(|w| w[0].0 != w[1].0), "a repeated column");
            assert!(entries.last().is_none_or(|&(c, _)| (c as usize) < columns), "a column outside");
            cols.extend(entries.iter().map(|&(c, _)| c));
            values.extend(entries.iter().map(|&(_, v)| v));
            starts.push(cols.len());
        }
        Csr { columns, starts, cols, values }
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.starts.len() - 1
    }

    /// Number of columns.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Number of stored entries.
    pub fn stored(&self) -> usize {
        self.cols.len()
    }

    /// The entries (column, value) of a row, by ascending column.
    pub fn row(&self, i: usize) -> impl Iterator<Item = (usize, Complex)> + '_ {
        let r = self.starts[i]..self.starts[i + 1];
        self.cols[r.clone()].iter().zip(&self.values[r]).map(|(&c, &v)| (c as usize, v))
    }

    /// `out = A x`. Panics if a length does not fit.
    pub fn multiply(&self, x: &[Complex], out: &mut [Complex]) {
        const CHUNK: usize = 2048;
        assert_eq!((x.len(), out.len()), (self.columns, self.rows()));
        par::for_rows(out, CHUNK, |chunk, part| {
            for (k, o) in part.iter_mut().enumerate() {
                *o = self.row(chunk * CHUNK + k).fold(Complex::ZERO, |s, (c, v)| s + v * x[c]);
            }
        });
    }

    /// The conjugate transpose.
    pub fn adjoint(&self) -> Csr {
        let mut starts = vec![0; self.columns + 1];
        for &c in &self.cols {
            starts[c as usize + 1] += 1;
        }
        for i in 0..self.columns {
            starts[i + 1] += starts[i];
        }
        let mut fill = starts.clone();
        let (mut cols, mut values) = (vec![0; self.stored()], vec![Complex::ZERO; self.stored()]);
        for i in 0..self.rows() {
            for (c, v) in self.row(i) {
                cols[fill[c]] = i as u32;
                values[fill[c]] = v.conj();
                fill[c] += 1;
            }
        }
        Csr { columns: self.rows(), starts, cols, values }
    }

    /// The matrix product with `o`, row by row (Gustavson 1978). Panics if the sizes do not fit.
    pub fn product(&self, o: &Csr) -> Csr {
        assert_eq!(self.columns, o.rows());
        let mut sum = vec![Complex::ZERO; o.columns];
        let mut seen = vec![false; o.columns];
        let mut touched: Vec<u32> = vec![];
        Csr::from_rows(self.rows(), o.columns, |i, entries| {
            for (k, a) in self.row(i) {
                for (c, b) in o.row(k) {
                    if !seen[c] {
                        seen[c] = true;
                        touched.push(c as u32);
                    }
                    sum[c] += a * b;
                }
            }
            for c in touched.drain(..) {
                entries.push((c, std::mem::take(&mut sum[c as usize])));
                seen[c as usize] = false;
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::rng::Key;

    fn random(rows: usize, columns: usize, key: Key) -> Csr {
        Csr::from_rows(rows, columns, |i, e| {
            for c in 0..columns {
                let k = key.with((i * columns + c) as u64);
                if k.unit(0) < 0.4 {
                    e.push((c as u32, complex(k.unit(1) - 0.5, k.unit(2) - 0.5)));
                }
            }
            e.reverse();
        })
    }

    fn dense(a: &Csr) -> Vec<Vec<Complex>> {
        (0..a.rows())
            .map(|i| {
                let mut row = vec![Complex::ZERO; a.columns()];
                a.row(i).for_each(|(c, v)| row[c] = v);
                row
            })
            .collect()
    }

    #[test]
    fn products_agree_with_dense_arithmetic() {
        let (a, b) = (random(6, 9, Key::new(1)), random(9, 5, Key::new(2)));
        let (p, da, db) = (dense(&a.product(&b)), dense(&a), dense(&b));
        for i in 0..6 {
            for j in 0..5 {
                let want = (0..9).fold(Complex::ZERO, |s, k| s + da[i][k] * db[k][j]);
                assert!((p[i][j] - want).norm2() < 1e-24);
            }
        }
        let h = dense(&a.adjoint());
        assert!((0..6).all(|i| (0..9).all(|j| h[j][i] == da[i][j].conj())));
        let x: Vec<_> = (0..9).map(|i| complex(i as f64, 1.0)).collect();
        let mut y = vec![Complex::ZERO; 6];
        a.multiply(&x, &mut y);
        assert!((0..6).all(|i| (y[i] - (0..9).fold(Complex::ZERO, |s, k| s + da[i][k] * x[k])).norm2() < 1e-20));
    }

    #[test]
    fn units_survive_tiny_numbers() {
        assert_eq!(complex(0.0, -1e-200).unit(), Some(complex(0.0, -1.0)));
        assert_eq!(Complex::ZERO.unit(), None);
        assert_eq!(complex(f64::NAN, f64::NAN).unit(), None);
        assert_eq!(complex(0.0, 1.0).power(4), Complex::ONE);
    }
}
