//! Which of several samples is wanted where, if nobody says: patches of each, with round outlines, in equal shares.
//!
//! Left to itself a walk hardly ever jumps from one sample to an unlike one: it shows one of them only, or few patches whose
//! borders are straight, since between unlike textures every seam costs the same.
//! Source: for each sample smooth noise by a lattice of random values (Perlin: An Image Synthesizer, 1985, of values in place
//! of gradients), in two octaves; a place belongs to the sample whose noise is greatest there.
//! In: sizes, a seed. Out: colours of a guide, one for each sample. Unaware of: what the samples show.

use super::guide::GuideMap;
use crate::numerics::rng::Key;

/// Patches are about so many times as wide as the mean side of the samples.
const PATCH: f32 = 0.5;

/// Least distance of random values, in pixels.
const LEAST: f32 = 16.0;

/// Share of the second octave, of half the distance.
const DETAIL: f32 = 0.4;

/// Pixels along the sides of the squares that are of one sample, as a power of two: what is between them is for the
/// correction to choose.
const SQUARE: u32 = 2;

/// The colour that stands for a sample; of 64, any two differ by a third of the range in some channel.
pub fn colour(sample: usize) -> [u8; 3] {
    [0, 2, 4].map(|shift| (sample >> shift & 3) as u8 * 85)
}

/// The guide of a canvas that mixes `samples` samples with a mean side of `side` texels; it repeats if `tileable`.
pub fn mixture(size: [u32; 2], tileable: bool, samples: usize, side: f32, seed: u64) -> GuideMap {
    let key = Key::new(seed).with_str("mixture");
    let spacing = (side * PATCH).max(LEAST);
    let octave = |spacing: f32, share: f32, number: u64| Lattice {
        counts: size.map(|s| ((s as f32 / spacing + 0.5) as u32).max(1)),
        size,
        tileable,
        share,
        number,
    };
    let octaves = [octave(spacing, 1.0, 0), octave(spacing / 2.0, DETAIL, 1)];
    let noise = |sample: usize, at: [u32; 2]| -> f32 {
        octaves.iter().map(|o| o.share * o.value(key.with(sample as u64).with(o.number), at)).sum()
    };
    GuideMap::coarse(size, SQUARE, |x, y| {
        let greatest = (0..samples).max_by(|a, b| noise(*a, [x, y]).total_cmp(&noise(*b, [x, y])).then(b.cmp(a)));
        colour(greatest.unwrap_or(0))
    })
}

/// Random values at places of a canvas.
struct Lattice {
    /// Values along a row and a column, before they repeat or beyond which there is one more.
    counts: [u32; 2],
    size: [u32; 2],
    tileable: bool,
    share: f32,
    number: u64,
}

impl Lattice {
    /// The value at a pixel, in between by smooth steps.
    fn value(&self, key: Key, at: [u32; 2]) -> f32 {
        let place = |a: usize| {
            let p = at[a] as f32 * self.counts[a] as f32 / self.size[a] as f32;
            let t = p - p.floor();
            (p as u32, t * t * (3.0 - 2.0 * t))
        };
        let ((x, u), (y, v)) = (place(0), place(1));
        let corner = |dx: u32, dy: u32| {
            let [i, j] = [(x + dx, 0), (y + dy, 1)].map(|(i, a)| if self.tileable { i % self.counts[a] } else { i });
            key.with(u64::from(j)).unit(u64::from(i)) as f32
        };
        let row = |dy: u32| corner(0, dy) + (corner(1, dy) - corner(0, dy)) * u;
        row(0) + (row(1) - row(0)) * v
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn each_sample_has_its_share() {
        for samples in [2, 3, 5] {
            let guide = mixture([1200, 900], false, samples, 100.0, 7);
            assert_eq!(guide.size(), [1200, 900]);
            let mut counts = vec![0usize; samples];
            for c in guide.colours() {
                counts[(0..samples).find(|s| colour(*s) == *c).unwrap()] += 1;
            }
            let all = guide.colours().len();
            assert!(counts.iter().all(|c| c * samples > all / 2 && c * samples < all * 2), "{counts:?} of {all}");
        }
        let colours: BTreeSet<[u8; 3]> = (0..64).map(colour).collect();
        assert_eq!(colours.len(), 64);
    }

    #[test]
    fn a_canvas_that_wraps_has_no_border() {
        let lattice = |tileable| Lattice { counts: [3, 2], size: [90, 60], tileable, share: 1.0, number: 0 };
        let key = Key::new(3);
        for y in 0..60 {
            let step = |t| (lattice(t).value(key, [89, y]) - lattice(t).value(key, [0, y])).abs();
            assert!(step(true) < 0.01, "{y}: {}", step(true));
        }
        assert!(
            (0..60).any(|y| { (lattice(false).value(key, [89, y]) - lattice(false).value(key, [0, y])).abs() > 0.1 })
        );
    }
}
