//! Flat synthesis by the real program: the same picture whole, in windows, in strips, for any number of threads.

mod common;

use common::Project;
use kiln::io::image_file::{Limits, decode_pixels};
use kiln::io::source_file::decode_sources;
use kiln::io::{Pixels, Samples};

const EXEMPLAR: [u32; 2] = [28, 22];

/// A PNG of the exemplar's size; `value(x, y, channel)`.
fn png(color: png::ColorType, value: impl Fn(u32, u32, u32) -> u8) -> Vec<u8> {
    let mut out = Vec::new();
    let [w, h] = EXEMPLAR;
    let mut encoder = png::Encoder::new(&mut out, w, h);
    encoder.set_color(color);
    encoder.set_depth(png::BitDepth::Eight);
    let channels = color.samples() as u32;
    let data: Vec<u8> =
        (0..w * h * channels).map(|i| value(i / channels % w, i / channels / w, i % channels)).collect();
    encoder.write_header().and_then(|mut w| w.write_image_data(&data)).expect("a picture in memory");
    out
}

/// Spots, no two texels alike.
fn color(x: u32, y: u32, channel: u32) -> u8 {
    ((x / 5 + y / 4) % 3 * 70 + (x * 3 + y * 5) % 40 + channel * 9) as u8
}

fn pixels(bytes: &[u8]) -> Pixels {
    decode_pixels(bytes, &Limits::default()).expect("a picture")
}

/// A window of a picture of 8 bits.
fn window(whole: &Pixels, [x, y, w, h]: [u32; 4]) -> Pixels {
    let Samples::U8(samples) = &whole.samples else { panic!("8 bits") };
    let c = whole.channels as usize;
    let row = |y: u32| {
        let from = (y * whole.width + x) as usize * c;
        &samples[from..from + w as usize * c]
    };
    let samples = Samples::U8((y..y + h).flat_map(|y| row(y).iter().copied()).collect());
    Pixels { width: w, height: h, channels: whole.channels, samples }
}

#[test]
fn windows_of_a_large_canvas_are_windows_of_the_whole() {
    let project = Project::new();
    project.write("e.png", png(png::ColorType::Rgba, color));
    for tileable in [false, true] {
        let synth = |out: &str, more: &[&str]| {
            let mut args = vec!["synth", "e.png", "-o", out, "--size", "1030x810", "--neighbourhoods", "5,3"];
            args.extend(["--refine", "1", "--blend-kernel", "5"]);
            args.extend(tileable.then_some("--tileable"));
            args.extend(more);
            project.kiln(&args).expect(0);
            project.read(out)
        };
        let bytes = synth("whole.png", &["-j", "2"]);
        assert!(synth("again.png", &["-j", "5"]) == bytes, "threads change the file");
        let whole = pixels(&bytes);
        assert_eq!((whole.width, whole.height, whole.channels), (1030, 810, 4));
        for r in [[0, 0, 7, 5], [1027, 803, 3, 7], [0, 400, 1030, 11], [500, 380, 40, 50], [0, 0, 1030, 810]] {
            let region = r.map(|v| v.to_string()).join(",");
            let part = pixels(&synth("part.png", &["--region", &region, "-j", "1"]));
            assert!(part == window(&whole, r), "tileable {tileable}: {region}");
        }
    }
}

#[test]
fn a_canvas_made_in_bands_is_the_same_canvas() {
    let project = Project::new();
    project.write("e.png", png(png::ColorType::Grayscale, color));
    let synth = |more: &[&str]| {
        let args = ["synth", "e.png", "-o", "o.png", "--size", "16384x1100", "--neighbourhoods", "3", "--refine", "0"];
        project.kiln(&[&args[..], &["--tileable", "--order", "serpentine"], more].concat()).expect(0);
        pixels(&project.read("o.png"))
    };
    let whole = synth(&["-j", "2"]);
    for r in [[16300, 1010, 84, 90], [0, 0, 30, 30], [8000, 200, 64, 100]] {
        let part = synth(&["--region", &r.map(|v| v.to_string()).join(","), "-j", "1"]);
        assert!(part == window(&whole, r), "{r:?}");
    }
}

const RECIPE: &str = r#"
[canvas]
size = [840, 330]
tileable = true
order = "scanline"
blend_kernel = 5
format = { roughness = "png16" }
debug = ["patches", "sources", "jumps"]

[exemplar]
base_color = "c.png"
normal = "n.png"
roughness = "r.png"

[analysis]
neighbourhoods = [5, 3]

[synthesis]
refine = 1
"#;

fn with_recipe(recipe: &str) -> Project {
    let project = Project::new();
    project.write("recipes/flat.toml", recipe);
    project.write("recipes/c.png", png(png::ColorType::Rgb, color));
    let normal = |x: u32, y: u32, c: u32| if c == 2 { 250 } else { (100 + (x * 5 + y * 3 + c) % 56) as u8 };
    project.write("recipes/n.png", png(png::ColorType::Rgb, normal));
    project.write("recipes/r.png", png(png::ColorType::Grayscale, |x, y, _| (x * 9) as u8 ^ (y * 4) as u8));
    project
}

#[test]
fn a_canvas_recipe_writes_all_maps_and_what_shows_how_they_came_about() {
    let project = with_recipe(RECIPE);
    project.kiln(&["bake", "-j", "1"]).expect(0);
    let files = project.files("out");
    let expected = [
        "flat.base_color.png",
        "flat.jumps.png",
        "flat.normal.png",
        "flat.patches.png",
        "flat.roughness.png",
        "flat.sources.png",
        "report.json",
    ];
    assert_eq!(files, expected.map(|f| format!("out/flat/{f}")));
    let other = with_recipe(RECIPE);
    other.kiln(&["bake", "-j", "4"]).expect(0);
    for file in &files {
        assert!(project.read(file) == other.read(file), "{file} depends on the number of threads");
    }
    let report: serde_json::Value = serde_json::from_slice(&project.read("out/flat/report.json")).expect("JSON");
    assert_eq!(report["canvas"], serde_json::json!({ "width": 840, "height": 330, "tileable": true }));
    assert_eq!(report["exemplar"]["width"], 28);
    let walk = &report["synthesis"]["walk"];
    assert!(walk["seeds"].as_u64() >= Some(1) && walk["jumps"].as_u64() > Some(100), "{walk}");
    assert!(project.kiln(&["bake"]).expect(0).out.starts_with("nothing to do"));
}

#[test]
fn sources_tell_where_every_pixel_was_copied_from() {
    let plain = RECIPE.replace("refine = 1", "refine = 1\nblend = \"none\"");
    let project = with_recipe(&plain);
    project.kiln(&["bake"]).expect(0);
    let sources = decode_sources(&project.read("out/flat/flat.sources.png"), EXEMPLAR).expect("sources");
    assert_eq!(([sources.width, sources.height], sources.tileable), ([840, 330], true));
    let by_hand: Vec<u8> =
        sources.sources.iter().flat_map(|s| (0..3).map(|c| color(s[0].into(), s[1].into(), c))).collect();
    assert!(pixels(&project.read("out/flat/flat.base_color.png")).samples == Samples::U8(by_hand));
    // Blending changes pixels at seams only.
    let blended = with_recipe(RECIPE);
    blended.kiln(&["bake"]).expect(0);
    let (a, b) = (project.read("out/flat/flat.base_color.png"), blended.read("out/flat/flat.base_color.png"));
    let (Samples::U8(a), Samples::U8(b)) = (pixels(&a).samples, pixels(&b).samples) else { panic!("8 bits") };
    let changed = a.chunks(3).zip(b.chunks(3)).filter(|(a, b)| a != b).count();
    assert!(changed > 0 && changed < a.len() / 6, "{changed}");
    assert!(project.read("out/flat/flat.sources.png") == blended.read("out/flat/flat.sources.png"));
}

#[test]
fn a_program_killed_while_it_writes_leaves_no_picture() {
    let project = Project::new();
    project.write("e.png", png(png::ColorType::Rgb, color));
    let args = ["synth", "e.png", "-o", "o.png", "--size", "4096x3072", "--neighbourhoods", "3", "--refine", "0"];
    let mut kiln = std::process::Command::new(env!("CARGO_BIN_EXE_kiln"));
    let mut kiln = kiln.arg("-C").arg(project.path("")).args(args).spawn().expect("kiln runs");
    let is_writing = || project.files("").iter().any(|f| f.contains(".kiln-tmp-"));
    while !is_writing() && kiln.try_wait().expect("a state").is_none() {
        std::thread::sleep(std::time::Duration::from_millis(2));
    }
    assert!(kiln.try_wait().expect("a state").is_none(), "killed too late to tell");
    kiln.kill().expect("a running program");
    kiln.wait().expect("a state");
    assert!(!project.path("o.png").exists());
}

#[test]
fn what_is_asked_for_in_vain_gets_a_sentence() {
    let project = Project::new();
    project.write("e.png", png(png::ColorType::Rgb, color));
    for (flags, said) in [
        ("--size 40x30 --region 30,20,11,5", "--region 30,20,11,5 does not lie in an output of 40 x 30"),
        ("--size 40x16385", "expected 1 to 16384"),
        ("--size 40x30 --debug patches=e.png", "e.png would be overwritten"),
        ("--size 40x30 --debug patches=o.png", "o.png would be written twice"),
        ("--size 40x30 --debug jumps=a.png --debug patches=a.png", "a.png would be written twice"),
    ] {
        let args: Vec<&str> = ["synth", "e.png", "-o", "o.png"].into_iter().chain(flags.split(' ')).collect();
        let ran = project.kiln(&args).expect(2);
        assert!(ran.err.contains(said), "{flags}: {}", ran.err);
    }
    assert_eq!(project.files(""), ["e.png"]);
    let wrong = RECIPE.replace("blend_kernel = 5", "blend_kernel = 4").replace("\"jumps\"", "\"patches\"");
    let project = with_recipe(&wrong.replace("840", "20000"));
    let ran = project.kiln(&["bake"]).expect(2);
    for said in ["blend_kernel", "`canvas.debug` has \"patches\" twice", "16384"] {
        assert!(ran.err.contains(said), "{said} is missing:\n{}", ran.err);
    }
}

#[test]
fn verbose_tells_what_the_walk_did() {
    let project = Project::new();
    project.write("e.png", png(png::ColorType::Rgb, color));
    let args = ["synth", "e.png", "-o", "o.exr", "--size", "60x50", "--neighbourhoods", "3", "-v"];
    let ran = project.kiln(&[&args[..], &["--debug", "sources=s.png"]].concat()).expect(0);
    assert!(ran.err.contains("synthesis: 1 seeds, "), "{}", ran.err);
    assert_eq!(ran.out, "o.exr\ns.png\n");
    assert_eq!(project.files(""), ["e.png", "o.exr", "s.png"]);
}
