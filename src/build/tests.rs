//! The engine in a world in memory, without sleeping.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use super::world::{MemoryDisk, Toy, later, options, ran};
use super::*;
use crate::disk::Disk;

/// ```text
///   a.txt -> upper a -.
///   b.txt -> upper b --> join -> out/join.txt
///                  `-> count b -> note -> out/note.txt
/// ```
fn sample_graph(separator: &str) -> Graph {
    let mut graph = Graph::new();
    let (a, b) = (graph.add_file("a.txt"), graph.add_file("./b.txt"));
    let upper_a = graph.add_step(Box::new(Toy::upper("upper a")), &[a]);
    let upper_b = graph.add_step(Box::new(Toy::upper("upper b")), &[b]);
    let join = graph.add_step(Box::new(Toy::concat("join", separator)), &[upper_a.into(), upper_b.into()]);
    let count = graph.add_step(Box::new(Toy::count("count b")), &[upper_b.into()]);
    let note = graph.add_step(Box::new(Toy::concat("note", "")), &[count.into()]);
    graph.add_output(join, "out/join.txt");
    graph.add_output(note, "out/note.txt");
    graph
}

fn sample_disk() -> MemoryDisk {
    MemoryDisk::new(&[("a.txt", "moss"), ("b.txt", "stone")])
}

fn built() -> (Graph, MemoryDisk) {
    let (graph, disk) = (sample_graph("+"), sample_disk());
    assert_eq!(ran(&later(&graph, &disk)).len(), 5);
    (graph, disk)
}

/// The state of one step in the plan.
fn state_of(graph: &Graph, disk: &MemoryDisk, name: &str) -> State {
    let plan = plan(graph, &[], &options(1), disk).unwrap();
    plan.into_iter().find(|step| step.name == name).unwrap().state
}

fn run_because(reason: &str) -> State {
    State::Run(vec![reason.to_string()])
}

#[test]
fn builds_everything_and_then_nothing() {
    let (graph, disk) = (sample_graph("+"), sample_disk());
    assert_eq!(state_of(&graph, &disk, "join"), run_because("never built"));
    assert_eq!(ran(&later(&graph, &disk)), ["count b", "join", "note", "upper a", "upper b"]);
    assert_eq!(disk.text("out/join.txt").as_deref(), Some("MOSS+STONE"));
    assert_eq!(disk.text("out/note.txt").as_deref(), Some("5"));
    let second = later(&graph, &disk);
    assert!(second.is_noop() && second.is_success());
    assert_eq!(*disk.reads.lock().unwrap(), [PathBuf::from(".kiln/manifest")], "stamps tell all");
    assert!(disk.writes.lock().unwrap().is_empty());
}

#[test]
fn new_content_rebuilds_exactly_its_cone() {
    let (graph, disk) = built();
    disk.put("a.txt", "fern");
    assert_eq!(state_of(&graph, &disk, "upper a"), run_because("a.txt: content changed"));
    assert_eq!(state_of(&graph, &disk, "join"), State::Maybe(vec!["upper a".to_string()]));
    assert_eq!(state_of(&graph, &disk, "note"), State::UpToDate);
    let report = later(&graph, &disk);
    assert_eq!(ran(&report), ["join", "upper a"]);
    assert_eq!(disk.text("out/join.txt").as_deref(), Some("FERN+STONE"));
    let join = report.steps.iter().find(|step| step.name == "join").unwrap();
    assert_eq!(join.reasons, ["`upper a` gave another artefact"]);
    disk.put("a.txt", "moss");
    let back = later(&graph, &disk);
    assert!(ran(&back).is_empty(), "the cache remembers the old content");
    assert_eq!(disk.text("out/join.txt").as_deref(), Some("MOSS+STONE"));
}

#[test]
fn a_new_stamp_alone_rebuilds_nothing() {
    let (graph, disk) = built();
    disk.put("a.txt", "moss");
    assert!(later(&graph, &disk).is_noop());
    assert!(disk.reads.lock().unwrap().contains(&PathBuf::from("a.txt")), "hashed once");
    assert!(later(&graph, &disk).is_noop());
    assert!(!disk.reads.lock().unwrap().contains(&PathBuf::from("a.txt")), "and not again");
}

#[test]
fn the_same_artefact_wakes_nobody() {
    let (graph, disk) = built();
    disk.put("b.txt", "slate");
    let report = later(&graph, &disk);
    assert_eq!(ran(&report), ["count b", "join", "upper b"], "`note` sees the same count");
    assert!(report.is_success());
}

#[test]
fn a_file_edited_twice_within_the_clock_is_hashed_again() {
    let (graph, disk) = (sample_graph("+"), sample_disk());
    run(&graph, &[], &options(1), &disk, &Silent).unwrap();
    disk.put_unnoticed(Path::new("a.txt"), b"fern");
    assert_eq!(ran(&later(&graph, &disk)), ["join", "upper a"], "its stamp was too fresh to be trusted");
    disk.put_unnoticed(Path::new("a.txt"), b"moss");
    assert!(later(&graph, &disk).is_noop(), "after ten seconds a stamp is trusted");
}

#[test]
fn damaged_and_missing_blobs_are_made_again() {
    let (graph, disk) = built();
    let blobs = disk.paths(".kiln/cache/blobs");
    let damages: [&dyn Fn(&Path); 3] = [
        &|path| disk.put_unnoticed(path, &vec![b'#'; disk.read(path, 100).unwrap().len()]),
        &|path| disk.put_unnoticed(path, b"longer than it should ever be"),
        &|path| disk.remove(path).unwrap(),
    ];
    for (round, damage) in damages.iter().enumerate() {
        blobs.iter().for_each(|path| damage(path));
        // `join` must run, and so needs the bytes of both `upper` steps.
        disk.put("a.txt", ["fern", "tree", "leaf"][round]);
        let report = later(&graph, &disk);
        assert!(report.is_success(), "{:?}", report.failures().collect::<Vec<_>>());
        assert_eq!(ran(&report), ["join", "upper a", "upper b"], "round {round}");
        assert_eq!(disk.text("out/join.txt").unwrap(), ["FERN", "TREE", "LEAF"][round].to_string() + "+STONE");
    }
    let plan_after = Cache::new(&disk, ".kiln/cache").verify().unwrap();
    assert!(plan_after.is_empty(), "nothing damaged is left: {plan_after:?}");
}

#[test]
fn lost_artefacts_are_made_again_through_many_levels() {
    let disk = MemoryDisk::new(&[("a.txt", "moss"), ("z.txt", "one")]);
    let mut graph = Graph::new();
    let mut last = graph.add_file("a.txt");
    for level in 0..20 {
        let separator = level.to_string();
        let toy = Toy::new(&format!("level {level}"), "level", move |inputs| {
            String::from_utf8_lossy(&inputs[0]).into_owned() + &separator
        });
        let toy = Toy { params: vec![("level", level.to_string())], ..toy };
        last = graph.add_step(Box::new(toy), &[last]).into();
    }
    let z = graph.add_file("z.txt");
    let end = graph.add_step(Box::new(Toy::concat("end", " ")), &[last, z, last]);
    graph.add_output(end, "out/end.txt");
    for (hold_bytes, word) in [(1 << 30, "one"), (0, "two"), (0, "three")] {
        disk.put("z.txt", word);
        // Damage that stamps do not show, so that the loss is found out only on reading.
        disk.paths(".kiln/cache/blobs").iter().for_each(|path| {
            let bytes = disk.read(path, 1000).unwrap();
            disk.put_unnoticed(path, &vec![b'#'; bytes.len()]);
        });
        disk.tick();
        let report = run(&graph, &[], &Options { hold_bytes, ..options(2) }, &disk, &Silent).unwrap();
        assert!(report.is_success(), "{:?}", report.failures().collect::<Vec<_>>());
        assert_eq!(ran(&report).len(), 21, "{word}");
        let made = "moss012345678910111213141516171819";
        assert_eq!(disk.text("out/end.txt").unwrap(), format!("{made} {word} {made}"));
    }
}

#[test]
fn a_damaged_blob_with_a_removed_output_is_made_again() {
    let (graph, disk) = built();
    disk.remove(Path::new("out/join.txt")).unwrap();
    disk.paths(".kiln/cache/blobs").iter().for_each(|path| disk.remove(path).unwrap());
    let reasons = ["output out/join.txt missing", "artefact missing from cache"].map(String::from).to_vec();
    assert_eq!(state_of(&graph, &disk, "join"), State::Run(reasons));
    assert_eq!(state_of(&graph, &disk, "upper b"), run_because("artefact missing from cache"));
    assert_eq!(state_of(&graph, &disk, "note"), State::UpToDate, "nobody asks for its bytes");
    assert_eq!(ran(&later(&graph, &disk)), ["join", "upper a", "upper b"]);
    assert_eq!(disk.text("out/join.txt").as_deref(), Some("MOSS+STONE"));
}

#[test]
fn outputs_are_restored_without_running() {
    let (graph, disk) = built();
    disk.remove(Path::new("out/join.txt")).unwrap();
    disk.put("out/note.txt", "scribble");
    let missing = vec!["output out/join.txt missing".to_string()];
    assert_eq!(state_of(&graph, &disk, "join"), State::Restore(missing));
    let differs = vec!["output out/note.txt: content differs".to_string()];
    assert_eq!(state_of(&graph, &disk, "note"), State::Restore(differs));
    let report = later(&graph, &disk);
    assert!(ran(&report).is_empty() && report.is_success() && !report.is_noop());
    assert_eq!(disk.text("out/join.txt").as_deref(), Some("MOSS+STONE"));
    assert_eq!(disk.text("out/note.txt").as_deref(), Some("5"));
    assert!(report.outputs.iter().all(|output| output.written && output.digest.is_some()));
    disk.put("out/note.txt", "5");
    assert!(later(&graph, &disk).is_noop(), "rewritten by somebody with the right content");
}

#[test]
fn parameters_and_revisions_are_explained() {
    let (_, disk) = built();
    let changed = sample_graph("-");
    let reason = "`separator` changed from \"+\" to \"-\"";
    assert_eq!(state_of(&changed, &disk, "join"), run_because(reason));
    assert_eq!(state_of(&changed, &disk, "upper a"), State::UpToDate);
    let one_step = |change: &dyn Fn(&mut Toy)| {
        let mut graph = Graph::new();
        let a = graph.add_file("a.txt");
        let mut toy = Toy::upper("upper a");
        change(&mut toy);
        graph.add_step(Box::new(toy), &[a]);
        state_of(&graph, &disk, "upper a")
    };
    assert_eq!(one_step(&|_| ()), State::UpToDate);
    assert_eq!(one_step(&|toy| toy.revision = 4), run_because("step revision 1 -> 4"));
    assert_eq!(one_step(&|toy| toy.kind = "higher"), run_because("step kind upper -> higher"));
    let with = one_step(&|toy| toy.params.push(("jumps", "3".to_string())));
    assert_eq!(with, run_because("`jumps` is new: \"3\""));
}

#[test]
fn changed_inputs_are_explained() {
    let (_, disk) = built();
    disk.put("c.txt", "new");
    let mut graph = Graph::new();
    let (a, c) = (graph.add_file("a.txt"), graph.add_file("c.txt"));
    let upper_a = graph.add_step(Box::new(Toy::upper("upper a")), &[a]);
    graph.add_step(Box::new(Toy::concat("join", "+")), &[upper_a.into(), c]);
    let reasons = ["c.txt: new input", "upper b: no longer an input"].map(String::from).to_vec();
    assert_eq!(state_of(&graph, &disk, "join"), State::Run(reasons));
}

#[test]
fn identical_steps_are_merged() {
    let mut graph = Graph::new();
    let sample = graph.add_file("sample.txt");
    let runs = Arc::new(AtomicUsize::new(0));
    for recipe in 0..10 {
        let count = runs.clone();
        let analyse = Toy::new(&format!("{recipe}/analyse"), "analyse", move |_| {
            count.fetch_add(1, Ordering::Relaxed);
            "analysed".to_string()
        });
        let analyse = graph.add_step(Box::new(analyse), &[sample]);
        let bake =
            graph.add_step(Box::new(Toy::concat(&format!("{recipe}/bake"), &recipe.to_string())), &[analyse.into()]);
        graph.add_output(bake, format!("out/{recipe}"));
    }
    assert_eq!(graph.step_count(), 11);
    assert!(later(&graph, &MemoryDisk::new(&[("sample.txt", "x")])).is_success());
    assert_eq!(runs.load(Ordering::Relaxed), 1);
}

#[test]
fn only_targets_and_what_they_need_are_built() {
    let (graph, disk) = (sample_graph("+"), sample_disk());
    let (note, _) = graph.outputs().nth(1).unwrap();
    let report = run(&graph, &[note], &options(2), &disk, &Silent).unwrap();
    assert_eq!(ran(&report), ["count b", "note", "upper b"]);
    assert_eq!(disk.text("out/join.txt"), None);
    assert_eq!(ran(&later(&graph, &disk)), ["join", "upper a"]);
    let report = run(&graph, &[note], &options(2), &disk, &Silent).unwrap();
    assert!(report.is_noop() && report.steps.len() == 3);
    assert!(later(&graph, &disk).is_noop(), "a partial run keeps the records of the rest");
}

/// `good` and `other` do not depend on `bad`, `after` does.
fn failing_graph(bad: Toy) -> Graph {
    let mut graph = Graph::new();
    let a = graph.add_file("a.txt");
    let bad = graph.add_step(Box::new(bad), &[a]);
    let good = graph.add_step(Box::new(Toy::upper("good")), &[a]);
    let after = graph.add_step(Box::new(Toy::concat("after", "")), &[bad.into(), good.into()]);
    let last = graph.add_step(Box::new(Toy::concat("last", "")), &[after.into()]);
    let other = graph.add_step(Box::new(Toy::count("other")), &[good.into()]);
    graph.add_output(last, "out/last.txt");
    graph.add_output(other, "out/other.txt");
    graph
}

fn outcome<'a>(report: &'a Report, name: &str) -> &'a Outcome {
    &report.steps.iter().find(|step| step.name == name).unwrap().outcome
}

#[test]
fn a_failure_stops_everything_or_only_what_depends_on_it() {
    let graph = failing_graph(Toy::fails("bad"));
    let stopped = run(&graph, &[], &options(1), &sample_disk(), &Silent).unwrap();
    assert!(!stopped.is_success());
    assert!(matches!(outcome(&stopped, "other"), Outcome::Skipped(None)));
    let disk = sample_disk();
    let options = Options { keep_going: true, ..options(1) };
    let report = run(&graph, &[], &options, &disk, &Silent).unwrap();
    assert_eq!(ran(&report), ["good", "other"]);
    assert_eq!(report.failures().collect::<Vec<_>>(), ["step `bad`: the moss is too wet"]);
    for name in ["after", "last"] {
        assert!(matches!(outcome(&report, name), Outcome::Skipped(Some(culprit)) if culprit == "bad"), "{name}");
    }
    assert_eq!(disk.text("out/other.txt").as_deref(), Some("4"));
    assert_eq!(disk.text("out/last.txt"), None);
    let again = run(&graph, &[], &options, &disk, &Silent).unwrap();
    assert!(ran(&again).is_empty() && !again.is_success(), "failures are tried again, successes kept");
    assert_eq!(state_of(&graph, &disk, "bad"), run_because("never built"));
}

#[test]
fn a_panic_is_a_failure_of_its_step() {
    let bad = Toy::new("bad", "bad", |_| {
        let nested: Vec<usize> = crate::numerics::par::map(1000, |i| if i == 700 { panic!("texel {i}") } else { i });
        nested.len().to_string()
    });
    let report = later(&failing_graph(bad), &sample_disk());
    let failures: Vec<String> = report.failures().collect();
    assert_eq!(failures, ["step `bad`: panicked: texel 700 (this is a bug in kiln)"]);
}

#[test]
fn a_missing_input_is_named_before_anything_runs() {
    let (graph, disk) = (sample_graph("+"), sample_disk());
    disk.remove(Path::new("b.txt")).unwrap();
    let report = later(&graph, &disk);
    assert!(ran(&report).is_empty());
    assert_eq!(report.failures().collect::<Vec<_>>(), ["step `upper b`: input file b.txt does not exist"]);
    assert!(matches!(outcome(&report, "note"), Outcome::Skipped(Some(culprit)) if culprit == "upper b"));
    let kept_going = run(&graph, &[], &Options { keep_going: true, ..options(2) }, &disk, &Silent).unwrap();
    assert_eq!(ran(&kept_going), ["upper a"]);
    assert_eq!(state_of(&graph, &disk, "upper b"), State::Broken("input file b.txt does not exist".to_string()));
    assert_eq!(state_of(&graph, &disk, "note"), State::Broken("`count b` cannot run".to_string()));
}

#[test]
fn contradictions_in_the_graph_are_refused() {
    let refused = |build: &dyn Fn(&mut Graph)| {
        let mut graph = sample_graph("+");
        build(&mut graph);
        run(&graph, &[], &options(1), &sample_disk(), &Silent).unwrap_err().to_string()
    };
    let step = |graph: &mut Graph, name| {
        let a = graph.add_file("a.txt");
        graph.add_step(Box::new(Toy::count(name)), &[a])
    };
    let same_name = refused(&|graph| {
        step(graph, "join");
    });
    assert!(same_name.contains("called `join`"), "{same_name}");
    let twice = refused(&|graph| {
        let step = step(graph, "new");
        graph.add_output(step, "out//./join.txt");
    });
    assert!(twice.contains("out/join.txt: written by both `join` and `new`"), "{twice}");
    let over = refused(&|graph| {
        let step = step(graph, "new");
        graph.add_output(step, "b.txt");
    });
    assert!(over.contains("b.txt: `new` would overwrite"), "{over}");
}

/// 40 layers of 10 steps that read two of the layer before.
fn lattice() -> Graph {
    let mut graph = Graph::new();
    let mut layer: Vec<InputId> = (0..10).map(|i| graph.add_file(format!("in/{i}"))).collect();
    for depth in 0..40 {
        layer = (0..10)
            .map(|i| {
                let toy = Toy::new(&format!("{depth}/{i}"), "mix", |inputs| {
                    let parts: Vec<u64> = crate::numerics::par::map(300, |k| {
                        inputs[0]
                            .iter()
                            .chain(&inputs[1])
                            .fold(k as u64, |sum, byte| sum * 31 % 65521 + u64::from(*byte))
                    });
                    parts.iter().sum::<u64>().to_string()
                });
                let toy = Toy { params: vec![("at", format!("{depth} {i}"))], ..toy };
                graph.add_step(Box::new(toy), &[layer[i], layer[(i * 3 + depth) % 10]]).into()
            })
            .collect();
    }
    let end = graph.add_step(Box::new(Toy::concat("end", "\n")), &layer);
    graph.add_output(end, "out/end");
    graph
}

#[test]
fn threads_and_memory_do_not_change_results() {
    let results: Vec<(Option<String>, Vec<Option<Digest>>)> = [(1, 1 << 30), (8, 1 << 30), (8, 0)]
        .map(|(jobs, hold_bytes)| {
            let disk = MemoryDisk::new(&[]);
            (0..10).for_each(|i| disk.put(&format!("in/{i}"), &format!("input {i}")));
            let report = run(&lattice(), &[], &Options { hold_bytes, ..options(jobs) }, &disk, &Silent).unwrap();
            assert_eq!(report.ran().count(), 401);
            assert!(Cache::new(&disk, ".kiln/cache").verify().unwrap().is_empty());
            (disk.text("out/end"), report.steps.iter().map(|step| step.artefact).collect())
        })
        .into();
    assert!(results[0].0.is_some());
    assert!(results[0] == results[1] && results[0] == results[2]);
}

#[test]
fn a_damaged_manifest_costs_looks_not_runs() {
    let (graph, disk) = built();
    let manifest = Path::new(".kiln/manifest");
    let whole = disk.read(manifest, 1 << 20).unwrap();
    for damaged in [&whole[..whole.len() / 2], b"", b"KILNMAN1 but nothing else that makes sense here, not at all"] {
        disk.put_unnoticed(manifest, damaged);
        let report = later(&graph, &disk);
        assert!(report.is_noop(), "everything is in the cache");
        assert_eq!(disk.read(manifest, 1 << 20).unwrap().len(), whole.len(), "written anew");
    }
}

#[test]
fn an_input_that_changes_during_the_run_is_noticed() {
    // Between the survey and the reading by the step: the step is not given what was not hashed.
    let (graph, disk) = (sample_graph("+"), sample_disk());
    let reads = AtomicUsize::new(0);
    let hook = move |disk: &MemoryDisk, path: &Path| {
        if path == Path::new("b.txt") && reads.fetch_add(1, Ordering::Relaxed) == 1 {
            disk.put("b.txt", "other");
        }
    };
    *disk.before_read.lock().unwrap() = Some(Arc::new(Box::new(hook)));
    let report = later(&graph, &disk);
    assert_eq!(report.failures().collect::<Vec<_>>(), ["step `upper b`: b.txt changed during the run; run again"]);
    assert_eq!(report.changed_inputs, [PathBuf::from("b.txt")]);
    let after = later(&graph, &disk);
    assert!(after.is_success() && after.changed_inputs.is_empty());
    assert_eq!(disk.text("out/join.txt").as_deref(), Some("MOSS+OTHER"));
}

#[test]
fn an_input_that_changes_after_it_was_read_is_noticed() {
    let disk = Arc::new(sample_disk());
    let mut graph = Graph::new();
    let a = graph.add_file("a.txt");
    let editor = disk.clone();
    let toy = Toy::new("slow", "slow", move |inputs| {
        if inputs[0] == *b"moss" {
            editor.put("a.txt", "fern");
        }
        String::from_utf8_lossy(&inputs[0]).into_owned()
    });
    let slow = graph.add_step(Box::new(toy), &[a]);
    graph.add_output(slow, "out/slow.txt");
    let report = later(&graph, &disk);
    assert_eq!(report.changed_inputs, [PathBuf::from("a.txt")]);
    assert_eq!(disk.text("out/slow.txt").as_deref(), Some("moss"), "right for what was read");
    let report = later(&graph, &disk);
    assert_eq!((ran(&report), report.changed_inputs.len()), (vec!["slow"], 0));
    assert_eq!(disk.text("out/slow.txt").as_deref(), Some("fern"));
}

#[test]
fn a_step_that_gives_other_bytes_fails_once_and_heals() {
    let disk = sample_disk();
    let mut graph = Graph::new();
    let (a, b) = (graph.add_file("a.txt"), graph.add_file("b.txt"));
    let calls = AtomicUsize::new(0);
    let moody = Toy::new("moody", "moody", move |_| calls.fetch_add(1, Ordering::Relaxed).min(1).to_string());
    let moody = graph.add_step(Box::new(moody), &[a]);
    let end = graph.add_step(Box::new(Toy::concat("end", " ")), &[moody.into(), b]);
    graph.add_output(end, "out/end.txt");
    assert!(later(&graph, &disk).is_success());
    disk.paths(".kiln/cache/blobs").iter().for_each(|path| disk.remove(path).unwrap());
    disk.put("b.txt", "slate");
    let report = later(&graph, &disk);
    let failures: Vec<String> = report.failures().collect();
    assert!(failures.len() == 1 && failures[0].contains("gave other bytes than before"), "{failures:?}");
    assert_eq!(disk.text("out/end.txt").as_deref(), Some("0 stone"));
    assert!(later(&graph, &disk).is_success());
    assert_eq!(disk.text("out/end.txt").as_deref(), Some("1 slate"));
}

#[test]
fn a_full_disk_fails_the_step_and_leaves_outputs_alone() {
    let (graph, disk) = built();
    disk.put("a.txt", "fern");
    *disk.full.lock().unwrap() = Some(PathBuf::from("out"));
    let report = later(&graph, &disk);
    let failures: Vec<String> = report.failures().collect();
    assert!(failures.len() == 1 && failures[0].starts_with("step `join`: cannot write out/join.txt: "), "{failures:?}");
    assert_eq!(disk.text("out/join.txt").as_deref(), Some("MOSS+STONE"));
    *disk.full.lock().unwrap() = Some(PathBuf::from(".kiln"));
    let failures: Vec<String> = later(&sample_graph("-"), &disk).failures().collect();
    assert!(failures[0].starts_with("step `join`: cannot write the cache: "), "{failures:?}");
    *disk.full.lock().unwrap() = None;
    let report = later(&graph, &disk);
    assert!(report.is_success() && ran(&report).is_empty(), "only the copy is left to do");
    assert_eq!(disk.text("out/join.txt").as_deref(), Some("FERN+STONE"));
}

#[test]
fn forcing_and_dry_runs() {
    let (graph, disk) = built();
    disk.put("a.txt", "fern");
    disk.forget_calls();
    let dry = run(&graph, &[], &Options { dry_run: true, ..options(2) }, &disk, &Silent).unwrap();
    let would: Vec<&str> =
        dry.steps.iter().filter(|step| matches!(step.outcome, Outcome::WouldRun)).map(|s| &*s.name).collect();
    assert_eq!(would, ["upper a", "join"]);
    assert!(disk.writes.lock().unwrap().is_empty());
    let forced = run(&graph, &[], &Options { force: true, ..options(2) }, &disk, &Silent).unwrap();
    assert_eq!(forced.ran().count(), 5);
    assert_eq!(disk.text("out/join.txt").as_deref(), Some("FERN+STONE"));
}

#[test]
fn the_whole_tree_forgets_others() {
    let (graph, disk) = built();
    let (note, _) = graph.outputs().nth(1).unwrap();
    let small = || {
        let mut graph = Graph::new();
        let a = graph.add_file("a.txt");
        graph.add_step(Box::new(Toy::count("single")), &[a]);
        graph
    };
    assert_eq!(ran(&later(&small(), &disk)), ["single"]);
    assert!(run(&graph, &[note], &options(1), &disk, &Silent).unwrap().is_noop());
    let size = || disk.read(Path::new(".kiln/manifest"), 1 << 20).unwrap().len();
    let before = size();
    disk.put("a.txt", "fern");
    run(&small(), &[], &Options { whole_tree: true, ..options(1) }, &disk, &Silent).unwrap();
    assert!(size() < before / 2, "{} of {before} bytes", size());
}

#[test]
fn the_cache_can_be_measured_verified_and_cleared() {
    let (graph, disk) = built();
    let cache = Cache::new(&disk, ".kiln/cache");
    let size = cache.size().unwrap();
    // MOSS, STONE, MOSS+STONE, and 5 twice.
    assert_eq!(size, Size { records: 5, blobs: 4, bytes: 4 + 5 + 10 + 1 });
    let blob = disk.paths(".kiln/cache/blobs").remove(0);
    disk.put_unnoticed(&blob, b"??????????");
    assert_eq!(cache.verify().unwrap(), [blob]);
    assert_eq!(cache.verify().unwrap(), Vec::<PathBuf>::new());
    assert_eq!(cache.size().unwrap().blobs, 3);
    disk.put(".kiln/cache/blobs/README", "not ours");
    cache.clear().unwrap();
    assert_eq!(cache.size().unwrap(), Size::default());
    assert_eq!(disk.text(".kiln/cache/blobs/README").as_deref(), Some("not ours"));
    assert!(later(&graph, &disk).is_noop(), "the manifest and the outputs still agree");
}

#[test]
fn trimming_starts_with_the_oldest() {
    let disk = MemoryDisk::new(&[]);
    let cache = Cache::new(&disk, "cache");
    let texts = ["oldest", "middle", "newest"];
    let keys = texts.map(|text| Digest::of(&[text.as_bytes(), b" key"].concat()));
    for (key, text) in keys.iter().zip(texts) {
        let record = Record { artefact: Digest::of(text.as_bytes()), len: 6, wall_ms: 1 };
        cache.store(key, &record, text.as_bytes()).unwrap();
        assert_eq!(cache.record(key), Some(record));
        disk.tick();
    }
    assert_eq!(cache.trim(Some(18), None, &[]).unwrap(), Size { records: 3, blobs: 3, bytes: 18 });
    assert_eq!(cache.trim(Some(17), None, &[]).unwrap(), Size { records: 2, blobs: 2, bytes: 12 });
    assert_eq!(keys.map(|key| cache.record(&key).is_some()), [false, true, true]);
    assert_eq!(cache.trim(Some(0), None, &[]).unwrap(), Size::default());
}

#[test]
fn plan_as_json_and_dot() {
    let (graph, disk) = built();
    disk.put("a.txt", "fern");
    let plan = plan(&graph, &[], &options(1), &disk).unwrap();
    let json: serde_json::Value = serde_json::from_str(&to_json(&plan, &[PathBuf::from("out/old")])).unwrap();
    assert_eq!(json["version"], 1);
    assert_eq!(json["dead"][0], "out/old");
    let expected = serde_json::json!({
        "name": "join", "kind": "concat", "state": "maybe", "reasons": [], "waits_for": ["upper a"],
        "inputs": ["upper a", "upper b"], "outputs": ["out/join.txt"],
    });
    assert_eq!(json["steps"][2], expected);
    assert_eq!(json["steps"][0]["reasons"][0], "a.txt: content changed");
    let dot = to_dot(&plan);
    assert!(dot.contains("\"step upper a\" -> \"step join\";"), "{dot}");
    assert!(dot.contains("\"file a.txt\" [label=\"a.txt\", shape=box];"), "{dot}");
}

#[test]
fn trace_and_depfile() {
    let (graph, disk) = (sample_graph("+"), sample_disk());
    let trace: serde_json::Value = serde_json::from_str(&chrome_trace(&later(&graph, &disk))).unwrap();
    let events = trace["traceEvents"].as_array().unwrap();
    let steps: Vec<_> = events.iter().filter(|event| event["ph"] == "X").collect();
    assert_eq!(steps.len(), 5);
    assert!(steps.iter().all(|step| step["args"]["from_cache"] == false && step["dur"].is_u64()));
    let rules = depfile(&graph, &[], &[PathBuf::from("my recipe.toml")]);
    let expected =
        "out/join.txt: a.txt \\\n  b.txt \\\n  my\\ recipe.toml\nout/note.txt: b.txt \\\n  my\\ recipe.toml\n";
    assert_eq!(rules, expected);
}

#[test]
fn a_no_op_on_ten_thousand_steps_is_quick() {
    let mut graph = Graph::new();
    for recipe in 0..1000 {
        let mut last = graph.add_file(format!("assets/{recipe}.png"));
        for stage in 0..10 {
            let mut toy = Toy::concat(&format!("recipe {recipe}/stage {stage}"), "");
            toy.params.push(("at", format!("{recipe} {stage}")));
            last = graph.add_step(Box::new(toy), &[last]).into();
        }
        let end = graph.add_step(Box::new(Toy::concat(&format!("recipe {recipe}/end"), "!")), &[last]);
        graph.add_output(end, format!("out/{recipe}.png"));
    }
    let disk = MemoryDisk::new(&[]);
    (0..1000).for_each(|recipe| disk.put(&format!("assets/{recipe}.png"), &recipe.to_string()));
    let cold = std::time::Instant::now();
    assert_eq!(later(&graph, &disk).ran().count(), 11_000);
    let cold = cold.elapsed();
    let no_op = || {
        let warm = std::time::Instant::now();
        assert!(later(&graph, &disk).is_noop());
        warm.elapsed()
    };
    let warm = (0..5).map(|_| no_op()).min().unwrap_or_default();
    println!("{} steps: cold {cold:?}, no-op {warm:?} (best of 5)", graph.step_count());
    assert!(warm.as_secs_f64() < 2.0, "ten times the aim, for slow machines: {warm:?}");
}
