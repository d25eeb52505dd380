//! The order of vertices along a sequence of faces that keeps to a small vertex cache, and that sequence.
//!
//! Source: \[ZG03\] 4.1 uses the universal rendering sequences of Bogomjakov and Gotsman (2002) as the surface's analogue of
//! the Hilbert curve, at the price of seconds to minutes of graph partitioning. This is a linear-time stand-in for the
//! same purpose, locality: fans around one vertex after the other, the next one chosen among those just touched that
//! are oldest in a simulated first-in-first-out cache and would still be in it after their fan; from a dead end back to
//! the vertex touched last that has faces left. Vertices come in the order of their first use. Sander, Nehab and
//! Barczak 2007 (Fast Triangle Reordering for Vertex Locality and Reduced Overdraw) make such fans as well.
//! Unaware of: positions, textures.

use crate::mesh::{Topology, TriMesh};

/// Vertices in the simulated cache.
pub const CACHE: u64 = 24;

/// All vertices, each once, in the order in which a cache-friendly sequence of the faces first uses them.
///
/// Every vertex but the first of each component has an earlier neighbour. Components follow each other by their lowest
/// vertex; those without a face come last. Time is linear in the faces. `topology` must be that of `mesh`.
pub fn rendering_sequence(mesh: &TriMesh, topology: &Topology) -> Vec<u32> {
    walk(mesh, topology).order
}

/// All faces, each once, in that sequence.
pub fn face_sequence(mesh: &TriMesh, topology: &Topology) -> Vec<u32> {
    walk(mesh, topology).faces
}

/// Average cache miss ratio: vertices that a first-in-first-out cache of `cache` vertices has to fetch per face, drawing
/// in this order; 3 at worst, 0.5 at best on large closed meshes, 0 without faces. Indices are below `vertices`.
pub fn acmr(faces: &[[u32; 3]], vertices: usize, cache: u64) -> f64 {
    let (mut entered, mut misses) = (vec![None; vertices], 0u64);
    for &v in faces.iter().flatten() {
        if entered[v as usize].is_none_or(|at| misses - at > cache) {
            entered[v as usize] = Some(misses);
            misses += 1;
        }
    }
    if faces.is_empty() { 0.0 } else { misses as f64 / faces.len() as f64 }
}

fn walk(mesh: &TriMesh, topology: &Topology) -> Walk {
    let vertices = topology.vertex_count();
    let mut walk = Walk {
        live: (0..vertices as u32).map(|v| topology.faces(v).len() as u32).collect(),
        emitted: vec![false; mesh.faces.len()],
        stamps: vec![0; vertices],
        time: CACHE + 1,
        order: Vec::with_capacity(vertices),
        faces: Vec::with_capacity(mesh.faces.len()),
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
    walk
}

struct Walk {
    /// Faces of each vertex still to come.
    live: Vec<u32>,
    emitted: Vec<bool>,
    /// When each vertex last entered the cache; 0: never.
    stamps: Vec<u64>,
    time: u64,
    order: Vec<u32>,
    faces: Vec<u32>,
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
            self.faces.push(f);
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

    #[test]
    fn misses_are_counted_by_hand() {
        let strip = [[0, 1, 2], [2, 1, 3], [2, 3, 4], [0, 1, 4]];
        assert_eq!(acmr(&strip, 5, 24), 5.0 / 4.0, "each vertex once");
        // 0 1 2 fill it, 3 drops 0, 4 drops 1; then 0 drops 2 and 1 drops 3, and 4 is still there.
        assert_eq!(acmr(&strip, 5, 3), 7.0 / 4.0);
        assert_eq!(acmr(&[], 5, 3), 0.0);
    }

    #[test]
    fn the_sequence_of_faces_spares_a_cache() {
        let mesh = grid(100, 100, 0.0);
        let order = face_sequence(&mesh, &Topology::new(&mesh));
        let mut sorted = order.clone();
        sorted.sort_unstable();
        assert_eq!(sorted, (0..mesh.faces.len() as u32).collect::<Vec<_>>());
        let faces: Vec<[u32; 3]> = order.iter().map(|&f| mesh.faces[f as usize]).collect();
        let (before, after) = (acmr(&mesh.faces, 10_000, CACHE), acmr(&faces, 10_000, CACHE));
        println!("row by row {before:.3}, as a sequence {after:.3}");
        assert!(before > 0.95 && after < 0.7, "{before} {after}");
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
            let grown = crate::synth::mesh::order::region_growing(&t, &[]).unwrap();
            let components =
                (0..20).filter(|i| !t.neighbours(grown[*i]).iter().any(|n| grown[..*i].contains(n))).count();
            prop_assert_eq!(starts, components);
        }
    }
}
