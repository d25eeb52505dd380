//! A textured mesh becomes steps, its levels of detail too: surface, field, what is laid along it, atlas, UV sets and views.

use std::collections::BTreeMap;
use std::path::Path;

use crate::bake::{Extent, Filter, Library, UnwrapParams, default_gutter_px};
use crate::build::{InputId, StepId};
use crate::exemplar::{AnalysisParams, TextonFeatures, TextonParams};
use crate::field::{
    Alignment, OrientationConstraint, ScalarConstraint, SingularityConstraint, SingularityKind, Symmetry,
};
use crate::io::gltf::TriangleOrder;
use crate::recipe::{self, FileRef, MeshBake};
use crate::synth::mesh::walk::VertexWalkParams;
use crate::synth::quilt::QuiltParams;
use crate::texture::MapKind;
use crate::uvset::Blend;

use super::super::field::{LayAreas, LayField};
use super::super::glb::{AtlasGlb, UvSetsGlb};
use super::super::lod::TakeFromFinest;
use super::super::prepare::{Prepare, Scale};
use super::super::rasterise::Rasterise;
use super::super::refine_atlas::RefineAtlas;
use super::super::render::{RenderField, RenderSingularities, RenderView};
use super::super::report::Report;
use super::super::surface::{ReadSurface, SceneFiles};
use super::super::synthesise::{Order, Synthesise};
use super::super::texton::AnalyseTextons;
use super::super::texton_quilt::{BlendMesh, BlendParams, BlendSets, QuiltFaces};
use super::super::tile::ReportTile;
use super::super::unwrap::{Layout, Unwrap};
use super::tile::without_areas;
use super::{PlanError, Planner, image_spec};

impl Planner<'_, '_> {
    /// The scene's files as inputs.
    pub(super) fn scene(&mut self, file: &FileRef, bake: &MeshBake) -> Result<Scene, PlanError> {
        let FileRef { key, path, place, .. } = file;
        let fail = |why: String| PlanError(format!("{}: {why} (named as {key} in {place})", path.display()));
        let mut uris = self.scenes.files(path).map_err(fail)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        // A picture that is not there matters only if its material is kept; the reader says so then.
        let (disk, absent) = (self.disk, &mut self.planned.absent);
        uris.retain(|uri| {
            let path = folder.join(uri);
            let there = !is_picture(uri) || matches!(disk.stamp(&path), Ok(Some(_)));
            absent.extend((!there).then_some(path));
            there
        });
        if let Some(gone) = uris.iter().find(|uri| matches!(self.disk.stamp(&folder.join(uri)), Ok(None))) {
            return Err(fail(format!("it refers to `{gone}`, and there is no such file beside it")));
        }
        let mut inputs = vec![self.graph.add_file(path)];
        inputs.extend(uris.iter().map(|uri| self.graph.add_file(folder.join(uri))));
        Ok((SceneFiles { uris, materials: bake.materials.clone() }, inputs))
    }

    /// A textured mesh and its simplifications: the finest is synthesised, the others take from it.
    pub(super) fn mesh(&mut self, bake: &MeshBake, scenes: Vec<Scene>) {
        let textons = self.recipe.analysis.textons;
        let keys = self.recipe.analysis.tile.clone();
        let tile = keys.as_ref().map(|keys| self.tile(keys));
        if let (Some(tile), None, None, true) = (tile, &bake.atlas, &bake.uv_sets, bake.renders.is_empty()) {
            let report = self.step(ReportTile { recipe: self.name() }, &[tile.into()]);
            self.output(report, "report.json");
            return;
        }
        // A tile is both what is looked up and what is known of it.
        let (maps, analyse) = match (tile, textons) {
            (Some(tile), _) => (tile, tile),
            (None, textons) => {
                let samples = self.recipe.exemplar.samples();
                let maps = self.maps(0, &samples[0]);
                let analyse = match textons {
                    None => self.analyse(maps, false),
                    Some(textons) => self.analyse_textons(maps, &textons),
                };
                (maps, analyse)
            }
        };
        let max_factor = bake.field.scale.iter().fold(1.0, |m: f64, c| m.max(c.factor));
        // The published method takes triangles as they are, as long as there is room for a choice of places.
        let max_span_share = match textons {
            _ if keys.is_some() => Some(PERIOD_SHARE),
            Some(_) if self.recipe.synthesis.refine == 0 => Some(0.25),
            _ => None,
        };
        let mut finest = None;
        for (level, scene) in scenes.into_iter().enumerate() {
            let name = if level == 0 { self.name() } else { format!("{}.lod{level}", self.recipe.name) };
            let surface = self.step(ReadSurface { recipe: name.clone(), scene: scene.0.clone() }, &scene.1);
            let mut inputs = vec![surface.into(), maps.into()];
            inputs.extend(finest.map(|(prepare, _)| InputId::from(prepare)));
            let scale = match (bake.scale, finest) {
                (_, Some(_)) => Scale::Same,
                (recipe::Scale::TexelsPerUnit(s), None) => Scale::Fixed(s),
                (recipe::Scale::Auto, None) => Scale::Auto,
            };
            let prepare = self.step(Prepare { recipe: name.clone(), scale, max_factor, max_span_share }, &inputs);
            let laid = match finest {
                None => self.synthesise(bake, [prepare, analyse, maps]),
                Some((finest, synthesised)) => {
                    let inputs = [finest, synthesised, prepare].map(InputId::from);
                    let synthesise = self.step(TakeFromFinest { recipe: name.clone() }, &inputs);
                    LaidOut { prepare, synthesise, field: vec![], coordinates: vec![] }
                }
            };
            finest = finest.or(Some((laid.prepare, laid.synthesise)));
            self.level(bake, name, scene, Level { maps, analyse, surface, laid });
        }
    }

    /// The field and what is laid along it; of synthesis mesh, analysis and maps.
    fn synthesise(&mut self, bake: &MeshBake, [prepare, analyse, maps]: [StepId; 3]) -> LaidOut {
        let recipe = self.name();
        let keys = self.recipe.analysis.tile.clone();
        let (laid, symmetry) = lay_field(&recipe, &bake.field);
        let everywhere = without_areas(&bake.field);
        // In material space what acts nearby is solved for itself, from the field of all else.
        let areas = keys.is_some() && everywhere != bake.field;
        let field = match areas {
            false => vec![self.step(laid, &[prepare.into()])],
            true => {
                let without = self.step(lay_field(&recipe, &everywhere).0, &[prepare.into()]);
                vec![without, self.step(LayAreas(laid), &[prepare, without].map(InputId::from))]
            }
        };
        let importance: BTreeMap<_, _> = self.recipe.exemplar.importance.iter().copied().collect();
        let order = match bake.order {
            recipe::WalkOrder::RegionGrowing => Order::RegionGrowing,
            recipe::WalkOrder::RenderingSequence => Order::RenderingSequence,
        };
        let inputs = [prepare, field[0], analyse, maps];
        let mut coordinates = vec![];
        let (prepare, synthesise) = match (&keys, self.recipe.analysis.textons) {
            (Some(keys), _) => {
                let (placed, laid) = self.place_in_tile(keys, &bake.field, prepare, &field);
                coordinates = laid;
                (prepare, placed)
            }
            (None, None) => (prepare, self.walk_vertices(bake.sharpness, order, symmetry, importance, inputs)),
            (None, Some(textons)) => self.quilt_faces(&textons, symmetry, importance, inputs),
        };
        LaidOut { prepare, synthesise, field, coordinates }
    }

    /// What comes out of one level of detail.
    fn level(&mut self, bake: &MeshBake, recipe: String, (scene, files): Scene, level: Level) {
        let Level { maps, analyse, surface, laid } = level;
        let LaidOut { prepare, synthesise, field, coordinates } = laid;
        let coordinates: Vec<InputId> = coordinates.into_iter().map(InputId::from).collect();
        let mut atlas_steps = None;
        if let Some(atlas) = &bake.atlas {
            let (layout, gutter_px) = layout(atlas);
            let unwrap = self.step(Unwrap { recipe: recipe.clone(), layout }, &[surface.into()]);
            let images = atlas.maps.iter().map(image_spec).collect();
            let mut inputs = [surface, prepare, synthesise, unwrap, maps].map(InputId::from).to_vec();
            let side = side(atlas);
            if atlas.refine > 0 {
                // Textons know of each texel only some that look alike, a jump map the most alike.
                let jumps = match self.recipe.analysis.textons {
                    None => analyse,
                    Some(_) => self.analyse(maps, false),
                };
                let importance = self.recipe.exemplar.importance.iter().copied().collect();
                let refine = RefineAtlas { recipe: recipe.clone(), passes: atlas.refine, importance, side };
                let of = [surface, prepare, synthesise, unwrap, jumps, maps].map(InputId::from);
                inputs.push(self.step(refine, &of).into());
            }
            let bundle = self.step(
                Rasterise { recipe: recipe.clone(), images, gutter_px, filter: filter(atlas.filter), side },
                &inputs,
            );
            self.encode(&recipe, &atlas.maps, atlas.compression, bundle, None);
            let glb = AtlasGlb { recipe: recipe.clone(), scene: scene.clone() };
            let inputs = [&files[..], &[surface, unwrap, bundle].map(InputId::from)].concat();
            let glb = self.step(glb, &inputs);
            self.output(glb, &format!("{recipe}.glb"));
            atlas_steps = Some((unwrap, bundle));
        }
        if let Some(uv_sets) = &bake.uv_sets {
            let triangles = match bake.order {
                recipe::WalkOrder::RegionGrowing => TriangleOrder::Input,
                recipe::WalkOrder::RenderingSequence => TriangleOrder::Cache,
            };
            let glb = UvSetsGlb { recipe: recipe.clone(), scene, weld_texels: uv_sets.weld, triangles };
            let inputs = [&files[..], &[surface, prepare, synthesise, maps].map(InputId::from)].concat();
            let glb = self.step(glb, &inputs);
            self.output(glb, &format!("{recipe}.uvsets.glb"));
        }
        let mut inputs = [surface, prepare, synthesise, maps].map(InputId::from).to_vec();
        inputs.extend(atlas_steps.iter().flat_map(|(unwrap, bundle)| [InputId::from(*unwrap), InputId::from(*bundle)]));
        // `name` for the finest, `name.lod1` for the first simplification.
        let suffix = recipe.strip_prefix(&self.recipe.name).unwrap_or_default().to_string();
        for view in &bake.renders {
            let (recipe, view) = (recipe.clone(), view.clone());
            let path = format!("render/{}{suffix}.png", view.name);
            let of_field: Vec<InputId> = [surface, prepare].iter().chain(&field).map(|s| InputId::from(*s)).collect();
            let render = match view.shading {
                // Levels of detail have no field of their own.
                recipe::Shading::Field | recipe::Shading::Singularities if field.is_empty() => continue,
                recipe::Shading::Field => self.step(RenderField { recipe, view }, &of_field),
                // Refused without a tile.
                recipe::Shading::Singularities => {
                    let inputs = [&of_field[..], &coordinates].concat();
                    self.step(RenderSingularities { recipe, view }, &inputs)
                }
                _ => self.step(RenderView { recipe, view }, &inputs),
            };
            self.output(render, &path);
        }
        inputs[3] = analyse.into();
        inputs.splice(4..4, field.iter().map(|s| InputId::from(*s)));
        inputs.extend(coordinates);
        let report = self.step(Report { recipe, has_field: !field.is_empty() }, &inputs);
        self.output(report, &format!("report{suffix}.json"));
    }

    /// Analyses the sample into textons.
    fn analyse_textons(&mut self, maps: StepId, from: &recipe::Textons) -> StepId {
        let AnalysisParams { importance, wrap, .. } = self.analysis();
        // The others belong to the quilt.
        let recipe::Textons { window, count, features, rotations, candidates: _, blend_threshold: _ } = *from;
        let features = match features {
            recipe::TextonFeatures::Window => TextonFeatures::Window,
            recipe::TextonFeatures::FilterBank => TextonFeatures::FilterBank,
        };
        let params = TextonParams { window, count, features, rotations, importance, wrap };
        self.step(AnalyseTextons { recipe: self.name(), params }, &[maps.into()])
    }

    /// Walks the vertices; of synthesis mesh, field, jump map and maps.
    fn walk_vertices(
        &mut self,
        sharpness: u32,
        order: Order,
        symmetry: Symmetry,
        importance: BTreeMap<MapKind, f64>,
        inputs: [StepId; 4],
    ) -> StepId {
        let recipe::Synthesis { seed, patch, refine, blend } = self.recipe.synthesis;
        let walk = VertexWalkParams { patch, seed, ..VertexWalkParams::default() };
        let blend = uv_blend(blend);
        let synthesise =
            Synthesise { recipe: self.name(), walk, symmetry, order, blend, sharpness, refine, importance };
        self.step(synthesise, &inputs.map(InputId::from))
    }

    /// Quilts the faces and blends their edges; of synthesis mesh, field, textons and maps. Gives the mesh with divided
    /// faces, in the place of the prepared one, and what lies on it.
    fn quilt_faces(
        &mut self,
        from: &recipe::Textons,
        symmetry: Symmetry,
        importance: BTreeMap<MapKind, f64>,
        [prepare, field, analyse, maps]: [StepId; 4],
    ) -> (StepId, StepId) {
        let recipe::Synthesis { seed, patch, refine, blend } = self.recipe.synthesis;
        let params = QuiltParams { seed, candidates: from.candidates, refine, reach: patch * PIECE_REACH };
        let quilt = QuiltFaces { recipe: self.name(), params, symmetry, importance: importance.clone() };
        let quilt = self.step(quilt, &[prepare, field, analyse, maps].map(InputId::from));
        let blend = uv_blend(blend);
        let params = BlendParams { symmetry, blend, threshold: from.blend_threshold, importance };
        let inputs = [prepare, field, quilt, maps].map(InputId::from);
        let mesh = self.step(BlendMesh { recipe: self.name(), params: params.clone() }, &inputs);
        let sets = self.step(BlendSets { recipe: self.name(), params }, &inputs);
        (mesh, sets)
    }
}

/// How far a piece of a quilt reaches around its first triangle, in exemplar sides, where `patch` is 1.
const PIECE_REACH: f64 = 0.0625;

/// Part of a tile's side that an edge may take: half as many triangles are shown by three look-ups as at a half.
const PERIOD_SHARE: f64 = 0.125;

/// A scene's files, and they as inputs.
type Scene = (SceneFiles, Vec<InputId>);

/// The steps that the outputs of a level are made from.
struct Level {
    maps: StepId,
    analyse: StepId,
    surface: StepId,
    laid: LaidOut,
}

/// The mesh on which a result lies, the result, and what it followed.
struct LaidOut {
    prepare: StepId,
    synthesise: StepId,
    /// None, the field, or that without what acts nearby and its change.
    field: Vec<StepId>,
    /// Periodic coordinates, of a tile's bake, and perhaps their change.
    coordinates: Vec<StepId>,
}

fn uv_blend(blend: recipe::Blend) -> Blend {
    match blend {
        recipe::Blend::Linear => Blend::Linear,
        recipe::Blend::Variance => Blend::Variance,
        recipe::Blend::None => Blend::Nearest,
    }
}

fn filter(filter: recipe::AtlasFilter) -> Filter {
    match filter {
        recipe::AtlasFilter::Linear => Filter::Linear,
        recipe::AtlasFilter::Cubic => Filter::Cubic,
    }
}

fn is_picture(uri: &str) -> bool {
    let lower = uri.to_ascii_lowercase();
    [".png", ".jpg", ".jpeg", ".webp", ".ktx2", ".dds", ".avif"].iter().any(|ext| lower.ends_with(ext))
}

/// Side of the page in texels; a guess where the layout decides.
fn side(atlas: &recipe::Atlas) -> u32 {
    match atlas.size {
        recipe::AtlasSize::Side(side) => side,
        recipe::AtlasSize::TexelsPerUnit(_) => 1024,
    }
}

fn layout(atlas: &recipe::Atlas) -> (Layout, u32) {
    let side = side(atlas);
    let extent = match atlas.size {
        recipe::AtlasSize::Side(side) => Extent::Page(side),
        recipe::AtlasSize::TexelsPerUnit(density) => Extent::TexelsPerUnit(density),
    };
    // Without mip levels nothing looks further than the next texel.
    let enough = if atlas.mips { default_gutter_px(side) } else { 2 };
    let gutter_px = atlas.gutter.unwrap_or(enough);
    let layout = match atlas.layout {
        recipe::Layout::KeepUv => Layout::Keep { set: 0, size: side },
        recipe::Layout::Unwrap(library) => {
            let library = match library {
                recipe::Unwrap::Uvunwrap => Library::Uvunwrap,
                recipe::Unwrap::Xatlas => Library::Xatlas,
            };
            Layout::New(UnwrapParams { extent, gutter_px, library })
        }
    };
    (layout, gutter_px)
}

fn lay_field(recipe: &str, from: &recipe::Field) -> (LayField, Symmetry) {
    // The material axis is no part of the field.
    let recipe::Field { symmetry, orientation, singularities, align: lines, scale, material: _ } = from;
    let symmetry = match symmetry {
        recipe::Symmetry::One => Symmetry::One,
        recipe::Symmetry::Two => Symmetry::Two,
        recipe::Symmetry::Four => Symmetry::Four,
        recipe::Symmetry::Isotropic => Symmetry::Isotropic,
    };
    let anchor = |&recipe::Orientation { at, up, radius }: &_| OrientationConstraint { at, up, radius };
    let singular = |&recipe::Singularity { at, kind, radius }: &_| {
        let kind = match kind {
            recipe::Singular::Kind(recipe::SingularityKind::Source) => SingularityKind::Source,
            recipe::Singular::Kind(recipe::SingularityKind::Sink) => SingularityKind::Sink,
            recipe::Singular::Kind(recipe::SingularityKind::Vortex) => SingularityKind::Vortex,
            recipe::Singular::Index(index) => SingularityKind::Index(index),
        };
        SingularityConstraint { at, kind, radius }
    };
    let align = |line: &recipe::AlignTo| match line {
        recipe::AlignTo::Creases => Alignment::Creases,
        recipe::AlignTo::Boundary => Alignment::Boundary,
        recipe::AlignTo::Curvature => Alignment::Curvature,
    };
    let factor = |&recipe::ScalePoint { at, factor, radius }: &_| ScalarConstraint { at, value: factor, radius };
    let field = LayField {
        recipe: recipe.to_string(),
        symmetry,
        orientation: orientation.iter().map(anchor).collect(),
        singularities: singularities.iter().map(singular).collect(),
        align: lines.iter().map(align).collect(),
        scale: scale.iter().map(factor).collect(),
    };
    (field, symmetry)
}
