//! A sample made to wrap, by a graph cut.
//!
//! Source: \[MST09\] section 1 names Kwatra, Schödl, Essa, Turk, Bobick: Graphcut Textures (2003): copies of the sample are
//! laid over each other, and minimum cuts decide which shows where; old seams may be covered again.
//! In: maps. Out: for each texel of a torus of the same size the texel of the sample that it shows.
//! Reads as: a copy is the sample shifted around the torus, with its own seam where its borders meet. Whatever shows is
//! kept, or replaced by one shifted copy, wherever the seams get less by it (an expansion move, Boykov, Veksler, Zabih
//! 2001); this is done for the copies that agree best with what lies around the seams, until none helps. So there
//! is no region that must come from one copy or another, and the corners where seams cross need no special case.
//! A seam between two texels costs what Kwatra's does: how much the copies differ at either.
//! Unaware of: what the maps show.

use std::collections::BTreeMap;

use super::planes::{Planes, planes};
use crate::numerics::mincut::GraphCut;
use crate::numerics::par;
use crate::numerics::rng::Key;
use crate::texture::{MapKind, MapSet, Texture};

/// Rounds of choosing copies by what lies around the present seams.
const ROUNDS: usize = 3;
/// Copies of a round for each direction.
const COPIES: usize = 5;
/// Texels around the seams in which a copy is compared with what shows.
const SAMPLES: usize = 400;
/// Shifts per side of the torus that are compared.
const SHIFTS: u32 = 64;
/// Integer steps per unit of difference.
const UNIT: f32 = 1024.0;

/// A sample that wraps.
#[derive(Clone, Debug, PartialEq)]
pub struct Seamless {
    /// The texel of the sample that each texel shows, counted row by row.
    pub sources: Vec<u32>,
    /// Mean cost of a texel of the sample's border as it is: how much it differs from what would lie beyond it.
    pub border: f64,
    /// The same total, of the seams that are left, per texel of that border.
    pub seams: f64,
}

impl Seamless {
    /// The maps as they wrap.
    pub fn apply(&self, maps: &MapSet) -> MapSet {
        let moved = |map: &Texture| {
            let channels = map.channels() as usize;
            let texel = |s: &u32| &map.data()[*s as usize * channels..][..channels];
            let data = self.sources.iter().flat_map(texel).copied().collect();
            Texture::from_data(map.width(), map.height(), map.channels(), data)
        };
        MapSet::new(maps.iter().map(|(kind, map)| (kind, moved(map))).collect())
    }
}

/// Makes a sample wrap; `importance` says what counts in seams. The sample's sides are at least 3 texels.
pub fn seamless(maps: &MapSet, importance: &BTreeMap<MapKind, f64>) -> Seamless {
    let mut cutter = Cutter::new(maps, importance);
    let (perimeter, before) = (f64::from(maps.width() + maps.height()), cutter.energy());
    let mut now = before;
    for round in 0..ROUNDS {
        let least = now;
        for copy in cutter.copies(round) {
            now = cutter.expand(copy, now);
        }
        if now == least {
            break;
        }
    }
    let per_texel = |energy: i64| energy as f64 / f64::from(UNIT) / perimeter;
    Seamless { sources: cutter.sources, border: per_texel(before), seams: per_texel(now) }
}

struct Cutter {
    width: u32,
    height: u32,
    planes: Planes,
    sources: Vec<u32>,
    cut: GraphCut,
}

/// Steps to the texels right and below.
const BESIDE: [[u32; 2]; 2] = [[1, 0], [0, 1]];

impl Cutter {
    fn new(maps: &MapSet, importance: &BTreeMap<MapKind, f64>) -> Self {
        let (width, height) = (maps.width(), maps.height());
        let sources = (0..width * height).collect();
        Cutter {
            width,
            height,
            planes: Planes::joined(&planes(maps, importance, true)),
            sources,
            cut: GraphCut::default(),
        }
    }

    /// The texel at some steps right and down, around the torus.
    fn shifted(&self, texel: u32, [dx, dy]: [u32; 2]) -> u32 {
        let (x, y) = (texel % self.width, texel / self.width);
        (y + dy) % self.height * self.width + (x + dx) % self.width
    }

    /// What it costs that texel `b` of the sample shows beside `a`, one step right or down: how much `a` differs from what
    /// the sample has beside `b`, and `b` from what it has beside `a`; where it ends there, the other counts for both.
    fn seam(&self, a: u32, b: u32, [dx, dy]: [u32; 2]) -> i32 {
        let after_a = a % self.width + dx < self.width && a / self.width + dy < self.height;
        let before_b = b % self.width >= dx && b / self.width >= dy;
        let step = dy * self.width + dx;
        if after_a && a + step == b {
            return 0;
        }
        let differ = |i: u32, j: u32| self.planes.squared(i as usize, j as usize).sqrt();
        let sum = match (after_a, before_b) {
            (true, true) => differ(a + step, b) + differ(a, b - step),
            (true, false) => 2.0 * differ(a + step, b),
            (false, true) => 2.0 * differ(a, b - step),
            (false, false) => 2.0 * differ(a, b),
        };
        (sum * UNIT) as i32
    }

    /// The cost of all seams.
    fn energy(&self) -> i64 {
        let texels = self.width * self.height;
        let of =
            |t: u32, d| i64::from(self.seam(self.sources[t as usize], self.sources[self.shifted(t, d) as usize], d));
        (0..texels).map(|t| BESIDE.iter().map(|d| of(t, *d)).sum::<i64>()).sum()
    }

    /// Replaces what shows by a shifted copy where that is cheaper in all; the cost afterwards.
    fn expand(&mut self, shift: [u32; 2], before: i64) -> i64 {
        let texels = self.width * self.height;
        let mut cut = std::mem::take(&mut self.cut);
        cut.reset(texels as usize);
        for t in 0..texels {
            let (kept, new) = (self.sources[t as usize], self.shifted(t, shift));
            for d in BESIDE {
                let u = self.shifted(t, d);
                let (kept_u, new_u) = (self.sources[u as usize], self.shifted(u, shift));
                let [both_kept, new_after, new_before, both_new] =
                    [(kept, kept_u), (kept, new_u), (new, kept_u), (new, new_u)].map(|(a, b)| self.seam(a, b, d));
                cut.add_terminal(t as usize, new_before - both_kept);
                cut.add_terminal(u as usize, both_new - new_before);
                // Where the copies agree better across than either with itself, the cut is only an upper bound.
                let price = (new_after + new_before - both_kept - both_new).max(0);
                if price > 0 {
                    cut.add_pair(t as usize, u as usize, [price, 0]);
                }
            }
        }
        cut.connect();
        cut.cut();
        let moved = |t: u32| if cut.is_sink(t as usize) { self.shifted(t, shift) } else { self.sources[t as usize] };
        let old = (0..texels).map(moved).collect();
        let old = std::mem::replace(&mut self.sources, old);
        self.cut = cut;
        let after = self.energy();
        if after < before {
            return after;
        }
        self.sources = old;
        before
    }

    /// The shifts whose copies agree best with what shows around the seams: some that cover upright borders, some that
    /// cover level ones, no two of them near each other.
    fn copies(&self, round: usize) -> Vec<[u32; 2]> {
        let around = self.around_seams(round);
        let step = |n: u32| n.div_ceil(SHIFTS).max(1) as usize;
        let shifts: Vec<[u32; 2]> = (0..self.height)
            .step_by(step(self.height))
            .flat_map(|y| (0..self.width).step_by(step(self.width)).map(move |x| [x, y]))
            .collect();
        let differences = par::map(shifts.len(), |i| self.difference(shifts[i], &around));
        let mut order: Vec<usize> = (0..shifts.len()).collect();
        order.sort_by(|a, b| differences[*a].total_cmp(&differences[*b]).then(a.cmp(b)));
        let torus = |a: u32, b: u32, n: u32| a.abs_diff(b).min(n - a.abs_diff(b));
        let apart = |a: &[u32; 2], b: &[u32; 2]| {
            torus(a[0], b[0], self.width) > self.width / 16 || torus(a[1], b[1], self.height) > self.height / 16
        };
        let mut out: Vec<[u32; 2]> = Vec::new();
        for (axis, n) in [self.width, self.height].into_iter().enumerate() {
            let before = out.len();
            for shift in order.iter().map(|i| shifts[*i]).filter(|shift| torus(shift[axis], 0, n) >= n / 4) {
                if out.len() < before + COPIES && out.iter().all(|o| apart(o, &shift)) {
                    out.push(shift);
                }
            }
        }
        out
    }

    /// Texels at random places some way off the seams.
    fn around_seams(&self, round: usize) -> Vec<u32> {
        let texels = self.width * self.height;
        let is_seam = |t: &u32| BESIDE.iter().any(|d| self.is_seam(*t, *d));
        let seams: Vec<u32> = (0..texels).filter(is_seam).collect();
        if seams.is_empty() {
            return Vec::new();
        }
        let key = Key::new(round as u64).with_str("around seams");
        let reach = [self.width, self.height].map(|n| (n / 8).max(1));
        let place = |i: usize| {
            let key = key.with(i as u64);
            let seam = seams[key.below(0, seams.len() as u32) as usize];
            let [dx, dy] = [(0, self.width), (1, self.height)].map(|(c, n)| {
                let reach = reach[c as usize];
                (n + key.below(1 + c, 2 * reach + 1) - reach) % n
            });
            self.shifted(seam, [dx, dy])
        };
        (0..SAMPLES).map(place).collect()
    }

    /// Whether a texel and the one right of it or below come from different copies.
    fn is_seam(&self, t: u32, [dx, dy]: [u32; 2]) -> bool {
        let (a, b) = (self.sources[t as usize], self.sources[self.shifted(t, [dx, dy]) as usize]);
        let after_a = a % self.width + dx < self.width && a / self.width + dy < self.height;
        !(after_a && a + dy * self.width + dx == b)
    }

    /// Mean squared difference of a copy from what shows.
    fn difference(&self, shift: [u32; 2], around: &[u32]) -> f32 {
        let squared =
            |t: &u32| self.planes.squared(self.sources[*t as usize] as usize, self.shifted(*t, shift) as usize);
        around.iter().map(squared).fold(0.0, |s, d| s + d) / around.len().max(1) as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn gray(w: u32, h: u32, f: impl Fn(u32, u32) -> f32 + Sync) -> MapSet {
        MapSet::new(vec![(MapKind::Height, Texture::from_fn(w, h, 1, |x, y, out| out[0] = f(x, y)))])
    }

    fn made(maps: &MapSet) -> Seamless {
        seamless(maps, &BTreeMap::from([(MapKind::Height, 1.0)]))
    }

    #[test]
    fn what_wraps_already_stays_as_it_is() {
        let maps = gray(24, 16, |x, y| ((x % 8) * 3 + y % 4) as f32 / 24.0);
        let found = made(&maps);
        assert_eq!(found.seams, 0.0);
        assert_eq!(found.apply(&maps), maps);
    }

    #[test]
    fn a_period_that_fits_is_found_through_a_torn_border() {
        // Stripes of period 8 in 40 texels, but the last 5 columns are spoilt: they are covered by intact ones.
        let stripe = |x: u32| if x % 8 < 4 { 0.2 } else { 0.8 };
        let maps = gray(40, 24, |x, _| if x < 35 { stripe(x) } else { 0.5 });
        let found = made(&maps);
        assert!(found.border > 0.1 && found.seams < 1e-3, "{} {}", found.border, found.seams);
    }

    #[test]
    fn all_maps_are_cut_alike() {
        let height =
            Texture::from_fn(20, 20, 1, |x, y, out| out[0] = Key::new(1).with(u64::from(y)).unit(u64::from(x)) as f32);
        let index = Texture::from_fn(20, 20, 1, |x, y, out| out[0] = (y * 20 + x) as f32);
        let maps = MapSet::new(vec![(MapKind::Height, height), (MapKind::Roughness, index)]);
        let found = made(&maps);
        let cut = found.apply(&maps);
        let [height, index] = [MapKind::Height, MapKind::Roughness].map(|k| cut.get(k).expect("the map"));
        for (h, i) in height.data().iter().zip(index.data()) {
            assert_eq!(*h, maps.get(MapKind::Height).expect("the map").data()[*i as usize]);
        }
        assert!(found.sources.iter().zip(index.data()).all(|(s, i)| *s as f32 == *i));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(16))]
        #[test]
        fn seams_never_cost_more_than_the_border_and_threads_do_not_matter(seed in 0u64..1000) {
            let key = Key::new(seed);
            let maps = gray(21, 17, |x, y| key.with(u64::from(y / 3)).unit(u64::from(x / 4)) as f32);
            let found = par::install(1, || made(&maps));
            prop_assert!(found.seams <= found.border);
            prop_assert_eq!(par::install(3, || made(&maps)), found);
        }
    }
}
