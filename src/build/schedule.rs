//! Runs what is stale: ready steps in parallel, each as soon as its inputs are known.
//!
//! ```text
//!   Waiting --all inputs known--> Ready --a thread is free--> Running --+--> Done --bytes wanted, but lost--> Ready
//!      ^                                                                +--> Failed   (again: `rebuild`)
//!      '---------- an input's bytes are lost: wait until it is made again; Skipped if an input fails
//! ```
//!
//! A step that gets its turn first computes its key: what the cache knows under it need not run (early cut-off).
//! The books are behind one lock that is never held while anything is read, run or written. At most `jobs` steps are
//! under way: a thread that waits inside a step for a parallel loop may take up another step meanwhile, and the bound
//! keeps its stack shallow. Ready steps start by the length of the longest path through them (`critical`), and none while
//! the next would not fit into memory beside those under way: a step alone has all threads for its loops.
//!
//! What the cache does not know, other machines may (`remote`). Their word is enough for the steps after it; the bytes are
//! fetched when a step reads them or an output needs them.
//!
//! Only bytes of the surveyed digest are given to a step, so a file that changes meanwhile cannot get a wrong artefact
//! into the cache.
//!
//! Unaware of: why steps are stale (`survey`), what they do.

use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use super::books::{Books, Phase, input_digests};
use super::cache::Record;
use super::critical;
use super::digest::Digest;
use super::explain;
use super::graph::{Bytes, Inputs, Node, Source, StepId};
use super::manifest::FileRecord;
use super::remote::Errand;
use super::report::{Failure, Outcome, Progress, StepReport};
use super::survey::{Artefact, Survey, Verdict, World, find_artefact, stale_outputs};

/// A run under way.
pub(super) struct Work<'a> {
    world: &'a World<'a>,
    survey: &'a Survey,
    progress: &'a dyn Progress,
    begun: Instant,
    books: Mutex<Books>,
    expected_ms: Vec<u64>,
}

/// What a thread needs to know to work on a step.
struct Task {
    step: StepId,
    inputs: Vec<Digest>,
    rebuild: bool,
    expected: Option<Artefact>,
    memory: u64,
}

/// How a task ended.
enum End {
    Done {
        artefact: Artefact,
        bytes: Option<Bytes>,
        outcome: Outcome,
        reasons: Vec<String>,
    },
    /// These inputs must be made again first.
    Lost(Vec<StepId>),
    Failed {
        failure: Failure,
        reasons: Vec<String>,
    },
    /// Others said something wrong of this step, and who knows what was made of that: the run begins again.
    Misled,
}

/// Why a step gave no artefact.
enum Unmade {
    Failed(Failure),
    Misled,
}

impl From<Failure> for Unmade {
    fn from(failure: Failure) -> Self {
        Unmade::Failed(failure)
    }
}

impl<'a> Work<'a> {
    pub fn new(world: &'a World<'a>, survey: &'a Survey, progress: &'a dyn Progress, begun: Instant) -> Self {
        let expected_ms = critical::expected_ms(world, survey);
        let books = Books::new(world, survey, critical::paths(world, &expected_ms));
        Work { world, survey, progress, begun, books: Mutex::new(books), expected_ms }
    }

    /// How long one thread would be expected to work.
    pub fn expected(&self) -> Duration {
        Duration::from_millis(self.expected_ms.iter().sum())
    }

    /// Runs until nothing more can be done; call it on the pool.
    pub fn run(self) -> Books {
        rayon::scope(|scope| self.dispatch(scope));
        self.books.into_inner().unwrap_or_else(PoisonError::into_inner)
    }

    fn lock(&self) -> MutexGuard<'_, Books> {
        self.books.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn dispatch<'s>(&'s self, scope: &rayon::Scope<'s>) {
        while let Some(task) = self.next() {
            scope.spawn(move |scope| {
                let start = self.begun.elapsed();
                let (step, memory) = (task.step, task.memory);
                let end = self.attempt(task);
                self.settle(step, end, start, memory);
                self.dispatch(scope);
            });
        }
    }

    fn next(&self) -> Option<Task> {
        let mut books = self.lock();
        books.stopped |= self.world.options.interrupt.load(Ordering::Relaxed);
        if books.stopped || books.running >= self.world.threads.load(Ordering::Relaxed) {
            return None;
        }
        let &(_, step) = books.ready.first()?;
        let memory = self.memory(&books, step);
        if books.running > 0 && books.memory.saturating_add(memory) > self.world.options.memory {
            return None;
        }
        books.ready.pop_first();
        books.running += 1;
        books.memory += memory;
        let slot = &mut books.slots[step.index()];
        slot.phase = Phase::Running;
        let (rebuild, expected) = (slot.rebuild, slot.artefact);
        let inputs = input_digests(self.world, self.survey, &books.slots, step);
        debug_assert!(inputs.is_some(), "a step is ready only when its inputs are known");
        let inputs = inputs.unwrap_or_default();
        Some(Task { step, inputs, rebuild, expected, memory })
    }

    /// What a step says that it takes.
    fn memory(&self, books: &Books, step: StepId) -> u64 {
        let node = &self.world.graph.nodes[step.index()];
        let len = |source: &Source| match source {
            Source::File(file) => self.survey.files[*file].len(),
            Source::Step(input) => books.slots[input.index()].artefact.map_or(0, |artefact| artefact.len),
        };
        // A step that overflows the sum would not fit beside anything either.
        node.step.memory(&node.inputs.iter().map(len).collect::<Vec<u64>>()).min(u64::MAX / 4096)
    }

    /// Finds the artefact in the cache or makes it, and writes its outputs.
    fn attempt(&self, task: Task) -> End {
        let Task { step, inputs, rebuild, mut expected, .. } = task;
        let key = self.world.graph.key(step, &inputs);
        let mut reasons = match &self.survey.steps[step.index()] {
            Verdict::Run(_, reasons) | Verdict::Restore(_, reasons) => reasons.clone(),
            Verdict::Maybe(_) => Vec::new(),
            _ => vec![explain::LOST.to_string()],
        };
        if !rebuild && !self.world.options.force {
            expected = find_artefact(self.world, step, &key).or_else(|| self.told(&key));
        }
        // What is to be made again is lost here; others may have it.
        if let Some(artefact) = expected.filter(|_| !rebuild || self.world.remote().is_some()) {
            let stale = stale_outputs(self.world, &self.survey.outputs, step, &artefact.digest);
            if stale.is_empty() && !rebuild {
                return End::Done { artefact, bytes: None, outcome: Outcome::UpToDate, reasons: Vec::new() };
            }
            if let Some(bytes) = self.artefact_bytes(step, artefact) {
                if reasons.is_empty() {
                    let why = |&output: &usize| explain::output(self.world, output, &self.survey.outputs[output]);
                    reasons = stale.iter().map(why).collect();
                }
                return match self.write_outputs(&stale, artefact, &bytes) {
                    Ok(()) => End::Done { artefact, bytes: Some(bytes), outcome: Outcome::Restored, reasons },
                    Err(failure) => End::Failed { failure, reasons },
                };
            }
            reasons.push(explain::LOST.to_string());
        }
        if reasons.is_empty() {
            reasons = explain::reasons(self.world, step, &inputs);
        }
        match self.gather(step, &inputs) {
            Ok(Ok(given)) => match self.make(step, &key, given, expected, &reasons) {
                Ok((artefact, bytes)) => End::Done { artefact, bytes: Some(bytes), outcome: Outcome::Ran, reasons },
                Err(Unmade::Failed(failure)) => End::Failed { failure, reasons },
                Err(Unmade::Misled) => End::Misled,
            },
            Ok(Err(lost)) => End::Lost(lost),
            Err(failure) => End::Failed { failure, reasons },
        }
    }

    /// The bytes of all inputs, or else the steps whose bytes are lost.
    fn gather(&self, step: StepId, digests: &[Digest]) -> Result<Result<Inputs, Vec<StepId>>, Failure> {
        let graph = self.world.graph;
        let mut items = Vec::new();
        let mut lost = Vec::new();
        for (source, digest) in graph.nodes[step.index()].inputs.iter().zip(digests) {
            let bytes = match *source {
                Source::File(file) => Some(self.file_bytes(file, digest)?),
                Source::Step(input) => {
                    let artefact = self.lock().slots[input.index()].artefact;
                    let bytes = artefact.and_then(|artefact| self.artefact_bytes(input, artefact));
                    if bytes.is_none() && !lost.contains(&input) {
                        lost.push(input);
                    }
                    bytes
                }
            };
            items.extend(bytes.map(|bytes| (graph.label(*source), bytes)));
        }
        Ok(if lost.is_empty() { Ok(Inputs::new(items)) } else { Err(lost) })
    }

    fn file_bytes(&self, file: usize, digest: &Digest) -> Result<Bytes, Failure> {
        if let Some(shared) = self.lock().files[file].upgrade() {
            return Ok(Bytes(shared));
        }
        let path = &self.world.graph.files[file];
        let read = self.world.disk.read(path, self.world.options.file_limit);
        match read {
            Ok(bytes) if Digest::of(&bytes) == *digest => {
                let bytes = Bytes::from(bytes);
                self.lock().files[file] = Arc::downgrade(&bytes.0);
                Ok(bytes)
            }
            _ => Err(Failure::InputChanged(path.clone())),
        }
    }

    /// What others say that `key` gives. It is not kept here before its bytes are.
    fn told(&self, key: &Digest) -> Option<Artefact> {
        let Record { artefact, len, wall_ms } = self.world.remote()?.record(key)?;
        (len <= self.world.options.file_limit).then_some(Artefact { digest: artefact, len, wall_ms })
    }

    /// Bytes of an artefact from others; from then on the cache has them.
    fn fetch(&self, step: StepId, artefact: Artefact) -> Option<Bytes> {
        let remote = self.world.remote()?;
        let inputs = input_digests(self.world, self.survey, &self.lock().slots, step)?;
        let key = self.world.graph.key(step, &inputs);
        let record = Record { artefact: artefact.digest, len: artefact.len, wall_ms: artefact.wall_ms };
        let bytes = Bytes::from(remote.load(&key, &record)?);
        if Digest::of(&bytes) != artefact.digest {
            remote.distrust("it gave other bytes than it had promised");
            return None;
        }
        // Without it they are asked for again.
        let _ = self.world.cache.store(&key, &record, &bytes);
        Some(bytes)
    }

    /// Bytes of an artefact, from memory, from the cache or from others.
    fn artefact_bytes(&self, step: StepId, artefact: Artefact) -> Option<Bytes> {
        let held = self.lock().held(step);
        if held.is_some() {
            return held;
        }
        let bytes = match self.world.cache.load(&artefact.digest, artefact.len) {
            Some(bytes) => Bytes::from(bytes),
            None => self.fetch(step, artefact)?,
        };
        self.lock().hold(step, &bytes, self.world.options.hold_bytes);
        Some(bytes)
    }

    /// Runs a step, stores its artefact and writes its outputs.
    fn make(
        &self,
        step: StepId,
        key: &Digest,
        inputs: Inputs,
        expected: Option<Artefact>,
        reasons: &[String],
    ) -> Result<(Artefact, Bytes), Unmade> {
        let node = &self.world.graph.nodes[step.index()];
        self.progress.start(&node.name, reasons);
        let begun = Instant::now();
        let errand = Errand { step, name: &node.name, key, inputs: &inputs };
        let remote = self.world.remote();
        let bytes = match remote.filter(|_| node.step.travels()).and_then(|remote| remote.execute(&errand)) {
            Some(bytes) => Bytes::from(bytes),
            None => run_caught(node, &inputs)?,
        };
        drop(inputs);
        let wall_ms = begun.elapsed().as_millis() as u64;
        let artefact = Artefact { digest: Digest::of(&bytes), len: bytes.len() as u64, wall_ms };
        let record = Record { artefact: artefact.digest, len: artefact.len, wall_ms };
        let before = expected.filter(|before| before.digest != artefact.digest);
        let ours = |before: Artefact| self.world.cache.record(key).is_some_and(|r| r.artefact == before.digest);
        if let (Some(remote), Some(_)) = (&self.world.options.remote, before.filter(|before| !ours(*before))) {
            remote.distrust("it knew of another result than this step has");
            self.world.disown(key);
        }
        match self.world.cache.store(key, &record, &bytes) {
            // Somebody else fills it. What is lost for want of room in memory is made again.
            Err(error) if is_forbidden(&error) => self.lock().unstored += 1,
            Err(source) => return Err(Failure::Write { what: "the cache".to_string(), source }.into()),
            Ok(()) => {}
        }
        if let Some(before) = before {
            let not_deterministic = Failure::NotDeterministic { before: before.digest, now: artefact.digest };
            let misled = self.world.disowns(key);
            return Err(if misled { Unmade::Misled } else { not_deterministic.into() });
        }
        if let Some(remote) = remote {
            remote.store(key, &record, &bytes);
        }
        let stale = stale_outputs(self.world, &self.survey.outputs, step, &artefact.digest);
        self.write_outputs(&stale, artefact, &bytes)?;
        Ok((artefact, bytes))
    }

    fn write_outputs(&self, outputs: &[usize], artefact: Artefact, bytes: &[u8]) -> Result<(), Failure> {
        for &output in outputs {
            let path = &self.world.graph.outputs[output].path;
            let written = self.world.disk.write(path, bytes);
            written.map_err(|source| Failure::Write { what: path.display().to_string(), source })?;
            // Nobody but kiln writes here, so the stamp can be trusted at once - unless it counts in whole seconds.
            let stamp = self.world.disk.stamp(path).ok().flatten().filter(|stamp| stamp.mtime_ns % 1_000_000_000 != 0);
            self.lock().written[output] = Some(FileRecord { stamp, digest: artefact.digest });
        }
        Ok(())
    }

    /// Enters a task's end into the books, which wakes whoever waits for it.
    fn settle(&self, step: StepId, end: End, start: Duration, memory: u64) {
        let node = &self.world.graph.nodes[step.index()];
        let counters = match &end {
            End::Done { bytes: Some(bytes), outcome: Outcome::Ran, .. } => node.step.counters(bytes),
            _ => Vec::new(),
        };
        let mut books = self.lock();
        books.running -= 1;
        books.memory -= memory;
        let (artefact, outcome, reasons) = match end {
            End::Lost(inputs) => return books.wait_for_rebuilds(self.world, step, &inputs),
            End::Misled => {
                books.stopped = true;
                return;
            }
            End::Done { artefact, bytes, outcome, reasons } => {
                books.done(self.world, step, artefact, bytes);
                (Some(artefact), outcome, reasons)
            }
            End::Failed { failure, reasons } => {
                books.failed(self.world, step);
                (None, Outcome::Failed(failure), reasons)
            }
        };
        drop(books);
        let mut report = step_report(node, artefact, outcome, reasons);
        report.counters = counters;
        report.start = start;
        report.duration = self.begun.elapsed().saturating_sub(start);
        report.expected = Duration::from_millis(self.expected_ms[step.index()]);
        report.thread = rayon::current_thread_index().unwrap_or(0);
        self.progress.done(&report);
        self.lock().slots[step.index()].report = Some(report);
    }
}

/// A report without times.
pub(super) fn step_report(
    node: &Node,
    artefact: Option<Artefact>,
    outcome: Outcome,
    reasons: Vec<String>,
) -> StepReport {
    StepReport {
        name: node.name.clone(),
        kind: node.step.kind(),
        outcome,
        reasons,
        artefact: artefact.map(|artefact| artefact.digest),
        len: artefact.map_or(0, |artefact| artefact.len),
        start: Duration::ZERO,
        duration: Duration::ZERO,
        expected: Duration::ZERO,
        thread: 0,
        counters: Vec::new(),
    }
}

/// Whether one may not write here, ever; a full disk is another matter.
fn is_forbidden(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::PermissionDenied | io::ErrorKind::ReadOnlyFilesystem)
}

fn run_caught(node: &Node, inputs: &Inputs) -> Result<Bytes, Failure> {
    match catch_unwind(AssertUnwindSafe(|| node.step.run(inputs))) {
        Ok(Ok(bytes)) => Ok(Bytes::from(bytes)),
        Ok(Err(error)) => Err(Failure::Step(error)),
        Err(panic) => {
            let message = panic.downcast_ref::<&str>().map(|text| text.to_string());
            let message = message.or_else(|| panic.downcast_ref::<String>().cloned());
            Err(Failure::Panic(message.unwrap_or_else(|| "no message".to_string())))
        }
    }
}
