//! An atlas bake as a .glb: the input with new coordinates and textures.
//!
//! Source: glTF 2.0; tangents as MikkTSpace gives them, one per corner.
//! In: the document, its surface, coordinates and tangents per corner, images. Out: a self-contained .glb.
//! Reads as: triangles keep their order and vertices theirs; one is split only where its corners differ in what is new.
//! Vertices that no triangle uses are left out. Tangents go back into the object by the inverse transform; their sign
//! turns where the transform mirrors, for glTF's bitangent is that of the object.
//! Unaware of: how the atlas was made.

use super::edit::Editor;
use super::material::{self, BakedMaps, Use};
use super::nodes::Linear;
use super::primitive::{self, Stream};
use super::{Document, accessor::Component};
use crate::io::SceneError;
use crate::mesh::{Part, Surface};
use crate::numerics::vec::{Vec3, vec3};
use crate::texture::Uv;

/// What is new at each corner of a surface: three entries per face, in the order of its corners.
#[derive(Clone, Copy, Debug)]
pub struct AtlasCorners<'a> {
    /// Coordinates in the atlas.
    pub uv: &'a [Uv],
    /// Unit tangents in the world, with the sign of the bitangent. Without them the input's tangents, being those of
    /// other coordinates, are dropped.
    pub tangents: Option<&'a [[f32; 4]]>,
}

/// Writes an atlas bake.
///
/// The atlas becomes TEXCOORD_0, the input's sets move up by one. Normals are written where the input has none and
/// tangents or a normal map are given.
pub fn write_atlas(
    doc: &Document,
    surface: &Surface,
    corners: &AtlasCorners,
    maps: &BakedMaps,
) -> Result<Vec<u8>, SceneError> {
    let n = 3 * surface.mesh.faces.len();
    primitive::check_parts(doc, surface)?;
    primitive::check_length("atlas coordinates", corners.uv.len(), n)?;
    primitive::check_length("tangents", corners.tangents.map_or(n, <[_]>::len), n)?;
    let wants_normals = corners.tangents.is_some() || maps.has(Use::Normal);
    let mut editor = Editor::new(doc);
    let splits: Vec<Split> =
        surface.parts.iter().map(|part| split(doc, surface, part, corners, wants_normals)).collect();
    for (part, split) in surface.parts.iter().zip(&splits) {
        strip(&mut editor, part, split);
    }
    let materials = material::prepare(&mut editor, &surface.parts, &maps.material_name, 1);
    editor.release();
    for (part, split) in surface.parts.iter().zip(&splits) {
        write(&mut editor, part, split);
    }
    material::fill(&mut editor, &materials, maps);
    editor.finish()
}

/// What is new at one corner, as stored.
#[derive(Clone, Copy, PartialEq)]
struct New {
    uv: [f32; 2],
    tangent: [f32; 4],
    normal: [f32; 3],
}

impl New {
    /// Equal for equal values; zeros have no sign here.
    fn bits(&self) -> [u32; 9] {
        let all = self.uv.iter().chain(&self.tangent).chain(&self.normal);
        let mut out = [0; 9];
        out.iter_mut().zip(all).for_each(|(o, v)| *o = (v + 0.0).to_bits());
        out
    }
}

/// The vertices of a part after splitting.
struct Split {
    /// Vertex of the document that each comes from, ascending.
    source: Vec<u32>,
    /// What is new at each.
    new: Vec<New>,
    /// Triangles, winding as in the document.
    faces: Vec<[u32; 3]>,
    has_tangents: bool,
    has_normals: bool,
    /// Whether the vertices are just those of the document.
    unchanged: bool,
}

fn split(doc: &Document, surface: &Surface, part: &Part, corners: &AtlasCorners, wants_normals: bool) -> Split {
    let linear = Linear::new(&part.to_world);
    let has_normals = wants_normals && primitive::attribute(doc, part, "NORMAL").is_none();
    let new_at = |c: usize| New {
        uv: [corners.uv[c].u, corners.uv[c].v],
        tangent: corners.tangents.map_or([0.0; 4], |t| to_object(&linear, surface.corner_normals[c], t[c])),
        normal: if has_normals { primitive::object_normal(&linear, surface, c) } else { [0.0; 3] },
    };
    let range = 3 * part.faces.start as usize..3 * part.faces.end as usize;
    let vertex = |c: usize| surface.mesh.faces[c / 3][c % 3] - part.vertices.start;
    let new: Vec<New> = range.clone().map(new_at).collect();
    let bits: Vec<[u32; 9]> = new.iter().map(New::bits).collect();
    // Corners by vertex, then by what is new; of equal ones the first stands for all.
    let mut order: Vec<usize> = (0..new.len()).collect();
    order.sort_unstable_by_key(|&k| (vertex(range.start + k), bits[k], k));
    let mut firsts: Vec<(u32, usize)> = Vec::new();
    let mut first_of = vec![0usize; new.len()];
    for same in order.chunk_by(|&a, &b| vertex(range.start + a) == vertex(range.start + b) && bits[a] == bits[b]) {
        firsts.push((vertex(range.start + same[0]), same[0]));
        same.iter().for_each(|&k| first_of[k] = same[0]);
    }
    firsts.sort_unstable();
    let mut index = vec![0u32; new.len()];
    firsts.iter().enumerate().for_each(|(i, &(_, k))| index[k] = i as u32);
    let mut faces: Vec<[u32; 3]> = first_of.chunks_exact(3).map(|f| [index[f[0]], index[f[1]], index[f[2]]]).collect();
    if linear.mirrors() {
        faces.iter_mut().for_each(|f| f.swap(1, 2));
    }
    let source: Vec<u32> = firsts.iter().map(|f| f.0).collect();
    let unchanged = source.len() == part.vertices.len() && source.iter().copied().eq(0..source.len() as u32);
    Split {
        new: firsts.iter().map(|f| new[f.1]).collect(),
        source,
        faces,
        has_tangents: corners.tangents.is_some(),
        has_normals,
        unchanged,
    }
}

/// A tangent of the world in the object. Where the transform flattens it, any direction across the normal serves.
fn to_object(linear: &Linear, normal: Vec3, [x, y, z, w]: [f32; 4]) -> [f32; 4] {
    let world = Vec3::from([x, y, z]);
    let normal = linear.normal_to_object(normal).unwrap_or(vec3(0.0, 0.0, 1.0));
    let [x, y, z] = linear.tangent_to_object(world).unwrap_or_else(|| normal.any_perpendicular()).to_f32();
    let sign = if (w < 0.0) != linear.mirrors() { -1.0 } else { 1.0 };
    [x, y, z, sign]
}

/// Takes away what will be replaced.
fn strip(editor: &mut Editor, part: &Part, split: &Split) {
    let keeps_indices = split.unchanged && primitive::is_plain_list(editor.doc, part);
    let entry = editor.primitive(part.mesh, part.primitive);
    primitive::strip(entry, split.unchanged, keeps_indices);
}

fn write(editor: &mut Editor, part: &Part, split: &Split) {
    let doc = editor.doc;
    let old = primitive::of(doc, part);
    let mut streams: Vec<(String, Stream)> = Vec::new();
    let floats = |width: usize, f: &dyn Fn(&New) -> Vec<f32>| {
        let shape = ["VEC2", "VEC3", "VEC4"][width - 2];
        let bytes = split.new.iter().flat_map(f).flat_map(|v| (v + 0.0).to_le_bytes()).collect();
        Stream::new(None, Component::F32, shape, bytes)
    };
    streams.push(("TEXCOORD_0".into(), floats(2, &|n| n.uv.to_vec())));
    if split.has_tangents {
        streams.push(("TANGENT".into(), floats(4, &|n| n.tangent.to_vec())));
    }
    if split.has_normals {
        streams.push(("NORMAL".into(), floats(3, &|n| n.normal.to_vec())));
    }
    let copy = |a: usize| {
        if split.unchanged { Stream::Keep(a) } else { Stream::gather(doc, a, &split.source) }
    };
    streams.extend(primitive::carried(&old["attributes"], 1).map(|(name, a)| (name, copy(a))));
    let attributes = primitive::write_streams(editor, streams);
    let targets = primitive::targets(old, 1).map(|t| t.map(|(name, a)| (name, copy(a))).collect()).collect();
    let targets = primitive::write_targets(editor, targets, split.source.len());
    let indices = if split.unchanged && primitive::is_plain_list(doc, part) {
        old["indices"].clone()
    } else {
        primitive::write_indices(editor, &split.faces, split.source.len())
    };
    let entry = editor.primitive(part.mesh, part.primitive);
    entry["attributes"] = attributes;
    entry["indices"] = indices;
    if let Some(targets) = targets {
        entry["targets"] = targets;
    }
}
