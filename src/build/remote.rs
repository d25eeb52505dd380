//! Other machines, as the engine sees them: somebody who may know what a key gave, and workers who may make it.
//!
//! Nothing relies on them. Whatever they give is checked against its digest before it is used, and what they do not give is
//! made here. A record is believed until its bytes are wanted; if a step then gives other bytes than the record says, the
//! run begins again without the others.
//!
//! Unaware of: networks.

use std::fmt::Debug;

use super::cache::Record;
use super::digest::Digest;
use super::graph::{Bytes, Graph, Inputs, StepError, StepId};

/// In a worker's folder: what it is to do.
pub const ORDER: &str = "order";
/// In a worker's folder: the folder of what the step reads.
pub const INPUTS: &str = "inputs";
/// In a worker's folder: what the step gives.
pub const ARTEFACT: &str = "artefact";

/// A step that may be done elsewhere.
#[derive(Debug)]
pub struct Errand<'a> {
    /// Which step of the graph.
    pub step: StepId,
    /// Its name.
    pub name: &'a str,
    /// Its key.
    pub key: &'a Digest,
    /// What it reads.
    pub inputs: &'a Inputs,
}

/// A cache, and perhaps workers, on other machines.
///
/// No call fails: whoever cannot help says nothing, and tells why in [`Remote::finish`]. Calls return within a bounded
/// time, and at once when the other side has been given up.
pub trait Remote: Debug + Send + Sync {
    /// Which artefact `key` gave somewhere.
    fn record(&self, key: &Digest) -> Option<Record>;
    /// The bytes of that artefact; the caller checks its digest.
    fn load(&self, key: &Digest, record: &Record) -> Option<Vec<u8>>;
    /// Tells the others what `key` gave here. May return before that is done.
    fn store(&self, key: &Digest, record: &Record, artefact: &Bytes);
    /// Has a step done elsewhere.
    fn execute(&self, errand: &Errand) -> Option<Vec<u8>>;
    /// Gives the others up for the rest of the run, as they said something wrong.
    fn distrust(&self, why: &str);
    /// Waits until what was to be told is told, unless there is no time for it.
    fn finish(&self, wait: bool) -> Finished;
}

/// How it went with others.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Finished {
    /// What they did, in a sentence.
    pub said: Option<String>,
    /// What went wrong.
    pub warnings: Vec<String>,
}

/// Does the step of `graph` that has this key with these inputs: what a worker does. `None` if there is no such step.
pub fn run_step(graph: &Graph, key: &Digest, inputs: Vec<Bytes>) -> Option<Result<Vec<u8>, StepError>> {
    let digests: Vec<Digest> = inputs.iter().map(|bytes| Digest::of(bytes)).collect();
    let asked = |index: &usize| {
        let of = |step| graph.key(step, &digests) == *key;
        graph.nodes[*index].inputs.len() == digests.len() && of(StepId::at(*index))
    };
    let node = &graph.nodes[(0..graph.nodes.len()).find(asked)?];
    let items = node.inputs.iter().zip(inputs).map(|(source, bytes)| (graph.label(*source), bytes));
    Some(node.step.run(&Inputs::new(items.collect())))
}
