//! PNG, by the `png` crate.
//!
//! Source: PNG, third edition (W3C 2025). Checksums are verified, also that of the last chunk, so that a cut or spoilt
//! file never passes. Colour chunks (gAMA, cHRM, iCCP) are not applied: the map's kind says what its samples mean.

use super::image_file::{Format, ImageError, Limits};
use super::image_strips::{Shape, StripError, Strips};
use super::{Pixels, SampleType, Samples};
use png::{BitDepth, ColorType, DecodingError, EncodingError};
use std::io::{Cursor, Write};
use std::sync::{Arc, Mutex, PoisonError};

/// How hard to try.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Compression {
    /// For every bake: 4096x4096 RGBA in about half a second.
    Fast,
    /// For a release: some 25 % smaller, about thirty times slower.
    Best,
}

/// What the samples of a written PNG say of themselves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Transfer {
    /// An sRGB chunk: the samples are sRGB colour.
    Srgb,
    /// No statement: numbers, such as normals or roughness.
    Unstated,
}

/// Decodes the (first) image of a PNG.
pub(super) fn decode(bytes: &[u8], limits: &Limits) -> Result<Pixels, ImageError> {
    let mut options = png::DecodeOptions::default();
    options.set_ignore_adler32(false);
    let mut decoder = png::Decoder::new_with_options(Cursor::new(bytes), options);
    // Rows in flight and chunks such as profiles; the image itself is checked below.
    decoder.set_limits(png::Limits { bytes: limits.max_bytes.min(1 << 26) as usize });
    decoder.set_transformations(png::Transformations::EXPAND);
    decoder.set_ignore_text_chunk(true);
    decoder.set_ignore_iccp_chunk(true);
    let header = decoder.read_header_info().map_err(broken)?;
    let (width, height) = (header.width, header.height);
    // Alpha may still come from a chunk further down: check for the most there can be.
    let most = if header.bit_depth == BitDepth::Sixteen { SampleType::U16 } else { SampleType::U8 };
    limits.check(width.into(), height.into(), 4, most)?;

    let mut reader = decoder.read_info().map_err(broken)?;
    let orientation = reader.info().exif_metadata.as_deref().and_then(super::image_jpeg::orientation).unwrap_or(1);
    let (color, depth) = reader.output_color_type();
    let channels = color.samples() as u32;
    let len = reader.output_buffer_size().ok_or_else(|| broken(DecodingError::LimitsExceeded))?;
    let mut buffer = vec![0; len];
    reader.next_frame(&mut buffer).map_err(broken)?;
    reader.finish().map_err(broken)?;
    let samples = match depth {
        BitDepth::Sixteen => Samples::U16(buffer.chunks_exact(2).map(|b| u16::from_be_bytes([b[0], b[1]])).collect()),
        _ => Samples::U8(buffer),
    };
    let pixels = Pixels { width, height, channels, samples };
    // A frame smaller than the image (an animation's) would leave a part of the buffer unset.
    if !pixels.is_whole() {
        return Err(ImageError::Unsupported { format: Format::Png, reason: "its first frame is not whole".into() });
    }
    Ok(pixels.upright(orientation))
}

/// Reads a PNG of 16 bits RGB row by row: `f(y, row)` until it returns false. Returns width and height.
pub(super) fn rows_rgb16(
    bytes: &[u8],
    limits: &Limits,
    mut f: impl FnMut(u32, &[[u16; 3]]) -> bool,
) -> Result<[u32; 2], ImageError> {
    let mut options = png::DecodeOptions::default();
    options.set_ignore_adler32(false);
    let mut decoder = png::Decoder::new_with_options(Cursor::new(bytes), options);
    decoder.set_limits(png::Limits { bytes: 1 << 26 });
    decoder.set_ignore_text_chunk(true);
    decoder.set_ignore_iccp_chunk(true);
    let header = decoder.read_header_info().map_err(broken)?;
    let (size, depth, color) = ([header.width, header.height], header.bit_depth, header.color_type);
    if (depth, color, header.interlaced) != (BitDepth::Sixteen, ColorType::Rgb, false) {
        let interlaced = if header.interlaced { ", interlaced" } else { "" };
        let reason = format!("it has {} bits and is {color:?}{interlaced}", depth as u8);
        return Err(ImageError::Unsupported { format: Format::Png, reason });
    }
    limits.check(size[0].into(), size[1].into(), 3, SampleType::U16)?;
    let mut reader = decoder.read_info().map_err(broken)?;
    let mut row = Vec::with_capacity(size[0] as usize);
    for y in 0..size[1] {
        let early = || broken(std::io::Error::from(std::io::ErrorKind::UnexpectedEof).into());
        let data = reader.next_row().map_err(broken)?.ok_or_else(early)?;
        row.clear();
        let sample = |b: &[u8]| u16::from_be_bytes([b[0], b[1]]);
        row.extend(data.data().chunks_exact(6).map(|b| [sample(b), sample(&b[2..]), sample(&b[4..])]));
        if !f(y, &row) {
            return Ok(size);
        }
    }
    reader.finish().map_err(broken)?;
    Ok(size)
}

fn broken(error: DecodingError) -> ImageError {
    let reason = match error {
        DecodingError::IoError(e) if e.kind() == std::io::ErrorKind::UnexpectedEof => "the file ends early".into(),
        DecodingError::LimitsExceeded => "it needs more memory than its size justifies".into(),
        other => other.to_string(),
    };
    ImageError::Broken { format: Format::Png, reason }
}

/// Encodes 8 or 16 bits per sample; the same samples always give the same bytes.
pub fn encode_png(pixels: &Pixels, compression: Compression, transfer: Transfer) -> Result<Vec<u8>, ImageError> {
    let refuse = |reason: String| ImageError::Encode { format: Format::Png, reason };
    if !pixels.is_whole() {
        let Pixels { width, height, channels, samples } = pixels;
        return Err(refuse(format!("{} samples for {width}x{height} with {channels} channels", samples.len())));
    }
    let wide: Vec<u8>;
    let (depth, data) = match &pixels.samples {
        Samples::U8(v) => (BitDepth::Eight, v.as_slice()),
        Samples::U16(v) => {
            wide = v.iter().flat_map(|s| s.to_be_bytes()).collect();
            (BitDepth::Sixteen, wide.as_slice())
        }
        Samples::F32(_) => return Err(refuse("it holds integers, and these samples are floats".into())),
    };
    let mut out = Vec::with_capacity(data.len() / 2);
    let encoder = encoder(&mut out, [pixels.width, pixels.height], pixels.channels, depth, compression, transfer);
    let write = |encoder: png::Encoder<_>| -> Result<(), EncodingError> {
        let mut writer = encoder.write_header()?;
        writer.write_image_data(data)?;
        writer.finish()
    };
    write(encoder).map_err(|e| refuse(e.to_string()))?;
    Ok(out)
}

fn encoder<W: Write>(
    to: W,
    [width, height]: [u32; 2],
    channels: u32,
    depth: BitDepth,
    compression: Compression,
    transfer: Transfer,
) -> png::Encoder<'static, W> {
    let mut encoder = png::Encoder::new(to, width, height);
    encoder.set_depth(depth);
    encoder.set_color(match channels {
        1 => ColorType::Grayscale,
        2 => ColorType::GrayscaleAlpha,
        3 => ColorType::Rgb,
        _ => ColorType::Rgba,
    });
    encoder.set_compression(match compression {
        Compression::Fast => png::Compression::Fast,
        Compression::Best => png::Compression::High,
    });
    if transfer == Transfer::Srgb {
        encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    }
    encoder
}

/// Bytes that the encoder gave and nobody has taken yet. The encoder's writer panics where a write fails, so it writes here,
/// where none does.
#[derive(Clone, Default)]
struct Pending(Arc<Mutex<Vec<u8>>>);

impl Pending {
    fn take(&self) -> Vec<u8> {
        std::mem::take(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

impl Write for Pending {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

/// Encodes an image strip by strip; the same samples always give the same bytes, however they are cut into strips.
pub(super) fn write_png(
    to: &mut (impl Write + Send + ?Sized),
    shape: &Shape,
    compression: Compression,
    transfer: Transfer,
    strips: &Strips<'_>,
) -> Result<(), StripError> {
    let refuse = |e: EncodingError| ImageError::Encode { format: Format::Png, reason: e.to_string() };
    let depth = match shape.depth {
        SampleType::U8 => BitDepth::Eight,
        SampleType::U16 => BitDepth::Sixteen,
        SampleType::F32 => {
            let reason = "it holds integers, and these samples are floats".into();
            return Err(ImageError::Encode { format: Format::Png, reason }.into());
        }
    };
    let pending = Pending::default();
    let size = [shape.width, shape.height];
    let encoder = encoder(pending.clone(), size, shape.channels, depth, compression, transfer);
    let writer = encoder.write_header().map_err(refuse)?;
    let mut writer = writer.into_stream_writer_with_size(IDAT_BYTES).map_err(refuse)?;
    shape.each_strip(1, strips, |strip| {
        match &strip.samples {
            Samples::U8(v) => writer.write_all(v)?,
            Samples::U16(v) => v.chunks(1 << 16).try_for_each(|part| {
                writer.write_all(&part.iter().flat_map(|s| s.to_be_bytes()).collect::<Vec<u8>>())
            })?,
            Samples::F32(_) => {}
        }
        Ok(to.write_all(&pending.take())?)
    })?;
    writer.finish().map_err(refuse)?;
    Ok(to.write_all(&pending.take())?)
}

/// Longest chunk of image data.
const IDAT_BYTES: usize = 1 << 20;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::image_file::decode_pixels;

    fn image(channels: u32, deep: bool) -> Pixels {
        let n = 19 * 13 * channels;
        let samples = match deep {
            true => Samples::U16((0..n).map(|i| (i * 9973 % 65536) as u16).collect()),
            false => Samples::U8((0..n).map(|i| (i * 31 % 256) as u8).collect()),
        };
        Pixels { width: 19, height: 13, channels, samples }
    }

    #[test]
    fn every_kind_survives_the_round_trip() {
        for channels in 1..=4 {
            for deep in [false, true] {
                for compression in [Compression::Fast, Compression::Best] {
                    let image = image(channels, deep);
                    let bytes = encode_png(&image, compression, Transfer::Srgb).unwrap();
                    assert_eq!(decode_pixels(&bytes, &Limits::default()).unwrap(), image);
                }
            }
        }
    }

    #[test]
    fn only_colour_is_marked_as_srgb() {
        let has_chunk = |transfer| {
            let bytes = encode_png(&image(3, false), Compression::Fast, transfer).unwrap();
            bytes.windows(4).any(|w| w == b"sRGB")
        };
        assert!(has_chunk(Transfer::Srgb));
        assert!(!has_chunk(Transfer::Unstated));
    }

    #[test]
    fn a_cut_anywhere_is_an_error() {
        let bytes = encode_png(&image(3, false), Compression::Fast, Transfer::Srgb).unwrap();
        for len in 0..bytes.len() {
            assert!(decode(&bytes[..len], &Limits::default()).is_err(), "cut to {len} of {} bytes", bytes.len());
        }
    }

    #[test]
    fn palettes_and_narrow_greys_are_widened() {
        let encode = |color, palette: &[u8], transparent: &[u8]| {
            let mut out = Vec::new();
            let mut encoder = png::Encoder::new(&mut out, 4, 1);
            encoder.set_color(color);
            encoder.set_depth(BitDepth::Two);
            if !palette.is_empty() {
                encoder.set_palette(palette.to_vec());
            }
            if !transparent.is_empty() {
                encoder.set_trns(transparent.to_vec());
            }
            encoder.write_header().unwrap().write_image_data(&[0b00_01_10_11]).unwrap();
            decode(&out, &Limits::default()).unwrap()
        };
        assert_eq!(encode(ColorType::Grayscale, &[], &[]).samples, Samples::U8(vec![0, 85, 170, 255]));
        let palette = [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12];
        let opaque = encode(ColorType::Indexed, &palette, &[]);
        assert_eq!((opaque.channels, opaque.samples), (3, Samples::U8(palette.to_vec())));
        let clear = encode(ColorType::Indexed, &palette, &[0, 128]);
        let expected = vec![1, 2, 3, 0, 4, 5, 6, 128, 7, 8, 9, 255, 10, 11, 12, 255];
        assert_eq!((clear.channels, clear.samples), (4, Samples::U8(expected)));
    }

    #[test]
    fn floats_and_wrong_lengths_are_refused() {
        let float = Pixels { width: 1, height: 1, channels: 1, samples: Samples::F32(vec![0.5]) };
        assert!(encode_png(&float, Compression::Fast, Transfer::Unstated).unwrap_err().to_string().contains("floats"));
        let short = Pixels { samples: Samples::U8(vec![]), ..float };
        assert!(encode_png(&short, Compression::Fast, Transfer::Unstated).is_err());
    }
}
