//! A tile from its key exemplars.
//!
//! Source: \[MST09\] section 1, and section 4 for more than two keys (morphs of keys that follow each other, joined) and
//! for one (layers that share its mask hide its period, figure 14).
//! In: maps of each key, perhaps with its feature mask. Out: a [`Tile`].
//! Reads as: `layers` are those of the whole tile, the keys among them; keys lie as evenly as layers allow. The blend
//! is that of values: colours in linear light, normals made unit length.
//! Unaware of: files, meshes.

use std::collections::BTreeMap;

use super::constrained::{Stack, USAGE, Wish};
use super::layers::choose;
use super::morph::{mask_of, morph};
use super::planes::planes;
use super::{Error, Mask, Tile, find_features, seamless};
use crate::numerics::par;
use crate::numerics::rng::Key;
use crate::texture::{MapKind, MapSet, Texture};

/// Shortest side of a key, in texels.
const LEAST_SIDE: u32 = 8;
/// Most texels in all layers.
const MOST_TEXELS: u64 = 1 << 25;
/// Most layers.
const MOST_LAYERS: u32 = 256;
/// Steps of a morph per layer, at least: N >> M.
const STEPS_PER_LAYER: usize = 16;
/// What use costs in layers that hide a period: as [`USAGE`], but they begin anew, and would stay patchy.
const HIDDEN_USAGE: f64 = 1.0;
/// Layers that hide a period show no texel nearer to its own place than this share of the shorter side.
const APART: f64 = 0.125;

/// A key exemplar.
#[derive(Clone, Copy, Debug)]
pub struct KeyTile<'a> {
    /// Its maps; the feature mask may be among them, and is found in the others if it is not.
    pub maps: &'a MapSet,
    /// It wraps already, and is taken as it is.
    pub tileable: bool,
}

/// How a tile is made.
#[derive(Clone, Debug, PartialEq)]
pub struct TileParams {
    /// Layers, 2..=256, at least one per key.
    pub layers: u32,
    /// Another seed gives another tile of the same keys.
    pub seed: u64,
    /// Factor of each map's squared differences; maps that are not listed count nothing. If none but the mask counts,
    /// all count alike.
    pub importance: BTreeMap<MapKind, f64>,
    /// Factor of the penalty for using parts of a key more than is due: 1 as it should be, 0 for none.
    pub usage: f64,
}

impl Default for TileParams {
    fn default() -> Self {
        let counts = [MapKind::BaseColor, MapKind::Height, MapKind::FeatureMask];
        TileParams { layers: 8, seed: 1, importance: counts.map(|kind| (kind, 1.0)).into(), usage: 1.0 }
    }
}

/// What was found in a key.
#[derive(Clone, Debug, PartialEq)]
pub struct KeyReport {
    /// Its layer, counted from 0.
    pub layer: u32,
    /// Mean difference across its border as it came, and of the seams that are left, per texel of the border; 0 if it was
    /// said to wrap.
    pub border: [f64; 2],
    /// Share of texels inside features.
    pub features: f64,
    /// Whether the features were found in the maps, since no mask was given.
    pub found: bool,
}

/// What became of a layer.
#[derive(Clone, Debug, PartialEq)]
pub struct LayerReport {
    /// Share of texels inside features.
    pub features: f64,
    /// Share of texels in which its mask differs from that of the layer before; 0 for the first.
    pub moved: f64,
    /// Distance of its histograms, inside and between features, from those of the keys that it is made of: how far a value
    /// that is compared moves on average.
    pub histogram: f64,
}

/// What was found out on the way.
#[derive(Clone, Debug, PartialEq)]
pub struct TileReport {
    /// Key by key.
    pub keys: Vec<KeyReport>,
    /// Layer by layer.
    pub layers: Vec<LayerReport>,
}

/// Makes a tile; keys lie along the material axis in their order. One key gives layers that share its mask.
///
/// The same for any number of threads. Fails if there are no keys, too few layers, keys of different sizes or maps, or a key
/// without features or with nothing but features.
pub fn make(keys: &[KeyTile], params: &TileParams) -> Result<(Tile, TileReport), Error> {
    check(keys, params)?;
    let cut = par::map_chunks(keys.len(), 1, |r| Cut::new(&keys[r.start], r.start, params));
    let cut = cut.into_iter().collect::<Result<Vec<Cut>, Error>>()?;
    let at = |i: usize| {
        let (last, keys) = (params.layers as usize - 1, (cut.len() - 1).max(1));
        (2 * i * last + keys) / (2 * keys)
    };
    let (mut layers, mut masks) = (vec![cut[0].maps.clone()], vec![cut[0].mask.clone()]);
    let mut histograms = vec![0.0];
    if cut.len() == 1 {
        let (hidden, far) = cut[0].hidden(params);
        masks.resize(params.layers as usize, cut[0].mask.clone());
        layers.extend(hidden);
        histograms.extend(far);
    }
    for (i, pair) in cut.windows(2).enumerate() {
        let key = Key::new(params.seed).with_str("tile").with(i as u64);
        let morphed = between(&pair[0], &pair[1], at(i + 1) - at(i), key, params);
        for (mask, maps, histogram) in morphed {
            masks.push(mask);
            layers.push(maps);
            histograms.push(histogram);
        }
        masks.push(pair[1].mask.clone());
        layers.push(pair[1].maps.clone());
        histograms.push(0.0);
    }
    let texels = masks[0].data().len() as f64;
    let of_layer = |m: usize| LayerReport {
        features: masks[m].count() as f64 / texels,
        moved: if m == 0 { 0.0 } else { masks[m].differing(&masks[m - 1]) as f64 / texels },
        histogram: histograms[m],
    };
    let of_key = |(i, cut): (usize, &Cut)| KeyReport {
        layer: at(i) as u32,
        border: cut.border,
        features: cut.mask.count() as f64 / texels,
        found: cut.found,
    };
    let report = TileReport {
        keys: cut.iter().enumerate().map(of_key).collect(),
        layers: (0..masks.len()).map(of_layer).collect(),
    };
    let tile = Tile::new(layers, masks);
    Ok((tile.ok_or(Error::NoKeys)?, report))
}

/// Checks what can be before anything is computed.
fn check(keys: &[KeyTile], params: &TileParams) -> Result<(), Error> {
    let first = keys.first().ok_or(Error::NoKeys)?.maps;
    let least = keys.len().max(2) as u32;
    if !(least..=MOST_LAYERS).contains(&params.layers) {
        return Err(Error::Layers { found: params.layers, least, most: MOST_LAYERS });
    }
    let (width, height) = (first.width(), first.height());
    let texels = u64::from(width) * u64::from(height) * u64::from(params.layers);
    if width.min(height) < LEAST_SIDE || texels > MOST_TEXELS {
        let found = [width, height, params.layers];
        return Err(Error::Size { found, least_side: LEAST_SIDE, most_texels: MOST_TEXELS });
    }
    let kinds = |maps: &MapSet| maps.iter().map(|m| m.0).filter(|k| *k != MapKind::FeatureMask).collect::<Vec<_>>();
    for (KeyTile { maps, .. }, key) in keys.iter().zip(1..) {
        if (maps.width(), maps.height()) != (width, height) {
            return Err(Error::Sizes { key, found: [maps.width(), maps.height()], first: [width, height] });
        }
        if kinds(maps) != kinds(first) || kinds(maps).is_empty() {
            return Err(Error::Maps { key, found: kinds(maps), first: kinds(first) });
        }
        for (map, texture) in maps.iter() {
            if let Some(i) = texture.data().iter().position(|v| !v.is_finite()) {
                let (texel, value) = (i as u32 / texture.channels(), texture.data()[i]);
                return Err(Error::Value { key, map, texel: [texel % width, texel / width], value });
            }
        }
    }
    Ok(())
}

/// A key that wraps.
struct Cut {
    /// Its maps but the mask.
    maps: MapSet,
    mask: Mask,
    found: bool,
    border: [f64; 2],
    planes: Vec<Vec<f32>>,
    stack: Stack,
}

impl Cut {
    fn new(key: &KeyTile, number: usize, params: &TileParams) -> Result<Self, Error> {
        let (maps, border) = if key.tileable {
            (key.maps.clone(), [0.0, 0.0])
        } else {
            let made = seamless(key.maps, &params.importance);
            (made.apply(key.maps), [made.border, made.seams])
        };
        let given = maps.get(MapKind::FeatureMask).map(Mask::of_texture);
        let found = given.is_none();
        let mask = given.or_else(|| find_features(&maps, &params.importance)).filter(Mask::is_mixed);
        let mask = mask.ok_or_else(|| {
            let on = maps.get(MapKind::FeatureMask).is_some_and(|m| m.get(0, 0)[0] > 0.5);
            Error::Mask { key: number + 1, on, found }
        })?;
        let planes = planes(&maps, &params.importance, false);
        let stack = Stack::new(planes.clone(), &mask);
        let others = maps.iter().filter(|(kind, _)| *kind != MapKind::FeatureMask);
        let maps = MapSet::new(others.map(|(kind, map)| (kind, map.clone())).collect());
        Ok(Cut { maps, mask, found, border, planes, stack })
    }

    /// Layers after the first that share the mask, and how far their histograms are.
    fn hidden(&self, params: &TileParams) -> (Vec<MapSet>, Vec<f64>) {
        let apart = APART * f64::from(self.mask.width().min(self.mask.height()));
        let key = Key::new(params.seed).with_str("tile");
        let wish = Wish { key, usage: HIDDEN_USAGE * params.usage, apart: Some(apart) };
        let sources = self.stack.synthesise(&vec![self.mask.clone(); params.layers as usize - 1], &wish);
        sources.iter().map(|s| (blended(self, s, self, s, 0.0), self.histogram(s, &self.mask))).unzip()
    }

    /// How far a value of the planes moves on average if those that the key has inside, and between, its features become
    /// those that a layer shows inside and between its own.
    fn histogram(&self, sources: &[u32], mask: &Mask) -> f64 {
        let texels = self.mask.data().len();
        let side = |on: bool, mask: &Mask| (0..texels).filter(|i| mask.data()[*i] == on).collect::<Vec<usize>>();
        let sides = [false, true].map(|on| (side(on, mask), side(on, &self.mask)));
        let distances = par::map_chunks(self.planes.len(), 1, |r| {
            let plane = &self.planes[r.start];
            let sorted = |values: &mut dyn Iterator<Item = f32>| {
                let mut values: Vec<f32> = values.collect();
                values.sort_unstable_by(f32::total_cmp);
                values
            };
            let of_side = |(places, own): &(Vec<usize>, Vec<usize>)| {
                let shown = sorted(&mut places.iter().map(|i| plane[sources[*i] as usize]));
                let own = sorted(&mut own.iter().map(|i| plane[*i]));
                let due = |i: usize| own[(2 * i + 1) * own.len() / (2 * shown.len())];
                shown.iter().enumerate().map(|(i, v)| f64::from((v - due(i)).abs())).sum::<f64>()
            };
            sides.iter().map(of_side).sum::<f64>() / texels as f64
        });
        distances.iter().sum::<f64>() / distances.len().max(1) as f64
    }
}

/// The layers between two keys, the second `last` layers after the first: mask, maps and histogram distance of each.
fn between(first: &Cut, second: &Cut, last: usize, key: Key, params: &TileParams) -> Vec<(Mask, MapSet, f64)> {
    if last < 2 {
        return Vec::new();
    }
    let (width, height) = (first.mask.width(), first.mask.height());
    let steps = morph(&first.mask, &second.mask, STEPS_PER_LAYER * last);
    let chosen = choose(&steps, last);
    let masks: Vec<Mask> = chosen[1..last].iter().map(|n| mask_of(&steps[*n], width, height)).collect();
    let backwards: Vec<Mask> = masks.iter().rev().cloned().collect();
    let wish = |side| Wish { key: key.with(side), usage: USAGE * params.usage, apart: None };
    let (forth, mut back) =
        par::join(|| first.stack.synthesise(&masks, &wish(0)), || second.stack.synthesise(&backwards, &wish(1)));
    back.reverse();
    let layer = |(i, mask): (usize, Mask)| {
        let share = (i + 1) as f32 / last as f32;
        let maps = blended(first, &forth[i], second, &back[i], share);
        let histogram = 0.5 * (first.histogram(&forth[i], &mask) + second.histogram(&back[i], &mask));
        (mask, maps, histogram)
    };
    masks.into_iter().enumerate().map(layer).collect()
}

/// What two keys show, the second by a share.
fn blended(first: &Cut, forth: &[u32], second: &Cut, back: &[u32], share: f32) -> MapSet {
    let map = |(kind, a): (MapKind, &Texture)| {
        let channels = a.channels() as usize;
        let b = second.maps.get(kind).unwrap_or(a);
        let mixed = Texture::from_fn(a.width(), a.height(), a.channels(), |x, y, out| {
            let place = (y * a.width() + x) as usize;
            let (from, to) = (forth[place] as usize * channels, back[place] as usize * channels);
            for (c, o) in out.iter_mut().enumerate() {
                *o = a.data()[from + c] * (1.0 - share) + b.data()[to + c] * share;
            }
            if kind == MapKind::Normal && share > 0.0 {
                let length = out.iter().map(|v| v * v).sum::<f32>().sqrt();
                // Opposite normals have no mean.
                let unit = [0.0, 0.0, 1.0];
                let way = out.iter_mut().zip(unit);
                way.for_each(|(o, z)| *o = if length > 1e-6 { *o / length } else { z });
            }
        });
        (kind, mixed)
    };
    MapSet::new(first.maps.iter().map(map).collect())
}
