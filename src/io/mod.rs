//! Files to values and back: images, scenes, artefacts.

pub mod artefact;
pub mod gltf;
mod image_exr;
pub mod image_file;
mod image_jpeg;
mod image_pixels;
mod image_png;
pub mod image_quantise;
pub mod image_restore;
pub mod image_set;
pub mod image_strips;
pub mod ktx2;
mod obj;
pub mod scene;
mod scene_error;
pub mod source_file;
pub mod steering;

pub use image_pixels::{Pixels, SampleType, Samples};
pub use scene_error::SceneError;

/// An error of a scene with the name of its file, which only faults of single lines bear themselves.
pub fn named(file: &str, error: &SceneError) -> String {
    let text = error.to_string();
    if text.starts_with(file) { text } else { format!("{file}: {text}") }
}
