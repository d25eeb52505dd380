//! Step: decode the maps of the exemplar, all of one size, into linear values.

use crate::build::{Inputs, Step, StepError, Visitor};
use crate::io::artefact::Artefact;
use crate::io::image_set::{self, Options, Slot};

/// Reads the map files, one per slot, in this order.
pub(super) struct Maps {
    pub recipe: String,
    pub slots: Vec<Slot>,
    pub options: Options,
}

impl Step for Maps {
    super::step_identity!("maps", 1);

    fn describe(&self, v: &mut dyn Visitor) {
        v.param("maps", &self.slots);
        v.param("normal_y", &self.options.normal_y);
    }

    fn run(&self, inputs: &Inputs) -> Result<Vec<u8>, StepError> {
        let files: Vec<(Slot, &str, &[u8])> =
            self.slots.iter().enumerate().map(|(i, slot)| (*slot, inputs.label(i), &inputs[i])).collect();
        match image_set::load(&files, &self.options) {
            Ok(set) => Ok(set.to_bytes()),
            Err(faults) => Err(faults.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n").into()),
        }
    }
}
