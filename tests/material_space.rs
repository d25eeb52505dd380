//! Surfaces in material space by the real program: outputs, what is listed, what an effect area costs.

mod common;

use common::{Project, sphere};
use serde_json::Value;

fn png(value: impl Fn(u32, u32) -> u8) -> Vec<u8> {
    let mut out = Vec::new();
    let mut encoder = png::Encoder::new(&mut out, 16, 16);
    encoder.set_color(png::ColorType::Grayscale);
    let data: Vec<u8> = (0..256).map(|i| value(i % 16, i / 16)).collect();
    encoder.write_header().and_then(|mut w| w.write_image_data(&data)).expect("a picture in memory");
    out
}

fn recipe(field: &str, scale: &str) -> String {
    format!(
        "mesh.path = 'm.obj'\nexemplar = {{ base_color = 'a.png', feature_mask = 'am.png' }}\n[analysis]\n\
         method = 'material-space'\nlayers = 3\n[[analysis.key]]\nbase_color = 'b.png'\nfeature_mask = 'bm.png'\n\
         [field]\nmaterial = [{{ at = [0, 1, 0], value = 1.0 }}, {{ at = [0, -1, 0], value = 0.0 }}]\n{field}\n\
         [synthesis]\nscale = {scale}\n[atlas]\nsize = 128\n[uv_sets]\n[[render]]\nview = 'turntable-1'\nsize = 48\n\
         [[render]]\nview = 'turntable-1'\nsize = 48\nshading = 'singularities'\n"
    )
}

fn project(field: &str) -> Project {
    let project = Project::new();
    let (dot, stripe) = (|x: u32, y: u32| x.abs_diff(8) + y.abs_diff(8) < 6, |x: u32, _: u32| x < 8);
    project.write("recipes/m.obj", sphere());
    project.write("recipes/a.png", png(|x, y| if dot(x, y) { 30 } else { 200 - (x * y % 7) as u8 }));
    project.write("recipes/b.png", png(|x, y| if stripe(x, y) { 90 } else { 250 - (x * y % 5) as u8 }));
    project.write("recipes/am.png", png(|x, y| if dot(x, y) { 255 } else { 0 }));
    project.write("recipes/bm.png", png(|x, y| if stripe(x, y) { 255 } else { 0 }));
    project.write("recipes/one.toml", recipe(field, "24.0"));
    project
}

#[test]
fn a_sphere_gets_every_output_the_same_for_any_number_of_threads() {
    let project = project("");
    project.kiln(&["bake", "-j", "1"]).expect(0);
    let files = project.files("out");
    for name in ["one.glb", "one.uvsets.glb", "one.base_color.png", "one.tile.ktx2", "render/turntable-1.png"] {
        assert!(files.contains(&format!("out/one/{name}")), "{name} in {files:?}");
    }
    let bytes: Vec<Vec<u8>> = files.iter().map(|f| project.read(f)).collect();
    project.kiln(&["cache", "clear"]).expect(0);
    std::fs::remove_dir_all(project.path("out")).expect("outputs");
    project.kiln(&["bake", "-j", "3"]).expect(0);
    assert!(files.iter().zip(&bytes).all(|(f, b)| project.read(f) == *b));
    let report: Value = serde_json::from_slice(&project.read("out/one/report.json")).expect("JSON");
    assert_eq!(report["field"]["index_sum"], 2.0);
    let listed = report["synthesis"]["singularities"].as_array().expect("a list");
    assert!(listed.iter().any(|s| s["kind"] == "pole"), "{listed:?}");
    let facts = project.kiln(&["inspect", "out/one/one.uvsets.glb", "--format", "json"]).expect(0).out;
    let facts: Value = serde_json::from_str(&facts).expect("JSON");
    assert_eq!(facts["poles and t-junctions"].as_array(), Some(listed));
    let text = String::from_utf8_lossy(&bytes[files.iter().position(|f| f.ends_with("uvsets.glb")).expect("there")])
        .into_owned();
    for part in ["\"_KILN_MATERIAL\"", "\"layers\":3", "\"tile\":\"one.tile.ktx2\"", "\"wrapS\":10497"] {
        assert!(text.contains(part), "{part}");
    }
}

#[test]
fn parts_without_a_material_of_their_own_are_told_of() {
    let project = project("");
    project.write("recipes/m.obj", sphere() + "v 1.2 -0.1 0\nv 1.5 0.1 0\nv 1.2 0.1 0.2\nf 267 268 269\n");
    let plain = recipe("", "24.0");
    project.write("recipes/one.toml", format!("{}[uv_sets]\n", &plain[..plain.find("[atlas]").expect("there")]));
    project.kiln(&["bake"]).expect(0);
    let report: Value = serde_json::from_slice(&project.read("out/one/report.json")).expect("JSON");
    assert_eq!(report["synthesis"]["periodic"]["components_without_material"], 1);
    let facts = project.kiln(&["inspect", "out/one/one.uvsets.glb"]).expect(0).out;
    assert!(facts.contains("components without material 1"), "{facts}");
}

#[test]
fn a_changed_effect_area_leaves_the_whole_as_it_is() {
    let area = |up: &str| format!("orientation = [{{ at = [0, 0, 1], up = {up}, radius = 0.7 }}]");
    let project = project(&area("[1, 0.5, 0]"));
    project.kiln(&["bake"]).expect(0);
    project.write("recipes/one.toml", recipe(&area("[1, -0.5, 0]"), "24.0"));
    let plan = project.kiln(&["plan", "--format", "json"]).expect(0).out;
    let plan: Value = serde_json::from_str(&plan).expect("JSON");
    let text = plan.to_string();
    assert!(text.contains("effect areas"), "{text}");
    let said = project.kiln(&["bake", "-v"]).expect(0).err;
    assert!(
        said.contains("one/effect areas") && !said.contains("one/parametrise") && !said.contains("one/field\n"),
        "{said}"
    );
}

#[test]
fn what_cannot_be_laid_says_why() {
    let project = project("");
    let said = |field: &str, scale: &str| {
        project.write("recipes/one.toml", recipe(field, scale));
        let ran = project.kiln(&["bake"]);
        assert_ne!(ran.code, 0, "{field} {scale}");
        ran.err
    };
    let coarse = said("", "1e9");
    assert!(coarse.contains("triangles, more than") && coarse.contains("fits"), "{coarse}");
    let zero = said("scale = [{ at = [0, 1, 0], factor = 0.0 }]", "24.0");
    assert!(zero.contains("`field.scale[0].factor` can't be 0"), "{zero}");
    let far = said("orientation = [{ at = [90, 0, 0], up = [0, 1, 0] }]", "24.0");
    assert!(far.contains("orientation constraint 0 is 89"), "{far}");
}
