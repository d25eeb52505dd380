//! Minimum cuts of small graphs: grids whose nodes have four neighbours, and any others.
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

/// Parents: the node hangs on its terminal, or on nothing. Other values are numbers of arcs.
const TERMINAL: u16 = u16::MAX - 1;
const ORPHAN: u16 = u16::MAX;

/// Most arcs that leave a node.
const MOST_ARCS: u32 = 65_000;

/// How arcs are kept. The arcs that leave a node are numbered; each has an opposite.
pub trait Layout: Default {
    /// What a node itself keeps of them.
    type Arcs: Copy + Default;
    /// Number of arcs that leave a node.
    fn count(&self, arcs: &Self::Arcs) -> usize;
    /// Where an arc leads.
    fn beside(&self, node: usize, arcs: &Self::Arcs, arc: usize) -> usize;
    /// The opposite's number at the node where an arc leads.
    fn back(&self, arcs: &Self::Arcs, arc: usize) -> usize;
    /// What an arc can still take.
    fn open(&self, arcs: &Self::Arcs, arc: usize) -> i32;
    /// Adds to what it can take.
    fn add(&mut self, arcs: &mut Self::Arcs, arc: usize, capacity: i32);
}

/// A grid of nodes with four neighbours each.
#[derive(Default)]
pub struct Grid {
    width: usize,
    /// Index steps of the directions.
    steps: [isize; 4],
}

impl Layout for Grid {
    type Arcs = [i32; 4];
    #[inline(always)]
    fn count(&self, _: &[i32; 4]) -> usize {
        4
    }
    #[inline(always)]
    fn beside(&self, node: usize, _: &[i32; 4], arc: usize) -> usize {
        node.wrapping_add_signed(self.steps[arc])
    }
    #[inline(always)]
    fn back(&self, _: &[i32; 4], arc: usize) -> usize {
        3 - arc
    }
    #[inline(always)]
    fn open(&self, arcs: &[i32; 4], arc: usize) -> i32 {
        arcs[arc]
    }
    #[inline(always)]
    fn add(&mut self, arcs: &mut [i32; 4], arc: usize, capacity: i32) {
        arcs[arc] += capacity;
    }
}

/// Arcs between any nodes.
#[derive(Default)]
pub struct Net {
    arcs: Vec<NetArc>,
    /// Pairs of nodes and the capacities there and back, until [`GraphCut::connect`] sorts them in.
    pairs: Vec<([u32; 2], [i32; 2])>,
}

#[derive(Clone, Copy, Default)]
struct NetArc {
    to: u32,
    back: u32,
    open: i32,
}

impl Layout for Net {
    /// The first of a node's arcs, and the one behind its last.
    type Arcs = [u32; 2];
    #[inline(always)]
    fn count(&self, arcs: &[u32; 2]) -> usize {
        (arcs[1] - arcs[0]) as usize
    }
    #[inline(always)]
    fn beside(&self, _: usize, arcs: &[u32; 2], arc: usize) -> usize {
        self.arcs[arcs[0] as usize + arc].to as usize
    }
    #[inline(always)]
    fn back(&self, arcs: &[u32; 2], arc: usize) -> usize {
        self.arcs[arcs[0] as usize + arc].back as usize
    }
    #[inline(always)]
    fn open(&self, arcs: &[u32; 2], arc: usize) -> i32 {
        self.arcs[arcs[0] as usize + arc].open
    }
    #[inline(always)]
    fn add(&mut self, arcs: &mut [u32; 2], arc: usize, capacity: i32) {
        self.arcs[arcs[0] as usize + arc].open += capacity;
    }
}

/// A node; all that is asked about it lies in one line of the cache (separate lists are a third slower).
#[derive(Clone, Copy)]
struct Node<A> {
    arcs: A,
    /// Capacity from the source (positive) or to the sink (negative).
    terminal: i32,
    /// Distance to the terminal and when it was found out.
    distance: u32,
    stamp: u32,
    parent: u16,
    tree: u8,
}

/// A graph with capacities; used again from cut to cut.
#[derive(Default)]
pub struct Cut<L: Layout> {
    layout: L,
    nodes: Vec<Node<L::Arcs>>,
    time: u32,
    active: VecDeque<u32>,
    orphans: Vec<u32>,
}

/// A grid with capacities.
pub type GridCut = Cut<Grid>;

/// Any graph with capacities.
pub type GraphCut = Cut<Net>;

impl GridCut {
    /// Begins a grid of `width` x `height` nodes without capacities. A border of nodes is added around it, so that every
    /// node has four neighbours.
    pub fn reset(&mut self, width: usize, height: usize) {
        self.layout.width = width + 2;
        self.layout.steps = DIRECTIONS.map(|[dx, dy]| dx as isize + dy as isize * (width as isize + 2));
        self.clear((width + 2) * (height + 2));
    }

    /// Index of the node in column `x` and row `y`.
    #[inline(always)]
    pub fn node(&self, x: usize, y: usize) -> usize {
        (y + 1) * self.layout.width + x + 1
    }

    /// Adds to the cost of `node` being on the source's side while its neighbour in a direction is on the sink's.
    /// `cost` is not negative; none may lead to the border that was added.
    #[inline(always)]
    pub fn add_arc(&mut self, node: usize, direction: usize, cost: i32) {
        debug_assert!(cost >= 0, "a capacity of {cost}");
        self.nodes[node].arcs[direction] += cost;
    }
}

impl GraphCut {
    /// Begins a graph of `count` nodes without capacities.
    pub fn reset(&mut self, count: usize) {
        self.layout.arcs.clear();
        self.layout.pairs.clear();
        self.clear(count);
    }

    /// Adds to the costs of `a` being on the source's side while `b` is on the sink's, and the other way round. Neither
    /// is negative; each pair of nodes comes once. Of a node in more than 65,000 pairs the last ones do not count.
    #[inline(always)]
    pub fn add_pair(&mut self, a: usize, b: usize, costs: [i32; 2]) {
        debug_assert!(costs[0] >= 0 && costs[1] >= 0 && a != b, "capacities of {costs:?} between {a} and {b}");
        self.layout.pairs.push(([a as u32, b as u32], costs));
    }

    /// Sorts the pairs in: to be called once all are added, before [`Cut::cut`].
    pub fn connect(&mut self) {
        let Net { arcs, pairs } = &mut self.layout;
        pairs.retain(|([a, b], _)| {
            let ends = [*a as usize, *b as usize];
            let fits = ends.iter().all(|i| self.nodes[*i].arcs[1] < MOST_ARCS);
            ends.iter().filter(|_| fits).for_each(|i| self.nodes[*i].arcs[1] += 1);
            fits
        });
        let mut first = 0;
        for node in &mut self.nodes {
            let count = node.arcs[1];
            node.arcs = [first, first];
            first += count;
        }
        arcs.resize(first as usize, NetArc::default());
        for ([a, b], [there, back]) in pairs.iter() {
            let place = |node: &mut Node<[u32; 2]>| {
                node.arcs[1] += 1;
                (node.arcs[1] - 1, node.arcs[1] - 1 - node.arcs[0])
            };
            let (i, i_number) = place(&mut self.nodes[*a as usize]);
            let (j, j_number) = place(&mut self.nodes[*b as usize]);
            arcs[i as usize] = NetArc { to: *b, back: j_number, open: *there };
            arcs[j as usize] = NetArc { to: *a, back: i_number, open: *back };
        }
    }
}

impl<L: Layout> Cut<L> {
    fn clear(&mut self, count: usize) {
        let arcs = L::Arcs::default();
        self.nodes.clear();
        self.nodes.resize(count, Node { arcs, terminal: 0, distance: 0, stamp: 0, tree: FREE, parent: ORPHAN });
        self.time = 0;
        self.active.clear();
        self.orphans.clear();
    }

    /// Adds to what it costs that a node lies on the sink's side, or, if negative, on the source's.
    #[inline(always)]
    pub fn add_terminal(&mut self, node: usize, cost: i32) {
        let t = &mut self.nodes[node].terminal;
        *t = t.saturating_add(cost);
    }

    #[inline(always)]
    fn beside(&self, node: usize, arc: usize) -> usize {
        self.layout.beside(node, &self.nodes[node].arcs, arc)
    }

    /// What an arc can still take.
    #[inline(always)]
    fn open(&self, node: usize, arc: usize) -> i32 {
        self.layout.open(&self.nodes[node].arcs, arc)
    }

    /// The opposite's number, at the node where an arc leads.
    #[inline(always)]
    fn back(&self, node: usize, arc: usize) -> usize {
        self.layout.back(&self.nodes[node].arcs, arc)
    }

    #[inline(always)]
    fn add(&mut self, node: usize, arc: usize, capacity: i32) {
        self.layout.add(&mut self.nodes[node].arcs, arc, capacity);
    }

    #[inline(always)]
    fn arcs(&self, node: usize) -> std::ops::Range<usize> {
        0..self.layout.count(&self.nodes[node].arcs)
    }

    /// Cuts; afterwards [`Cut::is_sink`] tells the sides.
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
                Some((from, arc)) => {
                    self.time += 1;
                    self.augment(from, arc);
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
            for arc in self.arcs(node) {
                let open = self.open(node, arc);
                if open == 0 {
                    continue;
                }
                let other = self.beside(node, arc);
                let flow = left.min(open).min(-self.nodes[other].terminal);
                if flow > 0 {
                    self.add(other, self.back(node, arc), flow);
                    self.add(node, arc, -flow);
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
        for arc in 0..self.layout.count(&arcs) {
            let (at, back) = (self.layout.beside(node, &arcs, arc), self.layout.back(&arcs, arc));
            let other = &mut self.nodes[at];
            let open = if tree == SOURCE { self.layout.open(&arcs, arc) } else { self.layout.open(&other.arcs, back) };
            if open == 0 {
                continue;
            }
            if other.tree == FREE {
                (other.tree, other.parent) = (tree, back as u16);
                (other.distance, other.stamp) = (distance + 1, stamp);
                self.active.push_back(at as u32);
            } else if other.tree != tree {
                return Some(if tree == SOURCE { (node, arc) } else { (at, back) });
            } else if other.stamp <= stamp && other.distance > distance + 1 && other.parent < TERMINAL {
                other.parent = back as u16;
                (other.distance, other.stamp) = (distance + 1, stamp);
            }
        }
        None
    }

    /// Sends what fits along the path that the arc closes.
    fn augment(&mut self, from: usize, arc: usize) {
        let (to, back) = (self.beside(from, arc), self.back(from, arc));
        let mut flow = self.open(from, arc);
        for (start, side) in [(from, SOURCE), (to, SINK)] {
            let mut node = start;
            while self.nodes[node].parent < TERMINAL {
                let up = self.nodes[node].parent as usize;
                let above = self.beside(node, up);
                let open = if side == SOURCE { self.open(above, self.back(node, up)) } else { self.open(node, up) };
                flow = flow.min(open);
                node = above;
            }
            flow = flow.min(self.nodes[node].terminal.abs());
        }
        self.add(from, arc, -flow);
        self.add(to, back, flow);
        for (start, side) in [(from, SOURCE), (to, SINK)] {
            let mut node = start;
            while self.nodes[node].parent < TERMINAL {
                let up = self.nodes[node].parent as usize;
                let (above, down) = (self.beside(node, up), self.back(node, up));
                let along = if side == SOURCE { -flow } else { flow };
                self.add(above, down, along);
                self.add(node, up, -along);
                let left = if side == SOURCE { self.open(above, down) } else { self.open(node, up) };
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
            let tree = self.nodes[node].tree;
            let mut best: Option<(u32, usize)> = None;
            for arc in self.arcs(node) {
                let at = self.beside(node, arc);
                let open = if tree == SOURCE { self.open(at, self.back(node, arc)) } else { self.open(node, arc) };
                if open == 0 || self.nodes[at].tree != tree {
                    continue;
                }
                if let Some(distance) = self.origin(at)
                    && best.is_none_or(|b| distance < b.0)
                {
                    best = Some((distance, arc));
                }
            }
            match best {
                Some((distance, arc)) => {
                    let (time, node) = (self.time, &mut self.nodes[node]);
                    (node.parent, node.stamp, node.distance) = (arc as u16, time, distance + 1);
                }
                None => self.set_free(node),
            }
        }
    }

    fn set_free(&mut self, node: usize) {
        let tree = self.nodes[node].tree;
        for arc in self.arcs(node) {
            let (at, back) = (self.beside(node, arc), self.back(node, arc));
            if self.nodes[at].tree != tree {
                continue;
            }
            let open = if tree == SOURCE { self.open(at, back) } else { self.open(node, arc) };
            if open > 0 {
                self.active.push_back(at as u32);
            }
            if self.nodes[at].parent == back as u16 {
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
        fn a_node_may_have_many_arcs(seed in 0u64..4) {
            // The middle hangs on the source by less than its arcs carry off; each leaf is cut off where that is cheaper.
            let key = crate::numerics::rng::Key::new(seed);
            let costs: Vec<[i32; 2]> = (0..700).map(|i| [0, 1].map(|j| key.with(j).below(i, 9) as i32)).collect();
            let mut cut = GraphCut::default();
            cut.reset(701);
            cut.add_terminal(0, 1_000_000);
            for (i, [terminal, arc]) in costs.iter().enumerate() {
                cut.add_terminal(i + 1, -terminal);
                cut.add_pair(0, i + 1, [*arc, 0]);
            }
            cut.connect();
            cut.cut();
            for (i, [terminal, arc]) in costs.iter().enumerate() {
                prop_assert_eq!(cut.is_sink(i + 1), terminal > arc, "leaf {}", i);
            }
        }

        #[test]
        fn any_graph_is_cut_as_the_same_grid(
            terminals in proptest::collection::vec(-6i32..7, 30),
            arcs in proptest::collection::vec(0i32..5, 120),
        ) {
            let size = [6, 5];
            let sides = solve(&mut GridCut::default(), size, &terminals, &arcs);
            let mut cut = GraphCut::default();
            for _ in 0..2 {
                cut.reset(30);
                (0..30).for_each(|i| cut.add_terminal(i, terminals[i]));
                for (x, y) in (0..5).flat_map(|y| (0..6).map(move |x| (x, y))) {
                    let i = y * 6 + x;
                    for (d, j, inside) in [(2, i + 1, x < 5), (3, i + 6, y < 4)] {
                        if inside {
                            cut.add_pair(i, j, [arcs[i * 4 + d], arcs[j * 4 + 3 - d]]);
                        }
                    }
                }
                cut.connect();
                cut.cut();
                let ours: Vec<bool> = (0..30).map(|i| cut.is_sink(i)).collect();
                prop_assert_eq!(&ours, &sides);
            }
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
