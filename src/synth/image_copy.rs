//! The picture of a walk: copies texels by the source map, blending small patches at the seams if asked to.
//!
//! Source: \[ZG02\] section 3.1, "we copy and blend a small gaussian patch of pixels (3x3 or 5x5) every time we synthesize
//! a pixel". Read as a weighted mean, so that the order of the pixels does not matter: a pixel receives, from every pixel
//! of its neighbourhood, the texel that this one's patch puts there. Inside a patch all agree, and the texel is copied
//! exactly. Parts of patches that lie outside the exemplar do not count.
//! Unaware of: what the channels mean; whoever copies normals renormalises them.

use super::source_map::{Rect, SourceMap};
use crate::texture::Texture;

/// How patches are blended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BlendKernel {
    /// Plain copies.
    None,
    /// Patches of 3 x 3 pixels.
    Three,
    /// Patches of 5 x 5 pixels.
    Five,
}

impl BlendKernel {
    /// The Gaussian along one axis: binomial weights, exact in f32.
    fn weights(self) -> &'static [f32] {
        match self {
            BlendKernel::None => &[1.0],
            BlendKernel::Three => &[0.25, 0.5, 0.25],
            BlendKernel::Five => &[0.0625, 0.25, 0.375, 0.25, 0.0625],
        }
    }
}

/// Makes the picture of `map` out of `texture`, which must have the size of the analysed exemplar (else this panics).
pub fn copy(texture: &Texture, map: &SourceMap, kernel: BlendKernel) -> Texture {
    copy_window(texture, map, Rect::whole([map.width, map.height]), kernel)
}

/// As [`copy`], a part of it only; pixels around the part take part in the blending. Panics if it does not fit.
pub fn copy_window(texture: &Texture, map: &SourceMap, part: Rect, kernel: BlendKernel) -> Texture {
    assert_eq!([texture.width(), texture.height()], map.exemplar_size, "a texture of another size than the exemplar");
    assert!(part.fits([map.width, map.height]), "a part {part:?} of {} x {}", map.width, map.height);
    let weights = kernel.weights();
    Texture::from_fn(part.width, part.height, texture.channels(), |x, y, out| {
        let (x, y) = (part.x + x, part.y + y);
        let own = source(map, i64::from(x), i64::from(y)).unwrap_or_default();
        if kernel == BlendKernel::None || all_agree(map, [x, y], own, weights.len() as i64 / 2) {
            out.copy_from_slice(texture.get(own[0] as u32, own[1] as u32));
        } else {
            blend(texture, map, [x, y], weights, out);
        }
    })
}

impl BlendKernel {
    /// Pixels around a part that its picture depends on.
    pub fn reach(self) -> u32 {
        self.weights().len() as u32 / 2
    }
}

/// The texel that pixel (x, y) was given; `None` outside the image.
fn source(map: &SourceMap, x: i64, y: i64) -> Option<[i64; 2]> {
    let (w, h) = (i64::from(map.width), i64::from(map.height));
    let (x, y) = if map.tileable { (x.rem_euclid(w), y.rem_euclid(h)) } else { (x, y) };
    let inside = (0..w).contains(&x) && (0..h).contains(&y);
    inside.then(|| map.sources[(y * w + x) as usize].map(i64::from))
}

/// The neighbourhood's pixels, with the texel that each would put at the centre.
fn suggestions(map: &SourceMap, at: [u32; 2], radius: i64) -> impl Iterator<Item = ([usize; 2], [i64; 2])> {
    let [x, y] = at.map(i64::from);
    (-radius..=radius).flat_map(move |dy| (-radius..=radius).map(move |dx| (dx, dy))).filter_map(move |(dx, dy)| {
        let [sx, sy] = source(map, x + dx, y + dy)?;
        Some(([(dx + radius) as usize, (dy + radius) as usize], [sx - dx, sy - dy]))
    })
}

fn all_agree(map: &SourceMap, at: [u32; 2], own: [i64; 2], radius: i64) -> bool {
    suggestions(map, at, radius).all(|(_, texel)| texel == own)
}

fn blend(texture: &Texture, map: &SourceMap, at: [u32; 2], weights: &[f32], out: &mut [f32]) {
    let (w, h) = (i64::from(texture.width()), i64::from(texture.height()));
    let mut sum = 0.0;
    out.fill(0.0);
    for ([i, j], [sx, sy]) in suggestions(map, at, weights.len() as i64 / 2) {
        if (0..w).contains(&sx) && (0..h).contains(&sy) {
            let weight = weights[i] * weights[j];
            sum += weight;
            for (o, v) in out.iter_mut().zip(texture.get(sx as u32, sy as u32)) {
                *o += weight * v;
            }
        }
    }
    for o in out {
        *o /= sum; // the centre always counts
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::par;
    use crate::synth::testing::noise;

    fn map(width: u32, height: u32, sources: Vec<[u16; 2]>, tileable: bool) -> SourceMap {
        SourceMap { width, height, exemplar_size: [4, 4], sources, tileable, counters: Default::default() }
    }

    fn ramp() -> Texture {
        Texture::from_fn(4, 4, 1, |x, y, out| out[0] = (x + 4 * y) as f32)
    }

    #[test]
    fn a_plain_copy_replays_the_sources() {
        let out = copy(&ramp(), &map(2, 2, vec![[0, 0], [3, 0], [1, 2], [3, 3]], false), BlendKernel::None);
        assert_eq!(out.data(), [0.0, 3.0, 9.0, 15.0]);
    }

    #[test]
    fn one_patch_is_copied_exactly() {
        let t = noise(4, 4);
        let sources = (0..9u16).map(|i| [i % 3 + 1, i / 3]).collect();
        let m = map(3, 3, sources, false);
        assert_eq!(copy(&t, &m, BlendKernel::Five), copy(&t, &m, BlendKernel::None));
    }

    #[test]
    fn two_patches_mix_at_their_seam() {
        // Pixels 0 and 1 of a row from texels 0 and 2. Pixel 1's patch puts texel 1 at pixel 0; pixel 0's puts texel 1 at
        // pixel 1. Weights 1/2 and 1/4.
        let out = copy(&ramp(), &map(2, 1, vec![[0, 0], [2, 0]], false), BlendKernel::Three);
        assert_eq!(out.data(), [(0.5 * 0.0 + 0.25 * 1.0) / 0.75, (0.5 * 2.0 + 0.25 * 1.0) / 0.75]);
        // Wrapping: each is the other's neighbour on both sides, and of its own above and below.
        let out = copy(&ramp(), &map(2, 1, vec![[0, 0], [2, 0]], true), BlendKernel::Three);
        assert!((out.data()[0] - wrapped_by_hand([0, 2])).abs() < 1e-6, "{}", out.data()[0]);
    }

    /// Pixel 0 of a tileable 2 x 1 image whose sources are the texels (a, 0), (b, 0) of the 4 x 4 ramp.
    fn wrapped_by_hand([a, b]: [i64; 2]) -> f32 {
        let k = [0.25f32, 0.5, 0.25];
        let (mut sum, mut total) = (0.0, 0.0);
        for dy in -1..=1i64 {
            for dx in -1..=1i64 {
                let (x, y) = (if dx == 0 { a } else { b } - dx, -dy);
                if (0..4).contains(&x) && (0..4).contains(&y) {
                    let w = k[(dx + 1) as usize] * k[(dy + 1) as usize];
                    sum += w * (x + 4 * y) as f32;
                    total += w;
                }
            }
        }
        sum / total
    }

    #[test]
    fn threads_do_not_change_the_picture() {
        let sources = (0..64u16).map(|i| [i * 7 % 4, i * 5 % 3]).collect();
        let m = map(8, 8, sources, true);
        let run = |jobs| par::install(jobs, || copy(&noise(4, 4), &m, BlendKernel::Five));
        assert_eq!(run(1), run(2));
        assert_eq!(run(1), run(8));
    }
}
