//! Cooling lava: dark crust over a glow that shows in the cracks.

use kiln::numerics::rng::Key;

use crate::material::{Extra, Material, Point};
use crate::noise::{cell, fractal, mix3, rgb, shade, step};

pub fn ember() -> Material {
    let key = Key::new(51).with_str("ember");
    let extra = Extra { emissive: true, ..Extra::default() };
    Material::new(192, 192, 10.0, extra, |x, y| {
        let wx = 5.0 * fractal(key.with(1), x / 16.0, y / 16.0, 4);
        let wy = 5.0 * fractal(key.with(2), x / 16.0, y / 16.0, 4);
        let plate = cell(key.with(3), (x + wx) / 30.0, (y + wy) / 30.0, 0.9);
        let small = cell(key.with(4), (x + wx) / 11.0, (y + wy) / 11.0, 0.9);
        let rough = fractal(key.with(5), x / 9.0, y / 9.0, 5);
        let fine = fractal(key.with(6), x / 2.2, y / 2.2, 3);
        let split = plate.border * 30.0 + 1.2 * fine;
        let minor = small.border * 11.0 + 0.8 * fine + 3.0 * step(0.4, 0.0, plate.key.unit(3));
        let hot = step(4.2, 0.4, split);
        let warm = 0.55 * step(1.3, 0.1, minor) * step(-0.3, 0.5, rough);
        let heat = (hot * (0.70 + 0.5 * rough) + warm).clamp(0.0, 1.0);
        let glow = mix3(mix3([0.0; 3], rgb(0xb3200a), step(0.02, 0.35, heat)), rgb(0xff8a1c), step(0.30, 0.75, heat));
        let glow = mix3(glow, rgb(0xffe08a), step(0.78, 1.0, heat));
        let crust = shade(rgb(0x2b2624), (0.9 + 0.35 * (plate.key.unit(4) - 0.5)) * (1.0 + 0.35 * rough + 0.30 * fine));
        let ash = step(0.25, 0.6, rough + 0.3 * fine);
        let crust = mix3(crust, rgb(0x6a625c), 0.45 * ash);
        let top = 0.55 + 0.20 * plate.key.unit(5) + 0.16 * rough + 0.05 * fine;
        Point {
            color: mix3(crust, shade(rgb(0x5a1c0c), 1.0), heat),
            height: (top * step(0.0, 6.0, split).max(0.15) - 0.08 * step(1.5, 0.0, minor)).clamp(0.0, 1.0),
            roughness: (0.86 + 0.1 * fine).clamp(0.0, 1.0),
            emissive: glow,
            ..Point::default()
        }
    })
}
