//! The triangles of a primitive, whatever its mode.
//!
//! Source: glTF 2.0, 3.7.2.1 (topology types). A strip's triangles that repeat an index only join its parts: left out.

use serde_json::Value;

use super::document::Document;
use super::refs::index;

/// Whether the primitive is one of triangles with positions.
pub(super) fn is_triangles(primitive: &Value) -> bool {
    mode(primitive) >= 4 && position(primitive).is_some()
}

/// Its mode; 4, a list of triangles, by default.
pub(super) fn mode(primitive: &Value) -> u64 {
    primitive.get("mode").and_then(Value::as_u64).unwrap_or(4)
}

/// Accessor of the positions.
pub(super) fn position(primitive: &Value) -> Option<usize> {
    index(primitive.get("attributes")?, "POSITION")
}

/// Number of corners before strips and fans are taken apart.
pub(super) fn corner_count(doc: &Document, primitive: &Value) -> usize {
    index(primitive, "indices").or(position(primitive)).map_or(0, |a| doc.accessors[a].count)
}

/// Vertex indices of the triangles, in order, winding as glTF has it.
pub(super) fn triangles(doc: &Document, primitive: &Value) -> Vec<[u32; 3]> {
    let corners = match index(primitive, "indices") {
        Some(a) => doc.accessors[a].indices(&doc.buffers),
        None => (0..corner_count(doc, primitive) as u32).collect(),
    };
    let distinct = |t: &[u32; 3]| t[0] != t[1] && t[1] != t[2] && t[2] != t[0];
    let windows = corners.windows(3);
    match mode(primitive) {
        4 => corners.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect(),
        5 => {
            let turned = |(i, c): (usize, &[u32])| if i % 2 == 0 { [c[0], c[1], c[2]] } else { [c[0], c[2], c[1]] };
            windows.enumerate().map(turned).filter(distinct).collect()
        }
        6 => corners.windows(2).skip(1).map(|c| [corners[0], c[0], c[1]]).filter(distinct).collect(),
        _ => Vec::new(),
    }
}
