//! How the sample lies on the page: which place of it a point of the atlas shows, and how far the sample goes on per texel.
//!
//! In: corner coordinates on the synthesis mesh and where that lies on the page. A point takes the set that weighs most.
//! Unaware of: maps, blending.

use super::atlas::Atlas;
use super::coverage::{Coverage, NO_FACE, clamp_bary, synthesis_px};
use crate::mesh::SynthesisMesh;
use crate::numerics::vec::Vec2;
use crate::texture::{Texel, texel};
use crate::uvset::UvSets;

/// Rows: right and down in the sample, in texels. Columns: per texel of the page to the right and down.
pub(crate) type Jacobian = [[f32; 2]; 2];

/// The sample on the page.
#[derive(Clone, Copy)]
pub(crate) struct Lie<'a> {
    pub coverage: &'a Coverage,
    pub synthesis: &'a SynthesisMesh,
    pub atlas: &'a Atlas,
    pub sets: &'a UvSets,
}

impl Lie<'_> {
    /// Synthesis face and barycentric coordinates of a texel's centre, if it is covered.
    pub fn shown(&self, t: u32) -> Option<(u32, [f32; 3])> {
        let (x, y) = (t % self.atlas.width, t / self.atlas.width);
        let face = self.coverage.row(y)[x as usize];
        let b = || clamp_bary(self.coverage.to_bary(face).at(x as f32 + 0.5, y as f32 + 0.5));
        (face != NO_FACE).then(|| (face, b()))
    }

    /// Centre of a texel on the page.
    pub fn centre(&self, t: u32) -> [f32; 2] {
        [(t % self.atlas.width) as f32 + 0.5, (t / self.atlas.width) as f32 + 0.5]
    }

    /// The chart of a synthesis face.
    pub fn chart(&self, face: u32) -> u32 {
        self.atlas.chart[self.synthesis.parent[face as usize] as usize]
    }

    /// The set of greatest weight at a point, the first of equals.
    pub fn heaviest(&self, face: u32, b: [f32; 3]) -> usize {
        let w = self.sets.weights_at(face as usize, b);
        (1..self.sets.sets.len()).fold(0, |best, s| if w[s] > w[best] { s } else { best })
    }

    /// How a set goes on over a face.
    pub fn jacobian(&self, face: u32, set: usize) -> Jacobian {
        let grad = self.coverage.to_bary(face).grad;
        let c = &self.sets.sets[set][3 * face as usize..3 * face as usize + 3];
        let e = [1, 2].map(|k| [c[k].x - c[0].x, c[k].y - c[0].y]);
        [0, 1].map(|row| [0, 1].map(|axis| e[0][row] * grad[0][axis] + e[1][row] * grad[1][axis]))
    }

    /// Where a point of a synthesis face lies on the page, in texels.
    pub fn on_page(&self, face: u32, b: [f32; 3]) -> [f32; 2] {
        let p = synthesis_px(self.synthesis, self.atlas, face as usize);
        let at = p[0] * f64::from(b[0]) + p[1] * f64::from(b[1]) + p[2] * f64::from(b[2]);
        [at.x as f32, at.y as f32]
    }

    /// Texels of the sample per texel of the page, as lengths, over all charts; 0 without area.
    pub fn sample_per_page(&self) -> f64 {
        let (mut sample, mut page) = (0.0, 0.0);
        for f in 0..self.synthesis.parent.len() as u32 {
            if self.chart(f) == super::NO_CHART {
                continue;
            }
            let p = synthesis_px(self.synthesis, self.atlas, f as usize);
            page += (p[1] - p[0]).cross(p[2] - p[0]).abs();
            let at = |t: Texel| Vec2 { x: t.x.into(), y: t.y.into() };
            let c = &self.sets.sets[0][3 * f as usize..3 * f as usize + 3];
            sample += (at(c[1]) - at(c[0])).cross(at(c[2]) - at(c[0])).abs();
        }
        if page > 0.0 { (sample / page).sqrt() } else { 0.0 }
    }
}

/// What a step on the page is in the sample.
pub(crate) fn step(j: &Jacobian, d: [f32; 2]) -> [f32; 2] {
    [j[0][0] * d[0] + j[0][1] * d[1], j[1][0] * d[0] + j[1][1] * d[1]]
}

/// The mean of two.
pub(crate) fn between(a: &Jacobian, b: &Jacobian) -> Jacobian {
    [0, 1].map(|r| [0, 1].map(|c| 0.5 * (a[r][c] + b[r][c])))
}

/// Whether the sample lies about alike in two places, neither turned nor at quite another scale.
pub(crate) fn alike(a: &Jacobian, b: &Jacobian) -> bool {
    let square = |j: &Jacobian| j.as_flattened().iter().map(|x| x * x).sum::<f32>();
    let apart = [0, 1].map(|r| [0, 1].map(|c| a[r][c] - b[r][c]));
    square(&apart) <= MOST_TURN * MOST_TURN * square(a).max(square(b))
}

/// The same of one vector, as two places have it.
pub(crate) fn alike_along(a: [f32; 2], b: [f32; 2]) -> bool {
    let square = |v: [f32; 2]| v[0] * v[0] + v[1] * v[1];
    square([a[0] - b[0], a[1] - b[1]]) <= MOST_TURN * MOST_TURN * square(a).max(square(b))
}

/// Difference, as a share, from which places are not alike: a turn by 29 degrees. Fields of 2-way and 4-way symmetry turn
/// by 180 and 90.
const MOST_TURN: f32 = 0.5;

/// A place of the sample a step further.
pub(crate) fn moved(at: Texel, by: [f32; 2]) -> Texel {
    texel(at.x + by[0], at.y + by[1])
}
