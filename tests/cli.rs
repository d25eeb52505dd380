//! The real program in a fresh folder.

mod common;

use common::{Project, TETRAHEDRON};

const RECIPE: &str = r#"
[mesh]
path = "m.obj"

[exemplar]
base_color = "e.png"

[analysis]
neighbourhoods = [5, 3]

[synthesis]
scale = 24.0

[atlas]
size = 64

[[render]]
view = "turntable-1"
size = 32
"#;

/// A picture of 16x16 texels with something in it.
fn exemplar(phase: u32) -> Vec<u8> {
    let mut out = Vec::new();
    let mut encoder = png::Encoder::new(&mut out, 16, 16);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    let texel = |i: u32| [(i * 37 + phase) as u8, (i * i * 11) as u8, (i / 16 * 15) as u8];
    let data: Vec<u8> = (0..256).flat_map(texel).collect();
    encoder.write_header().and_then(|mut w| w.write_image_data(&data)).expect("a picture in memory");
    out
}

fn small() -> Project {
    let project = Project::new();
    project.write("recipes/one.toml", RECIPE);
    project.write("recipes/m.obj", TETRAHEDRON);
    project.write("recipes/e.png", exemplar(0));
    project
}

#[test]
fn the_second_bake_has_nothing_to_do_and_a_touched_input_rebuilds_its_cone() {
    let project = small();
    let first = project.kiln(&["bake"]).expect(0);
    assert!(first.out.contains("out/one/one.glb"), "{}", first.out);
    let files = project.files("out");
    let expected = ["one.base_color.png", "one.glb", "render/turntable-1.png", "report.json"];
    assert_eq!(files, expected.map(|f| format!("out/one/{f}")));
    assert!(project.kiln(&["bake"]).expect(0).out.starts_with("nothing to do"));
    assert!(project.kiln(&["plan"]).expect(0).out.starts_with("nothing to do"));

    project.write("recipes/e.png", exemplar(90));
    let plan = project.kiln(&["plan"]).expect(0).out;
    assert!(plan.contains("one/maps: recipes/e.png: content changed"), "{plan}");
    let again = project.kiln(&["bake"]).expect(0).err;
    for ran in ["one/maps", "one/analyse", "one/synthesise", "one/rasterise"] {
        assert!(again.contains(ran), "{ran} should have run:\n{again}");
    }
    for idle in ["one/surface", "one/unwrap"] {
        assert!(!again.contains(idle), "{idle} does not depend on the exemplar:\n{again}");
    }
    // Back again: the cache remembers.
    project.write("recipes/e.png", exemplar(0));
    let back = project.kiln(&["bake"]).expect(0);
    assert!(back.err.lines().filter(|l| !l.contains("cache")).all(|l| l.contains("maps")), "{}", back.err);
}

#[test]
fn an_output_that_is_gone_or_spoilt_comes_back() {
    let project = small();
    project.kiln(&["bake"]).expect(0);
    let whole = project.read("out/one/one.glb");
    std::fs::remove_file(project.path("out/one/one.glb")).expect("an output");
    project.write("out/one/one.base_color.png", "spoilt");
    project.kiln(&["bake"]).expect(0);
    assert_eq!(project.read("out/one/one.glb"), whole);
    assert!(project.read("out/one/one.base_color.png").starts_with(b"\x89PNG"));
}

#[test]
fn a_changed_parameter_is_named() {
    let project = small();
    project.kiln(&["bake"]).expect(0);
    project.write("recipes/one.toml", RECIPE.replace("[5, 3]", "[7, 3]"));
    let plan = project.kiln(&["plan"]).expect(0).out;
    assert!(plan.contains("`neighbourhoods` changed from [5, 3] to [7, 3]"), "{plan}");
    let json = project.kiln(&["plan", "--format", "json"]).expect(0).out;
    let plan: serde_json::Value = serde_json::from_str(&json).expect("JSON");
    assert_eq!(plan["version"], 1);
    assert!(project.kiln(&["plan", "--graph"]).expect(0).out.starts_with("digraph"));
    assert!(project.kiln(&["bake", "-n"]).expect(0).out.contains("analyse"));
    assert!(project.kiln(&["bake", "--explain"]).expect(0).err.contains("why  one/analyse: `neighbourhoods`"));
}

#[test]
fn three_mistakes_are_three_faults_with_lines_and_hints() {
    let project = small();
    let wrong = RECIPE.replace("base_color", "base_colour").replace("size = 64", "size = -4") + "\nshading = \"lid\"\n";
    project.write("recipes/one.toml", wrong);
    let ran = project.kiln(&["bake"]).expect(2);
    for said in ["base_colour", "base_color", "-4", "\"lid\"", "\"lit\"", "one.toml:6", "one.toml:15", "one.toml:21"] {
        assert!(ran.err.contains(said), "{said} is missing:\n{}", ran.err);
    }
    assert!(project.files("out").is_empty());
}

#[test]
fn wrong_commands_end_with_2_and_failed_bakes_with_1() {
    let project = small();
    project.kiln(&["bakke"]).expect(2);
    project.kiln(&["bake", "recipes/none.toml"]).expect(2);
    Project::new().kiln(&["bake"]).expect(2);
    project.write("recipes/m.obj", "v 0 0 0\nf 1 2 3\n");
    let ran = project.kiln(&["bake"]).expect(1);
    assert!(ran.err.contains("m.obj"), "{}", ran.err);
    assert!(project.files("out").is_empty(), "a failed bake leaves no output");
}

#[test]
fn check_accepts_nothing_and_a_changed_picture_is_shown() {
    let project = small();
    let fresh = project.kiln(&["check"]).expect(1);
    assert!(fresh.out.contains("new") && fresh.out.contains("kiln accept one"), "{}", fresh.out);
    assert!(project.files("golden").is_empty(), "check writes no golden");
    let refused = project.kiln_with(&["accept"], &[("CI", "true")]).expect(2);
    assert!(refused.err.contains("CI"), "{}", refused.err);
    project.kiln(&["accept", "-n"]).expect(0);
    assert!(project.files("golden").is_empty(), "a dry run writes no golden");
    project.kiln(&["accept", "one"]).expect(0);
    project.kiln(&["check"]).expect(0);
    project.write("recipes/bad.toml", RECIPE.replace("m.obj", "none.obj"));
    let half = project.kiln(&["check", "--junit", "half.xml"]).expect(1);
    assert!(half.out.contains("failed    bad/bake"), "{}", half.out);
    assert!(String::from_utf8_lossy(&project.read("half.xml")).contains("none.obj"));
    std::fs::remove_file(project.path("recipes/bad.toml")).expect("a recipe");

    project.write("recipes/one.toml", RECIPE.replace("scale = 24.0", "scale = 20.0"));
    let ran = project.kiln(&["check", "--report", "r.html", "--junit", "r.xml"]).expect(1);
    for said in ["different one/one.base_color.png", "first step that differs: prepare", "kiln accept one"] {
        assert!(ran.out.contains(said), "{said} is missing:\n{}", ran.out);
    }
    assert!(project.read(".kiln/check/one/one.base_color.png").starts_with(b"\x89PNG"), "the triptych");
    assert!(String::from_utf8_lossy(&project.read("r.html")).contains("data:image/png;base64,"));
    assert!(String::from_utf8_lossy(&project.read("r.xml")).contains("<failure"));
}

#[test]
fn the_other_verbs_do_what_they_say() {
    let project = small();
    let args = ["synth", "recipes/e.png", "-o", "big.png", "--size", "40x24", "--neighbourhoods", "5,3"];
    project.kiln(&args).expect(0);
    let info = project.kiln(&["inspect", "big.png", "--format", "json"]).expect(0).out;
    let info: serde_json::Value = serde_json::from_str(&info).expect("JSON");
    assert_eq!(info["size"], serde_json::json!([40, 24]));
    let mesh = project.kiln(&["inspect", "recipes/m.obj"]).expect(0).out;
    assert!(mesh.contains("triangles") && mesh.contains("euler characteristic     2"), "{mesh}");
    let started = project.kiln(&["init", "recipes/m.obj", "recipes/e.png", "-o", "recipes/two.toml"]).expect(0);
    assert!(started.out.contains("recipes/two.toml"), "{}", started.out);
    project.kiln(&["plan", "two"]).expect(0);
    project.kiln(&["bake", "one", "--trace", "t.json", "--depfile", "d"]).expect(0);
    assert!(String::from_utf8_lossy(&project.read("d")).contains("recipes/e.png"));
    assert!(serde_json::from_slice::<serde_json::Value>(&project.read("t.json")).is_ok());
    assert!(project.kiln(&["cache"]).expect(0).out.contains("artefacts"));
    project.kiln(&["cache", "verify"]).expect(0);
    assert!(project.kiln(&["schema"]).expect(0).out.contains("\"neighbourhoods\""));
    for (language, word) in [("glsl", "kiln_sample"), ("wgsl", "fn kiln_sample"), ("three", "applyKilnUvSets")] {
        assert!(project.kiln(&["shader", language]).expect(0).out.contains(word));
    }
    assert!(project.kiln(&["completions", "bash"]).expect(0).out.contains("kiln"));
    project.kiln(&["cache", "clear"]).expect(0);
}
