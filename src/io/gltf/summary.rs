//! What a scene holds, counted: for `kiln inspect`.

use serde_json::Value;

use super::document::Document;
use super::refs::{index, list};
use super::triangles::{is_triangles, position, triangles};

/// Counts and names of a scene.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Summary {
    /// Nodes.
    pub nodes: usize,
    /// Meshes.
    pub meshes: usize,
    /// Primitives of all meshes, of any kind.
    pub primitives: usize,
    /// Triangles of all meshes, each mesh once.
    pub triangles: usize,
    /// Vertices as stored, of all primitives.
    pub vertices: usize,
    /// Names of the materials; one without a name is `material <index>`.
    pub materials: Vec<String>,
    /// Sets of texture coordinates that every textured primitive has.
    pub uv_sets: usize,
    /// Whether every primitive of triangles has normals.
    pub normals: bool,
    /// Images.
    pub images: usize,
    /// Skins.
    pub skins: usize,
    /// Animations.
    pub animations: usize,
    /// Greatest number of morph targets of a mesh.
    pub morph_targets: usize,
    /// Extensions that the file says it uses.
    pub extensions: Vec<String>,
}

impl Document {
    /// Counts what is in the scene.
    pub fn summary(&self) -> Summary {
        let count = |key: &str| list(&self.root, key).len();
        let meshes = list(&self.root, "meshes");
        let primitives: Vec<&Value> = meshes.iter().flat_map(|m| list(m, "primitives")).collect();
        let surfaces = || primitives.iter().copied().filter(|p| is_triangles(p));
        let uv_sets =
            |p: &Value| (0..).take_while(|i| index(&p["attributes"], &format!("TEXCOORD_{i}")).is_some()).count();
        let name = |(i, m): (usize, &Value)| {
            m.get("name").and_then(Value::as_str).map_or_else(|| format!("material {i}"), String::from)
        };
        Summary {
            nodes: count("nodes"),
            meshes: meshes.len(),
            primitives: primitives.len(),
            triangles: surfaces().map(|p| triangles(self, p).len()).sum(),
            vertices: primitives.iter().filter_map(|p| position(p)).map(|a| self.accessors[a].count).sum(),
            materials: list(&self.root, "materials").iter().enumerate().map(name).collect(),
            uv_sets: surfaces().map(uv_sets).min().unwrap_or(0),
            normals: surfaces().all(|p| index(&p["attributes"], "NORMAL").is_some()),
            images: count("images"),
            skins: count("skins"),
            animations: count("animations"),
            morph_targets: primitives.iter().map(|p| list(p, "targets").len()).max().unwrap_or(0),
            extensions: self.extensions.clone(),
        }
    }
}
