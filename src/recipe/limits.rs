//! The ranges of a recipe's numbers, for the schema, its faults and the command line alike.
//!
//! Limits are either the meaning of the key (a share lies in 0..=1) or a bound on memory and time.

use std::ops::RangeInclusive;

/// Largest recipe or `kiln.toml`, in bytes.
pub const FILE_BYTES: u64 = 1 << 20;
/// Longest times for a server, in seconds.
pub const REMOTE_TIMEOUT: RangeInclusive<u64> = 1..=86_400;
/// Sides of a canvas, in texels: where GPUs end.
pub const CANVAS_SIDE: RangeInclusive<u32> = 1..=16384;
/// Frames of an output flipbook.
pub const FRAMES: RangeInclusive<u32> = 1..=4096;
/// Frames of an exemplar.
pub const EXEMPLAR_FRAMES: RangeInclusive<usize> = 2..=1024;
/// Largest output flipbook, in texels of all frames.
pub const FLIPBOOK_TEXELS: u64 = 1 << 26;
/// Side of an atlas, in texels.
pub const ATLAS_SIDE: RangeInclusive<u32> = 16..=16384;
/// Gutter around charts, in texels.
pub const GUTTER: RangeInclusive<u32> = 0..=256;
/// Number of a mesh's own TEXCOORD set.
pub const KEEP_UV: RangeInclusive<u32> = 0..=7;
/// Side of a golden view, in pixels.
pub const RENDER_SIDE: RangeInclusive<u32> = 16..=8192;
/// Pixels of all views of one golden render.
pub const RENDER_PIXELS: u64 = 1 << 28;
/// Golden views of one recipe.
pub const RENDERS: usize = 64;
/// Views of one turntable.
pub const TURNTABLE: RangeInclusive<u32> = 1..=360;
/// Vertical field of view, in degrees.
pub const FOV_DEG: RangeInclusive<f64> = 1.0..=170.0;
/// Side of a neighbourhood, in texels; odd.
pub const NEIGHBOURHOOD: RangeInclusive<u32> = 1..=33;
/// Levels of a neighbourhood.
pub const LEVELS: RangeInclusive<usize> = 1..=8;
/// Jumps per texel, k.
pub const JUMPS: RangeInclusive<u32> = 1..=64;
/// Share of the variance that the reduced neighbourhoods keep.
pub const VARIANCE: RangeInclusive<f64> = 0.1..=1.0;
/// Leniency of \[ZG02\] Eq. 1.
pub const ALPHA: RangeInclusive<f64> = 0.01..=100.0;
/// Candidates per jump, beta.
pub const DIVERSITY: RangeInclusive<u32> = 1..=64;
/// Radius of the Poisson disc, in texels.
pub const MIN_DISTANCE: RangeInclusive<f64> = 0.0..=4096.0;
/// Side of a texton window, in texels; odd.
pub const WINDOW: RangeInclusive<u32> = 3..=33;
/// Number of textons; the table of their distances grows with its square.
pub const TEXTONS: RangeInclusive<u32> = 2..=4096;
/// Orientations in which textons are known.
pub const ROTATIONS: RangeInclusive<u32> = 1..=64;
/// Places that are ranked for a piece of a quilt.
pub const CANDIDATES: RangeInclusive<u32> = 1..=4096;
/// Continuity error above which edges are blended: a distance of colours.
pub const BLEND_THRESHOLD: RangeInclusive<f64> = 0.0..=1000.0;
/// Keys of a material-space tile after the first.
pub const KEYS: usize = 255;
/// Layers of a material-space tile.
pub const LAYERS: RangeInclusive<u32> = 2..=256;
/// Texels per mesh unit.
pub const SCALE: RangeInclusive<f64> = 1e-6..=1e9;
/// Local factor on the scale.
pub const FACTOR: RangeInclusive<f64> = 0.01..=100.0;
/// Mean distance between jumps, in exemplar sides.
pub const PATCH: RangeInclusive<f64> = 0.01..=100.0;
/// What differences from a guide count against seams.
pub const GUIDE_WEIGHT: RangeInclusive<f64> = 0.01..=100.0;
/// Samples after the first.
pub const SAMPLES: usize = 63;
/// Correction passes.
pub const REFINE: RangeInclusive<u32> = 0..=16;
/// Power of the blend weights.
pub const SHARPNESS: RangeInclusive<u32> = 1..=16;
/// Simplified meshes beside the finest.
pub const LODS: usize = 16;
/// Largest seed.
pub const SEED: RangeInclusive<u64> = 0..=i64::MAX as u64;
/// Coordinates of points and directions, in mesh units.
pub const COORDINATE: RangeInclusive<f64> = -1e9..=1e9;
/// Geodesic radius of a constraint, in mesh units.
pub const RADIUS: RangeInclusive<f64> = 1e-9..=1e9;
/// Index of a singularity, in turns.
pub const INDEX: RangeInclusive<f64> = -8.0..=8.0;
/// Weight of a map in the similarity.
pub const IMPORTANCE: RangeInclusive<f64> = 0.0..=1000.0;
/// Distance within which corners share a vertex, in texels.
pub const WELD: RangeInclusive<f64> = 0.0..=16.0;
