//! Steps of a canvas recipe: walk the pixels of a flat image, then paint its maps along the walk (\[ZG02\] section 3).

use std::collections::BTreeMap;
use std::io::Cursor;

use crate::build::{Inputs, Step, StepError, Visitor};
use crate::exemplar::{AnalysisParams, JumpMap};
use crate::io::artefact::{Artefact, Damaged, Reader, Writer};
use crate::io::image_strips::Container;
use crate::synth::image_canvas::{ImageCanvas, ImageTask};
use crate::synth::image_copy::BlendKernel;
use crate::synth::image_walk::ImageWalkParams;
use crate::synth::seam_metric::SeamMetrics;
use crate::synth::source_map::{ImageCounters, Rect};
use crate::synth::source_strips::SourceStrips;
use crate::texture::{MapKind, MapSet};

use super::painting::{Painting, Picture};

/// Reads the jump map and the maps.
pub(super) struct WalkImage {
    pub recipe: String,
    pub params: ImageWalkParams,
    /// Correction passes; 0 is the published method.
    pub refine: u32,
    /// Weight of each map in the correction's comparisons.
    pub importance: BTreeMap<MapKind, f64>,
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
    super::step_identity!("walk image", 3);

    fn describe(&self, v: &mut dyn Visitor) {
        let ImageWalkParams { size, order, patch, seed, tileable } = &self.params;
        v.param("size", size);
        v.param("order", order);
        v.param("patch", patch);
        v.param("seed", seed);
        v.param("tileable", tileable);
        v.param("refine", &self.refine);
        v.param("importance", &self.importance);
    }

    fn run(&self, inputs: &Inputs) -> Result<Vec<u8>, StepError> {
        let map = JumpMap::from_bytes(&inputs[0])?;
        let maps: MapSet = super::read(inputs, 1)?;
        let analysis = AnalysisParams { importance: self.importance.clone(), ..AnalysisParams::default() };
        let metrics = SeamMetrics::new(&maps, &analysis)?;
        let task = ImageTask {
            jumps: &map,
            metrics: Some(&metrics),
            walk: self.params,
            refine: self.refine,
            guide: None,
            given: None,
        };
        let sources = SourceStrips::synthesise(&mut ImageCanvas::new(task)?, Rect::whole(self.params.size));
        Ok(sources.to_bytes())
    }
}

/// Reads the sources and the maps; gives a file.
pub(super) struct PaintImage {
    pub recipe: String,
    /// What the picture is called.
    pub image: String,
    pub picture: Picture,
    pub kernel: BlendKernel,
    pub container: Container,
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
    }

    fn run(&self, inputs: &Inputs) -> Result<Vec<u8>, StepError> {
        let sources: SourceStrips = super::read(inputs, 0)?;
        let maps: MapSet = super::read(inputs, 1)?;
        let mut file = Cursor::new(Vec::new());
        Painting { sources: &sources, maps: &maps, picture: self.picture, kernel: self.kernel }
            .write(&mut file, self.container)?;
        Ok(file.into_inner())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synth::source_map::SourceMap;

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
