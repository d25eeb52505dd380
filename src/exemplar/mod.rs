//! Analysis of a sample: for every texel, where else the sample looks alike.
//!
//! [`analyse`] is the way in: it reads as figure 2 of \[ZG02\], one file per step.

mod analysis;
mod appearance;
mod codec;
mod domain;
mod error;
mod jump_map;
mod matching;
mod neighbourhood;
mod params;
mod pyramid;
#[cfg(test)]
mod tests;

pub use analysis::{AnalysisReport, analyse, recall};
pub use appearance::{Appearance, appearance};
pub use domain::Domain;
pub use error::Error;
pub use jump_map::{FloatJump, Jump, JumpMap};
pub use params::AnalysisParams;
