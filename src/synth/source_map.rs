//! Source maps: for every pixel of an image, or of a window of one, the texel of the exemplar that it shows.
//!
//! Unaware of: how the sources were found, what the texels show.

use crate::numerics::par;

/// How often the walk did what.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ImageCounters {
    /// Pixels without a synthesised neighbour: a random texel (the first pixel of a part of the canvas only).
    pub seeds: u64,
    /// Jumps taken by choice.
    pub jumps: u64,
    /// Jumps taken because going on would have left the exemplar or what a guide asks for.
    pub forced_jumps: u64,
    /// Pixels whose chosen neighbour led nowhere, continued from another neighbour.
    pub dead_ends: u64,
    /// Pixels for which no neighbour led anywhere: a jump of the source without the offset.
    pub unshifted_jumps: u64,
    /// Pixels that got a random texel as the last resort.
    pub random_fallbacks: u64,
}

impl ImageCounters {
    /// Adds the counts of another part.
    pub fn add(&mut self, o: &ImageCounters) {
        let ImageCounters { seeds, jumps, forced_jumps, dead_ends, unshifted_jumps, random_fallbacks } = o;
        self.seeds += seeds;
        self.jumps += jumps;
        self.forced_jumps += forced_jumps;
        self.dead_ends += dead_ends;
        self.unshifted_jumps += unshifted_jumps;
        self.random_fallbacks += random_fallbacks;
    }
}

/// Marks a pixel not yet synthesised; no texel, since sides are at most 65535.
pub const EMPTY: [u16; 2] = [u16::MAX; 2];

/// A rectangle of pixels: its first column and row, and its size.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rect {
    /// First column.
    pub x: u32,
    /// First row.
    pub y: u32,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

impl Rect {
    /// The rectangle of a whole image.
    pub fn whole([width, height]: [u32; 2]) -> Rect {
        Rect { x: 0, y: 0, width, height }
    }

    /// Number of pixels.
    pub fn len(&self) -> usize {
        self.width as usize * self.height as usize
    }

    /// True without pixels.
    pub fn is_empty(&self) -> bool {
        self.width == 0 || self.height == 0
    }

    /// True if all of it lies in an image of that size.
    pub fn fits(&self, [width, height]: [u32; 2]) -> bool {
        u64::from(self.x) + u64::from(self.width) <= width.into()
            && u64::from(self.y) + u64::from(self.height) <= height.into()
    }
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

impl SourceMap {
    /// The part in a rectangle that fits; nothing is known beyond its borders. Panics if it does not fit.
    pub fn window(&self, r: Rect) -> SourceMap {
        assert!(r.fits([self.width, self.height]), "a window of {r:?} in {} x {}", self.width, self.height);
        let mut sources = vec![EMPTY; r.len()];
        par::for_rows(&mut sources, r.width as usize, |y, row| {
            let from = (r.y as usize + y) * self.width as usize + r.x as usize;
            row.copy_from_slice(&self.sources[from..from + row.len()]);
        });
        let SourceMap { exemplar_size, counters, .. } = *self;
        SourceMap { width: r.width, height: r.height, exemplar_size, sources, tileable: false, counters }
    }
}
