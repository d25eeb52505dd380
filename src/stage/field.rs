//! Step: lay orientation and scale over the synthesis mesh (\[ZG03\] section 3).

use crate::build::{Inputs, Step, StepError, Visitor};
use crate::field::{
    self, Alignment, Field, Laid, OrientationConstraint, ScalarConstraint, Singularity, SingularityConstraint, Symmetry,
};
use crate::io::artefact::{Artefact, Damaged, Reader, Writer, read_turning, write_turning};
use crate::mesh::{Topology, check::census};
use crate::numerics::vec::Vec3;

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

/// What constraints with a radius change in the field of those without.
pub(super) struct FieldChange {
    /// Vertices whose direction changes, ascending.
    up: Vec<(u32, Vec3)>,
    /// Vertices whose scale changes, ascending.
    scale: Vec<(u32, f32)>,
    /// As in [`Laid`], of all of the surface.
    turning: Vec<(u32, f64)>,
    singularities: Vec<Singularity>,
}

impl FieldChange {
    fn new(before: &Field, after: &Field, turning: Vec<(u32, f64)>, singularities: Vec<Singularity>) -> Self {
        let vertices = || 0..after.up.len() as u32;
        let (up, scale) = (|v: u32| after.up[v as usize], |v: u32| after.scale[v as usize]);
        FieldChange {
            up: vertices().filter(|&v| up(v) != before.up[v as usize]).map(|v| (v, up(v))).collect(),
            scale: vertices().filter(|&v| scale(v) != before.scale[v as usize]).map(|v| (v, scale(v))).collect(),
            turning,
            singularities,
        }
    }

    /// Makes the change.
    pub fn apply(&self, field: &mut Field) -> Result<(), Damaged> {
        let beyond = |v: u32| Damaged(format!("vertex {v} of a field of {}", field.up.len()));
        if let Some(v) = self.up.iter().map(|c| c.0).chain(self.scale.iter().map(|c| c.0)).max()
            && v as usize >= field.up.len()
        {
            return Err(beyond(v));
        }
        self.up.iter().for_each(|&(v, up)| field.up[v as usize] = up);
        self.scale.iter().for_each(|&(v, scale)| field.scale[v as usize] = scale);
        Ok(())
    }
}

impl Artefact for FieldChange {
    const TAG: [u8; 4] = *b"fldc";

    fn write(&self, to: &mut Writer) {
        to.pairs(self.up.iter().copied());
        to.pairs(self.scale.iter().copied());
        write_turning(&self.turning, &self.singularities, to);
    }

    fn read(from: &mut Reader<'_>) -> Result<Self, Damaged> {
        let (up, scale) = (from.pairs()?.collect(), from.pairs()?.collect());
        let (turning, singularities) = read_turning(from)?;
        Ok(FieldChange { up, scale, turning, singularities })
    }
}

/// The field that is input `index`, changed by the next one if that is a change; and the index after them.
pub(super) fn laid(inputs: &Inputs, index: usize) -> Result<(Laid, usize), StepError> {
    let mut laid: Laid = super::read(inputs, index)?;
    if index + 1 == inputs.len() || !FieldChange::is_one(&inputs[index + 1]) {
        return Ok((laid, index + 1));
    }
    let change: FieldChange = super::read(inputs, index + 1)?;
    change.apply(&mut laid.field)?;
    (laid.turning, laid.singularities) = (change.turning, change.singularities);
    Ok((laid, index + 2))
}

/// The field within the areas of constraints with a radius, again: reads the synthesis mesh and the field of those
/// without. Gives what changes.
pub(super) struct LayAreas(pub LayField);

impl Step for LayAreas {
    fn name(&self) -> String {
        format!("{}/field of areas", self.0.recipe)
    }

    fn kind(&self) -> &'static str {
        "field of areas"
    }

    fn revision(&self) -> u32 {
        3
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
        let after = Field { up: after, scale: field::scale(mesh, &topo, ground.scale, scale)? };
        Ok(FieldChange::new(&before.field, &after, turning, singularities).to_bytes())
    }
}
