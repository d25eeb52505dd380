//! Sliced Wasserstein distance between the patches of two sets of images.
//!
//! Source: Karras et al., "Progressive Growing of GANs" (2018), section 5. Unaware of: what is a sample.

use super::{Corner, Image, draw};
use crate::numerics::rng::Key;
use crate::numerics::{det, par};
use std::f64::consts::TAU;

/// Side of a patch.
pub(super) const PATCH: usize = 7;
const LEVELS: usize = 3;
/// Patches per level.
const PATCHES: usize = 2048;
const DIRECTIONS: usize = 64;
/// Values of a patch, padded to whole lanes.
const VALUES: usize = PATCH * PATCH * 3;
const LANES: usize = 8;
const STRIDE: usize = VALUES.next_multiple_of(LANES);

/// One level of a pyramid.
struct Level {
    width: usize,
    height: usize,
    texels: Vec<[f32; 3]>,
}

/// The mean over the levels, x1000; `None` if nothing can be compared.
pub(super) fn distance(samples: &[Image], output: &[Image], keep: impl Fn(Corner) -> bool) -> Option<f64> {
    let pyramid = |image: &Image| laplacian(image);
    let a: Vec<Vec<Level>> = samples.iter().map(pyramid).collect();
    let b: Vec<Vec<Level>> = output.iter().map(pyramid).collect();
    let mut distances = Vec::new();
    for level in 0..LEVELS {
        let shape = |pyramids: &[Vec<Level>]| -> Vec<Image> {
            let of = |l: &Level| Image { width: l.width, height: l.height, texels: Vec::new() };
            pyramids.iter().map(|p| of(&p[level])).collect()
        };
        // Flatness is a matter of the finest level.
        let at = |v: usize, side: usize| (v << level).min(side - PATCH);
        let keep = |(i, x, y): Corner| keep((i, at(x, output[i].width), at(y, output[i].height)));
        let at_b = draw(&shape(&b), PATCH, PATCHES, keep);
        let at_a = draw(&shape(&a), PATCH, PATCHES, |_| true);
        // As many of both, spread over all.
        let count = at_a.len().min(at_b.len());
        if count == 0 {
            continue;
        }
        let thinned = |all: &[Corner]| -> Vec<Corner> { (0..count).map(|i| all[i * all.len() / count]).collect() };
        let of = |pyramids: &[Vec<Level>], at: &[Corner]| {
            let one = |c: &Corner| patch(&pyramids[c.0][level], (c.1, c.2));
            thinned(at).iter().flat_map(one).collect::<Vec<f32>>()
        };
        distances.push(sliced(&of(&a, &at_a), &of(&b, &at_b)));
    }
    (!distances.is_empty()).then(|| distances.iter().sum::<f64>() / distances.len() as f64 * 1000.0)
}

/// The values of a patch, padded with zeros.
fn patch(level: &Level, (x, y): (usize, usize)) -> [f32; STRIDE] {
    let mut out = [0.0; STRIDE];
    for dy in 0..PATCH {
        let row = &level.texels[(y + dy) * level.width + x..][..PATCH];
        out[dy * PATCH * 3..][..PATCH * 3].copy_from_slice(row.as_flattened());
    }
    out
}

/// Mean distance of sorted projections, in standard deviations of the first set.
fn sliced(a: &[f32], b: &[f32]) -> f64 {
    let count = a.len() / STRIDE;
    let values = (count * VALUES) as f64;
    let mean = a.iter().map(|v| f64::from(*v)).sum::<f64>() / values;
    let squares = a.iter().map(|v| f64::from(*v) * f64::from(*v)).sum::<f64>() / values;
    let deviation = (squares - mean * mean).max(0.0).sqrt() + 1e-9;
    let axes = par::map_chunks(DIRECTIONS, 4, |axes| {
        let one = |axis: usize| {
            let axis = direction(axis);
            let (a, b) = (projected(a, &axis), projected(b, &axis));
            a.iter().zip(&b).map(|(a, b)| f64::from((a - b).abs())).sum::<f64>()
        };
        axes.map(one).sum::<f64>()
    });
    axes.into_iter().sum::<f64>() / (count * DIRECTIONS) as f64 / deviation
}

/// Patches along an axis, sorted.
fn projected(patches: &[f32], axis: &[f32; STRIDE]) -> Vec<f32> {
    let mut out: Vec<f32> = patches.chunks_exact(STRIDE).map(|patch| dot(patch, axis)).collect();
    out.sort_unstable_by(f32::total_cmp);
    out
}

/// Lanes are summed apart, so that the order of the sum is fixed and the work is not.
fn dot(a: &[f32], b: &[f32; STRIDE]) -> f32 {
    let mut lanes = [0.0f32; LANES];
    for (a, b) in a.chunks_exact(LANES).zip(b.chunks_exact(LANES)) {
        for i in 0..LANES {
            lanes[i] += a[i] * b[i];
        }
    }
    lanes.iter().sum()
}

/// A direction of length one, even over the sphere; padding is zero.
fn direction(axis: usize) -> [f32; STRIDE] {
    let key = Key::new(0).with_str("directions").with(axis as u64);
    // Box and Muller; 1 - u is never zero.
    let normal = |i: u64| (-2.0 * det::ln(1.0 - key.unit(2 * i))).sqrt() * det::cos(TAU * key.unit(2 * i + 1));
    let values: Vec<f64> = (0..VALUES as u64).map(normal).collect();
    let length = values.iter().map(|v| v * v).sum::<f64>().sqrt();
    let mut out = [0.0; STRIDE];
    out.iter_mut().zip(&values).for_each(|(out, v)| *out = (v / length) as f32);
    out
}

/// Band-pass levels, finest first; the last is what is left. As small images have few levels, none is smaller than a patch.
fn laplacian(image: &Image) -> Vec<Level> {
    let texels = image.texels.iter().map(|t| t.map(f32::from)).collect();
    let mut rest = Level { width: image.width, height: image.height, texels };
    let mut out = Vec::new();
    for _ in 1..LEVELS {
        let low = halved(&rest);
        let up = blurred(&Level {
            width: rest.width,
            height: rest.height,
            texels: (0..rest.width * rest.height)
                .map(|i| low.texels[i / rest.width / 2 * low.width + i % rest.width / 2])
                .collect(),
        });
        let band = rest.texels.iter().zip(&up.texels).map(|(a, b)| [0, 1, 2].map(|c| a[c] - b[c])).collect();
        out.push(Level { width: rest.width, height: rest.height, texels: band });
        rest = low;
    }
    out.push(rest);
    out
}

/// Every other texel of the blurred level.
fn halved(level: &Level) -> Level {
    let fine = blurred(level);
    let (width, height) = (level.width.div_ceil(2), level.height.div_ceil(2));
    let texels = (0..width * height).map(|i| fine.texels[i / width * 2 * level.width + i % width * 2]).collect();
    Level { width, height, texels }
}

/// By a Gaussian of one texel; borders are mirrored.
fn blurred(level: &Level) -> Level {
    let kernel: Vec<f64> = (-4i32..=4).map(|x| det::exp(-f64::from(x * x) / 2.0)).collect();
    let sum: f64 = kernel.iter().sum();
    let kernel: Vec<f32> = kernel.iter().map(|k| (k / sum) as f32).collect();
    let mirrored = |at: usize, i: usize, n: usize| {
        let at = (at + i) as i64 - 4;
        let at = at.rem_euclid(2 * n as i64) as usize;
        if at < n { at } else { 2 * n - 1 - at }
    };
    let pass = |source: &[[f32; 3]], along: &dyn Fn(usize, usize) -> usize| -> Vec<[f32; 3]> {
        let one = |i: usize| {
            let mut sum = [0.0f32; 3];
            for (k, weight) in kernel.iter().enumerate() {
                let v = source[along(i, k)];
                sum = [0, 1, 2].map(|c| sum[c] + weight * v[c]);
            }
            sum
        };
        (0..source.len()).map(one).collect()
    };
    let (w, h) = (level.width, level.height);
    let across = pass(&level.texels, &|i, k| i / w * w + mirrored(i % w, k, w));
    let texels = pass(&across, &|i, k| mirrored(i / w, k, h) * w + i % w);
    Level { width: w, height: h, texels }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_are_of_length_one_and_even() {
        let mut mean = [0.0; STRIDE];
        for axis in (0..DIRECTIONS).map(direction) {
            assert!((dot(&axis, &axis) - 1.0).abs() < 1e-5);
            mean.iter_mut().zip(axis).for_each(|(m, v)| *m += v / DIRECTIONS as f32);
        }
        assert!(dot(&mean, &mean) < 0.02, "they point everywhere");
    }

    #[test]
    fn a_pyramid_adds_up_and_a_flat_image_has_no_bands() {
        let flat = Image { width: 21, height: 16, texels: vec![[90, 60, 30]; 21 * 16] };
        let levels = laplacian(&flat);
        assert_eq!(levels.iter().map(|l| (l.width, l.height)).collect::<Vec<_>>(), [(21, 16), (11, 8), (6, 4)]);
        assert!(levels[0].texels.iter().flatten().all(|v| v.abs() < 1e-3));
        assert!(levels[2].texels.iter().all(|t| (t[0] - 90.0).abs() < 1e-3));
    }

    #[test]
    fn shifted_values_are_their_shift_apart() {
        // All along one axis: the distance of two sets that differ by a constant is that constant.
        let set = |by: f32| -> Vec<f32> {
            (0..200)
                .flat_map(|i| {
                    let mut p = [0.0; STRIDE];
                    p[..VALUES].fill(i as f32 + by);
                    p
                })
                .collect()
        };
        assert_eq!(sliced(&set(0.0), &set(0.0)), 0.0);
        let (near, far) = (sliced(&set(0.0), &set(1.0)), sliced(&set(0.0), &set(2.0)));
        assert!(near > 0.0 && (far / near - 2.0).abs() < 0.01, "{near} {far}");
    }
}
