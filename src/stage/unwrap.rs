//! Step: lay the surface out on an atlas page, or keep its own UVs. Depends on the mesh alone, so a new texture never
//! redoes it.

use crate::bake::{self, Atlas, UnwrapParams};
use crate::build::{Inputs, Step, StepError, Visitor};
use crate::io::artefact::Artefact;
use crate::mesh::Surface;

/// Reads the surface.
pub(super) struct Unwrap {
    pub recipe: String,
    pub layout: Layout,
}

/// Where the UVs of the atlas come from.
#[derive(Clone, Debug)]
pub(super) enum Layout {
    New(UnwrapParams),
    /// A TEXCOORD set of the document, on a page of `size` texels a side.
    Keep {
        set: usize,
        size: u32,
    },
}

impl Step for Unwrap {
    super::step_identity!("unwrap", 1, travels);

    fn describe(&self, v: &mut dyn Visitor) {
        v.param("layout", &self.layout);
    }

    fn run(&self, inputs: &Inputs) -> Result<Vec<u8>, StepError> {
        let surface: Surface = super::read(inputs, 0)?;
        let atlas = match &self.layout {
            Layout::New(params) => bake::unwrap(&surface, params)?,
            Layout::Keep { set, size } => Atlas::keep(&surface, *set, *size)?,
        };
        Ok(atlas.to_bytes())
    }
}
