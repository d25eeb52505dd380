//! The filter bank of Leung and Malik, the alternative to plain windows.
//!
//! Source: Leung, Malik: Representing and recognizing the visual appearance of materials using 3D textons (2001), section
//! 3.1, named in \[MK03\] 3.1: 48 filters, that is first and second derivatives of elongated Gaussians at six
//! orientations and three scales, eight Laplacians of Gaussians and four Gaussians.
//! Reads as: their scales are 1, sqrt 2, 2 texels with an elongation of three. Here they are multiplied by window / 11, so
//! that the window's side scales the bank as it scales the plain window. Each filter is cut to the bank's square, its
//! mean removed (but for Gaussians) and its absolute values made to sum to one.
//! Unaware of: images.

use crate::numerics::det;
use std::f64::consts::PI;

/// The scale of the largest blob, in units of the smallest.
const LARGEST: f64 = 2.0 * std::f64::consts::SQRT_2;

/// Texels by which the bank reaches around its centre.
pub(super) fn radius(window: u32) -> u32 {
    // Three standard deviations of the longest derivative are 18 texels; at 15 a hundredth of it is left out.
    (f64::from(window) * 15.0 / 11.0).round() as u32
}

/// The filters, each a square of side `2 * radius + 1`, row by row.
pub(super) fn bank(window: u32) -> Vec<Vec<f32>> {
    let unit = f64::from(window) / 11.0;
    let r = radius(window) as i32;
    let square = |f: &dyn Fn(f64, f64) -> f64| -> Vec<f64> {
        (-r..=r).flat_map(|y| (-r..=r).map(move |x| (x, y))).map(|(x, y)| f(f64::from(x), f64::from(y))).collect()
    };
    let gauss = |t: f64, s: f64| det::exp(-t * t / (2.0 * s * s)) / s;
    let scales = [1.0, std::f64::consts::SQRT_2, 2.0].map(|s| s * unit);
    let mut out = Vec::with_capacity(48);
    for order in [1, 2] {
        for s in scales {
            for turn in 0..6 {
                let (sin, cos) = det::sin_cos(PI * f64::from(turn) / 6.0);
                let value = |x: f64, y: f64| {
                    let (along, across) = (x * cos + y * sin, y * cos - x * sin);
                    let derivative = match order {
                        1 => -across / (s * s),
                        _ => (across * across - s * s) / (s * s * s * s),
                    };
                    gauss(along, 3.0 * s) * gauss(across, s) * derivative
                };
                out.push(normalised(square(&value), true));
            }
        }
    }
    let blobs = [scales[0], scales[1], scales[2], LARGEST * unit];
    for s in blobs.into_iter().chain(blobs.map(|s| 3.0 * s)) {
        let value = |x: f64, y: f64| {
            let d2 = x * x + y * y;
            (d2 - 2.0 * s * s) * det::exp(-d2 / (2.0 * s * s))
        };
        out.push(normalised(square(&value), true));
    }
    for s in blobs {
        out.push(normalised(square(&|x, y| gauss(x, s) * gauss(y, s)), false));
    }
    out
}

fn normalised(mut kernel: Vec<f64>, balance: bool) -> Vec<f32> {
    if balance {
        let mean = kernel.iter().sum::<f64>() / kernel.len() as f64;
        kernel.iter_mut().for_each(|v| *v -= mean);
    }
    let sum = kernel.iter().map(|v| v.abs()).sum::<f64>().max(f64::MIN_POSITIVE);
    kernel.iter().map(|v| (v / sum) as f32).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_are_48_filters_and_only_four_see_a_constant() {
        for window in [3, 11, 21] {
            let bank = bank(window);
            let side = 2 * radius(window) as usize + 1;
            assert_eq!(bank.len(), 48);
            assert!(bank.iter().all(|k| k.len() == side * side));
            let sums: Vec<f32> = bank.iter().map(|k| k.iter().sum()).collect();
            assert!(sums[..44].iter().all(|s| s.abs() < 1e-4) && sums[44..].iter().all(|s| (s - 1.0).abs() < 1e-4));
        }
    }

    #[test]
    fn a_first_derivative_sees_the_edge_along_it() {
        let (bank, r) = (bank(11), radius(11) as i32);
        // Dark above, light below: an edge along x, which is orientation 0.
        let response = |k: &Vec<f32>| -> f32 {
            k.iter().enumerate().map(|(i, v)| if i as i32 / (2 * r + 1) > r { *v } else { 0.0 }).sum()
        };
        let seen: Vec<f32> = bank[..6].iter().map(|k| response(k).abs()).collect();
        assert!(seen[0] > 0.4 && seen[3] < 1e-3, "{seen:?}");
    }
}
