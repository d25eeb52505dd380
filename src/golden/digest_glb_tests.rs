//! Tests of the digest of GLBs: the same content in other clothes, and other content in the same.

use super::*;
use crate::io::image_file::{Compression, Transfer, encode_png};
use crate::io::{Pixels, Samples};
use serde_json::json;
use std::path::Path;

fn glb(json: &Value, bin: &[u8]) -> Vec<u8> {
    let mut text = json.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut bin = bin.to_vec();
    bin.resize(bin.len().next_multiple_of(4), 0);
    let mut out = b"glTF\x02\0\0\0".to_vec();
    out.extend((12 + 8 + text.len() as u32 + 8 + bin.len() as u32).to_le_bytes());
    for (kind, chunk) in [(b"JSON", &text), (b"BIN\0", &bin)] {
        out.extend((chunk.len() as u32).to_le_bytes());
        out.extend(kind);
        out.extend(chunk);
    }
    out
}

fn png(value: u8, compression: Compression) -> Vec<u8> {
    let pixels = Pixels { width: 8, height: 8, channels: 3, samples: Samples::U8(vec![value; 192]) };
    encode_png(&pixels, compression, Transfer::Srgb).unwrap()
}

/// Three points (u16) and an image; `stride` bytes between points, `image` after them.
fn sample(points: [[u16; 3]; 3], stride: usize, image: &[u8], generator: &str) -> Vec<u8> {
    let mut bin = vec![0xaa; 3 * stride];
    for (i, point) in points.iter().enumerate() {
        for (j, v) in point.iter().enumerate() {
            bin[i * stride + 2 * j..][..2].copy_from_slice(&v.to_le_bytes());
        }
    }
    bin.extend(image);
    let json = json!({
        "asset": { "version": "2.0", "generator": generator },
        "accessors": [{ "bufferView": 1, "componentType": 5123, "type": "VEC3", "count": 3, "name": "points" }],
        "buffers": [{ "byteLength": bin.len() }],
        "bufferViews": [
            { "buffer": 0, "byteOffset": 3 * stride, "byteLength": image.len() },
            { "buffer": 0, "byteLength": 3 * stride, "byteStride": stride },
        ],
        "images": [{ "bufferView": 0, "mimeType": "image/png" }],
        "extras": { "bufferView": 99 },
    });
    glb(&json, &bin)
}

const POINTS: [[u16; 3]; 3] = [[0, 1, 2], [3, 4, 5], [6, 7, 8]];

#[test]
fn layout_compression_and_generator_do_not_count() {
    let digest = digest_glb(&sample(POINTS, 6, &png(9, Compression::Fast), "one")).unwrap();
    assert_eq!(digest_glb(&sample(POINTS, 12, &png(9, Compression::Best), "two")).unwrap(), digest);
}

#[test]
fn vertices_and_pixels_count() {
    let file = |points, value| digest_glb(&sample(points, 8, &png(value, Compression::Fast), "")).unwrap();
    let digest = file(POINTS, 9);
    assert_ne!(file([[0, 1, 2], [3, 4, 5], [6, 7, 9]], 9), digest);
    assert_ne!(file(POINTS, 10), digest);
}

#[test]
fn names_numbers_and_order_of_keys() {
    let of = |text: &str| digest_glb(&glb(&serde_json::from_str(text).unwrap(), &[])).unwrap();
    let digest = of(r#"{ "asset": { "version": "2.0" }, "nodes": [{ "name": "a", "scale": [1, 2.5, 1e2] }] }"#);
    assert_eq!(
        of(r#"{ "nodes": [{ "scale": [1.0, 2.50, 100], "name": "a" }], "asset": { "version": "2.0" } }"#),
        digest
    );
    assert_ne!(of(r#"{ "asset": { "version": "2.0" }, "nodes": [{ "name": "b", "scale": [1, 2.5, 100] }] }"#), digest);
    assert_ne!(of(r#"{ "asset": { "version": "2.0" }, "nodes": [{ "name": "a", "scale": [1, 2.5, 101] }] }"#), digest);
}

#[test]
fn sparse_accessors_and_matrices_are_decoded() {
    // Two MAT2 of bytes with padded columns, and the same as one with a sparse second element.
    let plain = json!({
        "accessors": [{ "bufferView": 0, "componentType": 5121, "type": "MAT2", "count": 2 }],
        "buffers": [{ "byteLength": 16 }],
        "bufferViews": [{ "buffer": 0, "byteLength": 16 }],
    });
    let sparse = json!({
        "accessors": [{ "componentType": 5121, "type": "MAT2", "count": 2, "sparse": {
            "count": 1, "indices": { "bufferView": 0, "componentType": 5121 }, "values": { "bufferView": 1 } } }],
        "buffers": [{ "byteLength": 12 }],
        "bufferViews": [{ "buffer": 0, "byteLength": 1 }, { "buffer": 0, "byteOffset": 4, "byteLength": 8 }],
    });
    let plain = glb(&plain, &[0, 0, 7, 7, 0, 0, 7, 7, 1, 2, 7, 7, 3, 4, 7, 7]);
    let sparse = glb(&sparse, &[1, 0, 0, 0, 1, 2, 9, 9, 3, 4, 9, 9]);
    assert_eq!(digest_glb(&plain).unwrap(), digest_glb(&sparse).unwrap());
}

#[test]
fn data_uris_are_part_of_the_file() {
    let image = png(9, Compression::Fast);
    let uri = format!("data:image/png;base64,{}", base64::encode(&image));
    let inside = glb(&json!({ "images": [{ "uri": uri }] }), &[]);
    let view = json!({
        "images": [{ "bufferView": 0, "mimeType": "image/png" }],
        "buffers": [{ "byteLength": image.len() }],
        "bufferViews": [{ "buffer": 0, "byteLength": image.len() }],
    });
    assert_eq!(digest_glb(&inside).unwrap(), digest_glb(&glb(&view, &image)).unwrap());
}

#[test]
fn what_does_not_fit_gets_a_sentence() {
    let accessor = |accessor: Value, view: Value| {
        let json = json!({ "accessors": [accessor], "buffers": [{ "byteLength": 8 }], "bufferViews": [view] });
        digest_glb(&glb(&json, &[0; 8])).unwrap_err().to_string()
    };
    let view = json!({ "buffer": 0, "byteLength": 8 });
    let vec3 = |count: u64| json!({ "bufferView": 0, "componentType": 5126, "type": "VEC3", "count": count });
    assert!(accessor(vec3(1), view.clone()).starts_with("accessors[0]: 1 elements from byte 0 lie outside"));
    assert!(accessor(vec3(u64::MAX), view.clone()).contains("too many"));
    assert!(accessor(vec3(1 << 60), view.clone()).contains("outside"));
    assert!(accessor(vec3(1), json!({ "buffer": 0, "byteLength": 9 })).starts_with("bufferViews[0]: 9 bytes"));
    assert!(accessor(vec3(1), json!({ "buffer": 1, "byteLength": 8 })).contains("outside"));
    assert!(accessor(json!({ "componentType": 5126, "type": "VEC3", "count": 1u64 << 40 }), view).contains("too many"));
    assert!(digest_glb(b"hello").unwrap_err().to_string().contains("does not start"));
    assert!(digest_glb(b"glTF\x02\0\0\0\xff\0\0\0").unwrap_err().to_string().contains("ends early"));
    assert!(matches!(digest_glb(&glb(&json!([]), &[])), Err(DigestError::Json(_))));
}

#[test]
fn the_broken_glbs_of_the_shared_data_never_panic() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data/broken");
    let Ok(entries) = std::fs::read_dir(&folder) else {
        println!("skipped: no {}", folder.display());
        return;
    };
    let names =
        ["accessor_past_view", "bad_json", "bad_magic", "empty", "huge_count", "truncated_bin", "view_past_buffer"];
    for path in entries.filter_map(|e| Some(e.ok()?.path())).filter(|p| p.extension().is_some_and(|e| e == "glb")) {
        let result = digest_glb(&std::fs::read(&path).unwrap());
        let name = path.file_stem().unwrap().to_string_lossy();
        assert!(result.is_err() || !names.contains(&&*name), "{name}: {result:?}");
    }
}
