//! `kiln synth`: a flat texture without a recipe, or a window of one.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

use crate::disk::{Disk, Real, Sink};
use crate::exemplar::analyse_sheet;
use crate::io::image_file::{Compression, Transfer};
use crate::io::image_strips::{Container, StripError};
use crate::io::{Pixels, SampleType};
use crate::numerics::par;
use crate::recipe::{Blend, BlendSize, CanvasOrder, MapFile};
use crate::stage::control;
use crate::stage::painting::{Painting, Picture};
use crate::stage::sheet::Stacked;
use crate::synth::image::canvas::{ImageCanvas, ImageTask};
use crate::synth::image::copy::BlendKernel;
use crate::synth::image::order::ImageOrder;
use crate::synth::image::source_map::{ImageCounters, Rect, SourceMap};
use crate::synth::image::source_strips::SourceStrips;
use crate::synth::image::walk::ImageWalkParams;
use crate::tile::{Seamless, seamless};

use super::args::{Global, Region, Size, Synth};
use super::synth_inputs::{Inputs, analysis};
use super::{Done, Stop, jobs};

/// Correction passes where none are asked for: the recipe's default.
const REFINE: u32 = 2;

/// A file to be written.
struct Output<'a> {
    path: &'a Path,
    picture: Picture,
    container: Container,
}

/// Analyses, walks, paints, writes.
pub(super) fn run(global: &Global, args: &Synth) -> Result<Done, Stop> {
    let outputs = outputs(args)?;
    if args.blend == Some(Blend::Variance) {
        return Err(Stop::Usage("--blend variance: images blend by linear or none".into()));
    }
    if args.seamless && args.exemplars.len() > 1 {
        return Err(Stop::Usage(format!(
            "--seamless: one sample is made to wrap, and here are {}",
            args.exemplars.len()
        )));
    }
    let paths: Vec<&Path> = outputs.iter().map(|o| o.path).collect();
    let inputs = Inputs::read(&args.exemplars, &args.control, &paths)?;
    let sheet = inputs.sheet()?;
    let original = inputs.original()?;
    let names: String = outputs.iter().map(|o| format!("{}\n", o.path.display())).collect();
    if global.dry_run {
        return Done::ok(names.lines().map(|name| format!("would write {name}\n")).collect::<String>());
    }
    let clock = Clock { verbose: global.verbose > 0, begun: Instant::now() };
    par::install(jobs(global), || {
        let sources = synthesise(args, &inputs, &sheet, &clock)?;
        outputs.iter().try_for_each(|output| {
            write(args, output, &sheet, original.as_ref(), &sources)?;
            clock.say(&output.path.display().to_string());
            Ok(())
        })
    })?;
    Done::ok(if global.quiet { String::new() } else { names })
}

/// The files to be written, none of them twice.
fn outputs(args: &Synth) -> Result<Vec<Output<'_>>, Stop> {
    let extension = args.output.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
    let png = |transfer| Container::Png { transfer, compression: Compression::Fast };
    let (depth, container) = match extension.as_deref() {
        Some("png") => (SampleType::U8, png(Transfer::Srgb)),
        Some("exr") => (SampleType::F32, Container::Exr),
        _ => return Err(Stop::Usage(format!("{}: expected a name that ends in .png or .exr", args.output.display()))),
    };
    let map = args.control.map.unwrap_or(MapFile::BaseColor);
    let transfer = if map.kinds()[0].is_srgb() { Transfer::Srgb } else { Transfer::Unstated };
    let container = if container == Container::Exr { container } else { png(transfer) };
    let mut all = vec![Output { path: &args.output, picture: Picture::Map(map, depth), container }];
    all.extend(args.debug.iter().map(|d| Output {
        path: &d.file,
        picture: Picture::Debug(d.what),
        container: png(Transfer::Unstated),
    }));
    let mut taken: Vec<&PathBuf> = vec![];
    for path in std::iter::once(&args.output).chain(args.debug.iter().map(|d| &d.file)) {
        if taken.contains(&path) {
            return Err(Stop::Usage(format!("{} would be written twice", path.display())));
        }
        taken.push(path);
    }
    Ok(all)
}

/// The window of the canvas that is wanted.
fn part(args: &Synth, [width, height]: [u32; 2]) -> Result<Rect, Stop> {
    let Some(Region { x, y, width: w, height: h }) = args.region else { return Ok(Rect::whole([width, height])) };
    let part = Rect { x, y, width: w, height: h };
    if part.fits([width, height]) {
        return Ok(part);
    }
    Err(Stop::Usage(format!("--region {x},{y},{w},{h} does not lie in an output of {width} x {height}")))
}

/// Chooses the sources of the part that is wanted.
fn synthesise(args: &Synth, inputs: &Inputs, sheet: &Stacked, clock: &Clock) -> Result<SourceStrips, Stop> {
    let names: Vec<String> = args.exemplars.iter().map(|e| e.display().to_string()).collect();
    let fail =
        |e: &dyn std::error::Error| Stop::Failed(format!("{}: {}", names.join(", "), super::bake::with_causes(e)));
    if let Some(file) = &inputs.sources {
        return Ok(SourceStrips::of(&control::sources(file.named(), sheet).map_err(Stop::Failed)?));
    }
    if args.seamless {
        return Ok(wrapped(sheet, clock));
    }
    let wanted = args.size.map(|Size { width, height }| [width, height]);
    let guide = inputs.guide(wanted, sheet)?;
    let size = control::canvas_size(wanted, guide.as_ref(), sheet).map_err(Stop::Failed)?;
    let part = part(args, size)?;
    let seed = args.seed.unwrap_or(1);
    let guide = match guide {
        None => control::mixed(size, args.tileable, seed, sheet).map_err(Stop::Failed)?,
        some => some,
    };
    let mut params = analysis(sheet.maps());
    if let Some(sides) = &args.neighbourhoods {
        params.neighbourhoods = sides.0.clone();
    }
    let (map, _) = analyse_sheet(sheet.sheet(), &params).map_err(|e| fail(&e))?;
    let order = match args.order.unwrap_or(CanvasOrder::Hilbert) {
        CanvasOrder::Scanline => ImageOrder::Scanline,
        CanvasOrder::Serpentine => ImageOrder::Serpentine,
        CanvasOrder::Hilbert => ImageOrder::Hilbert,
    };
    let walk = ImageWalkParams { size, order, patch: args.patch.unwrap_or(1.0), seed, tileable: args.tileable };
    let refine = args.refine.unwrap_or(REFINE);
    let metrics = sheet.metrics(&params).map_err(|e| fail(&e))?;
    clock.say("analysis");
    let given = sheet.given();
    let (guide, given) = (guide.as_ref(), given.as_deref());
    let task = ImageTask { jumps: &map, metrics: Some(&metrics), walk, refine, guide, given };
    let sources = SourceStrips::synthesise(&mut ImageCanvas::new(task).map_err(|e| fail(&e))?, part);
    let ImageCounters { seeds, jumps, forced_jumps, dead_ends, unshifted_jumps, random_fallbacks } = sources.counters;
    clock.say(&format!(
        "synthesis: {seeds} seeds, {jumps} jumps, {forced_jumps} forced, {dead_ends} dead ends, {unshifted_jumps} \
         unshifted, {random_fallbacks} random"
    ));
    Ok(sources)
}

/// The sample made to wrap.
fn wrapped(sheet: &Stacked, clock: &Clock) -> SourceStrips {
    let maps = sheet.maps();
    let Seamless { sources, border, seams } = seamless(maps, &analysis(maps).importance);
    clock.say(&format!("cut: seams of {seams:.4} per texel, the border has {border:.4}"));
    let (width, height) = (maps.width(), maps.height());
    let sources = sources.into_iter().map(|s| [(s % width) as u16, (s / width) as u16]).collect();
    let exemplar_size = [width, height];
    let counters = ImageCounters::default();
    SourceStrips::of(&SourceMap { width, height, exemplar_size, sources, tileable: true, counters })
}

/// Writes a picture strip by strip.
fn write(
    args: &Synth,
    output: &Output,
    sheet: &Stacked,
    original: Option<&Pixels>,
    sources: &SourceStrips,
) -> Result<(), Stop> {
    let kernel = match (args.blend, args.blend_kernel) {
        (Some(Blend::None), _) => BlendKernel::None,
        // A cut that was sought needs no blending, and a sample that wraps already stays as it is.
        (None, None) if args.seamless => BlendKernel::None,
        (_, Some(BlendSize::Five)) => BlendKernel::Five,
        (_, _) => BlendKernel::Three,
    };
    let (maps, bounds) = (sheet.maps(), sheet.bounds());
    let painting = Painting { sources, maps, picture: output.picture, kernel, bounds, original };
    let written = Real.write_with(output.path, &mut |sink: &mut dyn Sink| {
        painting.write(sink, output.container).map_err(|e| match e {
            StripError::Write(e) => e,
            other => std::io::Error::other(other),
        })
    });
    written.map_err(|e| Stop::Failed(format!("cannot write {}: {e}", output.path.display())))
}

/// Says on stderr, if that was asked for, what is done and when.
struct Clock {
    verbose: bool,
    begun: Instant,
}

impl Clock {
    fn say(&self, what: &str) {
        if self.verbose {
            let _ = writeln!(anstream::stderr(), "{:6.2}s  {what}", self.begun.elapsed().as_secs_f64());
        }
    }
}
