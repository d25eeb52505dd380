//! Moves that give a part of a graph on a surface to another patch, the part being chosen by a minimum cut.
//!
//! What `image::window` is for pixels: expansion moves (Boykov, Veksler, Zabih 2001) within a window. A patch is an
//! address that continues from node to node along the edges' offsets; within a window, whose nodes are laid out in the
//! plane of the exemplar from its middle on, it is a shift of that plane. Minimised over a window is the sum over its
//! edges of what it costs that the address of one end does not continue that of the other,
//!
//! ```text
//! JUMP (less for shifts below a texel) + d(a, b continued to a's node) + d(a continued to b's node, b)
//! ```
//!
//! and over its nodes of overuse of the exemplar. Where the surface is curved, layouts do not close and shifts are patches
//! only nearly; the cut is found as if they were, and taken if the true sum falls, so it never rises.
//! Unaware of: levels, how windows are chosen, positions in space.

use super::hierarchy::Graph;
use super::room::Room;
use super::walk::shifted;
use crate::exemplar::JumpMap;
use crate::numerics::mincut::GraphCut;
use crate::numerics::vec::{Vec2, vec2};
use crate::synth::seam_metric::{Metric, Sample, UNIT};
use crate::synth::usage::Usage;
use crate::texture::{Texel, texel};

/// What it costs in itself that an address does not continue its neighbour's: as on images, over twice the edges per node.
const JUMP: f32 = 0.1;

/// Shifts below this many texels cost a share of [`JUMP`]: such a seam is a slight stretch.
const FULL_JUMP: f32 = 0.5;

/// Addresses this near each other, in texels, are the same patch.
const SAME: f32 = 0.02;

/// Cost of an edge neither of whose ends has anything at the other's place.
const NOTHING_IN_COMMON: i32 = (20.0 * UNIT) as i32;

/// What all windows of a level share.
pub(super) struct Scene<'a> {
    pub jumps: &'a JumpMap,
    pub metric: &'a Metric,
    pub graph: &'a Graph,
    pub rooms: &'a [Room],
    pub addresses: &'a [Texel],
    pub usage: &'a Usage<'a>,
    /// Most patches of the window that are tried.
    pub present: usize,
    /// Most new patches that are tried.
    pub fresh: usize,
}

/// Two nodes of the window or its ring; the first may change.
#[derive(Clone, Copy)]
struct Pair {
    i: usize,
    j: usize,
    /// Offset from the first to the second.
    d: Vec2,
    /// True if the second is where the layout expects it.
    flat: bool,
}

/// What a node shows or would show.
#[derive(Clone, Copy)]
struct Shown {
    at: Texel,
    sample: Option<Sample>,
}

/// What the patch of a pair's one end shows at the other, once somebody asked.
type Across = Option<Option<Sample>>;

/// What the first end's patch shows at the second, and the second's at the first: as it is, and of the candidate.
#[derive(Clone, Copy, Default)]
struct Seen {
    own: [Across; 2],
    candidate: [Across; 2],
}

/// Memory that is used again from window to window.
#[derive(Default)]
pub(super) struct Scratch {
    cut: GraphCut,
    /// Nodes of the window, then its ring.
    nodes: Vec<u32>,
    /// Sorted nodes of the ring and their numbers.
    ring: Vec<u32>,
    pairs: Vec<Pair>,
    /// Of each pair.
    seen: Vec<Seen>,
    /// Where the layout puts each node.
    layout: Vec<Vec2>,
    own: Vec<Shown>,
    candidate: Vec<Shown>,
    /// Whether it is known what the candidate shows.
    looked: Vec<bool>,
    free: Vec<bool>,
    /// What each pair costs as it is.
    costs: Vec<i32>,
    /// What each would cost after the move in work.
    after: Vec<i32>,
    votes: Vec<(i32, i32, u32)>,
}

/// Improves a window: the nodes of `open`, a connected set whose first is its middle; `number_of` tells a node's place in
/// `open`, if it is there. Returns the nodes whose address changed.
pub(super) fn improve(
    scene: &Scene,
    open: &[u32],
    number_of: impl Fn(u32) -> Option<usize>,
    s: &mut Scratch,
) -> Vec<(u32, Texel)> {
    lay_out(scene, open, number_of, s);
    let mut changed = false;
    for patch in candidates(scene, s) {
        changed |= expand(scene, open.len(), patch, s);
    }
    if !changed {
        return vec![];
    }
    let moved = |(v, shown): (&u32, &Shown)| (scene.addresses[*v as usize] != shown.at).then_some((*v, shown.at));
    open.iter().zip(&s.own).filter_map(moved).collect()
}

/// Collects nodes and pairs and lays them out in the plane, from the middle on.
fn lay_out(scene: &Scene, open: &[u32], number_of: impl Fn(u32) -> Option<usize>, s: &mut Scratch) {
    s.nodes.clear();
    s.ring.clear();
    s.pairs.clear();
    for &v in open {
        let outside = scene.graph.edges(v as usize).map(|(w, _)| w as u32).filter(|w| number_of(*w).is_none());
        s.ring.extend(outside);
    }
    s.ring.sort_unstable();
    s.ring.dedup();
    s.nodes.extend(open.iter().chain(&s.ring));
    for (i, &v) in open.iter().enumerate() {
        for (w, d) in scene.graph.edges(v as usize) {
            let inside = number_of(w as u32);
            if inside.is_some_and(|j| j <= i) {
                continue;
            }
            let ring = || open.len() + s.ring.partition_point(|r| (*r as usize) < w);
            s.pairs.push(Pair { i, j: inside.unwrap_or_else(ring), d, flat: true });
        }
    }
    // The window is in the order of a breadth-first search, so one pass reaches nearly all; the rest follow.
    let unknown = vec2(f64::NAN, f64::NAN);
    s.layout.clear();
    s.layout.resize(s.nodes.len(), unknown);
    s.layout[0] = Vec2::ZERO;
    loop {
        let mut reached = false;
        for p in &s.pairs {
            let (a, b) = (s.layout[p.i], s.layout[p.j]);
            match (a.x.is_nan(), b.x.is_nan()) {
                (false, true) => (s.layout[p.j], reached) = (a + p.d, true),
                (true, false) => (s.layout[p.i], reached) = (b - p.d, true),
                _ => {}
            }
        }
        if !reached {
            break;
        }
    }
    for at in s.layout.iter_mut().filter(|at| at.x.is_nan()) {
        *at = Vec2::ZERO;
    }
    for p in &mut s.pairs {
        let gap = s.layout[p.i] + p.d - s.layout[p.j];
        p.flat = gap.x.abs() < f64::from(SAME) && gap.y.abs() < f64::from(SAME);
    }
    s.own.clear();
    s.own.extend(s.nodes.iter().map(|v| shown(scene, scene.addresses[*v as usize])));
    s.candidate.clear();
    s.candidate.extend_from_slice(&s.own);
    s.free.clear();
    s.free.resize(s.nodes.len(), false);
    s.looked.clear();
    s.looked.resize(s.nodes.len(), false);
    s.seen.clear();
    s.seen.resize(s.pairs.len(), Seen::default());
    s.costs.clear();
    s.costs.resize(s.pairs.len(), 0);
    s.after.clear();
    s.after.resize(s.pairs.len(), 0);
    recount(scene, s);
}

fn shown(scene: &Scene, at: Texel) -> Shown {
    Shown { at, sample: scene.metric.sample(at) }
}

/// Notes what each pair costs as it is.
fn recount(scene: &Scene, s: &mut Scratch) {
    for ((p, now), seen) in s.pairs.iter().zip(&mut s.costs).zip(&mut s.seen) {
        let [from_first, from_second] = &mut seen.own;
        *now = cost(scene, p, (&s.own[p.i], from_first), (&s.own[p.j], from_second));
    }
}

/// How far an address is from continuing another.
fn gap(p: &Pair, a: Texel, b: Texel) -> f32 {
    let c = shifted(a, p.d);
    (c.x - b.x).abs().max((c.y - b.y).abs())
}

/// Cost of a pair whose ends show `a` and `b`, each with what it shows at the other end.
fn cost(scene: &Scene, p: &Pair, (a, from_a): (&Shown, &mut Across), (b, from_b): (&Shown, &mut Across)) -> i32 {
    let gap = gap(p, a.at, b.at);
    if gap < SAME {
        return 0;
    }
    let from_b = *from_b.get_or_insert_with(|| scene.metric.sample(shifted(b.at, -p.d)));
    let from_a = *from_a.get_or_insert_with(|| scene.metric.sample(shifted(a.at, p.d)));
    jump(gap) + visible(scene, [a.sample, from_b], [from_a, b.sample])
}

fn jump(gap: f32) -> i32 {
    (JUMP * UNIT * (gap / FULL_JUMP).min(1.0)) as i32
}

/// What is seen of a seam, by what the two patches show at the first node and at the second.
#[inline(always)]
fn visible(scene: &Scene, [a, b]: [Option<Sample>; 2], [c, d]: [Option<Sample>; 2]) -> i32 {
    let difference = |a: Option<Sample>, b: Option<Sample>| Some(scene.metric.difference_of(&a?, &b?));
    match (difference(a, b), difference(c, d)) {
        (Some(first), Some(second)) => first + second,
        (Some(only), None) | (None, Some(only)) => 2 * only,
        (None, None) => NOTHING_IN_COMMON,
    }
}

/// The patches to try, as shifts of the layout: those in the window, most frequent first, then those that jumps at seams
/// lead to.
fn candidates(scene: &Scene, s: &mut Scratch) -> Vec<Vec2> {
    let shift = |s: &Scratch, i: usize, at: Texel| vec2(at.x.into(), at.y.into()) - s.layout[i];
    let whole = |o: Vec2| (o.x.round() as i32, o.y.round() as i32);
    s.votes.clear();
    for i in 0..s.nodes.len() {
        let (x, y) = whole(shift(s, i, s.own[i].at));
        s.votes.push((x, y, i as u32));
    }
    let known = frequent(&mut s.votes, &[], scene.present);
    let mut out: Vec<Vec2> = known.iter().map(|(.., i)| shift(s, *i as usize, s.own[*i as usize].at)).collect();
    if out.len() < 2 {
        return vec![];
    }
    s.votes.clear();
    let mut shifts = vec![];
    let mut last = usize::MAX;
    for (k, p) in s.pairs.iter().enumerate() {
        // Pairs are in order of their first node.
        if p.i == last || s.costs[k] == 0 {
            continue;
        }
        last = p.i;
        let at = s.own[p.i].at;
        let (x, y) = (at.x as u32, at.y as u32);
        for j in scene.jumps.row(x.min(scene.jumps.width() - 1), y.min(scene.jumps.height() - 1)) {
            let to = texel(at.x + (f32::from(j.x) - x as f32), at.y + (f32::from(j.y) - y as f32));
            let o = shift(s, p.i, to);
            let (x, y) = whole(o);
            s.votes.push((x, y, shifts.len() as u32));
            shifts.push(o);
        }
    }
    let fresh = frequent(&mut s.votes, &known, scene.fresh);
    out.extend(fresh.iter().map(|(.., i)| shifts[*i as usize]));
    out
}

/// The most frequent places that are not in `but`, at most `count`, each with the first number that voted for it.
fn frequent(votes: &mut [(i32, i32, u32)], but: &[(i32, i32, u32)], count: usize) -> Vec<(i32, i32, u32)> {
    votes.sort_unstable();
    let same = |a: &(i32, i32, u32), b: &(i32, i32, u32)| (a.0, a.1) == (b.0, b.1);
    let mut counted: Vec<_> = votes.chunk_by(same).map(|c| (c.len(), c[0])).collect();
    counted.retain(|(_, place)| !but.iter().any(|b| same(b, place)));
    counted.sort_unstable_by(|a, b| b.0.cmp(&a.0).then(a.1.2.cmp(&b.1.2)).then(a.1.cmp(&b.1)));
    counted.truncate(count);
    counted.into_iter().map(|c| c.1).collect()
}

/// Gives those nodes to a patch for which the sum is least; true if it fell.
fn expand(scene: &Scene, open: usize, patch: Vec2, s: &mut Scratch) -> bool {
    let mut any = false;
    s.looked.fill(false);
    for i in 0..s.nodes.len() {
        let at = patch + s.layout[i];
        let (a, b) = (s.own[i].at, texel(at.x as f32, at.y as f32));
        s.candidate[i].at = b;
        let new = (a.x - b.x).abs() >= SAME || (a.y - b.y).abs() >= SAME;
        let valid = i < open && new && scene.rooms[s.nodes[i] as usize].contains(b);
        s.free[i] = valid && look(scene, i, &mut s.candidate, &mut s.looked).is_some();
        any |= s.free[i];
    }
    if !any {
        return false;
    }
    load(scene, s);
    s.cut.connect();
    s.cut.cut();
    let mut taken = false;
    for i in 0..open {
        s.free[i] = s.free[i] && s.cut.is_sink(i);
        taken |= s.free[i];
    }
    taken && take(scene, open, s)
}

/// What a candidate shows. It takes a while to see, and of most nobody asks.
fn look(scene: &Scene, i: usize, candidate: &mut [Shown], looked: &mut [bool]) -> Option<Sample> {
    if !std::mem::replace(&mut looked[i], true) {
        candidate[i].sample = scene.metric.sample(candidate[i].at);
    }
    candidate[i].sample
}

/// Sets the capacities of a move.
fn load(scene: &Scene, s: &mut Scratch) {
    let Scratch { cut, nodes, pairs, seen, own, candidate, looked, free, costs, .. } = s;
    cut.reset(nodes.len());
    for i in (0..nodes.len()).filter(|i| free[*i]) {
        cut.add_terminal(i, 2 * (scene.usage.cost_at(candidate[i].at) - scene.usage.cost_at(own[i].at)));
    }
    for ((p, &stay), Seen { own: from_own, candidate: from_new }) in pairs.iter().zip(&*costs).zip(&mut *seen) {
        let (i, j) = (p.i, p.j);
        *from_new = [None; 2];
        if !free[i] && !free[j] {
            continue;
        }
        // Inside one patch both moves compare the same places.
        let within = (stay == 0 && p.flat).then(|| gap(p, own[i].at, candidate[j].at));
        let inside = within.filter(|gap| *gap >= SAME).map_or(0, |gap| {
            let [first, second] = [i, j].map(|k| [own[k].sample, look(scene, k, candidate, looked)]);
            jump(gap) + visible(scene, first, second)
        });
        let ([own_first, own_second], [new_first, new_second]) = (from_own, from_new);
        let (second, first) = if within.is_some() {
            (inside, inside)
        } else {
            let mixed = |a, b| cost(scene, p, a, b);
            let second = if free[j] { mixed((&own[i], own_first), (&candidate[j], new_second)) } else { 0 };
            (second, if free[i] { mixed((&candidate[i], new_first), (&own[j], own_second)) } else { 0 })
        };
        let both = match p.flat || !(free[i] && free[j]) {
            true => 0,
            false => cost(scene, p, (&candidate[i], new_first), (&candidate[j], new_second)),
        };
        match (free[i], free[j]) {
            (true, true) => cut.add_move([i, j], [stay, first, second, both]),
            (true, false) => cut.add_terminal(i, 2 * (first - stay)),
            (false, true) => cut.add_terminal(j, 2 * (second - stay)),
            (false, false) => {}
        }
    }
}

/// Gives the free nodes their candidates, if that lowers the true sum.
fn take(scene: &Scene, open: usize, s: &mut Scratch) -> bool {
    let mut change = 0i64;
    for i in (0..open).filter(|i| s.free[*i]) {
        change += i64::from(scene.usage.cost_at(s.candidate[i].at) - scene.usage.cost_at(s.own[i].at));
    }
    let Scratch { pairs, seen, own, candidate, free, costs, after, .. } = s;
    for (((p, now), after), seen) in pairs.iter().zip(&*costs).zip(&mut *after).zip(&mut *seen) {
        let ([own_first, own_second], [new_first, new_second]) = (&mut seen.own, &mut seen.candidate);
        let first = if free[p.i] { (&candidate[p.i], new_first) } else { (&own[p.i], own_first) };
        let second = if free[p.j] { (&candidate[p.j], new_second) } else { (&own[p.j], own_second) };
        *after = if free[p.i] || free[p.j] { cost(scene, p, first, second) } else { *now };
        change += i64::from(*after - *now);
    }
    if change >= 0 {
        return false;
    }
    std::mem::swap(costs, after);
    for (p, Seen { own, candidate }) in pairs.iter().zip(seen) {
        for end in [0, 1].into_iter().filter(|end| free[[p.i, p.j][*end]]) {
            own[end] = candidate[end];
        }
    }
    for i in (0..open).filter(|i| free[*i]) {
        own[i] = candidate[i];
    }
    true
}
