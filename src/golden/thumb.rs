//! Thumbnails: what a line of a golden book means, at a glance.

use crate::io::{Pixels, Samples};

/// An image of 8 bits at most `side` texels wide and high: each texel the mean of a block, in the file's own values.
/// Smaller images only change their depth; floats are clamped to 0..1.
pub fn thumbnail(pixels: &Pixels, side: u32) -> Pixels {
    let step = pixels.width.max(pixels.height).div_ceil(side.max(1)).max(1);
    let (width, height) = (pixels.width.div_ceil(step), pixels.height.div_ceil(step));
    let c = pixels.channels as usize;
    let value = |i: usize| match &pixels.samples {
        Samples::U8(s) => f64::from(s[i]),
        Samples::U16(s) => f64::from(s[i]) / 257.0,
        Samples::F32(s) => f64::from(s[i].clamp(0.0, 1.0)) * 255.0,
    };
    let mut out = Vec::with_capacity(width as usize * height as usize * c);
    for y in 0..height {
        for x in 0..width {
            let rows = y * step..((y + 1) * step).min(pixels.height);
            let columns = x * step..((x + 1) * step).min(pixels.width);
            let count = f64::from(rows.len() as u32 * columns.len() as u32);
            for channel in 0..c {
                let mut sum = 0.0;
                for row in rows.clone() {
                    for column in columns.clone() {
                        sum += value((row as usize * pixels.width as usize + column as usize) * c + channel);
                    }
                }
                out.push((sum / count).round() as u8);
            }
        }
    }
    Pixels { width, height, channels: pixels.channels, samples: Samples::U8(out) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_become_their_means() {
        let p = Pixels { width: 4, height: 2, channels: 1, samples: Samples::U8(vec![0, 2, 10, 10, 4, 6, 10, 10]) };
        let t = thumbnail(&p, 2);
        assert_eq!((t.width, t.height, t.samples), (2, 1, Samples::U8(vec![3, 10])));
        let deep = Pixels { width: 1, height: 1, channels: 1, samples: Samples::U16(vec![65535]) };
        assert_eq!(thumbnail(&deep, 64).samples, Samples::U8(vec![255]));
    }
}
