//! Steps: the finished GLBs, with atlas maps or with UV sets; all else of the scene as it came.

use crate::bake::{Atlas, pack_orm, tangents};
use crate::build::{Inputs, Step, StepError, Visitor};
use crate::io::gltf::{
    AlphaMode, AtlasCorners, BakedImage, BakedMaps, MaterialSpace, TriangleOrder, Use, UvSetOutput, write_atlas,
    write_uv_sets,
};
use crate::io::image_file::{Compression, Transfer, encode_png};
use crate::io::image_quantise::{Encoding, dequantise, quantise};
use crate::io::{Pixels, SampleType};
use crate::mesh::Surface;
use crate::texture::{MapKind, MapSet, Texture};

use super::material_space::Source;
use super::prepare::Prepared;
use super::rasterise::{Bundle, GLTF_ORM};
use super::surface::SceneFiles;
use super::synthesise::Synthesised;

/// Reads the scene's files, the surface, the atlas and its images.
pub(super) struct AtlasGlb {
    pub recipe: String,
    pub scene: SceneFiles,
}

/// A picture as glTF holds it: PNG of 8 bits.
fn image(usage: Use, name: &str, pixels: &Pixels, encoding: Encoding) -> Result<BakedImage, StepError> {
    let transfer = if encoding == Encoding::Color { Transfer::Srgb } else { Transfer::Unstated };
    let eight;
    let pixels = match pixels.samples.sample_type() {
        SampleType::U8 => pixels,
        _ => {
            eight = quantise(&dequantise(pixels, encoding), encoding, SampleType::U8)?;
            &eight
        }
    };
    let bytes = encode_png(pixels, Compression::Fast, transfer)?;
    Ok(BakedImage { usage, mime: "image/png".into(), bytes, name: name.into() })
}

/// How alpha is meant: a cut-out where nearly all of it is all or nothing, else a blend.
fn alpha_mode(pixels: &Pixels) -> AlphaMode {
    if !pixels.has_alpha() {
        return AlphaMode::Opaque;
    }
    let texture = dequantise(pixels, Encoding::Data);
    let c = texture.channels() as usize;
    let partial = texture.data().iter().skip(c - 1).step_by(c).filter(|a| (0.05..0.95).contains(*a)).count();
    if partial * 4 < texture.texel_count() { AlphaMode::Mask } else { AlphaMode::Blend }
}

/// Which of the packed map's channels mean something.
fn orm_use(has: impl Fn(MapKind) -> bool) -> Use {
    let shines = has(MapKind::Roughness) || has(MapKind::Metallic);
    match (has(MapKind::Occlusion), shines) {
        (true, false) => Use::Occlusion,
        (true, true) => Use::OcclusionMetallicRoughness,
        _ => Use::MetallicRoughness,
    }
}

impl Step for AtlasGlb {
    super::step_identity!("atlas glb", 1);

    fn describe(&self, v: &mut dyn Visitor) {
        v.param("name", &self.recipe);
        self.scene.describe(v);
    }

    fn run(&self, inputs: &Inputs) -> Result<Vec<u8>, StepError> {
        let document = self.scene.document(inputs)?;
        let first = self.scene.inputs();
        let surface: Surface = super::read(inputs, first)?;
        let atlas: Atlas = super::read(inputs, first + 1)?;
        let bundle: Bundle = super::read(inputs, first + 2)?;
        let mut maps = BakedMaps { material_name: self.recipe.clone(), ..BakedMaps::default() };
        let mut add = |name: &str, usage, encoding| -> Result<(), StepError> {
            if let Some(pixels) = bundle.images.get(name) {
                maps.images.push(image(usage, name, pixels, encoding)?);
            }
            Ok(())
        };
        add("base_color", Use::BaseColor, Encoding::Color)?;
        add("normal", Use::Normal, Encoding::Normal)?;
        add("emissive", Use::Emissive, Encoding::Color)?;
        let single = |kind: MapKind| bundle.images.contains_key(kind.name());
        if bundle.images.contains_key("orm") {
            add("orm", Use::OcclusionMetallicRoughness, Encoding::Data)?;
        } else {
            add(GLTF_ORM, orm_use(single), Encoding::Data)?;
        }
        maps.alpha = bundle.images.get("base_color").map_or(AlphaMode::Opaque, alpha_mode);
        let tangents = maps.has(Use::Normal).then(|| tangents(&surface, &atlas));
        let corners = AtlasCorners { uv: &atlas.corner_uv, tangents: tangents.as_deref() };
        Ok(write_atlas(&document, &surface, &corners, &maps)?)
    }
}

/// Reads the scene's files, the surface, the synthesis mesh, the corner coordinates and the maps or the tile. Of a
/// tile, the material shows the layer at m = 0.
pub(super) struct UvSetsGlb {
    pub recipe: String,
    pub scene: SceneFiles,
    pub weld_texels: f64,
    pub triangles: TriangleOrder,
}

/// Means of a map's channels.
fn mean(map: &Texture) -> Vec<f32> {
    let c = map.channels() as usize;
    let mut sums = vec![0.0f64; c];
    for texel in map.data().chunks_exact(c) {
        texel.iter().zip(&mut sums).for_each(|(v, s)| *s += f64::from(*v));
    }
    sums.iter().map(|s| (s / map.texel_count() as f64) as f32).collect()
}

/// Means of maps by name.
type Means = Vec<(String, Vec<f32>)>;

/// The sample's maps as a material's textures, and the mean of each in linear values.
fn sample_maps(recipe: &str, maps: &MapSet) -> Result<(BakedMaps, Means), StepError> {
    let mut out = BakedMaps { material_name: recipe.into(), ..BakedMaps::default() };
    let mut means = Vec::new();
    let mut add = |name: &str, usage, texture: &Texture, encoding| -> Result<(), StepError> {
        let pixels = quantise(texture, encoding, SampleType::U8)?;
        out.images.push(image(usage, name, &pixels, encoding)?);
        means.push((name.to_string(), mean(texture)));
        Ok(())
    };
    let get = |kind| maps.get(kind);
    let mut alpha = AlphaMode::Opaque;
    if let Some(color) = get(MapKind::BaseColor) {
        match get(MapKind::Opacity) {
            None => add("base_color", Use::BaseColor, color, Encoding::Color)?,
            Some(opacity) => {
                let both = color.with_alpha(opacity);
                alpha = alpha_mode(&quantise(&both, Encoding::Color, SampleType::U8)?);
                add("base_color", Use::BaseColor, &both, Encoding::Color)?;
            }
        }
    }
    if let Some(normal) = get(MapKind::Normal) {
        add("normal", Use::Normal, normal, Encoding::Normal)?;
    }
    if let Some(orm) = pack_orm(get(MapKind::Occlusion), get(MapKind::Roughness), get(MapKind::Metallic)) {
        add("orm", orm_use(|kind| get(kind).is_some()), &orm, Encoding::Data)?;
    }
    if let Some(emissive) = get(MapKind::Emissive) {
        add("emissive", Use::Emissive, emissive, Encoding::Color)?;
    }
    out.alpha = alpha;
    Ok((out, means))
}

impl Step for UvSetsGlb {
    super::step_identity!("uv sets glb", 3);

    fn describe(&self, v: &mut dyn Visitor) {
        v.param("name", &self.recipe);
        v.param("weld", &self.weld_texels);
        v.param("triangles", &self.triangles);
        self.scene.describe(v);
    }

    fn run(&self, inputs: &Inputs) -> Result<Vec<u8>, StepError> {
        let document = self.scene.document(inputs)?;
        let first = self.scene.inputs();
        let surface: Surface = super::read(inputs, first)?;
        let prepared: Prepared = super::read(inputs, first + 1)?;
        let synthesised: Synthesised = super::read(inputs, first + 2)?;
        let source = Source::read(inputs, first + 3)?;
        let (mut images, means) = sample_maps(&self.recipe, source.first())?;
        images.repeats = source.is_tile();
        let mean_color = source.first().get(MapKind::BaseColor).map(|t| {
            let m = mean(t);
            [m[0], m[1], m[2]]
        });
        let tile = format!("{}.tile.ktx2", self.recipe);
        let material_space = source.is_tile().then_some(MaterialSpace {
            values: &synthesised.sets.material,
            layers: source.layers().len() as u32,
            tile: &tile,
        });
        let output = UvSetOutput {
            weld_texels: self.weld_texels as f32,
            maps: &images,
            mean_color,
            means: &means,
            repeat_weights_in_uv: false,
            triangles: self.triangles,
            material_space,
            edge_metric: &synthesised.metric,
        };
        Ok(write_uv_sets(&document, &surface, &prepared.mesh, &synthesised.sets, &output)?)
    }
}
