//! A canvas becomes steps: one sample walked, or several mixed, holes filled and guides followed; or stored sources read.

use std::collections::BTreeMap;

use crate::build::{InputId, StepId};
use crate::io::image_file::Transfer;
use crate::io::image_strips::Container;
use crate::recipe::{self, Canvas, MapFile, Sample, Word};
use crate::synth::image::copy::BlendKernel;
use crate::synth::image::order::ImageOrder;
use crate::texture::Wrap;

use super::super::canvas::{PaintImage, ReadSources, WalkImage};
use super::super::painting::Picture;
use super::super::rasterise::ImageSpec;
use super::super::report::CanvasReport;
use super::super::sheet::{Form, Stack};
use super::{Planner, container, image_spec, squeeze};

impl Planner<'_, '_> {
    /// A flat image.
    pub(super) fn canvas(&mut self, canvas: &Canvas) {
        let samples = self.recipe.exemplar.samples();
        let (maps, form) = self.sheet(canvas, &samples);
        let (walk, analyse) = match &canvas.sources {
            Some(file) => {
                let file = self.graph.add_file(&file.path);
                (self.step(ReadSources { recipe: self.name(), samples: form }, &[file, maps.into()]), None)
            }
            None => {
                let analyse = self.analyse(maps, form.stacked);
                (self.walk(canvas, &samples, [analyse, maps], form), Some(analyse))
            }
        };
        let kernel = match (self.recipe.synthesis.blend, canvas.blend_kernel) {
            (recipe::Blend::None, _) => BlendKernel::None,
            (_, recipe::BlendSize::Three) => BlendKernel::Three,
            (_, recipe::BlendSize::Five) => BlendKernel::Five,
        };
        let mut paint = |image: &str, picture: Picture, (container, ext): (Container, &str)| {
            let original = self.original(canvas, &samples[0], picture);
            let (recipe, image) = (self.name(), image.to_string());
            let file = format!("{recipe}.{image}.{ext}");
            let paint = PaintImage { recipe, image, picture, kernel, container, samples: form };
            let inputs: Vec<InputId> = [walk.into(), maps.into()].into_iter().chain(original).collect();
            let step = self.step(paint, &inputs);
            self.output(step, &file);
        };
        for file in &canvas.maps {
            let ImageSpec { file: map, depth } = image_spec(file);
            paint(map.name(), Picture::Map(map, depth), container(file, canvas.compression));
        }
        for picture in &canvas.debug {
            let png = Container::Png { transfer: Transfer::Unstated, compression: squeeze(canvas.compression) };
            paint(picture.name(), Picture::Debug(*picture), (png, "png"));
        }
        let inputs: Vec<InputId> = [walk].into_iter().chain(analyse).map(InputId::from).collect();
        let report = self.step(CanvasReport { recipe: self.name() }, &inputs);
        self.output(report, "report.json");
    }

    /// The file that a map of a sample which is filled in comes from.
    fn original(&mut self, canvas: &Canvas, sample: &Sample, picture: Picture) -> Option<InputId> {
        let Picture::Map(map, _) = picture else { return None };
        // A normal map that is turned over is another picture.
        if canvas.inpaint.is_none() || (map == MapFile::Normal && sample.normal_y == recipe::NormalY::Down) {
            return None;
        }
        let file = sample.maps.iter().find(|m| m.map == map)?;
        Some(self.graph.add_file(&file.file.path))
    }

    /// The samples of a canvas: the maps of a single one, or a sheet of all.
    fn sheet(&mut self, canvas: &Canvas, samples: &[Sample]) -> (StepId, Form) {
        let maps: Vec<StepId> = samples.iter().enumerate().map(|(i, s)| self.maps(i, s)).collect();
        if samples.len() == 1 && samples[0].mask.is_none() && canvas.inpaint.is_none() {
            return (maps[0], self.form(false));
        }
        let masks = samples.iter().map(|s| s.mask.is_some()).collect();
        let mut inputs: Vec<InputId> = maps.into_iter().map(InputId::from).collect();
        let files = samples.iter().flat_map(|s| &s.mask).chain(&canvas.inpaint);
        inputs.extend(files.map(|f| self.graph.add_file(&f.path)));
        let stack = Stack { recipe: self.name(), masks, inpaint: canvas.inpaint.is_some() };
        (self.step(stack, &inputs), self.form(true))
    }

    fn form(&self, stacked: bool) -> Form {
        Form { stacked, wrap: if self.recipe.exemplar.tileable { Wrap::Repeat } else { Wrap::Clamp } }
    }

    /// Chooses the sources of a canvas.
    fn walk(&mut self, canvas: &Canvas, samples: &[Sample], [analyse, maps]: [StepId; 2], form: Form) -> StepId {
        let order = image_order(canvas.order);
        let recipe::Synthesis { seed, patch, refine, blend: _ } = self.recipe.synthesis;
        let importance: BTreeMap<_, _> = self.recipe.exemplar.importance.iter().copied().collect();
        let (size, tileable) = (canvas.size, canvas.tileable);
        let guide_weight = canvas.guide.as_ref().map(|g| g.weight);
        let recipe = self.name();
        let walk =
            WalkImage { recipe, size, order, patch, seed, tileable, refine, importance, samples: form, guide_weight };
        let mut inputs = vec![analyse.into(), maps.into()];
        if let Some(guide) = &canvas.guide {
            let files = std::iter::once(&guide.file).chain(samples.iter().flat_map(|s| &s.guide));
            inputs.extend(files.map(|f| self.graph.add_file(&f.path)));
        }
        self.step(walk, &inputs)
    }
}

pub(super) fn image_order(order: recipe::CanvasOrder) -> ImageOrder {
    match order {
        recipe::CanvasOrder::Scanline => ImageOrder::Scanline,
        recipe::CanvasOrder::Serpentine => ImageOrder::Serpentine,
        recipe::CanvasOrder::Hilbert => ImageOrder::Hilbert,
    }
}
