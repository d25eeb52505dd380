//! The engine: runs the steps that are stale, in parallel, and remembers what they gave.
//!
//! ```text
//!   Graph ---> survey ----> schedule ----> outputs, cache, manifest, Report ---> trace
//!  (steps,     stamps,      (threads)
//!   files)     keys  '----> plan ---> words, JSON, DOT
//! ```
//!
//! Beside the path: [`seal`] knows a run with nothing to do by stamps alone, `critical` says which steps are urgent, `lend`
//! takes threads from a make, `dead` finds what should not be there, `remote` is what may help from other machines.
//!
//! A step's key is the BLAKE3 of its kind, revision, parameters and its inputs' *contents*; its artefact is stored
//! under that key. So a step runs only if something that it depends on really differs, and a step that gives the same
//! bytes as before does not wake those after it. The manifest makes the common case cheap: if no stamp moved, nothing
//! is read.
//!
//! Two kilns on one tree do no harm to each other: everything is written atomically, entries of the cache are what
//! their names say, and a manifest that misses what the other wrote costs a look into the cache.
//!
//! How it is used, on the command line and in CI: [`guide`].
//!
//! Unaware of: textures, recipes, the command line.

#[doc = include_str!("guide.md")]
pub mod guide {}

mod books;
mod cache;
mod codec;
mod critical;
mod dead;
mod depfile;
mod described;
mod digest;
mod explain;
mod graph;
mod lend;
mod manifest;
mod options;
mod plan;
mod remote;
mod report;
mod run;
mod schedule;
pub mod seal;
mod survey;
mod trace;

#[cfg(test)]
mod history;
#[cfg(test)]
mod remote_tests;
#[cfg(test)]
mod run_tests;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod world;

pub use cache::{Cache, Copied, Record, Size};
pub use depfile::depfile;
pub use described::Described;
pub use digest::Digest;
pub use graph::{Bytes, Graph, GraphError, InputId, Inputs, Step, StepError, StepId, Visitor};
pub use options::{Error, Options};
pub use plan::{PlannedInput, PlannedStep, State, dead_outputs, plan, to_dot, to_json};
pub use remote::{ARTEFACT, Errand, Finished, INPUTS, ORDER, Remote, run_step};
pub use report::{Failure, Outcome, OutputReport, Progress, Report, Silent, StepReport};
pub use run::{artefacts, run};
pub use trace::chrome_trace;
