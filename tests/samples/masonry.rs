//! Laid things: bricks in a running bond, and overlapping scales. Both know which way is up.

use kiln::numerics::rng::Key;

use crate::material::{Extra, Material, Point};
use crate::noise::{cell, fractal, mix, mix3, rgb, shade, step};

const BRICKS: [u32; 5] = [0x9c4f38, 0x8a4230, 0xa9603f, 0x7a3a2d, 0xb06d4c];

pub fn bricks() -> Material {
    let key = Key::new(41).with_str("bricks");
    Material::new(256, 192, 9.0, Extra::default(), |x, y| {
        let (length, course) = (64.0, 24.0);
        let (wx, wy) =
            (1.4 * fractal(key.with(1), x / 22.0, y / 22.0, 3), 1.4 * fractal(key.with(2), x / 22.0, y / 22.0, 3));
        let row = ((y + wy) / course).floor();
        let shift = if row.rem_euclid(2.0) < 1.0 { 0.0 } else { 0.5 };
        let u = (x + wx) / length + shift;
        let brick = key.with(3).with(u.floor() as i64 as u64).with(row as i64 as u64);
        let ex = ((u - u.floor()) * length).min((1.0 - (u - u.floor())) * length);
        let fy = (y + wy) - row * course;
        let ey = fy.min(course - fy);
        let chip = 1.6 * fractal(key.with(4), x / 6.0, y / 6.0, 3);
        // Rounded corners: distance inside a box shrunk by the joint.
        let joint = 2.6;
        let (qx, qy) = ((4.0 - (ex - joint)).max(0.0), (4.0 - (ey - joint)).max(0.0));
        let inside = 4.0 - (qx * qx + qy * qy).sqrt() + chip;
        let body = step(-0.4, 2.2, inside);
        let grit = fractal(key.with(5), x / 2.0, y / 2.0, 3);
        let pores = step(0.16, 0.05, cell(key.with(6), x / 7.0, y / 7.0, 1.0).centre) * step(0.5, 0.9, brick.unit(3));
        let tone = rgb(BRICKS[brick.below(0, BRICKS.len() as u32) as usize]);
        let fired = fractal(brick.with(1), x / 26.0, y / 12.0, 3);
        let face = shade(
            tone,
            (0.92 + 0.22 * (brick.unit(1) - 0.5)) * (1.0 + 0.16 * grit + 0.20 * fired) * (1.0 - 0.45 * pores),
        );
        let face = mix3(face, rgb(0xc9bfae), 0.35 * step(0.25, 0.6, fractal(key.with(7), x / 30.0, y / 30.0, 4)));
        let mortar = shade(rgb(0xa79f90), 0.86 + 0.22 * grit);
        let height = mix(
            0.16 + 0.08 * grit,
            0.72 + 0.10 * (brick.unit(2) - 0.5) + 0.05 * grit + 0.05 * fired - 0.2 * pores,
            body,
        );
        Point {
            color: mix3(mortar, face, body),
            height: height.clamp(0.0, 1.0),
            roughness: (mix(0.96, 0.82, body) + 0.05 * grit).clamp(0.0, 1.0),
            ..Point::default()
        }
    })
}

pub fn scales() -> Material {
    let key = Key::new(42).with_str("scales");
    Material::new(256, 256, 11.0, Extra::default(), |x, y| {
        let (w, h) = (32.0, 21.0);
        // The scale on top is the one whose tip hangs lowest over this point: look at three rows from above.
        let mut found = Point { color: rgb(0x101812), height: 0.0, roughness: 0.7, ..Point::default() };
        for back in 0..3 {
            let row = (y / h).floor() - f64::from(back);
            let shift = if row.rem_euclid(2.0) < 1.0 { 0.0 } else { 0.5 };
            let col = (x / w + shift).floor();
            let k = key.with(row as i64 as u64).with(col as i64 as u64);
            let cx = (col - shift + 0.5) * w + 1.6 * (k.unit(0) - 0.5);
            let top = row * h + 2.0 * (k.unit(1) - 0.5);
            let (a, b) = ((x - cx) / (w * 0.54), (y - top) / (h * 2.05));
            // A pointed arch: straight above, drawn in to a tip below.
            let half = if b < 0.40 { 1.0 } else { (1.0 - ((b - 0.40) / 0.60) * ((b - 0.40) / 0.60)).max(0.0).sqrt() };
            let edge = half - a.abs() * (0.97 + 0.06 * fractal(k.with(1), x / 5.0, y / 5.0, 2));
            if edge <= 0.0 || !(0.0..1.0).contains(&b) {
                continue;
            }
            let rim = step(0.0, 0.14, edge);
            let keel = step(0.20, 0.0, a.abs()) * step(1.0, 0.5, b);
            let rings = fractal(k.with(2), a * 2.0, (b - 0.25 * a * a) * 13.0, 2);
            let ray = fractal(k.with(3), a * 9.0 / (0.35 + b), b * 1.5, 2);
            let lift = 0.20 + 0.62 * b;
            let dome = 0.14 * (1.0 - a * a);
            let height = lift * (0.55 + 0.45 * rim) + dome + 0.05 * keel + 0.018 * rings;
            if height <= found.height {
                continue;
            }
            let base = mix3(rgb(0x1f4a3a), rgb(0x4f8f5e), (0.25 + 0.9 * b * (0.7 + 0.6 * k.unit(2))).min(1.0));
            let base = mix3(base, rgb(0xb9a24e), 0.75 * step(0.20, 0.02, edge) * step(0.25, 0.7, b));
            let base = mix3(base, rgb(0x2b3d5a), 0.5 * k.unit(3));
            let lit = (0.78 + 0.3 * (k.unit(4) - 0.5))
                * (1.0 + 0.14 * rings + 0.16 * ray)
                * mix(0.55, 1.15, b)
                * mix(0.6, 1.0, rim);
            found = Point {
                color: shade(base, lit),
                height,
                roughness: (0.38 + 0.12 * rings - 0.08 * keel).clamp(0.1, 1.0),
                ..Point::default()
            };
        }
        found
    })
}
