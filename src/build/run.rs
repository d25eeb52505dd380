//! One run from beginning to end: read the manifest, survey, schedule, write the manifest, report.
//!
//! Unaware of: what steps do.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use super::books::{Books, Phase, Slot, input_digests};
use super::cache::Cache;
use super::dead::{Dead, remove_unfinished, sweep};
use super::digest::Digest;
use super::graph::{Graph, StepId};
use super::lend::lend;
use super::manifest::{Entry, FileRecord, Manifest, NewStep, Update, encode};
use super::options::{Error, Options};
use super::report::{Failure, Outcome, OutputReport, Progress, Report, StepReport};
use super::schedule::{Work, step_report};
use super::survey::{Artefact, Seen, Survey, Verdict, World, survey};
use crate::disk::{Clock, Disk};
use crate::numerics::par;

/// A manifest of this size would hold tens of millions of steps.
const MANIFEST_LIMIT: u64 = 4 << 30;
/// A thread that waits inside a step may run up to `jobs` others on the same stack. Only touched pages count.
const STACK_BYTES: usize = 32 << 20;

/// Brings `targets` (all steps, if there are none) up to date and writes their outputs.
///
/// Outputs are written once their step has succeeded, and only where the content differs. Failures of steps are in the
/// report; an `Err` means that nothing was run.
pub fn run(
    graph: &Graph,
    targets: &[StepId],
    options: &Options,
    disk: &dyn Disk,
    progress: &dyn Progress,
) -> Result<Report, Error> {
    in_world(graph, targets, options, disk, |world| run_in(world, progress))
}

/// Digests of all artefacts that the manifest tells of, sorted: what the outputs here are made from.
pub fn artefacts(options: &Options, disk: &dyn Disk) -> Vec<Digest> {
    with_manifest(options, disk, |manifest| {
        let mut digests: Vec<Digest> = manifest.steps.rows().map(|record| record.artefact).collect();
        digests.sort_unstable();
        digests.dedup();
        digests
    })
}

/// Calls `work` with the manifest; an empty one, if it cannot be read.
pub(super) fn with_manifest<R>(options: &Options, disk: &dyn Disk, work: impl FnOnce(&Manifest) -> R) -> R {
    let bytes = disk.read(&options.manifest, MANIFEST_LIMIT).unwrap_or_default();
    work(&Manifest::parse(&bytes).unwrap_or_default())
}

/// Checks the graph, reads the manifest and calls `work` on a pool of `jobs` threads.
pub(super) fn in_world<R: Send>(
    graph: &Graph,
    targets: &[StepId],
    options: &Options,
    disk: &dyn Disk,
    work: impl FnOnce(&World) -> R + Send,
) -> Result<R, Error> {
    graph.check()?;
    let bytes = disk.read(&options.manifest, MANIFEST_LIMIT).unwrap_or_default();
    let manifest = Manifest::parse(&bytes).unwrap_or_default();
    let cache = Cache::new(disk, &options.cache);
    let jobs = options.jobs.max(1);
    let threads = Arc::new(AtomicUsize::new(if options.jobserver.is_some() { 1 } else { jobs }));
    let world = World {
        graph,
        disk,
        options,
        cache,
        manifest,
        needed: graph.needed(targets),
        threads: threads.clone(),
        disowned: Mutex::default(),
    };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(jobs).stack_size(STACK_BYTES).build();
    let pool = pool.map_err(|error| Error::Threads(Box::new(error)))?;
    let one_more = move || {
        threads.fetch_add(1, Ordering::Relaxed);
    };
    let _lending = options.jobserver.clone().map(|jobserver| lend(&pool, jobserver, one_more));
    Ok(pool.install(|| work(&world)))
}

fn run_in(world: &World, progress: &dyn Progress) -> Report {
    let begun = Instant::now();
    let dry = world.options.dry_run;
    let probe = world.options.manifest.with_file_name("clock");
    let clock = if dry { Clock::stopped(world.disk) } else { Clock::new(world.disk, probe) };
    let survey = survey(world, &clock);
    let to_do =
        survey.steps.iter().filter(|verdict| !matches!(verdict, Verdict::UpToDate(_) | Verdict::Ignored)).count();
    let needed = world.needed.iter().filter(|needed| **needed).count();
    if let Some(until_ns) = world.options.clean.filter(|_| !dry) {
        remove_unfinished(world, until_ns);
    }
    let Dead { found, gone, warnings } = sweep(world);
    let mut report = Report {
        steps: Vec::with_capacity(needed),
        outputs: Vec::new(),
        changed_inputs: Vec::new(),
        dead_outputs: found,
        interrupted: false,
        warnings,
        remote: None,
        elapsed: begun.elapsed(),
    };
    if dry || (to_do == 0 && !survey.moved && gone.is_empty()) {
        progress.begin(needed - to_do, to_do, Duration::ZERO);
        report.steps = report_survey(world, &survey);
        report_outputs(world, |output| survey.outputs[output].digest(), |_| false, &mut report);
        return report;
    }
    let (survey, books) = carry_out(world, &clock, survey, progress, [needed, to_do], begun);
    let changed = changed_files(world, &survey);
    if books.unstored > 0 {
        let (count, path) = (books.unstored, world.options.cache.display());
        report.warnings.push(format!("{count} artefacts were not kept: {path} may not be written to"));
    }
    if let Err(error) = write_manifest(world, &survey, &books, &changed, gone) {
        let path = world.options.manifest.display();
        report
            .warnings
            .push(format!("{path} cannot be written: {error}; the next run has to look at everything again"));
    }
    if let Some(remote) = &world.options.remote {
        let finished = remote.finish(!world.options.interrupt.load(Ordering::Relaxed));
        report.warnings.extend(finished.warnings);
        report.remote = finished.said;
    }
    let changed = world.graph.files.iter().zip(changed).filter(|(_, changed)| *changed);
    report.changed_inputs = changed.map(|(path, _)| path.clone()).collect();
    let digest_of = |output: usize| {
        let slot = &books.slots[world.graph.outputs[output].step.index()];
        slot.artefact.filter(|_| slot.phase == Phase::Done).map(|artefact| artefact.digest)
    };
    report_outputs(world, digest_of, |output| books.written[output].is_some(), &mut report);
    report_steps(world, books.slots, &mut report);
    report.interrupted = world.options.interrupt.load(Ordering::Relaxed) && !report.is_success();
    report.elapsed = begun.elapsed();
    report
}

/// Runs what the survey found wanting; from the beginning, if others have said something wrong on the way.
fn carry_out(
    world: &World,
    clock: &Clock,
    mut seen: Survey,
    progress: &dyn Progress,
    [needed, to_do]: [usize; 2],
    begun: Instant,
) -> (Survey, Books) {
    loop {
        let disowned = world.disowned_count();
        let work = Work::new(world, &seen, progress, begun);
        progress.begin(needed - to_do, to_do, work.expected());
        let books = work.run();
        if world.disowned_count() == disowned {
            return (seen, books);
        }
        seen = survey(world, clock);
    }
}

/// Which input files have another stamp than at the survey.
fn changed_files(world: &World, survey: &Survey) -> Vec<bool> {
    par::map(survey.files.len(), |file| match &survey.files[file] {
        Seen::Known { stamp, .. } => world.disk.stamp(&world.graph.files[file]).ok().flatten() != Some(*stamp),
        _ => false,
    })
}

fn write_manifest(
    world: &World,
    survey: &Survey,
    books: &Books,
    changed: &[bool],
    forget_outputs: Vec<Vec<u8>>,
) -> std::io::Result<()> {
    let graph = world.graph;
    let files = survey.files.iter().zip(changed).map(|(seen, changed)| match seen.record() {
        Some(record) => Entry::New(FileRecord { stamp: record.stamp.filter(|_| !changed), ..record }),
        None => Entry::Old,
    });
    let steps = (0..graph.nodes.len()).map(|index| step_entry(world, survey, &books.slots, StepId::at(index)));
    let outputs = survey.outputs.iter().zip(&books.written).map(|(seen, written)| match (written, seen) {
        (Some(record), _) => Entry::New(*record),
        (None, Seen::Ignored | Seen::Faulty(_)) => Entry::Old,
        (None, seen) => seen.record().map_or(Entry::Drop, Entry::New),
    });
    let update = Update {
        files: files.collect(),
        steps: steps.collect(),
        outputs: outputs.collect(),
        keep_others: !world.options.whole_tree,
        forget_outputs,
    };
    world.disk.write(&world.options.manifest, &encode(graph, &world.manifest, &update))
}

fn step_entry(world: &World, survey: &Survey, slots: &[Slot], step: StepId) -> Entry<NewStep> {
    let slot = &slots[step.index()];
    if let Some(Outcome::Failed(Failure::NotDeterministic { .. })) = slot.report.as_ref().map(|report| &report.outcome)
    {
        // The cache has the new artefact: without a record here the next run goes by that.
        return Entry::Drop;
    }
    match (slot.phase, slot.artefact, input_digests(world, survey, slots, step)) {
        (Phase::Done, Some(artefact), Some(inputs)) => {
            let key = world.graph.key(step, &inputs);
            let Artefact { digest, len, wall_ms } = artefact;
            Entry::New(NewStep { key, artefact: digest, len, wall_ms, inputs })
        }
        _ => Entry::Old,
    }
}

fn report_outputs(
    world: &World,
    digest_of: impl Fn(usize) -> Option<super::Digest>,
    written: impl Fn(usize) -> bool,
    report: &mut Report,
) {
    for (index, output) in world.graph.outputs.iter().enumerate() {
        if world.needed[output.step.index()] {
            let step = world.graph.name(output.step).to_string();
            let (digest, written) = (digest_of(index), written(index));
            report.outputs.push(OutputReport { path: output.path.clone(), step, digest, written });
        }
    }
}

/// Steps as the survey has them: of a dry run, or of one with nothing to do.
fn report_survey(world: &World, survey: &Survey) -> Vec<StepReport> {
    let mut steps = Vec::new();
    for (node, verdict) in world.graph.nodes.iter().zip(&survey.steps) {
        let (outcome, reasons) = match verdict {
            Verdict::Ignored => continue,
            Verdict::UpToDate(_) => (Outcome::UpToDate, Vec::new()),
            Verdict::Restore(_, reasons) | Verdict::Run(_, reasons) => (Outcome::WouldRun, reasons.clone()),
            Verdict::Maybe(_) => (Outcome::WouldRun, Vec::new()),
            Verdict::Broken(sentence) => (Outcome::Failed(Failure::Input(sentence.clone())), Vec::new()),
            Verdict::Blocked(input) => (Outcome::Skipped(Some(world.graph.name(*input).to_string())), Vec::new()),
        };
        steps.push(step_report(node, verdict.artefact(), outcome, reasons));
    }
    steps
}

/// Steps as the schedule left them; what it never came to is skipped, because of the failure nearest to its root.
fn report_steps(world: &World, slots: Vec<Slot>, report: &mut Report) {
    let mut culprits: Vec<Option<StepId>> = vec![None; slots.len()];
    for (index, slot) in slots.into_iter().enumerate().filter(|(index, _)| world.needed[*index]) {
        let node = &world.graph.nodes[index];
        if slot.phase == Phase::Failed {
            culprits[index] = Some(StepId::at(index));
        } else if slot.phase != Phase::Done {
            culprits[index] = node.input_steps().find_map(|input| culprits[input.index()]);
        }
        report.steps.push(match (slot.report, slot.phase) {
            (Some(report), Phase::Done | Phase::Failed) => report,
            (_, Phase::Done) => step_report(node, slot.artefact, Outcome::UpToDate, Vec::new()),
            _ => {
                let because = culprits[index].map(|culprit| world.graph.name(culprit).to_string());
                step_report(node, None, Outcome::Skipped(because), Vec::new())
            }
        });
    }
}
