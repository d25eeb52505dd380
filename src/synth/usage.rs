//! How often each part of an exemplar is used, and each look that it has.
//!
//! Parts are square cells; looks are groups of texels of like appearance ([`Metric::looks`]), wherever they are. Even use
//! of the parts hides repetition; due use of the looks keeps the exemplar's statistics, as many bright places and as many
//! dark ones (Kopf et al. 2007 keep histograms to that end).
//! Unaware of: images, meshes, seams.

use super::seam_metric::{LOOKS, Metric, UNIT};
use crate::exemplar::Domain;
use crate::texture::Texel;

/// What it costs that a part of the exemplar is used twice as much as it should, per node.
const OVERUSE: f32 = 0.35;

/// The same for a look, by level from the finest on. Blocks are few on coarse levels, and what is wrong there stays wrong:
/// with 2 everywhere, swd is a tenth higher.
const OVERUSE_OF_LOOKS: [f32; 4] = [2.0, 2.0, 4.0, 6.0];

/// Most cells along a side of the exemplar in which its use is counted.
const MOST_CELLS: u32 = 16;

/// Sources that the even share of a cell should be, or counts say nothing. Where there are few, cells are larger.
const LEAST_SHARE: f32 = 16.0;

/// How often each part of the exemplar is used, and each look that it has.
pub(super) struct Usage<'a> {
    width: u32,
    cells: u32,
    cell: [u32; 2],
    looks: &'a [u8],
    parts_used: Shares,
    looks_used: Shares,
    overuse_of_looks: f32,
}

/// Counts of groups, and what is due to each.
struct Shares {
    counts: Vec<u32>,
    /// One over the number of sources that a group should have.
    scale: Vec<f32>,
}

impl Shares {
    /// How many times more than its share a group is used, less one; 0 if not more.
    #[inline(always)]
    fn excess(&self, group: usize) -> f32 {
        (self.counts[group] as f32 * self.scale[group] - 1.0).max(0.0)
    }

    fn moved(&mut self, from: usize, to: usize) {
        self.counts[from] -= 1;
        self.counts[to] += 1;
    }
}

impl<'a> Usage<'a> {
    /// Counts the sources of a level (0: the finest); the share of a cell is that of one full of texels of the domain, the share of a look that of its
    /// texels in the domain.
    pub fn new(
        domain: &Domain,
        metric: &'a Metric,
        level: usize,
        sources: impl ExactSizeIterator<Item = [u16; 2]>,
    ) -> Self {
        let count = sources.len() as f32;
        let cells = ((count / LEAST_SHARE).sqrt() as u32).clamp(1, MOST_CELLS);
        let cell = [domain.width().div_ceil(cells), domain.height().div_ceil(cells)];
        let per_texel = count / domain.len() as f32;
        let full = 1.0 / (per_texel * (cell[0] * cell[1]) as f32).max(1.0);
        let looks = metric.looks();
        let mut texels = [0u32; LOOKS];
        for (x, y) in (0..domain.height()).flat_map(|y| (0..domain.width()).map(move |x| (x, y))) {
            if domain.at(x as i32, y as i32).is_some() {
                texels[usize::from(looks[(y * domain.width() + x) as usize])] += 1;
            }
        }
        let parts = (cells * cells) as usize;
        let mut usage = Usage {
            width: domain.width(),
            cells,
            cell,
            looks,
            parts_used: Shares { counts: vec![0; parts], scale: vec![full; parts] },
            looks_used: Shares {
                counts: vec![0; LOOKS],
                scale: texels.iter().map(|n| 1.0 / (*n as f32 * per_texel).max(1.0)).collect(),
            },
            overuse_of_looks: OVERUSE_OF_LOOKS[level.min(OVERUSE_OF_LOOKS.len() - 1)],
        };
        for s in sources {
            let [part, look] = usage.groups(s.map(u32::from));
            usage.parts_used.counts[part] += 1;
            usage.looks_used.counts[look] += 1;
        }
        usage
    }

    /// The same, but no use costs anything.
    pub fn ignored(mut self) -> Self {
        self.parts_used.scale.fill(0.0);
        self.looks_used.scale.fill(0.0);
        self
    }

    /// The part that a texel belongs to, and its look.
    #[inline(always)]
    fn groups(&self, [x, y]: [u32; 2]) -> [usize; 2] {
        let part = y / self.cell[1] * self.cells + x / self.cell[0];
        [part as usize, usize::from(self.looks[(y * self.width + x) as usize])]
    }

    /// One source less at `from`, one more at `to`.
    pub fn moved(&mut self, from: [u16; 2], to: [u16; 2]) {
        let ([a, b], [c, d]) = (self.groups(from.map(u32::from)), self.groups(to.map(u32::from)));
        self.parts_used.moved(a, c);
        self.looks_used.moved(b, d);
    }

    /// What it costs to show a texel: nothing where the exemplar is used no more than evenly.
    #[inline(always)]
    pub fn cost(&self, texel: u32) -> i32 {
        let [part, look] = self.groups([texel % self.width, texel / self.width]);
        let price = OVERUSE * self.parts_used.excess(part) + self.overuse_of_looks * self.looks_used.excess(look);
        (price * UNIT) as i32
    }

    /// The cost of the texel that a place is in, which is inside.
    pub fn cost_at(&self, at: Texel) -> i32 {
        let [x, y] = texel_of(at).map(u32::from);
        self.cost(y * self.width + x)
    }
}

/// The texel that a place in the exemplar is in.
pub(super) fn texel_of(at: Texel) -> [u16; 2] {
    [at.x as u16, at.y as u16]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::texture::Wrap;

    #[test]
    fn use_beyond_the_due_share_costs() {
        // 64 sources of 1024 texels: four cells of 16 x 16 texels, 16 sources each; 32 looks of 32 texels, 2 sources each.
        let domain = Domain::full(32, 32, Wrap::Clamp);
        let values = |t: usize| [(t % 32 / 4) as f32, (t / 32 / 8) as f32, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        let metric = Metric::of_values((0..1024).map(values).collect(), [32, 32]);
        let sources = (0..64).map(|i| if i < 48 { [i % 2, i / 2 % 2] } else { [16 + i % 16, 20] });
        let sources: Vec<[u16; 2]> = sources.collect();
        let mut usage = Usage::new(&domain, &metric, 2, sources.into_iter());
        let price = |parts: f32, looks: f32| ((OVERUSE * parts + OVERUSE_OF_LOOKS[2] * looks) * UNIT) as i32;
        let costs = |usage: &Usage| [0, 20 * 32 + 21, 20].map(|t| usage.cost(t));
        assert_eq!(costs(&usage), [price(2.0, 23.0), price(0.0, 1.0), 0]);
        (0..24).for_each(|i| usage.moved([i % 2, i / 2 % 2], [20, 0]));
        assert_eq!(costs(&usage), [price(0.5, 11.0), price(0.0, 1.0), price(0.5, 11.0)]);
    }
}
