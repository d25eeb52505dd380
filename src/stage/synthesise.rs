//! Step: walk the vertices through the jump map and hand out corner coordinates (\[ZG03\] section 4).

use std::collections::BTreeMap;

use crate::build::{Inputs, Step, StepError, Visitor};
use crate::exemplar::{AnalysisParams, JumpMap};
use crate::field::{self, Laid, Symmetry};
use crate::io::artefact::{Artefact, Damaged, Reader, Writer, set_count};
use crate::mesh::Topology;
use crate::synth::mesh::corner::{Base, corner_sets};
use crate::synth::mesh::layers::layered_sets;
use crate::synth::mesh::order::region_growing;
use crate::synth::mesh::refine::refine;
use crate::synth::mesh::rendering_sequence::rendering_sequence;
use crate::synth::mesh::sites::Sites;
use crate::synth::mesh::walk::{VertexWalkParams, WalkCounters, walk};
use crate::synth::quilt::QuiltCounters;
use crate::synth::seam_metric::SeamMetrics;
use crate::texture::{MapKind, MapSet};
use crate::uvset::{Blend, UvSets};

use super::prepare::{Ground, Prepared};

/// Order in which the vertices are synthesised.
#[derive(Clone, Copy, Debug)]
pub(super) enum Order {
    RegionGrowing,
    RenderingSequence,
}

/// Distance of sites as a share of the exemplar's shorter side: half the longest edge that `mesh::prepare` leaves, so that
/// patches are of one size and blend over one width on coarse meshes, which are subdivided, and on fine ones.
const SPACING: f64 = 0.03125;

/// Distance of sites in texels if the walk is corrected: as on images. The correction makes patches as large as they
/// should be, and the more vertices it may cut along, the better: on a plane of leopard skin mean coherence is 21.9 with
/// edges of 5.3 texels, 16.7 with edges of 1.6.
const REFINED_SPACING: f64 = 1.0;

/// Reads the synthesis mesh, the field, the jump map and the maps.
pub(super) struct Synthesise {
    pub recipe: String,
    pub walk: VertexWalkParams,
    pub symmetry: Symmetry,
    pub order: Order,
    pub blend: Blend,
    /// Power of the blend weights.
    pub sharpness: u32,
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
    /// Periodic coordinates: faces beyond the bound, faces around which they wind, faces shown by three look-ups;
    /// components that no material constraint sits on though there are some.
    Periodic { distorted: u64, winding: u64, three_look_ups: u64, unsaid: u64 },
    /// Nothing was synthesised: the finest level's result was taken over.
    Taken,
}

impl Counters {
    fn read(from: &mut Reader<'_>) -> Result<Self, Damaged> {
        Ok(match from.get::<u8>()? {
            0 => {
                let [seeds, continuations, jumps, random_fallbacks, dropped_invalid] = from.get()?;
                Counters::Walk(WalkCounters { seeds, continuations, jumps, random_fallbacks, dropped_invalid })
            }
            4 => {
                let [pieces, seeds, continued, closings, bad_closings, reopened, recut, relaxed, faces, blended] =
                    from.get()?;
                let quilt =
                    QuiltCounters { pieces, seeds, continued, closings, bad_closings, reopened, recut, relaxed };
                Counters::Quilt { quilt, faces, blended, edge_error: from.get()? }
            }
            3 => Counters::Taken,
            2 => {
                let [distorted, winding, three_look_ups, unsaid] = from.get()?;
                Counters::Periodic { distorted, winding, three_look_ups, unsaid }
            }
            kind => return Err(Damaged(format!("counters of kind {kind}"))),
        })
    }
}

/// What a walk counted, by name.
pub(super) fn named(counters: &WalkCounters) -> [(&'static str, u64); 5] {
    let WalkCounters { seeds, continuations, jumps, random_fallbacks, dropped_invalid } = *counters;
    [
        ("seeds", seeds),
        ("continuations", continuations),
        ("jumps", jumps),
        ("dropped_invalid", dropped_invalid),
        ("random_fallbacks", random_fallbacks),
    ]
}

/// Corner coordinates and how the synthesis came by them.
pub(super) struct Synthesised {
    pub sets: UvSets,
    pub counters: Counters,
    /// Per corner the continuity error and length of the edge blended there; empty where the method has none.
    pub metric: Vec<[f32; 2]>,
}

impl Synthesised {
    /// The counters alone.
    pub fn counters(artefact: &[u8]) -> Result<Counters, Damaged> {
        Counters::read(&mut Self::open(artefact)?)
    }

    /// The counters and how many sets there are.
    pub fn counts(artefact: &[u8]) -> Result<(Counters, usize), Damaged> {
        let mut from = Self::open(artefact)?;
        let counters = Counters::read(&mut from)?;
        from.pass::<[f32; 2]>()?;
        Ok((counters, set_count(&mut from)?))
    }
}

impl Artefact for Synthesised {
    const TAG: [u8; 4] = *b"syn3";

    fn write(&self, to: &mut Writer) {
        match self.counters {
            Counters::Walk(WalkCounters { seeds, continuations, jumps, random_fallbacks, dropped_invalid }) => {
                to.put(0u8);
                to.put([seeds, continuations, jumps, random_fallbacks, dropped_invalid]);
            }
            Counters::Quilt { quilt, faces, blended, edge_error } => {
                let QuiltCounters { pieces, seeds, continued, closings, bad_closings, reopened, recut, relaxed } =
                    quilt;
                to.put(4u8);
                to.put([pieces, seeds, continued, closings, bad_closings, reopened, recut, relaxed, faces, blended]);
                to.put(edge_error);
            }
            Counters::Taken => to.put(3u8),
            Counters::Periodic { distorted, winding, three_look_ups, unsaid } => {
                to.put(2u8);
                to.put([distorted, winding, three_look_ups, unsaid]);
            }
        }
        to.slice(&self.metric);
        self.sets.write(to);
    }

    fn read(from: &mut Reader<'_>) -> Result<Self, Damaged> {
        let counters = Counters::read(from)?;
        let metric: Vec<[f32; 2]> = from.slice()?;
        let sets = UvSets::read(from)?;
        match metric.is_empty() || metric.len() == sets.weights.len() {
            true => Ok(Synthesised { counters, metric, sets }),
            false => Err(Damaged("one measure per corner".into())),
        }
    }
}

impl Step for Synthesise {
    super::step_identity!("synthesise", 6, travels);

    fn describe(&self, v: &mut dyn Visitor) {
        let VertexWalkParams { patch, seed, border_band } = self.walk;
        v.param("patch", &patch);
        v.param("seed", &seed);
        v.param("border_band", &border_band);
        v.param("symmetry", &self.symmetry);
        v.param("order", &self.order);
        v.param("blend", &self.blend);
        v.param("sharpness", &self.sharpness);
        v.param("refine", &self.refine);
        v.param("importance", &self.importance);
    }

    fn run(&self, inputs: &Inputs) -> Result<Vec<u8>, StepError> {
        let Ground { exemplar_size, mesh, .. } = Prepared::ground(&inputs[0])?;
        let Laid { field, normals, .. } = super::read(inputs, 1)?;
        let map = JumpMap::from_bytes(&inputs[2])?;
        let topology = Topology::new(&mesh);
        let offsets = field::edge_offsets(&mesh, &topology, &normals, &field, self.symmetry);
        let spacing = match self.refine {
            0 => f64::from(exemplar_size[0].min(exemplar_size[1])) * SPACING,
            _ => REFINED_SPACING,
        };
        let sites = Sites::new(&topology, &offsets, spacing, self.symmetry.directions() > 1);
        let order = match (self.order, &sites) {
            (Order::RegionGrowing, None) => region_growing(&topology, &[])?,
            (Order::RegionGrowing, Some(sites)) => region_growing(&sites.topology, &[])?,
            (Order::RenderingSequence, None) => rendering_sequence(&mesh, &topology),
            (Order::RenderingSequence, Some(sites)) => sites.in_order_of(&rendering_sequence(&mesh, &topology)),
        };
        let (net, along, boxes) = match &sites {
            None => (&topology, &offsets, None),
            Some(sites) => (&sites.topology, &sites.offsets, Some(&sites.boxes[..])),
        };
        let mut walked = walk(&map, net, along, boxes, &order, &self.walk)?;
        if self.refine > 0 {
            let maps: MapSet = super::read(inputs, 3)?;
            let analysis = AnalysisParams { importance: self.importance.clone(), ..AnalysisParams::default() };
            let metrics = SeamMetrics::new(&maps, &analysis)?;
            walked.address = refine(&map, &metrics, net, along, boxes, &walked.address, self.refine)?;
        }
        // A vertex alone decides with `blend = "none"`: one set with a random base vertex ([ZG03] 4.3).
        let base = match self.blend {
            Blend::Nearest => Base::Random { seed: self.walk.seed },
            _ => Base::Three,
        };
        let (at, blend) = (&walked.address, self.blend);
        let mut sets = match &sites {
            None => corner_sets(&mesh.faces, &topology, &offsets, at, exemplar_size, base, blend)?,
            Some(sites) => layered_sets(&mesh.faces, sites, at, exemplar_size, blend)?,
        };
        sets.sharpness = self.sharpness;
        Ok(Synthesised { sets, counters: Counters::Walk(walked.counters), metric: vec![] }.to_bytes())
    }

    fn counters(&self, artefact: &[u8]) -> Vec<(&'static str, u64)> {
        match Synthesised::counters(artefact) {
            Ok(Counters::Walk(c)) => named(&c).to_vec(),
            _ => vec![],
        }
    }
}
