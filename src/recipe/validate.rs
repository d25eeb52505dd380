//! From what was written to what is meant: the last checks, and the conversion into plain values.
//!
//! In: serde's values of a tree whose shape is right, or as much as was left of it. Every struct is taken apart in
//! full, so that a new key does not compile until it is handled here. What this version can't do yet is refused.
//! Out: a [`Recipe`]; it is only valid if no fault was found on the way.

use super::fault::{Fault, Findings, Source, listing, printable};
use super::limits;
use super::samples;
use super::schema;
use super::tree::Node;
use super::values::*;
use super::words::*;
use crate::numerics::vec::{Vec3, vec3};
use crate::texture::MapKind;
use std::collections::BTreeSet;
use std::path::{Component, Path, PathBuf};

/// What a conversion looks things up in, and where it reports.
pub(super) struct Context<'a> {
    pub tree: &'a Node,
    pub sources: &'a [Source],
    /// Relative paths are relative to this.
    pub folder: &'a Path,
    pub findings: &'a mut Findings,
}

impl Context<'_> {
    pub fn fault(&self, key: &str, message: impl Into<String>) -> Fault {
        Fault::new(self.tree.locate(key), key, message)
    }

    /// Refuses a value that is right but not possible yet.
    fn not_yet(&mut self, key: &str, value: &str, allowed: &str) {
        let fault = self.fault(key, format!("this version of kiln can't do `{key} = {value}` yet"));
        self.findings.push(fault.found(value).allowed(allowed));
    }

    pub fn is_own(&self, key: &str) -> bool {
        self.tree.locate(key).source == self.tree.at.source
    }

    /// A file named by `key`.
    pub fn file(&mut self, key: &str, written: String) -> FileRef {
        if written.chars().any(char::is_control) {
            let fault = self.fault(key, format!("`{key}` has a control character in it: \"{}\"", printable(&written)));
            self.findings.push(fault.found(printable(&written)).allowed("a path"));
        }
        let at = self.tree.locate(key);
        FileRef {
            key: key.into(),
            path: resolve(self.folder, &written),
            written,
            place: self.sources[at.source].place(at.span.start),
        }
    }
}

/// `written` seen from `folder`, with `.` and `..` taken out by name alone.
fn resolve(folder: &Path, written: &str) -> PathBuf {
    let mut out = PathBuf::new();
    for component in folder.join(written).components() {
        match component {
            Component::CurDir => {}
            Component::ParentDir => match out.components().next_back() {
                Some(Component::Normal(_)) => _ = out.pop(),
                Some(Component::RootDir | Component::Prefix(_)) => {}
                _ => out.push(".."),
            },
            other => out.push(other),
        }
    }
    out
}

/// The name of a recipe: the stem of its file, which becomes the name of folders and files.
pub(super) fn name(path: &Path) -> Result<String, String> {
    let stem = path.file_stem().ok_or_else(|| format!("{} names no file", path.display()))?;
    let stem = stem.to_str().ok_or_else(|| format!("the file name of {} is not UTF-8", path.display()))?;
    let is_bad = |c: char| c.is_control() || "<>:\"/\\|?*".contains(c);
    if let Some(c) = stem.chars().find(|&c| is_bad(c)) {
        return Err(format!("a recipe's file name becomes the name of its outputs and can't have {c:?} in it"));
    }
    if stem.starts_with('.') || stem.ends_with(['.', ' ']) {
        return Err(
            "a recipe's file name becomes the name of its outputs and can't begin with a dot or end in one".into()
        );
    }
    Ok(stem.into())
}

/// Converts a whole recipe.
pub(super) fn recipe(name: String, path: PathBuf, from: schema::Recipe, context: &mut Context) -> Recipe {
    let schema::Recipe { kiln: _, mesh, canvas, exemplar, analysis, field, synthesis, atlas, uv_sets, render } = from;
    let exemplar = exemplar_of(exemplar.unwrap_or_default(), context);
    let schema::Synthesis { scale, seed, order, patch, refine, blend, candidates, blend_threshold, sharpness } =
        synthesis;
    let is_canvas = canvas.is_some();
    let has_keys = analysis.method == Method::MaterialSpace;
    let target = match canvas {
        Some(canvas) => {
            if blend == Blend::Variance {
                context.not_yet("synthesis.blend", "\"variance\" on a canvas", "\"linear\" or \"none\"");
            }
            Target::Canvas(canvas_of(canvas, &exemplar, context))
        }
        None => {
            let schema::Mesh { path, materials, lods } = mesh.unwrap_or_default();
            Target::Mesh(MeshBake {
                mesh: mesh_file("mesh.path", path.unwrap_or_default(), context),
                lods: lods_of(lods, context),
                materials: materials.inspect(|names| refuse_twice("mesh.materials", names, context)),
                scale: match scale {
                    schema::Scale::Number(n) => Scale::TexelsPerUnit(n),
                    schema::Scale::Word(schema::Auto::Auto) => Scale::Auto,
                },
                order,
                sharpness,
                field: field_of(field.unwrap_or_default(), has_keys, context),
                atlas: atlas.map(|atlas| atlas_of(atlas, &exemplar, context)),
                uv_sets: uv_sets.map(|schema::UvSets { weld }| UvSets { weld }),
                renders: renders_of(render, analysis.method, context),
            })
        }
    };
    let first = exemplar.samples().swap_remove(0);
    let mut analysis = analysis_of(analysis, (candidates, blend_threshold), is_canvas, context);
    if let Some(tile) = &mut analysis.tile {
        check_tile(tile, &first, context);
    }
    Recipe { name, path, exemplar, analysis, synthesis: Synthesis { seed, patch, refine, blend }, target }
}

fn lods_of(paths: Vec<String>, context: &mut Context) -> Vec<FileRef> {
    refuse_twice("mesh.lods", &paths, context);
    paths.into_iter().enumerate().map(|(i, path)| mesh_file(&format!("mesh.lods[{i}]"), path, context)).collect()
}

fn mesh_file(key: &str, path: String, context: &mut Context) -> FileRef {
    let file = context.file(key, path);
    let extension = file.path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    if !file.written.is_empty() && !["glb", "gltf", "obj"].contains(&extension.as_str()) {
        let found = printable(&file.written);
        let fault = context.fault(key, format!("`{key}` can't be \"{found}\""));
        context.findings.push(fault.found(found).allowed("a .glb, .gltf or .obj file"));
    }
    file
}

fn refuse_twice(key: &str, names: &[impl AsRef<str>], context: &mut Context) {
    let mut seen = BTreeSet::new();
    for (i, name) in names.iter().map(AsRef::as_ref).enumerate() {
        if !seen.insert(name) {
            let message = format!("`{key}` has \"{}\" twice", printable(name));
            let fault = context.fault(&format!("{key}[{i}]"), message);
            context.findings.push(fault.hint("remove one".to_string()));
        }
    }
}

fn exemplar_of(from: schema::Exemplar, context: &mut Context) -> Exemplar {
    let schema::Exemplar {
        base_color,
        frames,
        normal,
        normal_y,
        roughness,
        metallic,
        occlusion,
        height,
        opacity,
        orm,
        emissive,
        feature_mask,
        mask,
        guide,
        more,
        tileable,
        importance,
    } = from;
    let first = schema::Sample {
        base_color,
        normal,
        normal_y,
        roughness,
        metallic,
        occlusion,
        height,
        opacity,
        orm,
        emissive,
        feature_mask,
        mask,
        guide,
    };
    let first = samples::sample_of("exemplar", first, frames, context);
    let number = |(i, sample)| samples::sample_of(&format!("exemplar.more[{i}]"), sample, None, context);
    let more: Vec<Sample> = more.into_iter().enumerate().map(number).collect();
    samples::check_alike("exemplar.more", &first, &more, context);
    let kinds = first.kinds();
    let importance = match importance {
        Some(weights) => importance_of(weights, &kinds, context),
        None => default_importance(&kinds),
    };
    if tileable && !more.is_empty() {
        let fault = context.fault("exemplar.tileable", "an exemplar that wraps is one sample, and here are more");
        context.findings.push(fault.hint("remove `tileable` or [[exemplar.more]]".to_string()));
    }
    let Sample { maps, feature_mask, normal_y, mask, guide } = first;
    Exemplar { maps, feature_mask, tileable, normal_y, mask, guide, more, importance }
}

/// The maps that say most about what goes where; where there is none of them, all.
fn default_importance(kinds: &[MapKind]) -> Vec<(MapKind, f64)> {
    let telling = |kind: &&MapKind| matches!(kind, MapKind::BaseColor | MapKind::Height | MapKind::FeatureMask);
    let main: Vec<_> = kinds.iter().filter(telling).map(|&kind| (kind, 1.0)).collect();
    if main.iter().any(|(kind, _)| *kind != MapKind::FeatureMask) {
        main
    } else {
        kinds.iter().map(|&kind| (kind, 1.0)).collect()
    }
}

fn importance_of(from: schema::Importance, kinds: &[MapKind], context: &mut Context) -> Vec<(MapKind, f64)> {
    const KEY: &str = "exemplar.importance";
    let schema::Importance {
        base_color,
        normal,
        roughness,
        metallic,
        occlusion,
        height,
        opacity,
        emissive,
        feature_mask,
    } = from;
    let mut out = Vec::new();
    for (kind, weight) in [
        (MapKind::BaseColor, base_color),
        (MapKind::Normal, normal),
        (MapKind::Roughness, roughness),
        (MapKind::Metallic, metallic),
        (MapKind::Occlusion, occlusion),
        (MapKind::Height, height),
        (MapKind::Emissive, emissive),
        (MapKind::Opacity, opacity),
        (MapKind::FeatureMask, feature_mask),
    ] {
        let key = format!("{KEY}.{}", kind.name());
        match weight {
            Some(weight) if kinds.contains(&kind) => out.push((kind, weight)),
            // A default may weigh maps that only other exemplars have.
            Some(_) if !kinds.is_empty() && context.is_own(&key) => {
                let message = format!("`{key}` weighs a map that the exemplar does not have");
                let names: Vec<&str> = kinds.iter().map(|kind| kind.name()).collect();
                let fault = context.fault(&key, message).found(kind.name()).allowed(listing(&names, "`", "or"));
                let files = [format!("exemplar.{}", kind.name()), "exemplar.orm".into()];
                context.findings.push_unless_due_to(&files.each_ref().map(String::as_str), fault);
            }
            _ => {}
        }
    }
    out.retain(|(_, weight)| *weight > 0.0);
    if out.is_empty() && context.findings.is_empty() {
        if !context.is_own(KEY) {
            return default_importance(kinds);
        }
        let fault = context.fault(KEY, format!("`{KEY}` gives no map any weight"));
        context.findings.push(fault.allowed("at least one weight above 0"));
    }
    out
}

/// `quilt` are the keys of `[synthesis]` that only textons read: candidates and threshold.
fn analysis_of(from: schema::Analysis, quilt: (u32, f64), is_canvas: bool, context: &mut Context) -> Analysis {
    let schema::Analysis {
        method,
        neighbourhoods,
        jumps,
        variance,
        alpha,
        diversity,
        min_distance,
        window,
        count,
        features,
        rotations,
        layers,
        key,
        tile,
    } = from;
    if is_canvas && method != Method::JumpMap {
        let why = match method {
            Method::Texton => "textons are quilted over the faces of a mesh, and a canvas has none",
            _ => "a tile of material space is laid over a mesh, and a canvas is none",
        };
        let fault = context.fault("analysis.method", why);
        context.findings.push(fault.found(format!("\"{}\"", method.name())).allowed("\"jump-map\""));
    }
    let key_of = |(i, key)| samples::sample_of(&format!("analysis.key[{i}]"), key, None, context);
    let keys: Vec<Sample> = key.into_iter().enumerate().map(key_of).collect();
    let tile = (method == Method::MaterialSpace).then_some(TileKeys { layers, keys, shape: tile });
    let count = match count {
        schema::Count::Number(n) => Some(n),
        schema::Count::Word(schema::Auto::Auto) => None,
    };
    let (candidates, blend_threshold) = quilt;
    let textons = Textons { window, count, features, rotations, candidates, blend_threshold };
    let textons = (method == Method::Texton).then_some(textons);
    Analysis { neighbourhoods, jumps, variance, alpha, diversity, min_distance, textons, tile }
}

/// Checks the keys of a tile against the first, and that there is a layer for each.
fn check_tile(tile: &TileKeys, first: &Sample, context: &mut Context) {
    samples::check_alike("analysis.key", first, &tile.keys, context);
    let count = tile.keys.len() as u32 + 1;
    if tile.layers < count {
        let key = "analysis.layers";
        let fault = context.fault(key, format!("{} layers are too few for {count} keys", tile.layers));
        let allowed = format!("at least {count}: [exemplar] and each [[analysis.key]] is a layer");
        context.findings.push(fault.found(tile.layers.to_string()).allowed(allowed));
    }
}

fn field_of(from: schema::Field, has_keys: bool, context: &mut Context) -> Field {
    let schema::Field { symmetry, orientation, singularities, align, scale, material } = from;
    refuse_twice("field.align", &align.iter().map(|line| line.name()).collect::<Vec<_>>(), context);
    let value_of = |(i, schema::MaterialPoint { at, value, radius }): (usize, _)| {
        let value = value.unwrap_or(0.0);
        // Of one exemplar the material axis is 0 everywhere; saying so is no mistake.
        if value != 0.0 && !has_keys {
            let key = format!("field.material[{i}].value");
            let fault = context.fault(&key, format!("`{key}` is a place between the keys of a tile"));
            let allowed = "0, the only exemplar, or `analysis.method = \"material-space\"`";
            context.findings.push(fault.found(format!("{value:?}")).allowed(allowed));
        }
        MaterialPoint { at: point(at), value, radius }
    };
    let material: Vec<MaterialPoint> = material.into_iter().enumerate().map(value_of).collect();
    let (symmetry, ways) = match symmetry {
        schema::Symmetry::Ways(2) => (Symmetry::Two, 2),
        schema::Symmetry::Ways(4) => (Symmetry::Four, 4),
        schema::Symmetry::Ways(_) => (Symmetry::One, 1),
        schema::Symmetry::Word(schema::Isotropic::Isotropic) => (Symmetry::Isotropic, 1),
    };
    Field {
        symmetry,
        align,
        orientation: orientation
            .into_iter()
            .enumerate()
            .map(|(i, schema::Orientation { at, up, radius })| Orientation {
                at: point(at),
                up: direction(&format!("field.orientation[{i}].up"), up, context),
                radius,
            })
            .collect(),
        singularities: singularities
            .into_iter()
            .enumerate()
            .map(|(i, schema::Singularity { at, kind, index, radius })| {
                let kind = match (kind, index) {
                    (None, Some(index)) => Singular::Index(index_of(i, index, ways, context)),
                    (kind, _) => Singular::Kind(kind.unwrap_or(SingularityKind::Source)),
                };
                Singularity { at: point(at), kind, radius }
            })
            .collect(),
        scale: scale
            .into_iter()
            .map(|schema::ScalePoint { at, factor, radius }| ScalePoint {
                at: point(at),
                factor: factor.unwrap_or(1.0),
                radius,
            })
            .collect(),
        material: if has_keys { material } else { Vec::new() },
    }
}

/// An index that a field of so many equivalent directions can have.
fn index_of(i: usize, index: f64, ways: u32, context: &mut Context) -> f64 {
    let turns = index * f64::from(ways);
    if turns == 0.0 || turns != turns.round() {
        let key = format!("field.singularities[{i}].index");
        let fault = context.fault(&key, format!("`{key}` can't be {index:?} where `field.symmetry` is {ways}"));
        let step = if ways == 1 { "a whole number".into() } else { format!("a multiple of 1/{ways}") };
        let fault = fault.found(format!("{index:?}")).allowed(format!("{step} other than 0"));
        context.findings.push_unless_due_to(&["field.symmetry"], fault);
    }
    index
}

fn point(at: Option<[f64; 3]>) -> Vec3 {
    let [x, y, z] = at.unwrap_or_default();
    vec3(x, y, z)
}

fn direction(key: &str, up: Option<[f64; 3]>, context: &mut Context) -> Vec3 {
    let Some([x, y, z]) = up else { return vec3(0.0, 1.0, 0.0) };
    // Divided by the largest component first, so that squares of tiny ones do not vanish.
    let largest = x.abs().max(y.abs()).max(z.abs());
    if largest < f64::MIN_POSITIVE {
        let fault = context.fault(key, format!("`{key}` has no direction"));
        context.findings.push(fault.found("[0, 0, 0]").allowed("at least one component other than 0"));
        return vec3(0.0, 1.0, 0.0);
    }
    let (x, y, z) = (x / largest, y / largest, z / largest);
    let length = (x * x + y * y + z * z).sqrt();
    vec3(x / length, y / length, z / length)
}

fn canvas_of(from: schema::Canvas, exemplar: &Exemplar, context: &mut Context) -> Canvas {
    let schema::Canvas {
        size,
        tileable,
        frames,
        looped,
        order,
        guide,
        guide_weight,
        inpaint,
        sources,
        blend_kernel,
        maps,
        format,
        compression,
        debug,
    } = from;
    let guide = samples::guide_of(guide, guide_weight, exemplar, context);
    let inpaint = inpaint.map(|written| context.file("canvas.inpaint", written));
    let sources = sources.map(|written| context.file("canvas.sources", written));
    let [width, height] = size.unwrap_or([1, 1]);
    let area = u64::from(width) * u64::from(height);
    let is_flipbook = exemplar.maps.iter().any(|map| map.file.key == "exemplar.frames");
    for (key, written) in [("canvas.frames", frames.is_some()), ("canvas.loop", looped)] {
        if written && !is_flipbook && !exemplar.maps.is_empty() && context.is_own(key) {
            let hint = "name the exemplar's frames: [exemplar] frames = \"smoke_%04d.png\"".to_string();
            let fault = context.fault(key, format!("`{key}` is for flipbooks, and the exemplar is a still")).hint(hint);
            context.findings.push_unless_due_to(&["exemplar.frames"], fault);
        }
    }
    let texels = area.saturating_mul(u64::from(frames.unwrap_or(1)));
    if is_flipbook && texels > limits::FLIPBOOK_TEXELS {
        let fault = context.fault("canvas.frames", format!("a flipbook of {width} x {height} has {texels} texels"));
        let allowed = format!("at most {} texels in all frames", limits::FLIPBOOK_TEXELS);
        context.findings.push(fault.found(texels.to_string()).allowed(allowed));
    }
    for (key, written) in [("canvas.debug", !debug.is_empty()), ("canvas.blend_kernel", blend_kernel == 5)] {
        if written && is_flipbook {
            context.findings.push(context.fault(key, format!("`{key}` is for stills, and the exemplar is a flipbook")));
        }
    }
    let blend_kernel = if blend_kernel == 5 { BlendSize::Five } else { BlendSize::Three };
    refuse_twice("canvas.debug", &debug.iter().map(|picture| picture.name()).collect::<Vec<_>>(), context);
    let maps = outputs_of("canvas", maps, format, exemplar, context);
    Canvas { size, tileable, frames, looped, order, guide, inpaint, sources, blend_kernel, maps, compression, debug }
}

fn atlas_of(from: schema::Atlas, exemplar: &Exemplar, context: &mut Context) -> Atlas {
    let schema::Atlas {
        size,
        texels_per_unit,
        udim,
        gutter,
        maps,
        format,
        compression,
        mips,
        unwrap,
        keep_uv,
        refine,
        filter,
    } = from;
    if udim {
        context.not_yet("atlas.udim", "true", "false");
    }
    if let Some(set) = keep_uv.filter(|&set| set != 0) {
        context.not_yet("atlas.keep_uv", &set.to_string(), "0");
    }
    if unwrap == Some(Unwrap::Xatlas) && cfg!(not(feature = "xatlas")) {
        let fault = context.fault("atlas.unwrap", "this kiln was built without xatlas");
        let hint = "take \"uvunwrap\", or build kiln with the cargo feature `xatlas`".to_string();
        context.findings.push(fault.found("\"xatlas\"").allowed("\"uvunwrap\"").hint(hint));
    }
    Atlas {
        size: match texels_per_unit {
            Some(n) => AtlasSize::TexelsPerUnit(n),
            None => AtlasSize::Side(size.unwrap_or(DEFAULT_ATLAS_SIDE)),
        },
        gutter,
        maps: outputs_of("atlas", maps, format, exemplar, context),
        compression,
        mips,
        layout: match keep_uv {
            Some(_) => Layout::KeepUv,
            None => Layout::Unwrap(unwrap.unwrap_or(Unwrap::Uvunwrap)),
        },
        refine,
        filter,
    }
}

/// Side of an atlas of which the recipe says neither side nor scale.
const DEFAULT_ATLAS_SIDE: u32 = 2048;

/// The maps that a table writes, and how.
fn outputs_of(
    table: &str,
    maps: Option<Vec<MapFile>>,
    format: schema::Formats,
    exemplar: &Exemplar,
    context: &mut Context,
) -> Vec<MapOutput> {
    let held: Vec<MapKind> = exemplar.maps.iter().flat_map(|m| m.map.kinds()).copied().collect();
    let key = format!("{table}.maps");
    let wanted = match maps {
        None => exemplar.maps.iter().map(|m| m.map).collect(),
        Some(wanted) => {
            let names: Vec<&str> = wanted.iter().map(|map| map.name()).collect();
            refuse_twice(&key, &names, context);
            for (i, map) in wanted.iter().enumerate() {
                if !map.kinds().iter().any(|kind| held.contains(kind)) {
                    let message = format!("`{key}` asks for `{}`, which the exemplar does not have", map.name());
                    let fault = context.fault(&format!("{key}[{i}]"), message);
                    let hint = format!("add `{}` to [exemplar], or leave it out", map.name());
                    let mut files: Vec<_> = map.kinds().iter().map(|k| format!("exemplar.{}", k.name())).collect();
                    files.push("exemplar.orm".into());
                    let files: Vec<&str> = files.iter().map(String::as_str).collect();
                    let fault = fault.found(format!("\"{}\"", map.name())).hint(hint);
                    context.findings.push_unless_due_to(&files, fault);
                }
            }
            wanted
        }
    };
    let formats = formats_of(table, format, &wanted, context);
    wanted.into_iter().map(|map| MapOutput { map, format: formats(map) }).collect()
}

/// The format of each map.
fn formats_of(
    table: &str,
    format: schema::Formats,
    wanted: &[MapFile],
    context: &mut Context,
) -> impl Fn(MapFile) -> ImageFormat + use<> {
    let key = format!("{table}.format");
    let (all, each) = match format {
        schema::Formats::One(format) => {
            refuse_format(&key, format, context);
            (format, schema::FormatPerMap::default())
        }
        schema::Formats::PerMap(each) => (ImageFormat::Png, each),
    };
    let schema::FormatPerMap { base_color, normal, roughness, metallic, occlusion, height, opacity, orm, emissive } =
        each;
    let own = move |map| match map {
        MapFile::BaseColor => base_color,
        MapFile::Normal => normal,
        MapFile::Roughness => roughness,
        MapFile::Metallic => metallic,
        MapFile::Occlusion => occlusion,
        MapFile::Height => height,
        MapFile::Opacity => opacity,
        MapFile::Orm => orm,
        MapFile::Emissive => emissive,
    };
    for &map in MapFile::ALL {
        let key = format!("{key}.{}", map.name());
        let Some(format) = own(map) else { continue };
        if wanted.contains(&map) {
            refuse_format(&key, format, context);
        } else if !wanted.is_empty() && context.is_own(&key) {
            let message = format!("`{key}` is the format of a map that is not written");
            let names: Vec<&str> = wanted.iter().map(|map| map.name()).collect();
            let fault = context.fault(&key, message).found(map.name()).allowed(listing(&names, "`", "or"));
            context.findings.push_unless_due_to(&[&format!("{table}.maps"), "exemplar"], fault);
        }
    }
    move |map| own(map).unwrap_or(all)
}

fn refuse_format(key: &str, format: ImageFormat, context: &mut Context) {
    match format {
        ImageFormat::Png | ImageFormat::Png16 | ImageFormat::Exr => {}
        _ => context.not_yet(key, &format!("\"{}\"", format.name()), "\"png\", \"png16\" or \"exr\""),
    }
}

fn renders_of(from: Vec<schema::Render>, method: Method, context: &mut Context) -> Vec<Render> {
    let mut out: Vec<Render> = Vec::with_capacity(from.len());
    for (i, schema::Render { view, camera, size, shading }) in from.into_iter().enumerate() {
        let key = format!("render[{i}]");
        let view = match camera {
            Some(camera) => camera_of(&format!("{key}.camera"), camera, context),
            None => View::Turntable(view.map_or(DEFAULT_TURNTABLE, |text| turntable(&key, &text, context))),
        };
        let lacks = match shading {
            Shading::Singularities if method != Method::MaterialSpace => Some((
                "the coordinates of a tile, and there is none",
                "`analysis.method = \"material-space\"`, or \"field\" for the field's singularities",
            )),
            Shading::Edges if method != Method::Texton => {
                Some(("what is blended over the edges of triangles, and nothing is", "`analysis.method = \"texton\"`"))
            }
            _ => None,
        };
        if let Some((what, allowed)) = lacks {
            let fault = context.fault(&format!("{key}.shading"), format!("`{key}` shows {what}"));
            context.findings.push(fault.found(format!("{:?}", shading.name())).allowed(allowed));
        }
        let pixels = match view {
            View::Turntable(n) => u64::from(n) * u64::from(size) * u64::from(size),
            View::Camera { .. } => u64::from(size) * u64::from(size),
        };
        if pixels > limits::RENDER_PIXELS {
            let fault = context.fault(&format!("{key}.size"), format!("`{key}` has {pixels} pixels in all its views"));
            let allowed = format!("at most {} pixels", limits::RENDER_PIXELS);
            context.findings.push(fault.found(pixels.to_string()).allowed(allowed));
        }
        let base = match view {
            View::Turntable(n) => format!("turntable-{n}"),
            View::Camera { .. } => "camera".into(),
        };
        let is_free = |name: &String| out.iter().all(|render| render.name != *name);
        let shaded = format!("{base}-{}", shading.name());
        let numbered = (2..).map(|n| format!("{base}-{n}"));
        let name = [base.clone(), shaded].into_iter().chain(numbered).find(is_free).unwrap_or_default();
        out.push(Render { name, view, size, shading });
    }
    out
}

/// Views of a render that does not say.
const DEFAULT_TURNTABLE: u32 = 4;

fn turntable(key: &str, text: &str, context: &mut Context) -> u32 {
    let digits = text.strip_prefix("turntable-").filter(|digits| !digits.starts_with(['0', '+']));
    match digits.and_then(|digits| digits.parse().ok()).filter(|n| limits::TURNTABLE.contains(n)) {
        Some(n) => n,
        None => {
            let key = format!("{key}.view");
            let fault = context.fault(&key, format!("`{key}` can't be \"{}\"", printable(text)));
            let (least, most) = (limits::TURNTABLE.start(), limits::TURNTABLE.end());
            let allowed = format!("\"turntable-N\" with N from {least} to {most}");
            let hint = "for a single view, write camera = { eye = [x, y, z], target = [x, y, z] }".to_string();
            context.findings.push(fault.found(format!("\"{}\"", printable(text))).allowed(allowed).hint(hint));
            DEFAULT_TURNTABLE
        }
    }
}

fn camera_of(key: &str, from: schema::Camera, context: &mut Context) -> View {
    let schema::Camera { eye, target, fov_deg } = from;
    if eye.is_some() && eye == target {
        let fault = context.fault(key, format!("`{key}` looks at its own place"));
        context.findings.push(fault.hint("move `eye` away from `target`".to_string()));
    }
    View::Camera { eye: point(eye), target: point(target), fov: fov_deg.to_radians() }
}
