//! Composes the README's picture from golden views, the exemplars and the bare knot:
//! `cargo run --release --example make_picture`, after `kiln accept`.

use std::path::Path;

use kiln::io::SampleType;
use kiln::io::image_file::{Compression, Limits, Transfer, decode_pixels, encode_png};
use kiln::io::image_quantise::{Encoding, dequantise, quantise};
use kiln::io::scene::Document;
use kiln::render::{Appearance, Hit, Look, Mode, Scene, render, turntable};
use kiln::texture::{Texel, Texture, texel};

const SIDE: u32 = 256;

/// Grey everywhere.
struct Plain;

impl Look for Plain {
    fn appearance(&self, hit: &Hit) -> Appearance {
        Appearance { color: [0.55; 3], normal: hit.normal, roughness: 0.7, ..Appearance::default() }
    }
    fn is_there(&self, _: usize, _: [f32; 3]) -> bool {
        true
    }
    fn source(&self, _: usize, _: [f32; 3]) -> Option<[f32; 2]> {
        None
    }
    fn checker(&self, _: usize, _: [f32; 3]) -> (Texel, f32) {
        (texel(0.0, 0.0), 1.0)
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let open = |path: &str| -> Result<Texture, Box<dyn std::error::Error>> {
        Ok(dequantise(&decode_pixels(&std::fs::read(root.join(path))?, &Limits::default())?, Encoding::Color))
    };
    let mesh = std::fs::read(root.join("recipes/assets/meshes/knot.glb"))?;
    let knot = Document::parse("knot.glb", &mesh, &mut |_| Err("one file".into()))?.surface(None)?;
    let scene = Scene { mesh: &knot.mesh, corner_normals: &knot.corner_normals, look: &Plain };
    let bare = render(&scene, &turntable(&knot.mesh, 1, SIDE)[0], Mode::Lit);
    let panels = [
        open("recipes/assets/pebbles/base_color.png")?,
        bare,
        open("golden/knot/render/turntable-2.png")?,
        open("golden/knot/render/turntable-1.png")?,
        open("golden/ring-scales/render/turntable-2.png")?,
        open("golden/block-bricks/render/camera.png")?,
        open("golden/toadstool-ember/render/turntable-2.png")?,
        open("golden/sphere-rust/render/turntable-2.png")?,
    ];
    let picture = Texture::from_fn(4 * SIDE, 2 * SIDE, 3, |x, y, out| {
        let panel = &panels[(y / SIDE * 4 + x / SIDE) as usize];
        // Larger pictures are shown by their middle.
        let (dx, dy) =
            (panel.width().min(panel.height()).saturating_sub(SIDE) / 2, panel.height().saturating_sub(SIDE) / 2);
        out.copy_from_slice(&panel.get(x % SIDE + dx, y % SIDE + dy)[..3]);
    });
    let pixels = quantise(&picture, Encoding::Color, SampleType::U8)?;
    std::fs::write(root.join("recipes/assets/picture.png"), encode_png(&pixels, Compression::Best, Transfer::Srgb)?)?;
    Ok(())
}
