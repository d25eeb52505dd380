//! Atlas bakes.

use super::uvsets::{plain, subdivided, uv_sets};
use super::*;

#[test]
fn an_atlas_keeps_every_triangle_of_every_scene() {
    for path in scenes("meshes") {
        let Ok((doc, surface)) = read(&path).and_then(|d| d.surface(None).map(|s| (d, s))) else { continue };
        // The largest meshes would only take long with a vertex per corner.
        for seams in if surface.mesh.faces.len() > 30_000 { vec![false] } else { vec![false, true] } {
            let tangents = tangents(&surface);
            let uv = atlas_uv(&surface, seams);
            let with = AtlasCorners { uv: &uv, tangents: seams.then_some(&tangents) };
            let maps = maps(&[Use::BaseColor, Use::Normal, Use::OcclusionMetallicRoughness]);
            let glb = write_atlas(&doc, &surface, &with, &maps).unwrap();
            dump(&path, if seams { "seams" } else { "smooth" }, &glb);
            let name = path.display();
            let back = again(&glb);
            let now = back.surface(None).unwrap();
            assert_eq!(corners(&surface), corners(&now), "{name}");
            assert_eq!(now.corner_uvs[0], uv, "{name}");
            assert_eq!(now.corner_uvs.len(), surface.corner_uvs.len() + 1, "{name}");
            assert_eq!(now.corner_uvs[1..], surface.corner_uvs[..], "{name}");
            assert!(now.has_normals && now.corner_normals.iter().all(|n| n.is_finite()), "{name}");
            for (a, b) in surface.corner_normals.iter().zip(&now.corner_normals) {
                assert!((*a - *b).length() < 1e-5, "{name}: {a:?} {b:?}");
            }
            let (before, after) = (doc.summary(), back.summary());
            assert_eq!((before.nodes, before.skins, before.animations), (after.nodes, after.skins, after.animations));
            assert_eq!((before.morph_targets, before.triangles), (after.morph_targets, after.triangles), "{name}");
            assert_eq!(glb, write_atlas(&doc, &surface, &with, &maps).unwrap(), "the same bytes");
        }
    }
}

#[test]
fn a_mirrored_node_turns_winding_and_the_sign_of_tangents() {
    let root = serde_json::json!({
        "nodes": [{"mesh": 0, "scale": [-2, 1, 1]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
    });
    let doc = made(root, &square());
    let surface = doc.surface(None).unwrap();
    assert_eq!(surface.mesh.faces, [[0, 2, 1], [0, 3, 2]]);
    let up = Vec3::from([0.0, 0.0, 1.0]);
    assert!(surface.corner_normals.iter().all(|n| (*n - up).length() < 1e-12), "outside stays outside");
    let uv = atlas_uv(&surface, false);
    let tangents = vec![[1.0, 0.0, 0.0, 1.0]; 6];
    let maps = maps(&[Use::Normal]);
    let glb = write_atlas(&doc, &surface, &AtlasCorners { uv: &uv, tangents: Some(&tangents) }, &maps).unwrap();
    let back = again(&glb);
    let primitive = &back.root["meshes"][0]["primitives"][0];
    let tangent = refs::index(&primitive["attributes"], "TANGENT").unwrap();
    let packed = back.accessors[tangent].packed(&back.buffers);
    assert_eq!(packed[..16], f32s(&[-1.0, 0.0, 0.0, -1.0]));
    let indices = refs::index(primitive, "indices").unwrap();
    assert_eq!(back.accessors[indices].indices(&back.buffers), [0, 1, 2, 0, 2, 3]);
    let synthesis = subdivided(&surface);
    let sets = uv_sets(&synthesis);
    let back_sets = again(&write_uv_sets(&doc, &surface, &synthesis, &sets, &plain(&BakedMaps::default())).unwrap());
    assert_eq!(corners(&back_sets.surface(None).unwrap())[3], synthesis.mesh.corners(3));
    let material = &back.root["materials"][0];
    assert_eq!((&material["name"], &material["pbrMetallicRoughness"]["metallicFactor"]), (&"Baked".into(), &0.into()));
}
