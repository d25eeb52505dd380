//! What can be wrong with a scene.

use std::fmt;

/// Why a scene cannot be read, textured or written. The text says what was found and what is allowed; whoever read the
/// file adds its path.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum SceneError {
    /// The file is no glTF container, no UTF-8 or no JSON, or of no kind that is read.
    Container(String),
    /// A fault at a place in the JSON, such as `meshes[0].primitives[0].attributes.POSITION`.
    At {
        /// The place.
        path: String,
        /// What was found and what is allowed.
        what: String,
    },
    /// A fault in a line of an OBJ file.
    Line {
        /// Name of the file as given.
        file: String,
        /// Line, from 1.
        line: usize,
        /// What was found and what is allowed.
        what: String,
    },
    /// A file that the scene refers to is not followed or cannot be read.
    Uri {
        /// The URI as it stands in the scene.
        uri: String,
        /// Why.
        what: String,
    },
    /// An extension that the file needs and kiln does not read.
    Extension {
        /// Its name.
        name: String,
        /// What to do.
        what: String,
    },
    /// A material named in the recipe is not in the scene.
    Material {
        /// The name asked for.
        name: String,
        /// The names there are, in order.
        existing: Vec<String>,
    },
    /// The scene is in order but has no triangle to texture.
    Nothing(String),
    /// More than kiln takes; checked before memory is.
    TooLarge(String),
    /// Data to be written does not fit the scene (a caller's fault).
    Mismatch(String),
}

impl SceneError {
    /// A fault at a place in the JSON.
    pub(super) fn at(path: impl Into<String>, what: impl Into<String>) -> Self {
        SceneError::At { path: path.into(), what: what.into() }
    }
}

impl fmt::Display for SceneError {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            SceneError::At { path, what } => write!(f, "{path}: {what}"),
            SceneError::Line { file, line, what } => write!(f, "{file}:{line}: {what}"),
            SceneError::Uri { uri, what } => {
                let short: String = uri.chars().take(80).collect();
                write!(f, "uri \"{short}{}\": {what}", if short.len() < uri.len() { "..." } else { "" })
            }
            SceneError::Extension { name, what } => write!(f, "extension {name}: {what}"),
            SceneError::Material { name, existing } => {
                write!(f, "no material \"{name}\"")?;
                let near = existing.iter().map(|e| (strsim::jaro_winkler(e, name), e));
                if let Some((_, e)) = near.filter(|(s, _)| *s > 0.75).max_by(|a, b| a.0.total_cmp(&b.0)) {
                    write!(f, "; did you mean \"{e}\"?")?;
                }
                match existing.len() {
                    0 => write!(f, " (the scene has no named materials)"),
                    n => {
                        let shown: Vec<_> = existing.iter().take(20).map(|e| format!("\"{e}\"")).collect();
                        write!(f, " (there are {}{})", shown.join(", "), if n > 20 { ", ..." } else { "" })
                    }
                }
            }
            SceneError::Container(what)
            | SceneError::Nothing(what)
            | SceneError::TooLarge(what)
            | SceneError::Mismatch(what) => f.write_str(what),
        }
    }
}

impl std::error::Error for SceneError {}
