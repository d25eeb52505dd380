//! Leading seams around features: faces beside a seam may go over to the patch on its other side.
//!
//! Beyond \[MK03\], after the minimum error cut of Efros and Freeman (2001): what is cut is not a path through an overlap but
//! the border between two pieces, face by face. A face may continue any of its neighbours if that lowers the sum of its
//! three edges' costs: the difference of what lies on both sides, and a little for the seam's length. Faces are visited by
//! colour, no two of one colour adjacent, so nothing depends on threads.
//! Unaware of: how the pieces were placed.

use super::frame::Facets;
use super::texton_string::{Inside, steps, texel_at};
use crate::exemplar::TextonMap;
use crate::numerics::par;
use crate::numerics::rng::Key;
use crate::numerics::vec::{Vec2, vec2};

/// Faces whose edge's middles are this near each other in the exemplar, in texels, continue each other.
pub(super) const SAME: f64 = 0.5;

/// What a texel of seam costs in itself; 1 is the difference of places that have nothing in common.
const SEAM_COST: f64 = 0.1;

/// Pairs of texels by which that difference is measured.
const PAIRS: u64 = 512;

/// How far what lies on the two sides of an edge is apart in the exemplar, in texels.
pub(super) fn gap(facets: &Facets, at: &[Vec2], f: usize, k: usize) -> Option<f64> {
    let (g, j) = facets.opposite(f, k)?;
    Some((at[f] + facets.middle(f, k) - at[g] - facets.middle(g, j)).length())
}

/// Lowers the cost of seams by up to `passes` passes; returns how many faces went over.
pub(super) fn relax(map: &TextonMap, facets: &Facets, at: &mut [Vec2], passes: u32) -> u64 {
    let seams = Seams::new(map, facets);
    let colours =
        colours(facets.len(), |f, out| out.extend((0..3).filter_map(|k| facets.opposite(f, k)).map(|(g, _)| g as u32)));
    let beside = |f: usize| (0..3).any(|k| gap(facets, at, f, k).is_some_and(|d| d > SAME));
    let mut dirty = par::map(facets.len(), beside);
    let mut moved = 0;
    for _ in 0..passes {
        let before = moved;
        for colour in &colours {
            let some: Vec<u32> = colour.iter().copied().filter(|f| dirty[*f as usize]).collect();
            let found = par::map_chunks(some.len(), 256, |r| {
                some[r].iter().map(|f| seams.better(at, *f as usize)).collect::<Vec<Option<Vec2>>>()
            });
            for (&f, to) in some.iter().zip(found.concat()) {
                dirty[f as usize] = false;
                if let Some(to) = to {
                    at[f as usize] = to;
                    moved += 1;
                    (0..3).filter_map(|k| facets.opposite(f as usize, k)).for_each(|(g, _)| dirty[g] = true);
                }
            }
        }
        if moved == before {
            break;
        }
    }
    moved
}

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

struct Seams<'a> {
    map: &'a TextonMap,
    facets: &'a Facets,
    size: [u32; 2],
    /// The difference of unrelated texels.
    typical: f64,
}

impl<'a> Seams<'a> {
    fn new(map: &'a TextonMap, facets: &'a Facets) -> Self {
        Seams { map, facets, size: [map.width(), map.height()], typical: typical_distance(map) }
    }

    /// The cost of an edge if the face lies at `place`.
    fn cost(&self, at: &[Vec2], f: usize, k: usize, place: Vec2) -> f64 {
        let Some((g, j)) = self.facets.opposite(f, k) else { return 0.0 };
        let ([a, b], [d, c]) = (self.facets.edge(f, k), self.facets.edge(g, j));
        let (a, b, c, d) = (place + a, place + b, at[g] + c, at[g] + d);
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
        length * (sum / f64::from(n) + SEAM_COST * self.typical)
    }

    /// Where the face lies better than where it is.
    fn better(&self, at: &[Vec2], f: usize) -> Option<Vec2> {
        let total = |place: Vec2| (0..3).map(|k| self.cost(at, f, k, place)).sum::<f64>();
        let here = total(at[f]);
        let mut best = (here * 0.9999, None);
        let room = Inside::new(self.size, box_of(&self.facets.local[f]));
        for k in 0..3 {
            let Some((g, j)) = self.facets.opposite(f, k) else { continue };
            let place = at[g] + self.facets.middle(g, j) - self.facets.middle(f, k);
            if room.contains(place) && (place - at[f]).length() > SAME {
                let cost = total(place);
                if cost < best.0 {
                    best = (cost, Some(place));
                }
            }
        }
        best.1
    }
}

/// The box of a face's corners.
pub(super) fn box_of(corners: &[Vec2; 3]) -> (Vec2, Vec2) {
    let [a, b, c] = corners;
    (vec2(a.x.min(b.x).min(c.x), a.y.min(b.y).min(c.y)), vec2(a.x.max(b.x).max(c.x), a.y.max(b.y).max(c.y)))
}
