//! Pictures that steer a synthesis and hold no map: masks (black and white) and guides (colours that stand for kinds of
//! texture, or any picture whose light and dark is to be followed).
//!
//! Samples count as they are stored, without any transfer function; alpha does not count. Grey is red, green and blue alike.
//! Unaware of: what is steered, sizes that are wanted.

use super::image_file::{ImageError, Limits, decode_pixels};
use super::{Pixels, Samples};
use std::fmt;

/// A picture in 8-bit colours.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    /// Texels per row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Red, green and blue of each texel, row by row.
    pub colours: Vec<[u8; 3]>,
}

/// Why a picture cannot be read. Reads on after "`file`: ".
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum PictureError {
    /// It is no image that can be read.
    Image(ImageError),
    /// A NaN or an infinity.
    NotFinite {
        /// Column and row of the first such texel.
        texel: [u32; 2],
        /// The value.
        value: f32,
    },
}

impl fmt::Display for PictureError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            PictureError::Image(e) => fmt::Display::fmt(e, f),
            PictureError::NotFinite { texel: [x, y], value } => {
                write!(f, "it holds {value} at texel ({x}, {y}); values must be finite")
            }
        }
    }
}

impl std::error::Error for PictureError {}

/// Reads a picture. Of 16 bits the nearest of 8 is taken; floats are clamped to 0..1.
pub fn decode_picture(bytes: &[u8]) -> Result<Picture, PictureError> {
    let Pixels { width, height, channels, samples } =
        decode_pixels(bytes, &Limits::default()).map_err(PictureError::Image)?;
    let c = channels as usize;
    if let Samples::F32(v) = &samples
        && let Some(i) = v.iter().position(|v| !v.is_finite())
    {
        let at = (i / c) as u32;
        return Err(PictureError::NotFinite { texel: [at % width, at / width], value: v[i] });
    }
    let channel = |i: usize| if c < 3 { 0 } else { i };
    let value = |at: usize| match &samples {
        Samples::U8(v) => v[at],
        Samples::U16(v) => ((u32::from(v[at]) + 128) / 257) as u8,
        Samples::F32(v) => (v[at].clamp(0.0, 1.0) * 255.0 + 0.5) as u8,
    };
    let texels = width as usize * height as usize;
    let colours = (0..texels).map(|t| [0, 1, 2].map(|i| value(t * c + channel(i)))).collect();
    Ok(Picture { width, height, colours })
}

impl Picture {
    /// Where the picture is white: the mean of a texel's channels is at least half.
    pub fn white(&self) -> Vec<bool> {
        self.colours.iter().map(|c| c.iter().map(|v| u32::from(*v)).sum::<u32>() * 2 >= 3 * 255).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::image_file::{Compression, Transfer, encode_exr, encode_png};

    fn png(channels: u32, samples: Samples) -> Vec<u8> {
        let width = samples.len() as u32 / channels;
        encode_png(&Pixels { width, height: 1, channels, samples }, Compression::Fast, Transfer::Unstated).unwrap()
    }

    #[test]
    fn every_kind_of_sample_becomes_colours() {
        let grey = decode_picture(&png(1, Samples::U8(vec![0, 127, 128, 255]))).unwrap();
        assert_eq!(grey.colours, [[0; 3], [127; 3], [128; 3], [255; 3]]);
        assert_eq!(grey.white(), [false, false, true, true]);
        let alpha = decode_picture(&png(4, Samples::U8(vec![255, 255, 0, 0, 255, 0, 0, 255]))).unwrap();
        assert_eq!(
            (alpha.colours.as_slice(), alpha.white()),
            ([[255, 255, 0], [255, 0, 0]].as_slice(), vec![true, false])
        );
        let deep = decode_picture(&png(2, Samples::U16(vec![0, 9, 32767, 0, 65535, 0, 129, 0]))).unwrap();
        assert_eq!(deep.colours, [[0; 3], [127; 3], [255; 3], [1; 3]]);
        let exr = |v: f32| {
            let samples = Samples::F32(vec![-1.0, 0.5, v]);
            decode_picture(&encode_exr(&Pixels { width: 1, height: 1, channels: 3, samples }).unwrap())
        };
        assert_eq!(exr(7.0).unwrap().colours, [[0, 128, 255]]);
    }

    #[test]
    fn what_is_no_picture_is_named() {
        assert_eq!(
            decode_picture(b"").unwrap_err().to_string(),
            "the file is empty; expected a PNG, JPEG or EXR image"
        );
        let fault = PictureError::NotFinite { texel: [3, 4], value: f32::NAN };
        assert_eq!(fault.to_string(), "it holds NaN at texel (3, 4); values must be finite");
    }
}
