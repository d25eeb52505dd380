//! Correction passes over a synthesised flipbook, from coarse to fine: every pixel looks at all its neighbours in space and
//! time and may change its source.
//!
//! Beyond \[ZG02\]; as `image::refine` does for images, with candidates from k-coherence (Tong et al. 2002). Minimised is
//! the sum over all pairs (p, q) of pixels in one neighbourhood, 3 x 3 pixels in 3 frames, of
//!
//! ```text
//! w(q - p) (c + |E(s_p + q - p) - E(s_q)|^2 / 2 sqrt(V(s_p + q - p) V(s_q)) + the same with p and q exchanged)
//! ```
//!
//! s_p being the source of p, E the exemplar's values, V their local variance, c the cost of a jump in itself: how visible
//! it is that the patch of p would put something else at q than is there. Inside one patch it is zero. Across a seam in
//! time it is a change that the exemplar does not have: flicker; such pairs weigh `TIME_WEIGHT` times as much. Where a
//! texel lies outside the exemplar the other half counts twice. As with images, a source costs more by the share by which
//! its part of the exemplar is used more than the rest.
//! A pixel's candidates are the continuations of its 26 neighbours and the jumps of the nearest six.
//!
//! Levels: pixels `stride` apart in each frame, as with images; in time there is one level, since flipbooks are short.
//! Within a level, pixels are visited in groups of which no two share a neighbourhood, so nothing depends on threads.
//! Unaware of: how the first sources were found.

use super::field::{Field, Place, Usage};
use super::walk::SourceVolume;
use crate::exemplar::JumpVolume;
use crate::numerics::par;
use crate::synth::Error;
use crate::texture::Texture;

/// What it costs in itself that two pixels are of different patches; 2 is the cost of places that have nothing in
/// common. Smoke, change from frame to frame at 0.1, 0.3, 0.6: 28.0, 28.7, 29.6 (the sample's 29.1), at no difference in
/// the statistics of patches; more leaves seams.
const JUMP_COST: f32 = 0.3;

/// Pairs of pixels in different frames weigh so many times as much as such in the same.
const TIME_WEIGHT: f32 = 2.0;

/// A level's stride is at most this share of the exemplar's smaller side. Sliced Wasserstein distance of patches of smoke
/// (48 x 48 x 20 texels) in space and time with one level, two, three, four: 3.27, 2.56, 2.21, 1.84.
const COARSEST: u32 = 4;

/// Refines `map` by `passes` passes on each level and returns the result; zero passes return it as it is.
///
/// `strip` holds the values by which pixels are compared, any number of channels, finite, of comparable range: the
/// exemplar's frames below one another. Fails if it or `jumps` has another size than the exemplar of `map`.
pub fn refine(jumps: &JumpVolume, strip: &Texture, map: &SourceVolume, passes: u32) -> Result<SourceVolume, Error> {
    let [w, h, frames] = map.exemplar_size;
    let expected = [w, h * frames];
    let [jump_w, jump_h, jump_frames] = jumps.size();
    for found in [[strip.width(), strip.height()], [jump_w, jump_h * jump_frames]] {
        if found != expected {
            return Err(Error::TextureSize { found, expected });
        }
    }
    let mut refined = map.clone();
    if passes == 0 {
        return Ok(refined);
    }
    let mut stride = 1;
    while stride * 2 * COARSEST <= w.min(h) {
        stride *= 2;
    }
    loop {
        let mut level = Level::new(jumps, strip, &refined, stride);
        // Coarse levels are cheap and decide the structure.
        for _ in 0..if stride > 1 { passes.saturating_mul(2) } else { passes } {
            if level.pass() == 0 {
                break;
            }
        }
        level.spread(&mut refined);
        if stride == 1 {
            return Ok(refined);
        }
        stride /= 2;
    }
}

/// Pixels `stride` apart in every frame and their sources.
struct Level<'a> {
    jumps: &'a JumpVolume,
    field: Field,
    /// Positions of the nodes along x, y and time in the output.
    axes: [Axis; 3],
    /// Indices of texels.
    sources: Vec<usize>,
    /// True for nodes whose neighbourhood changed since they were last looked at.
    dirty: Vec<bool>,
    usage: Usage,
    /// Steps to the nodes of a neighbourhood, nearest first, and their weights.
    window: Vec<(Place, f32)>,
}

/// One thing in the neighbourhood of a node.
struct Term {
    /// Step from the node in the output.
    step: Place,
    weight: f32,
    /// What is there.
    there: usize,
    /// What its patch would put at the node; `None` outside the exemplar.
    here: Option<usize>,
}

/// Memory used again from node to node.
#[derive(Default)]
struct Scratch {
    terms: Vec<Term>,
    /// How many of the terms are the nearest six or fewer.
    next: usize,
    candidates: Vec<usize>,
}

impl<'a> Level<'a> {
    fn new(jumps: &'a JumpVolume, strip: &Texture, map: &SourceVolume, stride: u32) -> Self {
        let axis = |i: usize| {
            let repeats = if i == 2 { map.looped } else { map.tileable };
            Axis::new(map.size[i], if i == 2 { 1 } else { stride }, repeats)
        };
        let axes = [axis(0), axis(1), axis(2)];
        let field = Field::new(strip, map.exemplar_size, stride as usize / 2, stride as usize);
        let mut sources = Vec::with_capacity(axes.iter().map(|a| a.at.len()).product());
        for (t, y) in axes[2].at.iter().flat_map(|t| axes[1].at.iter().map(move |y| (t, y))) {
            let at = axes[0].at.iter().filter_map(|x| map.index([*x, *y, *t]));
            sources.extend(at.filter_map(|i| field.index(map.sources[i].map(i32::from))));
        }
        let ring = || -1..=1;
        let mut window: Vec<(Place, f32)> = ring()
            .flat_map(|t| ring().flat_map(move |y| ring().map(move |x| [x, y, t])))
            .filter(|step| *step != [0; 3])
            .map(|step| (step, weight(step)))
            .collect();
        window.sort_by_key(|(step, _)| (step.iter().map(|d| d * d).sum::<i32>(), *step));
        let usage = Usage::new(map.exemplar_size, &sources);
        Level { jumps, field, axes, dirty: vec![true; sources.len()], sources, usage, window }
    }

    /// Index of a node.
    fn node(&self, [x, y, t]: [usize; 3]) -> usize {
        (t * self.axes[1].at.len() + y) * self.axes[0].at.len() + x
    }

    /// Looks once at every node whose neighbourhood changed; returns the number of sources changed.
    fn pass(&mut self) -> usize {
        let [columns, rows, frames] = self.axes.each_ref().map(Axis::groups);
        let mut changes = 0;
        for frames in &frames {
            for rows in &rows {
                let lines: Vec<[usize; 2]> = frames.iter().flat_map(|t| rows.iter().map(move |y| [*y, *t])).collect();
                for columns in &columns {
                    let updates = par::map_chunks(lines.len(), 4, |some| {
                        let (mut updates, mut scratch) = (vec![], Scratch::default());
                        for [y, t] in &lines[some] {
                            for at in columns.iter().map(|x| [*x, *y, *t]).filter(|at| self.dirty[self.node(*at)]) {
                                updates.push((at, self.best(at, &mut scratch)));
                            }
                        }
                        updates
                    });
                    for (at, to) in updates.into_iter().flatten() {
                        changes += usize::from(self.update(at, to));
                    }
                }
            }
        }
        changes
    }

    fn update(&mut self, at: [usize; 3], to: usize) -> bool {
        let node = self.node(at);
        self.dirty[node] = false;
        let from = std::mem::replace(&mut self.sources[node], to);
        if from == to {
            return false;
        }
        self.usage.moved(from, to);
        for i in 0..self.window.len() {
            if let Some((node, _)) = self.neighbour(at, self.window[i].0) {
                self.dirty[node] = true;
            }
        }
        true
    }

    /// The node `by` nodes further on along each axis, and how many pixels and frames that is.
    #[inline]
    fn neighbour(&self, at: [usize; 3], by: Place) -> Option<(usize, Place)> {
        let [(x, dx), (y, dy), (t, dt)] =
            [self.axes[0].step(at[0], by[0])?, self.axes[1].step(at[1], by[1])?, self.axes[2].step(at[2], by[2])?];
        Some((self.node([x, y, t]), [dx, dy, dt]))
    }

    /// The best source of a node: its present one unless a candidate costs less.
    fn best(&self, at: [usize; 3], scratch: &mut Scratch) -> usize {
        let own = self.sources[self.node(at)];
        if self.look_around(at, own, scratch) {
            return own;
        }
        let Scratch { terms, next, candidates } = scratch;
        for t in &terms[..*next] {
            let row = self.jumps.row(self.field.place(t.there).map(|v| v as u16)).iter();
            candidates.extend(row.filter_map(|j| self.field.index(minus(j.to().map(i32::from), t.step))));
        }
        let (mut best, mut least) = (own, self.cost(own, terms, f32::INFINITY));
        for (i, &candidate) in candidates.iter().enumerate() {
            if !candidates[..i].contains(&candidate) {
                let cost = self.cost(candidate, terms, least);
                if cost < least {
                    (best, least) = (candidate, cost);
                }
            }
        }
        best
    }

    /// Collects the terms and the continuations; true if the whole neighbourhood is one patch.
    fn look_around(&self, at: [usize; 3], own: usize, scratch: &mut Scratch) -> bool {
        let Scratch { terms, next, candidates } = scratch;
        terms.clear();
        candidates.clear();
        *next = 0;
        let own = self.field.place(own);
        let mut agree = true;
        for &(by, weight) in &self.window {
            let Some((node, step)) = self.neighbour(at, by) else { continue };
            let there = self.sources[node];
            let place = minus(self.field.place(there), step);
            agree &= place == own;
            let here = self.field.index(place);
            candidates.extend(here);
            terms.push(Term { step, weight, there, here });
            *next += usize::from(by.iter().map(|d| d.abs()).sum::<i32>() == 1);
        }
        agree
    }

    /// What it costs to take the texel `source` among `terms`; gives up once it is no less than `limit`.
    fn cost(&self, source: usize, terms: &[Term], limit: f32) -> f32 {
        let factor = self.usage.factor(source);
        let place = self.field.place(source);
        let mut sum = 0.0;
        for t in terms {
            let forth = self.field.index(plus(place, t.step));
            if forth == Some(t.there) {
                continue; // one patch
            }
            let forth = forth.map(|i| self.field.difference(i, t.there));
            let back = t.here.map(|i| self.field.difference(i, source));
            let visible = match (forth, back) {
                (Some(a), Some(b)) => a + b,
                (Some(a), None) | (None, Some(a)) => 2.0 * a,
                (None, None) => 2.0, // as two places that have nothing in common
            };
            sum += t.weight * (JUMP_COST + visible);
            if sum * factor >= limit {
                return limit;
            }
        }
        sum * factor
    }

    /// Gives every pixel the source that continues the patch of its node; a place outside becomes the nearest texel.
    fn spread(&self, map: &mut SourceVolume) {
        let [w, h, frames] = map.exemplar_size.map(|s| s as i32);
        let (width, height) = (map.size[0] as usize, map.size[1] as usize);
        let [columns, rows, _] = &self.axes;
        par::for_rows(&mut map.sources, width, |row, pixels| {
            let (t, y) = (row / height, row % height);
            for (x, pixel) in pixels.iter_mut().enumerate() {
                let [i, j] = [x / columns.stride, y / rows.stride];
                let [sx, sy, st] = self.field.place(self.sources[self.node([i, j, t])]);
                let (dx, dy) = (x as i32 - columns.at[i], y as i32 - rows.at[j]);
                let to = [(sx + dx).clamp(0, w - 1), (sy + dy).clamp(0, h - 1), st.clamp(0, frames - 1)];
                *pixel = to.map(|v| v as u16);
            }
        });
    }
}

/// Weight of a pair of nodes that are so many apart.
fn weight([x, y, t]: Place) -> f32 {
    (if t == 0 { 1.0 } else { TIME_WEIGHT }) / (1.0 + 0.5 * (x * x + y * y + t * t) as f32)
}

fn plus(a: Place, b: Place) -> Place {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

fn minus(a: Place, b: Place) -> Place {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// The nodes along one axis of the output.
struct Axis {
    /// Position of each in pixels or frames: the middle of its block.
    at: Vec<i32>,
    stride: usize,
    /// Pixels or frames after which the output repeats, if it does.
    period: Option<i32>,
}

impl Axis {
    fn new(pixels: u32, stride: u32, repeats: bool) -> Self {
        let middle = |i: u32| (i * stride + stride / 2).min(pixels - 1) as i32;
        Axis {
            at: (0..pixels.div_ceil(stride)).map(middle).collect(),
            stride: stride as usize,
            period: repeats.then_some(pixels as i32),
        }
    }

    /// The node `by` further on and its distance in pixels; `None` beyond the border.
    #[inline]
    fn step(&self, from: usize, by: i32) -> Option<(usize, i32)> {
        let (n, to) = (self.at.len() as i32, from as i32 + by);
        if (0..n).contains(&to) {
            return Some((to as usize, self.at[to as usize] - self.at[from]));
        }
        let (i, turns) = (to.rem_euclid(n) as usize, to.div_euclid(n));
        self.period.map(|period| (i, self.at[i] + turns * period - self.at[from]))
    }

    /// Groups of nodes of which no two are next to each other, across the wrap neither.
    fn groups(&self) -> Vec<Vec<usize>> {
        let n = self.at.len();
        let whole = if self.period.is_some() { n - n % 2 } else { n };
        let mut groups: Vec<Vec<usize>> = (0..2).map(|g| (g..whole).step_by(2).collect()).collect();
        groups.extend((whole..n).map(|i| vec![i]));
        groups
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::exemplar::{AnalysisParams, analyse_flipbook};
    use crate::numerics::rng::Key;
    use crate::synth::image::order::ImageOrder;
    use crate::synth::testing::jump_volume;
    use crate::synth::volume::walk::{VolumeWalkParams, walk};
    use crate::texture::{Flipbook, MapKind, MapSet};

    /// Smooth noise that lives for some frames, and its jump map.
    fn smoke(w: u32, h: u32, frames: u32) -> (Texture, JumpVolume) {
        let noise = |x: u32, y: u32, t: u32| Key::new(9).with(t.into()).with(y.into()).unit(x.into()) as f32;
        let mean =
            |x: u32, y: u32, t: u32| (0..48).map(|i| noise(x + i % 4, y + i / 4 % 4, t + i / 16)).sum::<f32>() / 9.0;
        let strip = Texture::from_fn(w, h * frames, 1, |x, y, out| out[0] = mean(x, y % h, y / h));
        let maps = MapSet::new(vec![(MapKind::Height, strip.clone())]);
        let book = Flipbook::from_strip(maps, frames).unwrap();
        let params = AnalysisParams { neighbourhoods: vec![5, 3], ..AnalysisParams::default() };
        (strip, analyse_flipbook(&book, &params).unwrap())
    }

    fn walked(map: &JumpVolume, size: [u32; 3], repeats: bool) -> SourceVolume {
        let order = ImageOrder::Hilbert;
        walk(map, &VolumeWalkParams { size, order, patch: 1.0, seed: 3, tileable: repeats, looped: repeats }).unwrap()
    }

    /// The seams between pixels next to each other in space, and in time.
    fn seams(strip: &Texture, map: &SourceVolume) -> [f64; 2] {
        let field = Field::new(strip, map.exemplar_size, 0, 1);
        let mut sums = [0.0; 2];
        let [w, h, frames] = map.size.map(|s| s as i32);
        for at in (0..frames).flat_map(|t| (0..h).flat_map(move |y| (0..w).map(move |x| [x, y, t]))) {
            for step in [[1, 0, 0], [0, 1, 0], [0, 0, 1]] {
                let source = |at| map.index(at).map(|i| map.sources[i].map(i32::from));
                let (Some(p), Some(q)) = (source(at), source(plus(at, step))) else { continue };
                let half = |a, b| Some(field.difference(field.index(a)?, field.index(b)?));
                let both = [half(plus(p, step), q), half(minus(q, step), p)];
                sums[step[2] as usize] +=
                    f64::from(both[0].or(both[1]).unwrap_or(1.0) + both[1].or(both[0]).unwrap_or(1.0));
            }
        }
        sums
    }

    #[test]
    fn seams_in_space_and_time_become_less_visible() {
        let (strip, map) = smoke(24, 20, 10);
        for repeats in [false, true] {
            let before = walked(&map, [30, 27, 14], repeats);
            let after = refine(&map, &strip, &before, 2).unwrap();
            let (a, b) = (seams(&strip, &before), seams(&strip, &after));
            assert!(b[0] < 0.6 * a[0] && b[1] < 0.6 * a[1], "{a:?} {b:?}");
            assert!(after.sources.iter().all(|s| s[0] < 24 && s[1] < 20 && s[2] < 10));
        }
    }

    #[test]
    fn wrong_pixels_of_one_patch_are_healed() {
        let (strip, _) = smoke(24, 24, 12);
        let map = jump_volume([24, 24, 12], |_| vec![]);
        let mut right = walked(&map, [12, 12, 6], false);
        right.sources = (0..864u16).map(|i| [i % 12 + 5, i / 12 % 12 + 6, i / 144 + 3]).collect();
        assert_eq!(refine(&map, &strip, &right, 2).unwrap(), right);
        let mut wrong = right.clone();
        wrong.sources[0] = [1, 2, 3];
        wrong.sources[3 * 144 + 5 * 12 + 7] = [20, 3, 11];
        assert_eq!(refine(&map, &strip, &wrong, 2).unwrap(), right);
    }

    #[test]
    fn no_pass_is_the_published_method_and_sizes_must_agree() {
        let map = jump_volume([8, 8, 4], |_| vec![]);
        let before = walked(&map, [9, 7, 5], false);
        assert_eq!(refine(&map, &Texture::new(8, 32, 1), &before, 0).unwrap(), before);
        let other = Error::TextureSize { found: [8, 31], expected: [8, 32] };
        assert_eq!(refine(&map, &Texture::new(8, 31, 1), &before, 1), Err(other));
    }

    #[test]
    fn threads_do_not_change_it() {
        let (strip, map) = smoke(20, 18, 8);
        for repeats in [false, true] {
            let before = walked(&map, [23, 21, 11], repeats);
            let run = |jobs| par::install(jobs, || refine(&map, &strip, &before, 1).unwrap());
            assert_eq!(run(1), run(2));
            assert_eq!(run(1), run(8));
        }
    }

    #[test]
    fn groups_keep_neighbours_apart() {
        for (pixels, stride, repeats) in
            [(10, 1, true), (11, 1, true), (11, 1, false), (37, 4, true), (1, 1, true), (2, 1, true)]
        {
            let axis = Axis::new(pixels, stride, repeats);
            let mut all = axis.groups().concat();
            all.sort_unstable();
            assert_eq!(all, (0..axis.at.len()).collect::<Vec<_>>());
            for group in axis.groups() {
                let next = |a: &usize| axis.step(*a, 1).map(|(b, _)| b);
                assert!(
                    group.iter().all(|a| next(a).is_none_or(|b| b == *a || !group.contains(&b))),
                    "{pixels} {stride}"
                );
            }
        }
    }

    #[test]
    fn nodes_step_by_pixels() {
        let axis = Axis::new(10, 4, true); // nodes at 2, 6 and 9: the last block has two pixels
        assert_eq!((axis.step(0, 1), axis.step(0, -1), axis.step(2, 1)), (Some((1, 4)), Some((2, -3)), Some((0, 3))));
        assert_eq!(Axis::new(10, 4, false).step(2, 1), None);
    }
}
