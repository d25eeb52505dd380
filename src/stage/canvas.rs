//! Steps of a canvas recipe: walk the pixels of a flat image, then paint its maps along the walk (\[ZG02\] section 3).

use std::collections::BTreeMap;
use std::io::Cursor;

use crate::build::{Inputs, Step, StepError, Visitor};
use crate::exemplar::{AnalysisParams, JumpMap};
use crate::io::artefact::{Artefact, Damaged, Reader, Writer};
use crate::io::image_file::{Limits, decode_pixels};
use crate::io::image_strips::Container;
use crate::synth::image::canvas::{ImageCanvas, ImageTask};
use crate::synth::image::copy::BlendKernel;
use crate::synth::image::order::ImageOrder;
use crate::synth::image::source_map::{ImageCounters, Rect};
use crate::synth::image::source_strips::SourceStrips;
use crate::synth::image::walk::ImageWalkParams;
use crate::texture::MapKind;

use super::control::{self, Named};
use super::painting::{Painting, Picture};
use super::sheet::Form;

/// Bytes per texel of a canvas under way: a source of four, twice while it is corrected, and what was done to it.
const CANVAS_BYTES: u64 = 12;

/// Reads the jump map, the maps or the sheet, and if it is guided the guide of the canvas and those of the samples.
pub(super) struct WalkImage {
    pub recipe: String,
    /// `None`: that of the guide or of what is filled in.
    pub size: Option<[u32; 2]>,
    pub order: ImageOrder,
    pub patch: f64,
    pub seed: u64,
    pub tileable: bool,
    /// Correction passes; 0 is the published method.
    pub refine: u32,
    /// Weight of each map in the correction's comparisons.
    pub importance: BTreeMap<MapKind, f64>,
    /// What the second input is.
    pub samples: Form,
    /// Set if the canvas is guided.
    pub guide_weight: Option<f64>,
}

impl Artefact for SourceStrips {
    const TAG: [u8; 4] = *b"src2";

    fn write(&self, to: &mut Writer) {
        let Rect { x, y, width, height } = self.part;
        to.put([self.size, self.exemplar_size, [x, y], [width, height]]);
        to.put(u32::from(self.tileable));
        let ImageCounters { seeds, jumps, forced_jumps, dead_ends, unshifted_jumps, random_fallbacks } = self.counters;
        to.put([seeds, jumps, forced_jumps, dead_ends, unshifted_jumps, random_fallbacks]);
        to.put(self.strips.len() as u32);
        for strip in &self.strips {
            to.slice(strip);
        }
    }

    fn read(from: &mut Reader<'_>) -> Result<Self, Damaged> {
        let [size, exemplar_size, [x, y], [width, height]] = from.get::<[[u32; 2]; 4]>()?;
        let part = Rect { x, y, width, height };
        let tileable = from.get::<u32>()? != 0;
        let [seeds, jumps, forced_jumps, dead_ends, unshifted_jumps, random_fallbacks] = from.get()?;
        let counters = ImageCounters { seeds, jumps, forced_jumps, dead_ends, unshifted_jumps, random_fallbacks };
        let count = from.get::<u32>()?;
        let strips = (0..count).map(|_| from.slice()).collect::<Result<_, Damaged>>()?;
        if part.is_empty() || !part.fits(size) || size.iter().any(|s| *s > 1 << 16) {
            return Err(Damaged("sources of a part that does not fit its size".into()));
        }
        Ok(SourceStrips { size, exemplar_size, tileable, part, counters, strips })
    }
}

impl Step for WalkImage {
    super::step_identity!("walk image", 7, travels);

    fn describe(&self, v: &mut dyn Visitor) {
        v.param("size", &self.size);
        v.param("order", &self.order);
        v.param("patch", &self.patch);
        v.param("seed", &self.seed);
        v.param("tileable", &self.tileable);
        v.param("refine", &self.refine);
        v.param("importance", &self.importance);
        v.param("samples", &self.samples);
        v.param("guide weight", &self.guide_weight);
    }

    fn memory(&self, inputs: &[u64]) -> u64 {
        let [width, height] = self.size.unwrap_or_default().map(u64::from);
        CANVAS_BYTES * width * height + 4 * inputs.iter().sum::<u64>()
    }

    fn run(&self, inputs: &Inputs) -> Result<Vec<u8>, StepError> {
        let map = JumpMap::from_bytes(&inputs[0])?;
        let stacked = self.samples.read(inputs, 1)?;
        let files: Vec<Named> = (2..inputs.len()).map(|i| Named::input(inputs, i)).collect();
        let guide = match (self.guide_weight, files.split_first()) {
            (Some(weight), Some((target, samples))) => {
                let canvas = self.size.or(stacked.fills());
                Some(control::guide(*target, samples, canvas, &stacked, weight)?)
            }
            _ => None,
        };
        let size = control::canvas_size(self.size, guide.as_ref(), &stacked)?;
        let &WalkImage { order, patch, seed, tileable, refine, .. } = self;
        let guide = match guide {
            None => control::mixed(size, tileable, seed, &stacked)?,
            some => some,
        };
        let (importance, wrap) = (self.importance.clone(), self.samples.wrap);
        let analysis = AnalysisParams { importance, wrap, ..AnalysisParams::default() };
        let metrics = stacked.metrics(&analysis)?;
        let given = stacked.given();
        let task = ImageTask {
            jumps: &map,
            metrics: Some(&metrics),
            walk: ImageWalkParams { size, order, patch, seed, tileable },
            refine,
            guide: guide.as_ref(),
            given: given.as_deref(),
        };
        Ok(SourceStrips::synthesise(&mut ImageCanvas::new(task)?, Rect::whole(size)).to_bytes())
    }
}

/// Reads stored sources, and the maps or the sheet that they are of.
pub(super) struct ReadSources {
    pub recipe: String,
    pub samples: Form,
}

impl Step for ReadSources {
    super::step_identity!("read sources", 1);

    fn describe(&self, v: &mut dyn Visitor) {
        v.param("samples", &self.samples);
    }

    fn run(&self, inputs: &Inputs) -> Result<Vec<u8>, StepError> {
        let stacked = self.samples.read(inputs, 1)?;
        Ok(SourceStrips::of(&control::sources(Named::input(inputs, 0), &stacked)?).to_bytes())
    }
}

/// Reads the sources, the maps or the sheet, and if a sample is filled in the file of the map; gives a file.
pub(super) struct PaintImage {
    pub recipe: String,
    /// What the picture is called.
    pub image: String,
    pub picture: Picture,
    pub kernel: BlendKernel,
    pub container: Container,
    /// What the second input is.
    pub samples: Form,
}

impl Step for PaintImage {
    fn name(&self) -> String {
        format!("{}/paint {}", self.recipe, self.image)
    }

    fn kind(&self) -> &'static str {
        "paint image"
    }

    fn revision(&self) -> u32 {
        1
    }

    fn describe(&self, v: &mut dyn Visitor) {
        v.param("picture", &self.picture);
        v.param("kernel", &self.kernel);
        v.param("container", &self.container);
        v.param("samples", &self.samples);
    }

    fn run(&self, inputs: &Inputs) -> Result<Vec<u8>, StepError> {
        let sources: SourceStrips = super::read(inputs, 0)?;
        let stacked = self.samples.read(inputs, 1)?;
        let original = inputs.get(2).map(|file| decode_pixels(file, &Limits::default())).transpose()?;
        let mut file = Cursor::new(Vec::new());
        let painting = Painting {
            sources: &sources,
            maps: stacked.maps(),
            picture: self.picture,
            kernel: self.kernel,
            bounds: stacked.bounds(),
            original: original.as_ref(),
        };
        painting.write(&mut file, self.container)?;
        Ok(file.into_inner())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synth::image::source_map::SourceMap;

    #[test]
    fn sources_survive_the_round_trip() {
        let sources = (0..300u16).map(|i| [i % 7, i % 5]).collect();
        let counters = ImageCounters { jumps: 1 << 40, ..ImageCounters::default() };
        let map = SourceMap { width: 3, height: 100, exemplar_size: [7, 5], sources, tileable: true, counters };
        let strips = SourceStrips::of(&map);
        let bytes = strips.to_bytes();
        assert_eq!(SourceStrips::from_bytes(&bytes), Ok(strips));
        for cut in 0..bytes.len() {
            assert!(SourceStrips::from_bytes(&bytes[..cut]).is_err(), "cut at {cut}");
        }
    }
}
