//! What steers a canvas: guides, masks, a hole to fill, from the bytes of their files to what the kernels take.
//!
//! For recipes and `kiln synth` alike. Every fault is a sentence that names the file.

use crate::build::Inputs;
use crate::io::source_file::decode_sources;
use crate::io::steering::{Picture, decode_picture};
use crate::synth::image::guide::{Guide, GuideMap};
use crate::synth::image::guide_light::{brightness, equivalents, luma, stretched};
use crate::synth::image::mixture::{colour, mixture};
use crate::synth::image::source_map::{Rect, SourceMap};
use crate::texture::{MapKind, MapSet, Texture};

use super::sheet::Stacked;

/// Colours of a picture, row by row.
type Colours = Vec<[u8; 3]>;

/// A file: its name for messages, and its bytes.
#[derive(Clone, Copy)]
pub(crate) struct Named<'a> {
    pub name: &'a str,
    pub bytes: &'a [u8],
}

impl<'a> Named<'a> {
    /// Input `index` of a step.
    pub(super) fn input(inputs: &'a Inputs, index: usize) -> Self {
        Named { name: inputs.label(index), bytes: &inputs[index] }
    }
}

/// A picture, checked to be of a size; `what` says whose.
fn picture(file: Named, expected: Option<([u32; 2], &str)>) -> Result<Picture, String> {
    let picture = decode_picture(file.bytes).map_err(|e| format!("{}: {e}", file.name))?;
    let Picture { width, height, .. } = picture;
    match expected {
        Some(([w, h], what)) if [w, h] != [width, height] => {
            Err(format!("{} is {width}x{height}, but {what} is {w}x{h}; both must have the same size", file.name))
        }
        _ => Ok(picture),
    }
}

/// A mask, true where it is white.
pub(super) fn mask(file: Named, sample: [u32; 2]) -> Result<Vec<bool>, String> {
    Ok(picture(file, Some((sample, "its sample")))?.white())
}

/// The guide of a canvas (of `size`, if that is known). `samples` are the guides of all samples, or none: then light and dark
/// are followed.
pub(crate) fn guide(
    target: Named,
    samples: &[Named],
    size: Option<[u32; 2]>,
    sheet: &Stacked,
    weight: f64,
) -> Result<Guide, String> {
    let target = picture(target, size.map(|size| (size, "the canvas")))?;
    let size = [target.width, target.height];
    let read = |(file, r): (&Named, Rect)| Ok(picture(*file, Some(([r.width, r.height], "its sample")))?.colours);
    let samples = samples.iter().zip(sheet.parts()).map(read).collect::<Result<Vec<_>, String>>()?;
    let (target, samples) = if samples.is_empty() { by_light(target, sheet)? } else { (target.colours, samples) };
    let exemplar = sheet.assemble(&samples);
    Guide::new(GuideMap::new(size, target), exemplar, sheet.domain(), weight as f32).map_err(|e| e.to_string())
}

/// The guide of a canvas that is mixed of several samples, if nobody says what goes where; `None` if there is one sample, or
/// a hole to be filled from all.
pub(crate) fn mixed(size: [u32; 2], tileable: bool, seed: u64, sheet: &Stacked) -> Result<Option<Guide>, String> {
    let parts = sheet.parts();
    if parts.len() < 2 || sheet.fills().is_some() {
        return Ok(None);
    }
    let side = parts.iter().map(|r| (r.width + r.height) as f32 / 2.0).sum::<f32>() / parts.len() as f32;
    let target = mixture(size, tileable, parts.len(), side, seed);
    let one = |(i, r): (usize, &Rect)| vec![colour(i); r.width as usize * r.height as usize];
    let samples: Vec<Colours> = parts.iter().enumerate().map(one).collect();
    Guide::new(target, sheet.assemble(&samples), sheet.domain(), 1.0).map(Some).map_err(|e| e.to_string())
}

/// The size of a canvas: what was asked for, or that of its guide or of what is filled in. They may not differ.
pub(crate) fn canvas_size(
    wanted: Option<[u32; 2]>,
    guide: Option<&Guide>,
    sheet: &Stacked,
) -> Result<[u32; 2], String> {
    let size = wanted.or(guide.map(Guide::canvas)).or(sheet.fills()).ok_or("the canvas has no size")?;
    match sheet.fills() {
        Some([w, h]) if [w, h] != size => Err(format!(
            "the canvas is {}x{}, but the sample to fill in is {w}x{h}; leave the size out",
            size[0], size[1]
        )),
        _ => Ok(size),
    }
}

/// Stored sources of texels of a sheet.
pub(crate) fn sources(file: Named, sheet: &Stacked) -> Result<SourceMap, String> {
    let size = [sheet.maps().width(), sheet.maps().height()];
    decode_sources(file.bytes, size).map_err(|e| format!("{}: {e}", file.name))
}

/// Colours of the canvas and of each sample that stand for light and dark.
fn by_light(target: Picture, sheet: &Stacked) -> Result<(Colours, Vec<Colours>), String> {
    let map = telling(sheet.maps()).ok_or(
        "a guide without one of the exemplar follows light and dark, and the exemplar has neither base_color nor height: give \
         the exemplar a guide",
    )?;
    let part = |r: &Rect| {
        Texture::from_fn(r.width, r.height, map.channels(), |x, y, out| out.copy_from_slice(map.get(r.x + x, r.y + y)))
    };
    let samples: Vec<Vec<u16>> = sheet.parts().iter().map(|r| brightness(&part(r))).collect();
    let target = stretched(&luma(&GuideMap::new([target.width, target.height], target.colours)));
    let domain = sheet.domain();
    let usable = sheet.parts().into_iter().zip(&samples).flat_map(|(r, values)| {
        let at = move |i: u32| ((r.x + i % r.width) as i32, (r.y + i / r.width) as i32);
        let inside = move |(i, _): &(usize, &u16)| domain.contains(at(*i as u32).0, at(*i as u32).1);
        values.iter().enumerate().filter(inside).map(|(_, v)| *v)
    });
    let table = equivalents(usable, &target);
    let grey = |v: u8| [v; 3];
    let sample = |values: &Vec<u16>| values.iter().map(|v| grey(table[usize::from(*v)])).collect();
    Ok((target.iter().map(|v| grey(*v)).collect(), samples.iter().map(sample).collect()))
}

/// The map whose light and dark the eye sees first.
fn telling(maps: &MapSet) -> Option<&Texture> {
    maps.get(MapKind::BaseColor).or_else(|| maps.get(MapKind::Height))
}
