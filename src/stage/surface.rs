//! Step: read the scene and take out the surface to be textured, in world units.

use crate::build::{Inputs, Step, StepError, Visitor};
use crate::io::artefact::Artefact;
use crate::io::named;
use crate::io::scene::Document;

/// Reads a scene; input 0 is its file, the others are the files it refers to.
pub(super) struct ReadSurface {
    pub recipe: String,
    pub scene: SceneFiles,
}

/// How to find a scene's parts among a step's inputs.
#[derive(Clone, Debug)]
pub(super) struct SceneFiles {
    /// URIs that the scene file refers to, in the order of the inputs that follow it.
    pub uris: Vec<String>,
    /// Names of the materials to be textured; `None` for all.
    pub materials: Option<Vec<String>>,
}

impl SceneFiles {
    pub fn describe(&self, v: &mut dyn Visitor) {
        v.param("files", &self.uris);
        v.param("materials", &self.materials);
    }

    /// How many inputs the scene takes.
    pub fn inputs(&self) -> usize {
        1 + self.uris.len()
    }

    /// The document, from the first inputs of a step.
    pub fn document(&self, inputs: &Inputs) -> Result<Document, StepError> {
        let mut resolve = |uri: &str| match self.uris.iter().position(|u| u == uri) {
            Some(i) => Ok(inputs[1 + i].to_vec()),
            None => Err("the file is not there".to_string()),
        };
        Document::parse(inputs.label(0), &inputs[0], &mut resolve).map_err(|e| named(inputs.label(0), &e).into())
    }
}

impl Step for ReadSurface {
    super::step_identity!("surface", 1);

    fn describe(&self, v: &mut dyn Visitor) {
        self.scene.describe(v);
    }

    fn run(&self, inputs: &Inputs) -> Result<Vec<u8>, StepError> {
        let document = self.scene.document(inputs)?;
        let surface = document.surface(self.scene.materials.as_deref()).map_err(|e| named(inputs.label(0), &e))?;
        Ok(surface.to_bytes())
    }
}
