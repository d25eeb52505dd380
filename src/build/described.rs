//! What a step is made of, for those who keep records of their own.
//!
//! Unaware of: keys, the manifest.

use std::path::Path;

use super::graph::{Graph, Source, StepId};

/// A step as its key sees it, but for the contents of its inputs.
#[derive(Clone, Debug)]
pub struct Described<'a> {
    /// The step's kind.
    pub kind: &'static str,
    /// The step's revision.
    pub revision: u32,
    /// Name and value of each parameter, in the step's order.
    pub params: &'a [(String, String)],
    /// The files that it reads itself.
    pub files: Vec<&'a Path>,
    /// Whether its artefact is wanted as a file.
    pub is_output: bool,
}

impl Graph {
    /// Describes a step of this graph.
    pub fn described(&self, step: StepId) -> Described<'_> {
        let node = &self.nodes[step.index()];
        let file = |source: &Source| match source {
            Source::File(file) => Some(self.files[*file].as_path()),
            Source::Step(_) => None,
        };
        Described {
            kind: node.step.kind(),
            revision: node.step.revision(),
            params: &node.params,
            files: node.inputs.iter().filter_map(file).collect(),
            is_output: !node.outputs.is_empty(),
        }
    }
}
