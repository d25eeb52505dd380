//! Flipbooks through the real program: what comes out moves as the sample does, and bad frames get a sentence.

mod common;

use common::Project;
use kiln::io::Samples;
use kiln::io::image_file::{Limits, decode_pixels};

const RECIPE: &str =
    "[canvas]\nsize = [20, 18]\nframes = 7\n[exemplar]\nframes = 'f/f_%02d.png'\n[analysis]\nneighbourhoods = [5, 3]\n";

/// A grey picture.
fn picture(width: u32, height: u32, grey: impl Fn(u32, u32) -> u8) -> Vec<u8> {
    let mut out = Vec::new();
    let mut encoder = png::Encoder::new(&mut out, width, height);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Eight);
    let data: Vec<u8> = (0..width * height).map(|i| grey(i % width, i / width)).collect();
    encoder.write_header().and_then(|mut w| w.write_image_data(&data)).expect("a picture in memory");
    out
}

/// Waves that travel one texel per frame and repeat after eight, in strips of two brightnesses.
fn wave(side: u32, frame: u32) -> Vec<u8> {
    const WAVE: [u8; 8] = [0, 40, 90, 160, 255, 180, 100, 30];
    picture(side, side, |x, y| WAVE[((x + 8 - frame % 8) % 8) as usize] / (1 + (y / 4 % 2) as u8))
}

/// Ten frames of waves and a recipe.
fn small() -> Project {
    let project = Project::new();
    project.write("recipes/one.toml", RECIPE);
    (1..=10).for_each(|t| project.write(&format!("recipes/f/f_{t:02}.png"), wave(16, t)));
    project
}

fn outputs() -> Vec<String> {
    (1..=7).map(|t| format!("out/one/one.base_color.{t:04}.png")).collect()
}

/// The samples of an image, and how many channels it has.
fn samples(bytes: &[u8]) -> (Vec<u8>, usize) {
    let pixels = decode_pixels(bytes, &Limits::default()).expect("an image");
    match pixels.samples {
        Samples::U8(samples) => (samples, pixels.channels as usize),
        other => panic!("{:?}", other.sample_type()),
    }
}

#[test]
fn frames_are_baked_once_and_the_same_for_any_number_of_threads() {
    let project = small();
    let first = project.kiln(&["bake", "-j", "1"]).expect(0);
    assert!(first.out.contains("one.base_color.0007.png"), "{}", first.out);
    assert_eq!(project.files("out"), outputs());
    let whole: Vec<Vec<u8>> = outputs().iter().map(|file| project.read(file)).collect();
    assert!(project.kiln(&["bake"]).expect(0).out.starts_with("nothing to do"));
    for jobs in ["2", "8"] {
        project.kiln(&["cache", "clear"]).expect(0);
        std::fs::remove_dir_all(project.path("out")).expect("outputs");
        project.kiln(&["bake", "-j", jobs]).expect(0);
        assert!(outputs().iter().zip(&whole).all(|(file, bytes)| project.read(file) == *bytes), "-j {jobs}");
    }
    // Another frame at the end is another exemplar.
    project.write("recipes/f/f_11.png", wave(16, 11));
    let plan = project.kiln(&["plan"]).expect(0).out;
    assert!(plan.contains("one/flipbook") && plan.contains("f_11.png"), "{plan}");
}

#[test]
fn what_travels_in_the_sample_travels_in_the_output() {
    let project = small();
    (1..=10).for_each(|t| project.write(&format!("recipes/f/f_{t:02}.png"), wave(32, t)));
    project.kiln(&["bake"]).expect(0);
    let frames: Vec<Vec<u8>> = outputs().iter().map(|file| samples(&project.read(file)).0).collect();
    // Mean change from frame to frame, seen from where the waves were `by` texels before.
    let change = |by: usize| {
        let pixel = |frame: &[u8], x: usize, y: usize| f64::from(frame[(y * 20 + x) * 3]);
        let pixels = || (0..18).flat_map(|y| (1..20).map(move |x| (x, y)));
        let of = |pair: &[Vec<u8>]| {
            pixels().map(|(x, y)| (pixel(&pair[1], x, y) - pixel(&pair[0], x - by, y)).abs()).sum::<f64>() / 342.0
        };
        frames.windows(2).map(of).sum::<f64>() / 6.0
    };
    assert!(change(1) < 0.2 * change(0), "{} against {}", change(1), change(0));
}

#[test]
fn a_constant_flipbook_stays_constant() {
    let project = small();
    (1..=10).for_each(|t| project.write(&format!("recipes/f/f_{t:02}.png"), picture(16, 16, |_, _| 77)));
    project.kiln(&["bake"]).expect(0);
    assert!(outputs().iter().all(|file| samples(&project.read(file)).0.iter().all(|v| *v == 77)));
}

#[test]
fn bad_frames_get_a_sentence() {
    let said = |change: &dyn Fn(&Project)| {
        let project = small();
        change(&project);
        let ran = project.kiln(&["bake"]).expect(1);
        assert!(project.files("out").is_empty());
        ran.err
    };
    let gone = |project: &Project, frames: std::ops::RangeInclusive<u32>| {
        frames.for_each(|t| std::fs::remove_file(project.path(&format!("recipes/f/f_{t:02}.png"))).expect("a frame"));
    };
    let missing = said(&|p| gone(p, 4..=5));
    assert!(missing.contains("recipes/f/f_%02d.png: f_04.png is missing, while there is f_06.png"), "{missing}");
    assert!(missing.contains("(named as exemplar.frames in recipes/one.toml:5:10)"), "{missing}");
    assert!(said(&|p| gone(p, 1..=10)).contains("there are no frames; the first one would be f_00.png or f_01.png"));
    assert!(said(&|p| gone(p, 2..=10)).contains("there is one frame only, and a flipbook needs 2 at least"));
    assert!(said(&|p| gone(p, 1..=2)).contains("the first frame is f_03.png"));
    let size = said(&|p| p.write("recipes/f/f_07.png", picture(16, 17, |_, _| 0)));
    assert!(size.contains("f_01.png` is 16x16, but `recipes/f/f_07.png` is 16x17"), "{size}");
    assert!(said(&|p| p.write("recipes/f/f_02.png", "no image")).contains("base_color `recipes/f/f_02.png`"));
    let height = said(&|p| {
        p.write("recipes/h_1.png", wave(16, 1));
        p.write("recipes/h_2.png", wave(16, 2));
        p.write("recipes/one.toml", RECIPE.replace("[analysis]", "height = 'h_%d.png'\n[analysis]"));
    });
    assert!(height.contains("h_%d.png: has frames 1 to 2, but the first map has 1 to 10"), "{height}");
    let large = RECIPE.replace("frames = 7\n", "").replace("[20, 18]", "[4096, 4096]");
    let large = said(&|p| p.write("recipes/one.toml", large.clone()));
    assert!(large.contains("10 frames of 4096 x 4096, as many as the exemplar has, are 167772160 texels"), "{large}");
    // A mesh does not move, and a pattern needs its number: faults of the recipe itself.
    let project = small();
    project.write(
        "recipes/one.toml",
        RECIPE.replace("[canvas]\nsize = [20, 18]\nframes = 7", "[atlas]\n[mesh]\npath = 'm.obj'"),
    );
    assert!(project.kiln(&["bake"]).expect(2).err.contains("a mesh is covered with a still"));
    project.write("recipes/one.toml", RECIPE.replace("_%02d", ""));
    assert!(project.kiln(&["bake"]).expect(2).err.contains("`exemplar.frames` has no frame number"));
}

#[test]
fn smoke_flickers_no_more_than_the_sample() {
    let project = Project::with_recipes();
    project.kiln(&["bake", "flipbook-smoke"]).expect(0);
    // Grey times opacity, as it is seen on black.
    let seen = |bytes: &[u8]| -> Vec<f64> {
        let (samples, channels) = samples(bytes);
        samples.chunks(channels).map(|p| f64::from(p[0]) * f64::from(p[channels - 1]) / 255.0).collect()
    };
    let change = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum::<f64>() / a.len() as f64;
    let read = |file: String| seen(&project.read(&file));
    let sample: Vec<Vec<f64>> = (1..=20).map(|t| read(format!("recipes/assets/smoke/smoke_{t:04}.png"))).collect();
    let out: Vec<Vec<f64>> =
        (1..=16).map(|t| read(format!("out/flipbook-smoke/flipbook-smoke.base_color.{t:04}.png"))).collect();
    let own = sample.windows(2).map(|pair| change(&pair[0], &pair[1])).sum::<f64>() / 19.0;
    // The last one is the step from the end of the loop to its beginning.
    let changes: Vec<f64> = (0..16).map(|t| change(&out[t], &out[(t + 1) % 16])).collect();
    let mean = changes.iter().sum::<f64>() / 16.0;
    println!("change from frame to frame: sample {own:.2}, output {mean:.2}, {changes:.1?}");
    assert!((0.8..1.15).contains(&(mean / own)), "{mean} against {own}");
    assert!(changes.iter().all(|c| *c < 1.4 * own), "{changes:?} against {own}");
}
