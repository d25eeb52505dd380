//! A painted steel plate that rusts: paint, bare metal at the chips, rust in patches and runs.

use kiln::numerics::rng::Key;

use crate::material::{Extra, Material, Point};
use crate::noise::{cell, fractal, mix, mix3, rgb, shade, step};

pub fn rusted_plate() -> Material {
    let key = Key::new(31).with_str("rust");
    let extra = Extra { metallic: true, packed: true, ..Extra::default() };
    Material::new(256, 256, 4.0, extra, |x, y| {
        let field = wear(key, x, y);
        let crumbs = fractal(key.with(3), x / 5.0, y / 5.0, 3);
        let runs = fractal(key.with(4), x / 4.5, y / 60.0, 3);
        let rust = step(-0.02, 0.05, field + 0.13 * crumbs - 0.08);
        let bare = step(-0.075, -0.045, field + 0.13 * crumbs - 0.08) * (1.0 - rust);
        let stain = step(-0.40, 0.05, field + 0.22 * runs) * (1.0 - rust);
        let fine = fractal(key.with(5), x / 1.8, y / 1.8, 2);
        let scratch = scratches(key.with(6), x, y) * (1.0 - rust);
        let pits = cell(key.with(7), x / 5.0, y / 5.0, 1.0);
        let grain = 0.5 + 0.5 * fractal(key.with(8), x / 7.0, y / 7.0, 4);

        let paint = shade(rgb(0x2f6f73), 1.0 + 0.05 * fine + 0.10 * fractal(key.with(9), x / 70.0, y / 70.0, 2));
        let paint = mix3(paint, rgb(0x6b4a30), 0.55 * stain * (0.35 + 0.65 * step(-0.2, 0.5, runs)));
        let steel = shade(rgb(0x9a9890), 1.0 + 0.10 * fine);
        let old = mix3(rgb(0x4a2314), rgb(0xa6521f), grain);
        let old = mix3(old, rgb(0xc9803a), 0.6 * step(0.25, 0.6, crumbs + 0.3 * fine));
        let old = shade(old, 1.0 + 0.22 * fine - 0.30 * step(0.20, 0.0, pits.border) * grain);
        let metal = (bare + 0.85 * scratch).min(1.0);
        let color = mix3(mix3(paint, steel, metal), old, rust);
        let blister = step(-0.20, -0.04, field + 0.13 * crumbs - 0.08) * (1.0 - rust) * (1.0 - bare);
        let raised = 0.62 + 0.10 * blister - 0.22 * bare - 0.12 * scratch;
        let eaten = 0.34 + 0.34 * grain + 0.10 * crumbs + 0.05 * fine - 0.12 * step(0.25, 0.0, pits.border);
        Point {
            color,
            height: mix(raised, eaten, rust).clamp(0.0, 1.0),
            roughness: mix(mix(0.34 + 0.2 * stain + 0.03 * fine, 0.30, metal), 0.93, rust).clamp(0.05, 1.0),
            metallic: (metal * (1.0 - rust)).clamp(0.0, 1.0),
            ..Point::default()
        }
    })
}

/// How far the rust has come, about -0.5 to 0.5.
fn wear(key: Key, x: f64, y: f64) -> f64 {
    let warp = 6.0 * fractal(key.with(1), x / 14.0, y / 14.0, 3);
    fractal(key.with(2), (x + warp) / 46.0, (y - warp) / 46.0, 5)
}

/// How worn the plate is at its texels, 0..1, row by row: a guide for it.
pub fn rusted_plate_wear() -> Vec<f64> {
    let key = Key::new(31).with_str("rust");
    let at = |i: usize| step(-0.25, 0.25, wear(key, (i % 256) as f64 + 0.5, (i / 256) as f64 + 0.5));
    (0..256 * 256).map(at).collect()
}

/// Thin straight scratches: 1 on a scratch.
fn scratches(key: Key, x: f64, y: f64) -> f64 {
    let mut most = 0.0f64;
    for i in 0..26 {
        let k = key.with(i);
        let (px, py) = (k.unit(0) * 256.0, k.unit(1) * 256.0);
        let (s, c) =
            kiln::numerics::det::sin_cos(0.5 + 0.9 * (k.unit(2) - 0.5) + if k.unit(5) < 0.3 { 1.6 } else { 0.0 });
        let (dx, dy) = (x - px, y - py);
        let (along, across) = (dx * c + dy * s, -dx * s + dy * c);
        let len = 10.0 + 34.0 * k.unit(3);
        let taper = step(len, len * 0.6, along.abs());
        most = most.max(
            taper * step(0.75, 0.25, (across + 0.8 * fractal(k, along / 12.0, 0.0, 2)).abs()) * (0.4 + 0.6 * k.unit(4)),
        );
    }
    most
}
