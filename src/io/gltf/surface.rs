//! From the document to the surface that is textured.
//!
//! Source: glTF 2.0, 3.7.2; where normals are missing, see `normals`.
//! In: a document, and which materials. Out: a [`Surface`] in world units.
//! Unaware of: files, recipes.

use serde_json::Value;

use super::accessor::Format;
use super::document::Document;
use super::nodes::{Linear, transform};
use super::normals::smooth_normals;
use super::refs::{index, list};
use super::triangles::{corner_count, is_triangles, position, triangles};
use crate::io::SceneError;
use crate::mesh::{Part, Surface, TriMesh};
use crate::numerics::vec::{Vec3, vec3};
use crate::texture::Uv;

/// Vertices, and corners of triangles, that a surface may have.
const MAX_ELEMENTS: usize = 1 << 26;

impl Document {
    /// The triangles to be textured: those of the named materials, or all.
    ///
    /// Primitives that no node shows, of points or lines, or without POSITION are left out. Refuses names that the
    /// scene does not have, and a surface without area.
    pub fn surface(&self, materials: Option<&[String]>) -> Result<Surface, SceneError> {
        let wanted = self.selection(materials)?;
        let mut builder = Builder { doc: self, surface: empty(), normals: Vec::new(), uvs: Vec::new() };
        let (mut vertices, mut corners) = (0usize, 0usize);
        for (m, mesh) in list(&self.root, "meshes").iter().enumerate() {
            let Some(to_world) = self.shown[m] else { continue };
            for (p, primitive) in list(mesh, "primitives").iter().enumerate() {
                let selected = match (index(primitive, "material"), &wanted) {
                    (_, None) => true,
                    (Some(i), Some(w)) => w[i],
                    (None, Some(_)) => false,
                };
                let Some(at) = position(primitive).filter(|_| selected && is_triangles(primitive)) else { continue };
                vertices += self.accessors[at].count;
                corners += corner_count(self, primitive) * if super::triangles::mode(primitive) == 4 { 1 } else { 3 };
                if vertices > MAX_ELEMENTS || corners > MAX_ELEMENTS {
                    let what = format!("more than {MAX_ELEMENTS} vertices or corners (meshes up to {m})");
                    return Err(SceneError::TooLarge(what));
                }
                builder.add(m, p, primitive, to_world);
            }
        }
        builder.finish()
    }

    /// Per material whether it is asked for; `None` for all.
    fn selection(&self, names: Option<&[String]>) -> Result<Option<Vec<bool>>, SceneError> {
        let Some(names) = names else { return Ok(None) };
        let name_of = |m: &Value| m.get("name").and_then(Value::as_str).map(String::from);
        let all: Vec<Option<String>> = list(&self.root, "materials").iter().map(name_of).collect();
        if let Some(unknown) = names.iter().find(|n| !all.contains(&Some((*n).clone()))) {
            let mut existing: Vec<String> = Vec::new();
            all.iter().flatten().for_each(|e| {
                if !existing.contains(e) {
                    existing.push(e.clone())
                }
            });
            return Err(SceneError::Material { name: unknown.clone(), existing });
        }
        Ok(Some(all.iter().map(|m| m.as_ref().is_some_and(|m| names.contains(m))).collect()))
    }
}

fn empty() -> Surface {
    Surface {
        mesh: TriMesh::default(),
        corner_normals: Vec::new(),
        has_normals: true,
        corner_uvs: Vec::new(),
        parts: Vec::new(),
    }
}

struct Builder<'a> {
    doc: &'a Document,
    surface: Surface,
    /// Unit normals of corners; `None` where the document has none that can be used.
    normals: Vec<Option<Vec3>>,
    /// Per part its sets of coordinates per corner.
    uvs: Vec<Vec<Vec<Uv>>>,
}

impl Builder<'_> {
    fn read(&self, a: usize) -> (Format, Vec<u8>) {
        let accessor = &self.doc.accessors[a];
        (accessor.format, accessor.packed(&self.doc.buffers))
    }

    fn add(&mut self, m: usize, p: usize, primitive: &Value, to_world: [[f64; 4]; 3]) {
        let Some(at) = position(primitive) else { return };
        let attributes = &primitive["attributes"];
        let linear = Linear::new(&to_world);
        let (format, packed) = self.read(at);
        let xyz = |f: Format, b: &[u8], i: usize| vec3(f.get(b, i, 0), f.get(b, i, 1), f.get(b, i, 2));
        let mesh = &mut self.surface.mesh;
        let (v0, f0) = (mesh.positions.len() as u32, mesh.faces.len() as u32);
        let count = self.doc.accessors[at].count;
        mesh.positions.extend((0..count).map(|i| transform(&to_world, xyz(format, &packed, i))));
        let mut faces = triangles(self.doc, primitive);
        if linear.mirrors() {
            faces.iter_mut().for_each(|f| f.swap(1, 2));
        }
        mesh.faces.extend(faces.iter().map(|f| f.map(|v| v + v0)));
        let f1 = mesh.faces.len() as u32;
        let corners = || faces.iter().flatten().map(|&v| v as usize);
        match index(attributes, "NORMAL") {
            Some(a) => {
                let (format, packed) = self.read(a);
                self.normals.extend(corners().map(|v| linear.normal_to_world(xyz(format, &packed, v))));
            }
            None => {
                self.surface.has_normals = false;
                self.normals.resize(3 * f1 as usize, None);
            }
        }
        let mut sets = Vec::new();
        while let Some(a) = index(attributes, &format!("TEXCOORD_{}", sets.len())) {
            let (format, packed) = self.read(a);
            let uv = |v| Uv { u: format.get(&packed, v, 0) as f32, v: format.get(&packed, v, 1) as f32 };
            sets.push(corners().map(uv).collect());
        }
        self.uvs.push(sets);
        self.surface.parts.push(Part {
            mesh: m as u32,
            primitive: p as u32,
            vertices: v0..v0 + count as u32,
            faces: f0..f1,
            to_world,
        });
    }

    fn finish(mut self) -> Result<Surface, SceneError> {
        let mesh = &self.surface.mesh;
        if mesh.faces.is_empty() {
            return Err(SceneError::Nothing(self.nothing()));
        }
        if !(0..mesh.faces.len()).any(|f| mesh.area_vector(f).normalized().is_some()) {
            let what = format!("none of the {} triangles has an area; nothing to texture", mesh.faces.len());
            return Err(SceneError::Nothing(what));
        }
        let smooth = if self.normals.contains(&None) { smooth_normals(mesh) } else { Vec::new() };
        let given = self.normals.iter().enumerate();
        self.surface.corner_normals = given.map(|(c, n)| n.unwrap_or_else(|| smooth[c])).collect();
        let sets = self.uvs.iter().map(Vec::len).min().unwrap_or(0);
        self.surface.corner_uvs =
            (0..sets).map(|s| self.uvs.iter().flat_map(|part| part[s].iter().copied()).collect()).collect();
        Ok(self.surface)
    }

    /// Why there is no triangle.
    fn nothing(&self) -> String {
        let meshes = list(&self.doc.root, "meshes");
        if meshes.is_empty() {
            return "the scene has no mesh; nothing to texture".into();
        }
        let all = || meshes.iter().flat_map(|m| list(m, "primitives"));
        let without = all().filter(|p| position(p).is_none()).count();
        let other = all().filter(|p| super::triangles::mode(p) < 4).count();
        format!(
            "no triangle to texture: of {} primitives {without} have no POSITION, {other} are points or lines, and the \
             others are empty, not selected or not shown by a node",
            all().count()
        )
    }
}
