//! Step: `report.json`, what a bake came to in numbers. Nothing in it depends on the machine or the day.

use serde_json::{Value, json};

use crate::bake::Atlas;
use crate::build::{Inputs, Step, StepError, Visitor};
use crate::exemplar::{JumpMap, TextonMap};
use crate::field::{Laid, Singularity};
use crate::io::artefact::Artefact;
use crate::mesh::Surface;
use crate::param::{Kind, Parametrization, Singularity as Place};
use crate::synth::source_map::ImageCounters;
use crate::synth::source_strips::SourceStrips;

use super::material_space::places;
use super::prepare::Prepared;
use super::rasterise::Bundle;
use super::synthesise::{Counters, Synthesised};
use super::tile::{MadeTile, facts};

/// Reads surface, synthesis mesh, corner coordinates, what was analysed and the field, and of an atlas bake the atlas and
/// its images; of a tile's bake last the periodic coordinates.
pub(super) struct Report {
    pub recipe: String,
}

impl Step for Report {
    super::step_identity!("report", 2);

    fn describe(&self, v: &mut dyn Visitor) {
        v.param("recipe", &self.recipe);
    }

    fn run(&self, inputs: &Inputs) -> Result<Vec<u8>, StepError> {
        let surface: Surface = super::read(inputs, 0)?;
        let prepared: Prepared = super::read(inputs, 1)?;
        let synthesised: Synthesised = super::read(inputs, 2)?;
        let (sample, how) = described(&synthesised.counters, &inputs[3])?;
        let laid: Laid = super::read(inputs, 4)?;
        let mut atlas_inputs = inputs.len();
        let mut report = json!({
            "recipe": self.recipe,
            "mesh": {
                "triangles": surface.mesh.faces.len(),
                "vertices": surface.mesh.positions.len(),
                "primitives": surface.parts.len(),
            },
            "exemplar": sample,
            "field": {
                "index_sum": laid.singularities.iter().map(|s| s.index).sum::<f64>(),
                "euler_characteristic": laid.euler,
                "singularities": laid.singularities.iter().map(singularity).collect::<Vec<_>>(),
            },
            "synthesis": {
                "texels_per_unit": prepared.scale,
                "triangles": prepared.mesh.mesh.faces.len(),
                "vertices": prepared.mesh.mesh.positions.len(),
                "sets": synthesised.sets.sets.len(),
            },
        });
        if let Counters::Periodic { .. } = synthesised.counters {
            let coordinates: Parametrization = super::read(inputs, inputs.len() - 1)?;
            let found = places(&prepared, &laid, &coordinates);
            // Places that are only stretched are many, and small.
            let (listed, stretched): (Vec<_>, Vec<_>) = found.iter().partition(|s| s.kind != Kind::Distortion);
            report["synthesis"]["singularities"] = listed.into_iter().map(place).collect();
            report["synthesis"]["distorted_places"] = stretched.len().into();
            atlas_inputs -= 1;
        }
        let (key, counts) = how;
        report["synthesis"][key] = counts;
        if atlas_inputs > 5 {
            let atlas: Atlas = super::read(inputs, 5)?;
            let bundle: Bundle = super::read(inputs, 6)?;
            report["atlas"] = json!({
                "width": atlas.width,
                "height": atlas.height,
                "charts": atlas.chart_count,
                "texels_per_unit": atlas.texels_per_unit,
                "surface_share": atlas.utilization(&surface),
                "quality": bundle.figures,
            });
        }
        text(&report)
    }
}

/// What the analysis' bytes hold, and what the synthesis did with it, by its name.
fn described(counters: &Counters, analysis: &[u8]) -> Result<(Value, (&'static str, Value)), StepError> {
    Ok(match counters {
        Counters::Walk(c) => {
            let walk = json!({
                "seeds": c.seeds,
                "continuations": c.continuations,
                "jumps": c.jumps,
                "dropped_invalid": c.dropped_invalid,
                "random_fallbacks": c.random_fallbacks,
            });
            (exemplar(&JumpMap::from_bytes(analysis)?), ("walk", walk))
        }
        Counters::Quilt { quilt: c, faces, blended, edge_error } => {
            let map = TextonMap::from_bytes(analysis)?;
            let sample = json!({ "width": map.width(), "height": map.height(), "textons": map.count() });
            let quilt = json!({
                "faces": faces,
                "pieces": c.pieces,
                "seeds": c.seeds,
                "continued": c.continued,
                "closings": c.closings,
                "reopened": c.reopened,
                "relaxed": c.relaxed,
                "blended_edges": blended,
                "edge_error": edge_error,
            });
            (sample, ("quilt", quilt))
        }
        Counters::Periodic { distorted, winding, three_look_ups } => {
            let periodic = json!({ "distorted": distorted, "winding": winding, "three_look_ups": three_look_ups });
            (facts(&MadeTile::from_bytes(analysis)?), ("periodic", periodic))
        }
    })
}

/// Reads the sources of a canvas, and the jump map if there is one.
pub(super) struct CanvasReport {
    pub recipe: String,
}

impl Step for CanvasReport {
    super::step_identity!("report", 1);

    fn describe(&self, v: &mut dyn Visitor) {
        v.param("recipe", &self.recipe);
    }

    fn run(&self, inputs: &Inputs) -> Result<Vec<u8>, StepError> {
        let SourceStrips { part, tileable, counters, .. } = super::read(inputs, 0)?;
        let ImageCounters { seeds, jumps, forced_jumps, dead_ends, unshifted_jumps, random_fallbacks } = counters;
        let mut report = json!({
            "recipe": self.recipe,
            "canvas": { "width": part.width, "height": part.height, "tileable": tileable },
            "synthesis": {
                "walk": {
                    "seeds": seeds,
                    "jumps": jumps,
                    "forced_jumps": forced_jumps,
                    "dead_ends": dead_ends,
                    "unshifted_jumps": unshifted_jumps,
                    "random_fallbacks": random_fallbacks,
                },
            },
        });
        if inputs.len() > 1 {
            report["exemplar"] = exemplar(&JumpMap::from_bytes(&inputs[1])?);
        }
        text(&report)
    }
}

fn singularity(s: &Singularity) -> Value {
    json!({ "index": s.index, "at": s.at.to_f32() })
}

fn place(s: &Place) -> Value {
    json!({ "kind": s.kind.name(), "at": s.at.to_f32(), "periods": s.periods, "faces": s.faces })
}

fn exemplar(map: &JumpMap) -> Value {
    let texels = (0..map.height()).flat_map(|y| (0..map.width()).map(move |x| (x, y)));
    let jumps: usize = texels.map(|(x, y)| map.row(x, y).len()).sum();
    let texels = f64::from(map.width()) * f64::from(map.height());
    json!({ "width": map.width(), "height": map.height(), "jumps_per_texel": jumps as f64 / texels })
}

pub(super) fn text(report: &Value) -> Result<Vec<u8>, StepError> {
    let mut text = serde_json::to_string_pretty(report)?;
    text.push('\n');
    Ok(text.into_bytes())
}
