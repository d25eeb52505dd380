//! Golden records: what a bake came out as when somebody looked and agreed.
//!
//! [`digest`] names decoded content, [`book`] keeps the names of a recipe's outputs and compares them, [`compare`]
//! measures and shows how two images differ, [`report`] writes it all down for people and for build servers. Values in,
//! values out: whoever calls reads and writes the files.

mod base64;
pub mod book;
pub mod compare;
pub mod compare_glb;
pub mod digest;
mod digest_glb;
pub mod flip;
pub mod quality;
pub mod report;
mod thumb;

pub use thumb::thumbnail;
