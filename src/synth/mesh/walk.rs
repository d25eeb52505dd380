//! The walk over the vertices of a mesh that gives each an address in the exemplar.
//!
//! Source: \[ZG03\] 4.2.3 to 4.2.5, figures 5 and 6. At a vertex v every synthesised neighbour w, at address a, with
//! offset d from w to v, puts into one table
//! - its continuation a + d, of weight M / |d|, M = patch x side of the exemplar (geometric mean): the mean distance
//!   between jumps in texels;
//! - the jumps of the fractional look-up at a, destinations shifted by d, with the weights that the look-up gives them.
//!
//! Addresses outside the vertex's room (`super::room`) are left out, and one weighted random choice decides. Destinations
//! suggested by several neighbours are in the table several times: that is what makes them likelier. Reads as:
//! - Border avoidance ("as the actual address approaches an edge, its weight is linearly decreased to zero") is measured
//!   at the continuation in the room of v, over a share of the room's extent. On images this is the paper's rule, one
//!   texel on; on coarse meshes it reaches zero exactly where the address becomes invalid.
//! - The random choice is made as two draws, jump or go on, then which. The first is usually settled by the known
//!   bound on the weight of all jumps, and then nobody looks them up: 98 % of the table is never built. Test
//!   `the_bound_changes_nothing` walks with whole tables and gets the same addresses and jumps.
//! - No valid entry: a random valid address, counted. No synthesised neighbour: the same, counted as a seed.
//!
//! Addresses are f32, sums are made in f64 and rounded once per step: at most 2^-17 texel per edge below 256 texels, so
//! less than a thousandth of a texel along a thousand edges.
//! Unaware of: positions, how offsets were made, corners.

use super::room::{Room, rooms};
use crate::exemplar::{FloatJump, JumpMap};
use crate::mesh::Topology;
use crate::numerics::rng::Key;
use crate::numerics::vec::Vec2;
use crate::synth::Error;
use crate::texture::{Texel, texel};

/// How to walk.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VertexWalkParams {
    /// Mean distance between jumps in exemplar sides, positive; \[ZG02\] uses 1.0 to 1.5.
    pub patch: f64,
    /// Seed of all random choices.
    pub seed: u64,
    /// Share of the valid region within which its borders are avoided, 0..=0.5; \[ZG02\] uses 0.2.
    pub border_band: f64,
}

impl Default for VertexWalkParams {
    fn default() -> Self {
        VertexWalkParams { patch: 1.0, seed: 0, border_band: 0.2 }
    }
}

/// How often the walk did what. The first four sum to the number of vertices.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WalkCounters {
    /// Vertices without a synthesised neighbour: one per component.
    pub seeds: u64,
    /// Vertices that go on from a neighbour.
    pub continuations: u64,
    /// Vertices that jump.
    pub jumps: u64,
    /// Vertices for which no suggestion was valid: a random address.
    pub random_fallbacks: u64,
    /// Suggestions looked at and left out because the vertex's box would not fit.
    pub dropped_invalid: u64,
}

/// The result of a walk.
#[derive(Clone, Debug, PartialEq)]
pub struct Walk {
    /// Address of each vertex in the exemplar: with all its edges' offsets added it stays within the outer texel centres.
    pub address: Vec<Texel>,
    /// How often the walk did what.
    pub counters: WalkCounters,
}

/// Edges shorter than this many texels weigh as if they were this long, so that none of length zero divides by it.
const MIN_LENGTH: f64 = 1e-3;

/// Marks a vertex not yet synthesised.
const EMPTY: Texel = texel(f32::NAN, f32::NAN);

/// Walks the vertices in `order` (each exactly once).
///
/// `offsets[h]` is the offset of half-edge `h` in texels, from the vertex it starts at to its target; the two halves of
/// an edge have opposite offsets. What must fit into the exemplar around a vertex are its edges, or its box of `boxes`
/// (least and greatest offset). Fails if parameters, counts or the order are wrong, an offset is not finite or what
/// must fit does not. Time is linear in the half-edges.
pub fn walk(
    map: &JumpMap,
    topology: &Topology,
    offsets: &[Vec2],
    boxes: Option<&[[Vec2; 2]]>,
    order: &[u32],
    params: &VertexWalkParams,
) -> Result<Walk, Error> {
    check(topology, order, params, [map.width(), map.height()])?;
    let rooms = rooms(topology, offsets, boxes, [map.width(), map.height()])?;
    walk_bounded(map, topology, offsets, &rooms, order, params, greatest_row_sum(map))
}

/// The greatest sum of probabilities of a texel, with some slack for rounding: bounds what a look-up can return.
fn greatest_row_sum(map: &JumpMap) -> f64 {
    let texels = (0..map.height()).flat_map(|y| (0..map.width()).map(move |x| (x, y)));
    let sum = |(x, y)| map.row(x, y).iter().map(|j| f64::from(j.p)).sum::<f64>();
    texels.map(sum).fold(0.0, f64::max) * (1.0 + 1e-5)
}

fn walk_bounded(
    map: &JumpMap,
    topology: &Topology,
    offsets: &[Vec2],
    rooms: &[Room],
    order: &[u32],
    params: &VertexWalkParams,
    row_bound: f64,
) -> Result<Walk, Error> {
    let key = Key::new(params.seed).with_str("vertex walk");
    let vertices = topology.vertex_count();
    let mut address = vec![EMPTY; vertices];
    let mut table = Table::new(map, params, row_bound);
    let mut counters = WalkCounters::default();
    let mut block = Block::default();
    for some in order.chunks(BLOCK) {
        block.gather(some, topology, offsets, &address);
        for &(v, start, end) in &block.vertices {
            if address.get(v as usize).is_none_or(|a| !a.x.is_nan()) {
                return Err(Error::Order { vertex: v, vertices });
            }
            let room = &rooms[v as usize];
            table.clear();
            for (&w, &offset) in block.targets[start..end].iter().zip(&block.offsets[start..end]) {
                table.suggest(address[w as usize], -offset, room, &mut counters);
            }
            address[v as usize] = table.choose(room, key.with(u64::from(v)), &mut counters);
        }
    }
    Ok(Walk { address, counters })
}

/// Vertices gathered at a time: their reads are independent of each other, so cache misses overlap.
const BLOCK: usize = 128;

/// The half-edges of the next vertices, side by side. A million vertices in random memory order: 0.97 us a vertex
/// without this, 0.34 with it; in a tidy order 0.19 and 0.22.
#[derive(Default)]
struct Block {
    /// Vertex and range of its half-edges here.
    vertices: Vec<(u32, usize, usize)>,
    targets: Vec<u32>,
    offsets: Vec<Vec2>,
}

impl Block {
    fn gather(&mut self, order: &[u32], topology: &Topology, offsets: &[Vec2], address: &[Texel]) {
        self.vertices.clear();
        self.targets.clear();
        self.offsets.clear();
        for &v in order {
            let edges = if (v as usize) < topology.vertex_count() { topology.half_edges(v) } else { 0..0 };
            let start = self.targets.len();
            self.vertices.push((v, start, start + edges.len()));
            self.targets.extend(edges.clone().map(|h| topology.target(h)));
            self.offsets.extend_from_slice(&offsets[edges]);
        }
        let mut touched = 0.0;
        for &w in &self.targets {
            touched += address[w as usize].x;
        }
        std::hint::black_box(touched);
    }
}

fn check(topology: &Topology, order: &[u32], params: &VertexWalkParams, size: [u32; 2]) -> Result<(), Error> {
    if !(params.patch > 0.0 && params.patch.is_finite()) {
        return Err(Error::Patch(params.patch));
    }
    if !(0.0..=0.5).contains(&params.border_band) {
        return Err(Error::BorderBand(params.border_band));
    }
    if size.iter().any(|s| !(1..=65535).contains(s)) {
        return Err(Error::ExemplarSize(size));
    }
    if order.len() != topology.vertex_count() {
        let (found, expected) = (order.len(), topology.vertex_count());
        return Err(Error::Count { what: "vertices in the order", found, expected });
    }
    Ok(())
}

/// An address moved by an offset: one rounding.
pub(super) fn shifted(a: Texel, d: Vec2) -> Texel {
    texel((f64::from(a.x) + d.x) as f32, (f64::from(a.y) + d.y) as f32)
}

/// The candidates of one vertex; scratch memory kept from vertex to vertex.
struct Table<'a> {
    map: &'a JumpMap,
    /// Weight of a continuation over an edge of one texel.
    mean_distance: f64,
    border_band: f64,
    /// No look-up returns more weight than this.
    row_bound: f64,
    /// Address of each synthesised neighbour and offset from it.
    known: Vec<(Texel, Vec2)>,
    /// Valid continuations.
    going_on: Vec<(Texel, f64)>,
    /// Valid jumps, once looked up.
    jumps: Vec<FloatJump>,
}

impl<'a> Table<'a> {
    fn new(map: &'a JumpMap, params: &VertexWalkParams, row_bound: f64) -> Self {
        let mean_distance = params.patch * (f64::from(map.width()) * f64::from(map.height())).sqrt();
        let (known, going_on, jumps) = (vec![], vec![], vec![]);
        Table { map, mean_distance, border_band: params.border_band, row_bound, known, going_on, jumps }
    }

    fn clear(&mut self) {
        self.known.clear();
        self.going_on.clear();
        self.jumps.clear();
    }

    /// Takes in a neighbour: its address, unless it is not synthesised yet, and the offset from it.
    #[inline]
    fn suggest(&mut self, a: Texel, d: Vec2, room: &Room, counters: &mut WalkCounters) {
        if a.x.is_nan() {
            return;
        }
        self.known.push((a, d));
        let to = shifted(a, d);
        if room.contains(to) {
            let weight = self.mean_distance / d.length().max(MIN_LENGTH) * room.depth(to, self.border_band);
            self.going_on.push((to, weight));
        } else {
            counters.dropped_invalid += 1;
        }
    }

    /// Draw 0 decides between going on and jumping, draw 1 which; a random address uses draws of its own.
    fn choose(&mut self, room: &Room, draws: Key, counters: &mut WalkCounters) -> Texel {
        if self.known.is_empty() {
            counters.seeds += 1;
            return room.random(draws.with(0));
        }
        let (decision, which) = (draws.unit(0), draws.unit(1));
        let stay: f64 = self.going_on.iter().map(|c| c.1).sum();
        // Rounding is monotone: what holds for the bound holds for any smaller weight of the jumps.
        let most = self.row_bound * self.known.len() as f64;
        if decision * (stay + most) < stay {
            counters.continuations += 1;
            return pick(self.going_on.iter().copied(), which * stay).unwrap_or_default();
        }
        let jump = self.look_up(room, counters);
        if decision * (stay + jump) < stay {
            counters.continuations += 1;
            return pick(self.going_on.iter().copied(), which * stay).unwrap_or_default();
        }
        let jumps = self.jumps.iter().map(|j| (j.to, f64::from(j.weight)));
        if let Some(to) = pick(jumps, which * jump) {
            counters.jumps += 1;
            return to;
        }
        // Nothing but continuations that lie on the very border of the room.
        if let Some(&(to, _)) = self.going_on.first() {
            counters.continuations += 1;
            return to;
        }
        counters.random_fallbacks += 1;
        room.random(draws.with(0))
    }

    /// Fills in the valid jumps of all neighbours; returns their weight.
    fn look_up(&mut self, room: &Room, counters: &mut WalkCounters) -> f64 {
        let mut valid = 0;
        for &(a, d) in &self.known {
            let first = valid;
            self.map.look_up(a, &mut self.jumps);
            for i in first..self.jumps.len() {
                let FloatJump { to, weight } = self.jumps[i];
                let to = shifted(to, d);
                if room.contains(to) {
                    self.jumps[valid] = FloatJump { to, weight };
                    valid += 1;
                } else {
                    counters.dropped_invalid += 1;
                }
            }
            self.jumps.truncate(valid);
        }
        self.jumps.iter().map(|j| f64::from(j.weight)).sum()
    }
}

/// The entry at `r` of the running sum of weights; the last one if rounding carries `r` beyond the end.
fn pick(entries: impl Iterator<Item = (Texel, f64)>, mut r: f64) -> Option<Texel> {
    let mut last = None;
    for (to, weight) in entries {
        last = Some(to);
        r -= weight;
        if r < 0.0 {
            break;
        }
    }
    last
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::exemplar::Jump;
    use crate::mesh::TriMesh;
    use crate::numerics::par;
    use crate::numerics::vec::vec2;
    use crate::synth::mesh::order::region_growing;
    use crate::synth::mesh::sites::Sites;
    use crate::synth::testing::{brute_force_map, flat_offsets, grid, noise, random_offsets, topologies};
    use proptest::prelude::*;

    fn no_jumps(side: u32) -> JumpMap {
        JumpMap::from_rows(side, side, &vec![vec![]; (side * side) as usize])
    }

    fn grow(map: &JumpMap, t: &Topology, offsets: &[Vec2], params: &VertexWalkParams) -> Result<Walk, Error> {
        walk(map, t, offsets, None, &region_growing(t, &[]).unwrap(), params)
    }

    /// Figure 6 in small: a 4 x 4 exemplar, two synthesised neighbours, one texel and two texels away.
    #[test]
    fn the_table_is_that_of_figure_6() {
        let mut rows = vec![vec![]; 16];
        rows[5] = vec![Jump { x: 0, y: 2, p: 0.5 }, Jump { x: 3, y: 3, p: 0.25 }]; // texel (1, 1)
        rows[2] = vec![Jump { x: 1, y: 0, p: 0.25 }]; // texel (2, 0)
        let map = JumpMap::from_rows(4, 4, &rows);
        let known = vec![(texel(1.5, 1.5), vec2(1.0, 0.0)), (texel(2.5, 0.5), vec2(0.0, 2.0))];
        // Continuations (2.5, 1.5) and (2.5, 2.5); jumps (1.5, 2.5), (4.5, 3.5) which is outside, (1.5, 2.5) again.
        let room = Room::new(&[vec2(-1.0, 0.0)], [4, 4]);
        let going_on = vec![(texel(2.5, 1.5), 4.0), (texel(2.5, 2.5), 2.0)];
        let mut table = Table { known, going_on, ..Table::new(&map, &VertexWalkParams::default(), 0.75) };
        let mut counters = WalkCounters::default();
        let mut seen = [0u32; 3];
        for seed in 0..60_000 {
            table.jumps.clear();
            let to = table.choose(&room, Key::new(seed), &mut counters);
            let places = [texel(2.5, 1.5), texel(2.5, 2.5), texel(1.5, 2.5)];
            seen[places.iter().position(|p| *p == to).unwrap()] += 1;
        }
        // Weights 4, 2 and 1/2 + 1/4, of 6.75.
        for (n, weight) in seen.iter().zip([4.0, 2.0, 0.75]) {
            assert!((f64::from(*n) - 60_000.0 * weight / 6.75).abs() < 400.0, "{seen:?}");
        }
        assert_eq!(u64::from(seen[2]), counters.jumps);
        assert_eq!(counters.continuations + counters.jumps, 60_000);
        assert!(counters.dropped_invalid > 0 && counters.random_fallbacks == 0);
    }

    #[test]
    fn without_jumps_a_flat_grid_is_mapped_linearly() {
        let mesh = grid(9, 7, 0.3);
        let t = Topology::new(&mesh);
        let offsets = flat_offsets(&mesh, &t, 2.0);
        for seed in 0..20 {
            let w = grow(&no_jumps(64), &t, &offsets, &VertexWalkParams { seed, ..Default::default() }).unwrap();
            if w.counters.random_fallbacks > 0 {
                continue; // ran into the border
            }
            assert_eq!((w.counters.seeds, w.counters.continuations), (1, 62));
            let (a0, p0) = (w.address[0], mesh.positions[0]);
            for (a, p) in w.address.iter().zip(&mesh.positions) {
                let d = *p - p0;
                assert!((f64::from(a.x - a0.x) - 2.0 * d.x).abs() < 1e-4);
                assert!((f64::from(a.y - a0.y) - 2.0 * d.y).abs() < 1e-4);
            }
            return;
        }
        panic!("every seed ran into the border");
    }

    #[test]
    fn perfect_jumps_give_a_periodic_surface() {
        // Period 4 in a 16 x 16 exemplar: every address must be the linear one modulo 4.
        let rows: Vec<Vec<Jump>> = (0..256u16)
            .map(|i| {
                let (x, y) = (i % 16, i / 16);
                let same = (0..16).map(|j| (x % 4 + 4 * (j % 4), y % 4 + 4 * (j / 4))).filter(|p| *p != (x, y));
                same.map(|(x, y)| Jump { x, y, p: 1.0 / 15.0 }).collect()
            })
            .collect();
        let map = JumpMap::from_rows(16, 16, &rows);
        let mesh = grid(40, 30, 0.2);
        let t = Topology::new(&mesh);
        let w = grow(&map, &t, &flat_offsets(&mesh, &t, 1.25), &VertexWalkParams::default()).unwrap();
        assert!(w.counters.jumps > 10 && w.counters.random_fallbacks == 0, "{:?}", w.counters);
        let near_zero = |v: f64| (v - 4.0 * (v / 4.0).round()).abs() < 1e-3;
        for (a, p) in w.address.iter().zip(&mesh.positions) {
            let d = (*p - mesh.positions[0]) * 1.25;
            assert!(near_zero(f64::from(a.x - w.address[0].x) - d.x), "{a:?}");
            assert!(near_zero(f64::from(a.y - w.address[0].y) - d.y), "{a:?}");
        }
    }

    #[test]
    fn jumps_come_as_often_as_the_patch_says() {
        // All jumps lead to the middle with total probability 1. Strips of one texel per edge, 200 texels of exemplar:
        // from the middle 60 texels at one jump in 200, then ever more.
        let rows = vec![vec![Jump { x: 100, y: 100, p: 1.0 }]; 40_000];
        let map = JumpMap::from_rows(200, 200, &rows);
        let n = 20_000u32;
        // A path: triangles without area keep the neighbours of a line.
        let faces = (0..n - 1).map(|i| [i, i + 1, i + 1]).collect();
        let t = Topology::new(&TriMesh { positions: vec![Default::default(); n as usize], faces });
        let along = |v: u32, w: &u32| vec2(f64::from(*w) - f64::from(v), 0.0);
        let offsets: Vec<Vec2> = (0..n).flat_map(|v| t.neighbours(v).iter().map(move |w| along(v, w))).collect();
        let order: Vec<u32> = (0..n).collect();
        let run = |patch| {
            walk(&map, &t, &offsets, None, &order, &VertexWalkParams { patch, ..Default::default() }).unwrap().counters
        };
        // Patch 1/40: five texels between jumps, the border is hardly seen: one vertex in six jumps (weights 5 and 1).
        let short = run(0.025).jumps as f64 / f64::from(n);
        assert!((short - 1.0 / 6.0).abs() < 0.01, "{short}");
        let long = run(1.0).jumps as f64 / f64::from(n);
        assert!((1.0 / 100.0..1.0 / 40.0).contains(&long), "{long}");
    }

    #[test]
    fn the_bound_changes_nothing() {
        let map = brute_force_map(&noise(24, 20), 1, 3, 2.0);
        let mesh = grid(40, 40, 0.4);
        let t = Topology::new(&mesh);
        let offsets = flat_offsets(&mesh, &t, 0.8);
        let order = region_growing(&t, &[820]).unwrap();
        let rooms = rooms(&t, &offsets, None, [24, 20]).unwrap();
        for seed in 0..5 {
            let p = VertexWalkParams { seed, ..Default::default() };
            let fast = walk(&map, &t, &offsets, None, &order, &p).unwrap();
            let plain = walk_bounded(&map, &t, &offsets, &rooms, &order, &p, f64::INFINITY).unwrap();
            assert_eq!(fast.address, plain.address);
            assert_eq!(fast.counters.jumps, plain.counters.jumps);
            assert!(fast.counters.jumps > 20 && fast.counters.random_fallbacks == 0, "{:?}", fast.counters);
        }
    }

    /// One square at three tessellations: on sites jumps come per area, whatever the triangles; next to nothing is lost.
    #[test]
    fn counters_do_not_depend_on_the_tessellation() {
        let map = brute_force_map(&noise(40, 40), 1, 3, 3.0);
        let jumps = [(31, 6.0), (91, 2.0), (226, 0.8)].map(|(side, scale)| {
            let mesh = grid(side, side, 0.2);
            let t = Topology::new(&mesh);
            let offsets = flat_offsets(&mesh, &t, scale);
            let p = VertexWalkParams::default();
            let (counters, vertices) = match Sites::new(&t, &offsets, 4.0, false) {
                None => (grow(&map, &t, &offsets, &p).unwrap().counters, t.vertex_count()),
                Some(s) => {
                    let order = region_growing(&s.topology, &[]).unwrap();
                    let walked = walk(&map, &s.topology, &s.offsets, Some(&s.boxes), &order, &p).unwrap();
                    (walked.counters, s.vertices.len())
                }
            };
            let c = counters;
            assert_eq!(c.seeds + c.continuations + c.jumps + c.random_fallbacks, vertices as u64);
            assert!(c.seeds == 1 && c.random_fallbacks * 100 < vertices as u64, "{side}: {c:?}");
            assert!(c.dropped_invalid < 12 * vertices as u64, "{side}: {c:?}");
            c.jumps as f64
        });
        assert!(jumps.iter().all(|j| (0.6..1.7).contains(&(j / jumps[0]))), "{jumps:?}");
    }

    #[test]
    fn a_recorded_walk_replays() {
        let map = brute_force_map(&noise(8, 8), 1, 2, 1.5);
        let mesh = grid(4, 3, 0.0);
        let t = Topology::new(&mesh);
        let p = VertexWalkParams { patch: 0.25, seed: 3, ..Default::default() };
        let run = |jobs| par::install(jobs, || grow(&map, &t, &flat_offsets(&mesh, &t, 1.0), &p).unwrap());
        let recorded = run(1);
        assert_eq!(recorded, run(2));
        assert_eq!(recorded, run(8));
        let thousandths: Vec<[i32; 2]> =
            recorded.address.iter().map(|a| [a.x, a.y].map(|c| (c * 1000.0).round() as i32)).collect();
        assert_eq!(thousandths, RECORDED);
    }

    /// Changes of this are changes of output: say so in the change log.
    const RECORDED: [[i32; 2]; 12] = [
        [6000, 3000],
        [3000, 5000],
        [4000, 5000],
        [5000, 5000],
        [6000, 4000],
        [3000, 2000],
        [4000, 2000],
        [7000, 2000],
        [2000, 3000],
        [3000, 3000],
        [4000, 3000],
        [5000, 3000],
    ];

    #[test]
    fn edges_of_length_zero_keep_the_address() {
        let mesh = TriMesh { positions: vec![Default::default(); 4], faces: vec![[0, 1, 2], [1, 3, 2]] };
        let t = Topology::new(&mesh);
        let offsets = vec![Vec2::ZERO; t.half_edge_count()];
        let map = JumpMap::from_rows(4, 4, &vec![vec![Jump { x: 1, y: 1, p: 0.5 }]; 16]);
        let w = grow(&map, &t, &offsets, &VertexWalkParams { seed: 4, ..Default::default() }).unwrap();
        assert!(w.address.iter().all(|a| *a == w.address[0]), "{w:?}");
        assert_eq!(w.counters.continuations, 3);
    }

    #[test]
    fn bad_inputs_are_named() {
        let mesh = grid(3, 3, 0.0);
        let t = Topology::new(&mesh);
        let (map, p) = (no_jumps(16), VertexWalkParams::default());
        let offsets = flat_offsets(&mesh, &t, 1.0);
        let order: Vec<u32> = (0..9).collect();
        let run = |offsets: &[Vec2], order: &[u32], p| walk(&map, &t, offsets, None, order, &p).unwrap_err();
        assert_eq!(run(&offsets, &order, VertexWalkParams { patch: -1.0, ..p }), Error::Patch(-1.0));
        assert_eq!(run(&offsets, &order, VertexWalkParams { border_band: 0.6, ..p }), Error::BorderBand(0.6));
        assert_eq!(run(&offsets[1..], &order, p), Error::OffsetCount { found: 31, expected: 32 });
        let short = Error::Count { what: "vertices in the order", found: 8, expected: 9 };
        assert_eq!(run(&offsets, &order[1..], p), short);
        let twice = [0, 1, 2, 3, 4, 5, 6, 7, 7];
        assert_eq!(run(&offsets, &twice, p), Error::Order { vertex: 7, vertices: 9 });
        let beyond = [0, 1, 2, 3, 4, 5, 6, 7, 9];
        assert_eq!(run(&offsets, &beyond, p), Error::Order { vertex: 9, vertices: 9 });
        let large = flat_offsets(&mesh, &t, 8.0);
        assert_eq!(run(&large, &order, p), Error::BoxTooLarge { vertex: 1, span: [16.0, 8.0], exemplar: [16, 16] });
        let mut nan = offsets.clone();
        nan[t.find(4, 3).unwrap()].x = f64::NAN;
        assert_eq!(run(&nan, &order, p), Error::Offset { from: 4, to: 3 });
        // A box that just fits leaves one address.
        let fits = flat_offsets(&mesh, &t, 7.5);
        assert_eq!(grow(&map, &t, &fits, &p).unwrap().address[4], texel(8.0, 8.0));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]
        #[test]
        fn every_box_fits(seed in 0u64..1000, reach in 0.0f64..3.4, patch in 0.1f64..2.0) {
            let map = brute_force_map(&noise(9, 8), 1, 3, 1.5);
            for (name, t) in topologies() {
                let offsets = random_offsets(&t, reach, seed);
                let w = grow(&map, &t, &offsets, &VertexWalkParams { patch, seed, ..Default::default() }).unwrap();
                let c = w.counters;
                prop_assert_eq!((c.seeds + c.continuations + c.jumps + c.random_fallbacks) as usize, t.vertex_count());
                for v in 0..t.vertex_count() as u32 {
                    let a = w.address[v as usize];
                    let around = t.half_edges(v).map(|h| shifted(a, offsets[h]));
                    for at in around.chain([a]) {
                        prop_assert!((0.5..=8.5).contains(&at.x) && (0.5..=7.5).contains(&at.y), "{} {:?}", name, at);
                    }
                }
            }
        }
    }
}
