//! Principal component analysis: the few directions that hold most of a point set's variance.
//!
//! Source: \[ZG02\] section 2.1. Means are sums in f64 over all samples in their order, covariances sums in f64 of the f32
//! sums of runs of samples, whatever the number of threads.
//! Unaware of: what the samples are.

use super::{eigen, par};
use wide::f32x8;

/// The mean of a point set and its leading principal directions.
#[derive(Clone, Debug, PartialEq)]
pub struct Pca {
    /// Mean of the samples.
    pub mean: Vec<f64>,
    /// Unit directions, largest variance first; at least one.
    pub basis: Vec<Vec<f64>>,
    /// Share of the total variance along `basis`, 0..=1; 1 if there is no variance at all.
    pub kept_variance: f64,
}

/// Rows of the covariance matrix per parallel task.
const ROWS_PER_TASK: usize = 16;

/// Rows of the covariance matrix that are summed at a time, in registers.
const TILE: usize = 4;

/// Columns that are summed at a time.
const LANES: usize = 8;

/// Samples whose products are summed in f32 before they go to the sums in f64.
const RUN: usize = 64;

/// Directions of less than this share of the total variance are rounding noise and never kept.
const NOISE: f64 = 1e-7;

/// Finds the least number of directions that hold at least `variance` (0..=1) of the variance of `samples`, rows of
/// `dims` finite values. Panics if there is no sample or the rows are not whole.
pub fn fit(samples: &[f32], dims: usize, variance: f64) -> Pca {
    fit_up_to(samples, dims, variance, dims)
}

/// As [`fit`], but at most `most` directions (one, if that is zero).
pub fn fit_up_to(samples: &[f32], dims: usize, variance: f64, most: usize) -> Pca {
    assert!(dims > 0 && !samples.is_empty() && samples.len().is_multiple_of(dims), "whole samples");
    let count = samples.len() / dims;
    let mut mean = vec![0.0; dims];
    for sample in samples.chunks_exact(dims) {
        mean.iter_mut().zip(sample).for_each(|(m, v)| *m += f64::from(*v));
    }
    mean.iter_mut().for_each(|m| *m /= count as f64);

    let covariance = covariance(samples, &mean);
    let total: f64 = (0..dims).map(|i| covariance[i * dims + i]).sum();
    let mut kept = 0.0;
    let eigen = eigen::symmetric(covariance, dims, |values| {
        let mut n = 0;
        while n < dims.min(most.max(1)) && kept < variance * total && values[n] > NOISE * total {
            kept += values[n];
            n += 1;
        }
        n.max(1)
    });
    let kept_variance = if total > 0.0 { (kept / total).min(1.0) } else { 1.0 };
    Pca { mean, basis: eigen.vectors, kept_variance }
}

/// Covariance matrix of the samples about `mean`.
fn covariance(samples: &[f32], mean: &[f64]) -> Vec<f64> {
    let dims = mean.len();
    let count = samples.len() / dims;
    let stride = dims.next_multiple_of(LANES);
    let mut centred = vec![0.0f32; count * stride];
    par::for_rows(&mut centred, RUN * stride, |task, rows| {
        let from = samples[task * RUN * dims..].chunks_exact(dims);
        for (row, sample) in rows.chunks_exact_mut(stride).zip(from) {
            row.iter_mut().zip(sample).zip(mean).for_each(|((c, v), m)| *c = (f64::from(*v) - m) as f32);
        }
    });
    // Each task owns some rows of the lower triangle and walks all samples: nothing to be folded afterwards.
    let blocks = par::map_chunks(dims, ROWS_PER_TASK, |r| {
        let width = r.end.next_multiple_of(LANES);
        let mut sums = vec![0.0f64; ROWS_PER_TASK * width];
        for run in centred.chunks(RUN * stride) {
            for (strip, i) in sums.chunks_exact_mut(TILE * width).zip(r.clone().step_by(TILE)) {
                for j in (0..width).step_by(LANES) {
                    for (row, products) in strip.chunks_exact_mut(width).zip(tile(run, stride, i, j)) {
                        row[j..j + LANES].iter_mut().zip(products.to_array()).for_each(|(s, p)| *s += f64::from(p));
                    }
                }
            }
        }
        sums
    });
    let mut matrix = vec![0.0; dims * dims];
    for (b, sums) in blocks.iter().enumerate() {
        let first = b * ROWS_PER_TASK;
        for (i, row) in (first..dims).zip(sums.chunks_exact(sums.len() / ROWS_PER_TASK)) {
            for (j, s) in row.iter().enumerate().take(i + 1) {
                matrix[i * dims + j] = s / count as f64;
                matrix[j * dims + i] = s / count as f64;
            }
        }
    }
    matrix
}

/// Sums over a run of samples, rows of `stride` values: of components `i..i + TILE` times components `j..j + LANES`.
fn tile(run: &[f32], stride: usize, i: usize, j: usize) -> [f32x8; TILE] {
    let mut sums = [f32x8::ZERO; TILE];
    for sample in run.chunks_exact(stride) {
        if let (Some(a), Some(b)) = (sample[i..].first_chunk::<TILE>(), sample[j..].first_chunk::<LANES>()) {
            let b = f32x8::new(*b);
            sums.iter_mut().zip(a).for_each(|(s, a)| *s += f32x8::splat(*a) * b);
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::rng::Key;

    #[test]
    fn points_on_a_line_have_one_direction() {
        let samples: Vec<f32> = (0..10).flat_map(|i| [i as f32 * 3.0, 7.0, i as f32 * 4.0]).collect();
        let pca = fit(&samples, 3, 1.0);
        assert_eq!(pca.basis.len(), 1);
        assert!((pca.basis[0][0] - 0.6).abs() < 1e-12 && (pca.basis[0][2] - 0.8).abs() < 1e-12);
        assert_eq!(pca.mean, [13.5, 7.0, 18.0]);
        assert!((pca.kept_variance - 1.0).abs() < 1e-12);
    }

    #[test]
    fn equal_points_keep_one_direction_and_all_of_nothing() {
        let pca = fit(&[0.3; 12], 4, 0.97);
        assert_eq!((pca.basis.len(), pca.kept_variance), (1, 1.0));
    }

    #[test]
    fn keeps_the_least_number_of_directions() {
        // Independent axes with variances 16 : 4 : 1, of a total 21.
        let key = Key::new(9);
        let samples: Vec<f32> =
            (0..30_000).flat_map(|i| [4.0, 2.0, 1.0].map(|s| s * (key.with(i).unit(s as u64) as f32 - 0.5))).collect();
        for (variance, want) in [(0.5, 1), (0.75, 1), (0.8, 2), (0.94, 2), (0.97, 3)] {
            let pca = fit(&samples, 3, variance);
            assert_eq!(pca.basis.len(), want, "{variance}");
            assert!(pca.kept_variance >= variance);
        }
        let two = fit_up_to(&samples, 3, 1.0, 2);
        assert_eq!(two.basis.len(), 2);
        assert!((two.kept_variance - 20.0 / 21.0).abs() < 0.01);
    }

    #[test]
    fn covariance_is_the_naive_one_for_any_thread_count() {
        let (dims, count) = (37, 303);
        let key = Key::new(2);
        let samples: Vec<f32> = (0..dims * count).map(|i| key.unit(i as u64) as f32).collect();
        let mean = vec![0.5; dims];
        let run = |jobs| par::install(jobs, || covariance(&samples, &mean));
        let c = run(1);
        assert_eq!(c, run(4));
        for (i, j) in [(0, 0), (5, 3), (3, 5), (36, 0), (36, 36), (16, 15)] {
            let row = |d: usize| samples.chunks_exact(dims).map(move |s| f64::from(s[d]) - 0.5);
            let want = row(i).zip(row(j)).map(|(a, b)| a * b).sum::<f64>() / count as f64;
            assert!((c[i * dims + j] - want).abs() < 1e-7, "{i} {j}");
        }
    }
}
