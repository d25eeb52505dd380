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
    super::step_identity!("field", 3);

    fn describe(&self, v: &mut dyn Visitor) {
        v.param("symmetry", &self.symmetry);
        v.param("orientation", &self.orientation);
        v.param("singularities", &self.singularities);
        v.param("align", &self.align);
        v.param("scale", &self.scale);
    }

    fn run(&self, inputs: &Inputs) -> Result<Vec<u8>, StepError> {
        let ground = Prepared::ground(&inputs[0])?;
        let mesh = &ground.mesh;
        let topology = Topology::new(mesh);
        let normals = mesh.vertex_normals();
        let (anchors, singular) = (&self.orientation, &self.singularities);
        let up = field::orientation(mesh, &topology, &normals, anchors, singular, &self.align, self.symmetry)?;
        let scale = field::scale(mesh, &topology, ground.scale, &self.scale)?;
        let turning = field::singularities(mesh, &topology, &normals, &up, self.symmetry);
        let singularities = field::singular_points(mesh, &turning);
        let closed = census(mesh, &topology);
        let euler =
            (closed.boundary_edges + closed.non_manifold_edges + closed.flipped_edges == 0).then_some(closed.euler);
        let field = Field { up, scale };
        Ok(Laid { field, normals, symmetry: self.symmetry, turning, singularities, euler }.to_bytes())
    }
}

/// The field within the areas of constraints with a radius, again: reads the synthesis mesh and the field of those
/// without.
pub(super) struct LayAreas(pub LayField);

impl Step for LayAreas {
    fn name(&self) -> String {
        format!("{}/field of areas", self.0.recipe)
    }

    fn kind(&self) -> &'static str {
        "field of areas"
    }

    fn revision(&self) -> u32 {
        2
    }

    fn describe(&self, v: &mut dyn Visitor) {
        self.0.describe(v);
    }

    fn run(&self, inputs: &Inputs) -> Result<Vec<u8>, StepError> {
        let LayField { recipe: _, symmetry, orientation, singularities, align, scale } = &self.0;
        let ground = Prepared::ground(&inputs[0])?;
        let before: Laid = super::read(inputs, 1)?;
        let mesh = &ground.mesh;
        let (topo, normals) = (Topology::new(mesh), &before.normals);
        let (on, up) = ((mesh, &topo, &normals[..]), &before.field.up);
        let after = field::orientation_in_areas(on, up, orientation, singularities, align, *symmetry)?;
        let changed: Vec<u32> = (0..after.len() as u32).filter(|&v| up[v as usize] != after[v as usize]).collect();
        let turning = field::singularities_again(on, &after, *symmetry, &changed, &before.turning);
        let singularities = field::singular_points(mesh, &turning);
        let scale = field::scale(mesh, &topo, ground.scale, scale)?;
        Ok(Laid { field: Field { up: after, scale }, turning, singularities, ..before }.to_bytes())
    }
}
