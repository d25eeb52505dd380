//! Distance of an output's patches from the nearest ones of the samples: exact, by bounds.
//!
//! Sums of squares of whole numbers have no rounding. A patch's total, then its sums over blocks of 3x3, bound the
//! distance from below, so that few candidates are compared value by value; they are tried in the order of their totals,
//! nearest first. Unaware of: what is golden.

use super::{Corner, Image, draw};
use crate::numerics::par;

/// Side of a patch.
pub(super) const PATCH: usize = 9;
const BLOCK: usize = 3;
const BLOCKS: usize = (PATCH / BLOCK) * (PATCH / BLOCK) * 3;
const VALUES: i64 = (PATCH * PATCH * 3) as i64;
/// Patches of the output that are looked up, and of the samples at most to look them up in: all of 512 x 512 texels.
const QUERIES: usize = 1024;
const CANDIDATES: usize = 1 << 18;

/// A patch by its sums.
struct Sums {
    total: i64,
    blocks: [i32; BLOCKS],
    at: Corner,
}

/// Mean and 95th percentile over the output's patches; `None` if there are none.
pub(super) fn distance(samples: &[Image], output: &[Image], keep: impl Fn(Corner) -> bool) -> Option<[f64; 2]> {
    let queries = draw(output, PATCH, QUERIES, keep);
    let candidates = draw(samples, PATCH, CANDIDATES, |_| true);
    if queries.is_empty() || candidates.is_empty() {
        return None;
    }
    let mut table: Vec<Sums> =
        par::map_chunks(candidates.len(), 1024, |part| part.map(|i| sums(samples, candidates[i])).collect::<Vec<_>>())
            .into_iter()
            .flatten()
            .collect();
    table.sort_by_key(|s| (s.total, s.at));
    let found = par::map_chunks(queries.len(), 16, |part| {
        part.map(|i| nearest(samples, &table, output, queries[i])).collect::<Vec<_>>()
    });
    let mut rms: Vec<f64> = found.into_iter().flatten().map(|d| (d as f64 / VALUES as f64).sqrt()).collect();
    let mean = rms.iter().sum::<f64>() / rms.len() as f64;
    rms.sort_unstable_by(f64::total_cmp);
    Some([mean, rms[(rms.len() - 1) * 95 / 100]])
}

fn sums(images: &[Image], at: Corner) -> Sums {
    let (image, x, y) = (&images[at.0], at.1, at.2);
    let mut blocks = [0; BLOCKS];
    for dy in 0..PATCH {
        let row = &image.texels[(y + dy) * image.width + x..][..PATCH];
        for (dx, texel) in row.iter().enumerate() {
            let block = (dy / BLOCK * (PATCH / BLOCK) + dx / BLOCK) * 3;
            (0..3).for_each(|c| blocks[block + c] += i32::from(texel[c]));
        }
    }
    Sums { total: blocks.iter().map(|b| i64::from(*b)).sum(), blocks, at }
}

/// Square of the distance to the nearest candidate.
fn nearest(samples: &[Image], table: &[Sums], output: &[Image], at: Corner) -> i64 {
    let query = sums(output, at);
    let mut best = i64::MAX;
    let middle = table.partition_point(|s| s.total < query.total);
    let (mut below, mut above) = (middle, middle);
    loop {
        let gap = |i: usize| (table[i].total - query.total).abs();
        let down = below.checked_sub(1).map(gap);
        let up = (above < table.len()).then(|| gap(above));
        let (gap, next) = match (down, up) {
            (Some(d), Some(u)) if d <= u => (d, below - 1),
            (Some(d), None) => (d, below - 1),
            (_, Some(u)) => (u, above),
            (None, None) => return best,
        };
        // By Cauchy and Schwarz: the square of a sum of n values is at most n times the sum of their squares.
        if gap * gap >= best.saturating_mul(VALUES) {
            return best;
        }
        if next < middle {
            below = next
        } else {
            above = next + 1
        }
        let blocks = query.blocks.iter().zip(&table[next].blocks).map(|(a, b)| (a - b) * (a - b)).sum::<i32>();
        if i64::from(blocks) < best.saturating_mul((BLOCK * BLOCK) as i64) {
            best = best.min(squares(output, at, samples, table[next].at, best));
        }
    }
}

/// Sum of the squared differences of two patches; may stop at `enough`.
fn squares(a: &[Image], at: Corner, b: &[Image], other: Corner, enough: i64) -> i64 {
    let row = |images: &[Image], (i, x, y): Corner, dy: usize| -> [[u8; 3]; PATCH] {
        let from = (y + dy) * images[i].width + x;
        std::array::from_fn(|dx| images[i].texels[from + dx])
    };
    let mut sum = 0;
    for dy in 0..PATCH {
        let (a, b) = (row(a, at, dy), row(b, other, dy));
        let pairs = a.as_flattened().iter().zip(b.as_flattened());
        sum += pairs.map(|(a, b)| i64::from((i32::from(*a) - i32::from(*b)).pow(2))).sum::<i64>();
        if sum >= enough {
            break;
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::rng::Key;

    fn noise(seed: u64, width: usize, height: usize) -> Image {
        let texel = |i: usize| [0, 1, 2].map(|c| (Key::new(seed).bits(i as u64 * 3 + c) >> 58) as u8 * 4);
        Image { width, height, texels: (0..width * height).map(texel).collect() }
    }

    #[test]
    fn bounds_find_what_comparing_all_finds() {
        let samples = [noise(1, 17, 20), noise(2, 12, 12)];
        let output = [noise(3, 14, 13)];
        let table = {
            let mut table: Vec<Sums> =
                draw(&samples, PATCH, 1 << 20, |_| true).iter().map(|c| sums(&samples, *c)).collect();
            table.sort_by_key(|s| (s.total, s.at));
            table
        };
        for query in draw(&output, PATCH, 1 << 20, |_| true) {
            let all = table.iter().map(|s| squares(&output, query, &samples, s.at, i64::MAX)).min();
            assert_eq!(Some(nearest(&samples, &table, &output, query)), all);
        }
    }
}
