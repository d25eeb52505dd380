//! Minimum cuts of small graphs: grids whose nodes have four neighbours, and any others.
//!
//! Source: Goldberg, Tarjan: A New Approach to the Maximum-Flow Problem (1988): flow runs on towards the sink along exact
//! distances. All distances are found anew before each wave of flow (Cherkassky, Goldberg 1997 do so now and then), which
//! on graphs of a few hundred nodes costs less than keeping search trees (Boykov, Kolmogorov 2004): 0.83 s instead of 0.94
//! for a corrected canvas of 768 x 768.
//! In: integer capacities. Out: the nodes on the sink's side of the minimum cut that has fewest of them, which is unique.
//! Unaware of: what is cut.

/// Steps to the four neighbours: up, left, right, down; the opposite of direction d is 3 - d.
pub const DIRECTIONS: [[i32; 2]; 4] = [[0, -1], [-1, 0], [1, 0], [0, 1]];

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
    /// What still comes from the source (positive) or can go to the sink (negative).
    terminal: i32,
    /// Number of arcs on the shortest open way to the sink; [`AWAY`] if there is none.
    distance: u32,
}

/// The distance of nodes from which the sink can't be reached.
const AWAY: u32 = u32::MAX;

/// A graph with capacities; used again from cut to cut.
#[derive(Default)]
pub struct Cut<L: Layout> {
    layout: L,
    nodes: Vec<Node<L::Arcs>>,
    /// The nodes that reach the sink, nearest first.
    reaching: Vec<u32>,
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
    /// is negative; each pair of nodes comes once.
    #[inline(always)]
    pub fn add_pair(&mut self, a: usize, b: usize, costs: [i32; 2]) {
        debug_assert!(costs[0] >= 0 && costs[1] >= 0 && a != b, "capacities of {costs:?} between {a} and {b}");
        self.layout.pairs.push(([a as u32, b as u32], costs));
    }

    /// Adds, doubled, what it costs that two nodes stay (on the source's side), that `a` alone goes, that `b` alone does,
    /// and that both do. Where to go together costs more than to part, it is as if it cost as much.
    #[inline(always)]
    pub fn add_move(&mut self, [a, b]: [usize; 2], [stay, first, second, both]: [i32; 4]) {
        self.add_terminal(a, first - stay + both - second);
        self.add_terminal(b, second - stay + both - first);
        self.add_pair(a, b, [(second + first - stay - both).max(0); 2]);
    }

    /// Sorts the pairs in: to be called once all are added, before [`Cut::cut`].
    pub fn connect(&mut self) {
        let Net { arcs, pairs } = &mut self.layout;
        for [a, b] in pairs.iter().map(|p| p.0) {
            self.nodes[a as usize].arcs[1] += 1;
            self.nodes[b as usize].arcs[1] += 1;
        }
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
        self.nodes.clear();
        self.nodes.resize(count, Node { arcs: L::Arcs::default(), terminal: 0, distance: AWAY });
    }

    /// Adds to what it costs that a node lies on the sink's side, or, if negative, on the source's.
    #[inline(always)]
    pub fn add_terminal(&mut self, node: usize, cost: i32) {
        let t = &mut self.nodes[node].terminal;
        *t = t.saturating_add(cost);
    }

    /// Cuts; afterwards [`Cut::is_sink`] tells the sides.
    pub fn cut(&mut self) {
        while self.find_distances() {
            self.run_on();
        }
    }

    /// True if the node is on the sink's side: all nodes from which the sink can still be reached.
    pub fn is_sink(&self, node: usize) -> bool {
        self.nodes[node].distance != AWAY
    }

    /// Finds all distances to the sink; true if flow is left that can reach it.
    fn find_distances(&mut self) -> bool {
        let Cut { layout, nodes, reaching } = self;
        reaching.clear();
        for (i, node) in nodes.iter_mut().enumerate() {
            node.distance = AWAY;
            if node.terminal < 0 {
                node.distance = 0;
                reaching.push(i as u32);
            }
        }
        let (mut found, mut next) = (false, 0);
        while let Some(&i) = reaching.get(next) {
            next += 1;
            let Node { arcs, distance, .. } = nodes[i as usize];
            for arc in 0..layout.count(&arcs) {
                let from = layout.beside(i as usize, &arcs, arc);
                let node = &mut nodes[from];
                if node.distance == AWAY && layout.open(&node.arcs, layout.back(&arcs, arc)) > 0 {
                    node.distance = distance + 1;
                    found |= node.terminal > 0;
                    reaching.push(from as u32);
                }
            }
        }
        found
    }

    /// Sends all flow that fits along shortest ways towards the sink, the farthest first. What does not fit stays where it got.
    fn run_on(&mut self) {
        let Cut { layout, nodes, reaching } = self;
        for &i in reaching.iter().rev() {
            let Node { mut arcs, terminal: mut left, distance } = nodes[i as usize];
            if left <= 0 || distance == 0 {
                continue;
            }
            for arc in 0..layout.count(&arcs) {
                let open = layout.open(&arcs, arc);
                let to = layout.beside(i as usize, &arcs, arc);
                if open == 0 || nodes[to].distance != distance - 1 {
                    continue;
                }
                let flow = left.min(open);
                let back = layout.back(&arcs, arc);
                nodes[to].terminal = nodes[to].terminal.saturating_add(flow);
                layout.add(&mut nodes[to].arcs, back, flow);
                layout.add(&mut arcs, arc, -flow);
                left -= flow;
                if left == 0 {
                    break;
                }
            }
            (nodes[i as usize].arcs, nodes[i as usize].terminal) = (arcs, left);
        }
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
