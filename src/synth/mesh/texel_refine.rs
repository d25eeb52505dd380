//! Correction of the places that the texels of an atlas show.
//!
//! Beyond \[ZG03\]: the vertices of a mesh may be several texels apart, and patches then meet along its edges. Texels are
//! nodes of a graph that goes on across the borders of charts; patches are cut anew along them as along the vertices
//! ([`super::refine`]), from the places that those came to.
//! Unaware of: atlases, how the offsets were found.

use super::hierarchy::Graph;
use super::refine::{coarsest_edge, refine_graph};
use super::room::Room;
use crate::exemplar::JumpMap;
use crate::numerics::par;
use crate::numerics::vec::Vec2;
use crate::synth::Error;
use crate::synth::seam_metric::SeamMetrics;
use crate::texture::Texel;

/// Nodes and the offsets between them.
#[derive(Clone, Debug)]
pub struct Net {
    /// Where each node's edges start, and at last their number.
    pub starts: Vec<u32>,
    /// The node that each edge leads to.
    pub targets: Vec<u32>,
    /// Offset along each edge in texels; those of the two directions are opposite.
    pub offsets: Vec<Vec2>,
}

/// Corrects `places` by `passes` sweeps over all nodes and twice as many on coarser levels; none leaves them as they are.
/// The result does not depend on the number of threads. Fails if counts or sizes do not agree, an offset or place is not
/// finite, or the edges around a node do not fit into the exemplar.
pub fn refine_texels(
    jumps: &JumpMap,
    metrics: &SeamMetrics,
    net: Net,
    places: &[Texel],
    passes: u32,
) -> Result<Vec<Texel>, Error> {
    let size = metrics.size;
    if size != [jumps.width(), jumps.height()] {
        return Err(Error::TextureSize { found: [jumps.width(), jumps.height()], expected: size });
    }
    let Net { starts, targets, offsets } = net;
    let count = |what, found, expected| match found == expected {
        true => Ok(()),
        false => Err(Error::Count { what, found, expected }),
    };
    count("starts of rows", starts.len(), places.len() + 1)?;
    let rows_end = starts.last().map_or(0, |n| *n as usize);
    count("targets of edges", targets.len(), rows_end)?;
    count("offsets of edges", offsets.len(), rows_end)?;
    count("rows in order", starts.windows(2).filter(|w| w[0] <= w[1]).count(), places.len())?;
    count("targets of edges that exist", targets.iter().filter(|t| **t as usize >= places.len()).count(), 0)?;
    let known = |at: &&Texel| at.x.is_finite() && at.y.is_finite();
    count("places that are finite", places.iter().filter(known).count(), places.len())?;
    if passes == 0 {
        return Ok(places.to_vec());
    }
    let row = |v: usize| starts[v] as usize..starts[v + 1] as usize;
    let rooms = par::map(places.len(), |v| Room::new(&offsets[row(v)], size));
    if let Some(v) = rooms.iter().position(Room::is_empty) {
        let around = &offsets[row(v)];
        if let Some(h) = around.iter().position(|d| !(d.x.is_finite() && d.y.is_finite())) {
            return Err(Error::Offset { from: v as u32, to: targets[row(v).start + h] });
        }
        let span = |along: fn(&Vec2) -> f64| {
            let (low, high) = around.iter().map(along).fold((0.0, 0.0), |(l, h): (f64, f64), x| (l.min(x), h.max(x)));
            high - low
        };
        return Err(Error::BoxTooLarge { vertex: v as u32, span: [span(|d| d.x), span(|d| d.y)], exemplar: size });
    }
    refine_graph(jumps, metrics, Graph::new(starts, targets, offsets), &rooms, places, passes, coarsest_edge(size))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::exemplar::AnalysisParams;
    use crate::mesh::Topology;
    use crate::numerics::rng::Key;
    use crate::synth::testing::{blobs, brute_force_map, flat_offsets, grid};
    use crate::texture::{MapKind, MapSet, Texture, texel};

    /// Texels of a square chart, each at a place of its own choice.
    fn bench() -> (JumpMap, SeamMetrics, Net, Vec<Texel>) {
        let e = blobs(40, 40);
        let height = Texture::from_fn(40, 40, 1, |x, y, out| out[0] = e.get(x, y)[0]);
        let maps = MapSet::new(vec![(MapKind::Height, height)]);
        let metrics = SeamMetrics::new(&maps, &AnalysisParams::default()).unwrap();
        let mesh = grid(30, 30, 0.0);
        let t = Topology::new(&mesh);
        let rows: Vec<usize> = (0..900).map(|v| t.half_edges(v).end).collect();
        let net = Net {
            starts: std::iter::once(0).chain(rows).map(|n| n as u32).collect(),
            targets: (0..t.half_edge_count()).map(|h| t.target(h)).collect(),
            offsets: flat_offsets(&mesh, &t, 1.0),
        };
        let places = (0..900).map(|v| {
            let draws = Key::new(8).with(v);
            texel(2.5 + (35.0 * draws.unit(0)).floor() as f32, 2.5 + (35.0 * draws.unit(1)).floor() as f32)
        });
        (brute_force_map(&e, 2, 3, 4.0), metrics, net, places.collect())
    }

    /// Edges along which a place does not continue the other.
    fn jumps(net: &Net, places: &[Texel]) -> usize {
        let broken = |v: usize, h: usize| {
            let (a, b, d) = (places[v], places[net.targets[h] as usize], net.offsets[h]);
            (f64::from(a.x) + d.x - f64::from(b.x)).abs() > 0.02 || (f64::from(a.y) + d.y - f64::from(b.y)).abs() > 0.02
        };
        let row = |v: usize| net.starts[v] as usize..net.starts[v + 1] as usize;
        (0..places.len()).map(|v| row(v).filter(|h| broken(v, *h)).count()).sum()
    }

    #[test]
    fn texels_become_patches_with_any_number_of_threads() {
        let (map, metrics, net, places) = bench();
        let run = |threads, passes| {
            par::install(threads, || refine_texels(&map, &metrics, net.clone(), &places, passes)).unwrap()
        };
        let corrected = run(1, 2);
        assert_eq!(corrected, run(8, 2));
        assert!(jumps(&net, &corrected) * 4 < jumps(&net, &places), "{}", jumps(&net, &corrected));
        assert_eq!(run(1, 0), places);
    }

    #[test]
    fn what_does_not_belong_together_is_named() {
        let (map, metrics, net, places) = bench();
        let with = |change: &dyn Fn(&mut Net, &mut Vec<Texel>)| {
            let (mut net, mut places) = (net.clone(), places.clone());
            change(&mut net, &mut places);
            refine_texels(&map, &metrics, net, &places, 1).map(|_| ())
        };
        let count = |what, found, expected| Err(Error::Count { what, found, expected });
        assert_eq!(with(&|_, p| p.truncate(899)), count("starts of rows", 901, 900));
        let halves = net.targets.len();
        assert_eq!(with(&|n, _| n.offsets.truncate(halves - 1)), count("offsets of edges", halves - 1, halves));
        assert_eq!(with(&|n, _| n.targets[0] = 900), count("targets of edges that exist", 1, 0));
        assert_eq!(with(&|n, _| n.starts[5] = 9999), count("rows in order", 899, 900));
        assert_eq!(with(&|_, p| p[3].x = f32::NAN), count("places that are finite", 899, 900));
        assert!(matches!(with(&|n, _| n.offsets[0].x = 60.0), Err(Error::BoxTooLarge { vertex: 0, .. })));
        assert!(matches!(with(&|n, _| n.offsets[0].x = f64::NAN), Err(Error::Offset { from: 0, .. }) | Ok(())));
    }
}
