//! Steps: quilt the faces by textons, and blend their edges (\[MK03\] sections 3.2 and 3.3).
//!
//! The blend divides faces, so it has two results, each a step of its own: the mesh, in the place of the prepared one, and
//! what was synthesised on it. Both repeat the same short computation.

use std::collections::BTreeMap;

use crate::build::{Inputs, Step, StepError, Visitor};
use crate::exemplar::{AnalysisParams, TextonMap};
use crate::field::{Laid, Symmetry};
use crate::io::artefact::{Artefact, Damaged, Reader, Writer};
use crate::numerics::par;
use crate::numerics::vec::Vec2;
use crate::synth::quilt::blend::{Blended, blend_edges};
use crate::synth::quilt::frame::Facets;
use crate::synth::quilt::{Quilt, QuiltCounters, QuiltParams, quilt};
use crate::synth::seam_metric::SeamMetrics;
use crate::texture::{MapKind, MapSet, texel};
use crate::uvset::Blend;
use crate::uvset::metric::continuity_error;

use super::compare::comparison;
use super::prepare::Prepared;
use super::synthesise::{Counters, Synthesised};

/// Reads the synthesis mesh, the field, the textons and the maps.
pub(super) struct QuiltFaces {
    pub recipe: String,
    pub params: QuiltParams,
    pub symmetry: Symmetry,
    /// Weight of each map where cuts compare.
    pub importance: BTreeMap<MapKind, f64>,
}

impl Artefact for Quilt {
    const TAG: [u8; 4] = *b"qul2";

    fn write(&self, to: &mut Writer) {
        let QuiltCounters { pieces, seeds, continued, closings, bad_closings, reopened, recut, relaxed } =
            self.counters;
        to.put([pieces, seeds, continued, closings, bad_closings, reopened, recut, relaxed]);
        to.slice(&self.at);
    }

    fn read(from: &mut Reader<'_>) -> Result<Self, Damaged> {
        let [pieces, seeds, continued, closings, bad_closings, reopened, recut, relaxed] = from.get::<[u64; 8]>()?;
        let counters = QuiltCounters { pieces, seeds, continued, closings, bad_closings, reopened, recut, relaxed };
        Ok(Quilt { counters, at: from.slice::<Vec2>()? })
    }
}

impl Step for QuiltFaces {
    super::step_identity!("quilt", 5, travels);

    fn describe(&self, v: &mut dyn Visitor) {
        let QuiltParams { seed, candidates, refine, reach } = self.params;
        v.param("seed", &seed);
        v.param("candidates", &candidates);
        v.param("refine", &refine);
        v.param("reach", &reach);
        v.param("symmetry", &self.symmetry);
        v.param("importance", &self.importance);
    }

    fn run(&self, inputs: &Inputs) -> Result<Vec<u8>, StepError> {
        let prepared: Prepared = super::read(inputs, 0)?;
        let Laid { field, .. } = super::read(inputs, 1)?;
        let map: TextonMap = super::read(inputs, 2)?;
        let facets = Facets::new(&prepared.mesh.mesh, &field, self.symmetry);
        let maps: MapSet = super::read(inputs, 3)?;
        let metrics = match self.params.refine {
            0 => None,
            _ => {
                let analysis = AnalysisParams { importance: self.importance.clone(), ..AnalysisParams::default() };
                Some(SeamMetrics::new(&maps, &analysis)?)
            }
        };
        Ok(quilt(&map, &facets, metrics.as_ref(), &self.params)?.to_bytes())
    }
}

/// How edges are blended, for the two steps that need it.
#[derive(Clone)]
pub(super) struct BlendParams {
    pub symmetry: Symmetry,
    pub blend: Blend,
    /// Continuity error above which an edge is blended.
    pub threshold: f64,
    /// Weight of each map in the continuity error.
    pub importance: BTreeMap<MapKind, f64>,
}

impl BlendParams {
    fn describe(&self, v: &mut dyn Visitor) {
        let BlendParams { symmetry, blend, threshold, importance } = self;
        v.param("symmetry", symmetry);
        v.param("blend", blend);
        v.param("threshold", threshold);
        v.param("importance", importance);
    }

    /// Of synthesis mesh, field, quilt and maps. Also the mean continuity error over the length of all edges.
    fn run(&self, inputs: &Inputs) -> Result<(Prepared, Quilt, Blended, f64), StepError> {
        let prepared: Prepared = super::read(inputs, 0)?;
        let Laid { field, .. } = super::read(inputs, 1)?;
        let quilt: Quilt = super::read(inputs, 2)?;
        let maps: MapSet = super::read(inputs, 3)?;
        let facets = Facets::new(&prepared.mesh.mesh, &field, self.symmetry);
        let compared = comparison(&maps, &self.importance);
        if quilt.at.len() != facets.len() {
            return Err(format!("{} places for {} faces", quilt.at.len(), facets.len()).into());
        }
        let end = |at: Vec2| texel(at.x as f32, at.y as f32);
        let error = |f: usize, k: usize| {
            let Some((g, j)) = facets.opposite(f, k) else { return 0.0 };
            let ([a, b], [d, c]) = (facets.edge(f, k), facets.edge(g, j));
            let (here, there) = ([a, b].map(|p| end(quilt.at[f] + p)), [c, d].map(|p| end(quilt.at[g] + p)));
            // From the lower face, so that both sides have the same bits.
            if f < g {
                continuity_error(&compared, here, there)
            } else {
                continuity_error(&compared, [there[1], there[0]], [here[1], here[0]])
            }
        };
        let errors = par::map(facets.len(), |f| [0, 1, 2].map(|k| error(f, k)));
        let (mut sum, mut length) = (0.0, 0.0);
        for (f, errors) in errors.iter().enumerate() {
            for (k, e) in errors.iter().enumerate().filter(|(k, _)| facets.opposite(f, *k).is_some()) {
                let [a, b] = facets.edge(f, k);
                sum += f64::from(*e) * (b - a).length();
                length += (b - a).length();
            }
        }
        let mean = if length > 0.0 { sum / length } else { 0.0 };
        let size = prepared.exemplar_size;
        let threshold = self.threshold as f32;
        let blended = blend_edges(&prepared.mesh, &facets, &quilt.at, &errors, threshold, size, self.blend)?;
        Ok((prepared, quilt, blended, mean))
    }
}

/// The mesh with faces divided where edges are blended. Reads the synthesis mesh, the field, the quilt and the maps.
pub(super) struct BlendMesh {
    pub recipe: String,
    pub params: BlendParams,
}

impl Step for BlendMesh {
    super::step_identity!("blend mesh", 3);

    fn describe(&self, v: &mut dyn Visitor) {
        self.params.describe(v);
    }

    fn run(&self, inputs: &Inputs) -> Result<Vec<u8>, StepError> {
        let (prepared, _, blended, _) = self.params.run(inputs)?;
        Ok(Prepared { mesh: blended.mesh, ..prepared }.to_bytes())
    }
}

/// The coordinates and weights on that mesh. Reads the same.
pub(super) struct BlendSets {
    pub recipe: String,
    pub params: BlendParams,
}

impl Step for BlendSets {
    super::step_identity!("blend sets", 4);

    fn describe(&self, v: &mut dyn Visitor) {
        self.params.describe(v);
    }

    fn run(&self, inputs: &Inputs) -> Result<Vec<u8>, StepError> {
        let (prepared, quilt, blended, edge_error) = self.params.run(inputs)?;
        let Blended { sets, metric, blended, .. } = blended;
        let faces = prepared.mesh.mesh.faces.len() as u64;
        let counters = Counters::Quilt { quilt: quilt.counters, faces, blended, edge_error };
        Ok(Synthesised { sets, counters, metric }.to_bytes())
    }
}
