//! Step: put the samples of a canvas onto one sheet, without what masks exclude and what is to be filled in.
//!
//! A canvas of one whole sample needs no such step: then its maps are the sheet ([`Stacked::plain`]).

use crate::build::{Inputs, Step, StepError, Visitor};
use crate::exemplar::{AnalysisParams, Domain, Error, Sample, Sheet};
use crate::io::artefact::{Artefact, Damaged, Reader, Writer};
use crate::synth::image::copy::Bounds;
use crate::synth::image::guide::GuideMap;
use crate::synth::image::source_map::{EMPTY, Rect};
use crate::synth::seam_metric::SeamMetrics;
use crate::texture::{MapKind, MapSet, Texture, Wrap};

use super::control::{Named, mask};

/// Samples as they are kept: for each the texels that may be copied, and of the first which stay as they are, if it is
/// filled in.
struct Kept {
    samples: Vec<(MapSet, Option<Texture>)>,
    /// One per texel of the first sample: true where it stays, false in the hole.
    keep: Option<Vec<bool>>,
}

/// Samples on a sheet, and perhaps a hole in the first of them.
pub(crate) struct Stacked {
    sheet: Sheet,
    /// The texels that may be copied, and whether the sample wraps.
    domain: Domain,
    keep: Option<Vec<bool>>,
}

impl Kept {
    /// Reads masks: one per sample, and `inpaint`, white where the first is to be filled in.
    fn read(samples: Vec<MapSet>, masks: &[Option<Named>], inpaint: Option<Named>) -> Result<Self, String> {
        let samples = with_opacity(samples);
        let size = |maps: &MapSet| [maps.width(), maps.height()];
        let read = |(maps, file): (&MapSet, &Option<Named>)| file.map(|f| mask(f, size(maps))).transpose();
        let mut copied: Vec<Option<Vec<bool>>> = samples.iter().zip(masks).map(read).collect::<Result<_, _>>()?;
        for (white, file) in copied.iter().zip(masks) {
            if let (Some(white), Some(file)) = (white, file)
                && !white.contains(&true)
            {
                return Err(format!("{} excludes everything: white is what may be copied, and it is black", file.name));
            }
        }
        let mut keep = None;
        if let Some(file) = inpaint {
            let hole = mask(file, size(&samples[0]))?;
            if !hole.contains(&true) {
                return Err(format!("{} marks nothing: white is what is filled in, and it is black", file.name));
            }
            let first = copied[0].get_or_insert_with(|| vec![true; hole.len()]);
            first.iter_mut().zip(&hole).for_each(|(copied, hole)| *copied &= !hole);
            if !first.contains(&true) {
                return Err(format!("{} leaves nothing of its sample to copy from: fill in less", file.name));
            }
            keep = Some(hole.into_iter().map(|h| !h).collect());
        }
        let texture = |maps: &MapSet, white: Vec<bool>| {
            Texture::from_fn(maps.width(), maps.height(), 1, |x, y, out| {
                out[0] = f32::from(u8::from(white[y as usize * maps.width() as usize + x as usize]));
            })
        };
        let pair = |(maps, white): (MapSet, Option<Vec<bool>>)| {
            let white = white.map(|white| texture(&maps, white));
            (maps, white)
        };
        Ok(Kept { samples: samples.into_iter().zip(copied).map(pair).collect(), keep })
    }
}

impl Stacked {
    /// One sample, all of it.
    pub fn plain(maps: MapSet) -> Result<Self, Error> {
        Ok(Stacked::of(Sheet::whole(maps)?, None))
    }

    /// Samples with masks, white where texels may be copied; `inpaint` is white where the first is to be filled in.
    pub fn read(samples: Vec<MapSet>, masks: &[Option<Named>], inpaint: Option<Named>) -> Result<Self, String> {
        Stacked::new(Kept::read(samples, masks, inpaint)?).map_err(|e| e.to_string())
    }

    fn new(Kept { samples, keep }: Kept) -> Result<Self, Error> {
        let parts: Vec<Sample> = samples.iter().map(|(maps, mask)| Sample { maps, mask: mask.as_ref() }).collect();
        let sheet = Sheet::new(&parts)?;
        let sheet = if keep.is_some() { sheet.with_holes_filled() } else { sheet };
        Ok(Stacked::of(sheet, keep))
    }

    fn of(sheet: Sheet, keep: Option<Vec<bool>>) -> Self {
        Stacked { domain: sheet.domain().clone(), sheet, keep }
    }

    /// The same; `wrap` says what lies beyond the borders of the sample.
    pub fn with_wrap(mut self, wrap: Wrap) -> Self {
        self.domain = self.domain.with_wrap(wrap);
        self
    }

    /// The samples and the texels that may be copied.
    pub fn sheet(&self) -> &Sheet {
        &self.sheet
    }

    /// The maps of all samples.
    pub fn maps(&self) -> &MapSet {
        self.sheet.maps()
    }

    /// The texels that may be copied.
    pub fn domain(&self) -> &Domain {
        &self.domain
    }

    /// Where each sample lies.
    pub fn parts(&self) -> Vec<Rect> {
        self.sheet.areas().iter().map(|a| Rect { x: 0, y: a.y, width: a.width, height: a.height }).collect()
    }

    /// The size of what is filled in.
    pub fn fills(&self) -> Option<[u32; 2]> {
        self.keep.as_ref().map(|_| [self.parts()[0].width, self.parts()[0].height])
    }

    /// The sources that are given: those of the first sample that stay.
    pub fn given(&self) -> Option<Vec<[u16; 2]>> {
        // The first sample lies at the beginning of the sheet.
        let width = self.parts()[0].width;
        let source = |(i, keep): (usize, &bool)| {
            if *keep { [i as u32 % width, i as u32 / width].map(|v| v as u16) } else { EMPTY }
        };
        self.keep.as_ref().map(|keep| keep.iter().enumerate().map(source).collect())
    }

    /// What limits blending.
    pub fn bounds(&self) -> Bounds<'_> {
        Bounds { domain: Some(self.domain()), plain: self.keep.as_deref() }
    }

    /// What seams between texels cost.
    pub fn metrics(&self, params: &AnalysisParams) -> Result<SeamMetrics, Error> {
        SeamMetrics::of_sheet(&self.sheet, params)
    }

    /// Colours of each sample as a map of the sheet; black where there is none.
    pub fn assemble(&self, colours: &[Vec<[u8; 3]>]) -> GuideMap {
        let (width, height) = (self.maps().width(), self.maps().height());
        let mut out = vec![[0; 3]; width as usize * height as usize];
        for (r, colours) in self.parts().iter().zip(colours) {
            for (y, row) in colours.chunks_exact(r.width as usize).enumerate() {
                let to = (r.y as usize + y) * width as usize;
                out[to..to + row.len()].copy_from_slice(row);
            }
        }
        GuideMap::new([width, height], out)
    }
}

/// The samples, with opaque maps of opacity for those that lack one that others have.
fn with_opacity(samples: Vec<MapSet>) -> Vec<MapSet> {
    let has = |maps: &MapSet| maps.get(MapKind::Opacity).is_some();
    if !samples.iter().any(has) {
        return samples;
    }
    let opaque = |maps: &MapSet| Texture::from_fn(maps.width(), maps.height(), 1, |_, _, out| out[0] = 1.0);
    let with = |maps: MapSet| {
        let added = (!has(&maps)).then(|| (MapKind::Opacity, opaque(&maps)));
        MapSet::new(maps.iter().map(|(kind, map)| (kind, map.clone())).chain(added).collect())
    };
    samples.into_iter().map(with).collect()
}

impl Artefact for Kept {
    const TAG: [u8; 4] = *b"stck";

    fn write(&self, to: &mut Writer) {
        to.put(self.samples.len() as u32);
        for (maps, mask) in &self.samples {
            maps.write(to);
            to.put(u32::from(mask.is_some()));
            let bytes = mask.iter().flat_map(|m| m.data().iter().map(|v| *v as u8));
            to.slice(&bytes.collect::<Vec<u8>>());
        }
        to.put(u32::from(self.keep.is_some()));
        to.slice(&self.keep.iter().flatten().map(|k| u8::from(*k)).collect::<Vec<u8>>());
    }

    fn read(from: &mut Reader<'_>) -> Result<Self, Damaged> {
        let fits = |bytes: &[u8], maps: &MapSet| bytes.len() == maps.width() as usize * maps.height() as usize;
        let wrong = || Damaged("a mask that does not fit its sample".into());
        let mut samples = Vec::new();
        for _ in 0..from.get::<u32>()? {
            let maps = MapSet::read(from)?;
            let masked = from.get::<u32>()? != 0;
            let bytes: Vec<u8> = from.slice()?;
            if masked && !fits(&bytes, &maps) {
                return Err(wrong());
            }
            let mask = masked.then(|| {
                Texture::from_data(maps.width(), maps.height(), 1, bytes.into_iter().map(f32::from).collect())
            });
            samples.push((maps, mask));
        }
        let keeps = from.get::<u32>()? != 0;
        let bytes: Vec<u8> = from.slice()?;
        if keeps && !samples.first().is_some_and(|(maps, _)| fits(&bytes, maps)) {
            return Err(wrong());
        }
        let keep = keeps.then(|| bytes.into_iter().map(|b| b != 0).collect());
        Ok(Kept { samples, keep })
    }
}

/// What an input that holds samples is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Form {
    /// True for a sheet, false for the maps of one whole sample.
    pub stacked: bool,
    /// What lies beyond the borders of the sample.
    pub wrap: Wrap,
}

impl Form {
    /// Reads input `index`.
    pub fn read(self, inputs: &Inputs, index: usize) -> Result<Stacked, StepError> {
        let stacked = if self.stacked {
            Stacked::new(super::read(inputs, index)?)?
        } else {
            Stacked::plain(super::read(inputs, index)?)?
        };
        Ok(stacked.with_wrap(self.wrap))
    }
}

/// Reads the maps of each sample, then the masks, then that of the hole.
pub(super) struct Stack {
    pub recipe: String,
    /// Whether each sample has a mask.
    pub masks: Vec<bool>,
    /// Whether the first sample is filled in.
    pub inpaint: bool,
}

impl Step for Stack {
    super::step_identity!("sheet", 1);

    fn describe(&self, v: &mut dyn Visitor) {
        v.param("masks", &self.masks);
        v.param("inpaint", &self.inpaint);
    }

    fn run(&self, inputs: &Inputs) -> Result<Vec<u8>, StepError> {
        let samples = (0..self.masks.len()).map(|i| super::read(inputs, i)).collect::<Result<_, StepError>>()?;
        let mut files = (self.masks.len()..inputs.len()).map(|i| Named::input(inputs, i));
        let masks: Vec<Option<Named>> = self.masks.iter().map(|has| if *has { files.next() } else { None }).collect();
        let inpaint = if self.inpaint { files.next() } else { None };
        Ok(Kept::read(samples, &masks, inpaint)?.to_bytes())
    }
}
