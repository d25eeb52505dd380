//! Step: encode one image of a bundle as a file.

use crate::build::{Inputs, Step, StepError, Visitor};
use crate::io::image_file::{encode_exr, encode_png};
use crate::io::image_strips::Container;

use super::rasterise::Bundle;

/// Reads a bundle of images and writes the one called `image`.
pub(super) struct Encode {
    pub recipe: String,
    pub image: String,
    pub container: Container,
}

impl Step for Encode {
    fn name(&self) -> String {
        format!("{}/encode {}", self.recipe, self.image)
    }

    fn kind(&self) -> &'static str {
        "encode"
    }

    fn revision(&self) -> u32 {
        1
    }

    fn describe(&self, v: &mut dyn Visitor) {
        v.param("image", &self.image);
        v.param("container", &self.container);
    }

    fn run(&self, inputs: &Inputs) -> Result<Vec<u8>, StepError> {
        let bundle: Bundle = super::read(inputs, 0)?;
        let pixels = bundle.get(&self.image)?;
        Ok(match self.container {
            Container::Png { transfer, compression } => encode_png(pixels, compression, transfer)?,
            Container::Exr => encode_exr(pixels)?,
        })
    }
}
