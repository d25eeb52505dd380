//! What counts when texels are compared: the maps in the spaces in which differences look even, times their importance.
//!
//! In: maps, the importance of each. Out: interleaved values. The squared difference of two texels is the sum over their
//! channels. Unaware of: what is compared.

use std::collections::BTreeMap;

use crate::exemplar::feature_planes;
use crate::texture::{MapKind, MapSet};

/// The values of every texel, row by row.
pub(super) struct Planes {
    /// Values per texel.
    pub channels: usize,
    values: Vec<f32>,
}

impl Planes {
    /// One value per texel from each plane.
    pub fn joined(planes: &[Vec<f32>]) -> Self {
        let texels = planes.first().map_or(0, Vec::len);
        let values = (0..texels).flat_map(|i| planes.iter().map(move |p| p[i])).collect();
        Planes { channels: planes.len(), values }
    }

    /// The values of a texel.
    #[inline(always)]
    pub fn at(&self, texel: usize) -> &[f32] {
        &self.values[texel * self.channels..][..self.channels]
    }

    /// All values.
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    /// Squared difference of two texels.
    #[inline(always)]
    pub fn squared(&self, a: usize, b: usize) -> f32 {
        self.at(a).iter().zip(self.at(b)).fold(0.0, |s, (a, b)| s + (a - b) * (a - b))
    }
}

/// One plane per channel of the maps that weigh something, the mask only if that is wanted; if no map but the mask weighs
/// anything, of all of them alike.
pub(super) fn planes(maps: &MapSet, importance: &BTreeMap<MapKind, f64>, mask: bool) -> Vec<Vec<f32>> {
    let weight = |kind: MapKind| importance.get(&kind).copied().unwrap_or(0.0);
    let is_mask = |kind| kind == MapKind::FeatureMask;
    let none = maps.iter().all(|(kind, _)| weight(kind) <= 0.0 || is_mask(kind));
    let weight = |kind| if none && !is_mask(kind) { 1.0 } else { weight(kind) };
    let counting = maps.iter().filter(|(kind, _)| weight(*kind) > 0.0 && (mask || !is_mask(*kind)));
    counting.flat_map(|(kind, map)| feature_planes(kind, map, weight(kind).sqrt() as f32)).collect()
}
