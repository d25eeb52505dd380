//! A UV-set bake as a .glb: the synthesis mesh with the sample's coordinates and weights at its corners.
//!
//! Source: \[ZG03\] 4.4 (a base vertex's set weighs one there and nothing at the others); glTF 2.0; the extension
//! KILN_uv_sets, which is described at [`write_uv_sets`].
//! In: the document, its surface, the synthesis mesh and what was synthesised on it. Out: a self-contained .glb.
//! Reads as:
//! - Corners become one vertex where they come from the same point of the input with the same weights and their
//!   coordinates differ by less than the tolerance; the first corner's count. A point between vertices has one position
//!   in a mesh, whichever triangle it is reached from.
//!
//! Unaware of: which method made the sets.

use serde_json::{Value, json};

use super::accessor::{Component, Format};
use super::document::Document;
use super::edit::Editor;
use super::interpolate::{self, Mix, shares};
use super::material::{self, BakedMaps, Use};
use super::nodes::Linear;
use super::pieces::{Piece, pieces, prepare_materials, shift};
use super::primitive::{self, Stream};
use super::refs::Kind;
use super::validate::Semantic;
use crate::io::SceneError;
use crate::mesh::{Part, Surface, SynthesisMesh, Topology, TriMesh};
use crate::numerics::vec::{Vec3, vec3};
use crate::synth::mesh::rendering_sequence::{CACHE, acmr, face_sequence};
use crate::texture::Texel;
use crate::uvset::{Blend, UvSets};

/// Vertices at one point that a corner is compared with: a fan of thousands of corners stays linear.
const LOOKBACK: usize = 64;

/// The third coordinate of a material-space bake.
#[derive(Clone, Copy, Debug)]
pub struct MaterialSpace<'a> {
    /// Position on the material axis per corner of the synthesis mesh, 0..1.
    pub values: &'a [f32],
    /// Layers of the tile.
    pub layers: u32,
    /// File name of the tile beside the scene.
    pub tile: &'a str,
}

/// How a UV-set bake is written.
#[derive(Clone, Copy, Debug)]
pub struct UvSetOutput<'a> {
    /// Texels within which corners may share a vertex.
    pub weld_texels: f32,
    /// The sample's maps, shown on set 0.
    pub maps: &'a BakedMaps,
    /// The sample's mean colour, linear.
    pub mean_color: Option<[f32; 3]>,
    /// Mean of each map by its name, linear.
    pub means: &'a [(String, Vec<f32>)],
    /// Also write the weights as sets of coordinates after the sets, for engines without custom attributes.
    pub repeat_weights_in_uv: bool,
    /// In which order triangles and vertices are written.
    pub triangles: TriangleOrder,
    /// For material-space bakes.
    pub material_space: Option<MaterialSpace<'a>>,
    /// For texton bakes, per corner of the synthesis mesh: the continuity error of the edge that its triangle blends over
    /// and the edge's length in world units (\[MK03\] Eq. 4); empty for others.
    pub edge_metric: &'a [[f32; 2]],
}

/// In which order triangles and vertices are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TriangleOrder {
    /// As in the synthesis mesh.
    Input,
    /// So that a small vertex cache serves most corners, and vertices by first use ([`face_sequence`]).
    Cache,
}

/// Writes a UV-set bake.
///
/// TEXCOORD_0..n-1 are the sets as shares of the sample, `_KILN_WEIGHTS` (VEC4, normalised u8 or u16, their sum exactly
/// one) their weights; with `repeat_weights_in_uv` TEXCOORD_n = (w0, w1) and, for four sets, TEXCOORD_n+1 = (w2, w3).
/// `_KILN_EDGE` (VEC2) is, in texton bakes, the same at all corners of a triangle: the continuity error of the edge that it
/// blends over and that edge's length. A shader may show set 0 alone where error x length x pixels per radian / distance is
/// small enough. The input's sets move up behind. Each baked material has an extension object `KILN_uv_sets`, repeated in
/// `extras.kiln` for tools that drop unknown extensions:
///
/// `sets` (1..=4), `blend` ("linear", "variance", "none": the set of greatest weight alone), `exemplarSize` (texels), `weights` ("_KILN_WEIGHTS"),
/// `sharpness` (1 or more: the power to which interpolated weights are raised), `weightsTexCoord` (n, if repeated),
/// `meanColor` (linear), `means` (per map), and for material-space bakes `material` ("_KILN_MATERIAL", SCALAR), `layers`,
/// `tile`; for texton bakes `edge` ("_KILN_EDGE").
///
/// A primitive of a material-space bake that is shown by one look-up in some places and by several in others becomes two:
/// in its place one of the triangles with one look-up, whose material has `sets` = 1, and behind the last primitive of the
/// mesh one of the others. Whoever draws every primitive by its own material's object needs to know no more.
///
/// A primitive none of whose triangles is in the synthesis mesh stays as it was.
pub fn write_uv_sets(
    doc: &Document,
    surface: &Surface,
    synthesis: &SynthesisMesh,
    sets: &UvSets,
    output: &UvSetOutput,
) -> Result<Vec<u8>, SceneError> {
    primitive::check_parts(doc, surface)?;
    check(surface, synthesis, sets, output)?;
    let mut pieces = pieces(surface, synthesis, sets, output);
    let mut editor = Editor::new(doc);
    for piece in &mut pieces {
        piece.claim(&mut editor);
    }
    let materials = prepare_materials(&mut editor, &pieces, output);
    editor.release();
    let n = synthesis.mesh.positions.len();
    let mut points = Points { mesh: vec![NONE; n], at: vec![[0.0; 3]; n], last: vec![NONE; n] };
    for of_part in pieces.chunk_by(|a, b| std::ptr::eq(a.part, b.part)) {
        let part = of_part[0].part;
        let (same, linear) = (&equal_vertices(doc, part)[..], Linear::new(&part.to_world));
        let wants_normals = output.maps.has(Use::Normal) && primitive::attribute(doc, part, "NORMAL").is_none();
        for piece in of_part {
            let weight_type = weight_type(&piece.faces, sets);
            let job = Job { doc, surface, synthesis, sets, output, piece, same, weight_type, linear, wants_normals };
            job.write(&mut editor, &mut points);
        }
    }
    material::fill(&mut editor, &materials.iter().map(|m| m.0).collect::<Vec<_>>(), output.maps);
    for (m, count) in materials {
        let description = describe(sets, count, output);
        let material = editor.entry(Kind::Material, m);
        set_in(material, "extensions", "KILN_uv_sets", &description);
        set_in(material, "extras", "kiln", &description);
    }
    editor.declare("KILN_uv_sets", false);
    editor.finish()
}

/// Sets a key of an object within an object; what is no object gives way.
fn set_in(object: &mut Value, key: &str, name: &str, value: &Value) {
    if !object[key].is_object() {
        object[key] = json!({});
    }
    object[key][name] = value.clone();
}

fn check(surface: &Surface, synthesis: &SynthesisMesh, sets: &UvSets, output: &UvSetOutput) -> Result<(), SceneError> {
    let faces = synthesis.mesh.faces.len();
    primitive::check_length("parents", synthesis.parent.len(), faces)?;
    primitive::check_length("barycentric triples", synthesis.parent_bary.len(), faces)?;
    primitive::check_length("weights", sets.weights.len(), 3 * faces)?;
    for set in &sets.sets {
        primitive::check_length("coordinates", set.len(), 3 * faces)?;
    }
    let values = output.material_space.map_or(3 * faces, |m| m.values.len());
    primitive::check_length("material values", values, 3 * faces)?;
    if !output.edge_metric.is_empty() {
        primitive::check_length("edge measures", output.edge_metric.len(), 3 * faces)?;
    }
    let bad = |what: String| Err(SceneError::Mismatch(what));
    if !(1..=4).contains(&sets.sets.len()) || sets.exemplar_size.contains(&0) {
        return bad(format!("{} sets of a sample of {:?}, expected 1..=4", sets.sets.len(), sets.exemplar_size));
    }
    if let Some(f) = synthesis.parent.iter().position(|&p| p as usize >= surface.mesh.faces.len()) {
        return bad(format!("face {f} lies in face {} of {}", synthesis.parent[f], surface.mesh.faces.len()));
    }
    let inside = |b: &[f32; 3]| b.iter().all(|w| (-1e-3..=1.001).contains(w)) && b.iter().any(|&w| w > 0.0);
    if let Some(f) = synthesis.parent_bary.iter().position(|b| !b.iter().all(inside)) {
        return bad(format!("face {f} has barycentrics {:?}, expected 0..=1", synthesis.parent_bary[f]));
    }
    let finite = |c: usize| {
        sets.sets.iter().all(|s| s[c].x.is_finite() && s[c].y.is_finite())
            && sets.weights[c].iter().all(|w| w.is_finite())
            && output.material_space.is_none_or(|m| m.values[c].is_finite())
            && output.edge_metric.get(c).is_none_or(|m| m.iter().all(|v| v.is_finite()))
    };
    if let Some(c) = (0..3 * faces).find(|&c| !finite(c)) {
        return bad(format!("corner {c} has coordinates or weights that are not finite"));
    }
    Ok(())
}

/// The extension object.
fn describe(sets: &UvSets, count: usize, output: &UvSetOutput) -> Value {
    let blend = match sets.blend {
        Blend::Linear => "linear",
        Blend::Variance => "variance",
        Blend::Nearest => "none",
    };
    let mut out = json!({
        "sets": count,
        "blend": blend,
        "sharpness": sets.sharpness,
        "exemplarSize": sets.exemplar_size,
        "weights": "_KILN_WEIGHTS",
    });
    if output.repeat_weights_in_uv {
        out["weightsTexCoord"] = count.into();
    }
    if let Some(mean) = output.mean_color {
        out["meanColor"] = mean.iter().copied().map(short).collect();
    }
    if !output.means.is_empty() {
        out["means"] = json!({});
        for (name, mean) in output.means {
            out["means"][name] = mean.iter().copied().map(short).collect();
        }
    }
    if !output.edge_metric.is_empty() {
        out["edge"] = "_KILN_EDGE".into();
    }
    if let Some(space) = &output.material_space {
        out["material"] = "_KILN_MATERIAL".into();
        out["layers"] = space.layers.into();
        out["tile"] = space.tile.into();
    }
    out
}

/// A number in as few digits as single precision needs.
fn short(v: f32) -> Value {
    format!("{v}").parse::<f64>().map_or(Value::Null, Value::from)
}

/// What is kept per vertex of the synthesis mesh from part to part.
struct Points {
    /// Positions of points between vertices, in the mesh that was written last.
    mesh: Vec<u32>,
    at: Vec<[f32; 3]>,
    /// For [`Job::vertices`].
    last: Vec<u32>,
}

const NONE: u32 = u32::MAX;

/// What lies at a corner, and thus at a vertex of the output.
#[derive(Clone, Copy)]
struct Vertex {
    /// Its corner of the synthesis mesh, the first of those that share it, and its vertex there.
    corner: usize,
    vertex: u32,
    /// Where it is in the input.
    mix: Mix,
    /// Normal in the object; zero if the input has them or none are wanted.
    normal: [f32; 3],
}

/// One piece of a part being written.
struct Job<'a> {
    doc: &'a Document,
    surface: &'a Surface,
    synthesis: &'a SynthesisMesh,
    sets: &'a UvSets,
    output: &'a UvSetOutput<'a>,
    piece: &'a Piece<'a>,
    /// See [`equal_vertices`].
    same: &'a [u32],
    weight_type: Component,
    linear: Linear,
    wants_normals: bool,
}

impl<'a> Job<'a> {
    /// What lies at a corner of the synthesis mesh.
    fn vertex(&self, corner: usize) -> Vertex {
        let Job { surface, synthesis, .. } = self;
        let (parent, bary) = (synthesis.parent[corner / 3] as usize, synthesis.parent_bary[corner / 3][corner % 3]);
        let vertices = surface.mesh.faces[parent].map(|v| self.same[(v - self.piece.part.vertices.start) as usize]);
        let normal = || {
            let normals = &surface.corner_normals[3 * parent..3 * parent + 3];
            let sum = normals.iter().zip(bary).fold(Vec3::ZERO, |s, (n, b)| s + *n * f64::from(b));
            let world = sum.normalized().unwrap_or(normals[0]);
            self.linear.normal_to_object(world).unwrap_or(vec3(0.0, 0.0, 1.0)).to_f32()
        };
        Vertex {
            corner,
            vertex: synthesis.mesh.faces[corner / 3][corner % 3],
            mix: Mix::new(vertices, bary),
            normal: if self.wants_normals { normal() } else { [0.0; 3] },
        }
    }

    /// The sets that the piece needs.
    fn shown(&self) -> &[Vec<Texel>] {
        &self.sets.sets[..self.piece.count]
    }

    /// The weights of a corner as they are stored.
    fn weights(&self, corner: usize) -> [u32; 4] {
        shares(self.sets.weights[corner].map(f64::from), self.weight_type.unit() as u32)
    }

    /// Whether two corners may be one vertex.
    fn agree(&self, a: &Vertex, b: &Vertex) -> bool {
        let near = |x: f32, y: f32| (x - y).abs() <= self.output.weld_texels;
        let (ca, cb) = (a.corner, b.corner);
        self.shown().iter().all(|s| near(s[ca].x, s[cb].x) && near(s[ca].y, s[cb].y))
            && (self.sets.weights[ca] == self.sets.weights[cb] || self.weights(ca) == self.weights(cb))
            && a.mix == b.mix
            && a.normal == b.normal
            && self.output.material_space.is_none_or(|m| m.values[ca] == m.values[cb])
            && self.output.edge_metric.get(ca) == self.output.edge_metric.get(cb)
    }

    /// The vertices, by their first corners, and the triangles. `last` has as many entries as the synthesis mesh has
    /// vertices, all [`NONE`], and is so again afterwards.
    fn vertices(&self, last: &mut [u32]) -> (Vec<Vertex>, Vec<[u32; 3]>) {
        let mut distinct: Vec<Vertex> = Vec::with_capacity(3 * self.piece.faces.len() / 2);
        // Of each, the one before it at the same vertex of the synthesis mesh.
        let mut before: Vec<u32> = Vec::with_capacity(3 * self.piece.faces.len() / 2);
        let mut index = |corner: usize| {
            let new = self.vertex(corner);
            let newest = &mut last[new.vertex as usize];
            let vertex = |k: u32| (k != NONE).then_some(k);
            let mut known = std::iter::successors(vertex(*newest), |&k| vertex(before[k as usize])).take(LOOKBACK);
            if let Some(k) = known.find(|&k| self.agree(&distinct[k as usize], &new)) {
                return k;
            }
            before.push(std::mem::replace(newest, distinct.len() as u32));
            distinct.push(new);
            distinct.len() as u32 - 1
        };
        let order = if self.linear.mirrors() { [0, 2, 1] } else { [0, 1, 2] };
        let face = |&f: &u32| {
            let corners = [0, 1, 2].map(|k| index(3 * f as usize + k));
            order.map(|k| corners[k])
        };
        let faces: Vec<[u32; 3]> = self.piece.faces.iter().map(face).collect();
        distinct.iter().for_each(|v| last[v.vertex as usize] = NONE);
        match self.output.triangles {
            TriangleOrder::Input => (distinct, faces),
            TriangleOrder::Cache => for_cache(distinct, faces),
        }
    }

    fn write(&self, editor: &mut Editor, points: &mut Points) {
        let shift = shift(self.piece.count, self.output) as u32;
        let (vertices, faces) = self.vertices(&mut points.last);
        let mixes: Vec<Mix> = vertices.iter().map(|v| v.mix).collect();
        let old = primitive::of(self.doc, self.piece.part);
        let mut streams = self.new_streams(&vertices);
        let skin = interpolate::skin(self.doc, &old["attributes"], &mixes);
        for (name, a) in primitive::carried(&old["attributes"], shift) {
            let semantic = Semantic::parse(&name);
            let stream = match semantic {
                _ if skin.iter().any(|s| s.0 == name) => continue,
                Some(Semantic::Position) => self.positions(a, &vertices, points),
                _ => interpolate::attribute(self.doc, a, semantic, false, &mixes),
            };
            streams.push((name, stream));
        }
        streams.extend(skin);
        let targets: Vec<Vec<(String, Stream)>> = primitive::targets(old, shift)
            .map(|target| {
                let morph = |(name, a): (String, usize)| {
                    let stream = interpolate::attribute(self.doc, a, Semantic::parse(&name), true, &mixes);
                    (name, stream)
                };
                target.map(morph).collect()
            })
            .collect();
        let attributes = primitive::write_streams(editor, streams);
        let targets = primitive::write_targets(editor, targets, vertices.len());
        let indices = primitive::write_indices(editor, &faces, vertices.len());
        let entry = editor.primitive(self.piece.part.mesh, self.piece.primitive);
        entry["attributes"] = attributes;
        entry["indices"] = indices;
        if let Some(targets) = targets {
            entry["targets"] = targets;
        }
    }

    /// Coordinates, weights, and what else is new.
    fn new_streams(&self, vertices: &[Vertex]) -> Vec<(String, Stream)> {
        let [w, h] = self.sets.exemplar_size.map(|s| s as f32);
        let mut out: Vec<(String, Stream)> = Vec::new();
        for (s, set) in self.shown().iter().enumerate() {
            let uv = |v: &Vertex| [set[v.corner].x / w, set[v.corner].y / h];
            out.push((format!("TEXCOORD_{s}"), floats("VEC2", vertices.iter().map(uv))));
        }
        let weights: Vec<[u32; 4]> = vertices.iter().map(|v| self.weights(v.corner)).collect();
        let mut bytes = Vec::with_capacity(4 * self.weight_type.size() * vertices.len());
        match self.weight_type {
            Component::U8 => weights.iter().for_each(|w| bytes.extend(w.map(|w| w as u8))),
            _ => weights.iter().flatten().for_each(|w| bytes.extend((*w as u16).to_le_bytes())),
        }
        let format = Format::new(self.weight_type, "VEC4", true);
        out.push(("_KILN_WEIGHTS".into(), Stream::New { like: None, format, bytes }));
        if self.output.repeat_weights_in_uv {
            let n = self.piece.count;
            let unit = self.weight_type.unit();
            for (s, pair) in [[0, 1], [2, 3]].into_iter().enumerate().take(if n > 3 { 2 } else { 1 }) {
                let share = |w: &[u32; 4]| pair.map(|k| (f64::from(w[k]) / unit) as f32);
                out.push((format!("TEXCOORD_{}", n + s), floats("VEC2", weights.iter().map(share))));
            }
        }
        if let Some(space) = &self.output.material_space {
            let values = vertices.iter().map(|v| [space.values[v.corner]]);
            out.push(("_KILN_MATERIAL".into(), floats("SCALAR", values)));
        }
        if !self.output.edge_metric.is_empty() {
            let values = vertices.iter().map(|v| self.output.edge_metric[v.corner]);
            out.push(("_KILN_EDGE".into(), floats("VEC2", values)));
        }
        if self.wants_normals {
            out.push(("NORMAL".into(), floats("VEC3", vertices.iter().map(|v| v.normal))));
        }
        out
    }

    /// Positions; a point between vertices is where the mesh had it first.
    fn positions(&self, a: usize, vertices: &[Vertex], points: &mut Points) -> Stream {
        if vertices.iter().all(|v| v.mix.single().is_some()) {
            let source: Vec<u32> = vertices.iter().filter_map(|v| v.mix.single()).collect();
            return Stream::gather(self.doc, a, &source);
        }
        let accessor = &self.doc.accessors[a];
        let input = interpolate::positions(accessor, &accessor.packed(&self.doc.buffers));
        let position = |v: &Vertex| {
            let (own, at) = (interpolate::position(&input, &v.mix), v.vertex as usize);
            if v.mix.single().is_some() {
                own
            } else if points.mesh[at] == self.piece.part.mesh {
                points.at[at]
            } else {
                (points.mesh[at], points.at[at]) = (self.piece.part.mesh, own);
                own
            }
        };
        let Stream::New { format, bytes, .. } = floats("VEC3", vertices.iter().map(position)) else {
            return Stream::Keep(a);
        };
        Stream::New { like: Some(a), format, bytes }
    }
}

/// New data of floats.
fn floats<const N: usize>(shape: &str, values: impl ExactSizeIterator<Item = [f32; N]>) -> Stream {
    let mut bytes = vec![0; 4 * N * values.len()];
    for (bytes, value) in bytes.chunks_exact_mut(4 * N).zip(values) {
        bytes.as_chunks_mut::<4>().0.iter_mut().zip(value).for_each(|(b, c)| *b = c.to_le_bytes());
    }
    Stream::new(None, Component::F32, shape, bytes)
}

/// The triangles as a cache likes them, and the vertices by first use; as they came if that is no better.
fn for_cache(vertices: Vec<Vertex>, faces: Vec<[u32; 3]>) -> (Vec<Vertex>, Vec<[u32; 3]>) {
    let mesh = TriMesh { positions: vec![Vec3::ZERO; vertices.len()], faces };
    let sequence = face_sequence(&mesh, &Topology::new(&mesh));
    let (mut index, mut used) = (vec![NONE; vertices.len()], Vec::with_capacity(vertices.len()));
    let mut renumber = |v: u32| {
        if index[v as usize] == NONE {
            index[v as usize] = used.len() as u32;
            used.push(vertices[v as usize]);
        }
        index[v as usize]
    };
    let faces: Vec<[u32; 3]> = sequence.iter().map(|&f| mesh.faces[f as usize].map(&mut renumber)).collect();
    // Where nearly every vertex is split there is little to gain, and the order that came may be the better one.
    let misses = |faces: &[[u32; 3]]| acmr(faces, vertices.len(), CACHE);
    if misses(&faces) < misses(&mesh.faces) { (used, faces) } else { (vertices, mesh.faces) }
}

/// For each vertex of a part the lowest one whose attributes are all the same.
fn equal_vertices(doc: &Document, part: &Part) -> Vec<u32> {
    let old = primitive::of(doc, part);
    let all = primitive::carried(&old["attributes"], 0).chain(primitive::targets(old, 0).flatten());
    let mut accessors: Vec<usize> = all.map(|(_, a)| a).collect();
    accessors.sort_unstable();
    accessors.dedup();
    let n = part.vertices.len();
    let columns: Vec<(usize, Vec<u8>)> =
        accessors.iter().map(|&a| (doc.accessors[a].format.size(), doc.accessors[a].packed(&doc.buffers))).collect();
    let compare = |a: u32, b: u32| {
        let elements = columns.iter().map(|(size, c)| {
            let at = |v: u32| &c[v as usize * size..(v as usize + 1) * size];
            at(a).cmp(at(b))
        });
        elements.into_iter().find(|o| o.is_ne())
    };
    // The first bytes tell most apart.
    let first = |v: u32| {
        let mut key = [0; 8];
        if let Some((size, c)) = columns.first() {
            let len = (*size).min(8);
            key[..len].copy_from_slice(&c[v as usize * size..v as usize * size + len]);
        }
        u64::from_be_bytes(key)
    };
    let mut order: Vec<(u64, u32)> = (0..n as u32).map(|v| (first(v), v)).collect();
    order.sort_unstable_by(|a, b| a.0.cmp(&b.0).then_with(|| compare(a.1, b.1).unwrap_or(a.1.cmp(&b.1))));
    let mut out = vec![0; n];
    for same in order.chunk_by(|a, b| a.0 == b.0 && compare(a.1, b.1).is_none()) {
        same.iter().for_each(|&(_, v)| out[v as usize] = same[0].1);
    }
    out
}

/// How weights are stored: in 8 bits where these are exact, else in 16.
fn weight_type(faces: &[u32], sets: &UvSets) -> Component {
    let exact = |w: f32| (w * 255.0 - (w * 255.0).round()).abs() < 1e-3;
    let corners = faces.iter().flat_map(|&f| &sets.weights[3 * f as usize..3 * f as usize + 3]);
    if corners.flatten().all(|&w| exact(w)) { Component::U8 } else { Component::U16 }
}
