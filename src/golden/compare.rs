//! How two images differ: in numbers, and as a picture for the reviewer.
//!
//! Unaware of: which image is golden, files, tolerances (see [`super::book`]).

use crate::io::{Pixels, SampleType, Samples};
use crate::numerics::par;
use crate::texture::color::linear_to_srgb;
use std::fmt;

/// Differences between the samples of two images of one shape.
///
/// Units are steps of 8 bits for integer samples (a step of 16 bits is 1/257), the values' own for floats.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Difference {
    /// Greatest difference of a sample; infinite where one float is NaN or infinite and the other is not the same.
    pub max: f64,
    /// Mean over all samples.
    pub mean: f64,
    /// Share of the texels of which any sample differs, 0..=1.
    pub differing_share: f64,
    /// Column and row of the first texel with the greatest difference.
    pub worst: [u32; 2],
}

impl Difference {
    /// True if every sample is the same.
    pub fn is_none(&self) -> bool {
        self.differing_share == 0.0
    }
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Difference { max, mean, differing_share, worst: [x, y] } = self;
        let percent = differing_share * 100.0;
        write!(f, "differs by at most {max:.3} (at {x}, {y}), on average {mean:.5}, in {percent:.2} % of the texels")
    }
}

/// Two images that cannot be compared sample by sample.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Unlike {
    /// Width, height, channels and type of the expected image.
    pub expected: (u32, u32, u32, SampleType),
    /// The same of the actual one.
    pub actual: (u32, u32, u32, SampleType),
}

impl fmt::Display for Unlike {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let say = |(w, h, c, t): (u32, u32, u32, SampleType)| format!("{w}x{h} with {c} channel(s) of {}", t.name());
        write!(f, "expected {}, found {}", say(self.expected), say(self.actual))
    }
}

impl std::error::Error for Unlike {}

/// Compares two images; both must be whole.
pub fn compare(expected: &Pixels, actual: &Pixels) -> Result<Difference, Unlike> {
    let shape = |p: &Pixels| (p.width, p.height, p.channels, p.samples.sample_type());
    if shape(expected) != shape(actual) {
        return Err(Unlike { expected: shape(expected), actual: shape(actual) });
    }
    let (w, h, c) = (expected.width as usize, expected.height as usize, expected.channels as usize);
    // One fold per row, then over the rows in order: the same sums for any number of threads.
    let rows = par::map_chunks(h, 1, |rows| {
        let (mut sum, mut max, mut worst, mut differing) = (0.0, 0.0, 0, 0usize);
        for x in 0..w {
            let mut texel = 0.0f64;
            for i in 0..c {
                let at = (rows.start * w + x) * c + i;
                let d = sample_difference(expected, at, actual, at);
                sum += d;
                texel = texel.max(d);
            }
            differing += usize::from(texel > 0.0);
            if texel > max {
                (max, worst) = (texel, x);
            }
        }
        (sum, max, worst, differing)
    });
    let mut out = Difference { max: 0.0, mean: 0.0, differing_share: 0.0, worst: [0, 0] };
    let mut differing_texels = 0;
    for (y, (sum, max, x, differing)) in rows.into_iter().enumerate() {
        out.mean += sum;
        differing_texels += differing;
        if max > out.max {
            (out.max, out.worst) = (max, [x as u32, y as u32]);
        }
    }
    out.mean /= (w * h * c) as f64;
    out.differing_share = differing_texels as f64 / (w * h) as f64;
    Ok(out)
}

/// Sample `i` of `a` against sample `j` of `b`.
fn sample_difference(a: &Pixels, i: usize, b: &Pixels, j: usize) -> f64 {
    match (&a.samples, &b.samples) {
        (Samples::U8(a), Samples::U8(b)) => f64::from(a[i].abs_diff(b[j])),
        (Samples::U16(a), Samples::U16(b)) => f64::from(a[i].abs_diff(b[j])) / 257.0,
        (Samples::F32(a), Samples::F32(b)) => {
            let (a, b) = (a[i], b[j]);
            if a == b || a.to_bits() == b.to_bits() {
                return 0.0;
            }
            let d = (f64::from(a) - f64::from(b)).abs();
            if d.is_finite() { d } else { f64::INFINITY }
        }
        _ => f64::INFINITY,
    }
}

/// True if a texel that both images have is not the same in both; images of different kinds are compared as shown.
fn differs(a: &Pixels, b: &Pixels, x: u32, y: u32) -> bool {
    let index = |p: &Pixels| (y as usize * p.width as usize + x as usize) * p.channels as usize;
    a.channels == b.channels
        && a.samples.sample_type() == b.samples.sample_type()
        && (0..a.channels as usize).any(|i| sample_difference(a, index(a) + i, b, index(b) + i) > 0.0)
}

/// Texels between the panels of a triptych, and their colour.
const GAP: u32 = 4;
const GAP_COLOR: [u8; 3] = [40, 40, 40];
/// What lies outside of the smaller of two images of different sizes.
const ABSENT: [u8; 3] = [255, 0, 255];

/// Expected, difference and actual, as 8-bit sRGB without alpha, all of one size.
///
/// Each panel is reduced by a whole factor to at most `panel` texels a side. The difference is amplified until its
/// greatest value is white, and a reduced texel shows the greatest difference in it, so that one odd texel stays in
/// sight. Floats are shown as linear colour clamped to 0..1, transparency as mid-grey. Images of different shapes are
/// laid over each other at the top left; what only one of them has is magenta.
pub fn panels(expected: &Pixels, actual: &Pixels, panel: u32) -> [Pixels; 3] {
    let (w, h) = (expected.width.max(actual.width), expected.height.max(actual.height));
    let factor = w.max(h).div_ceil(panel.max(1));
    let (width, height) = (w.div_ceil(factor), h.div_ceil(factor));
    let difference = |x, y| match (shown(expected, x, y), shown(actual, x, y)) {
        // Too small a difference for 8 bits is one all the same.
        (Some(a), Some(b)) if a == b => Some([u8::from(differs(expected, actual, x, y)); 3]),
        (Some(a), Some(b)) => Some([0, 1, 2].map(|i| a[i].abs_diff(b[i]))),
        (None, None) => Some([0; 3]),
        _ => None,
    };
    let gain = {
        let rows = par::map_chunks(h as usize, 1, |y| {
            (0..w).filter_map(|x| difference(x, y.start as u32)).flatten().max().unwrap_or(0)
        });
        255.0 / f32::from(rows.into_iter().max().unwrap_or(0).max(1))
    };
    [0, 1, 2].map(|part| {
        let mut samples = vec![0; width as usize * height as usize * 3];
        par::for_rows(&mut samples, width as usize * 3, |y, row| {
            for (x, out) in row.chunks_exact_mut(3).enumerate() {
                let block = Block { x: x as u32 * factor, y: y as u32 * factor, factor, w, h };
                let color = match part {
                    0 => block.mean(|x, y| shown(expected, x, y)),
                    1 => block.greatest(difference).map(|v| (f32::from(v) * gain + 0.5) as u8),
                    _ => block.mean(|x, y| shown(actual, x, y)),
                };
                out.copy_from_slice(&color);
            }
        });
        Pixels { width, height, channels: 3, samples: Samples::U8(samples) }
    })
}

/// Panels of one size and 8-bit colour side by side.
pub fn beside(panels: &[Pixels]) -> Pixels {
    let height = panels.first().map_or(0, |p| p.height);
    let mut samples = Vec::new();
    for y in 0..height as usize {
        for (i, panel) in panels.iter().enumerate() {
            if i > 0 {
                samples.extend([GAP_COLOR; GAP as usize].as_flattened());
            }
            let row = panel.width as usize * 3;
            if let Samples::U8(texels) = &panel.samples {
                samples.extend_from_slice(&texels[y * row..][..row]);
            }
        }
    }
    let width = panels.iter().map(|p| p.width + GAP).sum::<u32>().saturating_sub(GAP);
    Pixels { width, height, channels: 3, samples: Samples::U8(samples) }
}

/// Expected, difference and actual side by side: see [`panels`].
pub fn triptych(expected: &Pixels, actual: &Pixels, panel: u32) -> Pixels {
    beside(&panels(expected, actual, panel))
}

/// The texels that one texel of a reduced panel stands for.
struct Block {
    x: u32,
    y: u32,
    factor: u32,
    w: u32,
    h: u32,
}

impl Block {
    fn texels(&self) -> impl Iterator<Item = (u32, u32)> {
        let xs = self.x..(self.x + self.factor).min(self.w);
        (self.y..(self.y + self.factor).min(self.h)).flat_map(move |y| xs.clone().map(move |x| (x, y)))
    }

    fn mean(&self, color: impl Fn(u32, u32) -> Option<[u8; 3]>) -> [u8; 3] {
        let mut sum = [0u32; 3];
        let mut count = 0;
        for texel in self.texels().map(|(x, y)| color(x, y).unwrap_or(ABSENT)) {
            count += 1;
            sum = [0, 1, 2].map(|i| sum[i] + u32::from(texel[i]));
        }
        sum.map(|s| (s / count.max(1)) as u8)
    }

    fn greatest(&self, difference: impl Fn(u32, u32) -> Option<[u8; 3]>) -> [u8; 3] {
        let all = self.texels().map(|(x, y)| difference(x, y).unwrap_or(ABSENT));
        all.fold([0; 3], |a, b| [0, 1, 2].map(|i| a[i].max(b[i])))
    }
}

/// A texel as it is shown, in sRGB 0..1 without rounding to 8 bits: alpha over mid-grey, floats clamped. The texel is in
/// the image.
pub(super) fn shown_fine(p: &Pixels, x: u32, y: u32) -> [f32; 3] {
    let c = p.channels as usize;
    let at = (y as usize * p.width as usize + x as usize) * c;
    let value = |i: usize| match &p.samples {
        Samples::U8(v) => f32::from(v[at + i]) / 255.0,
        Samples::U16(v) => f32::from(v[at + i]) / 65535.0,
        Samples::F32(v) if v[at + i].is_nan() => 0.0,
        Samples::F32(v) if p.has_alpha() && i == c - 1 => v[at + i].clamp(0.0, 1.0),
        Samples::F32(v) => linear_to_srgb(v[at + i]),
    };
    let color = if c < 3 { [value(0); 3] } else { [value(0), value(1), value(2)] };
    let alpha = if p.has_alpha() { value(c - 1) } else { 1.0 };
    color.map(|v| v * alpha + 128.0 / 255.0 * (1.0 - alpha))
}

/// A texel as it is shown; `None` outside of the image.
pub(super) fn shown(p: &Pixels, x: u32, y: u32) -> Option<[u8; 3]> {
    if x >= p.width || y >= p.height {
        return None;
    }
    let c = p.channels as usize;
    let at = (y as usize * p.width as usize + x as usize) * c;
    let value = |i: usize| match &p.samples {
        Samples::U8(v) => v[at + i],
        Samples::U16(v) => (v[at + i] / 257) as u8,
        // Alpha is linear; a NaN shows black.
        Samples::F32(v) if p.has_alpha() && i == c - 1 => (v[at + i].clamp(0.0, 1.0) * 255.0 + 0.5) as u8,
        Samples::F32(v) => (linear_to_srgb(v[at + i]) * 255.0 + 0.5) as u8,
    };
    let color = if c < 3 { [value(0); 3] } else { [value(0), value(1), value(2)] };
    Some(match p.has_alpha() {
        true => {
            let alpha = u32::from(value(c - 1));
            color.map(|v| ((u32::from(v) * alpha + 128 * (255 - alpha)) / 255) as u8)
        }
        false => color,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(width: u32, channels: u32, samples: Samples) -> Pixels {
        let height = samples.len() as u32 / width / channels;
        Pixels { width, height, channels, samples }
    }

    fn texel(p: &Pixels, x: u32, y: u32) -> [u8; 3] {
        shown(p, x, y).unwrap()
    }

    #[test]
    fn figures_of_a_small_difference() {
        let a = image(2, 2, Samples::U8(vec![0, 0, 10, 10, 0, 0, 0, 0]));
        let b = image(2, 2, Samples::U8(vec![0, 0, 10, 13, 0, 5, 0, 0]));
        let d = compare(&a, &b).unwrap();
        assert_eq!(d, Difference { max: 5.0, mean: 1.0, differing_share: 0.5, worst: [0, 1] });
        assert!(compare(&a, &a).unwrap().is_none());
        assert_eq!(d.to_string(), "differs by at most 5.000 (at 0, 1), on average 1.00000, in 50.00 % of the texels");
    }

    #[test]
    fn sixteen_bits_count_in_steps_of_eight_and_floats_as_they_are() {
        let d = |a, b| compare(&image(2, 1, a), &image(2, 1, b)).unwrap();
        assert_eq!(d(Samples::U16(vec![0, 514]), Samples::U16(vec![0, 0])).max, 2.0);
        assert_eq!(d(Samples::F32(vec![0.0, 1.5]), Samples::F32(vec![0.0, 1.0])).max, 0.5);
        let nan = f32::NAN;
        assert!(d(Samples::F32(vec![nan, -0.0]), Samples::F32(vec![nan, 0.0])).is_none());
        assert_eq!(d(Samples::F32(vec![nan, 0.0]), Samples::F32(vec![1.0, 0.0])).max, f64::INFINITY);
        assert_eq!(d(Samples::F32(vec![f32::INFINITY, 0.0]), Samples::F32(vec![1.0, 0.0])).max, f64::INFINITY);
    }

    #[test]
    fn shapes_that_differ_are_told() {
        let a = image(2, 1, Samples::U8(vec![0; 4]));
        let b = image(2, 2, Samples::U8(vec![0; 4]));
        let unlike = compare(&a, &b).unwrap_err();
        assert_eq!(unlike.to_string(), "expected 2x2 with 1 channel(s) of u8, found 2x1 with 2 channel(s) of u8");
    }

    #[test]
    fn a_triptych_amplifies_the_difference() {
        let a = image(2, 3, Samples::U8(vec![10, 20, 30, 40, 50, 60]));
        let b = image(2, 3, Samples::U8(vec![10, 20, 30, 40, 40, 65]));
        let t = triptych(&a, &b, 100);
        assert_eq!((t.width, t.height), (3 * 2 + 2 * GAP, 1));
        assert_eq!(texel(&t, 1, 0), [40, 50, 60]);
        assert_eq!(texel(&t, 2, 0), GAP_COLOR);
        assert_eq!(texel(&t, 2 + GAP, 0), [0, 0, 0]);
        assert_eq!(texel(&t, 3 + GAP, 0), [0, 255, 128]);
        assert_eq!(texel(&t, 5 + 2 * GAP, 0), [40, 40, 65]);
    }

    #[test]
    fn one_odd_texel_survives_the_reduction() {
        let a = image(64, 1, Samples::U8(vec![100; 64 * 64]));
        let mut odd = vec![100; 64 * 64];
        odd[64 * 33 + 20] = 101;
        let t = triptych(&a, &image(64, 1, Samples::U8(odd)), 8);
        assert_eq!((t.width, t.height), (24 + 2 * GAP, 8));
        assert_eq!(texel(&t, 8 + GAP + 2, 4), [255; 3]);
        assert_eq!(texel(&t, 8 + GAP + 3, 4), [0; 3]);
    }

    #[test]
    fn a_difference_below_eight_bits_is_shown_too() {
        let a = image(2, 1, Samples::U16(vec![1000, 1000]));
        let t = triptych(&a, &image(2, 1, Samples::U16(vec![1000, 1001])), 10);
        assert_eq!((texel(&t, 2 + GAP, 0), texel(&t, 3 + GAP, 0)), ([0; 3], [255; 3]));
    }

    #[test]
    fn images_of_different_sizes_lie_over_each_other() {
        let a = image(1, 1, Samples::U8(vec![7]));
        let b = image(2, 1, Samples::U16(vec![7 * 257, 0, 9 * 257, 0]));
        let t = triptych(&a, &b, 10);
        assert_eq!((t.width, t.height), (3 * 2 + 2 * GAP, 2));
        assert_eq!(texel(&t, 0, 0), [7; 3]);
        assert_eq!(texel(&t, 1, 1), ABSENT);
        assert_eq!(texel(&t, 2 + GAP, 0), [0; 3]);
        assert_eq!(texel(&t, 3 + GAP, 0), ABSENT.map(|v| if v == 0 { 0 } else { 255 }));
    }
}
