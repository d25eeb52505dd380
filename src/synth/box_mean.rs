//! Means over squares of an image.
//!
//! Unaware of: what the values are.

/// The mean over a square of 2 `reach` + 1 texels, of those that are inside.
pub(super) fn box_mean(values: &[f32], [w, h]: [u32; 2], channels: usize, reach: usize) -> Vec<f32> {
    if reach == 0 {
        return values.to_vec();
    }
    let (w, h) = (w as usize, h as usize);
    let across = line_means(values, [w, h], channels, [channels, w * channels], reach);
    line_means(&across, [h, w], channels, [w * channels, channels], reach)
}

/// Means along lines of `n` texels; `steps`: distance between the texels of a line and between lines.
fn line_means(values: &[f32], [n, lines]: [usize; 2], channels: usize, steps: [usize; 2], reach: usize) -> Vec<f32> {
    let mut out = vec![0.0; values.len()];
    for start in (0..lines).flat_map(|l| (0..channels).map(move |c| l * steps[1] + c)) {
        // A running sum in f64: its rounding stays far below that of f32.
        let at = |i: usize| start + i * steps[0];
        let mut sum: f64 = (0..reach.min(n)).map(|i| f64::from(values[at(i)])).sum();
        for i in 0..n {
            if i + reach < n {
                sum += f64::from(values[at(i + reach)]);
            }
            if i > reach {
                sum -= f64::from(values[at(i - reach - 1)]);
            }
            let count = (i + reach + 1).min(n) - i.saturating_sub(reach);
            out[at(i)] = (sum / count as f64) as f32;
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synth::testing::noise;

    #[test]
    fn box_means_are_means() {
        let t = noise(7, 5);
        let out = box_mean(t.data(), [7, 5], 1, 2);
        for (x, y) in (0..5i64).flat_map(|y| (0..7i64).map(move |x| (x, y))) {
            let inside = |c: i64, n: i64| (c - 2).max(0)..(c + 3).min(n);
            let all: Vec<f32> = inside(y, 5)
                .flat_map(|b| inside(x, 7).map(move |a| (a, b)))
                .map(|(a, b)| t.get(a as u32, b as u32)[0])
                .collect();
            let mean = all.iter().sum::<f32>() / all.len() as f32;
            assert!((out[(y * 7 + x) as usize] - mean).abs() < 1e-5);
        }
    }
}
