//! Ever coarser graphs over the vertices of a mesh, with offsets between their nodes.
//!
//! A coarser graph's nodes are vertices of which no two are adjacent and that are adjacent to all others (a maximal
//! independent set, by lowest index). Two of them are connected where an edge connects vertices that are nearest to them;
//! the offset is the sum along that path, the shortest if there are several. On a flat field it is exact.
//! Unaware of: positions, textures, addresses.

use crate::mesh::Topology;
use crate::numerics::vec::Vec2;

/// Nodes and the offsets of their edges, in texels; the two halves of an edge have opposite offsets.
pub(in crate::synth) struct Graph {
    starts: Vec<u32>,
    targets: Vec<u32>,
    offsets: Vec<Vec2>,
    /// The mesh vertex that each node is.
    pub vertices: Vec<u32>,
    /// For each node of the next finer graph its nearest node here and the offset from there; empty for the finest.
    pub parents: Vec<(u32, Vec2)>,
}

impl Graph {
    /// The mesh itself.
    pub fn finest(topology: &Topology, offsets: &[Vec2]) -> Self {
        let n = topology.vertex_count() as u32;
        let ends = (0..n).map(|v| topology.half_edges(v).end as u32);
        let targets = (0..topology.half_edge_count()).map(|h| topology.target(h)).collect();
        Self::new(std::iter::once(0).chain(ends).collect(), targets, offsets.to_vec())
    }

    /// Any graph: where each node's edges start (and at last their number), where they lead, the offsets along them.
    pub fn new(starts: Vec<u32>, targets: Vec<u32>, offsets: Vec<Vec2>) -> Self {
        let vertices = (0..starts.len().saturating_sub(1) as u32).collect();
        Graph { starts, targets, offsets, vertices, parents: vec![] }
    }

    /// Number of nodes.
    pub fn len(&self) -> usize {
        self.vertices.len()
    }

    /// Neighbours of a node and the offsets to them.
    pub fn edges(&self, node: usize) -> impl Iterator<Item = (usize, Vec2)> {
        let range = self.starts[node] as usize..self.starts[node + 1] as usize;
        self.targets[range.clone()].iter().map(|t| *t as usize).zip(self.offsets[range].iter().copied())
    }

    /// Mean length of the edges in texels; `None` without edges.
    pub fn mean_length(&self) -> Option<f64> {
        let sum: f64 = self.offsets.iter().map(|d| d.length()).sum();
        (!self.offsets.is_empty()).then(|| sum / self.offsets.len() as f64)
    }

    /// The next coarser graph.
    pub fn coarser(&self) -> Graph {
        let (vertices, parents) = self.cluster();
        // Each edge once, by its lower half: sorted by ends, then length, then place; the first of equal ends stays.
        let mut paths = vec![];
        for v in 0..self.len() {
            for (w, d) in self.edges(v) {
                let ((a, from), (b, to)) = (parents[v], parents[w]);
                if a < b {
                    paths.push((a, b, from.length() + d.length() + to.length(), paths.len(), from + d - to));
                }
            }
        }
        paths.sort_unstable_by(|p, q| (p.0, p.1).cmp(&(q.0, q.1)).then(p.2.total_cmp(&q.2)).then(p.3.cmp(&q.3)));
        paths.dedup_by_key(|p| (p.0, p.1));
        let mut halves: Vec<(u32, u32, Vec2)> =
            paths.iter().flat_map(|p| [(p.0, p.1, p.4), (p.1, p.0, -p.4)]).collect();
        halves.sort_unstable_by_key(|h| (h.0, h.1));
        let mut starts = vec![0; vertices.len() + 1];
        for h in &halves {
            starts[h.0 as usize + 1] += 1;
        }
        for i in 0..vertices.len() {
            starts[i + 1] += starts[i];
        }
        let (targets, offsets) = halves.into_iter().map(|h| (h.1, h.2)).unzip();
        Graph { starts, targets, offsets, vertices, parents }
    }

    /// Chooses the nodes of the coarser graph: their vertices, and for each node here its nearest and the offset from it.
    fn cluster(&self) -> (Vec<u32>, Vec<(u32, Vec2)>) {
        const FREE: u32 = u32::MAX;
        const COVERED: u32 = u32::MAX - 1;
        let mut ids = vec![FREE; self.len()];
        let mut vertices = vec![];
        for v in 0..self.len() {
            if ids[v] == FREE {
                ids[v] = vertices.len() as u32;
                vertices.push(self.vertices[v]);
                for (w, _) in self.edges(v) {
                    ids[w] = COVERED;
                }
            }
        }
        let nearest = |v: usize| {
            if ids[v] < COVERED {
                return (ids[v], Vec2::ZERO);
            }
            let chosen = self.edges(v).filter(|(w, _)| ids[*w] < COVERED);
            let (w, d) = chosen.min_by(|a, b| a.1.length().total_cmp(&b.1.length())).unwrap_or((v, Vec2::ZERO));
            (ids[w], -d)
        };
        let parents = (0..self.len()).map(nearest).collect();
        (vertices, parents)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synth::testing::{flat_offsets, grid, random_offsets, topologies};

    #[test]
    fn coarse_offsets_are_exact_on_a_flat_mesh() {
        let mesh = grid(20, 15, 0.3);
        let t = Topology::new(&mesh);
        let mut graph = Graph::finest(&t, &flat_offsets(&mesh, &t, 2.0));
        let flat = |a: u32, b: u32| (mesh.positions[b as usize] - mesh.positions[a as usize]) * 2.0;
        for _ in 0..3 {
            let coarse = graph.coarser();
            assert!(coarse.len() * 2 < graph.len());
            for v in 0..coarse.len() {
                for (w, d) in coarse.edges(v) {
                    let p = flat(coarse.vertices[v], coarse.vertices[w]);
                    assert!((p.x - d.x).abs() < 1e-9 && (p.y - d.y).abs() < 1e-9);
                }
            }
            for (v, (parent, d)) in coarse.parents.iter().enumerate() {
                let p = flat(coarse.vertices[*parent as usize], graph.vertices[v]);
                assert!((p.x - d.x).abs() < 1e-9 && (p.y - d.y).abs() < 1e-9);
            }
            graph = coarse;
        }
    }

    #[test]
    fn any_mesh_has_coarser_graphs() {
        for (name, t) in topologies() {
            let graph = Graph::finest(&t, &random_offsets(&t, 1.0, 1));
            let coarse = graph.coarser();
            assert_eq!(coarse.parents.len(), graph.len(), "{name}");
            for v in 0..coarse.len() {
                for (w, d) in coarse.edges(v) {
                    assert_eq!(coarse.edges(w).find(|(u, _)| *u == v).map(|(_, e)| -e), Some(d), "{name}");
                }
            }
            // No two chosen vertices are adjacent.
            for (i, &v) in coarse.vertices.iter().enumerate() {
                assert!(coarse.vertices[i + 1..].iter().all(|w| t.find(v, *w).is_none()), "{name}");
            }
        }
    }
}
