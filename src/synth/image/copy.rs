//! The picture of a walk: copies texels by the source map, blending small patches at the seams if asked to.
//!
//! Source: \[ZG02\] section 3.1, "we copy and blend a small gaussian patch of pixels (3x3 or 5x5) every time we synthesize
//! a pixel". Read as a weighted mean, so that the order of the pixels does not matter: a pixel receives, from every pixel
//! of its neighbourhood, the texel that this one's patch puts there. Inside a patch all agree, and the texel is copied
//! exactly. Parts of patches that lie outside the exemplar, or where it may not be copied, do not count.
//! Unaware of: what the channels mean; whoever copies normals renormalises them.

use std::ops::Range;

use super::source_map::{Rect, SourceMap};
use crate::exemplar::Domain;
use crate::numerics::par;
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

/// What limits the blending.
#[derive(Clone, Copy, Debug, Default)]
pub struct Bounds<'a> {
    /// Texels that may show; default: all of the exemplar, which has borders.
    pub domain: Option<&'a Domain>,
    /// Pixels of the whole image, row by row, that are plain copies; default: none.
    pub plain: Option<&'a [bool]>,
}

/// As [`copy`], a part of it only; pixels around the part take part in the blending. Panics if it does not fit.
pub fn copy_window(texture: &Texture, map: &SourceMap, part: Rect, kernel: BlendKernel) -> Texture {
    copy_bounded(texture, map, part, kernel, &Bounds::default())
}

/// As [`copy_window`], within bounds. Panics if those are of another size.
pub fn copy_bounded(texture: &Texture, map: &SourceMap, part: Rect, kernel: BlendKernel, bounds: &Bounds) -> Texture {
    let sizes = bounds.domain.map_or(map.exemplar_size, |d| [d.width(), d.height()]);
    assert_eq!(sizes, map.exemplar_size, "a domain of another size than the exemplar");
    assert!(bounds.plain.is_none_or(|p| p.len() == map.sources.len()), "plain pixels of another image");
    assert_eq!([texture.width(), texture.height()], map.exemplar_size, "a texture of another size than the exemplar");
    assert!(part.fits([map.width, map.height]), "a part {part:?} of {} x {}", map.width, map.height);
    let (channels, row) = (texture.channels() as usize, part.width as usize * texture.channels() as usize);
    let mut out = Texture::new(part.width, part.height, texture.channels());
    par::for_rows(out.data_mut(), row, |y, out| {
        let y = part.y + y as u32;
        let columns = part.x as usize..(part.x + part.width) as usize;
        let seams = near_seams(map, y, columns.clone(), kernel.reach() as usize);
        let own = &map.sources[y as usize * map.width as usize..][columns];
        let mut x = 0;
        while x < own.len() {
            if seams[x] {
                mix(texture, map, [part.x + x as u32, y], kernel, bounds, &mut out[x * channels..][..channels]);
                x += 1;
                continue;
            }
            // Inside a patch texels follow each other in the exemplar, too.
            let more = |i: &usize| !seams[*i] && right_of(own[i - 1]) == own[*i];
            let len = 1 + (x + 1..own.len()).take_while(more).count();
            let [sx, sy] = own[x].map(usize::from);
            let from = (sy * texture.width() as usize + sx) * channels;
            out[x * channels..][..len * channels].copy_from_slice(&texture.data()[from..][..len * channels]);
            x += len;
        }
    });
    out
}

/// The source that goes on with a patch one pixel to the right.
#[inline(always)]
fn right_of([x, y]: [u16; 2]) -> [u16; 2] {
    [x.wrapping_add(1), y]
}

/// The source that goes on with a patch one pixel down.
#[inline(always)]
fn below([x, y]: [u16; 2]) -> [u16; 2] {
    [x, y.wrapping_add(1)]
}

/// For each of some columns of a row: whether two patches may meet within `radius` pixels. If not, all pixels that near
/// are of one patch.
fn near_seams(map: &SourceMap, y: u32, columns: Range<usize>, radius: usize) -> Vec<bool> {
    let mut near = vec![false; columns.len()];
    if radius == 0 {
        return near;
    }
    let (width, height) = (map.width as usize, i64::from(map.height));
    let mut mark = |x: usize| {
        let (from, to) = (x.saturating_sub(radius).max(columns.start), (x + radius + 1).min(columns.end));
        if from < to {
            near[from - columns.start..to - columns.start].fill(true);
        }
    };
    let row = |dy: i64| {
        let at = if map.tileable { (i64::from(y) + dy).rem_euclid(height) } else { i64::from(y) + dy };
        (0..height).contains(&at).then(|| &map.sources[at as usize * width..][..width])
    };
    let around = columns.start.saturating_sub(radius)..(columns.end + radius).min(width);
    if let Some(own) = row(0) {
        let own = &own[around.clone()];
        for (x, pair) in own.windows(2).enumerate() {
            if right_of(pair[0]) != pair[1] {
                mark(around.start + x);
                mark(around.start + x + 1);
            }
        }
    }
    let radius = radius as i64;
    for dy in -radius..radius {
        if let (Some(upper), Some(lower)) = (row(dy), row(dy + 1)) {
            for (x, (a, b)) in upper[around.clone()].iter().zip(&lower[around.clone()]).enumerate() {
                if below(*a) != *b {
                    mark(around.start + x);
                }
            }
        }
    }
    if map.tileable {
        // Across the border it is not looked.
        mark(0);
        mark(width - 1);
    }
    near
}

/// The colour of a pixel near a seam.
fn mix(texture: &Texture, map: &SourceMap, at: [u32; 2], kernel: BlendKernel, bounds: &Bounds, out: &mut [f32]) {
    let weights = kernel.weights();
    let own = source(map, at[0].into(), at[1].into()).unwrap_or_default();
    let plain = bounds.plain.is_some_and(|p| p[at[1] as usize * map.width as usize + at[0] as usize]);
    if plain || all_agree(map, at, own, weights.len() as i64 / 2, bounds) {
        out.copy_from_slice(texture.get(own[0] as u32, own[1] as u32));
    } else {
        blend(texture, map, at, weights, out, bounds);
    }
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

impl Bounds<'_> {
    /// The texel that shows at a place of the exemplar, if one does.
    fn texel(&self, [x, y]: [i64; 2], [w, h]: [u32; 2]) -> Option<[u32; 2]> {
        match self.domain {
            Some(domain) => domain.at(x as i32, y as i32).map(|t| t.map(u32::from)),
            None => ((0..w.into()).contains(&x) && (0..h.into()).contains(&y)).then_some([x as u32, y as u32]),
        }
    }
}

fn all_agree(map: &SourceMap, at: [u32; 2], own: [i64; 2], radius: i64, bounds: &Bounds) -> bool {
    // Where the exemplar repeats, a place beyond its border is a texel.
    let texel = |place| bounds.texel(place, map.exemplar_size).map(|t| t.map(i64::from));
    suggestions(map, at, radius).all(|(_, place)| place == own || texel(place) == Some(own))
}

fn blend(texture: &Texture, map: &SourceMap, at: [u32; 2], weights: &[f32], out: &mut [f32], bounds: &Bounds) {
    let mut sum = 0.0;
    out.fill(0.0);
    for ([i, j], place) in suggestions(map, at, weights.len() as i64 / 2) {
        if let Some([sx, sy]) = bounds.texel(place, map.exemplar_size) {
            let weight = weights[i] * weights[j];
            sum += weight;
            for (o, v) in out.iter_mut().zip(texture.get(sx, sy)) {
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
    use crate::synth::testing::noise;
    use crate::texture::Wrap;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(100) })]

        #[test]
        fn patches_are_copied_as_if_pixel_by_pixel(
            (width, height) in (1..24u32, 1..24u32),
            patches in prop::collection::vec((0..576usize, 1..60usize, 0..12u16, 0..9u16), 0..12),
            (x, y, w, h) in (0..24u32, 0..24u32, 1..24u32, 1..24u32),
            tileable: bool,
        ) {
            let texture = noise(12, 9);
            let at = |i: usize| ((i % width as usize) as u16, (i / width as usize) as u16);
            let mut sources: Vec<[u16; 2]> =
                (0..(width * height) as usize).map(|i| [at(i).0 % 12, at(i).1 % 9]).collect();
            for (first, len, dx, dy) in patches {
                for i in (first..first + len).filter(|i| *i < (width * height) as usize) {
                    sources[i] = [(at(i).0 + dx) % 12, (at(i).1 + dy) % 9];
                }
            }
            let map = SourceMap { exemplar_size: [12, 9], ..map(width, height, sources, tileable) };
            let (x, y) = (x % width, y % height);
            let part = Rect { x, y, width: w.min(width - x), height: h.min(height - y) };
            for kernel in [BlendKernel::None, BlendKernel::Three, BlendKernel::Five] {
                let expected = Texture::from_fn(part.width, part.height, texture.channels(), |i, j, out| {
                    mix(&texture, &map, [part.x + i, part.y + j], kernel, &Bounds::default(), out);
                });
                prop_assert!(copy_window(&texture, &map, part, kernel) == expected, "{:?}", kernel);
            }
        }
    }

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
    fn what_may_not_be_copied_is_not_blended_in() {
        // As above: texel 1 is what each pixel gets from the other.
        let m = map(2, 1, vec![[0, 0], [2, 0]], false);
        let run = |bounds: &Bounds| copy_bounded(&ramp(), &m, Rect::whole([2, 1]), BlendKernel::Three, bounds);
        let domain = Domain::masked(4, 4, Wrap::Clamp, |x, _| x != 1).unwrap();
        assert_eq!(run(&Bounds { domain: Some(&domain), plain: None }).data(), [0.0, 2.0]);
        let plain = run(&Bounds { domain: None, plain: Some(&[true, false]) });
        assert_eq!(plain.data(), [0.0, (0.5 * 2.0 + 0.25 * 1.0) / 0.75]);
        // Around a torus the patch of texel 3 goes on with texel 0: no seam.
        let m = map(2, 1, vec![[3, 0], [0, 0]], false);
        let torus = Domain::full(4, 4, Wrap::Repeat);
        let bounds = Bounds { domain: Some(&torus), plain: None };
        assert_eq!(copy_bounded(&ramp(), &m, Rect::whole([2, 1]), BlendKernel::Three, &bounds).data(), [3.0, 0.0]);
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
