//! Neighbourhood vectors: what a texel's surroundings look like, on all levels and in all maps that count.
//!
//! Source: \[ZG02\] sections 2.1 and 2.3.
//! In: the maps, their importance, neighbourhood sizes. Out: vectors, and their projection as points of `numerics::knn`.
//! Reads as: the similarity is the plain L2 norm; a map of importance w adds w times its squared differences. Colours
//! are compared in Oklab, where equal distances look about equally different. In linear light the dark half of what the
//! eye tells apart spans a fifth of the range, and mismatches in shade would cost next to nothing. Components of normals
//! are halved, so that every map spans about one unit.
//! Unaware of: how neighbours are found.

use super::params::AnalysisParams;
use super::pyramid::{BLOCK, Pyramid};
use crate::numerics::knn::{Points, RANGE};
use crate::numerics::pca::Pca;
use crate::numerics::rng::Key;
use crate::numerics::{det, par};
use crate::texture::{MapKind, MapSet, Texture};
use wide::f32x8;

/// One component of a neighbourhood vector: a plane and where in it, relative to the texel.
struct Tap {
    plane: usize,
    offset: isize,
}

/// The neighbourhood vectors of every texel of an exemplar.
pub(crate) struct Neighbourhoods {
    pyramid: Pyramid,
    taps: Vec<Tap>,
}

impl Neighbourhoods {
    /// Prepares the vectors. Expects checked parameters.
    pub(crate) fn new(maps: &MapSet, params: &AnalysisParams) -> Self {
        let planes: Vec<Vec<f32>> = maps
            .iter()
            .filter(|(kind, _)| params.weight(*kind) > 0.0)
            .flat_map(|(kind, map)| feature_planes(kind, map, params.weight(kind).sqrt() as f32))
            .collect();
        let channels = planes.len();
        let radius = |level: usize| params.neighbourhoods[level] as usize / 2;
        let levels = params.neighbourhoods.len();
        let pyramid = Pyramid::new(planes, maps.width(), maps.height(), levels, params.reach(), params.wrap);
        let mut taps = Vec::new();
        for level in 0..levels {
            let r = radius(level) as isize;
            for (dy, dx) in (-r..=r).flat_map(|dy| (-r..=r).map(move |dx| (dy, dx))) {
                let offset = (dy * pyramid.stride as isize + dx) << level;
                taps.extend((0..channels).map(|c| Tap { plane: level * channels + c, offset }));
            }
        }
        Neighbourhoods { pyramid, taps }
    }

    /// Components of a vector.
    pub(crate) fn dims(&self) -> usize {
        self.taps.len()
    }

    /// Number of texels.
    pub(crate) fn len(&self) -> usize {
        self.pyramid.width * self.pyramid.height
    }

    /// Appends the vector of a texel (counted row by row).
    pub(crate) fn push_vector(&self, texel: usize, out: &mut Vec<f32>) {
        let at = self.pyramid.at(texel % self.pyramid.width, texel / self.pyramid.width) as isize;
        out.extend(self.taps.iter().map(|t| self.pyramid.planes[t.plane][(at + t.offset) as usize]));
    }

    /// The vectors of up to `count` texels, drawn one from each of as many runs of texels: a regular grid would see one
    /// phase of a periodic exemplar.
    pub(crate) fn sample(&self, count: usize) -> Vec<f32> {
        let (len, key) = (self.len(), Key::new(0).with_str("pca"));
        let count = count.min(len);
        let mut samples = Vec::with_capacity(count * self.dims());
        for i in 0..count {
            let (start, end) = (i * len / count, (i + 1) * len / count);
            self.push_vector(start + key.below(i as u64, (end - start) as u32) as usize, &mut samples);
        }
        samples
    }

    /// `scale` times the projections of every vector on the principal directions, texel by texel, `components` values
    /// each; directions that there are not give zeros.
    pub(crate) fn features(&self, pca: &Pca, scale: f64, components: usize) -> Vec<f32> {
        let width = self.pyramid.width;
        let groups = self.weights(pca, scale);
        let mut features = vec![0.0; self.len() * components];
        par::for_rows(&mut features, width * components, |y, row| {
            for x in (0..width).step_by(BLOCK) {
                for (g, (start, weights)) in groups.iter().enumerate() {
                    let sums = self.block_sums(self.pyramid.at(x, y), start, weights);
                    for (i, point) in row[x * components..].chunks_exact_mut(components).take(BLOCK).enumerate() {
                        for (p, sum) in point.iter_mut().skip(g * GROUP).zip(&sums) {
                            *p = sum.as_array()[i];
                        }
                    }
                }
            }
        });
        features
    }

    /// Projects every vector on the principal directions and rounds to integers.
    pub(crate) fn project(&self, pca: &Pca) -> Points {
        let width = self.pyramid.width;
        // No vector is farther from the mean than the farthest before the projection: scaled by it, none saturates.
        let radius = f64::from(self.largest_norm(&pca.mean)).sqrt();
        let scale = if radius > 0.0 { f64::from(RANGE) / radius } else { 1.0 };
        let groups = self.weights(pca, scale);
        let mut points = Points::new(self.len(), pca.basis.len(), scale);
        let stride = points.stride();
        par::for_rows(points.data_mut(), stride * width, |y, row| {
            for x in (0..width).step_by(BLOCK) {
                for (g, (start, weights)) in groups.iter().enumerate() {
                    let sums = self.block_sums(self.pyramid.at(x, y), start, weights);
                    for (i, point) in row[x * stride..].chunks_exact_mut(stride).take(BLOCK).enumerate() {
                        for (p, sum) in point[g * GROUP..].iter_mut().zip(&sums) {
                            *p = sum.as_array()[i].round() as i16;
                        }
                    }
                }
            }
        });
        points
    }

    /// Principal directions in groups of [`GROUP`]: start values and scaled weights, tap by tap.
    fn weights(&self, pca: &Pca, scale: f64) -> Vec<([f32x8; GROUP], Vec<[f32; GROUP]>)> {
        let group = |basis: &[Vec<f64>]| {
            let component = |f: &dyn Fn(&[f64]) -> f64| -> [f32; GROUP] {
                std::array::from_fn(|j| basis.get(j).map_or(0.0, |b| (f(b) * scale) as f32))
            };
            let start = component(&|b| -b.iter().zip(&pca.mean).fold(0.0, |s, (b, m)| s + b * m));
            (start.map(f32x8::splat), (0..self.taps.len()).map(|t| component(&|b| b[t])).collect())
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
                    let d = self.values(at, tap) - f32x8::splat(*m as f32);
                    norms + d * d
                });
                largest = norms.to_array().iter().take(width - x).fold(largest, |a, b| a.max(*b));
            }
            largest
        });
        rows.into_iter().fold(0.0, f32::max)
    }
}

/// Principal directions that are projected on at once.
const GROUP: usize = 4;

/// The planes that are compared: `weight` times the map in the space in which it is measured.
pub(crate) fn feature_planes(kind: MapKind, map: &Texture, weight: f32) -> Vec<Vec<f32>> {
    let channels = map.channels() as usize;
    let features = par::map(map.texel_count(), |i| {
        let v = &map.data()[i * channels..(i + 1) * channels];
        match kind {
            MapKind::BaseColor | MapKind::Emissive => oklab([v[0], v[1], v[2]]),
            MapKind::Normal => [v[0] * 0.5, v[1] * 0.5, v[2] * 0.5],
            _ => [v[0], 0.0, 0.0],
        }
    });
    (0..channels).map(|c| features.iter().map(|f| f[c] * weight).collect()).collect()
}

/// Linear Rec. 709 to Oklab (Ottosson 2020).
fn oklab([r, g, b]: [f32; 3]) -> [f32; 3] {
    let root = |v: f32| det::powf(v.abs(), 1.0 / 3.0).copysign(v);
    let l = root(0.412_221_46 * r + 0.536_332_55 * g + 0.051_445_995 * b);
    let m = root(0.211_903_5 * r + 0.680_699_5 * g + 0.107_396_96 * b);
    let s = root(0.088_302_46 * r + 0.281_718_85 * g + 0.629_978_7 * b);
    [
        0.210_454_26 * l + 0.793_617_8 * m - 0.004_072_047 * s,
        1.977_998_5 * l - 2.428_592_2 * m + 0.450_593_7 * s,
        0.025_904_037 * l + 0.782_771_77 * m - 0.808_675_77 * s,
    ]
}
