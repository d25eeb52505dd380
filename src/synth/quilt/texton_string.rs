//! Texton strings: what lies along finished edges, and where in the exemplar the like is found.
//!
//! Source: \[MK03\] section 3.2.2, figures 3 and 4, Eq. 2.
//! Reads as: Eq. 2 and the counting loop call the labels S_r, the text calls them S_t; they are the same list. Offsets may
//! lead out of the texture: such places are no candidates (the piece must lie inside as a whole), so nothing is counted
//! there. Edges are sampled at their middles of steps of about a texel. Votes are taken from at most [`VOTERS`] samples of
//! a long string, evenly spaced: windows of neighbouring samples overlap nearly as a whole, and ranking uses all of them.
//! Places are whole texels away from a base, so that they keep its sub-texel part: of a continued neighbour the string is
//! found exactly.
//! Unaware of: meshes; which candidates there are besides.

use std::ops::Range;

use wide::u8x16;

use crate::exemplar::TextonMap;
use crate::numerics::rng::Key;
use crate::numerics::vec::{Vec2, vec2};

/// Most samples of a string that vote. With 64, for more than twice the time, the published method's edges differ by 1 to
/// 2 % less (basket, wicker).
pub const VOTERS: usize = 16;

/// Counts in a register.
const LANES: usize = 16;

/// Places of which the most votes are noted in one register, by which most places are passed over.
const RUN: usize = 8 * LANES;

/// Places of which the most votes in each lane tell how many a place needs.
const BLOCK: usize = 8 * RUN;

/// Bits of a place's rank among those with as many votes.
const RANK_BITS: u32 = 27;

/// A point of a finished edge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Offset from the origin of the piece to be placed, in its texture space: S_o.
    pub offset: Vec2,
    /// Label of the texel that the neighbour shows there, as seen in the piece's orientation: S_t.
    pub label: u16,
    /// That texel, row by row.
    pub texel: u32,
}

/// Where the origin of a piece may lie: inclusive, in texels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inside {
    /// Least coordinates.
    pub low: Vec2,
    /// Greatest coordinates.
    pub high: Vec2,
}

impl Inside {
    /// For a piece that takes the box `low..high` around its origin: the outer texel centres bound it.
    pub fn new(size: [u32; 2], (low, high): (Vec2, Vec2)) -> Self {
        let [w, h] = size.map(f64::from);
        Inside { low: vec2(0.5 - low.x, 0.5 - low.y), high: vec2(w - 0.5 - high.x, h - 0.5 - high.y) }
    }

    /// True if there is no room at all.
    pub fn is_empty(&self) -> bool {
        self.low.x > self.high.x || self.low.y > self.high.y
    }

    /// True if the piece lies inside.
    pub fn contains(&self, at: Vec2) -> bool {
        self.low.x <= at.x && at.x <= self.high.x && self.low.y <= at.y && at.y <= self.high.y
    }

    /// The nearest place inside that is whole texels away, or the nearest one at all if there is none.
    pub fn nearest(&self, at: Vec2) -> Vec2 {
        let along = |at: f64, low: f64, high: f64| {
            let whole = if at < low {
                at + (low - at).ceil()
            } else if at > high {
                at - (at - high).ceil()
            } else {
                at
            };
            if low <= whole && whole <= high { whole } else { at.max(low).min(high) }
        };
        vec2(along(at.x, self.low.x, self.high.x), along(at.y, self.low.y, self.high.y))
    }

    /// A random place: draws 0 and 1 of a key.
    pub fn random(&self, key: Key) -> Vec2 {
        let along = |i, low: f64, high: f64| low + key.unit(i) * (high - low);
        vec2(along(0, self.low.x, self.high.x), along(1, self.low.y, self.high.y))
    }
}

/// Texel that holds a position inside the exemplar.
#[inline]
pub fn texel_at(size: [u32; 2], at: Vec2) -> u32 {
    let x = (at.x as i32).clamp(0, size[0] as i32 - 1) as u32;
    let y = (at.y as i32).clamp(0, size[1] as i32 - 1) as u32;
    y * size[0] + x
}

/// Number of samples of an edge of so many texels.
pub fn steps(length: f64) -> u32 {
    length.clamp(1.0, 1e4).round() as u32
}

/// Error of a piece at `origin`: the sum over its string of the squared distances of textons, Eq. 2. Stops where the sum
/// reaches `limit`: what it returns then is at least that.
pub fn error(map: &TextonMap, string: &[Sample], origin: Vec2, limit: u64) -> u64 {
    let (size, labels) = ([map.width(), map.height()], map.labels(0));
    let at = |s: &Sample| labels[texel_at(size, origin + s.offset) as usize];
    up_to(limit, string, |s| map.distance(s.label, at(s)))
}

/// A string as it is compared from many places that are whole texels apart.
pub struct WholeSteps {
    /// Distance in texels, row by row, from the texel of the origin, and where the label's row of distances begins.
    samples: Vec<(i32, u32)>,
}

impl WholeSteps {
    /// For places with the sub-texel part of `base`.
    pub fn new(map: &TextonMap, string: &[Sample], base: Vec2) -> Self {
        let part = fraction(base);
        let step = |s: &Sample| {
            let o = part + s.offset;
            (o.y.floor() as i32 * map.width() as i32 + o.x.floor() as i32, u32::from(s.label) * map.count())
        };
        WholeSteps { samples: string.iter().map(step).collect() }
    }

    /// As [`error`] of a piece inside the exemplar.
    pub fn error(&self, map: &TextonMap, origin: Vec2, limit: u64) -> u64 {
        let labels = map.labels(0);
        let first = origin.y.floor() as i32 * map.width() as i32 + origin.x.floor() as i32;
        // Rounding may lead out by one.
        let label = |by: i32| u32::from(labels[(first + by).clamp(0, labels.len() as i32 - 1) as usize]);
        up_to(limit, &self.samples, |s| map.distances()[(s.1 + label(s.0)) as usize])
    }
}

/// The sub-texel part of a place.
fn fraction(at: Vec2) -> Vec2 {
    vec2(at.x - at.x.floor(), at.y - at.y.floor())
}

/// As [`error`], by the texels' own vectors instead of their clusters'. Turned neighbours are compared as they lie.
pub fn fine_error(map: &TextonMap, string: &[Sample], origin: Vec2, limit: u64) -> u64 {
    let size = [map.width(), map.height()];
    up_to(limit, string, |s| {
        let texel = texel_at(size, origin + s.offset);
        if texel == s.texel { 0 } else { map.points().squared_distance(texel, s.texel) }
    })
}

/// The sum over a string, or some part of it that reaches `limit`.
fn up_to<S>(limit: u64, string: &[S], distance: impl Fn(&S) -> u32) -> u64 {
    let mut sum = 0;
    for s in string {
        sum += u64::from(distance(s));
        if sum >= limit {
            break;
        }
    }
    sum
}

/// Memory for counting votes, used again and again.
#[derive(Default)]
pub struct Ballot {
    counts: Vec<u8>,
    /// The most votes in each lane of each run.
    maxima: Vec<u8x16>,
    /// Places found, as numbers that sort by votes (the most first), by rank among equals ([`RANK_BITS`]) and by place (32
    /// bits).
    found: Vec<u64>,
}

impl Ballot {
    /// The `most` places with the most votes for a string, at least one each, best first; `base` gives the sub-texel part,
    /// `key` the order of equals. N of \[MK03\] 3.2.2. The box of the piece that lies `inside` holds its origin and the
    /// string.
    pub fn best(
        &mut self,
        map: &TextonMap,
        string: &[Sample],
        inside: &Inside,
        base: Vec2,
        most: usize,
        key: Key,
    ) -> Vec<Vec2> {
        let part = fraction(base);
        // Whole places within the room: origin = first + (column, row) + part.
        let first = [(inside.low.x - part.x).ceil() as i32, (inside.low.y - part.y).ceil() as i32];
        let last = [(inside.high.x - part.x).floor() as i32, (inside.high.y - part.y).floor() as i32];
        if string.is_empty() || most == 0 || last[0] < first[0] || last[1] < first[1] {
            return vec![];
        }
        let (w, h) = ((last[0] - first[0] + 1) as usize, (last[1] - first[1] + 1) as usize);
        let stride = map.width() as usize;
        let origin = self.count(map, string, part) + first[1] as usize * stride + first[0] as usize;
        // Rows of places lie a row of the exemplar apart; what was counted between and after them has no room.
        let end = origin + (h * stride).next_multiple_of(BLOCK);
        for row in 0..h {
            let from = origin + row * stride;
            let to = if row + 1 < h { from + stride } else { end };
            self.counts[from + w..to].fill(0);
        }
        self.select(origin..end, most);
        let place = |i: u64| [i as u32 as usize % stride, i as u32 as usize / stride];
        for f in &mut self.found {
            let [x, y] = place(*f);
            *f |= u64::from(key.bits((y * w + x) as u64) as u32 >> (32 - RANK_BITS)) << 32;
        }
        if self.found.len() > most {
            self.found.select_nth_unstable(most);
            self.found.truncate(most);
        }
        self.found.sort_unstable();
        let at =
            |[x, y]: [usize; 2]| vec2(f64::from(first[0] + x as i32) + part.x, f64::from(first[1] + y as i32) + part.y);
        self.found.iter().map(|f| at(place(*f))).collect()
    }

    /// Counts the votes for every whole place; returns which of the counts is that of the exemplar's first texel.
    ///
    /// Votes for places beyond a side come to lie beyond the other one. No place with room is among them: a piece has room
    /// where all its samples, which are within its bounds, lie inside.
    fn count(&mut self, map: &TextonMap, string: &[Sample], part: Vec2) -> usize {
        let texels = map.labels(0).len();
        let stride = string.len().div_ceil(VOTERS);
        let back = |s: &Sample| {
            let o = part + s.offset;
            (s.label, o.y.floor() as i32 * map.width() as i32 + o.x.floor() as i32)
        };
        let voters = || string.iter().skip(stride / 2).step_by(stride).map(back);
        let (least, greatest) = voters().fold((0, 0), |(l, g): (i32, i32), (_, by)| (l.min(by), g.max(by)));
        self.counts.clear();
        self.counts.resize((greatest - least) as usize + texels + map.width() as usize + BLOCK, 0);
        for (label, by) in voters() {
            let counts = &mut self.counts[(greatest - by) as usize..][..texels];
            for texel in map.bucket(label) {
                let count = &mut counts[*texel as usize];
                *count = count.wrapping_add(1);
            }
        }
        greatest as usize
    }

    /// Votes that the `most` best places have at least: so many lanes of blocks have a place with as many votes that no
    /// place with fewer is needed. Notes the most votes of each lane of runs.
    fn least(&mut self, range: Range<usize>, most: usize) -> u8 {
        // A histogram for each lane: none waits for the one before.
        let mut highest = [[0u32; VOTERS + 1]; LANES];
        self.maxima.clear();
        for block in self.counts[range].chunks_exact(BLOCK) {
            let of_run = |run: &[u8]| run.as_chunks().0.iter().fold(u8x16::ZERO, |max, row| max.max(u8x16::new(*row)));
            let runs = block.chunks_exact(RUN).map(of_run);
            self.maxima.extend(runs);
            let last = &self.maxima[self.maxima.len() - BLOCK / RUN..];
            let max = last.iter().fold(u8x16::ZERO, |max, run| max.max(*run));
            for (highest, n) in highest.iter_mut().zip(max.to_array()) {
                highest[usize::from(n)] += 1;
            }
        }
        let lanes = |n: u8| highest.iter().map(|h| h[usize::from(n)] as usize).sum::<usize>();
        let (mut least, mut so_many) = (VOTERS as u8, lanes(VOTERS as u8));
        while least > 1 && so_many < most {
            least -= 1;
            so_many += lanes(least);
        }
        least
    }

    /// Leaves in `found` the places of a range of counts, counted from its start and not ranked yet, that have as many votes
    /// as the `most` best.
    fn select(&mut self, range: Range<usize>, most: usize) {
        let mut least = self.least(range.clone(), most);
        // It rises as more is seen.
        let (mut above, mut with) = (0, [0; VOTERS + 1]);
        let first = |n: u8| ((VOTERS as u64) - u64::from(n)) << (32 + RANK_BITS);
        self.found.clear();
        let counts = &self.counts[range];
        for (run, max) in self.maxima.iter().enumerate() {
            if with_votes(*max, least) == 0 {
                continue;
            }
            for from in (run * RUN..(run + 1) * RUN).step_by(4 * LANES) {
                let (rows, _) = counts[from..from + 4 * LANES].as_chunks();
                let mut hits = (0..4).fold(0, |hits, r| hits | with_votes(u8x16::new(rows[r]), least) << (LANES * r));
                while hits != 0 {
                    let place = from + hits.trailing_zeros() as usize;
                    hits &= hits - 1;
                    let n = counts[place];
                    self.found.push(first(n) | place as u64);
                    with[usize::from(n)] += 1;
                    above += usize::from(n > least);
                }
                while above >= most {
                    least += 1;
                    above -= with[usize::from(least)];
                }
            }
        }
        self.found.retain(|f| *f < first(least - 1));
    }
}

/// The lanes with at least so many votes, a bit each.
#[inline]
fn with_votes(counts: u8x16, least: u8) -> u64 {
    counts.max(u8x16::splat(least)).simd_eq(counts).to_bitmask().into()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::exemplar::{TextonParams, analyse_textons};
    use crate::texture::{MapKind, MapSet, Texture};
    use proptest::prelude::*;

    fn textons() -> TextonMap {
        let noise = |x: u32, y: u32| Key::new(5).with(u64::from(x / 2)).unit(u64::from(y / 3)) as f32;
        let t = Texture::from_fn(30, 24, 1, |x, y, out| out[0] = noise(x, y));
        let maps = MapSet::new(vec![(MapKind::Height, t)]);
        analyse_textons(&maps, &TextonParams { window: 5, ..TextonParams::default() }).unwrap().0
    }

    fn string(map: &TextonMap, at: Vec2, offsets: &[(f64, f64)]) -> Vec<Sample> {
        let sample = |&(x, y): &(f64, f64)| {
            let texel = texel_at([30, 24], at + vec2(x, y));
            Sample { offset: vec2(x, y), label: map.labels(0)[texel as usize], texel }
        };
        offsets.iter().map(sample).collect()
    }

    /// Votes by trying every place.
    fn naive(map: &TextonMap, s: &[Sample], inside: &Inside, part: Vec2) -> Vec<(usize, Vec2)> {
        let mut out = vec![];
        for y in -40..40 {
            for x in -40..40 {
                let at = vec2(f64::from(x), f64::from(y)) + part;
                if inside.contains(at) {
                    let hits =
                        s.iter().filter(|s| map.labels(0)[texel_at([30, 24], at + s.offset) as usize] == s.label);
                    out.push((hits.count(), at));
                }
            }
        }
        out
    }

    proptest! {
        #[test]
        fn votes_are_those_of_trying_every_place(
            offsets in prop::collection::vec((-3.0..4.0f64, -2.0..5.0f64), 1..=VOTERS), x in 4.0..25.0f64, y in 3.0..18.0f64,
        ) {
            let map = textons();
            let inside = Inside::new([30, 24], (vec2(-3.0, -2.0), vec2(4.0, 5.0)));
            let base = vec2(x, y);
            let s = string(&map, base, &offsets);
            let part = vec2(x - x.floor(), y - y.floor());
            let mut truth = naive(&map, &s, &inside, part);
            truth.retain(|t| t.0 > 0);
            let votes = |at: Vec2| truth.iter().find(|t| (t.1 - at).length() < 1e-9).map(|t| t.0);
            let mut all: Vec<usize> = truth.iter().map(|t| t.0).collect();
            all.sort_unstable_by(|a, b| b.cmp(a));
            let found = Ballot::default().best(&map, &s, &inside, base, 12, Key::new(1));
            let got: Vec<usize> = found.iter().map(|at| votes(*at).expect("a place inside")).collect();
            prop_assert_eq!(&got[..], &all[..all.len().min(12)]);
            prop_assert_eq!(got[0], s.len(), "the place it was taken from has all votes");
            prop_assert_eq!(error(&map, &s, base, u64::MAX), 0);
            let whole = WholeSteps::new(&map, &s, base);
            for at in &found {
                prop_assert_eq!(whole.error(&map, *at, u64::MAX), error(&map, &s, *at, u64::MAX));
            }
            prop_assert_eq!(fine_error(&map, &s, base, u64::MAX), 0);
        }
    }

    #[test]
    fn eq_2_sums_the_distances_of_labels() {
        let map = textons();
        let s = string(&map, vec2(10.2, 10.7), &[(0.0, 0.0), (3.4, -1.0), (-2.0, 2.2)]);
        let at = vec2(15.5, 9.5);
        let one = |s: &Sample| {
            let p = at + s.offset;
            map.distance(map.labels(0)[p.y as usize * 30 + p.x as usize], s.label)
        };
        assert_eq!(error(&map, &s, at, u64::MAX), s.iter().map(|s| u64::from(one(s))).sum::<u64>());
        assert_eq!(error(&map, &s, at, 1), s.iter().map(|s| u64::from(one(s))).find(|e| *e > 0).unwrap_or(0));
    }

    #[test]
    fn a_piece_without_room_has_no_place() {
        let map = textons();
        let inside = Inside::new([30, 24], (vec2(-20.0, 0.0), vec2(20.0, 1.0)));
        assert!(inside.is_empty());
        let s = string(&map, vec2(10.0, 10.0), &[(0.0, 0.0)]);
        assert!(Ballot::default().best(&map, &s, &inside, vec2(10.0, 10.0), 5, Key::new(1)).is_empty());
    }
}
