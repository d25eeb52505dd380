//! A small writer of glTF scenes for the sample meshes.

use kiln::mesh::TriMesh;
use serde_json::{Value, json};

/// Collects buffers and accessors.
#[derive(Default)]
pub struct Builder {
    bin: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Builder {
    fn accessor(&mut self, data: &[u8], target: u32, component: u32, kind: &str, count: usize, bounds: Value) -> usize {
        let view = json!({"buffer": 0, "byteOffset": self.bin.len(), "byteLength": data.len(), "target": target});
        self.bin.extend_from_slice(data);
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        let mut accessor =
            json!({"bufferView": self.views.len(), "componentType": component, "type": kind, "count": count});
        if let (Value::Object(a), Value::Object(b)) = (&mut accessor, bounds) {
            a.extend(b);
        }
        self.views.push(view);
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    fn floats<const N: usize>(&mut self, items: &[[f32; N]], kind: &str, bounds: Value) -> usize {
        let bytes: Vec<u8> = items.iter().flatten().flat_map(|v| v.to_le_bytes()).collect();
        self.accessor(&bytes, 34962, 5126, kind, items.len(), bounds)
    }

    /// Adds a mesh as a primitive: positions, smooth normals, UVs if there are any, 16-bit indices.
    pub fn primitive(&mut self, mesh: &TriMesh, uvs: Option<&[[f32; 2]]>, material: usize) -> Value {
        let positions: Vec<[f32; 3]> = mesh.positions.iter().map(|p| p.to_f32()).collect();
        let fold =
            |f: fn(f32, f32) -> f32| positions.iter().fold(positions[0], |a, p| std::array::from_fn(|i| f(a[i], p[i])));
        let bounds = json!({"min": fold(f32::min), "max": fold(f32::max)});
        let mut attributes = json!({"POSITION": self.floats(&positions, "VEC3", bounds)});
        let normals: Vec<[f32; 3]> = mesh.vertex_normals().iter().map(|n| n.to_f32()).collect();
        attributes["NORMAL"] = json!(self.floats(&normals, "VEC3", json!({})));
        if let Some(uvs) = uvs {
            attributes["TEXCOORD_0"] = json!(self.floats(uvs, "VEC2", json!({})));
        }
        let indices: Vec<u8> = mesh.faces.iter().flatten().flat_map(|&v| (v as u16).to_le_bytes()).collect();
        assert!(mesh.positions.len() < 65535, "16-bit indices");
        let indices = self.accessor(&indices, 34963, 5123, "SCALAR", mesh.faces.len() * 3, json!({}));
        json!({"attributes": attributes, "indices": indices, "material": material})
    }

    /// The document with its buffer, which lies in `uri` or, without one, in the GLB.
    fn document(&self, mut scene: Value, uri: Option<&str>) -> Value {
        scene["asset"] = json!({"version": "2.0", "generator": "kiln make_samples"});
        scene["bufferViews"] = json!(self.views);
        scene["accessors"] = json!(self.accessors);
        scene["buffers"] = match uri {
            Some(uri) => json!([{"byteLength": self.bin.len(), "uri": uri}]),
            None => json!([{"byteLength": self.bin.len()}]),
        };
        scene
    }

    /// A whole .glb.
    pub fn glb(&self, scene: Value) -> Vec<u8> {
        let mut text = self.document(scene, None).to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        let total = 12 + 8 + text.len() + 8 + self.bin.len();
        let mut out = Vec::with_capacity(total);
        out.extend_from_slice(b"glTF");
        out.extend_from_slice(&2u32.to_le_bytes());
        out.extend_from_slice(&(total as u32).to_le_bytes());
        for (kind, chunk) in [(b"JSON", &text), (b"BIN\0", &self.bin)] {
            out.extend_from_slice(&(chunk.len() as u32).to_le_bytes());
            out.extend_from_slice(kind);
            out.extend_from_slice(chunk);
        }
        out
    }

    /// A .gltf and the buffer that it names.
    pub fn gltf(&self, scene: Value, uri: &str) -> (String, Vec<u8>) {
        let text = serde_json::to_string_pretty(&self.document(scene, Some(uri))).unwrap_or_default();
        (text + "\n", self.bin.clone())
    }
}
