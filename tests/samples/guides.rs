//! Pictures that steer canvases: where a plate is worn, how worn it shall be elsewhere, a hole in a wall.

use std::path::Path;

use kiln::numerics::rng::Key;

use crate::material::write_png;
use crate::noise::{fractal, step};
use crate::rust::rusted_plate_wear;

/// Size of the canvas that [`wear`] is for.
const CANVAS: [usize; 2] = [384, 256];

/// Size of the bricks.
const WALL: [usize; 2] = [256, 192];

pub fn write_all(folder: &Path) -> std::io::Result<()> {
    std::fs::create_dir_all(folder)?;
    let plate = rusted_plate_wear();
    save(folder, "plate-wear", [256, 256], |x, y| plate[y * 256 + x])?;
    save(folder, "ring-wear", CANVAS, wear)?;
    save(folder, "wall-hole", WALL, hole)
}

fn save(folder: &Path, name: &str, [w, h]: [usize; 2], f: impl Fn(usize, usize) -> f64) -> std::io::Result<()> {
    let byte = |v: f64| (v.clamp(0.0, 1.0) * 255.0).round() as u8;
    let data: Vec<u8> = (0..w * h).map(|i| byte(f(i % w, i / w))).collect();
    let (grey, eight) = (png::ColorType::Grayscale, png::BitDepth::Eight);
    write_png(&folder.join(format!("{name}.png")), w, h, grey, eight, &data)
}

/// Worn along a ring and at the foot, clean elsewhere.
fn wear(x: usize, y: usize) -> f64 {
    let (x, y) = (x as f64 + 0.5, y as f64 + 0.5);
    let ragged = 14.0 * fractal(Key::new(5).with_str("wear"), x / 40.0, y / 40.0, 3);
    let (dx, dy) = (x - CANVAS[0] as f64 / 2.0, y - 110.0);
    let ring = ((dx * dx + dy * dy).sqrt() + ragged - 72.0).abs();
    step(34.0, 8.0, ring).max(step(200.0, 248.0, y + ragged))
}

/// White where a cannon ball went through the wall.
fn hole(x: usize, y: usize) -> f64 {
    let (dx, dy) = (x as f64 - 140.0, y as f64 - 92.0);
    let ragged = 9.0 * fractal(Key::new(6).with_str("hole"), x as f64 / 18.0, y as f64 / 18.0, 3);
    f64::from(u8::from((dx * dx / 1.6 + dy * dy).sqrt() + ragged < 38.0))
}
