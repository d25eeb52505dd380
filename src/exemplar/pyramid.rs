//! Undecimated Gaussian pyramid of an exemplar.
//!
//! Source: \[ZG02\] section 2.3; the 5-tap binomial kernel is Burt and Adelson's (1983).
//! In: planes of one size. Out: for each level the planes, blurred, at full resolution, with a border.
//! Reads as: the paper averages coarser levels from finer ones and does not say how a texel that lies between coarse
//! samples finds its place. Here no level is decimated: level l is the binomial blur of level l - 1 with taps 2^(l-1)
//! texels apart, and its samples around a texel are read 2^l texels apart. This is exactly the decimated pyramid whose
//! grids pass through that texel's own centre, so equal surroundings have equal vectors at any position (a period of 7
//! or 9 is found as well as one of 8), there is no sub-texel alignment left to do, and odd sizes are no special case. The
//! odd kernel keeps centres where they are; a 2x2 box would shift each level by half a texel.
//! Unaware of: which maps the planes come from, neighbourhoods.

use crate::numerics::par;
use crate::texture::Wrap;

/// One 5-tap binomial.
const KERNEL: [f32; 5] = [1.0 / 16.0, 4.0 / 16.0, 6.0 / 16.0, 4.0 / 16.0, 1.0 / 16.0];

/// Index in 0..n for an index beyond the exemplar. A torus repeats; anything else is reflected at its outer edge
/// (..., 1, 0 | 0, 1, ...), which keeps the grain of the texture where clamping would draw streaks. It matters little:
/// of the jumps of texels within 4 of the border, 14, 19, 27 and 20 % end within 4 of a border (leopard, carpet, bricks,
/// pebbles; the border's share of the area is 12, 12, 8 and 12 %), with clamping 10, 26, 28 and 18 %.
pub(crate) fn border_index(wrap: Wrap, i: i64, n: u32) -> u32 {
    match wrap {
        Wrap::Repeat => wrap.index(i, n),
        Wrap::Clamp => {
            let folded = Wrap::Repeat.index(i, 2 * n);
            folded.min(2 * n - 1 - folded)
        }
    }
}

/// The levels of a pyramid, finest first, each plane with `pad` texels of border on every side.
pub(crate) struct Pyramid {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) pad: usize,
    /// Values per padded row. At least `BLOCK - 1` more than the row needs, so that blocks of texels read past it.
    pub(crate) stride: usize,
    /// `planes[level * channels + channel]`.
    pub(crate) planes: Vec<Vec<f32>>,
}

/// Texels that are read at once from a row.
pub(crate) const BLOCK: usize = 8;

impl Pyramid {
    /// Builds `levels` levels of the planes (one per channel, `width * height` values each).
    pub(crate) fn new(planes: Vec<Vec<f32>>, width: u32, height: u32, levels: usize, pad: usize, wrap: Wrap) -> Self {
        let (w, h) = (width as usize, height as usize);
        let stride = w + 2 * pad + BLOCK - 1;
        let mut current = planes;
        let mut out = Vec::with_capacity(levels * current.len());
        for level in 0..levels {
            if level > 0 {
                let step = 1i64 << (level - 1);
                current.iter_mut().for_each(|p| *p = blur(p, width, height, step, wrap));
            }
            out.extend(current.iter().map(|p| padded(p, width, height, pad, stride, wrap)));
        }
        Pyramid { width: w, height: h, pad, stride, planes: out }
    }

    /// Index of texel (x, y) in every plane.
    pub(crate) fn at(&self, x: usize, y: usize) -> usize {
        (y + self.pad) * self.stride + x + self.pad
    }
}

/// Separable binomial blur with taps `step` texels apart.
fn blur(plane: &[f32], width: u32, height: u32, step: i64, wrap: Wrap) -> Vec<f32> {
    let w = width as usize;
    let tap = |i: usize, t: usize, n: u32| border_index(wrap, i as i64 + (t as i64 - 2) * step, n) as usize;
    let columns: Vec<[usize; 5]> = (0..w).map(|x| std::array::from_fn(|t| tap(x, t, width))).collect();
    let mut across = vec![0.0f32; plane.len()];
    par::for_rows(&mut across, w, |y, out| {
        let row = &plane[y * w..(y + 1) * w];
        for (o, taps) in out.iter_mut().zip(&columns) {
            *o = taps.iter().zip(KERNEL).fold(0.0, |s, (&x, k)| s + row[x] * k);
        }
    });
    let mut down = vec![0.0f32; plane.len()];
    par::for_rows(&mut down, w, |y, out| {
        for (t, k) in KERNEL.into_iter().enumerate() {
            let from = tap(y, t, height) * w;
            out.iter_mut().zip(&across[from..from + w]).for_each(|(o, v)| *o += v * k);
        }
    });
    down
}

/// The plane with its border.
fn padded(plane: &[f32], width: u32, height: u32, pad: usize, stride: usize, wrap: Wrap) -> Vec<f32> {
    let w = width as usize;
    let index = |i: usize, n: u32| border_index(wrap, i as i64 - pad as i64, n) as usize;
    let columns: Vec<usize> = (0..stride).map(|x| index(x, width)).collect();
    let mut out = vec![0.0; stride * (height as usize + 2 * pad)];
    par::for_rows(&mut out, stride, |y, row| {
        let from = index(y, height) * w;
        row.iter_mut().zip(&columns).for_each(|(o, &x)| *o = plane[from + x]);
    });
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn borders_reflect_or_repeat() {
        let reflect: Vec<u32> = (-4..7).map(|i| border_index(Wrap::Clamp, i, 3)).collect();
        assert_eq!(reflect, [2, 2, 1, 0, 0, 1, 2, 2, 1, 0, 0]);
        let repeat: Vec<u32> = (-2..5).map(|i| border_index(Wrap::Repeat, i, 3)).collect();
        assert_eq!(repeat, [1, 2, 0, 1, 2, 0, 1]);
        assert_eq!(border_index(Wrap::Clamp, -17, 1), 0);
    }

    #[test]
    fn an_impulse_spreads_as_the_binomial() {
        let mut plane = vec![0.0; 15 * 15];
        plane[7 * 15 + 7] = 256.0;
        let p = Pyramid::new(vec![plane], 15, 15, 3, 0, Wrap::Clamp);
        let row = |level: usize, y: usize| (0..15).map(|x| p.planes[level][p.at(x, y)]).collect::<Vec<_>>();
        assert_eq!(row(1, 7)[4..11], [0.0, 6.0, 24.0, 36.0, 24.0, 6.0, 0.0]);
        assert_eq!(row(1, 6)[5..10], [4.0, 16.0, 24.0, 16.0, 4.0]);
        // Level 2: taps two texels apart, on the kernel of level 1. Centre of [1 4 6 4 1] * [1 0 4 0 6 0 4 0 1] is 44.
        assert_eq!(row(2, 7)[7], 44.0 * 44.0 / 256.0);
    }

    #[test]
    fn a_constant_stays_constant_in_every_level_and_border() {
        for wrap in [Wrap::Clamp, Wrap::Repeat] {
            let p = Pyramid::new(vec![vec![0.3; 5 * 3]], 5, 3, 4, 9, wrap);
            assert!(p.planes[1..].iter().all(|l| l.iter().all(|v| *v == p.planes[1][0])));
        }
    }
}
