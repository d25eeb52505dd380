//! Texels that no chart and no gutter reaches: filled so that no mip level sees a background.
//!
//! Every empty texel takes the mean of the filled texels in the smallest aligned block of 2^k texels around it that has
//! any. A box mip level of the page is then the mean of what was filled, at every level and wherever something was.

use super::coverage::{Coverage, NO_FACE};
use crate::numerics::par;
use crate::texture::Texture;

/// One level of sums over filled texels: value times weight, and weight.
struct Level {
    width: usize,
    height: usize,
    /// Channels and weight, interleaved.
    data: Vec<f32>,
}

/// Fills the texels of `map` that are neither covered nor in the gutter.
pub(crate) fn dilate(coverage: &Coverage, map: &mut Texture) {
    let (w, h, c) = (map.width() as usize, map.height() as usize, map.channels() as usize);
    let filled = filled_rows(coverage);
    let mut levels = vec![first_level(map, &filled)];
    while let Some(last) = levels.last().filter(|l| l.width > 1 || l.height > 1) {
        levels.push(half(last, c));
    }
    for i in (1..levels.len()).rev() {
        let (fine, coarse) = levels.split_at_mut(i);
        fill_from(&mut fine[i - 1], &coarse[0], c);
    }
    let top = &levels[0];
    par::for_rows(map.data_mut(), w * c, |y, row| {
        for (x, out) in row.chunks_exact_mut(c).enumerate().filter(|(x, _)| !bit(&filled[y], *x)) {
            let from = &top.data[((y / 2) * top.width + x / 2) * (c + 1)..];
            out.copy_from_slice(&from[..c]);
        }
    });
    debug_assert!(h > 0, "textures have rows");
}

fn bit(row: &[u64], x: usize) -> bool {
    row[x / 64] >> (x % 64) & 1 == 1
}

/// One bit per texel: covered or in the gutter.
fn filled_rows(coverage: &Coverage) -> Vec<Vec<u64>> {
    let w = coverage.width();
    par::map(coverage.height() as usize, |y| {
        let mut bits = vec![0u64; (w as usize).div_ceil(64)];
        for (x, _) in coverage.row(y as u32).iter().enumerate().filter(|(_, f)| **f != NO_FACE) {
            bits[x / 64] |= 1 << (x % 64);
        }
        for g in coverage.gutter_in(y as u32..y as u32 + 1) {
            let x = (g.texel % w) as usize;
            bits[x / 64] |= 1 << (x % 64);
        }
        bits
    })
}

/// Means of 2x2 blocks of the map; the weight is 1 where a block has a filled texel.
fn first_level(map: &Texture, filled: &[Vec<u64>]) -> Level {
    let (w, h, c) = (map.width() as usize, map.height() as usize, map.channels() as usize);
    let (width, height) = (w.div_ceil(2), h.div_ceil(2));
    let mut data = vec![0.0; width * height * (c + 1)];
    let source = map.data();
    par::for_rows(&mut data, width * (c + 1), |y, row| {
        for (x, out) in row.chunks_exact_mut(c + 1).enumerate() {
            let mut n = 0.0;
            for (sx, sy) in [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(dx, dy)| (2 * x + dx, 2 * y + dy)) {
                if sx < w && sy < h && bit(&filled[sy], sx) {
                    let t = &source[(sy * w + sx) * c..][..c];
                    (0..c).for_each(|k| out[k] += t[k]);
                    n += 1.0;
                }
            }
            finish(out, n);
        }
    });
    Level { width, height, data }
}

fn half(fine: &Level, c: usize) -> Level {
    let (width, height) = (fine.width.div_ceil(2), fine.height.div_ceil(2));
    let mut data = vec![0.0; width * height * (c + 1)];
    par::for_rows(&mut data, width * (c + 1), |y, row| {
        for (x, out) in row.chunks_exact_mut(c + 1).enumerate() {
            let mut n = 0.0;
            for (sx, sy) in [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(dx, dy)| (2 * x + dx, 2 * y + dy)) {
                if sx < fine.width && sy < fine.height {
                    let t = &fine.data[(sy * fine.width + sx) * (c + 1)..][..c + 1];
                    (0..c).for_each(|k| out[k] += t[k] * t[c]);
                    n += t[c];
                }
            }
            finish(out, n);
        }
    });
    Level { width, height, data }
}

/// Turns a sum of `n` values into their mean.
fn finish(out: &mut [f32], n: f32) {
    let c = out.len() - 1;
    if n > 0.0 {
        out[..c].iter_mut().for_each(|v| *v /= n);
        out[c] = 1.0;
    }
}

fn fill_from(fine: &mut Level, coarse: &Level, c: usize) {
    let width = fine.width;
    par::for_rows(&mut fine.data, width * (c + 1), |y, row| {
        for (x, out) in row.chunks_exact_mut(c + 1).enumerate().filter(|(_, o)| o[c] == 0.0) {
            out.copy_from_slice(&coarse.data[((y / 2) * coarse.width + x / 2) * (c + 1)..][..c + 1]);
        }
    });
}
