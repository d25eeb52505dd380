//! How well a texture reproduces its sample, in figures: lower is better.
//!
//! - `swd`: sliced Wasserstein distance between the 7x7 patches of both, on three levels of a Laplacian pyramid (Karras
//!   et al. 2018), x1000, mean over the levels: does the output have the sample's statistics?
//! - `coherence` and `coherence_p95`: RMS colour difference, in steps of 8 bits, between 9x9 patches of the output and
//!   the nearest ones of the sample, mean and 95th percentile: the tail is the seams (Simakov et al. 2008).
//!
//! In: samples and an output, compared as 8-bit sRGB; how many of the output's texels lie on one of the samples'. Places
//! and directions are drawn by fixed keys and sums are made in a fixed order, so the figures are the same everywhere, and
//! small changes show as such. Patches of the output in which neighbours are alike are left out where the sample has none
//! such: an atlas is filled up with flat colour between its charts. Its patches lie as the charts do, turned against the
//! sample, so its figures are for comparing with themselves.
//! Unaware of: recipes, files, what is golden.

mod coherence;
mod swd;

use super::compare::shown;
use crate::io::Pixels;
use crate::numerics::rng::Key;
use std::collections::BTreeMap;

/// A patch is flat if more than one in so many of its texels is like its right neighbour.
const FLAT_SHARE: usize = 3;
/// Of larger pictures so many windows a side are looked at, spread over all, of so many texels a side.
const WINDOWS: u32 = 4;
const WINDOW: u32 = 256;

/// Colours as they are shown, row by row.
#[derive(Clone, Debug, PartialEq)]
struct Image {
    width: usize,
    height: usize,
    texels: Vec<[u8; 3]>,
}

/// Where a patch begins: index of the image, column, row.
type Corner = (usize, usize, usize);

impl Image {
    fn of(pixels: &Pixels) -> Image {
        Image::window(pixels, [0, 0], [pixels.width, pixels.height])
    }

    /// The texels from a place on.
    fn window(pixels: &Pixels, [left, top]: [u32; 2], [width, height]: [u32; 2]) -> Image {
        let rows = (top..top + height).flat_map(|y| (left..left + width).map(move |x| (x, y)));
        let texels = rows.map(|(x, y)| shown(pixels, x, y).unwrap_or_default()).collect();
        Image { width: width as usize, height: height as usize, texels }
    }

    /// A picture, or windows of `side` texels of one that is larger than they are together.
    fn parts(pixels: &Pixels, side: u32) -> Vec<Image> {
        let texels = u64::from(pixels.width) * u64::from(pixels.height);
        if texels <= (u64::from(WINDOWS) * u64::from(side)).pow(2) {
            return vec![Image::of(pixels)];
        }
        let [width, height] = [pixels.width, pixels.height].map(|n| n.min(side));
        let at = |i: u32, n: u32, size: u32| (u64::from(n - size) * u64::from(i) / u64::from(WINDOWS - 1)) as u32;
        let places = (0..WINDOWS * WINDOWS)
            .map(|i| [at(i % WINDOWS, pixels.width, width), at(i / WINDOWS, pixels.height, height)]);
        places.map(|place| Image::window(pixels, place, [width, height])).collect()
    }

    /// Another size by a triangle filter that is as wide as a texel of the coarser image.
    fn resized(&self, factor: f64) -> Image {
        let side = |n: usize| ((n as f64 * factor).round() as usize).max(1);
        let (width, height) = (side(self.width), side(self.height));
        let across = taps(self.width, width);
        let down = taps(self.height, height);
        let mut rows = Vec::with_capacity(self.height * width);
        for row in self.texels.chunks_exact(self.width) {
            rows.extend(across.iter().map(|(start, taps)| mean(taps, |i| row[start + i].map(f32::from))));
        }
        let mut texels = Vec::with_capacity(height * width);
        for (start, taps) in &down {
            let column = |x: usize| mean(taps, |i| rows[(start + i) * width + x]).map(|v| (v + 0.5) as u8);
            texels.extend((0..width).map(column));
        }
        Image { width, height, texels }
    }

    /// How many patches begin in it.
    fn patches(&self, size: usize) -> usize {
        (self.width + 1).saturating_sub(size) * (self.height + 1).saturating_sub(size)
    }

    /// Where patch `index` begins.
    fn corner(&self, size: usize, index: usize) -> (usize, usize) {
        let columns = self.width + 1 - size;
        (index % columns, index / columns)
    }

    /// Whether a third of a patch is like its right neighbour.
    fn is_flat(&self, size: usize, (x, y): (usize, usize)) -> bool {
        let row = |dy: usize| &self.texels[(y + dy) * self.width + x..][..size];
        let alike = (0..size).map(|dy| row(dy).windows(2).filter(|w| w[0] == w[1]).count());
        alike.sum::<usize>() * FLAT_SHARE > size * (size - 1)
    }
}

/// For each texel of a row of `to`, the first texel of a row of `from` and the weights from there on.
fn taps(from: usize, to: usize) -> Vec<(usize, Vec<f32>)> {
    let step = from as f64 / to as f64;
    let reach = step.max(1.0);
    let one = |i: usize| {
        let at = (i as f64 + 0.5) * step - 0.5;
        let first = (at - reach).ceil().max(0.0) as usize;
        let last = ((at + reach).floor().max(0.0) as usize).min(from - 1);
        let weights: Vec<f32> =
            (first..=last).map(|x| (1.0 - (x as f64 - at).abs() / reach).max(1e-6) as f32).collect();
        let sum: f32 = weights.iter().sum();
        (first, weights.into_iter().map(|w| w / sum).collect())
    };
    (0..to).map(one).collect()
}

fn mean(taps: &[f32], value: impl Fn(usize) -> [f32; 3]) -> [f32; 3] {
    let mut sum = [0.0; 3];
    for (i, weight) in taps.iter().enumerate() {
        let v = value(i);
        sum = [0, 1, 2].map(|c| sum[c] + weight * v[c]);
    }
    sum
}

/// At most `count` patches of some images, evenly spread at random; without those that `keep` refuses.
fn draw(images: &[Image], size: usize, count: usize, keep: impl Fn(Corner) -> bool) -> Vec<Corner> {
    let total: usize = images.iter().map(|i| i.patches(size)).sum();
    let count = count.min(total);
    let key = Key::new(0).with_str("patches").with(size as u64);
    let mut corners = Vec::with_capacity(count);
    let (mut image, mut before) = (0, 0);
    for i in 0..count {
        // One in each of `count` equal parts of all patches; all, if there are no more.
        let part = (i as f64 + key.unit(i as u64)) * total as f64 / count as f64;
        let at = if count == total { i } else { (part as usize).min(total - 1) };
        while at - before >= images[image].patches(size) {
            before += images[image].patches(size);
            image += 1;
        }
        let (x, y) = images[image].corner(size, at - before);
        if keep((image, x, y)) {
            corners.push((image, x, y));
        }
    }
    corners
}

/// Figures of an output by name; none where the output or a sample is too small for patches, or the output is flat.
///
/// `scale` is the output's texels per texel of the samples, along a side.
pub fn measure(samples: &[Pixels], output: &Pixels, scale: f64) -> BTreeMap<String, f64> {
    // Beyond these it says nothing any more.
    let scale = if scale.is_finite() { scale.clamp(1.0 / 64.0, 8.0) } else { 1.0 };
    let side = (f64::from(WINDOW) / scale.min(1.0)).ceil() as u32;
    let mut samples: Vec<Image> = samples.iter().flat_map(|s| Image::parts(s, side)).collect();
    if !(0.99..=1.01).contains(&scale) {
        samples = samples.iter().map(|s| s.resized(scale)).collect();
    }
    let mut output = Image::parts(output, WINDOW);
    for images in [&mut samples, &mut output] {
        images.retain(|i| i.width.min(i.height) >= coherence::PATCH + 2);
    }
    if samples.is_empty() || output.is_empty() {
        return BTreeMap::new();
    }
    let places = draw(&samples, coherence::PATCH, 1000, |_| true);
    let flat = places.iter().filter(|(i, x, y)| samples[*i].is_flat(coherence::PATCH, (*x, *y))).count();
    let keep_flat = flat * 50 > places.len();
    let keep = |size: usize| {
        let output = &output;
        move |(i, x, y): Corner| keep_flat || !output[i].is_flat(size, (x, y))
    };
    let mut figures = BTreeMap::new();
    if let Some(swd) = swd::distance(&samples, &output, keep(swd::PATCH)) {
        figures.insert("swd".to_string(), rounded(swd, 10.0));
    }
    if let Some([mean, p95]) = coherence::distance(&samples, &output, keep(coherence::PATCH)) {
        figures.insert("coherence".to_string(), rounded(mean, 100.0));
        figures.insert("coherence_p95".to_string(), rounded(p95, 100.0));
    }
    figures
}

fn rounded(value: f64, steps: f64) -> f64 {
    (value * steps).round() / steps
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::Samples;
    use crate::numerics::par;

    fn picture(width: u32, height: u32, color: impl Fn(u32, u32) -> [u8; 3]) -> Pixels {
        let texels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        Pixels { width, height, channels: 3, samples: Samples::U8(texels.flat_map(|(x, y)| color(x, y)).collect()) }
    }

    /// Bricks of sorts, with a little noise that tells places apart.
    fn bricks(x: u32, y: u32) -> [u8; 3] {
        let (x, y) = (x % 64, y % 64);
        let joint = y % 16 < 2 || (x + 8 * (y / 16 % 2)) % 32 < 2;
        let noise = (Key::new(5).bits(u64::from(y * 64 + x)) % 40) as u8;
        if joint { [90 + noise / 4; 3] } else { [150 + noise, 70 + noise / 2, 50] }
    }

    fn other(x: u32, y: u32) -> [u8; 3] {
        [0, 1, 2].map(|c| (Key::new(8).bits(u64::from(y * 4096 + x) * 3 + c) % 200) as u8)
    }

    #[test]
    fn what_is_copied_is_coherent_and_what_is_not_is_worse() {
        let sample = [picture(64, 64, bricks)];
        let tiled = measure(&sample, &picture(128, 128, bricks), 1.0);
        // Only patches across the border of the sample are not in it.
        assert!(tiled["coherence"] < 10.0, "{tiled:?}");
        let same = measure(&sample, &sample[0], 1.0);
        assert_eq!((same["coherence"], same["coherence_p95"], same["swd"]), (0.0, 0.0, 0.0), "the sample itself");
        let noise = measure(&sample, &picture(40, 40, other), 1.0);
        assert!(noise["coherence"] > 30.0 && noise["swd"] > 10.0 * tiled["swd"].max(1.0), "{noise:?} {tiled:?}");
    }

    #[test]
    fn a_seam_shows_in_the_tail() {
        let sample = [picture(64, 64, bricks)];
        let clean = measure(&sample, &picture(60, 60, bricks), 1.0);
        let torn =
            measure(&sample, &picture(60, 60, |x, y| if x < 30 { bricks(x, y) } else { bricks(x + 7, y + 5) }), 1.0);
        assert!(torn["coherence_p95"] > clean["coherence_p95"] + 2.0, "{torn:?} {clean:?}");
    }

    #[test]
    fn figures_do_not_depend_on_threads() {
        let (sample, output) = ([picture(32, 32, bricks)], picture(24, 20, other));
        let run = |jobs| par::install(jobs, || measure(&sample, &output, 1.0));
        assert_eq!(run(1), run(3));
    }

    #[test]
    fn an_output_of_another_scale_is_compared_at_that_scale() {
        let sample = picture(96, 96, |x, y| bricks(x, y).map(|v| v / 2 * 2));
        let coarse = Image::of(&sample).resized(0.5);
        assert_eq!((coarse.width, coarse.height), (48, 48));
        let half = picture(48, 48, |x, y| coarse.texels[(y * 48 + x) as usize]);
        let [scaled, plain] = [0.5, 1.0].map(|scale| measure(std::slice::from_ref(&sample), &half, scale)["coherence"]);
        assert!(scaled == 0.0 && plain > 3.0, "{scaled} {plain}");
    }

    #[test]
    fn flat_filling_is_left_out() {
        let sample = [picture(64, 64, bricks)];
        let filled = picture(128, 128, |x, y| if x < 64 { bricks(x, y) } else { [(x / 16) as u8 * 9, 100, 200] });
        assert!(measure(&sample, &filled, 1.0)["coherence"] < 8.0);
        assert!(measure(&sample, &picture(64, 64, |_, _| [7; 3]), 1.0).is_empty(), "nothing is left");
    }

    #[test]
    fn large_pictures_are_looked_at_in_windows() {
        let large = picture(1500, 1000, |x, y| [(x / 8) as u8, (y / 8) as u8, 0]);
        let parts = Image::parts(&large, 256);
        assert_eq!((parts.len(), parts[0].width, parts[15].height), (16, 256, 256));
        assert_eq!((parts[0].texels[0], parts[15].texels.last()), ([0, 0, 0], Some(&[187, 124, 0])));
        let long = picture(2000, 600, |_, _| [0; 3]);
        assert_eq!(Image::parts(&long, 256)[5].height, 256);
        assert_eq!(Image::parts(&picture(1024, 1024, |_, _| [0; 3]), 256).len(), 1);
        assert_eq!(Image::parts(&picture(20_000, 60, |_, _| [0; 3]), 256)[15].height, 60);
    }

    #[test]
    fn small_pictures_have_no_figures() {
        let tiny = picture(8, 8, other);
        assert!(measure(std::slice::from_ref(&tiny), &picture(64, 64, other), 1.0).is_empty());
        assert!(measure(&[picture(64, 64, other)], &tiny, 1.0).is_empty());
        assert!(measure(&[], &picture(64, 64, other), 1.0).is_empty());
    }

    #[test]
    fn patches_are_spread_over_all_images() {
        let images = [picture(20, 20, other), picture(30, 30, other)].map(|p| Image::of(&p));
        let all = draw(&images, 9, 10_000, |_| true);
        assert_eq!(all.len(), 12 * 12 + 22 * 22);
        assert_eq!(all.last(), Some(&(1, 21, 21)));
        let some = draw(&images, 9, 100, |_| true);
        assert!(some.len() == 100 && some.windows(2).all(|w| w[0] != w[1]) && some.iter().any(|c| c.0 == 0));
    }
}
