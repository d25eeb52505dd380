//! The walk through the jump map of a flipbook that gives every pixel of every frame its source.
//!
//! Source: \[ZG02\] section 3, carried over to time as section 6 proposes. A source is (column, row, frame) of the
//! exemplar. Frames are synthesised one after the other, each in the order of an image. A pixel continues a patch from one
//! of its synthesised neighbours, chosen at random: those beside it, the one in the frame before and, in a loop, the one
//! in the frame after. To continue from the frame before means the same texel, one frame later. Reads as:
//! - R, the mean number of pixels between perfect jumps, is `patch` times the square root of the number of texels: for an
//!   image that is the side, as published; for a flipbook that of all its frames. With the side, patches held fifty pixels
//!   in space *and* time, and after ten frames nothing larger was left of the sample (smoke of 48 x 48 x 20 texels).
//! - "Linearly decreasing it to 1 at the actual boundary" within 0.2 of the side, or of the frames: a neighbour is chosen
//!   more rarely the fewer texels are left in the direction of the step, and never at the border itself if another one can
//!   go on; the chosen one jumps more often by the same share. A new frame has a neighbour for every pixel, so patches that
//!   come to an end, in space or time, are overgrown by those around them. If each pixel jumped for itself instead, as
//!   along a border in an image, a whole frame would fall apart when its patches reach the end of time together.
//! - Patches only grow forward in time, so the last frame of the exemplar is an order-dependent edge (3.1): jumps that lead
//!   near it have their probabilities reduced.
//! - The neighbour in time counts for `TIME` of those in space.
//!
//! Unaware of: colours.

use crate::exemplar::{JumpVolume, VolumeJump};
use crate::numerics::rng::Key;
use crate::synth::image::order::ImageOrder;
use crate::synth::image::walk::BORDER_BAND;
use crate::synth::{Error, MAX_PIXELS};

/// What to synthesise and how.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VolumeWalkParams {
    /// Width, height and frames of the output, at least 1 each, at most [`MAX_VOLUME`] together.
    pub size: [u32; 3],
    /// Order of the pixels of a frame.
    pub order: ImageOrder,
    /// Mean number of pixels between jumps as a multiple of the square root of the exemplar's texels, positive.
    pub patch: f64,
    /// Seed of all random choices.
    pub seed: u64,
    /// True to make every frame wrap in both directions.
    pub tileable: bool,
    /// True to make the first frame follow the last.
    pub looped: bool,
}

/// Most pixels in all frames of an output: 512 x 512 in 256 frames.
pub const MAX_VOLUME: u64 = MAX_PIXELS / 4;

/// How often the walk did what.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct VolumeCounters {
    /// Pixels without a synthesised neighbour (the first one only).
    pub seeds: u64,
    /// Jumps taken by choice.
    pub jumps: u64,
    /// Jumps taken because going on would have left the exemplar.
    pub forced_jumps: u64,
    /// Pixels whose chosen neighbour led nowhere, continued from another neighbour.
    pub dead_ends: u64,
    /// Pixels for which no neighbour led anywhere: a jump of the source without the step.
    pub unshifted_jumps: u64,
    /// Pixels that got a random texel as the last resort.
    pub random_fallbacks: u64,
}

/// The source of every pixel of every frame.
#[derive(Clone, Debug, PartialEq)]
pub struct SourceVolume {
    /// Width, height and frames.
    pub size: [u32; 3],
    /// Width, height and frames of the exemplar.
    pub exemplar_size: [u32; 3],
    /// Column, row and frame in the exemplar of each pixel's source, frame by frame and row by row.
    pub sources: Vec<[u16; 3]>,
    /// True if each frame continues at its opposite borders.
    pub tileable: bool,
    /// True if the first frame follows the last.
    pub looped: bool,
    /// How often the walk did what.
    pub counters: VolumeCounters,
}

impl SourceVolume {
    /// Index of a pixel, brought into the volume along the axes that repeat; `None` outside.
    #[inline]
    pub(super) fn index(&self, at: [i32; 3]) -> Option<usize> {
        let repeats = [self.tileable, self.tileable, self.looped];
        let mut index = 0;
        for i in [2, 1, 0] {
            let n = self.size[i] as i32;
            let inside = (0..n).contains(&at[i]);
            if !inside && !repeats[i] {
                return None;
            }
            index = index * n as usize + if inside { at[i] } else { at[i].rem_euclid(n) } as usize;
        }
        Some(index)
    }
}

/// Marks a pixel not yet synthesised; no texel, since sides are at most 65535.
const EMPTY: [u16; 3] = [u16::MAX; 3];

/// Step from a neighbour to the pixel, in the exemplar as in the output; the last two are those in time.
const STEPS: [[i16; 3]; 6] = [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]];

/// How many neighbours in space the one in time stands for. On smoke, frames changed by 32.0 where the sample's change by
/// 29.1 (blended in space, not refined), by 33.7 with one and 32.2 with four.
const TIME: f64 = 2.0;

/// Synthesised neighbours of a pixel: their sources and the steps from them.
type Around = ([([u16; 3], [i16; 3]); 6], usize);

/// Gives every pixel of every frame its source.
///
/// Fails on an empty or too large output and on a `patch` that is not a positive number. The same map and parameters give
/// the same result on every machine.
pub fn walk(map: &JumpVolume, params: &VolumeWalkParams) -> Result<SourceVolume, Error> {
    let &VolumeWalkParams { size, order, patch, seed, tileable, looped } = params;
    let pixels = size.iter().fold(1u64, |n, s| n.saturating_mul(u64::from(*s)));
    if pixels == 0 || pixels > MAX_VOLUME {
        return Err(Error::VolumeSize(size));
    }
    if !(patch > 0.0 && patch.is_finite()) {
        return Err(Error::Patch(patch));
    }
    let counters = VolumeCounters::default();
    let sources = vec![EMPTY; pixels as usize];
    let mut out = SourceVolume { size, exemplar_size: map.size(), sources, tileable, looped, counters };
    let mut walker = Walker::new(map, patch, Key::new(seed).with_str("flipbook walk"));
    for t in 0..size[2] as i32 {
        order.for_each(size[0], size[1], |x, y| {
            let at = [x as i32, y as i32, t];
            if let Some(i) = out.index(at) {
                out.sources[i] = walker.step(i, around(&out, at));
            }
        });
    }
    out.counters = walker.counters;
    Ok(out)
}

/// The neighbours of a pixel that have a source.
fn around(out: &SourceVolume, at: [i32; 3]) -> Around {
    let (mut found, mut count) = ([(EMPTY, [0; 3]); 6], 0);
    for step in STEPS {
        let neighbour = [0, 1, 2].map(|i| at[i] - i32::from(step[i]));
        if let Some(source) = out.index(neighbour).map(|i| out.sources[i]).filter(|s| *s != EMPTY) {
            found[count] = (source, step);
            count += 1;
        }
    }
    (found, count)
}

struct Walker<'a> {
    map: &'a JumpVolume,
    /// Mean number of pixels between perfect jumps.
    range: f64,
    key: Key,
    counters: VolumeCounters,
}

impl<'a> Walker<'a> {
    fn new(map: &'a JumpVolume, patch: f64, key: Key) -> Self {
        let [w, h, frames] = map.size().map(f64::from);
        let range = (patch * (w * h * frames).sqrt()).max(1.0);
        Walker { map, range, key, counters: VolumeCounters::default() }
    }

    /// The source of pixel `at`, given its neighbours.
    fn step(&mut self, at: usize, (around, count): Around) -> [u16; 3] {
        let draws = self.key.with(at as u64);
        if count == 0 {
            self.counters.seeds += 1;
            return self.any_texel(draws);
        }
        let chosen = self.choose(&around[..count], draws);
        let (source, step) = around[chosen];
        let next = self.moved(source, step);
        if let Some(next) = next.filter(|_| draws.unit(1) >= self.chance(source, step)) {
            return next;
        }
        if let Some(to) = self.jump(source, step, draws) {
            *(if next.is_some() { &mut self.counters.jumps } else { &mut self.counters.forced_jumps }) += 1;
            return to;
        }
        if let Some(next) = next {
            return next;
        }
        let others = || (0..count).filter(|i| *i != chosen).map(|i| around[i]);
        let found = others().find_map(|(source, step)| self.moved(source, step));
        if let Some(to) = found.or_else(|| others().find_map(|(source, step)| self.jump(source, step, draws))) {
            self.counters.dead_ends += 1;
            return to;
        }
        if let Some(to) = self.jump(source, [0; 3], draws) {
            self.counters.unshifted_jumps += 1;
            return to;
        }
        self.counters.random_fallbacks += 1;
        self.any_texel(draws)
    }

    /// One of the neighbours at random, rarer the nearer the end of its patch; any if all have reached it.
    fn choose(&self, around: &[([u16; 3], [i16; 3])], draws: Key) -> usize {
        let weight =
            |&(source, step): &([u16; 3], [i16; 3])| self.depth(source, step) * if step[2] == 0 { 1.0 } else { TIME };
        let total: f64 = around.iter().map(weight).sum();
        let mut r = draws.unit(0) * total;
        for (i, neighbour) in around.iter().enumerate() {
            r -= weight(neighbour);
            if r < 0.0 {
                return i;
            }
        }
        draws.below(6, around.len() as u32) as usize
    }

    /// How far a patch can go on from `source` in the direction of the step: 0 at the border, 1 outside its band.
    fn depth(&self, source: [u16; 3], step: [i16; 3]) -> f64 {
        let axis = step.iter().position(|s| *s != 0).unwrap_or_default();
        let side = self.map.size()[axis];
        let at = u32::from(source[axis]);
        let ahead = if step[axis] > 0 { side - 1 - at } else { at };
        (f64::from(ahead) / (BORDER_BAND * f64::from(side))).min(1.0)
    }

    /// Probability that a jump is wanted where a patch takes a step from `source`.
    fn chance(&self, source: [u16; 3], step: [i16; 3]) -> f64 {
        let total: f64 = self.map.row(source).iter().map(|j| self.probability(j)).sum();
        total / (1.0 + (self.range - 1.0) * self.depth(source, step))
    }

    /// A jump's probability, reduced near the end of time, which all patches grow towards.
    fn probability(&self, jump: &VolumeJump) -> f64 {
        let frames = f64::from(self.map.size()[2]);
        let ahead = frames - f64::from(jump.to()[2]) - 0.5;
        jump.p() * (ahead / (BORDER_BAND * frames)).min(1.0)
    }

    /// A jump of the texel `from` by probability among those that are inside after the step; `None` if there is none.
    fn jump(&self, from: [u16; 3], step: [i16; 3], draws: Key) -> Option<[u16; 3]> {
        let valid = || {
            let row = self.map.row(from).iter();
            row.filter_map(|j| Some((self.moved(j.to(), step)?, self.probability(j))))
        };
        let total: f64 = valid().map(|(_, p)| p).sum();
        let mut r = draws.unit(2) * total;
        let mut last = None;
        for (to, p) in valid() {
            last = Some(to);
            r -= p;
            if r < 0.0 {
                break;
            }
        }
        last
    }

    /// A texel moved by a step; `None` outside the exemplar.
    #[inline]
    fn moved(&self, at: [u16; 3], step: [i16; 3]) -> Option<[u16; 3]> {
        // Below zero it becomes 65535, which is never inside.
        let to = [0, 1, 2].map(|i| at[i].wrapping_add_signed(step[i]));
        (0..3).all(|i| u32::from(to[i]) < self.map.size()[i]).then_some(to)
    }

    fn any_texel(&self, draws: Key) -> [u16; 3] {
        [0, 1, 2].map(|i| draws.below(3 + i as u64, self.map.size()[i]) as u16)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synth::testing::jump_volume;

    fn params(size: [u32; 3]) -> VolumeWalkParams {
        VolumeWalkParams { size, order: ImageOrder::Hilbert, patch: 1.0, seed: 1, tileable: false, looped: false }
    }

    #[test]
    fn perfect_jumps_of_a_period_keep_the_phase_in_space_and_time() {
        // Texel (x, y, t) jumps to any other of the same phase, modulo 3 in space and 4 in time.
        let map = jump_volume([9, 9, 12], |at| {
            let phases =
                (0..36).map(|i| [at[0] % 3 + 3 * (i % 3), at[1] % 3 + 3 * (i / 3 % 3), at[2] % 4 + 4 * (i / 9)]);
            phases.filter(|to| *to != at && to[2] < 12).collect()
        });
        for order in ImageOrder::ALL {
            for looped in [false, true] {
                let p = VolumeWalkParams { order, looped, tileable: looped, ..params([21, 12, 40]) };
                let out = walk(&map, &p).unwrap();
                let phase = |s: [u16; 3]| [s[0] % 3, s[1] % 3, s[2] % 4].map(usize::from);
                let origin = phase(out.sources[0]);
                for (i, s) in out.sources.iter().enumerate() {
                    let at = [i % 21, i / 21 % 12, i / 252];
                    let expected = [(origin[0] + at[0]) % 3, (origin[1] + at[1]) % 3, (origin[2] + at[2]) % 4];
                    assert_eq!(phase(*s), expected, "{order:?} {at:?}");
                }
                let c = out.counters;
                assert_eq!((c.seeds, c.unshifted_jumps, c.random_fallbacks), (1, 0, 0), "{c:?}");
                assert!(c.jumps > 0 && c.forced_jumps > 0);
            }
        }
    }

    #[test]
    fn without_jumps_the_output_is_a_piece_of_the_exemplar() {
        let map = jump_volume([40, 40, 40], |_| vec![]);
        let out = walk(&map, &params([3, 3, 3])).unwrap();
        let first = out.sources[0];
        for (i, s) in out.sources.iter().enumerate() {
            let i = i as u16;
            assert_eq!(*s, [first[0] + i % 3, first[1] + i / 3 % 3, first[2] + i / 9]);
        }
        assert_eq!(out.counters, VolumeCounters { seeds: 1, ..Default::default() });
    }

    #[test]
    fn one_texel_gives_a_constant_output() {
        let out = walk(&jump_volume([1, 1, 2], |_| vec![]), &params([4, 3, 5])).unwrap();
        assert!(out.sources.iter().all(|s| s[0] == 0 && s[1] == 0 && s[2] < 2));
    }

    #[test]
    fn jumps_come_as_often_as_the_patch_says_and_more_often_towards_the_borders() {
        // The square root of 4000 texels, times 0.5.
        let map = jump_volume([20, 20, 10], |at| vec![[at[0], at[1], 0]]);
        let walker = Walker::new(&map, 0.5, Key::new(1));
        let rare = 1.0 / (0.5 * 4000f64.sqrt());
        let (right, left, on) = ([1, 0, 0], [-1, 0, 0], [0, 0, 1]);
        assert!(
            [([10, 10, 9], right), ([0, 19, 9], right), ([19, 0, 0], left), ([19, 19, 7], on)]
                .iter()
                .all(|&(at, step)| (walker.chance(at, step) - rare).abs() < 1e-12 && walker.depth(at, step) == 1.0)
        );
        assert_eq!((walker.depth([17, 0, 0], right), walker.depth([3, 0, 0], left)), (0.5, 0.75));
        assert_eq!((walker.depth([0, 0, 8], on), walker.depth([0, 0, 9], on)), (0.5, 0.0));
        assert_eq!(walker.chance([19, 10, 0], right), 1.0);
        assert_eq!(walker.chance([0, 0, 9], on), 1.0);
        // A jump to the last frame is a quarter as likely: it leads half a frame from the end, of two.
        assert_eq!(walker.probability(&VolumeJump::new([0, 0, 9], 1.0)), 0.25);
        assert_eq!(walker.probability(&VolumeJump::new([0, 0, 7], 1.0)), 1.0);
    }

    #[test]
    fn a_patch_at_its_end_is_not_gone_on_with_if_another_is() {
        let map = jump_volume([20, 20, 10], |_| vec![]);
        let walker = Walker::new(&map, 1.0, Key::new(1));
        let around = [([5, 5, 5], [1, 0, 0]), ([5, 5, 9], [0, 0, 1]), ([19, 5, 5], [1, 0, 0]), ([5, 5, 5], [0, 0, 1])];
        let mut counts = [0; 4];
        (0..3000).for_each(|i| counts[walker.choose(&around, Key::new(i))] += 1);
        assert!(counts[1] == 0 && counts[2] == 0 && (900..1100).contains(&counts[0]), "{counts:?}");
        assert!((0..99).all(|i| walker.choose(&around[1..3], Key::new(i)) < 2), "where all are at an end, any");
    }

    #[test]
    fn every_source_follows_from_a_neighbour_and_stays_inside() {
        let map = jump_volume([7, 6, 5], |[x, y, t]| vec![[6 - x, 5 - y, 4 - t], [x / 2, y / 2, t / 2]]);
        for (tileable, looped) in [(false, false), (true, false), (false, true), (true, true)] {
            let p = VolumeWalkParams { tileable, looped, ..params([13, 11, 9]) };
            let out = walk(&map, &p).unwrap();
            assert!(out.sources.iter().all(|s| s[0] < 7 && s[1] < 6 && s[2] < 5));
            let c = out.counters;
            assert_eq!((c.seeds, c.random_fallbacks), (1, 0), "{c:?}");
            assert_eq!(out, walk(&map, &p).unwrap());
            assert_ne!(out.sources, walk(&map, &VolumeWalkParams { seed: 2, ..p }).unwrap().sources);
        }
    }

    #[test]
    fn bad_parameters_are_named() {
        let map = jump_volume([2, 2, 2], |_| vec![]);
        assert_eq!(walk(&map, &params([5, 0, 4])), Err(Error::VolumeSize([5, 0, 4])));
        assert_eq!(walk(&map, &params([u32::MAX; 3])), Err(Error::VolumeSize([u32::MAX; 3])));
        assert_eq!(walk(&map, &VolumeWalkParams { patch: -1.0, ..params([2, 2, 2]) }), Err(Error::Patch(-1.0)));
    }
}
