//! The graph of steps: what is made from what.
//!
//! A step names its inputs when it is added, so they are there before it: the graph has no cycles and the order of
//! adding is an order of running.
//!
//! Unaware of: disk, cache, what the steps do.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::{self, Debug};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::digest::{Digest, Fields};

/// Why a step could not do its work; its sources are shown as the chain of causes.
pub type StepError = Box<dyn std::error::Error + Send + Sync>;

/// Receives a step's parameters.
pub trait Visitor {
    /// One parameter. What `{:?}` shows of `value` is what is hashed and what is shown to a human: it must hold every
    /// digit that the result depends on (derived `Debug` of numbers, strings, enums, slices and structs does).
    fn param(&mut self, name: &str, value: &dyn Debug);
}

/// A function from the contents of its inputs and from its parameters to bytes.
///
/// The same inputs, parameters and revision give the same bytes: no clock, path, environment or thread count.
pub trait Step: Send + Sync {
    /// Unique in the graph, for humans: `bricks/rasterise base_color`. Not part of the key.
    fn name(&self) -> String;
    /// What sort of step it is: `rasterise`. Part of the key.
    fn kind(&self) -> &'static str;
    /// Raised whenever the same inputs and parameters give other bytes than before.
    fn revision(&self) -> u32;
    /// The one walk over the parameters, in fixed order: from it come the key and the explanation of a rebuild.
    fn describe(&self, visitor: &mut dyn Visitor);
    /// About how many bytes the work takes at its peak, of inputs of these lengths and the artefact included: what keeps
    /// steps from running side by side that do not fit into memory together. Not part of the key.
    fn memory(&self, inputs: &[u64]) -> u64 {
        DECODED * inputs.iter().sum::<u64>()
    }
    /// Does the work. Runs on the engine's pool; loops of `numerics::par` stay on it.
    fn run(&self, inputs: &Inputs) -> Result<Vec<u8>, StepError>;
    /// Whether the work is so long against the bytes that it reads and gives that another machine may better do it.
    fn travels(&self) -> bool {
        false
    }
    /// What the artefact that was just made came with, in numbers, for the trace of the run.
    fn counters(&self, _artefact: &[u8]) -> Vec<(&'static str, u64)> {
        Vec::new()
    }
}

/// Bytes that a step takes for each byte of its inputs, if it does not know better: them, what is decoded of them, and as
/// much for what it makes.
const DECODED: u64 = 4;

/// Shared, immutable bytes of a file or an artefact; cloning copies nothing.
#[derive(Clone, Debug)]
pub struct Bytes(pub(super) Arc<Vec<u8>>);

impl From<Vec<u8>> for Bytes {
    fn from(bytes: Vec<u8>) -> Self {
        Bytes(Arc::new(bytes))
    }
}

impl std::ops::Deref for Bytes {
    type Target = [u8];
    fn deref(&self) -> &[u8] {
        &self.0
    }
}

/// What a running step is given: the bytes of its inputs, in the order in which they were declared.
#[derive(Debug, Default)]
pub struct Inputs(Vec<(String, Bytes)>);

impl Inputs {
    /// From labels (a file's path or a step's name) and bytes.
    pub fn new(items: Vec<(String, Bytes)>) -> Self {
        Inputs(items)
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Bytes of input `index`, as many as were declared.
    pub fn get(&self, index: usize) -> Option<&Bytes> {
        self.0.get(index).map(|(_, bytes)| bytes)
    }

    /// Path or step name of input `index`, for messages; empty if there is none.
    pub fn label(&self, index: usize) -> &str {
        self.0.get(index).map_or("", |(label, _)| label)
    }
}

/// Panics beyond the last declared input, as a slice does.
impl std::ops::Index<usize> for Inputs {
    type Output = [u8];
    fn index(&self, index: usize) -> &[u8] {
        &self.0[index].1
    }
}

/// A step of one graph.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct StepId(pub(super) u32);

impl StepId {
    pub(super) fn at(index: usize) -> Self {
        StepId(index as u32)
    }
    pub(super) fn index(self) -> usize {
        self.0 as usize
    }
}

/// Something that a step of the same graph can read: a file or another step's artefact.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct InputId(pub(super) Source);

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Source {
    File(usize),
    Step(StepId),
}

impl From<StepId> for InputId {
    fn from(step: StepId) -> Self {
        InputId(Source::Step(step))
    }
}

/// What is wrong with a graph as a whole.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum GraphError {
    /// Two different steps of one name.
    DuplicateName {
        /// The name.
        name: String,
    },
    /// Two steps would write one file.
    DuplicateOutput {
        /// The file.
        path: PathBuf,
        /// Who writes it first.
        first: String,
        /// Who writes it as well.
        second: String,
    },
    /// A step would overwrite a file that the graph reads.
    OutputIsInput {
        /// The file.
        path: PathBuf,
        /// Who writes it.
        step: String,
    },
}

impl std::error::Error for GraphError {}

impl fmt::Display for GraphError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            GraphError::DuplicateName { name } => {
                write!(f, "two different steps are called `{name}`; names must be unique")
            }
            GraphError::DuplicateOutput { path, first, second } => {
                write!(f, "{}: written by both `{first}` and `{second}`; each output needs one maker", path.display())
            }
            GraphError::OutputIsInput { path, step } => {
                write!(f, "{}: `{step}` would overwrite a file that is an input", path.display())
            }
        }
    }
}

/// One step as it stands in the graph.
pub(super) struct Node {
    pub step: Box<dyn Step>,
    pub name: String,
    pub params: Vec<(String, String)>,
    /// Digest of kind, revision and parameters: the key without the inputs.
    definition: Digest,
    pub inputs: Vec<Source>,
    pub outputs: Vec<usize>,
}

/// An output file: a copy of a step's artefact.
pub(super) struct Output {
    pub path: PathBuf,
    pub step: StepId,
}

/// Steps, the files that they read, and the files that are wanted.
#[derive(Default)]
pub struct Graph {
    pub(super) files: Vec<PathBuf>,
    pub(super) nodes: Vec<Node>,
    pub(super) outputs: Vec<Output>,
    file_ids: BTreeMap<Vec<u8>, usize>,
    identities: BTreeMap<(Digest, Vec<Source>), StepId>,
}

impl Graph {
    /// A graph of nothing.
    pub fn new() -> Self {
        Graph::default()
    }

    /// An input file; the same path gives the same id.
    pub fn add_file(&mut self, path: impl Into<PathBuf>) -> InputId {
        let path = tidy(path.into());
        let next = self.files.len();
        let id = *self.file_ids.entry(path.as_os_str().as_encoded_bytes().to_vec()).or_insert(next);
        if id == next {
            self.files.push(path);
        }
        InputId(Source::File(id))
    }

    /// A step and what it reads. If a step of the same kind, revision, parameters and inputs is there already, that
    /// one is returned (under its own name): ten recipes with one exemplar analyse it once.
    ///
    /// `inputs` must come from this graph.
    pub fn add_step(&mut self, step: Box<dyn Step>, inputs: &[InputId]) -> StepId {
        let mut params = Pairs(Vec::new());
        step.describe(&mut params);
        let definition = definition(step.kind(), step.revision(), &params.0);
        let inputs: Vec<Source> = inputs.iter().map(|input| input.0).collect();
        debug_assert!(inputs.iter().all(|source| match source {
            Source::File(file) => *file < self.files.len(),
            Source::Step(step) => step.index() < self.nodes.len(),
        }));
        let next = StepId::at(self.nodes.len());
        let id = *self.identities.entry((definition, inputs.clone())).or_insert(next);
        if id == next {
            let name = step.name();
            self.nodes.push(Node { step, name, params: params.0, definition, inputs, outputs: Vec::new() });
        }
        id
    }

    /// Wants the artefact of `step` as the file `path`. The same again changes nothing.
    pub fn add_output(&mut self, step: StepId, path: impl Into<PathBuf>) {
        let path = tidy(path.into());
        let outputs = &mut self.nodes[step.index()].outputs;
        if outputs.iter().all(|&output| self.outputs[output].path != path) {
            outputs.push(self.outputs.len());
            self.outputs.push(Output { path, step });
        }
    }

    /// How many different steps there are.
    pub fn step_count(&self) -> usize {
        self.nodes.len()
    }

    /// Name of a step.
    pub fn name(&self, step: StepId) -> &str {
        &self.nodes[step.index()].name
    }

    /// The output files of all steps, in the order of adding.
    pub fn outputs(&self) -> impl Iterator<Item = (StepId, &Path)> {
        self.outputs.iter().map(|output| (output.step, output.path.as_path()))
    }

    /// The input files, in the order of adding.
    pub fn files(&self) -> impl Iterator<Item = &Path> {
        self.files.iter().map(PathBuf::as_path)
    }

    /// The input files of these steps, in the order of adding.
    pub fn files_of(&self, steps: &[StepId]) -> impl Iterator<Item = &Path> {
        let sources = steps.iter().flat_map(|step| &self.nodes[step.index()].inputs);
        let files: BTreeSet<usize> = sources
            .filter_map(|source| match source {
                Source::File(file) => Some(*file),
                Source::Step(_) => None,
            })
            .collect();
        files.into_iter().map(|file| self.files[file].as_path())
    }

    /// Looks for names and outputs that are claimed twice and for outputs that are inputs.
    pub fn check(&self) -> Result<(), GraphError> {
        let mut names: Vec<&str> = self.nodes.iter().map(|node| node.name.as_str()).collect();
        names.sort_unstable();
        if let Some(pair) = names.windows(2).find(|pair| pair[0] == pair[1]) {
            return Err(GraphError::DuplicateName { name: pair[0].to_string() });
        }
        let mut outputs: Vec<(&[u8], usize)> = Vec::with_capacity(self.outputs.len());
        for (index, output) in self.outputs.iter().enumerate() {
            let path = output.path.as_os_str().as_encoded_bytes();
            if self.file_ids.contains_key(path) {
                let step = self.name(output.step).to_string();
                return Err(GraphError::OutputIsInput { path: output.path.clone(), step });
            }
            outputs.push((path, index));
        }
        outputs.sort_unstable();
        if let Some(pair) = outputs.windows(2).find(|pair| pair[0].0 == pair[1].0) {
            let of = |index: usize| self.name(self.outputs[index].step).to_string();
            let path = self.outputs[pair[0].1].path.clone();
            return Err(GraphError::DuplicateOutput { path, first: of(pair[0].1), second: of(pair[1].1) });
        }
        Ok(())
    }

    /// Key of a step with these inputs.
    pub fn step_key(&self, step: StepId, inputs: &[Bytes]) -> Digest {
        self.key(step, &inputs.iter().map(|bytes| Digest::of(bytes)).collect::<Vec<Digest>>())
    }

    /// Key of a step whose inputs have these contents: what its artefact is stored under.
    pub(super) fn key(&self, step: StepId, inputs: &[Digest]) -> Digest {
        let mut fields = Fields::new("kiln step");
        fields.add(self.nodes[step.index()].definition.as_bytes());
        inputs.iter().for_each(|input| fields.add(input.as_bytes()));
        fields.finish()
    }

    /// Path or name of an input.
    pub(super) fn label(&self, source: Source) -> String {
        match source {
            Source::File(file) => self.files[file].display().to_string(),
            Source::Step(step) => self.name(step).to_string(),
        }
    }

    /// Which steps `targets` need, themselves included; all if there are none.
    pub(super) fn needed(&self, targets: &[StepId]) -> Vec<bool> {
        let mut needed = vec![targets.is_empty(); self.nodes.len()];
        for target in targets {
            needed[target.index()] = true;
        }
        // Inputs come before the steps that read them: one pass from the last to the first reaches all.
        for index in (0..self.nodes.len()).rev().filter(|_| !targets.is_empty()) {
            if needed[index] {
                for step in self.nodes[index].input_steps() {
                    needed[step.index()] = true;
                }
            }
        }
        needed
    }
}

impl Node {
    /// The inputs that are steps.
    pub fn input_steps(&self) -> impl Iterator<Item = StepId> {
        self.inputs.iter().filter_map(|source| match source {
            Source::Step(step) => Some(*step),
            Source::File(_) => None,
        })
    }
}

/// Collects a description as text.
struct Pairs(Vec<(String, String)>);

impl Visitor for Pairs {
    fn param(&mut self, name: &str, value: &dyn Debug) {
        self.0.push((name.to_string(), format!("{value:?}")));
    }
}

fn definition(kind: &str, revision: u32, params: &[(String, String)]) -> Digest {
    let mut fields = Fields::new("kiln definition");
    fields.add(kind.as_bytes());
    fields.add(&revision.to_le_bytes());
    for (name, value) in params {
        fields.add(name.as_bytes());
        fields.add(value.as_bytes());
    }
    fields.finish()
}

/// One spelling for `a/b`, `./a/b`, `a//b` and `a/./b`; `..` stays, as links give it a meaning.
fn tidy(path: PathBuf) -> PathBuf {
    let bytes = path.as_os_str().as_encoded_bytes();
    let odd = bytes.starts_with(b"./") || bytes.windows(2).any(|pair| pair == b"//" || pair == b"/.");
    if !odd {
        return path;
    }
    path.components().filter(|part| !matches!(part, std::path::Component::CurDir)).collect()
}
