//! Nearest neighbours of every point of a set, within the set.
//!
//! Source: the lists are refined as in NN-descent (Dong, Moses, Li 2011), read old, write new, so that no order of
//! threads shows; the first guess compares clusters of similar points (`cluster`).
//! In: points with integer coordinates, a predicate that says which pairs may be neighbours. Out: for each point a list
//! of `k`, nearest first; equal distances in an order that is random but fixed, and another for each point.
//! Coordinates are 16-bit integers, so that distances are exact and the order of a sum cannot matter on any CPU, and
//! eight components cost one subtraction and one multiply-add on plain SSE2 or NEON (`wide`).
//! Unaware of: what the points are, images.

mod cluster;

pub use cluster::{Effort, search};

use super::par;
use wide::{i16x8, i32x4};

/// Greatest distance of a point from the origin: differences of components fit 16 bits, squared distances 31.
pub const RANGE: i16 = 16383;

/// Components are padded with zeros to a multiple of this.
const LANES: usize = 8;

/// Points per parallel task of a refinement.
const TASK: usize = 256;

/// Points with integer coordinates.
#[derive(Clone, Debug, PartialEq)]
pub struct Points {
    dims: usize,
    stride: usize,
    scale: f64,
    data: Vec<i16>,
}

impl Points {
    /// `len` points of `dims` (at least one) components at the origin. One unit of length is `scale` integer steps.
    pub fn new(len: usize, dims: usize, scale: f64) -> Self {
        let stride = dims.max(1).next_multiple_of(LANES);
        Points { dims: dims.max(1), stride, scale, data: vec![0; len * stride] }
    }

    /// Components per point, without the padding.
    pub fn dims(&self) -> usize {
        self.dims
    }

    /// Integer steps per unit of length.
    pub fn scale(&self) -> f64 {
        self.scale
    }

    /// All components, point by point, with the padding.
    pub fn data(&self) -> &[i16] {
        &self.data
    }

    /// Components per point with the padding.
    pub fn stride(&self) -> usize {
        self.stride
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.data.len() / self.stride
    }

    /// True if there are no points.
    pub fn is_empty(&self) -> bool {
        self.data.is_empty()
    }

    /// Leaves only the points that `keep` says, in their order.
    pub fn retain(&mut self, mut keep: impl FnMut(usize) -> bool) {
        let (stride, mut kept) = (self.stride, 0);
        for i in (0..self.len()).filter(|i| keep(*i)).collect::<Vec<_>>() {
            self.data.copy_within(i * stride..(i + 1) * stride, kept * stride);
            kept += 1;
        }
        self.data.truncate(kept * stride);
        self.data.shrink_to_fit();
    }

    /// All components, point by point. The norm of every point must stay within [`RANGE`], the padding zero.
    pub fn data_mut(&mut self) -> &mut [i16] {
        &mut self.data
    }

    /// The components of a point.
    pub fn point(&self, i: u32) -> &[i16] {
        &self.data[i as usize * self.stride..][..self.stride]
    }

    /// A squared integer distance as a distance in the caller's unit of length.
    pub fn length(&self, squared: u32) -> f64 {
        f64::from(squared).sqrt() / self.scale
    }

    /// So many points at the origin, of the same components and scale.
    pub fn empty_like(&self, len: usize) -> Points {
        Points { data: vec![0; len * self.stride], ..*self }
    }

    /// Squared distance of a point from components of another, padded alike.
    #[inline]
    pub fn squared_distance_to(&self, a: u32, other: &[i16]) -> u32 {
        squared_distance(self.point(a), other)
    }

    /// Squared distance of two points.
    pub fn squared_distance(&self, a: u32, b: u32) -> u32 {
        squared_distance(self.point(a), self.point(b))
    }
}

/// Squared distance of two rows of a multiple of eight components.
#[inline]
fn squared_distance(a: &[i16], b: &[i16]) -> u32 {
    let ((a, _), (b, _)) = (a.as_chunks::<LANES>(), b.as_chunks::<LANES>());
    let mut sum = i32x4::ZERO;
    for (a, b) in a.iter().zip(b) {
        let d = i16x8::new(*a) - i16x8::new(*b);
        sum += d.dot(d);
    }
    sum.reduce_add() as u32
}

/// A neighbour as one number that sorts by (distance, a random but fixed rank): 31 bits of squared distance, 32 bits of
/// rank, one bit that says that the entry is new since the last refinement. The rank is a bijection of the neighbour's
/// index that differs for each point: where a sample is flat or repeats exactly, thousands of neighbours tie, and by
/// index all of them would choose the same few in the first row.
mod key {
    pub(super) const NONE: u64 = u64::MAX;
    const FRESH: u64 = 1;
    const MULTIPLIER: u32 = 0x9e37_79b1;
    /// `MULTIPLIER * INVERSE = 1` modulo 2^32.
    const INVERSE: u32 = {
        let mut x = 1u32;
        let mut i = 0;
        while i < 5 {
            x = x.wrapping_mul(2u32.wrapping_sub(MULTIPLIER.wrapping_mul(x)));
            i += 1;
        }
        x
    };

    fn salt(of: u32) -> u32 {
        let h = of.wrapping_mul(0x85eb_ca6b);
        (h ^ (h >> 15)).wrapping_mul(0xc2b2_ae35)
    }

    pub(super) fn rank(of: u32, neighbour: u32) -> u32 {
        let r = (neighbour ^ salt(of)).wrapping_mul(MULTIPLIER);
        r.rotate_left(16)
    }

    #[inline]
    pub(super) fn new(of: u32, neighbour: u32, squared: u32) -> u64 {
        (u64::from(squared) << 33) | (u64::from(rank(of, neighbour)) << 1)
    }

    #[inline]
    pub(super) fn neighbour(of: u32, key: u64) -> u32 {
        ((key >> 1) as u32).rotate_left(16).wrapping_mul(INVERSE) ^ salt(of)
    }

    #[inline]
    pub(super) fn squared(key: u64) -> u32 {
        (key >> 33) as u32
    }

    #[inline]
    pub(super) fn is_fresh(key: u64) -> bool {
        key & FRESH != 0
    }

    /// Inserts a key into a sorted list as fresh, dropping the last, unless it is there already or too far.
    #[inline]
    pub(super) fn offer(list: &mut [u64], key: u64) {
        let last = list.len() - 1;
        if key >= list[last] & !FRESH {
            return;
        }
        let mut at = last;
        while at > 0 && list[at - 1] & !FRESH > key {
            at -= 1;
        }
        if at > 0 && list[at - 1] & !FRESH == key {
            return;
        }
        list.copy_within(at..last, at + 1);
        list[at] = key | FRESH;
    }
}

/// The nearest neighbours of every point.
#[derive(Clone, Debug, PartialEq)]
pub struct Neighbours {
    k: usize,
    keys: Vec<u64>,
}

impl Neighbours {
    /// Neighbours found for a point, nearest first: (index, squared distance). Fewer than `k` if there are no more.
    pub fn row(&self, point: u32) -> impl Iterator<Item = (u32, u32)> + '_ {
        let keys = &self.keys[point as usize * self.k..][..self.k];
        keys.iter().take_while(|k| **k != key::NONE).map(move |k| (key::neighbour(point, *k), key::squared(*k)))
    }

    /// Offers candidates to every list. `candidates(point, lists, out)` appends points to try, found in the lists as
    /// they were before; repetitions cost little. Pairs that are not `allowed` and the point itself are left out.
    pub fn refine(
        &mut self,
        points: &Points,
        allowed: impl Fn(u32, u32) -> bool + Sync,
        candidates: impl Fn(u32, &Lists, &mut Vec<u32>) + Sync,
    ) {
        let old = self.lists();
        self.keys.iter_mut().filter(|k| **k != key::NONE).for_each(|k| *k &= !1);
        let k = self.k;
        par::for_rows(&mut self.keys, TASK * k, |task, keys| {
            let (mut tried, mut proposed, mut batch) = (Tried::new(), vec![], vec![]);
            for (i, list) in keys.chunks_exact_mut(k).enumerate() {
                let point = (task * TASK + i) as u32;
                proposed.clear();
                candidates(point, &old, &mut proposed);
                // Distances of a whole batch at a time: their cache misses then overlap.
                batch.clear();
                batch.extend(proposed.iter().filter(|&&q| q != point && tried.is_new(point, q) && allowed(point, q)));
                for &q in &batch {
                    let squared = points.squared_distance(point, q);
                    if squared <= key::squared(list[k - 1]) {
                        key::offer(list, key::new(point, q, squared));
                    }
                }
            }
        });
    }

    /// The lists without their distances.
    fn lists(&self) -> Lists {
        let (k, keys) = (self.k, &self.keys);
        let ids = par::map(keys.len(), |i| match keys[i] {
            key::NONE => Lists::NONE,
            found => key::neighbour((i / k) as u32, found) | if key::is_fresh(found) { Lists::FRESH } else { 0 },
        });
        Lists { k, ids }
    }
}

/// The neighbours of every point before a refinement.
pub struct Lists {
    k: usize,
    ids: Vec<u32>,
}

impl Lists {
    const FRESH: u32 = 1 << 31;
    const NONE: u32 = u32::MAX;

    /// The neighbours of a point, nearest first, and whether each came with the refinement before this one.
    pub fn row(&self, point: u32) -> impl Iterator<Item = (u32, bool)> + '_ {
        let row = &self.ids[point as usize * self.k..][..self.k];
        row.iter().take_while(|q| **q != Self::NONE).map(|q| (q & !Self::FRESH, q & Self::FRESH != 0))
    }
}

/// Remembers most of the pairs that were tried lately; forgetting one only costs time.
struct Tried(Vec<u64>);

impl Tried {
    fn new() -> Self {
        Tried(vec![u64::MAX; 1024])
    }

    #[inline]
    fn is_new(&mut self, p: u32, q: u32) -> bool {
        let pair = (u64::from(p) << 32) | u64::from(q);
        std::mem::replace(&mut self.0[q as usize % 1024], pair) != pair
    }
}

/// The `k` nearest of one point by comparing it with all others, in the same order: the oracle of the search.
pub fn exhaustive(points: &Points, point: u32, k: usize, allowed: impl Fn(u32, u32) -> bool) -> Vec<(u32, u32)> {
    let mut keys: Vec<u64> = (0..points.len() as u32)
        .filter(|&q| q != point && allowed(point, q))
        .map(|q| key::new(point, q, points.squared_distance(point, q)))
        .collect();
    keys.sort_unstable();
    keys.iter().take(k).map(|&key| (key::neighbour(point, key), key::squared(key))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::rng::Key;

    /// Points that are random, in few places (so that many tie), or both.
    fn points(len: usize, dims: usize, places: u32) -> Points {
        let mut points = Points::new(len, dims, 2.0);
        let (stride, key) = (points.stride(), Key::new(6));
        for (i, row) in points.data_mut().chunks_exact_mut(stride).enumerate() {
            let place = key.with(i as u64).below(0, places);
            for (d, v) in row.iter_mut().take(dims).enumerate() {
                *v = key.with_str("place").with(u64::from(place)).below(d as u64, 8000) as i16 - 4000;
            }
        }
        points
    }

    #[test]
    fn the_points_that_stay_keep_their_order() {
        let mut points = points(5, 3, 100);
        let third = points.point(3).to_vec();
        points.retain(|i| i % 3 == 0);
        assert_eq!((points.len(), points.point(1)), (2, &third[..]));
    }

    #[test]
    fn keys_sort_by_distance_and_give_the_neighbour_back() {
        for (of, q, d) in [(0, 0, 0), (7, 123_456, 1 << 30), (u32::MAX >> 1, 5, 99)] {
            let k = key::new(of, q, d);
            assert_eq!((key::neighbour(of, k), key::squared(k), key::is_fresh(k)), (q, d, false));
        }
        assert!(key::new(1, 900, 4) < key::new(1, 2, 5));
        let first = (0..1000).filter(|of| key::rank(*of, 2) < key::rank(*of, 3)).count();
        assert!((300..700).contains(&first), "of two that tie, either is first for about half of the points: {first}");
    }

    #[test]
    fn offers_keep_the_nearest_once() {
        let mut list = vec![key::NONE; 3];
        for (q, d) in [(1, 50), (2, 40), (1, 50), (3, 60), (4, 10), (5, 70)] {
            key::offer(&mut list, key::new(0, q, d));
        }
        let ids: Vec<u32> = list.iter().map(|k| key::neighbour(0, *k)).collect();
        assert_eq!(ids, [4, 2, 1]);
    }

    #[test]
    fn distances_are_those_of_the_textbook() {
        let p = points(2, 19, 100);
        let naive: i64 = p.point(0).iter().zip(p.point(1)).map(|(a, b)| (i64::from(*a) - i64::from(*b)).pow(2)).sum();
        assert_eq!(i64::from(p.squared_distance(0, 1)), naive);
        assert_eq!(p.length(16), 2.0);
        // The extremes: two points at opposite ends of the range.
        let mut far = Points::new(2, 1, 1.0);
        far.data_mut()[0] = RANGE;
        far.data_mut()[8] = -RANGE;
        assert_eq!(far.squared_distance(0, 1), 32766 * 32766);
    }

    #[test]
    fn the_exact_search_is_the_exhaustive_one() {
        let allowed = |a: u32, b: u32| a.abs_diff(b) > 3;
        for (len, dims, places) in [(1, 1, 1), (5, 2, 5), (32, 8, 1000), (33, 9, 4), (500, 30, 1000), (700, 3, 10)] {
            let p = points(len, dims, places);
            let found = search(&p, 6, Effort::Exact, allowed);
            for i in 0..len as u32 {
                assert_eq!(found.row(i).collect::<Vec<_>>(), exhaustive(&p, i, 6, allowed), "{i} of {len}");
            }
        }
    }

    #[test]
    fn probing_finds_neighbours_and_refining_more() {
        let p = points(5000, 12, 5000);
        let hits = |found: &Neighbours| -> usize {
            let share = |i: u32| {
                let truth = exhaustive(&p, i, 10, |_, _| true);
                found.row(i).filter(|m| truth.contains(m)).count()
            };
            (0..100).map(|i| share(i * 50)).sum()
        };
        let mut found = search(&p, 10, Effort::Probes(12), |_, _| true);
        let before = hits(&found);
        assert!(before > 200, "{before} of 1000");
        found.refine(
            &p,
            |_, _| true,
            |i, lists, out| {
                for (m, _) in lists.row(i) {
                    out.extend(lists.row(m).map(|q| q.0).filter(|q| *q != i));
                }
            },
        );
        let after = hits(&found);
        assert!(after > before + 40, "{before}, then {after} of 1000");
        assert!((0..5000).all(|i| found.row(i).all(|m| m.0 != i)));
    }
}
