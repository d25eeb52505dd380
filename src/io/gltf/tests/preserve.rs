//! What a bake leaves alone.

use super::*;

/// Accessors, textures and materials that primitives outside the bake, skins and animations use, with the data.
fn outside(doc: &Document, baked: &[(u32, u32)]) -> Vec<(String, Vec<u8>)> {
    let mut out = Vec::new();
    let mut textures = Vec::new();
    let is_baked = |m: usize, p: usize| baked.contains(&(m as u32, p as u32));
    refs::each(&doc.root, &mut |kind, path, value| {
        let place = match path {
            [refs::Step::Key("meshes"), refs::Step::Index(m), _, refs::Step::Index(p), ..] if is_baked(*m, *p) => {
                return;
            }
            _ => refs::text(path),
        };
        let i = value.as_u64().unwrap() as usize;
        match (kind, path[0]) {
            (refs::Kind::Accessor, _) => out.push((format!("{place} {i}"), doc.accessors[i].packed(&doc.buffers))),
            (refs::Kind::Material, _) => {
                let material = &doc.root["materials"][i];
                out.push((format!("{place} {i}"), material.to_string().into_bytes()));
                refs::each(&doc.root, &mut |kind, path, value| {
                    if let (refs::Kind::Texture, [_, refs::Step::Index(m), ..]) = (kind, path) {
                        textures.extend(value.as_u64().filter(|_| *m == i));
                    }
                });
            }
            _ => {}
        }
    });
    for t in textures {
        let texture = &doc.root["textures"][t as usize];
        let i = refs::index(texture, "source").unwrap();
        let view = refs::index(&doc.root["images"][i], "bufferView").map(|v| doc.views[v]);
        let bytes = view.map(|v| doc.buffers[v.buffer][v.start..v.start + v.len].to_vec());
        out.push((format!("texture {texture}"), bytes.or(doc.images[i].clone()).unwrap_or_default()));
    }
    out
}

#[test]
fn what_is_not_baked_comes_out_as_it_went_in() {
    let mut tried = 0;
    for path in scenes("meshes") {
        let Ok(doc) = read(&path) else { continue };
        let names: Vec<String> =
            list(&doc.root, "materials").iter().filter_map(|m| Some(m["name"].as_str()?.into())).collect();
        for material in names.iter().take(2) {
            let Ok(surface) = doc.surface(Some(std::slice::from_ref(material))) else { continue };
            let baked: Vec<(u32, u32)> = surface.parts.iter().map(|p| (p.mesh, p.primitive)).collect();
            let uv = atlas_uv(&surface, true);
            let glb = write_atlas(&doc, &surface, &AtlasCorners { uv: &uv, tangents: None }, &maps(&[Use::BaseColor]))
                .unwrap();
            let back = again(&glb);
            for key in ["scene", "scenes", "nodes", "animations", "skins", "cameras", "asset", "extras", "extensions"] {
                assert_eq!(doc.root.get(key), back.root.get(key), "{} {key}", path.display());
            }
            assert_eq!(outside(&doc, &baked), outside(&back, &baked), "{} {material}", path.display());
            let bytes: usize = doc.buffers.iter().map(Vec::len).sum();
            let images: usize = doc.images.iter().flatten().map(Vec::len).sum();
            let json = doc.root.to_string().len();
            // Every corner became a vertex: no more than that was added.
            let vertex: usize = doc.accessors.iter().map(|a| a.format.size()).max().unwrap_or(0) * 8 + 100;
            assert!(glb.len() < 2 * json + bytes + images + 3 * surface.mesh.faces.len() * vertex + 10_000);
            tried += 1;
        }
    }
    println!("{tried} materials");
    assert!(tried > 25 || data("meshes").is_none());
}

#[test]
fn indices_that_something_unknown_may_mean_stay() {
    let [positions, indices] = square();
    let spare = (5126, "VEC2", false, f32s(&[0.5; 8]));
    let root = serde_json::json!({
        "meshes": [{"primitives": [
            {"attributes": {"POSITION": 0, "TEXCOORD_0": 2, "TEXCOORD_1": 3, "_MINE": 4}, "indices": 1, "material": 0,
             "extensions": {"KHR_materials_variants": {"mappings": [{"material": 1, "variants": [0]}]}}},
            {"attributes": {"POSITION": 0}, "indices": 1, "material": 1, "mode": 1},
        ]}],
        "nodes": [{"mesh": 0, "extensions": {"ACME_lightmap": {"accessor": 3}}, "extras": {"id": 2}}],
        "materials": [
            {"name": "a", "extras": {"mine": 7}, "doubleSided": true, "normalTexture": {"index": 0},
             "extensions": {"KHR_materials_ior": {"ior": 1.4}, "KHR_materials_sheen": {"sheenColorTexture": {"index": 0}}}},
            {"name": "b", "emissiveTexture": {"index": 1, "texCoord": 1}},
        ],
        "textures": [{"source": 0}, {"source": 1}],
        "images": [{"uri": "data:image/png;base64,AAAA"}, {"uri": "data:image/png;base64,BBBB", "name": "kept"}],
        "extensions": {"KHR_materials_variants": {"variants": [{"name": "v"}]}},
        "extensionsUsed": ["KHR_materials_variants", "ACME_lightmap", "KHR_materials_ior", "KHR_materials_sheen"],
    });
    let doc =
        made(root, &[positions, indices, spare.clone(), spare.clone(), (5121, "SCALAR", false, vec![9, 8, 7, 6])]);
    let surface = doc.surface(Some(&["a".into()])).unwrap();
    let uv = atlas_uv(&surface, true);
    let glb = write_atlas(&doc, &surface, &AtlasCorners { uv: &uv, tangents: None }, &maps(&[Use::BaseColor])).unwrap();
    let back = again(&glb);
    assert_eq!(back.accessors[3].packed(&back.buffers), spare.3, "an unknown extension may mean accessor 3");
    assert_eq!(back.accessors[0].packed(&back.buffers), doc.accessors[0].packed(&doc.buffers), "the lines use it");
    let (old, new) = (&doc.root, &back.root);
    assert_eq!(new["nodes"], old["nodes"]);
    assert_eq!(new["meshes"][0]["primitives"][1], old["meshes"][0]["primitives"][1]);
    let baked = &new["meshes"][0]["primitives"][0];
    let names: Vec<&String> = baked["attributes"].as_object().unwrap().keys().collect();
    assert_eq!(names, ["POSITION", "TEXCOORD_0", "TEXCOORD_1", "TEXCOORD_2", "_MINE"]);
    let mine = refs::index(&baked["attributes"], "_MINE").unwrap();
    assert_eq!(back.accessors[mine].packed(&back.buffers), [9, 9, 8, 7, 7, 6]);
    // The variant's material reads a set that moved up; it is also that of the lines, where nothing moved.
    let variant = baked["extensions"]["KHR_materials_variants"]["mappings"][0]["material"].as_u64().unwrap() as usize;
    assert_eq!(new["materials"][variant]["emissiveTexture"], serde_json::json!({"index": 1, "texCoord": 2}));
    assert_eq!(new["materials"][1], old["materials"][1]);
    assert_eq!(new["images"][1], old["images"][1]);
    assert_eq!(new["images"].as_array().unwrap().len(), 2, "the slot of the replaced image is used again");
    let a = &new["materials"][0];
    assert_eq!((&a["extras"], &a["doubleSided"]), (&old["materials"][0]["extras"], &true.into()));
    assert_eq!(a["extensions"], serde_json::json!({"KHR_materials_ior": {"ior": 1.4}}));
    assert!(a.get("normalTexture").is_none());
    let used = serde_json::json!(["KHR_materials_variants", "ACME_lightmap", "KHR_materials_ior"]);
    assert_eq!(new["extensionsUsed"], used);
}

#[test]
fn images_beside_the_scene_are_embedded_once_and_missing_ones_stay() {
    let [positions, indices] = square();
    let doc = made(
        serde_json::json!({"meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}]}),
        &[positions, indices],
    );
    let mut root = doc.root.clone();
    root["images"] = serde_json::json!([{"uri": "a%20b.png"}, {"uri": "a%20b.png", "name": "n"}, {"uri": "gone.png"}]);
    root["buffers"][0]["uri"] = "mesh.bin".into();
    let text = root.to_string();
    assert_eq!(
        crate::io::scene::external_files("s.gltf", text.as_bytes()).unwrap(),
        ["mesh.bin", "a b.png", "gone.png"]
    );
    let doc = Document::parse("s.gltf", text.as_bytes(), &mut |file| match file {
        "mesh.bin" => Ok(doc.buffers[0].clone()),
        "a b.png" => Ok(PNG.to_vec()),
        _ => Err("not there".into()),
    });
    let doc = doc.unwrap();
    let surface = doc.surface(None).unwrap();
    let uv = atlas_uv(&surface, false);
    let glb = write_atlas(&doc, &surface, &AtlasCorners { uv: &uv, tangents: None }, &maps(&[])).unwrap();
    let (back, _) = parts(&glb).unwrap();
    let image = &back["images"][0];
    assert_eq!((&image["name"], &image["mimeType"]), (&"a b".into(), &"image/png".into()));
    assert_eq!(back["images"][1]["bufferView"], image["bufferView"]);
    assert_eq!(back["images"][2], root["images"][2]);
}
