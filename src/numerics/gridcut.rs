//! Minimum cuts of small grids whose nodes have four neighbours.
//!
//! Source: Boykov, Kolmogorov: An Experimental Comparison of Min-Cut/Max-Flow Algorithms for Energy Minimization in
//! Vision (2004): two search trees, from the source and from the sink, that are mended after every augmentation. On
//! grids of a few hundred nodes several times as fast as level graphs.
//! In: integer capacities. Out: the nodes on the sink's side of the minimum cut that has fewest of them, which is unique.
//! Unaware of: what is cut.

use std::collections::VecDeque;

/// Steps to the four neighbours: up, left, right, down; the opposite of direction d is 3 - d.
pub const DIRECTIONS: [[i32; 2]; 4] = [[0, -1], [-1, 0], [1, 0], [0, 1]];

const FREE: u8 = 0;
const SOURCE: u8 = 1;
const SINK: u8 = 2;

/// Parents: the node hangs on its terminal, or on nothing. Other values are directions.
const TERMINAL: u8 = 4;
const ORPHAN: u8 = 5;

/// A node; all that is asked about it lies in one line of the cache (separate lists are a third slower).
#[derive(Clone, Copy)]
struct Node {
    /// Capacity in each direction.
    arcs: [i32; 4],
    /// Capacity from the source (positive) or to the sink (negative).
    terminal: i32,
    /// Distance to the terminal and when it was found out.
    distance: u32,
    stamp: u32,
    tree: u8,
    parent: u8,
}

/// A grid with capacities; used again from cut to cut.
#[derive(Default)]
pub struct GridCut {
    width: usize,
    nodes: Vec<Node>,
    time: u32,
    active: VecDeque<u32>,
    orphans: Vec<u32>,
    /// Index steps of the directions.
    steps: [isize; 4],
}

impl GridCut {
    /// Begins a grid of `width` x `height` nodes without capacities. A border of nodes is added around it, so that every
    /// node has four neighbours.
    pub fn reset(&mut self, width: usize, height: usize) {
        self.width = width + 2;
        let bare = Node { arcs: [0; 4], terminal: 0, distance: 0, stamp: 0, tree: FREE, parent: ORPHAN };
        self.nodes.clear();
        self.nodes.resize(self.width * (height + 2), bare);
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
        let t = &mut self.nodes[node].terminal;
        *t = t.saturating_add(cost);
    }

    /// Adds to the cost of `node` being on the source's side while its neighbour in a direction is on the sink's.
    /// `cost` is not negative; none may lead to the border that was added.
    #[inline(always)]
    pub fn add_arc(&mut self, node: usize, direction: usize, cost: i32) {
        debug_assert!(cost >= 0, "a capacity of {cost}");
        self.nodes[node].arcs[direction] += cost;
    }

    #[inline(always)]
    fn beside(&self, node: usize, direction: usize) -> usize {
        node.wrapping_add_signed(self.steps[direction])
    }

    /// Cuts; afterwards [`GridCut::is_sink`] tells the sides.
    pub fn cut(&mut self) {
        self.send_next_door();
        for (i, node) in self.nodes.iter_mut().enumerate() {
            if node.terminal != 0 {
                node.tree = if node.terminal > 0 { SOURCE } else { SINK };
                node.parent = TERMINAL;
                node.distance = 1;
                self.active.push_back(i as u32);
            }
        }
        while let Some(&node) = self.active.front() {
            let node = node as usize;
            // A node stays active until it finds nothing more.
            match (self.nodes[node].tree != FREE).then(|| self.grow(node)).flatten() {
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

    /// Sends what it can from each node straight to its neighbours: most of the flow where costs are smooth, without any tree.
    fn send_next_door(&mut self) {
        for node in 0..self.nodes.len() {
            let mut left = self.nodes[node].terminal;
            if left <= 0 {
                continue;
            }
            for direction in 0..4 {
                let open = self.nodes[node].arcs[direction];
                if open == 0 {
                    continue;
                }
                let other = self.beside(node, direction);
                let flow = left.min(open).min(-self.nodes[other].terminal);
                if flow > 0 {
                    self.nodes[node].arcs[direction] -= flow;
                    self.nodes[other].arcs[3 - direction] += flow;
                    self.nodes[other].terminal += flow;
                    left -= flow;
                }
            }
            self.nodes[node].terminal = left;
        }
    }

    /// True if the node is on the sink's side: all nodes from which the sink can still be reached.
    pub fn is_sink(&self, node: usize) -> bool {
        self.nodes[node].tree == SINK
    }

    /// Adds the neighbours that a node reaches to its tree; the arc from the source's tree to the sink's if one is met.
    fn grow(&mut self, node: usize) -> Option<(usize, usize)> {
        let Node { arcs, distance, stamp, tree, .. } = self.nodes[node];
        for (direction, out) in arcs.into_iter().enumerate() {
            let at = self.beside(node, direction);
            let other = &mut self.nodes[at];
            let open = if tree == SOURCE { out } else { other.arcs[3 - direction] };
            if open == 0 {
                continue;
            }
            if other.tree == FREE {
                (other.tree, other.parent) = (tree, 3 - direction as u8);
                (other.distance, other.stamp) = (distance + 1, stamp);
                self.active.push_back(at as u32);
            } else if other.tree != tree {
                return Some(if tree == SOURCE { (node, direction) } else { (at, 3 - direction) });
            } else if other.stamp <= stamp && other.distance > distance + 1 && other.parent < TERMINAL {
                other.parent = 3 - direction as u8;
                (other.distance, other.stamp) = (distance + 1, stamp);
            }
        }
        None
    }

    /// Sends what fits along the path that the arc closes.
    fn augment(&mut self, from: usize, direction: usize) {
        let to = self.beside(from, direction);
        let mut flow = self.nodes[from].arcs[direction];
        for (start, side) in [(from, SOURCE), (to, SINK)] {
            let mut node = start;
            while self.nodes[node].parent < TERMINAL {
                let up = self.nodes[node].parent as usize;
                let above = self.beside(node, up);
                let open = if side == SOURCE { self.nodes[above].arcs[3 - up] } else { self.nodes[node].arcs[up] };
                flow = flow.min(open);
                node = above;
            }
            flow = flow.min(self.nodes[node].terminal.abs());
        }
        self.nodes[from].arcs[direction] -= flow;
        self.nodes[to].arcs[3 - direction] += flow;
        for (start, side) in [(from, SOURCE), (to, SINK)] {
            let mut node = start;
            while self.nodes[node].parent < TERMINAL {
                let up = self.nodes[node].parent as usize;
                let above = self.beside(node, up);
                let along = if side == SOURCE { -flow } else { flow };
                self.nodes[above].arcs[3 - up] += along;
                self.nodes[node].arcs[up] -= along;
                let left = if side == SOURCE { self.nodes[above].arcs[3 - up] } else { self.nodes[node].arcs[up] };
                if left == 0 {
                    self.orphan(node);
                }
                node = above;
            }
            let t = &mut self.nodes[node].terminal;
            *t -= t.signum() * flow;
            if *t == 0 {
                self.orphan(node);
            }
        }
    }

    fn orphan(&mut self, node: usize) {
        self.nodes[node].parent = ORPHAN;
        self.orphans.push(node as u32);
    }

    /// Finds new parents for the orphans; those without become free.
    fn adopt(&mut self) {
        while let Some(node) = self.orphans.pop() {
            let node = node as usize;
            let Node { tree, arcs, .. } = self.nodes[node];
            let mut best: Option<(u32, usize)> = None;
            for (direction, out) in arcs.into_iter().enumerate() {
                let at = self.beside(node, direction);
                let other = &self.nodes[at];
                let open = if tree == SOURCE { other.arcs[3 - direction] } else { out };
                if open == 0 || other.tree != tree {
                    continue;
                }
                if let Some(distance) = self.origin(at)
                    && best.is_none_or(|b| distance < b.0)
                {
                    best = Some((distance, direction));
                }
            }
            match best {
                Some((distance, direction)) => {
                    let (time, node) = (self.time, &mut self.nodes[node]);
                    (node.parent, node.stamp, node.distance) = (direction as u8, time, distance + 1);
                }
                None => self.set_free(node),
            }
        }
    }

    fn set_free(&mut self, node: usize) {
        let Node { tree, arcs, .. } = self.nodes[node];
        for (direction, out) in arcs.into_iter().enumerate() {
            let at = self.beside(node, direction);
            let other = &self.nodes[at];
            if other.tree != tree {
                continue;
            }
            let open = if tree == SOURCE { other.arcs[3 - direction] } else { out };
            if open > 0 {
                self.active.push_back(at as u32);
            }
            if other.parent == 3 - direction as u8 {
                self.orphan(at);
            }
        }
        self.nodes[node].tree = FREE;
    }

    /// Distance of a node to its terminal, if it still hangs on one; notes it along the way.
    fn origin(&mut self, from: usize) -> Option<u32> {
        let (mut at, mut steps, time) = (from, 0, self.time);
        let end = loop {
            let node = &mut self.nodes[at];
            if node.stamp == time {
                break node.distance;
            }
            match node.parent {
                TERMINAL => {
                    (node.stamp, node.distance) = (time, 1);
                    break 1;
                }
                ORPHAN => return None,
                up => at = self.beside(at, up as usize),
            }
            steps += 1;
        };
        let total = end + steps;
        let (mut at, mut distance) = (from, total);
        while self.nodes[at].stamp != time {
            let up = self.nodes[at].parent as usize;
            (self.nodes[at].stamp, self.nodes[at].distance) = (time, distance);
            distance -= 1;
            at = self.beside(at, up);
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
                        sum += i64::from(arcs[i * 4 + d]);
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
                    cut.add_arc(n, d, arcs[i * 4 + d]);
                }
            }
        }
        cut.cut();
        nodes.iter().map(|n| cut.is_sink(*n)).collect()
    }

    #[test]
    fn a_chain_is_cut_at_its_weakest_arc() {
        let mut arcs = vec![0; 4 * 4];
        for (i, c) in [5, 2, 7].into_iter().enumerate() {
            arcs[i * 4 + 2] = c;
        }
        let sides = solve(&mut GridCut::default(), [4, 1], &[9, 0, 0, -9], &arcs);
        assert_eq!(sides, [false, false, true, true]);
    }

    proptest! {
        #[test]
        fn no_division_is_cheaper_and_none_as_cheap_has_fewer_on_the_sinks_side(
            terminals in proptest::collection::vec(-6i32..7, 12),
            arcs in proptest::collection::vec(0i32..5, 48),
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
            let arcs: Vec<i32> = (0..1200).map(|i| key.with(1).below(i, 500) as i32).collect();
            let sides = solve(&mut GridCut::default(), [20, 15], &terminals, &arcs);
            // No single change helps.
            let ours = cost([20, 15], &terminals, &arcs, |i| sides[i]);
            for flip in 0..300 {
                prop_assert!(cost([20, 15], &terminals, &arcs, |i| sides[i] != (i == flip)) >= ours);
            }
        }
    }
}
