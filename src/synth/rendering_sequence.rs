//! The order of vertices along a sequence of faces that keeps to a small vertex cache.
//!
//! Source: \[ZG03\] 4.1 uses the universal rendering sequences of Bogomjakov and Gotsman (2002) as the surface's analogue of
//! the Hilbert curve, at the price of seconds to minutes of graph partitioning. This is a linear-time stand-in for the
//! same purpose, locality: fans around one vertex after the other, the next one chosen among those just touched that
//! are oldest in a simulated first-in-first-out cache and would still be in it after their fan; from a dead end back to
//! the vertex touched last that has faces left. Vertices come in the order of their first use.
//! Unaware of: positions, textures.

use crate::mesh::{Topology, TriMesh};

/// Vertices in the simulated cache.
const CACHE: u64 = 24;

/// All vertices, each once, in the order in which a cache-friendly sequence of the faces first uses them.
///
/// Every vertex but the first of each component has an earlier neighbour. Components follow each other by their lowest
/// vertex; those without a face come last. Time is linear in the faces. `topology` must be that of `mesh`.
pub fn rendering_sequence(mesh: &TriMesh, topology: &Topology) -> Vec<u32> {
    let vertices = topology.vertex_count();
    let mut walk = Walk {
        live: (0..vertices as u32).map(|v| topology.faces(v).len() as u32).collect(),
        emitted: vec![false; mesh.faces.len()],
        stamps: vec![0; vertices],
        time: CACHE + 1,
        order: Vec::with_capacity(vertices),
        touched: vec![],
    };
    for start in 0..vertices as u32 {
        let mut centre = (walk.live[start as usize] > 0).then_some(start);
        while let Some(v) = centre {
            let first = walk.touched.len();
            walk.fan(v, mesh, topology);
            centre = walk.next(first);
        }
    }
    let lonely = (0..vertices as u32).filter(|v| walk.stamps[*v as usize] == 0);
    walk.order.extend(lonely);
    walk.order
}

struct Walk {
    /// Faces of each vertex still to come.
    live: Vec<u32>,
    emitted: Vec<bool>,
    /// When each vertex last entered the cache; 0: never.
    stamps: Vec<u64>,
    time: u64,
    order: Vec<u32>,
    /// Vertices by last use, to return to from dead ends.
    touched: Vec<u32>,
}

impl Walk {
    /// Emits the remaining faces around `v`.
    fn fan(&mut self, v: u32, mesh: &TriMesh, topology: &Topology) {
        self.touch(v);
        for &f in topology.faces(v) {
            if std::mem::replace(&mut self.emitted[f as usize], true) {
                continue;
            }
            let [a, b, c] = mesh.faces[f as usize];
            for (i, w) in [a, b, c].into_iter().enumerate() {
                // A face counts once at each of its distinct vertices, as in the topology's rows.
                if i == 0 || (w != a && (i == 1 || w != b)) {
                    self.live[w as usize] -= 1;
                    self.touch(w);
                }
            }
        }
    }

    fn touch(&mut self, v: u32) {
        let stamp = &mut self.stamps[v as usize];
        if *stamp == 0 {
            self.order.push(v);
        }
        if self.time - *stamp > CACHE {
            *stamp = self.time;
            self.time += 1;
        }
        self.touched.push(v);
    }

    /// The next vertex to fan around, preferably one touched since `first`.
    fn next(&mut self, first: usize) -> Option<u32> {
        let age = |v: u32| {
            let age = self.time - self.stamps[v as usize];
            if age + 2 * u64::from(self.live[v as usize]) <= CACHE { age } else { 0 }
        };
        let recent = self.touched[first..].iter().copied().filter(|v| self.live[*v as usize] > 0);
        if let Some(v) = recent.max_by_key(|v| (age(*v), std::cmp::Reverse(*v))) {
            return Some(v);
        }
        while let Some(v) = self.touched.pop() {
            if self.live[v as usize] > 0 {
                return Some(v);
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synth::testing::grid;
    use proptest::prelude::*;

    #[test]
    fn a_strip_is_walked_along() {
        let mesh = grid(4, 2, 0.0);
        let order = rendering_sequence(&mesh, &Topology::new(&mesh));
        assert_eq!(order, [0, 4, 1, 5, 2, 6, 3, 7]);
    }

    #[test]
    fn successive_vertices_are_near() {
        // A 100 x 100 grid: nearly all vertices find a neighbour among the 32 before them; row by row would be 100.
        let mesh = grid(100, 100, 0.0);
        let t = Topology::new(&mesh);
        let order = rendering_sequence(&mesh, &t);
        let near = |i: usize| t.neighbours(order[i]).iter().any(|n| order[i.saturating_sub(32)..i].contains(n));
        assert!((1..order.len()).filter(|i| near(*i)).count() > 9500);
    }

    proptest! {
        #[test]
        fn every_vertex_comes_once_and_next_to_an_earlier_one(
            faces in prop::collection::vec([0u32..20, 0..20, 0..20], 0..30),
        ) {
            let mesh = TriMesh { positions: vec![Default::default(); 20], faces };
            let t = Topology::new(&mesh);
            let order = rendering_sequence(&mesh, &t);
            let mut sorted = order.clone();
            sorted.sort_unstable();
            prop_assert_eq!(sorted, (0..20).collect::<Vec<_>>());
            let starts = (0..20).filter(|i| !t.neighbours(order[*i]).iter().any(|n| order[..*i].contains(n))).count();
            let grown = crate::synth::vertex_order::region_growing(&t, &[]).unwrap();
            let components =
                (0..20).filter(|i| !t.neighbours(grown[*i]).iter().any(|n| grown[..*i].contains(n))).count();
            prop_assert_eq!(starts, components);
        }
    }
}
