//! Linear float textures to the samples of an output file.
//!
//! In: a [`Texture`] as the kernels make it. Out: [`Pixels`], the very samples that are written and hashed.
//! Conventions, those of glTF and of the engines:
//! - Integer samples are `round(v * max)`, halves away from zero, values outside 0..1 clamped.
//! - Colour in integers is sRGB; in floats it stays linear. Alpha is always linear.
//! - Normals are stored as `n * 0.5 + 0.5`, in floats too: that is how engines decode every normal map, EXR included.
//!
//! sRGB has no power function per sample: a table indexed by the leading bits of the float holds the code and the one
//! value where it steps up. Rounding makes the formula jitter within a few ulps of such a step; there the formula
//! itself decides, so the result is the formula's everywhere (test `the_table_is_the_formula`). 4096x4096 RGB to 8 bits
//! on two cores: 0.11 s against the formula's 1.2.
//! Unaware of: file formats, what maps a bake has.

use super::{Pixels, SampleType, Samples};
use crate::numerics::par;
use crate::texture::color::{linear_to_srgb, srgb_to_linear};
use crate::texture::{MapKind, Texture};
use std::fmt;
use std::sync::OnceLock;

/// How values become samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    /// Linear colour; sRGB in integers. A second or fourth channel is alpha.
    Color,
    /// Numbers as they are.
    Data,
    /// Unit vectors -1..=1. A fourth channel is a number as it is.
    Normal,
}

impl Encoding {
    /// The encoding of a map.
    pub fn of(kind: MapKind) -> Encoding {
        match kind {
            MapKind::BaseColor | MapKind::Emissive => Encoding::Color,
            MapKind::Normal => Encoding::Normal,
            _ => Encoding::Data,
        }
    }
}

/// A value that no file can hold.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NotFinite {
    /// Column of the texel.
    pub x: u32,
    /// Row of the texel.
    pub y: u32,
    /// Its channel.
    pub channel: u32,
    /// NaN or an infinity.
    pub value: f32,
}

impl fmt::Display for NotFinite {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "the value at texel ({}, {}), channel {}, is {}", self.x, self.y, self.channel, self.value)
    }
}

impl std::error::Error for NotFinite {}

/// Quantises a texture of at most four channels. The first value that is not finite, in texel order, is the error.
pub fn quantise(texture: &Texture, encoding: Encoding, depth: SampleType) -> Result<Pixels, NotFinite> {
    let channels = texture.channels();
    assert!(channels <= 4, "an image of {channels} channels");
    find_not_finite(texture)?;
    let samples = match depth {
        SampleType::U8 => {
            let table = (encoding == Encoding::Color).then(table_u8);
            Samples::U8(convert(texture, encoding, |v| round(v, 255.0) as u8, |v| table.map_or(0, |t| t.code(v) as u8)))
        }
        SampleType::U16 => {
            let table = (encoding == Encoding::Color).then(table_u16);
            Samples::U16(convert(texture, encoding, |v| round(v, 65535.0), |v| table.map_or(0, |t| t.code(v))))
        }
        SampleType::F32 => Samples::F32(convert(texture, encoding, |v| v, |v| v)),
    };
    Ok(Pixels { width: texture.width(), height: texture.height(), channels, samples })
}

/// The values that samples stand for: the inverse of [`quantise`] but for rounding. Panics if the samples are not whole.
pub fn dequantise(pixels: &Pixels, encoding: Encoding) -> Texture {
    let c = pixels.channels as usize;
    let plain = if c.is_multiple_of(2) { c - 1 } else { c };
    let is_float = matches!(pixels.samples, Samples::F32(_));
    let value = |channel: usize, v: f32| match encoding {
        Encoding::Color if channel < plain && !is_float => srgb_to_linear(v),
        Encoding::Normal if channel < plain => v * 2.0 - 1.0,
        _ => v,
    };
    let fill = |get: &(dyn Fn(usize) -> f32 + Sync)| {
        Texture::from_fn(pixels.width, pixels.height, pixels.channels, |x, y, out| {
            let at = (y as usize * pixels.width as usize + x as usize) * c;
            out.iter_mut().enumerate().for_each(|(i, o)| *o = value(i, get(at + i)));
        })
    };
    match &pixels.samples {
        // 256 codes: the power function once for each.
        Samples::U8(s) if encoding == Encoding::Color => {
            let table: Vec<f32> = (0..=255u8).map(|i| srgb_to_linear(f32::from(i) / 255.0)).collect();
            Texture::from_fn(pixels.width, pixels.height, pixels.channels, |x, y, out| {
                let at = (y as usize * pixels.width as usize + x as usize) * c;
                for (i, o) in out.iter_mut().enumerate() {
                    *o = if i < plain { table[s[at + i] as usize] } else { f32::from(s[at + i]) / 255.0 };
                }
            })
        }
        Samples::U8(s) => fill(&|i| f32::from(s[i]) / 255.0),
        Samples::U16(s) => fill(&|i| f32::from(s[i]) / 65535.0),
        Samples::F32(s) => fill(&|i| s[i]),
    }
}

fn find_not_finite(texture: &Texture) -> Result<(), NotFinite> {
    let (c, w) = (texture.channels() as usize, texture.width() as usize);
    let data = texture.data();
    let rows = par::map_chunks(texture.height() as usize, 16, |rows| {
        let range = rows.start * w * c..rows.end * w * c;
        let start = range.start;
        data[range].iter().position(|v| !v.is_finite()).map(|i| start + i)
    });
    match rows.into_iter().flatten().next() {
        None => Ok(()),
        Some(i) => {
            Err(NotFinite { x: (i / c % w) as u32, y: (i / c / w) as u32, channel: (i % c) as u32, value: data[i] })
        }
    }
}

/// Applies `number` or `color` to each value as the encoding says, in parallel by rows.
fn convert<T: Copy + Default + Send>(
    texture: &Texture,
    encoding: Encoding,
    number: impl Fn(f32) -> T + Sync,
    color: impl Fn(f32) -> T + Sync,
) -> Vec<T> {
    let c = texture.channels() as usize;
    // The channels before alpha, where there is one.
    let plain = if c.is_multiple_of(2) { c - 1 } else { c };
    let row = texture.width() as usize * c;
    let mut out = vec![T::default(); texture.data().len()];
    par::for_rows(&mut out, row, |y, out| {
        let from = &texture.data()[y * row..(y + 1) * row];
        if encoding == Encoding::Data {
            out.iter_mut().zip(from).for_each(|(o, v)| *o = number(*v));
            return;
        }
        for (out, from) in out.chunks_exact_mut(c).zip(from.chunks_exact(c)) {
            for (i, (o, v)) in out.iter_mut().zip(from).enumerate() {
                *o = match encoding {
                    Encoding::Color if i < plain => color(*v),
                    Encoding::Normal if i < plain => number(*v * 0.5 + 0.5),
                    _ => number(*v),
                };
            }
        }
    });
    out
}

/// `round(clamp(v, 0, 1) * max)`, halves up; by truncation, which compiles to one instruction where `round` is a call.
fn round(v: f32, max: f32) -> u16 {
    let x = v.clamp(0.0, 1.0) * max;
    let whole = x as u16;
    whole + u16::from(x - f32::from(whole) >= 0.5)
}

/// The formula that the tables must agree with.
fn formula(v: f32, max: f32) -> u16 {
    round(linear_to_srgb(v), max)
}

/// 2^-22: values below have code 0; the least threshold, that of 16 bits, is 0.5 / 65535 / 12.92 = 2^-20.7.
const FIRST_BITS: u32 = (127 - 22) << 23;
/// One, beyond which every code is the greatest.
const ONE_BITS: u32 = 127 << 23;
/// How many floats around a threshold are left to the formula: its error is below 8 ulps of its argument.
const JITTER: u32 = 32;

/// The floats that share their leading bits.
#[derive(Clone, Copy)]
struct Group {
    /// Code below the threshold.
    code: u32,
    /// Bits of the one value in the group, or within the jitter of it, where the code steps up; far off if none.
    threshold: u32,
}

/// The sRGB code of any linear value.
struct Table {
    max: f32,
    groups: Vec<Group>,
    shift: u32,
}

impl Table {
    /// `shift`: how many trailing bits of a float to ignore, few enough that no group holds two thresholds.
    fn new(max: f32, shift: u32) -> Table {
        let thresholds: Vec<u32> = (1..=max as u16).map(|code| threshold(code, max)).collect();
        let groups = (0..(ONE_BITS - FIRST_BITS) >> shift).map(|g| {
            let start = FIRST_BITS + (g << shift);
            let below = thresholds.partition_point(|t| *t + JITTER < start);
            let above = thresholds.partition_point(|t| *t < start + (1 << shift) + JITTER);
            debug_assert!(above - below <= 1);
            Group { code: below as u32, threshold: if above > below { thresholds[below] } else { u32::MAX } }
        });
        Table { max, groups: groups.collect(), shift }
    }

    /// Same as [`formula`].
    #[inline]
    fn code(&self, v: f32) -> u16 {
        let bits = v.to_bits().clamp(FIRST_BITS, ONE_BITS - 1);
        // Also the negative ones, whose bits are above those of one.
        if v >= 1.0 || v <= 0.0 {
            return if v > 0.0 { self.max as u16 } else { 0 };
        }
        let group = self.groups[((bits - FIRST_BITS) >> self.shift) as usize];
        if group.threshold.abs_diff(bits) <= JITTER {
            return formula(v, self.max);
        }
        (group.code + u32::from(bits >= group.threshold)) as u16
    }
}

/// The bits of a value where the formula steps from below `code` to at least `code`.
fn threshold(code: u16, max: f32) -> u32 {
    let guess = srgb_to_linear((f32::from(code) - 0.5) / max).to_bits();
    let at_least = |bits: u32| formula(f32::from_bits(bits), max) >= code;
    let (mut below, mut above) = (guess - 1, guess + 1);
    let mut step = 1;
    while at_least(below) {
        step *= 2;
        below -= step;
    }
    while !at_least(above) {
        step *= 2;
        above += step;
    }
    while above - below > 1 {
        let middle = below + (above - below) / 2;
        if at_least(middle) {
            above = middle;
        } else {
            below = middle;
        }
    }
    above
}

/// 22 binades of 128 groups; the closest two thresholds of 8 bits are 100 K floats apart.
fn table_u8() -> &'static Table {
    static TABLE: OnceLock<Table> = OnceLock::new();
    TABLE.get_or_init(|| Table::new(255.0, 16))
}

/// 22 binades of 32768 groups (6 MB); the closest two thresholds of 16 bits are 388 floats apart.
fn table_u16() -> &'static Table {
    static TABLE: OnceLock<Table> = OnceLock::new();
    TABLE.get_or_init(|| Table::new(65535.0, 8))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_survive_being_read_and_written_again() {
        for encoding in [Encoding::Color, Encoding::Data, Encoding::Normal] {
            for channels in [1u32, 3, 4] {
                let bytes: Vec<u8> = (0..=255).cycle().take(64 * 4 * channels as usize).collect();
                let p = Pixels { width: 64, height: 4, channels, samples: Samples::U8(bytes) };
                assert_eq!(quantise(&dequantise(&p, encoding), encoding, SampleType::U8), Ok(p));
            }
        }
    }

    fn row(values: &[f32], channels: u32) -> Texture {
        Texture::from_data(values.len() as u32 / channels, 1, channels, values.to_vec())
    }

    #[test]
    fn the_table_is_the_formula() {
        for table in [table_u8(), table_u16()] {
            let max = table.max;
            let check = |bits: u32| {
                let v = f32::from_bits(bits);
                let expected = (linear_to_srgb(v) * max).round() as u16;
                assert_eq!(table.code(v), expected, "{v:e} (bits {bits:#x}) at {max}");
            };
            // Everywhere, and every float around each threshold.
            (0..ONE_BITS + 5000).step_by(997).for_each(check);
            for code in 1..=max as u16 {
                let t = threshold(code, max);
                (t - 2 * JITTER..t + 2 * JITTER).for_each(check);
            }
            // Around the joint of the two branches of the formula.
            let joint = 0.003_130_8f32.to_bits();
            (joint - 5000..joint + 5000).for_each(check);
            for v in [-1.0, -0.0, 0.0, f32::MIN_POSITIVE, 1.0, 1.5, f32::MAX] {
                assert_eq!(table.code(v), (linear_to_srgb(v) * max).round() as u16);
            }
        }
    }

    // The jitter that is left to the formula covers the formula's own error.
    #[test]
    fn beyond_the_jitter_the_formula_is_monotone() {
        for table in [table_u8(), table_u16()] {
            for code in (1..=table.max as u16).step_by(7) {
                let t = threshold(code, table.max);
                for d in JITTER / 2..JITTER {
                    assert!(formula(f32::from_bits(t - d), table.max) < code);
                    assert!(formula(f32::from_bits(t + d), table.max) >= code);
                }
            }
        }
    }

    #[test]
    fn halves_round_up_and_the_rest_is_clamped() {
        let image = row(&[-1.0, 0.0, 0.5, 1.0, 2.0, 0.5 / 255.0, 0.499 / 255.0], 1);
        let pixels = quantise(&image, Encoding::Data, SampleType::U8).unwrap();
        assert_eq!(pixels.samples, Samples::U8(vec![0, 0, 128, 255, 255, 1, 0]));
        let pixels = quantise(&image, Encoding::Data, SampleType::U16).unwrap();
        assert_eq!(pixels.samples, Samples::U16(vec![0, 0, 32768, 65535, 65535, 129, 128]));
        for i in 0..=100_000 {
            let v = i as f32 / 100_000.0;
            assert_eq!(round(v, 255.0), (v * 255.0).round() as u16);
            assert_eq!(round(v, 65535.0), (v * 65535.0).round() as u16);
        }
    }

    #[test]
    fn alpha_stays_linear_and_floats_stay_themselves() {
        let image = row(&[0.5, 0.0, 1.0, 0.5], 4);
        let pixels = quantise(&image, Encoding::Color, SampleType::U8).unwrap();
        assert_eq!(pixels.samples, Samples::U8(vec![188, 0, 255, 128]));
        let float = quantise(&image, Encoding::Color, SampleType::F32).unwrap();
        assert_eq!(float.samples, Samples::F32(vec![0.5, 0.0, 1.0, 0.5]));
    }

    #[test]
    fn normals_are_shifted_into_zero_to_one_in_every_depth() {
        let image = row(&[0.0, -1.0, 1.0], 3);
        let of = |depth| quantise(&image, Encoding::Normal, depth).unwrap().samples;
        assert_eq!(of(SampleType::U8), Samples::U8(vec![128, 0, 255]));
        assert_eq!(of(SampleType::U16), Samples::U16(vec![32768, 0, 65535]));
        assert_eq!(of(SampleType::F32), Samples::F32(vec![0.5, 0.0, 1.0]));
    }

    #[test]
    fn the_first_value_that_is_not_finite_is_named() {
        let mut image = Texture::new(5, 40, 3);
        image.get_mut(3, 30)[1] = f32::INFINITY;
        image.get_mut(4, 20)[2] = f32::NAN;
        let error = quantise(&image, Encoding::Color, SampleType::U8).unwrap_err();
        assert_eq!(error.to_string(), "the value at texel (4, 20), channel 2, is NaN");
    }
}
