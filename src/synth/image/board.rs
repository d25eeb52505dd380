//! A board: the part of a canvas that is being synthesised, with what is already there around it.
//!
//! Unaware of: how the canvas is cut up, jump maps, colours.

use super::source_map::{EMPTY, Rect};

/// Part of a canvas.
#[derive(Clone, Debug)]
pub(super) struct Board {
    /// Size of the canvas.
    pub canvas: [u32; 2],
    /// Column and row of the canvas that the first pixel is; modulo the canvas where that wraps.
    pub origin: [u32; 2],
    /// Columns and rows.
    pub size: [u32; 2],
    /// True along axes on which the board is the whole canvas and wraps.
    pub wraps: [bool; 2],
    /// Sources, [`EMPTY`] where there is none.
    pub sources: Vec<[u16; 2]>,
    /// The pixels to synthesise, those of them that are empty.
    pub cell: Rect,
    /// The pixels that corrections may change; what lies outside is context.
    pub open: Rect,
    /// Pixels that the user gave: never changed.
    pub given: Option<Vec<bool>>,
}

impl Board {
    /// A whole canvas, empty.
    pub fn whole(size: [u32; 2], tileable: bool) -> Self {
        let cell = Rect::whole(size);
        let sources = vec![EMPTY; cell.len()];
        Board { canvas: size, origin: [0, 0], size, wraps: [tileable; 2], sources, cell, open: cell, given: None }
    }

    /// Index of a pixel.
    #[inline(always)]
    pub fn index(&self, x: u32, y: u32) -> usize {
        y as usize * self.size[0] as usize + x as usize
    }

    /// Number of a pixel on the canvas, row by row: the address of its random numbers.
    #[inline(always)]
    pub fn number(&self, x: u32, y: u32) -> u64 {
        let [cx, cy] = self.on_canvas(x, y);
        u64::from(cy) * u64::from(self.canvas[0]) + u64::from(cx)
    }

    /// Column and row of the canvas that a pixel is.
    #[inline(always)]
    pub fn on_canvas(&self, x: u32, y: u32) -> [u32; 2] {
        let wrapped = |v: u32, n: u32| if v >= n { v - n } else { v };
        [wrapped(self.origin[0] + x, self.canvas[0]), wrapped(self.origin[1] + y, self.canvas[1])]
    }

    /// Indices of the four neighbours; the pixel itself for one that does not exist.
    #[inline(always)]
    pub fn beside(&self, x: u32, y: u32) -> [usize; 4] {
        let [w, h] = self.size;
        let at = self.index(x, y);
        let row = w as usize;
        let pick = |inside: bool, near: usize, wraps: bool, across: usize| match (inside, wraps) {
            (true, _) => near,
            (false, true) => across,
            (false, false) => at,
        };
        [
            pick(x > 0, at.wrapping_sub(1), self.wraps[0], at + row - 1),
            pick(x + 1 < w, at + 1, self.wraps[0], (at + 1).wrapping_sub(row)),
            pick(y > 0, at.wrapping_sub(row), self.wraps[1], (h - 1) as usize * row + x as usize),
            pick(y + 1 < h, at + row, self.wraps[1], x as usize),
        ]
    }

    /// True if a pixel may be changed.
    #[inline(always)]
    pub fn is_open(&self, x: u32, y: u32) -> bool {
        let Rect { x: ox, y: oy, width, height } = self.open;
        let inside = x.wrapping_sub(ox) < width && y.wrapping_sub(oy) < height;
        inside && self.given.as_ref().is_none_or(|g| !g[self.index(x, y)])
    }

    /// The empty pixels of `order` from those beside known ones inwards, ties in that order; all of them in that order if
    /// nothing is known.
    pub fn inwards(&self, order: &[[u32; 2]], sources: &[[u16; 2]]) -> Vec<[u32; 2]> {
        let mut rank = vec![u32::MAX; sources.len()];
        for (i, &[x, y]) in order.iter().enumerate() {
            rank[self.index(x, y)] = i as u32;
        }
        let mut seen: Vec<bool> = sources.iter().map(|s| *s != EMPTY).collect();
        if seen.iter().all(|s| !s) {
            return order.to_vec();
        }
        let place = |i: usize| [(i % self.size[0] as usize) as u32, (i / self.size[0] as usize) as u32];
        let mut front: Vec<usize> = (0..seen.len()).filter(|i| seen[*i]).collect();
        let mut out = Vec::with_capacity(order.len());
        while !front.is_empty() {
            let mut next = vec![];
            for i in front {
                let [x, y] = place(i);
                for n in self.beside(x, y) {
                    if !seen[n] && rank[n] != u32::MAX {
                        seen[n] = true;
                        next.push(n);
                    }
                }
            }
            next.sort_unstable_by_key(|i| rank[*i]);
            out.extend(next.iter().map(|i| place(*i)));
            front = next;
        }
        // Parts that touch nothing known.
        out.extend(order.iter().filter(|p| !seen[self.index(p[0], p[1])]));
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbours_wrap_where_the_board_does() {
        let mut b = Board::whole([3, 2], true);
        assert_eq!(b.beside(0, 0), [2, 1, 3, 3]);
        assert_eq!(b.beside(2, 1), [4, 3, 2, 2]);
        b.wraps = [false; 2];
        assert_eq!(b.beside(0, 0), [0, 1, 0, 3]);
        let b = Board { origin: [8, 3], canvas: [10, 4], ..Board::whole([3, 2], false) };
        assert_eq!((b.on_canvas(2, 1), b.number(2, 1)), ([0, 0], 0));
    }

    #[test]
    fn holes_fill_from_their_rim() {
        let mut b = Board::whole([5, 1], false);
        let order: Vec<[u32; 2]> = (0..5).map(|x| [x, 0]).collect();
        assert_eq!(b.inwards(&order, &b.sources), order);
        b.sources[0] = [0, 0];
        b.sources[4] = [1, 0];
        assert_eq!(b.inwards(&order[1..4], &b.sources), [[1, 0], [3, 0], [2, 0]]);
    }
}
