//! How visible a seam between two places of a flipbook is, and how much each part of it is used: `seam` in space and time.
//!
//! Unaware of: outputs, walks.

use crate::numerics::par;
use crate::synth::box_mean::box_mean;
use crate::texture::Texture;

/// Column, row and frame of a texel of the exemplar, or of a place outside.
pub(super) type Place = [i32; 3];

/// Added to local variances, as a share of their mean, so that flat places do not divide by nothing.
const VARIANCE_FLOOR: f32 = 0.1;

/// Cells along each side of the exemplar, and along its frames, in which its use is counted.
const CELLS: [u32; 3] = [8, 8, 4];

/// Sources of a cell below which none is counted as used too much: fewer say nothing.
const LEAST_SHARE: f32 = 8.0;

/// The exemplar's values, blurred for a level, and their local variances.
pub(super) struct Field {
    size: Place,
    /// Groups of four channels per texel.
    quads: usize,
    values: Vec<[f32; 4]>,
    /// One over the root of the local variance.
    sharpness: Vec<f32>,
}

impl Field {
    /// Of frames of `size` (width, height, frames), below one another in `strip`. Blurs each by a tent of `blur` texels to
    /// each side; variances are those within `around` texels to each side in the same frame.
    pub fn new(strip: &Texture, size: [u32; 3], blur: usize, around: usize) -> Self {
        let (channels, area) = (strip.channels() as usize, size[0] as usize * size[1] as usize);
        let sides = [size[0], size[1]];
        let frames = par::map_chunks(size[2] as usize, 1, |t| {
            let own = strip.data()[t.start * area * channels..t.end * area * channels].to_vec();
            let values = box_mean(&box_mean(&own, sides, channels, blur), sides, channels, blur);
            let mean = box_mean(&values, sides, channels, around);
            let squares: Vec<f32> = values.chunks(channels).map(|t| t.iter().map(|v| v * v).sum()).collect();
            let spread = |(m, s): (&[f32], &f32)| (s - m.iter().map(|v| v * v).sum::<f32>()).max(0.0);
            let variance: Vec<f32> =
                mean.chunks(channels).zip(&box_mean(&squares, sides, 1, around)).map(spread).collect();
            (values, variance)
        });
        let variance: Vec<f32> = frames.iter().flat_map(|f| f.1.iter().copied()).collect();
        let typical = variance.iter().map(|v| f64::from(*v)).sum::<f64>() / variance.len() as f64;
        let floor = (typical as f32 * VARIANCE_FLOOR).max(1e-12);
        let quads = channels.div_ceil(4);
        let mut values = vec![[0.0; 4]; variance.len() * quads];
        let texels = frames.iter().flat_map(|f| f.0.chunks(channels));
        for (texel, quads) in texels.zip(values.chunks_mut(quads)) {
            quads.as_flattened_mut()[..channels].copy_from_slice(texel);
        }
        let sharpness = variance.iter().map(|v| 1.0 / (v + floor).sqrt()).collect();
        Field { size: size.map(|s| s as i32), quads, values, sharpness }
    }

    /// Index of a texel; `None` outside.
    #[inline(always)]
    pub fn index(&self, [x, y, t]: Place) -> Option<usize> {
        let [w, h, frames] = self.size;
        let inside = (0..w).contains(&x) & (0..h).contains(&y) & (0..frames).contains(&t);
        inside.then(|| ((t * h + y) * w + x) as usize)
    }

    /// The inverse of [`Field::index`].
    #[inline]
    pub fn place(&self, index: usize) -> Place {
        let ([w, h, _], i) = (self.size.map(|s| s as u32), index as u32);
        [i % w, i / w % h, i / (w * h)].map(|v| v as i32)
    }

    /// Half the squared difference of two texels in relation to what varies around them.
    #[inline(always)]
    pub fn difference(&self, a: usize, b: usize) -> f32 {
        let texel = |i: usize| &self.values[i * self.quads..(i + 1) * self.quads];
        square(texel(a), texel(b)) * self.sharpness[a] * self.sharpness[b]
    }
}

/// How often each part of the exemplar is used.
pub(super) struct Usage {
    /// The cell of each texel.
    cells: Vec<u16>,
    counts: Vec<u32>,
    /// One over the even share of a cell.
    scale: f32,
}

impl Usage {
    /// Counts the sources, indices of texels.
    pub fn new(size: [u32; 3], sources: &[usize]) -> Self {
        let [w, h, frames] = size;
        let side = [0, 1, 2].map(|i| size[i].div_ceil(CELLS[i]));
        let cell = |i: u32| {
            let [x, y, t] = [i % w / side[0], i / w % h / side[1], i / (w * h) / side[2]];
            ((t * CELLS[1] + y) * CELLS[0] + x) as u16
        };
        let cells = (0..w * h * frames).map(cell).collect();
        let share = sources.len() as f32 * side.iter().product::<u32>() as f32 / (w * h * frames) as f32;
        let counts = vec![0; CELLS.iter().product::<u32>() as usize];
        let mut usage = Usage { cells, counts, scale: 1.0 / share.max(LEAST_SHARE) };
        for s in sources {
            usage.counts[usize::from(usage.cells[*s])] += 1;
        }
        usage
    }

    /// One source less at `from`, one more at `to`.
    pub fn moved(&mut self, from: usize, to: usize) {
        self.counts[usize::from(self.cells[from])] -= 1;
        self.counts[usize::from(self.cells[to])] += 1;
    }

    /// One for a texel of a part used no more than evenly, else how many times more.
    #[inline]
    pub fn factor(&self, texel: usize) -> f32 {
        (self.counts[usize::from(self.cells[texel])] as f32 * self.scale).max(1.0)
    }
}

/// Half the squared distance of two samples.
#[inline(always)]
fn square(a: &[[f32; 4]], b: &[[f32; 4]]) -> f32 {
    let mut sums = [0.0; 4];
    for (a, b) in a.iter().zip(b) {
        for c in 0..4 {
            sums[c] += (a[c] - b[c]) * (a[c] - b[c]);
        }
    }
    0.5 * (sums[0] + sums[1] + sums[2] + sums[3])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synth::testing::noise;

    #[test]
    fn each_frame_is_blurred_and_measured_by_itself() {
        // Frames of 4 x 3: the first is flat, the second noise, the third three times as strong.
        let strip = Texture::from_fn(4, 9, 5, |x, y, out| {
            let v = noise(4, 3).get(x, y % 3)[0];
            out.fill([0.5, v, 3.0 * v][(y / 3) as usize]);
        });
        let field = Field::new(&strip, [4, 3, 3], 1, 1);
        let at = |t| field.index([1, 1, t]).unwrap();
        assert!((0..12).all(|i| field.values[2 * i] == [0.5; 4] && field.values[2 * i + 1] == [0.5, 0.0, 0.0, 0.0]));
        assert!(field.sharpness[at(0)] > field.sharpness[at(1)] && field.sharpness[at(1)] > field.sharpness[at(2)]);
        assert_eq!(field.difference(at(1), at(1)), 0.0);
        assert!(field.difference(at(1), at(2)) > 0.0);
        assert!((0..36).all(|i| field.index(field.place(i)) == Some(i)));
        assert_eq!((field.index([4, 0, 0]), field.index([0, 0, 3]), field.index([0, -1, 1])), (None, None, None));
    }

    #[test]
    fn use_beyond_the_even_share_costs() {
        let texel = |x: usize, y: usize, t: usize| (t * 16 + y) * 16 + x;
        let sources: Vec<usize> = (0..64).map(|i| texel(i % 2, i / 2 % 2, i / 4 % 2)).collect();
        let mut usage = Usage::new([16, 16, 8], &sources);
        // Cells of 2 x 2 texels in 2 frames: the even share is below eight.
        assert_eq!(
            (usage.factor(texel(0, 1, 1)), usage.factor(texel(2, 0, 0)), usage.factor(texel(0, 0, 2))),
            (8.0, 1.0, 1.0)
        );
        (0..32).for_each(|_| usage.moved(texel(1, 1, 0), texel(15, 15, 7)));
        assert_eq!((usage.factor(0), usage.factor(texel(14, 14, 6))), (4.0, 4.0));
    }
}
