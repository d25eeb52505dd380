//! What is known before anything runs: which steps are up to date, which must run and why.
//!
//! Stamps are looked at first; only files whose stamp moved are read and hashed. Then one pass in the order of the
//! graph settles what the manifest or the cache knows, and one pass back finds artefacts that a step will want to read
//! but that the cache has lost.
//!
//! A stamp is trusted only if it is older than the reading of the file by more than any file system's clock is coarse:
//! otherwise a second edit could leave the stamp as it was. "Now" is asked of the file system itself, which may be
//! another machine's.
//!
//! Unaware of: threads of the schedule, running.

use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::path::Path;
use std::sync::atomic::AtomicUsize;
use std::sync::{Arc, Mutex, PoisonError};

use super::cache::{Cache, Record};
use super::digest::Digest;
use super::explain;
use super::graph::{Graph, Source, StepId};
use super::manifest::{FileRecord, Manifest};
use super::options::Options;
use super::remote::Remote;
use crate::disk::{Clock, Disk, Stamp};
use crate::numerics::par;

/// Everything that is the same throughout one run.
pub(super) struct World<'a> {
    pub graph: &'a Graph,
    pub disk: &'a dyn Disk,
    pub options: &'a Options,
    pub cache: Cache<'a>,
    pub manifest: Manifest<'a>,
    pub needed: Vec<bool>,
    /// How many threads there are by now: a jobserver lends them one by one.
    pub threads: Arc<AtomicUsize>,
    /// Keys of which others said something wrong: what the manifest has of them is theirs and not believed.
    pub disowned: Mutex<BTreeSet<Digest>>,
}

impl World<'_> {
    /// Who may help from other machines, as long as they are right.
    pub fn remote(&self) -> Option<&dyn Remote> {
        let asked = self.options.remote.as_deref().filter(|_| !self.options.force);
        asked.filter(|_| self.disowned_count() == 0)
    }

    /// How many keys are disowned.
    pub fn disowned_count(&self) -> usize {
        self.disowned.lock().unwrap_or_else(PoisonError::into_inner).len()
    }

    /// Believes no more what others said of `key`.
    pub fn disown(&self, key: &Digest) {
        self.disowned.lock().unwrap_or_else(PoisonError::into_inner).insert(*key);
    }

    /// Whether what the manifest has of `key` came from others and was wrong.
    pub fn disowns(&self, key: &Digest) -> bool {
        self.disowned.lock().unwrap_or_else(PoisonError::into_inner).contains(key)
    }
}

/// A file as it was found.
pub(super) enum Seen {
    /// Nobody asked.
    Ignored,
    /// There is no such file.
    Missing,
    /// It cannot be read; why.
    Faulty(String),
    /// Its content.
    Known { stamp: Stamp, trusted: bool, digest: Digest },
}

impl Seen {
    /// Digest of the content, if there is any.
    pub fn digest(&self) -> Option<Digest> {
        match self {
            Seen::Known { digest, .. } => Some(*digest),
            _ => None,
        }
    }

    /// Length of the content in bytes; 0 if there is none.
    pub fn len(&self) -> u64 {
        match self {
            Seen::Known { stamp, .. } => stamp.len,
            _ => 0,
        }
    }

    /// What to remember of it.
    pub fn record(&self) -> Option<FileRecord> {
        match self {
            Seen::Known { stamp, trusted, digest } => {
                Some(FileRecord { stamp: trusted.then_some(*stamp), digest: *digest })
            }
            _ => None,
        }
    }
}

/// An artefact that is known without running its step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Artefact {
    pub digest: Digest,
    pub len: u64,
    /// How long its step took.
    pub wall_ms: u64,
}

/// What the survey says of a step.
#[derive(Debug, PartialEq)]
pub(super) enum Verdict {
    /// No target needs it.
    Ignored,
    /// Nothing to do.
    UpToDate(Artefact),
    /// The artefact is in the cache; output files must be written from it. Why.
    Restore(Artefact, Vec<String>),
    /// Must run, and why. The artefact is there if it is known but lost.
    Run(Option<Artefact>, Vec<String>),
    /// Depends on what these inputs will be.
    Maybe(Vec<StepId>),
    /// Cannot run, as an input file is missing or unreadable; what to say.
    Broken(String),
    /// Cannot run, as this step cannot.
    Blocked(StepId),
}

impl Verdict {
    /// The artefact, where known.
    pub fn artefact(&self) -> Option<Artefact> {
        match self {
            Verdict::UpToDate(artefact) | Verdict::Restore(artefact, _) | Verdict::Run(Some(artefact), _) => {
                Some(*artefact)
            }
            _ => None,
        }
    }
}

/// Result of [`survey`]: one entry per file, output and step of the graph.
pub(super) struct Survey {
    pub files: Vec<Seen>,
    pub outputs: Vec<Seen>,
    pub steps: Vec<Verdict>,
    /// Something is not as the manifest has it.
    pub moved: bool,
}

/// Looks at files, outputs and keys.
pub(super) fn survey(world: &World, clock: &Clock) -> Survey {
    let graph = world.graph;
    let mut files_needed = vec![false; graph.files.len()];
    for (node, _) in graph.nodes.iter().zip(&world.needed).filter(|(_, needed)| **needed) {
        for source in &node.inputs {
            if let Source::File(file) = source {
                files_needed[*file] = true;
            }
        }
    }
    let mut looks = Vec::with_capacity(graph.files.len() + graph.outputs.len());
    for (file, path) in graph.files.iter().enumerate() {
        looks.push(files_needed[file].then(|| Look { path, record: world.manifest.file(graph, file) }));
    }
    for (index, output) in graph.outputs.iter().enumerate() {
        let needed = world.needed[output.step.index()];
        looks.push(needed.then(|| Look { path: &output.path, record: world.manifest.output(graph, index) }));
    }
    let (mut files, hashed) = look_at(world, &looks, clock);
    let outputs = files.split_off(graph.files.len());
    let mut survey = Survey { files, outputs, steps: Vec::with_capacity(graph.nodes.len()), moved: hashed };
    for index in 0..graph.nodes.len() {
        let verdict = judge(world, &mut survey, StepId::at(index));
        survey.steps.push(verdict);
    }
    find_lost(world, &mut survey);
    survey
}

struct Look<'a> {
    path: &'a Path,
    record: Option<&'a FileRecord>,
}

/// Stamps all, reads and hashes those whose stamp is not the recorded one; also returns whether there were any.
fn look_at(world: &World, looks: &[Option<Look>], clock: &Clock) -> (Vec<Seen>, bool) {
    let mut seen = par::map(looks.len(), |index| {
        let Some(look) = &looks[index] else { return (Seen::Ignored, None) };
        match world.disk.stamp(look.path) {
            Err(error) => (Seen::Faulty(error.to_string()), None),
            Ok(None) => (Seen::Missing, None),
            Ok(Some(stamp)) => match look.record {
                Some(record) if record.stamp == Some(stamp) => {
                    (Seen::Known { stamp, trusted: true, digest: record.digest }, None)
                }
                _ => (Seen::Missing, Some((index, stamp))),
            },
        }
    });
    let moved: Vec<(usize, Stamp)> = seen.iter().filter_map(|(_, moved)| *moved).collect();
    // Now, before anything is read.
    let _ = if moved.is_empty() { None } else { clock.now() };
    let hashed = par::map_chunks(moved.len(), 1, |range| {
        let (index, stamp) = moved[range.start];
        let Some(look) = &looks[index] else { return Seen::Ignored };
        match world.disk.read(look.path, world.options.file_limit) {
            Ok(bytes) => Seen::Known { stamp, trusted: clock.trusts(&stamp), digest: Digest::of(&bytes) },
            Err(error) if error.kind() == io::ErrorKind::NotFound => Seen::Missing,
            Err(error) => Seen::Faulty(error.to_string()),
        }
    });
    for ((index, _), found) in moved.iter().zip(hashed) {
        seen[*index].0 = found;
    }
    (seen.into_iter().map(|(found, _)| found).collect(), !moved.is_empty())
}

fn judge(world: &World, survey: &mut Survey, step: StepId) -> Verdict {
    if !world.needed[step.index()] {
        return Verdict::Ignored;
    }
    let mut digests = Vec::new();
    let mut waits_for = Vec::new();
    for source in &world.graph.nodes[step.index()].inputs {
        digests.push(match source {
            Source::File(file) => match &survey.files[*file] {
                Seen::Known { digest, .. } => Some(*digest),
                seen => return Verdict::Broken(fault(&world.graph.files[*file], seen)),
            },
            Source::Step(input) => match &survey.steps[input.index()] {
                Verdict::Broken(_) | Verdict::Blocked(_) => return Verdict::Blocked(*input),
                verdict => {
                    let digest = verdict.artefact().map(|artefact| artefact.digest);
                    if digest.is_none() && !waits_for.contains(input) {
                        waits_for.push(*input);
                    }
                    digest
                }
            },
        });
    }
    if world.options.force {
        return Verdict::Run(None, vec!["forced".to_string()]);
    }
    match digests.iter().copied().collect::<Option<Vec<Digest>>>() {
        Some(digests) => judge_by_key(world, survey, step, &digests),
        None => {
            let reasons = explain::differences(world, step, |input| digests[input]);
            if reasons.is_empty() { Verdict::Maybe(waits_for) } else { Verdict::Run(None, reasons) }
        }
    }
}

fn judge_by_key(world: &World, survey: &mut Survey, step: StepId, inputs: &[Digest]) -> Verdict {
    let key = world.graph.key(step, inputs);
    let recorded = world.manifest.step(world.graph, step).filter(|record| record.key == key);
    survey.moved |= recorded.is_none();
    let Some(artefact) = find_artefact(world, step, &key) else {
        return Verdict::Run(None, explain::reasons(world, step, inputs));
    };
    let stale = stale_outputs(world, &survey.outputs, step, &artefact.digest);
    let reasons: Vec<String> =
        stale.iter().map(|&output| explain::output(world, output, &survey.outputs[output])).collect();
    if reasons.is_empty() { Verdict::UpToDate(artefact) } else { Verdict::Restore(artefact, reasons) }
}

/// The artefact that `key` gave before, by the manifest or by the cache.
pub(super) fn find_artefact(world: &World, step: StepId, key: &Digest) -> Option<Artefact> {
    let recorded = world.manifest.step(world.graph, step).filter(|record| record.key == *key);
    if let Some(record) = recorded.filter(|_| !world.disowns(key)) {
        return Some(Artefact { digest: record.artefact, len: record.len, wall_ms: record.wall_ms });
    }
    let of = |record: Record| Artefact { digest: record.artefact, len: record.len, wall_ms: record.wall_ms };
    world.cache.record(key).map(of)
}

/// Outputs of a step that do not hold its artefact.
pub(super) fn stale_outputs(world: &World, seen: &[Seen], step: StepId, artefact: &Digest) -> Vec<usize> {
    let outputs = &world.graph.nodes[step.index()].outputs;
    outputs.iter().copied().filter(|&output| seen[output].digest() != Some(*artefact)).collect()
}

fn fault(path: &Path, seen: &Seen) -> String {
    match seen {
        Seen::Faulty(why) => format!("input file {} cannot be read: {why}", path.display()),
        _ => format!("input file {} does not exist", path.display()),
    }
}

/// From last to first: artefacts that steps will read but that the cache does not have must be made again.
fn find_lost(world: &World, survey: &mut Survey) {
    let mut present: BTreeMap<Digest, bool> = BTreeMap::new();
    let mut lost = |artefact: Artefact| {
        !*present.entry(artefact.digest).or_insert_with(|| world.cache.has(&artefact.digest, artefact.len))
    };
    for index in (0..survey.steps.len()).rev() {
        if let Verdict::Restore(artefact, reasons) = &mut survey.steps[index] {
            let artefact = *artefact;
            if lost(artefact) {
                let reasons = std::mem::take(reasons).into_iter().chain([explain::LOST.to_string()]).collect();
                survey.steps[index] = Verdict::Run(Some(artefact), reasons);
            }
        }
        if !matches!(survey.steps[index], Verdict::Run(..)) {
            continue;
        }
        for input in world.graph.nodes[index].input_steps() {
            if let Verdict::UpToDate(artefact) = survey.steps[input.index()]
                && lost(artefact)
            {
                survey.steps[input.index()] = Verdict::Run(Some(artefact), vec![explain::LOST.to_string()]);
            }
        }
    }
}
