//! How visible it is where patches of an image meet, on every level of the correction.
//!
//! Two texels may take each other's place as far as their appearances agree (Lefebvre, Hoppe 2006): neighbourhoods of
//! 5 x 5 texels, reduced to eight numbers. A seam that looks good by single texels may still cut a feature; by
//! appearances it does not. Differences count in relation to the local contrast, so that seams are led through busy places.
//! Unaware of: images, patches, how sources are chosen.

use super::seam::box_mean;
use crate::exemplar::{AnalysisParams, Appearance, Error, appearance};
use crate::numerics::par;
use crate::texture::MapSet;

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

/// Largest cost of one difference.
const MOST: f32 = 50.0 * UNIT;

/// The metrics of all levels of an exemplar; level i is for blocks of 2^i pixels.
#[derive(Clone, Debug)]
pub struct SeamMetrics {
    pub(super) size: [u32; 2],
    pub(super) levels: Vec<Metric>,
}

/// Appearances on one level.
#[derive(Clone, Debug)]
pub(super) struct Metric {
    values: Vec<[f32; COMPONENTS]>,
    /// One over the fourth root of the local variance: two of them make a difference relative to the contrast.
    sharpness: Vec<f32>,
}

impl SeamMetrics {
    /// Prepares the metrics of an exemplar. Of `params`, importance and wrap count. Fails as the analysis does.
    pub fn new(maps: &MapSet, params: &AnalysisParams) -> Result<Self, Error> {
        let size = [maps.width(), maps.height()];
        let side = size[0].min(size[1]);
        let count = (1..MAX_LEVELS).take_while(|i| (COARSEST << i) <= side).count() + 1;
        let levels = (0..count)
            .map(|level| {
                let mut neighbourhoods = vec![1; level.saturating_sub(1)];
                neighbourhoods.push(NEIGHBOURHOOD.min(side - (1 - side % 2)));
                let params = AnalysisParams { neighbourhoods, min_distance: Some(1.0), ..params.clone() };
                let Appearance { features, .. } = appearance(maps, &params, COMPONENTS)?;
                let channels = features.channels() as usize;
                Ok(Metric::new(features.data(), channels, size, 1 << level))
            })
            .collect::<Result<_, Error>>()?;
        Ok(SeamMetrics { size, levels })
    }
}

impl Metric {
    fn new(features: &[f32], channels: usize, size: [u32; 2], around: usize) -> Self {
        let mean = box_mean(features, size, channels, around);
        let squares: Vec<f32> = features.chunks(channels).map(|t| t.iter().map(|v| v * v).sum()).collect();
        let mean_square = box_mean(&squares, size, 1, around);
        let spread = |(m, s): (&[f32], &f32)| (s - m.iter().map(|v| v * v).sum::<f32>()).max(0.0);
        let variance: Vec<f32> = mean.chunks(channels).zip(&mean_square).map(spread).collect();
        let typical = (variance.iter().map(|v| f64::from(*v)).sum::<f64>() / variance.len() as f64) as f32;
        let floor = (typical * VARIANCE_FLOOR).max(1e-10);
        let unit = UNIT.sqrt();
        let sharpness = variance.iter().map(|v| unit / (v + floor).sqrt().sqrt()).collect();
        let value = |i: usize| {
            let mut out = [0.0; COMPONENTS];
            out[..channels].copy_from_slice(&features[i * channels..(i + 1) * channels]);
            out
        };
        Metric { values: par::map(variance.len(), value), sharpness }
    }

    /// What it costs to see one texel in the other's place; both are indices into the exemplar.
    #[inline(always)]
    pub fn difference(&self, a: u32, b: u32) -> i32 {
        let (x, y) = (&self.values[a as usize], &self.values[b as usize]);
        let mut sums = [0.0f32; 4];
        for i in 0..4 {
            let (d, e) = (x[i] - y[i], x[i + 4] - y[i + 4]);
            sums[i] = d * d + e * e;
        }
        let distance = ((sums[0] + sums[1]) + (sums[2] + sums[3])).sqrt();
        (distance * (self.sharpness[a as usize] * self.sharpness[b as usize])).min(MOST) as i32
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synth::testing::noise;
    use crate::texture::MapKind;

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
