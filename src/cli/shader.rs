//! `kiln shader`: the reference consumers of UV sets.

use super::args::ShaderLanguage;
use super::{Done, Stop};

/// Prints a shader.
pub(super) fn run(language: ShaderLanguage) -> Result<Done, Stop> {
    Done::ok(match language {
        ShaderLanguage::Glsl => include_str!("shader/kiln_uv_sets.glsl"),
        ShaderLanguage::Wgsl => include_str!("shader/kiln_uv_sets.wgsl"),
        ShaderLanguage::Three => include_str!("shader/kiln_uv_sets.js"),
    })
}
