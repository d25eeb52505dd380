//! Recipe steps: the only place where kernels and the engine meet.
//!
//! One file per step: its parameters, what it reads, and a `run` that loads, calls one kernel and stores. [`plan`] turns
//! a recipe into a graph of them.
//!
//! ```text
//! maps ---> [sheet] ---> analyse ---------.
//!   |                                     v
//!   '----> prepare ---> field ---> synthesise ---> rasterise ---> encode, atlas glb, render
//!            ^                                        ^
//! surface ---+--> unwrap -----------------------------'    between synthesise and rasterise: [refine atlas]
//!
//! textons:  maps -> analyse textons; in place of synthesise: quilt -> blend mesh, blend sets, and the mesh of the former
//!           in place of the prepared one
//! lod:      its prepare ---> take from finest (instead of field and synthesise) ---> as above
//! tiles:    maps of each key ---> tile ---> tile texture, tile strip, one each per map
//!           in place of synthesise: prepared, field --> parametrise --> [effect areas] --> place in tile; the tile is the maps
//! canvas:   maps -------> analyse ----------> walk image ------> copy image ------------> encode
//! flipbook: flipbook ---> analyse flipbook -> walk flipbook ---> copy frame, one each --> encode
//! ```
//!
//! Architecture invariant: a step's result is a function of its inputs' bytes, its parameters and its `REVISION`. Raise
//! the revision whenever the same inputs give other bytes.

mod analyse;
mod canvas;
pub mod compare;
pub(crate) mod control;
mod encode;
pub mod errand;
mod field;
mod flipbook;
mod glb;
mod lod;
mod maps;
mod material_space;
pub mod painting;
pub mod plan;
mod prepare;
mod rasterise;
mod refine_atlas;
mod render;
mod report;
pub mod scenes;
pub(crate) mod sheet;
mod surface;
mod synthesise;
mod texton;
mod texton_quilt;
pub(crate) mod tile;
mod unwrap;

use crate::build::{Inputs, StepError};
use crate::io::artefact::Artefact;

/// Input `index` as a value.
fn read<T: Artefact>(inputs: &Inputs, index: usize) -> Result<T, StepError> {
    T::from_bytes(&inputs[index]).map_err(|e| format!("{}: {e}", inputs.label(index)).into())
}

/// The last part of a path, for names in messages and documents.
fn file_name(label: &str) -> &str {
    label.rsplit(['/', '\\']).next().unwrap_or(label)
}

/// Implements the fixed parts of a step: its kind, its revision and its name `recipe/what`; and that workers may do it, if its
/// work takes a second or so for every few megabytes that it reads and gives.
macro_rules! step_identity {
    ($kind:literal, $revision:literal, travels) => {
        super::step_identity!($kind, $revision);

        fn travels(&self) -> bool {
            true
        }
    };
    ($kind:literal, $revision:literal) => {
        fn name(&self) -> String {
            format!("{}/{}", self.recipe, $kind)
        }

        fn kind(&self) -> &'static str {
            $kind
        }

        fn revision(&self) -> u32 {
            $revision
        }
    };
}
use step_identity;
