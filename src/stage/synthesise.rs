//! Step: walk the vertices through the jump map and hand out corner coordinates (\[ZG03\] section 4).

use std::collections::BTreeMap;

use crate::build::{Inputs, Step, StepError, Visitor};
use crate::exemplar::{AnalysisParams, JumpMap};
use crate::field::{self, Field, Symmetry};
use crate::io::artefact::{Artefact, Damaged, Reader, Writer};
use crate::mesh::Topology;
use crate::synth::corner::{Base, corner_sets};
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

/// Corner coordinates and how the walk came by them.
pub(super) struct Synthesised {
    pub sets: UvSets,
    pub counters: WalkCounters,
}

impl Artefact for Synthesised {
    const TAG: [u8; 4] = *b"synt";

    fn write(&self, to: &mut Writer) {
        let WalkCounters { seeds, continuations, jumps, random_fallbacks, dropped_invalid } = self.counters;
        to.put([seeds, continuations, jumps, random_fallbacks, dropped_invalid]);
        self.sets.write(to);
    }

    fn read(from: &mut Reader<'_>) -> Result<Self, Damaged> {
        let [seeds, continuations, jumps, random_fallbacks, dropped_invalid] = from.get()?;
        let counters = WalkCounters { seeds, continuations, jumps, random_fallbacks, dropped_invalid };
        Ok(Synthesised { counters, sets: UvSets::read(from)? })
    }
}

impl Step for Synthesise {
    super::step_identity!("synthesise", 2);

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
        Ok(Synthesised { sets, counters: walked.counters }.to_bytes())
    }
}
