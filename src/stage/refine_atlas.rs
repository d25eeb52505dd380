//! Step: correct texel by texel what an atlas shows, across the borders of its charts.

use std::collections::BTreeMap;

use crate::bake::{Atlas, Coverage, MAX_NODES, TexelGraph, TexelSources, tangents};
use crate::build::{Inputs, Step, StepError, Visitor};
use crate::exemplar::{AnalysisParams, JumpMap};
use crate::io::artefact::{Artefact, Damaged, Reader, Writer};
use crate::mesh::Surface;
use crate::synth::mesh::texel_refine::{Net, refine_texels};
use crate::synth::seam_metric::SeamMetrics;
use crate::texture::{MapKind, MapSet, Texel};

use super::prepare::Prepared;
use super::synthesise::Synthesised;

/// Reads surface, synthesis mesh, corner coordinates, atlas, jump map and maps.
pub(super) struct RefineAtlas {
    pub recipe: String,
    pub passes: u32,
    /// Weight of each map in the comparisons.
    pub importance: BTreeMap<MapKind, f64>,
    /// Side of the page in texels, as far as it is known, for the estimate of memory; not a parameter.
    pub side: u32,
}

/// What the texels of an atlas show, and how that came about.
pub(super) struct RefinedAtlas {
    pub sources: TexelSources,
    /// Nodes whose place changed.
    pub changed: u64,
    /// Edges from one chart's border to another's.
    pub across: u64,
}

impl RefinedAtlas {
    /// What was counted, by name.
    pub fn named(&self) -> [(&'static str, u64); 4] {
        let TexelSources { pitch, texels, places: _ } = &self.sources;
        [
            ("texels_per_node", u64::from(*pitch)),
            ("nodes", texels.len() as u64),
            ("changed", self.changed),
            ("edges_across_charts", self.across),
        ]
    }
}

impl Artefact for RefinedAtlas {
    const TAG: [u8; 4] = *b"rat1";

    fn write(&self, to: &mut Writer) {
        to.put([self.changed, self.across]);
        to.put(self.sources.pitch);
        to.slice(&self.sources.texels);
        to.slice(&self.sources.places);
    }

    fn read(from: &mut Reader<'_>) -> Result<Self, Damaged> {
        let [changed, across] = from.get()?;
        let (pitch, texels, places): (u32, Vec<u32>, Vec<Texel>) = (from.get()?, from.slice()?, from.slice()?);
        match texels.len() == places.len() {
            true => Ok(RefinedAtlas { changed, across, sources: TexelSources { pitch, texels, places } }),
            false => Err(Damaged("one place per node".into())),
        }
    }
}

/// Bytes per texel of the page and per node: measured on pages of 1024 and 2048.
const PAGE_BYTES: u64 = 16;
const NODE_BYTES: u64 = 500;

impl Step for RefineAtlas {
    super::step_identity!("refine atlas", 2);

    fn describe(&self, v: &mut dyn Visitor) {
        v.param("passes", &self.passes);
        v.param("importance", &self.importance);
    }

    fn memory(&self, inputs: &[u64]) -> u64 {
        let texels = u64::from(self.side).pow(2);
        texels * PAGE_BYTES + texels.min(MAX_NODES as u64) * NODE_BYTES + 4 * inputs.iter().sum::<u64>()
    }

    fn run(&self, inputs: &Inputs) -> Result<Vec<u8>, StepError> {
        let surface: Surface = super::read(inputs, 0)?;
        let Prepared { mesh, .. } = super::read(inputs, 1)?;
        let Synthesised { sets, .. } = super::read(inputs, 2)?;
        let atlas: Atlas = super::read(inputs, 3)?;
        let jumps = JumpMap::from_bytes(&inputs[4])?;
        let maps: MapSet = super::read(inputs, 5)?;
        let analysis = AnalysisParams { importance: self.importance.clone(), ..AnalysisParams::default() };
        let metrics = SeamMetrics::new(&maps, &analysis)?;
        // The nearest texels of the gutter tell where charts go on.
        let coverage = Coverage::new(&surface, &mesh, &atlas, &tangents(&surface, &atlas), 2)?;
        let TexelGraph { sources, starts, targets, offsets, across } =
            TexelGraph::new(&coverage, &mesh, &atlas, &sets)?;
        drop(coverage);
        let net = Net { starts, targets, offsets };
        let places = refine_texels(&jumps, &metrics, net, &sources.places, self.passes)?;
        let changed = places.iter().zip(&sources.places).filter(|(a, b)| a != b).count() as u64;
        let sources = TexelSources { places, ..sources };
        Ok(RefinedAtlas { sources, changed, across: across as u64 }.to_bytes())
    }

    fn counters(&self, artefact: &[u8]) -> Vec<(&'static str, u64)> {
        RefinedAtlas::from_bytes(artefact).map(|r| r.named().to_vec()).unwrap_or_default()
    }
}
