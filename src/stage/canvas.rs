//! Steps of a canvas recipe: walk the pixels of a flat image, then copy the maps along the walk (\[ZG02\] section 3).

use std::collections::BTreeMap;

use crate::build::{Inputs, Step, StepError, Visitor};
use crate::exemplar::JumpMap;
use crate::io::artefact::{Artefact, Damaged, Reader, Writer};
use crate::synth::image_copy::{BlendKernel, copy};
use crate::synth::image_refine::refine;
use crate::synth::image_walk::{ImageCounters, ImageWalkParams, SourceMap, walk};
use crate::texture::{MapKind, MapSet};

use super::compare::comparison;
use super::rasterise::{ImageSpec, images};

/// Reads the jump map and the maps.
pub(super) struct WalkImage {
    pub recipe: String,
    pub params: ImageWalkParams,
    /// Correction passes; 0 is the published method.
    pub refine: u32,
    /// Weight of each map in the correction's comparisons.
    pub importance: BTreeMap<MapKind, f64>,
}

impl Artefact for SourceMap {
    const TAG: [u8; 4] = *b"srcs";

    fn write(&self, to: &mut Writer) {
        to.put([self.width, self.height, self.exemplar_size[0], self.exemplar_size[1], u32::from(self.tileable)]);
        let ImageCounters { seeds, jumps, forced_jumps, dead_ends, unshifted_jumps, random_fallbacks } = self.counters;
        to.put([seeds, jumps, forced_jumps, dead_ends, unshifted_jumps, random_fallbacks]);
        to.slice(&self.sources);
    }

    fn read(from: &mut Reader<'_>) -> Result<Self, Damaged> {
        let [width, height, ew, eh, tileable] = from.get::<[u32; 5]>()?;
        let [seeds, jumps, forced_jumps, dead_ends, unshifted_jumps, random_fallbacks] = from.get()?;
        let counters = ImageCounters { seeds, jumps, forced_jumps, dead_ends, unshifted_jumps, random_fallbacks };
        let sources: Vec<[u16; 2]> = from.slice()?;
        let inside = sources.iter().all(|s| u32::from(s[0]) < ew && u32::from(s[1]) < eh);
        if !inside || sources.len() as u64 != u64::from(width) * u64::from(height) {
            return Err(Damaged("a source map that does not fit its size".into()));
        }
        Ok(SourceMap { width, height, exemplar_size: [ew, eh], sources, tileable: tileable != 0, counters })
    }
}

impl Step for WalkImage {
    super::step_identity!("walk image", 1);

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
        let walked = walk(&map, &self.params)?;
        if self.refine == 0 {
            return Ok(walked.to_bytes());
        }
        let maps: MapSet = super::read(inputs, 1)?;
        let compared = comparison(&maps, &self.importance);
        Ok(refine(&map, &compared, &walked, self.refine)?.to_bytes())
    }
}

/// Reads the source map and the maps.
pub(super) struct CopyImage {
    pub recipe: String,
    pub images: Vec<ImageSpec>,
    pub kernel: BlendKernel,
}

impl Step for CopyImage {
    super::step_identity!("copy image", 1);

    fn describe(&self, v: &mut dyn Visitor) {
        v.param("images", &self.images);
        v.param("kernel", &self.kernel);
    }

    fn run(&self, inputs: &Inputs) -> Result<Vec<u8>, StepError> {
        let sources: SourceMap = super::read(inputs, 0)?;
        let maps: MapSet = super::read(inputs, 1)?;
        let bundle = images(&self.images, &maps, false, |kind, map| {
            let mut out = copy(map, &sources, self.kernel);
            if kind == MapKind::Normal {
                renormalise(out.data_mut());
            }
            Ok(out)
        })?;
        Ok(bundle.to_bytes())
    }
}

/// Makes vectors of three unit length; one without a direction points straight out.
pub(super) fn renormalise(data: &mut [f32]) {
    for n in data.chunks_exact_mut(3) {
        let l = (n[0] * n[0] + n[1] * n[1] + n[2] * n[2]).sqrt();
        if l > 1e-6 {
            n.iter_mut().for_each(|v| *v /= l);
        } else {
            n.copy_from_slice(&[0.0, 0.0, 1.0]);
        }
    }
}
