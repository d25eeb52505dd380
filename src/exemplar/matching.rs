//! Which texels look alike: the best matches of every texel outside a disc around it.
//!
//! Source: \[ZG02\] section 2.1, with another search than its kd-tree; the propagation of matches is Ashikhmin's coherence
//! (2001), as in PatchMatch (Barnes et al. 2009).
//! Reads as: the beta k matches of \[ZG02\] 2.2 are counted outside the disc around the texel itself. Those inside would
//! all be refused, and on a smooth sample they are all there are among the nearest.
//! Unaware of: what the vectors stand for, probabilities.

use crate::numerics::knn::{self, Effort, Lists, Neighbours, Points};
use crate::texture::Wrap;

/// The texels of an exemplar and the disc around each.
#[derive(Clone, Copy)]
pub(crate) struct Grid {
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) wrap: Wrap,
    /// Least distance of two texels in texels.
    pub(crate) min_distance: f64,
}

impl Grid {
    /// True if two texels are at least the minimum distance apart; on a torus the short way counts.
    #[inline]
    pub(crate) fn apart(&self, a: u32, b: u32) -> bool {
        // Far apart in the order of rows is far apart; only the rest needs divisions.
        let (d, reach) = (a.abs_diff(b), (self.min_distance as u32 + 1).saturating_mul(self.width + 1));
        if d > reach && d < (self.width * self.height).saturating_sub(reach) {
            return true;
        }
        let along = |a: u32, b: u32, n: u32| {
            let d = a.abs_diff(b);
            u64::from(if self.wrap == Wrap::Repeat { d.min(n - d) } else { d })
        };
        let dx = along(a % self.width, b % self.width, self.width);
        let dy = along(a / self.width, b / self.width, self.height);
        (dx * dx + dy * dy) as f64 >= self.min_distance * self.min_distance
    }

    /// The texel at an offset, if there is one.
    #[inline]
    fn shifted(&self, texel: u32, (dx, dy): (i32, i32)) -> Option<u32> {
        let axis = |i: u32, d: i32, n: u32| match self.wrap {
            Wrap::Repeat => Some(self.wrap.index(i64::from(i) + i64::from(d), n)),
            Wrap::Clamp => i.checked_add_signed(d).filter(|i| *i < n),
        };
        let x = axis(texel % self.width, dx, self.width)?;
        let y = axis(texel / self.width, dy, self.height)?;
        Some(y * self.width + x)
    }
}

/// Exemplars of up to this many texels are searched exhaustively.
const EXHAUSTIVE: usize = 4096;

/// Shorter lists do not carry matches well from texel to texel.
const LEAST_LIST: usize = 15;

/// Clusters that are probed for lists of `LEAST_LIST`; see the figures in [`matches()`].
const PROBES: usize = 144;

const AROUND: [(i32, i32); 8] = [(-1, 0), (1, 0), (0, -1), (0, 1), (-1, -1), (1, 1), (1, -1), (-1, 1)];

/// The `count` best matches of every texel (or a few more), each at least the minimum distance from it.
///
/// Share of the true matches after each pass, on noise of 73 components (soil 256x256, 128 probes): clusters 0.67; matches
/// of the texels around 0.93; matches of matches 0.950; again those around 0.955. With 96 probes the end is 0.944. Most
/// exemplars have fewer components and stop probing earlier.
pub(crate) fn matches(points: &Points, grid: Grid, count: usize) -> Neighbours {
    let length = count.max(LEAST_LIST);
    let apart = |a, b| grid.apart(a, b);
    if points.len() <= EXHAUSTIVE {
        return knn::search(points, length, Effort::Exact, apart);
    }
    let mut found = knn::search(points, length, Effort::Probes(PROBES * length / LEAST_LIST), apart);
    found.refine(points, apart, |texel, lists, out| propagate(grid, texel, lists, out));
    found.refine(points, apart, relay);
    found.refine(points, apart, |texel, lists, out| propagate(grid, texel, lists, out));
    found
}

/// Where the texels around a texel found a match lately, shifted back by one.
fn propagate(grid: Grid, texel: u32, lists: &Lists, out: &mut Vec<u32>) {
    for (dx, dy) in AROUND {
        if let Some(beside) = grid.shifted(texel, (dx, dy)) {
            let fresh = lists.row(beside).filter(|m| m.1);
            out.extend(fresh.filter_map(|(m, _)| grid.shifted(m, (-dx, -dy))));
        }
    }
}

/// The matches of matches, if either is new.
fn relay(texel: u32, lists: &Lists, out: &mut Vec<u32>) {
    for (m, fresh) in lists.row(texel) {
        out.extend(lists.row(m).filter(|q| fresh || q.1).map(|q| q.0));
    }
}
