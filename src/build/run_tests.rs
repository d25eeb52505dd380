//! How a run goes: what starts first, what may run side by side, how it ends early, what it leaves.

use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use super::world::{MemoryDisk, later, options};
use super::*;
use crate::disk::{Disk, Memory};

/// A step that notes when it begins and how many are under way.
struct Timed {
    name: String,
    sleep: Duration,
    memory: u64,
    log: Arc<Log>,
}

#[derive(Default)]
struct Log {
    begun: Mutex<Vec<String>>,
    running: AtomicUsize,
    most: AtomicUsize,
}

impl Step for Timed {
    fn name(&self) -> String {
        self.name.clone()
    }
    fn kind(&self) -> &'static str {
        "timed"
    }
    fn revision(&self) -> u32 {
        1
    }
    fn describe(&self, visitor: &mut dyn Visitor) {
        visitor.param("name", &self.name);
    }
    fn memory(&self, _: &[u64]) -> u64 {
        self.memory
    }
    fn run(&self, _: &Inputs) -> Result<Vec<u8>, StepError> {
        self.log.begun.lock().unwrap().push(self.name.clone());
        let running = self.log.running.fetch_add(1, Ordering::SeqCst) + 1;
        self.log.most.fetch_max(running, Ordering::SeqCst);
        std::thread::sleep(self.sleep);
        self.log.running.fetch_sub(1, Ordering::SeqCst);
        Ok(self.name.as_bytes().to_vec())
    }
}

/// Chains of steps: for each name, how long each of its two steps sleeps in ms.
fn chains(of: &[(&str, u64)], memory: u64) -> (Graph, Arc<Log>) {
    let (mut graph, log) = (Graph::new(), Arc::new(Log::default()));
    for &(name, ms) in of {
        let step = |n| Timed { name: format!("{name}{n}"), sleep: Duration::from_millis(ms), memory, log: log.clone() };
        let file = graph.add_file(format!("in/{name}"));
        let first = graph.add_step(Box::new(step(1)), &[file]);
        let second = graph.add_step(Box::new(step(2)), &[first.into()]);
        graph.add_output(second, format!("out/{name}"));
    }
    (graph, log)
}

fn inputs(of: &[(&str, u64)]) -> MemoryDisk {
    let disk = MemoryDisk::new(&[]);
    of.iter().for_each(|(name, _)| disk.put(&format!("in/{name}"), "x"));
    disk.tick();
    disk
}

#[test]
fn the_longest_path_starts_first_once_its_length_is_known() {
    let of = [("short", 2), ("long", 40), ("middle", 15)];
    let (graph, log) = chains(&of, 0);
    let disk = inputs(&of);
    let build = || run(&graph, &[], &Options { force: true, ..options(1) }, &disk, &Silent).unwrap();
    build();
    let begun = || std::mem::take(&mut *log.begun.lock().unwrap());
    assert_eq!(begun(), ["short1", "short2", "long1", "long2", "middle1", "middle2"], "nothing is known: as added");
    let report = build();
    assert_eq!(begun(), ["long1", "long2", "middle1", "middle2", "short1", "short2"]);
    assert!(report.steps.iter().all(|step| step.expected <= step.duration + Duration::from_millis(200)));
    let long = report.steps.iter().find(|step| step.name == "long1").unwrap();
    assert!(long.expected >= Duration::from_millis(40), "{:?}", long.expected);
}

#[test]
fn a_new_step_is_expected_to_take_as_long_as_others_of_its_kind() {
    let disk = inputs(&[("a", 0), ("b", 0)]);
    later(&chains(&[("a", 30)], 0).0, &disk);
    let (both, _) = chains(&[("a", 30), ("b", 0)], 0);
    let report = later(&both, &disk);
    let b = report.steps.iter().find(|step| step.name == "b1").unwrap();
    assert!(b.expected >= Duration::from_millis(30), "{:?}", b.expected);
}

#[test]
fn steps_that_do_not_fit_into_memory_together_run_one_after_the_other() {
    let of = [("a", 20), ("b", 20), ("c", 20), ("d", 20)];
    for (memory, most) in [(u64::MAX, 4), (250, 2), (10, 1)] {
        let (graph, log) = chains(&of, 100);
        let report = run(&graph, &[], &Options { memory, ..options(4) }, &inputs(&of), &Silent).unwrap();
        assert!(report.is_success());
        let ran = log.most.load(Ordering::SeqCst);
        assert!(ran <= most && (ran > 1 || most == 1), "{ran} steps of 100 bytes side by side in {memory} bytes");
    }
}

/// Asks for the end when a certain step is done.
struct EndAfter(&'static str, Arc<std::sync::atomic::AtomicBool>);

impl Progress for EndAfter {
    fn done(&self, step: &StepReport) {
        if step.name == self.0 {
            self.1.store(true, Ordering::Relaxed);
        }
    }
}

#[test]
fn an_interrupted_run_keeps_what_is_done_and_the_next_one_goes_on() {
    let of = [("a", 0), ("b", 0), ("c", 0)];
    let (graph, disk) = (chains(&of, 0).0, inputs(&of));
    let options = options(1);
    let progress = EndAfter("b1", options.interrupt.clone());
    let report = run(&graph, &[], &options, &disk, &progress).unwrap();
    assert!(report.interrupted && !report.is_success());
    assert_eq!(report.ran().collect::<Vec<_>>(), ["a1", "a2", "b1"]);
    assert_eq!((disk.text("out/a").as_deref(), disk.text("out/b")), (Some("a2"), None));
    let report = later(&graph, &disk);
    assert!(report.is_success() && !report.interrupted);
    assert_eq!(report.ran().collect::<Vec<_>>(), ["b2", "c1", "c2"]);
}

#[test]
fn outputs_of_removed_recipes_are_reported_and_removed_on_request() {
    let of = [("a", 0), ("b", 0), ("c", 0)];
    let disk = inputs(&of);
    later(&chains(&of, 0).0, &disk);
    disk.put("out/c", "edited by hand");
    let rest = chains(&of[..1], 0).0;
    let with = |prune| {
        disk.tick();
        run(&rest, &[], &Options { prune, whole_tree: true, ..options(1) }, &disk, &Silent).unwrap()
    };
    assert_eq!(
        later(&rest, &disk).dead_outputs,
        Vec::<PathBuf>::new(),
        "a part of the tree knows nothing of the others"
    );
    for _ in 0..2 {
        let report = with(false);
        assert!(report.is_noop());
        assert_eq!(report.dead_outputs, [PathBuf::from("out/b")], "what somebody else wrote is not ours");
        assert_eq!(disk.text("out/b").as_deref(), Some("b2"));
    }
    assert_eq!(with(true).dead_outputs, [PathBuf::from("out/b")]);
    assert_eq!(disk.paths("out"), ["out/a", "out/c"].map(PathBuf::from));
    assert_eq!(with(false).dead_outputs, Vec::<PathBuf>::new());
    // The cache still knows them.
    assert_eq!(later(&chains(&of, 0).0, &disk).ran().count(), 0);
    assert_eq!(disk.text("out/b").as_deref(), Some("b2"));
}

#[test]
fn what_a_killed_run_left_unfinished_is_removed_unless_somebody_writes_it() {
    let disk = Memory::new();
    disk.write("in/a".as_ref(), b"a").unwrap();
    let unfinished = |name: &str| {
        let path = PathBuf::from(format!("out/.kiln-tmp-{name}"));
        disk.write(&path, b"ha").unwrap();
        path
    };
    let mtime_ns = |path: &PathBuf| disk.stamp(path).unwrap().unwrap().mtime_ns;
    let (old, busy, now, new) = (unfinished("1"), unfinished("2"), unfinished("3"), unfinished("4"));
    let writer = disk.try_lock(&busy).unwrap();
    let left_by = |clean: Option<i128>| {
        disk.pass(Duration::from_secs(10));
        run(&chains(&[("a", 0)], 0).0, &[], &Options { clean, ..options(1) }, &disk, &Silent).unwrap();
        let mut left = disk.list("out".as_ref()).unwrap();
        left.retain(|path| !path.ends_with("a"));
        left
    };
    assert_eq!(left_by(None), [&old, &busy, &now, &new].map(PathBuf::clone));
    // One may be killed and the next begin within one tick of the clock.
    let begun = Some(mtime_ns(&now));
    assert_eq!(left_by(begun), [&busy, &new].map(PathBuf::clone));
    drop(writer);
    assert_eq!(left_by(begun), [new]);
}

#[test]
fn trimming_spares_what_is_used_longest() {
    let disk = MemoryDisk::new(&[]);
    let cache = Cache::new(&disk, "cache");
    let texts = ["oldest", "middle", "newest"];
    let digest = |text: &str| Digest::of(text.as_bytes());
    for text in texts {
        let record = Record { artefact: digest(text), len: 6, wall_ms: 1 };
        cache.store(&digest(&format!("{text} key")), &record, text.as_bytes()).unwrap();
        disk.tick();
    }
    let left = || texts.map(|text| cache.has(&digest(text), 6));
    // A tick is ten seconds: the middle one is older than 15, the oldest is used here.
    cache.trim(None, Some(Duration::from_secs(15)), &[digest("oldest")]).unwrap();
    assert_eq!(left(), [true, false, true]);
    cache.trim(Some(6), None, &[digest("oldest")]).unwrap();
    assert_eq!(left(), [true, false, false]);
    // Reading is use.
    let record = Record { artefact: digest("newest"), len: 6, wall_ms: 1 };
    cache.store(&digest("newest key"), &record, b"newest").unwrap();
    disk.tick();
    assert!(cache.load(&digest("oldest"), 6).is_some());
    cache.trim(Some(6), None, &[]).unwrap();
    assert_eq!(left(), [true, false, false]);
}

#[test]
fn a_cache_is_copied_whole_or_as_far_as_it_is_used_and_never_with_damage() {
    let of = [("a", 0), ("b", 0)];
    let disk = inputs(&of);
    later(&chains(&of, 0).0, &disk);
    let cache = Cache::new(&disk, ".kiln/cache");
    disk.remove(".kiln/manifest".as_ref()).unwrap();
    later(&chains(&of[..1], 0).0, &disk);
    let used = artefacts(&options(1), &disk);
    let part = cache.copy_to(&Cache::new(&disk, "part"), Some(&used)).unwrap();
    assert_eq!(part, Copied { size: Size { records: 2, blobs: 2, bytes: 4 }, damaged: 0 });
    let blob = disk.paths("part/blobs").remove(0);
    disk.put_unnoticed(&blob, b"??");
    let other = Cache::new(&disk, "other");
    let again = Cache::new(&disk, "part").copy_to(&other, None).unwrap();
    assert_eq!((again.size.records, again.damaged), (1, 1));
    assert!(other.verify().unwrap().is_empty());
    assert_eq!(cache.copy_to(&other, None).unwrap().size.records, 4);
    assert_eq!(other.size().unwrap(), cache.size().unwrap());
    // And it is as good as the first.
    let fresh = Options { cache: "other".into(), manifest: "fresh/manifest".into(), ..options(1) };
    assert_eq!(run(&chains(&of, 0).0, &[], &fresh, &disk, &Silent).unwrap().ran().count(), 0);
}

#[cfg(target_os = "linux")]
#[test]
fn threads_beyond_the_first_are_lent_and_given_back() {
    use std::io::{Read, Write};
    use std::os::fd::AsRawFd;
    let of = [("a", 30), ("b", 30), ("c", 30), ("d", 30)];
    for (tokens, most) in [(0, 1), (1, 2), (9, 4)] {
        let (mut read, mut write) = std::io::pipe().unwrap();
        write.write_all(&b"+++++++++"[..tokens]).unwrap();
        let flags = format!("--jobserver-auth={},{}", read.as_raw_fd(), write.as_raw_fd());
        let jobserver = crate::disk::Jobserver::from_makeflags(&flags).map(Arc::new);
        assert!(jobserver.is_some());
        let (graph, log) = chains(&of, 0);
        let report = run(&graph, &[], &Options { jobserver, ..options(4) }, &inputs(&of), &Silent).unwrap();
        assert!(report.is_success());
        let side_by_side = log.most.load(Ordering::SeqCst);
        assert!(side_by_side <= most && (most == 1 || side_by_side > 1), "{side_by_side} with {tokens} tokens");
        drop(write);
        let mut back = Vec::new();
        read.read_to_end(&mut back).unwrap();
        assert_eq!(back.len(), tokens, "tokens that came back");
    }
}
