//! What a run would do and why, without doing it: as values, as JSON and as a DOT graph.
//!
//! The JSON is a contract, raised to another version when a field changes its meaning or goes:
//!
//! ```json
//! {"version": 1, "steps": [
//!   {"name": "knot/analyse", "kind": "analyse", "state": "run", "reasons": ["`jumps` changed from 3 to 4"],
//!    "waits_for": [], "inputs": ["knot/decode"], "outputs": []}],
//!  "dead": ["out/old/old.glb"]}
//! ```
//!
//! `state` is `up-to-date`, `restore` (the artefact is in the cache, outputs are written from it), `run`, `maybe`
//! (depends on what the steps in `waits_for` give) or `broken` (an input is missing; `reasons` says which). Steps come
//! in an order in which they can run. `inputs` holds paths of files and names of steps. `dead` are outputs that no recipe makes any more.
//!
//! Unaware of: the terminal.

use std::path::PathBuf;

use serde_json::{Value, json};

use super::dead::sweep;
use super::graph::{Graph, Source, StepId};
use super::options::{Error, Options};
use super::run::in_world;
use super::survey::{Verdict, World, survey};
use crate::disk::{Clock, Disk};

/// A step and what would be done about it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PlannedStep {
    /// The step's name.
    pub name: String,
    /// The step's kind.
    pub kind: &'static str,
    /// What would be done.
    pub state: State,
    /// Paths of its input files and names of its input steps, in the order of declaration.
    pub inputs: Vec<PlannedInput>,
    /// Its output files.
    pub outputs: Vec<PathBuf>,
}

/// An input of a planned step.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum PlannedInput {
    /// A file.
    File(PathBuf),
    /// Another step, by name.
    Step(String),
}

/// What would be done about a step.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum State {
    /// Nothing.
    UpToDate,
    /// Output files are written from the cache, for these reasons.
    Restore(Vec<String>),
    /// It runs, for these reasons (unless the cache remembers the same work from some time before).
    Run(Vec<String>),
    /// It runs if one of these steps gives another artefact than before.
    Maybe(Vec<String>),
    /// It cannot run; why.
    Broken(String),
}

/// Plans `targets` (all steps, if there are none). Writes nothing; hashes only files whose stamp moved.
pub fn plan(graph: &Graph, targets: &[StepId], options: &Options, disk: &dyn Disk) -> Result<Vec<PlannedStep>, Error> {
    in_world(graph, targets, options, disk, |world| {
        let verdicts = survey(world, &Clock::stopped(disk)).steps;
        let planned =
            verdicts.into_iter().enumerate().filter_map(|(index, verdict)| planned_step(world, index, verdict));
        planned.collect()
    })
}

/// Outputs of recipes that are gone and that are still there, if the graph is of the whole tree.
pub fn dead_outputs(graph: &Graph, options: &Options, disk: &dyn Disk) -> Result<Vec<PathBuf>, Error> {
    in_world(graph, &[], &Options { dry_run: true, ..options.clone() }, disk, |world| sweep(world).found)
}

fn planned_step(world: &World, index: usize, verdict: Verdict) -> Option<PlannedStep> {
    let graph = world.graph;
    let state = match verdict {
        Verdict::Ignored => return None,
        Verdict::UpToDate(_) => State::UpToDate,
        Verdict::Restore(_, reasons) => State::Restore(reasons),
        Verdict::Run(_, reasons) => State::Run(reasons),
        Verdict::Maybe(steps) => State::Maybe(steps.into_iter().map(|step| graph.name(step).to_string()).collect()),
        Verdict::Broken(sentence) => State::Broken(sentence),
        Verdict::Blocked(step) => State::Broken(format!("`{}` cannot run", graph.name(step))),
    };
    let node = &graph.nodes[index];
    let input = |source: &Source| match source {
        Source::File(file) => PlannedInput::File(graph.files[*file].clone()),
        Source::Step(step) => PlannedInput::Step(graph.name(*step).to_string()),
    };
    Some(PlannedStep {
        name: node.name.clone(),
        kind: node.step.kind(),
        state,
        inputs: node.inputs.iter().map(input).collect(),
        outputs: node.outputs.iter().map(|&output| graph.outputs[output].path.clone()).collect(),
    })
}

impl State {
    /// The state's word in JSON.
    pub fn word(&self) -> &'static str {
        match self {
            State::UpToDate => "up-to-date",
            State::Restore(_) => "restore",
            State::Run(_) => "run",
            State::Maybe(_) => "maybe",
            State::Broken(_) => "broken",
        }
    }

    /// Why, where there is a reason.
    pub fn reasons(&self) -> &[String] {
        match self {
            State::Restore(reasons) | State::Run(reasons) => reasons,
            State::Broken(sentence) => std::slice::from_ref(sentence),
            State::UpToDate | State::Maybe(_) => &[],
        }
    }
}

/// The plan as JSON, one line (see the module's text for its fields).
pub fn to_json(plan: &[PlannedStep], dead: &[PathBuf]) -> String {
    let step = |step: &PlannedStep| {
        let waits_for: &[String] = if let State::Maybe(steps) = &step.state { steps } else { &[] };
        let inputs: Vec<String> = step.inputs.iter().map(PlannedInput::label).collect();
        let outputs: Vec<String> = step.outputs.iter().map(|path| path.display().to_string()).collect();
        json!({
            "name": step.name,
            "kind": step.kind,
            "state": step.state.word(),
            "reasons": step.state.reasons(),
            "waits_for": waits_for,
            "inputs": inputs,
            "outputs": outputs,
        })
    };
    let dead: Vec<String> = dead.iter().map(|path| path.display().to_string()).collect();
    json!({"version": 1, "steps": plan.iter().map(step).collect::<Vec<Value>>(), "dead": dead}).to_string()
}

/// The plan as a graph for `dot`: steps as ellipses, grey when up to date; files as boxes.
pub fn to_dot(plan: &[PlannedStep]) -> String {
    let mut dot = String::from("digraph kiln {\n  rankdir=LR;\n  node [fontname=\"sans-serif\"];\n");
    let mut files = std::collections::BTreeSet::new();
    for step in plan {
        let color = match step.state {
            State::UpToDate => "gray70",
            State::Restore(_) => "steelblue",
            State::Run(_) => "firebrick",
            State::Maybe(_) => "darkorange",
            State::Broken(_) => "black",
        };
        let name = quoted(&format!("step {}", step.name));
        let tooltip = quoted(&format!("{}: {}", step.state.word(), step.state.reasons().join("; ")));
        dot += &format!("  {name} [label={}, color={color}, tooltip={tooltip}];\n", quoted(&step.name));
        for input in &step.inputs {
            let from = match input {
                PlannedInput::Step(step) => format!("step {step}"),
                PlannedInput::File(_) => {
                    files.insert(input.label());
                    format!("file {}", input.label())
                }
            };
            dot += &format!("  {} -> {name};\n", quoted(&from));
        }
        for output in &step.outputs {
            let path = output.display().to_string();
            dot += &format!("  {name} -> {};\n", quoted(&format!("file {path}")));
            files.insert(path);
        }
    }
    for file in files {
        dot += &format!("  {} [label={}, shape=box];\n", quoted(&format!("file {file}")), quoted(&file));
    }
    dot + "}\n"
}

impl PlannedInput {
    /// Path or name.
    pub fn label(&self) -> String {
        match self {
            PlannedInput::File(path) => path.display().to_string(),
            PlannedInput::Step(name) => name.clone(),
        }
    }
}

/// A quoted DOT string.
fn quoted(text: &str) -> String {
    format!("\"{}\"", text.replace('\\', "\\\\").replace('"', "\\\"").replace('\n', "\\n"))
}
