//! The image files of one sample to a [`MapSet`].
//!
//! In: the bytes of each file and the slot it fills. Out: linear float maps of one size, or every fault that was found.
//! How samples become values:
//! - Colour (base colour, emissive): sRGB in 8- and 16-bit files, linear in EXR; grey files give three equal channels.
//! - Alpha of the base colour becomes opacity, unless it is 1 everywhere or opacity has a file of its own.
//! - Normals: `v * 2 - 1`, also in EXR; y is turned when the file's points down; then made unit length (a vector
//!   without a direction becomes (0, 0, 1)).
//! - Numbers (roughness, metallic, occlusion, height, opacity): the first channel. Roughness, metallic, occlusion and
//!   opacity are shares: an EXR's values beyond 0..1, such as filters leave, are clamped. Height and colour are kept.
//! - Feature mask: the first channel, 1 from 0.5 upwards, else 0.
//! - `orm`: red is occlusion, green roughness, blue metallic, each unless it has a file of its own.
//!
//! Unaware of: paths, recipes, what the maps are for.

use super::image_file::{ImageError, Limits, decode_pixels};
use super::{Pixels, Samples};
use crate::numerics::par;
use crate::texture::color::srgb_to_linear;
use crate::texture::{MapKind, MapSet, Texture};
use std::fmt;
use std::sync::OnceLock;

/// Texels that a side must have: three levels of analysis halve it twice, and the coarsest still needs two texels.
pub const MIN_SIDE: u32 = 8;
/// Texels that a side may have: analysis is meant for samples; larger ones take minutes and show no more.
pub const MAX_SIDE: u32 = 4096;

/// What a file is given as.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Slot {
    /// One map.
    Map(MapKind),
    /// Occlusion, roughness and metallic in red, green and blue.
    Orm,
}

impl Slot {
    /// The name used in recipes.
    pub fn name(self) -> &'static str {
        match self {
            Slot::Map(kind) => kind.name(),
            Slot::Orm => "orm",
        }
    }
}

/// Where green points in the normal map.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum NormalY {
    /// Up in the image (OpenGL).
    #[default]
    Up,
    /// Down in the image (DirectX).
    Down,
}

/// How to read a set.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Options {
    /// Where green points in the normal map.
    pub normal_y: NormalY,
}

/// A fault in one file of a set, or between files. Names files as they were given.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum SetError {
    /// There is no file, or nothing but a feature mask.
    NoMaps,
    /// Two files for one slot.
    Twice {
        /// The slot.
        slot: Slot,
    },
    /// A file cannot be decoded.
    Image {
        /// The file.
        file: String,
        /// What it was given as.
        slot: Slot,
        /// Why.
        error: ImageError,
    },
    /// A side is too short or too long for a sample.
    Side {
        /// The file.
        file: String,
        /// Texels per row.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// Two files differ in size.
    Sizes {
        /// The first file.
        file: String,
        /// Its size.
        size: [u32; 2],
        /// The file that differs.
        other: String,
        /// The size of that.
        other_size: [u32; 2],
    },
    /// A file has too few channels for its slot.
    Channels {
        /// The file.
        file: String,
        /// What it was given as.
        slot: Slot,
        /// The channels it has.
        found: u32,
        /// The channels it needs.
        needed: u32,
    },
    /// A NaN or an infinity.
    NotFinite {
        /// The file.
        file: String,
        /// What it was given as.
        slot: Slot,
        /// Column and row of the first such texel.
        texel: [u32; 2],
        /// The value.
        value: f32,
    },
    /// A normal map whose components are stored as -1..1.
    SignedNormal {
        /// The file.
        file: String,
        /// Column and row of the first such texel.
        texel: [u32; 2],
        /// The value.
        value: f32,
    },
    /// A feature mask that is the same everywhere marks no feature.
    UniformMask {
        /// The file.
        file: String,
        /// 0 or 1.
        value: f32,
    },
}

impl fmt::Display for SetError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            SetError::NoMaps => write!(f, "the sample has no map; give at least one, such as base_color"),
            SetError::Twice { slot } => write!(f, "two files are given as {}", slot.name()),
            SetError::Image { file, slot, error } => write!(f, "{} `{file}`: {error}", slot.name()),
            SetError::Side { file, width, height } => write!(
                f,
                "`{file}` is {width}x{height}; each side of a sample may have {MIN_SIDE} to {MAX_SIDE} texels"
            ),
            SetError::Sizes { file, size: [w, h], other, other_size: [ow, oh] } => write!(
                f,
                "`{file}` is {w}x{h}, but `{other}` is {ow}x{oh}; all maps of a sample must have the same size"
            ),
            SetError::Channels { file, slot, found, needed } => {
                write!(f, "{} `{file}` has {found} channel(s); it needs {needed}", slot.name())
            }
            SetError::NotFinite { file, slot, texel: [x, y], value } => {
                write!(f, "{} `{file}` holds {value} at texel ({x}, {y}); values must be finite", slot.name())
            }
            SetError::SignedNormal { file, texel: [x, y], value } => write!(
                f,
                "normal `{file}` holds {value} at texel ({x}, {y}); normals are stored as 0 to 1, where 0.5 means 0"
            ),
            SetError::UniformMask { file, value } => write!(
                f,
                "feature_mask `{file}` is {} everywhere (threshold 0.5), so it marks no feature",
                if *value == 0.0 { "black" } else { "white" }
            ),
        }
    }
}

impl std::error::Error for SetError {}

/// Decodes the files of one sample: `slots` are (slot, name for messages, bytes), in any order.
///
/// All maps have one size, each side [`MIN_SIDE`] to [`MAX_SIDE`] texels, and hold finite values. All faults are told:
/// files that cannot be decoded, then sizes, then what is wrong with samples, each in the order of [`Slot`].
pub fn load(slots: &[(Slot, &str, &[u8])], options: &Options) -> Result<MapSet, Vec<SetError>> {
    let mut slots = slots.to_vec();
    slots.sort_by_key(|(slot, _, _)| *slot);
    if slots.iter().all(|(slot, _, _)| *slot == Slot::Map(MapKind::FeatureMask)) {
        return Err(vec![SetError::NoMaps]);
    }
    if let Some(twice) = slots.windows(2).find(|w| w[0].0 == w[1].0) {
        return Err(vec![SetError::Twice { slot: twice[0].0 }]);
    }
    // Twice the greatest side: what is a little too large is refused as a sample, what is far too large as an image.
    let limits = Limits { max_side: 2 * MAX_SIDE, ..Limits::default() };
    let decoded = par::map_chunks(slots.len(), 1, |i| decode_pixels(slots[i.start].2, &limits));
    let mut errors = Vec::new();
    let mut files = Vec::new();
    for ((slot, file, _), pixels) in slots.iter().zip(decoded) {
        match pixels {
            Ok(pixels) => files.push(File { slot: *slot, name: file, pixels }),
            Err(error) => errors.push(SetError::Image { file: file.to_string(), slot: *slot, error }),
        }
    }
    check_sizes(&files, &mut errors);
    for file in &files {
        errors.extend(file.check());
    }
    if !errors.is_empty() {
        return Err(errors);
    }
    let maps = convert(&files, options);
    match files.iter().find(|f| f.slot == Slot::Map(MapKind::FeatureMask)).zip(maps.last()) {
        Some((file, (_, mask))) if mask.data().iter().all(|v| *v == mask.data()[0]) => {
            Err(vec![SetError::UniformMask { file: file.name.to_string(), value: mask.data()[0] }])
        }
        _ => Ok(MapSet::new(maps)),
    }
}

struct File<'a> {
    slot: Slot,
    name: &'a str,
    pixels: Pixels,
}

fn check_sizes(files: &[File], errors: &mut Vec<SetError>) {
    let Some(first) = files.first() else { return };
    let size = |f: &File| [f.pixels.width, f.pixels.height];
    for file in files {
        let [width, height] = size(file);
        if width.min(height) < MIN_SIDE || width.max(height) > MAX_SIDE {
            errors.push(SetError::Side { file: file.name.to_string(), width, height });
        } else if size(file) != size(first) {
            errors.push(SetError::Sizes {
                file: first.name.to_string(),
                size: size(first),
                other: file.name.to_string(),
                other_size: size(file),
            });
        }
    }
}

impl File<'_> {
    /// Faults that the samples have by themselves.
    fn check(&self) -> Option<SetError> {
        let (file, slot, found) = (self.name.to_string(), self.slot, self.pixels.channels);
        if matches!(slot, Slot::Orm | Slot::Map(MapKind::Normal)) && found < 3 {
            return Some(SetError::Channels { file, slot, found, needed: 3 });
        }
        let Samples::F32(samples) = &self.pixels.samples else { return None };
        let (c, w) = (found as usize, self.pixels.width as usize);
        let texel = |i: usize| [(i / c % w) as u32, (i / c / w) as u32];
        if let Some(i) = samples.iter().position(|v| !v.is_finite()) {
            return Some(SetError::NotFinite { file, slot, texel: texel(i), value: samples[i] });
        }
        // Filters may leave values a little below 0; -1..1 normals go far below somewhere, unless they are all flat.
        let signed = |(i, v): (usize, &f32)| (i % c < 3 && *v < -0.1).then_some(i);
        match samples.iter().enumerate().find_map(signed) {
            Some(i) if slot == Slot::Map(MapKind::Normal) => {
                Some(SetError::SignedNormal { file, texel: texel(i), value: samples[i] })
            }
            _ => None,
        }
    }

    /// Computes the map of `kind` texel by texel from the samples as 0..1, or as they are if floats.
    fn map(&self, kind: MapKind, f: impl Fn(&[f32], &mut [f32]) + Sync) -> Texture {
        let p = &self.pixels;
        let c = p.channels as usize;
        Texture::from_fn(p.width, p.height, kind.channels(), |x, y, out| {
            let at = (y as usize * p.width as usize + x as usize) * c;
            let mut texel = [0.0; 4];
            for (i, v) in texel.iter_mut().enumerate().take(c) {
                *v = match &p.samples {
                    Samples::U8(s) => f32::from(s[at + i]) / 255.0,
                    Samples::U16(s) => f32::from(s[at + i]) / 65535.0,
                    Samples::F32(s) => s[at + i],
                };
            }
            f(&texel[..c], out);
        })
    }

    fn color(&self, kind: MapKind) -> Texture {
        let integers = !matches!(self.pixels.samples, Samples::F32(_));
        // Sixteen bits are few enough for a table; eight fall on every 257th of its entries.
        static LINEAR: OnceLock<Vec<f32>> = OnceLock::new();
        let table = LINEAR.get_or_init(|| (0..=65535u16).map(|i| srgb_to_linear(f32::from(i) / 65535.0)).collect());
        let linear = |v: f32| table[(v * 65535.0).round() as usize];
        self.map(kind, |texel, out| {
            for (i, o) in out.iter_mut().enumerate() {
                let v = if texel.len() < 3 { texel[0] } else { texel[i] };
                *o = if integers { linear(v) } else { v };
            }
        })
    }

    fn normal(&self, normal_y: NormalY) -> Texture {
        self.map(MapKind::Normal, |texel, out| {
            let [x, y, z] = [0, 1, 2].map(|i| texel[i] * 2.0 - 1.0);
            let y = if normal_y == NormalY::Down { -y } else { y };
            let length = (x * x + y * y + z * z).sqrt();
            let n = if length.is_normal() { [x / length, y / length, z / length] } else { [0.0, 0.0, 1.0] };
            out.copy_from_slice(&n);
        })
    }

    fn number(&self, kind: MapKind, channel: usize) -> Texture {
        self.map(kind, |texel, out| {
            let v = texel[channel];
            out[0] = match kind {
                MapKind::Height => v,
                MapKind::FeatureMask => f32::from(u8::from(v >= 0.5)),
                _ => v.clamp(0.0, 1.0),
            };
        })
    }

    /// The alpha channel, unless there is none or it is opaque everywhere.
    fn opacity(&self) -> Option<Texture> {
        let alpha = self.pixels.channels as usize - 1;
        if !self.pixels.has_alpha() {
            return None;
        }
        let map = self.number(MapKind::Opacity, alpha);
        map.data().iter().any(|v| *v < 1.0).then_some(map)
    }
}

/// The maps of files that were checked, in the order of [`MapKind`].
fn convert(files: &[File], options: &Options) -> Vec<(MapKind, Texture)> {
    let mut maps: Vec<(MapKind, Texture)> = Vec::new();
    let given = |kind| files.iter().any(|f| f.slot == Slot::Map(kind));
    for file in files {
        let Slot::Map(kind) = file.slot else {
            let packed = [MapKind::Occlusion, MapKind::Roughness, MapKind::Metallic];
            for (channel, kind) in packed.into_iter().enumerate().filter(|(_, kind)| !given(*kind)) {
                maps.push((kind, file.number(kind, channel)));
            }
            continue;
        };
        let map = match kind {
            MapKind::BaseColor | MapKind::Emissive => file.color(kind),
            MapKind::Normal => file.normal(options.normal_y),
            _ => file.number(kind, 0),
        };
        maps.push((kind, map));
        if kind == MapKind::BaseColor && !given(MapKind::Opacity) {
            maps.extend(file.opacity().map(|map| (MapKind::Opacity, map)));
        }
    }
    maps.sort_by_key(|(kind, _)| *kind);
    maps
}

#[cfg(test)]
#[path = "image_set_tests.rs"]
mod tests;
