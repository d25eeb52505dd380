//! Bark: long plates between deep upright fissures, with lichen.

use kiln::numerics::rng::Key;

use crate::material::{Extra, Material, Point};
use crate::noise::{cell, fractal, mix, mix3, rgb, ridged, shade, step};

pub fn bark() -> Material {
    let key = Key::new(5).with_str("bark");
    Material::new(256, 256, 18.0, Extra::default(), |x, y| {
        let bend =
            11.0 * fractal(key.with(1), x / 60.0, y / 95.0, 3) + 2.5 * fractal(key.with(2), x / 9.0, y / 17.0, 3);
        let u = (x + bend) / 23.0;
        let v = (y + 6.0 * fractal(key.with(3), x / 20.0, y / 20.0, 3)) / 78.0;
        let plate = cell(key.with(4), u, v, 0.95);
        let edge = plate.border + 0.05 * fractal(key.with(5), x / 6.0, y / 12.0, 3);
        let deep = step(0.02, 0.26, edge);
        let fibre = ridged(key.with(6), (x + bend) / 5.5, y / 42.0, 4);
        let flake = cell(key.with(7), (x + bend) / 8.0, y / 15.0, 1.0);
        let crack = step(0.0, 0.10, flake.border + 0.05 * fractal(key.with(8), x / 3.0, y / 5.0, 2));
        let fine = fractal(key.with(9), x / 2.0, y / 3.4, 3);
        let body = 0.62 + 0.16 * plate.key.unit(3) + 0.20 * (fibre - 0.6) + 0.06 * (flake.key.unit(2) - 0.5);
        let height = deep * (body - 0.10 * (1.0 - crack)) + 0.03 * fine * deep + 0.06 * (1.0 - deep) * fibre;
        let tone = mix3(rgb(0x6d5a49), rgb(0x8c7a68), plate.key.unit(4));
        let tone = mix3(tone, rgb(0x5a4234), 0.5 * flake.key.unit(5));
        let lit = mix(0.34, 1.0, deep) * mix(0.72, 1.0, crack) * (0.80 + 0.34 * (fibre - 0.3)) * (1.0 + 0.18 * fine);
        let lichen = step(0.18, 0.5, fractal(key.with(10), x / 34.0, y / 40.0, 4) + 0.25 * fine) * deep * crack;
        let color = mix3(shade(tone, lit), shade(rgb(0x9aa585), 0.9 + 0.25 * fine), 0.62 * lichen);
        Point { color, height, roughness: (0.86 + 0.1 * fine).clamp(0.0, 1.0), ..Point::default() }
    })
}
