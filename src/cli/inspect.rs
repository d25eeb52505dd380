//! `kiln inspect`: what is in a mesh or a picture.

use std::path::Path;

use serde_json::{Value, json};

use crate::disk::{Disk, Real};
use crate::io::image_file::{Format as Picture, Limits, decode_pixels};
use crate::io::named;
use crate::io::scene::Document;
use crate::mesh::{PrepareParams, Topology, check::census, prepare};

use super::args::{Format, Global, Inspect};
use super::{Done, Stop};

/// Largest file that is looked into, in bytes.
const LIMIT: u64 = 1 << 31;

/// Prints facts, one a line or as JSON.
pub(super) fn run(global: &Global, args: &Inspect) -> Result<Done, Stop> {
    let path = &args.file;
    let bytes = Real.read(path, LIMIT).map_err(|e| Stop::Failed(format!("{}: {e}", path.display())))?;
    let facts = if Picture::of(&bytes).is_some() { picture(path, &bytes)? } else { scene(path, &bytes)? };
    Done::ok(match global.format {
        Format::Json => format!("{facts}\n"),
        Format::Text => facts.as_object().into_iter().flatten().map(|(k, v)| line(k, v)).collect(),
    })
}

fn line(key: &str, value: &Value) -> String {
    let text = match value {
        Value::String(s) => s.clone(),
        Value::Array(items) if items.is_empty() => "none".into(),
        Value::Array(items) => {
            items.iter().map(|i| i.as_str().map_or(i.to_string(), str::to_string)).collect::<Vec<_>>().join(", ")
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

fn scene(path: &Path, bytes: &[u8]) -> Result<Value, Stop> {
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut resolve = |uri: &str| Real.read(&folder.join(uri), LIMIT).map_err(|e| e.to_string());
    let name = path.display().to_string();
    let document = Document::parse(&name, bytes, &mut resolve).map_err(|e| Stop::Failed(named(&name, &e)))?;
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
    // The facts of the surface need one that can be textured.
    let Ok(surface) = document.surface(None) else { return Ok(facts) };
    let (low, high) = surface.mesh.bounds();
    facts["bounds"] = json!([low.to_f32(), high.to_f32()]);
    let area: f64 = (0..surface.mesh.faces.len()).map(|f| surface.mesh.area(f)).sum();
    facts["surface area"] = json!(area);
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
