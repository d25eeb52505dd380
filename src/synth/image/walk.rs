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
//! Known pixels around the part of the canvas that is walked take part as neighbours, so that what is already there goes on.
//! A guide counts as a border: a patch ends where the texture is to change. Jumps lead to texels that fit the guide if there
//! are any, and if not, to a random one that fits.
//! Unaware of: colours, meshes.

use super::board::Board;
use super::guide::Guide;
use super::order::ImageOrder;
use super::source_map::{EMPTY, ImageCounters, SourceMap};
use crate::exemplar::{Domain, Jump, JumpMap};
use crate::numerics::rng::Key;
use crate::synth::{Error, MAX_PIXELS};
use crate::texture::Wrap;

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

/// Share of the exemplar's side within which borders are avoided (\[ZG02\] section 4).
pub(in crate::synth) const BORDER_BAND: f64 = 0.2;

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

impl ImageWalkParams {
    /// Checks the parameters, and that the exemplar can be walked.
    pub(super) fn check(&self, exemplar: [u32; 2]) -> Result<(), Error> {
        let [w, h] = self.size;
        if w == 0 || h == 0 || u64::from(w) * u64::from(h) > MAX_PIXELS {
            return Err(Error::ImageSize(self.size));
        }
        if exemplar.iter().any(|s| !(1..=65535).contains(s)) {
            return Err(Error::ExemplarSize(exemplar));
        }
        if !(self.patch > 0.0 && self.patch.is_finite()) {
            return Err(Error::Patch(self.patch));
        }
        Ok(())
    }
}

/// Gives every pixel its source texel.
///
/// Fails on an empty or too large output or exemplar and on a `patch` that is not a positive number. The time depends
/// on the number of pixels only. The same map and parameters give the same result on every machine.
pub fn walk(map: &JumpMap, params: &ImageWalkParams) -> Result<SourceMap, Error> {
    params.check([map.width(), map.height()])?;
    let mut board = Board::whole(params.size, params.tileable);
    let counters = Walk::new(map, params).fill(&mut board, None);
    let exemplar_size = [map.width(), map.height()];
    let [width, height] = params.size;
    Ok(SourceMap { width, height, exemplar_size, sources: board.sources, tileable: params.tileable, counters })
}

/// What is worked out once for all parts of a canvas. Expects checked parameters.
pub(super) struct Walk<'a> {
    map: &'a JumpMap,
    order: ImageOrder,
    /// Per texel: a jump is wanted when 32 random bits are below this.
    thresholds: Vec<u32>,
    borders: Borders,
    key: Key,
}

impl<'a> Walk<'a> {
    pub fn new(map: &'a JumpMap, params: &ImageWalkParams) -> Self {
        let key = Key::new(params.seed).with_str("image walk");
        Self::with_key(map, params.order, params.patch, key)
    }

    fn with_key(map: &'a JumpMap, order: ImageOrder, patch: f64, key: Key) -> Self {
        let borders = Borders::new(map.domain());
        let mut walk = Walk { map, order, thresholds: vec![], borders, key };
        walk.thresholds = Vec::with_capacity(map.width() as usize * map.height() as usize);
        for y in 0..map.height() {
            for x in 0..map.width() {
                let total: f64 = map.row(x, y).iter().map(|j| walk.probability(j)).sum();
                let p = total / walk.borders.range_at(x, y, patch);
                walk.thresholds.push((p * 4_294_967_296.0) as u32); // saturates at one
            }
        }
        walk
    }

    /// A jump's probability, reduced near the edges that the order's patches grow towards.
    fn probability(&self, jump: &Jump) -> f64 {
        let ahead = |axis| self.borders.ahead(jump.x.into(), jump.y.into(), axis).min(1.0);
        let factor = match self.order {
            ImageOrder::Scanline => ahead(0).min(ahead(1)),
            ImageOrder::Serpentine => ahead(1),
            ImageOrder::Hilbert => 1.0,
        };
        f64::from(jump.p) * factor
    }

    /// Gives the empty pixels of the board's cell their sources.
    pub fn fill(&self, board: &mut Board, guide: Option<&Guide>) -> ImageCounters {
        let whole = board.cell.len() == board.sources.len() && board.given.is_none() && board.wraps == [false; 2];
        let mut sources = std::mem::take(&mut board.sources);
        let mut walker = Walker { walk: self, board, guide, counters: ImageCounters::default() };
        match self.order {
            ImageOrder::Scanline | ImageOrder::Serpentine if whole => rows(&mut walker, &mut sources),
            _ => any_order(&mut walker, &mut sources),
        }
        let counters = walker.counters;
        board.sources = sources;
        counters
    }
}

/// Scanline and serpentine order of a whole board: which neighbours are there follows from the position.
fn rows(walker: &mut Walker, sources: &mut [[u16; 2]]) {
    let [width, height] = walker.board.size;
    for y in 0..height {
        let row = walker.board.index(0, y);
        let up = u8::from(y > 0) << UP;
        // Before the first row there is nothing to look at: any index will do for the masked neighbour.
        let above = |at: usize| at.saturating_sub(width as usize);
        if walker.walk.order == ImageOrder::Serpentine && y % 2 == 1 {
            for x in (0..width).rev() {
                let at = row + x as usize;
                let (mask, right) = if x + 1 < width { (up | 1 << RIGHT, at + 1) } else { (up, at) };
                sources[at] = walker.step(sources, [x, y], mask, [at, right, above(at), at]);
            }
        } else {
            for x in 0..width {
                let at = row + x as usize;
                let (mask, left) = if x > 0 { (up | 1 << LEFT, at - 1) } else { (up, at) };
                sources[at] = walker.step(sources, [x, y], mask, [left, at, above(at), at]);
            }
        }
    }
}

/// Any order, with or without wrapping: looks which neighbours are there.
fn any_order(walker: &mut Walker, sources: &mut [[u16; 2]]) {
    let board = walker.board;
    let (cell, order) = (board.cell, walker.walk.order);
    let mut visit = |sources: &mut [[u16; 2]], x: u32, y: u32| {
        let at = board.index(x, y);
        let neighbours = board.beside(x, y);
        let mut mask = 0;
        // One that does not exist is the pixel itself, which is still empty.
        for (dir, &n) in neighbours.iter().enumerate() {
            mask |= u8::from(sources[n] != EMPTY) << dir;
        }
        sources[at] = walker.step(sources, [x, y], mask, neighbours);
    };
    let Some(given) = &board.given else {
        order.for_each(cell.width, cell.height, |x, y| visit(sources, cell.x + x, cell.y + y));
        return;
    };
    let mut holes = Vec::new();
    order.for_each(cell.width, cell.height, |x, y| {
        let [x, y] = [cell.x + x, cell.y + y];
        if !given[board.index(x, y)] {
            holes.push([x, y]);
        }
    });
    for [x, y] in board.inwards(&holes, sources) {
        visit(sources, x, y);
    }
}

/// One part of a canvas in work.
struct Walker<'a> {
    walk: &'a Walk<'a>,
    board: &'a Board,
    guide: Option<&'a Guide>,
    counters: ImageCounters,
}

impl Walker<'_> {
    /// True if a source goes with a pixel.
    #[inline(always)]
    fn fits(&self, [x, y]: [u32; 2], source: [u16; 2]) -> bool {
        self.guide.is_none_or(|g| g.fits(self.board.on_canvas(x, y), source))
    }

    /// The source of a pixel, given which of its neighbours (indices into `sources`) are synthesised.
    #[inline(always)]
    fn step(&mut self, sources: &[[u16; 2]], pixel: [u32; 2], mask: u8, neighbours: [usize; 4]) -> [u16; 2] {
        let bits = self.walk.key.bits(self.board.number(pixel[0], pixel[1]));
        let choice = ((bits & 0xffff_ffff) * u64::from(mask.count_ones())) >> 32;
        let dir = usize::from(PICK[usize::from(mask & 15)][(choice & 3) as usize]);
        let source = sources[neighbours[dir]];
        if mask != 0 {
            let domain = self.walk.map.domain();
            let texel = usize::from(source[1]) * domain.width() as usize + usize::from(source[0]);
            if (bits >> 32) as u32 >= self.walk.thresholds[texel]
                && let Some(next) = moved(domain, source, STEP[dir])
                && self.fits(pixel, next)
            {
                return next;
            }
        }
        self.leave(sources, pixel, mask, neighbours, dir)
    }

    /// The rare case: a jump is wanted, or going on would leave the exemplar, or there is no neighbour at all.
    #[cold]
    #[inline(never)]
    fn leave(
        &mut self,
        sources: &[[u16; 2]],
        pixel: [u32; 2],
        mask: u8,
        neighbours: [usize; 4],
        dir: usize,
    ) -> [u16; 2] {
        let draws = self.walk.key.with(self.board.number(pixel[0], pixel[1]));
        if mask == 0 {
            self.counters.seeds += 1;
            return self.any_texel(pixel, draws);
        }
        let domain = self.walk.map.domain();
        let source = sources[neighbours[dir]];
        let next = moved(domain, source, STEP[dir]).filter(|next| self.fits(pixel, *next));
        if let Some(to) = self.jump(pixel, source, STEP[dir], draws) {
            let counter = if next.is_some() { &mut self.counters.jumps } else { &mut self.counters.forced_jumps };
            *counter += 1;
            return to;
        }
        if let Some(next) = next {
            return next;
        }
        let others = || (0..4).filter(|d| mask >> d & 1 == 1 && *d != dir).map(|d| (sources[neighbours[d]], STEP[d]));
        let found = others().filter_map(|(s, step)| moved(domain, s, step)).find(|next| self.fits(pixel, *next));
        if let Some(to) = found.or_else(|| others().find_map(|(s, step)| self.jump(pixel, s, step, draws))) {
            self.counters.dead_ends += 1;
            return to;
        }
        if let Some(to) = self.jump(pixel, source, [0, 0], draws) {
            self.counters.unshifted_jumps += 1;
            return to;
        }
        self.counters.random_fallbacks += 1;
        self.any_texel(pixel, draws)
    }

    /// A jump of the texel `from` by probability among those that are inside after the step and fit; `None` if there is none.
    fn jump(&self, pixel: [u32; 2], from: [u16; 2], step: [i16; 2], draws: Key) -> Option<[u16; 2]> {
        let (map, domain) = (self.walk.map, self.walk.map.domain());
        let valid = || {
            let row = map.row(u32::from(from[0]), u32::from(from[1])).iter();
            row.filter_map(move |j| Some((moved(domain, [j.x, j.y], step)?, self.walk.probability(j))))
                .filter(|(to, _)| self.fits(pixel, *to))
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

    fn any_texel(&self, [x, y]: [u32; 2], draws: Key) -> [u16; 2] {
        match self.guide {
            Some(guide) => guide.seed(self.board.on_canvas(x, y), draws),
            None => random_texel(self.walk.map.domain(), draws),
        }
    }
}

/// A random texel of a domain.
fn random_texel(domain: &Domain, draws: Key) -> [u16; 2] {
    let draw = |i: u64| [draws.below(2 * i + 1, domain.width()) as u16, draws.below(2 * i + 2, domain.height()) as u16];
    // A few tries for one that belongs; where the domain is sparse, the next one that does.
    let [x, y] = (0..16).map(draw).find(|t| domain.contains(t[0].into(), t[1].into())).unwrap_or_else(|| draw(16));
    let all = domain.width() as usize * domain.height() as usize;
    let start = usize::from(y) * domain.width() as usize + usize::from(x);
    let place = |i: usize| [(i % domain.width() as usize) as u16, (i / domain.width() as usize) as u16];
    let mut from = (start..all).chain(0..start).map(place);
    from.find(|t| domain.contains(t[0].into(), t[1].into())).unwrap_or([x, y])
}

/// A texel moved by a step, if that stays inside.
#[inline(always)]
fn moved(domain: &Domain, at: [u16; 2], step: [i16; 2]) -> Option<[u16; 2]> {
    domain.at(i32::from(at[0]) + i32::from(step[0]), i32::from(at[1]) + i32::from(step[1]))
}

/// How far the texels of a domain are from its borders, along both axes: texels before and after each in its run.
struct Borders {
    width: usize,
    before: [Vec<u16>; 2],
    after: [Vec<u16>; 2],
    /// A domain that repeats and has no gaps has no borders at all.
    none: bool,
}

impl Borders {
    fn new(domain: &Domain) -> Self {
        let (w, h) = (domain.width() as usize, domain.height() as usize);
        let empty = || [vec![0u16; w * h], vec![0u16; w * h]];
        let mut borders = Borders { width: w, before: empty(), after: empty(), none: false };
        borders.none = domain.wrap() == Wrap::Repeat && domain.len() == w * h;
        for (axis, lines, length) in [(0, h, w), (1, w, h)] {
            let at = |line: usize, i: usize| if axis == 0 { line * w + i } else { i * w + line };
            let belongs = |i: usize| domain.contains((i % w) as i32, (i / w) as i32);
            for line in 0..lines {
                for i in 1..length {
                    if belongs(at(line, i - 1)) {
                        borders.before[axis][at(line, i)] = borders.before[axis][at(line, i - 1)] + 1;
                    }
                }
                for i in (0..length.saturating_sub(1)).rev() {
                    if belongs(at(line, i + 1)) {
                        borders.after[axis][at(line, i)] = borders.after[axis][at(line, i + 1)] + 1;
                    }
                }
            }
        }
        borders
    }

    /// Texels before and after a texel and in its whole run along an axis.
    fn run(&self, x: u32, y: u32, axis: usize) -> [f64; 3] {
        let i = y as usize * self.width + x as usize;
        let [before, after] = [f64::from(self.before[axis][i]), f64::from(self.after[axis][i])];
        [before, after, before + after + 1.0]
    }

    /// Distance to the border ahead (right or below) in bands.
    fn ahead(&self, x: u32, y: u32, axis: usize) -> f64 {
        if self.none {
            return 1.0;
        }
        let [_, after, side] = self.run(x, y, axis);
        (after + 0.5) / (BORDER_BAND * side)
    }

    /// The range of the random number at a texel: `patch` sides, falling to 1 at the border, never below 1.
    fn range_at(&self, x: u32, y: u32, patch: f64) -> f64 {
        let runs = [self.run(x, y, 0), self.run(x, y, 1)];
        let range = patch * (runs[0][2] * runs[1][2]).sqrt();
        let depth = |[before, after, side]: [f64; 3]| before.min(after) / (BORDER_BAND * side);
        let share = if self.none { 1.0 } else { depth(runs[0]).min(depth(runs[1])).min(1.0) };
        1.0 + (range.max(1.0) - 1.0) * share
    }
}

#[cfg(test)]
mod tests {
    use super::*;
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
            let walk = Walk::with_key(&map, ImageOrder::Hilbert, patch, Key::new(1));
            let p = |x: usize, y: usize| f64::from(walk.thresholds[y * 100 + x]) / 4_294_967_296.0;
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
        let walker = |order| Walk::with_key(&map, order, 1.0, Key::new(1));
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
        let (all, board) = (Walk::new(map, p), Board::whole(p.size, p.tileable));
        let mut walker = Walker { walk: &all, board: &board, guide: None, counters: ImageCounters::default() };
        let mut done = vec![EMPTY; w * h];
        p.order.for_each(p.size[0], p.size[1], |x, y| {
            let (ix, iy) = (i64::from(x), i64::from(y));
            let mut neighbours = [0; 4];
            let mut mask = 0;
            for (dir, step) in STEP.iter().enumerate() {
                let (mut nx, mut ny) = (ix - i64::from(step[0]), iy - i64::from(step[1]));
                if p.tileable {
                    (nx, ny) = (nx.rem_euclid(w as i64), ny.rem_euclid(h as i64));
                }
                if nx >= 0 && ny >= 0 && nx < w as i64 && ny < h as i64 && done[ny as usize * w + nx as usize] != EMPTY
                {
                    mask |= 1 << dir;
                    neighbours[dir] = ny as usize * w + nx as usize;
                }
            }
            done[y as usize * w + x as usize] = walker.step(&done, [x, y], mask, neighbours);
        });
        done
    }

    #[test]
    fn a_sample_that_tiles_is_never_left() {
        let domain = Domain::full(6, 5, Wrap::Repeat);
        let map = JumpMap::over(domain, &vec![vec![]; 30]);
        let out = walk(&map, &params([40, 30], ImageOrder::Hilbert)).unwrap();
        let [x, y] = out.sources[0].map(u32::from);
        for (i, s) in out.sources.iter().enumerate() {
            assert_eq!(s.map(u32::from), [(x + i as u32 % 40) % 6, (y + i as u32 / 40) % 5]);
        }
        assert_eq!(out.counters, ImageCounters { seeds: 1, ..Default::default() });
    }

    #[test]
    fn masked_texels_are_never_sources() {
        let texture = noise(20, 20);
        let belongs = |x: u32, y: u32| (x / 5 + y / 5).is_multiple_of(2);
        let domain = Domain::masked(20, 20, Wrap::Clamp, belongs).unwrap();
        let full = brute_force_map(&texture, 1, 4, 2.0);
        let kept =
            |x: u32, y: u32| full.row(x, y).iter().filter(|j| belongs(j.x.into(), j.y.into())).copied().collect();
        let rows: Vec<Vec<Jump>> =
            (0..400u32).map(|i| if belongs(i % 20, i / 20) { kept(i % 20, i / 20) } else { vec![] }).collect();
        let map = JumpMap::over(domain, &rows);
        for order in ImageOrder::ALL {
            let out = walk(&map, &params([60, 60], order)).unwrap();
            assert!(out.sources.iter().all(|s| belongs(s[0].into(), s[1].into())), "{order:?}");
        }
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
