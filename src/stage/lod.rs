//! Step: give a simplification of a mesh the texture that the mesh has.

use crate::build::{Inputs, Step, StepError, Visitor};
use crate::io::artefact::Artefact;
use crate::synth::mesh::lod::transfer;

use super::prepare::Prepared;
use super::synthesise::{Counters, Synthesised};

/// Reads the finest synthesis mesh, what was synthesised on it and the synthesis mesh of the level.
pub(super) struct TakeFromFinest {
    pub recipe: String,
}

impl Step for TakeFromFinest {
    super::step_identity!("level of detail", 2);

    fn describe(&self, _: &mut dyn Visitor) {}

    fn run(&self, inputs: &Inputs) -> Result<Vec<u8>, StepError> {
        let finest: Prepared = super::read(inputs, 0)?;
        let synthesised: Synthesised = super::read(inputs, 1)?;
        let level: Prepared = super::read(inputs, 2)?;
        let sets = transfer(&finest.mesh.mesh, &synthesised.sets, &level.mesh.mesh);
        Ok(Synthesised { sets, counters: Counters::Taken, metric: vec![] }.to_bytes())
    }
}
