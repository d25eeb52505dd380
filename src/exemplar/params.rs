//! Parameters of the analysis and what is allowed.
//!
//! Source: \[ZG02\] sections 2 and 4.
//! Unaware of: recipes, files.

use super::Error;
use super::sheet::Subject;
use crate::texture::{MapKind, MapSet, Wrap};
use std::collections::BTreeMap;

/// Most levels of a pyramid; the eighth reads 128 texels apart.
const MAX_LEVELS: usize = 8;
/// Largest side of a neighbourhood.
const MAX_NEIGHBOURHOOD: u32 = 63;
/// Most components of a vector: the eigenvalue problem grows with their cube (1035: 2 s).
pub(super) const MAX_DIMENSIONS: usize = 2048;
const MAX_JUMPS: u32 = 64;
const MAX_DIVERSITY: u32 = 64;
const MAX_IMPORTANCE: f64 = 1e6;
/// Squares of such values, times the importance, summed over a vector, stay finite.
const MAX_VALUE: f32 = 1e6;
/// Destinations are 16-bit, and the largest number marks what is no texel.
pub(super) const MAX_SIDE: u32 = 65535;
/// 4096 x 4096.
pub(super) const MAX_TEXELS: u64 = 1 << 24;
pub(super) const MAX_MEMORY: u64 = 8 << 30;

/// How an exemplar is analysed.
#[derive(Clone, Debug, PartialEq)]
pub struct AnalysisParams {
    /// Sides of the square neighbourhoods in texels of their level, finest level first; odd. [9, 5, 3] in \[ZG02\] 4.
    pub neighbourhoods: Vec<u32>,
    /// Most jumps per texel, k, 1..=64. 3 in \[ZG02\] 4.
    pub jumps: u32,
    /// Matches looked at per jump, beta, 1..=64. 5 in \[ZG02\] 2.2.
    pub diversity: u32,
    /// Share of the vectors' variance that the principal components keep, above 0 and at most 1. 0.97 in \[ZG02\] 2.1.
    pub variance: f64,
    /// Leniency, above 1: a jump of distance alpha times the largest would never be taken. 1.1 in \[ZG02\] 2.
    pub alpha: f64,
    /// Least distance in texels of a texel's jumps from it and from each other, from 1 to the longer side.
    /// `None`: the side of the finest neighbourhood, so that no two matches share a texel of that level, but at most a
    /// quarter of the exemplar's shorter side.
    pub min_distance: Option<f64>,
    /// Factor of each map's squared differences, 0..=1e6; maps that are not listed count nothing.
    pub importance: BTreeMap<MapKind, f64>,
    /// What lies beyond the exemplar's borders: the exemplar again (then distances and jumps go across them as well, and
    /// there is only one sample), or (clamp, the default) its mirror image.
    pub wrap: Wrap,
}

impl Default for AnalysisParams {
    fn default() -> Self {
        let counts = [MapKind::BaseColor, MapKind::Height, MapKind::FeatureMask];
        AnalysisParams {
            neighbourhoods: vec![9, 5, 3],
            jumps: 3,
            diversity: 5,
            variance: 0.97,
            alpha: 1.1,
            min_distance: None,
            importance: counts.map(|kind| (kind, 1.0)).into(),
            wrap: Wrap::Clamp,
        }
    }
}

impl AnalysisParams {
    /// Importance of a map.
    pub(crate) fn weight(&self, kind: MapKind) -> f64 {
        self.importance.get(&kind).copied().unwrap_or(0.0)
    }

    /// Matches per texel that the search should find, beta k.
    pub(crate) fn matches(&self) -> usize {
        self.jumps as usize * self.diversity as usize
    }

    /// Texels by which the neighbourhoods of a border texel reach beyond the exemplar.
    pub(crate) fn reach(&self) -> usize {
        self.neighbourhoods.iter().enumerate().map(|(level, n)| (*n as usize / 2) << level).max().unwrap_or(0)
    }

    /// The minimum distance of matches for an exemplar.
    pub(crate) fn resolved_min_distance(&self, subject: &Subject) -> f64 {
        let finest = self.neighbourhoods.first().copied().unwrap_or(1);
        let quarter = f64::from(subject.sides().0) / 4.0;
        self.min_distance.unwrap_or_else(|| f64::from(finest).min(quarter).max(1.0))
    }

    /// Checks the parameters and an exemplar, whose size is checked already, against them.
    pub(crate) fn check(&self, subject: &Subject) -> Result<(), Error> {
        self.check_numbers()?;
        let min = self.neighbourhoods[0];
        if let Some(area) = subject.areas.iter().find(|a| a.width.min(a.height) < min) {
            return Err(Error::TooSmall { size: (area.width, area.height), min });
        }
        let (distance, max) = (self.resolved_min_distance(subject), f64::from(subject.sides().1));
        if !(1.0..=max).contains(&distance) {
            return Err(Error::MinDistance { found: distance, max });
        }
        self.check_maps(subject.maps)?;
        self.check_memory(subject, 1)
    }

    /// Fails if the vectors reduced to `components`, the lists of matches and the pyramids would not fit.
    pub(crate) fn check_memory(&self, subject: &Subject, components: usize) -> Result<(), Error> {
        let (lists, texels) = (self.matches().max(24) as u64, subject.domain.len() as u64);
        // Points twice (by texel and by cluster) at two bytes per component; lists of 8 bytes and a copy of 4; the grid.
        let per_texel = 4 * components as u64 + 12 * lists + 8;
        let (border, planes) =
            (2 * self.reach() as u64, (self.channels(subject.maps) * self.neighbourhoods.len()) as u64);
        let padded = |n: u32| u64::from(n) + border;
        let areas: u64 = subject.areas.iter().map(|a| padded(a.width) * padded(a.height)).sum();
        let bytes = texels * per_texel + 4 * planes * areas;
        if bytes > MAX_MEMORY { Err(Error::Memory { bytes, max: MAX_MEMORY }) } else { Ok(()) }
    }

    /// Values per texel that are compared.
    pub(super) fn channels(&self, maps: &MapSet) -> usize {
        maps.iter().filter(|(k, _)| self.weight(*k) > 0.0).map(|(k, _)| k.channels() as usize).sum()
    }

    /// Components of a neighbourhood vector.
    pub(crate) fn dimensions(&self, maps: &MapSet) -> usize {
        self.neighbourhoods.iter().map(|n| (n * n) as usize).sum::<usize>() * self.channels(maps)
    }

    pub(super) fn check_numbers(&self) -> Result<(), Error> {
        let levels = self.neighbourhoods.len();
        if !(1..=MAX_LEVELS).contains(&levels) {
            return Err(Error::Levels { found: levels, max: MAX_LEVELS });
        }
        if let Some(&size) = self.neighbourhoods.iter().find(|n| **n % 2 == 0 || **n > MAX_NEIGHBOURHOOD) {
            return Err(Error::Neighbourhood { size, max: MAX_NEIGHBOURHOOD });
        }
        if !(1..=MAX_JUMPS).contains(&self.jumps) {
            return Err(Error::Jumps { found: self.jumps, max: MAX_JUMPS });
        }
        if !(1..=MAX_DIVERSITY).contains(&self.diversity) {
            return Err(Error::Diversity { found: self.diversity, max: MAX_DIVERSITY });
        }
        if !(self.variance > 0.0 && self.variance <= 1.0) {
            return Err(Error::Variance(self.variance));
        }
        if !(self.alpha > 1.0 && self.alpha.is_finite()) {
            return Err(Error::Alpha(self.alpha));
        }
        match self.importance.iter().find(|(_, w)| !(0.0..=MAX_IMPORTANCE).contains(*w)) {
            Some((&map, &weight)) => Err(Error::Importance { map, weight, max: MAX_IMPORTANCE }),
            None => Ok(()),
        }
    }

    pub(super) fn check_maps(&self, maps: &MapSet) -> Result<(), Error> {
        if self.channels(maps) == 0 {
            return Err(Error::NothingToCompare { maps: maps.iter().map(|(k, _)| k).collect() });
        }
        let found = self.dimensions(maps);
        if found > MAX_DIMENSIONS {
            return Err(Error::Dimensions { found, max: MAX_DIMENSIONS });
        }
        for (map, texture) in maps.iter() {
            if let Some(i) = texture.data().iter().position(|v| v.is_nan() || v.abs() > MAX_VALUE) {
                let texel = i as u32 / texture.channels();
                let (x, y) = (texel % texture.width(), texel / texture.width());
                return Err(Error::Value { map, x, y, value: texture.data()[i], max: MAX_VALUE });
            }
        }
        Ok(())
    }
}

/// Fails if an exemplar of that size would be too large.
pub(crate) fn check_size(width: u64, height: u64) -> Result<(), Error> {
    if width.max(height) > u64::from(MAX_SIDE) || width * height > MAX_TEXELS {
        return Err(Error::TooLarge { size: (width, height), max_side: MAX_SIDE, max_texels: MAX_TEXELS });
    }
    Ok(())
}
