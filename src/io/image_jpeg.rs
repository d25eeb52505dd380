//! JPEG, by the `zune-jpeg` crate (the one behind `image`), used directly for two things that `image` does not offer.
//!
//! Source: ITU-T T.81; EXIF 2.32 for the orientation. Strict: `image` returns a cut file as a half-grey image. Scalar:
//! the decoder's AVX2 and NEON paths are switched off, so that one file gives one result on every machine. CMYK and
//! YCCK become RGB by the decoder's plain formula; profiles are not applied.

use super::image_file::{Format, ImageError, Limits};
use super::{Pixels, SampleType, Samples};
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

pub(super) fn decode(bytes: &[u8], limits: &Limits) -> Result<Pixels, ImageError> {
    let broken = |reason: String| ImageError::Broken { format: Format::Jpeg, reason };
    let side = limits.max_side as usize;
    let options = DecoderOptions::default().set_strict_mode(true).set_use_unsafe(false);
    // The decoder's own limits give no numbers; ours are checked on the header instead.
    let mut decoder =
        JpegDecoder::new_with_options(ZCursor::new(bytes), options.set_max_width(65535).set_max_height(65535));
    decoder.decode_headers().map_err(|e| broken(e.to_string()))?;
    let (width, height) = decoder.dimensions().ok_or_else(|| broken("it has no size".into()))?;
    let grey = matches!(decoder.input_colorspace(), Some(ColorSpace::Luma));
    let channels = if grey { 1 } else { 3 };
    // A progressive file is held as coefficients of 16 bits.
    limits.check(width as u64, height as u64, channels, SampleType::U16)?;
    debug_assert!(width.max(height) <= side);
    if !ends(bytes) {
        return Err(broken("the file ends early".into()));
    }

    let space = if grey { ColorSpace::Luma } else { ColorSpace::RGB };
    decoder.set_options(decoder.options().jpeg_set_out_colorspace(space));
    let samples = decoder.decode().map_err(|e| broken(e.to_string()))?;
    let turn = decoder.exif().and_then(|chunk| orientation(chunk)).unwrap_or(1);
    let pixels =
        Pixels { width: width as u32, height: height as u32, channels: channels as u32, samples: Samples::U8(samples) };
    if !pixels.is_whole() {
        return Err(broken(format!("{} samples for {width}x{height}", pixels.samples.len())));
    }
    Ok(pixels.upright(turn))
}

/// The orientation that an EXIF chunk states, 1..=8.
pub(super) fn orientation(chunk: &[u8]) -> Option<u8> {
    image::metadata::Orientation::from_exif_chunk(chunk).map(|o| o.to_exif())
}

/// True if the end-of-image marker follows the last scan: what a cut file lacks. Source: T.81 annex B.
fn ends(bytes: &[u8]) -> bool {
    const SOI: u8 = 0xd8;
    const EOI: u8 = 0xd9;
    const SOS: u8 = 0xda;
    let mut at = 0;
    let mut in_scan = false;
    while let Some(&[0xff, marker]) = bytes.get(at..at + 2) {
        match marker {
            EOI => return true,
            // Fill bytes; markers without a segment (TEM, RSTn).
            0xff => at += 1,
            0x00 | 0x01 | 0xd0..=0xd7 | SOI => at += 2,
            _ => {
                let Some(&[hi, lo]) = bytes.get(at + 2..at + 4) else { return false };
                at += 2 + usize::from(u16::from_be_bytes([hi, lo]));
                in_scan = marker == SOS;
            }
        }
        if in_scan {
            match bytes.get(at..).and_then(|rest| rest.iter().position(|b| *b == 0xff)) {
                Some(skip) => at += skip,
                None => return false,
            }
        }
    }
    false
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// A grey 8x8 baseline JPEG, written by hand: one block, DC difference 0, end of block.
    pub(in crate::io) fn sample() -> Vec<u8> {
        let mut b = vec![0xff, 0xd8];
        b.extend([0xff, 0xdb, 0, 67, 0]); // one quantisation table of ones
        b.extend([1; 64]);
        b.extend([0xff, 0xc0, 0, 11, 8, 0, 8, 0, 8, 1, 1, 0x11, 0]); // 8 bits, 8x8, one component
        for class in [0x00, 0x10] {
            // One code of length 1: category 0 for DC, end of block for AC.
            b.extend([0xff, 0xc4, 0, 20, class, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
        }
        b.extend([0xff, 0xda, 0, 8, 1, 1, 0x00, 0, 63, 0]);
        b.extend([0b0011_1111, 0xff, 0xd9]);
        b
    }

    #[test]
    fn a_block_without_coefficients_is_middle_grey() {
        let pixels = decode(&sample(), &Limits::default()).unwrap();
        let expected = Pixels { width: 8, height: 8, channels: 1, samples: Samples::U8(vec![128; 64]) };
        assert_eq!(pixels, expected);
    }

    #[test]
    fn a_cut_anywhere_is_an_error() {
        let bytes = sample();
        for len in 3..bytes.len() {
            assert!(decode(&bytes[..len], &Limits::default()).is_err(), "cut to {len} of {}", bytes.len());
        }
    }

    #[test]
    fn what_follows_the_image_does_not_matter() {
        let mut bytes = sample();
        bytes.extend(b"trailing");
        assert!(decode(&bytes, &Limits::default()).is_ok());
    }

    #[test]
    fn a_header_with_a_huge_size_is_refused_by_its_numbers() {
        let mut bytes = sample();
        let at = bytes.windows(2).position(|w| w == [0xff, 0xc0]).unwrap() + 5;
        bytes[at..at + 4].copy_from_slice(&[0xea, 0x60, 0xea, 0x60]);
        let error = decode(&bytes, &Limits::default()).unwrap_err();
        assert!(matches!(error, ImageError::Size { width: 60000, height: 60000, .. }), "{error}");
    }
}
