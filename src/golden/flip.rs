//! How different two pictures look when one follows the other on a screen: LDR-FLIP.
//!
//! Source: Andersson et al., "FLIP: A Difference Evaluator for Alternating Images" (2020), sections 4 and 5, with the
//! viewer of its section 6: 0.7 m before a screen 0.7 m wide of 3840 texels. In: two pictures of one size, as they are
//! shown (alpha over mid-grey, floats clamped to 0..1). Out: the mean over all texels of a value from 0, no difference
//! to be seen, to 1. Borders are continued by their outermost texels.
//! The two-dimensional filters of the paper are sums of products of one-dimensional ones and applied as such.
//! Unaware of: which picture is golden.

use super::compare::shown_fine;
use crate::io::Pixels;
use crate::numerics::{det, par};
use crate::texture::color::srgb_to_linear;
use std::f64::consts::PI;
use std::ops::Range;

/// Texels per degree of the viewer's field of view: 0.7 * 3840 / 0.7 * pi / 180.
const TEXELS_PER_DEGREE: f64 = 67.020_643_276_582_25;
/// Rows per parallel task.
const BAND: usize = 32;

/// Linear sRGB to XYZ, rows; the sums of the rows are the reference white.
const TO_XYZ: [[f64; 3]; 3] = [
    [10_135_552.0 / 24_577_794.0, 8_788_810.0 / 24_577_794.0, 4_435_075.0 / 24_577_794.0],
    [2_613_072.0 / 12_288_897.0, 8_788_810.0 / 12_288_897.0, 887_015.0 / 12_288_897.0],
    [1_425_312.0 / 73_733_382.0, 8_788_810.0 / 73_733_382.0, 70_074_185.0 / 73_733_382.0],
];

/// The mean difference of two pictures to the eye, 0..=1; 1 for pictures of different sizes.
pub fn flip(expected: &Pixels, actual: &Pixels) -> f64 {
    if (expected.width, expected.height) != (actual.width, actual.height) {
        return 1.0;
    }
    let height = expected.height as usize;
    let eye = Eye::new();
    // One sum per band, added in order: the same for any number of threads.
    let bands = par::map_chunks(height, BAND, |rows| {
        let [a, b] = [expected, actual].map(|picture| eye.look(picture, rows.clone()));
        a.iter().zip(&b).map(|(a, b)| eye.difference(a, b)).sum::<f64>()
    });
    bands.into_iter().sum::<f64>() / (f64::from(expected.width) * height as f64)
}

/// What the eye gets of one texel.
struct Percept {
    /// Colour after the eye's blur: L*, and a* and b* by Hunt.
    lab: [f64; 3],
    /// Strength of edges and of points.
    edge: f64,
    point: f64,
}

/// The filters, and the greatest difference of colours.
struct Eye {
    white: [f64; 3],
    from_xyz: [[f64; 3]; 3],
    /// Contrast sensitivity: light, red-green, and the two parts of blue-yellow with the share of the first.
    blur: [Vec<f64>; 4],
    share: f64,
    /// Gauss, its first and its second derivative.
    features: [Vec<f64>; 3],
    greatest: f64,
}

impl Eye {
    fn new() -> Self {
        let white = TO_XYZ.map(|row| row.iter().sum());
        // The widest filter says how far all reach.
        let reach = (3.0 * (0.04 / (2.0 * PI * PI)).sqrt() * TEXELS_PER_DEGREE).ceil() as i32;
        let gauss = |b: f64| -> Vec<f64> {
            let at = |x: i32| det::exp(-PI * PI * square(f64::from(x) / TEXELS_PER_DEGREE) / b);
            (-reach..=reach).map(at).collect()
        };
        let weight = |a: f64, b: f64| a * (PI / b).sqrt() * square(gauss(b).iter().sum());
        let (first, second) = (weight(34.1, 0.04), weight(13.5, 0.025));
        let mut eye = Eye {
            white,
            from_xyz: inverse(TO_XYZ),
            blur: [0.0047, 0.0053, 0.04, 0.025].map(|b| normalised(gauss(b))),
            share: first / (first + second),
            features: features(),
            greatest: 0.0,
        };
        eye.greatest = det::pow(hyab(eye.lab([0.0, 1.0, 0.0]), eye.lab([0.0, 0.0, 1.0])), 0.7);
        eye
    }

    /// Light, red-green and blue-yellow of a linear colour (YCxCz; here light is 0..1).
    fn opponent(&self, rgb: [f64; 3]) -> [f64; 3] {
        let xyz = product(&TO_XYZ, rgb);
        let [x, y, z] = [0, 1, 2].map(|i| xyz[i] / self.white[i]);
        [y, 500.0 * (x - y), 200.0 * (y - z)]
    }

    /// The other way round, what the screen cannot show clamped.
    fn screen(&self, [y, cx, cz]: [f64; 3]) -> [f64; 3] {
        let xyz = [y + cx / 500.0, y, y - cz / 200.0];
        product(&self.from_xyz, [0, 1, 2].map(|i| xyz[i] * self.white[i])).map(|v| v.clamp(0.0, 1.0))
    }

    /// L*, and a* and b* that fade with the light (section 4.2).
    fn lab(&self, rgb: [f64; 3]) -> [f64; 3] {
        let xyz = product(&TO_XYZ, rgb);
        let [x, y, z] = [0, 1, 2].map(|i| {
            let t = xyz[i] / self.white[i];
            const STEP: f64 = 6.0 / 29.0;
            if t > STEP * STEP * STEP { det::pow(t, 1.0 / 3.0) } else { t / (3.0 * STEP * STEP) + 4.0 / 29.0 }
        });
        let light = 116.0 * y - 16.0;
        [light, 0.01 * light * 500.0 * (x - y), 0.01 * light * 200.0 * (y - z)]
    }

    /// The texels of some rows as the eye gets them.
    fn look(&self, picture: &Pixels, rows: Range<usize>) -> Vec<Percept> {
        let (width, height) = (picture.width as usize, picture.height as usize);
        let reach = self.blur[0].len() / 2;
        let halo = rows.start.saturating_sub(reach)..(rows.end + reach).min(height);
        let mut planes = [(); 3].map(|()| Vec::with_capacity(halo.len() * width));
        for y in halo.clone() {
            for x in 0..width {
                let rgb = shown_fine(picture, x as u32, y as u32).map(|v| f64::from(srgb_to_linear(v)));
                for (plane, v) in planes.iter_mut().zip(self.opponent(rgb)) {
                    plane.push(v);
                }
            }
        }
        let band = Band { width, height, halo, rows };
        let [light, cx, cz] = &planes;
        let blurred = |plane: &[f64], kernel: &[f64]| band.down(&band.across(plane, kernel), kernel);
        let [a, rg] = [blurred(light, &self.blur[0]), blurred(cx, &self.blur[1])];
        let by = [blurred(cz, &self.blur[2]), blurred(cz, &self.blur[3])];
        let [gauss, first, second] = &self.features;
        let smooth = band.across(light, gauss);
        let [edge_x, point_x] = [first, second].map(|k| band.down(&band.across(light, k), gauss));
        let [edge_y, point_y] = [first, second].map(|k| band.down(&smooth, k));
        let texel = |i: usize| {
            let yellow = self.share * by[0][i] + (1.0 - self.share) * by[1][i];
            Percept {
                lab: self.lab(self.screen([a[i], rg[i], yellow])),
                edge: (square(edge_x[i]) + square(edge_y[i])).sqrt(),
                point: (square(point_x[i]) + square(point_y[i])).sqrt(),
            }
        };
        (0..a.len()).map(texel).collect()
    }

    /// Of two texels: the difference of colours, raised by that of features (sections 4.3 and 5).
    fn difference(&self, a: &Percept, b: &Percept) -> f64 {
        // Up to 0.4 of the greatest difference makes 0.95 of the range.
        let (knee, most) = (0.4 * self.greatest, 0.95);
        let d = det::pow(hyab(a.lab, b.lab), 0.7);
        let color = if d < knee { d * most / knee } else { most + (d - knee) / (self.greatest - knee) * (1.0 - most) };
        let feature = (a.edge - b.edge).abs().max((a.point - b.point).abs());
        let feature = (feature * std::f64::consts::FRAC_1_SQRT_2).sqrt();
        if color <= 0.0 { 0.0 } else { det::pow(color.min(1.0), 1.0 - feature.min(1.0)) }
    }
}

/// Some rows of a picture, and the rows around them that filters see.
struct Band {
    width: usize,
    height: usize,
    halo: Range<usize>,
    rows: Range<usize>,
}

impl Band {
    /// Filters every row of the halo.
    fn across(&self, plane: &[f64], kernel: &[f64]) -> Vec<f64> {
        let reach = kernel.len() / 2;
        let mut out = Vec::with_capacity(plane.len());
        let mut wide = vec![0.0; self.width + 2 * reach];
        for row in plane.chunks_exact(self.width) {
            wide[..reach].fill(row[0]);
            wide[reach..reach + self.width].copy_from_slice(row);
            wide[reach + self.width..].fill(row[self.width - 1]);
            out.extend(wide.windows(kernel.len()).map(|w| w.iter().zip(kernel).map(|(v, k)| v * k).sum::<f64>()));
        }
        out
    }

    /// Filters the columns of the halo, for the rows that are wanted.
    fn down(&self, plane: &[f64], kernel: &[f64]) -> Vec<f64> {
        let reach = kernel.len() / 2;
        let mut out = vec![0.0; self.rows.len() * self.width];
        for (row, y) in out.chunks_exact_mut(self.width).zip(self.rows.clone()) {
            for (i, k) in kernel.iter().enumerate() {
                let from = ((y + i).saturating_sub(reach).min(self.height - 1) - self.halo.start) * self.width;
                row.iter_mut().zip(&plane[from..from + self.width]).for_each(|(out, v)| *out += v * k);
            }
        }
        out
    }
}

/// Detectors of edges and points 0.082 degrees wide, each side of which sums to one.
fn features() -> [Vec<f64>; 3] {
    let sigma = 0.5 * 0.082 * TEXELS_PER_DEGREE;
    let reach = (3.0 * sigma).ceil() as i32;
    let gauss = |x: i32| det::exp(-square(f64::from(x) / sigma) / 2.0);
    let both_sides = |values: Vec<f64>| -> Vec<f64> {
        let up: f64 = values.iter().filter(|v| **v > 0.0).sum();
        let down: f64 = -values.iter().filter(|v| **v < 0.0).sum::<f64>();
        values.into_iter().map(|v| if v > 0.0 { v / up } else { v / down }).collect()
    };
    let all = || -reach..=reach;
    [
        normalised(all().map(gauss).collect()),
        both_sides(all().map(|x| -f64::from(x) * gauss(x)).collect()),
        both_sides(all().map(|x| (square(f64::from(x) / sigma) - 1.0) * gauss(x)).collect()),
    ]
}

fn square(v: f64) -> f64 {
    v * v
}

fn normalised(kernel: Vec<f64>) -> Vec<f64> {
    let sum: f64 = kernel.iter().sum();
    kernel.into_iter().map(|v| v / sum).collect()
}

/// Difference of light plus distance of colours.
fn hyab(a: [f64; 3], b: [f64; 3]) -> f64 {
    (a[0] - b[0]).abs() + (square(a[1] - b[1]) + square(a[2] - b[2])).sqrt()
}

fn product(m: &[[f64; 3]; 3], v: [f64; 3]) -> [f64; 3] {
    m.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
}

/// By cofactors.
fn inverse(m: [[f64; 3]; 3]) -> [[f64; 3]; 3] {
    let cofactor = |r: usize, c: usize| {
        let (a, b, d, e) = ((r + 1) % 3, (r + 2) % 3, (c + 1) % 3, (c + 2) % 3);
        m[a][d] * m[b][e] - m[a][e] * m[b][d]
    };
    let determinant: f64 = (0..3).map(|c| m[0][c] * cofactor(0, c)).sum();
    [0, 1, 2].map(|r| [0, 1, 2].map(|c| cofactor(c, r) / determinant))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::Samples;
    use crate::numerics::rng::Key;

    fn filled(width: u32, height: u32, color: impl Fn(u32, u32) -> [u8; 3]) -> Pixels {
        let texels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        let samples = texels.flat_map(|(x, y)| color(x, y)).collect();
        Pixels { width, height, channels: 3, samples: Samples::U8(samples) }
    }

    fn noise(seed: u64) -> Pixels {
        filled(40, 70, |x, y| [0, 1, 2].map(|i| Key::new(seed).bits(u64::from(y * 40 + x) * 3 + i) as u8))
    }

    #[test]
    fn the_same_picture_differs_by_nothing_and_order_does_not_matter() {
        let (a, b) = (noise(1), noise(2));
        assert_eq!(flip(&a, &a), 0.0);
        let d = flip(&a, &b);
        assert!(d > 0.1 && d < 1.0, "{d}");
        assert_eq!(flip(&b, &a), d);
    }

    #[test]
    fn flat_pictures_differ_as_the_formula_says() {
        let flat = |color| filled(30, 30, |_, _| color);
        // The paper's greatest difference.
        assert!((flip(&flat([0, 255, 0]), &flat([0, 0, 255])) - 1.0).abs() < 1e-9);
        // Black and white are 100 apart: 0.95 + 0.05 (100^0.7 - 0.4 m) / (0.6 m), m = 41.2760 as published with the code.
        let expected = 0.95 + 0.05 * (det::pow(100.0, 0.7) - 0.4 * 41.276) / (0.6 * 41.276);
        let found = flip(&flat([0; 3]), &flat([255; 3]));
        assert!((found - expected).abs() < 2e-3, "{found} {expected}");
    }

    // The mean that the authors' evaluator (flip-evaluator 1.x, LDR, the same viewer) gives for these two pictures.
    #[test]
    fn two_pictures_differ_as_the_authors_say() {
        let base = |x: u32, y: u32| [x * 4, y * 5, (x + y) * 2].map(|v| (v % 256) as u8);
        let a = filled(64, 48, base);
        let b = filled(64, 48, |x, y| match base(x, y) {
            c if (10..20).contains(&y) && (10..30).contains(&x) => c.map(|v| 255 - v),
            [r, g, b] if y >= 30 && x >= 40 => [r / 2, g, b],
            c => c,
        });
        let found = flip(&a, &b);
        assert!((found - 0.197_043).abs() < 2e-5, "{found}");
    }

    #[test]
    fn an_edge_counts_more_than_a_tint_and_more_of_it_counts_more() {
        let grey = filled(64, 64, |_, _| [120; 3]);
        let step = |by: u8| filled(64, 64, move |x, _| [if x < 32 { 120 - by } else { 120 + by }; 3]);
        let tint = filled(64, 64, |_, _| [128; 3]);
        let [small, large] = [8, 16].map(|by| flip(&grey, &step(by)));
        assert!(flip(&grey, &tint) < small && small < large, "{small} {large}");
    }

    #[test]
    fn what_is_too_fine_to_be_seen_counts_less() {
        let grey = filled(64, 64, |_, _| [120; 3]);
        let checks = |side: u32| {
            filled(
                64,
                64,
                move |x, y| if (x / side + y / side).is_multiple_of(2) { [150, 120, 90] } else { [90, 120, 150] },
            )
        };
        let [fine, coarse] = [1, 16].map(|side| flip(&grey, &checks(side)));
        assert!(fine < 0.5 * coarse, "{fine} {coarse}");
    }

    #[test]
    fn a_single_texel_is_found_and_threads_do_not_matter() {
        let a = noise(3);
        let mut b = a.clone();
        let Samples::U8(samples) = &mut b.samples else { return };
        samples[3 * (35 * 40 + 20)] ^= 0x80;
        let d = par::install(1, || flip(&a, &b));
        assert!(d > 0.0 && d < 0.01, "{d}");
        assert_eq!(par::install(3, || flip(&a, &b)).to_bits(), d.to_bits());
    }

    #[test]
    fn other_sizes_differ_wholly() {
        assert_eq!(flip(&filled(4, 4, |_, _| [0; 3]), &filled(4, 5, |_, _| [0; 3])), 1.0);
        let one = filled(1, 1, |_, _| [9; 3]);
        assert_eq!(flip(&one, &one), 0.0, "smaller than every filter");
    }
}
