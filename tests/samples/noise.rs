//! Noise on a plane of texels: gradient noise, its sums, cellular noise. All from hashed keys, the same everywhere.

use kiln::numerics::det;
use kiln::numerics::rng::Key;

/// Random unit-interval value of a lattice point.
pub fn hash(key: Key, x: i64, y: i64) -> f64 {
    key.with(x as u64).with(y as u64).unit(0)
}

/// Gradient (Perlin) noise, about -1..1, features one unit apart.
pub fn gradient(key: Key, x: f64, y: f64) -> f64 {
    let (x0, y0) = (x.floor(), y.floor());
    let (fx, fy) = (x - x0, y - y0);
    let corner = |dx: f64, dy: f64| {
        let angle = hash(key, (x0 + dx) as i64, (y0 + dy) as i64) * std::f64::consts::TAU;
        let (s, c) = det::sin_cos(angle);
        c * (fx - dx) + s * (fy - dy)
    };
    let fade = |t: f64| t * t * t * (t * (t * 6.0 - 15.0) + 10.0);
    let (u, v) = (fade(fx), fade(fy));
    let top = corner(0.0, 0.0) * (1.0 - u) + corner(1.0, 0.0) * u;
    let bottom = corner(0.0, 1.0) * (1.0 - u) + corner(1.0, 1.0) * u;
    (top * (1.0 - v) + bottom * v) * 1.5
}

/// Sum of `octaves` of gradient noise, each half as large and half as strong; about -1..1.
pub fn fractal(key: Key, x: f64, y: f64, octaves: u32) -> f64 {
    let (mut sum, mut size, mut total) = (0.0, 1.0, 0.0);
    for o in 0..octaves {
        sum += gradient(key.with(u64::from(o)), x / size, y / size) * size;
        total += size;
        size *= 0.5;
    }
    sum / total * 1.4
}

/// Gradient noise in space and time, about -1..1, features one unit apart.
pub fn gradient3(key: Key, at: [f64; 3]) -> f64 {
    let base = at.map(f64::floor);
    let part: [f64; 3] = std::array::from_fn(|i| at[i] - base[i]);
    let fade = part.map(|t| t * t * t * (t * (t * 6.0 - 15.0) + 10.0));
    (0..8).fold(0.0, |sum, corner: u32| {
        let bit = |i: u32| f64::from(corner >> i & 1);
        let k = (0..3).fold(key, |k, i| k.with((base[i as usize] + bit(i)) as i64 as u64));
        let (s, c) = det::sin_cos(k.unit(0) * std::f64::consts::TAU);
        let z = k.unit(1) * 2.0 - 1.0;
        let r = (1.0 - z * z).sqrt();
        let slope = c * r * (part[0] - bit(0)) + s * r * (part[1] - bit(1)) + z * (part[2] - bit(2));
        let weight = |i: u32| if bit(i) == 1.0 { fade[i as usize] } else { 1.0 - fade[i as usize] };
        sum + slope * weight(0) * weight(1) * weight(2) * 1.5
    })
}

/// Ridged sum: sharp crests at 1, valleys at 0.
pub fn ridged(key: Key, x: f64, y: f64, octaves: u32) -> f64 {
    let (mut sum, mut size, mut total) = (0.0, 1.0, 0.0);
    for o in 0..octaves {
        sum += (1.0 - gradient(key.with(u64::from(o)), x / size, y / size).abs()) * size;
        total += size;
        size *= 0.5;
    }
    sum / total
}

/// What cellular noise knows of a point.
pub struct Cell {
    /// Distance to the border with the next cell, in lattice units.
    pub border: f64,
    /// Distance to the cell's own point.
    pub centre: f64,
    /// The cell's key, for its colour and form.
    pub key: Key,
}

/// Cellular noise with one jittered point per unit square; `jitter` 0..1. Exact distance to the border.
pub fn cell(key: Key, x: f64, y: f64, jitter: f64) -> Cell {
    let (cx, cy) = (x.floor() as i64, y.floor() as i64);
    let point = |i: i64, j: i64| {
        let k = key.with(i as u64).with(j as u64);
        (i as f64 + 0.5 + (k.unit(0) - 0.5) * jitter, j as f64 + 0.5 + (k.unit(1) - 0.5) * jitter, k)
    };
    let mut nearest = (f64::MAX, 0.0, 0.0, key);
    for j in cy - 2..=cy + 2 {
        for i in cx - 2..=cx + 2 {
            let (px, py, k) = point(i, j);
            let d = (px - x) * (px - x) + (py - y) * (py - y);
            if d < nearest.0 {
                nearest = (d, px, py, k);
            }
        }
    }
    let mut border = f64::MAX;
    for j in cy - 2..=cy + 2 {
        for i in cx - 2..=cx + 2 {
            let (px, py, k) = point(i, j);
            if k == nearest.3 {
                continue;
            }
            let (ex, ey) = (px - nearest.1, py - nearest.2);
            let (mx, my) = ((px + nearest.1) * 0.5 - x, (py + nearest.2) * 0.5 - y);
            border = border.min((mx * ex + my * ey) / (ex * ex + ey * ey).sqrt());
        }
    }
    Cell { border, centre: nearest.0.sqrt(), key: nearest.3 }
}

/// Smooth step from 0 at `a` to 1 at `b`.
pub fn step(a: f64, b: f64, x: f64) -> f64 {
    let t = ((x - a) / (b - a)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Linear mix.
pub fn mix(a: f64, b: f64, t: f64) -> f64 {
    a + (b - a) * t
}

/// Linear mix of colours.
pub fn mix3(a: [f64; 3], b: [f64; 3], t: f64) -> [f64; 3] {
    std::array::from_fn(|i| mix(a[i], b[i], t))
}

/// A colour made lighter or darker.
pub fn shade(c: [f64; 3], f: f64) -> [f64; 3] {
    c.map(|v| v * f)
}

/// 0xRRGGBB as sRGB 0..1.
pub fn rgb(hex: u32) -> [f64; 3] {
    [16, 8, 0].map(|s| f64::from(hex >> s & 255) / 255.0)
}
