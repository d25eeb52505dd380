//! The narrow waist: texture coordinates of the sample at the corners of the synthesis mesh, and how to blend them.
//!
//! Every method ends here and every output starts here. Source: \[ZG03\] sections 4.3 and 4.4; \[MK03\] 3.3; \[MST09\] 3.

pub mod metric;

use crate::texture::Texel;

/// How the sets of one surface point are combined.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Blend {
    /// Weighted mean (\[ZG03\] 4.4).
    Linear,
    /// Weighted mean about the sample's mean, stretched so that the variance of one sample is kept.
    Variance,
    /// The set of greatest weight alone (the first of equals).
    Nearest,
}

/// Corner coordinates of one synthesis mesh in one exemplar.
///
/// Corner `c` belongs to face `c / 3`. Within one set the three corners of a face are consistent: they lie in one
/// region of the exemplar, without a jump between them.
#[derive(Clone, Debug, PartialEq)]
pub struct UvSets {
    /// Size of the exemplar in texels.
    pub exemplar_size: [u32; 2],
    /// `sets[s][corner]`: position in the exemplar in texels. One to four sets, all of the same length.
    pub sets: Vec<Vec<Texel>>,
    /// `weights[corner][s]`: the weight of set `s` at the corner; unused sets 0, the sum 1.
    pub weights: Vec<[f32; 4]>,
    /// How to combine the sets.
    pub blend: Blend,
    /// Power to which interpolated weights are raised before they are made to sum to 1, at least 1: the higher, the
    /// narrower the blend.
    pub sharpness: u32,
    /// Position on the material axis at each corner, 0..=1, for a tile of several layers, which wraps in both directions
    /// (\[MST09\]); empty for an exemplar.
    pub material: Vec<f32>,
}

impl UvSets {
    /// Number of faces.
    pub fn face_count(&self) -> usize {
        self.weights.len() / 3
    }

    /// Position of set `set` at barycentric coordinates `bary` of `face`.
    pub fn at(&self, set: usize, face: usize, bary: [f32; 3]) -> Texel {
        let c = &self.sets[set][3 * face..3 * face + 3];
        Texel {
            x: c[0].x * bary[0] + c[1].x * bary[1] + c[2].x * bary[2],
            y: c[0].y * bary[0] + c[1].y * bary[1] + c[2].y * bary[2],
        }
    }

    /// Weights of all sets at barycentric coordinates `bary` of `face`.
    pub fn weights_at(&self, face: usize, bary: [f32; 3]) -> [f32; 4] {
        let w = &self.weights[3 * face..3 * face + 3];
        std::array::from_fn(|s| w[0][s] * bary[0] + w[1][s] * bary[1] + w[2][s] * bary[2])
    }
}
