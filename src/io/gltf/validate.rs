//! What is checked of a document before anything reads it, so that nothing after has to.
//!
//! Source: glTF 2.0, 3.7.2 (meshes), 3.12 (extensions), KHR_mesh_quantization; the `gltf` crate's own validation for
//! types, missing fields and names, which reports the place.
//! Policy: a count of indices that is no multiple of three is an error. A primitive without POSITION passes through.
//! Time and memory are linear in the file: each accessor is looked through once however often it is used.

use gltf::json::validation::{Error as JsonError, Validate};
use serde::Deserialize;
use serde_json::Value;

use super::accessor::{self, Component, Format};
use super::document::Document;
use super::refs::{self, index, list};
use crate::io::SceneError;

/// Extensions that may be required: read here, or passed through without a loss.
const READ: &[&str] = &["EXT_meshopt_compression", "KHR_mesh_quantization", "KHR_meshopt_compression"];

/// The version, and that every required extension can be dealt with.
pub(super) fn header(root: &Value) -> Result<(), SceneError> {
    let asset =
        root.get("asset").ok_or_else(|| SceneError::at("asset", "is missing; expected {\"version\": \"2.0\"}"))?;
    let version = asset.get("minVersion").or(asset.get("version")).unwrap_or(&Value::Null);
    if version.as_str().is_none_or(|v| v != "2" && !v.starts_with("2.0")) {
        return Err(SceneError::at("asset.version", format!("found {version}, kiln reads glTF \"2.0\"")));
    }
    for name in list(root, "extensionsRequired").iter().filter_map(Value::as_str) {
        if name == "KHR_draco_mesh_compression" {
            return Err(draco());
        }
        if !READ.contains(&name) && !refs::is_known(name) {
            let what = "the file requires it and kiln does not read it";
            return Err(SceneError::Extension { name: name.into(), what: what.into() });
        }
    }
    Ok(())
}

fn draco() -> SceneError {
    let what = "kiln does not read Draco; decompress the file first, for example with `gltf-transform copy`";
    SceneError::Extension { name: "KHR_draco_mesh_compression".into(), what: what.into() }
}

/// Entries of an array at the root as the `gltf` crate's types.
fn typed<'a, T: Deserialize<'a>>(root: &'a Value, name: &str) -> Result<Vec<T>, SceneError> {
    match root.get(name) {
        None | Some(Value::Null) => Ok(Vec::new()),
        Some(Value::Array(entries)) => {
            let one = |(i, v)| {
                T::deserialize(v).map_err(|e: serde_json::Error| SceneError::at(format!("{name}[{i}]"), e.to_string()))
            };
            entries.iter().enumerate().map(one).collect()
        }
        Some(other) => Err(SceneError::at(name, format!("found {}, expected an array", kind_of(other)))),
    }
}

fn kind_of(value: &Value) -> &'static str {
    match value {
        Value::Null => "null",
        Value::Bool(_) => "a boolean",
        Value::Number(_) => "a number",
        Value::String(_) => "a string",
        Value::Array(_) => "an array",
        Value::Object(_) => "an object",
    }
}

/// Types of everything, and all indices.
pub(super) fn structure(root: &Value) -> Result<(), SceneError> {
    // An extension may give the source instead; the typed model insists on one.
    let mut textures: Vec<Value> = typed(root, "textures")?;
    for texture in textures.iter_mut().filter_map(Value::as_object_mut) {
        texture.entry("source").or_insert(0.into());
    }
    let textures = serde_json::json!({ "textures": textures });
    let model = gltf::json::Root {
        accessors: typed(root, "accessors")?,
        animations: typed(root, "animations")?,
        buffers: typed(root, "buffers")?,
        buffer_views: typed(root, "bufferViews")?,
        cameras: typed(root, "cameras")?,
        extensions_required: Vec::new(),
        extensions_used: typed(root, "extensionsUsed")?,
        images: typed(root, "images")?,
        materials: typed(root, "materials")?,
        meshes: typed(root, "meshes")?,
        nodes: typed(root, "nodes")?,
        samplers: typed(root, "samplers")?,
        scenes: typed(root, "scenes")?,
        skins: typed(root, "skins")?,
        textures: typed(&textures, "textures")?,
        ..Default::default()
    };
    typed::<String>(root, "extensionsRequired")?;
    // Before the crate's own validation, which takes indices of accessors for granted.
    refs::check(root)?;
    attribute_names(root)?;
    let mut fault = None;
    model.validate(&model, gltf::json::Path::new, &mut |path, error| {
        // Bounds are taken from the data and sources from extensions; only values that are wrong count here.
        let path = path();
        let bounds = path.as_str().ends_with(".min") || path.as_str().ends_with(".max");
        if error == JsonError::Invalid && !bounds && fault.is_none() {
            fault = Some(SceneError::at(path.as_str(), "the value is none of those that glTF allows"));
        }
    });
    fault.map_or(Ok(()), Err)
}

fn attribute_names(root: &Value) -> Result<(), SceneError> {
    let mut fault = None;
    refs::each(root, &mut |_, path, _| {
        if let [refs::Step::Key("meshes"), .., refs::Step::Key("attributes"), refs::Step::Key(name)] = path
            && fault.is_none()
            && Semantic::parse(name).is_none()
        {
            let what = "no attribute that glTF knows; names of one's own begin with an underscore";
            fault = Some(SceneError::at(refs::text(path), what));
        }
    });
    fault.map_or(Ok(()), Err)
}

/// What an attribute means.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Semantic {
    Position,
    Normal,
    Tangent,
    TexCoord(u32),
    Color(u32),
    Joints(u32),
    Weights(u32),
    Custom,
}

impl Semantic {
    pub(super) fn parse(name: &str) -> Option<Self> {
        let numbered = |prefix: &str| {
            let digits = name.strip_prefix(prefix)?;
            let n: u32 = digits.parse().ok()?;
            (n.to_string() == digits && n < 1 << 16).then_some(n)
        };
        Some(match name {
            "POSITION" => Semantic::Position,
            "NORMAL" => Semantic::Normal,
            "TANGENT" => Semantic::Tangent,
            _ if name.starts_with('_') => Semantic::Custom,
            _ => numbered("TEXCOORD_")
                .map(Semantic::TexCoord)
                .or(numbered("COLOR_").map(Semantic::Color))
                .or(numbered("JOINTS_").map(Semantic::Joints))
                .or(numbered("WEIGHTS_").map(Semantic::Weights))?,
        })
    }

    /// Whether glTF allows the format without an extension.
    pub(super) fn is_core(self, format: Format) -> bool {
        let unit = matches!(format.component, Component::U8 | Component::U16) && format.normalized;
        match self {
            Semantic::Position | Semantic::Normal | Semantic::Tangent => format.component == Component::F32,
            Semantic::TexCoord(_) | Semantic::Color(_) | Semantic::Weights(_) => {
                format.component == Component::F32 || unit
            }
            Semantic::Joints(_) => matches!(format.component, Component::U8 | Component::U16) && !format.normalized,
            Semantic::Custom => true,
        }
    }

    /// The shapes allowed, or `None` for any.
    fn shapes(self, morph: bool) -> Option<&'static [&'static str]> {
        Some(match self {
            Semantic::Position | Semantic::Normal => &["VEC3"],
            Semantic::Tangent => {
                if morph {
                    &["VEC3"]
                } else {
                    &["VEC4"]
                }
            }
            Semantic::TexCoord(_) => &["VEC2"],
            Semantic::Color(_) => &["VEC3", "VEC4"],
            Semantic::Joints(_) | Semantic::Weights(_) => &["VEC4"],
            Semantic::Custom => return None,
        })
    }

    /// Whether the format may stand for this, with KHR_mesh_quantization if `quantized`.
    fn check(self, format: Format, quantized: bool, morph: bool) -> Result<(), String> {
        if let Some(shapes) = self.shapes(morph).filter(|s| !s.contains(&format.shape)) {
            return Err(format!("found type {}, expected {}", format.shape, shapes.join(" or ")));
        }
        let small = quantized
            && format.component.size() < 4
            && match self {
                Semantic::Position | Semantic::TexCoord(_) => true,
                Semantic::Normal | Semantic::Tangent | Semantic::Color(_) => format.normalized || morph,
                _ => false,
            };
        if self.is_core(format) || small {
            return Ok(());
        }
        let norm = if format.normalized { ", normalized" } else { "" };
        Err(format!(
            "componentType {}{norm} is not allowed here (without KHR_mesh_quantization)",
            format.component.code()
        ))
    }
}

/// What attributes and indices are stored as.
pub(super) fn formats(root: &Value, quantized: bool) -> Result<(), SceneError> {
    let formats = accessor::formats(root)?;
    let mut fault = None;
    refs::each(root, &mut |kind, path, value| {
        let (refs::Kind::Accessor, None, Some(a)) = (kind, &fault, value.as_u64()) else { return };
        let format = formats[a as usize];
        let checked = match path {
            [refs::Step::Key("meshes"), .., refs::Step::Key("indices")] => check_indices(format),
            [refs::Step::Key("meshes"), .., before, refs::Step::Key(name)] => {
                let morph = matches!(before, refs::Step::Index(_));
                Semantic::parse(name).map_or(Ok(()), |s| s.check(format, quantized, morph))
            }
            _ => Ok(()),
        };
        fault = checked.err().map(|what| SceneError::at(refs::text(path), what));
    });
    fault.map_or(Ok(()), Err)
}

fn check_indices(f: Format) -> Result<(), String> {
    let integer = matches!(f.component, Component::U8 | Component::U16 | Component::U32) && !f.normalized;
    if f.shape == "SCALAR" && integer {
        return Ok(());
    }
    Err(format!("found type {}, componentType {}; expected SCALAR of 5121, 5123 or 5125", f.shape, f.component.code()))
}

/// What has been looked through already, per accessor.
struct Seen {
    finite: Vec<bool>,
    greatest: Vec<Option<u32>>,
}

/// Meshes, skins and animations: counts, ranges of indices, and that all floats are finite.
pub(super) fn data(doc: &Document) -> Result<(), SceneError> {
    let n = doc.accessors.len();
    let mut seen = Seen { finite: vec![false; n], greatest: vec![None; n] };
    for (m, mesh) in list(&doc.root, "meshes").iter().enumerate() {
        let primitives = list(mesh, "primitives");
        if primitives.is_empty() {
            return Err(SceneError::at(format!("meshes[{m}].primitives"), "is empty, expected at least one"));
        }
        for (p, primitive) in primitives.iter().enumerate() {
            seen.primitive(doc, primitive, &format!("meshes[{m}].primitives[{p}]"))?;
        }
    }
    let mut fault = None;
    refs::each(&doc.root, &mut |kind, path, value| {
        let outside = matches!(path.first(), Some(refs::Step::Key("skins" | "animations")));
        if let (refs::Kind::Accessor, true, None, Some(a)) = (kind, outside, &fault, value.as_u64()) {
            fault = seen.finite(doc, a as usize, &refs::text(path)).err();
        }
    });
    fault.map_or(Ok(()), Err)
}

impl Seen {
    fn primitive(&mut self, doc: &Document, primitive: &Value, path: &str) -> Result<(), SceneError> {
        let mode = primitive.get("mode").filter(|m| !m.is_null()).map_or(Some(4), Value::as_u64);
        if mode.is_none_or(|m| m > 6) {
            return Err(SceneError::at(format!("{path}.mode"), format!("found {}, expected 0..=6", primitive["mode"])));
        }
        let attributes = primitive.get("attributes").unwrap_or(&Value::Null);
        let Some(position) = index(attributes, "POSITION") else { return Ok(()) };
        let is_draco = primitive.pointer("/extensions/KHR_draco_mesh_compression").is_some();
        if is_draco && !doc.accessors[position].has_data() {
            return Err(draco());
        }
        let vertices = doc.accessors[position].count;
        self.attributes(doc, attributes, vertices, &format!("{path}.attributes"))?;
        for (t, target) in list(primitive, "targets").iter().enumerate() {
            self.attributes(doc, target, vertices, &format!("{path}.targets[{t}]"))?;
        }
        let corners = match index(primitive, "indices") {
            Some(a) => self.indices(doc, a, vertices, &format!("{path}.indices"))?,
            None => vertices,
        };
        match mode {
            Some(4) if corners % 3 != 0 => {
                Err(SceneError::at(path, format!("{corners} corners of triangles, expected a multiple of 3")))
            }
            Some(5 | 6) if corners < 3 => {
                Err(SceneError::at(path, format!("{corners} corners of a strip or fan, expected at least 3")))
            }
            _ => Ok(()),
        }
    }

    fn attributes(
        &mut self,
        doc: &Document,
        attributes: &Value,
        vertices: usize,
        path: &str,
    ) -> Result<(), SceneError> {
        for (name, a) in attributes.as_object().into_iter().flatten() {
            let (Some(a), path) = (a.as_u64().map(|a| a as usize), format!("{path}.{name}")) else { continue };
            let accessor = &doc.accessors[a];
            if accessor.count != vertices {
                let what = format!("{} elements, but POSITION has {vertices}", accessor.count);
                return Err(SceneError::at(path, what));
            }
            self.finite(doc, a, &path)?;
        }
        Ok(())
    }

    /// Floats of an accessor are numbers.
    fn finite(&mut self, doc: &Document, a: usize, path: &str) -> Result<(), SceneError> {
        let accessor = &doc.accessors[a];
        if accessor.format.component != Component::F32 || std::mem::replace(&mut self.finite[a], true) {
            return Ok(());
        }
        if !accessor.has_data() {
            return Ok(());
        }
        let packed = accessor.packed(&doc.buffers);
        let width = accessor.format.width();
        match packed.chunks_exact(4).map(|b| Component::F32.read(b)).enumerate().find(|(_, v)| !v.is_finite()) {
            Some((k, v)) => {
                let what = format!("component {} of element {} is {v}, expected a finite number", k % width, k / width);
                Err(SceneError::at(path, what))
            }
            None => Ok(()),
        }
    }

    /// The number of indices; each is below the number of vertices.
    fn indices(&mut self, doc: &Document, a: usize, vertices: usize, path: &str) -> Result<usize, SceneError> {
        let accessor = &doc.accessors[a];
        let greatest = *self.greatest[a].get_or_insert_with(|| {
            if accessor.has_data() { accessor.indices(&doc.buffers).into_iter().max().unwrap_or(0) } else { 0 }
        });
        if greatest as usize >= vertices {
            let all = accessor.indices(&doc.buffers);
            let k = all.iter().position(|&i| i as usize >= vertices).unwrap_or(0);
            let what = format!("index {k} is {}, but there are {vertices} vertices", all[k]);
            return Err(SceneError::at(path, what));
        }
        Ok(accessor.count)
    }
}
