//! The input scene, whole: its JSON as read, and every byte that it refers to.
//!
//! Source: glTF 2.0; EXT_meshopt_compression for compressed views, which are decompressed here once and for all.
//! In: the file, and a way to read files beside it. Out: a document in which every index, range and number was checked.

use serde_json::{Value, json};

use super::accessor::{self, Accessor, View};
use super::meshopt_filter::Filter;
use super::refs::{index, list};
use super::uri::{Target, target};
use super::{container, meshopt, nodes, validate};
use crate::io::SceneError;

/// Bytes that compressed views of one file may unpack to.
const MAX_UNPACKED: usize = 1 << 31;

const COMPRESSIONS: [&str; 2] = ["EXT_meshopt_compression", "KHR_meshopt_compression"];

/// A scene as it was read, with nothing left out. Compressed buffer views are decompressed.
#[derive(Clone, Debug)]
pub struct Document {
    pub(super) root: Value,
    pub(super) buffers: Vec<Vec<u8>>,
    /// Bytes of images that lie in files of their own, as far as these could be read.
    pub(super) images: Vec<Option<Vec<u8>>>,
    pub(super) views: Vec<View>,
    pub(super) accessors: Vec<Accessor>,
    /// Transform under which each mesh is first shown.
    pub(super) shown: Vec<Option<nodes::Matrix>>,
    /// Names of the extensions that the file uses, in its order.
    pub(super) extensions: Vec<String>,
}

/// Reads a file's bytes by its path relative to the scene.
pub(in crate::io) type Resolve<'a> = &'a mut dyn FnMut(&str) -> Result<Vec<u8>, String>;

/// JSON and binary chunk of a .glb or .gltf.
pub(in crate::io) fn parts(bytes: &[u8]) -> Result<(Value, Option<&[u8]>), SceneError> {
    let (text, bin) = if bytes.starts_with(b"glTF") { container::split(bytes)? } else { (bytes, None) };
    Ok((container::json(text)?, bin))
}

/// Paths of the files that a scene refers to, each once, in order of appearance.
pub(in crate::io) fn external_files(root: &Value) -> Result<Vec<String>, SceneError> {
    let mut out = Vec::new();
    let needed = needed_buffers(root);
    let buffers = list(root, "buffers").iter().zip(needed).filter(|(_, n)| *n).map(|(b, _)| b);
    for object in buffers.chain(list(root, "images")) {
        if let Some(Target::File(path)) = object.get("uri").and_then(Value::as_str).map(target).transpose()?
            && !out.contains(&path)
        {
            out.push(path);
        }
    }
    Ok(out)
}

/// The extension object of a compressed view, or of a buffer that is a fallback.
fn compression(object: &Value) -> Option<&Value> {
    COMPRESSIONS.iter().find_map(|name| object.get("extensions")?.get(name))
}

/// Buffers whose data must be there: all but the fallbacks of compressed views.
fn needed_buffers(root: &Value) -> Vec<bool> {
    let buffers = list(root, "buffers");
    let (mut fallback, mut read) = (vec![false; buffers.len()], vec![false; buffers.len()]);
    let mark = |marks: &mut [bool], i: Option<usize>| {
        if let Some(mark) = i.and_then(|i| marks.get_mut(i)) {
            *mark = true;
        }
    };
    for view in list(root, "bufferViews") {
        let compressed = compression(view);
        mark(&mut read, index(compressed.unwrap_or(view), "buffer"));
        mark(&mut fallback, compressed.and(index(view, "buffer")));
    }
    let tagged = |b: &Value| compression(b).is_some_and(|e| e.get("fallback") == Some(&Value::Bool(true)));
    buffers.iter().enumerate().map(|(i, b)| read[i] || !(tagged(b) || fallback[i])).collect()
}

impl Document {
    /// Reads .glb or .gltf.
    pub(in crate::io) fn from_gltf(bytes: &[u8], resolve: Resolve) -> Result<Self, SceneError> {
        let (root, bin) = parts(bytes)?;
        validate::header(&root)?;
        validate::structure(&root)?;
        let buffers = load_buffers(&root, bin, resolve)?;
        Self::new(root, buffers, resolve)
    }

    /// A document of JSON whose buffers are at hand.
    pub(in crate::io) fn new(mut root: Value, mut buffers: Vec<Vec<u8>>, resolve: Resolve) -> Result<Self, SceneError> {
        let names =
            |key: &str| list(&root, key).iter().filter_map(|e| e.as_str().map(String::from)).collect::<Vec<_>>();
        let extensions = names("extensionsUsed");
        let quantized = extensions.iter().any(|e| e == "KHR_mesh_quantization");
        validate::formats(&root, quantized)?;
        decompress(&mut root, &mut buffers)?;
        let sizes: Vec<usize> = buffers.iter().map(Vec::len).collect();
        let views = accessor::views(&root, &sizes)?;
        let accessors = accessor::accessors(&root, &views, &buffers)?;
        let shown = nodes::first_shown(&root)?;
        let images = load_images(&root, resolve)?;
        let doc = Document { root, buffers, images, views, accessors, shown, extensions };
        validate::data(&doc)?;
        Ok(doc)
    }
}

fn load_buffers(root: &Value, bin: Option<&[u8]>, resolve: Resolve) -> Result<Vec<Vec<u8>>, SceneError> {
    let needed = needed_buffers(root);
    let mut out = Vec::new();
    for (i, buffer) in list(root, "buffers").iter().enumerate() {
        if !needed[i] {
            out.push(Vec::new());
            continue;
        }
        let path = format!("buffers[{i}]");
        let mut bytes = match (buffer.get("uri").and_then(Value::as_str), bin) {
            (Some(uri), _) => match target(uri)? {
                Target::Data(bytes) => bytes,
                Target::File(file) => resolve(&file)
                    .map_err(|what| SceneError::Uri { uri: uri.into(), what: format!("{path}: {what}") })?,
            },
            (None, Some(bin)) if i == 0 => bin.to_vec(),
            (None, _) => return Err(SceneError::at(path, "no `uri`, and no BIN chunk that it could be")),
        };
        let len = buffer.get("byteLength").and_then(Value::as_u64).unwrap_or(0);
        if len > bytes.len() as u64 {
            let what = format!("`byteLength` is {len}, but its data has {} bytes", bytes.len());
            return Err(SceneError::at(path, what));
        }
        bytes.truncate(len as usize);
        out.push(bytes);
    }
    Ok(out)
}

/// Images in files of their own. One that is not there stays a reference: it may belong to a material that is replaced.
fn load_images(root: &Value, resolve: Resolve) -> Result<Vec<Option<Vec<u8>>>, SceneError> {
    let one = |image: &Value| match image.get("uri").and_then(Value::as_str).map(target).transpose()? {
        Some(Target::File(path)) => Ok(resolve(&path).ok()),
        _ => Ok(None),
    };
    list(root, "images").iter().map(one).collect()
}

/// Replaces compressed views by views of new buffers and forgets that there was a compression.
fn decompress(root: &mut Value, buffers: &mut Vec<Vec<u8>>) -> Result<(), SceneError> {
    let mut left = MAX_UNPACKED;
    for i in 0..list(root, "bufferViews").len() {
        let view = &list(root, "bufferViews")[i];
        let Some(extension) = compression(view) else { continue };
        let path = format!("bufferViews[{i}].extensions.EXT_meshopt_compression");
        let bytes = unpack(view, extension, buffers, &mut left).map_err(|what| SceneError::at(path, what))?;
        let view = &mut root["bufferViews"][i];
        view["buffer"] = buffers.len().into();
        if let Some(view) = view.as_object_mut() {
            view.remove("byteOffset");
            remove_extensions(view);
        }
        if let Some(all) = root["buffers"].as_array_mut() {
            all.push(json!({"byteLength": bytes.len()}));
        }
        buffers.push(bytes);
    }
    for buffer in root.get_mut("buffers").and_then(Value::as_array_mut).into_iter().flatten() {
        buffer.as_object_mut().map(remove_extensions);
    }
    for key in ["extensionsUsed", "extensionsRequired"] {
        if let Some(names) = root.get_mut(key).and_then(Value::as_array_mut) {
            names.retain(|n| n.as_str().is_none_or(|n| !COMPRESSIONS.contains(&n)));
            if names.is_empty() {
                root.as_object_mut().map(|r| r.remove(key));
            }
        }
    }
    Ok(())
}

fn remove_extensions(object: &mut serde_json::Map<String, Value>) {
    if let Some(all) = object.get_mut("extensions").and_then(Value::as_object_mut) {
        COMPRESSIONS.iter().for_each(|name| drop(all.remove(*name)));
        if all.is_empty() {
            object.remove("extensions");
        }
    }
}

/// The bytes of one compressed view.
fn unpack(view: &Value, extension: &Value, buffers: &[Vec<u8>], left: &mut usize) -> Result<Vec<u8>, String> {
    let number = |key: &str| match extension.get(key) {
        Some(v) => v.as_u64().filter(|&n| n <= 1 << 40).ok_or_else(|| format!("`{key}` is {v}")).map(|n| n as usize),
        None if key == "byteOffset" => Ok(0),
        None => Err(format!("`{key}` is missing")),
    };
    let (start, len, stride, count) =
        (number("byteOffset")?, number("byteLength")?, number("byteStride")?, number("count")?);
    let buffer = &buffers[number("buffer")?];
    let data = buffer.get(start..).and_then(|b| b.get(..len));
    let data = data.ok_or_else(|| format!("bytes {start} + {len} of a buffer of {}", buffer.len()))?;
    let text = |key: &str| extension.get(key).and_then(Value::as_str).unwrap_or("NONE");
    let (mode, filter) = (text("mode"), text("filter"));
    let filter = match filter {
        "NONE" => None,
        "OCTAHEDRAL" => Some(Filter::Octahedral),
        "QUATERNION" => Some(Filter::Quaternion),
        "EXPONENTIAL" => Some(Filter::Exponential),
        "COLOR" => Some(Filter::Color),
        other => return Err(format!("filter \"{other}\"; known: OCTAHEDRAL, QUATERNION, EXPONENTIAL, COLOR")),
    };
    let strides_fit = match mode {
        "ATTRIBUTES" => stride % 4 == 0 && (4..=256).contains(&stride),
        "TRIANGLES" => count % 3 == 0 && (stride == 2 || stride == 4),
        "INDICES" => stride == 2 || stride == 4,
        other => return Err(format!("mode \"{other}\"; known: ATTRIBUTES, TRIANGLES, INDICES")),
    };
    if !strides_fit || filter.is_some_and(|f| mode != "ATTRIBUTES" || !f.allows(stride)) {
        return Err(format!(
            "mode {mode}, filter {filter:?}, byteStride {stride} and count {count} do not go together"
        ));
    }
    let size = count.saturating_mul(stride);
    if view.get("byteLength").and_then(Value::as_u64) != Some(size as u64) || count == 0 {
        return Err(format!("{count} elements of {stride} bytes in a view of {} bytes", view["byteLength"]));
    }
    // The streams' least sizes bound what a small file can ask for.
    let least = if mode == "ATTRIBUTES" { meshopt::least_attribute_bytes(count, stride) } else { count / 3 };
    if least > len {
        return Err(format!("{count} elements take at least {least} bytes, the compressed data has {len}"));
    }
    *left = left.checked_sub(size).ok_or_else(|| format!("more than {MAX_UNPACKED} bytes in all"))?;
    if mode == "ATTRIBUTES" {
        let mut bytes = meshopt::attributes(data, count, stride)?;
        if let Some(filter) = filter {
            filter.apply(&mut bytes, stride);
        }
        return Ok(bytes);
    }
    let indices = if mode == "TRIANGLES" { meshopt::triangles(data, count)? } else { meshopt::indices(data, count)? };
    Ok(indices.into_iter().flat_map(|i| i.to_le_bytes().into_iter().take(stride)).collect())
}
