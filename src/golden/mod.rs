//! Golden records: what a bake came out as when somebody looked and agreed.
//!
//! [`digest`] names decoded content, [`book`] keeps the names of a recipe's outputs and compares them, [`change`] tells
//! where they went another way, [`compare`], [`compare_glb`] and [`flip`] measure and show how two outputs differ, [`quality`]
//! how well a texture reproduces its sample, [`report`] writes it all down for people and for build servers. Values in,
//! values out: whoever calls reads and writes the files.
//!
//! # How it is worked with
//!
//! - `golden/<recipe>.toml` is in the repository, with a small picture of each image beside it. `kiln check` bakes every step
//!   from nothing, so neither a cache nor a forgotten revision hides anything, and fails on what differs, is new, is
//!   missing, or belongs to no recipe any more; on an analysis that is another one; and on a step that gives something
//!   else although its revision, parameters and inputs are as accepted.
//! - An output is the same to the bit or it differs, unless its entry has a `tolerance` by `max`, `mean`, `share` or `flip`,
//!   which is written by hand and stays when the output is accepted again.
//! - Who changed something looks at `kiln check --report page.html` and accepts: `kiln accept NAME`, or one by one with
//!   `--review`, and commits the change of `golden/` with that of the recipe. Figures of quality in the book say in the
//!   review whether it became better or worse.
//! - In CI, `kiln check --junit results.xml --report page.html` needs nothing but the repository; `kiln accept` refuses to work
//!   there. The night's run may add `--twice`, which bakes everything again in a process with other threads.
//! - Accepted files are kept in `.kiln/golden/` of the machine where they were accepted: there a mismatch is shown in full,
//!   elsewhere renders are, and of maps their thumbnails.

mod base64;
pub mod book;
pub mod change;
pub mod compare;
pub mod compare_glb;
pub mod digest;
mod digest_glb;
pub mod flip;
pub mod quality;
pub mod report;
mod thumb;

pub use thumb::thumbnail;
