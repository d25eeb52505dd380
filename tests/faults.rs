//! What may go wrong around kiln: kills at any moment, full and read-only disks, clocks that jump, inputs that change
//! under its hands, others of its kind. Outputs stay whole, the next run ends well, and what comes out is right.
#![cfg(unix)]

mod common;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant, SystemTime};

use common::{Project, picture, small_project};

const SAMPLE: &str = "recipes/e.png";
const SIDE: u32 = 16;
/// How often the first test kills.
const KILLS: usize = 200;

type Contents = BTreeMap<String, Vec<u8>>;

/// What a first bake on a fresh disk makes of each phase of the sample.
fn references(recipes: usize, phases: &[u32]) -> Vec<Contents> {
    let bake = |&phase: &u32| {
        let project = small_project(recipes);
        project.write(SAMPLE, picture(SIDE, phase));
        project.kiln(&["bake", "-q"]).expect(0);
        project.contents("out")
    };
    phases.iter().map(bake).collect()
}

/// Numbers that look random and are the same each time.
struct Dice(u64);

impl Dice {
    fn next(&mut self, below: u64) -> u64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 33) % below
    }
}

fn unfinished(project: &Project) -> Vec<String> {
    let all = [project.files("out"), project.files(".kiln")].concat();
    all.into_iter().filter(|file| file.contains(".kiln-tmp-")).collect()
}

/// The run ends, its outputs are these, nothing is left over, and then there is nothing to do.
fn ends_well(project: &Project, expected: &Contents) {
    project.kiln(&["bake", "-q"]).expect(0);
    let found = project.contents("out");
    assert_eq!(found.keys().collect::<Vec<_>>(), expected.keys().collect::<Vec<_>>());
    for (file, bytes) in expected {
        assert!(found[file] == *bytes, "{file} is not what a first bake makes");
    }
    assert_eq!(unfinished(project), Vec::<String>::new());
    assert!(project.kiln(&["bake"]).expect(0).out.starts_with("nothing to do"));
    project.kiln(&["cache", "verify"]).expect(0);
}

fn send(signal: &str, process: u32) {
    let sent = Command::new("kill").arg(signal).arg(process.to_string()).status();
    assert!(sent.is_ok_and(|status| status.success()), "kill {signal}");
}

#[test]
fn killed_at_any_moment_outputs_are_whole_and_the_next_run_ends() {
    let references = references(3, &[0, 90]);
    let project = small_project(3);
    let begun = Instant::now();
    project.kiln(&["bake", "-q"]).expect(0);
    let whole_ms = begun.elapsed().as_millis() as u64;
    let (mut dice, mut killed, mut left_behind, mut runs) = (Dice(7), 0, 0, 0);
    while killed < KILLS {
        runs += 1;
        assert!(runs < 10 * KILLS, "kiln ends before it can be killed");
        let phase = runs % 2;
        project.write(SAMPLE, picture(SIDE, phase as u32 * 90));
        if dice.next(3) > 0 {
            let _ = std::fs::remove_dir_all(project.path(".kiln/cache"));
        }
        if dice.next(4) == 0 {
            let _ = std::fs::remove_dir_all(project.path("out"));
        }
        let mut kiln = project.start(&["bake", "-q", "-j2"]);
        std::thread::sleep(Duration::from_micros(dice.next(whole_ms * 1000)));
        killed += usize::from(kiln.try_wait().expect("a child").is_none());
        let _ = kiln.kill();
        kiln.wait().expect("a child");
        left_behind += usize::from(!unfinished(&project).is_empty());
        for (file, bytes) in project.contents("out").iter().filter(|(file, _)| !file.contains(".kiln-tmp-")) {
            let whole = references.iter().any(|reference| reference.get(file) == Some(bytes));
            assert!(whole, "{file} is not whole after kill {killed}");
        }
        if runs % 10 == 0 {
            ends_well(&project, &references[phase]);
        }
    }
    println!(
        "{killed} kills in {runs} runs within {whole_ms} ms; {left_behind} left an unfinished file for the next to remove"
    );
    project.write(SAMPLE, picture(SIDE, 0));
    ends_well(&project, &references[0]);
}

#[test]
fn ctrl_c_ends_with_130_and_keeps_what_is_done() {
    let references = references(8, &[0]);
    let (mut dice, mut ended) = (Dice(3), 0);
    for _ in 0..30 {
        let project = small_project(8);
        let kiln = project.start(&["bake", "-j1"]);
        std::thread::sleep(Duration::from_millis(20 + dice.next(300)));
        send("-INT", kiln.id());
        let output = kiln.wait_with_output().expect("a child");
        match output.status.code() {
            Some(130) => {
                let said = String::from_utf8_lossy(&output.stderr);
                assert!(said.contains("interrupted; what is done is kept"), "{said}");
                assert_eq!(unfinished(&project), Vec::<String>::new());
                let done = said.lines().filter(|line| line.contains("s  ")).count();
                let again = project.kiln(&["bake"]).expect(0).err;
                let rest = again.lines().filter(|line| line.contains("s  ")).count();
                assert!(done == 0 || !again.contains("r0/maps"), "done before: {said}, done again: {again}");
                ended += usize::from(done > 0 && rest > 0);
            }
            // Before kiln listens, or after all was done.
            code => assert!(code.is_none() || code == Some(0), "{code:?}"),
        }
        ends_well(&project, &references[0]);
        if ended == 3 {
            return;
        }
    }
    assert!(ended > 0, "no signal came while kiln worked");
}

/// A small file system in memory; `None` where one may not mount.
struct Mounted(PathBuf);

impl Mounted {
    fn new(at: &Path, options: &str) -> Option<Self> {
        std::fs::create_dir_all(at).expect("a folder");
        let mount = Command::new("mount").args(["-t", "tmpfs", "-o", options, "tmpfs"]).arg(at).output();
        if mount.is_ok_and(|output| output.status.success()) {
            return Some(Mounted(at.to_path_buf()));
        }
        println!("skipped: one may not mount a file system here");
        None
    }

    fn again(&self, options: &str) {
        let options = format!("remount,{options}");
        let mount = Command::new("mount").args(["-o", &options]).arg(&self.0).status();
        assert!(mount.is_ok_and(|status| status.success()), "remount");
    }
}

impl Drop for Mounted {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg("-l").arg(&self.0).status();
    }
}

#[test]
fn a_full_disk_is_said_and_leaves_nothing_half_written() {
    let references = references(3, &[0]);
    for folder in ["out", ".kiln"] {
        for size in ["4k", "24k", "60k"] {
            let project = small_project(3);
            let Some(disk) = Mounted::new(&project.path(folder), &format!("size={size}")) else { return };
            let ran = project.kiln(&["bake", "-k"]).expect(1);
            assert!(ran.err.contains("cannot write") && ran.err.contains("o space left"), "{}", ran.err);
            assert_eq!(unfinished(&project), Vec::<String>::new(), "{size} for {folder}");
            for (file, bytes) in project.contents("out") {
                assert!(references[0][&file] == bytes, "{file} with {size} for {folder}");
            }
            disk.again("size=10m");
            ends_well(&project, &references[0]);
        }
    }
}

#[test]
fn a_read_only_output_folder_is_said() {
    let references = references(2, &[0]);
    let project = small_project(2);
    let Some(disk) = Mounted::new(&project.path("out"), "size=10m,ro") else { return };
    let ran = project.kiln(&["bake"]).expect(1);
    assert!(ran.err.contains("cannot write out/r") && ran.err.to_lowercase().contains("read-only"), "{}", ran.err);
    disk.again("rw");
    let ran = project.kiln(&["bake", "-v"]).expect(0);
    assert!(ran.err.contains("cache"), "what was made is not made again: {}", ran.err);
    ends_well(&project, &references[0]);
}

#[test]
fn a_cache_that_may_only_be_read_is_used_as_far_as_it_goes() {
    let references = references(2, &[0, 90]);
    let first = small_project(2);
    first.kiln(&["bake", "-q"]).expect(0);
    let shared = first.path("shared");
    let Some(disk) = Mounted::new(&shared, "size=10m") else { return };
    let shared = shared.display().to_string();
    first.kiln(&["cache", "export", &shared]).expect(0);
    disk.again("ro");
    let project = small_project(2);
    let bake = || project.kiln(&["bake", "--cache", &shared]).expect(0);
    assert!(bake().out.contains(" 0 steps run"));
    assert_eq!(project.contents("out"), references[0]);
    project.write(SAMPLE, picture(SIDE, 90));
    let ran = bake();
    assert!(ran.err.contains("artefacts were not kept"), "{}", ran.err);
    assert_eq!(project.contents("out"), references[1]);
    assert!(bake().out.starts_with("nothing to do"));
}

#[test]
fn an_input_that_cannot_be_read_is_named() {
    let references = references(2, &[0]);
    let project = small_project(2);
    project.kiln(&["bake", "-q"]).expect(0);
    let sample = project.path(SAMPLE);
    let spoil: [&dyn Fn(); 3] = [
        &|| std::os::unix::fs::symlink(&sample, &sample).expect("a link to itself"),
        &|| std::fs::create_dir(&sample).expect("a folder"),
        &|| {},
    ];
    for spoil in spoil {
        std::fs::remove_file(&sample).expect("a file");
        spoil();
        let ran = project.kiln(&["bake"]).expect(1);
        assert!(ran.err.contains("recipes/e.png"), "{}", ran.err);
        assert_eq!(project.contents("out"), references[0], "outputs of before stay");
        let _ = std::fs::remove_dir(&sample);
        let _ = std::fs::remove_file(&sample);
        project.write(SAMPLE, picture(SIDE, 0));
        ends_well(&project, &references[0]);
    }
}

fn set_time(path: &Path, time: SystemTime) {
    let file = std::fs::File::options().append(true).open(path).expect("a file");
    file.set_modified(time).expect("a time");
}

#[test]
fn clocks_that_go_back_or_are_wrong_hide_no_change() {
    let references = references(2, &[0, 90]);
    let project = small_project(2);
    let sample = project.path(SAMPLE);
    let now = SystemTime::now();
    let (year, day) = (Duration::from_secs(365 * 86_400), Duration::from_secs(86_400));
    ends_well(&project, &references[0]);
    // Back and back again: each edit is older than the one before. The length is always the same.
    for back in 1..5u32 {
        let phase = back as usize % 2;
        project.write(SAMPLE, picture(SIDE, phase as u32 * 90));
        set_time(&sample, now - day * back);
        ends_well(&project, &references[phase]);
    }
    // From the future, and always the same time: such a stamp tells nothing.
    for turn in 1..5u32 {
        let phase = turn as usize % 2;
        std::fs::write(&sample, picture(SIDE, phase as u32 * 90)).expect("a file");
        set_time(&sample, now + year);
        ends_well(&project, &references[phase]);
    }
    // kiln's own files and outputs from the future.
    for file in [project.files(".kiln"), project.files("out")].concat() {
        set_time(&project.path(&file), now + year);
    }
    project.write(SAMPLE, picture(SIDE, 90));
    ends_well(&project, &references[1]);
}

#[test]
fn inputs_that_change_during_a_bake_get_nothing_wrong_into_the_cache() {
    let phases = [0, 90];
    let references = references(1, &phases);
    let project = small_project(1);
    let mut noticed = 0;
    for _ in 0..20 {
        let _ = std::fs::remove_dir_all(project.path(".kiln"));
        let over = AtomicBool::new(false);
        std::thread::scope(|scope| {
            scope.spawn(|| {
                let other = project.path("other.png");
                for turn in 0.. {
                    // An editor that saves by renaming, ever again.
                    std::fs::write(&other, picture(SIDE, phases[turn % 2])).expect("a file");
                    std::fs::rename(&other, project.path(SAMPLE)).expect("a file");
                    std::thread::sleep(Duration::from_micros(300));
                    if over.load(Ordering::Relaxed) {
                        return;
                    }
                }
            });
            let ran = project.kiln(&["bake"]);
            over.store(true, Ordering::Relaxed);
            assert!(ran.code == 0 || ran.code == 1, "{}", ran.err);
            noticed += usize::from(ran.err.contains("changed during the"));
        });
        for (phase, reference) in phases.iter().zip(&references) {
            project.write(SAMPLE, picture(SIDE, *phase));
            project.kiln(&["bake", "-q"]).expect(0);
            assert!(project.contents("out") == *reference, "something wrong got into the cache");
        }
    }
    assert!(noticed > 0, "no bake noticed anything");
    ends_well(&project, &references[1]);
}

#[test]
fn kilns_side_by_side_on_one_tree_do_no_harm() {
    let references = references(4, &[0, 90]);
    let project = small_project(4);
    for turn in 0..6 {
        project.write(SAMPLE, picture(SIDE, turn % 2 * 90));
        if turn > 2 {
            let _ = std::fs::remove_dir_all(project.path(".kiln/cache"));
        }
        let kilns: Vec<_> = (0..4).map(|_| project.start(&["bake", "-j2"])).collect();
        for kiln in kilns {
            let output = kiln.wait_with_output().expect("a child");
            assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        }
        ends_well(&project, &references[turn as usize % 2]);
    }
}
