//! Step: lay orientation and scale over the synthesis mesh (\[ZG03\] section 3).

use crate::build::{Inputs, Step, StepError, Visitor};
use crate::field::{
    self, Alignment, Field, Laid, OrientationConstraint, ScalarConstraint, SingularityConstraint, Symmetry,
};
use crate::io::artefact::Artefact;
use crate::mesh::{Topology, check::census};

use super::prepare::Prepared;

/// Reads the synthesis mesh.
pub(super) struct LayField {
    pub recipe: String,
    pub symmetry: Symmetry,
    pub orientation: Vec<OrientationConstraint>,
    pub singularities: Vec<SingularityConstraint>,
    pub align: Vec<Alignment>,
    /// Factors on the scale.
    pub scale: Vec<ScalarConstraint>,
}

impl Step for LayField {
    super::step_identity!("field", 2);

    fn describe(&self, v: &mut dyn Visitor) {
        v.param("symmetry", &self.symmetry);
        v.param("orientation", &self.orientation);
        v.param("singularities", &self.singularities);
        v.param("align", &self.align);
        v.param("scale", &self.scale);
    }

    fn run(&self, inputs: &Inputs) -> Result<Vec<u8>, StepError> {
        let prepared: Prepared = super::read(inputs, 0)?;
        let mesh = &prepared.mesh.mesh;
        let topology = Topology::new(mesh);
        let normals = mesh.vertex_normals();
        let (anchors, singular) = (&self.orientation, &self.singularities);
        let up = field::orientation(mesh, &topology, &normals, anchors, singular, &self.align, self.symmetry)?;
        let scale = field::scale(mesh, &topology, prepared.scale, &self.scale)?;
        let found = field::singularities(mesh, &topology, &normals, &up, self.symmetry);
        let singularities = field::singular_points(mesh, &found);
        let closed = census(mesh, &topology);
        let euler =
            (closed.boundary_edges + closed.non_manifold_edges + closed.flipped_edges == 0).then_some(closed.euler);
        Ok(Laid { field: Field { up, scale }, symmetry: self.symmetry, singularities, euler }.to_bytes())
    }
}
