//! Welding: vertices at one place become one vertex.
//!
//! Vertices are taken by index; each joins the lowest earlier vertex within the tolerance that joined no other, or
//! stays. So what is kept lies further apart than the tolerance, chains do not creep, and vertices at equal positions
//! always meet. Found by a grid of cells some tolerances wide: a vertex looks only into those cells that its tolerance
//! reaches, nearly always its own.

use crate::numerics::vec::Vec3;

/// Width of a cell in tolerances: wide enough that few vertices look into a second cell.
const CELL: f64 = 16.0;
/// Bits per axis of a cell's key.
const BITS: u32 = 21;

/// For each vertex the vertex it becomes (itself if it stays). Only vertices in `used` take part; the others stay.
///
/// `low` is the smallest corner of the bounding box of those used, whose sides are at most 1e6 `CELL` tolerances.
pub(super) fn weld(positions: &[Vec3], used: &[bool], low: Vec3, tolerance: f64) -> Vec<u32> {
    let width = CELL * tolerance;
    // One cell of margin below, so that a tolerance below the box is a cell too.
    let cell = |p: Vec3, shift: f64| {
        let c = |x: f64, low: f64| (((x + shift - low) / width + 1.0).floor() as u64).min((1 << BITS) - 1);
        [c(p.x, low.x), c(p.y, low.y), c(p.z, low.z)]
    };
    let key = |c: [u64; 3]| c[0] << (2 * BITS) | c[1] << BITS | c[2];

    let mut keyed: Vec<(u64, u32)> =
        (0..positions.len()).filter(|&v| used[v]).map(|v| (key(cell(positions[v], 0.0)), v as u32)).collect();
    keyed.sort_unstable();
    let mut keys: Vec<u64> = vec![];
    let mut starts: Vec<usize> = vec![];
    for (i, &(k, _)) in keyed.iter().enumerate() {
        if keys.last() != Some(&k) {
            keys.push(k);
            starts.push(i);
        }
    }

    let mut target: Vec<u32> = (0..positions.len() as u32).collect();
    // The vertices that stay, by cell, in the places of all vertices of that cell.
    let mut kept = vec![0u32; keyed.len()];
    let mut kept_count = vec![0u32; keys.len()];
    for v in (0..positions.len()).filter(|&v| used[v]) {
        let p = positions[v];
        let (from, to) = (cell(p, -tolerance), cell(p, tolerance));
        let mut best = v as u32;
        for x in from[0]..=to[0] {
            for y in from[1]..=to[1] {
                for z in from[2]..=to[2] {
                    let Ok(c) = keys.binary_search(&key([x, y, z])) else { continue };
                    let stays = &kept[starts[c]..starts[c] + kept_count[c] as usize];
                    let near = stays.iter().find(|&&k| {
                        let d = positions[k as usize] - p;
                        d.dot(d) <= tolerance * tolerance
                    });
                    best = near.map_or(best, |&k| best.min(k));
                }
            }
        }
        target[v] = best;
        if best == v as u32
            && let Ok(c) = keys.binary_search(&key(cell(p, 0.0)))
        {
            kept[starts[c] + kept_count[c] as usize] = best;
            kept_count[c] += 1;
        }
    }
    target
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::vec::vec3;
    use proptest::prelude::*;

    /// The rule as it reads.
    fn naive(positions: &[Vec3], tolerance: f64) -> Vec<u32> {
        let mut target: Vec<u32> = vec![];
        for (v, p) in positions.iter().enumerate() {
            let near = (0..v).find(|&k| {
                let d = positions[k] - *p;
                target[k] == k as u32 && d.dot(d) <= tolerance * tolerance
            });
            target.push(near.unwrap_or(v) as u32);
        }
        target
    }

    #[test]
    fn zeros_of_both_signs_are_one_place() {
        let p = [vec3(0., 0., 0.), vec3(1., 0., 0.), vec3(-0.0, 0., -0.0)];
        assert_eq!(weld(&p, &[true; 3], Vec3::ZERO, 1e-7), [0, 1, 0]);
        assert_eq!(weld(&p, &[true, true, false], Vec3::ZERO, 1e-7), [0, 1, 2]);
    }

    proptest! {
        #[test]
        fn the_grid_agrees_with_the_rule(
            points in prop::collection::vec(prop::array::uniform3(0u32..40), 1..60), tolerance in 0.5f64..3.0,
        ) {
            let p: Vec<Vec3> = points.iter().map(|q| q.map(|c| f64::from(c) - 20.0).into()).collect();
            let low = vec3(-20.0, -20.0, -20.0);
            prop_assert_eq!(weld(&p, &vec![true; p.len()], low, tolerance), naive(&p, tolerance));
        }
    }
}
