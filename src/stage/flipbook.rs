//! Steps of a flipbook: decode the frames, analyse them, walk and refine in space and time, copy frame by frame
//! (\[ZG02\] sections 2, 3 and 6).

use std::collections::BTreeMap;

use crate::build::{Inputs, Step, StepError, Visitor};
use crate::exemplar::{AnalysisParams, JumpVolume, VolumeJump, analyse_flipbook, check_flipbook_size};
use crate::io::artefact::{Artefact, Damaged, Reader, Writer};
use crate::io::image_set::{self, Options, SetError, Slot};
use crate::numerics::par;
use crate::synth::volume::copy::{VolumeKernel, copy_frame};
use crate::synth::volume::refine::refine;
use crate::synth::volume::walk::{SourceVolume, VolumeCounters, VolumeWalkParams, walk};
use crate::texture::{Flipbook, MapKind, MapSet, Texture};

use super::compare::comparison;
use super::painting::renormalise;
use super::rasterise::{Bundle, ImageSpec, images};

/// Faults that are told of the frames of a flipbook; what is wrong with one is often wrong with all.
const FAULTS: usize = 8;

/// Reads the files of all frames, slot by slot.
pub(super) struct ReadFlipbook {
    pub recipe: String,
    pub slots: Vec<Slot>,
    pub frames: u32,
    pub options: Options,
}

impl ReadFlipbook {
    /// Decodes one frame.
    fn frame(&self, inputs: &Inputs, t: usize) -> Result<MapSet, Vec<SetError>> {
        let input = |i: usize| i * self.frames as usize + t;
        let slots = self.slots.iter().enumerate();
        let files: Vec<(Slot, &str, &[u8])> =
            slots.map(|(i, slot)| (*slot, inputs.label(input(i)), &inputs[input(i)])).collect();
        image_set::load(&files, &self.options)
    }
}

impl Step for ReadFlipbook {
    super::step_identity!("flipbook", 1);

    fn describe(&self, v: &mut dyn Visitor) {
        v.param("maps", &self.slots);
        v.param("frames", &self.frames);
        v.param("normal_y", &self.options.normal_y);
    }

    fn run(&self, inputs: &Inputs) -> Result<Vec<u8>, StepError> {
        let said = |faults: &[SetError]| faults.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n");
        // The first frame tells how much memory all will take.
        let first = self.frame(inputs, 0).map_err(|faults| said(&faults))?;
        let size = [first.width(), first.height()];
        check_flipbook_size([size[0], size[1], self.frames])?;
        let found = par::map_chunks(self.frames as usize, 1, |t| self.frame(inputs, t.start));
        let (mut sets, mut faults) = (Vec::new(), Vec::new());
        for (t, frame) in found.into_iter().enumerate() {
            match frame {
                Ok(set) if [set.width(), set.height()] == size => sets.push(set),
                Ok(set) => faults.push(SetError::Sizes {
                    file: inputs.label(0).to_string(),
                    size,
                    other: inputs.label(t).to_string(),
                    other_size: [set.width(), set.height()],
                }),
                Err(more) => faults.extend(more),
            }
        }
        if faults.is_empty() {
            return Ok(Flipbook::new(&with_opacity(sets)).to_bytes());
        }
        let more = faults.len().saturating_sub(FAULTS);
        let rest = if more > 0 { format!("\nand {more} more") } else { String::new() };
        Err(format!("{}{rest}", said(&faults[..faults.len() - more])).into())
    }
}

/// Frames whose alpha is opaque came without opacity; they get one if any other frame has.
fn with_opacity(sets: Vec<MapSet>) -> Vec<MapSet> {
    if sets.iter().all(|set| set.get(MapKind::Opacity).is_none()) {
        return sets;
    }
    let completed = |set: MapSet| {
        let opaque = || Texture::from_fn(set.width(), set.height(), 1, |_, _, out| out[0] = 1.0);
        let missing = set.get(MapKind::Opacity).is_none().then(|| (MapKind::Opacity, opaque()));
        MapSet::new(set.iter().map(|(kind, map)| (kind, map.clone())).chain(missing).collect())
    };
    sets.into_iter().map(completed).collect()
}

/// A flipbook as it is compared: what is transparent has no colour, and opacity weighs as much as the colour that it
/// goes with unless the recipe says otherwise.
fn compared(book: &Flipbook, importance: &BTreeMap<MapKind, f64>) -> (Flipbook, BTreeMap<MapKind, f64>) {
    let (Some(color), Some(opacity)) = (book.strip().get(MapKind::BaseColor), book.strip().get(MapKind::Opacity))
    else {
        return (book.clone(), importance.clone());
    };
    let mut importance = importance.clone();
    let weight = importance.get(&MapKind::BaseColor).copied().unwrap_or(0.0);
    importance.entry(MapKind::Opacity).or_insert(weight);
    let others = book.strip().iter().filter(|(kind, _)| *kind != MapKind::BaseColor);
    let maps =
        others.map(|(kind, map)| (kind, map.clone())).chain([(MapKind::BaseColor, premultiplied(color, opacity))]);
    let strip = MapSet::new(maps.collect());
    (Flipbook::from_strip(strip, book.size()[2]).unwrap_or_else(|| book.clone()), importance)
}

fn premultiplied(color: &Texture, opacity: &Texture) -> Texture {
    Texture::from_fn(color.width(), color.height(), 3, |x, y, out| {
        let alpha = opacity.get(x, y)[0];
        out.iter_mut().zip(color.get(x, y)).for_each(|(o, c)| *o = c * alpha);
    })
}

impl Artefact for JumpVolume {
    const TAG: [u8; 4] = *b"jvol";

    fn write(&self, to: &mut Writer) {
        let (counts, jumps) = self.parts();
        to.put(self.size());
        to.slice(&counts);
        to.slice(jumps);
    }

    fn read(from: &mut Reader<'_>) -> Result<Self, Damaged> {
        let size = from.get()?;
        let counts: Vec<u8> = from.slice()?;
        let jumps: Vec<VolumeJump> = from.slice()?;
        JumpVolume::new(size, &counts, jumps).ok_or_else(|| Damaged("jumps that do not fit their size".into()))
    }
}

/// Reads the flipbook.
pub(super) struct AnalyseFlipbook {
    pub recipe: String,
    pub params: AnalysisParams,
}

impl Step for AnalyseFlipbook {
    super::step_identity!("analyse flipbook", 3, travels);

    fn describe(&self, v: &mut dyn Visitor) {
        super::analyse::describe(&self.params, v);
    }

    fn run(&self, inputs: &Inputs) -> Result<Vec<u8>, StepError> {
        let book: Flipbook = super::read(inputs, 0)?;
        let (book, importance) = compared(&book, &self.params.importance);
        let params = AnalysisParams { importance, ..self.params.clone() };
        Ok(analyse_flipbook(&book, &params)?.to_bytes())
    }
}

impl Artefact for SourceVolume {
    const TAG: [u8; 4] = *b"svol";

    fn write(&self, to: &mut Writer) {
        to.put(self.size);
        to.put(self.exemplar_size);
        to.put([self.tileable, self.looped].map(u8::from));
        let VolumeCounters { seeds, jumps, forced_jumps, dead_ends, unshifted_jumps, random_fallbacks } = self.counters;
        to.put([seeds, jumps, forced_jumps, dead_ends, unshifted_jumps, random_fallbacks]);
        to.slice(&self.sources);
    }

    fn read(from: &mut Reader<'_>) -> Result<Self, Damaged> {
        let (size, exemplar_size): ([u32; 3], [u32; 3]) = (from.get()?, from.get()?);
        let [tileable, looped] = from.get::<[u8; 2]>()?.map(|flag| flag != 0);
        let [seeds, jumps, forced_jumps, dead_ends, unshifted_jumps, random_fallbacks] = from.get()?;
        let counters = VolumeCounters { seeds, jumps, forced_jumps, dead_ends, unshifted_jumps, random_fallbacks };
        let sources: Vec<[u16; 3]> = from.slice()?;
        let inside = |s: &[u16; 3]| (0..3).all(|i| u32::from(s[i]) < exemplar_size[i]);
        let pixels: u128 = size.iter().map(|s| u128::from(*s)).product();
        if sources.len() as u128 != pixels || !sources.iter().all(inside) {
            return Err(Damaged("sources that do not fit their size".into()));
        }
        Ok(SourceVolume { size, exemplar_size, sources, tileable, looped, counters })
    }
}

/// Bytes per texel of a flipbook under way: as of a canvas.
const TEXEL_BYTES: u64 = 12;

/// Reads the jump map and the flipbook.
pub(super) struct WalkFlipbook {
    pub recipe: String,
    pub params: VolumeWalkParams,
    /// Correction passes; 0 is the published method.
    pub refine: u32,
    /// Weight of each map in the correction's comparisons.
    pub importance: BTreeMap<MapKind, f64>,
}

impl Step for WalkFlipbook {
    super::step_identity!("walk flipbook", 3, travels);

    fn describe(&self, v: &mut dyn Visitor) {
        let VolumeWalkParams { size, order, patch, seed, tileable, looped } = &self.params;
        v.param("size", size);
        v.param("order", order);
        v.param("patch", patch);
        v.param("seed", seed);
        v.param("tileable", tileable);
        v.param("loop", looped);
        v.param("refine", &self.refine);
        v.param("importance", &self.importance);
    }

    fn memory(&self, inputs: &[u64]) -> u64 {
        TEXEL_BYTES * self.params.size.map(u64::from).iter().product::<u64>() + 4 * inputs.iter().sum::<u64>()
    }

    fn run(&self, inputs: &Inputs) -> Result<Vec<u8>, StepError> {
        let map: JumpVolume = super::read(inputs, 0)?;
        let walked = walk(&map, &self.params)?;
        if self.refine == 0 {
            return Ok(walked.to_bytes());
        }
        let book: Flipbook = super::read(inputs, 1)?;
        let (book, importance) = compared(&book, &self.importance);
        let values = comparison(book.strip(), &importance);
        drop(book);
        Ok(refine(&map, &values, &walked, self.refine)?.to_bytes())
    }
}

/// Reads the sources and the flipbook and makes the images of one frame, called `base_color.0001` and so on.
pub(super) struct CopyFrame {
    pub recipe: String,
    /// From 0.
    pub frame: u32,
    pub images: Vec<ImageSpec>,
    pub kernel: VolumeKernel,
}

/// The part of an image's or a file's name that tells the frame; frames are counted from 1.
pub(super) fn frame_number(frame: u32) -> String {
    format!("{:04}", frame + 1)
}

impl Step for CopyFrame {
    fn name(&self) -> String {
        format!("{}/copy frame {}", self.recipe, frame_number(self.frame))
    }

    fn kind(&self) -> &'static str {
        "copy frame"
    }

    fn revision(&self) -> u32 {
        1
    }

    fn describe(&self, v: &mut dyn Visitor) {
        v.param("frame", &self.frame);
        v.param("images", &self.images);
        v.param("kernel", &self.kernel);
    }

    fn run(&self, inputs: &Inputs) -> Result<Vec<u8>, StepError> {
        let sources: SourceVolume = super::read(inputs, 0)?;
        let book: Flipbook = super::read(inputs, 1)?;
        let copy = |map: &Texture, kernel| copy_frame(map, &sources, self.frame, kernel);
        let mut bundle = images(&self.images, book.strip(), false, |kind, map| {
            let opacity = book.strip().get(MapKind::Opacity).filter(|_| kind == MapKind::BaseColor);
            let Some(opacity) = opacity.filter(|_| self.kernel != VolumeKernel::None) else {
                let mut out = copy(map, self.kernel);
                if kind == MapKind::Normal {
                    renormalise(&mut out);
                }
                return Ok(out);
            };
            // What is transparent must not colour what it is blended with.
            let alpha = copy(opacity, self.kernel);
            let mut out = copy(&premultiplied(map, opacity), self.kernel);
            let plain = copy(map, VolumeKernel::None);
            for ((color, plain), alpha) in out.data_mut().chunks_mut(3).zip(plain.data().chunks(3)).zip(alpha.data()) {
                match *alpha > 1e-6 {
                    true => color.iter_mut().for_each(|c| *c /= alpha),
                    false => color.copy_from_slice(plain),
                }
            }
            Ok(out)
        })?;
        let numbered = |(name, pixels)| (format!("{name}.{}", frame_number(self.frame)), pixels);
        bundle.images = std::mem::take(&mut bundle.images).into_iter().map(numbered).collect();
        Ok(Bundle::to_bytes(&bundle))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synth::image::order::ImageOrder;

    fn set(maps: Vec<(MapKind, f32)>) -> MapSet {
        let map = |(kind, v): (MapKind, f32)| (kind, Texture::from_fn(2, 1, kind.channels(), |_, _, out| out.fill(v)));
        MapSet::new(maps.into_iter().map(map).collect())
    }

    #[test]
    fn opaque_frames_among_others_get_an_opacity() {
        let half = set(vec![(MapKind::BaseColor, 0.5), (MapKind::Opacity, 0.5)]);
        let whole = set(vec![(MapKind::BaseColor, 0.5)]);
        let out = with_opacity(vec![whole.clone(), half.clone()]);
        assert_eq!(out, [set(vec![(MapKind::BaseColor, 0.5), (MapKind::Opacity, 1.0)]), half]);
        assert_eq!(with_opacity(vec![whole.clone(); 2]), vec![whole; 2]);
    }

    #[test]
    fn colour_counts_as_far_as_it_is_seen() {
        let book = Flipbook::new(&[set(vec![(MapKind::BaseColor, 0.5), (MapKind::Opacity, 0.5)])]);
        let (seen, importance) = compared(&book, &[(MapKind::BaseColor, 2.0)].into());
        assert_eq!(seen.strip().get(MapKind::BaseColor).map(|t| t.data()[0]), Some(0.25));
        assert_eq!(importance, [(MapKind::BaseColor, 2.0), (MapKind::Opacity, 2.0)].into());
        let (_, own) = compared(&book, &[(MapKind::Opacity, 0.1)].into());
        assert_eq!(own, [(MapKind::Opacity, 0.1)].into());
    }

    #[test]
    fn artefacts_survive_the_round_trip_and_damage_is_named() {
        let map = JumpVolume::new([2, 1, 2], &[1, 0, 0, 1], vec![VolumeJump::new([1, 0, 1], 0.5); 2]).unwrap();
        assert_eq!(JumpVolume::from_bytes(&map.to_bytes()), Ok(map.clone()));
        let params = VolumeWalkParams {
            size: [3, 2, 2],
            order: ImageOrder::Hilbert,
            patch: 1.0,
            seed: 1,
            tileable: true,
            looped: false,
        };
        let sources = walk(&map, &params).unwrap();
        let bytes = sources.to_bytes();
        assert_eq!(SourceVolume::from_bytes(&bytes), Ok(sources.clone()));
        assert!((0..bytes.len()).all(|cut| SourceVolume::from_bytes(&bytes[..cut]).is_err()));
        let outside = SourceVolume { exemplar_size: [1, 1, 1], ..sources };
        assert!(SourceVolume::from_bytes(&outside.to_bytes()).is_err());
        let book = Flipbook::new(&[set(vec![(MapKind::Height, 0.5)]), set(vec![(MapKind::Height, 1.0)])]);
        assert_eq!(Flipbook::from_bytes(&book.to_bytes()), Ok(book));
    }
}
