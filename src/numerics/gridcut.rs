//! Minimum cuts of small grids whose nodes have up to eight neighbours.
//!
//! Source: Boykov, Kolmogorov: An Experimental Comparison of Min-Cut/Max-Flow Algorithms for Energy Minimization in
//! Vision (2004): two search trees, from the source and from the sink, that are mended after every augmentation. On
//! grids of a few hundred nodes several times as fast as level graphs.
//! In: integer capacities. Out: the nodes on the sink's side of the minimum cut that has fewest of them, which is unique.
//! Unaware of: what is cut.

use std::collections::VecDeque;

/// Steps to the eight neighbours; the opposite of direction d is 7 - d.
pub const DIRECTIONS: [[i32; 2]; 8] = [[-1, -1], [0, -1], [1, -1], [-1, 0], [1, 0], [-1, 1], [0, 1], [1, 1]];

const FREE: u8 = 0;
const SOURCE: u8 = 1;
const SINK: u8 = 2;

/// `parent`: the node hangs on its terminal, or on nothing yet. Other values are directions.
const TERMINAL: u8 = 8;
const ORPHAN: u8 = 9;

/// A grid with capacities; used again from cut to cut.
#[derive(Default)]
pub struct GridCut {
    width: usize,
    /// Capacity from a node in each direction, eight per node.
    arcs: Vec<i32>,
    /// Capacity from the source (positive) or to the sink (negative).
    terminals: Vec<i32>,
    tree: Vec<u8>,
    parent: Vec<u8>,
    /// Distance to the terminal and when it was found out.
    distance: Vec<u32>,
    stamp: Vec<u32>,
    time: u32,
    active: VecDeque<u32>,
    orphans: Vec<u32>,
    /// Index steps of the directions.
    steps: [isize; 8],
}

impl GridCut {
    /// Begins a grid of `width` x `height` nodes without capacities. A border of nodes is added around it, so that every
    /// node has eight neighbours.
    pub fn reset(&mut self, width: usize, height: usize) {
        self.width = width + 2;
        let count = self.width * (height + 2);
        self.arcs.clear();
        self.arcs.resize(count * 8, 0);
        for (bytes, value) in [(&mut self.tree, FREE), (&mut self.parent, ORPHAN)] {
            bytes.clear();
            bytes.resize(count, value);
        }
        for words in [&mut self.distance, &mut self.stamp] {
            words.clear();
            words.resize(count, 0);
        }
        self.terminals.clear();
        self.terminals.resize(count, 0);
        self.time = 0;
        self.active.clear();
        self.orphans.clear();
        self.steps = DIRECTIONS.map(|[dx, dy]| dx as isize + dy as isize * self.width as isize);
    }

    /// Index of the node in column `x` and row `y`.
    #[inline(always)]
    pub fn node(&self, x: usize, y: usize) -> usize {
        (y + 1) * self.width + x + 1
    }

    /// Adds to what it costs that a node lies on the sink's side, or, if negative, on the source's.
    #[inline(always)]
    pub fn add_terminal(&mut self, node: usize, cost: i32) {
        self.terminals[node] = self.terminals[node].saturating_add(cost);
    }

    /// Adds to the cost of `node` being on the source's side while its neighbour in a direction is on the sink's.
    /// `cost` is not negative.
    #[inline(always)]
    pub fn add_arc(&mut self, node: usize, direction: usize, cost: i32) {
        debug_assert!(cost >= 0, "a capacity of {cost}");
        self.arcs[node * 8 + direction] += cost;
    }

    #[inline(always)]
    fn beside(&self, node: usize, direction: usize) -> usize {
        (node as isize + self.steps[direction]) as usize
    }

    /// Cuts; afterwards [`GridCut::is_sink`] tells the sides.
    pub fn cut(&mut self) {
        for node in 0..self.terminals.len() {
            let t = self.terminals[node];
            if t != 0 {
                self.tree[node] = if t > 0 { SOURCE } else { SINK };
                self.parent[node] = TERMINAL;
                self.distance[node] = 1;
                self.active.push_back(node as u32);
            }
        }
        while let Some(&node) = self.active.front() {
            let node = node as usize;
            // A node stays active until it finds nothing more.
            match (self.tree[node] != FREE).then(|| self.grow(node)).flatten() {
                None => {
                    self.active.pop_front();
                }
                Some((from, direction)) => {
                    self.time += 1;
                    self.augment(from, direction);
                    self.adopt();
                }
            }
        }
    }

    /// True if the node is on the sink's side: all nodes from which the sink can still be reached.
    pub fn is_sink(&self, node: usize) -> bool {
        self.tree[node] == SINK
    }

    /// Adds the neighbours that a node reaches to its tree; the arc from the source's tree to the sink's if one is met.
    fn grow(&mut self, node: usize) -> Option<(usize, usize)> {
        let tree = self.tree[node];
        for direction in 0..8 {
            let other = self.beside(node, direction);
            let open =
                if tree == SOURCE { self.arcs[node * 8 + direction] } else { self.arcs[other * 8 + 7 - direction] };
            if open == 0 {
                continue;
            }
            if self.tree[other] == FREE {
                self.tree[other] = tree;
                self.parent[other] = 7 - direction as u8;
                self.distance[other] = self.distance[node] + 1;
                self.stamp[other] = self.stamp[node];
                self.active.push_back(other as u32);
            } else if self.tree[other] != tree {
                return Some(if tree == SOURCE { (node, direction) } else { (other, 7 - direction) });
            } else if self.stamp[other] <= self.stamp[node]
                && self.distance[other] > self.distance[node] + 1
                && self.parent[other] < TERMINAL
            {
                self.parent[other] = 7 - direction as u8;
                self.distance[other] = self.distance[node] + 1;
                self.stamp[other] = self.stamp[node];
            }
        }
        None
    }

    /// Sends what fits along the path that the arc closes.
    fn augment(&mut self, from: usize, direction: usize) {
        let to = self.beside(from, direction);
        let mut flow = self.arcs[from * 8 + direction];
        let (mut node, mut side) = (from, SOURCE);
        loop {
            while self.parent[node] < TERMINAL {
                let up = self.parent[node] as usize;
                let above = self.beside(node, up);
                let arc = if side == SOURCE { above * 8 + 7 - up } else { node * 8 + up };
                flow = flow.min(self.arcs[arc]);
                node = above;
            }
            flow = flow.min(self.terminals[node].abs());
            if side == SINK {
                break;
            }
            (node, side) = (to, SINK);
        }
        self.arcs[from * 8 + direction] -= flow;
        self.arcs[to * 8 + 7 - direction] += flow;
        (node, side) = (from, SOURCE);
        loop {
            while self.parent[node] < TERMINAL {
                let up = self.parent[node] as usize;
                let above = self.beside(node, up);
                let (forth, back) = (above * 8 + 7 - up, node * 8 + up);
                let (used, opened) = if side == SOURCE { (forth, back) } else { (back, forth) };
                self.arcs[used] -= flow;
                self.arcs[opened] += flow;
                if self.arcs[used] == 0 {
                    self.orphan(node);
                }
                node = above;
            }
            let t = &mut self.terminals[node];
            *t -= t.signum() * flow;
            if *t == 0 {
                self.orphan(node);
            }
            if side == SINK {
                return;
            }
            (node, side) = (to, SINK);
        }
    }

    fn orphan(&mut self, node: usize) {
        self.parent[node] = ORPHAN;
        self.orphans.push(node as u32);
    }

    /// Finds new parents for the orphans; those without become free.
    fn adopt(&mut self) {
        while let Some(node) = self.orphans.pop() {
            let node = node as usize;
            let tree = self.tree[node];
            let mut best: Option<(u32, usize)> = None;
            for direction in 0..8 {
                let other = self.beside(node, direction);
                if self.tree[other] != tree || self.toward(tree, other, node, direction) == 0 {
                    continue;
                }
                if let Some(distance) = self.origin(other)
                    && best.is_none_or(|b| distance < b.0)
                {
                    best = Some((distance, direction));
                }
            }
            match best {
                Some((distance, direction)) => {
                    self.parent[node] = direction as u8;
                    self.stamp[node] = self.time;
                    self.distance[node] = distance + 1;
                }
                None => self.set_free(node, tree),
            }
        }
    }

    /// Capacity that a parent in a direction would give a node.
    #[inline(always)]
    fn toward(&self, tree: u8, parent: usize, node: usize, direction: usize) -> i32 {
        if tree == SOURCE { self.arcs[parent * 8 + 7 - direction] } else { self.arcs[node * 8 + direction] }
    }

    fn set_free(&mut self, node: usize, tree: u8) {
        for direction in 0..8 {
            let other = self.beside(node, direction);
            if self.tree[other] != tree {
                continue;
            }
            if self.toward(tree, other, node, direction) > 0 {
                self.active.push_back(other as u32);
            }
            if self.parent[other] == 7 - direction as u8 {
                self.orphan(other);
            }
        }
        self.tree[node] = FREE;
    }

    /// Distance of a node to its terminal, if it still hangs on one; notes it along the way.
    fn origin(&mut self, from: usize) -> Option<u32> {
        let (mut node, mut steps) = (from, 0);
        let end = loop {
            if self.stamp[node] == self.time {
                break self.distance[node];
            }
            match self.parent[node] {
                TERMINAL => {
                    self.stamp[node] = self.time;
                    self.distance[node] = 1;
                    break 1;
                }
                ORPHAN => return None,
                up => node = self.beside(node, up as usize),
            }
            steps += 1;
        };
        let total = end + steps;
        let (mut node, mut distance) = (from, total);
        while self.stamp[node] != self.time {
            self.stamp[node] = self.time;
            self.distance[node] = distance;
            distance -= 1;
            node = self.beside(node, self.parent[node] as usize);
        }
        Some(total)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The cost of a division into sides, by definition.
    fn cost(size: [usize; 2], terminals: &[i32], arcs: &[i32], sink: impl Fn(usize) -> bool) -> i64 {
        let mut sum = 0;
        for (i, &t) in terminals.iter().enumerate() {
            if (t > 0) == sink(i) {
                sum += i64::from(t.abs());
            }
            let (x, y) = ((i % size[0]) as i32, (i / size[0]) as i32);
            for (d, [dx, dy]) in DIRECTIONS.iter().enumerate() {
                let (nx, ny) = (x + dx, y + dy);
                if nx >= 0 && ny >= 0 && nx < size[0] as i32 && ny < size[1] as i32 {
                    let j = ny as usize * size[0] + nx as usize;
                    if !sink(i) && sink(j) {
                        sum += i64::from(arcs[i * 8 + d]);
                    }
                }
            }
        }
        sum
    }

    fn solve(cut: &mut GridCut, size: [usize; 2], terminals: &[i32], arcs: &[i32]) -> Vec<bool> {
        cut.reset(size[0], size[1]);
        let nodes: Vec<usize> = (0..size[0] * size[1]).map(|i| cut.node(i % size[0], i / size[0])).collect();
        for (i, &n) in nodes.iter().enumerate() {
            cut.add_terminal(n, terminals[i]);
            let (x, y) = ((i % size[0]) as i32, (i / size[0]) as i32);
            for (d, [dx, dy]) in DIRECTIONS.iter().enumerate() {
                if (0..size[0] as i32).contains(&(x + dx)) && (0..size[1] as i32).contains(&(y + dy)) {
                    cut.add_arc(n, d, arcs[i * 8 + d]);
                }
            }
        }
        cut.cut();
        nodes.iter().map(|n| cut.is_sink(*n)).collect()
    }

    #[test]
    fn a_chain_is_cut_at_its_weakest_arc() {
        let mut arcs = vec![0; 4 * 8];
        for (i, c) in [5, 2, 7].into_iter().enumerate() {
            arcs[i * 8 + 4] = c;
        }
        let sides = solve(&mut GridCut::default(), [4, 1], &[9, 0, 0, -9], &arcs);
        assert_eq!(sides, [false, false, true, true]);
    }

    proptest! {
        #[test]
        fn no_division_is_cheaper_and_none_as_cheap_has_fewer_on_the_sinks_side(
            terminals in proptest::collection::vec(-6i32..7, 12),
            arcs in proptest::collection::vec(0i32..5, 96),
        ) {
            let (size, mut cut) = ([4, 3], GridCut::default());
            let sides = solve(&mut cut, size, &terminals, &arcs);
            let ours = cost(size, &terminals, &arcs, |i| sides[i]);
            let mut best = (i64::MAX, u32::MAX);
            for mask in 0u32..1 << 12 {
                best = best.min((cost(size, &terminals, &arcs, |i| mask >> i & 1 == 1), mask.count_ones()));
            }
            // Of the free nodes none can reach the sink.
            prop_assert_eq!((ours, sides.iter().filter(|s| **s).count() as u32), best);
            // Used again, it gives the same.
            prop_assert_eq!(solve(&mut cut, size, &terminals, &arcs), sides);
        }

        #[test]
        fn larger_grids_end(seed in 0u64..200) {
            let key = crate::numerics::rng::Key::new(seed);
            let terminals: Vec<i32> = (0..300).map(|i| key.below(i, 2001) as i32 - 1000).collect();
            let arcs: Vec<i32> = (0..2400).map(|i| key.with(1).below(i, 500) as i32).collect();
            let sides = solve(&mut GridCut::default(), [20, 15], &terminals, &arcs);
            // No single change helps.
            let ours = cost([20, 15], &terminals, &arcs, |i| sides[i]);
            for flip in 0..300 {
                prop_assert!(cost([20, 15], &terminals, &arcs, |i| sides[i] != (i == flip)) >= ours);
            }
        }
    }
}
