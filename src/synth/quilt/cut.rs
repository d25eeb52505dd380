//! Minimum cuts through a quilt: parts of it go over to other patches, or to places that look alike, where that lowers what
//! the seams show.
//!
//! Beyond \[MK03\], whose section 5 names the greedy search as what limits quality. The faces are the nodes of a graph,
//! adjacent ones connected, and `mesh::refine` cuts it as it cuts the vertices of a walk; what looks alike is known
//! from the buckets of the textons ([`TextonMap::alike`]). Faces keep their shapes: only places change.
//! Unaware of: pieces, how the first places were found.

use super::frame::Facets;
use super::seam::SAME;
use crate::exemplar::TextonMap;
use crate::numerics::par;
use crate::numerics::vec::{Vec2, vec2};
use crate::synth::Error;
use crate::synth::mesh::hierarchy::Graph;
use crate::synth::mesh::refine::refine_graph;
use crate::synth::mesh::room::Room;
use crate::synth::seam_metric::SeamMetrics;
use crate::texture::{Texel, texel};

/// Edges of the coarsest level are at most this share of the exemplar's smaller side. Of basket, brick-vistex, radishes and
/// wicker on 4608 faces swd and coherence_p95 (geometric means, three seeds) are 30.5 and 12.3 for a 16th, 28.8 and 11.3
/// for an eighth, 34.3 and 12.2 for a quarter; of jump maps 31.8 and 11.1.
const COARSEST: f64 = 8.0;

/// Moves faces to better places in `passes` sweeps on the finest level; returns how many moved.
pub(super) fn recut(
    map: &TextonMap,
    metrics: &SeamMetrics,
    facets: &Facets,
    at: &mut [Vec2],
    passes: u32,
) -> Result<u64, Error> {
    let size = [map.width(), map.height()];
    let rooms = par::map(facets.len(), |f| Room::new(&facets.local[f].map(|c| c - facets.centre(f)), size));
    let address = |f: usize| {
        let p = at[f] + facets.centre(f);
        rooms[f].nearest(texel(p.x as f32, p.y as f32))
    };
    let before: Vec<Texel> = par::map(facets.len(), address);
    let coarsest = f64::from(size[0].min(size[1])) / COARSEST;
    let after = refine_graph(map.alike(), metrics, graph(facets), &rooms, &before, passes, coarsest)?;
    let mut moved = 0;
    for (f, (from, to)) in before.iter().zip(&after).enumerate() {
        let by = vec2(f64::from(to.x) - f64::from(from.x), f64::from(to.y) - f64::from(from.y));
        // Addresses are coarser than places: what only continues stays as it is.
        if by.length() > SAME {
            at[f] = vec2(to.x.into(), to.y.into()) - facets.centre(f);
            moved += 1;
        }
    }
    Ok(moved)
}

/// Faces as nodes; the offset between two leads over the middle of their edge.
fn graph(facets: &Facets) -> Graph {
    let (mut starts, mut targets, mut offsets) = (vec![0], vec![], vec![]);
    for f in 0..facets.len() {
        for (k, (g, j)) in (0..3).filter_map(|k| Some((k, facets.opposite(f, k)?))) {
            targets.push(g as u32);
            offsets.push(facets.middle(f, k) - facets.centre(f) + facets.centre(g) - facets.middle(g, j));
        }
        starts.push(targets.len() as u32);
    }
    Graph::new(starts, targets, offsets)
}
