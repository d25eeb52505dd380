//! What a run did: the value that it returns, and the calls that it makes on the way.
//!
//! Unaware of: terminals.

use std::fmt;
use std::io;
use std::path::PathBuf;
use std::time::Duration;

use super::digest::Digest;
use super::graph::StepError;

/// What a run did, step by step in the order of the graph.
#[derive(Debug)]
pub struct Report {
    /// The steps that the targets need.
    pub steps: Vec<StepReport>,
    /// Their output files.
    pub outputs: Vec<OutputReport>,
    /// Input files that changed while the run went on. What was made is right for what was read; run again.
    pub changed_inputs: Vec<PathBuf>,
    /// Outputs of recipes that are gone, as they were written: still there, or removed if that was asked for.
    pub dead_outputs: Vec<PathBuf>,
    /// The run was asked to end before all was done.
    pub interrupted: bool,
    /// What went wrong without harm to the outputs.
    pub warnings: Vec<String>,
    /// What other machines did, where any were to be asked.
    pub remote: Option<String>,
    /// Time of the whole run.
    pub elapsed: Duration,
}

/// One step of a [`Report`].
#[derive(Debug)]
pub struct StepReport {
    /// The step's name.
    pub name: String,
    /// The step's kind.
    pub kind: &'static str,
    /// What became of it.
    pub outcome: Outcome,
    /// Why it was not simply up to date; in words.
    pub reasons: Vec<String>,
    /// Digest of its artefact, where there is one.
    pub artefact: Option<Digest>,
    /// Length of its artefact in bytes; 0 where there is none.
    pub len: u64,
    /// When it was begun, from the beginning of the run.
    pub start: Duration,
    /// How long it took, reading and writing included.
    pub duration: Duration,
    /// How long it was expected to take, by what it or others of its kind took before.
    pub expected: Duration,
    /// Which thread worked on it, from 0.
    pub thread: usize,
    /// What the step counted, if it ran.
    pub counters: Vec<(&'static str, u64)>,
}

/// What became of a step.
#[derive(Debug)]
#[non_exhaustive]
pub enum Outcome {
    /// Nothing to do.
    UpToDate,
    /// Output files were written from the cache; the step did not run.
    Restored,
    /// The step ran.
    Ran,
    /// It could not be done.
    Failed(Failure),
    /// Not begun, because of this step's failure, or because the run stopped.
    Skipped(Option<String>),
    /// Dry run: it would or may have to run.
    WouldRun,
}

/// Why a step failed.
#[derive(Debug)]
#[non_exhaustive]
pub enum Failure {
    /// The step said so.
    Step(StepError),
    /// The step panicked, with this message.
    Panic(String),
    /// An input file is missing or unreadable: the whole sentence.
    Input(String),
    /// An input file changed between hashing and reading it.
    InputChanged(PathBuf),
    /// The step gave other bytes than the last time for the same key.
    NotDeterministic {
        /// The artefact of last time.
        before: Digest,
        /// The artefact of this time.
        now: Digest,
    },
    /// A file could not be written.
    Write {
        /// What it is: an output's path or "the cache".
        what: String,
        /// Why.
        source: io::Error,
    },
}

impl std::error::Error for Failure {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Failure::Step(error) => error.source(),
            Failure::Write { source, .. } => Some(source),
            _ => None,
        }
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Failure::Step(error) => fmt::Display::fmt(error, f),
            Failure::Panic(message) => write!(f, "panicked: {message} (this is a bug in kiln)"),
            Failure::Input(sentence) => f.write_str(sentence),
            Failure::InputChanged(path) => write!(f, "{} changed during the run; run again", path.display()),
            Failure::NotDeterministic { before, now } => write!(
                f,
                "gave other bytes than before for the same inputs and parameters ({before}, now {now}): it depends on \
                 something else, or its revision was not raised. Run again to rebuild what depends on it"
            ),
            Failure::Write { what, .. } => write!(f, "cannot write {what}"),
        }
    }
}

/// One output file of a [`Report`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OutputReport {
    /// The file.
    pub path: PathBuf,
    /// The step whose artefact it is.
    pub step: String,
    /// Digest of its content; `None` if the step failed.
    pub digest: Option<Digest>,
    /// Whether this run wrote it.
    pub written: bool,
}

impl Report {
    /// Whether every step is up to date now.
    pub fn is_success(&self) -> bool {
        self.steps.iter().all(|step| !matches!(step.outcome, Outcome::Failed(_) | Outcome::Skipped(_)))
    }

    /// Whether there was nothing to do.
    pub fn is_noop(&self) -> bool {
        self.steps.iter().all(|step| matches!(step.outcome, Outcome::UpToDate))
    }

    /// Names of the steps that ran.
    pub fn ran(&self) -> impl Iterator<Item = &str> {
        self.steps.iter().filter(|step| matches!(step.outcome, Outcome::Ran)).map(|step| step.name.as_str())
    }

    /// Each failure with its step and all causes: "step `a/decode`: assets/a.png: not a PNG".
    pub fn failures(&self) -> impl Iterator<Item = String> {
        self.steps.iter().filter_map(|step| match &step.outcome {
            Outcome::Failed(failure) => Some(format!("step `{}`: {}", step.name, chain(failure))),
            _ => None,
        })
    }
}

/// An error and its sources, joined by colons.
fn chain(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut source = error.source();
    while let Some(error) = source {
        text.push_str(": ");
        text.push_str(&error.to_string());
        source = error.source();
    }
    text
}

/// Hears of a run while it goes on; called from all its threads.
pub trait Progress: Sync {
    /// The survey is done: so many steps are up to date, so many may have to run, which is expected to take so much time
    /// of one thread.
    fn begin(&self, _up_to_date: usize, _to_do: usize, _expected: Duration) {}
    /// A step runs now, for these reasons.
    fn start(&self, _step: &str, _reasons: &[String]) {}
    /// A step that was to do is done: ran, restored, failed, or up to date after all.
    fn done(&self, _step: &StepReport) {}
}

/// Progress for nobody.
pub struct Silent;

impl Progress for Silent {}
