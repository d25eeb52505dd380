//! The build engine as its users meet it: Make, Ninja, a watch, a cache that is carried about, recipes that go.
#![cfg(unix)]

mod common;

use std::io::Read;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant, SystemTime};

use common::{CANVAS_RECIPE, Project, picture, small_project};

fn has(program: &str) -> bool {
    let there = Command::new(program).arg("--version").output().is_ok();
    if !there {
        println!("skipped: {program} is not here");
    }
    there
}

/// Runs another build program in the project, with kiln on the path; what it said.
fn other(project: &Project, program: &str, args: &[&str]) -> String {
    let kiln = Path::new(env!("CARGO_BIN_EXE_kiln")).parent().expect("a folder");
    let path = format!("{}:{}", kiln.display(), std::env::var("PATH").unwrap_or_default());
    let ran = Command::new(program)
        .args(args)
        .current_dir(project.path(""))
        .env("PATH", path)
        .env_remove("MAKEFLAGS")
        .env_remove("CI")
        .output()
        .expect(program);
    let said = [ran.stdout, ran.stderr].map(|text| String::from_utf8_lossy(&text).into_owned()).concat();
    assert!(ran.status.success(), "{program}: {said}");
    said
}

/// As if the inputs had been there for a while.
fn age(project: &Project) {
    for file in project.files("recipes") {
        let file = std::fs::File::options().append(true).open(project.path(&file)).expect("a file");
        file.set_modified(SystemTime::now() - Duration::from_secs(100)).expect("a time");
    }
}

#[test]
fn one_graph_makes_what_is_shared_once_and_goes_on_past_what_is_wrong() {
    let project = small_project(4);
    project.write("recipes/faulty.toml", CANVAS_RECIPE.replace("size", "sise"));
    project.write("recipes/missing.toml", CANVAS_RECIPE.replace("e.png", "none.png"));
    let stops = project.kiln(&["bake"]).expect(2);
    assert!(stops.err.contains("did you mean `size`") && project.files("out").is_empty(), "{}", stops.err);
    let goes_on = project.kiln(&["bake", "-k", "--memory", "1MiB"]).expect(2);
    assert!(goes_on.err.contains("did you mean `size`") && goes_on.err.contains("none.png"), "{}", goes_on.err);
    assert!(goes_on.out.contains("2 failed"), "{}", goes_on.out);
    let ran = |step: &str| goes_on.err.lines().filter(|line| line.ends_with(step)).count();
    assert_eq!([ran("/maps"), ran("/analyse"), ran("/surface"), ran("/report")], [1, 1, 1, 4], "{}", goes_on.err);
    std::fs::remove_file(project.path("recipes/faulty.toml")).expect("a file");
    project.kiln(&["bake", "-k"]).expect(1);
}

#[test]
fn outputs_of_removed_recipes_stay_until_they_are_pruned() {
    let project = small_project(3);
    project.kiln(&["bake"]).expect(0);
    let all = project.contents("out");
    std::fs::remove_file(project.path("recipes/r1.toml")).expect("a file");
    for _ in 0..2 {
        let ran = project.kiln(&["bake"]).expect(0);
        assert!(ran.err.contains("no recipe makes 2 earlier outputs (out/r1/r1.base_color.png, "), "{}", ran.err);
        assert_eq!(project.contents("out"), all);
    }
    project.write("recipes/wrong.toml", "[");
    project.kiln(&["bake", "-k", "--prune"]).expect(2);
    assert_eq!(project.contents("out"), all, "who knows what the wrong recipe makes");
    std::fs::remove_file(project.path("recipes/wrong.toml")).expect("a file");
    let planned = project.kiln(&["plan"]).expect(0).out;
    assert!(planned.contains("dead     out/r1/r1.base_color.png: no recipe makes it"), "{planned}");
    assert!(
        project.kiln(&["plan", "--format", "json"]).expect(0).out.contains("\"dead\":[\"out/r1/r1.base_color.png\"")
    );
    let ran = project.kiln(&["bake", "--prune"]).expect(0);
    assert!(ran.out.contains("removed out/r1/r1.base_color.png"), "{}", ran.out);
    assert!(!project.path("out/r1").exists() && !project.files("out/r0").is_empty());
    assert_eq!(project.kiln(&["bake"]).expect(0).err, "");
}

#[cfg(not(feature = "remote"))]
#[test]
fn a_kiln_without_servers_says_so() {
    let project = small_project(1);
    let ran = project.kiln(&["bake", "--remote", "grpc://farm:8980"]).expect(2);
    assert!(ran.err.contains("grpc://farm:8980: this kiln cannot ask servers; build it with `--features remote`"));
    let ran = project.kiln(&["bake", "--remote-execute"]).expect(2);
    assert!(ran.err.contains("--remote-execute needs a server"), "{}", ran.err);
    project.write("kiln.toml", "[cache]\nremote = 'grpc://farm:8980'\n");
    let ran = project.kiln(&["bake"]).expect(0);
    assert!(ran.err.contains("warning: grpc://farm:8980: this kiln cannot ask servers"), "{}", ran.err);
    assert_eq!(project.kiln(&["plan", "-v", "--remote", "none"]).expect(0).err, "");
}

#[test]
fn nothing_to_do_is_known_by_stamps_alone_and_any_change_is_seen() {
    let project = small_project(3);
    project.write("kiln.toml", "[defaults.analysis]\njumps = 3\n");
    age(&project);
    let file = std::fs::File::options().append(true).open(project.path("kiln.toml")).expect("a file");
    file.set_modified(SystemTime::now() - Duration::from_secs(100)).expect("a time");
    project.kiln(&["bake"]).expect(0);
    let idle = || {
        let ran = project.kiln(&["bake"]).expect(0);
        assert!(ran.out.starts_with("nothing to do: all 12 outputs"), "{}", ran.out);
        assert!(project.kiln(&["plan"]).expect(0).out.starts_with("nothing to do: all "));
    };
    idle();
    assert!(!project.files(".kiln").iter().filter(|file| *file == ".kiln/seal").collect::<Vec<_>>().is_empty());
    // With the seal not even the manifest is read.
    let manifest = project.read(".kiln/manifest");
    project.write(".kiln/manifest", "damaged");
    idle();
    project.write(".kiln/manifest", manifest);
    let works = |what: &str| {
        let ran = project.kiln(&["bake"]).expect(0);
        assert!(!ran.out.starts_with("nothing to do"), "{what} was not seen: {}", ran.out);
        idle();
    };
    std::fs::remove_file(project.path("out/r0/report.json")).expect("a file");
    works("a missing output");
    project.write("out/r0/r0.glb", "scribble");
    works("a changed output");
    project.write("recipes/e.png", picture(16, 50));
    works("a changed sample");
    project.write("kiln.toml", "[defaults.analysis]\njumps = 2\n");
    works("other settings");
    let recipe = String::from_utf8(project.read("recipes/r0.toml")).expect("text");
    project.write("recipes/r0.toml", recipe.replace("scale = 12.0", "scale = 10.0"));
    works("a changed recipe");
    std::fs::rename(project.path("recipes/r1.toml"), project.path("recipes/other.toml")).expect("a file");
    assert!(project.kiln(&["bake", "--prune"]).expect(0).out.contains("removed out/r1/"), "a renamed recipe");
    std::fs::rename(project.path("recipes/other.toml"), project.path("recipes/r1.toml")).expect("a file");
    assert!(project.kiln(&["bake", "--prune"]).expect(0).out.contains("out/r1/report.json"), "and back");
    project.write("damage", "");
    for file in [".kiln/seal", ".kiln/manifest", ".kiln/scenes"] {
        project.write(file, "damaged");
        idle();
    }
}

#[test]
fn a_touched_sample_rebuilds_exactly_its_cone() {
    let project = small_project(4);
    project.write("recipes/f.png", picture(16, 7));
    project.write("recipes/other.toml", CANVAS_RECIPE.replace("e.png", "f.png"));
    project.kiln(&["bake"]).expect(0);
    project.write("recipes/f.png", picture(16, 8));
    let planned = project.kiln(&["plan"]).expect(0).out;
    assert!(planned.lines().all(|line| line.contains("other/")), "{planned}");
    let ran = project.kiln(&["bake"]).expect(0).err;
    let mut steps: Vec<&str> = ran.lines().map(|line| line.split_once("s  ").expect("a step that ran").1).collect();
    steps.sort_unstable();
    assert_eq!(steps, ["analyse", "maps", "paint base_color", "report", "walk image"].map(|s| format!("other/{s}")));
}

#[test]
fn make_lends_threads_and_gets_them_back() {
    if !has("make") {
        return;
    }
    let project = small_project(4);
    let reference = {
        let project = small_project(4);
        project.kiln(&["bake", "-q"]).expect(0);
        project.contents("out")
    };
    project.write("Makefile", "all: a b\na b:\n\t+@kiln bake -q --cache $@ r0 r1 r2 r3\n");
    for jobs in ["-j1", "-j3"] {
        let said = other(&project, "make", &[jobs]);
        assert!(!said.contains("jobserver") && !said.contains("tokens"), "{said}");
        assert_eq!(project.contents("out"), reference);
        std::fs::remove_dir_all(project.path("out")).expect("a folder");
    }
}

#[test]
fn make_and_ninja_learn_from_the_depfile_what_outputs_are_made_from() {
    let project = small_project(1);
    let rule = "kiln bake -q r0 --depfile r0.d";
    project.write("Makefile", format!("out/r0/r0.glb: recipes/r0.toml\n\t{rule}\n-include r0.d\n"));
    let ninja = format!(
        "rule bake\n  command = {rule}\n  depfile = r0.d\n  deps = gcc\n  restat = 1\n\
         build out/r0/r0.glb | out/r0/r0.base_color.png out/r0/r0.uvsets.glb out/r0/render/turntable-1.png \
         out/r0/report.json: bake recipes/r0.toml\n"
    );
    project.write("build.ninja", ninja);
    for (program, idle) in [("make", "up to date"), ("ninja", "no work to do")] {
        if !has(program) {
            continue;
        }
        let _ = std::fs::remove_dir_all(project.path("out"));
        let _ = std::fs::remove_file(project.path("r0.d"));
        other(&project, program, &[]);
        assert!(other(&project, program, &[]).contains(idle), "{program}");
        // The mesh stands in the depfile alone.
        std::thread::sleep(Duration::from_millis(20));
        project.write("recipes/m.obj", common::TETRAHEDRON.replace("v 1 0 0", &format!("v 1.{} 0 0", program.len())));
        let before = project.read("out/r0/r0.glb");
        other(&project, program, &[]);
        assert_ne!(project.read("out/r0/r0.glb"), before, "{program}");
    }
}

#[test]
fn a_plan_is_rules_for_ninja() {
    let project = small_project(3);
    let rules = project.kiln(&["plan", "--format", "ninja"]).expect(0).out;
    assert!(rules.contains("build out/r1/r1.base_color.png out/r1/report.json: bake recipes/r1.toml | recipes/e.png"));
    project.kiln(&["bake", "--format", "ninja"]).expect(2);
    project.kiln(&["check", "--format", "ninja"]).expect(2);
    if !has("ninja") {
        return;
    }
    project.write("build.ninja", rules);
    other(&project, "ninja", &[]);
    assert!(other(&project, "ninja", &[]).contains("no work to do"));
    assert!(project.kiln(&["bake"]).expect(0).out.starts_with("nothing to do"));
    std::thread::sleep(Duration::from_millis(20));
    project.write("recipes/e.png", picture(16, 1));
    let before = project.contents("out");
    other(&project, "ninja", &[]);
    let changed = project.contents("out").iter().filter(|(file, bytes)| before[*file] != **bytes).count();
    assert!(changed >= 5, "{changed} outputs changed");
}

#[test]
fn a_cache_is_carried_to_another_tree_and_kept_small() {
    let project = small_project(2);
    project.kiln(&["bake"]).expect(0);
    let exported = project.kiln(&["cache", "export", "carried"]).expect(0).out;
    assert!(exported.contains("carried: ") && exported.contains("artefacts"), "{exported}");
    let other = small_project(2);
    let carried = project.path("carried").display().to_string();
    other.kiln(&["cache", "import", &carried]).expect(0);
    let ran = other.kiln(&["bake"]).expect(0);
    assert!(ran.out.contains(" 0 steps run"), "{}", ran.out);
    assert_eq!(other.contents("out"), project.contents("out"));
    // Or used where it lies, as a folder on a network disk is; and damage there is noticed.
    let shared = small_project(2);
    assert!(shared.kiln(&["bake", "--cache", &carried]).expect(0).out.contains(" 0 steps run"));
    for blob in project.files("carried/blobs") {
        project.write(&blob, "damaged");
    }
    let damaged = small_project(2).kiln(&["cache", "import", &carried]).expect(1).out;
    assert!(damaged.contains("damaged entries were left out"), "{damaged}");
    std::fs::remove_dir_all(shared.path("out")).expect("a folder");
    std::fs::remove_dir_all(shared.path(".kiln")).expect("a folder");
    shared.kiln(&["bake", "--cache", &carried]).expect(0);
    assert_eq!(shared.contents("out"), project.contents("out"));
    shared.kiln(&["cache", "verify", "--cache", &carried]).expect(0);

    let sizes =
        |project: &Project| -> Vec<usize> { project.contents(".kiln/cache/blobs").values().map(Vec::len).collect() };
    let bytes = |project: &Project| -> usize { sizes(project).iter().sum() };
    // Which artefact was used last differs from run to run; room for any two of them always leaves one.
    let room = 2 * sizes(&other).into_iter().max().expect("artefacts");
    let all = bytes(&other);
    assert!(all > room, "{all} bytes, {room} of them to be left");
    other.kiln(&["cache", "trim"]).expect(2);
    other.kiln(&["cache", "trim", "--max-age", "1d"]).expect(0);
    assert_eq!(bytes(&other), all, "all of it is young and used");
    other.kiln(&["cache", "trim", "--max-size", &format!("{room}B")]).expect(0);
    assert!((1..=room).contains(&bytes(&other)), "{}", bytes(&other));
    other.write("kiln.toml", format!("[cache]\nmax_size = {room}\n"));
    other.write("recipes/e.png", picture(16, 77));
    other.kiln(&["bake"]).expect(0);
    assert!((1..=room).contains(&bytes(&other)), "{}", bytes(&other));
    other.kiln(&["cache", "clear"]).expect(0);
    assert_eq!(bytes(&other), 0);
    project.kiln(&["cache", "import", "nowhere"]).expect(2);
}

#[test]
fn every_reason_is_said_in_words_and_the_plan_has_its_shape() {
    let project = small_project(2);
    project.kiln(&["bake", "-q"]).expect(0);
    let recipe = String::from_utf8(project.read("recipes/r0.toml")).expect("text");
    project.write("recipes/r0.toml", recipe.replace("neighbourhoods = [3]", "neighbourhoods = [5, 3]"));
    project.write("recipes/m.obj", common::TETRAHEDRON.replace("v 1 0 0", "v 1.5 0 0"));
    std::fs::remove_file(project.path("out/r1/report.json")).expect("a file");
    let says = |said: &str, reasons: &[&str]| {
        for reason in reasons {
            assert!(said.contains(reason), "{reason} is missing:\n{said}");
        }
    };
    let reasons = [
        "r0/analyse: `neighbourhoods` changed from [3] to [5, 3]",
        "r0/surface: recipes/m.obj: content changed",
        "r1/report: output out/r1/report.json missing",
    ];
    says(&project.kiln(&["plan"]).expect(0).out, &reasons);
    says(&project.kiln(&["bake", "-n", "--explain"]).expect(0).out, &reasons);
    let plan = project.kiln(&["plan", "--format", "json"]).expect(0).out;
    let plan: serde_json::Value = serde_json::from_str(&plan).expect("JSON");
    assert_eq!(plan["version"], 1);
    let step = plan["steps"].as_array().expect("steps").iter().find(|step| step["name"] == "r0/analyse");
    let expected = serde_json::json!({
        "name": "r0/analyse", "kind": "analyse", "state": "run", "inputs": ["r0/maps"], "outputs": [],
        "reasons": ["`neighbourhoods` changed from [3] to [5, 3]"], "waits_for": [],
    });
    assert_eq!(step, Some(&expected));
    says(&project.kiln(&["bake", "--explain"]).expect(0).err, &reasons[..2]);
    project.kiln(&["cache", "clear"]).expect(0);
    std::fs::remove_file(project.path("out/r0/r0.glb")).expect("a file");
    let lost =
        ["r0/atlas glb: output out/r0/r0.glb missing; artefact missing from cache", "r0/rasterise: artefact missing"];
    says(&project.kiln(&["plan"]).expect(0).out, &lost);
    says(&project.kiln(&["bake", "--explain"]).expect(0).err, &lost);
}

#[test]
fn a_terminal_shows_one_line_and_how_long_it_will_take() {
    let project = small_project(2);
    let command = format!("{} -C {} bake", env!("CARGO_BIN_EXE_kiln"), project.path("").display());
    let mut script = Command::new("script");
    let Ok(ran) = script.args(["-qec", &command, "/dev/null"]).env_remove("CI").stdin(Stdio::null()).output() else {
        println!("skipped: there is no `script` to make a terminal");
        return;
    };
    let said = String::from_utf8_lossy(&ran.stdout);
    assert!(said.contains(" to go: r0/") && said.contains("\r\u{1b}[2K["), "{said}");
    assert!(!said.contains("s  r0/maps"), "no plain lines: {said}");
    let plain = small_project(2).kiln(&["bake"]).expect(0).err;
    assert!(plain.contains("s  r0/maps") && !plain.contains("to go"), "{plain}");
}

/// Waits until something holds; what it was waiting for, in a panic.
fn until(what: &str, mut holds: impl FnMut() -> bool) {
    let begun = Instant::now();
    while !holds() {
        assert!(begun.elapsed() < Duration::from_secs(60), "waited in vain for {what}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// Ends a process, whatever comes.
struct Ended(u32);

impl Drop for Ended {
    fn drop(&mut self) {
        if std::thread::panicking() {
            let _ = Command::new("kill").args(["-KILL", &self.0.to_string()]).status();
        }
    }
}

#[test]
fn a_watch_bakes_what_changes_and_survives_mistakes() {
    let project = small_project(2);
    let mut command = Command::new(env!("CARGO_BIN_EXE_kiln"));
    command.arg("-C").arg(project.path("")).arg("watch").env_remove("CI");
    let mut kiln = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("kiln starts");
    let said = std::sync::Mutex::new(String::new());
    let mut err = kiln.stderr.take().expect("a pipe");
    std::thread::scope(|scope| {
        scope.spawn(|| {
            let mut some = [0; 4096];
            while let Ok(count @ 1..) = err.read(&mut some) {
                said.lock().expect("text").push_str(&String::from_utf8_lossy(&some[..count]));
            }
        });
        let _ended = Ended(kiln.id());
        let waits = || said.lock().expect("text").matches("waiting for changes").count();
        until("the first bake", || waits() == 1);
        let first = project.contents("out");
        assert_eq!(first.len(), 7);
        // Two files at once wake one bake.
        project.write("recipes/e.png", picture(16, 9));
        project.write("recipes/m.obj", common::TETRAHEDRON.replace("v 1 0 0", "v 1.5 0 0"));
        until("the second bake", || waits() == 2);
        let second = project.contents("out");
        assert!(first.iter().filter(|(file, bytes)| second[*file] != **bytes).count() >= 5);
        let recipe = project.read("recipes/r1.toml");
        project.write("recipes/r1.toml", "[canvas\n");
        until("the mistake", || waits() == 3);
        assert!(said.lock().expect("text").contains("recipes/r1.toml:1"), "{}", said.lock().expect("text"));
        std::fs::remove_file(project.path("recipes/m.obj")).expect("a file");
        project.write("recipes/r1.toml", String::from_utf8_lossy(&recipe).replace("96", "48").as_str());
        until("the missing mesh", || said.lock().expect("text").contains("recipes/m.obj: there is no such file"));
        project.write("recipes/m.obj", common::TETRAHEDRON);
        until("the last bake", || project.read("out/r1/r1.base_color.png") != second["out/r1/r1.base_color.png"]);
        until("its end", || said.lock().expect("text").ends_with("Ctrl-C ends\n"));
        let status = Command::new("kill").arg("-INT").arg(kiln.id().to_string()).status().expect("kill");
        assert!(status.success());
        assert_eq!(kiln.wait().expect("a child").code(), Some(130));
    });
    assert!(project.kiln(&["bake"]).expect(0).out.starts_with("nothing to do"));
}
