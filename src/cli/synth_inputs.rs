//! What `kiln synth` is given: samples, masks, guides, a hole to fill, stored sources.
//!
//! Flags for one of several exemplars take `N=FILE`, N counted from 1; a plain FILE is for the next exemplar in turn, so a
//! flag that is given as often as there are exemplars needs no numbers.

use std::path::{Path, PathBuf};

use clap::{Args, ValueHint};

use crate::disk::{Disk, Real};
use crate::exemplar::{AnalysisParams, Error};
use crate::io::Pixels;
use crate::io::image_file::{Limits, decode_pixels};
use crate::io::image_set::{Options, Slot, load};
use crate::recipe::{MapFile, limits};
use crate::stage::control::{self, Named};
use crate::stage::sheet::Stacked;
use crate::synth::image::guide::Guide;
use crate::texture::MapSet;

use super::Stop;

/// Largest file that is read, in bytes.
const FILE_LIMIT: u64 = 1 << 31;

/// Weight of a guide that does not say: the recipe's default.
const GUIDE_WEIGHT: f64 = 1.0;

/// Flags that steer a synthesis.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Control")]
pub struct Control {
    /// Copy nothing from where this picture of the exemplar is black. For the n-th exemplar write N=FILE, or give the flag
    /// once for each in turn
    #[arg(long, value_name = "[N=]FILE", value_hint = ValueHint::FilePath, value_parser = numbered)]
    pub mask: Vec<Numbered>,
    /// What is wanted where: a picture of the output in the colours of --exemplar-guide or, without that, any picture whose
    /// light and dark is followed
    #[arg(long, value_name = "TARGET", value_hint = ValueHint::FilePath)]
    pub guide: Option<PathBuf>,
    /// What is where on the exemplar, in the colours of --guide; for all exemplars or none
    #[arg(long, value_name = "[N=]FILE", requires = "guide", value_hint = ValueHint::FilePath, value_parser = numbered)]
    pub exemplar_guide: Vec<Numbered>,
    /// What differences from the guide count against seams [default: 1.0]
    #[arg(long, value_name = "WEIGHT", requires = "guide", value_parser = weight)]
    pub guide_weight: Option<f64>,
    /// Fill in the (first) exemplar where this picture of it is white; the rest stays as it is
    #[arg(long, value_name = "MASK", conflicts_with = "region", value_hint = ValueHint::FilePath)]
    pub inpaint: Option<PathBuf>,
    /// Apply a synthesis again, to another map of the same size: its source coordinates. Nothing is analysed
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath,
          conflicts_with_all = ["guide", "inpaint", "size", "region", "tileable", "seed", "order", "patch", "neighbourhoods",
                               "refine"])]
    pub sources: Option<PathBuf>,
    /// What the exemplars hold [default: base_color]
    #[arg(long, value_name = "MAP", value_parser = super::args::word::<MapFile>())]
    pub map: Option<MapFile>,
}

/// A file for an exemplar.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Numbered {
    /// The exemplar, counted from 1; `None`: the next in turn.
    pub number: Option<usize>,
    /// The file.
    pub file: PathBuf,
}

fn numbered(text: &str) -> Result<Numbered, String> {
    let plain = Numbered { number: None, file: text.into() };
    let Some((number, file)) = text.split_once('=') else { return Ok(plain) };
    match number.parse() {
        Err(_) => Ok(plain),
        Ok(0) => Err("exemplars are counted from 1".into()),
        Ok(_) if file.is_empty() => Err("expected a file after the =".into()),
        Ok(number) => Ok(Numbered { number: Some(number), file: file.into() }),
    }
}

fn weight(text: &str) -> Result<f64, String> {
    super::args::within(text.parse().map_err(|_| "expected a number, such as 1.0")?, limits::GUIDE_WEIGHT)
}

/// One file or none for each of `count` exemplars.
fn for_each<'a>(flag: &str, given: &'a [Numbered], count: usize) -> Result<Vec<Option<&'a Path>>, Stop> {
    let mut out = vec![None; count];
    let mut next = 0;
    for Numbered { number, file } in given {
        let i = number.map_or(next, |n| n - 1);
        next = i + 1;
        match out.get_mut(i) {
            None => {
                return Err(Stop::Usage(format!(
                    "{flag} {}: there is no exemplar {}, only {count}",
                    file.display(),
                    i + 1
                )));
            }
            Some(Some(_)) => {
                return Err(Stop::Usage(format!("{flag} {}: exemplar {} has one already", file.display(), i + 1)));
            }
            Some(to) => *to = Some(file.as_path()),
        }
    }
    Ok(out)
}

/// A file in memory.
pub(super) struct Loaded {
    name: String,
    bytes: Vec<u8>,
}

impl Loaded {
    /// Reads a file.
    pub fn read(path: &Path) -> Result<Self, Stop> {
        let name = path.display().to_string();
        let bytes = Real.read(path, FILE_LIMIT).map_err(|e| Stop::Failed(format!("{name}: {e}")))?;
        Ok(Loaded { name, bytes })
    }

    /// Its name and bytes.
    pub fn named(&self) -> Named<'_> {
        Named { name: &self.name, bytes: &self.bytes }
    }
}

/// The files of a synthesis.
pub(super) struct Inputs {
    /// What the exemplars hold.
    pub map: MapFile,
    /// The exemplars' files.
    pub exemplars: Vec<Loaded>,
    masks: Vec<Option<Loaded>>,
    guide: Option<Loaded>,
    exemplar_guides: Vec<Loaded>,
    guide_weight: f64,
    inpaint: Option<Loaded>,
    /// Stored sources.
    pub sources: Option<Loaded>,
}

impl Inputs {
    /// Reads all files, after everything was checked that can be without them.
    pub fn read(exemplars: &[PathBuf], control: &Control, outputs: &[&Path]) -> Result<Self, Stop> {
        let Control { mask, guide, exemplar_guide, guide_weight, inpaint, sources, map } = control;
        let masks = for_each("--mask", mask, exemplars.len())?;
        let guides = for_each("--exemplar-guide", exemplar_guide, exemplars.len())?;
        if let (false, Some(i)) = (exemplar_guide.is_empty(), guides.iter().position(Option::is_none)) {
            let what = exemplars[i].display();
            return Err(Stop::Usage(format!("{what} has no --exemplar-guide: give every exemplar one, or none")));
        }
        let others = masks.iter().chain(&guides).flatten().copied();
        let others = others.chain([guide, inpaint, sources].into_iter().flatten().map(PathBuf::as_path));
        if let Some(path) = exemplars.iter().map(PathBuf::as_path).chain(others).find(|i| outputs.contains(i)) {
            return Err(Stop::Usage(format!("{} would be overwritten, and the output is made of it", path.display())));
        }
        let one = |path: &Option<PathBuf>| path.as_deref().map(Loaded::read).transpose();
        Ok(Inputs {
            map: map.unwrap_or(MapFile::BaseColor),
            exemplars: exemplars.iter().map(|path| Loaded::read(path)).collect::<Result<_, _>>()?,
            masks: masks.into_iter().map(|path| path.map(Loaded::read).transpose()).collect::<Result<_, _>>()?,
            guide: one(guide)?,
            exemplar_guides: guides.into_iter().flatten().map(Loaded::read).collect::<Result<_, _>>()?,
            guide_weight: guide_weight.unwrap_or(GUIDE_WEIGHT),
            inpaint: one(inpaint)?,
            sources: one(sources)?,
        })
    }

    /// The guide, if there is one; `size` if that was asked for.
    pub fn guide(&self, size: Option<[u32; 2]>, sheet: &Stacked) -> Result<Option<Guide>, Stop> {
        let Some(target) = &self.guide else { return Ok(None) };
        let samples: Vec<Named> = self.exemplar_guides.iter().map(Loaded::named).collect();
        let guide = control::guide(target.named(), &samples, size.or(sheet.fills()), sheet, self.guide_weight);
        guide.map(Some).map_err(Stop::Failed)
    }

    /// The file whose samples stay where it is filled in, decoded.
    pub fn original(&self) -> Result<Option<Pixels>, Stop> {
        let file = &self.exemplars[0];
        let decode = |_| decode_pixels(&file.bytes, &Limits::default());
        let decoded = self.inpaint.as_ref().map(decode).transpose();
        decoded.map_err(|e| Stop::Failed(format!("{}: {e}", file.name)))
    }

    /// Decodes the exemplars and puts them onto a sheet.
    pub fn sheet(&self) -> Result<Stacked, Stop> {
        let slot = match self.map {
            MapFile::Orm => Slot::Orm,
            single => Slot::Map(single.kinds()[0]),
        };
        let decode = |file: &Loaded| -> Result<MapSet, Stop> {
            load(&[(slot, &file.name, &file.bytes)], &Options::default())
                .map_err(|faults| Stop::Failed(faults.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n")))
        };
        let samples = self.exemplars.iter().map(decode).collect::<Result<Vec<_>, _>>()?;
        if samples.len() == 1 && self.masks[0].is_none() && self.inpaint.is_none() {
            let whole = samples.into_iter().next().map(Stacked::plain);
            return whole.unwrap_or(Err(Error::NoSamples)).map_err(|e| Stop::Failed(e.to_string()));
        }
        let masks: Vec<Option<Named>> = self.masks.iter().map(|m| m.as_ref().map(Loaded::named)).collect();
        let inpaint = self.inpaint.as_ref().map(Loaded::named);
        Stacked::read(samples, &masks, inpaint).map_err(Stop::Failed)
    }
}

/// The analysis' parameters: where none of the maps counts by default, all do.
pub(super) fn analysis(maps: &MapSet) -> AnalysisParams {
    let mut params = AnalysisParams::default();
    if maps.iter().all(|(kind, _)| !params.importance.contains_key(&kind)) {
        params.importance = maps.iter().map(|(kind, _)| (kind, 1.0)).collect();
    }
    params
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_find_their_exemplars() {
        let run = |given: &[&str], count| {
            let given: Vec<Numbered> = given.iter().map(|text| numbered(text).unwrap()).collect();
            match for_each("--mask", &given, count) {
                Ok(found) => {
                    Ok(found.iter().map(|f| f.map(|p| p.display().to_string()).unwrap_or_default()).collect::<Vec<_>>())
                }
                Err(Stop::Usage(text) | Stop::Failed(text) | Stop::Partly(text)) => Err(text),
                Err(Stop::Interrupted) => Err("interrupted".into()),
            }
        };
        assert_eq!(run(&["a.png", "b.png"], 3), Ok(vec!["a.png".into(), "b.png".into(), String::new()]));
        assert_eq!(
            run(&["3=a=b.png", "1=c.png", "d=e.png"], 3),
            Ok(vec!["c.png".into(), "d=e.png".into(), "a=b.png".into()])
        );
        assert_eq!(run(&["a.png", "b.png"], 1), Err("--mask b.png: there is no exemplar 2, only 1".into()));
        assert_eq!(run(&["a.png", "1=b.png"], 2), Err("--mask b.png: exemplar 1 has one already".into()));
        assert!(numbered("0=a.png").is_err() && numbered("1=").is_err());
    }
}
