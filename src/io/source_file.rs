//! Source files: which texel of the exemplar each pixel of a synthesis shows, as a picture.
//!
//! A PNG of 16 bits, RGB, as large as the synthesis: red is the column of the texel, green its row, both counted from 0.
//! Blue is 1 in every pixel if the synthesis continues at its opposite borders, else 0. So it is lossless, any tool can
//! look at it, and the same synthesis can be applied again to another map of the exemplar's size.
//! Unaware of: what the texels show.

use std::fmt;

use super::image_file::{Compression, ImageError, Limits, Transfer, encode_png};
use super::{Pixels, Samples, image_png};
use crate::synth::source_map::SourceMap;

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

/// The sources of a map as a picture.
pub fn source_pixels(map: &SourceMap) -> Pixels {
    let wraps = u16::from(map.tileable);
    let samples = Samples::U16(map.sources.iter().flat_map(|[x, y]| [*x, *y, wraps]).collect());
    Pixels { width: map.width, height: map.height, channels: 3, samples }
}

/// The file of a map's sources.
pub fn encode_sources(map: &SourceMap) -> Result<Vec<u8>, ImageError> {
    encode_png(&source_pixels(map), Compression::Fast, Transfer::Unstated)
}

/// Reads sources in an exemplar of `exemplar` texels, of which every one is checked to lie inside. The counters are zero.
pub fn decode_sources(bytes: &[u8], exemplar: [u32; 2]) -> Result<SourceMap, SourceFileError> {
    let mut sources = Vec::new();
    let mut wraps = None;
    let mut fault = None;
    let [width, height] = image_png::rows_rgb16(bytes, &LIMITS, |y, row| {
        for (x, &[sx, sy, blue]) in row.iter().enumerate() {
            let pixel = [x as u32, y];
            if u32::from(sx) >= exemplar[0] || u32::from(sy) >= exemplar[1] {
                fault.get_or_insert(SourceFileError::Outside { pixel, source: [sx, sy], exemplar });
            }
            if blue > 1 || *wraps.get_or_insert(blue) != blue {
                let reason = format!("pixel ({x}, {y}) has a blue of {blue}, not 0 or 1 as in all others");
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
            tileable: wraps == Some(1),
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
        let outside = "pixel (0, 0) shows texel (0, 299) of an exemplar of 700 x 299: sources of another one";
        assert_eq!(read(&bytes, [700, 299]), outside);
        let mut pixels = source_pixels(&map(true));
        if let Samples::U16(s) = &mut pixels.samples {
            s[8] = 0;
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
