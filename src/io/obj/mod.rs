//! Wavefront OBJ, read into a glTF document so that everything after knows one kind of scene.
//!
//! Source: the OBJ specification (Alias|Wavefront, appendix B1): `v` (with colours), `vt`, `vn`, `f`, `usemtl`, `g`, `o`.
//! In: text. Out: JSON of a glTF document and its one buffer. A mesh and a node per object and group, in it a primitive
//! per material. Texture coordinates are flipped: v points down in glTF.
//! Reads as: an index may point ahead; a face's corners all have `vt` (`vn`) or none of them counts. Material libraries,
//! free-form curves, lines and points are passed over.

mod triangulate;

use std::collections::BTreeMap;

use serde_json::{Value, json};

use super::SceneError;

/// Groups and materials beyond which groups are no longer told apart: files with one per face exist.
const MAX_GROUPS: usize = 4096;

/// A corner: 0-based indices of position, and of coordinates and normal or `NONE`.
type Corner = [u32; 3];
const NONE: u32 = u32::MAX;

/// What faces must share to be in one primitive: mesh, material, and whether they have coordinates and normals.
type Key = (u32, u32, bool, bool);

struct Parser<'a> {
    file: &'a str,
    line: usize,
    positions: Vec<[f32; 3]>,
    /// Empty, or one per position so far.
    colors: Vec<[f32; 3]>,
    uvs: Vec<[f32; 2]>,
    normals: Vec<[f32; 3]>,
    /// Triangles per primitive.
    faces: BTreeMap<Key, Vec<[Corner; 3]>>,
    /// Names of meshes and materials in order of appearance.
    meshes: Vec<String>,
    materials: Vec<String>,
    object: String,
    group: String,
    mesh: u32,
    material: u32,
    /// For positions, coordinates and normals the greatest index so far that points ahead, with its line.
    ahead: [Option<(u32, usize)>; 3],
}

/// Reads an OBJ file; `file` names it in errors.
pub(super) fn read(file: &str, bytes: &[u8]) -> Result<(Value, Vec<u8>), SceneError> {
    if bytes.len() >= NONE as usize {
        return Err(SceneError::TooLarge(format!("an OBJ of {} bytes; at most {} are read", bytes.len(), NONE)));
    }
    let mut parser = Parser {
        file,
        line: 0,
        positions: Vec::new(),
        colors: Vec::new(),
        uvs: Vec::new(),
        normals: Vec::new(),
        faces: BTreeMap::new(),
        meshes: Vec::new(),
        materials: Vec::new(),
        object: String::new(),
        group: String::new(),
        mesh: NONE,
        material: NONE,
        ahead: [None; 3],
    };
    let mut joined: Vec<u8> = Vec::new();
    for line in bytes.split(|&b| b == b'\n') {
        parser.line += 1;
        let line = line.strip_suffix(b"\r").unwrap_or(line);
        // A backslash at the end joins the next line.
        if let Some(head) = line.strip_suffix(b"\\") {
            joined.extend_from_slice(head);
            joined.push(b' ');
            continue;
        }
        if joined.is_empty() {
            parser.statement(line)?;
        } else {
            joined.extend_from_slice(line);
            parser.statement(&std::mem::take(&mut joined))?;
        }
    }
    parser.statement(&joined)?;
    parser.check_ahead()?;
    if parser.faces.is_empty() {
        let (v, lines) = (parser.positions.len(), parser.line);
        return Err(SceneError::Nothing(format!("{file}: no face (`f`) in {lines} lines with {v} vertices")));
    }
    Ok(Writer::new(&parser).document())
}

impl Parser<'_> {
    fn fault<T>(&self, what: String) -> Result<T, SceneError> {
        Err(SceneError::Line { file: self.file.into(), line: self.line, what })
    }

    fn statement(&mut self, line: &[u8]) -> Result<(), SceneError> {
        let line = line.split(|&b| b == b'#').next().unwrap_or_default();
        let text = String::from_utf8_lossy(line);
        let mut words = text.split_ascii_whitespace();
        match words.next() {
            Some("v") => {
                let (n, v) = self.numbers::<7>("v", words, 3)?;
                self.positions.push([v[0], v[1], v[2]]);
                // Six numbers are a position and a colour, seven have a weight between them.
                let color = if n >= 6 { Some([v[n - 3], v[n - 2], v[n - 1]]) } else { None };
                if let Some(c) = color.filter(|_| self.colors.len() + 1 == self.positions.len()) {
                    self.colors.push(c);
                }
            }
            Some("vt") => {
                let (_, v) = self.numbers::<3>("vt", words, 1)?;
                self.uvs.push([v[0], v[1]]);
            }
            Some("vn") => {
                let (_, v) = self.numbers::<3>("vn", words, 3)?;
                self.normals.push(v);
            }
            Some("f") => self.face(words)?,
            Some("o") => self.rename(words.collect::<Vec<_>>().join(" "), None),
            Some("g") => self.rename(self.object.clone(), Some(words.collect::<Vec<_>>().join(" "))),
            Some("usemtl") => {
                let name = words.collect::<Vec<_>>().join(" ");
                if self.materials.len() == MAX_GROUPS && !self.materials.contains(&name) {
                    return self.fault(format!("`usemtl`: more than {MAX_GROUPS} materials"));
                }
                self.material = place(&mut self.materials, name);
            }
            _ => {}
        }
        Ok(())
    }

    fn rename(&mut self, object: String, group: Option<String>) {
        (self.object, self.group) = (object, group.unwrap_or_default());
        self.mesh = NONE;
    }

    /// Up to `N` finite numbers, at least `least`; the rest 0. Also their count.
    fn numbers<'w, const N: usize>(
        &self,
        keyword: &str,
        words: impl Iterator<Item = &'w str>,
        least: usize,
    ) -> Result<(usize, [f32; N]), SceneError> {
        let (mut out, mut n) = ([0.0; N], 0);
        for word in words.take(N) {
            match word.parse::<f32>() {
                Ok(v) if v.is_finite() => out[n] = v,
                _ => return self.fault(format!("`{keyword}`: \"{word}\" is no finite number (f32)")),
            }
            n += 1;
        }
        if n < least {
            return self.fault(format!("`{keyword}` has {n} numbers, expected at least {least}"));
        }
        Ok((n, out))
    }

    fn face<'w>(&mut self, words: impl Iterator<Item = &'w str>) -> Result<(), SceneError> {
        let mut corners = words.map(|w| self.corner(w)).collect::<Result<Vec<Corner>, _>>()?;
        if corners.len() < 3 {
            return self.fault(format!("`f` has {} corners, expected at least 3", corners.len()));
        }
        let all = |slot: usize| corners.iter().all(|c| c[slot] != NONE);
        let (has_uv, has_normal) = (all(1), all(2));
        for c in &mut corners {
            *c = [c[0], if has_uv { c[1] } else { NONE }, if has_normal { c[2] } else { NONE }];
        }
        if self.mesh == NONE {
            let name = [self.object.as_str(), self.group.as_str()];
            let name = name.into_iter().filter(|n| !n.is_empty()).collect::<Vec<_>>().join("/");
            self.mesh = place(&mut self.meshes, name);
        }
        let position = |c: &Corner| self.positions.get(c[0] as usize).map(|p| p.map(f64::from));
        // Corners that point ahead have no position yet: such a face is cut as if it were convex.
        let points: Option<Vec<[f64; 3]>> = corners.iter().map(position).collect();
        let triangles = match triangulate::polygon(corners.len(), points.as_deref()) {
            Ok(t) => t,
            Err(what) => return self.fault(format!("`f`: {what}")),
        };
        let list = self.faces.entry((self.mesh, self.material, has_uv, has_normal)).or_default();
        list.extend(triangles.into_iter().map(|t| t.map(|i| corners[i])));
        Ok(())
    }

    /// `v`, `v/vt`, `v//vn` or `v/vt/vn`; from 1, or from -1 backwards.
    fn corner(&mut self, word: &str) -> Result<Corner, SceneError> {
        let mut out = [NONE; 3];
        let counts = [self.positions.len(), self.uvs.len(), self.normals.len()];
        let mut parts = 0;
        for (slot, part) in word.split('/').enumerate() {
            parts = slot + 1;
            if slot > 2 || (part.is_empty() && slot != 1) {
                break;
            }
            if part.is_empty() {
                continue;
            }
            let n = counts[slot] as i64;
            let index = match part.parse::<i64>() {
                Ok(i) if i > 0 && i < i64::from(NONE) => i - 1,
                Ok(i) if i < 0 && -i <= n => n + i,
                _ => {
                    let what = ["positions", "texture coordinates", "normals"][slot];
                    return self
                        .fault(format!("`f`: index \"{part}\"; there are {n} {what} so far, counted from 1 or -1"));
                }
            };
            out[slot] = index as u32;
            if index >= n && self.ahead[slot].is_none_or(|(i, _)| i < out[slot]) {
                self.ahead[slot] = Some((out[slot], self.line));
            }
        }
        if out[0] == NONE || parts > 3 || (parts > 1 && word.ends_with('/')) {
            return self.fault(format!("`f`: corner \"{word}\", expected v, v/vt, v//vn or v/vt/vn"));
        }
        Ok(out)
    }

    /// Indices that pointed ahead of their line point at something by the end.
    fn check_ahead(&mut self) -> Result<(), SceneError> {
        let counts = [self.positions.len(), self.uvs.len(), self.normals.len()];
        for slot in 0..3 {
            if let Some((index, line)) = self.ahead[slot].filter(|(i, _)| *i as usize >= counts[slot]) {
                self.line = line;
                let what = ["positions", "texture coordinates", "normals"][slot];
                return self.fault(format!(
                    "`f`: index {}, but there are {} {what}",
                    u64::from(index) + 1,
                    counts[slot]
                ));
            }
        }
        Ok(())
    }
}

/// Index of a name, which is added if it is new; that of the last once there are `MAX_GROUPS`.
fn place(names: &mut Vec<String>, name: String) -> u32 {
    let found = names.iter().rposition(|n| *n == name);
    found.unwrap_or_else(|| {
        if names.len() < MAX_GROUPS {
            names.push(name);
        }
        names.len() - 1
    }) as u32
}

/// Collects the glTF document.
struct Writer<'a> {
    obj: &'a Parser<'a>,
    bin: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl<'a> Writer<'a> {
    fn new(obj: &'a Parser<'a>) -> Self {
        Writer { obj, bin: Vec::new(), views: Vec::new(), accessors: Vec::new() }
    }

    fn document(mut self) -> (Value, Vec<u8>) {
        let mut meshes: Vec<Value> = self.obj.meshes.iter().map(|n| json!({"name": n, "primitives": []})).collect();
        for (key, faces) in &self.obj.faces {
            let primitive = self.primitive(*key, faces);
            if let Some(list) = meshes[key.0 as usize]["primitives"].as_array_mut() {
                list.push(primitive);
            }
        }
        let nodes: Vec<Value> = (0..meshes.len()).map(|i| json!({"name": meshes[i]["name"], "mesh": i})).collect();
        let roots: Vec<usize> = (0..nodes.len()).collect();
        let mut root = json!({
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": roots}],
            "nodes": nodes,
            "meshes": meshes,
            "accessors": self.accessors,
            "bufferViews": self.views,
            "buffers": [{"byteLength": self.bin.len()}],
        });
        // Names that stand for nothing are left out.
        for key in ["nodes", "meshes"] {
            for entry in root[key].as_array_mut().into_iter().flatten().filter_map(Value::as_object_mut) {
                if entry["name"] == "" {
                    entry.remove("name");
                }
            }
        }
        if !self.obj.materials.is_empty() {
            let material = |n: &String| json!({"name": n, "pbrMetallicRoughness": {"metallicFactor": 0}});
            root["materials"] = self.obj.materials.iter().map(material).collect();
        }
        (root, self.bin)
    }

    fn primitive(&mut self, (_, material, has_uv, has_normal): Key, faces: &[[Corner; 3]]) -> Value {
        let mut corners: Vec<(Corner, u32)> = faces.iter().flatten().copied().zip(0..).collect();
        corners.sort_unstable();
        // Vertices in the order in which the faces first use them.
        let mut firsts: Vec<(u32, Corner)> = Vec::new();
        for same in corners.chunk_by(|a, b| a.0 == b.0) {
            firsts.push((same[0].1, same[0].0));
        }
        firsts.sort_unstable();
        let mut by_corner: Vec<(Corner, u32)> = firsts.iter().map(|f| f.1).zip(0..).collect();
        by_corner.sort_unstable();
        let index = |c: &Corner| by_corner.binary_search_by_key(c, |b| b.0).map_or(0, |i| by_corner[i].1);
        let indices: Vec<u32> = faces.iter().flatten().map(index).collect();
        let obj = self.obj;
        let of = |slot: usize| firsts.iter().map(move |f| f.1[slot] as usize);
        let mut attributes = json!({"POSITION": self.floats(of(0).flat_map(|i| obj.positions[i]), "VEC3")});
        if has_normal {
            // Lengths are not to be relied on; a normal without one points up.
            let unit =
                |n: [f32; 3]| crate::numerics::vec::Vec3::from(n).normalized().map_or([0.0, 0.0, 1.0], |n| n.to_f32());
            attributes["NORMAL"] = self.floats(of(2).flat_map(|i| unit(obj.normals[i])), "VEC3");
        }
        if has_uv {
            let flip = |[u, v]: [f32; 2]| [u, 1.0 - v];
            attributes["TEXCOORD_0"] = self.floats(of(1).flat_map(|i| flip(obj.uvs[i])), "VEC2");
        }
        if obj.colors.len() == obj.positions.len() {
            let color = |i: usize| obj.colors[i].map(|c| c.clamp(0.0, 1.0));
            attributes["COLOR_0"] = self.floats(of(0).flat_map(color), "VEC3");
        }
        let mut primitive = json!({"attributes": attributes, "indices": self.indices(&indices)});
        if material != NONE {
            primitive["material"] = material.into();
        }
        primitive
    }

    fn floats(&mut self, values: impl Iterator<Item = f32>, shape: &str) -> Value {
        let start = self.bin.len();
        let mut least = [f32::MAX; 3];
        let mut most = [f32::MIN; 3];
        let width = if shape == "VEC2" { 2 } else { 3 };
        let mut n = 0;
        for v in values {
            (least[n % width], most[n % width]) = (least[n % width].min(v), most[n % width].max(v));
            self.bin.extend_from_slice(&v.to_le_bytes());
            n += 1;
        }
        self.accessor(start, 5126, shape, n / width, Some((&least[..width], &most[..width])))
    }

    fn indices(&mut self, indices: &[u32]) -> Value {
        let start = self.bin.len();
        self.bin.extend(indices.iter().flat_map(|i| i.to_le_bytes()));
        self.accessor(start, 5125, "SCALAR", indices.len(), None)
    }

    fn accessor(
        &mut self,
        start: usize,
        kind: u32,
        shape: &str,
        count: usize,
        bounds: Option<(&[f32], &[f32])>,
    ) -> Value {
        let target = if bounds.is_some() { 34962 } else { 34963 };
        self.views
            .push(json!({"buffer": 0, "byteOffset": start, "byteLength": self.bin.len() - start, "target": target}));
        let view = self.views.len() - 1;
        let mut accessor = json!({"bufferView": view, "componentType": kind, "type": shape, "count": count});
        if let Some((least, most)) = bounds {
            (accessor["min"], accessor["max"]) = (json!(least), json!(most));
        }
        self.accessors.push(accessor);
        (self.accessors.len() - 1).into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fault(text: &str) -> String {
        read("x.obj", text.as_bytes()).unwrap_err().to_string()
    }

    fn floats(root: &Value, bin: &[u8], accessor: &Value) -> Vec<f32> {
        let a = &root["accessors"][accessor.as_u64().unwrap() as usize];
        let view = &root["bufferViews"][a["bufferView"].as_u64().unwrap() as usize];
        let (start, len) =
            (view["byteOffset"].as_u64().unwrap() as usize, view["byteLength"].as_u64().unwrap() as usize);
        bin[start..start + len].chunks(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect()
    }

    #[test]
    fn quads_materials_groups_and_flipped_coordinates() {
        let text = "# a comment\r\nmtllib none.mtl\no Wall\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\n\
                    vt 0 .25\nusemtl Brick Red\nf 1/1 2/2 \\\n 3/3 4/4\ng top\nusemtl Moss\nf -4 -3 -2\n";
        let (root, bin) = read("x.obj", text.as_bytes()).unwrap();
        assert_eq!(root["meshes"].as_array().unwrap().len(), 2);
        assert_eq!((&root["meshes"][0]["name"], &root["meshes"][1]["name"]), (&json!("Wall"), &json!("Wall/top")));
        assert_eq!(root["materials"][0]["name"], "Brick Red");
        let quad = &root["meshes"][0]["primitives"][0];
        assert_eq!(floats(&root, &bin, &quad["attributes"]["TEXCOORD_0"]), [0., 1., 1., 1., 1., 0., 0., 0.75]);
        let corner = &root["meshes"][1]["primitives"][0];
        assert_eq!(corner["material"], 1);
        assert_eq!(floats(&root, &bin, &corner["attributes"]["POSITION"]), [0., 0., 0., 1., 0., 0., 1., 1., 0.]);
        assert!(corner["attributes"].get("TEXCOORD_0").is_none());
    }

    #[test]
    fn colours_need_every_vertex() {
        let (root, bin) = read("x.obj", b"v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 0 1 0 0 0 2\nf 1 2 3").unwrap();
        let attributes = &root["meshes"][0]["primitives"][0]["attributes"];
        assert_eq!(floats(&root, &bin, &attributes["COLOR_0"]), [1., 0., 0., 0., 1., 0., 0., 0., 1.]);
        let (root, _) = read("x.obj", b"v 0 0 0\nv 1 0 0 0 1 0\nv 0 1 0 0 0 1\nf 1 2 3").unwrap();
        assert!(root["meshes"][0]["primitives"][0]["attributes"].get("COLOR_0").is_none());
    }

    #[test]
    fn faults_name_the_line() {
        let v = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
        assert!(fault("v 0 nan 0").starts_with("x.obj:1: `v`: \"nan\" is no finite"));
        assert!(fault("\nv 0 1e39 0").starts_with("x.obj:2:"));
        assert!(fault("v 0 0").contains("2 numbers"));
        assert!(fault(&format!("{v}f 1 2")).contains("x.obj:4: `f` has 2 corners"));
        assert!(fault(&format!("{v}f 1 2 4")).contains("x.obj:4: `f`: index 4, but there are 3"));
        assert!(fault(&format!("{v}f 1 2 0")).contains("index \"0\""));
        assert!(fault(&format!("{v}f 1 2 -4")).contains("index \"-4\""));
        assert!(fault(&format!("{v}f 1 2 3/1/1/1")).contains("corner"));
        assert!(fault(&format!("{v}f 1 2 x")).contains("\"x\""));
        assert!(fault(v).contains("no face"));
        assert!(read("x.obj", format!("f 1 2 3\n{v}").as_bytes()).is_ok());
    }
}
