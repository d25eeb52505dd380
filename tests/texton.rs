//! Textons through the real program: the map of a picture, a bake for any number of threads, what cannot be.

mod common;

use common::{Project, TETRAHEDRON, picture, sphere};
use kiln::io::Samples;
use kiln::io::image_file::{Limits, decode_pixels};

/// A PNG of 8 bits, RGB.
fn png([w, h]: [u32; 2], value: impl Fn(u32, u32) -> [u8; 3]) -> Vec<u8> {
    let mut out = Vec::new();
    let mut encoder = png::Encoder::new(&mut out, w, h);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    let data: Vec<u8> = (0..w * h).flat_map(|i| value(i % w, i / w)).collect();
    encoder.write_header().and_then(|mut w| w.write_image_data(&data)).expect("a picture in memory");
    out
}

/// Bricks of 12 x 6 texels, each of another red.
fn bricks(x: u32, y: u32) -> [u8; 3] {
    let row = y / 6;
    let (x, brick) = (x + row % 2 * 6, (x + row % 2 * 6) / 12);
    if y.is_multiple_of(6) || x.is_multiple_of(12) {
        [180, 178, 170]
    } else {
        [110 + (brick * 37 + row * 61) as u8 % 90, 60, 50]
    }
}

fn recipe(analysis: &str, synthesis: &str, outputs: &str) -> String {
    format!(
        "mesh.path = 'm.obj'\nexemplar = {{ base_color = 'e.png', height = 'h.png', importance = {{ base_color = 1.0, height = 0.5 }} }}\n\
         [analysis]\nmethod = 'texton'\nwindow = 5\n{analysis}\n[synthesis]\nscale = 40.0\n{synthesis}\n{outputs}\n"
    )
}

const ALL: &str = "[atlas]\nsize = 128\n[uv_sets]\n[[render]]\nview = 'turntable-1'\nsize = 64\n";

fn project() -> Project {
    let project = Project::new();
    project.write("recipes/m.obj", sphere());
    project.write("recipes/e.png", png([64, 48], bricks));
    project.write("recipes/h.png", png([64, 48], |x, y| [bricks(x, y)[0] / 2; 3]));
    project
}

#[test]
fn the_same_bytes_for_any_number_of_threads_and_all_ways_of_quilting() {
    let bake = |jobs| {
        let project = project();
        let ways = [
            ("window", "", ""),
            ("published", "", "refine = 0\nblend_threshold = 0.0"),
            ("turned", "rotations = 8", "refine = 1\nblend = 'variance'"),
            ("bank", "features = 'filter-bank'\ncount = 30", "candidates = 5\nblend = 'none'"),
            ("order", "", "order = 'rendering-sequence'"),
        ];
        ways.iter().for_each(|(name, a, s)| project.write(&format!("recipes/{name}.toml"), recipe(a, s, ALL)));
        project.kiln(&["bake", "-j", jobs]).expect(0);
        let again = project.kiln(&["bake", "-j", jobs]).expect(0);
        assert!(
            again.err.contains("nothing to do") || again.out.contains("nothing to do"),
            "{}{}",
            again.out,
            again.err
        );
        project.contents("out")
    };
    let (one, two) = (bake("1"), bake("2"));
    assert_eq!(one.keys().collect::<Vec<_>>(), two.keys().collect::<Vec<_>>());
    for (file, bytes) in &one {
        assert!(bytes == &two[file], "{file} depends on the number of threads");
    }
    let report = |way: &str| -> serde_json::Value {
        serde_json::from_slice(&one[&format!("out/{way}/report.json")]).expect("a report")
    };
    let quilt = |way| report(way)["synthesis"]["quilt"].clone();
    assert_eq!(quilt("published")["pieces"], quilt("published")["faces"], "one triangle at a time");
    assert!(quilt("window")["pieces"].as_u64() < quilt("window")["faces"].as_u64());
    assert!(quilt("published")["edge_error"].as_f64() > quilt("window")["edge_error"].as_f64());
    assert_eq!(
        (quilt("bank")["blended_edges"].as_u64(), report("bank")["exemplar"]["textons"].as_u64()),
        (Some(0), Some(30))
    );
    // The order of [synthesis] is that of the triangles written: the picture is the same.
    assert_eq!(one["out/order/order.base_color.png"], one["out/window/window.base_color.png"]);
    assert_ne!(one["out/order/order.uvsets.glb"], one["out/window/window.uvsets.glb"]);
}

/// The steps of textons that ran, of one recipe.
fn steps_of_textons(said: &str, of: &str) -> Vec<String> {
    let steps = said.lines().filter_map(|line| line.split_once("s  ")?.1.strip_prefix(of)).map(str::to_string);
    let mut steps: Vec<String> = steps
        .filter(|s| ["/maps", "/analyse textons", "/quilt", "/blend mesh", "/blend sets"].contains(&&s[..]))
        .collect();
    steps.sort_unstable();
    steps
}

#[test]
fn further_meshes_take_the_textons_from_the_cache() {
    let first = project();
    first.write("recipes/one.toml", recipe("", "", "[uv_sets]"));
    let ran = first.kiln(&["bake"]).expect(0).err;
    let quilted = ["/blend mesh", "/blend sets", "/quilt"];
    assert_eq!(steps_of_textons(&ran, "one"), ["/analyse textons", "/blend mesh", "/blend sets", "/maps", "/quilt"]);
    let other = recipe("", "", "[uv_sets]").replace("'m.obj'", "'n.obj'");
    first.write("recipes/n.obj", TETRAHEDRON);
    first.write("recipes/two.toml", &other);
    let ran = first.kiln(&["bake"]).expect(0).err;
    assert_eq!(steps_of_textons(&ran, "two"), quilted, "{ran}");
    // Also in another project that keeps its artefacts in the same place.
    let second = project();
    second.write("recipes/n.obj", TETRAHEDRON.replace("0 0 1", "0 0 2"));
    second.write("recipes/three.toml", &other);
    let cache = first.path(".kiln/cache");
    let ran = second.kiln(&["bake", "--cache", cache.to_str().expect("UTF-8")]).expect(0).err;
    assert_eq!(steps_of_textons(&ran, "three"), quilted, "{ran}");
}

#[test]
fn a_picture_of_the_textons() {
    let project = project();
    let facts =
        project.kiln(&["inspect", "recipes/e.png", "--quick", "--texton-map", "t.png", "--format", "json"]).expect(0);
    let facts: serde_json::Value = serde_json::from_str(&facts.out).expect("JSON");
    assert_eq!(facts["textons"], 55, "the square root of 64 x 48");
    let map = decode_pixels(&project.read("t.png"), &Limits::default()).expect("a picture");
    assert_eq!((map.width, map.height, map.channels), (64, 48, 3));
    let Samples::U8(texels) = map.samples else { panic!("8 bits") };
    let mut colours: Vec<&[u8]> = texels.chunks_exact(3).collect();
    colours.sort_unstable();
    colours.dedup();
    assert_eq!(colours.len(), 55, "a colour for each texton");
    // The joints look alike from one brick to the next.
    let at = |x: usize, y: usize| &texels[3 * (y * 64 + x)..][..3];
    let alike = (12..36).filter(|x| at(*x, 24) == at(*x + 12, 24)).count();
    assert!(alike * 2 > 24, "{alike} of 24");
}

#[test]
fn what_cannot_be_gets_a_sentence() {
    let project = project();
    project.write("recipes/small.png", png([9, 9], bricks));
    project.write("recipes/constant.png", png([24, 24], |_, _| [90, 120, 30]));
    let fails = |analysis: &str, synthesis: &str, code, what: &str| {
        project.write("recipes/r.toml", recipe(analysis, synthesis, "[uv_sets]"));
        let ran = project.kiln(&["bake"]).expect(code);
        assert!(ran.err.contains(what), "{what}\n{}", ran.err);
    };
    fails("count = 3073", "", 1, "count = 3073 textons of an exemplar of 3072 texels");
    fails("", "candidates = 0", 2, "`synthesis.candidates` can't be 0");
    fails("", "blend_threshold = nan", 2, "`synthesis.blend_threshold` can't be nan");
    fails("", "blend_threshold = 'none'", 2, "`synthesis.blend_threshold` can't be \"none\"");
    fails("rotations = 65", "", 2, "`analysis.rotations` can't be 65");
    project.write(
        "recipes/r.toml",
        recipe("", "", "[uv_sets]")
            .replace("'e.png'", "'small.png'")
            .replace("'h.png'", "'small.png'")
            .replace("window = 5", "window = 11"),
    );
    let large = project.kiln(&["bake"]).expect(1);
    assert!(large.err.contains("the exemplar is 9x9 texels, a texton's window needs at least 11x11"), "{}", large.err);
    // A constant sample makes a constant surface, and is told so.
    project.write(
        "recipes/r.toml",
        recipe("", "", ALL).replace("'e.png'", "'constant.png'").replace("'h.png'", "'constant.png'"),
    );
    project.kiln(&["bake"]).expect(0);
    let report = String::from_utf8(project.read("out/r/report.json")).expect("text");
    assert!(report.contains("looks the same everywhere"), "{report}");
    let facts = project.kiln(&["inspect", "recipes/constant.png", "--quick", "--texton-map", "t.png"]).expect(0);
    assert!(facts.out.contains("looks the same everywhere"), "{}", facts.out);
    let tiny = project.kiln(&["inspect", "recipes/small.png", "--quick", "--texton-map", "t.png"]).expect(1);
    assert!(tiny.err.contains("needs at least 11x11"), "{}", tiny.err);
    let mesh = project.kiln(&["inspect", "recipes/m.obj", "--texton-map", "t.png"]).expect(2);
    assert!(mesh.err.contains("--texton-map is for pictures"), "{}", mesh.err);
    project.write("recipes/noise.png", picture(16, 0));
    project.kiln(&["inspect", "recipes/noise.png", "--quick", "--texton-map", "t.png", "-n"]).expect(0);
}

/// A square of two units' side towards z, of `n` x `n` cells.
fn square(n: u32) -> String {
    let at = |i: u32| 2.0 * f64::from(i) / f64::from(n) - 1.0;
    let points = (0..(n + 1) * (n + 1)).map(|i| format!("v {:.6} {:.6} 0\n", at(i % (n + 1)), at(i / (n + 1))));
    let cells = (0..n * n).map(|i| {
        let a = i / n * (n + 1) + i % n + 1;
        format!("f {a} {} {}\nf {a} {} {}\n", a + 1, a + n + 2, a + n + 2, a + n + 1)
    });
    points.chain(cells).collect()
}

/// Mean difference of two pictures of 8 bits.
fn difference(a: &[u8], b: &[u8]) -> f64 {
    let [a, b] = [a, b].map(|png| match decode_pixels(png, &Limits::default()).expect("a picture").samples {
        Samples::U8(samples) => samples,
        _ => panic!("8 bits"),
    });
    assert_eq!(a.len(), b.len());
    a.iter().zip(&b).map(|(a, b)| f64::from(a.abs_diff(*b))).sum::<f64>() / a.len() as f64
}

#[test]
fn levels_of_detail_take_over_the_quilt() {
    const OUTPUTS: &str =
        "[atlas]\nsize = 128\n[uv_sets]\n[[render]]\nview = 'turntable-1'\nsize = 96\nshading = 'unlit'\n";
    let bake = |jobs| {
        let project = project();
        project.write("recipes/m.obj", square(24));
        project.write("recipes/c.obj", square(12));
        for (name, synthesis) in [("r", ""), ("other", "seed = 2"), ("one", "blend = 'none'\nrefine = 0")] {
            let text = recipe("", synthesis, OUTPUTS).replace("'m.obj'", "'m.obj'\nmesh.lods = ['c.obj']");
            project.write(&format!("recipes/{name}.toml"), text);
        }
        project.kiln(&["bake", "-j", jobs]).expect(0);
        project.contents("out")
    };
    let (one, two) = (bake("1"), bake("2"));
    assert!(one == two, "levels depend on the number of threads");
    let view = |of: &str| &one[&format!("out/{of}.png")];
    let taken = difference(view("r/render/turntable-1"), view("r/render/turntable-1.lod1"));
    let other = difference(view("r/render/turntable-1"), view("other/render/turntable-1"));
    println!("a level differs from the finest by {taken:.2}, another seed by {other:.2}");
    assert!(taken * 3.0 < other, "{taken} {other}");
    for name in ["r", "one"] {
        let report: serde_json::Value =
            serde_json::from_slice(&one[&format!("out/{name}/report.lod1.json")]).expect("a report");
        assert_eq!(
            (report["mesh"]["triangles"].as_u64(), report["exemplar"]["textons"].as_u64()),
            (Some(288), Some(55))
        );
        assert!(one.contains_key(&format!("out/{name}/{name}.lod1.uvsets.glb")));
    }
}

#[test]
fn the_texels_of_an_atlas_are_corrected_after_the_quilt() {
    let bake = |jobs| {
        let project = project();
        for (name, refine) in [("plain", ""), ("corrected", "refine = 2\n")] {
            let atlas = format!("[atlas]\nsize = 256\n{refine}");
            project.write(&format!("recipes/{name}.toml"), recipe("", "", &atlas));
        }
        let ran = project.kiln(&["bake", "-j", jobs]).expect(0).err;
        assert!(ran.contains("corrected/refine atlas") && !ran.contains("plain/refine atlas"), "{ran}");
        project.contents("out")
    };
    let (one, two) = (bake("1"), bake("2"));
    assert!(one == two, "corrected atlases depend on the number of threads");
    let quilt = |name: &str| -> serde_json::Value {
        let report: serde_json::Value =
            serde_json::from_slice(&one[&format!("out/{name}/report.json")]).expect("a report");
        report["synthesis"]["quilt"].clone()
    };
    assert_eq!(quilt("plain"), quilt("corrected"));
    let atlas = |name: &str| &one[&format!("out/{name}/{name}.base_color.png")];
    let changed = difference(atlas("plain"), atlas("corrected"));
    assert!(changed > 0.5 && changed < 20.0, "{changed}");
}
