//! Step: bake every map of the sample onto the atlas and quantise it as its file will hold it.

use std::collections::BTreeMap;

use crate::bake::{self, Atlas, Coverage, Filter, bake_map, bake_tile, pack_orm, seam_error, tangents};
use crate::build::{Inputs, Step, StepError, Visitor};
use crate::io::artefact::{Artefact, Damaged, Reader, Writer};
use crate::io::image_quantise::{Encoding, quantise};
use crate::io::{Pixels, SampleType};
use crate::mesh::Surface;
use crate::recipe::MapFile;
use crate::texture::{MapKind, MapSet, Texture};

use super::material_space::Source;
use super::prepare::Prepared;
use super::refine_atlas::RefinedAtlas;
use super::synthesise::Synthesised;

/// Name in a bundle of the packed map that glTF wants where the recipe asks for single ones.
pub(super) const GLTF_ORM: &str = "gltf orm";

/// Finished images by name, and what was measured on the way.
pub(super) struct Bundle {
    pub images: BTreeMap<String, Pixels>,
    /// Figures of quality by name, such as `seam_mip0`.
    pub figures: BTreeMap<String, f64>,
}

impl Bundle {
    /// The image of a name.
    pub fn get(&self, name: &str) -> Result<&Pixels, StepError> {
        self.images.get(name).ok_or_else(|| format!("no image `{name}` was made").into())
    }
}

impl Artefact for Bundle {
    const TAG: [u8; 4] = *b"bndl";

    fn write(&self, to: &mut Writer) {
        to.put(self.images.len() as u32);
        for (name, pixels) in &self.images {
            to.text(name);
            pixels.write(to);
        }
        to.put(self.figures.len() as u32);
        for (name, figure) in &self.figures {
            to.text(name);
            to.put(*figure);
        }
    }

    fn read(from: &mut Reader<'_>) -> Result<Self, Damaged> {
        let n = from.get::<u32>()?;
        let images = (0..n).map(|_| Ok((from.text()?, Pixels::read(from)?))).collect::<Result<_, Damaged>>()?;
        let n = from.get::<u32>()?;
        let figures = (0..n).map(|_| Ok((from.text()?, from.get()?))).collect::<Result<_, Damaged>>()?;
        Ok(Bundle { images, figures })
    }
}

/// An image to be made: which maps it holds, and its samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct ImageSpec {
    pub file: MapFile,
    pub depth: SampleType,
}

/// The encoding of a file's channels.
pub(super) fn encoding(file: MapFile) -> Encoding {
    match file {
        MapFile::Orm => Encoding::Data,
        other => Encoding::of(other.kinds()[0]),
    }
}

/// Makes the images of a recipe out of single maps that `bake` yields.
///
/// Base colour carries the opacity as alpha where the sample has one. A packed map for glTF is added where single ones
/// are wanted. Maps that the sample lacks are an error of the recipe and were refused before.
pub(super) fn images(
    specs: &[ImageSpec],
    maps: &MapSet,
    for_gltf: bool,
    mut bake: impl FnMut(MapKind, &Texture) -> Result<Texture, StepError>,
) -> Result<Bundle, StepError> {
    let mut done: BTreeMap<MapKind, Texture> = BTreeMap::new();
    let mut get = |kind: MapKind| -> Result<Option<Texture>, StepError> {
        if let Some(t) = done.get(&kind) {
            return Ok(Some(t.clone()));
        }
        let Some(source) = maps.get(kind) else { return Ok(None) };
        let t = bake(kind, source)?;
        // Maps that go into one image only are not kept.
        if matches!(kind, MapKind::Occlusion | MapKind::Roughness | MapKind::Metallic | MapKind::Opacity) {
            done.insert(kind, t.clone());
        }
        Ok(Some(t))
    };
    let mut bundle = BTreeMap::new();
    for spec in specs {
        let texture = match spec.file {
            MapFile::Orm => {
                let [o, r, m] = [get(MapKind::Occlusion)?, get(MapKind::Roughness)?, get(MapKind::Metallic)?];
                pack_orm(o.as_ref(), r.as_ref(), m.as_ref())
            }
            MapFile::BaseColor => match (get(MapKind::BaseColor)?, get(MapKind::Opacity)?) {
                (Some(color), Some(alpha)) => Some(color.with_alpha(&alpha)),
                (color, _) => color,
            },
            file => get(file.kinds()[0])?,
        };
        let name = crate::recipe::Word::name(spec.file);
        let texture = texture.ok_or_else(|| format!("the exemplar has no {name} map"))?;
        bundle.insert(name.to_string(), quantise(&texture, encoding(spec.file), spec.depth)?);
    }
    if for_gltf && specs.iter().all(|s| s.file != MapFile::Orm) {
        let single = |k: MapFile| specs.iter().any(|s| s.file == k);
        let mut pick = |file: MapFile, kind| if single(file) { get(kind) } else { Ok(None) };
        let o = pick(MapFile::Occlusion, MapKind::Occlusion)?;
        let r = pick(MapFile::Roughness, MapKind::Roughness)?;
        let m = pick(MapFile::Metallic, MapKind::Metallic)?;
        if let Some(orm) = pack_orm(o.as_ref(), r.as_ref(), m.as_ref()) {
            bundle.insert(GLTF_ORM.to_string(), quantise(&orm, Encoding::Data, SampleType::U8)?);
        }
    }
    Ok(Bundle { images: bundle, figures: BTreeMap::new() })
}

/// Reads surface, synthesis mesh, corner coordinates, atlas, the maps or the tile, and what corrected the atlas if
/// anything did.
pub(super) struct Rasterise {
    pub recipe: String,
    pub images: Vec<ImageSpec>,
    pub gutter_px: u32,
    /// How the sample is interpolated where it is magnified.
    pub filter: Filter,
    /// Side of the page in texels, as far as it is known, for the estimate of memory; not a parameter.
    pub side: u32,
}

/// Bytes per texel of the page, and further ones for each image: measured on pages of 2048 and 4096 (one image 40 to 48 in
/// all, three 116 to 125).
const PAGE_BYTES: u64 = 16;
const IMAGE_BYTES: u64 = 36;

impl Step for Rasterise {
    super::step_identity!("rasterise", 3, travels);

    fn describe(&self, v: &mut dyn Visitor) {
        v.param("images", &self.images);
        v.param("gutter", &self.gutter_px);
        v.param("filter", &self.filter);
    }

    fn memory(&self, inputs: &[u64]) -> u64 {
        let texels = u64::from(self.side).pow(2);
        texels * (PAGE_BYTES + IMAGE_BYTES * self.images.len() as u64) + 4 * inputs.iter().sum::<u64>()
    }

    fn run(&self, inputs: &Inputs) -> Result<Vec<u8>, StepError> {
        let surface: Surface = super::read(inputs, 0)?;
        let prepared: Prepared = super::read(inputs, 1)?;
        let synthesised: Synthesised = super::read(inputs, 2)?;
        let atlas: Atlas = super::read(inputs, 3)?;
        let source = Source::read(inputs, 4)?;
        let refined: Option<RefinedAtlas> = (inputs.len() > 5).then(|| super::read(inputs, 5)).transpose()?;
        let tangents = tangents(&surface, &atlas);
        let coverage = Coverage::new(&surface, &prepared.mesh, &atlas, &tangents, self.gutter_px)?;
        let shared = bake::Inputs {
            surface: &surface,
            synthesis: &prepared.mesh,
            atlas: &atlas,
            coverage: &coverage,
            tangents: &tangents,
            sets: &synthesised.sets,
            sources: refined.as_ref().map(|r| &r.sources),
            filter: self.filter,
        };
        let mut figures = BTreeMap::new();
        let mut bundle = images(&self.images, source.first(), true, |kind, map| {
            let baked = match &source {
                Source::Exemplar(_) => bake_map(&shared, kind, map)?,
                Source::Tile(made) => {
                    let layers: Vec<&Texture> = made.tile.layers().iter().filter_map(|maps| maps.get(kind)).collect();
                    bake_tile(&shared, kind, &layers)?
                }
            };
            if kind == MapKind::BaseColor {
                for mip in 0..4 {
                    figures.insert(format!("seam_mip{mip}"), seam_error(&surface, &atlas, kind, &baked, mip).mean);
                }
            }
            Ok(baked)
        })?;
        bundle.figures = figures;
        Ok(bundle.to_bytes())
    }
}
