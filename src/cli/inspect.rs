//! `kiln inspect`: what is in a mesh, an exemplar, a jump map, a tile, a field or a bake.

use std::path::Path;

use serde_json::{Value, json};

use crate::disk::{Disk, Real};
use crate::exemplar::{
    AnalysisParams, JUMP_MAP_MAGIC, JumpMap, TextonMap, TextonParams, analyse_measured, analyse_textons,
};
use crate::field::{Laid, Singularity, Symmetry};
use crate::io::artefact::Artefact;
use crate::io::image_file::{Compression, Format as Picture, Limits, Transfer, decode_pixels, encode_png};
use crate::io::image_set::{Options, Slot, load};
use crate::io::ktx2::Ktx2Header;
use crate::io::scene::Document;
use crate::io::{Pixels, Samples, named};
use crate::mesh::{PrepareParams, Topology, check::census, prepare};
use crate::numerics::par;
use crate::numerics::rng::Key;
use crate::stage::tile;
use crate::synth::mesh::rendering_sequence::{CACHE, acmr};
use crate::texture::{MapKind, Wrap};
use crate::tile::{Mask, find_features, seamless};

use super::args::{Format, Global, Inspect};
use super::{Done, Stop, jobs};

/// Largest file that is looked into, in bytes.
const LIMIT: u64 = 1 << 31;
/// Larger pictures are hardly exemplars; an analysis would take minutes.
const MOST_TEXELS: u64 = 1 << 22;
/// Texels at which the recall is measured.
const RECALL_SAMPLES: usize = 400;

/// Prints facts, one a line or as JSON.
pub(super) fn run(global: &Global, args: &Inspect) -> Result<Done, Stop> {
    let path = &args.file;
    let bytes = Real.read(path, LIMIT).map_err(|e| Stop::Failed(format!("{}: {e}", path.display())))?;
    let facts = if Picture::of(&bytes).is_some() {
        let mut facts = picture(path, &bytes)?;
        if let Some(out) = &args.texton_map {
            let map = par::install(jobs(global), || textons(path, &bytes, &mut facts))?;
            if !global.dry_run {
                super::bake::write(out, &texton_picture(&map)?)?;
            }
        }
        if let Some(out) = &args.feature_mask {
            let mask = par::install(jobs(global), || features(path, &bytes, &mut facts))?;
            if !global.dry_run {
                super::bake::write(out, &mask_picture(&mask)?)?;
            }
        }
        if !args.quick {
            par::install(jobs(global), || analysis(path, &bytes, &mut facts));
        }
        facts
    } else if args.texton_map.is_some() {
        return Err(Stop::Usage(format!("{}: --texton-map is for pictures, and this is none", path.display())));
    } else if args.feature_mask.is_some() {
        return Err(Stop::Usage(format!("{}: --feature-mask is for pictures, and this is none", path.display())));
    } else if bytes.starts_with(JUMP_MAP_MAGIC) {
        jump_map(path, &bytes)?
    } else if Laid::is_one(&bytes) {
        field(path, &bytes)?
    } else if let Some(read) = tile::described(&bytes) {
        let mut facts = read.map_err(|e| Stop::Failed(format!("{}: {e}", path.display())))?;
        (facts["file"], facts["kind"]) = (json!(path.display().to_string()), json!("tile"));
        facts
    } else if let Some(header) = Ktx2Header::read(&bytes) {
        layered(path, &header, bytes.len())
    } else {
        scene(path, &bytes)?
    };
    Done::ok(match global.format {
        Format::Json | Format::Ninja => format!("{facts}\n"),
        Format::Text => facts.as_object().into_iter().flatten().map(|(k, v)| line(k, v)).collect(),
    })
}

fn line(key: &str, value: &Value) -> String {
    let text = match value {
        Value::String(s) => s.clone(),
        Value::Array(items) if items.is_empty() => "none".into(),
        Value::Array(items) => {
            let text = |i: &Value| match i {
                Value::Object(o) => o.iter().map(|(k, v)| format!("{k} {v}")).collect::<Vec<_>>().join(" "),
                _ => i.as_str().map_or(i.to_string(), str::to_string),
            };
            let between = if items[0].is_object() { format!("\n{:25}", "") } else { ", ".into() };
            items.iter().map(text).collect::<Vec<_>>().join(&between)
        }
        other => other.to_string(),
    };
    format!("{key:24} {text}\n")
}

fn picture(path: &Path, bytes: &[u8]) -> Result<Value, Stop> {
    let pixels =
        decode_pixels(bytes, &Limits::default()).map_err(|e| Stop::Failed(format!("{}: {e}", path.display())))?;
    Ok(json!({
        "file": path.display().to_string(),
        "size": [pixels.width, pixels.height],
        "channels": pixels.channels,
        "samples": pixels.samples.sample_type().name(),
    }))
}

/// Adds what an analysis as by a recipe without `[analysis]` finds, or why there is none.
fn analysis(path: &Path, bytes: &[u8], facts: &mut Value) {
    let texels: u64 = facts["size"].as_array().into_iter().flatten().filter_map(Value::as_u64).product();
    if texels > MOST_TEXELS {
        facts["analysis"] = json!(format!("none of more than {MOST_TEXELS} texels"));
        return;
    }
    let params = AnalysisParams::default();
    let found = load(&[(Slot::Map(MapKind::BaseColor), &path.display().to_string(), bytes)], &Options::default())
        .map_err(|faults| faults.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "))
        .and_then(|maps| analyse_measured(&maps, &params, RECALL_SAMPLES).map_err(|e| e.to_string()));
    let (map, report, recall) = match found {
        Ok(found) => found,
        Err(why) => {
            facts["analysis"] = json!(why);
            return;
        }
    };
    facts["neighbourhoods"] = json!(params.neighbourhoods);
    facts["dimensions"] = json!(report.dimensions);
    facts["dimensions kept"] = json!(report.kept_dimensions);
    facts["variance kept"] = rounded(report.kept_variance);
    facts["least jump"] = json!(report.min_distance);
    facts["mean distance"] = rounded(report.mean_distance);
    facts["largest distance"] = rounded(report.max_distance);
    facts["recall"] = rounded(recall);
    jumps(&map, map.to_bytes().len(), facts);
}

/// The textons of a picture, as by a recipe with `method = "texton"` and nothing else; adds what was found.
fn textons(path: &Path, bytes: &[u8], facts: &mut Value) -> Result<TextonMap, Stop> {
    let fail = |why: String| Stop::Failed(format!("{}: {why}", path.display()));
    let maps = load(&[(Slot::Map(MapKind::BaseColor), &path.display().to_string(), bytes)], &Options::default())
        .map_err(|faults| fail(faults.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")))?;
    let (map, report) = analyse_textons(&maps, &TextonParams::default()).map_err(|e| fail(e.to_string()))?;
    facts["textons"] = json!(map.count());
    facts["texton dimensions"] = json!([report.dimensions, report.kept_dimensions]);
    facts["texton variance kept"] = rounded(report.kept_variance);
    facts["texton iterations"] = json!(report.iterations);
    facts["texton spread"] = rounded(report.spread);
    if let Some(note) = map.note() {
        facts["note"] = json!(note);
    }
    Ok(map)
}

/// The features of a picture, as of a key of a tile that brings no mask; adds what was found.
fn features(path: &Path, bytes: &[u8], facts: &mut Value) -> Result<Mask, Stop> {
    let fail = |why: String| Stop::Failed(format!("{}: {why}", path.display()));
    let maps = load(&[(Slot::Map(MapKind::BaseColor), &path.display().to_string(), bytes)], &Options::default())
        .map_err(|faults| fail(faults.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")))?;
    let importance = AnalysisParams::default().importance;
    let cut = seamless(&maps, &importance);
    let none = || fail("no features are found: it looks the same everywhere".into());
    let mask = find_features(&cut.apply(&maps), &importance).ok_or_else(none)?;
    facts["border difference"] = rounded(cut.border);
    facts["seam difference"] = rounded(cut.seams);
    facts["inside features"] = rounded(mask.count() as f64 / mask.data().len() as f64);
    Ok(mask)
}

fn mask_picture(mask: &Mask) -> Result<Vec<u8>, Stop> {
    let samples = Samples::U8(mask.data().iter().map(|on| 255 * u8::from(*on)).collect());
    let pixels = Pixels { width: mask.width(), height: mask.height(), channels: 1, samples };
    encode_png(&pixels, Compression::Fast, Transfer::Unstated).map_err(|e| Stop::Failed(e.to_string()))
}

/// Labels as colours (\[MK03\] figure 2).
fn texton_picture(map: &TextonMap) -> Result<Vec<u8>, Stop> {
    let key = Key::new(1).with_str("pseudo-colours");
    let color = |t: &u16| [0, 1, 2].map(|c| 32 + key.with(u64::from(*t)).below(c, 224) as u8);
    let samples = Samples::U8(map.labels(0).iter().flat_map(color).collect());
    let pixels = Pixels { width: map.width(), height: map.height(), channels: 3, samples };
    encode_png(&pixels, Compression::Fast, Transfer::Srgb).map_err(|e| Stop::Failed(e.to_string()))
}

fn layered(path: &Path, header: &Ktx2Header, bytes: usize) -> Value {
    let Ktx2Header { format, width, height, depth, layers, faces, levels } = *header;
    let shape = match (depth, layers, faces) {
        (0, 0, 6) => "cube",
        (0, 0, _) => "2d",
        (0, _, 6) => "cube-array",
        (0, _, _) => "2d-array",
        _ => "3d",
    };
    let samples = match header.is_srgb() {
        Some(true) => "RGBA, 8 bits, sRGB".to_string(),
        Some(false) => "RGBA, 8 bits".to_string(),
        None => format!("format {format} of Vulkan"),
    };
    json!({
        "file": path.display().to_string(),
        "kind": "KTX2 texture",
        "shape": shape,
        "size": [width, height],
        "layers": depth.max(layers).max(1),
        "levels": levels,
        "samples": samples,
        "bytes": bytes,
    })
}

fn jump_map(path: &Path, bytes: &[u8]) -> Result<Value, Stop> {
    let map = JumpMap::from_bytes(bytes).map_err(|e| Stop::Failed(format!("{}: {e}", path.display())))?;
    let domain = map.domain();
    let mut facts = json!({
        "file": path.display().to_string(),
        "kind": "jump map",
        "size": [map.width(), map.height()],
        "texels to copy from": domain.len(),
        "tileable": domain.wrap() == Wrap::Repeat,
    });
    jumps(&map, bytes.len(), &mut facts);
    Ok(facts)
}

fn field(path: &Path, bytes: &[u8]) -> Result<Value, Stop> {
    let laid = Laid::from_bytes(bytes).map_err(|e| Stop::Failed(format!("{}: {e}", path.display())))?;
    let symmetry = match laid.symmetry {
        Symmetry::Isotropic => json!("isotropic"),
        ways => json!(ways.directions()),
    };
    let scales = || laid.field.scale.iter().copied();
    let point = |s: &Singularity| json!({ "index": s.index, "at": s.at.to_f32(), "face": s.face });
    let mut facts = json!({
        "file": path.display().to_string(),
        "kind": "field",
        "vertices": laid.field.up.len(),
        "symmetry": symmetry,
        "least scale": scales().reduce(f32::min),
        "largest scale": scales().reduce(f32::max),
        "singular points": laid.singularities.len(),
        "index sum": laid.singularities.iter().map(|s| s.index).sum::<f64>(),
        "singularities": laid.singularities.iter().map(point).collect::<Vec<_>>(),
    });
    if let Some(euler) = laid.euler {
        facts["euler characteristic"] = json!(euler);
    }
    Ok(facts)
}

/// Adds the facts of a jump map. Texels are those that may be copied.
fn jumps(map: &JumpMap, bytes: usize, facts: &mut Value) {
    let counts = || map.domain().texels().map(|[x, y]| map.row(x.into(), y.into()).len());
    let texels = map.domain().len();
    facts["mean jumps"] = rounded(counts().sum::<usize>() as f64 / texels as f64);
    facts["most jumps"] = json!(counts().max());
    facts["jumpless texels"] = json!(counts().filter(|c| *c == 0).count());
    facts["bytes"] = json!(bytes);
    facts["bytes per texel"] = rounded(bytes as f64 / texels as f64);
}

/// To four digits, which no rounding error reaches.
fn rounded(v: f64) -> Value {
    json!((v * 1e4).round() / 1e4)
}

fn scene(path: &Path, bytes: &[u8]) -> Result<Value, Stop> {
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut resolve = |uri: &str| Real.read(&folder.join(uri), LIMIT).map_err(|e| e.to_string());
    let name = path.display().to_string();
    let document = Document::parse(&name, bytes, &mut resolve).map_err(|e| Stop::Failed(named(&name, &e)))?;
    let report = Real.read(&folder.join("report.json"), LIMIT).ok();
    let s = document.summary();
    let mut facts = json!({
        "file": name,
        "nodes": s.nodes,
        "meshes": s.meshes,
        "primitives": s.primitives,
        "triangles": s.triangles,
        "vertices": s.vertices,
        "materials": s.materials,
        "uv sets": s.uv_sets,
        "normals": s.normals,
        "images": s.images,
        "skins": s.skins,
        "animations": s.animations,
        "morph targets": s.morph_targets,
        "extensions": s.extensions,
    });
    // A bake has a report beside it, which knows the field that its texture follows.
    let report = report.and_then(|bytes| serde_json::from_slice::<Value>(&bytes).ok()).unwrap_or_default();
    if let Some(found) = report["field"]["singularities"].as_array() {
        facts["singular points"] = json!(found.len());
        facts["singularities"] = json!(found);
    }
    // Of a tile's bake also where its coordinates end or meet.
    if let Some(found) = report["synthesis"]["singularities"].as_array() {
        let count = |kind: &str| json!(found.iter().filter(|s| s["kind"] == kind).count());
        facts["poles"] = count("pole");
        facts["t-junctions"] = count("t-junction");
        facts["poles and t-junctions"] = json!(found);
    }
    if let Some(count) = report["synthesis"]["periodic"].get("components_without_material") {
        facts["components without material"] = count.clone();
    }
    // The facts of the surface need one that can be textured.
    let Ok(surface) = document.surface(None) else { return Ok(facts) };
    let (low, high) = surface.mesh.bounds();
    facts["bounds"] = json!([low.to_f32(), high.to_f32()]);
    let area: f64 = (0..surface.mesh.faces.len()).map(|f| surface.mesh.area(f)).sum();
    facts["surface area"] = json!(area);
    // As a cache of vertices sees the file: nothing is welded here.
    facts["acmr"] = rounded(acmr(&surface.mesh.faces, surface.mesh.positions.len(), CACHE));
    // Welded as a bake would see it; at this scale nothing is subdivided.
    if let Ok(welded) = prepare(&surface, &PrepareParams::new(f64::MIN_POSITIVE, [1024, 1024])) {
        let c = census(&welded.mesh, &Topology::new(&welded.mesh));
        facts["welded vertices"] = json!(welded.mesh.positions.len());
        facts["components"] = json!(c.components);
        facts["boundary edges"] = json!(c.boundary_edges);
        facts["non-manifold edges"] = json!(c.non_manifold_edges);
        facts["euler characteristic"] = json!(c.euler);
    }
    Ok(facts)
}
