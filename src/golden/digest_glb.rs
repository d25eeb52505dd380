//! The digest of a GLB's content.
//!
//! Source: glTF 2.0, sections 3.6 (binary data), 3.8 (images), 4 (GLB). In: the bytes of a file. Out: a digest of its
//! JSON with sorted keys and plain numbers, in which every accessor stands for its elements, every image for its
//! pixels, and buffers, views, offsets, strides and `asset.generator` are left out. So another layout, another
//! compression of a PNG or another writer give the same digest, and any changed vertex, pixel, name or extra another
//! one. The order of accessors, images and so on counts: numbers refer to them. Data outside of the file is not looked
//! at.
//! Unaware of: what meshes and materials mean, extensions (a `bufferView` in one stands for the view's bytes).

use super::base64;
use super::digest::{digest_bytes, digest_pixels};
use crate::io::image_file::{ImageError, Limits, decode_pixels};
use serde_json::{Map, Value};
use std::borrow::Cow;
use std::fmt;

/// Bytes of an accessor without a view: it is all zeros, and only its count says how many.
const MAX_ZEROS: u64 = 1 << 28;
/// Recursion over it is bounded: the parser refuses more than 128 levels.
pub(super) type Object = Map<String, Value>;

/// Why a GLB has no digest.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum DigestError {
    /// The container is not that of a GLB 2.
    Container(String),
    /// The JSON chunk is not the JSON of a glTF.
    Json(String),
    /// Something in the document does not fit.
    Content {
        /// Where, such as `accessors[3]`.
        place: String,
        /// What was found and what is allowed.
        reason: String,
    },
}

impl fmt::Display for DigestError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            DigestError::Container(reason) => write!(f, "not a GLB: {reason}"),
            DigestError::Json(reason) => write!(f, "the JSON of the GLB is wrong: {reason}"),
            DigestError::Content { place, reason } => write!(f, "{place}: {reason}"),
        }
    }
}

impl std::error::Error for DigestError {}

pub(super) type Result<T> = std::result::Result<T, DigestError>;

fn fault<T>(place: &str, reason: impl Into<String>) -> Result<T> {
    Err(DigestError::Content { place: place.to_string(), reason: reason.into() })
}

/// Digest of the content of a GLB.
pub fn digest_glb(bytes: &[u8]) -> Result<String> {
    let (root, bin) = read(bytes)?;
    let content = content(&root, &Document::new(&root, bin)?)?;
    let mut text = b"kiln glb 1\n".to_vec();
    write_canonical(&Value::Object(content), &mut text);
    Ok(digest_bytes(&text))
}

/// The JSON of a GLB and its bytes.
pub(super) fn read(bytes: &[u8]) -> Result<(Object, &[u8])> {
    let (json, bin) = chunks(bytes)?;
    let root: Value = serde_json::from_slice(json).map_err(|e| DigestError::Json(e.to_string()))?;
    let Value::Object(root) = root else { return Err(DigestError::Json("it is not an object".into())) };
    Ok((root, bin))
}

/// What the digest is made of.
pub(super) fn content(root: &Object, document: &Document) -> Result<Object> {
    let mut out = Vec::new();
    for (key, value) in root {
        let value = match (key.as_str(), value) {
            ("buffers" | "bufferViews", _) => continue,
            ("accessors", Value::Array(list)) => document.each(list, "accessors", Document::accessor)?,
            ("images", Value::Array(list)) => document.each(list, "images", Document::image)?,
            ("asset", Value::Object(asset)) => Value::Object(without(asset, &["generator"])),
            ("extras", value) => value.clone(),
            (key, value) => document.resolved(value, key)?,
        };
        out.push((key, value));
    }
    Ok(out.into_iter().map(|(k, v)| (k.clone(), v)).collect())
}

/// The JSON and BIN chunks.
fn chunks(bytes: &[u8]) -> Result<(&[u8], &[u8])> {
    let wrong = |reason: &str| DigestError::Container(reason.to_string());
    let word = |at: usize| -> Result<usize> {
        let word = bytes.get(at..at + 4).and_then(|b| b.try_into().ok()).ok_or_else(|| wrong("the file ends early"))?;
        Ok(u32::from_le_bytes(word) as usize)
    };
    if !bytes.starts_with(b"glTF") {
        return Err(wrong("it does not start with `glTF`"));
    }
    if word(4)? != 2 {
        return Err(DigestError::Container(format!("version {}, expected 2", word(4)?)));
    }
    let length = word(8)?;
    let bytes = bytes.get(..length).ok_or_else(|| wrong("the file ends early"))?;
    let mut parts: [Option<&[u8]>; 2] = [None, None];
    let mut at = 12;
    while at + 8 <= length {
        let (size, kind) = (word(at)?, &bytes[at + 4..at + 8]);
        let chunk = bytes.get(at + 8..).and_then(|b| b.get(..size)).ok_or_else(|| wrong("a chunk ends early"))?;
        let part = [b"JSON", b"BIN\0"].iter().position(|k| *k == kind);
        if let Some(slot) = part.map(|i| &mut parts[i]) {
            slot.get_or_insert(chunk);
        }
        at += 8 + size;
    }
    let json = parts[0].ok_or_else(|| wrong("it has no JSON chunk"))?;
    Ok((json, parts[1].unwrap_or_default()))
}

pub(super) struct Document<'a> {
    buffers: Vec<Cow<'a, [u8]>>,
    views: &'a [Value],
}

impl<'a> Document<'a> {
    pub fn new(root: &'a Object, bin: &'a [u8]) -> Result<Document<'a>> {
        let mut buffers = Vec::new();
        for (i, buffer) in list(root, "buffers").iter().enumerate() {
            let place = format!("buffers[{i}]");
            buffers.push(match buffer.get("uri").map(|uri| uri.as_str()) {
                None => Cow::Borrowed(bin),
                Some(uri) => match uri.and_then(data_uri) {
                    Some(bytes) => Cow::Owned(bytes),
                    None => return fault(&place, "its bytes are not in the file"),
                },
            });
        }
        Ok(Document { buffers, views: list(root, "bufferViews") })
    }

    fn each(&self, list: &[Value], name: &str, f: impl Fn(&Self, &Object, &str) -> Result<Object>) -> Result<Value> {
        let items = list.iter().enumerate().map(|(i, value)| {
            let place = format!("{name}[{i}]");
            match value {
                Value::Object(object) => Ok(Value::Object(f(self, object, &place)?)),
                _ => fault(&place, "it is not an object"),
            }
        });
        Ok(Value::Array(items.collect::<Result<_>>()?))
    }

    /// The bytes of a view and its stride, if it states one.
    fn view(&self, index: u64, place: &str) -> Result<(&[u8], Option<u64>)> {
        let Some(Value::Object(view)) = usize::try_from(index).ok().and_then(|i| self.views.get(i)) else {
            return fault(place, format!("buffer view {index} of {}", self.views.len()));
        };
        let place = format!("bufferViews[{index}]");
        if let Some(name) = view.get("extensions").and_then(|e| e.as_object()).and_then(|e| e.keys().next()) {
            return fault(&place, format!("its bytes are packed by {name}, which is not supported"));
        }
        let buffer = required(view, "buffer", &place)?;
        let (start, len) = (number(view, "byteOffset", &place)?.unwrap_or(0), required(view, "byteLength", &place)?);
        let buffer = usize::try_from(buffer).ok().and_then(|i| self.buffers.get(i));
        let bytes = buffer.and_then(|b| part(b, start, len));
        match bytes {
            Some(bytes) => Ok((bytes, number(view, "byteStride", &place)?)),
            None => fault(&place, format!("{len} bytes from {start} lie outside of its buffer")),
        }
    }

    /// An accessor whose `elements` are the digest of its elements, tightly packed.
    fn accessor(&self, accessor: &Object, place: &str) -> Result<Object> {
        let data = self.elements(accessor, place)?;
        let mut out = without(accessor, &["bufferView", "byteOffset", "sparse", "normalized"]);
        if accessor.get("normalized") == Some(&Value::Bool(true)) {
            out.insert("normalized".into(), true.into());
        }
        out.insert("elements".into(), digest_bytes(&data).into());
        Ok(out)
    }

    /// The elements of an accessor, tightly packed.
    pub fn elements(&self, accessor: &Object, place: &str) -> Result<Vec<u8>> {
        let element = Element::of(accessor, place)?;
        let count = required(accessor, "count", place)?;
        let too_large = || fault(place, format!("{count} elements are too many"));
        let Some(total) = count.checked_mul(element.packed()) else { return too_large() };
        let mut data = match number(accessor, "bufferView", place)? {
            Some(index) => {
                let (view, stride) = self.view(index, place)?;
                let offset = number(accessor, "byteOffset", place)?.unwrap_or(0);
                element.gather(view, offset, stride, count, place)?
            }
            None if total > MAX_ZEROS => return too_large(),
            None => vec![0; total as usize],
        };
        if let Some(sparse) = accessor.get("sparse") {
            self.overlay(sparse, &element, &mut data, &format!("{place}.sparse"))?;
        }
        Ok(data)
    }

    /// Puts the values of a sparse accessor in their places.
    fn overlay(&self, sparse: &Value, element: &Element, data: &mut [u8], place: &str) -> Result<()> {
        let objects =
            [Some(sparse), sparse.get("indices"), sparse.get("values")].map(|v| v.and_then(|v| v.as_object()));
        let [Some(sparse), Some(indices), Some(values)] = objects else {
            return fault(place, "it needs `count`, `indices` and `values`");
        };
        let count = required(sparse, "count", place)?;
        let gather = |part: &Object, element: &Element| -> Result<Vec<u8>> {
            let (view, _) = self.view(required(part, "bufferView", place)?, place)?;
            element.gather(view, number(part, "byteOffset", place)?.unwrap_or(0), None, count, place)
        };
        let index =
            Element { columns: 1, rows: 1, size: component_size(required(indices, "componentType", place)?, place)? };
        let places = gather(indices, &index)?;
        let values = gather(values, element)?;
        let len = element.packed() as usize;
        for (at, value) in places.chunks_exact(index.size as usize).zip(values.chunks_exact(len)) {
            let at = at.iter().rev().fold(0u64, |n, b| n << 8 | u64::from(*b));
            match part_mut(data, at.saturating_mul(len as u64), len) {
                Some(slot) => slot.copy_from_slice(value),
                None => return fault(place, format!("index {at} lies outside of the accessor")),
            }
        }
        Ok(())
    }

    /// An image whose `content` is the digest of its pixels, or of its bytes if they are of a format not decoded here.
    fn image(&self, image: &Object, place: &str) -> Result<Object> {
        let uri = image.get("uri").and_then(|uri| uri.as_str());
        let bytes = match (number(image, "bufferView", place)?, uri.and_then(data_uri)) {
            (Some(index), _) => Cow::Borrowed(self.view(index, place)?.0),
            (None, Some(bytes)) => Cow::Owned(bytes),
            // Outside of the file: the name is all that the file says.
            (None, None) => return Ok(image.clone()),
        };
        let content = match decode_pixels(&bytes, &Limits::default()) {
            Ok(pixels) => digest_pixels(&pixels),
            Err(ImageError::Unknown { .. }) => digest_bytes(&bytes),
            Err(error) => return fault(place, error.to_string()),
        };
        let mut out = without(image, &["bufferView", "uri", "mimeType"]);
        out.insert("content".into(), content.into());
        Ok(out)
    }

    /// Any other part of the document: `bufferView`s, which only extensions have there, stand for their bytes.
    fn resolved(&self, value: &Value, place: &str) -> Result<Value> {
        Ok(match value {
            Value::Array(list) => {
                let items = list.iter().enumerate().map(|(i, v)| self.resolved(v, &format!("{place}[{i}]")));
                Value::Array(items.collect::<Result<_>>()?)
            }
            Value::Object(object) => {
                let items = object.iter().map(|(key, v)| {
                    let v = match (key.as_str(), v.as_u64()) {
                        ("extras", _) => v.clone(),
                        ("bufferView", Some(index)) => digest_bytes(self.view(index, place)?.0).into(),
                        _ => self.resolved(v, &format!("{place}.{key}"))?,
                    };
                    Ok((key.clone(), v))
                });
                Value::Object(items.collect::<Result<_>>()?)
            }
            other => other.clone(),
        })
    }
}

/// The shape of one element; columns of matrices start at multiples of four bytes (glTF 2.0, 3.6.2.4).
struct Element {
    columns: u64,
    rows: u64,
    size: u64,
}

impl Element {
    fn of(accessor: &Object, place: &str) -> Result<Element> {
        let kind = accessor.get("type").and_then(|t| t.as_str()).unwrap_or_default();
        let (columns, rows) = match kind {
            "SCALAR" => (1, 1),
            "VEC2" => (1, 2),
            "VEC3" => (1, 3),
            "VEC4" => (1, 4),
            "MAT2" => (2, 2),
            "MAT3" => (3, 3),
            "MAT4" => (4, 4),
            _ => return fault(place, format!("type `{kind}`; expected SCALAR, VEC2 to VEC4 or MAT2 to MAT4")),
        };
        let size = component_size(required(accessor, "componentType", place)?, place)?;
        Ok(Element { columns, rows, size })
    }

    /// Bytes without padding.
    fn packed(&self) -> u64 {
        self.columns * self.rows * self.size
    }

    /// Copies `count` elements out of a view.
    fn gather(&self, view: &[u8], offset: u64, stride: Option<u64>, count: u64, place: &str) -> Result<Vec<u8>> {
        let column = self.rows * self.size;
        let step = if self.columns > 1 { column.next_multiple_of(4) } else { column };
        let span = (self.columns - 1) * step + column;
        let stride = stride.unwrap_or(self.columns * step);
        if stride < span {
            return fault(place, format!("stride {stride} for elements of {span} bytes"));
        }
        if count == 0 {
            return Ok(Vec::new());
        }
        let end = (count - 1).checked_mul(stride).and_then(|n| n.checked_add(span)).and_then(|n| n.checked_add(offset));
        if end.is_none_or(|end| end > view.len() as u64) {
            return fault(
                place,
                format!("{count} elements from byte {offset} lie outside of a view of {} bytes", view.len()),
            );
        }
        let mut out = Vec::with_capacity((count * self.packed()) as usize);
        for i in 0..count {
            for c in 0..self.columns {
                let at = (offset + i * stride + c * step) as usize;
                out.extend_from_slice(&view[at..at + column as usize]);
            }
        }
        Ok(out)
    }
}

fn component_size(code: u64, place: &str) -> Result<u64> {
    match code {
        5120 | 5121 => Ok(1),
        5122 | 5123 => Ok(2),
        5125 | 5126 => Ok(4),
        _ => fault(place, format!("component type {code}; expected 5120 to 5123, 5125 or 5126")),
    }
}

pub(super) fn list<'a>(object: &'a Object, key: &str) -> &'a [Value] {
    object.get(key).and_then(|v| v.as_array()).map_or(&[], |v| v.as_slice())
}

fn number(object: &Object, key: &str, place: &str) -> Result<Option<u64>> {
    match object.get(key) {
        None => Ok(None),
        Some(value) => match value.as_u64() {
            Some(number) => Ok(Some(number)),
            None => fault(place, format!("`{key}` is {value}; expected a whole number from 0")),
        },
    }
}

fn required(object: &Object, key: &str, place: &str) -> Result<u64> {
    match number(object, key, place)? {
        Some(number) => Ok(number),
        None => fault(place, format!("`{key}` is missing")),
    }
}

fn part(bytes: &[u8], start: u64, len: u64) -> Option<&[u8]> {
    bytes.get(usize::try_from(start).ok()?..)?.get(..usize::try_from(len).ok()?)
}

fn part_mut(bytes: &mut [u8], start: u64, len: usize) -> Option<&mut [u8]> {
    bytes.get_mut(usize::try_from(start).ok()?..)?.get_mut(..len)
}

fn without(object: &Object, keys: &[&str]) -> Object {
    object.iter().filter(|(k, _)| !keys.contains(&k.as_str())).map(|(k, v)| (k.clone(), v.clone())).collect()
}

fn data_uri(uri: &str) -> Option<Vec<u8>> {
    base64::decode(uri.strip_prefix("data:")?.split_once(";base64,")?.1)
}

/// JSON with sorted keys and one spelling per number, whatever order the map type keeps.
fn write_canonical(value: &Value, out: &mut Vec<u8>) {
    match value {
        Value::Array(items) => {
            out.push(b'[');
            for item in items {
                write_canonical(item, out);
                out.push(b',');
            }
            out.push(b']');
        }
        Value::Object(object) => {
            let mut keys: Vec<&String> = object.keys().collect();
            keys.sort();
            out.push(b'{');
            for key in keys {
                out.extend(Value::from(key.as_str()).to_string().bytes());
                out.push(b':');
                write_canonical(&object[key.as_str()], out);
                out.push(b',');
            }
            out.push(b'}');
        }
        // 1, 1.0 and 1e0 are one number to JSON.
        Value::Number(n) if !n.is_f64() => out.extend(n.to_string().bytes()),
        Value::Number(n) => out.extend(n.as_f64().unwrap_or_default().to_string().bytes()),
        other => out.extend(other.to_string().bytes()),
    }
}

#[cfg(test)]
#[path = "digest_glb_tests.rs"]
mod tests;
