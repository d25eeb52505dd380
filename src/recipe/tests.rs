//! Recipes as users write them, right and wrong.

use super::*;
use crate::numerics::vec::{Vec3, vec3};
use crate::texture::MapKind;

/// Every table and key of the format that this version can do.
const FULL: &str = r#"kiln = 1

[mesh]
path = "assets/knot.glb"
materials = ["Stone"]

[exemplar]
base_color = "assets/pebbles/base_color.png"
normal     = "assets/pebbles/normal.png"
normal_y   = "down"
roughness  = "../shared/./roughness.png"
feature_mask = "mask.png"
importance = { base_color = 1.0, roughness = 0.5 }

[analysis]
method = "jump-map"
neighbourhoods = [9, 5, 3]
jumps = 3
variance = 0.97
alpha = 1.1
diversity = 5
min_distance = 4

[field]
symmetry = 1
orientation = [
  { at = [0.0, 1.0, 0.0], up = [0.0, 0.0, 2.0], radius = 3 },
]
singularities = [ { at = [0, 2, 0], kind = "source" } ]
scale    = [ { at = [0, 0, 0], factor = 2.0 } ]
material = [ { at = [0, 0, 0], value = 0.0 } ]

[synthesis]
scale = 256.0
seed = 1
order = "region-growing"
patch = 1.0
refine = 2
blend = "linear"

[atlas]
size = 2048
gutter = 8
maps = ["base_color", "normal", "orm"]
format = { normal = "exr" }
compression = "best"
mips = true
unwrap = "uvunwrap"

[uv_sets]
weld = 0.25

[[render]]
view = "turntable-4"
size = 512
shading = "lit"

[[render]]
camera = { eye = [0, 0, 3], target = [0, 0, 0], fov_deg = 90 }
"#;

fn read(text: &str) -> Result<Recipe, Faults> {
    parse(Path::new("recipes/knot.toml"), text.as_bytes(), None)
}

/// The least that makes sense.
const LEAST: &str = "mesh.path = 'm.obj'\nexemplar.base_color = 'c.png'\natlas = {}\n";

/// The faults of a recipe, one line each, without the file's name.
fn faults(text: &str) -> Vec<String> {
    let faults = read(text).err().map(|faults| faults.to_string()).unwrap_or_default();
    faults.lines().map(|line| line.strip_prefix("recipes/knot.toml:").unwrap_or(line).to_string()).collect()
}

fn mesh_bake(recipe: Recipe) -> MeshBake {
    match recipe.target {
        Target::Mesh(bake) => bake,
        Target::Canvas(canvas) => panic!("a canvas: {canvas:?}"),
    }
}

#[test]
fn every_key_arrives() {
    let recipe = read(FULL).unwrap_or_else(|f| panic!("{}", f.render(false)));
    assert_eq!(recipe.name, "knot");
    let maps: Vec<_> = recipe.exemplar.maps.iter().map(|m| (m.map, m.file.path.to_str())).collect();
    assert_eq!(
        maps,
        [
            (MapFile::BaseColor, Some("recipes/assets/pebbles/base_color.png")),
            (MapFile::Normal, Some("recipes/assets/pebbles/normal.png")),
            (MapFile::Roughness, Some("shared/roughness.png")),
        ]
    );
    assert_eq!(recipe.exemplar.maps[0].file.place, "recipes/knot.toml:8:14");
    assert_eq!(recipe.exemplar.maps[2].file.written, "../shared/./roughness.png");
    assert_eq!(recipe.exemplar.normal_y, NormalY::Down);
    assert_eq!(recipe.exemplar.importance, [(MapKind::BaseColor, 1.0), (MapKind::Roughness, 0.5)]);
    assert_eq!(
        recipe.analysis,
        Analysis {
            neighbourhoods: vec![9, 5, 3],
            jumps: 3,
            variance: 0.97,
            alpha: 1.1,
            diversity: 5,
            min_distance: Some(4.0),
            textons: None,
            tile: None,
        }
    );
    assert_eq!(recipe.synthesis, Synthesis { seed: 1, patch: 1.0, refine: 2, blend: Blend::Linear });
    let bake = mesh_bake(recipe);
    assert_eq!(bake.mesh.path, Path::new("recipes/assets/knot.glb"));
    assert_eq!(bake.materials, Some(vec!["Stone".to_string()]));
    assert_eq!(bake.scale, Scale::TexelsPerUnit(256.0));
    let up = Orientation { at: vec3(0.0, 1.0, 0.0), up: vec3(0.0, 0.0, 1.0), radius: Some(3.0) };
    assert_eq!(
        bake.field,
        Field {
            symmetry: Symmetry::One,
            orientation: vec![up],
            singularities: vec![Singularity {
                at: vec3(0.0, 2.0, 0.0),
                kind: Singular::Kind(SingularityKind::Source),
                radius: None
            }],
            align: vec![],
            scale: vec![ScalePoint { at: Vec3::ZERO, factor: 2.0, radius: None }],
            material: vec![],
        }
    );
    assert_eq!(
        bake.atlas,
        Some(Atlas {
            size: AtlasSize::Side(2048),
            gutter: Some(8),
            maps: vec![
                MapOutput { map: MapFile::BaseColor, format: ImageFormat::Png },
                MapOutput { map: MapFile::Normal, format: ImageFormat::Exr },
                MapOutput { map: MapFile::Orm, format: ImageFormat::Png },
            ],
            compression: Compression::Best,
            mips: true,
            layout: Layout::Unwrap(Unwrap::Uvunwrap),
            refine: 0,
            filter: AtlasFilter::Cubic,
        })
    );
    assert_eq!(bake.uv_sets, Some(UvSets { weld: 0.25 }));
    let camera = View::Camera { eye: vec3(0.0, 0.0, 3.0), target: Vec3::ZERO, fov: std::f64::consts::FRAC_PI_2 };
    assert_eq!(
        bake.renders,
        [
            Render { name: "turntable-4".into(), view: View::Turntable(4), size: 512, shading: Shading::Lit },
            Render { name: "camera".into(), view: camera, size: 512, shading: Shading::Lit },
        ]
    );
}

#[test]
fn levels_of_detail_are_meshes_beside_the_recipe() {
    let text = format!("{LEAST}mesh.lods = ['b.obj', '../c.glb']\nsynthesis.sharpness = 3\n");
    let bake = mesh_bake(read(&text).unwrap_or_else(|f| panic!("{}", f.render(false))));
    let paths: Vec<&Path> = bake.lods.iter().map(|l| l.path.as_path()).collect();
    assert_eq!(paths, [Path::new("recipes/b.obj"), Path::new("c.glb")]);
    assert_eq!((bake.lods[1].key.as_str(), bake.sharpness), ("mesh.lods[1]", 3));
}

#[test]
fn everything_but_the_mesh_and_the_exemplar_has_a_default() {
    let recipe = read(LEAST).unwrap_or_else(|f| panic!("{}", f.render(false)));
    assert_eq!(recipe.exemplar.importance, [(MapKind::BaseColor, 1.0)]);
    assert_eq!(recipe.exemplar.normal_y, NormalY::Up);
    assert_eq!((recipe.analysis.min_distance, recipe.analysis.neighbourhoods), (None, vec![9, 5, 3]));
    assert_eq!(recipe.synthesis, Synthesis { seed: 1, patch: 1.0, refine: 2, blend: Blend::Linear });
    let bake = mesh_bake(read(LEAST).unwrap_or_else(|f| panic!("{f}")));
    assert_eq!((bake.scale, bake.order, bake.materials), (Scale::Auto, WalkOrder::RegionGrowing, None));
    let atlas = bake.atlas.expect("asked for");
    assert_eq!(atlas.maps, [MapOutput { map: MapFile::BaseColor, format: ImageFormat::Png }]);
    assert_eq!((atlas.size, atlas.gutter, atlas.mips), (AtlasSize::Side(2048), None, true));
}

#[test]
fn a_canvas_is_a_recipe_too() {
    let text = "[canvas]\nsize = [512, 256]\ntileable = true\norder = 'serpentine'\nformat = 'png16'\n\
                blend_kernel = 5\ndebug = ['sources', 'patches']\n\
                [exemplar]\norm = 'a.png'\nheight = 'h.png'\n[synthesis]\nseed = 7\nblend = 'none'\n";
    let recipe = read(text).unwrap_or_else(|f| panic!("{}", f.render(false)));
    assert_eq!(recipe.exemplar.importance, [(MapKind::Height, 1.0)]);
    assert_eq!((recipe.synthesis.seed, recipe.synthesis.blend), (7, Blend::None));
    assert_eq!(
        recipe.target,
        Target::Canvas(Canvas {
            size: Some([512, 256]),
            tileable: true,
            frames: None,
            looped: false,
            order: CanvasOrder::Serpentine,
            guide: None,
            inpaint: None,
            sources: None,
            blend_kernel: BlendSize::Five,
            maps: vec![
                MapOutput { map: MapFile::Height, format: ImageFormat::Png16 },
                MapOutput { map: MapFile::Orm, format: ImageFormat::Png16 },
            ],
            compression: Compression::Fast,
            debug: vec![CanvasDebug::Sources, CanvasDebug::Patches],
        })
    );
}

#[test]
fn a_flipbook_is_a_canvas_of_frames() {
    let text = "[canvas]\nsize = [64, 32]\nframes = 40\nloop = true\n\
                [exemplar]\nframes = 'a/smoke_%04d.png'\nheight = 'h%d.png'\n";
    let recipe = read(text).unwrap_or_else(|f| panic!("{}", f.render(false)));
    let maps: Vec<_> = recipe.exemplar.maps.iter().map(|m| (m.map, m.file.path.to_str(), m.frames.as_ref())).collect();
    let [smoke, height] = ["smoke_%04d.png", "h%d.png"].map(|name| FramePattern::parse(name).expect("a pattern"));
    assert_eq!(
        maps,
        [
            (MapFile::BaseColor, Some("recipes/a/smoke_%04d.png"), Some(&smoke)),
            (MapFile::Height, Some("recipes/h%d.png"), Some(&height)),
        ]
    );
    assert_eq!(recipe.exemplar.importance, [(MapKind::BaseColor, 1.0), (MapKind::Height, 1.0)]);
    let Target::Canvas(canvas) = recipe.target else { panic!("a mesh") };
    assert_eq!((canvas.frames, canvas.looped, canvas.maps.len()), (Some(40), true, 2));

    let allowed = "expected one `%d`, or `%04d` for four digits, such as \"smoke_%04d.png\"";
    for (old, new, expected) in [
        ("_%04d", "", format!("6:10: the file name of `exemplar.frames` has no frame number: {allowed}")),
        ("h%d", "h%d%d", format!("7:10: the file name of `exemplar.height` has two frame numbers: {allowed}")),
        ("a/smoke", "%d/x", "".into()),
        ("frames = 40", "frames = 0", "3:10: `canvas.frames` can't be 0: expected a whole number from 1 to 4096".into()),
        (
            "[64, 32]",
            "[1024, 2048]",
            "3:10: a flipbook of 1024 x 2048 has 83886080 texels: expected at most 67108864 texels in all frames".into(),
        ),
        (
            "height",
            "base_color",
            "7:1: `exemplar.frames` and `exemplar.base_color` exclude each other; `frames` are the base colour of a \
             flipbook; keep one"
                .into(),
        ),
        (
            "height",
            "feature_mask",
            "7:1: `exemplar.frames` and `exemplar.feature_mask` exclude each other; a flipbook is analysed without a \
             mask; remove it"
                .into(),
        ),
        (
            "[canvas]\nsize = [64, 32]\nframes = 40\nloop = true\n",
            "[atlas]\n[mesh]\npath = 'm.obj'\n",
            "5:1: [mesh] and `exemplar.frames` exclude each other; a mesh is covered with a still; a flipbook fills a \
             [canvas]"
                .into(),
        ),
        (
            "frames = 'a/smoke_%04d.png'",
            "base_color = 'c.png'",
            "3:10: `canvas.frames` is for flipbooks, and the exemplar is a still; name the exemplar's frames: [exemplar] \
             frames = \"smoke_%04d.png\"\n4:8: `canvas.loop` is for flipbooks, and the exemplar is a still; name the \
             exemplar's frames: [exemplar] frames = \"smoke_%04d.png\""
                .into(),
        ),
    ] {
        assert!(text.contains(old), "{old}");
        assert_eq!(faults(&text.replacen(old, new, 1)).join("\n"), expected, "{new}");
    }
}

#[test]
fn three_mistakes_are_reported_as_three() {
    let text = FULL.replace("jumps = 3", "jumpss = 3").replace("= \"linear\"", "= \"lineer\"");
    assert_eq!(
        faults(&text.replace("gutter = 8", "gutter = 300")),
        [
            "18:1: unknown key `jumpss` in [analysis]; did you mean `jumps`?",
            "39:9: `synthesis.blend` can't be \"lineer\": expected \"linear\", \"variance\" or \"none\"; did you mean \
         \"linear\"?",
            "43:10: `atlas.gutter` can't be 300: expected a whole number from 0 to 256",
        ]
    );
}

/// Every mistake alone: what is replaced in `FULL`, by what, and what is said.
#[test]
fn mistakes_are_named_with_place_and_remedy() {
    for (old, new, expected) in [
        ("kiln = 1", "kiln = 2", "1:8: `kiln` can't be 2: expected 1"),
        ("blend = \"linear\"", "seeed = 1", "39:1: unknown key `seeed` in [synthesis]; did you mean `seed`?"),
        ("blend = \"linear\"", "gutter = 1", "39:1: unknown key `gutter` in [synthesis]; `gutter` belongs in [atlas]"),
        ("[uv_sets]", "[uvsets]", "50:2: unknown table [uvsets]; did you mean `uv_sets`?"),
        ("weld = 0.25", "with = 1", "51:1: unknown key `with` in [uv_sets]; [uv_sets] takes `weld`"),
        ("weld = 0.25", "weld = nan", "51:8: `uv_sets.weld` can't be nan: expected a number from 0 to 16"),
        ("weld = 0.25", "weld = -inf", "51:8: `uv_sets.weld` can't be -inf: expected a number from 0 to 16"),
        (
            "seed = 1",
            "seed = -1",
            "35:8: `synthesis.seed` can't be -1: expected a whole number from 0 to \
            9223372036854775807",
        ),
        (
            "seed = 1",
            "seed = '1'",
            "35:8: `synthesis.seed` can't be \"1\": expected a whole number from 0 to \
            9223372036854775807; write it without quotes: 1",
        ),
        (
            "jumps = 3",
            "jumps = 3.0",
            "18:9: `analysis.jumps` can't be 3.0: expected a whole number from 1 to 64; \
            write it without a fraction: 3",
        ),
        ("jumps = 3", "jumps = 3.5", "18:9: `analysis.jumps` can't be 3.5: expected a whole number from 1 to 64"),
        (
            "[9, 5, 3]",
            "[9, 4, 35]",
            "17:22: `analysis.neighbourhoods[1]` can't be 4: expected an odd whole number \
            from 1 to 33\n17:25: `analysis.neighbourhoods[2]` can't be 35: expected an odd whole number from 1 to 33",
        ),
        (
            "[9, 5, 3]",
            "[]",
            "17:18: `analysis.neighbourhoods` has 0 values: expected an array of 1 to 8 values, each \
            an odd whole number from 1 to 33",
        ),
        (
            "[9, 5, 3]",
            "9",
            "17:18: `analysis.neighbourhoods` can't be 9: expected an array of 1 to 8 values, each an \
            odd whole number from 1 to 33; write it in brackets: [9]",
        ),
        (
            "scale = 256.0",
            "scale = 0",
            "34:9: `synthesis.scale` can't be 0: expected a number from 1e-6 to 1e9 or \
            \"auto\"",
        ),
        (
            "scale = 256.0",
            "scale = 'Auto'",
            "34:9: `synthesis.scale` can't be \"Auto\": expected a number from 1e-6 \
            to 1e9 or \"auto\"; did you mean \"auto\"?",
        ),
        (
            "mips = true",
            "mips = 'true'",
            "47:8: `atlas.mips` can't be \"true\": expected true or false; write it \
            without quotes: true",
        ),
        ("size = 2048", "size = 8", "42:8: `atlas.size` can't be 8: expected a whole number from 16 to 16384"),
        (
            "unwrap = \"uvunwrap\"",
            "keep_uv = 0\nunwrap = 'uvunwrap'",
            "49:1: `atlas.keep_uv` and `atlas.unwrap` \
            exclude each other; the texture coordinates are made or kept; keep one",
        ),
        (
            "unwrap = \"uvunwrap\"",
            "texels_per_unit = 10",
            "48:1: `atlas.size` and `atlas.texels_per_unit` exclude \
            each other; each follows from the other; keep one",
        ),
        (
            "mips = true",
            "mips = true\nrefine = 2",
            "51:2: `atlas.refine` and [uv_sets] exclude each other; the atlas would show what the UV sets cannot; make \
            two recipes",
        ),
        (
            "mips = true",
            "filter = 'nearest'",
            "47:10: `atlas.filter` can't be \"nearest\": expected \"linear\" or \"cubic\"",
        ),
        ("mips = true", "udim = true", "47:8: this version of kiln can't do `atlas.udim = true` yet: expected false"),
        (
            "{ normal = \"exr\" }",
            "{ normal = 'ktx2-bc5', height = 'png' }",
            "45:21: this version of kiln can't do \
            `atlas.format.normal = \"ktx2-bc5\"` yet: expected \"png\", \"png16\" or \"exr\"\n45:42: \
            `atlas.format.height` is the format of a map that is not written: expected `base_color`, `normal` or `orm`",
        ),
        (
            "\"orm\"]",
            "\"height\"]",
            "44:33: `atlas.maps` asks for `height`, which the exemplar does not have; add \
            `height` to [exemplar], or leave it out",
        ),
        ("\"orm\"]", "\"normal\"]", "44:33: `atlas.maps` has \"normal\" twice; remove one"),
        (
            "roughness = 0.5",
            "height = 0.5",
            "13:43: `exemplar.importance.height` weighs a map that the exemplar does \
            not have: expected `base_color`, `normal`, `roughness` or `feature_mask`",
        ),
        (
            "base_color = 1.0, roughness = 0.5",
            "base_color = 0",
            "13:14: `exemplar.importance` gives no map any \
            weight: expected at least one weight above 0",
        ),
        (
            "feature_mask =",
            "orm =",
            "12:1: `exemplar.roughness` and `exemplar.orm` exclude each other; `orm` holds \
            the roughness in its green channel; keep one",
        ),
        ("knot.glb", "knot.fbx", "4:8: `mesh.path` can't be \"assets/knot.fbx\": expected a .glb, .gltf or .obj file"),
        (
            "knot.glb",
            "kn\\u001bot.glb",
            "4:8: `mesh.path` has a control character in it: \"assets/kn\\u{1b}ot.glb\": \
            expected a path",
        ),
        (
            "materials = [\"Stone\"]",
            "lods = [\"a.glb\", \"a.glb\"]",
            "5:18: `mesh.lods` has \"a.glb\" twice; remove one",
        ),
        (
            "patch = 1.0",
            "sharpness = 0",
            "37:13: `synthesis.sharpness` can't be 0: expected a whole number from 1 to 16",
        ),
        ("[\"Stone\"]", "[\"a\", \"a\"]", "5:19: `mesh.materials` has \"a\" twice; remove one"),
        ("symmetry = 1", "symmetry = 3", "25:12: `field.symmetry` can't be 3: expected 1, 2, 4 or \"isotropic\""),
        (
            "up = [0.0, 0.0, 2.0]",
            "up = [0, 0, 0.0]",
            "27:32: `field.orientation[0].up` has no direction: expected at \
            least one component other than 0",
        ),
        (
            "kind = \"source\"",
            "index = 0.5",
            "29:45: `field.singularities[0].index` can't be 0.5 where `field.symmetry` is 1: \
            expected a whole number other than 0",
        ),
        (
            "kind = \"source\"",
            "kind = 'sink', index = 1",
            "29:52: `field.singularities[0].kind` and \
            `field.singularities[0].index` exclude each other; the kind says the index; keep one",
        ),
        (
            ", kind = \"source\"",
            "",
            "29:19: `field.singularities[0]` has no `kind`: expected kind = \"source\", \
            \"sink\" or \"vortex\", or an `index`",
        ),
        (
            "symmetry = 1",
            "symmetry = 1\nalign = [\"creases\", \"creases\"]",
            "26:21: `field.align` has \"creases\" twice; remove one",
        ),
        (
            "value = 0.0",
            "value = 0.5",
            "31:40: `field.material[0].value` is a place between the keys of a tile: \
            expected 0, the only exemplar, or `analysis.method = \"material-space\"`",
        ),
        (
            "shading = \"lit\"",
            "shading = \"singularities\"",
            "56:11: `render[0]` shows the coordinates of a tile, and there is none: \
            expected `analysis.method = \"material-space\"`, or \"field\" for the field's singularities",
        ),
        (
            "shading = \"lit\"",
            "shading = \"edges\"",
            "56:11: `render[0]` shows what is blended over the edges of triangles, and nothing is: \
            expected `analysis.method = \"texton\"`",
        ),
        (
            "at = [0, 0, 0], factor",
            "factor",
            "30:14: `field.scale[0]` needs a key `at`: expected an array of 3 \
            values, each a number from -1e9 to 1e9",
        ),
        (
            "turntable-4",
            "turntable-0",
            "54:8: `render[0].view` can't be \"turntable-0\": expected \"turntable-N\" \
            with N from 1 to 360; for a single view, write camera = { eye = [x, y, z], target = [x, y, z] }",
        ),
        (
            "eye = [0, 0, 3]",
            "eye = [0, 0, 0]",
            "59:10: `render[1].camera` looks at its own place; move `eye` away \
            from `target`",
        ),
        (
            "camera =",
            "view = 'turntable-1'\ncamera =",
            "60:1: `render[1].view` and `render[1].camera` exclude each \
            other; a camera is a view of its own; make two [[render]] tables",
        ),
        (
            "jumps = 3",
            "window = 11",
            "18:1: `analysis.window` belongs to the method \"texton\", and this recipe's is \
            \"jump-map\"; remove it",
        ),
    ] {
        let text = FULL.replacen(old, new, 1);
        assert_ne!(text, FULL, "{old} is not in the recipe");
        assert_eq!(faults(&text).join("\n"), expected, "{new}");
    }
}

#[test]
fn what_is_missing_is_asked_for_once() {
    assert_eq!(
        faults(""),
        [
            "1:1: the recipe needs a table [exemplar]",
            "1:1: the recipe has neither [mesh] nor [canvas]; name what to texture: [mesh] with a `path`, or [canvas] with \
         a `size`",
        ]
    );
    assert_eq!(
        faults("[mesh]\n[exemplar]\n[atlas]\n"),
        [
            "1:1: [mesh] needs a key `path`: expected text in quotes, not empty",
            "2:2: [exemplar] names no map; name at least one of `base_color`, `normal`, `roughness`, `metallic`, \
         `occlusion`, `height`, `opacity`, `orm` and `emissive`",
        ]
    );
    // Each absence follows from a slip that is reported already.
    assert_eq!(
        faults("[mehs]\npath = 'a.glb'\n[exemplar]\nalbedo = 'a.png'\n[atlas]\n"),
        [
            "1:2: unknown table [mehs]; did you mean `mesh`?",
            "4:1: unknown key `albedo` in [exemplar]; did you mean `base_color`?",
        ]
    );
    let nothing_out = LEAST.replace("atlas = {}", "");
    assert!(faults(&nothing_out)[0].starts_with("1:1: the recipe covers a mesh and writes nothing; add [atlas]"));
}

#[test]
fn a_canvas_has_no_surface() {
    let text = "[canvas]\nsize = [512, 20000]\n[exemplar]\nnormal = 'n.png'\n[field]\n[atlas]\n[uv_sets]\n\
                [[render]]\n[synthesis]\nscale = 2\norder = 'region-growing'\n";
    let found = faults(text);
    let places: Vec<_> = found.iter().map(|f| f.split(':').next().unwrap_or_default()).collect();
    assert_eq!(places, ["2", "5", "6", "7", "8", "10", "11"], "{found:#?}");
    assert!(found[0].contains("20000") && found[0].contains("16384"), "{}", found[0]);
    let both = faults(&text.replace("[field]", "[mesh]\npath = 'a.glb'\n[field]"));
    assert!(both[1].starts_with("5:2: [canvas] and [mesh] exclude each other"), "{}", both[1]);
}

#[test]
fn textons_have_their_keys_and_only_they() {
    let analysis = "[analysis]\nmethod = 'texton'\nwindow = 9\ncount = 200\nfeatures = 'filter-bank'\nrotations = 8\n";
    let text = LEAST.to_string() + analysis + "[synthesis]\ncandidates = 32\nblend_threshold = 0.1\n";
    let recipe = parse(Path::new("r.toml"), text.as_bytes(), None).unwrap_or_else(|f| panic!("{f}"));
    let features = TextonFeatures::FilterBank;
    assert_eq!(
        recipe.analysis.textons,
        Some(Textons { window: 9, count: Some(200), features, rotations: 8, candidates: 32, blend_threshold: 0.1 })
    );
    let none = faults(&text.replace("candidates = 32", "candidates = 0"));
    assert!(none.len() == 1 && none[0].contains("`synthesis.candidates` can't be 0"), "{none:?}");
    let nan = faults(&text.replace("blend_threshold = 0.1", "blend_threshold = nan"));
    assert!(nan.len() == 1 && nan[0].contains("`synthesis.blend_threshold` can't be nan"), "{nan:?}");
    let jumps = faults(&text.replace(analysis, ""));
    assert!(jumps.len() == 2 && jumps[0].contains("belongs to the method \"texton\""), "{jumps:?}");
    let further = "mesh = { path = 'a.glb', lods = ['b.glb'] }\n[exemplar]\nbase_color = 'a.png'\n[uv_sets]\n";
    assert_eq!(faults(&(further.to_string() + analysis)), [""; 0]);
    let corrected = text.replace("[synthesis]", "[atlas]\nrefine = 2\n[synthesis]");
    assert!(!faults(&corrected).iter().any(|f| f.contains("belongs")), "{:?}", faults(&corrected));
    let tile = faults(&further.replace("[exemplar]", "[analysis]\nmethod = 'material-space'\n[exemplar]"));
    let sentence =
        "`mesh.lods` belongs to the methods \"jump-map\" and \"texton\", and this recipe's is \"material-space\"";
    assert!(tile.iter().any(|f| f.contains(sentence)), "{tile:?}");
    let canvas = "canvas = { size = [8, 8] }\nanalysis = { method = 'texton' }\n[exemplar]\nbase_color = 'a.png'\n";
    let found = faults(canvas);
    assert!(found.len() == 1 && found[0].contains("a canvas has none"), "{found:?}");
}

#[test]
fn methods_parse_and_what_is_not_built_in_is_refused_by_name() {
    let texton = "analysis = { method = 'texton', window = 9, count = 'auto', features = 'filter-bank' }\n";
    assert_eq!(faults(&(texton.to_string() + LEAST)), [""; 0]);
    let tile = "[analysis]\nmethod = 'material-space'\nlayers = 4\n[[analysis.key]]\nbase_color = 'b.png'\n\
                feature_mask = 'f.png'\n";
    assert_eq!(faults(&(LEAST.to_string() + tile)), [""; 0]);
    let built_with = faults(&(LEAST.replace("{}", "{ unwrap = 'xatlas' }")));
    assert_eq!(built_with.is_empty(), cfg!(feature = "xatlas"), "{built_with:?}");
}

#[test]
fn broken_lines_do_not_hide_other_mistakes() {
    let text =
        FULL.replace("jumps = 3", "jumps = = 3").replace("gutter = 8", "guter = 8").replace("[uv_sets]", "[uv_sets");
    let found = faults(&text);
    assert_eq!(found.len(), 3, "{found:#?}");
    assert_eq!(found[0], "18:9: not TOML: extra `=`, expected nothing");
    assert_eq!(found[1], "43:1: unknown key `guter` in [atlas]; did you mean `gutter`?");
    assert!(found[2].starts_with("50:9: not TOML: unclosed table"), "{}", found[2]);
    let twice = LEAST.to_string() + "[analysis]\njumps = 1\njumps = 2\n";
    assert_eq!(faults(&twice), ["6:1: not TOML: duplicate key `jumps`"]);
}

#[test]
fn files_that_are_no_recipes_are_refused_without_harm() {
    let of = |bytes: &[u8]| parse(Path::new("a.toml"), bytes, None).map(|_| ()).map_err(|f| f.to_string());
    let refused = |bytes: &[u8]| of(bytes).expect_err("not a recipe");
    assert_eq!(
        refused(b"a = 1\n# \xff"),
        "a.toml:1:1: unknown key `a` outside of any table; the file takes `analysis`, `atlas`, `canvas`, `exemplar`, \
         `field`, `kiln`, `mesh`, `render`, `synthesis` and `uv_sets`\n\
         a.toml:2:3: the file is not UTF-8 text: it has a byte 0xff here; save it as UTF-8"
    );
    let large = vec![b'#'; limits::FILE_BYTES as usize + 1];
    assert!(refused(&large).starts_with("a.toml:1:1: the file has 1048577 bytes"));
    assert!(refused("[".repeat(1 << 20).as_bytes()).contains("not TOML"));
    assert!(refused(("a = ".to_string() + &"[".repeat(1 << 19)).as_bytes()).contains("not TOML"));
    assert!(refused(("a.".repeat(1 << 18) + "a = 1").as_bytes()).contains("a.toml:1:"));
    // A byte order mark and DOS line ends are harmless, comments and blank lines too.
    let dos = format!("\u{feff}# x\n\n{LEAST}").replace('\n', "\r\n");
    assert_eq!(of(dos.as_bytes()), Ok(()));
}

#[test]
fn many_mistakes_are_counted_and_the_first_hundred_shown() {
    let many = format!("{LEAST}[analysis]\nneighbourhoods = [{}]\n", "0,".repeat(9)).replace("0,0,", "0,\n0,");
    assert_eq!(faults(&many)[0].split(": ").nth(1), Some("`analysis.neighbourhoods` has 9 values"));
    let unknown: String = (0..50_000).map(|i| format!("k{i} = 1\n")).collect();
    let faults = read(&unknown).expect_err("none is known");
    assert_eq!((faults.count(), faults.iter().count()), (50_002, 100));
    assert!(faults.render(false).ends_with("\n\n... and 49902 more\n"));
}

#[test]
fn names_become_file_names() {
    let at = |path: &str| parse(Path::new(path), LEAST.as_bytes(), None).map(|r| r.name).map_err(|f| f.to_string());
    assert_eq!(at("a/b/knot.v2.toml").as_deref(), Ok("knot.v2"));
    assert_eq!(at("knot").as_deref(), Ok("knot"));
    for bad in ["", "..", "a/.hidden.toml", "a?.toml", "a\n.toml", "trailing .toml", "dot..toml"] {
        assert!(at(bad).is_err_and(|e| !e.is_empty()), "{bad}");
    }
    let path = |folder: &str, written: &str| {
        let text = LEAST.replace("m.obj", written);
        let recipe = parse(&Path::new(folder).join("r.toml"), text.as_bytes(), None).unwrap_or_else(|f| panic!("{f}"));
        mesh_bake(recipe).mesh.path.to_str().map(str::to_string)
    };
    assert_eq!(path("recipes", "../a/./b/../m.glb").as_deref(), Some("a/m.glb"));
    assert_eq!(path("", "../../m.GLB").as_deref(), Some("../../m.GLB"));
    assert_eq!(path("/x", "../../m.glb").as_deref(), Some("/m.glb"));
    assert_eq!(path("recipes", "/abs/m.glb").as_deref(), Some("/abs/m.glb"));
}

#[test]
fn views_have_names_of_their_own() {
    let view = "[[render]]\n";
    let text = LEAST.to_string() + view + view + "[[render]]\nshading = 'uv'\n" + view;
    let names: Vec<_> = mesh_bake(read(&text).unwrap_or_else(|f| panic!("{f}"))).renders;
    let names: Vec<&str> = names.iter().map(|r| r.name.as_str()).collect();
    assert_eq!(names, ["turntable-4", "turntable-4-lit", "turntable-4-uv", "turntable-4-2"]);
}

#[test]
fn defaults_lie_under_a_recipe_key_by_key() {
    let toml = "[defaults.analysis]\njumps = 5\nneighbourhoods = [7]\n[defaults.atlas]\nsize = 1024\nmips = false\n\
                [defaults.synthesis]\nscale = 64\n[defaults.exemplar]\nimportance = { base_color = 2, height = 1 }\n\
                [cache]\npath = '../cache'\nmax_size = 1000\n";
    let project = parse_project(Path::new("p/kiln.toml"), toml.as_bytes()).unwrap_or_else(|f| panic!("{f}"));
    assert_eq!(project.cache.path.as_ref().and_then(|f| f.path.to_str()), Some("cache"));
    assert_eq!(project.cache.max_size, Some(1000));
    let read = |text: &str| parse(Path::new("r.toml"), text.as_bytes(), Some(&project.defaults));

    let recipe = read(&(LEAST.to_string() + "[analysis]\nneighbourhoods = [9, 5]\n")).unwrap_or_else(|f| panic!("{f}"));
    assert_eq!((recipe.analysis.jumps, &recipe.analysis.neighbourhoods[..]), (5, &[9, 5][..]));
    assert_eq!(recipe.exemplar.importance, [(MapKind::BaseColor, 2.0)]);
    let atlas = mesh_bake(recipe).atlas.expect("asked for");
    assert_eq!((atlas.size, atlas.mips), (AtlasSize::Side(1024), false));

    // A recipe's own key drives out the default that excludes it.
    let own = read(&LEAST.replace("{}", "{ texels_per_unit = 10 }")).unwrap_or_else(|f| panic!("{f}"));
    assert_eq!(mesh_bake(own).atlas.map(|a| a.size), Some(AtlasSize::TexelsPerUnit(10.0)));
    let canvas = read("canvas.size = [8, 8]\nexemplar.height = 'h.png'\n").unwrap_or_else(|f| panic!("{f}"));
    assert_eq!(canvas.analysis.jumps, 5);
    assert_eq!(canvas.exemplar.importance, [(MapKind::Height, 1.0)]);
}

#[test]
fn a_server_is_said_in_the_cache() {
    let of = |text: &str| parse_project(Path::new("kiln.toml"), text.as_bytes()).map(|project| project.cache.remote);
    assert_eq!(of("").unwrap_or_else(|f| panic!("{f}")), Remote::default());
    let text = "[cache]\nremote = 'grpc://farm:8980'\nremote_instance = 'art'\nremote_mode = 'read'\n\
                remote_execute = true\nremote_timeout = 3\nremote_platform = ['OSFamily=linux', 'ISA = x86-64']\n";
    let remote = of(text).unwrap_or_else(|f| panic!("{f}"));
    assert_eq!((remote.url.as_deref(), remote.instance.as_str()), (Some("grpc://farm:8980"), "art"));
    assert_eq!((remote.mode, remote.execute, remote.timeout), (RemoteMode::Read, true, 3));
    assert_eq!(remote.platform, [("OSFamily", "linux"), ("ISA", "x86-64")].map(|(n, v)| (n.into(), v.into())));
    let faults =
        of("[cache]\nremote = 'farm:8980'\nremote_timeout = 0\nremote_mode = 'write'\nremote_platform = ['linux']\n");
    let faults = faults.expect_err("four mistakes").to_string();
    for said in [
        "`cache.remote_timeout` can't be 0: expected a whole number from 1 to 86400",
        "expected \"read\" or \"read-write\"",
    ] {
        assert!(faults.contains(said), "{faults}");
    }
    let faults = of("[cache]\nremote = 'farm:8980'\nremote_platform = ['linux']\n").expect_err("two").to_string();
    assert!(
        faults.contains("kiln.toml:2:10: `cache.remote` can't be \"farm:8980\": expected \"grpc://host:port\""),
        "{faults}"
    );
    assert!(faults.contains("`cache.remote_platform[0]` can't be \"linux\": expected \"name=value\""), "{faults}");
}

#[test]
fn mistakes_in_defaults_point_into_kiln_toml() {
    let of = |text: &str| parse_project(Path::new("kiln.toml"), text.as_bytes()).map_err(|f| f.to_string());
    assert_eq!(
        of("[default]\n[defaults.atlas]\nsiz = 1\ngutter = -1\n[cache]\nmax_size = '1'\n").expect_err("four mistakes"),
        "kiln.toml:1:2: unknown table [default]; did you mean `defaults`?\n\
         kiln.toml:3:1: unknown key `siz` in [defaults.atlas]; did you mean `size`?\n\
         kiln.toml:4:10: `defaults.atlas.gutter` can't be -1: expected a whole number from 0 to 256\n\
         kiln.toml:6:12: `cache.max_size` can't be \"1\": expected a whole number of at least 0; write it without \
         quotes: 1"
    );
    // What only a recipe can tell is told of the recipe, at the place of the default.
    let project = of("\n[defaults.analysis]\nmethod = 'texton'\n").unwrap_or_else(|f| panic!("{f}"));
    let canvas = b"canvas.size = [8, 8]\nexemplar.base_color = 'c.png'\n";
    let faults = parse(Path::new("r.toml"), canvas, Some(&project.defaults)).expect_err("no mesh");
    assert!(faults.to_string().starts_with("kiln.toml:3:10: textons are quilted over"), "{faults}");
    assert!(faults.render(false).contains("3 | method = 'texton'"));
    assert!(of("").is_ok());
}

#[test]
fn the_schema_has_every_key_that_recipes_use() {
    let schema = json_schema();
    for line in FULL.lines() {
        let header = line.strip_prefix('[').map(|rest| rest.trim_matches(['[', ']']));
        let keys = line.split([',', '{']).filter_map(|part| part.split_once('=')).map(|(key, _)| key.trim());
        for key in header.into_iter().chain(keys) {
            assert!(schema.contains(&format!("\"{key}\": {{")), "{key}");
        }
    }
}

mod any_input;
mod control;
mod material;
