//! Which texels look alike: the best matches of every texel outside a disc around it.
//!
//! Source: \[ZG02\] section 2.1, with another search than its kd-tree; the propagation of matches is Ashikhmin's coherence
//! (2001), as in PatchMatch (Barnes et al. 2009); the matches of matches are those of k-coherence (Tong et al. 2002) and
//! of NN-descent (Dong, Moses, Li 2011).
//! Reads as: the beta k matches of \[ZG02\] 2.2 are counted outside the disc around the texel itself. Those inside would
//! all be refused, and on a smooth sample they are all there are among the nearest. Texels of different samples are
//! apart however near they lie in the sheet.
//! Unaware of: what the vectors stand for, probabilities.

use super::sheet::{Area, Subject};
use crate::numerics::knn::{self, Effort, Lists, Neighbours, Points};
use crate::texture::Wrap;

/// The points of an exemplar in the plane: which lies where, what lies beside each, and the disc around each.
///
/// Places count the texels of a table in which every sample has a border of [`REACH`] places. There are no points there,
/// or on a torus those of the other side, so that a step to a texel nearby is one addition and one look-up.
pub(crate) struct Grid {
    /// Places per row.
    stride: u32,
    /// Columns and rows of the one sample, if it is a torus.
    torus: Option<(u32, u32)>,
    /// The square of the minimum distance, rounded up: squared distances are whole.
    min_squared: u64,
    /// The first place of each sample.
    starts: Vec<u32>,
    /// The place of each point.
    places: Vec<u32>,
    /// Column and row of each place.
    at: Vec<[u32; 2]>,
    /// The point at each place, or [`NONE`].
    points: Vec<u32>,
}

/// Longest step of a propagation along an axis.
const REACH: u32 = 2;
/// No point.
const NONE: u32 = u32::MAX;

impl Grid {
    /// The texels of a domain are numbered sample by sample, row by row.
    pub(crate) fn new(subject: &Subject, min_distance: f64) -> Self {
        let domain = &subject.domain;
        let stride = domain.width() + 2 * REACH;
        let torus = (domain.wrap() == Wrap::Repeat).then_some((domain.width(), domain.height()));
        let rows = |a: &Area| a.height + 2 * REACH;
        let mut grid = Grid {
            stride,
            torus,
            min_squared: (min_distance * min_distance).ceil() as u64,
            starts: vec![],
            places: Vec::with_capacity(domain.len()),
            at: Vec::with_capacity(domain.len()),
            points: vec![NONE; (stride * subject.areas.iter().map(rows).sum::<u32>()) as usize],
        };
        let mut start = 0;
        for area in &subject.areas {
            grid.starts.push(start);
            for (y, x) in (0..area.height).flat_map(|y| (0..area.width).map(move |x| (y, x))) {
                if domain.contains(x as i32, (area.y + y) as i32) {
                    let place = start + (y + REACH) * stride + x + REACH;
                    grid.points[place as usize] = grid.places.len() as u32;
                    grid.places.push(place);
                    grid.at.push([place % stride, place / stride]);
                }
            }
            start += rows(area) * stride;
        }
        grid.wrap_border();
        grid
    }

    /// Fills the border of a torus.
    fn wrap_border(&mut self) {
        let Some((w, h)) = self.torus else { return };
        let inner = |i: u32, n: u32| Wrap::Repeat.index(i64::from(i) - i64::from(REACH), n) + REACH;
        for (y, x) in (0..h + 2 * REACH).flat_map(|y| (0..w + 2 * REACH).map(move |x| (y, x))) {
            self.points[(y * self.stride + x) as usize] =
                self.points[(inner(y, h) * self.stride + inner(x, w)) as usize];
        }
    }

    /// True if two points are at least the minimum distance apart; on a torus the short way counts.
    #[inline]
    pub(crate) fn apart(&self, a: u32, b: u32) -> bool {
        let ([ax, ay], [bx, by]) = (self.at[a as usize], self.at[b as usize]);
        let along = |a: u32, b: u32, n: Option<u32>| {
            let d = a.abs_diff(b);
            u64::from(n.map_or(d, |n| d.min(n - d)))
        };
        let dx = along(ax, bx, self.torus.map(|t| t.0));
        let dy = along(ay, by, self.torus.map(|t| t.1));
        if dx * dx + dy * dy >= self.min_squared {
            return true;
        }
        let sample = |row: u32| self.starts.partition_point(|s| *s <= row * self.stride);
        self.starts.len() > 1 && sample(ay) != sample(by)
    }

    /// The difference of places of a step.
    fn step(&self, (dx, dy): (i32, i32)) -> i32 {
        dy * self.stride as i32 + dx
    }

    /// The point a step away from a point, if there is one.
    #[inline]
    fn shifted(&self, point: u32, step: i32) -> Option<u32> {
        let place = self.places[point as usize].wrapping_add_signed(step);
        Some(self.points[place as usize]).filter(|p| *p != NONE)
    }
}

/// Exemplars of up to this many texels are searched exhaustively.
const EXHAUSTIVE: usize = 4096;

/// Shorter lists do not carry matches well from texel to texel.
const LEAST_LIST: usize = 15;

/// Clusters that are probed for lists of `LEAST_LIST` in an exemplar of 256 x 256; see the figures in [`matches()`].
const PROBES: usize = 192;

/// Of longer lists only so many entries are looked at for matches of matches.
const RELAYED: usize = 32;

/// Where matches are propagated from. Eight more, diagonal and three texels away, raise the recall on granite by 0.002 and
/// cost a tenth of the whole search.
const AROUND: [(i32, i32); 8] = [(-1, 0), (1, 0), (0, -1), (0, 1), (-2, 0), (2, 0), (0, -2), (0, 2)];

/// The `count` best matches of every texel (or a few more), each at least the minimum distance from it.
pub(crate) fn matches(points: &Points, grid: &Grid, count: usize) -> Neighbours {
    let length = count.max(LEAST_LIST);
    let apart = |a, b| grid.apart(a, b);
    if points.len() <= EXHAUSTIVE {
        return knn::search(points, length, Effort::Exact, apart);
    }
    // The more points there are, the smaller a part of them a probe is.
    let doublings = (points.len() >> 16).max(1).ilog2() as usize;
    let probes = (PROBES + 24 * doublings) * length / LEAST_LIST;
    let length = length + length * doublings / 7;
    let steps = AROUND.map(|d| grid.step(d));
    let propagate = |texel, lists: &Lists, out: &mut Vec<u32>| propagate(grid, &steps, texel, lists, out);
    let mut found = knn::search(points, length, Effort::Probes(probes), apart);
    found.refine(points, apart, propagate);
    found.refine(points, apart, relay);
    found.refine(points, apart, propagate);
    found
}

/// Where the texels around a texel found a match lately, shifted back.
fn propagate(grid: &Grid, steps: &[i32], texel: u32, lists: &Lists, out: &mut Vec<u32>) {
    for &step in steps {
        if let Some(beside) = grid.shifted(texel, step) {
            let fresh = lists.row(beside).filter(|m| m.1);
            out.extend(fresh.filter_map(|(m, _)| grid.shifted(m, -step)));
        }
    }
}

/// The matches of matches, if either is new.
fn relay(texel: u32, lists: &Lists, out: &mut Vec<u32>) {
    for (m, fresh) in lists.row(texel).take(RELAYED) {
        out.extend(lists.row(m).take(RELAYED).filter(|q| fresh || q.1).map(|q| q.0));
    }
}
