//! Tiles of material space by the real program: their files, samples that are made to wrap, features that are found.

mod common;

use common::{Project, TETRAHEDRON};
use kiln::io::image_file::{Limits, decode_pixels};
use kiln::io::{Pixels, Samples};

/// A PNG of 8 bits, grey or RGB.
fn png(side: u32, channels: u32, value: impl Fn(u32, u32, u32) -> u8) -> Vec<u8> {
    let mut out = Vec::new();
    let mut encoder = png::Encoder::new(&mut out, side, side);
    encoder.set_color(if channels == 1 { png::ColorType::Grayscale } else { png::ColorType::Rgb });
    encoder.set_depth(png::BitDepth::Eight);
    let data: Vec<u8> =
        (0..side * side * channels).map(|i| value(i / channels % side, i / channels / side, i % channels)).collect();
    encoder.write_header().and_then(|mut w| w.write_image_data(&data)).expect("a picture in memory");
    out
}

fn grain(x: u32, y: u32) -> u8 {
    ((x * 73 + y * 179 + x * y * 31) % 23) as u8
}

fn spot(x: u32, y: u32) -> bool {
    let [dx, dy] = [x, y].map(|v| (v % 16) as i32 - 8);
    dx * dx + dy * dy < 25
}

fn project() -> Project {
    let project = Project::new();
    project.write("recipes/m.obj", TETRAHEDRON);
    project.write("recipes/a.png", png(32, 3, |x, y, c| grain(x, y) + if spot(x, y) { 40 * c as u8 } else { 120 }));
    project.write("recipes/b.png", png(32, 3, |x, y, _| grain(x, y) + if x % 16 < 6 { 30 } else { 210 }));
    project.write("recipes/ah.png", png(32, 1, |x, y, _| if spot(x, y) { 200 } else { 90 }));
    project.write("recipes/bh.png", png(32, 1, |x, _, _| if x % 16 < 6 { 10 } else { 60 }));
    project.write("recipes/bm.png", png(32, 1, |x, _, _| if x % 16 < 6 { 255 } else { 0 }));
    project.write("recipes/small.png", png(16, 3, |x, y, _| grain(x, y) * 9));
    project.write("recipes/on.png", png(32, 1, |_, _, _| 255));
    project
}

const RECIPE: &str = "mesh.path = 'm.obj'\nexemplar = { base_color = 'a.png', height = 'ah.png' }\n\
    [analysis]\nmethod = 'material-space'\nlayers = 4\n\
    [[analysis.key]]\nbase_color = 'b.png'\nheight = 'bh.png'\nfeature_mask = 'bm.png'\n";

#[test]
fn a_recipe_of_keys_writes_textures_and_strips() {
    let project = project();
    project.write("recipes/t.toml", RECIPE);
    project.kiln(&["bake"]).expect(0);
    let names = [
        "report.json",
        "t.tile.base_color.png",
        "t.tile.feature_mask.png",
        "t.tile.height.ktx2",
        "t.tile.height.png",
        "t.tile.ktx2",
    ];
    assert_eq!(project.files("out"), names.map(|n| format!("out/t/{n}")));
    let Pixels { width, height, samples: Samples::U8(samples), .. } =
        decode_pixels(&project.read("out/t/t.tile.feature_mask.png"), &Limits::default()).expect("a picture")
    else {
        panic!("8 bits")
    };
    assert_eq!((width, height), (4 * 32, 32));
    // The last layer is the second key, whose mask was given.
    assert!((0..32).all(|x| (samples[x + 96] == 255) == (x % 16 < 6)));
    let volume = project.read("out/t/t.tile.ktx2");
    let word = |file: &[u8], at: usize| u32::from_le_bytes([0, 1, 2, 3].map(|i| file[at + i]));
    // Format sRGB, sides, depth, no array, one level.
    assert_eq!([12, 20, 24, 28, 32, 40].map(|at| word(&volume, at)), [43, 32, 32, 4, 0, 1]);
    let told = project.kiln(&["inspect", "out/t/t.tile.ktx2", "--format", "json"]).expect(0).out;
    for part in ["\"KTX2 texture\"", "\"3d\"", "\"layers\":4", "\"size\":[32,32]", "sRGB"] {
        assert!(told.contains(part), "{part} in {told}");
    }
    let files = project.files("out");
    let bytes: Vec<Vec<u8>> = files.iter().map(|f| project.read(f)).collect();
    for jobs in ["1", "3"] {
        project.kiln(&["cache", "clear"]).expect(0);
        std::fs::remove_dir_all(project.path("out")).expect("outputs");
        project.kiln(&["bake", "-j", jobs]).expect(0);
        assert!(files.iter().zip(&bytes).all(|(f, b)| project.read(f) == *b), "-j {jobs}");
    }
    project.write("recipes/t.toml", RECIPE.replace("layers = 4", "layers = 4\ntile = '2d-array'"));
    project.kiln(&["bake"]).expect(0);
    let array = project.read("out/t/t.tile.height.ktx2");
    assert_eq!([12, 20, 24, 28, 32, 40].map(|at| word(&array, at)), [37, 32, 32, 0, 4, 6]);
}

#[test]
fn keys_that_do_not_go_together_fail_with_a_sentence() {
    let project = project();
    for (old, new, said) in [
        ("'b.png'\nheight = 'bh.png'\nfeature_mask = 'bm.png'", "'small.png'\nheight = 'small.png'", "key 2 is 16x16"),
        ("'bm.png'", "'on.png'", "on.png"),
    ] {
        project.write("recipes/t.toml", RECIPE.replace(old, new));
        let ran = project.kiln(&["bake"]).expect(1);
        assert!(ran.err.contains(said), "{new}: {}", ran.err);
    }
}

#[test]
fn a_sample_is_made_to_wrap_and_its_maps_follow() {
    let project = project();
    let synth = |args: &str| project.kiln(&["synth"].into_iter().chain(args.split(' ')).collect::<Vec<_>>());
    synth("recipes/small.png --seamless -o w.png --debug sources=s.png").expect(0);
    synth("recipes/small.png --sources s.png -o again.png --blend none").expect(0);
    let pixels = |file: &str| decode_pixels(&project.read(file), &Limits::default()).expect("a picture");
    assert_eq!((pixels("w.png").width, pixels("w.png").height), (16, 16));
    assert_eq!(pixels("again.png"), pixels("w.png"));
    // What wraps already stays as it is.
    synth("recipes/bh.png --map height --seamless -o same.png").expect(0);
    assert_eq!(pixels("same.png").samples, pixels("recipes/bh.png").samples);
    let two = synth("recipes/a.png recipes/b.png --seamless -o no.png").expect(2);
    assert!(two.err.contains("one sample is made to wrap"), "{}", two.err);
    assert!(synth("recipes/a.png --seamless --size 9x9 -o no.png").expect(2).err.contains("--size"));
}

#[test]
fn features_are_shown() {
    let project = project();
    let facts = project.kiln(&["inspect", "recipes/b.png", "--quick", "--feature-mask", "f.png"]).expect(0);
    assert!(facts.out.contains("inside features"), "{}", facts.out);
    let Samples::U8(mask) = decode_pixels(&project.read("f.png"), &Limits::default()).expect("a picture").samples
    else {
        panic!("8 bits")
    };
    let right = (0..1024).filter(|i| (mask[*i] == 255) == (i % 16 < 6)).count();
    assert!(right > 950, "{right} of 1024");
    let flat = project.kiln(&["inspect", "recipes/on.png", "--quick", "--feature-mask", "f.png"]).expect(1);
    assert!(flat.err.contains("looks the same everywhere"), "{}", flat.err);
    let mesh = project.kiln(&["inspect", "recipes/m.obj", "--feature-mask", "f.png"]).expect(2);
    assert!(mesh.err.contains("--feature-mask is for pictures"), "{}", mesh.err);
}
