//! Scenes of any kind that is read: glTF (text or binary) and OBJ.
//!
//! In: a file's name and bytes, and a way to read files beside it. Out: a [`Document`].
//! Unaware of: the file system.

pub use super::gltf::{Document, Summary};
use super::{SceneError, gltf, obj};

#[derive(Clone, Copy, PartialEq, Eq)]
enum Format {
    Gltf,
    Obj,
}

/// By content where that is clear, else by the extension of the name.
fn format(name: &str, bytes: &[u8]) -> Result<Format, SceneError> {
    let extension = name.rsplit_once('.').map_or(String::new(), |(_, e)| e.to_ascii_lowercase());
    let is_glb = bytes.starts_with(b"glTF");
    match extension.as_str() {
        _ if is_glb => Ok(Format::Gltf),
        "gltf" => Ok(Format::Gltf),
        "obj" => Ok(Format::Obj),
        "glb" if bytes.is_empty() => Err(SceneError::Container("the file is empty; expected a .glb".into())),
        "glb" => {
            let found = String::from_utf8_lossy(&bytes[..bytes.len().min(4)]);
            Err(SceneError::Container(format!("not a .glb: it begins with {found:?}, expected \"glTF\"")))
        }
        _ if bytes.trim_ascii_start().starts_with(b"{") => Ok(Format::Gltf),
        _ => Err(SceneError::Container(format!("\"{name}\" is of no kind that kiln reads: .glb, .gltf, .obj"))),
    }
}

/// Paths, relative to the scene, of the buffers and images that lie in files of their own.
///
/// Percent-encoding is undone. Refuses URIs of other schemes, absolute paths, and paths out of the scene's folder.
/// Material libraries of OBJ files are not read.
pub fn external_files(name: &str, bytes: &[u8]) -> Result<Vec<String>, SceneError> {
    match format(name, bytes)? {
        Format::Gltf => gltf::external_files(&gltf::parts(bytes)?.0),
        Format::Obj => Ok(Vec::new()),
    }
}

impl Document {
    /// Reads a scene and checks it. `resolve` gives the bytes of a file by its path relative to the scene; buffers must
    /// be there, an image that is not stays the reference that it was.
    pub fn parse(
        name: &str,
        bytes: &[u8],
        resolve: &mut dyn FnMut(&str) -> Result<Vec<u8>, String>,
    ) -> Result<Document, SceneError> {
        match format(name, bytes)? {
            Format::Gltf => Document::from_gltf(bytes, resolve),
            Format::Obj => {
                let (root, buffer) = obj::read(name, bytes)?;
                Document::new(root, vec![buffer], resolve)
            }
        }
    }
}
