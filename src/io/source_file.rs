//! Source files: which texel of the exemplar each pixel of a synthesis shows, as a picture.
//!
//! A PNG of 16 bits, RGB, as large as the synthesis: red is the column of the texel, green its row, both counted from 0.
//! Blue is the same in every pixel: odd if the synthesis continues at its opposite borders, and its half is a number that
//! stands for the exemplar's size. So it is lossless, any tool can look at it, and the same synthesis can be applied again
//! to another map of the exemplar's size, but not to one of another size by mistake.
//! Unaware of: what the texels show.

use std::fmt;

use super::image_file::{Compression, ImageError, Limits, Transfer, encode_png};
use super::{Pixels, Samples, image_png};
use crate::synth::image::source_map::SourceMap;

/// A source may take 1.5 GiB as a picture: 16384 x 16384 pixels of three times 16 bits. It is read row by row.
const LIMITS: Limits = Limits { max_side: 16384, max_bytes: 3 << 29 };

/// Why sources cannot be read. Reads on after "`file`: ".
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum SourceFileError {
    /// It is no PNG that can be read.
    Image(ImageError),
    /// It is a picture, but not of sources.
    NotSources {
        /// What is wrong.
        reason: String,
    },
    /// The sources of an exemplar of another size.
    Size {
        /// Size of the exemplar in texels.
        exemplar: [u32; 2],
    },
    /// A pixel's source lies outside the exemplar.
    Outside {
        /// Column and row of the pixel.
        pixel: [u32; 2],
        /// Its source.
        source: [u16; 2],
        /// Size of the exemplar in texels.
        exemplar: [u32; 2],
    },
}

impl fmt::Display for SourceFileError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            SourceFileError::Image(e) => fmt::Display::fmt(e, f),
            SourceFileError::NotSources { reason } => {
                write!(f, "{reason}; expected source coordinates as kiln writes them: a PNG of 16 bits, RGB")
            }
            SourceFileError::Size { exemplar: [w, h] } => {
                write!(f, "these are not sources of an exemplar of {w} x {h}")
            }
            SourceFileError::Outside { pixel: [x, y], source: [sx, sy], exemplar: [w, h] } => {
                write!(
                    f,
                    "pixel ({x}, {y}) shows texel ({sx}, {sy}) of an exemplar of {w} x {h}: sources of another one"
                )
            }
        }
    }
}

impl std::error::Error for SourceFileError {}

impl From<ImageError> for SourceFileError {
    fn from(e: ImageError) -> Self {
        SourceFileError::Image(e)
    }
}

/// What blue is.
fn blue(exemplar: [u32; 2], wraps: bool) -> u16 {
    // Sizes with the same number differ a lot.
    let size = (exemplar[0] * 251 + exemplar[1]) & 0x7fff;
    (size << 1) as u16 | u16::from(wraps)
}

/// The sources of a map as a picture.
pub fn source_pixels(map: &SourceMap) -> Pixels {
    let blue = blue(map.exemplar_size, map.tileable);
    let samples = Samples::U16(map.sources.iter().flat_map(|[x, y]| [*x, *y, blue]).collect());
    Pixels { width: map.width, height: map.height, channels: 3, samples }
}

/// The file of a map's sources.
pub fn encode_sources(map: &SourceMap) -> Result<Vec<u8>, ImageError> {
    encode_png(&source_pixels(map), Compression::Fast, Transfer::Unstated)
}

/// Reads sources in an exemplar of `exemplar` texels, of which every one is checked to lie inside. The counters are zero.
pub fn decode_sources(bytes: &[u8], exemplar: [u32; 2]) -> Result<SourceMap, SourceFileError> {
    let mut sources = Vec::new();
    let mut first = None;
    let mut fault = None;
    let [width, height] = image_png::rows_rgb16(bytes, &LIMITS, |y, row| {
        for (x, &[sx, sy, blue]) in row.iter().enumerate() {
            let pixel = [x as u32, y];
            let expected = *first.get_or_insert(blue);
            if expected | 1 != self::blue(exemplar, true) {
                fault.get_or_insert(SourceFileError::Size { exemplar });
            }
            if u32::from(sx) >= exemplar[0] || u32::from(sy) >= exemplar[1] {
                fault.get_or_insert(SourceFileError::Outside { pixel, source: [sx, sy], exemplar });
            }
            if blue != expected {
                let reason = format!("pixel ({x}, {y}) has a blue of {blue}, not {expected} as the first");
                fault.get_or_insert(SourceFileError::NotSources { reason });
            }
            sources.push([sx, sy]);
        }
        fault.is_none()
    })
    .map_err(|e| match e {
        ImageError::Unsupported { reason, .. } => SourceFileError::NotSources { reason },
        other => SourceFileError::Image(other),
    })?;
    match fault {
        Some(fault) => Err(fault),
        None => Ok(SourceMap {
            width,
            height,
            exemplar_size: exemplar,
            sources,
            tileable: first.is_some_and(|blue| blue & 1 == 1),
            counters: Default::default(),
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map(tileable: bool) -> SourceMap {
        let sources = (0..35u16).map(|i| [i * 977 % 700, 299 - i * 8]).collect();
        SourceMap { width: 7, height: 5, exemplar_size: [700, 300], sources, tileable, counters: Default::default() }
    }

    #[test]
    fn sources_survive_the_round_trip() {
        for tileable in [false, true] {
            let bytes = encode_sources(&map(tileable)).unwrap();
            assert_eq!(decode_sources(&bytes, [700, 300]), Ok(map(tileable)));
        }
    }

    #[test]
    fn what_does_not_fit_is_named() {
        let read = |bytes: &[u8], exemplar| decode_sources(bytes, exemplar).unwrap_err().to_string();
        let bytes = encode_sources(&map(false)).unwrap();
        for size in [[700, 299], [701, 300], [2048, 2048]] {
            let [w, h] = size;
            assert_eq!(read(&bytes, size), format!("these are not sources of an exemplar of {w} x {h}"));
        }
        let mut pixels = source_pixels(&map(true));
        if let Samples::U16(s) = &mut pixels.samples {
            s[1] = 300;
        }
        let outside = encode_png(&pixels, Compression::Fast, Transfer::Unstated).unwrap();
        let said = "pixel (0, 0) shows texel (0, 300) of an exemplar of 700 x 300: sources of another one";
        assert_eq!(read(&outside, [700, 300]), said);
        if let Samples::U16(s) = &mut pixels.samples {
            (s[1], s[8]) = (299, 0);
        }
        let mixed = encode_png(&pixels, Compression::Best, Transfer::Unstated).unwrap();
        assert!(read(&mixed, [700, 300]).starts_with("pixel (2, 0) has a blue of 0"), "{}", read(&mixed, [700, 300]));
        let narrow = Pixels { width: 1, height: 1, channels: 3, samples: Samples::U8(vec![0; 3]) };
        let narrow = encode_png(&narrow, Compression::Fast, Transfer::Unstated).unwrap();
        assert!(read(&narrow, [9, 9]).contains("8 bits"), "{}", read(&narrow, [9, 9]));
        assert!(read(b"GIF89a", [9, 9]).contains("PNG"));
        for len in 0..bytes.len() {
            assert!(decode_sources(&bytes[..len], [700, 300]).is_err(), "cut to {len} of {} bytes", bytes.len());
        }
    }
}
