//! The books of a run under way: in which phase each step is, what it waits for, whose bytes are held.
//!
//! Every method is called under the schedule's lock and does no work beyond the books.
//!
//! Unaware of: threads, disk.

use std::cmp::Reverse;
use std::collections::BTreeSet;
use std::sync::{Arc, Weak};

use super::digest::Digest;
use super::graph::{Bytes, Source, StepId};
use super::manifest::FileRecord;
use super::report::{Failure, Outcome, StepReport};
use super::schedule::step_report;
use super::survey::{Artefact, Survey, Verdict, World};

/// The books. After the run they are what is left of it.
pub(super) struct Books {
    pub slots: Vec<Slot>,
    /// New records of the outputs that were written.
    pub written: Vec<Option<FileRecord>>,
    /// Contents of input files that some step works with.
    pub files: Vec<Weak<Vec<u8>>>,
    /// Steps that can start: those on the longest path first, then in the order of the graph.
    pub ready: BTreeSet<(Reverse<u64>, StepId)>,
    /// How many artefacts are not in the cache, as one may not write there.
    pub unstored: usize,
    /// How many steps are under way.
    pub running: usize,
    /// Bytes that they are estimated to take.
    pub memory: u64,
    /// Length of the longest path through each step, in milliseconds.
    paths: Vec<u64>,
    /// Start nothing more.
    pub stopped: bool,
    /// Bytes of all strongly held artefacts.
    held_bytes: u64,
    /// The scheduled steps that read each step; once per reading.
    readers: Vec<Vec<StepId>>,
}

/// A step of the run.
pub(super) struct Slot {
    pub phase: Phase,
    pub artefact: Option<Artefact>,
    pub report: Option<StepReport>,
    /// Readings still to become possible before this step is ready.
    waiting: usize,
    /// The artefact's digest has been told to the readers.
    announced: bool,
    /// Run whatever the cache says: the bytes are wanted.
    pub rebuild: bool,
    /// Readings by steps that are not yet settled.
    users: usize,
    /// Steps that wait for this one to be made again.
    waiters: Vec<StepId>,
    bytes: Held,
}

/// Where a step stands; see the picture in `schedule`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Phase {
    Waiting,
    Ready,
    Running,
    Done,
    Failed,
    Skipped,
}

/// Bytes kept for readers, or only remembered while somebody else keeps them.
enum Held {
    Strong(Bytes),
    Weak(Weak<Vec<u8>>),
}

impl Slot {
    fn new(verdict: &Verdict) -> Self {
        let phase = match verdict {
            Verdict::Ignored | Verdict::UpToDate(_) => Phase::Done,
            Verdict::Broken(_) => Phase::Failed,
            Verdict::Blocked(_) => Phase::Skipped,
            _ => Phase::Waiting,
        };
        Slot {
            phase,
            artefact: verdict.artefact(),
            report: None,
            waiting: 0,
            announced: matches!(verdict, Verdict::UpToDate(_) | Verdict::Restore(..)),
            rebuild: matches!(verdict, Verdict::Run(Some(_), _)),
            users: 0,
            waiters: Vec::new(),
            bytes: Held::Weak(Weak::new()),
        }
    }
}

impl Books {
    /// Opens the books: what the survey found wanting waits for its inputs.
    pub fn new(world: &World, survey: &Survey, paths: Vec<u64>) -> Self {
        let count = world.graph.nodes.len();
        let mut books = Books {
            slots: survey.steps.iter().map(Slot::new).collect(),
            written: vec![None; world.graph.outputs.len()],
            files: world.graph.files.iter().map(|_| Weak::new()).collect(),
            ready: BTreeSet::new(),
            unstored: 0,
            running: 0,
            memory: 0,
            paths,
            stopped: false,
            held_bytes: 0,
            readers: vec![Vec::new(); count],
        };
        for index in 0..count {
            let step = StepId::at(index);
            if let Verdict::Broken(sentence) = &survey.steps[index] {
                let outcome = Outcome::Failed(Failure::Input(sentence.clone()));
                books.slots[index].report = Some(step_report(&world.graph.nodes[index], None, outcome, Vec::new()));
                books.stopped |= !world.options.keep_going;
            }
            if books.slots[index].phase == Phase::Waiting {
                books.enter_readings(world, step);
            }
        }
        books
    }

    fn enter_readings(&mut self, world: &World, step: StepId) {
        for input in world.graph.nodes[step.index()].input_steps() {
            self.readers[input.index()].push(step);
            self.slots[input.index()].users += 1;
            self.slots[step.index()].waiting += usize::from(!self.slots[input.index()].announced);
        }
        if self.slots[step.index()].waiting == 0 {
            self.make_ready(step);
        }
    }

    fn make_ready(&mut self, step: StepId) {
        self.slots[step.index()].phase = Phase::Ready;
        self.ready.insert((Reverse(self.paths[step.index()]), step));
    }

    fn wake(&mut self, step: StepId) {
        let slot = &mut self.slots[step.index()];
        slot.waiting -= 1;
        if slot.waiting == 0 && slot.phase == Phase::Waiting {
            self.make_ready(step);
        }
    }

    /// A step is done: its bytes, if at hand, are kept for those who want them, and those who wait for it go on.
    pub fn done(&mut self, world: &World, step: StepId, artefact: Artefact, bytes: Option<Bytes>) {
        let slot = &mut self.slots[step.index()];
        slot.phase = Phase::Done;
        slot.artefact = Some(artefact);
        slot.rebuild = false;
        if let Some(bytes) = bytes {
            self.hold(step, &bytes, world.options.hold_bytes);
        }
        self.announce(step);
        self.release_inputs(world, step);
    }

    /// A step has failed, and so all that depend on it.
    pub fn failed(&mut self, world: &World, step: StepId) {
        self.slots[step.index()].phase = Phase::Failed;
        self.stopped |= !world.options.keep_going;
        self.release_inputs(world, step);
        self.skip_readers(world, step);
    }

    fn announce(&mut self, step: StepId) {
        let slot = &mut self.slots[step.index()];
        let first_time = !std::mem::replace(&mut slot.announced, true);
        let waiters = std::mem::take(&mut slot.waiters);
        waiters.into_iter().for_each(|waiter| self.wake(waiter));
        if first_time {
            let readers = std::mem::take(&mut self.readers[step.index()]);
            readers.iter().for_each(|reader| self.wake(*reader));
            self.readers[step.index()] = readers;
        }
    }

    /// Lets `step` try again once `inputs` have been made again.
    pub fn wait_for_rebuilds(&mut self, world: &World, step: StepId, inputs: &[StepId]) {
        self.slots[step.index()].phase = Phase::Waiting;
        let given_up = |input: &&StepId| matches!(self.slots[input.index()].phase, Phase::Failed | Phase::Skipped);
        if let Some(&input) = inputs.iter().find(given_up) {
            self.slots[input.index()].waiters.push(step);
            return self.skip_readers(world, input);
        }
        for &input in inputs {
            self.slots[step.index()].waiting += 1;
            let slot = &mut self.slots[input.index()];
            slot.waiters.push(step);
            if slot.phase == Phase::Done {
                slot.rebuild = true;
                self.make_ready(input);
                for source in world.graph.nodes[input.index()].input_steps() {
                    self.slots[source.index()].users += 1;
                }
            }
        }
    }

    /// Gives up, at any distance, the steps that wait for `failed`, and what is held for them.
    fn skip_readers(&mut self, world: &World, failed: StepId) {
        let mut stack = vec![failed];
        while let Some(step) = stack.pop() {
            let waiters = std::mem::take(&mut self.slots[step.index()].waiters);
            let readers = self.readers[step.index()].clone();
            for reader in readers.into_iter().chain(waiters) {
                if self.slots[reader.index()].phase == Phase::Waiting {
                    self.slots[reader.index()].phase = Phase::Skipped;
                    self.release_inputs(world, reader);
                    stack.push(reader);
                }
            }
        }
    }

    /// The bytes of a step, if somebody has them.
    pub fn held(&self, step: StepId) -> Option<Bytes> {
        match &self.slots[step.index()].bytes {
            Held::Strong(bytes) => Some(bytes.clone()),
            Held::Weak(bytes) => bytes.upgrade().map(Bytes),
        }
    }

    /// Keeps bytes for the steps that will read them: in any case if someone waits for just these, else while there is
    /// room; beyond that only as long as somebody works with them.
    pub fn hold(&mut self, step: StepId, bytes: &Bytes, limit: u64) {
        let len = bytes.len() as u64;
        let slot = &mut self.slots[step.index()];
        if matches!(slot.bytes, Held::Strong(_)) {
            return;
        }
        let wanted = slot.users > 0 && self.held_bytes.saturating_add(len) <= limit;
        if wanted || !slot.waiters.is_empty() {
            slot.bytes = Held::Strong(bytes.clone());
            self.held_bytes += len;
        } else {
            slot.bytes = Held::Weak(Arc::downgrade(&bytes.0));
        }
    }

    fn release_inputs(&mut self, world: &World, step: StepId) {
        for input in world.graph.nodes[step.index()].input_steps() {
            let slot = &mut self.slots[input.index()];
            slot.users = slot.users.saturating_sub(1);
            if slot.users == 0
                && slot.waiters.is_empty()
                && let Held::Strong(bytes) = &slot.bytes
            {
                self.held_bytes -= bytes.len() as u64;
                slot.bytes = Held::Weak(Arc::downgrade(&bytes.0));
            }
        }
    }
}

/// Digests of a step's inputs, once all are known.
pub(super) fn input_digests(world: &World, survey: &Survey, slots: &[Slot], step: StepId) -> Option<Vec<Digest>> {
    let digest = |source: &Source| match source {
        Source::File(file) => survey.files[*file].digest(),
        Source::Step(input) => slots[input.index()].artefact.map(|artefact| artefact.digest),
    };
    world.graph.nodes[step.index()].inputs.iter().map(digest).collect()
}
