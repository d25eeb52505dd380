//! The frames of a flipbook: copies texels by the sources, blending small patches at the seams if asked to.
//!
//! Source: \[ZG02\] section 3.1, as `image::copy` reads it, in space and time: a pixel receives, from every pixel of its
//! neighbourhood, the texel that this one's patch puts there. Inside a patch all agree, and the texel is copied exactly.
//! Unaware of: what the channels mean; whoever copies normals renormalises them.

use super::walk::SourceVolume;
use crate::texture::Texture;

/// How patches are blended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum VolumeKernel {
    /// Plain copies.
    None,
    /// Patches of 3 x 3 pixels.
    Space,
    /// Patches of 3 x 3 pixels in three frames: a cut in time becomes a dissolve over two frames.
    SpaceTime,
}

/// Weights of the neighbours by distance along one axis, binomial.
const WEIGHTS: [f32; 3] = [0.25, 0.5, 0.25];

/// Makes frame `t` of `map` out of `strip`, the exemplar's frames below one another. Panics if that has another size than
/// the analysed exemplar, or there is no such frame.
pub fn copy_frame(strip: &Texture, map: &SourceVolume, t: u32, kernel: VolumeKernel) -> Texture {
    let [w, h, frames] = map.exemplar_size;
    assert_eq!([strip.width(), strip.height()], [w, h * frames], "a strip of another size than the exemplar");
    assert!(t < map.size[2], "frame {t} of {}", map.size[2]);
    let radius = [i32::from(kernel != VolumeKernel::None), i32::from(kernel == VolumeKernel::SpaceTime)];
    Texture::from_fn(map.size[0], map.size[1], strip.channels(), |x, y, out| {
        let at = [x as i32, y as i32, t as i32];
        let own = suggestion(map, at, [0; 3]).unwrap_or_default();
        let mut steps = steps(radius);
        if steps.all(|step| suggestion(map, at, step).is_none_or(|s| s == own)) {
            out.copy_from_slice(strip.get(own[0] as u32, own[2] as u32 * h + own[1] as u32));
        } else {
            blend(strip, map, at, radius, out);
        }
    })
}

/// The steps to the pixels of a neighbourhood.
fn steps([space, time]: [i32; 2]) -> impl Iterator<Item = [i32; 3]> {
    let plane = move |t| (-space..=space).flat_map(move |y| (-space..=space).map(move |x| [x, y, t]));
    (-time..=time).flat_map(plane)
}

/// The texel that the patch of the pixel at `at + step` puts at `at`; `None` if there is no such pixel.
fn suggestion(map: &SourceVolume, at: [i32; 3], step: [i32; 3]) -> Option<[i32; 3]> {
    let source = map.sources[map.index([0, 1, 2].map(|i| at[i] + step[i]))?];
    Some([0, 1, 2].map(|i| i32::from(source[i]) - step[i]))
}

fn blend(strip: &Texture, map: &SourceVolume, at: [i32; 3], radius: [i32; 2], out: &mut [f32]) {
    let size = map.exemplar_size.map(|s| s as i32);
    let mut sum = 0.0;
    out.fill(0.0);
    for step in steps(radius) {
        let Some([x, y, t]) = suggestion(map, at, step) else { continue };
        if (0..size[0]).contains(&x) && (0..size[1]).contains(&y) && (0..size[2]).contains(&t) {
            let weight = step.iter().map(|d| WEIGHTS[(d + 1) as usize]).product::<f32>();
            sum += weight;
            for (o, v) in out.iter_mut().zip(strip.get(x as u32, (t * size[1] + y) as u32)) {
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

    /// Texels that tell their place: column + 10 row + 100 frame.
    fn strip() -> Texture {
        Texture::from_fn(4, 4 * 3, 1, |x, y, out| out[0] = (x + 10 * (y % 4) + 100 * (y / 4)) as f32)
    }

    fn map(size: [u32; 3], sources: Vec<[u16; 3]>, looped: bool) -> SourceVolume {
        let counters = Default::default();
        SourceVolume { size, exemplar_size: [4, 4, 3], sources, tileable: false, looped, counters }
    }

    #[test]
    fn a_plain_copy_replays_the_sources() {
        let map = map([2, 1, 2], vec![[0, 0, 0], [3, 1, 2], [1, 2, 1], [2, 3, 0]], false);
        let frame = |t| copy_frame(&strip(), &map, t, VolumeKernel::None).data().to_vec();
        assert_eq!((frame(0), frame(1)), (vec![0.0, 213.0], vec![121.0, 32.0]));
    }

    #[test]
    fn one_patch_is_copied_exactly() {
        let map = map([2, 2, 2], (0..8).map(|i| [1 + i % 2, 1 + i / 2 % 2, i / 4]).collect(), false);
        for kernel in [VolumeKernel::Space, VolumeKernel::SpaceTime] {
            assert_eq!(copy_frame(&strip(), &map, 1, kernel), copy_frame(&strip(), &map, 1, VolumeKernel::None));
        }
    }

    #[test]
    fn a_cut_in_time_is_dissolved_and_one_in_space_mixed() {
        // Two frames of one pixel: texel (0, 0) of frame 0, then (3, 3) of frame 1, whose patch began at (3, 3, 0).
        let cut = map([1, 1, 2], vec![[0, 0, 0], [3, 3, 1]], false);
        let value = |map: &SourceVolume, t, kernel| copy_frame(&strip(), map, t, kernel).data()[0];
        assert_eq!(value(&cut, 0, VolumeKernel::Space), 0.0);
        assert_eq!(value(&cut, 0, VolumeKernel::SpaceTime), (0.5 * 0.0 + 0.25 * 33.0) / 0.75);
        assert_eq!(value(&cut, 1, VolumeKernel::SpaceTime), (0.5 * 133.0 + 0.25 * 100.0) / 0.75);
        // In a loop the last frame comes before the first as well: (3, 3, 1) puts (3, 3, 2) there.
        let round = map([1, 1, 2], vec![[0, 0, 0], [3, 3, 1]], true);
        assert_eq!(value(&round, 0, VolumeKernel::SpaceTime), 0.5 * 0.0 + 0.25 * 33.0 + 0.25 * 233.0);
        let side = map([2, 1, 1], vec![[0, 0, 2], [2, 0, 0]], false);
        assert_eq!(value(&side, 0, VolumeKernel::Space), (0.5 * 200.0 + 0.25 * 1.0) / 0.75);
    }

    #[test]
    fn threads_do_not_change_the_picture() {
        let map = map([8, 8, 3], (0..192u16).map(|i| [i * 7 % 4, i * 5 % 3, i % 3]).collect(), true);
        let run = |jobs| par::install(jobs, || copy_frame(&strip(), &map, 1, VolumeKernel::SpaceTime));
        assert_eq!(run(1), run(8));
    }
}
