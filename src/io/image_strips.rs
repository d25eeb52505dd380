//! Images written strip by strip, for those that are too large to be held whole.
//!
//! In: the shape of the image and a function that makes the pixels of any of its rows. Out: the bytes of a file. While one
//! strip is encoded the next is made. How rows are cut into strips follows from the shape alone.
//! Unaware of: what the pixels show, where the bytes go.

use std::fmt;
use std::io::{self, Seek, Write};
use std::ops::Range;

use super::image_file::{Compression, ImageError, Transfer};
use super::{Pixels, SampleType, image_exr, image_png};
use crate::numerics::par;

/// About so many pixels are held at a time, twice: those being encoded, and the next ones.
const STRIP_PIXELS: u32 = 1 << 22;

/// What an image is before any of it is there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shape {
    /// Texels per row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// 1 grey, 2 grey and alpha, 3 RGB, 4 RGB and alpha.
    pub channels: u32,
    /// What one sample is.
    pub depth: SampleType,
}

/// The container of an image file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Container {
    /// PNG, for integers.
    Png {
        /// What the samples say of themselves.
        transfer: Transfer,
        /// How hard to try.
        compression: Compression,
    },
    /// OpenEXR, for floats.
    Exr,
}

/// Makes the pixels of some rows. Called from any thread, for each row once.
pub type Strips<'a> = dyn Fn(Range<u32>) -> Result<Pixels, Box<dyn std::error::Error + Send + Sync>> + Sync + 'a;

/// Why an image could not be written.
#[derive(Debug)]
#[non_exhaustive]
pub enum StripError {
    /// The pixels do not go into the format.
    Image(ImageError),
    /// The pixels could not be made.
    Strip(Box<dyn std::error::Error + Send + Sync>),
    /// The bytes could not be written.
    Write(io::Error),
}

impl fmt::Display for StripError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            StripError::Image(e) => fmt::Display::fmt(e, f),
            StripError::Strip(e) => fmt::Display::fmt(e, f),
            StripError::Write(e) => fmt::Display::fmt(e, f),
        }
    }
}

impl std::error::Error for StripError {}

impl From<ImageError> for StripError {
    fn from(e: ImageError) -> Self {
        StripError::Image(e)
    }
}

impl From<io::Error> for StripError {
    fn from(e: io::Error) -> Self {
        StripError::Write(e)
    }
}

/// Encodes an image strip by strip; the same samples always give the same bytes.
pub fn write_image(
    to: &mut (impl Write + Seek + Send + ?Sized),
    shape: &Shape,
    container: Container,
    strips: &Strips<'_>,
) -> Result<(), StripError> {
    match container {
        Container::Png { transfer, compression } => image_png::write_png(to, shape, compression, transfer, strips),
        Container::Exr => image_exr::write_exr(to, shape, strips),
    }
}

impl Shape {
    /// Calls `encode` with strips from top to bottom, whose rows are a multiple of `rows`, except the last one's.
    pub(super) fn each_strip(
        &self,
        rows: u32,
        strips: &Strips<'_>,
        mut encode: impl FnMut(Pixels) -> Result<(), StripError> + Send,
    ) -> Result<(), StripError> {
        let step = (STRIP_PIXELS / self.width.max(1)).clamp(1, self.height).next_multiple_of(rows);
        let make = |y: u32| -> Result<Pixels, StripError> {
            let rows = y..(y + step).min(self.height);
            let count = rows.len() as u32;
            let strip = strips(rows).map_err(StripError::Strip)?;
            let fits = (strip.width, strip.height, strip.channels) == (self.width, count, self.channels)
                && strip.samples.sample_type() == self.depth;
            assert!(fits && strip.is_whole(), "a strip of another shape than {self:?}");
            Ok(strip)
        };
        let mut strip = make(0)?;
        for y in (0..self.height).step_by(step as usize) {
            let next = y + step;
            if next >= self.height {
                return encode(strip);
            }
            let (done, following) = par::join(|| encode(strip), || make(next));
            done?;
            strip = following?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::Samples;
    use crate::io::image_file::{Limits, decode_pixels, encode_exr};
    use std::io::Cursor;

    const PNG: Container = Container::Png { transfer: Transfer::Srgb, compression: Compression::Fast };

    /// An image of 37 000 rows, which is more than one strip.
    fn image(depth: SampleType) -> (Shape, Pixels) {
        let shape = Shape { width: 130, height: 37_000, channels: 3, depth };
        let n = 130 * 37_000 * 3u32;
        let samples = match depth {
            SampleType::U8 => Samples::U8((0..n).map(|i| (i / 7 * (i % 130)) as u8).collect()),
            SampleType::U16 => Samples::U16((0..n).map(|i| (i / 7 * (i % 130)) as u16).collect()),
            SampleType::F32 => Samples::F32((0..n).map(|i| (i % 1000) as f32 * 0.5).collect()),
        };
        (shape, Pixels { width: 130, height: 37_000, channels: 3, samples })
    }

    fn rows(image: &Pixels, rows: Range<u32>) -> Pixels {
        let range = rows.start as usize * 390..rows.end as usize * 390;
        let samples = match &image.samples {
            Samples::U8(v) => Samples::U8(v[range].to_vec()),
            Samples::U16(v) => Samples::U16(v[range].to_vec()),
            Samples::F32(v) => Samples::F32(v[range].to_vec()),
        };
        Pixels { height: rows.len() as u32, samples, ..*image }
    }

    fn written(container: Container, shape: &Shape, image: &Pixels) -> Vec<u8> {
        let mut out = Cursor::new(Vec::new());
        write_image(&mut out, shape, container, &|r| Ok(rows(image, r))).unwrap();
        out.into_inner()
    }

    #[test]
    fn strips_make_the_whole_image() {
        let limits = Limits { max_side: 40_000, ..Limits::default() };
        for (depth, container) in [(SampleType::U8, PNG), (SampleType::U16, PNG), (SampleType::F32, Container::Exr)] {
            let (shape, image) = image(depth);
            let bytes = written(container, &shape, &image);
            assert!(decode_pixels(&bytes, &limits).unwrap() == image, "{depth:?}");
            if container == Container::Exr {
                assert!(bytes == encode_exr(&image).unwrap());
            }
        }
    }

    #[test]
    fn what_goes_wrong_is_passed_on() {
        let (shape, image) = image(SampleType::U8);
        let strips = |r: Range<u32>| if r.start > 0 { Err("no more".into()) } else { Ok(rows(&image, r)) };
        let mut out = Cursor::new(Vec::new());
        assert_eq!(write_image(&mut out, &shape, PNG, &strips).unwrap_err().to_string(), "no more");
        struct Full;
        impl Write for Full {
            fn write(&mut self, _: &[u8]) -> io::Result<usize> {
                Err(io::ErrorKind::StorageFull.into())
            }
            fn flush(&mut self) -> io::Result<()> {
                Ok(())
            }
        }
        impl Seek for Full {
            fn seek(&mut self, _: io::SeekFrom) -> io::Result<u64> {
                Ok(0)
            }
        }
        let fault = write_image(&mut Full, &shape, PNG, &|r| Ok(rows(&image, r))).unwrap_err();
        assert!(matches!(fault, StripError::Write(e) if e.kind() == io::ErrorKind::StorageFull));
        let (shape, image) = self::image(SampleType::F32);
        let fault = write_image(&mut Full, &shape, Container::Exr, &|r| Ok(rows(&image, r))).unwrap_err();
        assert!(matches!(fault, StripError::Write(e) if e.kind() == io::ErrorKind::StorageFull));
        let fault = write_image(&mut Full, &shape, PNG, &|r| Ok(rows(&image, r))).unwrap_err();
        assert!(fault.to_string().contains("floats"), "{fault}");
    }
}
