//! Step: walk the vertices through the jump map and hand out corner coordinates (\[ZG03\] section 4).

use std::collections::BTreeMap;

use crate::build::{Inputs, Step, StepError, Visitor};
use crate::exemplar::{AnalysisParams, JumpMap};
use crate::field::{self, Field, Symmetry};
use crate::io::artefact::{Artefact, Damaged, Reader, Writer};
use crate::mesh::Topology;
use crate::synth::corner::{Base, corner_sets};
use crate::synth::quilt::QuiltCounters;
use crate::synth::rendering_sequence::rendering_sequence;
use crate::synth::seam_metric::SeamMetrics;
use crate::synth::vertex_order::region_growing;
use crate::synth::vertex_refine::refine;
use crate::synth::vertex_walk::{VertexWalkParams, WalkCounters, walk};
use crate::texture::{MapKind, MapSet};
use crate::uvset::{Blend, UvSets};

use super::prepare::Prepared;

/// Order in which the vertices are synthesised.
#[derive(Clone, Copy, Debug)]
pub(super) enum Order {
    RegionGrowing,
    RenderingSequence,
}

/// Reads the synthesis mesh, the field, the jump map and the maps.
pub(super) struct Synthesise {
    pub recipe: String,
    pub walk: VertexWalkParams,
    pub symmetry: Symmetry,
    pub order: Order,
    pub blend: Blend,
    /// Correction passes; 0 is the published method.
    pub refine: u32,
    /// Weight of each map in the correction's comparisons.
    pub importance: BTreeMap<MapKind, f64>,
}

/// What a synthesis did how often.
#[derive(Clone, Copy, Debug)]
pub(super) enum Counters {
    /// A walk over vertices.
    Walk(WalkCounters),
    /// A quilt of faces; how many there were before edges were blended, how many edges are, and the mean continuity error
    /// of all edges before.
    Quilt { quilt: QuiltCounters, faces: u64, blended: u64, edge_error: f64 },
    /// Periodic coordinates: faces beyond the bound, faces around which they wind, faces shown by three look-ups.
    Periodic { distorted: u64, winding: u64, three_look_ups: u64 },
}

/// Corner coordinates and how the synthesis came by them.
pub(super) struct Synthesised {
    pub sets: UvSets,
    pub counters: Counters,
    /// Per corner the continuity error and length of the edge blended there; empty where the method has none.
    pub metric: Vec<[f32; 2]>,
}

impl Artefact for Synthesised {
    const TAG: [u8; 4] = *b"syn2";

    fn write(&self, to: &mut Writer) {
        match self.counters {
            Counters::Walk(WalkCounters { seeds, continuations, jumps, random_fallbacks, dropped_invalid }) => {
                to.put(0u8);
                to.put([seeds, continuations, jumps, random_fallbacks, dropped_invalid]);
            }
            Counters::Quilt { quilt, faces, blended, edge_error } => {
                let QuiltCounters { pieces, seeds, continued, closings, reopened, relaxed } = quilt;
                to.put(1u8);
                to.put([pieces, seeds, continued, closings, reopened, relaxed, faces, blended]);
                to.put(edge_error);
            }
            Counters::Periodic { distorted, winding, three_look_ups } => {
                to.put(2u8);
                to.put([distorted, winding, three_look_ups]);
            }
        }
        to.slice(&self.metric);
        self.sets.write(to);
    }

    fn read(from: &mut Reader<'_>) -> Result<Self, Damaged> {
        let counters = match from.get::<u8>()? {
            0 => {
                let [seeds, continuations, jumps, random_fallbacks, dropped_invalid] = from.get()?;
                Counters::Walk(WalkCounters { seeds, continuations, jumps, random_fallbacks, dropped_invalid })
            }
            1 => {
                let [pieces, seeds, continued, closings, reopened, relaxed, faces, blended] = from.get()?;
                let quilt = QuiltCounters { pieces, seeds, continued, closings, reopened, relaxed };
                Counters::Quilt { quilt, faces, blended, edge_error: from.get()? }
            }
            2 => {
                let [distorted, winding, three_look_ups] = from.get()?;
                Counters::Periodic { distorted, winding, three_look_ups }
            }
            kind => return Err(Damaged(format!("counters of kind {kind}"))),
        };
        let metric: Vec<[f32; 2]> = from.slice()?;
        let sets = UvSets::read(from)?;
        match metric.is_empty() || metric.len() == sets.weights.len() {
            true => Ok(Synthesised { counters, metric, sets }),
            false => Err(Damaged("one measure per corner".into())),
        }
    }
}

impl Step for Synthesise {
    super::step_identity!("synthesise", 3);

    fn describe(&self, v: &mut dyn Visitor) {
        let VertexWalkParams { patch, seed, border_band } = self.walk;
        v.param("patch", &patch);
        v.param("seed", &seed);
        v.param("border_band", &border_band);
        v.param("symmetry", &self.symmetry);
        v.param("order", &self.order);
        v.param("blend", &self.blend);
        v.param("refine", &self.refine);
        v.param("importance", &self.importance);
    }

    fn run(&self, inputs: &Inputs) -> Result<Vec<u8>, StepError> {
        let Prepared { exemplar_size, mesh, .. } = super::read(inputs, 0)?;
        let field: Field = super::read::<field::Laid>(inputs, 1)?.field;
        let map = JumpMap::from_bytes(&inputs[2])?;
        let mesh = mesh.mesh;
        let topology = Topology::new(&mesh);
        let offsets = field::edge_offsets(&mesh, &topology, &mesh.vertex_normals(), &field, self.symmetry);
        let order = match self.order {
            Order::RegionGrowing => region_growing(&topology, &[])?,
            Order::RenderingSequence => rendering_sequence(&mesh, &topology),
        };
        let mut walked = walk(&map, &topology, &offsets, &order, &self.walk)?;
        if self.refine > 0 {
            let maps: MapSet = super::read(inputs, 3)?;
            let analysis = AnalysisParams { importance: self.importance.clone(), ..AnalysisParams::default() };
            let metrics = SeamMetrics::new(&maps, &analysis)?;
            walked.address = refine(&map, &metrics, &topology, &offsets, &walked.address, self.refine)?;
        }
        // A vertex alone decides with `blend = "none"`: one set with a random base vertex ([ZG03] 4.3).
        let base = match self.blend {
            Blend::Nearest => Base::Random { seed: self.walk.seed },
            _ => Base::Three,
        };
        let sets = corner_sets(&mesh.faces, &topology, &offsets, &walked.address, exemplar_size, base, self.blend)?;
        Ok(Synthesised { sets, counters: Counters::Walk(walked.counters), metric: vec![] }.to_bytes())
    }
}
