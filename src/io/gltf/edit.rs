//! Changing a document without leaving behind what was replaced: slots of accessors, views, textures, images and
//! samplers that nothing refers to any more are used again, all other indices stay.
//!
//! In: a document; then edits of its JSON, `release`, additions. Out: a self-contained .glb.
//! Reads as: bytes keep their order; ranges that overlap stay one. An entry that could neither be used again nor cut
//! off the end of its array becomes a copy of the next one, which costs no bytes of data.
//! Unaware of: what the data mean.

use std::collections::{BTreeMap, BTreeSet};

use serde_json::{Value, json};

use super::accessor::{self, Component, Format};
use super::container::{self, Bin};
use super::document::Document;
use super::refs::{self, Kind, Step, index, list};
use super::uri;
use super::validate::Semantic;
use crate::io::SceneError;

/// What is used again once it is free. An order in which users come before what they use.
const REUSED: [Kind; 5] = [Kind::Accessor, Kind::Texture, Kind::Image, Kind::Sampler, Kind::View];

/// What a .glb can hold.
const MAX_BYTES: usize = u32::MAX as usize;

/// What a buffer view is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Target {
    Vertices,
    Indices,
}

/// A document being changed.
pub(super) struct Editor<'a> {
    pub(super) doc: &'a Document,
    pub(super) root: Value,
    used_before: BTreeMap<Kind, Vec<bool>>,
    /// Free slots, the lowest last.
    free: BTreeMap<Kind, Vec<usize>>,
    /// Bytes of the views that are not those of the document.
    written: BTreeMap<usize, Vec<u8>>,
    /// Bytes written so far. Beyond what fits a file they are only counted.
    total: usize,
}

impl<'a> Editor<'a> {
    pub(super) fn new(doc: &'a Document) -> Self {
        let used_before = REUSED.map(|k| (k, refs::in_use(&doc.root, k))).into();
        Editor { doc, root: doc.root.clone(), used_before, free: BTreeMap::new(), written: BTreeMap::new(), total: 0 }
    }

    /// An entry of an array at the root.
    pub(super) fn entry(&mut self, kind: Kind, i: usize) -> &mut Value {
        &mut self.root[kind.array()][i]
    }

    /// A primitive.
    pub(super) fn primitive(&mut self, mesh: u32, primitive: u32) -> &mut Value {
        &mut self.root["meshes"][mesh as usize]["primitives"][primitive as usize]
    }

    /// Frees what was in use and is no longer. To be called once, between taking away and adding.
    pub(super) fn release(&mut self) {
        for kind in REUSED {
            let now = refs::in_use(&self.root, kind);
            let lost = |&i: &usize| self.used_before[&kind][i] && !now[i];
            let free: Vec<usize> = (0..now.len()).filter(lost).rev().collect();
            for &i in &free {
                self.root[kind.array()][i] = Value::Null;
            }
            self.free.insert(kind, free);
        }
    }

    /// Adds an entry, in a free slot if there is one.
    pub(super) fn add(&mut self, kind: Kind, value: Value) -> usize {
        if let Some(i) = self.free.get_mut(&kind).and_then(Vec::pop) {
            self.root[kind.array()][i] = value;
            return i;
        }
        if !self.root[kind.array()].is_array() {
            self.root[kind.array()] = json!([]);
        }
        let array = self.root[kind.array()].as_array_mut();
        array.map_or(0, |a| {
            a.push(value);
            a.len() - 1
        })
    }

    /// Adds a view of bytes of its own.
    pub(super) fn view(&mut self, bytes: Vec<u8>) -> usize {
        let i = self.add(Kind::View, json!({"buffer": 0, "byteLength": bytes.len()}));
        self.total += bytes.len();
        self.written.insert(i, if self.total > MAX_BYTES { Vec::new() } else { bytes });
        i
    }

    /// Adds an accessor of packed elements with a view of its own; `like` gives name and extras.
    pub(super) fn accessor(
        &mut self,
        like: Option<usize>,
        format: Format,
        packed: Vec<u8>,
        target: Target,
        bounds: bool,
    ) -> usize {
        let (size, count) = (format.size(), packed.len() / format.size());
        let mut value = match like {
            Some(i) => self.doc.root["accessors"][i].clone(),
            None => json!({}),
        };
        if let Some(v) = value.as_object_mut() {
            v.retain(|k, _| !["byteOffset", "sparse", "min", "max", "normalized"].contains(&k.as_str()));
        }
        value["componentType"] = format.component.code().into();
        value["type"] = format.shape.into();
        value["count"] = count.into();
        if format.normalized {
            value["normalized"] = true.into();
        }
        if bounds {
            let (least, most) = bounds_of(format, &packed);
            (value["min"], value["max"]) = (least, most);
        }
        let stride = size.next_multiple_of(4);
        let padded = if stride == size || target == Target::Indices {
            packed
        } else {
            let pad = |e: &[u8]| [e, &[0; 3][..stride - size]].concat();
            packed.chunks_exact(size).flat_map(pad).collect()
        };
        let view = self.view(padded);
        let entry = self.entry(Kind::View, view);
        entry["target"] = if target == Target::Vertices { 34962 } else { 34963 }.into();
        if target == Target::Vertices && stride != size {
            entry["byteStride"] = stride.into();
        }
        value["bufferView"] = view.into();
        self.add(Kind::Accessor, value)
    }

    /// Says that the file uses an extension, or cannot do without it.
    pub(super) fn declare(&mut self, name: &str, required: bool) {
        for key in ["extensionsUsed", "extensionsRequired"].into_iter().take(1 + usize::from(required)) {
            if !self.root[key].is_array() {
                self.root[key] = json!([]);
            }
            if let Some(names) = self.root[key].as_array_mut().filter(|n| !n.contains(&name.into())) {
                names.push(name.into());
            }
        }
    }

    /// Everything into one .glb.
    pub(super) fn finish(mut self) -> Result<Vec<u8>, SceneError> {
        if self.total > MAX_BYTES {
            return Err(SceneError::TooLarge(format!(
                "{} bytes of new data; at most {MAX_BYTES} fit a .glb",
                self.total
            )));
        }
        self.embed_images();
        self.compact_views();
        for kind in REUSED {
            self.cut_off_free_slots(kind);
        }
        let bin = self.lay_out();
        for kind in REUSED {
            self.fill_free_slots(kind);
        }
        self.undeclare();
        match self.root["buffers"].as_array_mut() {
            Some(buffers) if bin.len() > 0 && !buffers.is_empty() => {
                buffers.truncate(1);
                buffers[0]["byteLength"] = bin.len().into();
                buffers[0].as_object_mut().map(|b| b.remove("uri"));
            }
            _ if bin.len() > 0 => self.root["buffers"] = json!([{"byteLength": bin.len()}]),
            _ => drop(self.root.as_object_mut().map(|r| r.remove("buffers"))),
        }
        if let Some(root) = self.root.as_object_mut() {
            let lists = ["extensionsUsed", "extensionsRequired"].into_iter().chain(REUSED.map(Kind::array));
            for key in lists {
                if root.get(key).is_some_and(|v| v.is_null() || v.as_array().is_some_and(Vec::is_empty)) {
                    root.remove(key);
                }
            }
        }
        container::join(&self.root, bin)
    }

    /// Images in files of their own become views. The same file is embedded once.
    fn embed_images(&mut self) {
        let mut embedded: BTreeMap<String, usize> = BTreeMap::new();
        for (i, bytes) in self.doc.images.iter().enumerate() {
            let (Some(bytes), Some(path)) = (bytes, self.root["images"][i].get("uri").and_then(Value::as_str)) else {
                continue;
            };
            let path = path.to_string();
            let Some(mime) = mime_type(bytes) else { continue };
            let view = match embedded.get(&path) {
                Some(&v) => v,
                None => self.view(bytes.clone()),
            };
            let image = self.entry(Kind::Image, i);
            image["bufferView"] = view.into();
            image["mimeType"] = mime.into();
            if image.get("name").is_none()
                && let Ok(uri::Target::File(file)) = uri::target(&path)
            {
                let name = file.rsplit('/').next().unwrap_or_default();
                image["name"] = name.rsplit_once('.').map_or(name, |(stem, _)| stem).into();
            }
            image.as_object_mut().map(|o| o.remove("uri"));
            embedded.insert(path, view);
        }
    }

    /// Where some of the accessors of a view are gone, their bytes go too.
    fn compact_views(&mut self) {
        let mut lost: BTreeSet<usize> = BTreeSet::new();
        let mut users: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        for (i, before) in list(&self.doc.root, "accessors").iter().enumerate() {
            let now = list(&self.root, "accessors").get(i).unwrap_or(&Value::Null);
            match (index(before, "bufferView"), now == before) {
                (Some(v), true) => users.entry(v).or_default().push(i),
                (Some(v), false) => {
                    lost.insert(v);
                }
                _ => {}
            }
        }
        // Views that something else refers to, or may, stay as they are.
        refs::each(&self.root, &mut |kind, path, value| {
            let by_accessor = matches!(path, [Step::Key("accessors"), _, Step::Key("bufferView")]);
            if let Some(v) = value.as_u64().filter(|_| kind == Kind::View && !by_accessor) {
                lost.remove(&(v as usize));
            }
        });
        let unknown = refs::unknown_numbers(&self.root);
        lost.retain(|&v| !unknown.contains(&(v as u64)));
        for v in lost {
            if let (Some(users), false) = (users.get(&v), self.written.contains_key(&v)) {
                self.compact(v, users);
            }
        }
    }

    /// Keeps of a view only what its accessors read.
    fn compact(&mut self, v: usize, users: &[usize]) {
        let view = self.doc.views[v];
        let mut ranges: Vec<(usize, usize, usize)> = Vec::new();
        for &a in users {
            let accessor = &self.doc.accessors[a];
            let size = accessor.format.size();
            let start = index(&self.root["accessors"][a], "byteOffset").unwrap_or(0);
            ranges.push((start, start + (accessor.count - 1) * view.stride.unwrap_or(size) + size, a));
        }
        ranges.sort_unstable();
        let old = &self.doc.buffers[view.buffer][view.start..view.start + view.len];
        let mut bytes: Vec<u8> = Vec::new();
        // Old place of the first byte and of the end of what was copied last, and the new place of the first.
        let (mut first, mut end, mut to) = (0, 0, 0);
        for (start, stop, a) in ranges {
            if bytes.is_empty() || start > end {
                bytes.resize(bytes.len().next_multiple_of(4) + start % 4, 0);
                (first, end, to) = (start, start, bytes.len());
            }
            bytes.extend_from_slice(&old[end.min(stop)..stop]);
            end = end.max(stop);
            self.root["accessors"][a]["byteOffset"] = (to + start - first).into();
        }
        self.root["bufferViews"][v]["byteLength"] = bytes.len().into();
        self.written.insert(v, bytes);
    }

    fn cut_off_free_slots(&mut self, kind: Kind) {
        if let Some(entries) = self.root.get_mut(kind.array()).and_then(Value::as_array_mut) {
            let kept = entries.iter().rposition(|e| !e.is_null()).map_or(0, |i| i + 1);
            entries.truncate(kept);
        }
    }

    fn fill_free_slots(&mut self, kind: Kind) {
        let entries = self.root.get_mut(kind.array()).and_then(Value::as_array_mut);
        let mut next = Value::Null;
        for entry in entries.into_iter().flatten().rev() {
            if entry.is_null() {
                *entry = next.clone();
            } else {
                next = entry.clone();
                next.as_object_mut().map(|n| n.remove("name"));
            }
        }
    }

    /// Gives every view its place and collects the bytes: first those of the document in their order, then new ones.
    fn lay_out(&mut self) -> Bin<'a> {
        let live = list(&self.root, "bufferViews").iter().enumerate().filter(|(_, v)| !v.is_null()).map(|(i, _)| i);
        let (new, old): (Vec<usize>, Vec<usize>) = live.partition(|i| self.written.contains_key(i));
        let mut old: Vec<_> = old.into_iter().map(|i| (self.doc.views[i].buffer, self.doc.views[i].start, i)).collect();
        old.sort_unstable();
        let (doc, mut bin) = (self.doc, Bin::default());
        // What was copied last: its buffer, how far it goes there, and how far its places were moved.
        let mut run: Option<(usize, usize, isize)> = None;
        for (buffer, start, i) in old {
            let end = start + self.doc.views[i].len;
            let (copied, shift) = match run {
                Some((b, copied, shift)) if b == buffer && start <= copied.next_multiple_of(8) => (copied, shift),
                _ => {
                    bin.align(start % 8);
                    (start, bin.len() as isize - start as isize)
                }
            };
            if end > copied {
                bin.push(&doc.buffers[buffer][copied..end]);
            }
            run = Some((buffer, copied.max(end), shift));
            self.place(i, (start as isize + shift) as usize);
        }
        for i in new {
            bin.align(0);
            self.place(i, bin.len());
            bin.push(self.written.remove(&i).unwrap_or_default());
        }
        bin
    }

    fn place(&mut self, view: usize, at: usize) {
        let entry = self.entry(Kind::View, view);
        entry["buffer"] = 0.into();
        entry["byteOffset"] = at.into();
    }

    /// Takes extensions off the lists that were in use and are no longer.
    fn undeclare(&mut self) {
        let left = refs::extension_names(&self.root);
        let mut gone = refs::extension_names(&self.doc.root);
        gone.retain(|n| !left.contains(n));
        if !self.is_quantized() {
            gone.insert("KHR_mesh_quantization".into());
        }
        for key in ["extensionsUsed", "extensionsRequired"] {
            if let Some(names) = self.root.get_mut(key).and_then(Value::as_array_mut) {
                names.retain(|n| n.as_str().is_none_or(|n| !gone.contains(n)));
            }
        }
    }

    /// Whether some attribute needs KHR_mesh_quantization.
    fn is_quantized(&self) -> bool {
        let formats = accessor::formats(&self.root).unwrap_or_default();
        let mut found = false;
        refs::each(&self.root, &mut |kind, path, value| {
            if let (Kind::Accessor, [Step::Key("meshes"), .., Step::Key(name)]) = (kind, path) {
                let format = value.as_u64().and_then(|a| formats.get(a as usize));
                found |= Semantic::parse(name).zip(format).is_some_and(|(s, f)| !s.is_core(*f));
            }
        });
        found
    }
}

/// Least and greatest value per component.
fn bounds_of(format: Format, packed: &[u8]) -> (Value, Value) {
    let component = format.component;
    let (least, most) = match component {
        Component::F32 => extremes(format, packed, |b| Component::F32.read(b)),
        _ => extremes(format, packed, |b| component.read(b)),
    };
    let number = |v: f64| if component.unit() == 1.0 { json!(v) } else { json!(v as i64) };
    (least.into_iter().map(number).collect(), most.into_iter().map(number).collect())
}

fn extremes(format: Format, packed: &[u8], read: impl Fn(&[u8]) -> f64) -> (Vec<f64>, Vec<f64>) {
    let mut elements = packed.chunks_exact(format.size());
    let values = |e: &[u8]| -> Vec<f64> { e.chunks_exact(format.component.size()).map(&read).collect() };
    let mut least = elements.next().map_or(vec![], values);
    let mut most = least.clone();
    for e in elements {
        let now = e.chunks_exact(format.component.size()).map(&read);
        for ((v, least), most) in now.zip(&mut least).zip(&mut most) {
            (*least, *most) = (least.min(v), most.max(v));
        }
    }
    (least, most)
}

/// MIME type of an image by its first bytes.
fn mime_type(bytes: &[u8]) -> Option<&'static str> {
    match bytes {
        [0x89, b'P', b'N', b'G', ..] => Some("image/png"),
        [0xff, 0xd8, 0xff, ..] => Some("image/jpeg"),
        [0xab, b'K', b'T', b'X', ..] => Some("image/ktx2"),
        [b'R', b'I', b'F', b'F', _, _, _, _, b'W', b'E', b'B', b'P', ..] => Some("image/webp"),
        _ => None,
    }
}
