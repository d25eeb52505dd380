//! A flipbook becomes steps: read and analysed whole, written frame by frame.

use std::path::{Path, PathBuf};

use crate::build::InputId;
use crate::recipe::limits::FLIPBOOK_TEXELS;
use crate::recipe::{self, Canvas, FileRef};
use crate::synth::volume::copy::VolumeKernel;
use crate::synth::volume::walk::VolumeWalkParams;

use super::super::flipbook::{AnalyseFlipbook, CopyFrame, ReadFlipbook, WalkFlipbook};
use super::canvas::image_order;
use super::{PlanError, Planner, image_spec};

impl Planner<'_, '_> {
    /// The files of a flipbook's frames, map by map, and how many frames there are.
    pub(super) fn frame_files(&self) -> Result<(Vec<PathBuf>, u32), PlanError> {
        let (mut files, mut first) = (Vec::new(), None);
        for map in &self.recipe.exemplar.maps {
            let FileRef { key, path, place, .. } = &map.file;
            let fail = |why: String| PlanError(format!("{}: {why} (named as {key} in {place})", path.display()));
            let Some(pattern) = &map.frames else { return Err(fail("is no pattern".into())) };
            let folder = path.parent().unwrap_or(Path::new(""));
            let listed = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
            let there = self.disk.list(listed).map_err(|e| fail(e.to_string()))?;
            let beside = there.iter().filter(|file| file.parent() == Some(listed));
            let names = beside.filter_map(|file| file.file_name()?.to_str());
            let frames = pattern.frames(names).map_err(|e| fail(e.to_string()))?;
            let first = first.get_or_insert_with(|| frames.clone());
            if *first != frames {
                let [found, wanted] = [&frames, first].map(|f| format!("{} to {}", f.start(), f.end()));
                return Err(fail(format!("has frames {found}, but the first map has {wanted}")));
            }
            files.extend(frames.map(|frame| folder.join(pattern.name(frame))));
        }
        Ok((files, first.map_or(0, |f| f.count() as u32)))
    }

    /// A flat image in many frames.
    pub(super) fn flipbook(
        &mut self,
        canvas: &Canvas,
        files: Vec<PathBuf>,
        exemplar_frames: u32,
    ) -> Result<(), PlanError> {
        // What else a canvas may have is refused for flipbooks.
        let Canvas { size, tileable, frames, looped, order, maps, compression, .. } = canvas;
        let [width, height] = size.ok_or_else(|| PlanError("a flipbook needs `canvas.size`".into()))?;
        let frames = frames.unwrap_or(exemplar_frames);
        let texels = u64::from(width) * u64::from(height) * u64::from(frames);
        if texels > FLIPBOOK_TEXELS {
            let path = self.recipe.path.display();
            return Err(PlanError(format!(
                "{path}: {frames} frames of {width} x {height}, as many as the exemplar has, are {texels} texels, and a \
                 flipbook may have {FLIPBOOK_TEXELS}; lower `canvas.size` or give `canvas.frames`"
            )));
        }
        let (slots, options) = Self::slots(&self.recipe.exemplar.samples()[0]);
        let files: Vec<InputId> = files.into_iter().map(|f| self.graph.add_file(f)).collect();
        let read = self.step(ReadFlipbook { recipe: self.name(), slots, frames: exemplar_frames, options }, &files);
        let analyse = AnalyseFlipbook { recipe: self.name(), params: self.analysis() };
        let analyse = self.step(analyse, &[read.into()]);
        let recipe::Synthesis { seed, patch, refine, blend } = self.recipe.synthesis;
        let importance = self.recipe.exemplar.importance.iter().copied().collect();
        let (size, order) = ([width, height, frames], image_order(*order));
        let params = VolumeWalkParams { size, order, patch, seed, tileable: *tileable, looped: *looped };
        let walk = WalkFlipbook { recipe: self.name(), params, refine, importance };
        let walk = self.step(walk, &[analyse.into(), read.into()]);
        // Refining mends cuts in time; to dissolve them as well would only blur. Mean difference of pixels next to each
        // other on smoke (the sample's 18.0): blended in space 17.1, in time as well 16.8. Without refining, frames change
        // by 32.0 and 29.5 (the sample's by 29.1).
        let kernel = match blend {
            recipe::Blend::None => VolumeKernel::None,
            _ if refine > 0 => VolumeKernel::Space,
            _ => VolumeKernel::SpaceTime,
        };
        for frame in 0..frames {
            let copy = CopyFrame { recipe: self.name(), frame, images: maps.iter().map(image_spec).collect(), kernel };
            let copy = self.step(copy, &[walk.into(), read.into()]);
            self.encode(&self.name(), maps, *compression, copy, Some(frame));
        }
        Ok(())
    }
}
