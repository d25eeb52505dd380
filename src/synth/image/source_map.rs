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

/// A rectangle with what is around it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Surroundings {
    /// Column and row of the canvas that its first pixel is.
    pub origin: [u32; 2],
    /// Columns and rows. Where the canvas wraps they may go on beyond its borders.
    pub size: [u32; 2],
    /// The rectangle, seen from the origin.
    pub part: Rect,
}

impl Rect {
    /// The rectangle with `apron` more pixels on each side: up to the borders of a canvas of that size, or from the other
    /// side of one that wraps.
    pub fn with_apron(&self, apron: u32, canvas: [u32; 2], wraps: bool) -> Surroundings {
        let axis = |from: u32, len: u32, side: u32| {
            if wraps {
                let before = (from + side - apron % side) % side;
                return (before, len + 2 * apron, apron);
            }
            let before = apron.min(from);
            (from - before, before + len + apron.min(side - from - len), before)
        };
        let (x, width, left) = axis(self.x, self.width, canvas[0]);
        let (y, height, above) = axis(self.y, self.height, canvas[1]);
        let part = Rect { x: left, y: above, width: self.width, height: self.height };
        Surroundings { origin: [x, y], size: [width, height], part }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_apron_ends_at_borders_or_reaches_across_them() {
        let r = Rect { x: 1, y: 6, width: 4, height: 3 };
        let cut = r.with_apron(2, [10, 10], false);
        let part = Rect { x: 1, y: 2, width: 4, height: 3 };
        assert_eq!(cut, Surroundings { origin: [0, 4], size: [7, 6], part });
        let wrapped = r.with_apron(2, [10, 10], true);
        let part = Rect { x: 2, y: 2, width: 4, height: 3 };
        assert_eq!(wrapped, Surroundings { origin: [9, 4], size: [8, 7], part });
        let around = Rect::whole([1, 1]).with_apron(2, [1, 1], true);
        assert_eq!((around.origin, around.size), ([0, 0], [5, 5]));
    }
}
