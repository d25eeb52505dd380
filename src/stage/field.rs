//! Step: lay orientation and scale over the synthesis mesh (\[ZG03\] section 3).

use crate::build::{Inputs, Step, StepError, Visitor};
use crate::field::{self, Field, OrientationConstraint, ScalarConstraint, SingularityConstraint, Symmetry};
use crate::io::artefact::Artefact;
use crate::mesh::Topology;

use super::prepare::Prepared;

/// Reads the synthesis mesh.
pub(super) struct LayField {
    pub recipe: String,
    pub symmetry: Symmetry,
    pub orientation: Vec<OrientationConstraint>,
    pub singularities: Vec<SingularityConstraint>,
    /// Factors on the scale.
    pub scale: Vec<ScalarConstraint>,
}

impl Step for LayField {
    super::step_identity!("field", 1);

    fn describe(&self, v: &mut dyn Visitor) {
        v.param("symmetry", &self.symmetry);
        v.param("orientation", &self.orientation);
        v.param("singularities", &self.singularities);
        v.param("scale", &self.scale);
    }

    fn run(&self, inputs: &Inputs) -> Result<Vec<u8>, StepError> {
        let prepared: Prepared = super::read(inputs, 0)?;
        let mesh = &prepared.mesh.mesh;
        let topology = Topology::new(mesh);
        let normals = mesh.vertex_normals();
        let up = field::orientation(mesh, &topology, &normals, &self.orientation, &self.singularities, self.symmetry)?;
        let scale = field::scale(mesh, &topology, prepared.scale, &self.scale)?;
        Ok(Field { up, scale }.to_bytes())
    }
}
