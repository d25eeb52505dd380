//! Materials of what was baked: their textures replaced, everything else kept.
//!
//! Source: glTF 2.0, 3.9 (materials); KHR_texture_basisu for KTX2 images; KHR_materials_variants.
//! In: the parts that were baked, and finished images. Out: changed entries in the document.
//! Reads as: a material that primitives outside the bake show as well stays as it is, and those inside get a copy.
//! Extensions that hold textures go, for the coordinates of those are no longer theirs; scalar ones stay.

use std::collections::{BTreeMap, BTreeSet};

use serde_json::{Map, Value, json};

use super::edit::Editor;
use super::refs::{Kind, index, list};
use crate::mesh::Part;

/// What a baked image is to a material.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Use {
    /// sRGB colour, alpha if there is any.
    BaseColor,
    /// Tangent-space normals, y up.
    Normal,
    /// Roughness in green, metalness in blue.
    MetallicRoughness,
    /// Occlusion in red, roughness in green, metalness in blue.
    OcclusionMetallicRoughness,
    /// Occlusion in red.
    Occlusion,
    /// sRGB emission.
    Emissive,
}

/// A finished image, encoded.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BakedImage {
    /// What it is.
    pub usage: Use,
    /// `image/png`, `image/jpeg` or `image/ktx2` (Basis, by KHR_texture_basisu).
    pub mime: String,
    /// The encoded file.
    pub bytes: Vec<u8>,
    /// Its name in the document.
    pub name: String,
}

/// How alpha counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum AlphaMode {
    /// Not at all.
    #[default]
    Opaque,
    /// Opaque from one half, else absent.
    Mask,
    /// As coverage.
    Blend,
}

/// The images of a bake and how materials show them.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct BakedMaps {
    /// Name of the material made for primitives that have none.
    pub material_name: String,
    /// At most one image per use.
    pub images: Vec<BakedImage>,
    /// What alpha of the base colour means.
    pub alpha: AlphaMode,
    /// The images go on at the other side, as a tile does.
    pub repeats: bool,
}

impl BakedMaps {
    /// Whether there is an image for a use.
    pub fn has(&self, usage: Use) -> bool {
        self.images.iter().any(|i| i.usage == usage)
    }
}

/// Gives each part a material of its own or of the bake, stripped of its textures; returns these materials, ascending.
///
/// `shift` is how far the input's sets of coordinates move up: other materials of the parts' variants follow.
pub(super) fn prepare(editor: &mut Editor, parts: &[Part], name: &str, shift: usize) -> Vec<usize> {
    let baked: BTreeSet<(u32, u32)> = parts.iter().map(|p| (p.mesh, p.primitive)).collect();
    let outside = shown_outside(&editor.root, &baked);
    let mut replaced: BTreeMap<Option<usize>, usize> = BTreeMap::new();
    for &(mesh, primitive) in &baked {
        let old = index(editor.primitive(mesh, primitive), "material");
        let new = match (replaced.get(&old), old) {
            (Some(&m), _) => m,
            (None, Some(m)) if !outside.contains(&m) => m,
            (None, Some(m)) => {
                let copy = editor.entry(Kind::Material, m).clone();
                editor.add(Kind::Material, copy)
            }
            (None, None) => editor.add(Kind::Material, json!({"name": name})),
        };
        replaced.insert(old, new);
        editor.primitive(mesh, primitive)["material"] = new.into();
    }
    let targets: BTreeSet<usize> = replaced.values().copied().collect();
    for &m in &targets {
        strip(editor.entry(Kind::Material, m));
    }
    shift_variants(editor, &baked, &replaced, shift);
    targets.into_iter().collect()
}

fn mappings(primitive: &Value) -> &[Value] {
    primitive.pointer("/extensions/KHR_materials_variants").map_or(&[], |v| list(v, "mappings"))
}

/// Materials of primitives that are not baked.
fn shown_outside(root: &Value, baked: &BTreeSet<(u32, u32)>) -> BTreeSet<usize> {
    let mut out = BTreeSet::new();
    for (m, mesh) in list(root, "meshes").iter().enumerate() {
        for (p, primitive) in list(mesh, "primitives").iter().enumerate() {
            if !baked.contains(&(m as u32, p as u32)) {
                out.extend(index(primitive, "material"));
                out.extend(mappings(primitive).iter().filter_map(|v| index(v, "material")));
            }
        }
    }
    out
}

/// Variants of baked primitives show materials that were not baked, on coordinates that moved up: they get copies.
fn shift_variants(
    editor: &mut Editor,
    baked: &BTreeSet<(u32, u32)>,
    replaced: &BTreeMap<Option<usize>, usize>,
    shift: usize,
) {
    let mut copies: BTreeMap<usize, usize> = BTreeMap::new();
    for &(mesh, primitive) in baked {
        for k in 0..mappings(editor.primitive(mesh, primitive)).len() {
            let Some(old) = index(&mappings(editor.primitive(mesh, primitive))[k], "material") else { continue };
            let new = match (replaced.get(&Some(old)), copies.get(&old)) {
                (Some(&m), _) | (None, Some(&m)) => m,
                (None, None) => {
                    let mut copy = editor.entry(Kind::Material, old).clone();
                    shift_coordinates(&mut copy, shift);
                    let m = editor.add(Kind::Material, copy);
                    copies.insert(old, m);
                    m
                }
            };
            editor.primitive(mesh, primitive)["extensions"]["KHR_materials_variants"]["mappings"][k]["material"] =
                new.into();
        }
    }
}

/// Adds `shift` to the set of coordinates of every texture in a material.
fn shift_coordinates(value: &mut Value, shift: usize) {
    for (key, v) in value.as_object_mut().into_iter().flatten().filter(|(k, _)| *k != "extras") {
        if key.ends_with("Texture") && v.get("index").is_some() {
            v["texCoord"] = (index(v, "texCoord").unwrap_or(0) + shift).into();
            if let Some(t) = v.pointer_mut("/extensions/KHR_texture_transform")
                && let Some(set) = index(t, "texCoord")
            {
                t["texCoord"] = (set + shift).into();
            }
        } else {
            shift_coordinates(v, shift);
        }
    }
}

/// Whether a texture is anywhere inside.
fn holds_texture(value: &Value) -> bool {
    value.as_object().into_iter().flatten().any(|(k, v)| (k.ends_with("Texture") && v.is_object()) || holds_texture(v))
}

/// Takes away textures and what goes with them.
fn strip(material: &mut Value) {
    let Some(m) = material.as_object_mut() else { return };
    if m.remove("emissiveTexture").is_some() {
        m.remove("emissiveFactor");
    }
    for key in ["normalTexture", "occlusionTexture", "alphaMode", "alphaCutoff"] {
        m.remove(key);
    }
    if let Some(pbr) = m.get_mut("pbrMetallicRoughness").and_then(Value::as_object_mut) {
        pbr.retain(|k, _| k != "baseColorTexture" && k != "metallicRoughnessTexture");
    }
    let stale = |name: &str, v: &Value| {
        holds_texture(v) || name == "KHR_materials_pbrSpecularGlossiness" || name == "KILN_uv_sets"
    };
    retain_in(m, "extensions", |name, v| !stale(name, v));
    retain_in(m, "extras", |name, _| name != "kiln");
}

/// Filters an object within an object, which goes when nothing is left of it.
fn retain_in(object: &mut Map<String, Value>, key: &str, keep: impl Fn(&str, &Value) -> bool) {
    if let Some(inner) = object.get_mut(key).and_then(Value::as_object_mut) {
        let before = inner.len();
        inner.retain(|k, v| keep(k, v));
        if before > 0 && inner.is_empty() {
            object.remove(key);
        }
    }
}

/// Puts the images into the document and onto the materials.
pub(super) fn fill(editor: &mut Editor, materials: &[usize], maps: &BakedMaps) {
    let mut textures: BTreeMap<Use, usize> = BTreeMap::new();
    if !maps.images.is_empty() {
        // LINEAR, LINEAR_MIPMAP_LINEAR, REPEAT or CLAMP_TO_EDGE.
        let wrap = if maps.repeats { 10497 } else { 33071 };
        let sampler = json!({"magFilter": 9729, "minFilter": 9987, "wrapS": wrap, "wrapT": wrap});
        let sampler = editor.add(Kind::Sampler, sampler);
        for image in &maps.images {
            let view = editor.view(image.bytes.clone());
            let entry = json!({"bufferView": view, "mimeType": image.mime, "name": image.name});
            let source = editor.add(Kind::Image, entry);
            let texture = if image.mime == "image/ktx2" {
                editor.declare("KHR_texture_basisu", true);
                json!({"sampler": sampler, "extensions": {"KHR_texture_basisu": {"source": source}}})
            } else {
                json!({"sampler": sampler, "source": source})
            };
            textures.insert(image.usage, editor.add(Kind::Texture, texture));
        }
    }
    for &m in materials {
        show(editor.entry(Kind::Material, m), &textures, maps.alpha);
    }
}

fn show(material: &mut Value, textures: &BTreeMap<Use, usize>, alpha: AlphaMode) {
    let texture = |usage: Use| textures.get(&usage).map(|t| json!({"index": t}));
    let orm = texture(Use::OcclusionMetallicRoughness);
    let pbr = &mut material["pbrMetallicRoughness"];
    if !pbr.is_object() {
        *pbr = json!({});
    }
    // Factors of one are the default and need no words.
    if let (Some(t), Some(pbr)) = (texture(Use::BaseColor), pbr.as_object_mut()) {
        pbr.remove("baseColorFactor");
        pbr.insert("baseColorTexture".into(), t);
    }
    match (texture(Use::MetallicRoughness).or(orm.clone()), pbr.as_object_mut()) {
        (Some(t), Some(pbr)) => {
            pbr.retain(|k, _| k != "metallicFactor" && k != "roughnessFactor");
            pbr.insert("metallicRoughnessTexture".into(), t);
        }
        _ => {
            pbr["metallicFactor"] = 0.into();
            pbr["roughnessFactor"] = 1.into();
        }
    }
    for (key, t) in [("normalTexture", texture(Use::Normal)), ("occlusionTexture", texture(Use::Occlusion).or(orm))] {
        if let Some(t) = t {
            material[key] = t;
        }
    }
    if let Some(t) = texture(Use::Emissive) {
        material["emissiveTexture"] = t;
        material["emissiveFactor"] = json!([1, 1, 1]);
    }
    match alpha {
        AlphaMode::Opaque => {}
        AlphaMode::Mask => material["alphaMode"] = "MASK".into(),
        AlphaMode::Blend => material["alphaMode"] = "BLEND".into(),
    }
}
