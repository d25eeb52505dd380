//! A sample made to wrap, by a graph cut.
//!
//! Source: \[MST09\] section 1 names Kwatra, Schödl, Essa, Turk, Bobick: Graphcut Textures (2003): copies of the sample are
//! laid over each other, and minimum cuts decide which shows where; old seams may be covered again.
//! In: maps. Out: for each texel of a torus of the same size the texel of the sample that it shows.
//! Reads as: a copy is the sample shifted around the torus, with its own seam where its borders meet. Whatever shows is
//! kept, or replaced by one shifted copy, wherever the seams get less by it (an expansion move, Boykov, Veksler, Zabih
//! 2001); this is done for the copies that agree best with what lies around the seams, until none helps. So there
//! is no region that must come from one copy or another, and the corners where seams cross need no special case.
//! Large samples are cut at a lower resolution first, and the cuts then moved within a band at each finer one: 256 x 256
//! texels take a fifth of the time.
//! A seam between two texels costs what Kwatra's does: how much the copies differ at either.
//! Unaware of: what the maps show.

use std::collections::{BTreeMap, BTreeSet};

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
/// Shorter side from which resolutions are halved: a cut takes much longer the more texels there are.
const ENOUGH: u32 = 128;
/// Texels around a cut that finer resolutions may move it over.
const BAND: u32 = 4;
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
    let [width, height] = [maps.width(), maps.height()];
    let mut levels = vec![Level { width, height, planes: planes(maps, importance, true) }];
    while let Some(coarser) = levels.last().and_then(Level::halved) {
        levels.push(coarser);
    }
    // The coarsest decides which copies there are, the finer ones move the cuts between them a little.
    let mut levels = levels.into_iter().rev().map(Cutter::new);
    let mut cutter = levels.next().map(Cutter::decided);
    let mut border = cutter.as_ref().map_or(0, |c| c.border);
    for finer in levels {
        border = finer.border;
        cutter = cutter.map(|coarser| finer.refined(&coarser));
    }
    let sources = cutter.as_ref().map_or_else(Vec::new, |c| c.sources.clone());
    let seams = cutter.map_or(0, |c| c.energy());
    let per_texel = |energy: i64| energy as f64 / f64::from(UNIT) / f64::from(width + height);
    if seams > border {
        return Seamless {
            sources: (0..width * height).collect(),
            border: per_texel(border),
            seams: per_texel(border),
        };
    }
    Seamless { sources, border: per_texel(border), seams: per_texel(seams) }
}

/// The planes of a sample at one resolution.
struct Level {
    width: u32,
    height: u32,
    planes: Vec<Vec<f32>>,
}

impl Level {
    /// Half the resolution, if there are enough texels and they can be halved.
    fn halved(&self) -> Option<Level> {
        let (w, h) = (self.width, self.height);
        if w.min(h) <= ENOUGH || w % 2 == 1 || h % 2 == 1 {
            return None;
        }
        let half = |plane: &Vec<f32>| {
            let at = |x: u32, y: u32| plane[(y * w + x) as usize];
            let mean = |x: u32, y: u32| 0.25 * (at(x, y) + at(x + 1, y) + at(x, y + 1) + at(x + 1, y + 1));
            (0..h / 2).flat_map(|y| (0..w / 2).map(move |x| (2 * x, 2 * y))).map(|(x, y)| mean(x, y)).collect()
        };
        Some(Level { width: w / 2, height: h / 2, planes: self.planes.iter().map(half).collect() })
    }
}

struct Cutter {
    width: u32,
    height: u32,
    planes: Planes,
    sources: Vec<u32>,
    /// The cost of the border as it is.
    border: i64,
    cut: GraphCut,
}

/// Steps to the texels right and below.
const BESIDE: [[u32; 2]; 2] = [[1, 0], [0, 1]];

impl Cutter {
    fn new(Level { width, height, planes }: Level) -> Self {
        let sources = (0..width * height).collect();
        let planes = Planes::joined(&planes);
        let mut cutter = Cutter { width, height, planes, sources, border: 0, cut: GraphCut::default() };
        cutter.border = cutter.energy();
        cutter
    }

    /// Cuts with copies that are chosen by what lies around the seams, until none helps.
    fn decided(mut self) -> Self {
        let everywhere = vec![true; self.sources.len()];
        let mut now = self.border;
        for round in 0..ROUNDS {
            let least = now;
            for copy in self.copies(round) {
                now = self.expand(copy, &everywhere, now);
            }
            if now == least {
                break;
            }
        }
        self
    }

    /// The cuts of half the resolution, moved where that is better.
    fn refined(mut self, coarser: &Cutter) -> Self {
        let shifts: Vec<[u32; 2]> =
            (0..coarser.sources.len() as u32).map(|t| coarser.shift(t).map(|n| 2 * n)).collect();
        let from = |t: u32| {
            let (x, y) = (t % self.width, t / self.width);
            self.shifted(t, shifts[(y / 2 * coarser.width + x / 2) as usize])
        };
        self.sources = (0..self.width * self.height).map(from).collect();
        let copies: BTreeSet<[u32; 2]> = shifts.into_iter().collect();
        let mut now = self.energy();
        for _ in 0..2 {
            for copy in &copies {
                let band = self.band();
                now = self.expand(*copy, &band, now);
            }
        }
        self
    }

    /// By how much the copy that a texel shows is shifted.
    fn shift(&self, t: u32) -> [u32; 2] {
        let s = self.sources[t as usize];
        let back = |from: u32, to: u32, n: u32| (to + n - from) % n;
        [back(t % self.width, s % self.width, self.width), back(t / self.width, s / self.width, self.height)]
    }

    /// The texels near seams.
    fn band(&self) -> Vec<bool> {
        let mut band = vec![false; self.sources.len()];
        for t in (0..self.sources.len() as u32).filter(|t| BESIDE.iter().any(|d| self.is_seam(*t, *d))) {
            for (dx, dy) in (0..=2 * BAND).flat_map(|y| (0..=2 * BAND).map(move |x| (x, y))) {
                let step = [(dx, self.width), (dy, self.height)].map(|(d, n)| (d + n - BAND % n) % n);
                band[self.shifted(t, step) as usize] = true;
            }
        }
        band
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

    /// Replaces what shows by a shifted copy where that is `free` to happen and cheaper in all; the cost afterwards.
    fn expand(&mut self, shift: [u32; 2], free: &[bool], before: i64) -> i64 {
        let texels = self.width * self.height;
        let mut nodes = vec![u32::MAX; free.len()];
        let mut count = 0;
        for (node, _) in nodes.iter_mut().zip(free).filter(|(_, free)| **free) {
            *node = count;
            count += 1;
        }
        let mut cut = std::mem::take(&mut self.cut);
        cut.reset(count as usize);
        for (t, d) in (0..texels).flat_map(|t| BESIDE.map(|d| (t, d))) {
            let u = self.shifted(t, d);
            let [node, node_u] = [t, u].map(|t| nodes[t as usize]);
            if node == u32::MAX && node_u == u32::MAX {
                continue;
            }
            let (kept, new) = (self.sources[t as usize], self.shifted(t, shift));
            let (kept_u, new_u) = (self.sources[u as usize], self.shifted(u, shift));
            let [both_kept, new_after, new_before, both_new] =
                [(kept, kept_u), (kept, new_u), (new, kept_u), (new, new_u)].map(|(a, b)| self.seam(a, b, d));
            if node == u32::MAX {
                cut.add_terminal(node_u as usize, new_after - both_kept);
            } else if node_u == u32::MAX {
                cut.add_terminal(node as usize, new_before - both_kept);
            } else {
                cut.add_terminal(node as usize, new_before - both_kept);
                cut.add_terminal(node_u as usize, both_new - new_before);
                // Where the copies agree better across than either with itself, the cut is only an upper bound.
                let price = (new_after + new_before - both_kept - both_new).max(0);
                if price > 0 {
                    cut.add_pair(node as usize, node_u as usize, [price, 0]);
                }
            }
        }
        cut.connect();
        cut.cut();
        let is_new = |t: u32| free[t as usize] && cut.is_sink(nodes[t as usize] as usize);
        let moved = |t: u32| if is_new(t) { self.shifted(t, shift) } else { self.sources[t as usize] };
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
    fn large_samples_are_cut_coarse_to_fine() {
        // Stripes whose period fits, torn at the border, and fine grain that the coarse level does not see.
        let grain = |x: u32, y: u32| Key::new(7).with(u64::from(y)).unit(u64::from(x)) as f32;
        let stripe = |x: u32| if x % 32 < 16 { 0.2 } else { 0.8 };
        let maps = gray(256, 136, |x, y| (if x < 230 { stripe(x) } else { 0.5 }) + 0.1 * grain(x, y));
        let found = made(&maps);
        assert!(found.seams < 0.5 * found.border, "{} of {}", found.seams, found.border);
        assert!(found.sources.iter().filter(|s| **s % 256 >= 230).count() < 256 * 10);
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
