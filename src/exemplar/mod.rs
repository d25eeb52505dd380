//! Analysis of a sample: for every texel, where else the sample looks alike.
//!
//! [`analyse`] is the way in: it reads as figure 2 of \[ZG02\], one file per step. [`analyse_textons`] is the other, \[MK03\].

mod analysis;
mod appearance;
mod codec;
mod domain;
mod error;
mod fill;
mod flipbook;
mod jump_map;
mod jump_volume;
mod matching;
mod neighbourhood;
mod params;
mod pyramid;
mod range_coder;
mod sheet;
#[cfg(test)]
mod tests;
mod texton;
mod texton_error;
mod texton_features;
mod texton_filters;

pub use analysis::{AnalysisReport, analyse, analyse_measured, analyse_sheet};
pub use appearance::{Appearance, appearance, appearance_sheet};
pub use codec::JUMP_MAP_MAGIC;
pub use domain::Domain;
pub use error::Error;
pub use flipbook::{analyse_flipbook, check_flipbook_size};
pub use jump_map::{FloatJump, Jump, JumpMap};
pub use jump_volume::{JumpVolume, VolumeJump};
pub(crate) use neighbourhood::feature_planes;
pub use params::AnalysisParams;
pub(crate) use pyramid::Pyramid;
pub use sheet::{Area, Sample, Sheet};
pub use texton::{TextonMap, TextonParams, TextonReport, analyse_textons};
pub use texton_error::TextonError;
pub use texton_features::TextonFeatures;
