//! A canvas of any size, synthesised in parts: on all cores, one window of it, or strip by strip.
//!
//! The "seeding" that \[ZG02\] section 6 asks for, so that the output can be sampled anywhere without generating all of it.
//! A large canvas is cut into cells of about 512 x 512 pixels. They are synthesised in four phases, by the parity of their
//! column and row, so that no two cells of a phase touch: the first phase starts from a seed of its own, later ones go on
//! from what is around them, and corrections may change `MARGIN` pixels of the neighbours that are there already. What a
//! cell becomes depends on the neighbours of earlier phases only, theirs on theirs: on 24 cells at most. A canvas of one
//! cell is the published method's single walk.
//! Unaware of: colours, files.

use std::collections::BTreeMap;

use super::board::Board;
use super::guide::Guide;
use super::refine::refine_board;
use super::source_map::{EMPTY, ImageCounters, Rect, SourceMap};
use super::walk::{ImageWalkParams, Walk};
use crate::exemplar::JumpMap;
use crate::numerics::par;
use crate::synth::Error;
use crate::synth::seam_metric::SeamMetrics;

/// Aimed-for side of a cell in pixels; a canvas of less than one and a half is one cell.
const CELL: u32 = 512;

/// Pixels of earlier neighbours that corrections may change. With [`CONTEXT`] on both sides it is less than the smallest
/// cell, so that no change reaches beyond the neighbours.
const MARGIN: u32 = 64;

/// Pixels around that are looked at.
const CONTEXT: u32 = 16;

/// What a canvas is made of.
#[derive(Clone, Copy)]
pub struct ImageTask<'a> {
    /// Where the exemplar looks alike.
    pub jumps: &'a JumpMap,
    /// What seams cost; needed where `refine` is not 0.
    pub metrics: Option<&'a SeamMetrics>,
    /// Size, order, patches, seed.
    pub walk: ImageWalkParams,
    /// Correction sweeps; 0 is the published method.
    pub refine: u32,
    /// What is wanted where.
    pub guide: Option<&'a Guide>,
    /// Sources that are given, row by row: `EMPTY` where texture is to be filled in. Makes the canvas one cell.
    pub given: Option<&'a [[u16; 2]]>,
}

/// A canvas, parts of which may have been synthesised.
pub struct ImageCanvas<'a> {
    task: ImageTask<'a>,
    walk: Walk<'a>,
    /// Where columns and rows of cells begin, and the canvas' size at the end.
    cuts: [Vec<u32>; 2],
    /// Sources of the cells that were begun, by row and column.
    cells: BTreeMap<(u32, u32), Vec<[u16; 2]>>,
    counters: ImageCounters,
}

impl<'a> ImageCanvas<'a> {
    /// Prepares a canvas. Fails on a size or parameter that is not allowed, and on a guide, metrics or given sources of
    /// another size.
    pub fn new(task: ImageTask<'a>) -> Result<Self, Error> {
        let exemplar = [task.jumps.width(), task.jumps.height()];
        task.walk.check(exemplar)?;
        match task.metrics {
            Some(m) if m.size != exemplar => return Err(Error::TextureSize { found: m.size, expected: exemplar }),
            None if task.refine > 0 => return Err(Error::TextureSize { found: [0, 0], expected: exemplar }),
            _ => {}
        }
        let [w, h] = task.walk.size;
        if let Some(found) = task.guide.map(Guide::canvas).filter(|found| *found != [w, h]) {
            return Err(Error::GuideSize { found, expected: [w, h] });
        }
        if let Some(given) = task.given {
            let (found, expected) = (given.len(), w as usize * h as usize);
            if found != expected {
                return Err(Error::Count { what: "given sources", found, expected });
            }
            let belongs =
                |s: &[u16; 2]| *s == EMPTY || (u32::from(s[0]) < exemplar[0] && u32::from(s[1]) < exemplar[1]);
            let fault = Error::Count { what: "given sources inside the exemplar", found: 0, expected };
            given.iter().all(belongs).then_some(()).ok_or(fault)?;
        }
        let cuts = [w, h].map(|side| {
            let near = if task.given.is_some() { 1 } else { ((side + CELL / 2) / CELL).max(1) };
            // Around a torus the phases alternate only if there are two of each.
            let count = if task.walk.tileable && near > 1 { near.next_multiple_of(2) } else { near };
            (0..=count).map(|i| (u64::from(side) * u64::from(i) / u64::from(count)) as u32).collect()
        });
        let walk = Walk::new(task.jumps, &task.walk);
        Ok(ImageCanvas { task, walk, cuts, cells: BTreeMap::new(), counters: ImageCounters::default() })
    }

    /// The sources of a rectangle, exactly as they are in the whole canvas. Synthesises what they depend on and was not
    /// before. Panics if the rectangle is empty or does not fit.
    ///
    /// The counters are those of everything synthesised so far.
    pub fn window(&mut self, r: Rect) -> SourceMap {
        assert!(!r.is_empty() && r.fits(self.task.walk.size), "a window of {r:?} in {:?}", self.task.walk.size);
        let whole = r == Rect::whole(self.task.walk.size);
        SourceMap { tileable: whole && self.task.walk.tileable, ..self.stretch([r.x, r.y], [r.width, r.height]) }
    }

    /// As [`ImageCanvas::window`], from any pixel on; on a canvas that wraps it may go on beyond the borders, so that what is
    /// around a window at a border can be had ([`Rect::with_apron`]). Panics if it is empty or does not fit.
    pub fn stretch(&mut self, origin: [u32; 2], size: [u32; 2]) -> SourceMap {
        let canvas = self.task.walk.size;
        let fits = |a: usize| origin[a] < canvas[a] && (self.task.walk.tileable || size[a] <= canvas[a] - origin[a]);
        let r = Rect { x: origin[0], y: origin[1], width: size[0], height: size[1] };
        assert!(!r.is_empty() && fits(0) && fits(1), "a window of {r:?} in {canvas:?}");
        self.synthesise(self.needed(origin, size));
        let mut sources = vec![EMPTY; r.len()];
        self.copy_out(origin, size, &mut sources);
        SourceMap {
            width: r.width,
            height: r.height,
            exemplar_size: [self.task.jumps.width(), self.task.jumps.height()],
            sources,
            tileable: false,
            counters: self.counters,
        }
    }

    /// Size of the canvas.
    pub fn canvas(&self) -> [u32; 2] {
        self.task.walk.size
    }

    /// True if the canvas continues at its opposite borders.
    pub fn is_tileable(&self) -> bool {
        self.task.walk.tileable
    }

    /// Forgets the cells that only rows above `row` depend on; later windows must not begin above it.
    pub fn forget_above(&mut self, row: u32) {
        let (this, rows) = (self.cell_at(1, row), self.rows());
        // Where the canvas wraps, the first and the last rows depend on each other.
        let wraps = self.task.walk.tileable;
        self.cells.retain(|(r, _), _| r + 3 > this || (wraps && (*r < 2 || r + 3 > rows)));
    }

    fn columns(&self) -> u32 {
        self.cuts[0].len() as u32 - 1
    }

    fn rows(&self) -> u32 {
        self.cuts[1].len() as u32 - 1
    }

    /// The column or row of cells that a pixel is in.
    fn cell_at(&self, axis: usize, pixel: u32) -> u32 {
        self.cuts[axis].partition_point(|c| *c <= pixel) as u32 - 1
    }

    /// Size of a cell.
    fn size(&self, (row, column): (u32, u32)) -> [u32; 2] {
        [(0, column), (1, row)].map(|(axis, i)| self.cuts[axis][i as usize + 1] - self.cuts[axis][i as usize])
    }

    /// When a cell is synthesised, 0..4.
    fn phase((row, column): (u32, u32)) -> u32 {
        row % 2 * 2 + column % 2
    }

    /// The cells around one, by their place relative to it.
    fn around(&self, (row, column): (u32, u32)) -> Vec<([i32; 2], (u32, u32))> {
        let beside = |i: u32, by: i32, count: u32| match i.checked_add_signed(by).filter(|i| *i < count) {
            Some(i) => Some(i),
            None if self.task.walk.tileable && count > 1 => Some((i + count).wrapping_add_signed(by) % count),
            None => None,
        };
        let steps = (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| [dx, dy])).filter(|s| *s != [0, 0]);
        steps
            .filter_map(|[dx, dy]| {
                let row = if dy == 0 { row } else { beside(row, dy, self.rows())? };
                let column = if dx == 0 { column } else { beside(column, dx, self.columns())? };
                Some(([dx, dy], (row, column)))
            })
            .collect()
    }

    /// The columns or rows of cells that a stretch of pixels touches.
    fn touched(&self, axis: usize, from: u32, len: u32) -> Vec<u32> {
        let side = self.task.walk.size[axis];
        let end = from + len;
        // Where it goes on beyond the border it begins again, perhaps more than once.
        let (first, last) = (self.cell_at(axis, from), self.cell_at(axis, end.min(side) - 1));
        let beyond = end.saturating_sub(side).min(side);
        let again = if beyond > 0 { self.cell_at(axis, beyond - 1) + 1 } else { 0 };
        (0..again).chain(first.max(again)..=last).collect()
    }

    /// The cells that a rectangle depends on and that are not done, by phase.
    fn needed(&self, origin: [u32; 2], size: [u32; 2]) -> [Vec<(u32, u32)>; 4] {
        let [columns, rows] = [0, 1].map(|a| self.touched(a, origin[a], size[a]));
        let inside: Vec<(u32, u32)> =
            rows.iter().flat_map(|row| columns.iter().map(move |column| (*row, *column))).collect();
        // Later neighbours change what is near their border.
        let mut open: Vec<(u32, u32)> = inside.clone();
        open.extend(inside.iter().flat_map(|cell| self.around(*cell).into_iter().map(|n| n.1)));
        let mut found: BTreeMap<(u32, u32), ()> = BTreeMap::new();
        while let Some(cell) = open.pop() {
            if self.cells.contains_key(&cell) || found.insert(cell, ()).is_some() {
                continue;
            }
            open.extend(self.around(cell).into_iter().map(|n| n.1).filter(|n| Self::phase(*n) < Self::phase(cell)));
        }
        let mut phases: [Vec<(u32, u32)>; 4] = Default::default();
        for (cell, ()) in found {
            phases[Self::phase(cell) as usize].push(cell);
        }
        phases
    }

    fn synthesise(&mut self, phases: [Vec<(u32, u32)>; 4]) {
        for cells in phases {
            let boards = par::map_chunks(cells.len(), 1, |i| self.cell(cells[i.start]));
            for (cell, (board, counters)) in cells.into_iter().zip(boards) {
                self.counters.add(&counters);
                self.store(cell, &board);
            }
        }
    }

    /// Synthesises one cell.
    fn cell(&self, cell: (u32, u32)) -> (Board, ImageCounters) {
        let mut board = self.board(cell);
        let counters = self.walk.fill(&mut board, self.task.guide);
        if let Some(metrics) = self.task.metrics {
            refine_board(self.task.jumps, metrics, self.task.guide, self.task.refine, &mut board);
        }
        (board, counters)
    }

    /// The board of a cell: itself, empty, and what is there around it.
    fn board(&self, cell: (u32, u32)) -> Board {
        let [w, h] = self.size(cell);
        let canvas = self.task.walk.size;
        let tiles = self.task.walk.tileable;
        if self.columns() * self.rows() == 1 {
            let mut board = Board::whole(canvas, tiles);
            if let Some(given) = self.task.given {
                board.sources.copy_from_slice(given);
                board.given = Some(given.iter().map(|s| *s != EMPTY).collect());
            }
            return board;
        }
        let before: Vec<_> = self.around(cell).into_iter().filter(|n| Self::phase(n.1) < Self::phase(cell)).collect();
        // Context on the sides where something is there, at most up to the canvas' border.
        let [mut low, mut high, mut open_low, mut open_high] = [[0; 2]; 4];
        for ([dx, dy], _) in &before {
            for (axis, d) in [*dx, *dy].into_iter().enumerate() {
                if d < 0 {
                    (low[axis], open_low[axis]) = (MARGIN + CONTEXT, MARGIN);
                } else if d > 0 {
                    (high[axis], open_high[axis]) = (MARGIN + CONTEXT, MARGIN);
                }
            }
        }
        let begin = [self.cuts[0][cell.1 as usize], self.cuts[1][cell.0 as usize]];
        let origin = [0, 1].map(|a| (begin[a] + canvas[a] - low[a]) % canvas[a]);
        let size = [w + low[0] + high[0], h + low[1] + high[1]];
        let wraps = [tiles && self.columns() == 1, tiles && self.rows() == 1];
        let mut sources = vec![EMPTY; size[0] as usize * size[1] as usize];
        self.copy_out(origin, size, &mut sources);
        let cell = Rect { x: low[0], y: low[1], width: w, height: h };
        let open = Rect {
            x: low[0] - open_low[0],
            y: low[1] - open_low[1],
            width: w + open_low[0] + open_high[0],
            height: h + open_low[1] + open_high[1],
        };
        Board { canvas, origin, size, wraps, sources, cell, open, given: None }
    }

    /// Calls `f(cell, column and row in it, column and row in the rectangle, length)` for each run of pixels of a rectangle
    /// that lies in one cell; the rectangle may reach across the borders of a canvas that wraps.
    fn each_run(&self, origin: [u32; 2], size: [u32; 2], mut f: impl FnMut((u32, u32), [u32; 2], [u32; 2], u32)) {
        let [w, h] = self.task.walk.size;
        for y in 0..size[1] {
            let cy = (origin[1] + y) % h;
            let row = self.cell_at(1, cy);
            let mut x = 0;
            while x < size[0] {
                let cx = (origin[0] + x) % w;
                let column = self.cell_at(0, cx);
                let len = (self.cuts[0][column as usize + 1] - cx).min(size[0] - x);
                let within = [cx - self.cuts[0][column as usize], cy - self.cuts[1][row as usize]];
                f((row, column), within, [x, y], len);
                x += len;
            }
        }
    }

    /// Copies what is known of a rectangle.
    fn copy_out(&self, origin: [u32; 2], size: [u32; 2], out: &mut [[u16; 2]]) {
        self.each_run(origin, size, |cell, from, to, len| {
            if let Some(sources) = self.cells.get(&cell) {
                let a = from[1] as usize * self.size(cell)[0] as usize + from[0] as usize;
                let b = to[1] as usize * size[0] as usize + to[0] as usize;
                out[b..b + len as usize].copy_from_slice(&sources[a..a + len as usize]);
            }
        });
    }

    /// Keeps a cell and what its corrections changed around it.
    fn store(&mut self, cell: (u32, u32), board: &Board) {
        let size = self.size(cell);
        self.cells.insert(cell, vec![EMPTY; size[0] as usize * size[1] as usize]);
        let mut cells = std::mem::take(&mut self.cells);
        self.each_run(board.origin, board.size, |to, at, from, len| {
            if let Some(sources) = cells.get_mut(&to) {
                let a = board.index(from[0], from[1]);
                let b = at[1] as usize * self.size(to)[0] as usize + at[0] as usize;
                let part = &board.sources[a..a + len as usize];
                for (to, from) in sources[b..b + len as usize].iter_mut().zip(part) {
                    if *from != EMPTY {
                        *to = *from;
                    }
                }
            }
        });
        self.cells = cells;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::exemplar::AnalysisParams;
    use crate::synth::image::guide::GuideMap;
    use crate::synth::image::order::ImageOrder;
    use crate::synth::image::walk::walk;
    use crate::synth::testing::{brute_force_map, noise};
    use crate::texture::{MapKind, MapSet, Texture};

    struct World {
        jumps: JumpMap,
        metrics: SeamMetrics,
    }

    fn world() -> World {
        let t = noise(24, 20);
        let metrics = SeamMetrics::new(&MapSet::new(vec![(MapKind::Height, t.clone())]), &AnalysisParams::default());
        World { jumps: brute_force_map(&t, 1, 3, 2.0), metrics: metrics.unwrap() }
    }

    fn task(world: &World, size: [u32; 2], tileable: bool, refine: u32) -> ImageTask<'_> {
        let walk = ImageWalkParams { size, order: ImageOrder::Hilbert, patch: 1.0, seed: 5, tileable };
        ImageTask { jumps: &world.jumps, metrics: Some(&world.metrics), walk, refine, guide: None, given: None }
    }

    #[test]
    fn a_small_canvas_is_the_published_walk() {
        let w = world();
        let t = task(&w, [90, 70], false, 0);
        let out = ImageCanvas::new(t).unwrap().window(Rect::whole([90, 70]));
        assert_eq!(out, walk(&w.jumps, &t.walk).unwrap());
    }

    #[test]
    fn windows_and_strips_show_what_the_whole_shows() {
        let w = world();
        for (size, tileable) in [([1100, 700], false), ([1100, 560], true), ([600, 250], true)] {
            let t = task(&w, size, tileable, 1);
            let whole = ImageCanvas::new(t).unwrap().window(Rect::whole(size));
            assert!(whole.sources.iter().all(|s| *s != EMPTY), "{size:?}");
            let part = |x, y, width, height| {
                let r = Rect { x, y, width, height };
                let got = ImageCanvas::new(t).unwrap().window(r);
                assert!(got.sources == whole.window(r).sources, "{size:?} {r:?}");
            };
            part(size[0] - 3, size[1] - 5, 3, 5);
            part(size[0] / 2 - 20, size[1] / 2 - 30, 50, 60);
            if tileable {
                // A corner with what is around it, from all four corners of the canvas.
                let around = Rect { x: 0, y: 0, width: 4, height: 3 }.with_apron(2, size, true);
                let got = ImageCanvas::new(t).unwrap().stretch(around.origin, around.size);
                for (i, s) in got.sources.iter().enumerate() {
                    let [x, y] = [i as u32 % 8, i as u32 / 8].map(|v| v as usize);
                    let [x, y] =
                        [(x + size[0] as usize - 2) % size[0] as usize, (y + size[1] as usize - 2) % size[1] as usize];
                    assert!(*s == whole.sources[y * size[0] as usize + x], "{size:?} {x} {y}");
                }
            }
            let mut strips = ImageCanvas::new(t).unwrap();
            for y in (0..size[1]).step_by(170) {
                let r = Rect { x: 0, y, width: size[0], height: 170.min(size[1] - y) };
                strips.forget_above(y);
                assert!(strips.window(r).sources == whole.window(r).sources, "{size:?} {r:?}");
            }
        }
    }

    #[test]
    fn a_window_leaves_most_of_a_large_canvas_alone() {
        let w = world();
        let mut canvas = ImageCanvas::new(task(&w, [16384, 16384], false, 0)).unwrap();
        let out = canvas.window(Rect { x: 9000, y: 7000, width: 40, height: 30 });
        assert!(out.sources.iter().all(|s| *s != EMPTY));
        assert!(canvas.cells.len() <= 25, "{} cells", canvas.cells.len());
    }

    #[test]
    fn threads_do_not_change_it() {
        let w = world();
        let run = |jobs| {
            let t = task(&w, [1100, 560], true, 1);
            par::install(jobs, || ImageCanvas::new(t).unwrap().window(Rect::whole([1100, 560])))
        };
        assert!(run(1) == run(3));
    }

    #[test]
    fn a_hole_is_filled_and_what_is_given_stays() {
        let w = world();
        let given: Vec<[u16; 2]> = (0..24 * 20u16)
            .map(|i| [i % 24, i / 24])
            .map(|[x, y]| if (8..15).contains(&x) && (6..12).contains(&y) { EMPTY } else { [x, y] })
            .collect();
        let t = ImageTask { given: Some(&given), ..task(&w, [24, 20], false, 2) };
        let out = ImageCanvas::new(t).unwrap().window(Rect::whole([24, 20]));
        for (got, given) in out.sources.iter().zip(&given) {
            assert!(*got != EMPTY && (*given == EMPTY || got == given));
        }
        assert_eq!(out.counters.seeds, 0);
    }

    #[test]
    fn a_guide_decides_which_part_is_shown() {
        // Left half dark, right half bright; the target is a checkerboard of large squares.
        let t = Texture::from_fn(40, 30, 1, |x, y, out| {
            out[0] = if x < 20 { 0.2 } else { 0.7 } + ((x * 7 + y * 3) % 5) as f32 * 0.04
        });
        let metrics = SeamMetrics::new(&MapSet::new(vec![(MapKind::Height, t.clone())]), &AnalysisParams::default());
        let w = World { jumps: brute_force_map(&t, 1, 3, 2.0), metrics: metrics.unwrap() };
        let side = |x: u32, y: u32| (x / 50 + y / 50) % 2;
        let target = GuideMap::from_fn([150, 100], |x, y| [side(x, y) as u8 * 255; 3]);
        let source = GuideMap::from_fn([40, 30], |x, _| [(x / 20) as u8 * 255; 3]);
        let guide = Guide::new(target, source, w.jumps.domain(), 1.0).unwrap();
        for refine in [0, 2] {
            let t = ImageTask { guide: Some(&guide), ..task(&w, [150, 100], false, refine) };
            let out = ImageCanvas::new(t).unwrap().window(Rect::whole([150, 100]));
            let wrong = |(i, s): (usize, &[u16; 2])| u32::from(s[0] / 20) != side(i as u32 % 150, i as u32 / 150);
            let share = out.sources.iter().enumerate().filter(|s| wrong(*s)).count() as f64 / 15_000.0;
            assert!(share < 0.02, "refine {refine}: {share}");
        }
    }

    #[test]
    fn what_does_not_fit_is_named() {
        let w = world();
        let fault = |t: ImageTask| ImageCanvas::new(t).err().map(|e| e.to_string()).unwrap_or_default();
        assert!(fault(task(&w, [0, 5], false, 0)).contains("0 x 5"));
        let t = ImageTask { given: Some(&[]), ..task(&w, [5, 5], false, 0) };
        assert_eq!(fault(t), "0 given sources: expected 25");
        let map = |size| GuideMap::from_fn(size, |_, _| [0; 3]);
        let guide = Guide::new(map([4, 4]), map([24, 20]), w.jumps.domain(), 1.0).unwrap();
        let t = ImageTask { guide: Some(&guide), ..task(&w, [5, 5], false, 0) };
        assert_eq!(fault(t), "a guide of 4 x 4 pixels for a canvas of 5 x 5");
    }
}
