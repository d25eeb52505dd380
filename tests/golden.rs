//! Every recipe of the project, baked by the real program and compared with `golden/`: so no example can rot. And the
//! checks themselves, on a small project: each must be able to fail.
//!
//! The goldens were accepted from a release build; this is a debug build. Together with the thread counts below they
//! are the test of promise 1; other CPUs follow in `tests/slow/same_bytes.sh`.

mod common;

use std::io::{BufRead, BufReader, Write};
use std::process::{Command, Stdio};

use common::{Project, Ran, TETRAHEDRON};
use kiln::build::{Cache, Digest, Record};
use kiln::disk::Real;
use kiln::golden::digest::{digest_glb, digest_pixels};
use kiln::io::image_file::{Compression, Limits, Transfer, decode_pixels, encode_png};
use kiln::io::{Pixels, Samples};
use serde_json::Value;

#[test]
fn recipes_bake_to_their_goldens_for_any_number_of_threads() {
    let project = Project::with_recipes();
    for jobs in ["1", "8"] {
        let ran = project.kiln(&["check", "-j", jobs]).expect(0);
        assert!(ran.out.ends_with("outputs are as accepted\n"), "-j {jobs}: {}", ran.out);
    }
    // The check left everything baked: there is nothing to do now.
    let ran = project.kiln(&["bake"]).expect(0);
    assert!(ran.out.starts_with("nothing to do: all "), "{}", ran.out);
}

#[test]
fn every_recipe_has_a_golden_book_and_every_book_a_recipe() {
    let names = |folder: &str| -> Vec<String> {
        let folder = std::fs::read_dir(common::root().join(folder)).expect("a folder of the project");
        let files = folder.map(|e| e.expect("an entry").path()).filter(|p| p.extension().is_some_and(|e| e == "toml"));
        let mut names: Vec<String> = files.map(|p| p.file_stem().expect("a name").to_string_lossy().into()).collect();
        names.sort();
        names
    };
    assert_eq!(names("recipes"), names("golden"));
    assert!(names("recipes").len() >= 8);
}

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

[uv_sets]

[[render]]
view = "turntable-1"
size = 32
"#;

const CANVAS: &str = "[canvas]\nsize = [48, 32]\n\n[exemplar]\nbase_color = \"e.png\"\n";

const COLOR: &str = "one.base_color.png";

fn png(pixels: &Pixels) -> Vec<u8> {
    encode_png(pixels, Compression::Fast, Transfer::Srgb).expect("a picture in memory")
}

fn exemplar(side: u32, phase: u32) -> Vec<u8> {
    let texel = |i: u32| [(i * 37 + phase) as u8, (i * i * 11) as u8, (i / side * 15) as u8];
    let samples = Samples::U8((0..side * side).flat_map(texel).collect());
    png(&Pixels { width: side, height: side, channels: 3, samples })
}

/// A mesh and a canvas with one exemplar, nothing accepted yet.
fn fresh() -> Project {
    let project = Project::new();
    project.write("recipes/one.toml", RECIPE);
    project.write("recipes/two.toml", CANVAS);
    project.write("recipes/m.obj", TETRAHEDRON);
    project.write("recipes/e.png", exemplar(24, 0));
    project
}

fn accepted() -> Project {
    let project = fresh();
    project.kiln(&["accept", "-q"]).expect(0);
    project
}

fn text(project: &Project, file: &str) -> String {
    String::from_utf8(project.read(file)).expect("text")
}

fn pixels(bytes: &[u8]) -> Pixels {
    decode_pixels(bytes, &Limits::default()).expect("a picture")
}

/// Puts another digest into the book in the place of that of `entry`, and returns the one that was there.
fn forge(project: &Project, book: &str, entry: &str, key: &str, digest: &str) -> String {
    let file = format!("golden/{book}.toml");
    let old = text(project, &file);
    let at = old.find(&format!("name = \"{entry}\"")).expect("an entry");
    let from = at + old[at..].find(&format!("{key} = \"")).expect("a digest") + key.len() + 4;
    let was = old[from..from + 64].to_string();
    project.write(&file, [&old[..from], digest, &old[from + 64..]].concat());
    was
}

/// The entry of an output in what `kiln check --format json` says.
fn entry(ran: &Ran, output: &str) -> Value {
    let said: Value = serde_json::from_str(&ran.out).expect("JSON");
    assert_eq!(said["version"], 1);
    let outputs = said["outputs"].as_array().expect("outputs");
    outputs.iter().find(|o| o["output"] == output).unwrap_or_else(|| panic!("{output} is not in {}", ran.out)).clone()
}

#[test]
fn a_book_holds_figures_and_what_steps_were_made_of_and_does_without() {
    let project = accepted();
    let book = text(&project, "golden/one.toml");
    for held in ["\"swd\" = ", "\"coherence\" = ", "\"seam_mip0\" = ", "revision = ", "\"neighbourhoods\" = \"[5, 3]\""]
    {
        assert!(book.contains(held), "{held} is missing:\n{book}");
    }
    assert!(book.contains("files = { \"recipes/e.png\" = \""), "{book}");
    assert!(text(&project, "golden/two.toml").contains("\"swd\" = "), "a canvas has figures, too");
    // As older versions wrote it.
    let is_new = |line: &&str| !["quality =", "revision =", "params =", "files ="].iter().any(|k| line.starts_with(k));
    let old: Vec<&str> = book.lines().filter(is_new).collect();
    project.write("golden/one.toml", old.join("\n"));
    project.kiln(&["check"]).expect(0);
    // Accepting again what is the same adds what is lacking and changes nothing else.
    project.kiln(&["accept", "one"]).expect(0);
    assert_eq!(text(&project, "golden/one.toml"), book);
}

#[test]
fn one_changed_pixel_is_found_and_tolerances_judge_it() {
    let project = accepted();
    let mut picture = pixels(&project.read(&format!("out/one/{COLOR}")));
    let Samples::U8(samples) = &mut picture.samples else { panic!("8 bits") };
    samples[3 * (64 * 7 + 5)] ^= 1;
    let digest = digest_pixels(&picture);
    forge(&project, "one", COLOR, "blake3", &digest);
    let ran = project.kiln(&["check", "one"]).expect(1);
    assert!(ran.out.contains("the content differs; its thumbnail"), "the accepted one is not here: {}", ran.out);

    project.write(&format!(".kiln/golden/{digest}"), png(&picture));
    let found = entry(&project.kiln(&["check", "--format", "json"]).expect(1), COLOR);
    assert_eq!((&found["status"], &found["kind"]), (&"different".into(), &"map".into()));
    assert_eq!((&found["figures"]["max"], &found["figures"]["worst"]), (&1.0.into(), &serde_json::json!([5, 7])));
    assert_eq!(found["figures"]["share"], 1.0 / 4096.0);
    let flip = found["figures"]["flip"].as_f64().expect("a number");
    assert!(flip > 0.0 && flip < 0.01, "{flip}");
    assert!(found["accept"] == "kiln accept one/one.base_color.png", "{found}");

    let book = text(&project, "golden/one.toml");
    let with = |tolerance: &str| {
        let line = format!("blake3 = \"{digest}\"\ntolerance = {{ {tolerance} }}");
        project.write("golden/one.toml", book.replace(&format!("blake3 = \"{digest}\""), &line));
        project.kiln(&["check", "one", "--format", "json"])
    };
    for enough in ["max = 1", "share = 0.001", "flip = 0.01", "mean = 0.01, max = 1, share = 0.01, flip = 0.01"] {
        assert_eq!(entry(&with(enough).expect(0), COLOR)["status"], "tolerated", "{enough}");
    }
    for short in ["max = 0.5", "share = 0.0001", "flip = 0", "mean = 0.00001", "max = 255, share = 0"] {
        assert_eq!(entry(&with(short).expect(1), COLOR)["status"], "different", "{short}");
    }
    assert!(with("").expect(2).err.contains("`tolerance` is empty"));
    // Where outputs may differ, what they are made of may, too.
    with("max = 1").expect(0);
    forge(&project, "one", "analyse", "artefact", &"0".repeat(64));
    let ran = project.kiln(&["check", "one", "--format", "json"]).expect(0);
    assert_eq!(entry(&ran, "step analyse")["status"], "tolerated");
}

#[test]
fn one_moved_uv_is_found() {
    let project = accepted();
    let mut glb = project.read("out/one/one.uvsets.glb");
    let json_len = u32::from_le_bytes(glb[12..16].try_into().expect("four bytes")) as usize;
    let json: Value = serde_json::from_slice(&glb[20..20 + json_len]).expect("JSON");
    let at = json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_1"].as_u64().expect("a second set") as usize;
    let accessor = &json["accessors"][at];
    let view = &json["bufferViews"][accessor["bufferView"].as_u64().expect("a view") as usize];
    let offset = [&accessor["byteOffset"], &view["byteOffset"]].iter().filter_map(|o| o.as_u64()).sum::<u64>() as usize;
    // The lowest bit of one coordinate.
    glb[20 + json_len + 8 + offset] ^= 1;
    let digest = digest_glb(&glb).expect("a digest");
    let was = forge(&project, "one", "one.uvsets.glb", "blake3", &digest);
    assert_ne!(was, digest);
    let ran = project.kiln(&["check"]).expect(1);
    assert!(ran.out.contains("different one/one.uvsets.glb") && ran.out.contains("\n1 of "), "{}", ran.out);
    project.write(&format!(".kiln/golden/{digest}"), &glb);
    let ran = project.kiln(&["check"]).expect(1);
    let said = "TEXCOORD_1 of mesh 0, primitive 0: 1 of ";
    assert!(ran.out.contains(said) && ran.out.contains(" elements differ, by at most "), "{}", ran.out);
}

#[test]
fn a_stale_golden_fails_the_check_until_it_is_pruned() {
    let project = accepted();
    std::fs::remove_file(project.path("recipes/two.toml")).expect("a recipe");
    project.write("golden/one/render/turntable-9.png", exemplar(4, 0));
    project.write("golden/README.md", "not a golden");
    project.kiln(&["check", "one"]).expect(0);
    let ran = project.kiln(&["check", "--junit", "r.xml"]).expect(1);
    for said in ["stale     two/golden/two.toml", "there is no recipe `two`", "turntable-9.png", "kiln accept --prune"]
    {
        assert!(ran.out.contains(said), "{said} is missing:\n{}", ran.out);
    }
    assert!(text(&project, "r.xml").contains("<failure message=\"stale\">"));
    let listed = project.kiln(&["accept"]).expect(0).out;
    assert!(listed.contains("stale: golden/two.toml"), "{listed}");
    let would = project.kiln(&["accept", "--prune", "-n"]).expect(0).out;
    assert!(would.contains("would remove golden/two.toml") && project.path("golden/two.toml").exists(), "{would}");
    project.kiln_with(&["accept", "--prune"], &[("CI", "1")]).expect(2);
    let removed = project.kiln(&["accept", "--prune"]).expect(0).out;
    assert!(removed.contains("removed golden/two.toml") && removed.contains("copies"), "{removed}");
    let left = project.files("golden");
    assert!(left.contains(&"golden/README.md".to_string()) && left.iter().all(|f| !f.contains("two")), "{left:?}");
    project.kiln(&["check"]).expect(0);
    assert_eq!(project.kiln(&["accept", "--prune"]).expect(0).out, "no golden is stale\n");
    // The wrong folder is no reason to throw everything away.
    std::fs::remove_file(project.path("recipes/one.toml")).expect("a recipe");
    project.kiln(&["accept", "--prune"]).expect(2);
    assert!(project.path("golden/one.toml").exists());
}

#[test]
fn a_forgotten_revision_is_found() {
    let project = accepted();
    // As if the code of a step gave something else now than when it was accepted.
    forge(&project, "one", "unwrap", "artefact", &"0".repeat(64));
    let ran = project.kiln(&["check"]).expect(1);
    for said in ["different one/step unwrap", "first step that differs: unwrap", "revision was not raised", "\n1 of "] {
        assert!(ran.out.contains(said), "{said} is missing:\n{}", ran.out);
    }
    // With a new revision it is not the outputs' business, as they are the same.
    let file = "golden/one.toml";
    let book = text(&project, file);
    let at = book.find("name = \"unwrap\"").expect("a step");
    project.write(file, [&book[..at], &book[at..].replacen("revision = 1", "revision = 0", 1)].concat());
    project.kiln(&["check"]).expect(0);
}

#[test]
fn a_changed_analysis_is_found_by_itself() {
    let project = accepted();
    forge(&project, "two", "analyse", "artefact", &"0".repeat(64));
    let book = text(&project, "golden/two.toml");
    let at = book.find("name = \"analyse\"").expect("a step");
    project.write("golden/two.toml", [&book[..at], &book[at..].replacen("revision = ", "revision = 1", 1)].concat());
    let (said, _) = review(&project, "");
    assert_eq!(said, "", "quiet");
    let ran = project.kiln(&["accept", "--review"]).expect(0);
    assert!(ran.out.contains("two: outputs are as accepted, its analysis is not"), "{}", ran.out);
    let ran = project.kiln(&["check"]).expect(1);
    assert!(ran.out.contains("different two/step analyse") && ran.out.contains("step revision 1"), "{}", ran.out);
}

#[test]
fn what_the_cache_says_is_not_believed() {
    let project = accepted();
    let file = format!("out/one/{COLOR}");
    let whole = project.read(&file);
    // An entry such as a step leaves behind whose code changed and whose revision was not raised: sound, but not what
    // the code gives now.
    let poison = {
        let mut picture = pixels(&whole);
        let Samples::U8(samples) = &mut picture.samples else { panic!("8 bits") };
        samples[100] ^= 0x40;
        png(&picture)
    };
    let folder = project.path(".kiln/cache");
    let cache = Cache::new(&Real, &folder);
    let mut poisoned = 0;
    for name in project.files(".kiln/cache/steps") {
        let hex = name.rsplit('/').next().expect("a name").to_string();
        let bytes: Vec<u8> = (0..32).map(|i| u8::from_str_radix(&hex[2 * i..2 * i + 2], 16).expect("hex")).collect();
        let key = Digest::from_bytes(bytes.try_into().expect("32 bytes"));
        let record = cache.record(&key).expect("a record");
        if record.artefact == Digest::of(&whole) {
            let record = Record { artefact: Digest::of(&poison), len: poison.len() as u64, ..record };
            cache.store(&key, &record, &poison).expect("a cache");
            poisoned += 1;
        }
    }
    assert_eq!(poisoned, 1);
    std::fs::remove_file(project.path(".kiln/manifest")).expect("a manifest");
    std::fs::remove_dir_all(project.path("out")).expect("outputs");
    project.kiln(&["bake"]).expect(0);
    assert_eq!(project.read(&file), poison, "a bake trusts its cache");
    project.kiln(&["check"]).expect(0);
    assert_eq!(project.read(&file), whole, "a check bakes from nothing");
    project.kiln(&["bake"]).expect(0);
    assert_eq!(project.read(&file), whole, "and the cache is mended");
}

#[test]
fn what_moved_is_named_and_quality_is_compared() {
    let project = accepted();
    project.write("recipes/one.toml", RECIPE.replace("[5, 3]", "[7, 3]"));
    let ran = project.kiln(&["check", "--report", "r.html", "--junit", "r.xml"]).expect(1);
    let said = "first step that differs: analyse: `neighbourhoods` changed from [5, 3] to [7, 3]";
    assert!(ran.out.contains(said) && ran.out.contains("different one/step analyse"), "{}", ran.out);
    assert!(text(&project, "r.xml").contains("changed from [5, 3] to [7, 3]"));
    let json = project.kiln(&["check", "--format", "json"]).expect(1);
    let found = entry(&json, COLOR);
    assert_eq!(found["first_change"]["step"], "analyse");
    for side in ["before", "after"] {
        assert!(
            found["quality"]["swd"][side].is_number() && found["quality"]["coherence"][side].is_number(),
            "{found}"
        );
    }
    let said: Value = serde_json::from_str(&json.out).expect("JSON");
    let one = said["recipes"].as_array().and_then(|r| r.iter().find(|r| r["recipe"] == "one")).expect("times");
    assert!(one["seconds"].as_f64().is_some_and(|s| s > 0.0), "{one}");

    // The page holds all of that, and pictures of all three kinds.
    let page = text(&project, "r.html");
    let data = page.split("type=\"application/json\">").nth(1).and_then(|s| s.split("</script>").next()).expect("data");
    let data: Value = serde_json::from_str(data).expect("JSON");
    let shown = data["outputs"].as_array().and_then(|o| o.iter().find(|o| o["output"] == COLOR)).expect("an output");
    for what in ["expected", "actual", "difference"] {
        let picture = shown["pictures"][what].as_str().expect("a picture");
        assert!(picture.starts_with("data:image/png;base64,"), "{what}");
    }
    assert_eq!(shown["accept"], "kiln accept one/one.base_color.png");

    project.write("recipes/one.toml", RECIPE);
    project.write("recipes/e.png", exemplar(24, 9));
    let ran = project.kiln(&["check", "two"]).expect(1);
    assert!(ran.out.contains("first step that differs: maps: recipes/e.png: content changed"), "{}", ran.out);
}

/// Runs `kiln accept --review` and answers.
fn review(project: &Project, answers: &str) -> (String, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_kiln"));
    command.arg("-C").arg(project.path("")).args(["accept", "--review", "-q"]).env_remove("CI").env("NO_COLOR", "1");
    let pipes = command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = pipes.spawn().expect("kiln runs");
    child.stdin.take().expect("a pipe").write_all(answers.as_bytes()).expect("answers");
    let output = child.wait_with_output().expect("kiln ends");
    let err = String::from_utf8_lossy(&output.stderr).to_string();
    assert!(output.status.success(), "{err}");
    (String::from_utf8_lossy(&output.stdout).to_string(), err)
}

#[test]
fn outputs_are_accepted_by_name_by_pattern_and_one_by_one() {
    let project = accepted();
    let books = || [text(&project, "golden/one.toml"), text(&project, "golden/two.toml")];
    let before = books();
    project.write("recipes/e.png", exemplar(24, 9));
    let failing = || -> Vec<String> {
        let ran = project.kiln(&["check", "-q"]);
        ran.out.lines().filter_map(|l| Some(l.strip_prefix("different ")?.to_string())).collect()
    };
    let all = failing();
    assert!(
        all.contains(&"one/render/turntable-1.png".to_string()) && all.contains(&"two/step analyse".into()),
        "{all:?}"
    );

    // One output by a pattern: nothing else moves, and the steps stay to explain the rest.
    let ran = project.kiln(&["accept", "o*/render/*"]).expect(0);
    assert!(ran.out.starts_with("one: 1 changed outputs accepted, "), "{}", ran.out);
    let left: Vec<String> = all.iter().filter(|o| *o != "one/render/turntable-1.png").cloned().collect();
    assert_eq!(failing(), left);
    assert_eq!(books()[1], before[1]);

    // No, then the end: nothing is written.
    let half = books();
    let (_, asked) = review(&project, "n\n");
    assert_eq!(asked.matches("accept?").count(), 2, "{asked}");
    for said in
        ["one/one.base_color.png", "map 64x64, 3 channel(s)", "to the eye (FLIP)", "swd ", "first step that differs"]
    {
        assert!(asked.contains(said), "{said} is missing:\n{asked}");
    }
    assert_eq!(books(), half);
    // Something else than an answer, then yes, then out.
    let (_, asked) = review(&project, "what\ny\nq\n");
    assert!(asked.contains("`what` is none of y, n, a and q"), "{asked}");
    let left: Vec<String> = left.into_iter().filter(|o| o != "one/one.base_color.png").collect();
    assert_eq!(failing(), left);
    // Everything of the first recipe, nothing of the second.
    review(&project, "a\nq\n");
    assert!(failing().iter().all(|o| o.starts_with("two/")), "{:?}", failing());
    project.kiln(&["accept", "t?o"]).expect(0);
    project.kiln(&["check"]).expect(0);

    let wrong = project.kiln(&["accept", "three*"]).expect(2);
    assert!(wrong.err.contains("`three*` is no recipe; there are one, two"), "{}", wrong.err);
    project.kiln(&["accept", "three"]).expect(2);
    for args in [&["accept", "--review"][..], &["accept", "two"], &["accept", "--prune"]] {
        assert!(project.kiln_with(args, &[("CI", "true")]).expect(2).err.contains("CI"));
    }
    project.kiln_with(&["accept", "two", "--force"], &[("CI", "true")]).expect(0);
}

#[test]
fn two_processes_make_the_same_and_what_they_do_not_is_named() {
    let project = accepted();
    let ran = project.kiln(&["check", "--twice", "-j", "2"]).expect(0);
    assert!(ran.err.contains("baking again in another process with 1 thread(s)"), "{}", ran.err);
    assert!(project.files(".kiln/twice").is_empty(), "nothing is left of it");
    project.kiln(&["check", "two", "--twice", "-j", "1"]).expect(0);

    // What a step gives must not depend on anything but its inputs. Here the exemplar is another file by the time that the
    // second process looks at it: so its first step gives something else there.
    project.write("recipes/one.toml", RECIPE.replace("size = 64", "size = 1024"));
    let mut command = Command::new(env!("CARGO_BIN_EXE_kiln"));
    command.arg("-C").arg(project.path("")).args(["check", "--twice", "-j", "2", "one"]).env("NO_COLOR", "1");
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("kiln runs");
    let lines = BufReader::new(child.stderr.take().expect("a pipe")).lines();
    for line in lines.map_while(Result::ok) {
        if line.ends_with(" one/maps") {
            project.write("recipes/e.png", exemplar(24, 9));
        }
    }
    let output = child.wait_with_output().expect("kiln ends");
    let out = String::from_utf8_lossy(&output.stdout);
    assert_eq!(output.status.code(), Some(1), "{out}");
    assert!(out.contains("unstable  one/step maps\n          the first step that is not the same twice"), "{out}");
    assert!(!out.contains("one/step surface"), "what does not depend on it is the same: {out}");
}
