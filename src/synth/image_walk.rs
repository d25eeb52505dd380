//! The walk through the jump map that gives every pixel of an image its source texel.
//!
//! Source: \[ZG02\] section 3, figure 4; border avoidance: 3.1 and section 4. Reads as:
//! - "We scale the random numbers used to select jumps": a jump is taken where a random number in 0..R falls below the
//!   sum of the texel's probabilities, R = patch x side of the exemplar (the geometric mean of its two sides). So R is
//!   the mean distance between jumps where those probabilities sum to one, and longer where the jumps are worse.
//! - "Adjusted near the input image edges by linearly decreasing it to 1": R falls from full at 0.2 sides from the
//!   nearest border to 1 in the border texels. `ShouldJump(inSource, offset)` has the offset as an argument: where
//!   going on would leave the exemplar, the jump is a must.
//! - "Jumps leading near order-dependent edges have their probabilities reduced": a jump's probability falls linearly
//!   towards the edges that patches grow towards, within the same band: right and bottom for scanline, bottom for
//!   serpentine, none for Hilbert, which grows to all sides alike.
//! - A jump counts only if its destination plus the offset lies inside. The paper leaves open what happens when there
//!   is none ("every jump could be guaranteed valid", \[ZG03\] 4.2.4): then another synthesised neighbour goes on; then
//!   another neighbour jumps; then a jump of the chosen source is taken without the offset; then any texel.
//!
//! Unaware of: colours, meshes.

use super::image_order::ImageOrder;
use super::{Error, MAX_PIXELS};
use crate::exemplar::JumpMap;
use crate::numerics::rng::Key;

/// What to synthesise and how.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImageWalkParams {
    /// Width and height of the output in pixels, at least 1, at most [`MAX_PIXELS`] together.
    pub size: [u32; 2],
    /// Order of the pixels.
    pub order: ImageOrder,
    /// Mean distance between jumps in exemplar sides, positive; the paper uses 1.0 to 1.5.
    pub patch: f64,
    /// Seed of all random choices.
    pub seed: u64,
    /// True to make the output wrap in both directions: neighbours are taken across its borders, too.
    pub tileable: bool,
}

/// How often the walk did what.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ImageCounters {
    /// Pixels without a synthesised neighbour: a random texel (the first pixel only).
    pub seeds: u64,
    /// Jumps taken by choice.
    pub jumps: u64,
    /// Jumps taken because going on would have left the exemplar.
    pub forced_jumps: u64,
    /// Pixels whose chosen neighbour led nowhere, continued from another neighbour.
    pub dead_ends: u64,
    /// Pixels for which no neighbour led anywhere: a jump of the source without the offset.
    pub unshifted_jumps: u64,
    /// Pixels that got a random texel as the last resort.
    pub random_fallbacks: u64,
}

/// The source texel of every pixel of an image.
#[derive(Clone, Debug, PartialEq)]
pub struct SourceMap {
    /// Pixels per row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Size of the exemplar in texels.
    pub exemplar_size: [u32; 2],
    /// Column and row in the exemplar of each pixel's source, row by row.
    pub sources: Vec<[u16; 2]>,
    /// True if the image continues at its opposite borders.
    pub tileable: bool,
    /// How often the walk did what.
    pub counters: ImageCounters,
}

/// Share of the exemplar's side within which borders are avoided (\[ZG02\] section 4).
pub(super) const BORDER_BAND: f64 = 0.2;

/// Marks a pixel not yet synthesised; no texel, since sides are at most 65535.
const EMPTY: [u16; 2] = [u16::MAX; 2];

/// Where a neighbour lies as seen from the pixel; bit numbers of a mask.
const LEFT: usize = 0;
const RIGHT: usize = 1;
const UP: usize = 2;

/// Step from a neighbour to the pixel, in the exemplar as in the output.
const STEP: [[i16; 2]; 4] = [[1, 0], [-1, 0], [0, 1], [0, -1]];

/// `PICK[mask][i]`: the i-th neighbour present in the mask.
const PICK: [[u8; 4]; 16] = {
    let mut table = [[0; 4]; 16];
    let mut mask = 0;
    while mask < 16 {
        let (mut dir, mut n) = (0, 0);
        while dir < 4 {
            if mask >> dir & 1 == 1 {
                table[mask][n] = dir as u8;
                n += 1;
            }
            dir += 1;
        }
        mask += 1;
    }
    table
};

/// Gives every pixel its source texel.
///
/// Fails on an empty or too large output or exemplar and on a `patch` that is not a positive number. The time depends
/// on the number of pixels only. The same map and parameters give the same result on every machine.
pub fn walk(map: &JumpMap, params: &ImageWalkParams) -> Result<SourceMap, Error> {
    let &ImageWalkParams { size: [width, height], order, patch, seed, tileable } = params;
    let exemplar_size = [map.width(), map.height()];
    check(exemplar_size, params)?;
    let mut walker = Walker::new(map, order, patch, Key::new(seed).with_str("image walk"));
    let mut sources = vec![EMPTY; width as usize * height as usize];
    match order {
        ImageOrder::Hilbert => any_order(&mut walker, &mut sources, params),
        _ if tileable => any_order(&mut walker, &mut sources, params),
        _ => rows(&mut walker, &mut sources, width as usize, order == ImageOrder::Serpentine),
    }
    Ok(SourceMap { width, height, exemplar_size, sources, tileable, counters: walker.counters })
}

fn check(exemplar: [u32; 2], params: &ImageWalkParams) -> Result<(), Error> {
    let [w, h] = params.size;
    if w == 0 || h == 0 || u64::from(w) * u64::from(h) > MAX_PIXELS {
        return Err(Error::ImageSize(params.size));
    }
    if exemplar.iter().any(|s| !(1..=65535).contains(s)) {
        return Err(Error::ExemplarSize(exemplar));
    }
    if !(params.patch > 0.0 && params.patch.is_finite()) {
        return Err(Error::Patch(params.patch));
    }
    Ok(())
}

/// Scanline and serpentine order: which neighbours are there follows from the position.
fn rows(walker: &mut Walker, sources: &mut [[u16; 2]], width: usize, serpentine: bool) {
    for (y, row) in (0..sources.len()).step_by(width).enumerate() {
        let up = u8::from(y > 0) << UP;
        // Before the first row there is nothing to look at: any index will do for the masked neighbour.
        let above = |at: usize| at.saturating_sub(width);
        if serpentine && y % 2 == 1 {
            let last = row + width - 1;
            sources[last] = walker.step(sources, last, up, [last, last, above(last), last]);
            for at in (row..last).rev() {
                sources[at] = walker.step(sources, at, up | 1 << RIGHT, [at, at + 1, above(at), at]);
            }
        } else {
            sources[row] = walker.step(sources, row, up, [row, row, above(row), row]);
            for at in row + 1..row + width {
                sources[at] = walker.step(sources, at, up | 1 << LEFT, [at - 1, at, above(at), at]);
            }
        }
    }
}

/// Any order, with or without wrapping: looks which neighbours are there.
fn any_order(walker: &mut Walker, sources: &mut [[u16; 2]], params: &ImageWalkParams) {
    let [w, h] = params.size.map(|s| s as usize);
    params.order.for_each(params.size[0], params.size[1], |x, y| {
        let (x, y) = (x as usize, y as usize);
        let at = y * w + x;
        // A neighbour beyond the border is the pixel itself, which is still empty, or the one across the image.
        let wrapped = |inside: bool, near: usize, across: usize| match (inside, params.tileable) {
            (true, _) => near,
            (false, true) => across,
            (false, false) => at,
        };
        let neighbours = [
            wrapped(x > 0, at.wrapping_sub(1), y * w + w - 1),
            wrapped(x + 1 < w, at + 1, y * w),
            wrapped(y > 0, at.wrapping_sub(w), (h - 1) * w + x),
            wrapped(y + 1 < h, at + w, x),
        ];
        let mut mask = 0;
        for (dir, &n) in neighbours.iter().enumerate() {
            mask |= u8::from(sources[n] != EMPTY) << dir;
        }
        sources[at] = walker.step(sources, at, mask, neighbours);
    });
}

struct Walker<'a> {
    map: &'a JumpMap,
    /// Exemplar size in texels.
    width: u32,
    height: u32,
    order: ImageOrder,
    /// Per texel: a jump is wanted when 32 random bits are below this.
    thresholds: Vec<u32>,
    key: Key,
    counters: ImageCounters,
}

impl<'a> Walker<'a> {
    fn new(map: &'a JumpMap, order: ImageOrder, patch: f64, key: Key) -> Self {
        let (width, height) = (map.width(), map.height());
        let counters = ImageCounters::default();
        let mut walker = Walker { map, width, height, order, thresholds: vec![], key, counters };
        let range = patch * (f64::from(width) * f64::from(height)).sqrt();
        walker.thresholds = Vec::with_capacity(width as usize * height as usize);
        for y in 0..height {
            for x in 0..width {
                let total: f64 = map.row(x, y).iter().map(|j| walker.probability(j)).sum();
                let p = total / range_at([x, y], [width, height], range);
                walker.thresholds.push((p * 4_294_967_296.0) as u32); // saturates at one
            }
        }
        walker
    }

    /// A jump's probability, reduced near the edges that the order's patches grow towards.
    fn probability(&self, jump: &crate::exemplar::Jump) -> f64 {
        let toward =
            |at: u16, side: u32| ((f64::from(side) - f64::from(at) - 0.5) / (BORDER_BAND * f64::from(side))).min(1.0);
        let factor = match self.order {
            ImageOrder::Scanline => toward(jump.x, self.width).min(toward(jump.y, self.height)),
            ImageOrder::Serpentine => toward(jump.y, self.height),
            ImageOrder::Hilbert => 1.0,
        };
        f64::from(jump.p) * factor
    }

    fn inside(&self, [x, y]: [u16; 2]) -> bool {
        u32::from(x) < self.width && u32::from(y) < self.height
    }

    /// The source of the pixel `at`, given which of its neighbours (indices into `sources`) are synthesised.
    #[inline(always)]
    fn step(&mut self, sources: &[[u16; 2]], at: usize, mask: u8, neighbours: [usize; 4]) -> [u16; 2] {
        let bits = self.key.bits(at as u64);
        let choice = ((bits & 0xffff_ffff) * u64::from(mask.count_ones())) >> 32;
        let dir = usize::from(PICK[usize::from(mask & 15)][(choice & 3) as usize]);
        let source = sources[neighbours[dir]];
        if mask != 0 {
            let texel = usize::from(source[1]) * self.width as usize + usize::from(source[0]);
            let next = moved(source, STEP[dir]);
            if (bits >> 32) as u32 >= self.thresholds[texel] && self.inside(next) {
                return next;
            }
        }
        self.leave(sources, at, mask, neighbours, dir)
    }

    /// The rare case: a jump is wanted, or going on would leave the exemplar, or there is no neighbour at all.
    #[cold]
    #[inline(never)]
    fn leave(&mut self, sources: &[[u16; 2]], at: usize, mask: u8, neighbours: [usize; 4], dir: usize) -> [u16; 2] {
        let draws = self.key.with(at as u64);
        if mask == 0 {
            self.counters.seeds += 1;
            return self.any_texel(draws);
        }
        let source = sources[neighbours[dir]];
        let next = moved(source, STEP[dir]);
        if let Some(to) = self.jump(source, STEP[dir], draws) {
            let counter = if self.inside(next) { &mut self.counters.jumps } else { &mut self.counters.forced_jumps };
            *counter += 1;
            return to;
        }
        if self.inside(next) {
            return next;
        }
        let others = || (0..4).filter(|d| mask >> d & 1 == 1 && *d != dir).map(|d| (sources[neighbours[d]], STEP[d]));
        let found = others().map(|(s, step)| moved(s, step)).find(|next| self.inside(*next));
        if let Some(to) = found.or_else(|| others().find_map(|(s, step)| self.jump(s, step, draws))) {
            self.counters.dead_ends += 1;
            return to;
        }
        if let Some(to) = self.jump(source, [0, 0], draws) {
            self.counters.unshifted_jumps += 1;
            return to;
        }
        self.counters.random_fallbacks += 1;
        self.any_texel(draws)
    }

    /// A jump of the texel `from` by probability among those that are inside after the step; `None` if there is none.
    fn jump(&self, from: [u16; 2], step: [i16; 2], draws: Key) -> Option<[u16; 2]> {
        let valid = || {
            let row = self.map.row(u32::from(from[0]), u32::from(from[1])).iter();
            row.map(move |j| (moved([j.x, j.y], step), self.probability(j))).filter(|(to, _)| self.inside(*to))
        };
        let total: f64 = valid().map(|(_, p)| p).sum();
        let mut r = draws.unit(0) * total;
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

    fn any_texel(&self, draws: Key) -> [u16; 2] {
        [draws.below(1, self.width) as u16, draws.below(2, self.height) as u16]
    }
}

/// The range of the random number at a texel: `range`, falling to 1 at the border, never below 1.
fn range_at(at: [u32; 2], size: [u32; 2], range: f64) -> f64 {
    let depth = |i: usize| f64::from(at[i].min(size[i] - 1 - at[i])) / (BORDER_BAND * f64::from(size[i]));
    1.0 + (range.max(1.0) - 1.0) * depth(0).min(depth(1)).min(1.0)
}

/// A texel moved by a step; a coordinate below zero becomes 65535, which is never inside.
fn moved(at: [u16; 2], step: [i16; 2]) -> [u16; 2] {
    [at[0].wrapping_add_signed(step[0]), at[1].wrapping_add_signed(step[1])]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::exemplar::Jump;
    use crate::synth::testing::{brute_force_map, noise};
    use crate::texture::Texture;
    use proptest::prelude::*;

    fn params(size: [u32; 2], order: ImageOrder) -> ImageWalkParams {
        ImageWalkParams { size, order, patch: 1.0, seed: 1, tileable: false }
    }

    /// A map whose texels all jump by the same vector, where that stays inside.
    fn shift_map(w: u32, h: u32, by: [i32; 2]) -> JumpMap {
        let rows: Vec<Vec<Jump>> = (0..h as i32)
            .flat_map(|y| (0..w as i32).map(move |x| (x + by[0], y + by[1])))
            .map(|(x, y)| {
                let ok = x >= 0 && y >= 0 && x < w as i32 && y < h as i32;
                if ok { vec![Jump { x: x as u16, y: y as u16, p: 1.0 }] } else { vec![] }
            })
            .collect();
        JumpMap::from_rows(w, h, &rows)
    }

    #[test]
    fn one_texel_gives_a_constant_image() {
        let map = JumpMap::from_rows(1, 1, &[vec![]]);
        for order in ImageOrder::ALL {
            let out = walk(&map, &params([5, 4], order)).unwrap();
            assert!(out.sources.iter().all(|s| *s == [0, 0]));
            assert_eq!(out.counters.random_fallbacks, 19);
        }
    }

    #[test]
    fn perfect_jumps_of_a_period_give_a_periodic_image() {
        // Texel (x, y) shows x % 4 + 4 (y % 4); every texel jumps by a period, to any place that has the same content.
        let rows: Vec<Vec<Jump>> = (0..144u16)
            .map(|i| {
                let (x, y) = (i % 12, i / 12);
                let same = (0..9).map(|j| (x % 4 + 4 * (j % 3), y % 4 + 4 * (j / 3))).filter(|p| *p != (x, y));
                same.map(|(x, y)| Jump { x, y, p: 0.125 }).collect()
            })
            .collect();
        let map = JumpMap::from_rows(12, 12, &rows);
        for order in ImageOrder::ALL {
            for tileable in [false, true] {
                let out = walk(&map, &ImageWalkParams { tileable, ..params([44, 36], order) }).unwrap();
                let phase = |i: usize| out.sources[i].map(|c| usize::from(c % 4));
                let origin = phase(0);
                for i in 0..out.sources.len() {
                    assert_eq!(phase(i), [(origin[0] + i % 44) % 4, (origin[1] + i / 44) % 4], "{order:?} pixel {i}");
                }
                let c = out.counters;
                assert_eq!((c.seeds, c.unshifted_jumps, c.random_fallbacks), (1, 0, 0));
                assert!(c.jumps > 0 && c.forced_jumps > 0);
            }
        }
    }

    #[test]
    fn without_jumps_the_image_is_a_copy() {
        // 64 x 64 texels, no jump: all pixels of a 3 x 3 image continue the seed (which this seed puts inside).
        let map = JumpMap::from_rows(64, 64, &vec![vec![]; 4096]);
        for order in ImageOrder::ALL {
            let out = walk(&map, &params([3, 3], order)).unwrap();
            let [x, y] = out.sources[0];
            for (i, s) in out.sources.iter().enumerate() {
                assert_eq!(*s, [x + i as u16 % 3, y + i as u16 / 3]);
            }
            assert_eq!(out.counters, ImageCounters { seeds: 1, ..Default::default() });
        }
    }

    #[test]
    fn jumps_come_as_often_as_the_patch_says() {
        // Away from the borders each texel has total probability 1: one jump in `patch` sides of 100 texels.
        let map = shift_map(100, 100, [0, 0]);
        for patch in [0.25, 1.0] {
            let walker = Walker::new(&map, ImageOrder::Hilbert, patch, Key::new(1));
            let p = |x: usize, y: usize| f64::from(walker.thresholds[y * 100 + x]) / 4_294_967_296.0;
            assert!((p(50, 50) - 0.01 / patch).abs() < 1e-6);
            assert!((p(20, 50) - 0.01 / patch).abs() < 1e-6);
            assert!((p(10, 50) - 1.0 / (1.0 + (100.0 * patch - 1.0) * 0.5)).abs() < 1e-6);
            assert!((p(0, 50) - 1.0).abs() < 1e-6 && (p(50, 99) - 1.0).abs() < 1e-6);
        }
        // Jumps to the middle column only: 30 texels at one jump in 100, then 20 at ever more, then a forced one.
        let rows: Vec<Vec<Jump>> = (0..10_000u16).map(|i| vec![Jump { x: 50, y: i / 100, p: 1.0 }]).collect();
        let map = JumpMap::from_rows(100, 100, &rows);
        let out = walk(&map, &params([100_000, 1], ImageOrder::Hilbert)).unwrap();
        let c = out.counters;
        assert!((2000..5000).contains(&(c.jumps + c.forced_jumps)) && c.jumps > c.forced_jumps, "{c:?}");
        assert_eq!((c.dead_ends, c.random_fallbacks), (0, 0), "{c:?}");
    }

    #[test]
    fn jumps_to_the_edges_ahead_are_rarer() {
        let map = shift_map(10, 10, [1, 1]);
        let walker = |order| Walker::new(&map, order, 1.0, Key::new(1));
        let jump = |x, y| Jump { x, y, p: 1.0 };
        let scan = walker(ImageOrder::Scanline);
        assert_eq!(scan.probability(&jump(9, 0)), 0.25);
        assert_eq!(scan.probability(&jump(8, 0)), 0.75);
        assert_eq!(scan.probability(&jump(7, 7)), 1.0);
        assert_eq!(scan.probability(&jump(0, 9)), 0.25);
        assert_eq!(walker(ImageOrder::Serpentine).probability(&jump(9, 0)), 1.0);
        assert_eq!(walker(ImageOrder::Serpentine).probability(&jump(9, 9)), 0.25);
        assert_eq!(walker(ImageOrder::Hilbert).probability(&jump(9, 9)), 1.0);
    }

    #[test]
    fn bad_parameters_are_named() {
        let map = JumpMap::from_rows(1, 1, &[vec![]]);
        let p = params([5, 4], ImageOrder::Hilbert);
        assert_eq!(walk(&map, &ImageWalkParams { size: [0, 4], ..p }), Err(Error::ImageSize([0, 4])));
        assert_eq!(walk(&map, &ImageWalkParams { size: [65536, 65536], ..p }), Err(Error::ImageSize([65536, 65536])));
        assert_eq!(walk(&map, &ImageWalkParams { patch: 0.0, ..p }), Err(Error::Patch(0.0)));
        assert!(walk(&map, &ImageWalkParams { patch: f64::NAN, ..p }).is_err());
        assert_eq!(walk(&JumpMap::from_rows(0, 1, &[]), &p), Err(Error::ExemplarSize([0, 1])));
    }

    #[test]
    fn fallbacks_are_rare_with_real_jumps() {
        let map = brute_force_map(&noise(24, 24), 1, 3, 2.0);
        for order in ImageOrder::ALL {
            let out = walk(&map, &params([128, 128], order)).unwrap();
            let c = out.counters;
            assert_eq!(c.random_fallbacks + c.unshifted_jumps, 0, "{order:?} {c:?}");
            assert!(c.dead_ends < 16384 / 100, "{order:?} {c:?}");
            assert_eq!(out, walk(&map, &params([128, 128], order)).unwrap());
        }
    }

    /// The published loop written plainly, from the synthesised neighbours up; the fast paths must agree with it.
    fn plain_walk(map: &JumpMap, p: &ImageWalkParams) -> Vec<[u16; 2]> {
        let [w, h] = p.size.map(|s| s as usize);
        let mut walker = Walker::new(map, p.order, p.patch, Key::new(p.seed).with_str("image walk"));
        let mut done = vec![EMPTY; w * h];
        p.order.for_each(p.size[0], p.size[1], |x, y| {
            let (x, y) = (x as i64, y as i64);
            let mut neighbours = [0; 4];
            let mut mask = 0;
            for (dir, step) in STEP.iter().enumerate() {
                let (mut nx, mut ny) = (x - i64::from(step[0]), y - i64::from(step[1]));
                if p.tileable {
                    (nx, ny) = (nx.rem_euclid(w as i64), ny.rem_euclid(h as i64));
                }
                if nx >= 0 && ny >= 0 && nx < w as i64 && ny < h as i64 && done[ny as usize * w + nx as usize] != EMPTY
                {
                    mask |= 1 << dir;
                    neighbours[dir] = ny as usize * w + nx as usize;
                }
            }
            let at = y as usize * w + x as usize;
            done[at] = walker.step(&done, at, mask, neighbours);
        });
        done
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn every_source_follows_from_a_neighbour(w in 1u32..40, h in 1u32..40, seed in 0u64..1000, tileable: bool) {
            let texture = Texture::from_fn(9, 7, 1, |x, y, out| out[0] = ((x * 7 + y * 3) % 5) as f32);
            let map = brute_force_map(&texture, 1, 2, 1.5);
            for order in ImageOrder::ALL {
                let p = ImageWalkParams { seed, tileable, ..params([w, h], order) };
                let out = walk(&map, &p).unwrap();
                prop_assert!(out.sources.iter().all(|s| s[0] < 9 && s[1] < 7));
                prop_assert_eq!(out.counters.seeds, 1);
                prop_assert_eq!(&out.sources, &plain_walk(&map, &p));
            }
        }
    }
}
