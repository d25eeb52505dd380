//! Several samples, and parts of samples, as one exemplar.
//!
//! In: samples of the same kinds of maps, for each perhaps a mask. Out: one set of maps with the samples below each
//! other, one empty row between, and the domain of the texels that may be copied.
//! Unaware of: what makes texels similar.

use super::params::check_size;
use super::{AnalysisParams, Domain, Error};
use crate::texture::{MapKind, MapSet, Texture, Wrap};

/// Rows between two samples, which belong to neither.
const GAP: u32 = 1;

/// A sample and which of its texels may be copied.
#[derive(Clone, Copy, Debug)]
pub struct Sample<'a> {
    /// Its maps.
    pub maps: &'a MapSet,
    /// Of its size, one channel: from 0.5 a texel may be copied, below it may not. Without a mask all may.
    pub mask: Option<&'a Texture>,
}

/// Where a sample lies in a sheet: in its first columns, from a row on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Area {
    /// First row.
    pub y: u32,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

/// Samples below each other. Texels that belong to no sample are zero in every map and, as those that a mask excludes,
/// not in the domain: they are neither searched nor found. Neighbourhoods never reach from one sample into another; those
/// beside an excluded texel still see what it shows, unless [`Sheet::with_holes_filled`].
#[derive(Clone, Debug, PartialEq)]
pub struct Sheet {
    maps: MapSet,
    areas: Vec<Area>,
    domain: Domain,
    fill: bool,
}

impl Sheet {
    /// Puts samples below each other. Fails if there is none, their kinds of maps differ, a mask is of another size than
    /// its sample or excludes every texel, or the whole is too large to be analysed.
    pub fn new(samples: &[Sample]) -> Result<Self, Error> {
        let first = samples.first().ok_or(Error::NoSamples)?;
        let mut areas: Vec<Area> = Vec::with_capacity(samples.len());
        let (mut width, mut height) = (0u32, 0u64);
        for (sample, i) in samples.iter().zip(1..) {
            check_sample(sample, i, first)?;
            let (w, h) = (sample.maps.width(), sample.maps.height());
            width = width.max(w);
            height += u64::from(h) + if i > 1 { u64::from(GAP) } else { 0 };
            check_size(width.into(), height)?;
            areas.push(Area { y: height as u32 - h, width: w, height: h });
        }
        let height = height as u32;
        let stack = |kind: MapKind| {
            let mut out = Texture::new(width, height, kind.channels());
            for (sample, area) in samples.iter().zip(&areas) {
                if let Some(map) = sample.maps.get(kind) {
                    paste(map, &mut out, area.y);
                }
            }
            (kind, out)
        };
        let maps = MapSet::new(first.maps.iter().map(|(kind, _)| stack(kind)).collect());
        let belongs = |x, y| {
            let found = areas.iter().zip(samples).find(|(a, _)| (a.y..a.y + a.height).contains(&y) && x < a.width);
            found.is_some_and(|(a, s)| s.mask.is_none_or(|m| m.get(x, y - a.y)[0] >= 0.5))
        };
        let domain = Domain::masked(width, height, Wrap::Clamp, belongs).ok_or(Error::NoSamples)?;
        Ok(Sheet { maps, areas, domain, fill: false })
    }

    /// One sample, all of it. Fails if it is too large to be analysed.
    pub fn whole(maps: MapSet) -> Result<Self, Error> {
        let (width, height) = (maps.width(), maps.height());
        check_size(width.into(), height.into())?;
        let domain = Domain::full(width, height, Wrap::Clamp);
        Ok(Sheet { maps, areas: vec![Area { y: 0, width, height }], domain, fill: false })
    }

    /// Neighbourhoods see, in place of what excluded texels show, a smooth continuation of the others. For pictures with
    /// a hole in which there is rubbish.
    pub fn with_holes_filled(mut self) -> Self {
        self.fill = true;
        self
    }

    /// True if neighbourhoods see a continuation of the others where texels are excluded.
    pub fn has_holes_filled(&self) -> bool {
        self.fill
    }

    /// The maps of all samples.
    pub fn maps(&self) -> &MapSet {
        &self.maps
    }

    /// Where each sample lies.
    pub fn areas(&self) -> &[Area] {
        &self.areas
    }

    /// The texels that may be copied.
    pub fn domain(&self) -> &Domain {
        &self.domain
    }
}

/// Checks a sample (counted from 1) by itself and against the first.
fn check_sample(sample: &Sample, number: usize, first: &Sample) -> Result<(), Error> {
    let kinds = |s: &Sample| s.maps.iter().map(|m| m.0).collect::<Vec<_>>();
    let (found, expected) = (kinds(sample), kinds(first));
    if found != expected {
        return Err(Error::SampleMaps { sample: number, found, expected });
    }
    let Some(mask) = sample.mask else { return Ok(()) };
    let (size, found) = ((sample.maps.width(), sample.maps.height()), (mask.width(), mask.height()));
    if found != size {
        return Err(Error::MaskSize { sample: number, found, size });
    }
    let channels = mask.channels() as usize;
    if !mask.data().iter().step_by(channels).any(|v| *v >= 0.5) {
        return Err(Error::MaskEmpty { sample: number });
    }
    Ok(())
}

/// Copies a map into the first columns of a larger one.
fn paste(map: &Texture, into: &mut Texture, y: u32) {
    let channels = map.channels() as usize;
    let (from, to) = (map.width() as usize * channels, into.width() as usize * channels);
    let rows = into.data_mut().chunks_exact_mut(to).skip(y as usize);
    rows.zip(map.data().chunks_exact(from)).for_each(|(to, row)| to[..from].copy_from_slice(row));
}

/// What an analysis looks at.
pub(crate) struct Subject<'a> {
    pub(crate) maps: &'a MapSet,
    pub(crate) areas: Vec<Area>,
    pub(crate) domain: Domain,
    /// Whether what lies outside the domain is replaced before it is looked at.
    pub(crate) fill: bool,
}

impl<'a> Subject<'a> {
    /// All of one sample.
    pub(crate) fn sample(maps: &'a MapSet, params: &AnalysisParams) -> Result<Self, Error> {
        let (width, height) = (maps.width(), maps.height());
        check_size(width.into(), height.into())?;
        let domain = Domain::full(width, height, params.wrap);
        let subject = Subject { maps, areas: vec![Area { y: 0, width, height }], domain, fill: false };
        params.check(&subject)?;
        Ok(subject)
    }

    /// All samples of a sheet.
    pub(crate) fn sheet(sheet: &'a Sheet, params: &AnalysisParams) -> Result<Self, Error> {
        let domain = sheet.domain.clone().with_wrap(params.wrap);
        let subject = Subject { maps: &sheet.maps, areas: sheet.areas.clone(), domain, fill: sheet.fill };
        params.check(&subject)?;
        if params.wrap == Wrap::Repeat && sheet.areas.len() > 1 {
            return Err(Error::WrapOfSeveral { samples: sheet.areas.len() });
        }
        let side = params.neighbourhoods[0];
        if !subject.holds_square(side as usize) {
            return Err(Error::MaskNarrow { side });
        }
        Ok(subject)
    }

    /// The shortest and the longest side of a sample.
    pub(crate) fn sides(&self) -> (u32, u32) {
        let sides = || self.areas.iter().flat_map(|a| [a.width, a.height]);
        (sides().min().unwrap_or(0), sides().max().unwrap_or(0))
    }

    /// True if there is a square of texels that all belong to the domain. On a torus it may lie across the border.
    fn holds_square(&self, side: usize) -> bool {
        let domain = &self.domain;
        let beyond = if domain.wrap() == Wrap::Repeat { side as i32 - 1 } else { 0 };
        let (w, h) = (domain.width() as i32 + beyond, domain.height() as i32 + beyond);
        // Side of the largest whole square whose lower right corner is here, for each column of the row above.
        let mut above = vec![0usize; w as usize + 1];
        for y in 0..h {
            let mut diagonal = 0;
            for x in 0..w as usize {
                let least = diagonal.min(above[x]).min(above[x + 1]);
                diagonal = above[x + 1];
                above[x + 1] = if domain.at(x as i32, y).is_some() { least + 1 } else { 0 };
                if above[x + 1] >= side {
                    return true;
                }
            }
        }
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flat(width: u32, height: u32, value: f32) -> MapSet {
        MapSet::new(vec![(MapKind::Height, Texture::from_fn(width, height, 1, |_, _, out| out[0] = value))])
    }

    fn mask(width: u32, height: u32, f: impl Fn(u32, u32) -> bool + Sync) -> Texture {
        Texture::from_fn(width, height, 1, |x, y, out| out[0] = f32::from(u8::from(f(x, y))))
    }

    #[test]
    fn samples_lie_below_each_other_with_a_row_between() {
        let (a, b) = (flat(3, 2, 0.25), flat(2, 4, 0.75));
        let m = mask(2, 4, |x, y| x == 1 || y > 0);
        let sheet = Sheet::new(&[Sample { maps: &a, mask: None }, Sample { maps: &b, mask: Some(&m) }]).unwrap();
        let rows = [Area { y: 0, width: 3, height: 2 }, Area { y: 3, width: 2, height: 4 }];
        assert_eq!((sheet.maps().width(), sheet.maps().height(), sheet.areas()), (3, 7, &rows[..]));
        let map = sheet.maps().get(MapKind::Height).unwrap();
        assert_eq!([map.get(2, 1)[0], map.get(0, 2)[0], map.get(1, 3)[0], map.get(2, 3)[0]], [0.25, 0.0, 0.75, 0.0]);
        let domain = sheet.domain();
        assert_eq!(domain.len(), 6 + 7);
        assert!(domain.contains(2, 1) && !domain.contains(1, 2) && !domain.contains(0, 3) && domain.contains(1, 3));
        assert!(!domain.contains(2, 4));
        let alone = Sheet::new(&[Sample { maps: &b, mask: None }]).unwrap();
        assert_eq!(Sheet::whole(b).unwrap(), alone);
    }

    #[test]
    fn faults_are_named() {
        let fault = |samples: &[Sample]| Sheet::new(samples).unwrap_err().to_string();
        let (a, b) = (flat(30, 20, 0.25), flat(20, 40, 0.75));
        let colour = MapSet::new(vec![(MapKind::BaseColor, Texture::new(9, 9, 3))]);
        let plain = |maps| Sample { maps, mask: None };
        assert_eq!(fault(&[]), "no sample to analyse");
        assert_eq!(
            fault(&[plain(&a), plain(&colour)]),
            "sample 2 has the maps base_color, but sample 1 has height: all samples need the same maps"
        );
        let small = mask(30, 19, |_, _| true);
        let fitting = Sample { maps: &a, mask: Some(&small) };
        assert_eq!(fault(&[fitting]), "the mask of sample 1 is 30x19 texels, the sample is 30x20");
        let none = mask(20, 40, |_, _| false);
        let excluded = Sample { maps: &b, mask: Some(&none) };
        assert_eq!(fault(&[plain(&a), excluded]), "the mask of sample 2 excludes every texel");
        let tall = flat(9, 40_000, 0.0);
        assert_eq!(
            fault(&[plain(&tall), plain(&tall)]),
            "the exemplar is 9x80001 texels, at most 65535 per side and 16777216 in all can be analysed"
        );
    }

    #[test]
    fn a_whole_neighbourhood_must_be_left() {
        let a = flat(20, 20, 0.5);
        let check = |wrap, f: &(dyn Fn(u32, u32) -> bool + Sync)| {
            let m = mask(20, 20, f);
            let sheet = Sheet::new(&[Sample { maps: &a, mask: Some(&m) }]).unwrap();
            let params = AnalysisParams { wrap, ..AnalysisParams::default() };
            Subject::sheet(&sheet, &params).map(|s| s.domain.len()).map_err(|e| e.to_string())
        };
        let narrow = "the masks leave no neighbourhood of 9x9 texels whole";
        assert_eq!(check(Wrap::Clamp, &|x, _| x < 8), Err(narrow.into()));
        assert_eq!(check(Wrap::Clamp, &|x, _| x < 9), Ok(180));
        assert_eq!(check(Wrap::Clamp, &|x, _| !(4..15).contains(&x)), Err(narrow.into()));
        assert_eq!(check(Wrap::Repeat, &|x, _| !(4..15).contains(&x)), Ok(180));
        let two = Sheet::new(&[Sample { maps: &a, mask: None }; 2]).unwrap();
        let params = AnalysisParams { wrap: Wrap::Repeat, ..AnalysisParams::default() };
        let fault = Subject::sheet(&two, &params).err().unwrap().to_string();
        assert_eq!(fault, "an exemplar that wraps is one sample, found 2");
    }
}
