//! The order in which the vertices of a mesh are synthesised: region growing.
//!
//! Source: \[ZG03\] 4.1, "iteratively selecting the unsynthesized vertex whose proportion of already-synthesized
//! neighbours is greatest". Proportions are kept in 1/1024ths, which tells all fractions apart for vertices of up to 32
//! neighbours. Of equals the one that reached its proportion first comes first, so that a front advances evenly and
//! stays round. A bucket per proportion, each a queue, makes this linear in the size of the mesh: a vertex is queued
//! again whenever its proportion rises, and entries that are out of date are passed over.
//! Unaware of: positions, textures.

use std::collections::VecDeque;

use crate::mesh::Topology;
use crate::synth::Error;

/// Steps of the proportion of synthesised neighbours.
const STEPS: u32 = 1024;

/// All vertices, each once, growing from `seeds`.
///
/// The component of the first seed comes first, and so on; a seed in a component that is done is passed over. Components
/// without a seed follow, each grown from its lowest vertex; isolated vertices are components of their own. Fails if a
/// seed is not a vertex.
pub fn region_growing(topology: &Topology, seeds: &[u32]) -> Result<Vec<u32>, Error> {
    let vertices = topology.vertex_count();
    if let Some(&vertex) = seeds.iter().find(|s| **s as usize >= vertices) {
        return Err(Error::Order { vertex, vertices });
    }
    let mut front = Front::new(vertices);
    let mut order = Vec::with_capacity(vertices);
    for seed in seeds.iter().copied().chain(0..vertices as u32) {
        let mut next = (!front.is_done(seed)).then_some(seed);
        while let Some(v) = next {
            order.push(v);
            front.synthesise(v, topology);
            next = front.pop();
        }
    }
    Ok(order)
}

/// State of a vertex: the proportion of its synthesised neighbours in steps, or done.
const DONE: u16 = u16::MAX;

struct Front {
    /// Synthesised neighbours of each vertex.
    known: Vec<u32>,
    state: Vec<u16>,
    buckets: Vec<VecDeque<u32>>,
    /// One bit per bucket that is not empty.
    occupied: [u64; STEPS as usize / 64 + 1],
}

impl Front {
    fn new(vertices: usize) -> Self {
        let buckets = vec![VecDeque::new(); STEPS as usize + 1];
        Front { known: vec![0; vertices], state: vec![0; vertices], buckets, occupied: [0; STEPS as usize / 64 + 1] }
    }

    fn is_done(&self, v: u32) -> bool {
        self.state[v as usize] == DONE
    }

    /// Marks `v` as done and moves its neighbours up.
    fn synthesise(&mut self, v: u32, topology: &Topology) {
        self.state[v as usize] = DONE;
        for &n in topology.neighbours(v) {
            let i = n as usize;
            if self.state[i] == DONE {
                continue;
            }
            self.known[i] += 1;
            let degree = topology.half_edges(n).len() as u64;
            let bucket = (u64::from(self.known[i]) * u64::from(STEPS) / degree) as u16;
            // A vertex of very high degree may stay on its step; it keeps its place in the queue then.
            if bucket > self.state[i] || self.known[i] == 1 {
                self.state[i] = bucket;
                self.buckets[bucket as usize].push_back(n);
                self.occupied[bucket as usize / 64] |= 1 << (bucket % 64);
            }
        }
    }

    /// The first vertex of the highest bucket; `None` when the component is done.
    fn pop(&mut self) -> Option<u32> {
        loop {
            let word = self.occupied.iter().rposition(|w| *w != 0)?;
            let bucket = word * 64 + 63 - self.occupied[word].leading_zeros() as usize;
            while let Some(v) = self.buckets[bucket].pop_front() {
                if usize::from(self.state[v as usize]) == bucket {
                    return Some(v);
                }
            }
            self.occupied[word] &= !(1 << (bucket % 64));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synth::testing::{grid, topologies};
    use proptest::prelude::*;

    /// The definition, by looking at every vertex each time.
    fn plain(topology: &Topology) -> Vec<u32> {
        let n = topology.vertex_count();
        let (mut order, mut done, mut reached) = (vec![], vec![false; n], vec![(0u32, 0usize); n]);
        let mut clock = 0;
        while order.len() < n {
            let open = || (0..n).filter(|v| !done[*v]);
            let better = |a: &usize, b: &usize| {
                let (ra, rb) = (reached[*a], reached[*b]);
                let (da, db) = (topology.neighbours(*a as u32).len(), topology.neighbours(*b as u32).len());
                let proportions = (ra.0 as usize * db.max(1)).cmp(&(rb.0 as usize * da.max(1)));
                proportions.then(rb.1.cmp(&ra.1)).then(b.cmp(a))
            };
            let v = open().max_by(better).unwrap();
            done[v] = true;
            order.push(v as u32);
            for &w in topology.neighbours(v as u32) {
                clock += 1;
                reached[w as usize] = (reached[w as usize].0 + 1, clock);
            }
        }
        order
    }

    #[test]
    fn the_order_is_greedy_by_proportion() {
        for (name, topology) in topologies() {
            assert_eq!(region_growing(&topology, &[]).unwrap(), plain(&topology), "{name}");
        }
    }

    #[test]
    fn growth_is_round() {
        // From the middle of a 101 x 101 grid: after a quarter of the vertices none beyond twice the disc's radius.
        let t = Topology::new(&grid(101, 101, 0.0));
        let order = region_growing(&t, &[5100]).unwrap();
        assert_eq!(order[0], 5100);
        let radius = (10201.0f64 / 4.0 / std::f64::consts::PI).sqrt();
        for &v in &order[..10201 / 4] {
            let (x, y) = (f64::from(v % 101) - 50.0, f64::from(v / 101) - 50.0);
            assert!((x * x + y * y).sqrt() < 2.0 * radius);
        }
    }

    #[test]
    fn seeds_lead_their_components() {
        let (_, two) = topologies().into_iter().find(|(name, _)| *name == "two components").unwrap();
        let order = region_growing(&two, &[4, 5]).unwrap();
        assert_eq!(order[0], 4);
        assert_eq!(order.len(), two.vertex_count());
        assert_eq!(region_growing(&two, &[99]), Err(Error::Order { vertex: 99, vertices: two.vertex_count() }));
    }

    proptest! {
        #[test]
        fn every_vertex_comes_once_and_next_to_the_grown(faces in prop::collection::vec([0u32..20, 0..20, 0..20], 0..30)) {
            let mesh = crate::mesh::TriMesh { positions: vec![Default::default(); 20], faces };
            let t = Topology::new(&mesh);
            let order = region_growing(&t, &[]).unwrap();
            prop_assert_eq!(&order, &plain(&t));
            let mut sorted = order.clone();
            sorted.sort_unstable();
            prop_assert_eq!(sorted, (0..20).collect::<Vec<_>>());
        }
    }
}
