//! The jump map: for every exemplar texel, a short list of texels with similar neighbourhoods.
//!
//! Source: \[ZG02\] section 2; fractional look-ups: \[ZG03\] section 4.2.3 and figure 5.
//! Unaware of: how the lists were found, meshes, files.

use super::Domain;
use crate::texture::{Texel, Wrap, texel};

/// One jump: a destination texel and the probability of taking it (\[ZG02\] Eq. 1).
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Jump {
    /// Column of the destination.
    pub x: u16,
    /// Row of the destination.
    pub y: u16,
    /// Probability, 0 < p <= 1/k.
    pub p: f32,
}

/// A jump from a fractional position: its destination is fractional too.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FloatJump {
    /// Destination in texels.
    pub to: Texel,
    /// Weight, the bilinear share of the row times its probability.
    pub weight: f32,
}

/// For each texel of an exemplar its jumps, best first; the probabilities of a texel sum to at most 1 and what is
/// missing is the probability of no jump (\[ZG02\] Eq. 2).
#[derive(Clone, Debug, PartialEq)]
pub struct JumpMap {
    domain: Domain,
    starts: Vec<u32>,
    jumps: Vec<Jump>,
}

impl JumpMap {
    /// Builds from one row of jumps per texel, row by row. Panics if the number of rows is not `width * height`, a
    /// destination lies outside, a side exceeds 65535 or a row 255 jumps.
    pub fn from_rows(width: u32, height: u32, rows: &[Vec<Jump>]) -> Self {
        Self::over(Domain::full(width, height, Wrap::Clamp), rows)
    }

    /// As [`JumpMap::from_rows`], for the texels of a domain; those that do not belong have no jumps.
    pub fn over(domain: Domain, rows: &[Vec<Jump>]) -> Self {
        let (width, height) = (domain.width(), domain.height());
        assert_eq!(rows.len(), width as usize * height as usize, "one row per texel");
        let mut starts = Vec::with_capacity(rows.len() + 1);
        starts.push(0);
        let mut jumps = Vec::with_capacity(rows.iter().map(Vec::len).sum());
        for row in rows {
            assert!(row.len() <= 255, "{} jumps of one texel", row.len());
            for j in row {
                assert!(domain.contains(j.x.into(), j.y.into()), "a jump out of the exemplar");
            }
            jumps.extend_from_slice(row);
            starts.push(jumps.len() as u32);
        }
        JumpMap { domain, starts, jumps }
    }

    /// From the number of jumps of each texel of a domain and all jumps, row by row, which must fit.
    pub(super) fn from_counts(domain: Domain, counts: &[u8], jumps: Vec<Jump>) -> Self {
        let mut counts = counts.iter();
        let (mut starts, mut next) = (vec![0], 0);
        starts.reserve_exact(domain.width() as usize * domain.height() as usize);
        for (y, x) in (0..domain.height()).flat_map(|y| (0..domain.width()).map(move |x| (y, x))) {
            if domain.contains(x as i32, y as i32) {
                next += counts.next().map_or(0, |c| u32::from(*c));
            }
            starts.push(next);
        }
        debug_assert!(counts.next().is_none() && next as usize == jumps.len(), "{next} jumps of {}", jumps.len());
        debug_assert!(jumps.iter().all(|j| domain.contains(j.x.into(), j.y.into())), "a jump out of the exemplar");
        JumpMap { domain, starts, jumps }
    }

    /// The texels that may be sources.
    pub fn domain(&self) -> &Domain {
        &self.domain
    }

    /// Texels per row of the exemplar.
    pub fn width(&self) -> u32 {
        self.domain.width()
    }

    /// Rows of the exemplar.
    pub fn height(&self) -> u32 {
        self.domain.height()
    }

    /// The number of jumps of each texel, row by row, and all jumps in that order.
    pub(super) fn parts(&self) -> (impl Iterator<Item = u8> + '_, &[Jump]) {
        (self.starts.windows(2).map(|w| (w[1] - w[0]) as u8), &self.jumps)
    }

    /// Jumps of a texel, best first. Panics outside.
    pub fn row(&self, x: u32, y: u32) -> &[Jump] {
        assert!(x < self.domain.width(), "column {x} of {}", self.domain.width());
        let i = y as usize * self.domain.width() as usize + x as usize;
        &self.jumps[self.starts[i] as usize..self.starts[i + 1] as usize]
    }

    /// Appends to `out` the jumps at a fractional position: those of the four surrounding texel centres, weighted
    /// bilinearly, destinations shifted by the sub-texel part. Positions beyond the outer centres use the border rows.
    /// Source: \[ZG03\] 4.2.3, Fig. 5.
    pub fn look_up(&self, pos: Texel, out: &mut Vec<FloatJump>) {
        let (fx, fy) = (pos.x - 0.5, pos.y - 0.5);
        let x0 = fx.floor().clamp(0.0, (self.domain.width() - 1) as f32);
        let y0 = fy.floor().clamp(0.0, (self.domain.height() - 1) as f32);
        let (tx, ty) = ((fx - x0).clamp(0.0, 1.0), (fy - y0).clamp(0.0, 1.0));
        for (dy, wy) in [(0u32, 1.0 - ty), (1, ty)] {
            for (dx, wx) in [(0u32, 1.0 - tx), (1, tx)] {
                let (x, y, w) = (x0 as u32 + dx, y0 as u32 + dy, wx * wy);
                if w <= 0.0 || x >= self.domain.width() || y >= self.domain.height() {
                    continue;
                }
                // The row belongs to the centre (x + 0.5, y + 0.5); keep our distance from it.
                let (sx, sy) = (pos.x - x as f32, pos.y - y as f32);
                out.extend(
                    self.row(x, y)
                        .iter()
                        .map(|j| FloatJump { to: texel(f32::from(j.x) + sx, f32::from(j.y) + sy), weight: w * j.p }),
                );
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn look_ups_blend_the_four_rows_and_keep_the_sub_texel_part() {
        let mut rows = vec![vec![]; 16];
        rows[5] = vec![Jump { x: 3, y: 3, p: 0.4 }]; // texel (1, 1)
        rows[6] = vec![Jump { x: 0, y: 2, p: 0.2 }]; // texel (2, 1)
        let map = JumpMap::from_rows(4, 4, &rows);
        let mut out = vec![];
        map.look_up(texel(1.75, 1.5), &mut out);
        assert_eq!(out.len(), 2);
        assert_eq!(out[0], FloatJump { to: texel(3.75, 3.5), weight: 0.75 * 0.4 });
        assert_eq!(out[1], FloatJump { to: texel(-0.25, 2.5), weight: 0.25 * 0.2 });
        out.clear();
        map.look_up(texel(1.5, 1.5), &mut out);
        assert_eq!(out, [FloatJump { to: texel(3.5, 3.5), weight: 0.4 }]);
        map.look_up(texel(0.0, 4.0), &mut out); // the corner uses the border rows: no panic
    }
}
