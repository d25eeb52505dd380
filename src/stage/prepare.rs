//! Step: weld and subdivide the surface into the synthesis mesh.

use crate::build::{Inputs, Step, StepError, Visitor};
use crate::io::artefact::{Artefact, Damaged, Reader, Writer, read_mesh};
use crate::mesh::{PrepareParams, Surface, SynthesisMesh, TriMesh, prepare};
use crate::numerics::vec::Vec3;

use super::material_space::Source;

/// Average longest edge as a share of the exemplar's shorter side that "auto" aims at: tau of \[MK03\] Eq. 1. At a tenth
/// a triangle shows a small piece of the sample and a 1-ring fits it with room to spare.
const AUTO_TAU: f64 = 0.1;

/// Texels per world unit.
#[derive(Clone, Copy, Debug)]
pub(super) enum Scale {
    Fixed(f64),
    /// From the mean longest edge of a triangle (\[MK03\] Eq. 1).
    Auto,
    /// That of another synthesis mesh.
    Same,
}

/// Reads the surface, the maps or the tile (for their size) and, for the same scale, another synthesis mesh.
pub(super) struct Prepare {
    pub recipe: String,
    pub scale: Scale,
    /// The greatest local factor on the scale.
    pub max_factor: f64,
    /// Part of the exemplar's shorter side that an edge may take; `None`: as the kernel has it.
    pub max_span_share: Option<f64>,
}

/// The synthesis mesh and the scale that it was made for.
pub(super) struct Prepared {
    /// Texels per world unit, before local factors.
    pub scale: f64,
    pub exemplar_size: [u32; 2],
    pub mesh: SynthesisMesh,
}

/// The mesh alone, without where its faces come from.
pub(super) struct Ground {
    pub scale: f64,
    pub exemplar_size: [u32; 2],
    pub mesh: TriMesh,
}

impl Prepared {
    /// What most steps want of it.
    pub fn ground(bytes: &[u8]) -> Result<Ground, Damaged> {
        let mut from = Self::open(bytes)?;
        Ok(Ground { scale: from.get()?, exemplar_size: from.get()?, mesh: read_mesh(&mut from)? })
    }

    /// Its scale, and how many vertices and faces it has.
    pub fn counts(bytes: &[u8]) -> Result<(f64, [usize; 2]), Damaged> {
        let mut from = Self::open(bytes)?;
        let scale = from.get()?;
        from.get::<[u32; 2]>()?;
        Ok((scale, [from.pass::<Vec3>()?, from.pass::<[u32; 3]>()?]))
    }
}

impl Artefact for Prepared {
    const TAG: [u8; 4] = *b"prep";

    fn write(&self, to: &mut Writer) {
        to.put(self.scale);
        to.put(self.exemplar_size);
        self.mesh.write(to);
    }

    fn read(from: &mut Reader<'_>) -> Result<Self, Damaged> {
        Ok(Prepared { scale: from.get()?, exemplar_size: from.get()?, mesh: SynthesisMesh::read(from)? })
    }
}

/// Scale at which the mean longest edge of a triangle takes [`AUTO_TAU`] of the exemplar's shorter side.
fn auto_scale(mesh: &TriMesh, exemplar_size: [u32; 2]) -> Result<f64, StepError> {
    let longest = |f: usize| {
        let [a, b, c] = mesh.corners(f);
        (b - a).length().max((c - b).length()).max((a - c).length())
    };
    let mean = (0..mesh.faces.len()).map(longest).sum::<f64>() / mesh.faces.len().max(1) as f64;
    let scale = AUTO_TAU * f64::from(exemplar_size[0].min(exemplar_size[1])) / mean;
    if scale.is_normal() { Ok(scale) } else { Err("scale = \"auto\" needs triangles with an area".into()) }
}

impl Step for Prepare {
    super::step_identity!("prepare", 3);

    fn describe(&self, v: &mut dyn Visitor) {
        v.param("scale", &self.scale);
        v.param("greatest factor", &self.max_factor);
        if let Some(share) = self.max_span_share {
            v.param("greatest share", &share);
        }
    }

    fn run(&self, inputs: &Inputs) -> Result<Vec<u8>, StepError> {
        let surface: Surface = super::read(inputs, 0)?;
        let source = Source::read(inputs, 1)?;
        let exemplar_size = [source.first().width(), source.first().height()];
        let scale = match self.scale {
            Scale::Fixed(scale) => scale,
            Scale::Auto => auto_scale(&surface.mesh, exemplar_size)?,
            Scale::Same => super::read::<Prepared>(inputs, 2)?.scale,
        };
        let mut params = PrepareParams::new(scale * self.max_factor, exemplar_size);
        params.max_span_share = self.max_span_share.unwrap_or(params.max_span_share);
        let mesh = prepare(&surface, &params)?;
        Ok(Prepared { scale, exemplar_size, mesh }.to_bytes())
    }
}
