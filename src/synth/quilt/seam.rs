//! Seams: where faces do not continue each other, and what that costs.
//!
//! A seam costs what the texels on its two sides differ by, along the edge itself, by the vectors that textons are made of:
//! whole neighbourhoods, so that a seam that cuts a feature costs more than one that follows it; and a little for its length.
//! Unaware of: how faces came to their places, what is done about seams.

use super::frame::Facets;
use super::texton_string::{steps, texel_at};
use crate::exemplar::TextonMap;
use crate::numerics::rng::Key;
use crate::numerics::vec::{Vec2, vec2};

/// Faces whose edge's middles are this near each other in the exemplar, in texels, continue each other.
pub(super) const SAME: f64 = 0.5;

/// What a texel of seam costs in itself; 1 is the difference of places that have nothing in common.
const SEAM_COST: f64 = 0.02;

/// Pairs of texels by which that difference is measured.
const PAIRS: u64 = 512;

/// Groups of elements none of which neighbour each other, by the lowest colour that is free.
pub(super) fn colours(n: usize, neighbours: impl Fn(usize, &mut Vec<u32>)) -> Vec<Vec<u32>> {
    let (mut colour, mut groups): (Vec<u32>, Vec<Vec<u32>>) = (vec![u32::MAX; n], vec![]);
    let mut around = vec![];
    for i in 0..n {
        around.clear();
        neighbours(i, &mut around);
        let free = (0..).find(|c| around.iter().all(|g| colour[*g as usize] != *c)).unwrap_or(0);
        colour[i] = free;
        if groups.len() <= free as usize {
            groups.push(vec![]);
        }
        groups[free as usize].push(i as u32);
    }
    groups
}

/// The mean distance of unrelated texels, in steps of their vectors; at least 1.
pub(super) fn typical_distance(map: &TextonMap) -> f64 {
    let (n, key) = (map.points().len() as u32, Key::new(0).with_str("unrelated texels"));
    let distance = |i: u64| f64::from(map.points().squared_distance(key.below(2 * i, n), key.below(2 * i + 1, n)));
    ((0..PAIRS).map(|i| distance(i).sqrt()).sum::<f64>() / PAIRS as f64).max(1.0)
}

/// The cost of seams.
pub(super) struct Seams<'a> {
    map: &'a TextonMap,
    facets: &'a Facets,
    /// Of the exemplar, in texels.
    pub size: [u32; 2],
    /// The difference of unrelated texels.
    typical: f64,
}

impl<'a> Seams<'a> {
    pub fn new(map: &'a TextonMap, facets: &'a Facets) -> Self {
        Seams { map, facets, size: [map.width(), map.height()], typical: typical_distance(map) }
    }

    /// The cost of an edge.
    pub fn cost(&self, at: &[Vec2], f: usize, k: usize) -> f64 {
        self.facets.opposite(f, k).map_or(0.0, |beyond| self.between(f, k, at[f], beyond, at[beyond.0]))
    }

    /// The cost of an edge if the face lies at `place` and the one beyond at `other`; 1 for each texel of its length if the
    /// two have nothing in common.
    pub fn between(&self, f: usize, k: usize, place: Vec2, (g, j): (usize, usize), other: Vec2) -> f64 {
        let ([a, b], [d, c]) = (self.facets.edge(f, k), self.facets.edge(g, j));
        let (a, b, c, d) = (place + a, place + b, other + c, other + d);
        if ((a + b - c - d) * 0.5).length() <= SAME {
            return 0.0;
        }
        let length = (b - a).length();
        let n = steps(length);
        let mut sum = 0.0;
        for i in 0..n {
            let t = (f64::from(i) + 0.5) / f64::from(n);
            let (p, q) = (texel_at(self.size, a + (b - a) * t), texel_at(self.size, c + (d - c) * t));
            sum += f64::from(self.map.points().squared_distance(p, q)).sqrt();
        }
        length * (sum / (f64::from(n) * self.typical) + SEAM_COST)
    }
}

/// The box of a face's corners.
pub(super) fn box_of(corners: &[Vec2; 3]) -> (Vec2, Vec2) {
    let [a, b, c] = corners;
    (vec2(a.x.min(b.x).min(c.x), a.y.min(b.y).min(c.y)), vec2(a.x.max(b.x).max(c.x), a.y.max(b.y).max(c.y)))
}
