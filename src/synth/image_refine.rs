//! Correction passes over a synthesised image, from coarse to fine: every pixel looks at all its neighbours and may
//! change its source.
//!
//! Beyond \[ZG02\]; suggested by \[ZG03\] section 6 ("extra passes, when all neighbours are available to suggest
//! destinations"; "a hierarchical generalization"). Without passes the result is the published method's. Minimised is
//! the sum over all pairs (p, q) of pixels in one neighbourhood of
//!
//! ```text
//! w(q - p) (|E(s_p + q - p) - E(s_q)|^2 / 2 sqrt(V(s_p + q - p) V(s_q)) + the same with p and q exchanged)
//! ```
//!
//! s_p being the source of p, E the exemplar's values and V their local variance: how visible it is that the patch of p
//! would put something else at q than is there. Inside one patch it is zero; a jump costs a little in itself. Without V, smooth places of the exemplar,
//! which go with everything, would spread; for the same reason, a source's cost grows with the share by which its part of
//! the exemplar is used more than the rest. Where a texel lies outside the exemplar the other half counts twice.
//! A pixel's candidates are those of the walk: continuations and jumps of its neighbours.
//!
//! Levels: pixels `stride` apart, compared in an exemplar blurred accordingly, start from the walk's sources; each next
//! level has half the stride and starts from the sources that continue the patches of the one before. Within a level,
//! pixels are visited in groups of which no two share a neighbourhood, so nothing depends on threads.
//! Unaware of: how the first sources were found.

use super::Error;
use super::image_walk::SourceMap;
use super::seam::{Field, Place, Usage};
use crate::exemplar::JumpMap;
use crate::numerics::par;
use crate::texture::Texture;

/// The nearest neighbours, whose jumps are candidates; of the ring around them only the continuations are.
const NEXT: usize = 4;

/// A level's stride is at most this share of the exemplar's smaller side.
const COARSEST: u32 = 16;

/// What it costs in itself that two pixels are of different patches; 2 is the cost of places that have nothing in
/// common. Keeps patches whole: on four exemplars 0.05 to 0.15 lowered swd and mean coherence at hardly any cost in seams;
/// more shows them.
const JUMP_COST: f32 = 0.1;

/// Refines `map` by `passes` passes on each level and returns the result; zero passes return it as it is.
///
/// `exemplar` holds the values by which pixels are compared, any number of channels, finite, of comparable range; fails
/// if it or `jumps` has another size than the exemplar of `map`.
pub fn refine(jumps: &JumpMap, exemplar: &Texture, map: &SourceMap, passes: u32) -> Result<SourceMap, Error> {
    for found in [[exemplar.width(), exemplar.height()], [jumps.width(), jumps.height()]] {
        if found != map.exemplar_size {
            return Err(Error::TextureSize { found, expected: map.exemplar_size });
        }
    }
    let mut refined = map.clone();
    if passes == 0 {
        return Ok(refined);
    }
    let mut stride = 1;
    while stride * 2 * COARSEST <= exemplar.width().min(exemplar.height()) {
        stride *= 2;
    }
    loop {
        let mut level = Level::new(jumps, exemplar, &refined, stride);
        for _ in 0..passes_at(stride, passes) {
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

/// Coarse levels are cheap and decide the structure: four times the passes of the finest, which only mends seams. On
/// four 128 x 128 exemplars this was as good as the same number everywhere in less than half the time.
fn passes_at(stride: u32, passes: u32) -> u32 {
    if stride > 1 { passes.saturating_mul(2) } else { passes.div_ceil(2) }
}

/// Reach of a neighbourhood in nodes: 5 x 5; at the finest level, 3 x 3 is hardly worse and three times as fast.
fn radius_at(stride: u32) -> i32 {
    if stride > 1 { 2 } else { 1 }
}

/// Pixels `stride` apart and their sources.
struct Level<'a> {
    jumps: &'a JumpMap,
    field: Field,
    /// True for texels whose neighbourhoods are all inside the exemplar.
    amid: Vec<bool>,
    /// Positions of the columns and rows of nodes in the image.
    columns: Axis,
    rows: Axis,
    sources: Vec<Place>,
    /// True for nodes whose neighbourhood changed since they were last looked at.
    dirty: Vec<bool>,
    usage: Usage,
    /// Steps to the nodes of a neighbourhood, nearest first, and their weights.
    window: Vec<(Place, f32)>,
}

/// One thing in the neighbourhood of a node.
struct Term {
    /// Step from the node in the image, and the same as a step of texel indices.
    step: Place,
    stride: i32,
    weight: f32,
    /// What is there.
    there: usize,
    /// What its patch would put at the node; `None` outside the exemplar.
    here: Option<usize>,
}

impl<'a> Level<'a> {
    fn new(jumps: &'a JumpMap, exemplar: &Texture, map: &SourceMap, stride: u32) -> Self {
        let columns = Axis::new(map.width, stride, map.tileable);
        let rows = Axis::new(map.height, stride, map.tileable);
        let pixel = |x: i32, y: i32| map.sources[y as usize * map.width as usize + x as usize].map(i32::from);
        let sources: Vec<Place> = rows.at.iter().flat_map(|y| columns.at.iter().map(|x| pixel(*x, *y))).collect();
        let radius = radius_at(stride);
        let mut window: Vec<(Place, f32)> = (-radius..=radius)
            .flat_map(|j| (-radius..=radius).map(move |i| [i, j]))
            .filter(|step| *step != [0, 0])
            .map(|[i, j]| ([i, j], 1.0 / (1.0 + 0.5 * (i * i + j * j) as f32)))
            .collect();
        window.sort_by_key(|([i, j], _)| (i * i + j * j, *j, *i));
        let usage = Usage::new(map.exemplar_size, sources.iter().copied());
        let dirty = vec![true; sources.len()];
        let blur = if stride > 1 { stride as usize / 2 } else { 0 };
        let field = Field::new(exemplar, blur, radius as usize * stride as usize);
        let [w, h] = map.exemplar_size;
        // One more than the radius: where the image ends, steps between nodes may be shorter or longer than the stride.
        let reach = (radius as u32 + 1) * stride;
        let clear = move |at: u32, side: u32| at >= reach && at + reach < side;
        let amid = (0..h).flat_map(|y| (0..w).map(move |x| clear(x, w) && clear(y, h))).collect();
        Level { jumps, field, amid, columns, rows, sources, dirty, usage, window }
    }

    /// Looks once at every node whose neighbourhood changed; returns the number of sources changed.
    fn pass(&mut self) -> usize {
        let mut changes = 0;
        for rows in self.rows.groups() {
            for columns in self.columns.groups() {
                let updates = par::map_chunks(rows.len(), 2, |some| {
                    let (mut updates, mut scratch) = (vec![], Scratch::default());
                    for &y in &rows[some] {
                        for &x in &columns {
                            let node = y * self.columns.at.len() + x;
                            if self.dirty[node] {
                                updates.push(([x, y], self.best(x as i32, y as i32, &mut scratch)));
                            }
                        }
                    }
                    updates
                });
                for ([x, y], to) in updates.into_iter().flatten() {
                    changes += usize::from(self.update(x, y, to));
                }
            }
        }
        changes
    }

    fn update(&mut self, x: usize, y: usize, to: Place) -> bool {
        let node = y * self.columns.at.len() + x;
        self.dirty[node] = false;
        let from = std::mem::replace(&mut self.sources[node], to);
        if from == to {
            return false;
        }
        self.usage.moved(from, to);
        for &([i, j], _) in &self.window {
            if let (Some((a, _)), Some((b, _))) = (self.columns.step(x as i32, i), self.rows.step(y as i32, j)) {
                self.dirty[b * self.columns.at.len() + a] = true;
            }
        }
        true
    }

    /// The best source of a node: its present one unless a candidate has less cost.
    fn best(&self, x: i32, y: i32, scratch: &mut Scratch) -> Place {
        let own = self.sources[y as usize * self.columns.at.len() + x as usize];
        if self.look_around(x, y, own, scratch) {
            return own;
        }
        let Scratch { terms, candidates } = scratch;
        for t in &terms[..terms.len().min(NEXT)] {
            let [x, y] = self.field.place(t.there);
            let row = self.jumps.row(x as u32, y as u32).iter();
            let moved = row.filter_map(|j| self.field.index([i32::from(j.x) - t.step[0], i32::from(j.y) - t.step[1]]));
            candidates.extend(moved);
        }
        let mut best = self.field.index(own).unwrap_or_default();
        let mut least = self.cost(best, terms, f32::INFINITY);
        for (i, &candidate) in candidates.iter().enumerate() {
            if !candidates[..i].contains(&candidate) {
                let cost = self.cost(candidate, terms, least);
                if cost < least {
                    (best, least) = (candidate, cost);
                }
            }
        }
        self.field.place(best)
    }

    /// Collects the terms and the continuations of the first ring; true if the whole neighbourhood is one patch.
    fn look_around(&self, x: i32, y: i32, own: Place, Scratch { terms, candidates }: &mut Scratch) -> bool {
        terms.clear();
        candidates.clear();
        let mut agree = true;
        for &([i, j], weight) in &self.window {
            let (Some((a, dx)), Some((b, dy))) = (self.columns.step(x, i), self.rows.step(y, j)) else { continue };
            let there = self.sources[b * self.columns.at.len() + a];
            let place = [there[0] - dx, there[1] - dy];
            agree &= place == own;
            let here = self.field.index(place);
            if i.abs().max(j.abs()) == 1 {
                candidates.extend(here);
            }
            if let Some(there) = self.field.index(there) {
                terms.push(Term { step: [dx, dy], stride: dy * self.field.size[0] + dx, weight, there, here });
            }
        }
        agree
    }

    /// What it costs to take the texel `source` among `terms`; gives up once it is no less than `limit`.
    fn cost(&self, source: usize, terms: &[Term], limit: f32) -> f32 {
        let factor = self.usage.factor(source);
        let (amid, [x, y]) = (self.amid[source], self.field.place(source));
        let mut sum = 0.0;
        for t in terms {
            let forth = if amid {
                Some((source as i32 + t.stride) as usize)
            } else {
                self.field.index([x + t.step[0], y + t.step[1]])
            };
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
    fn spread(&self, map: &mut SourceMap) {
        let [w, h] = map.exemplar_size.map(|s| s as i32);
        let width = map.width as usize;
        par::for_rows(&mut map.sources, width, |y, row| {
            let node_row = y / self.rows.stride;
            for (x, pixel) in row.iter_mut().enumerate() {
                let node_column = x / self.columns.stride;
                let [sx, sy] = self.sources[node_row * self.columns.at.len() + node_column];
                let (dx, dy) = (x as i32 - self.columns.at[node_column], y as i32 - self.rows.at[node_row]);
                *pixel = [(sx + dx).clamp(0, w - 1) as u16, (sy + dy).clamp(0, h - 1) as u16];
            }
        });
    }
}

/// Memory used again from node to node.
#[derive(Default)]
struct Scratch {
    terms: Vec<Term>,
    candidates: Vec<usize>,
}

/// The nodes along one side of the image.
struct Axis {
    /// Position of each in pixels: the middle of its block.
    at: Vec<i32>,
    stride: usize,
    /// Pixels after which the image repeats, if it does.
    period: Option<i32>,
}

impl Axis {
    fn new(pixels: u32, stride: u32, tileable: bool) -> Self {
        let middle = |i: u32| (i * stride + stride / 2).min(pixels - 1) as i32;
        Axis {
            at: (0..pixels.div_ceil(stride)).map(middle).collect(),
            stride: stride as usize,
            period: tileable.then_some(pixels as i32),
        }
    }

    /// The node `by` further on and its distance in pixels; `None` beyond the border, or if that is the node itself.
    fn step(&self, from: i32, by: i32) -> Option<(usize, i32)> {
        let n = self.at.len() as i32;
        let to = from + by;
        match self.period {
            _ if (0..n).contains(&to) => Some((to as usize, self.at[to as usize] - self.at[from as usize])),
            Some(period) => {
                let i = to.rem_euclid(n);
                let turns = to.div_euclid(n);
                Some((i as usize, self.at[i as usize] + turns * period - self.at[from as usize]))
            }
            None => None,
        }
    }

    /// Groups of nodes of which no two are in one neighbourhood, across the wrap neither.
    fn groups(&self) -> Vec<Vec<usize>> {
        let (n, m) = (self.at.len(), radius_at(self.stride as u32) as usize + 1);
        let whole = if self.period.is_some() { n - n % m } else { n };
        let mut groups: Vec<Vec<usize>> = (0..m).map(|g| (g..whole).step_by(m).collect()).collect();
        groups.extend((whole..n).map(|i| vec![i]));
        groups
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synth::image_order::ImageOrder;
    use crate::synth::image_walk::{ImageWalkParams, walk};
    use crate::synth::testing::{blobs, brute_force_map, noise};

    fn walked(map: &JumpMap, size: [u32; 2], tileable: bool) -> SourceMap {
        let p = ImageWalkParams { size, order: ImageOrder::Hilbert, patch: 1.0, seed: 3, tileable };
        walk(map, &p).unwrap()
    }

    /// The sum that is minimised at the finest level, by its definition.
    fn seams(exemplar: &Texture, map: &SourceMap) -> f64 {
        let field = Field::new(exemplar, 0, 1);
        let source = |x: i32, y: i32| {
            let inside = x >= 0 && y >= 0 && x < map.width as i32 && y < map.height as i32;
            inside.then(|| map.sources[(y * map.width as i32 + x) as usize].map(i32::from))
        };
        let mut sum = 0.0;
        for (x, y) in (0..map.height as i32).flat_map(|y| (0..map.width as i32).map(move |x| (x, y))) {
            for (dx, dy) in [(1, 0), (0, 1), (1, 1), (-1, 1)] {
                let (Some(p), Some(q)) = (source(x, y), source(x + dx, y + dy)) else { continue };
                let half = |a: Place, b: Place| Some(field.difference(field.index(a)?, field.index(b)?));
                let (forth, back) = (half([p[0] + dx, p[1] + dy], q), half([q[0] - dx, q[1] - dy], p));
                let both = forth.or(back).unwrap_or(1.0) + back.or(forth).unwrap_or(1.0);
                sum += f64::from(both) / (1.0 + 0.5 * f64::from(dx * dx + dy * dy));
            }
        }
        sum
    }

    #[test]
    fn seams_become_less_visible() {
        let t = blobs(40, 40);
        let map = brute_force_map(&t, 2, 3, 4.0);
        for tileable in [false, true] {
            let before = walked(&map, [70, 60], tileable);
            let after = refine(&map, &t, &before, 2).unwrap();
            let (a, b) = (seams(&t, &before), seams(&t, &after));
            assert!(b < 0.4 * a, "{a} {b}");
            assert!(after.sources.iter().all(|s| s[0] < 40 && s[1] < 40));
        }
    }

    #[test]
    fn a_wrong_pixel_in_a_periodic_image_is_healed() {
        // Period 4; one patch after the other; one pixel of the wrong phase, between the nodes of the coarse level.
        let t = Texture::from_fn(32, 32, 1, |x, y, out| out[0] = (x % 4 * 4 + y % 4) as f32);
        let same: Vec<Vec<crate::exemplar::Jump>> = vec![vec![]; 1024];
        let map = JumpMap::from_rows(32, 32, &same);
        let sources = (0..400u16).map(|i| [i % 20 + 4, i / 20 + 4]).collect();
        let right = SourceMap {
            width: 20,
            height: 20,
            exemplar_size: [32, 32],
            sources,
            tileable: false,
            counters: Default::default(),
        };
        assert_eq!(refine(&map, &t, &right, 2).unwrap(), right);
        let mut wrong = right.clone();
        wrong.sources[5 * 20 + 7] = [3, 3];
        wrong.sources[12 * 20 + 2] = [30, 31];
        assert_eq!(refine(&map, &t, &wrong, 1).unwrap(), right);
    }

    #[test]
    fn no_pass_is_the_published_method() {
        let t = noise(20, 20);
        let map = brute_force_map(&t, 1, 3, 2.0);
        let before = walked(&map, [33, 17], false);
        assert_eq!(refine(&map, &t, &before, 0).unwrap(), before);
        let other = Error::TextureSize { found: [19, 20], expected: [20, 20] };
        assert_eq!(refine(&map, &noise(19, 20), &before, 1), Err(other));
    }

    #[test]
    fn threads_do_not_change_it() {
        let t = blobs(36, 36);
        let map = brute_force_map(&t, 1, 3, 3.0);
        for tileable in [false, true] {
            let before = walked(&map, [53, 47], tileable);
            let run = |jobs| par::install(jobs, || refine(&map, &t, &before, 1).unwrap());
            assert_eq!(run(1), run(2));
            assert_eq!(run(1), run(8));
        }
    }

    #[test]
    fn groups_keep_neighbourhoods_apart() {
        for (pixels, stride, tileable) in [(10, 1, true), (11, 1, false), (37, 2, true), (5, 4, true), (1, 1, true)] {
            let axis = Axis::new(pixels, stride, tileable);
            let groups = axis.groups();
            let mut all: Vec<usize> = groups.concat();
            all.sort_unstable();
            assert_eq!(all, (0..axis.at.len()).collect::<Vec<_>>());
            for group in groups {
                for &a in &group {
                    for by in 1..=radius_at(stride) {
                        let other = axis.step(a as i32, by).map(|(b, _)| b);
                        assert!(other.is_none_or(|b| b == a || !group.contains(&b)), "{pixels} {stride}: {a} + {by}");
                    }
                }
            }
        }
    }

    #[test]
    fn nodes_step_by_pixels() {
        let axis = Axis::new(10, 4, true); // nodes at 2, 6 and 9: the last block has two pixels
        assert_eq!(axis.at, [2, 6, 9]);
        assert_eq!(axis.step(0, 2), Some((2, 7)));
        assert_eq!(axis.step(0, -1), Some((2, -3)));
        assert_eq!(axis.step(2, 1), Some((0, 3)));
        assert_eq!(Axis::new(10, 4, false).step(2, 1), None);
    }
}
