//! Feature vectors of texels: what textons are clustered by.
//!
//! Source: \[MK03\] section 3.1: the n x n neighbourhood times a centred Gaussian; as the alternative, a filter bank
//! (`super::texton_filters`). In: the maps that count. Out: points of `numerics::knn`, one per texel, for the sample as it
//! lies and, if wanted, as it looks to someone whose own texture is turned.
//! Reads as: the paper does not say how wide its Gaussian is; a quarter of the window (2.75 texels of 11) leaves a seventh
//! of the weight at the middle of the border. Vectors are reduced to their principal components, at least 98 % of the
//! variance or 48 numbers: distances, which are all that counts, hardly change, and clustering is ten times faster.
//! Colours and normals as in `super::neighbourhood`. Beyond the exemplar lies its mirror image or, if it tiles, itself.
//! Both kinds of features and every rotation are linear in the texels: a vector's components are sums over a square of
//! taps, whose weights are the principal directions, turned.
//! Unaware of: clusters.

use super::neighbourhood::feature_planes;
use super::pyramid::{BLOCK, Pyramid};
use super::texton_filters::{bank, radius};
use crate::numerics::knn::{Points, RANGE};
use crate::numerics::pca::{self, Pca};
use crate::numerics::rng::Key;
use crate::numerics::{det, par};
use crate::texture::{MapKind, MapSet, Wrap};
use std::collections::BTreeMap;
use wide::f32x8;

/// What is clustered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TextonFeatures {
    /// The texels of the window.
    Window,
    /// Responses of a filter bank.
    FilterBank,
}

/// The Gaussian's standard deviation as a share of the window's side.
const SIGMA: f64 = 0.25;
/// Share of the variance that is kept.
const VARIANCE: f64 = 0.98;
/// Most components.
const COMPONENTS: usize = 48;
/// Texels from which the principal directions are found.
const SAMPLES: usize = 4096;
/// Principal directions projected on at once.
const GROUP: usize = 4;
/// Share of the range that the vectors of the unturned sample take: turned ones may be a little longer.
const FILL: f64 = 0.75;

/// The vectors of a sample, ready to be projected in any orientation.
pub(super) struct Features {
    planes: Pyramid,
    /// Kernels of the vectors' components on each plane, of side `2 * radius + 1`.
    radius: i32,
    kernels: Vec<Vec<f32>>,
    pca: Pca,
    scale: f64,
}

impl Features {
    /// Prepares the vectors of checked maps. `window` is odd.
    pub fn new(
        maps: &MapSet,
        importance: &BTreeMap<MapKind, f64>,
        window: u32,
        features: TextonFeatures,
        wrap: Wrap,
        turned: bool,
    ) -> Self {
        let weigh = |kind| importance.get(&kind).copied().unwrap_or(0.0);
        let planes: Vec<Vec<f32>> = maps
            .iter()
            .filter(|(kind, _)| weigh(*kind) > 0.0)
            .flat_map(|(kind, map)| feature_planes(kind, map, weigh(kind).sqrt() as f32))
            .collect();
        let (radius, kernels) = match features {
            TextonFeatures::Window => (window as i32 / 2, window_kernels(window)),
            TextonFeatures::FilterBank => (radius(window) as i32, bank(window)),
        };
        let pad = if turned { turned_radius(radius) } else { radius } as usize;
        let planes = Pyramid::new(planes, maps.width(), maps.height(), 1, pad, wrap);
        let mut out = Features {
            planes,
            radius,
            kernels,
            pca: Pca { mean: vec![], basis: vec![], kept_variance: 1.0 },
            scale: 1.0,
        };
        let samples = out.sample();
        out.pca = pca::fit_up_to(&samples, out.dims(), VARIANCE, COMPONENTS);
        let longest = out
            .project_f32(0.0)
            .chunks_exact(out.components())
            .fold(0.0f32, |m, v| m.max(v.iter().map(|x| x * x).sum()));
        let longest = f64::from(longest).sqrt();
        out.scale = if longest > 0.0 { f64::from(RANGE) * FILL / longest } else { 1.0 };
        out
    }

    /// Components of a vector before the reduction.
    pub fn dims(&self) -> usize {
        self.kernels.len() * self.planes.planes.len()
    }

    /// Components that are kept.
    pub fn components(&self) -> usize {
        self.pca.basis.len()
    }

    /// Share of the variance that they hold, 0..=1.
    pub fn kept_variance(&self) -> f64 {
        self.pca.kept_variance
    }

    /// The vectors as they look in a frame turned by `angle` radians against the sample's (x towards y): offset p there is
    /// offset R(angle) p here.
    pub fn points(&self, angle: f64) -> Points {
        let (values, n) = (self.project_f32(angle), self.components());
        let mut points = Points::new(values.len() / n, n, self.scale);
        let stride = points.stride();
        par::for_rows(points.data_mut(), stride, |i, row| {
            let v = &values[i * n..(i + 1) * n];
            let length = v.iter().map(|x| f64::from(x * x)).sum::<f64>().sqrt() * self.scale;
            // Turned vectors that are far longer than any unturned one are shortened: they are like none anyway.
            let most = f64::from(RANGE) - 8.0;
            let scale = if length > most { self.scale * most / length } else { self.scale };
            row.iter_mut().zip(v).for_each(|(r, x)| *r = (f64::from(*x) * scale).round() as i16);
        });
        points
    }

    /// Vectors of texels drawn one from each of as many runs of texels.
    fn sample(&self) -> Vec<f32> {
        let (w, len) = (self.planes.width, self.planes.width * self.planes.height);
        let (count, key) = (SAMPLES.min(len), Key::new(0).with_str("textons"));
        let side = 2 * self.radius as usize + 1;
        let vector = |i: usize| {
            let (start, end) = (i * len / count, (i + 1) * len / count);
            let texel = start + key.below(i as u64, (end - start) as u32) as usize;
            let at = self.planes.at(texel % w, texel / w) as isize;
            let planes = self.planes.planes.iter();
            let square = planes.map(|p| {
                let rows = (0..side).flat_map(|y| {
                    let from = at + (y as isize - self.radius as isize) * self.planes.stride as isize;
                    &p[(from - self.radius as isize) as usize..][..side]
                });
                rows.copied().collect::<Vec<f32>>()
            });
            let values = square.flat_map(|s| {
                let dot =
                    |k: &Vec<f32>| k.iter().zip(&s).fold(0.0, |sum, (a, b)| if *a == 0.0 { sum } else { sum + a * b });
                self.kernels.iter().map(dot).collect::<Vec<f32>>()
            });
            values.collect::<Vec<f32>>()
        };
        par::map_chunks(count, 64, |r| r.flat_map(vector).collect::<Vec<f32>>()).concat()
    }

    /// The principal directions as kernels on the planes, turned: their radius, and weights by direction, plane, row.
    fn directions(&self, angle: f64) -> (i32, Vec<Vec<f32>>) {
        let taps = self.kernels[0].len();
        let straight = self.pca.basis.iter().map(|b| {
            let mut out = vec![0.0f64; taps * self.planes.planes.len()];
            for (plane, b) in b.chunks_exact(self.kernels.len()).enumerate() {
                for (k, b) in self.kernels.iter().zip(b) {
                    let out = &mut out[plane * taps..(plane + 1) * taps];
                    out.iter_mut().zip(k).filter(|(_, k)| **k != 0.0).for_each(|(o, k)| *o += b * f64::from(*k));
                }
            }
            out
        });
        let straight: Vec<Vec<f64>> = straight.collect();
        if angle == 0.0 {
            let rows = straight.iter().map(|r| r.iter().map(|v| *v as f32).collect());
            return (self.radius, rows.collect());
        }
        let radius = turned_radius(self.radius);
        let turned = par::map_chunks(straight.len(), 1, |r| {
            let kernels = straight[r.start].chunks_exact(taps);
            kernels.flat_map(|k| turn(k, self.radius, radius, angle)).collect::<Vec<f32>>()
        });
        (radius, turned)
    }

    /// Projections of all vectors, texel by texel.
    fn project_f32(&self, angle: f64) -> Vec<f32> {
        let (radius, directions) = self.directions(angle);
        let (n, w, h) = (directions.len(), self.planes.width, self.planes.height);
        let side = 2 * radius as usize + 1;
        // Taps that weigh something in some direction: plane and offset.
        let at = |i: usize| {
            let (x, y) = ((i % side) as isize - radius as isize, (i / side % side) as isize - radius as isize);
            (i / (side * side), y * self.planes.stride as isize + x)
        };
        let used: Vec<usize> = (0..directions[0].len()).filter(|i| directions.iter().any(|d| d[*i] != 0.0)).collect();
        let taps: Vec<(usize, isize)> = used.iter().map(|i| at(*i)).collect();
        let groups: Vec<(Vec<[f32; GROUP]>, [f32; GROUP])> = directions
            .chunks(GROUP)
            .zip(self.pca.basis.chunks(GROUP))
            .map(|(d, b)| {
                let weights = used.iter().map(|i| std::array::from_fn(|j| d.get(j).map_or(0.0, |d| d[*i]))).collect();
                let mean = |b: &Vec<f64>| b.iter().zip(&self.pca.mean).fold(0.0, |s, (b, m)| s + b * m) as f32;
                (weights, std::array::from_fn(|j| b.get(j).map_or(0.0, mean)))
            })
            .collect();
        let mut out = vec![0.0f32; w * h * n];
        par::for_rows(&mut out, w * n, |y, row| {
            for x in (0..w).step_by(BLOCK) {
                let from = self.planes.at(x, y) as isize;
                for (g, (weights, mean)) in groups.iter().enumerate() {
                    let mut sums = mean.map(|m| f32x8::splat(-m));
                    for (&(plane, offset), w) in taps.iter().zip(weights) {
                        let mut v = [0.0; BLOCK];
                        v.copy_from_slice(&self.planes.planes[plane][(from + offset) as usize..][..BLOCK]);
                        let v = f32x8::new(v);
                        sums.iter_mut().zip(w).for_each(|(s, w)| *s += v * f32x8::splat(*w));
                    }
                    for (i, texel) in row[x * n..].chunks_exact_mut(n).take(BLOCK).enumerate() {
                        let sums = sums.iter().map(|s| s.as_array()[i]);
                        texel.iter_mut().skip(g * GROUP).zip(sums).for_each(|(t, s)| *t = s);
                    }
                }
            }
        });
        out
    }
}

/// The window's texels as kernels of one tap each, weighted by the Gaussian.
fn window_kernels(window: u32) -> Vec<Vec<f32>> {
    let r = f64::from(window / 2);
    let sigma = SIGMA * f64::from(window);
    let kernel = |i: u32| {
        let (x, y) = (f64::from(i % window) - r, f64::from(i / window) - r);
        let mut k = vec![0.0; (window * window) as usize];
        k[i as usize] = det::exp(-(x * x + y * y) / (2.0 * sigma * sigma)) as f32;
        k
    };
    (0..window * window).map(kernel).collect()
}

/// Reach of a turned square.
fn turned_radius(radius: i32) -> i32 {
    (f64::from(radius) * std::f64::consts::SQRT_2).ceil() as i32
}

/// A kernel turned by `angle`: the weight of offset p goes to the four texels around R(angle) p, bilinearly.
fn turn(kernel: &[f64], radius: i32, turned: i32, angle: f64) -> Vec<f32> {
    let (sin, cos) = det::sin_cos(angle);
    let (side, wide) = (2 * radius + 1, 2 * turned + 1);
    let mut out = vec![0.0f64; (wide * wide) as usize];
    for (i, v) in kernel.iter().enumerate().filter(|(_, v)| **v != 0.0) {
        let (x, y) = (f64::from(i as i32 % side - radius), f64::from(i as i32 / side - radius));
        // Rounded to 2^-20 texels, so that turns of a quarter hit texels exactly.
        let snap = |v: f64| (v * 1048576.0).round() / 1048576.0;
        let (tx, ty) = (snap(x * cos - y * sin), snap(x * sin + y * cos));
        let (x0, y0) = (tx.floor(), ty.floor());
        let (fx, fy) = (tx - x0, ty - y0);
        for (dx, dy, share) in
            [(0, 0, (1.0 - fx) * (1.0 - fy)), (1, 0, fx * (1.0 - fy)), (0, 1, (1.0 - fx) * fy), (1, 1, fx * fy)]
        {
            if share > 0.0 {
                let at = (y0 as i32 + dy + turned) * wide + x0 as i32 + dx + turned;
                out[at as usize] += v * share;
            }
        }
    }
    out.iter().map(|v| *v as f32).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::texture::Texture;

    fn maps(f: impl Fn(u32, u32) -> f32 + Sync) -> MapSet {
        MapSet::new(vec![(MapKind::Height, Texture::from_fn(24, 20, 1, |x, y, out| out[0] = f(x, y)))])
    }

    fn random(x: u32, y: u32) -> f32 {
        Key::new(4).with(u64::from(x)).unit(u64::from(y)) as f32
    }

    fn features(maps: &MapSet, kind: TextonFeatures) -> Features {
        Features::new(maps, &[(MapKind::Height, 1.0)].into(), 5, kind, Wrap::Repeat, true)
    }

    #[test]
    fn distances_are_those_of_the_windows() {
        let m = maps(random);
        let f = features(&m, TextonFeatures::Window);
        assert_eq!((f.dims(), f.kept_variance() >= 0.98), (25, true));
        let p = f.points(0.0);
        let value = |x: i64, y: i64| {
            f64::from(m.get(MapKind::Height).unwrap().get(x.rem_euclid(24) as u32, y.rem_euclid(20) as u32)[0])
        };
        let weight = |d: i64| det::exp(-(d * d) as f64 / (2.0 * 1.25 * 1.25));
        for (a, b) in [((3, 4), (17, 9)), ((0, 0), (23, 19)), ((5, 5), (6, 5))] {
            let squares = (-2..=2i64).flat_map(|y| (-2..=2i64).map(move |x| (x, y)));
            let truth: f64 = squares
                .map(|(x, y)| {
                    let d = (value(a.0 + x, a.1 + y) - value(b.0 + x, b.1 + y)) * weight(x) * weight(y);
                    d * d
                })
                .sum();
            let index = |(x, y): (i64, i64)| (y * 24 + x) as u32;
            let found = p.length(p.squared_distance(index(a), index(b)));
            assert!((found / truth.sqrt() - 1.0).abs() < 0.05, "{found} {}", truth.sqrt());
        }
    }

    #[test]
    fn a_quarter_turn_sees_what_the_turned_sample_shows() {
        // The sample turned by a quarter: its texel (x, y) shows texel R (x, y) = (-y, x) of the sample, about the origin.
        let straight = maps(|x, y| if x < 20 { random(x, y) } else { 0.5 });
        for kind in [TextonFeatures::Window, TextonFeatures::FilterBank] {
            let f = features(&straight, kind);
            let (a, b) = (f.project_f32(0.0), f.project_f32(std::f64::consts::FRAC_PI_2));
            let n = f.components();
            // A full turn in four steps is no turn.
            let full = f.project_f32(std::f64::consts::TAU);
            assert!(a.iter().zip(&full).all(|(x, y)| (x - y).abs() < 1e-4));
            if kind == TextonFeatures::FilterBank {
                continue;
            }
            let image = |x: i64, y: i64| {
                f64::from(
                    straight.get(MapKind::Height).unwrap().get(x.rem_euclid(24) as u32, y.rem_euclid(20) as u32)[0],
                )
            };
            let (cx, cy) = (9i64, 8i64);
            let g = |x: i64, y: i64| det::exp(-((x * x + y * y) as f64) / (2.0 * 1.25 * 1.25));
            let windows = (-2..=2i64).flat_map(|y| (-2..=2i64).map(move |x| (x, y)));
            let vector: Vec<f64> = windows.map(|(x, y)| g(x, y) * image(cx - y, cy + x)).collect();
            for (j, basis) in f.pca.basis.iter().enumerate() {
                let want: f64 = basis.iter().zip(&vector).zip(&f.pca.mean).map(|((b, v), m)| b * (v - m)).sum();
                let found = f64::from(b[(cy * 24 + cx) as usize * n + j]);
                assert!((found - want).abs() < 1e-4, "{found} {want}");
            }
        }
    }

    #[test]
    fn a_constant_has_no_length() {
        let f = features(&maps(|_, _| 0.25), TextonFeatures::Window);
        let p = f.points(0.3);
        assert!((0..p.len() as u32).all(|i| p.squared_distance(i, 0) == 0));
    }
}
