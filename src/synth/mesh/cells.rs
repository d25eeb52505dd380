//! Division of a graph into cells: the windows of the correction on surfaces.
//!
//! Middles are nodes at least [`REACH`] steps from each other, so many that every node is nearer to one; a cell is all
//! nodes nearest to its middle. Cells have colours, no two of one colour adjacent.
//! Unaware of: offsets, addresses.

use super::hierarchy::Graph;

/// Steps between middles: cells of about 200 nodes on a mesh whose nodes have six neighbours.
const REACH: u32 = 9;

/// Cells of a graph.
pub(super) struct Cells {
    /// Nodes by cell, each cell in the order of a breadth-first search from its middle.
    nodes: Vec<u32>,
    starts: Vec<u32>,
    /// The cell of each node, and its place in the cell.
    place: Vec<(u32, u32)>,
    /// Steps from the middle.
    depth: Vec<u32>,
    /// Cells by colour.
    pub colours: Vec<Vec<u32>>,
}

impl Cells {
    /// Divides a graph. With `shifted`, another division, the middles are where that one's cells meet.
    pub fn new(graph: &Graph, shifted: Option<&Cells>) -> Self {
        let n = graph.len();
        let mut order: Vec<u32> = (0..n as u32).collect();
        if let Some(other) = shifted {
            order.sort_by_key(|v| std::cmp::Reverse(other.depth[*v as usize]));
        }
        let (place, depth) = grow(graph, &middles(graph, &order));
        let count = place.iter().map(|p| p.0 + 1).max().unwrap_or(0) as usize;
        let mut starts = vec![0u32; count + 1];
        for p in &place {
            starts[p.0 as usize + 1] += 1;
        }
        for i in 0..count {
            starts[i + 1] += starts[i];
        }
        let mut nodes = vec![0; n];
        for (v, p) in place.iter().enumerate() {
            nodes[(starts[p.0 as usize] + p.1) as usize] = v as u32;
        }
        let mut cells = Cells { nodes, starts, place, depth, colours: vec![] };
        cells.colours = cells.coloured(graph);
        cells
    }

    /// The nodes of a cell.
    pub fn nodes(&self, cell: u32) -> &[u32] {
        &self.nodes[self.starts[cell as usize] as usize..self.starts[cell as usize + 1] as usize]
    }

    /// The place of a node in a cell, if it is there.
    #[inline(always)]
    pub fn number_in(&self, cell: u32, node: u32) -> Option<usize> {
        let (of, number) = self.place[node as usize];
        (of == cell).then_some(number as usize)
    }

    /// Greedy colours in the order of the cells.
    fn coloured(&self, graph: &Graph) -> Vec<Vec<u32>> {
        let count = self.starts.len() - 1;
        let mut colours: Vec<Vec<u32>> = vec![];
        let mut of = vec![usize::MAX; count];
        for cell in 0..count as u32 {
            let mut taken = vec![];
            for &v in self.nodes(cell) {
                taken.extend(graph.edges(v as usize).map(|(w, _)| of[self.place[w].0 as usize]));
            }
            taken.sort_unstable();
            taken.dedup();
            let colour = taken.iter().enumerate().find(|(i, c)| i != *c).map_or(taken.len(), |(i, _)| i);
            of[cell as usize] = colour;
            if colours.len() <= colour {
                colours.push(vec![]);
            }
            colours[colour].push(cell);
        }
        colours
    }
}

/// Nodes at least [`REACH`] steps apart, chosen greedily in an order; every node is nearer than that to one.
fn middles(graph: &Graph, order: &[u32]) -> Vec<u32> {
    let mut nearest = vec![u32::MAX; graph.len()];
    let mut queue = vec![];
    let mut out = vec![];
    for &middle in order {
        if nearest[middle as usize] != u32::MAX {
            continue;
        }
        out.push(middle);
        nearest[middle as usize] = 0;
        queue.clear();
        queue.push(middle);
        let mut i = 0;
        while i < queue.len() {
            let v = queue[i] as usize;
            i += 1;
            let next = nearest[v] + 1;
            if next >= REACH {
                break;
            }
            for (w, _) in graph.edges(v) {
                if nearest[w] > next {
                    nearest[w] = next;
                    queue.push(w as u32);
                }
            }
        }
    }
    out
}

/// The cell of each node, its place in the order in which the cell grew, and its steps from the middle.
fn grow(graph: &Graph, middles: &[u32]) -> (Vec<(u32, u32)>, Vec<u32>) {
    let mut place = vec![(u32::MAX, 0); graph.len()];
    let mut depth = vec![0; graph.len()];
    let mut sizes = vec![1u32; middles.len()];
    for (cell, m) in middles.iter().enumerate() {
        place[*m as usize] = (cell as u32, 0);
    }
    let mut queue = middles.to_vec();
    let mut i = 0;
    while i < queue.len() {
        let v = queue[i] as usize;
        i += 1;
        let cell = place[v].0;
        for (w, _) in graph.edges(v) {
            if place[w].0 == u32::MAX {
                place[w] = (cell, sizes[cell as usize]);
                sizes[cell as usize] += 1;
                depth[w] = depth[v] + 1;
                queue.push(w as u32);
            }
        }
    }
    (place, depth)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synth::testing::{grid, random_offsets, topologies};

    fn check(graph: &Graph, cells: &Cells, name: &str) {
        let mut seen = vec![0; graph.len()];
        let mut colour_of = vec![usize::MAX; graph.len()];
        for (colour, some) in cells.colours.iter().enumerate() {
            for &cell in some {
                for (i, &v) in cells.nodes(cell).iter().enumerate() {
                    seen[v as usize] += 1;
                    colour_of[v as usize] = colour;
                    assert_eq!(cells.number_in(cell, v), Some(i), "{name}");
                    // Connected: each but the middle touches one before it.
                    let before = |w: usize| cells.number_in(cell, w as u32).is_some_and(|j| j < i);
                    assert!(i == 0 || graph.edges(v as usize).any(|(w, _)| before(w)), "{name}");
                }
            }
        }
        assert!(seen.iter().all(|n| *n == 1), "{name}");
        for v in 0..graph.len() {
            for (w, _) in graph.edges(v) {
                assert!(cells.place[v].0 == cells.place[w].0 || colour_of[v] != colour_of[w], "{name}");
            }
        }
    }

    #[test]
    fn every_node_is_in_one_connected_cell_and_neighbours_differ_in_colour() {
        for (name, t) in topologies() {
            let graph = Graph::finest(&t, &random_offsets(&t, 1.0, 1));
            let cells = Cells::new(&graph, None);
            check(&graph, &cells, name);
            check(&graph, &Cells::new(&graph, Some(&cells)), name);
        }
        let mesh = grid(60, 50, 0.3);
        let t = crate::mesh::Topology::new(&mesh);
        let graph = Graph::finest(&t, &random_offsets(&t, 1.0, 1));
        let cells = Cells::new(&graph, None);
        check(&graph, &cells, "grid");
        let other = Cells::new(&graph, Some(&cells));
        check(&graph, &other, "grid, shifted");
        let count = |c: &Cells| c.starts.len() - 1;
        assert!(
            (8..60).contains(&count(&cells)) && (8..60).contains(&count(&other)),
            "{} {}",
            count(&cells),
            count(&other)
        );
        // Middles of the one are far from those of the other.
        let near = (0..count(&other) as u32).filter(|c| cells.depth[other.nodes(*c)[0] as usize] < 2).count();
        assert!(near * 4 < count(&other), "{near}");
    }
}
