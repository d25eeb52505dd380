//! Pictures of a synthesised canvas, made in strips: its maps, and what helps to see how it came about.
//!
//! Maps are copied along the sources (\[ZG02\] section 3). For looking into a synthesis:
//! - patches: the place in the exemplar that each pixel shows, red to the right, green down, blue what is left: "colour
//!   corresponds to position in input from which pixel was copied" (\[ZG02\] figure 3).
//! - sources: the same as numbers, lossless ([`crate::io::source_file`]).
//! - jumps: white where a pixel goes on with the patch neither of its left nor of its upper neighbour, grey where with one
//!   of them only, black inside patches.

use std::io::{Seek, Write};
use std::ops::Range;

use crate::bake::pack_orm;
use crate::build::StepError;
use crate::io::image_quantise::quantise;
use crate::io::image_restore::restore;
use crate::io::image_strips::{Container, Shape, StripError, write_image};
use crate::io::source_file::source_pixels;
use crate::io::{Pixels, SampleType, Samples};
use crate::numerics::par;
use crate::recipe::{CanvasDebug, MapFile, Word};
use crate::synth::image::copy::{BlendKernel, Bounds, copy_bounded};
use crate::synth::image::source_map::{Rect, SourceMap, Surroundings};
use crate::synth::image::source_strips::SourceStrips;
use crate::texture::{MapKind, MapSet, Texture};

use super::rasterise::encoding;

/// What a picture shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Picture {
    /// A map, with so many bits.
    Map(MapFile, SampleType),
    /// How the canvas came about.
    Debug(CanvasDebug),
}

/// A picture to be made of a canvas.
#[derive(Clone, Copy)]
pub struct Painting<'a> {
    /// Where every pixel comes from.
    pub sources: &'a SourceStrips,
    /// The exemplar's maps.
    pub maps: &'a MapSet,
    /// What is shown.
    pub picture: Picture,
    /// How patches are blended in maps.
    pub kernel: BlendKernel,
    /// What limits blending; `plain` is of the whole canvas, and then so are the sources.
    pub bounds: Bounds<'a>,
    /// The file of a map that is filled in: where the canvas is plain, its samples are what is shown.
    pub original: Option<&'a Pixels>,
}

impl Painting<'_> {
    /// Encodes the picture strip by strip.
    pub fn write(&self, to: &mut (impl Write + Seek + Send + ?Sized), container: Container) -> Result<(), StripError> {
        write_image(to, &self.shape(), container, &|rows| self.rows(rows))
    }

    fn shape(&self) -> Shape {
        let (channels, depth) = match self.picture {
            Picture::Map(MapFile::BaseColor, depth) if self.maps.get(MapKind::Opacity).is_some() => (4, depth),
            Picture::Map(MapFile::Orm, depth) => (3, depth),
            Picture::Map(file, depth) => (file.kinds()[0].channels(), depth),
            Picture::Debug(CanvasDebug::Patches) => (3, SampleType::U8),
            Picture::Debug(CanvasDebug::Sources) => (3, SampleType::U16),
            Picture::Debug(CanvasDebug::Jumps) => (1, SampleType::U8),
        };
        let Rect { width, height, .. } = self.sources.part;
        Shape { width, height, channels, depth }
    }

    fn rows(&self, rows: Range<u32>) -> Result<Pixels, StepError> {
        let part = Rect { x: 0, y: rows.start, width: self.sources.part.width, height: rows.len() as u32 };
        let apron = match self.picture {
            Picture::Map(..) => self.kernel.reach(),
            Picture::Debug(CanvasDebug::Jumps) => 1,
            Picture::Debug(_) => 0,
        };
        let plain = self.plain(part, apron);
        let (map, part) = self.sources.window(part, apron)?;
        let bounds = Bounds { plain: plain.as_deref(), ..self.bounds };
        Ok(match self.picture {
            Picture::Map(file, depth) => {
                let mut image = quantise(&self.copied(file, &map, part, &bounds)?, encoding(file), depth)?;
                if let (Some(original), Some(plain)) = (self.original, self.bounds.plain) {
                    restore(&mut image, original, plain, rows.start);
                }
                image
            }
            Picture::Debug(CanvasDebug::Patches) => patches(&map),
            Picture::Debug(CanvasDebug::Sources) => {
                source_pixels(&SourceMap { tileable: self.sources.tileable, ..map })
            }
            Picture::Debug(CanvasDebug::Jumps) => jumps(&map, part),
        })
    }

    /// Which pixels are plain copies, of a part and what is around it.
    fn plain(&self, part: Rect, apron: u32) -> Option<Vec<bool>> {
        let plain = self.bounds.plain?;
        let [w, h] = self.sources.size;
        assert_eq!(plain.len(), w as usize * h as usize, "plain pixels of another canvas");
        let Surroundings { origin, size, .. } = part.with_apron(apron, [w, h], self.sources.tileable);
        let at = |x: u32, y: u32| plain[((origin[1] + y) % h) as usize * w as usize + ((origin[0] + x) % w) as usize];
        Some((0..size[1]).flat_map(|y| (0..size[0]).map(move |x| at(x, y))).collect())
    }

    fn copied(&self, file: MapFile, map: &SourceMap, part: Rect, bounds: &Bounds) -> Result<Texture, StepError> {
        let get = |kind: MapKind| {
            let texture = self.maps.get(kind)?;
            let mut out = copy_bounded(texture, map, part, self.kernel, bounds);
            if kind == MapKind::Normal {
                renormalise(&mut out);
            }
            Some(out)
        };
        let texture = match file {
            MapFile::Orm => {
                let [o, r, m] = [MapKind::Occlusion, MapKind::Roughness, MapKind::Metallic].map(get);
                pack_orm(o.as_ref(), r.as_ref(), m.as_ref())
            }
            MapFile::BaseColor => match (get(MapKind::BaseColor), get(MapKind::Opacity)) {
                (Some(color), Some(alpha)) => Some(color.with_alpha(&alpha)),
                (color, _) => color,
            },
            single => get(single.kinds()[0]),
        };
        texture.ok_or_else(|| format!("the exemplar has no {} map", file.name()).into())
    }
}

/// Makes vectors of three unit length; one without a direction points straight out.
pub(super) fn renormalise(normals: &mut Texture) {
    let row = normals.width() as usize * 3;
    par::for_rows(normals.data_mut(), row, |_, row| {
        for n in row.chunks_exact_mut(3) {
            let l = (n[0] * n[0] + n[1] * n[1] + n[2] * n[2]).sqrt();
            if l > 1e-6 {
                n.iter_mut().for_each(|v| *v /= l);
            } else {
                n.copy_from_slice(&[0.0, 0.0, 1.0]);
            }
        }
    });
}

fn patches(map: &SourceMap) -> Pixels {
    let share = |at: u16, side: u32| u64::from(at) * 255 / u64::from(side.max(2) - 1);
    let color = |s: &[u16; 2]| {
        let (x, y) = (share(s[0], map.exemplar_size[0]), share(s[1], map.exemplar_size[1]));
        [x as u8, y as u8, 255 - ((x + y) / 2) as u8]
    };
    let samples = Samples::U8(map.sources.iter().flat_map(color).collect());
    Pixels { width: map.width, height: map.height, channels: 3, samples }
}

fn jumps(map: &SourceMap, part: Rect) -> Pixels {
    let source = |x: u32, y: u32| map.sources[y as usize * map.width as usize + x as usize];
    let value = |x: u32, y: u32| {
        let [sx, sy] = source(x, y);
        // At the border of the canvas there is no neighbour to go on with, and none not to.
        let left = x == 0 || source(x - 1, y) == [sx.wrapping_sub(1), sy];
        let above = y == 0 || source(x, y - 1) == [sx, sy.wrapping_sub(1)];
        match (left, above) {
            (true, true) => 0,
            (false, false) => 255,
            _ => 128,
        }
    };
    let (columns, rows) = (part.x..part.x + part.width, part.y..part.y + part.height);
    let samples = Samples::U8(rows.flat_map(|y| columns.clone().map(move |x| value(x, y))).collect());
    Pixels { width: part.width, height: part.height, channels: 1, samples }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two patches of a 5 x 4 exemplar side by side.
    fn map() -> SourceMap {
        let sources = vec![[0, 0], [1, 0], [3, 2], [4, 2], [0, 1], [1, 1], [3, 3], [4, 3]];
        SourceMap { width: 4, height: 2, exemplar_size: [5, 4], sources, tileable: true, counters: Default::default() }
    }

    fn painted(picture: Picture, kernel: BlendKernel) -> Pixels {
        let maps = MapSet::new(vec![
            (MapKind::BaseColor, Texture::from_fn(5, 4, 3, |x, y, out| out.fill((x + 5 * y) as f32 / 20.0))),
            (MapKind::Normal, Texture::from_fn(5, 4, 3, |x, _, out| out[(x % 3) as usize] = 1.0)),
            (MapKind::Roughness, Texture::from_fn(5, 4, 1, |_, y, out| out[0] = y as f32 / 3.0)),
        ]);
        let sources = SourceStrips::of(&map());
        let bounds = Bounds::default();
        Painting { sources: &sources, maps: &maps, picture, kernel, bounds, original: None }.rows(0..2).unwrap()
    }

    #[test]
    fn patches_and_jumps_and_sources_show_the_map() {
        let patches = painted(Picture::Debug(CanvasDebug::Patches), BlendKernel::Five);
        assert_eq!((patches.width, patches.height), (4, 2));
        let Samples::U8(colors) = patches.samples else { panic!("8 bits") };
        assert_eq!(colors[..6], [0, 0, 255, 63, 0, 224]);
        assert_eq!(colors[21..], [255, 255, 0]);
        let jumps = painted(Picture::Debug(CanvasDebug::Jumps), BlendKernel::None);
        // The map wraps: at the left border the patch of the right one ends, at the upper one that of the lower.
        assert_eq!(jumps.samples, Samples::U8(vec![255, 128, 255, 128, 128, 0, 128, 0]));
        let sources = painted(Picture::Debug(CanvasDebug::Sources), BlendKernel::None);
        assert_eq!(sources, source_pixels(&map()));
    }

    #[test]
    fn every_map_is_copied_and_normals_stay_normals() {
        let roughness = painted(Picture::Map(MapFile::Roughness, SampleType::U8), BlendKernel::None);
        assert_eq!(roughness.samples, Samples::U8(vec![0, 0, 170, 170, 85, 85, 255, 255]));
        let orm = painted(Picture::Map(MapFile::Orm, SampleType::F32), BlendKernel::None);
        assert!(matches!(orm.samples, Samples::F32(v) if v[..3] == [1.0, 0.0, 0.0]));
        let normals = painted(Picture::Map(MapFile::Normal, SampleType::F32), BlendKernel::Three);
        let Samples::F32(v) = normals.samples else { panic!("floats") };
        for n in v.chunks_exact(3) {
            let length: f32 = n.iter().map(|v| (v * 2.0 - 1.0) * (v * 2.0 - 1.0)).sum();
            assert!((length - 1.0).abs() < 1e-5, "{n:?}");
        }
    }
}
