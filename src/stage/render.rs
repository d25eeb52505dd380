//! Step: a golden view by the CPU renderer, encoded as PNG.
//!
//! Of an atlas bake it shows the finished maps as an engine would, else the UV sets. Pictures of patches always look
//! through the UV sets, which alone know where a texel came from; those of edges show the metric of the blend. Pictures of
//! the field need neither.

use crate::bake::{Atlas, pack_orm, tangents};
use crate::build::{Inputs, Step, StepError, Visitor};
use crate::field::Laid;
use crate::io::image_file::{Compression, Transfer, encode_png};
use crate::io::image_quantise::{Encoding, dequantise, quantise};
use crate::io::{Pixels, SampleType};
use crate::mesh::{Surface, TriMesh};
use crate::numerics::vec::Vec3;
use crate::param::{Kind, Singularity};
use crate::recipe::{self, Render, Shading};
use crate::render::{
    self, AtlasLook, AtlasMaps, Edges, Grid, Look, Mode, Scene, SetsLook, Strokes, View, synthesis_normals, turntable,
};
use crate::texture::Texture;

use super::field::laid;
use super::material_space::{Source, coordinates, places};
use super::prepare::Prepared;
use super::rasterise::{Bundle, GLTF_ORM};
use super::synthesise::Synthesised;

/// Reads surface, synthesis mesh, corner coordinates and the maps or the tile, and of an atlas bake the atlas and its images.
pub(super) struct RenderView {
    pub recipe: String,
    pub view: Render,
}

/// The images of a bundle as an engine would read them.
fn atlas_maps(bundle: &Bundle) -> Result<AtlasMaps, StepError> {
    let get = |name: &str, encoding| bundle.images.get(name).map(|p: &Pixels| dequantise(p, encoding));
    let single = |name: &str| get(name, Encoding::Data);
    let packed = get("orm", Encoding::Data).or_else(|| get(GLTF_ORM, Encoding::Data));
    let orm = packed.or_else(|| {
        let [o, r, m] = ["occlusion", "roughness", "metallic"].map(single);
        pack_orm(o.as_ref(), r.as_ref(), m.as_ref())
    });
    Ok(AtlasMaps {
        base_color: get("base_color", Encoding::Color),
        normal: get("normal", Encoding::Normal),
        orm,
        emissive: get("emissive", Encoding::Color),
    })
}

/// A picture of a mesh from the views of a recipe's render.
fn picture(view: &Render, surface: &Surface, mesh: &TriMesh, normals: &[Vec3], look: &dyn Look) -> Texture {
    let size = view.size;
    let views = match view.view {
        recipe::View::Turntable(n) => turntable(&surface.mesh, n, size),
        recipe::View::Camera { eye, target, fov } => vec![View { eye, target, fov, size }],
    };
    let mode = match view.shading {
        Shading::Unlit => Mode::Unlit,
        Shading::Lit | Shading::Field | Shading::Singularities | Shading::Edges => Mode::Lit,
        Shading::Normal => Mode::Normal,
        Shading::Patches => Mode::Patches,
        Shading::Uv => Mode::Uv,
    };
    render::strip(&Scene { mesh, corner_normals: normals, look }, &views, mode)
}

fn png(picture: &Texture) -> Result<Vec<u8>, StepError> {
    let pixels = quantise(picture, Encoding::Color, SampleType::U8)?;
    Ok(encode_png(&pixels, Compression::Fast, Transfer::Srgb)?)
}

/// The identity of a step that makes a view.
macro_rules! view_identity {
    ($kind:literal, $revision:literal) => {
        fn name(&self) -> String {
            format!("{}/render {}", self.recipe, self.view.name)
        }

        fn kind(&self) -> &'static str {
            $kind
        }

        fn revision(&self) -> u32 {
            $revision
        }

        fn travels(&self) -> bool {
            true
        }
    };
}

/// Where from and how large a view is.
fn describe_view(view: &Render, v: &mut dyn Visitor) {
    v.param("view", &view.view);
    v.param("size", &view.size);
}

/// A view of the field: reads surface, synthesis mesh and field.
pub(super) struct RenderField {
    pub recipe: String,
    pub view: Render,
}

impl Step for RenderField {
    view_identity!("render field", 1);

    fn describe(&self, v: &mut dyn Visitor) {
        describe_view(&self.view, v);
    }

    fn run(&self, inputs: &Inputs) -> Result<Vec<u8>, StepError> {
        let surface: Surface = super::read(inputs, 0)?;
        let prepared: Prepared = super::read(inputs, 1)?;
        let (Laid { field, symmetry, singularities, .. }, _) = laid(inputs, 2)?;
        let normals = synthesis_normals(&prepared.mesh, &surface.corner_normals);
        let marks: Vec<_> = singularities.iter().map(|s| (s.at, s.index)).collect();
        let look = Strokes::new(&prepared.mesh.mesh, &field.up, symmetry.directions(), &marks);
        png(&picture(&self.view, &surface, &prepared.mesh.mesh, &normals, &look))
    }
}

/// A view of the periodic coordinates: reads surface, synthesis mesh, field and coordinates.
pub(super) struct RenderSingularities {
    pub recipe: String,
    pub view: Render,
}

impl Step for RenderSingularities {
    view_identity!("render singularities", 1);

    fn describe(&self, v: &mut dyn Visitor) {
        describe_view(&self.view, v);
    }

    fn run(&self, inputs: &Inputs) -> Result<Vec<u8>, StepError> {
        let surface: Surface = super::read(inputs, 0)?;
        let prepared: Prepared = super::read(inputs, 1)?;
        let (laid, next) = laid(inputs, 2)?;
        let coordinates = coordinates(inputs, next)?;
        let mesh = &prepared.mesh.mesh;
        let normals = synthesis_normals(&prepared.mesh, &surface.corner_normals);
        let mark = |s: &Singularity| match s.kind {
            Kind::Pole => Some((s.at, 1.0)),
            Kind::TJunction => Some((s.at, -1.0)),
            Kind::Distortion => None,
        };
        let marks: Vec<_> = places(mesh, &laid, &coordinates).iter().filter_map(mark).collect();
        let blended: Vec<bool> = (0..mesh.faces.len()).map(|f| coordinates.look_ups(mesh, f) == 3).collect();
        let look = Grid::new(mesh, &coordinates.corners, &blended, &marks);
        png(&picture(&self.view, &surface, mesh, &normals, &look))
    }
}

impl Step for RenderView {
    view_identity!("render", 1);

    fn describe(&self, v: &mut dyn Visitor) {
        describe_view(&self.view, v);
        v.param("shading", &self.view.shading);
    }

    fn run(&self, inputs: &Inputs) -> Result<Vec<u8>, StepError> {
        let surface: Surface = super::read(inputs, 0)?;
        let through_sets = inputs.len() <= 4 || self.view.shading == Shading::Patches;
        let shown = if self.view.shading == Shading::Edges {
            let prepared: Prepared = super::read(inputs, 1)?;
            let synthesised: Synthesised = super::read(inputs, 2)?;
            let normals = synthesis_normals(&prepared.mesh, &surface.corner_normals);
            picture(&self.view, &surface, &prepared.mesh.mesh, &normals, &Edges::new(&synthesised.metric))
        } else if through_sets {
            let prepared: Prepared = super::read(inputs, 1)?;
            let synthesised: Synthesised = super::read(inputs, 2)?;
            let normals = synthesis_normals(&prepared.mesh, &surface.corner_normals);
            let (mesh, sets) = (&prepared.mesh.mesh, &synthesised.sets);
            let look = match Source::read(inputs, 3)? {
                Source::Exemplar(maps) => SetsLook::new(mesh, sets, &maps),
                Source::Tile(made) => SetsLook::tile(mesh, sets, made.tile.layers()),
            };
            picture(&self.view, &surface, &prepared.mesh.mesh, &normals, &look)
        } else {
            let atlas: Atlas = super::read(inputs, 4)?;
            let bundle: Bundle = super::read(inputs, 5)?;
            let tangents = tangents(&surface, &atlas);
            let look = AtlasLook::new(&atlas, &tangents, &surface.corner_normals, &atlas_maps(&bundle)?);
            picture(&self.view, &surface, &surface.mesh, &surface.corner_normals, &look)
        };
        png(&shown)
    }
}
