//! Tiles of material space: keys, layers, what is written.

use super::*;

const TILE: &str = "mesh.path = 'm.obj'\nexemplar.base_color = 'a.png'\nexemplar.normal = 'an.png'\n\
    [analysis]\nmethod = 'material-space'\nlayers = 5\ntile = '2d-array'\n\
    [[analysis.key]]\nbase_color = 'b.png'\nnormal = 'bn.png'\nnormal_y = 'down'\nfeature_mask = 'bf.png'\n";

#[test]
fn keys_follow_the_exemplar() {
    let recipe = read(TILE).unwrap_or_else(|f| panic!("{f}"));
    let tile = recipe.analysis.tile.expect("a tile");
    assert_eq!((tile.layers, tile.shape, tile.keys.len()), (5, TileShape::Array, 1));
    let key = &tile.keys[0];
    assert_eq!((key.maps[1].file.key.as_str(), key.normal_y), ("analysis.key[0].normal", NormalY::Down));
    assert_eq!(key.feature_mask.as_ref().map(|f| f.written.as_str()), Some("bf.png"));
    let field = "field.material = [{ at = [0, 1, 0], value = 0.25, radius = 2.0 }]\natlas = {}\n";
    let Target::Mesh(bake) = read(&(field.to_string() + TILE)).unwrap_or_else(|f| panic!("{f}")).target else {
        panic!("a mesh")
    };
    let point = MaterialPoint { at: vec3(0.0, 1.0, 0.0), value: 0.25, radius: Some(2.0) };
    assert_eq!((bake.field.material, bake.atlas.is_some()), (vec![point], true));
    let one = "mesh.path = 'm.obj'\nexemplar.base_color = 'a.png'\nanalysis.method = 'material-space'\n";
    let tile = read(one).unwrap_or_else(|f| panic!("{f}")).analysis.tile.expect("a tile");
    assert_eq!((tile.layers, tile.shape, tile.keys.len()), (8, TileShape::Volume, 0));
}

#[test]
fn what_cannot_be_a_tile_is_named() {
    let said = |old: &str, new: &str| {
        assert!(TILE.contains(old), "{old}");
        faults(&TILE.replace(old, new)).join("\n")
    };
    for (old, new, expected) in [
        ("layers = 5", "layers = 1", "6:10: `analysis.layers` can't be 1: expected a whole number from 2 to 256"),
        (
            "normal = 'bn.png'\n",
            "",
            "8:1: `analysis.key[0]` has other maps than [exemplar]: expected `base_color` and `normal`",
        ),
        ("base_color = 'b.png'\nnormal = 'bn.png'\n", "", "`analysis.key[0]` names no map"),
        ("normal_y", "mask = 'm.png'\nnormal_y", "11:1: `analysis.key[0].mask` is for canvases"),
        ("normal_y", "tileable = true\nnormal_y", "11:1: unknown key `tileable` in `analysis.key[0]`"),
        ("'material-space'", "'jump-map'", "`analysis.key` belongs to the method \"material-space\""),
        (
            "mesh.path = 'm.obj'",
            "canvas.size = [8, 8]",
            "a tile of material space is laid over a mesh, and a canvas is none",
        ),
    ] {
        let found = said(old, new);
        assert!(found.contains(expected), "{new}: {found}");
    }
    let keys = "[[analysis.key]]\nbase_color = 'c.png'\nnormal = 'cn.png'\n".repeat(5);
    let many = faults(&(TILE.to_string() + &keys)).join("\n");
    assert!(many.contains("6:10: 5 layers are too few for 7 keys: expected at least 7"), "{many}");
}
