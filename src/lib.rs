//! kiln bakes textures onto meshes from small samples.
//!
//! # Map
//!
//! ```text
//!                                main
//!                                 |
//!                                cli                    flags, exit codes, terminal
//!          .-----------.---------+---------.-----------.
//!        recipe      stage               build       golden
//!       TOML, faults   one file per step   graph, cache  digest, book, compare
//!                      |                     |  '-- remote (feature): servers, workers
//!   ===================|===== pure from here down: values in, values out =========
//!   exemplar  field  synth  tile  param  bake  render |   io --- disk
//!   uvset  texture  mesh  numerics
//! ```
//!
//! The path of the data: `io` decodes maps and a scene; [`exemplar`] analyses the maps into a jump map or textons; [`tile`] grows
//! layers between key exemplars; [`mesh`] welds
//! and subdivides the scene into the synthesis mesh; [`field`] lays an orientation over it and turns every edge into an
//! offset in texels; [`synth`] walks the vertices or quilts the faces, or [`param`] lays periodic coordinates, and corner coordinates come out, the narrow waist [`uvset`]; [`bake`]
//! unwraps and rasterises that into an atlas; [`render`] looks at it. [`stage`] wraps each of these kernels as a step,
//! [`build`] runs the steps that are stale, [`golden`] compares what came out with what was accepted.
//!
//! # Architecture invariants
//!
//! - The engine (`build`) knows no texture; the kernels know no engine; `stage` is the only place where they meet.
//! - `bake` consumes any [`uvset::UvSets`]; it never asks which method made it.
//! - Each outside crate has one door: clap and signal-hook in `cli`; schemars in `recipe`; image, png, exr and gltf in `io`; rayon in
//!   `numerics::par` and `build`; tempfile in `disk`; xatlas in `bake`; tonic, tokio and their like in `remote`. `tests/architecture.rs` holds the `use` lines to this.
//! - Only `disk` touches the file system.
//! - Same inputs give the same bytes for any thread count, profile and CPU: see [`numerics`].
//!
//! # Keys to the sources
//!
//! - `[ZG02]` Zelinka, Garland: Towards Real-Time Texture Synthesis with the Jump Map (2002).
//! - `[ZG03]` Zelinka, Garland: Interactive Texture Synthesis on Surfaces Using Jump Maps (2003).
//! - `[MK03]` Magda, Kriegman: Fast Texture Synthesis on Arbitrary Meshes (2003).
//! - `[MST09]` Ray, Lévy, Wang, Turk, Vallet: Material Space Texturing (2009).
#![deny(unsafe_code)]
#![warn(missing_docs)]

pub mod bake;
pub mod build;
pub mod cli;
pub mod disk;
pub mod exemplar;
pub mod field;
pub mod golden;
pub mod io;
pub mod mesh;
pub mod numerics;
pub mod param;
pub mod recipe;
#[cfg(feature = "remote")]
pub mod remote;
pub mod render;
pub mod stage;
pub mod synth;
pub mod texture;
pub mod tile;
pub mod uvset;
