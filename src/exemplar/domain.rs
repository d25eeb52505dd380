//! Which texels of an exemplar may be copied, and what lies next to each.
//!
//! A plain sample is a rectangle. Several samples stand in one sheet with empty rows between them, a mask takes texels
//! away, and a sample that tiles has no border at all: in each case a patch goes on as long as the next texel belongs
//! to the domain.
//! Unaware of: what the texels show.

use crate::texture::Wrap;

/// The texels that may be sources. At least one does, its sides are in 1..=65535.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Domain {
    width: u32,
    height: u32,
    wrap: Wrap,
    /// One bit per texel, row by row, lowest bit first; `None` if all belong.
    bits: Option<Vec<u64>>,
}

impl Domain {
    /// All texels of a rectangle. Panics if a side is not in 1..=65535.
    pub fn full(width: u32, height: u32, wrap: Wrap) -> Self {
        assert!([width, height].iter().all(|s| (1..=65535).contains(s)), "a domain of {width} x {height} texels");
        Domain { width, height, wrap, bits: None }
    }

    /// Those texels, row by row, for which `belongs` says so; `None` if none does. Panics as [`Domain::full`] does.
    pub fn masked(width: u32, height: u32, wrap: Wrap, mut belongs: impl FnMut(u32, u32) -> bool) -> Option<Self> {
        let mut domain = Domain::full(width, height, wrap);
        let mut bits = vec![0u64; (width as usize * height as usize).div_ceil(64)];
        let (mut i, mut count) = (0, 0);
        for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
            if belongs(x, y) {
                bits[i / 64] |= 1 << (i % 64);
                count += 1;
            }
            i += 1;
        }
        domain.bits = (count < i).then_some(bits);
        (count > 0).then_some(domain)
    }

    /// The same texels with another answer to what lies beyond the borders.
    pub fn with_wrap(mut self, wrap: Wrap) -> Self {
        self.wrap = wrap;
        self
    }

    /// One bit per texel, row by row, lowest bit first; `None` if all belong.
    pub(super) fn bits(&self) -> Option<&[u64]> {
        self.bits.as_deref()
    }

    /// The texels that belong, row by row, as columns and rows.
    pub fn texels(&self) -> impl Iterator<Item = [u16; 2]> + '_ {
        let rows = (0..self.height).flat_map(|y| (0..self.width).map(move |x| [x as u16, y as u16]));
        rows.filter(|t| self.contains(t[0].into(), t[1].into()))
    }

    /// Texels per row.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// What lies beyond the borders: the domain again, or (clamp) nothing.
    pub fn wrap(&self) -> Wrap {
        self.wrap
    }

    /// True if every texel of the rectangle belongs and it has borders.
    pub fn is_plain(&self) -> bool {
        self.bits.is_none() && self.wrap == Wrap::Clamp
    }

    /// True if the texel belongs; false for places outside the rectangle.
    #[inline(always)]
    pub fn contains(&self, x: i32, y: i32) -> bool {
        let inside = (x as u32) < self.width && (y as u32) < self.height;
        match &self.bits {
            None => inside,
            Some(bits) => {
                inside && {
                    let i = y as usize * self.width as usize + x as usize;
                    bits[i / 64] >> (i % 64) & 1 == 1
                }
            }
        }
    }

    /// The texel at a place, brought into the rectangle if the domain repeats; `None` if none belongs there.
    #[inline(always)]
    pub fn at(&self, x: i32, y: i32) -> Option<[u16; 2]> {
        let [x, y] = match self.wrap {
            Wrap::Clamp => [x, y],
            Wrap::Repeat => [x.rem_euclid(self.width as i32), y.rem_euclid(self.height as i32)],
        };
        self.contains(x, y).then_some([x as u16, y as u16])
    }

    /// Number of texels that belong.
    pub fn len(&self) -> usize {
        match &self.bits {
            None => self.width as usize * self.height as usize,
            Some(bits) => bits.iter().map(|b| b.count_ones() as usize).sum(),
        }
    }

    /// Never true.
    pub fn is_empty(&self) -> bool {
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mask_takes_texels_away() {
        let d = Domain::masked(3, 2, Wrap::Clamp, |x, y| x != 1 || y != 0).unwrap();
        assert_eq!((d.len(), d.is_plain()), (5, false));
        assert_eq!(d.texels().collect::<Vec<_>>(), [[0, 0], [2, 0], [0, 1], [1, 1], [2, 1]]);
        assert!(d.contains(0, 0) && !d.contains(1, 0) && d.contains(1, 1));
        assert!(!d.contains(-1, 0) && !d.contains(3, 1) && !d.contains(0, 2));
        assert!(Domain::masked(3, 2, Wrap::Clamp, |_, _| true).unwrap().is_plain());
        assert_eq!(Domain::masked(3, 2, Wrap::Clamp, |_, _| false), None);
    }

    #[test]
    fn a_torus_has_no_border() {
        let d = Domain::full(3, 2, Wrap::Repeat);
        assert_eq!(d.at(-1, 5), Some([2, 1]));
        assert_eq!(Domain::full(3, 2, Wrap::Clamp).at(-1, 1), None);
    }
}
