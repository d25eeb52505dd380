//! River pebbles: rounded stones of many colours, packed, with wet earth between.

use kiln::numerics::rng::Key;

use crate::material::{Extra, Material, Point};
use crate::noise::{cell, fractal, mix, mix3, rgb, shade, step};

const STONES: [u32; 7] = [0x8d8a83, 0xb3a894, 0x6f6a66, 0xa08468, 0xc9c2b4, 0x7b7f85, 0x93705a];

pub fn pebbles() -> Material {
    let key = Key::new(11).with_str("pebbles");
    Material::new(256, 256, 14.0, Extra::default(), |x, y| {
        // Two sizes of stone: small ones lie where the large ones leave room.
        let large = stone(key.with(1), x, y, 27.0);
        let small = stone(key.with(2), x, y, 11.0);
        let earth = earth(key, x, y);
        let mut best = earth;
        if small.height * 0.62 > best.height {
            best = Point { height: small.height * 0.62, ..small };
        }
        if large.height > best.height {
            best = large;
        }
        best
    })
}

fn stone(key: Key, x: f64, y: f64, size: f64) -> Point {
    // Warped a little, so that no outline is a straight line.
    let w = 0.10;
    let (u, v) = (x / size, y / size);
    let u2 = u + w * fractal(key.with(7), u * 1.7, v * 1.7, 3);
    let v2 = v + w * fractal(key.with(8), u * 1.7, v * 1.7, 3);
    let c = cell(key, u2, v2, 0.85);
    let gap = 0.05 + 0.10 * c.key.unit(2);
    let inside = ((c.border - gap) / (0.40 - 0.12 * c.key.unit(3))).clamp(0.0, 1.0);
    let dome = (1.0 - (1.0 - inside) * (1.0 - inside)).sqrt();
    let sunk = 0.55 + 0.45 * c.key.unit(4);
    let missing = if c.border < gap || (size < 20.0 && c.key.unit(5) < 0.25) { 0.0 } else { 1.0 };
    let base = rgb(STONES[c.key.below(6, STONES.len() as u32) as usize]);
    let grain = fractal(c.key, x / 3.0, y / 3.0, 3);
    let vein = (fractal(c.key.with(3), x / 14.0, y / 14.0, 2) * 5.0).abs();
    let veined = if c.key.unit(7) < 0.35 { step(0.35, 0.0, vein) } else { 0.0 };
    let fleck = step(0.55, 0.75, fractal(c.key.with(5), x / 1.7, y / 1.7, 2));
    let light = (0.86 + 0.28 * c.key.unit(8)) * (1.0 + 0.16 * grain) * mix(0.55, 1.05, dome);
    let color = mix3(shade(base, light), rgb(0xd8d2c6), 0.5 * veined);
    let color = mix3(color, rgb(0x3c3a38), 0.5 * fleck * c.key.unit(9));
    Point {
        color,
        height: missing * (0.22 + 0.72 * dome * sunk + 0.015 * grain),
        roughness: (0.42 + 0.25 * c.key.unit(10) + 0.08 * grain).clamp(0.1, 1.0),
        ..Point::default()
    }
}

fn earth(key: Key, x: f64, y: f64) -> Point {
    let n = fractal(key.with(20), x / 9.0, y / 9.0, 4);
    let fine = fractal(key.with(21), x / 2.2, y / 2.2, 2);
    let moss = step(0.1, 0.45, fractal(key.with(22), x / 30.0, y / 30.0, 3));
    let color = mix3(shade(rgb(0x3b2f25), 1.0 + 0.35 * fine), shade(rgb(0x47532a), 1.0 + 0.5 * fine), moss * 0.8);
    Point { color, height: 0.14 + 0.10 * n + 0.05 * fine, roughness: 0.93, ..Point::default() }
}
