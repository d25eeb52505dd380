//! Runs with others that help, forget and lie.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};

use super::world::{MemoryDisk, Toy, ran};
use super::*;

/// Another machine, in memory.
#[derive(Debug, Default)]
struct Others {
    records: Mutex<BTreeMap<Digest, Record>>,
    blobs: Mutex<BTreeMap<Digest, Vec<u8>>>,
    loads: AtomicUsize,
    stored: AtomicUsize,
    executed: Mutex<Vec<String>>,
    /// What workers say to whatever they are asked.
    works: Mutex<Option<Vec<u8>>>,
    given_up: AtomicBool,
}

impl Remote for Others {
    fn record(&self, key: &Digest) -> Option<Record> {
        let up = !self.given_up.load(Ordering::SeqCst);
        up.then(|| self.records.lock().unwrap().get(key).copied()).flatten()
    }
    fn load(&self, _: &Digest, record: &Record) -> Option<Vec<u8>> {
        self.loads.fetch_add(1, Ordering::SeqCst);
        let up = !self.given_up.load(Ordering::SeqCst);
        up.then(|| self.blobs.lock().unwrap().get(&record.artefact).cloned()).flatten()
    }
    fn store(&self, key: &Digest, record: &Record, artefact: &Bytes) {
        self.stored.fetch_add(1, Ordering::SeqCst);
        self.records.lock().unwrap().insert(*key, *record);
        self.blobs.lock().unwrap().insert(record.artefact, artefact.to_vec());
    }
    fn execute(&self, errand: &Errand) -> Option<Vec<u8>> {
        self.executed.lock().unwrap().push(errand.name.to_string());
        self.works.lock().unwrap().clone()
    }
    fn distrust(&self, _: &str) {
        self.given_up.store(true, Ordering::SeqCst);
    }
    fn finish(&self, _: bool) -> Finished {
        let given_up = self.given_up.swap(false, Ordering::SeqCst);
        Finished { said: None, warnings: if given_up { vec!["given up".to_string()] } else { Vec::new() } }
    }
}

/// `a.txt -> upper -> count -> note -> out/note.txt`, and `upper -> shout -> out/shout.txt`.
fn graph(shout: &str) -> Graph {
    let mut graph = Graph::new();
    let file = graph.add_file("a.txt");
    let upper = graph.add_step(Box::new(Toy::upper("upper")), &[file]);
    let count = graph.add_step(Box::new(Toy::count("count")), &[upper.into()]);
    let note = graph.add_step(Box::new(Toy::concat("note", "")), &[count.into()]);
    let shout = graph.add_step(Box::new(Toy::concat("shout", shout)), &[upper.into(), upper.into()]);
    graph.add_output(note, "out/note.txt");
    graph.add_output(shout, "out/shout.txt");
    graph
}

/// A machine with nothing but the source, and the others.
fn machine() -> MemoryDisk {
    MemoryDisk::new(&[("a.txt", "moss")])
}

fn bake(graph: &Graph, disk: &MemoryDisk, others: &Arc<Others>) -> Report {
    disk.tick();
    let options = Options { jobs: 2, remote: Some(others.clone()), ..Options::default() };
    run(graph, &[], &options, disk, &Silent).unwrap()
}

/// All that comes out is right, and then there is nothing to do.
fn ends_well(graph: &Graph, disk: &MemoryDisk, others: &Arc<Others>, between: &str) {
    assert_eq!(disk.text("out/note.txt").as_deref(), Some("4"));
    assert_eq!(disk.text("out/shout.txt"), Some(format!("MOSS{between}MOSS")));
    assert!(bake(graph, disk, others).is_noop());
}

#[test]
fn what_one_machine_made_no_other_makes_and_only_outputs_travel() {
    let others = Arc::new(Others::default());
    let first = machine();
    assert_eq!(ran(&bake(&graph("+"), &first, &others)), ["count", "note", "shout", "upper"]);
    assert_eq!(others.stored.load(Ordering::SeqCst), 4);

    let second = machine();
    let report = bake(&graph("+"), &second, &others);
    assert!(ran(&report).is_empty() && report.is_success() && report.warnings.is_empty());
    assert_eq!(others.loads.load(Ordering::SeqCst), 2, "`upper` and `count` are known by their digests alone");
    assert_eq!(others.stored.load(Ordering::SeqCst), 4);
    ends_well(&graph("+"), &second, &others, "+");

    // Another step wants the bytes of `upper`, which this machine never had.
    let report = bake(&graph("-"), &second, &others);
    assert_eq!(ran(&report), ["shout"]);
    ends_well(&graph("-"), &second, &others, "-");
}

#[test]
fn what_others_have_lost_is_made_here() {
    let others = Arc::new(Others::default());
    bake(&graph("+"), &machine(), &others);
    others.blobs.lock().unwrap().clear();
    let here = machine();
    let report = bake(&graph("+"), &here, &others);
    assert_eq!(ran(&report), ["count", "shout", "upper"], "`note` is the same as `count`");
    assert!(report.is_success() && report.warnings.is_empty());
    ends_well(&graph("+"), &here, &others, "+");
}

#[test]
fn a_false_record_costs_a_second_beginning() {
    for keep_going in [false, true] {
        let others = Arc::new(Others::default());
        bake(&graph("+"), &machine(), &others);
        // Every record names something that nobody has.
        others.records.lock().unwrap().values_mut().for_each(|record| record.artefact = Digest::of(b"lies"));
        let (graph, here) = (graph("+"), machine());
        here.tick();
        let options = Options { jobs: 2, keep_going, remote: Some(others.clone()), ..Options::default() };
        let report = run(&graph, &[], &options, &here, &Silent).unwrap();
        assert!(report.is_success(), "{:?}", report.failures().collect::<Vec<_>>());
        assert_eq!(report.warnings, ["given up"]);
        others.records.lock().unwrap().clear();
        ends_well(&graph, &here, &others, "+");
    }
}

#[test]
fn a_false_record_is_found_out_runs_later() {
    let others = Arc::new(Others::default());
    bake(&graph("+"), &machine(), &others);
    let upper = Digest::of(b"MOSS");
    let lie =
        |record: &mut Record| record.artefact = if record.artefact == upper { Digest::of(b"lies") } else { upper };
    // What the second machine sees: `upper` is something else, and what was made of that is as it was.
    let here = machine();
    let mut truth = others.records.lock().unwrap().clone();
    others.records.lock().unwrap().values_mut().filter(|record| record.artefact == upper).for_each(lie);
    bake(&graph("+"), &here, &others);
    // Whatever it believed, another wish uncovers it.
    others.records.lock().unwrap().clear();
    others.records.lock().unwrap().append(&mut truth);
    let report = bake(&graph("-"), &here, &others);
    assert!(report.is_success(), "{:?}", report.failures().collect::<Vec<_>>());
    ends_well(&graph("-"), &here, &others, "-");
}

#[test]
fn other_bytes_than_promised_are_not_used() {
    let others = Arc::new(Others::default());
    bake(&graph("+"), &machine(), &others);
    others.blobs.lock().unwrap().values_mut().for_each(|bytes| bytes[0] ^= 1);
    let here = machine();
    let report = bake(&graph("+"), &here, &others);
    assert!(report.is_success());
    assert_eq!(report.warnings, ["given up"]);
    ends_well(&graph("+"), &here, &others, "+");
}

#[test]
fn forced_runs_ask_nobody() {
    let others = Arc::new(Others::default());
    bake(&graph("+"), &machine(), &others);
    let here = machine();
    here.tick();
    let options = Options { force: true, remote: Some(others.clone()), ..Options::default() };
    let report = run(&graph("+"), &[], &options, &here, &Silent).unwrap();
    assert_eq!(ran(&report).len(), 4);
    assert_eq!(others.stored.load(Ordering::SeqCst), 4, "nor tell anybody");
}

/// A step for workers.
struct Far;

impl Step for Far {
    fn name(&self) -> String {
        "far".to_string()
    }
    fn kind(&self) -> &'static str {
        "far"
    }
    fn revision(&self) -> u32 {
        1
    }
    fn describe(&self, _: &mut dyn Visitor) {}
    fn travels(&self) -> bool {
        true
    }
    fn run(&self, inputs: &Inputs) -> Result<Vec<u8>, StepError> {
        Ok([&inputs[0], b" from here"].concat())
    }
}

#[test]
fn workers_get_what_travels_and_what_they_do_not_do_is_done_here() {
    for (answer, expected) in [(Some("MOSS from there"), "MOSS from there"), (None, "MOSS from here")] {
        let mut graph = Graph::new();
        let file = graph.add_file("a.txt");
        let upper = graph.add_step(Box::new(Toy::upper("upper")), &[file]);
        let far = graph.add_step(Box::new(Far), &[upper.into()]);
        graph.add_output(far, "out/far.txt");
        let (here, others) = (machine(), Arc::new(Others::default()));
        *others.works.lock().unwrap() = answer.map(|text| text.as_bytes().to_vec());
        assert_eq!(ran(&bake(&graph, &here, &others)), ["far", "upper"]);
        assert_eq!(here.text("out/far.txt").as_deref(), Some(expected));
        assert_eq!(*others.executed.lock().unwrap(), ["far"]);

        // A worker finds the step by its key, among others.
        let key = graph.key(far, &[Digest::of(b"MOSS")]);
        let input = || vec![Bytes::from(b"MOSS".to_vec())];
        let done = run_step(&graph, &key, input()).map(|result| result.unwrap());
        assert_eq!(done.as_deref(), Some(&b"MOSS from here"[..]));
        assert!(run_step(&graph, &Digest::of(b"?"), input()).is_none());
        assert!(run_step(&graph, &key, vec![Bytes::from(b"FERN".to_vec())]).is_none());
    }
}
