//! A small renderer on the CPU: golden views that are the same bytes on every machine.
//!
//! In: triangles, a [`Look`] that says how they look at a point, a camera. Out: a picture in linear colour.
//! Perspective-correct homogeneous rasterisation (Olano and Greer 1997) into a z-buffer with 2x2 samples a pixel; both
//! sides of a triangle are drawn. Lighting is a key light at the viewer's shoulder and a plain sky: enough to judge
//! colour, relief and gloss, no more.
//!
//! Unaware of: files, recipes, how the texture was made.

mod camera;
mod edges;
mod grid;
mod light;
mod look;
mod raster;
mod strokes;

pub use camera::{View, turntable};
pub use edges::Edges;
pub use grid::Grid;
pub use look::{Appearance, AtlasLook, AtlasMaps, Hit, Look, SetsLook, synthesis_normals};
pub use raster::render;
pub use strokes::Strokes;

use crate::numerics::vec::Vec3;
use crate::texture::Texture;

/// What a picture shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// Base colour and emission alone.
    Unlit,
    /// Lit by a key light and a sky.
    Lit,
    /// Normals in the world, -1..1 as 0..1.
    Normal,
    /// The position in the exemplar as a colour ramp (\[ZG03\] figure 3, right).
    Patches,
    /// A checkerboard of the texture coordinates.
    Uv,
}

/// Triangles to be drawn.
#[derive(Clone, Copy)]
pub struct Scene<'a> {
    /// World positions and triangles.
    pub mesh: &'a crate::mesh::TriMesh,
    /// Unit shading normal of each corner (3 per face).
    pub corner_normals: &'a [Vec3],
    /// How the triangles look.
    pub look: &'a dyn Look,
}

/// Renders several views side by side, in order. Panics without a view or with views of different sizes.
pub fn strip(scene: &Scene<'_>, views: &[View], mode: Mode) -> Texture {
    let pictures: Vec<Texture> = views.iter().map(|v| render(scene, v, mode)).collect();
    let (w, h) = (pictures[0].width(), pictures[0].height());
    assert!(pictures.iter().all(|p| (p.width(), p.height()) == (w, h)), "views of one size");
    Texture::from_fn(w * pictures.len() as u32, h, 3, |x, y, out| {
        out.copy_from_slice(pictures[(x / w) as usize].get(x % w, y));
    })
}
