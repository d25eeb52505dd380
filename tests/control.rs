//! Steered canvases by the real program, in recipes and by flags: several samples, masks, guides, holes, stored sources.

mod common;

use common::{Project, Ran};
use kiln::io::image_file::{Limits, decode_pixels, encode_exr};
use kiln::io::{Pixels, Samples};

/// A PNG of 8 bits; `value(x, y, channel)`.
fn png(color: png::ColorType, [w, h]: [u32; 2], value: impl Fn(u32, u32, u32) -> u8) -> Vec<u8> {
    let mut out = Vec::new();
    let mut encoder = png::Encoder::new(&mut out, w, h);
    encoder.set_color(color);
    encoder.set_depth(png::BitDepth::Eight);
    let c = color.samples() as u32;
    let data: Vec<u8> = (0..w * h * c).map(|i| value(i / c % w, i / c / w, i % c)).collect();
    encoder.write_header().and_then(|mut w| w.write_image_data(&data)).expect("a picture in memory");
    out
}

fn grey(size: [u32; 2], value: impl Fn(u32, u32) -> u8) -> Vec<u8> {
    png(png::ColorType::Grayscale, size, |x, y, _| value(x, y))
}

/// Spots around a level; `level` tells samples apart.
fn spots(size: [u32; 2], level: u8) -> Vec<u8> {
    png(png::ColorType::Rgb, size, |x, y, c| level + ((x / 4 + y / 3) % 3 * 12 + (x * 3 + y * 5) % 14 + c * 3) as u8)
}

/// The first channel of a picture of 8 bits.
fn reds(bytes: &[u8]) -> (u32, u32, Vec<u8>) {
    let Pixels { width, height, channels, samples } = decode_pixels(bytes, &Limits::default()).expect("a picture");
    let Samples::U8(samples) = samples else { panic!("8 bits") };
    (width, height, samples.into_iter().step_by(channels as usize).collect())
}

/// A folder with two samples, one dark and one bright.
fn project() -> Project {
    let project = Project::new();
    project.write("dark.png", spots([30, 26], 10));
    project.write("bright.png", spots([24, 40], 180));
    project
}

fn synth(project: &Project, args: &str) -> Ran {
    project.kiln(&["synth"].into_iter().chain(args.split(' ')).collect::<Vec<_>>())
}

const FEW: &str = "--neighbourhoods 5,3 --refine 1";

#[test]
fn several_samples_are_mixed_and_masked_parts_are_left_out() {
    let project = project();
    project.write("right.png", grey([24, 40], |x, _| if x < 12 { 0 } else { 255 }));
    let is_bright = |v: &u8| *v >= 160;
    let run = |more: &str| {
        synth(&project, &format!("dark.png bright.png -o o.png --size 90x70 --debug sources=s.png {FEW} {more}"))
            .expect(0);
        (reds(&project.read("o.png")).2, project.read("s.png"))
    };
    let (mixed, _) = run("-j 1");
    let bright = mixed.iter().filter(|v| is_bright(v)).count();
    assert!((600..5700).contains(&bright), "{bright} of 6300 pixels are of the second sample");
    assert!(run("-j 4").0 == mixed);
    let (_, sources) = run("--mask 2=right.png");
    let Samples::U16(sources) = decode_pixels(&sources, &Limits::default()).expect("sources").samples else {
        panic!("16 bits")
    };
    // The second sample begins below the first and a row between.
    let places: Vec<[u16; 2]> = sources.chunks_exact(3).map(|s| [s[0], s[1]]).collect();
    assert!(places.iter().any(|[_, y]| *y >= 27));
    assert!(places.iter().all(|[x, y]| if *y >= 27 { (12..24).contains(x) } else { *y < 26 }));
}

#[test]
fn guides_say_what_goes_where_in_recipes_and_by_flags_alike() {
    let project = project();
    let target = |x: u32, y: u32| if (x / 40 + y / 40).is_multiple_of(2) { 0 } else { 255 };
    project.write("target.png", grey([120, 80], target));
    project.write("dark-label.png", grey([30, 26], |_, _| 0));
    project.write("bright-label.png", grey([24, 40], |_, _| 255));
    project.write("dark-mask.png", grey([30, 26], |x, _| if x < 20 { 255 } else { 0 }));
    let wrong = |bytes: &[u8]| {
        let (w, h, pixels) = reds(bytes);
        assert_eq!([w, h], [120, 80]);
        let unlike = |(i, v): &(usize, &u8)| (**v >= 160) != (target(*i as u32 % 120, *i as u32 / 120) == 255);
        pixels.iter().enumerate().filter(unlike).count()
    };
    let flags = "--guide target.png --exemplar-guide dark-label.png --exemplar-guide 2=bright-label.png";
    let all = format!("dark.png bright.png {flags} --mask dark-mask.png --tileable {FEW}");
    synth(&project, &format!("{all} -o o.png")).expect(0);
    let by_flags = project.read("o.png");
    assert!(wrong(&by_flags) < 200, "{} of 9600 pixels are of the wrong sample", wrong(&by_flags));
    project.write(
        "recipes/guided.toml",
        "[canvas]\nguide = '../target.png'\ntileable = true\n[exemplar]\nbase_color = '../dark.png'\n\
         guide = '../dark-label.png'\nmask = '../dark-mask.png'\n[[exemplar.more]]\nbase_color = '../bright.png'\n\
         guide = '../bright-label.png'\n[analysis]\nneighbourhoods = [5, 3]\n[synthesis]\nrefine = 1\n",
    );
    project.kiln(&["bake"]).expect(0);
    assert!(reds(&project.read("out/guided/guided.base_color.png")) == reds(&by_flags));
    // Without labels light and dark are followed.
    synth(&project, &format!("dark.png bright.png --guide target.png -o o.png {FEW}")).expect(0);
    assert!(wrong(&project.read("o.png")) < 900, "{} of 9600 pixels", wrong(&project.read("o.png")));
}

#[test]
fn a_hole_is_filled_and_the_rest_stays_to_the_bit() {
    let project = Project::new();
    let size = [44, 36];
    let hole = |x: u32, y: u32| (10..24).contains(&x) && (8..22).contains(&y);
    // Rubbish in the hole; alpha; normals of every length.
    let color = |x: u32, y: u32, c: u32| match c {
        3 => 200 + (x % 50) as u8,
        _ if hole(x, y) => 255,
        _ => ((x / 4 + y / 3) % 3 * 40 + (x * 7 + y * 5) % 20 + c) as u8,
    };
    project.write("wall.png", png(png::ColorType::Rgba, size, color));
    project.write("normal.png", png(png::ColorType::Rgb, size, |x, y, c| ((x * 31 + y * 17 + c * 71) % 251) as u8));
    project.write("roughness.png", grey(size, |x, y| ((x * 9) ^ (y * 4)) as u8));
    project.write("hole.png", grey(size, |x, y| if hole(x, y) { 255 } else { 0 }));
    project.write(
        "recipes/mended.toml",
        "[canvas]\ninpaint = '../hole.png'\n[exemplar]\nbase_color = '../wall.png'\nnormal = '../normal.png'\n\
         roughness = '../roughness.png'\n[analysis]\nneighbourhoods = [5, 3]\n",
    );
    project.kiln(&["bake", "-j", "3"]).expect(0);
    let samples = |bytes: &[u8]| {
        let Pixels { width, height, channels, samples } = decode_pixels(bytes, &Limits::default()).expect("a picture");
        assert_eq!([width, height], size);
        let Samples::U8(v) = samples else { panic!("8 bits") };
        (channels as usize, v)
    };
    for (map, file) in [("base_color", "wall.png"), ("normal", "normal.png"), ("roughness", "roughness.png")] {
        let (c, before) = samples(&project.read(file));
        let (channels, after) = samples(&project.read(&format!("out/mended/mended.{map}.png")));
        assert_eq!(c, channels);
        let kept = |i: &usize| !hole((*i / c) as u32 % size[0], (*i / c) as u32 / size[0]);
        assert!((0..before.len()).filter(kept).all(|i| before[i] == after[i]), "{map} changed outside the hole");
        assert!(before != after, "{map} is as it was");
    }
    let mended = project.read("out/mended/mended.base_color.png");
    assert!(reds(&mended).2.iter().all(|v| *v < 150), "the rubbish is still there");
    synth(&project, "wall.png -o o.png --inpaint hole.png --neighbourhoods 5,3 -j 1").expect(0);
    assert!(project.read("o.png") == mended);
    synth(&project, "wall.png -o o.png --inpaint hole.png --neighbourhoods 5,3 --size 44x36").expect(0);
    assert!(project.read("o.png") == mended);
}

#[test]
fn what_goes_on_across_a_hole_closes() {
    // Bricks: lines that cross the hole, one inside the picture and one at its corner, and beds along its edges.
    let project = Project::new();
    let (size, period) = ([96, 72], [24, 16]);
    let wall = |x: u32, y: u32| {
        let shifted = x + y / (period[1] / 2) % 2 * period[0] / 2;
        let is_mortar = shifted % period[0] < 2 || y % (period[1] / 2) < 2;
        if is_mortar { 220 } else { 60 + (shifted % period[0] + y % 8) as u8 }
    };
    let hole = |x: u32, y: u32| ((30..50).contains(&x) && (25..40).contains(&y)) || (x >= 80 && y >= 58);
    project.write("wall.png", grey(size, |x, y| if hole(x, y) { 130 } else { wall(x, y) }));
    project.write("hole.png", grey(size, |x, y| if hole(x, y) { 255 } else { 0 }));
    synth(&project, "wall.png -o o.png --inpaint hole.png").expect(0);
    let (_, _, mended) = reds(&project.read("o.png"));
    let wrong = |(i, v): &(usize, &u8)| v.abs_diff(wall(*i as u32 % size[0], *i as u32 / size[0])) > 24;
    let wrong = mended.iter().enumerate().filter(wrong).count();
    assert!(wrong < 40, "{wrong} of 524 pixels of the holes are not as the wall goes on");
}

#[test]
fn a_synthesis_is_applied_again() {
    let project = project();
    project.write("rough.png", grey([30, 26], |x, y| ((x * 9) ^ (y * 4)) as u8));
    synth(&project, &format!("dark.png -o first.png --size 70x50 --tileable --debug sources=s.png {FEW}")).expect(0);
    synth(&project, "dark.png -o again.png --sources s.png").expect(0);
    assert!(project.read("again.png") == project.read("first.png"));
    synth(&project, "rough.png --map roughness -o rough-out.png --sources s.png --blend none").expect(0);
    project.write(
        "recipes/again.toml",
        "canvas.sources = '../s.png'\nsynthesis.blend = 'none'\nexemplar.roughness = '../rough.png'\n",
    );
    let ran = project.kiln(&["bake"]).expect(0);
    assert!(
        reds(&project.read("out/again/again.roughness.png")) == reds(&project.read("rough-out.png")),
        "{}",
        ran.out
    );
    assert!(!project.kiln(&["plan"]).expect(0).out.contains("analyse"));
    let sources = decode_pixels(&project.read("s.png"), &Limits::default()).expect("sources");
    let Samples::U16(v) = &sources.samples else { panic!("16 bits") };
    let (_, _, rough) = reds(&project.read("rough.png"));
    let copied: Vec<u8> = v.chunks_exact(3).map(|s| rough[usize::from(s[1]) * 30 + usize::from(s[0])]).collect();
    assert_eq!(reds(&project.read("rough-out.png")).2, copied);
}

#[test]
fn what_is_wrong_gets_a_sentence() {
    let project = project();
    project.write("black.png", grey([30, 26], |_, _| 0));
    project.write("white.png", grey([30, 26], |_, _| 255));
    project.write("sliver.png", grey([30, 26], |x, _| if x == 3 { 255 } else { 0 }));
    project.write("other.png", grey([29, 26], |_, _| 255));
    project.write("alpha.png", png(png::ColorType::Rgba, [20, 20], |x, y, c| (x * 3 + y * 5 + c) as u8));
    project.write("text.png", "no picture");
    let values = (0..81).map(|i| if i == 40 { f32::NAN } else { 0.5 }).collect();
    let nan = Pixels { width: 9, height: 9, channels: 1, samples: Samples::F32(values) };
    project.write("nan.exr", encode_exr(&nan).expect("a picture in memory"));
    synth(&project, "bright.png -o x.png --size 20x20 --neighbourhoods 5 --refine 0 --debug sources=s.png").expect(0);
    project.write("dark-large.png", spots([31, 26], 10));
    synth(&project, "dark.png -o x.png --size 9x9 --refine 0 --debug sources=dark.sources.png").expect(0);
    for (args, code, said) in [
        ("dark.png --size 9x9 --mask black.png", 1, "black.png excludes everything: white is what may be copied"),
        ("dark.png --size 9x9 --mask other.png", 1, "other.png is 29x26, but its sample is 30x26"),
        ("dark.png --size 9x9 --mask text.png", 1, "text.png: not a PNG, JPEG or EXR image"),
        ("dark.png --size 9x9 --mask gone.png", 1, "gone.png"),
        ("dark.png --size 9x9 --mask sliver.png", 1, "the masks leave no neighbourhood of 9x9 texels whole"),
        ("dark.png --size 9x9 --mask 2=white.png", 2, "there is no exemplar 2, only 1"),
        ("dark.png --size 9x9 --guide white.png", 1, "white.png is 30x26, but the canvas is 9x9"),
        ("dark.png --guide nan.exr", 1, "nan.exr: it holds NaN at texel (4, 4); values must be finite"),
        ("dark.png --guide white.png --exemplar-guide other.png", 1, "other.png is 29x26, but its sample is 30x26"),
        ("dark.png bright.png --guide white.png --exemplar-guide white.png", 2, "bright.png has no --exemplar-guide"),
        ("dark.png --inpaint black.png", 1, "black.png marks nothing: white is what is filled in"),
        ("dark.png --inpaint white.png", 1, "white.png leaves nothing of its sample to copy from"),
        ("dark.png --inpaint other.png", 1, "other.png is 29x26, but its sample is 30x26"),
        ("dark.png --inpaint sliver.png --size 9x9", 1, "the canvas is 9x9, but the sample to fill in is 30x26"),
        ("dark.png --sources s.png", 1, "s.png: these are not sources of an exemplar of 30 x 26"),
        ("dark-large.png --sources dark.sources.png", 1, "these are not sources of an exemplar of 31 x 26"),
        ("dark.png --sources white.png", 1, "expected source coordinates as kiln writes them"),
        ("dark.png --size 9x9 --mask white.png -o white.png", 2, "white.png would be overwritten"),
        ("dark.png bright.png --map normal --guide white.png", 1, "neither base_color nor height"),
    ] {
        let out = if args.contains(" -o ") { args.to_string() } else { format!("{args} -o o.png") };
        let ran = synth(&project, &out).expect(code);
        assert!(ran.err.contains(said) && ran.err.lines().count() == 1, "{args}: {}", ran.err);
    }
    // Transparency in one of two samples: the other is opaque.
    synth(&project, &format!("dark.png alpha.png -o o.png --size 40x40 {FEW}")).expect(0);
    let recipe = |code: i32, text: &str| {
        project.write("recipes/r.toml", text);
        project.kiln(&["bake"]).expect(code).err
    };
    let said = recipe(1, "canvas.size = [8, 8]\nexemplar.base_color = '../dark.png'\nexemplar.mask = '../gone.png'\n");
    assert!(said.contains("gone.png: there is no such file (named as exemplar.mask in"), "{said}");
    let said = recipe(1, "canvas.size = [8, 8]\nexemplar.base_color = '../dark.png'\nexemplar.mask = '../black.png'\n");
    assert!(said.contains("black.png excludes everything"), "{said}");
    let said = recipe(
        2,
        "canvas.size = [8, 8]\nexemplar.base_color = '../dark.png'\n[[exemplar.more]]\nroughness = '../bright.png'\n",
    );
    assert!(said.contains("`exemplar.more[0]` has other maps than [exemplar]"), "{said}");
    let said = recipe(2, "canvas = { size = [8, 8], inpaint = '../black.png' }\nexemplar.frames = '../dark%d.png'\n");
    assert!(said.contains("exclude each other") && said.contains("holes are filled in stills only"), "{said}");
}
