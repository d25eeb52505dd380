//! Guides by light and dark, for pictures that share nothing but that: how bright each place is, and which brightness of
//! the exemplar stands for which of the target.
//!
//! Source: Hertzmann et al.: Image Analogies (2001) 3.4, which maps luminance by mean and variance. Here by rank: texels
//! that are brighter than so many others stand for pixels that are brighter than as many. So the target asks for all that
//! the exemplar has and for nothing that it has not, and a flat part of the target asks for nothing in particular.
//! Unaware of: jump maps, how guides are used.

use super::guide::GuideMap;
use crate::synth::box_mean::box_mean;
use crate::texture::Texture;
use crate::texture::color::{linear_to_srgb, luminance};

/// Texels to each side over which brightness is averaged, twice: the grain is the texture's own business.
const BLUR: usize = 2;

/// Values of brightness.
const VALUES: usize = 1 << 16;

/// How bright each place of a map is, blurred: linear colours by their luminance in sRGB steps, other maps by their first
/// channel, clamped to 0..=1.
pub fn brightness(map: &Texture) -> Vec<u16> {
    let size = [map.width(), map.height()];
    let channels = map.channels() as usize;
    let value = |texel: &[f32]| match *texel {
        [r, g, b, ..] => linear_to_srgb(luminance([r, g, b])),
        _ => texel[0].clamp(0.0, 1.0),
    };
    blurred(&map.data().chunks_exact(channels).map(value).collect::<Vec<f32>>(), size)
}

/// The same of a picture in sRGB colours, by their luma. The two differ where colours are strong; ranks hardly do.
pub fn luma(picture: &GuideMap) -> Vec<u16> {
    let value = |&[r, g, b]: &[u8; 3]| luminance([r, g, b].map(|v| f32::from(v) / 255.0));
    blurred(&picture.colours().iter().map(value).collect::<Vec<f32>>(), picture.size())
}

fn blurred(values: &[f32], size: [u32; 2]) -> Vec<u16> {
    let blurred = box_mean(&box_mean(values, size, 1, BLUR), size, 1, BLUR);
    blurred.iter().map(|v| (v * 65535.0 + 0.5) as u16).collect()
}

/// The values of a target, stretched to the whole range; of one value all are 0.
pub fn stretched(target: &[u16]) -> Vec<u8> {
    let low = target.iter().copied().min().unwrap_or(0);
    let range = u32::from(target.iter().copied().max().unwrap_or(0) - low).max(1);
    target.iter().map(|v| ((u32::from(*v - low) * 255 + range / 2) / range) as u8).collect()
}

/// For every brightness the value of a stretched target that has the same rank there as it has in `values`. Brightnesses
/// that are not in `values` get what those below and above them get.
pub fn equivalents(values: impl Iterator<Item = u16>, target: &[u8]) -> Vec<u8> {
    let mut ours = vec![0u64; VALUES];
    values.for_each(|v| ours[usize::from(v)] += 1);
    let mut theirs = [0u64; 256];
    target.iter().for_each(|v| theirs[usize::from(*v)] += 1);
    let (count, pixels) = (ours.iter().sum::<u64>(), target.len() as u64);
    let (mut below, mut step, mut passed) = (0, 0, 0);
    let rank = |ours: &u64| {
        // All texels of one brightness count as the middle one of them.
        let middle = u128::from(2 * below + ours) * u128::from(pixels);
        while step < 255 && u128::from(2 * (passed + theirs[step])) * u128::from(count) <= middle {
            passed += theirs[step];
            step += 1;
        }
        below += ours;
        step as u8
    };
    ours.iter().map(rank).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranks_decide() {
        let found = |values: &[u16], target: &[u8]| {
            let table = equivalents(values.iter().copied(), target);
            values.iter().map(|v| table[usize::from(*v)]).collect::<Vec<_>>()
        };
        assert_eq!(found(&[100, 200, 100, 200], &[0, 255, 0, 255]), [0, 255, 0, 255]);
        assert_eq!(found(&[40, 30_000, 20, 10], &[1, 2, 3, 250]), [3, 250, 2, 1]);
        // A flat part stands for all that is not asked for elsewhere.
        assert_eq!(found(&[1, 2, 3, 4], &[0, 255, 255, 255]), [0, 255, 255, 255]);
        assert_eq!(found(&[1, 2, 3], &[0, 0]), [0, 0, 0]);
        // Nothing to tell apart: the middle.
        assert_eq!(found(&[9, 9, 9], &[50, 60, 70]), [60; 3]);
        assert_eq!(stretched(&[300, 400, 500]), [0, 128, 255]);
        assert_eq!(stretched(&[7; 4]), [0; 4]);
    }

    #[test]
    fn brightness_is_that_of_the_eye() {
        let t = Texture::from_fn(40, 9, 3, |x, _, out| out.fill(if x < 20 { 0.0 } else { 0.215_86 }));
        let b = brightness(&t);
        let near = |v: u16, to: f32| (f32::from(v) - to * 65535.0).abs() < 70.0;
        assert!(near(b[0], 0.0) && near(b[15], 0.0) && near(b[24], 128.0 / 255.0) && near(b[39], 128.0 / 255.0));
        assert!(b[..40].windows(2).all(|w| w[0] <= w[1]) && (300..32_000).contains(&b[19]));
        let picture = GuideMap::from_fn([40, 9], |x, _| [if x < 20 { 0 } else { 128 }; 3]);
        assert!(luma(&picture).iter().zip(&b).all(|(a, b)| a.abs_diff(*b) < 70));
        let mask = Texture::from_fn(3, 3, 1, |_, _, out| out[0] = 7.0);
        assert_eq!(brightness(&mask), [65535; 9]);
    }
}
