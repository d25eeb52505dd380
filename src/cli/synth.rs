//! `kiln synth`: a flat texture without a recipe, or a window of one.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

use crate::disk::{Disk, Real, Sink};
use crate::exemplar::{AnalysisParams, analyse};
use crate::io::SampleType;
use crate::io::image_file::{Compression, Transfer};
use crate::io::image_set::{Options, Slot, load};
use crate::io::image_strips::{Container, StripError};
use crate::numerics::par;
use crate::recipe::{Blend, BlendSize, CanvasOrder, MapFile};
use crate::stage::painting::{Painting, Picture};
use crate::synth::image_canvas::{ImageCanvas, ImageTask};
use crate::synth::image_copy::BlendKernel;
use crate::synth::image_order::ImageOrder;
use crate::synth::image_walk::ImageWalkParams;
use crate::synth::seam_metric::SeamMetrics;
use crate::synth::source_map::{ImageCounters, Rect};
use crate::synth::source_strips::SourceStrips;
use crate::texture::{MapKind, MapSet};

use super::args::{Global, Region, Size, Synth};
use super::{Done, Stop, jobs};

/// Correction passes where none are asked for: the recipe's default.
const REFINE: u32 = 2;
/// Largest exemplar file, in bytes.
const EXEMPLAR_LIMIT: u64 = 1 << 30;

/// A file to be written.
struct Output<'a> {
    path: &'a Path,
    picture: Picture,
    container: Container,
}

/// Analyses, walks, paints, writes.
pub(super) fn run(global: &Global, args: &Synth) -> Result<Done, Stop> {
    let outputs = outputs(args)?;
    let part = part(args)?;
    if args.blend == Some(Blend::Variance) {
        return Err(Stop::Usage("--blend variance: images blend by linear or none".into()));
    }
    let maps = read(&args.exemplar)?;
    let names: String = outputs.iter().map(|o| format!("{}\n", o.path.display())).collect();
    if global.dry_run {
        return Done::ok(names.lines().map(|name| format!("would write {name}\n")).collect::<String>());
    }
    let clock = Clock { verbose: global.verbose > 0, begun: Instant::now() };
    par::install(jobs(global), || {
        let sources = synthesise(args, &maps, part, &clock)?;
        outputs.iter().try_for_each(|output| {
            write(args, output, &maps, &sources)?;
            clock.say(&output.path.display().to_string());
            Ok(())
        })
    })?;
    Done::ok(if global.quiet { String::new() } else { names })
}

/// The files to be written, none of them twice, and none over the exemplar.
fn outputs(args: &Synth) -> Result<Vec<Output<'_>>, Stop> {
    let extension = args.output.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
    let png = |transfer| Container::Png { transfer, compression: Compression::Fast };
    let (depth, container) = match extension.as_deref() {
        Some("png") => (SampleType::U8, png(Transfer::Srgb)),
        Some("exr") => (SampleType::F32, Container::Exr),
        _ => return Err(Stop::Usage(format!("{}: expected a name that ends in .png or .exr", args.output.display()))),
    };
    let mut all = vec![Output { path: &args.output, picture: Picture::Map(MapFile::BaseColor, depth), container }];
    all.extend(args.debug.iter().map(|d| Output {
        path: &d.file,
        picture: Picture::Debug(d.what),
        container: png(Transfer::Unstated),
    }));
    let mut taken: Vec<&PathBuf> = vec![&args.exemplar];
    for path in std::iter::once(&args.output).chain(args.debug.iter().map(|d| &d.file)) {
        if *path == args.exemplar {
            return Err(Stop::Usage(format!("{} would overwrite the exemplar", path.display())));
        }
        if taken.contains(&path) {
            return Err(Stop::Usage(format!("{} would be written twice", path.display())));
        }
        taken.push(path);
    }
    Ok(all)
}

/// The window of the canvas that is wanted.
fn part(args: &Synth) -> Result<Rect, Stop> {
    let Size { width, height } = args.size;
    let Some(Region { x, y, width: w, height: h }) = args.region else { return Ok(Rect::whole([width, height])) };
    let part = Rect { x, y, width: w, height: h };
    if part.fits([width, height]) {
        return Ok(part);
    }
    Err(Stop::Usage(format!("--region {x},{y},{w},{h} does not lie in an output of {width} x {height}")))
}

fn read(path: &Path) -> Result<MapSet, Stop> {
    let name = path.display().to_string();
    let bytes = Real.read(path, EXEMPLAR_LIMIT).map_err(|e| Stop::Failed(format!("{name}: {e}")))?;
    load(&[(Slot::Map(MapKind::BaseColor), &name, &bytes)], &Options::default())
        .map_err(|faults| Stop::Failed(faults.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n")))
}

fn synthesise(args: &Synth, maps: &MapSet, part: Rect, clock: &Clock) -> Result<SourceStrips, Stop> {
    let fail = |e: &dyn std::error::Error| {
        Stop::Failed(format!("{}: {}", args.exemplar.display(), super::bake::with_causes(e)))
    };
    let mut params = AnalysisParams::default();
    if let Some(sides) = &args.neighbourhoods {
        params.neighbourhoods = sides.0.clone();
    }
    let (map, _) = analyse(maps, &params).map_err(|e| fail(&e))?;
    let order = match args.order.unwrap_or(CanvasOrder::Hilbert) {
        CanvasOrder::Scanline => ImageOrder::Scanline,
        CanvasOrder::Serpentine => ImageOrder::Serpentine,
        CanvasOrder::Hilbert => ImageOrder::Hilbert,
    };
    let walk = ImageWalkParams {
        size: [args.size.width, args.size.height],
        order,
        patch: args.patch.unwrap_or(1.0),
        seed: args.seed.unwrap_or(1),
        tileable: args.tileable,
    };
    let refine = args.refine.unwrap_or(REFINE);
    let metrics = SeamMetrics::new(maps, &params).map_err(|e| fail(&e))?;
    clock.say("analysis");
    let task = ImageTask { jumps: &map, metrics: Some(&metrics), walk, refine, guide: None, given: None };
    let sources = SourceStrips::synthesise(&mut ImageCanvas::new(task).map_err(|e| fail(&e))?, part);
    let ImageCounters { seeds, jumps, forced_jumps, dead_ends, unshifted_jumps, random_fallbacks } = sources.counters;
    clock.say(&format!(
        "synthesis: {seeds} seeds, {jumps} jumps, {forced_jumps} forced, {dead_ends} dead ends, {unshifted_jumps} \
         unshifted, {random_fallbacks} random"
    ));
    Ok(sources)
}

/// Writes a picture strip by strip.
fn write(args: &Synth, output: &Output, maps: &MapSet, sources: &SourceStrips) -> Result<(), Stop> {
    let kernel = match (args.blend, args.blend_kernel) {
        (Some(Blend::None), _) => BlendKernel::None,
        (_, Some(BlendSize::Five)) => BlendKernel::Five,
        (_, _) => BlendKernel::Three,
    };
    let painting = Painting { sources, maps, picture: output.picture, kernel };
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
