//! Steps: a material-space tile from its keys (\[MST09\] section 1), its texture, its pictures and its report.

use serde_json::json;

use crate::bake::mip_chain;
use crate::build::{Inputs, Step, StepError, Visitor};
use crate::io::artefact::{Artefact, Damaged, Reader, Writer};
use crate::io::image_file::{Compression, Transfer, encode_png};
use crate::io::ktx2::{LayeredTexture, Shape, write_ktx2};
use crate::io::{Pixels, SampleType, Samples};
use crate::recipe::{MapFile, Word};
use crate::texture::{MapKind, MapSet, Texture};
use crate::tile::{KeyReport, KeyTile, LayerReport, Mask, Tile, TileParams, TileReport, make};

use super::rasterise::{ImageSpec, images};

/// A tile and what was found out on the way.
pub(super) struct MadeTile {
    pub tile: Tile,
    pub report: TileReport,
}

impl Artefact for Tile {
    const TAG: [u8; 4] = *b"tile";

    fn write(&self, to: &mut Writer) {
        to.put(self.depth());
        for (maps, mask) in self.layers().iter().zip(self.masks()) {
            maps.write(to);
            to.slice(&mask.data().iter().map(|on| u8::from(*on)).collect::<Vec<u8>>());
        }
    }

    fn read(from: &mut Reader<'_>) -> Result<Self, Damaged> {
        let damaged = || Damaged("layers of a tile that do not fit each other".into());
        let (mut layers, mut masks) = (Vec::new(), Vec::new());
        for _ in 0..from.get::<u32>()? {
            let maps = MapSet::read(from)?;
            let on: Vec<u8> = from.slice()?;
            if on.len() != maps.width() as usize * maps.height() as usize {
                return Err(damaged());
            }
            masks.push(Mask::new(maps.width(), on.into_iter().map(|v| v != 0).collect()));
            layers.push(maps);
        }
        Tile::new(layers, masks).ok_or_else(damaged)
    }
}

impl Artefact for MadeTile {
    const TAG: [u8; 4] = *b"mtil";

    fn write(&self, to: &mut Writer) {
        self.tile.write(to);
        to.put(self.report.keys.len() as u32);
        for KeyReport { layer, border, features, found } in &self.report.keys {
            to.put([*layer, u32::from(*found)]);
            to.put([border[0], border[1], *features]);
        }
        to.put(self.report.layers.len() as u32);
        for LayerReport { features, moved, histogram } in &self.report.layers {
            to.put([*features, *moved, *histogram]);
        }
    }

    fn read(from: &mut Reader<'_>) -> Result<Self, Damaged> {
        let tile = Tile::read(from)?;
        let mut report = TileReport { keys: Vec::new(), layers: Vec::new() };
        for _ in 0..from.get::<u32>()? {
            let [layer, found] = from.get::<[u32; 2]>()?;
            let [before, after, features] = from.get::<[f64; 3]>()?;
            report.keys.push(KeyReport { layer, border: [before, after], features, found: found != 0 });
        }
        for _ in 0..from.get::<u32>()? {
            let [features, moved, histogram] = from.get::<[f64; 3]>()?;
            report.layers.push(LayerReport { features, moved, histogram });
        }
        Ok(MadeTile { tile, report })
    }
}

/// Reads the maps of each key.
pub(super) struct MakeTile {
    pub recipe: String,
    pub params: TileParams,
    /// The keys wrap already.
    pub tileable: bool,
}

impl Step for MakeTile {
    super::step_identity!("tile", 4, travels);

    fn describe(&self, v: &mut dyn Visitor) {
        let TileParams { layers, seed, importance, usage } = &self.params;
        v.param("layers", layers);
        v.param("seed", seed);
        v.param("importance", importance);
        v.param("usage", usage);
        v.param("tileable", &self.tileable);
    }

    fn run(&self, inputs: &Inputs) -> Result<Vec<u8>, StepError> {
        let maps = (0..inputs.len()).map(|i| super::read(inputs, i)).collect::<Result<Vec<MapSet>, StepError>>()?;
        let maps = alike(maps);
        let keys: Vec<KeyTile> = maps.iter().map(|maps| KeyTile { maps, tileable: self.tileable }).collect();
        let (tile, report) = make(&keys, &self.params)?;
        Ok(MadeTile { tile, report }.to_bytes())
    }
}

/// The keys, with opaque maps of opacity for those that lack one that others have.
fn alike(keys: Vec<MapSet>) -> Vec<MapSet> {
    let has = |maps: &MapSet| maps.get(MapKind::Opacity).is_some();
    if !keys.iter().any(has) {
        return keys;
    }
    let with = |maps: MapSet| {
        let opaque = Texture::from_fn(maps.width(), maps.height(), 1, |_, _, out| out[0] = 1.0);
        let added = (!has(&maps)).then_some((MapKind::Opacity, opaque));
        MapSet::new(maps.iter().map(|(kind, map)| (kind, map.clone())).chain(added).collect())
    };
    keys.into_iter().map(with).collect()
}

/// Reads a tile and writes the texture of one of its maps.
pub(super) struct TileTexture {
    pub recipe: String,
    pub map: MapFile,
    pub shape: Shape,
}

impl Step for TileTexture {
    fn name(&self) -> String {
        format!("{}/tile texture {}", self.recipe, self.map.name())
    }

    fn kind(&self) -> &'static str {
        "tile texture"
    }

    fn revision(&self) -> u32 {
        1
    }

    fn describe(&self, v: &mut dyn Visitor) {
        v.param("map", &self.map);
        v.param("shape", &self.shape);
    }

    fn run(&self, inputs: &Inputs) -> Result<Vec<u8>, StepError> {
        let MadeTile { tile, .. } = super::read(inputs, 0)?;
        Ok(write_ktx2(&texture(&tile, self.map, self.shape)?)?)
    }
}

/// The layers of a map as a texture; an array has all mip levels, in s and t only.
fn texture(tile: &Tile, map: MapFile, shape: Shape) -> Result<LayeredTexture, StepError> {
    let srgb = map.kinds()[0].is_srgb();
    let mut levels: Vec<Vec<u8>> = Vec::new();
    for maps in tile.layers() {
        // Each map is halved for itself, so that normals stay unit vectors and alpha stays by its colour.
        let chains: Vec<(MapKind, Vec<Texture>)> = match shape {
            Shape::Volume => Vec::new(),
            Shape::Array => maps.iter().map(|(kind, t)| (kind, mip_chain(kind, t))).collect(),
        };
        let count = 1 + chains.first().map_or(0, |c| c.1.len());
        levels.resize_with(count.max(levels.len()), Vec::new);
        for (l, level) in levels.iter_mut().enumerate() {
            let pixels = match l {
                0 => image(maps, map)?,
                _ => image(&MapSet::new(chains.iter().map(|(k, c)| (*k, c[l - 1].clone())).collect()), map)?,
            };
            level.extend(rgba(&pixels));
        }
    }
    Ok(LayeredTexture { width: tile.width(), height: tile.height(), layers: tile.depth(), srgb, shape, levels })
}

/// A map as a file holds it, 8 bits per sample.
fn image(maps: &MapSet, map: MapFile) -> Result<Pixels, StepError> {
    let bundle = images(&[ImageSpec { file: map, depth: SampleType::U8 }], maps, false, |_, t| Ok(t.clone()))?;
    Ok(bundle.get(map.name())?.clone())
}

/// Samples widened to RGBA: one channel is repeated, alpha is 255 where there is none.
fn rgba(pixels: &Pixels) -> Vec<u8> {
    let Samples::U8(samples) = &pixels.samples else { return Vec::new() };
    let wide = |texel: &[u8]| match *texel {
        [v] => [v, v, v, 255],
        [v, a] => [v, v, v, a],
        [r, g, b] => [r, g, b, 255],
        [r, g, b, a, ..] => [r, g, b, a],
        [] => [0; 4],
    };
    samples.chunks_exact(pixels.channels as usize).flat_map(wide).collect()
}

/// Reads a tile and writes the layers of one of its maps beside each other, for people.
pub(super) struct TileStrip {
    pub recipe: String,
    /// The map; `None`: the feature masks.
    pub map: Option<MapFile>,
}

impl Step for TileStrip {
    fn name(&self) -> String {
        format!("{}/tile strip {}", self.recipe, self.map.map_or(MapKind::FeatureMask.name(), |m| m.name()))
    }

    fn kind(&self) -> &'static str {
        "tile strip"
    }

    fn revision(&self) -> u32 {
        1
    }

    fn describe(&self, v: &mut dyn Visitor) {
        v.param("map", &self.map);
    }

    fn run(&self, inputs: &Inputs) -> Result<Vec<u8>, StepError> {
        let MadeTile { tile, .. } = super::read(inputs, 0)?;
        let layers = match self.map {
            Some(map) => tile.layers().iter().map(|maps| image(maps, map)).collect::<Result<Vec<_>, _>>()?,
            None => tile.masks().iter().map(mask_image).collect(),
        };
        let srgb = self.map.is_some_and(|map| map.kinds()[0].is_srgb());
        let transfer = if srgb { Transfer::Srgb } else { Transfer::Unstated };
        Ok(encode_png(&beside(&layers), Compression::Fast, transfer)?)
    }
}

fn mask_image(mask: &Mask) -> Pixels {
    let samples = Samples::U8(mask.data().iter().map(|on| 255 * u8::from(*on)).collect());
    Pixels { width: mask.width(), height: mask.height(), channels: 1, samples }
}

/// Images of one size from left to right.
fn beside(images: &[Pixels]) -> Pixels {
    let (width, height, channels) = images.first().map_or((0, 0, 1), |p| (p.width, p.height, p.channels));
    let row = (width * channels) as usize;
    let mut out = Vec::new();
    for y in 0..height as usize {
        for pixels in images {
            if let Samples::U8(samples) = &pixels.samples {
                out.extend_from_slice(&samples[y * row..(y + 1) * row]);
            }
        }
    }
    Pixels { width: width * images.len() as u32, height, channels, samples: Samples::U8(out) }
}

/// Reads a tile and writes `report.json`.
pub(super) struct ReportTile {
    pub recipe: String,
}

impl Step for ReportTile {
    super::step_identity!("report", 1);

    fn describe(&self, v: &mut dyn Visitor) {
        v.param("recipe", &self.recipe);
    }

    fn run(&self, inputs: &Inputs) -> Result<Vec<u8>, StepError> {
        let made: MadeTile = super::read(inputs, 0)?;
        super::report::text(&json!({ "recipe": self.recipe, "tile": facts(&made) }))
    }
}

/// The tile that an artefact of the cache holds, in numbers; `None`: it holds none.
pub(crate) fn described(artefact: &[u8]) -> Option<Result<serde_json::Value, Damaged>> {
    MadeTile::is_one(artefact).then(|| MadeTile::from_bytes(artefact).map(|made| facts(&made)))
}

/// A tile in numbers.
pub(super) fn facts(MadeTile { tile, report }: &MadeTile) -> serde_json::Value {
    let key = |k: &KeyReport| {
        let features = if k.found { "found" } else { "given" };
        json!({
            "layer": k.layer,
            "features": features,
            "border_difference": k.border[0],
            "seam_difference": k.border[1],
        })
    };
    let layer = |l: &LayerReport| json!({ "inside_features": l.features, "mask_moved": l.moved, "histogram_distance": l.histogram });
    json!({
        "width": tile.width(),
        "height": tile.height(),
        "maps": tile.kinds().iter().map(|k| k.name()).collect::<Vec<_>>(),
        "keys": report.keys.iter().map(key).collect::<Vec<_>>(),
        "layers": report.layers.iter().map(layer).collect::<Vec<_>>(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn made() -> MadeTile {
        let layer = |m: u32| {
            let color = Texture::from_fn(4, 2, 3, |x, _, out| out.fill((x + m) as f32 / 8.0));
            let height = Texture::from_fn(4, 2, 1, |_, y, out| out[0] = (y + m) as f32 / 4.0);
            MapSet::new(vec![(MapKind::BaseColor, color), (MapKind::Height, height)])
        };
        let masks = (0..3).map(|m| Mask::from_fn(4, 2, |x, _| x == m)).collect();
        let tile = Tile::new((0..3).map(layer).collect(), masks).expect("layers that fit");
        let keys = vec![KeyReport { layer: 2, border: [0.5, 0.25], features: 0.3, found: true }];
        let layers = vec![LayerReport { features: 0.5, moved: 0.1, histogram: 0.01 }; 3];
        MadeTile { tile, report: TileReport { keys, layers } }
    }

    #[test]
    fn tiles_survive_the_round_trip_and_damage_is_told() {
        let made = made();
        let bytes = made.to_bytes();
        let read = MadeTile::from_bytes(&bytes).expect("whole");
        assert_eq!((&read.tile, &read.report), (&made.tile, &made.report));
        for cut in 0..bytes.len() {
            assert!(MadeTile::from_bytes(&bytes[..cut]).is_err(), "cut at {cut}");
        }
        assert_eq!(described(&bytes), Some(Ok(facts(&made))));
        assert!(matches!(described(&bytes[..40]), Some(Err(_))) && described(b"none").is_none());
        assert_eq!(Tile::from_bytes(&made.tile.to_bytes()), Ok(made.tile));
    }

    #[test]
    fn arrays_have_mips_in_s_and_t_and_volumes_have_none() {
        let tile = made().tile;
        let array = texture(&tile, MapFile::Height, Shape::Array).expect("a texture");
        assert_eq!(array.levels.iter().map(Vec::len).collect::<Vec<_>>(), [4 * 8 * 3, 4 * 2 * 3, 4 * 3]);
        // Layer by layer, each the mean of its own rows: 0.125, 0.375, 0.625.
        assert_eq!(array.levels[2], [32, 32, 32, 255, 96, 96, 96, 255, 159, 159, 159, 255]);
        let volume = texture(&tile, MapFile::BaseColor, Shape::Volume).expect("a texture");
        assert_eq!((volume.levels.len(), volume.srgb, volume.layers), (1, true, 3));
        assert_eq!(volume.levels[0][..4], [0, 0, 0, 255]);
    }

    #[test]
    fn layers_lie_beside_each_other() {
        let images: Vec<Pixels> = made().tile.masks().iter().map(mask_image).collect();
        let strip = beside(&images);
        let on = 255;
        assert_eq!((strip.width, strip.height), (12, 2));
        assert_eq!(strip.samples, Samples::U8([[on, 0, 0, 0, 0, on, 0, 0, 0, 0, on, 0]; 2].concat()));
    }
}
