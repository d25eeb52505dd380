//! Step: `report.json`, what a bake came to in numbers. Nothing in it depends on the machine or the day.

use serde_json::{Value, json};

use crate::bake::Atlas;
use crate::build::{Inputs, Step, StepError, Visitor};
use crate::exemplar::{JumpMap, TextonMap};
use crate::field::Singularity;
use crate::io::artefact::{Artefact, surface_counts};
use crate::mesh::Surface;
use crate::param::{Change, Kind, Singularity as Place};
use crate::synth::image::source_map::ImageCounters;
use crate::synth::image::source_strips::SourceStrips;

use super::field::laid;
use super::material_space::{coordinates, places};
use super::prepare::Prepared;
use super::rasterise::Bundle;
use super::synthesise::{Counters, Synthesised, named};
use super::tile::{MadeTile, facts};

/// Reads surface, synthesis mesh, corner coordinates, what was analysed, the field if there is one, and of an atlas bake
/// the atlas and its images; of a tile's bake last the periodic coordinates.
pub(super) struct Report {
    pub recipe: String,
    /// False for levels of detail, which take over what the finest one's field led to.
    pub has_field: bool,
}

impl Step for Report {
    super::step_identity!("report", 3);

    fn describe(&self, v: &mut dyn Visitor) {
        v.param("recipe", &self.recipe);
        v.param("has_field", &self.has_field);
    }

    fn run(&self, inputs: &Inputs) -> Result<Vec<u8>, StepError> {
        let [vertices, triangles, primitives] = surface_counts(&inputs[0])?;
        let (scale, prepared) = Prepared::counts(&inputs[1])?;
        let (counters, sets) = Synthesised::counts(&inputs[2])?;
        let (sample, how) = described(&counters, &inputs[3])?;
        let mut report = json!({
            "recipe": self.recipe,
            "mesh": {
                "triangles": triangles,
                "vertices": vertices,
                "primitives": primitives,
            },
            "exemplar": sample,
            "synthesis": {
                "texels_per_unit": scale,
                "triangles": prepared[1],
                "vertices": prepared[0],
                "sets": sets,
            },
        });
        if let Some((key, counts)) = how {
            report["synthesis"][key] = counts;
        }
        let (mut next, mut last) = (4, inputs.len());
        if self.has_field {
            let (laid, after) = laid(inputs, next)?;
            report["field"] = json!({
                "index_sum": laid.singularities.iter().map(|s| s.index).sum::<f64>(),
                "euler_characteristic": laid.euler,
                "singularities": laid.singularities.iter().map(singularity).collect::<Vec<_>>(),
            });
            next = after;
            if let Counters::Periodic { .. } = counters {
                last -= 1 + usize::from(Change::is_one(&inputs[last - 1]));
                let found = places(&Prepared::ground(&inputs[1])?.mesh, &laid, &coordinates(inputs, last)?);
                // Places that are only stretched are many, and small.
                let (listed, stretched): (Vec<_>, Vec<_>) = found.iter().partition(|s| s.kind != Kind::Distortion);
                report["synthesis"]["singularities"] = listed.into_iter().map(place).collect();
                report["synthesis"]["distorted_places"] = stretched.len().into();
            }
        }
        if last > next {
            let (surface, atlas): (Surface, Atlas) = (super::read(inputs, 0)?, super::read(inputs, next)?);
            let bundle: Bundle = super::read(inputs, next + 1)?;
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

/// What was counted, under its name.
type Counted = (&'static str, Value);

/// What the analysis' bytes hold, and what the synthesis did with it, by its name.
fn described(counters: &Counters, analysis: &[u8]) -> Result<(Value, Option<Counted>), StepError> {
    Ok(match counters {
        Counters::Walk(c) => {
            let walk = named(c).map(|(name, n)| (name.to_string(), json!(n)));
            (exemplar(analysis)?, Some(("walk", Value::Object(walk.into_iter().collect()))))
        }
        Counters::Quilt { quilt: c, faces, blended, edge_error } => {
            let quilt = json!({
                "faces": faces,
                "pieces": c.pieces,
                "seeds": c.seeds,
                "continued": c.continued,
                "closings": c.closings,
                "bad_closings": c.bad_closings,
                "reopened": c.reopened,
                "recut": c.recut,
                "relaxed": c.relaxed,
                "blended_edges": blended,
                "edge_error": edge_error,
            });
            (textons(analysis)?, Some(("quilt", quilt)))
        }
        // What the finest level was made by.
        Counters::Taken if TextonMap::open(analysis).is_ok() => (textons(analysis)?, None),
        Counters::Taken => (exemplar(analysis)?, None),
        Counters::Periodic { distorted, winding, three_look_ups, unsaid } => {
            let mut periodic = json!({ "distorted": distorted, "winding": winding, "three_look_ups": three_look_ups });
            if *unsaid > 0 {
                periodic["components_without_material"] = json!(unsaid);
            }
            (facts(&MadeTile::from_bytes(analysis)?), Some(("periodic", periodic)))
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
            report["exemplar"] = exemplar(&inputs[1])?;
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

fn exemplar(jump_map: &[u8]) -> Result<Value, StepError> {
    let [width, height, jumps] = JumpMap::counts(jump_map)?;
    let texels = f64::from(width) * f64::from(height);
    Ok(json!({ "width": width, "height": height, "jumps_per_texel": f64::from(jumps) / texels }))
}

fn textons(map: &[u8]) -> Result<Value, StepError> {
    let map = TextonMap::from_bytes(map)?;
    let mut sample = json!({ "width": map.width(), "height": map.height(), "textons": map.count() });
    if let Some(note) = map.note() {
        sample["note"] = json!(note);
    }
    Ok(sample)
}

pub(super) fn text(report: &Value) -> Result<Vec<u8>, StepError> {
    let mut text = serde_json::to_string_pretty(report)?;
    text.push('\n');
    Ok(text.into_bytes())
}
