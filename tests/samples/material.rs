//! A material as a function of the texel, and its maps as files.

use std::path::Path;

use kiln::numerics::det;

/// What a material is at one texel.
#[derive(Clone, Copy)]
pub struct Point {
    /// sRGB, 0..1.
    pub color: [f64; 3],
    /// 0..1.
    pub height: f64,
    /// 0..1.
    pub roughness: f64,
    /// 0..1.
    pub metallic: f64,
    /// sRGB, 0..1.
    pub emissive: [f64; 3],
    /// 0..1.
    pub opacity: f64,
}

impl Default for Point {
    fn default() -> Self {
        Point { color: [0.5; 3], height: 0.5, roughness: 0.8, metallic: 0.0, emissive: [0.0; 3], opacity: 1.0 }
    }
}

/// Which files are written besides colour, normal, roughness, occlusion and height.
#[derive(Clone, Copy, Default)]
pub struct Extra {
    pub metallic: bool,
    pub emissive: bool,
    pub opacity: bool,
    /// Occlusion, roughness and metallic in one file instead of three.
    pub packed: bool,
}

/// All texels of a material.
pub struct Material {
    width: usize,
    height: usize,
    points: Vec<Point>,
    /// Texels that the height range 0..1 stands for.
    relief: f64,
    extra: Extra,
}

impl Material {
    pub fn new(width: usize, height: usize, relief: f64, extra: Extra, f: impl Fn(f64, f64) -> Point) -> Self {
        let mut points = Vec::with_capacity(width * height);
        for y in 0..height {
            for x in 0..width {
                points.push(average(&f, x, y));
            }
        }
        Material { width, height, points, relief, extra }
    }

    fn at(&self, x: i64, y: i64) -> &Point {
        let (x, y) = (x.clamp(0, self.width as i64 - 1), y.clamp(0, self.height as i64 - 1));
        &self.points[y as usize * self.width + x as usize]
    }

    /// Tangent-space normal from the height by a Sobel filter; y up.
    fn normal(&self, x: i64, y: i64) -> [f64; 3] {
        let h = |dx: i64, dy: i64| self.at(x + dx, y + dy).height * self.relief;
        let gx = (h(1, -1) + 2.0 * h(1, 0) + h(1, 1) - h(-1, -1) - 2.0 * h(-1, 0) - h(-1, 1)) / 8.0;
        let gy = (h(-1, 1) + 2.0 * h(0, 1) + h(1, 1) - h(-1, -1) - 2.0 * h(0, -1) - h(1, -1)) / 8.0;
        let l = (gx * gx + gy * gy + 1.0).sqrt();
        [-gx / l, gy / l, 1.0 / l]
    }

    /// Share of the sky seen from a texel: horizon angles in twelve directions.
    fn occlusion(&self, x: i64, y: i64) -> f64 {
        let here = self.at(x, y).height * self.relief;
        let mut open = 0.0;
        for d in 0..12 {
            let (s, c) = det::sin_cos(f64::from(d) * std::f64::consts::TAU / 12.0);
            let mut slope = 0.0f64;
            for r in [1.5, 3.0, 5.0, 8.0, 12.0] {
                let there = self.at(x + (c * r).round() as i64, y + (s * r).round() as i64).height * self.relief;
                slope = slope.max((there - here) / r);
            }
            open += 1.0 - slope / (1.0 + slope * slope).sqrt();
        }
        open / 12.0
    }

    /// Writes the maps as PNG files into a folder.
    pub fn write(&self, folder: &Path) -> std::io::Result<()> {
        std::fs::create_dir_all(folder)?;
        let byte = |v: f64| (v.clamp(0.0, 1.0) * 255.0).round() as u8;
        let each = |f: PutTexel<'_>| {
            let mut out = Vec::new();
            for y in 0..self.height as i64 {
                for x in 0..self.width as i64 {
                    f(x, y, self.at(x, y), &mut out);
                }
            }
            out
        };
        let save = |name: &str, color: png::ColorType, depth: png::BitDepth, data: &[u8]| {
            write_png(&folder.join(name), self.width, self.height, color, depth, data)
        };
        let (grey, rgb, eight) = (png::ColorType::Grayscale, png::ColorType::Rgb, png::BitDepth::Eight);
        save("base_color.png", rgb, eight, &each(&|_, _, p, o| o.extend(p.color.map(byte))))?;
        save("normal.png", rgb, eight, &each(&|x, y, _, o| o.extend(self.normal(x, y).map(|v| byte(v * 0.5 + 0.5)))))?;
        let deep = each(&|_, _, p, o| {
            o.extend(((p.height.clamp(0.0, 1.0) * 65535.0).round() as u16).to_be_bytes());
        });
        save("height.png", grey, png::BitDepth::Sixteen, &deep)?;
        if self.extra.packed {
            let orm = each(&|x, y, p, o| o.extend([self.occlusion(x, y), p.roughness, p.metallic].map(byte)));
            save("orm.png", rgb, eight, &orm)?;
        } else {
            save("roughness.png", grey, eight, &each(&|_, _, p, o| o.push(byte(p.roughness))))?;
            save("occlusion.png", grey, eight, &each(&|x, y, _, o| o.push(byte(self.occlusion(x, y)))))?;
            if self.extra.metallic {
                save("metallic.png", grey, eight, &each(&|_, _, p, o| o.push(byte(p.metallic))))?;
            }
        }
        if self.extra.emissive {
            save("emissive.png", rgb, eight, &each(&|_, _, p, o| o.extend(p.emissive.map(byte))))?;
        }
        if self.extra.opacity {
            save("opacity.png", grey, eight, &each(&|_, _, p, o| o.push(byte(p.opacity))))?;
        }
        Ok(())
    }
}

/// Appends the bytes of the texel (x, y).
type PutTexel<'a> = &'a dyn Fn(i64, i64, &Point, &mut Vec<u8>);

/// Mean of 3x3 samples within a texel.
fn average(f: &impl Fn(f64, f64) -> Point, x: usize, y: usize) -> Point {
    let zero = Point { color: [0.0; 3], height: 0.0, roughness: 0.0, metallic: 0.0, emissive: [0.0; 3], opacity: 0.0 };
    let mut sum = zero;
    for j in 0..3 {
        for i in 0..3 {
            let p = f(x as f64 + (f64::from(i) + 0.5) / 3.0, y as f64 + (f64::from(j) + 0.5) / 3.0);
            for c in 0..3 {
                sum.color[c] += p.color[c].clamp(0.0, 1.0) / 9.0;
                sum.emissive[c] += p.emissive[c].clamp(0.0, 1.0) / 9.0;
            }
            sum.height += p.height / 9.0;
            sum.roughness += p.roughness / 9.0;
            sum.metallic += p.metallic / 9.0;
            sum.opacity += p.opacity / 9.0;
        }
    }
    sum
}

/// Writes a PNG.
pub fn write_png(
    path: &Path,
    width: usize,
    height: usize,
    color: png::ColorType,
    depth: png::BitDepth,
    data: &[u8],
) -> std::io::Result<()> {
    let file = std::io::BufWriter::new(std::fs::File::create(path)?);
    let mut encoder = png::Encoder::new(file, width as u32, height as u32);
    encoder.set_color(color);
    encoder.set_depth(depth);
    encoder.set_compression(png::Compression::High);
    encoder.write_header()?.write_image_data(data)?;
    Ok(())
}
