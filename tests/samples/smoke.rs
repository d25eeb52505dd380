//! Rising smoke: a flipbook of grey with opacity.

use std::path::Path;

use kiln::numerics::rng::Key;

use crate::material::write_png;
use crate::noise::{gradient3, step};

/// Width, height, frames.
const SIZE: [usize; 3] = [48, 48, 20];

/// Texels that the smoke rises per frame.
const RISE: f64 = 1.5;

/// Grey and opacity, 0..1, at a texel of a frame.
fn smoke(key: Key, x: f64, y: f64, t: f64) -> [f64; 2] {
    let at = |key: Key, size: f64, life: f64| gradient3(key, [x / size, (y + RISE * t) / size, t / life]);
    let (wx, wy) = (3.0 * at(key.with(1), 9.0, 9.0), 3.0 * at(key.with(2), 9.0, 9.0));
    let wisp = |part: u64, size: f64, life: f64| {
        gradient3(key.with(part), [(x + wx) / size, (y + wy + RISE * t) / size, t / life])
    };
    let thick = wisp(3, 11.0, 14.0) + 0.55 * wisp(4, 5.5, 8.0) + 0.25 * wisp(5, 3.0, 5.0);
    let light = 0.72 + 0.22 * wisp(6, 7.0, 10.0) + 0.1 * thick;
    [light, step(-0.35, 0.75, thick)]
}

/// Writes the frames `smoke_0001.png` and on into a folder.
pub fn write(folder: &Path) -> std::io::Result<()> {
    std::fs::create_dir_all(folder)?;
    let key = Key::new(71).with_str("smoke");
    let [width, height, frames] = SIZE;
    for t in 0..frames {
        // Sixteen greys and 32 opacities: nobody sees more of smoke, and the files stay small.
        let level = |v: f64, most: f64| ((v.clamp(0.0, 1.0) * most).round() / most * 255.0).round() as u8;
        let texels = (0..height).flat_map(|y| (0..width).map(move |x| (x as f64 + 0.5, y as f64 + 0.5)));
        let data: Vec<u8> = texels
            .flat_map(|(x, y)| {
                let [light, opacity] = smoke(key, x, y, t as f64);
                [level(light, 15.0), level(opacity, 31.0)]
            })
            .collect();
        let path = folder.join(format!("smoke_{:04}.png", t + 1));
        write_png(&path, width, height, png::ColorType::GrayscaleAlpha, png::BitDepth::Eight, &data)?;
    }
    Ok(())
}
