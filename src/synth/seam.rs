//! How visible a seam between two places of the exemplar is.
//!
//! Difference of values in relation to the local variance of both places, so that seams in busy places weigh less and
//! smooth places, which go with everything smooth, gain nothing. Beside it a count of how much each part is used.
//! Unaware of: images, meshes.

use crate::texture::{Texel, Texture};

/// Column and row of a texel of the exemplar, or of a place outside.
pub(super) type Place = [i32; 2];

/// Added to local variances, as a share of their mean, so that flat places do not divide by nothing.
const VARIANCE_FLOOR: f32 = 0.1;

/// Sources of a cell below which none is counted as used too much: fewer say nothing.
const LEAST_SHARE: f32 = 8.0;

/// Cells along a side of the exemplar in which its use is counted.
const CELLS: u32 = 16;

/// The exemplar's values, blurred for a level, and their local variances.
pub(super) struct Field {
    /// Size of the exemplar in texels.
    pub size: [i32; 2],
    /// Groups of four channels per texel.
    quads: usize,
    values: Vec<[f32; 4]>,
    /// One over the root of the local variance.
    sharpness: Vec<f32>,
}

impl Field {
    /// Blurs by a tent of `blur` texels to each side; variances are those within `around` texels to each side.
    pub fn new(exemplar: &Texture, blur: usize, around: usize) -> Self {
        let channels = exemplar.channels() as usize;
        let size = [exemplar.width(), exemplar.height()];
        let smooth = |v: Vec<f32>, channels| box_mean(&box_mean(&v, size, channels, blur), size, channels, blur);
        let values = smooth(exemplar.data().to_vec(), channels);
        let mean = box_mean(&values, size, channels, around);
        let squares: Vec<f32> = values.chunks(channels).map(|t| t.iter().map(|v| v * v).sum()).collect();
        let mean_square = box_mean(&squares, size, 1, around);
        let spread = |(m, s): (&[f32], &f32)| (s - m.iter().map(|v| v * v).sum::<f32>()).max(0.0);
        let variance: Vec<f32> = mean.chunks(channels).zip(&mean_square).map(spread).collect();
        let typical = variance.iter().map(|v| f64::from(*v)).sum::<f64>() / variance.len() as f64;
        let floor = (typical as f32 * VARIANCE_FLOOR).max(1e-12);
        let sharpness = variance.iter().map(|v| 1.0 / (v + floor).sqrt()).collect();
        let quads = channels.div_ceil(4);
        let mut padded = vec![[0.0; 4]; variance.len() * quads];
        for (texel, quads) in values.chunks(channels).zip(padded.chunks_mut(quads)) {
            for (v, to) in texel.iter().zip(quads.as_flattened_mut()) {
                *to = *v;
            }
        }
        Field { size: size.map(|s| s as i32), quads, values: padded, sharpness }
    }

    /// Index of a texel; `None` outside.
    #[inline(always)]
    pub fn index(&self, [x, y]: Place) -> Option<usize> {
        let inside = (0..self.size[0]).contains(&x) & (0..self.size[1]).contains(&y);
        inside.then(|| (y * self.size[0] + x) as usize)
    }

    /// The inverse of [`Field::index`].
    pub fn place(&self, index: usize) -> Place {
        let (index, width) = (index as u32, self.size[0] as u32);
        [(index % width) as i32, (index / width) as i32]
    }

    /// Squared difference of two texels in relation to what varies around them.
    #[inline(always)]
    pub fn difference(&self, a: usize, b: usize) -> f32 {
        let texel = |i: usize| &self.values[i * self.quads..(i + 1) * self.quads];
        square(texel(a), texel(b)) * self.sharpness[a] * self.sharpness[b]
    }

    /// Quads of a sample.
    pub fn quads(&self) -> usize {
        self.quads
    }

    /// Appends the bilinear sample at `at` to `out`; returns its sharpness, or `None` if it lies beyond the outer centres.
    pub fn sample(&self, at: Texel, out: &mut Vec<[f32; 4]>) -> Option<f32> {
        let [w, h] = self.size;
        let (x, y) = (at.x - 0.5, at.y - 0.5);
        let inside = x >= -SLACK && y >= -SLACK && x <= (w - 1) as f32 + SLACK && y <= (h - 1) as f32 + SLACK;
        if !inside {
            return None;
        }
        let (x0, y0) = ((x.floor() as i32).clamp(0, (w - 2).max(0)), (y.floor() as i32).clamp(0, (h - 2).max(0)));
        let (tx, ty) = (x - x0 as f32, y - y0 as f32);
        let (x1, y1) = ((x0 + 1).min(w - 1), (y0 + 1).min(h - 1));
        let texel = |x: i32, y: i32| &self.values[(y * w + x) as usize * self.quads..][..self.quads];
        let (a, b, c, d) = (texel(x0, y0), texel(x1, y0), texel(x0, y1), texel(x1, y1));
        for q in 0..self.quads {
            out.push(std::array::from_fn(|i| {
                let top = a[q][i] + (b[q][i] - a[q][i]) * tx;
                let bottom = c[q][i] + (d[q][i] - c[q][i]) * tx;
                top + (bottom - top) * ty
            }));
        }
        let near = |t: f32, a: i32, b: i32| if t < 0.5 { a } else { b };
        Some(self.sharpness[(near(ty, y0, y1) * w + near(tx, x0, x1)) as usize])
    }
}

/// Addresses are f32: what is this little outside counts as inside.
const SLACK: f32 = 1e-2;

/// Half the squared distance of two samples.
#[inline(always)]
pub(super) fn square(a: &[[f32; 4]], b: &[[f32; 4]]) -> f32 {
    let mut sums = [0.0; 4];
    for (a, b) in a.iter().zip(b) {
        for c in 0..4 {
            sums[c] += (a[c] - b[c]) * (a[c] - b[c]);
        }
    }
    0.5 * (sums[0] + sums[1] + sums[2] + sums[3])
}

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

/// How often each part of the exemplar is used.
pub(super) struct Usage {
    width: i32,
    /// The cell of each texel.
    cells: Vec<u16>,
    counts: Vec<u32>,
    /// One over the even share of a cell.
    scale: f32,
}

impl Usage {
    /// Counts the sources; an even share is one per cell of [`CELLS`] squared.
    pub fn new([w, h]: [u32; 2], sources: impl ExactSizeIterator<Item = Place>) -> Self {
        let side = [w.div_ceil(CELLS), h.div_ceil(CELLS)];
        let cell = |x: u32, y: u32| (y / side[1] * CELLS + x / side[0]) as u16;
        let cells = (0..h).flat_map(|y| (0..w).map(move |x| cell(x, y))).collect();
        let share = sources.len() as f32 * (side[0] * side[1]) as f32 / (w as f32 * h as f32);
        let counts = vec![0; (CELLS * CELLS) as usize];
        let mut usage = Usage { width: w as i32, cells, counts, scale: 1.0 / share.max(LEAST_SHARE) };
        for s in sources {
            let cell = usage.cell(s);
            usage.counts[cell] += 1;
        }
        usage
    }

    fn cell(&self, [x, y]: Place) -> usize {
        usize::from(self.cells[(y * self.width + x) as usize])
    }

    /// One source less at `from`, one more at `to`.
    pub fn moved(&mut self, from: Place, to: Place) {
        let (a, b) = (self.cell(from), self.cell(to));
        self.counts[a] -= 1;
        self.counts[b] += 1;
    }

    /// One for a texel of a part used no more than evenly, else how many times more.
    pub fn factor(&self, texel: usize) -> f32 {
        (self.counts[usize::from(self.cells[texel])] as f32 * self.scale).max(1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synth::testing::noise;
    use crate::texture::{Wrap, texel};

    #[test]
    fn samples_are_bilinear_and_sharp_where_little_varies() {
        let t =
            Texture::from_fn(8, 6, 5, |x, y, out| out.copy_from_slice(&[x as f32, y as f32, 1.0, 2.0, (x * y) as f32]));
        let field = Field::new(&t, 0, 1);
        assert_eq!(field.quads(), 2);
        let (mut ours, mut theirs) = (vec![], [0.0; 5]);
        for at in [texel(0.5, 0.5), texel(3.2, 4.9), texel(7.5, 5.5), texel(1.0, 5.5)] {
            ours.clear();
            assert!(field.sample(at, &mut ours).is_some());
            t.sample(at, Wrap::Clamp, &mut theirs);
            for (a, b) in ours.as_flattened().iter().zip(theirs) {
                assert!((a - b).abs() < 1e-5, "{at:?} {a} {b}");
            }
        }
        assert_eq!(field.sample(texel(0.4, 3.0), &mut ours), None);
        assert_eq!(field.sample(texel(3.0, 5.6), &mut ours), None);
        // The product x y varies most at the far corner.
        assert!(field.sharpness[0] > field.sharpness[47]);
        assert_eq!(field.place(field.index([3, 2]).unwrap()), [3, 2]);
        assert_eq!(field.index([8, 2]), None);
    }

    #[test]
    fn use_beyond_the_even_share_costs() {
        let sources = (0..64).map(|i| [i % 2, i / 2 % 2]).chain([[20, 20]; 40]);
        let sources: Vec<Place> = sources.collect();
        let mut usage = Usage::new([32, 32], sources.into_iter());
        // 256 cells of 2 x 2 texels: the even share is below eight.
        assert_eq!((usage.factor(0), usage.factor(20 * 32 + 21), usage.factor(5)), (8.0, 5.0, 1.0));
        (0..32).for_each(|_| usage.moved([1, 1], [5, 0]));
        assert_eq!((usage.factor(0), usage.factor(5)), (4.0, 4.0));
    }

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
