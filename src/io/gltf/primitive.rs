//! Primitives of the output: what is common to atlas and UV-set bakes.
//!
//! Unaware of: where new coordinates come from.

use std::collections::BTreeMap;

use serde_json::{Map, Value, json};

use super::accessor::{Component, Format};
use super::document::Document;
use super::edit::{Editor, Target};
use super::nodes::Linear;
use super::refs::{Kind, index, list};
use super::triangles::{is_triangles, mode, position};
use super::validate::Semantic;
use crate::io::SceneError;
use crate::mesh::{Part, Surface};
use crate::numerics::vec::vec3;

/// The primitive of a part as the document has it.
pub(super) fn of<'a>(doc: &'a Document, part: &Part) -> &'a Value {
    &doc.root["meshes"][part.mesh as usize]["primitives"][part.primitive as usize]
}

/// Accessor of an attribute of a part.
pub(super) fn attribute(doc: &Document, part: &Part, name: &str) -> Option<usize> {
    index(&of(doc, part)["attributes"], name)
}

/// An array that belongs to the surface has as many entries as it must.
pub(super) fn check_length(what: &str, found: usize, expected: usize) -> Result<(), SceneError> {
    if found == expected {
        return Ok(());
    }
    Err(SceneError::Mismatch(format!("{found} {what}, expected {expected}")))
}

/// The surface is one of this document.
pub(super) fn check_parts(doc: &Document, surface: &Surface) -> Result<(), SceneError> {
    let (mut faces, mut vertices) = (0, 0);
    for part in &surface.parts {
        let mesh = list(&doc.root, "meshes").get(part.mesh as usize).unwrap_or(&Value::Null);
        let primitive = list(mesh, "primitives").get(part.primitive as usize).unwrap_or(&Value::Null);
        let count = position(primitive).filter(|_| is_triangles(primitive)).map_or(0, |a| doc.accessors[a].count);
        if part.faces.start != faces || part.vertices.start != vertices || part.vertices.len() != count {
            return Err(SceneError::Mismatch(format!("the surface is not of this scene: part {part:?}")));
        }
        (faces, vertices) = (part.faces.end, part.vertices.end);
    }
    check_length("faces in parts", faces as usize, surface.mesh.faces.len())?;
    check_length("corner normals", surface.corner_normals.len(), 3 * surface.mesh.faces.len())
}

/// The surface's normal at a corner, in the object.
pub(super) fn object_normal(linear: &Linear, surface: &Surface, corner: usize) -> [f32; 3] {
    linear.normal_to_object(surface.corner_normals[corner]).unwrap_or(vec3(0.0, 0.0, 1.0)).to_f32()
}

/// Whether the primitive is an indexed list of triangles already, with indices of a size that is written here.
pub(super) fn is_plain_list(doc: &Document, part: &Part) -> bool {
    let primitive = of(doc, part);
    let small = |a: usize| doc.accessors[a].format.component.size() <= if part.vertices.len() <= 65535 { 2 } else { 4 };
    mode(primitive) == 4 && index(primitive, "indices").is_some_and(small)
}

/// Takes from a primitive what will be written anew; `vertices` and `indices` tell what is kept.
pub(super) fn strip(primitive: &mut Value, vertices: bool, indices: bool) {
    let Some(p) = primitive.as_object_mut() else { return };
    p.remove("mode");
    if !indices {
        p.remove("indices");
    }
    if !vertices {
        p.remove("targets");
        p.insert("attributes".into(), json!({}));
    }
    for set in p.get_mut("attributes").into_iter() {
        set.as_object_mut().map(drop_stale);
    }
    for target in p.get_mut("targets").and_then(Value::as_array_mut).into_iter().flatten() {
        target.as_object_mut().map(drop_stale);
    }
    // Draco's copy of the data would be stale.
    if let Some(extensions) = p.get_mut("extensions").and_then(Value::as_object_mut)
        && extensions.remove("KHR_draco_mesh_compression").is_some()
        && extensions.is_empty()
    {
        p.remove("extensions");
    }
}

fn drop_stale(attributes: &mut Map<String, Value>) {
    attributes.retain(|name, _| !is_stale(name));
}

/// Tangents belong to coordinates that are replaced, weights of an earlier bake to that bake.
fn is_stale(name: &str) -> bool {
    name == "TANGENT" || name.starts_with("_KILN_")
}

/// The attributes that are carried over, sets of coordinates moved up by `shift`.
pub(super) fn carried(attributes: &Value, shift: u32) -> impl Iterator<Item = (String, usize)> {
    attributes.as_object().into_iter().flatten().filter(|(name, _)| !is_stale(name)).filter_map(move |(name, a)| {
        let name = match Semantic::parse(name) {
            Some(Semantic::TexCoord(i)) => format!("TEXCOORD_{}", i + shift),
            _ => name.clone(),
        };
        Some((name, a.as_u64()? as usize))
    })
}

/// Attributes of the morph targets, likewise.
pub(super) fn targets(primitive: &Value, shift: u32) -> impl Iterator<Item = impl Iterator<Item = (String, usize)>> {
    list(primitive, "targets").iter().map(move |t| carried(t, shift))
}

/// Data of one attribute.
pub(super) enum Stream {
    /// An accessor as it is.
    Keep(usize),
    /// New data, packed, with the accessor that it replaces.
    New { like: Option<usize>, format: Format, bytes: Vec<u8> },
}

impl Stream {
    /// New data without a normalised meaning.
    pub(super) fn new(like: Option<usize>, component: Component, shape: &str, bytes: Vec<u8>) -> Self {
        Stream::New { like, format: Format::new(component, shape, false), bytes }
    }

    /// The accessor that new data were made from.
    fn origin(&self) -> Option<usize> {
        match self {
            Stream::Keep(_) => None,
            Stream::New { like, .. } => *like,
        }
    }

    /// Elements of an accessor, picked and repeated.
    pub(super) fn gather(doc: &Document, a: usize, source: &[u32]) -> Self {
        let accessor = &doc.accessors[a];
        let (size, packed) = (accessor.format.size(), accessor.packed(&doc.buffers));
        let mut bytes = Vec::with_capacity(source.len() * size);
        source.iter().for_each(|&v| bytes.extend_from_slice(&packed[v as usize * size..(v as usize + 1) * size]));
        Stream::New { like: Some(a), format: accessor.format, bytes }
    }
}

/// Writes a set of attributes; what was copied from one accessor under several names is written once.
pub(super) fn write_streams(editor: &mut Editor, streams: Vec<(String, Stream)>) -> Value {
    let mut written: BTreeMap<usize, (Format, blake3::Hash, usize)> = BTreeMap::new();
    let origins: Vec<usize> = streams.iter().filter_map(|(_, s)| s.origin()).collect();
    let mut out = Map::new();
    for (name, stream) in streams {
        let shared = stream.origin().filter(|o| origins.iter().filter(|p| *p == o).count() > 1);
        let accessor = match stream {
            Stream::Keep(a) => a,
            Stream::New { like, format, bytes } => {
                let hash = shared.map(|_| blake3::hash(&bytes));
                match shared.and_then(|o| written.get(&o)) {
                    Some((f, h, a)) if *f == format && Some(*h) == hash => *a,
                    _ => {
                        let a = editor.accessor(like, format, bytes, Target::Vertices, name == "POSITION");
                        written.extend(shared.zip(hash).map(|(o, h)| (o, (format, h, a))));
                        a
                    }
                }
            }
        };
        out.insert(name, accessor.into());
    }
    Value::Object(out)
}

/// Writes morph targets of `vertices` vertices. One of which nothing is left moves no vertex, and keeps its place.
pub(super) fn write_targets(
    editor: &mut Editor,
    targets: Vec<Vec<(String, Stream)>>,
    vertices: usize,
) -> Option<Value> {
    let mut out = Vec::new();
    for streams in targets {
        let mut target = write_streams(editor, streams);
        if target.as_object().is_some_and(Map::is_empty) {
            let zeros =
                json!({"componentType": 5126, "type": "VEC3", "count": vertices, "min": [0, 0, 0], "max": [0, 0, 0]});
            target["POSITION"] = editor.add(Kind::Accessor, zeros).into();
        }
        out.push(target);
    }
    (!out.is_empty()).then_some(Value::Array(out))
}

/// Writes triangles with 16-bit indices where these do, else 32.
pub(super) fn write_indices(editor: &mut Editor, faces: &[[u32; 3]], vertices: usize) -> Value {
    let all = faces.as_flattened();
    // 65535 itself restarts a primitive.
    let component = if vertices <= 65535 { Component::U16 } else { Component::U32 };
    let mut bytes = Vec::with_capacity(all.len() * component.size());
    match component {
        Component::U16 => all.iter().for_each(|&i| bytes.extend_from_slice(&(i as u16).to_le_bytes())),
        _ => all.iter().for_each(|i| bytes.extend_from_slice(&i.to_le_bytes())),
    }
    editor.accessor(None, Format::new(component, "SCALAR", false), bytes, Target::Indices, false).into()
}
