//! Neighbourhood vectors: what a texel's surroundings look like, on all levels and in all maps that count.
//!
//! Source: \[ZG02\] sections 2.1 and 2.3.
//! In: the maps, their importance, neighbourhood sizes. Out: vectors, and their projection as points of `numerics::knn`.
//! Reads as: the similarity is the plain L2 norm; a map of importance w adds w times its squared differences. Colours
//! are compared in Oklab, where equal distances look about equally different. In linear light the dark half of what the
//! eye tells apart spans a fifth of the range, and mismatches in shade would cost next to nothing. Components of normals
//! are halved, so that every map spans about one unit.
//! Unaware of: how neighbours are found.

use super::fill::fill_holes;
use super::params::AnalysisParams;
use super::pyramid::{BLOCK, Pyramid};
use super::sheet::{Area, Subject};
use crate::numerics::knn::{Points, RANGE};
use crate::numerics::pca::Pca;
use crate::numerics::rng::Key;
use crate::numerics::{det, par};
use crate::texture::{MapKind, MapSet, Texture, color};
use wide::f32x8;

/// Whether colours are compared in Oklab; else as gamma-encoded sRGB.
const OKLAB: bool = true;

/// If set, texels weigh by a Gaussian of this many radii of their window, else all alike.
const FALLOFF: Option<f64> = None;

/// Principal directions that are projected on at once.
const GROUP: usize = 4;

/// One component of a neighbourhood vector: a plane, where in it relative to the texel, and a factor.
struct Tap {
    plane: usize,
    offset: isize,
    weight: f32,
}

/// The neighbourhood vectors of the texels of one sample.
struct Window {
    /// First row in the sheet.
    y: usize,
    pyramid: Pyramid,
    taps: Vec<Tap>,
    /// The sample's texels that belong to the domain, counted row by row.
    members: Vec<u32>,
}

/// The neighbourhood vectors of every texel of an exemplar, sample by sample, row by row.
pub(crate) struct Neighbourhoods {
    windows: Vec<Window>,
}

impl Neighbourhoods {
    /// Prepares the vectors. Expects checked parameters.
    pub(crate) fn new(subject: &Subject, params: &AnalysisParams) -> Self {
        let planes = all_planes(subject.maps, params);
        let width = subject.maps.width() as usize;
        let window = |area: &Area| Window::new(subject, area, params, planes.iter().map(|p| cut(p, width, area)));
        Neighbourhoods { windows: subject.areas.iter().map(window).collect() }
    }

    /// Components of a vector.
    pub(crate) fn dims(&self) -> usize {
        self.windows[0].taps.len()
    }

    /// Number of texels.
    pub(crate) fn len(&self) -> usize {
        self.windows.iter().map(|w| w.members.len()).sum()
    }

    /// The vectors of up to `count` texels, drawn one from each of as many runs of texels: a regular grid would see one
    /// phase of a periodic exemplar.
    pub(crate) fn sample(&self, count: usize) -> Vec<f32> {
        let (len, key) = (self.len(), Key::new(0).with_str("pca"));
        let count = count.min(len);
        let mut samples = Vec::with_capacity(count * self.dims());
        for i in 0..count {
            let (start, end) = (i * len / count, (i + 1) * len / count);
            let mut at = start + key.below(i as u64, (end - start) as u32) as usize;
            for window in &self.windows {
                if let Some(&texel) = window.members.get(at) {
                    window.push_vector(texel as usize, &mut samples);
                    break;
                }
                at -= window.members.len();
            }
        }
        samples
    }

    /// Projects every vector on the principal directions and rounds to integers.
    pub(crate) fn project(&self, pca: &Pca) -> Points {
        // No vector is farther from the mean than the farthest before the projection: scaled by it, none saturates.
        let norms = self.windows.iter().map(|w| w.largest_norm(&pca.mean));
        let radius = f64::from(norms.fold(0.0, f32::max)).sqrt();
        let scale = if radius > 0.0 { f64::from(RANGE) / radius } else { 1.0 };
        let all = self.windows.iter().map(|w| w.pyramid.width * w.pyramid.height).sum();
        let mut points = Points::new(all, pca.basis.len(), scale);
        let (stride, mut first) = (points.stride(), 0);
        let mut belongs = vec![false; all];
        for window in &self.windows {
            let texels = window.pyramid.width * window.pyramid.height;
            let out = &mut points.data_mut()[first * stride..][..texels * stride];
            window.project(pca, scale, stride, out, |v| v.round() as i16);
            window.members.iter().for_each(|m| belongs[first + *m as usize] = true);
            first += texels;
        }
        if belongs.iter().any(|b| !b) {
            points.retain(|i| belongs[i]);
        }
        points
    }

    /// `scale` times the projections of the vectors on the principal directions as a texture of `size`, one channel each;
    /// directions that there are not, and texels that belong to no sample, are zero.
    pub(crate) fn features(&self, pca: &Pca, scale: f64, components: u32, size: (u32, u32)) -> Texture {
        let mut features = Texture::new(size.0, size.1, components);
        let (stride, row) = (components as usize, (size.0 * components) as usize);
        for window in &self.windows {
            let (w, h) = (window.pyramid.width, window.pyramid.height);
            let mut out = vec![0.0; w * h * stride];
            window.project(pca, scale, stride, &mut out, |v| v);
            let rows = features.data_mut()[window.y * row..].chunks_exact_mut(row);
            rows.zip(out.chunks_exact(w * stride)).for_each(|(to, from)| to[..w * stride].copy_from_slice(from));
        }
        features
    }
}

impl Window {
    fn new(subject: &Subject, area: &Area, params: &AnalysisParams, planes: impl Iterator<Item = Vec<f32>>) -> Self {
        let (width, height) = (area.width, area.height);
        let texels = (0..height).flat_map(|y| (0..width).map(move |x| (x as i32, (area.y + y) as i32)));
        let known: Vec<bool> = texels.map(|(x, y)| subject.domain.contains(x, y)).collect();
        let mut planes: Vec<Vec<f32>> = planes.collect();
        if subject.fill {
            planes.iter_mut().for_each(|p| fill_holes(p, &known, width as usize));
        }
        let (channels, levels) = (planes.len(), params.neighbourhoods.len());
        let pyramid = Pyramid::new(planes, width, height, levels, params.reach(), params.wrap);
        let mut taps = Vec::new();
        for (level, &side) in params.neighbourhoods.iter().enumerate() {
            let r = side as isize / 2;
            let around = (-r..=r).flat_map(|dy| (-r..=r).map(move |dx| (dx, dy)));
            for ((dx, dy), weight) in around.zip(tap_weights(side, FALLOFF)) {
                let offset = (dy * pyramid.stride as isize + dx) << level;
                taps.extend((0..channels).map(|c| Tap { plane: level * channels + c, offset, weight }));
            }
        }
        let members = (0..known.len() as u32).filter(|i| known[*i as usize]).collect();
        Window { y: area.y as usize, pyramid, taps, members }
    }

    /// Appends the vector of a texel (counted row by row).
    fn push_vector(&self, texel: usize, out: &mut Vec<f32>) {
        let at = self.pyramid.at(texel % self.pyramid.width, texel / self.pyramid.width) as isize;
        out.extend(self.taps.iter().map(|t| t.weight * self.pyramid.planes[t.plane][(at + t.offset) as usize]));
    }

    /// Writes `scale` times the projections on the principal directions, converted, `stride` values per texel.
    fn project<T: Send>(&self, pca: &Pca, scale: f64, stride: usize, out: &mut [T], convert: impl Fn(f32) -> T + Sync) {
        let width = self.pyramid.width;
        let groups = self.weights(pca, scale);
        par::for_rows(out, stride * width, |y, row| {
            for x in (0..width).step_by(BLOCK) {
                for (g, (start, weights)) in groups.iter().enumerate() {
                    let sums = self.block_sums(self.pyramid.at(x, y), start, weights);
                    for (i, point) in row[x * stride..].chunks_exact_mut(stride).take(BLOCK).enumerate() {
                        for (p, sum) in point.iter_mut().skip(g * GROUP).zip(&sums) {
                            *p = convert(sum.as_array()[i]);
                        }
                    }
                }
            }
        });
    }

    /// Principal directions in groups of [`GROUP`]: start values and scaled weights, tap by tap.
    fn weights(&self, pca: &Pca, scale: f64) -> Vec<([f32x8; GROUP], Vec<[f32; GROUP]>)> {
        let group = |basis: &[Vec<f64>]| {
            let component = |f: &dyn Fn(&[f64]) -> f64| -> [f32; GROUP] {
                std::array::from_fn(|j| basis.get(j).map_or(0.0, |b| (f(b) * scale) as f32))
            };
            let start = component(&|b| -b.iter().zip(&pca.mean).fold(0.0, |s, (b, m)| s + b * m));
            let taps = self.taps.iter().enumerate();
            let weights = taps.map(|(t, tap)| component(&|b| b[t] * f64::from(tap.weight))).collect();
            (start.map(f32x8::splat), weights)
        };
        pca.basis.chunks(GROUP).map(group).collect()
    }

    /// The values of a tap for [`BLOCK`] texels in a row.
    #[inline]
    fn values(&self, at: usize, tap: &Tap) -> f32x8 {
        let from = (at as isize + tap.offset) as usize;
        let mut values = [0.0; BLOCK];
        values.copy_from_slice(&self.pyramid.planes[tap.plane][from..from + BLOCK]);
        f32x8::new(values)
    }

    /// [`GROUP`] components of the projections of [`BLOCK`] texels in a row: a small matrix product in registers.
    fn block_sums(&self, at: usize, start: &[f32x8; GROUP], weights: &[[f32; GROUP]]) -> [f32x8; GROUP] {
        let mut sums = *start;
        for (tap, weights) in self.taps.iter().zip(weights) {
            let values = self.values(at, tap);
            for (sum, w) in sums.iter_mut().zip(weights) {
                *sum += values * f32x8::splat(*w);
            }
        }
        sums
    }

    /// The largest squared distance of a vector from `mean`.
    fn largest_norm(&self, mean: &[f64]) -> f32 {
        let Pyramid { width, height, .. } = self.pyramid;
        let rows = par::map_chunks(height, 1, |rows| {
            let mut largest = 0.0f32;
            for x in (0..width).step_by(BLOCK) {
                let at = self.pyramid.at(x, rows.start);
                let norms = self.taps.iter().zip(mean).fold(f32x8::ZERO, |norms, (tap, m)| {
                    let d = self.values(at, tap) * f32x8::splat(tap.weight) - f32x8::splat(*m as f32);
                    norms + d * d
                });
                largest = norms.to_array().iter().take(width - x).fold(largest, |a, b| a.max(*b));
            }
            largest
        });
        rows.into_iter().fold(0.0, f32::max)
    }
}

/// Factors of the values of a window, row by row. Their squares sum to the number of texels whatever the falloff, so that
/// it does not change what a level counts against the others.
fn tap_weights(side: u32, falloff: Option<f64>) -> Vec<f32> {
    let r = f64::from(side / 2);
    let Some(falloff) = falloff else { return vec![1.0; (side * side) as usize] };
    let sigma = falloff * r.max(0.5);
    let weight = |x: u32, y: u32| {
        let (dx, dy) = (f64::from(x) - r, f64::from(y) - r);
        det::exp(-(dx * dx + dy * dy) / (2.0 * sigma * sigma))
    };
    let weights: Vec<f64> = (0..side).flat_map(|y| (0..side).map(move |x| weight(x, y))).collect();
    let mean = weights.iter().sum::<f64>() / weights.len() as f64;
    weights.iter().map(|w| (w / mean).sqrt() as f32).collect()
}

/// A sample's part of a plane.
fn cut(plane: &[f32], width: usize, area: &Area) -> Vec<f32> {
    let rows = plane.chunks_exact(width).skip(area.y as usize).take(area.height as usize);
    rows.flat_map(|row| &row[..area.width as usize]).copied().collect()
}

/// The planes of all maps that count.
fn all_planes(maps: &MapSet, params: &AnalysisParams) -> Vec<Vec<f32>> {
    let weighed = maps.iter().filter(|(kind, _)| params.weight(*kind) > 0.0);
    weighed.flat_map(|(kind, map)| feature_planes(kind, map, params.weight(kind).sqrt() as f32)).collect()
}

/// The planes that are compared: `weight` times the map in the space in which it is measured.
pub(crate) fn feature_planes(kind: MapKind, map: &Texture, weight: f32) -> Vec<Vec<f32>> {
    let channels = map.channels() as usize;
    let features = par::map(map.texel_count(), |i| {
        let v = &map.data()[i * channels..(i + 1) * channels];
        match kind {
            MapKind::BaseColor | MapKind::Emissive if OKLAB => oklab([v[0], v[1], v[2]]),
            MapKind::BaseColor | MapKind::Emissive => [v[0], v[1], v[2]].map(color::linear_to_srgb),
            MapKind::Normal => [v[0] * 0.5, v[1] * 0.5, v[2] * 0.5],
            _ => [v[0], 0.0, 0.0],
        }
    });
    (0..channels).map(|c| features.iter().map(|f| f[c] * weight).collect()).collect()
}

/// Linear Rec. 709 to Oklab (Ottosson 2020).
fn oklab([r, g, b]: [f32; 3]) -> [f32; 3] {
    let l = det::cbrt(0.412_221_46 * r + 0.536_332_55 * g + 0.051_445_995 * b);
    let m = det::cbrt(0.211_903_5 * r + 0.680_699_5 * g + 0.107_396_96 * b);
    let s = det::cbrt(0.088_302_46 * r + 0.281_718_85 * g + 0.629_978_7 * b);
    [
        0.210_454_26 * l + 0.793_617_8 * m - 0.004_072_047 * s,
        1.977_998_5 * l - 2.428_592_2 * m + 0.450_593_7 * s,
        0.025_904_037 * l + 0.782_771_77 * m - 0.808_675_77 * s,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_falloff_keeps_the_weight_of_a_level() {
        assert_eq!(tap_weights(3, None), [1.0; 9]);
        for (side, falloff) in [(1, 0.5), (5, 0.5), (9, 2.0)] {
            let weights = tap_weights(side, Some(falloff));
            let total: f32 = weights.iter().map(|w| w * w).sum();
            assert!((total - (side * side) as f32).abs() < 1e-3, "{side}: {total}");
            assert!(weights.iter().all(|w| *w <= weights[weights.len() / 2]));
        }
    }
}
