//! Image files to exact samples and back: PNG, JPEG and EXR.
//!
//! In: the bytes of a file; its format is found by its content, never by a name. Out: its samples as they are stored,
//! with no colour conversion (but palettes are expanded, 1-, 2- and 4-bit PNGs widened, CMYK turned into RGB, half
//! floats widened) and upright as EXIF says. Every size is checked before memory is taken, and a file that is damaged
//! or cut is an error, never a half-grey image.
//! Unaware of: what a map means (see [`super::image_set`]), paths.

use super::{Pixels, SampleType};
use std::fmt;

pub use super::image_exr::encode_exr;
pub use super::image_png::{Compression, Transfer, encode_png};

/// What an image may be at most.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Texels per side.
    pub max_side: u32,
    /// Bytes of the decoded samples.
    pub max_bytes: u64,
}

impl Default for Limits {
    /// 16384 texels a side, 1 GiB: an RGBA atlas page of 8 bits at the size where GPUs end.
    fn default() -> Self {
        Limits { max_side: 16384, max_bytes: 1 << 30 }
    }
}

impl Limits {
    /// Refuses what is too large; `sample` is the type that samples will have in memory.
    pub(crate) fn check(&self, width: u64, height: u64, channels: u64, sample: SampleType) -> Result<(), ImageError> {
        if width == 0 || height == 0 || width.max(height) > u64::from(self.max_side) {
            return Err(ImageError::Size { width, height, max_side: self.max_side });
        }
        let bytes = width * height * channels * sample.bytes();
        if bytes > self.max_bytes {
            return Err(ImageError::Bytes { width, height, bytes, max_bytes: self.max_bytes });
        }
        Ok(())
    }
}

/// The formats that kiln reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// Portable Network Graphics.
    Png,
    /// JPEG, baseline or progressive.
    Jpeg,
    /// OpenEXR.
    Exr,
}

impl Format {
    /// The format that the first bytes of a file announce.
    pub fn of(bytes: &[u8]) -> Option<Format> {
        match bytes {
            [0x89, b'P', b'N', b'G', ..] => Some(Format::Png),
            [0xff, 0xd8, 0xff, ..] => Some(Format::Jpeg),
            [0x76, 0x2f, 0x31, 0x01, ..] => Some(Format::Exr),
            _ => None,
        }
    }

    /// `PNG`, `JPEG` or `EXR`.
    pub fn name(self) -> &'static str {
        match self {
            Format::Png => "PNG",
            Format::Jpeg => "JPEG",
            Format::Exr => "EXR",
        }
    }
}

/// Why an image cannot be read or written. Reads on after "`file`: ".
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum ImageError {
    /// The file has no bytes.
    Empty,
    /// The first bytes announce no format that kiln knows.
    Unknown {
        /// The first bytes.
        start: Vec<u8>,
    },
    /// A side is zero or longer than allowed.
    Size {
        /// Texels per row.
        width: u64,
        /// Rows.
        height: u64,
        /// What is allowed.
        max_side: u32,
    },
    /// The samples would take more memory than allowed.
    Bytes {
        /// Texels per row.
        width: u64,
        /// Rows.
        height: u64,
        /// What the samples would take.
        bytes: u64,
        /// What is allowed.
        max_bytes: u64,
    },
    /// The file is damaged or cut.
    Broken {
        /// The format that it announces.
        format: Format,
        /// What is wrong, in the decoder's words.
        reason: String,
    },
    /// The file is sound, but of a kind that kiln does not read.
    Unsupported {
        /// The format that it announces.
        format: Format,
        /// What it has, and what is read.
        reason: String,
    },
    /// These samples do not go into this format.
    Encode {
        /// The format asked for.
        format: Format,
        /// Why not.
        reason: String,
    },
}

impl fmt::Display for ImageError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            ImageError::Empty => write!(f, "the file is empty; expected a PNG, JPEG or EXR image"),
            ImageError::Unknown { start } => {
                write!(f, "not a PNG, JPEG or EXR image: it starts with \"{}\"", start.escape_ascii())
            }
            ImageError::Size { width, height, max_side } => {
                write!(f, "the image is {width}x{height}; a side may have 1 to {max_side} texels")
            }
            ImageError::Bytes { width, height, bytes, max_bytes } => {
                let mib = |b: u64| b.div_ceil(1 << 20);
                let (found, allowed) = (mib(*bytes), mib(*max_bytes));
                write!(
                    f,
                    "the image is {width}x{height} and takes {found} MiB in memory; at most {allowed} are allowed"
                )
            }
            ImageError::Broken { format, reason } => write!(f, "the {} is damaged: {reason}", format.name()),
            ImageError::Unsupported { format, reason } => {
                write!(f, "this kind of {} is not supported: {reason}", format.name())
            }
            ImageError::Encode { format, reason } => write!(f, "cannot be written as {}: {reason}", format.name()),
        }
    }
}

impl std::error::Error for ImageError {}

/// Decodes a PNG, JPEG or EXR to its samples.
///
/// PNG: 8 bits (also for 1, 2 and 4) or 16; palettes become RGB, a transparent colour becomes alpha. JPEG: 8 bits, grey
/// or RGB. EXR: the first layer that has samples, as floats: `R G B (A)`, `Y (A)` or a single channel of any name.
pub fn decode_pixels(bytes: &[u8], limits: &Limits) -> Result<Pixels, ImageError> {
    if bytes.is_empty() {
        return Err(ImageError::Empty);
    }
    let pixels = match Format::of(bytes) {
        Some(Format::Png) => super::image_png::decode(bytes, limits)?,
        Some(Format::Jpeg) => super::image_jpeg::decode(bytes, limits)?,
        Some(Format::Exr) => super::image_exr::decode(bytes, limits)?,
        None => return Err(ImageError::Unknown { start: bytes[..bytes.len().min(12)].to_vec() }),
    };
    debug_assert!(pixels.is_whole());
    Ok(pixels)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::Samples;
    use proptest::prelude::*;

    #[test]
    fn what_is_no_image_is_named() {
        let read = |bytes: &[u8]| decode_pixels(bytes, &Limits::default()).unwrap_err().to_string();
        assert!(read(b"").contains("empty"));
        assert_eq!(read(b"hello\n"), "not a PNG, JPEG or EXR image: it starts with \"hello\\n\"");
        assert!(read(b"\x89PNG\r\n\x1a\n").contains("damaged"));
    }

    #[test]
    fn limits_hold_before_memory_is_taken() {
        let limits = Limits { max_side: 100, max_bytes: 100 };
        assert_eq!(limits.check(10, 10, 1, SampleType::U8), Ok(()));
        assert!(matches!(limits.check(10, 10, 1, SampleType::U16), Err(ImageError::Bytes { bytes: 200, .. })));
        assert!(matches!(limits.check(101, 1, 1, SampleType::U8), Err(ImageError::Size { width: 101, .. })));
        assert!(matches!(limits.check(0, 1, 1, SampleType::U8), Err(ImageError::Size { .. })));
        assert!(Limits::default().check(16384, 16384, 4, SampleType::U8).is_ok());
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(200))]

        // Whatever happens to the bytes, decoding ends with an image or an error.
        #[test]
        fn damage_never_panics(format in 0..3usize, at in 0..2000usize, value: u8, cut in 0..4000usize) {
            let texels = (0..300u32).map(|i| (i * 7 % 251) as u8).collect();
            let image = Pixels { width: 10, height: 10, channels: 3, samples: Samples::U8(texels) };
            let float = Pixels { samples: Samples::F32((0..300).map(|i| i as f32).collect()), ..image.clone() };
            let mut bytes = match format {
                0 => encode_png(&image, Compression::Fast, Transfer::Srgb).unwrap(),
                1 => crate::io::image_jpeg::tests::sample(),
                _ => encode_exr(&float).unwrap(),
            };
            let at = at % bytes.len();
            bytes[at] = value;
            bytes.truncate(cut);
            let limits = Limits { max_side: 4096, max_bytes: 1 << 26 };
            if let Ok(pixels) = decode_pixels(&bytes, &limits) {
                prop_assert!(pixels.is_whole());
            }
        }
    }
}
