//! What of a scene differs, in words: which attribute of which mesh moved, and by how much.
//!
//! In: two GLBs. Out: a line for each attribute whose elements are not the same, then for each other part. What the
//! digest does not look at (layout, compression, generator) is no difference here either.
//! Unaware of: which one is golden.

use super::digest_glb::{DigestError, Document, Object, content, list, read};
use serde_json::Value;
use std::collections::BTreeMap;

/// The differences of two GLBs, in words; none if their digests are the same.
pub fn compare_glb(expected: &[u8], actual: &[u8]) -> std::result::Result<Vec<String>, DigestError> {
    let (old_root, old_bin) = read(expected)?;
    let (new_root, new_bin) = read(actual)?;
    let [old_data, new_data] = [Document::new(&old_root, old_bin)?, Document::new(&new_root, new_bin)?];
    let [old, new] = [content(&old_root, &old_data)?, content(&new_root, &new_data)?];
    let [old_used, new_used] = [attributes(&old_root), attributes(&new_root)];
    let mut said = Vec::new();
    for (name, old_accessor) in &old_used {
        match new_used.get(name) {
            None => said.push(format!("{name} is gone")),
            Some(new_accessor) => {
                let place = name.as_str();
                let old = (*old_accessor, old_data.elements(old_accessor, place)?);
                said.extend(moved(name, old, (*new_accessor, new_data.elements(new_accessor, place)?)));
            }
        }
    }
    said.extend(new_used.keys().filter(|name| !old_used.contains_key(*name)).map(|name| format!("{name} is new")));
    let mut keys: Vec<&String> = old.keys().chain(new.keys()).collect();
    keys.sort_unstable();
    keys.dedup();
    // Attributes have been told one by one.
    let told = !said.is_empty();
    let differs = |key: &&String| old.get(*key) != new.get(*key) && !(told && key.as_str() == "accessors");
    said.extend(keys.into_iter().filter(differs).map(|key| format!("`{key}` differ")));
    Ok(said)
}

/// Accessors by what they are used for in meshes.
fn attributes(root: &Object) -> BTreeMap<String, &Object> {
    let accessors = list(root, "accessors");
    let mut used = BTreeMap::new();
    for (m, mesh) in list(root, "meshes").iter().enumerate() {
        let primitives = mesh.get("primitives").and_then(Value::as_array).map_or(&[][..], Vec::as_slice);
        for (p, primitive) in primitives.iter().enumerate() {
            let named = primitive.get("attributes").and_then(Value::as_object).into_iter().flatten();
            let indices = primitive.get("indices").map(|index| ("indices", index));
            for (name, index) in named.map(|(name, index)| (name.as_str(), index)).chain(indices) {
                let accessor = index.as_u64().and_then(|i| accessors.get(i as usize)).and_then(Value::as_object);
                used.extend(accessor.map(|a| (format!("{name} of mesh {m}, primitive {p}"), a)));
            }
        }
    }
    used
}

/// How the elements of an attribute differ.
fn moved(name: &str, (old, a): (&Object, Vec<u8>), (new, b): (&Object, Vec<u8>)) -> Option<String> {
    let shape = |o: &Object| ["type", "componentType", "count", "normalized"].map(|key| o.get(key).cloned());
    if shape(old) != shape(new) {
        let count = |o: &Object| o.get("count").and_then(Value::as_u64).unwrap_or(0);
        return Some(format!("{name}: expected {} elements, found {}, or of another type", count(old), count(new)));
    }
    if a == b {
        return None;
    }
    let count = old.get("count").and_then(Value::as_u64).unwrap_or(1).max(1) as usize;
    let size = (a.len() / count).max(1);
    let pairs = a.chunks(size).zip(b.chunks(size));
    let differing = pairs.filter(|(a, b)| a != b).count();
    let component = old.get("componentType").and_then(Value::as_u64).unwrap_or(0);
    let [a, b] = [&a, &b].map(|bytes| values(bytes, component));
    let most = a.iter().zip(&b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    Some(format!("{name}: {differing} of {count} elements differ, by at most {most:.3e}"))
}

/// The numbers of packed elements, as they are stored.
fn values(bytes: &[u8], component: u64) -> Vec<f64> {
    fn each<const N: usize>(bytes: &[u8], number: impl Fn([u8; N]) -> f64) -> Vec<f64> {
        bytes.as_chunks::<N>().0.iter().map(|b| number(*b)).collect()
    }
    match component {
        5120 => each(bytes, |b| f64::from(i8::from_le_bytes(b))),
        5122 => each(bytes, |b| f64::from(i16::from_le_bytes(b))),
        5123 => each(bytes, |b| f64::from(u16::from_le_bytes(b))),
        5125 => each(bytes, |b| f64::from(u32::from_le_bytes(b))),
        5126 => each(bytes, |b| f64::from(f32::from_le_bytes(b))),
        _ => bytes.iter().map(|b| f64::from(*b)).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn glb(json: &Value, bin: &[u8]) -> Vec<u8> {
        let mut json = json.to_string().into_bytes();
        json.resize(json.len().next_multiple_of(4), b' ');
        let mut out = b"glTF\x02\0\0\0".to_vec();
        out.extend(((12 + 8 + json.len() + 8 + bin.len()) as u32).to_le_bytes());
        for (kind, part) in [(b"JSON", json.as_slice()), (b"BIN\0", bin)] {
            out.extend((part.len() as u32).to_le_bytes());
            out.extend(kind);
            out.extend(part);
        }
        out
    }

    /// Three points with coordinates.
    fn scene(uv: [f32; 6], name: &str) -> Vec<u8> {
        let json = json!({
            "asset": { "version": "2.0" },
            "nodes": [{ "name": name, "mesh": 0 }],
            "meshes": [{ "primitives": [{ "attributes": { "TEXCOORD_1": 0 } }] }],
            "accessors": [{ "bufferView": 0, "componentType": 5126, "type": "VEC2", "count": 3 }],
            "bufferViews": [{ "buffer": 0, "byteLength": 24 }],
            "buffers": [{ "byteLength": 24 }],
        });
        glb(&json, &uv.map(f32::to_le_bytes).concat())
    }

    #[test]
    fn a_moved_coordinate_is_told_with_its_distance() {
        let uv = [0.0, 0.25, 0.5, 0.75, 1.0, 0.0];
        let old = scene(uv, "a");
        assert!(compare_glb(&old, &old).unwrap().is_empty());
        let mut moved = uv;
        moved[3] = 0.5;
        let said = compare_glb(&old, &scene(moved, "a")).unwrap();
        assert_eq!(said, ["TEXCOORD_1 of mesh 0, primitive 0: 1 of 3 elements differ, by at most 2.500e-1"]);
        assert_eq!(compare_glb(&old, &scene(uv, "b")).unwrap(), ["`nodes` differ"]);
    }

    #[test]
    fn attributes_come_and_go_and_change_their_shape() {
        let with = |attributes: Value, count: u32| {
            let accessor = json!({ "bufferView": 0, "componentType": 5121, "type": "SCALAR", "count": count });
            let json = json!({
                "meshes": [{ "primitives": [{ "attributes": attributes }] }], "accessors": [accessor],
                "bufferViews": [{ "buffer": 0, "byteLength": 4 }], "buffers": [{ "byteLength": 4 }],
            });
            glb(&json, &[1, 2, 3, 4])
        };
        let old = with(json!({ "_A": 0 }), 4);
        let said = compare_glb(&old, &with(json!({ "_B": 0 }), 4)).unwrap();
        assert_eq!(said[..2], ["_A of mesh 0, primitive 0 is gone", "_B of mesh 0, primitive 0 is new"]);
        let said = compare_glb(&old, &with(json!({ "_A": 0 }), 3)).unwrap();
        assert!(said[0].contains("expected 4 elements, found 3"), "{said:?}");
        assert!(compare_glb(&old, b"none").is_err());
    }
}
