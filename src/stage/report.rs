//! Step: `report.json`, what a bake came to in numbers. Nothing in it depends on the machine or the day.

use serde_json::{Value, json};

use crate::bake::Atlas;
use crate::build::{Inputs, Step, StepError, Visitor};
use crate::exemplar::JumpMap;
use crate::mesh::Surface;
use crate::synth::source_map::ImageCounters;
use crate::synth::source_strips::SourceStrips;

use super::prepare::Prepared;
use super::rasterise::Bundle;
use super::synthesise::Synthesised;

/// Reads surface, synthesis mesh, corner coordinates and jump map, and of an atlas bake the atlas and its images.
pub(super) struct Report {
    pub recipe: String,
}

impl Step for Report {
    super::step_identity!("report", 1);

    fn describe(&self, v: &mut dyn Visitor) {
        v.param("recipe", &self.recipe);
    }

    fn run(&self, inputs: &Inputs) -> Result<Vec<u8>, StepError> {
        let surface: Surface = super::read(inputs, 0)?;
        let prepared: Prepared = super::read(inputs, 1)?;
        let synthesised: Synthesised = super::read(inputs, 2)?;
        let map = JumpMap::from_bytes(&inputs[3])?;
        let walk = Synthesised::named_counters(&synthesised.counters).map(|(name, n)| (name.to_string(), json!(n)));
        let mut report = json!({
            "recipe": self.recipe,
            "mesh": {
                "triangles": surface.mesh.faces.len(),
                "vertices": surface.mesh.positions.len(),
                "primitives": surface.parts.len(),
            },
            "exemplar": exemplar(&map),
            "synthesis": {
                "texels_per_unit": prepared.scale,
                "triangles": prepared.mesh.mesh.faces.len(),
                "vertices": prepared.mesh.mesh.positions.len(),
                "sets": synthesised.sets.sets.len(),
                "walk": Value::Object(walk.into_iter().collect()),
            },
        });
        if inputs.len() > 4 {
            let atlas: Atlas = super::read(inputs, 4)?;
            let bundle: Bundle = super::read(inputs, 5)?;
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

/// Reads the jump map and the sources of a canvas.
pub(super) struct CanvasReport {
    pub recipe: String,
}

impl Step for CanvasReport {
    super::step_identity!("report", 1);

    fn describe(&self, v: &mut dyn Visitor) {
        v.param("recipe", &self.recipe);
    }

    fn run(&self, inputs: &Inputs) -> Result<Vec<u8>, StepError> {
        let map = JumpMap::from_bytes(&inputs[0])?;
        let SourceStrips { part, tileable, counters, .. } = super::read(inputs, 1)?;
        let ImageCounters { seeds, jumps, forced_jumps, dead_ends, unshifted_jumps, random_fallbacks } = counters;
        text(&json!({
            "recipe": self.recipe,
            "exemplar": exemplar(&map),
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
        }))
    }
}

fn exemplar(map: &JumpMap) -> Value {
    let texels = (0..map.height()).flat_map(|y| (0..map.width()).map(move |x| (x, y)));
    let jumps: usize = texels.map(|(x, y)| map.row(x, y).len()).sum();
    let texels = f64::from(map.width()) * f64::from(map.height());
    json!({ "width": map.width(), "height": map.height(), "jumps_per_texel": jumps as f64 / texels })
}

fn text(report: &Value) -> Result<Vec<u8>, StepError> {
    let mut text = serde_json::to_string_pretty(report)?;
    text.push('\n');
    Ok(text.into_bytes())
}
