//! How visible it is where patches of an image meet, on every level of the correction.
//!
//! Two texels may take each other's place as far as their appearances agree (Lefebvre, Hoppe 2006): neighbourhoods of
//! 5 x 5 texels, reduced to eight numbers. A seam that looks good by single texels may still cut a feature; by
//! appearances it does not. Differences count in relation to the local contrast, so that seams are led through busy places.
//! Unaware of: images, patches, how sources are chosen.

use super::box_mean::box_mean;
use super::image::hole_shifts::distances;
use crate::exemplar::{AnalysisParams, Appearance, Area, Error, Sheet, appearance, appearance_sheet};
use crate::numerics::par;
use crate::texture::{MapSet, Texel, Texture};

/// Numbers that describe a texel's appearance.
const COMPONENTS: usize = 8;

/// Side of the neighbourhoods that are compared.
const NEIGHBOURHOOD: u32 = 5;

/// A level's stride is at most this share of the exemplar's smaller side, so that a block is a small part of it.
const COARSEST: u32 = 16;

/// Most levels: the coarsest has blocks of 8 x 8 pixels.
const MAX_LEVELS: usize = 4;

/// Added to local variances, as a share of their mean, so that flat places do not divide by nothing.
const VARIANCE_FLOOR: f32 = 0.1;

/// Costs are whole multiples of a thousandth of the typical contrast.
pub(super) const UNIT: f32 = 1000.0;

/// Addresses are f32: what is this little outside the outer centres, in texels, counts as inside.
const SLACK: f32 = 1e-2;

/// Largest cost of one difference.
const MOST: f32 = 50.0 * UNIT;

/// Looks along the leading component of the appearance, and along the second of each.
const LOOKS_BY: [usize; 2] = [8, 4];

/// Number of looks.
pub(super) const LOOKS: usize = LOOKS_BY[0] * LOOKS_BY[1];

/// The metrics of all levels of an exemplar; level i is for blocks of 2^i pixels.
#[derive(Clone, Debug)]
pub struct SeamMetrics {
    pub(super) size: [u32; 2],
    pub(super) levels: Vec<Metric>,
}

/// What a place between texels looks like.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sample {
    value: [f32; COMPONENTS],
    sharpness: f32,
}

/// Appearances on one level.
#[derive(Clone, Debug)]
pub(super) struct Metric {
    size: [u32; 2],
    values: Vec<[f32; COMPONENTS]>,
    /// One over the fourth root of the local variance: two of them make a difference relative to the contrast.
    sharpness: Vec<f32>,
    looks: Vec<u8>,
    /// Set where a picture is filled in.
    rim: Option<Box<Rim>>,
}

/// What is compared as well near a hole, where neighbourhoods reach into it and say less: single texels.
#[derive(Clone, Debug)]
struct Rim {
    /// True for texels near a hole, one per texel.
    near: Vec<bool>,
    texels: Metric,
}

impl SeamMetrics {
    /// Prepares the metrics of an exemplar. Of `params`, importance and wrap count. Fails as the analysis does.
    pub fn new(maps: &MapSet, params: &AnalysisParams) -> Result<Self, Error> {
        let [width, height] = [maps.width(), maps.height()];
        Self::over([width, height], &[Area { y: 0, width, height }], params, |p| appearance(maps, p, COMPONENTS))
    }

    /// Prepares the metrics of several samples. The levels are those of the largest. Fails as the analysis does.
    pub fn of_sheet(sheet: &Sheet, params: &AnalysisParams) -> Result<Self, Error> {
        let size = [sheet.maps().width(), sheet.maps().height()];
        let appearance = |p: &AnalysisParams| appearance_sheet(sheet, p, COMPONENTS);
        let mut metrics = Self::over(size, sheet.areas(), params, appearance)?;
        if sheet.has_holes_filled() {
            let mut known = vec![true; size[0] as usize * size[1] as usize];
            for a in sheet.areas() {
                for (x, y) in (a.y..a.y + a.height).flat_map(|y| (0..a.width).map(move |x| (x, y))) {
                    known[(y * size[0] + x) as usize] = sheet.domain().contains(x as i32, y as i32);
                }
            }
            for (level, metric) in metrics.levels.iter_mut().enumerate() {
                let reach = (NEIGHBOURHOOD / 2 + 1) << level;
                let near = distances(&known, size, reach + 1).into_iter().map(|away| away <= reach).collect();
                let texels = Metric::new(&appearance(&at_level(level, 1, params))?.features, sheet.areas(), 1 << level);
                metric.rim = Some(Box::new(Rim { near, texels }));
            }
        }
        Ok(metrics)
    }

    fn over(
        size: [u32; 2],
        areas: &[Area],
        params: &AnalysisParams,
        appearance: impl Fn(&AnalysisParams) -> Result<Appearance, Error>,
    ) -> Result<Self, Error> {
        let sides = || areas.iter().map(|a| a.width.min(a.height));
        let (side, large) = (sides().min().unwrap_or(1), sides().max().unwrap_or(1));
        let count = (1..MAX_LEVELS).take_while(|i| (COARSEST << i) <= large).count() + 1;
        let levels = (0..count)
            .map(|level| {
                let whole = NEIGHBOURHOOD.min(side - (1 - side % 2));
                let Appearance { features, .. } = appearance(&at_level(level, whole, params))?;
                Ok(Metric::new(&features, areas, 1 << level))
            })
            .collect::<Result<_, Error>>()?;
        Ok(SeamMetrics { size, levels })
    }
}

/// What to look at for blocks of `2^level` pixels.
fn at_level(level: usize, neighbourhood: u32, params: &AnalysisParams) -> AnalysisParams {
    let mut neighbourhoods = vec![1; level.saturating_sub(1)];
    neighbourhoods.push(neighbourhood);
    AnalysisParams { neighbourhoods, min_distance: Some(1.0), ..params.clone() }
}

impl Metric {
    fn new(features: &Texture, areas: &[Area], around: usize) -> Self {
        let (width, channels) = (features.width() as usize, features.channels() as usize);
        let mut variance = vec![0.0; features.texel_count()];
        let (mut sum, mut count) = (0.0, 0);
        for a in areas {
            let local = local_variance(features, a, around);
            sum = local.iter().fold(sum, |s, v| s + f64::from(*v));
            count += local.len();
            let rows = variance.chunks_exact_mut(width).skip(a.y as usize);
            rows.zip(local.chunks_exact(a.width as usize)).for_each(|(to, row)| to[..row.len()].copy_from_slice(row));
        }
        let typical = (sum / count as f64) as f32;
        let floor = (typical * VARIANCE_FLOOR).max(1e-10);
        let unit = UNIT.sqrt();
        let sharpness = variance.iter().map(|v| unit / (v + floor).sqrt().sqrt()).collect();
        let value = |i: usize| {
            let mut out = [0.0; COMPONENTS];
            out[..channels].copy_from_slice(&features.data()[i * channels..(i + 1) * channels]);
            out
        };
        let values = par::map(variance.len(), value);
        let size = [features.width(), features.height()];
        Metric { size, looks: looks(&values), values, sharpness, rim: None }
    }

    /// The metric of texels that look as given, all as busy as each other.
    #[cfg(test)]
    pub fn of_values(values: Vec<[f32; COMPONENTS]>, size: [u32; 2]) -> Self {
        Metric { size, looks: looks(&values), sharpness: vec![1.0; values.len()], values, rim: None }
    }

    /// Which of [`LOOKS`] groups of like appearance each texel belongs to; all are about as large.
    pub fn looks(&self) -> &[u8] {
        &self.looks
    }

    /// What it costs to see one texel in the other's place; both are indices into the exemplar.
    #[inline(always)]
    pub fn difference(&self, a: u32, b: u32) -> i32 {
        match &self.rim {
            Some(rim) if rim.near[a as usize] || rim.near[b as usize] => {
                (rim.texels.distance(a, b) + self.distance(a, b)) / 2
            }
            _ => self.distance(a, b),
        }
    }

    #[inline(always)]
    fn distance(&self, a: u32, b: u32) -> i32 {
        let (a, b) = (a as usize, b as usize);
        cost(&self.values[a], &self.values[b], self.sharpness[a] * self.sharpness[b])
    }

    /// The look of a place, bilinear; `None` beyond the outer texel centres.
    pub fn sample(&self, at: Texel) -> Option<Sample> {
        let [w, h] = self.size;
        let (x, y) = (at.x - 0.5, at.y - 0.5);
        let (right, bottom) = ((w - 1) as f32, (h - 1) as f32);
        let inside = x >= -SLACK && y >= -SLACK && x <= right + SLACK && y <= bottom + SLACK;
        if !inside {
            return None;
        }
        let (x, y) = (x.clamp(0.0, right), y.clamp(0.0, bottom));
        let (x0, y0) = ((x as u32).min(w.max(2) - 2), (y as u32).min(h.max(2) - 2));
        let (tx, ty) = (x - x0 as f32, y - y0 as f32);
        let (x1, y1) = ((x0 + 1).min(w - 1), (y0 + 1).min(h - 1));
        let index = |x: u32, y: u32| (y * w + x) as usize;
        let [a, b, c, d] = [index(x0, y0), index(x1, y0), index(x0, y1), index(x1, y1)];
        let [p, q, r, s] = [a, b, c, d].map(|i| &self.values[i]);
        let value = std::array::from_fn(|i| {
            let top = p[i] + (q[i] - p[i]) * tx;
            let bottom = r[i] + (s[i] - r[i]) * tx;
            top + (bottom - top) * ty
        });
        let nearest = match (tx < 0.5, ty < 0.5) {
            (true, true) => a,
            (false, true) => b,
            (true, false) => c,
            (false, false) => d,
        };
        Some(Sample { value, sharpness: self.sharpness[nearest] })
    }

    /// What it costs to see one place in the other's.
    #[inline(always)]
    pub fn difference_of(&self, a: &Sample, b: &Sample) -> i32 {
        cost(&a.value, &b.value, a.sharpness * b.sharpness)
    }
}

/// Distance of two appearances in relation to the contrast.
#[inline(always)]
fn cost(x: &[f32; COMPONENTS], y: &[f32; COMPONENTS], sharpness: f32) -> i32 {
    let mut sums = [0.0f32; 4];
    for i in 0..4 {
        let (d, e) = (x[i] - y[i], x[i + 4] - y[i + 4]);
        sums[i] = d * d + e * e;
    }
    let distance = ((sums[0] + sums[1]) + (sums[2] + sums[3])).sqrt();
    (distance * sharpness).min(MOST) as i32
}

/// Divides texels into groups of about equal size by the leading component of their appearance, and each by the second.
/// What looks the same is in one group.
fn looks(values: &[[f32; COMPONENTS]]) -> Vec<u8> {
    let all: Vec<u32> = (0..values.len() as u32).collect();
    let mut out = vec![0; values.len()];
    for (i, some) in shared_out(&all, LOOKS_BY[0], |t| values[t as usize][0]).into_iter().enumerate() {
        for (j, texels) in shared_out(&some, LOOKS_BY[1], |t| values[t as usize][1]).into_iter().enumerate() {
            texels.iter().for_each(|t| out[*t as usize] = (i * LOOKS_BY[1] + j) as u8);
        }
    }
    out
}

/// Divides texels by where a value lies among its quantiles.
fn shared_out(texels: &[u32], parts: usize, value: impl Fn(u32) -> f32) -> Vec<Vec<u32>> {
    let mut values: Vec<f32> = texels.iter().map(|t| value(*t)).collect();
    let count = values.len();
    let (mut rest, mut passed, mut bounds) = (&mut values[..], 0, vec![]);
    for at in (1..parts).map(|i| i * count / parts).filter(|at| *at < count) {
        rest.select_nth_unstable_by(at - passed, f32::total_cmp);
        rest = &mut rest[at - passed..];
        passed = at;
        bounds.push(rest[0]);
    }
    let mut out = vec![vec![]; parts];
    for &t in texels {
        out[bounds.partition_point(|b| *b <= value(t))].push(t);
    }
    out
}

/// Variance of the texels of a sample, all channels together, within `around` texels to each side.
fn local_variance(features: &Texture, area: &Area, around: usize) -> Vec<f32> {
    let channels = features.channels() as usize;
    let (size, len) = ([area.width, area.height], area.width as usize * channels);
    let rows = features.data().chunks_exact(features.width() as usize * channels).skip(area.y as usize);
    let sample: Vec<f32> = rows.take(area.height as usize).flat_map(|row| &row[..len]).copied().collect();
    let mean = box_mean(&sample, size, channels, around);
    let squares: Vec<f32> = sample.chunks(channels).map(|t| t.iter().map(|v| v * v).sum()).collect();
    let mean_square = box_mean(&squares, size, 1, around);
    let spread = |(m, s): (&[f32], &f32)| (s - m.iter().map(|v| v * v).sum::<f32>()).max(0.0);
    mean.chunks(channels).zip(&mean_square).map(spread).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::exemplar::Sample;
    use crate::synth::testing::noise;
    use crate::texture::MapKind;

    #[test]
    fn samples_of_a_sheet_are_measured_each_by_itself() {
        let maps = |w: u32, h: u32| MapSet::new(vec![(MapKind::Height, noise(w, h))]);
        let (a, b) = (maps(40, 30), maps(20, 36));
        let params = AnalysisParams::default();
        let sheet = |samples: &[&MapSet]| {
            let samples: Vec<Sample> = samples.iter().map(|maps| Sample { maps, mask: None }).collect();
            SeamMetrics::of_sheet(&Sheet::new(&samples).unwrap(), &params).unwrap()
        };
        let (one, alone) = (sheet(&[&a]), SeamMetrics::new(&a, &params).unwrap());
        let pairs: Vec<(u32, u32)> = (0..1000).map(|i| (i, (i * 7 + 5) % 1200)).collect();
        assert!(pairs.iter().all(|(p, q)| one.levels[0].difference(*p, *q) == alone.levels[0].difference(*p, *q)));
        // Twice the same sample: what a texel and its twin show does not differ.
        let twice = sheet(&[&b, &a, &b]);
        let twin = |i: u32| i + 40 * (36 + 1 + 30 + 1);
        assert_eq!(twice.size, [40, 36 + 1 + 30 + 1 + 36]);
        for i in (0..36).flat_map(|y| (0..20).map(move |x| y * 40 + x)) {
            assert_eq!(twice.levels[0].difference(i, twin(i)), 0, "{i}");
            assert_eq!(twice.levels[0].difference(i, 7), twice.levels[0].difference(twin(i), 7));
        }
    }

    #[test]
    fn near_a_hole_what_is_known_counts_more() {
        // Flat but for a line; the row above it is the last that is known.
        let t = Texture::from_fn(60, 40, 1, |_, y, out| {
            out[0] = if y % 20 == 10 { 0.0 } else { 0.5 + (y % 2) as f32 * 0.01 }
        });
        let maps = MapSet::new(vec![(MapKind::Height, t)]);
        let mask = Texture::from_fn(60, 40, 1, |x, y, out| {
            out[0] = f32::from(u8::from(!(20..40).contains(&x) || !(10..20).contains(&y)))
        });
        let sheet = Sheet::new(&[Sample { maps: &maps, mask: Some(&mask) }]).unwrap();
        let metrics = SeamMetrics::of_sheet(&sheet.with_holes_filled(), &AnalysisParams::default()).unwrap();
        let filled = &metrics.levels[0];
        let [at, twin, line, other] = [9, 29, 30, 25].map(|y| y * 60 + 30);
        assert!(filled.difference(at, twin) < filled.distance(at, twin));
        assert!(filled.difference(at, line) > 1000);
        // Away from the hole, that a line is near is a difference.
        assert!(filled.difference(other, twin) > 0);
    }

    #[test]
    fn a_level_for_each_size_that_is_small_against_the_exemplar() {
        let metrics = |w: u32, h: u32| {
            let maps = MapSet::new(vec![(MapKind::Height, noise(w, h))]);
            SeamMetrics::new(&maps, &AnalysisParams::default()).unwrap()
        };
        assert_eq!(metrics(4, 40).levels.len(), 1);
        assert_eq!(metrics(31, 40).levels.len(), 1);
        assert_eq!(metrics(32, 40).levels.len(), 2);
        let m = metrics(128, 130);
        assert_eq!(m.levels.len(), 4);
        for level in &m.levels {
            assert_eq!(level.difference(700, 700), 0);
            assert_eq!(level.difference(12, 700), level.difference(700, 12));
            // The typical difference is of the order of the typical contrast.
            let mean = (0..500).map(|i| i64::from(level.difference(i, 9000 + 3 * i))).sum::<i64>() / 500;
            assert!((500..5000).contains(&mean), "{mean}");
        }
    }
}
