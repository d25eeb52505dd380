//! Correction passes over a walked mesh, from coarse to fine: every vertex looks at all its neighbours and may change
//! its address.
//!
//! Beyond \[ZG03\]; suggested by its section 6 ("extra passes over the mesh, when all neighbours are available to suggest
//! destinations"; "a hierarchical generalization"; "extra sources may be sampled along edges"). Without passes the result
//! is the published method's. Minimised is the sum over all edges of how visible the seam is between the two patches
//! that are blended along it: the difference of what the addresses of its two ends put at its start, middle and end, in
//! relation to the exemplar's local variance there. It is zero where one address continues the other; a jump
//! costs something in itself. As on images, a
//! cost grows with the share by which its part of the exemplar is used more than the rest.
//! A vertex's candidates are those of the walk: continuations and jumps of its neighbours (the jumps of the texel that
//! the neighbour's address lies in), if they are valid for it.
//!
//! Levels: the graphs of `super::hierarchy`, edges up to an eighth of the exemplar, compared in an exemplar
//! blurred by half an edge. The coarsest starts from the walk's addresses, each next from those that continue the patches
//! of the one before. Within a level vertices are visited by colour, no two of one colour adjacent, so nothing depends on
//! threads.
//! Unaware of: positions, how the first addresses were found.

use super::Error;
use super::hierarchy::Graph;
use super::room::{Room, rooms};
use super::seam::{Field, Usage, square};
use super::vertex_walk::shifted;
use crate::exemplar::JumpMap;
use crate::mesh::Topology;
use crate::numerics::par;
use crate::numerics::vec::Vec2;
use crate::texture::{Texel, Texture, texel};

/// Edges of the coarsest level are at most this share of the exemplar's smaller side.
const COARSEST: f64 = 8.0;

/// What a jump over an edge costs in itself, 1 being the difference of places that have nothing in common: blending two
/// patches blurs both, so many small ones are worse than few. Without it seams break up into patches of single vertices;
/// 0.3 and 0.6 did equally well on seven pairs of mesh and exemplar.
const JUMP_COST: f32 = 0.5;

/// Addresses this near each other, in texels, are the same patch.
const SAME: f32 = 0.02;

/// Refines the addresses of a walk by `passes` passes on each level and returns the result; zero passes return them as
/// they are.
///
/// `exemplar` holds the values by which places are compared, any number of channels, finite, of comparable range;
/// `offsets` and `boxes` as for the walk. All addresses stay valid. Fails if a count or size is wrong or the edges around a vertex
/// do not fit into the exemplar.
pub fn refine(
    jumps: &JumpMap,
    exemplar: &Texture,
    topology: &Topology,
    offsets: &[Vec2],
    boxes: Option<&[[Vec2; 2]]>,
    address: &[Texel],
    passes: u32,
) -> Result<Vec<Texel>, Error> {
    let size = [exemplar.width(), exemplar.height()];
    if size != [jumps.width(), jumps.height()] {
        return Err(Error::TextureSize { found: [jumps.width(), jumps.height()], expected: size });
    }
    if address.len() != topology.vertex_count() {
        let (found, expected) = (address.len(), topology.vertex_count());
        return Err(Error::Count { what: "addresses of vertices", found, expected });
    }
    let rooms = rooms(topology, offsets, boxes, size)?;
    if passes == 0 {
        return Ok(address.to_vec());
    }
    let room = |v: u32| rooms[v as usize];
    let mut graphs = vec![Graph::finest(topology, offsets)];
    let coarsest = f64::from(size[0].min(size[1])) / COARSEST;
    loop {
        let next = graphs[graphs.len() - 1].coarser();
        if next.mean_length().is_none_or(|l| l > coarsest) {
            break;
        }
        graphs.push(next);
    }
    // The nodes' addresses, from the walk at first, then from the level above.
    let top = &graphs[graphs.len() - 1];
    let mut nodes: Vec<Texel> = top.vertices.iter().map(|v| room(*v).nearest(address[*v as usize])).collect();
    for (i, graph) in graphs.iter().enumerate().rev() {
        let mut level = Level::new(jumps, exemplar, graph, &room, nodes);
        // As on images: coarse levels are cheap and decide the structure, the finest mends seams.
        for _ in 0..if i > 0 { passes.saturating_mul(2) } else { passes.div_ceil(2) } {
            if level.pass() == 0 {
                break;
            }
        }
        nodes = level.address;
        if i > 0 {
            let continued = |v: usize| {
                let (parent, d) = graph.parents[v];
                room(graphs[i - 1].vertices[v]).nearest(shifted(nodes[parent as usize], d))
            };
            nodes = par::map(graphs[i - 1].len(), continued);
        }
    }
    Ok(nodes)
}

struct Level<'a> {
    jumps: &'a JumpMap,
    field: Field,
    graph: &'a Graph,
    groups: Vec<Vec<u32>>,
    rooms: Vec<Room>,
    address: Vec<Texel>,
    /// True for nodes that have not been looked at since a neighbour changed.
    dirty: Vec<bool>,
    usage: Usage,
}

impl<'a> Level<'a> {
    fn new(
        jumps: &'a JumpMap,
        exemplar: &Texture,
        graph: &'a Graph,
        room: &(impl Fn(u32) -> Room + Sync),
        address: Vec<Texel>,
    ) -> Self {
        // Half an edge of blur, one edge of surroundings; an edge of a texel or less needs none.
        let spacing = graph.mean_length().unwrap_or_default().min(COARSEST * 1024.0).round() as usize;
        let size = [exemplar.width(), exemplar.height()];
        let blur = if spacing > 1 { spacing / 2 } else { 0 };
        Level {
            jumps,
            field: Field::new(exemplar, blur, spacing.max(1)),
            graph,
            groups: graph.groups(),
            rooms: par::map(graph.len(), |v| room(graph.vertices[v])),
            dirty: vec![true; graph.len()],
            usage: Usage::new(size, address.iter().map(|a| place(*a))),
            address,
        }
    }

    /// Looks once at every node whose neighbourhood changed; returns the number of addresses changed.
    fn pass(&mut self) -> usize {
        let mut changes = 0;
        for g in 0..self.groups.len() {
            let group = &self.groups[g];
            let updates = par::map_chunks(group.len(), 256, |some| {
                let mut scratch = Scratch::default();
                let dirty = group[some].iter().map(|v| *v as usize).filter(|v| self.dirty[*v]);
                dirty.map(|v| (v, self.best(v, &mut scratch))).collect::<Vec<_>>()
            });
            for (v, to) in updates.into_iter().flatten() {
                self.dirty[v] = false;
                let from = std::mem::replace(&mut self.address[v], to);
                if from != to {
                    changes += 1;
                    self.usage.moved(place(from), place(to));
                    for (w, _) in self.graph.edges(v) {
                        self.dirty[w] = true;
                    }
                }
            }
        }
        changes
    }

    /// The best address of a node: its present one unless a candidate has less cost.
    fn best(&self, v: usize, scratch: &mut Scratch) -> Texel {
        let own = self.address[v];
        scratch.edges.clear();
        scratch.candidates.clear();
        for (w, d) in self.graph.edges(v) {
            let continuation = shifted(self.address[w], -d);
            scratch.edges.push(Edge { d, continuation });
            scratch.suggest(continuation, &self.rooms[v]);
        }
        if scratch.edges.iter().all(|e| same(e.continuation, own)) {
            return own;
        }
        for (w, d) in self.graph.edges(v) {
            let a = self.address[w];
            let [x, y] = place(a);
            for j in self.jumps.row(x as u32, y as u32) {
                let to = texel(a.x + (f32::from(j.x) - x as f32), a.y + (f32::from(j.y) - y as f32));
                scratch.suggest(shifted(to, -d), &self.rooms[v]);
            }
        }
        self.sample_edges(scratch);
        let Scratch { edges, candidates, theirs, ours } = scratch;
        let (mut best, mut least) = (own, self.cost(own, edges, theirs, ours, f32::INFINITY));
        for &candidate in candidates.iter() {
            let cost = self.cost(candidate, edges, theirs, ours, least);
            if cost < least {
                (best, least) = (candidate, cost);
            }
        }
        best
    }

    /// What the neighbours put at the start, middle and end of each edge.
    fn sample_edges(&self, Scratch { edges, theirs, .. }: &mut Scratch) {
        theirs.clear();
        for e in edges {
            theirs.push_with(&self.field, e.continuation);
            theirs.push_with(&self.field, shifted(e.continuation, e.d * 0.5));
            theirs.push_with(&self.field, shifted(e.continuation, e.d));
        }
    }

    /// What it costs to take the address `at`; gives up once it is no less than `limit`.
    fn cost(&self, at: Texel, edges: &[Edge], theirs: &Samples, ours: &mut Samples, limit: f32) -> f32 {
        let factor = match self.field.index(place(at)) {
            Some(i) => self.usage.factor(i),
            None => return f32::INFINITY,
        };
        ours.clear();
        ours.push_with(&self.field, at);
        let mut sum = 0.0;
        for (e, i) in edges.iter().zip((0..).step_by(3)) {
            if same(e.continuation, at) {
                continue;
            }
            ours.truncate(1);
            ours.push_with(&self.field, shifted(at, e.d * 0.5));
            ours.push_with(&self.field, shifted(at, e.d));
            let (mut seen, mut there) = (0.0, 0);
            for k in 0..3 {
                if let Some(difference) = ours.difference(k, theirs, i + k) {
                    seen += difference;
                    there += 1;
                }
            }
            // An edge that cannot be compared counts as one whose ends have nothing in common.
            sum += JUMP_COST + if there > 0 { seen / there as f32 } else { 1.0 };
            if sum * factor >= limit {
                return limit;
            }
        }
        sum * factor
    }
}

/// The texel that an address lies in.
fn place(a: Texel) -> [i32; 2] {
    [a.x as i32, a.y as i32]
}

fn same(a: Texel, b: Texel) -> bool {
    (a.x - b.x).abs() < SAME && (a.y - b.y).abs() < SAME
}

/// An edge of the node that is looked at.
struct Edge {
    d: Vec2,
    /// What the neighbour's address is at the node.
    continuation: Texel,
}

/// Memory used again from node to node.
#[derive(Default)]
struct Scratch {
    edges: Vec<Edge>,
    candidates: Vec<Texel>,
    theirs: Samples,
    ours: Samples,
}

impl Scratch {
    /// Takes in a candidate that is valid and new.
    fn suggest(&mut self, at: Texel, room: &Room) {
        if room.contains(at) && !self.candidates.iter().any(|c| same(*c, at)) {
            self.candidates.push(at);
        }
    }
}

/// Samples of a field; those outside the exemplar have no sharpness.
#[derive(Default)]
struct Samples {
    values: Vec<[f32; 4]>,
    sharpness: Vec<Option<f32>>,
    quads: usize,
}

impl Samples {
    fn clear(&mut self) {
        self.values.clear();
        self.sharpness.clear();
    }

    fn truncate(&mut self, n: usize) {
        self.values.truncate(n * self.quads);
        self.sharpness.truncate(n);
    }

    fn push_with(&mut self, field: &Field, at: Texel) {
        self.quads = field.quads();
        let sharpness = field.sample(at, &mut self.values);
        self.sharpness.push(sharpness);
        self.values.resize(self.sharpness.len() * self.quads, [0.0; 4]);
    }

    /// Difference of sample `i` and sample `j` of `other`; `None` if one lies outside.
    fn difference(&self, i: usize, other: &Samples, j: usize) -> Option<f32> {
        let (a, b) = (self.sharpness[i]?, other.sharpness[j]?);
        let q = self.quads;
        Some(square(&self.values[i * q..(i + 1) * q], &other.values[j * q..(j + 1) * q]) * a * b)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synth::testing::{blobs, brute_force_map, flat_offsets, grid, noise, random_offsets, topologies};
    use crate::synth::vertex_order::region_growing;
    use crate::synth::vertex_walk::{VertexWalkParams, walk};
    use proptest::prelude::*;

    fn walked(map: &JumpMap, t: &Topology, offsets: &[Vec2], seed: u64) -> Vec<Texel> {
        let order = region_growing(t, &[]).unwrap();
        walk(map, t, offsets, None, &order, &VertexWalkParams { seed, ..Default::default() }).unwrap().address
    }

    /// Squared difference, over all edges, of what both ends put at the middle.
    fn seams(exemplar: &Texture, t: &Topology, offsets: &[Vec2], address: &[Texel]) -> f64 {
        let mut sum = 0.0;
        let (mut a, mut b) = (vec![0.0; exemplar.channels() as usize], vec![0.0; exemplar.channels() as usize]);
        for v in 0..t.vertex_count() as u32 {
            for h in t.half_edges(v) {
                let d = offsets[h] * 0.5;
                exemplar.sample(shifted(address[v as usize], d), crate::texture::Wrap::Clamp, &mut a);
                exemplar.sample(shifted(address[t.target(h) as usize], -d), crate::texture::Wrap::Clamp, &mut b);
                sum += a.iter().zip(&b).map(|(a, b)| f64::from((a - b) * (a - b))).sum::<f64>();
            }
        }
        sum
    }

    #[test]
    fn seams_become_less_visible() {
        let e = blobs(48, 48);
        let map = brute_force_map(&e, 2, 3, 4.0);
        let mesh = grid(40, 40, 0.3);
        let t = Topology::new(&mesh);
        for scale in [0.8, 2.5] {
            let offsets = flat_offsets(&mesh, &t, scale);
            let before = walked(&map, &t, &offsets, 3);
            let after = refine(&map, &e, &t, &offsets, None, &before, 2).unwrap();
            let (a, b) = (seams(&e, &t, &offsets, &before), seams(&e, &t, &offsets, &after));
            assert!(b < 0.8 * a, "{scale}: {a} {b}");
        }
    }

    #[test]
    fn a_wrong_vertex_is_healed() {
        let e = noise(64, 64);
        let map = JumpMap::from_rows(64, 64, &vec![vec![]; 4096]);
        let mesh = grid(10, 10, 0.2);
        let t = Topology::new(&mesh);
        let offsets = flat_offsets(&mesh, &t, 2.0);
        let at = |p: &crate::numerics::vec::Vec3| texel((p.x * 2.0) as f32 + 20.0, (p.y * 2.0) as f32 + 20.0);
        let right: Vec<Texel> = mesh.positions.iter().map(at).collect();
        assert!(refine(&map, &e, &t, &offsets, None, &right, 2).unwrap().iter().zip(&right).all(|(a, b)| same(*a, *b)));
        let mut wrong = right.clone();
        wrong[55] = texel(9.0, 50.0);
        let healed = refine(&map, &e, &t, &offsets, None, &wrong, 2).unwrap();
        assert!(healed.iter().zip(&right).all(|(a, b)| same(*a, *b)));
    }

    #[test]
    fn threads_do_not_change_it_and_no_pass_changes_nothing() {
        let e = blobs(36, 36);
        let map = brute_force_map(&e, 1, 3, 3.0);
        let mesh = grid(45, 40, 0.3);
        let t = Topology::new(&mesh);
        let offsets = flat_offsets(&mesh, &t, 1.0);
        let before = walked(&map, &t, &offsets, 1);
        let run = |jobs, passes| par::install(jobs, || refine(&map, &e, &t, &offsets, None, &before, passes).unwrap());
        assert_eq!(run(1, 1), run(2, 1));
        assert_eq!(run(1, 1), run(8, 1));
        assert_eq!(run(1, 0), before);
    }

    #[test]
    fn wrong_sizes_are_named() {
        let map = JumpMap::from_rows(8, 8, &vec![vec![]; 64]);
        let t = Topology::new(&grid(2, 2, 0.0));
        let offsets = vec![Vec2::ZERO; t.half_edge_count()];
        let other = Error::TextureSize { found: [8, 8], expected: [9, 8] };
        assert_eq!(refine(&map, &noise(9, 8), &t, &offsets, None, &[Texel::default(); 4], 1), Err(other));
        let few = Error::Count { what: "addresses of vertices", found: 3, expected: 4 };
        assert_eq!(refine(&map, &noise(8, 8), &t, &offsets, None, &[Texel::default(); 3], 1), Err(few));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(16))]
        #[test]
        fn every_box_still_fits(seed in 0u64..1000, reach in 0.0f64..3.4) {
            let e = noise(9, 8);
            let map = brute_force_map(&e, 1, 3, 1.5);
            for (name, t) in topologies() {
                let offsets = random_offsets(&t, reach, seed);
                let before = walked(&map, &t, &offsets, seed);
                let after = refine(&map, &e, &t, &offsets, None, &before, 3).unwrap();
                for v in 0..t.vertex_count() as u32 {
                    let room = Room::new(&offsets[t.half_edges(v)], [9, 8]);
                    prop_assert!(room.contains(after[v as usize]), "{} {}", name, v);
                }
            }
        }
    }
}
