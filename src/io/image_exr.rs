//! OpenEXR, by the `exr` crate.
//!
//! Source: the OpenEXR file layout. Written: one layer, scan lines, ZIP16, every channel f32 (mixed types break
//! viewers), named `R G B A` or `Y A`. Blocks are packed here and compressed by [`par`], because the crate's own
//! parallel writer starts a thread per core whatever the caller's `-j` says.

use super::image_file::{Format, ImageError, Limits};
use super::image_strips::{Shape, StripError, Strips};
use super::{Pixels, SampleType, Samples};
use crate::numerics::par;
use exr::block::writer::ChunksWriter;
use exr::block::{BlockIndex, UncompressedBlock};
use exr::image::FlatSamples;
use exr::meta::attribute::{ChannelDescription, LineOrder, SampleType as ExrType, Text};
use exr::meta::header::Header;
use exr::meta::{BlockDescription, MetaData};
use exr::prelude::{Compression, ReadChannels, ReadLayers, Vec2};
use std::io::{Cursor, Seek, Write};
use std::ops::Range;

/// Rows per ZIP16 block.
const BLOCK_ROWS: usize = 16;
/// Blocks compressed at once: bounds the memory in flight (64 blocks of 16 rows of 4096 RGBA texels: 64 MiB).
const BATCH: usize = 64;

/// Decodes the first layer that is not deep; its size is its data window.
pub(super) fn decode(bytes: &[u8], limits: &Limits) -> Result<Pixels, ImageError> {
    let meta = MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(broken)?;
    let header = meta.headers.iter().find(|h| !h.deep).ok_or_else(|| unsupported("it holds only deep data".into()))?;
    let (width, height) = (header.layer_size.0, header.layer_size.1);
    let names: Vec<String> = header.channels.list.iter().map(|c| c.name.to_string()).collect();
    limits.check(width as u64, height as u64, names.len() as u64, SampleType::F32)?;
    let wanted = wanted_channels(&names)?;
    for name in &wanted {
        let channel = header.channels.list.iter().find(|c| c.name.eq(name));
        if channel.is_some_and(|c| c.sampling != Vec2(1, 1)) {
            return Err(unsupported(format!("channel `{name}` is subsampled")));
        }
        if channel.is_some_and(|c| c.sample_type == ExrType::U32) {
            return Err(unsupported(format!("channel `{name}` holds integers; half and float are read")));
        }
    }

    let image = exr::image::read::read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .non_parallel()
        .from_buffered(Cursor::new(bytes))
        .map_err(broken)?;
    let layer = image.layer_data;
    let texels = width * height;
    let mut samples = vec![0.0; texels * wanted.len()];
    for (i, name) in wanted.iter().enumerate() {
        let channel = layer.channel_data.list.iter().find(|c| c.name.eq(name));
        let channel = channel.filter(|c| c.sample_data.len() == texels);
        let channel = channel.ok_or_else(|| unsupported(format!("channel `{name}` is not of the image's size")))?;
        let out = samples[i..].iter_mut().step_by(wanted.len());
        match &channel.sample_data {
            FlatSamples::F16(v) => out.zip(v).for_each(|(o, s)| *o = s.to_f32()),
            FlatSamples::F32(v) => out.zip(v).for_each(|(o, s)| *o = *s),
            FlatSamples::U32(_) => return Err(unsupported(format!("channel `{name}` holds integers"))),
        }
    }
    let channels = wanted.len() as u32;
    Ok(Pixels { width: width as u32, height: height as u32, channels, samples: Samples::F32(samples) })
}

fn broken(error: exr::error::Error) -> ImageError {
    match error {
        exr::error::Error::NotSupported(reason) => unsupported(reason.into_owned()),
        other => ImageError::Broken { format: Format::Exr, reason: other.to_string() },
    }
}

fn unsupported(reason: String) -> ImageError {
    ImageError::Unsupported { format: Format::Exr, reason }
}

/// The channels to read, in the order of [`Pixels`].
fn wanted_channels(names: &[String]) -> Result<Vec<&str>, ImageError> {
    let all = |wanted: &[&'static str]| wanted.iter().all(|w| names.iter().any(|n| n == w));
    let mut wanted = match names {
        _ if all(&["R", "G", "B"]) => vec!["R", "G", "B"],
        _ if all(&["Y"]) => vec!["Y"],
        [only] => return Ok(vec![only]),
        _ => {
            let found = names.join("`, `");
            return Err(unsupported(format!("it has the channels `{found}`; R G B, Y or a single one are read")));
        }
    };
    if all(&["A"]) {
        wanted.push("A");
    }
    Ok(wanted)
}

/// Encodes float samples; the same samples always give the same bytes.
pub fn encode_exr(pixels: &Pixels) -> Result<Vec<u8>, ImageError> {
    let refuse = |reason: String| ImageError::Encode { format: Format::Exr, reason };
    let Samples::F32(samples) = &pixels.samples else {
        return Err(refuse(format!("it holds floats, and these samples are {}", pixels.samples.sample_type().name())));
    };
    if !pixels.is_whole() {
        let Pixels { width, height, channels, .. } = pixels;
        return Err(refuse(format!("{} samples for {width}x{height} with {channels} channels", samples.len())));
    }
    let shape = Shape { width: pixels.width, height: pixels.height, channels: pixels.channels, depth: SampleType::F32 };
    let row = pixels.width as usize * pixels.channels as usize;
    let strips = |rows: Range<u32>| {
        let samples = Samples::F32(samples[rows.start as usize * row..rows.end as usize * row].to_vec());
        Ok(Pixels { height: rows.len() as u32, samples, ..*pixels })
    };
    let mut out = Cursor::new(Vec::new());
    write_exr(&mut out, &shape, &strips).map_err(|e| refuse(e.to_string()))?;
    Ok(out.into_inner())
}

/// Encodes an image strip by strip.
pub(super) fn write_exr(
    to: &mut (impl Write + Seek + Send + ?Sized),
    shape: &Shape,
    strips: &Strips<'_>,
) -> Result<(), StripError> {
    // The file wants channels sorted by name: each with its place in a texel.
    let named: &[(&str, usize)] = match shape.channels {
        1 => &[("Y", 0)],
        2 => &[("A", 1), ("Y", 0)],
        3 => &[("B", 2), ("G", 1), ("R", 0)],
        _ => &[("A", 3), ("B", 2), ("G", 1), ("R", 0)],
    };
    let describe = |(name, _): &(&str, usize)| ChannelDescription::named(*name, ExrType::F32);
    let size = Vec2(shape.width as usize, shape.height as usize);
    let mut header = Header::new(Text::from("kiln"), size, named.iter().map(describe).collect()).with_encoding(
        Compression::ZIP16,
        BlockDescription::ScanLines,
        LineOrder::Increasing,
    );
    // A name is for files of several layers.
    header.own_attributes.layer_name = None;

    // The crate passes on errors of its own only.
    let mut fault = None;
    let mut done = 0;
    let written = exr::block::write(to, [header].into_iter().collect(), true, |meta, writer| {
        let append = |strip: Pixels| -> Result<(), StripError> {
            let blocks = (strip.height as usize).div_ceil(BLOCK_ROWS);
            for first in (0..blocks).step_by(BATCH) {
                let chunks = par::map_chunks(BATCH.min(blocks - first), 1, |i| {
                    pack(&strip, named, done * BLOCK_ROWS, first + i.start).compress_to_chunk(&meta.headers)
                });
                for (i, chunk) in chunks.into_iter().enumerate() {
                    writer.write_chunk(done + first + i, chunk.map_err(unwritten)?).map_err(unwritten)?;
                }
            }
            done += blocks;
            Ok(())
        };
        fault = shape.each_strip(BLOCK_ROWS as u32, strips, append).err();
        match &fault {
            None => Ok(()),
            Some(_) => Err(exr::error::Error::Aborted),
        }
    });
    match (fault, written) {
        (Some(fault), _) => Err(fault),
        (None, written) => written.map_err(unwritten),
    }
}

fn unwritten(error: exr::error::Error) -> StripError {
    match error {
        exr::error::Error::Io(e) => StripError::Write(e),
        other => ImageError::Encode { format: Format::Exr, reason: other.to_string() }.into(),
    }
}

/// Block `index` of a strip that begins at row `above` of the image, as the file wants it: line by line, in each line channel
/// by channel.
fn pack(strip: &Pixels, named: &[(&str, usize)], above: usize, index: usize) -> UncompressedBlock {
    let (width, channels) = (strip.width as usize, strip.channels as usize);
    let rows = index * BLOCK_ROWS..((index + 1) * BLOCK_ROWS).min(strip.height as usize);
    let samples: &[f32] = if let Samples::F32(v) = &strip.samples { v } else { &[] };
    let mut data = Vec::with_capacity(rows.len() * width * channels * 4);
    for row in samples.chunks_exact(width * channels).take(rows.end).skip(rows.start) {
        for (_, place) in named {
            data.extend(row.iter().skip(*place).step_by(channels).flat_map(|s| s.to_ne_bytes()));
        }
    }
    let (pixel_position, pixel_size) = (Vec2(0, above + rows.start), Vec2(width, rows.len()));
    UncompressedBlock { index: BlockIndex { layer: 0, pixel_position, pixel_size, level: Vec2(0, 0) }, data }
}

#[cfg(test)]
mod tests {
    use super::*;
    use exr::prelude::{Encoding, Image, SpecificChannels, WritableImage, f16};

    fn image(channels: u32) -> Pixels {
        let samples = (0..21 * 37 * channels).map(|i| (i as f32 - 300.0) * 0.25).collect();
        Pixels { width: 21, height: 37, channels, samples: Samples::F32(samples) }
    }

    #[test]
    fn floats_survive_the_round_trip() {
        for channels in 1..=4 {
            let image = image(channels);
            let bytes = encode_exr(&image).unwrap();
            assert_eq!(decode(&bytes, &Limits::default()).unwrap(), image);
        }
    }

    #[test]
    fn the_number_of_threads_does_not_change_the_bytes() {
        let wide =
            Pixels { width: 3, height: 259, channels: 1, samples: Samples::F32((0..777).map(|i| i as f32).collect()) };
        assert_eq!(par::install(1, || encode_exr(&wide)), par::install(8, || encode_exr(&wide)));
    }

    #[test]
    fn a_cut_anywhere_is_an_error() {
        let bytes = encode_exr(&image(1)).unwrap();
        for len in 0..bytes.len() {
            assert!(decode(&bytes[..len], &Limits::default()).is_err(), "cut to {len} of {} bytes", bytes.len());
        }
    }

    #[test]
    fn half_floats_are_widened() {
        let channels = SpecificChannels::rgb(|p: Vec2<usize>| {
            (f16::from_f32(p.0 as f32), f16::from_f32(0.5), f16::from_f32(p.1 as f32))
        });
        let mut out = Cursor::new(Vec::new());
        Image::from_encoded_channels((2, 2), Encoding::default(), channels).write().to_buffered(&mut out).unwrap();
        let expected = vec![0.0, 0.5, 0.0, 1.0, 0.5, 0.0, 0.0, 0.5, 1.0, 1.0, 0.5, 1.0];
        let pixels = decode(out.get_ref(), &Limits::default()).unwrap();
        assert_eq!(pixels, Pixels { width: 2, height: 2, channels: 3, samples: Samples::F32(expected) });
    }

    #[test]
    fn channels_are_found_by_name() {
        let pick = |names: &[&str]| {
            let names: Vec<String> = names.iter().map(|n| n.to_string()).collect();
            wanted_channels(&names).map(|w| w.join("")).map_err(|e| e.to_string())
        };
        assert_eq!(pick(&["A", "B", "G", "R", "Z"]).unwrap(), "RGBA");
        assert_eq!(pick(&["Y"]).unwrap(), "Y");
        assert_eq!(pick(&["height"]).unwrap(), "height");
        assert!(pick(&["U", "V"]).unwrap_err().contains("`U`, `V`"));
    }

    #[test]
    fn sizes_are_checked_before_memory_is_taken() {
        let bytes = encode_exr(&image(3)).unwrap();
        let limits = Limits { max_side: 36, max_bytes: 1 << 20 };
        assert!(matches!(decode(&bytes, &limits), Err(ImageError::Size { height: 37, .. })));
        let limits = Limits { max_side: 37, max_bytes: 100 };
        assert!(matches!(decode(&bytes, &limits), Err(ImageError::Bytes { .. })));
    }
}
