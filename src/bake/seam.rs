//! UV seams: edges of the surface that two charts share, and how much their two sides differ in a baked map.

use super::atlas::Atlas;
use super::border::{Border, borders};
use crate::mesh::Surface;
use crate::numerics::vec::Vec2;
use crate::texture::color::linear_to_srgb;
use crate::texture::{MapKind, Texture};

/// The two sides of a seam edge, ends in the same order.
#[derive(Clone, Debug)]
pub(crate) struct Seam {
    /// Corners of the surface.
    pub corners: [[u32; 2]; 2],
    /// The ends on the page in texels.
    pub px: [[Vec2; 2]; 2],
}

/// All seam edges, each once.
pub(crate) fn seams(atlas: &Atlas, borders: &[Border]) -> Vec<Seam> {
    let px = |c: [u32; 2]| c.map(|c| atlas.corner_px(c as usize));
    let pairs = borders.iter().filter_map(|b| Some((b.corners, b.partner?)));
    // Each pair is listed from both sides unless a third face joins in.
    let mut pairs: Vec<_> = pairs.map(|(a, b)| if a[0] < b[0] { (a, b) } else { (b, a) }).collect();
    pairs.sort_unstable();
    pairs.dedup();
    pairs.into_iter().map(|(a, b)| Seam { corners: [a, b], px: [px(a), px(b)] }).collect()
}

/// One bilinear look-up: four texels and their shares.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Tap {
    pub texels: [u32; 4],
    pub weights: [f32; 4],
}

/// Bilinear look-up at a position in texels; texels numbered row by row.
pub(crate) fn tap(p: Vec2, width: u32, height: u32) -> Tap {
    let axis = |v: f64, n: u32| {
        let v = (v - 0.5).clamp(0.0, f64::from(n - 1));
        let i = (v as u32).min(n - 1);
        (i, (i + 1).min(n - 1), (v - f64::from(i)) as f32)
    };
    let ((x0, x1, fx), (y0, y1, fy)) = (axis(p.x, width), axis(p.y, height));
    let at = |x: u32, y: u32| y * width + x;
    Tap {
        texels: [at(x0, y0), at(x1, y0), at(x0, y1), at(x1, y1)],
        weights: [(1.0 - fx) * (1.0 - fy), fx * (1.0 - fy), (1.0 - fx) * fy, fx * fy],
    }
}

/// How much the two sides of UV seams differ: 8-bit steps, the mean over points and channels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SeamError {
    /// Seam edges measured.
    pub edges: usize,
    /// Mean difference.
    pub mean: f64,
    /// 95th percentile of the points' differences.
    pub p95: f64,
}

/// Measures a baked map: 8 points along every seam edge, filtered bilinearly on mip level `mip` of the 8-bit map (sRGB
/// where the kind is), levels made by a 2x2 box in 8-bit values; as an engine that makes its own mips would show it. Not for normal maps: their two sides
/// differ by the angle between their bases.
pub fn seam_error(surface: &Surface, atlas: &Atlas, kind: MapKind, map: &Texture, mip: u32) -> SeamError {
    let stored = |v: f32| if kind.is_srgb() { linear_to_srgb(v) } else { v.clamp(0.0, 1.0) };
    let c = map.channels() as usize;
    let bytes = map.data().iter().map(|v| (stored(*v) * 255.0).round()).collect();
    let mut level = Texture::from_data(map.width(), map.height(), map.channels(), bytes);
    for _ in 0..mip {
        level = super::mip::box_half(&level);
    }
    let seams = seams(atlas, &borders(surface, atlas));
    let shrink =
        [f64::from(level.width()) / f64::from(map.width()), f64::from(level.height()) / f64::from(map.height())];
    let mut found = Vec::new();
    for seam in &seams {
        for i in 0..8 {
            let t = (f64::from(i) + 0.5) / 8.0;
            let [a, b] = seam.px.map(|[a, b]| {
                let p = a * (1.0 - t) + b * t;
                let p = Vec2 { x: p.x * shrink[0], y: p.y * shrink[1] };
                let tap = tap(p, level.width(), level.height());
                let value = |ch: usize| -> f32 {
                    (0..4).map(|k| tap.weights[k] * level.data()[tap.texels[k] as usize * c + ch]).sum()
                };
                (0..c).map(value).collect::<Vec<f32>>()
            });
            let sum: f32 = a.iter().zip(&b).map(|(a, b)| (a - b).abs()).sum();
            found.push(f64::from(sum) / c as f64);
        }
    }
    found.sort_unstable_by(f64::total_cmp);
    let mean = found.iter().sum::<f64>() / found.len().max(1) as f64;
    let p95 = found.get((found.len() * 95 / 100).min(found.len().saturating_sub(1))).copied().unwrap_or(0.0);
    SeamError { edges: seams.len(), mean, p95 }
}
