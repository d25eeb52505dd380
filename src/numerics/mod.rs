//! Deterministic maths: the same bits for any thread count, build profile and CPU.
//!
//! Transcendental functions come from [`det`] (libm), never from std, whose results are the platform's. Random numbers
//! are addressed by key ([`rng`]), not drawn from a stream. Parallel loops ([`par`]) work on fixed chunks, and sums are
//! folded in index order. Nothing here contracts a multiplication and an addition into one rounding.

pub mod cg;
pub mod csr;
pub mod det;
pub mod eigen;
pub mod kmeans;
pub mod knn;
pub mod mincut;
pub mod multigrid;
pub mod par;
pub mod pca;
pub mod rng;
pub mod vec;
