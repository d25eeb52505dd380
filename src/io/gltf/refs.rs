//! Which numbers in a document are indices, and of what: one table for checking, for finding what is in use and for
//! renumbering nothing by accident.
//!
//! Source: glTF 2.0, 5 (properties reference), and the extensions named in the table.
//! Reads as: an extension that is not known here may refer to anything, so every integer in it counts as an index of
//! every kind of data.

use std::collections::BTreeSet;

use serde_json::Value;

use crate::io::SceneError;

/// What an index counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Kind {
    Scene,
    Node,
    Mesh,
    Skin,
    Camera,
    Material,
    Accessor,
    View,
    Buffer,
    Texture,
    Image,
    Sampler,
}

impl Kind {
    /// Name of the array at the root.
    pub(super) fn array(self) -> &'static str {
        match self {
            Kind::Scene => "scenes",
            Kind::Node => "nodes",
            Kind::Mesh => "meshes",
            Kind::Skin => "skins",
            Kind::Camera => "cameras",
            Kind::Material => "materials",
            Kind::Accessor => "accessors",
            Kind::View => "bufferViews",
            Kind::Buffer => "buffers",
            Kind::Texture => "textures",
            Kind::Image => "images",
            Kind::Sampler => "samplers",
        }
    }
}

/// `[]` steps into each entry of an array, `{}` into each of an object.
const TABLE: &[(&str, Kind)] = &[
    ("scene", Kind::Scene),
    ("scenes[].nodes[]", Kind::Node),
    ("nodes[].children[]", Kind::Node),
    ("nodes[].mesh", Kind::Mesh),
    ("nodes[].skin", Kind::Skin),
    ("nodes[].camera", Kind::Camera),
    ("nodes[].extensions.EXT_mesh_gpu_instancing.attributes{}", Kind::Accessor),
    ("meshes[].primitives[].attributes{}", Kind::Accessor),
    ("meshes[].primitives[].targets[]{}", Kind::Accessor),
    ("meshes[].primitives[].indices", Kind::Accessor),
    ("meshes[].primitives[].material", Kind::Material),
    ("meshes[].primitives[].extensions.KHR_draco_mesh_compression.bufferView", Kind::View),
    ("meshes[].primitives[].extensions.KHR_materials_variants.mappings[].material", Kind::Material),
    ("accessors[].bufferView", Kind::View),
    ("accessors[].sparse.indices.bufferView", Kind::View),
    ("accessors[].sparse.values.bufferView", Kind::View),
    ("bufferViews[].buffer", Kind::Buffer),
    ("bufferViews[].extensions.EXT_meshopt_compression.buffer", Kind::Buffer),
    ("bufferViews[].extensions.KHR_meshopt_compression.buffer", Kind::Buffer),
    ("images[].bufferView", Kind::View),
    ("textures[].source", Kind::Image),
    ("textures[].sampler", Kind::Sampler),
    ("textures[].extensions.KHR_texture_basisu.source", Kind::Image),
    ("textures[].extensions.EXT_texture_webp.source", Kind::Image),
    ("textures[].extensions.EXT_texture_avif.source", Kind::Image),
    ("textures[].extensions.MSFT_texture_dds.source", Kind::Image),
    ("skins[].inverseBindMatrices", Kind::Accessor),
    ("skins[].skeleton", Kind::Node),
    ("skins[].joints[]", Kind::Node),
    ("animations[].samplers[].input", Kind::Accessor),
    ("animations[].samplers[].output", Kind::Accessor),
    ("animations[].channels[].target.node", Kind::Node),
];

/// Extensions whose indices are all in the table, or are those of textures in materials, or are of nothing above.
const KNOWN: &[&str] = &[
    "EXT_mesh_gpu_instancing",
    "EXT_meshopt_compression",
    "EXT_texture_avif",
    "EXT_texture_webp",
    "KHR_animation_pointer",
    "KHR_draco_mesh_compression",
    "KHR_lights_punctual",
    "KHR_mesh_quantization",
    "KHR_meshopt_compression",
    "KHR_node_visibility",
    "KHR_texture_basisu",
    "KHR_texture_transform",
    "KHR_xmp_json_ld",
    "KILN_uv_sets",
    "MSFT_texture_dds",
];

/// Whether all indices of an extension are understood. Those of materials hold their textures alike.
pub(super) fn is_known(extension: &str) -> bool {
    KNOWN.contains(&extension) || extension.starts_with("KHR_materials_")
}

/// One step into JSON.
#[derive(Clone, Copy, Debug)]
pub(super) enum Step<'a> {
    Key(&'a str),
    Index(usize),
}

/// A place as text: `meshes[0].primitives[0].indices`.
pub(super) fn text(path: &[Step]) -> String {
    let mut out = String::new();
    for step in path {
        match step {
            Step::Key(k) if out.is_empty() => out.push_str(k),
            Step::Key(k) => out.extend([".", k]),
            Step::Index(i) => out.push_str(&format!("[{i}]")),
        }
    }
    out
}

type Visit<'f, 'a> = &'f mut dyn FnMut(Kind, &[Step<'a>], &'a Value);

/// Calls `f` for every index of the document, in a fixed order. Removed (null) entries hold none.
pub(super) fn each<'a>(root: &'a Value, f: Visit<'_, 'a>) {
    let mut path = Vec::new();
    for (pattern, kind) in TABLE {
        walk(root, pattern, *kind, &mut path, f);
    }
    for (i, material) in list(root, "materials").iter().enumerate() {
        path.extend([Step::Key("materials"), Step::Index(i)]);
        textures(material, &mut path, f);
        path.clear();
    }
}

fn walk<'a>(value: &'a Value, pattern: &'static str, kind: Kind, path: &mut Vec<Step<'a>>, f: Visit<'_, 'a>) {
    if pattern.is_empty() {
        if !value.is_null() {
            f(kind, path, value);
        }
        return;
    }
    let depth = path.len();
    if let Some(rest) = pattern.strip_prefix("[]") {
        for (i, v) in value.as_array().into_iter().flatten().enumerate() {
            path.push(Step::Index(i));
            walk(v, rest, kind, path, f);
            path.truncate(depth);
        }
    } else if let Some(rest) = pattern.strip_prefix("{}") {
        for (k, v) in value.as_object().into_iter().flatten() {
            path.push(Step::Key(k));
            walk(v, rest, kind, path, f);
            path.truncate(depth);
        }
    } else {
        let pattern = pattern.strip_prefix('.').unwrap_or(pattern);
        let (name, rest) = pattern.split_at(pattern.find(['.', '[', '{']).unwrap_or(pattern.len()));
        if let Some(v) = value.get(name) {
            path.push(Step::Key(name));
            walk(v, rest, kind, path, f);
            path.truncate(depth);
        }
    }
}

/// Texture infos anywhere in a material, extensions included: objects under a key that ends in "Texture".
fn textures<'a>(value: &'a Value, path: &mut Vec<Step<'a>>, f: Visit<'_, 'a>) {
    for (key, v) in value.as_object().into_iter().flatten().filter(|(k, _)| *k != "extras") {
        path.push(Step::Key(key));
        if let Some(index) = v.get("index").filter(|i| key.ends_with("Texture") && !i.is_null()) {
            path.push(Step::Key("index"));
            f(Kind::Texture, path, index);
            path.pop();
        }
        textures(v, path, f);
        path.pop();
    }
}

/// An array at the root; empty if there is none.
pub(super) fn list<'a>(root: &'a Value, name: &str) -> &'a [Value] {
    root.get(name).and_then(Value::as_array).map_or(&[], Vec::as_slice)
}

/// An index in an object that was checked.
pub(super) fn index(object: &Value, key: &str) -> Option<usize> {
    object.get(key).and_then(Value::as_u64).map(|i| i as usize)
}

/// Every index is an integer below the length of its array, else the first fault.
pub(super) fn check(root: &Value) -> Result<(), SceneError> {
    let mut fault = None;
    each(root, &mut |kind, path, value| {
        let n = list(root, kind.array()).len();
        if fault.is_none() && value.as_u64().is_none_or(|i| i >= n as u64) {
            let what = format!("{value} is no index into `{}`: there are {n}", kind.array());
            fault = Some(SceneError::at(text(path), what));
        }
    });
    fault.map_or(Ok(()), Err)
}

/// Per entry of one array whether anything refers to it, or may.
pub(super) fn in_use(root: &Value, wanted: Kind) -> Vec<bool> {
    let mut used = vec![false; list(root, wanted.array()).len()];
    let mut mark = |i: u64| {
        if let Some(u) = usize::try_from(i).ok().and_then(|i| used.get_mut(i)) {
            *u = true;
        }
    };
    each(root, &mut |kind, _, value| {
        if let Some(i) = value.as_u64().filter(|_| kind == wanted) {
            mark(i);
        }
    });
    unknown_numbers(root).into_iter().for_each(mark);
    used
}

/// All integers in extensions that are not understood.
pub(super) fn unknown_numbers(root: &Value) -> BTreeSet<u64> {
    fn go(value: &Value, inside: bool, out: &mut BTreeSet<u64>) {
        match value {
            Value::Number(n) if inside => out.extend(n.as_u64()),
            Value::Array(a) => a.iter().for_each(|v| go(v, inside, out)),
            Value::Object(o) => {
                for (key, v) in o.iter().filter(|(k, _)| inside || *k != "extras") {
                    match v.as_object().filter(|_| key == "extensions" && !inside) {
                        Some(all) => all.iter().for_each(|(name, v)| go(v, !is_known(name), out)),
                        None => go(v, inside, out),
                    }
                }
            }
            _ => {}
        }
    }
    let mut out = BTreeSet::new();
    go(root, false, &mut out);
    out
}

/// Names of all extension objects in the document.
pub(super) fn extension_names(root: &Value) -> BTreeSet<String> {
    fn go(value: &Value, out: &mut BTreeSet<String>) {
        match value {
            Value::Array(a) => a.iter().for_each(|v| go(v, out)),
            Value::Object(o) => {
                for (key, v) in o.iter().filter(|(k, _)| *k != "extras") {
                    if let Some(all) = v.as_object().filter(|_| key == "extensions") {
                        out.extend(all.keys().cloned());
                    }
                    go(v, out);
                }
            }
            _ => {}
        }
    }
    let mut out = BTreeSet::new();
    go(root, &mut out);
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn indices_are_found_named_and_checked() {
        let mut root = json!({
            "accessors": [{}, {}], "textures": [{}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 1}, "targets": [{"POSITION": 0}]}]}],
            "materials": [{"extensions": {"KHR_materials_clearcoat": {"clearcoatTexture": {"index": 0}}}}],
            "nodes": [{"extensions": {"ACME": {"deep": [{"view": 3}], "scale": 0.5}}}],
        });
        let mut seen = Vec::new();
        each(&root, &mut |_, path, v| seen.push(format!("{}={v}", text(path))));
        assert_eq!(
            seen,
            [
                "meshes[0].primitives[0].attributes.POSITION=1",
                "meshes[0].primitives[0].targets[0].POSITION=0",
                "materials[0].extensions.KHR_materials_clearcoat.clearcoatTexture.index=0",
            ]
        );
        assert_eq!(check(&root), Ok(()));
        assert_eq!(unknown_numbers(&root), [3].into());
        root["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = json!(99);
        let text = check(&root).unwrap_err().to_string();
        assert_eq!(text, "meshes[0].primitives[0].attributes.POSITION: 99 is no index into `accessors`: there are 2");
        root["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = json!(4294967296u64);
        assert!(check(&root).is_err());
    }
}
