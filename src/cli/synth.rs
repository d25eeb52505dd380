//! `kiln synth`: a flat texture without a recipe.

use std::path::Path;

use crate::disk::{Disk, Real};
use crate::exemplar::{AnalysisParams, analyse};
use crate::io::SampleType;
use crate::io::image_file::{Compression, Transfer, encode_exr, encode_png};
use crate::io::image_quantise::{Encoding, quantise};
use crate::io::image_set::{Options, Slot, load};
use crate::numerics::par;
use crate::recipe::{Blend, CanvasOrder};
use crate::synth::image_canvas::{ImageCanvas, ImageTask};
use crate::synth::image_copy::{BlendKernel, copy};
use crate::synth::image_order::ImageOrder;
use crate::synth::image_walk::ImageWalkParams;
use crate::synth::seam_metric::SeamMetrics;
use crate::synth::source_map::Rect;
use crate::texture::{MapKind, MapSet};

use super::args::{Global, Synth};
use super::{Done, Stop, jobs};

/// Correction passes where none are asked for: the recipe's default.
const REFINE: u32 = 2;
/// Largest exemplar file, in bytes.
const EXEMPLAR_LIMIT: u64 = 1 << 30;

/// Analyses, walks, copies, writes.
pub(super) fn run(global: &Global, args: &Synth) -> Result<Done, Stop> {
    let exr = match args.output.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase).as_deref() {
        Some("png") => false,
        Some("exr") => true,
        _ => return Err(Stop::Usage(format!("{}: expected a name that ends in .png or .exr", args.output.display()))),
    };
    if args.output == args.exemplar {
        return Err(Stop::Usage(format!("{} would overwrite the exemplar", args.output.display())));
    }
    if args.blend == Some(Blend::Variance) {
        return Err(Stop::Usage("--blend variance: images blend by linear or none".into()));
    }
    let maps = read(&args.exemplar)?;
    if global.dry_run {
        return Done::ok(format!("would write {}\n", args.output.display()));
    }
    let bytes = par::install(jobs(global), || make(args, &maps, exr))?;
    super::bake::write(&args.output, &bytes)?;
    Done::ok(if global.quiet { String::new() } else { format!("{}\n", args.output.display()) })
}

fn read(path: &Path) -> Result<MapSet, Stop> {
    let name = path.display().to_string();
    let bytes = Real.read(path, EXEMPLAR_LIMIT).map_err(|e| Stop::Failed(format!("{name}: {e}")))?;
    load(&[(Slot::Map(MapKind::BaseColor), &name, &bytes)], &Options::default())
        .map_err(|faults| Stop::Failed(faults.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n")))
}

fn make(args: &Synth, maps: &MapSet, exr: bool) -> Result<Vec<u8>, Stop> {
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
    let size = [args.size.width, args.size.height];
    let walk_params = ImageWalkParams {
        size,
        order,
        patch: args.patch.unwrap_or(1.0),
        seed: args.seed.unwrap_or(1),
        tileable: false,
    };
    let refine = args.refine.unwrap_or(REFINE);
    let metrics = SeamMetrics::new(maps, &params).map_err(|e| fail(&e))?;
    let task = ImageTask { jumps: &map, metrics: Some(&metrics), walk: walk_params, refine, guide: None, given: None };
    let mut canvas = ImageCanvas::new(task).map_err(|e| fail(&e))?;
    let sources = canvas.window(Rect::whole(size));
    let kernel = match args.blend.unwrap_or(Blend::Linear) {
        Blend::None => BlendKernel::None,
        _ => BlendKernel::Three,
    };
    let color = maps.get(MapKind::BaseColor).map(|t| copy(t, &sources, kernel));
    let color = color.ok_or_else(|| Stop::Failed("the exemplar has no colour".into()))?;
    let picture = match maps.get(MapKind::Opacity).map(|t| copy(t, &sources, kernel)) {
        None => color,
        Some(alpha) => color.with_alpha(&alpha),
    };
    let depth = if exr { SampleType::F32 } else { SampleType::U8 };
    let pixels = quantise(&picture, Encoding::Color, depth).map_err(|e| fail(&e))?;
    if exr { encode_exr(&pixels) } else { encode_png(&pixels, Compression::Fast, Transfer::Srgb) }.map_err(|e| fail(&e))
}
