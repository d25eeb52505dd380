//! Which steps of a morph become layers.
//!
//! Source: \[MST09\] section 1.1, speed-adaptive subsampling: H(0) = 0, H(M) = N, and the number of texels in which layers
//! that follow each other differ is as constant as can be.
//! Reads as: the largest of those numbers is as small as can be, and then the sum of their squares. The sum alone is not
//! enough: what moves to and fro differs less in the end than on the way, and one long step can be cheaper than two (of
//! cracks to mortar 9839 texels and six times 5000). Found exactly, by dynamic programming over all pairs of up to
//! [`CANDIDATES`] steps.
//! Unaware of: how the masks were made.

use super::morph::{Bits, differing};
use crate::numerics::par;

/// Steps that are looked at.
const CANDIDATES: usize = 192;

/// The steps of layers 0..=`last`, strictly rising from the first step to the last. There are more steps than layers.
pub(super) fn choose(steps: &[Bits], last: usize) -> Vec<usize> {
    let candidates = spread(steps, CANDIDATES.max(4 * last));
    let n = candidates.len();
    if last == 0 || n <= last + 1 {
        return candidates;
    }
    // Row i: the differences of candidate i from those after it.
    let differences: Vec<Vec<u64>> = par::map_chunks(n, 1, |r| {
        let from = &steps[candidates[r.start]];
        (r.start + 1..n).map(|j| u64::from(differing(from, &steps[candidates[j]]))).collect()
    });
    let between = |i: usize, j: usize| differences[i][j - i - 1];
    let largest = path(n, last, |so_far, i, j| Some(so_far.max(between(i, j))));
    let most = largest.windows(2).map(|w| between(w[0], w[1])).max().unwrap_or(0);
    let even = path(n, last, |so_far, i, j| Some(between(i, j)).filter(|d| *d <= most).map(|d| so_far + d * d));
    even.into_iter().map(|i| candidates[i]).collect()
}

/// The cheapest way from 0 to `n - 1` that takes `steps` rising steps; `cost(so_far, i, j)` is what it costs up to j, if it
/// may lead from i to j. There is a way.
fn path(n: usize, steps: usize, cost: impl Fn(u64, usize, usize) -> Option<u64>) -> Vec<usize> {
    let mut best: Vec<Option<u64>> = (0..n).map(|j| (j == 0).then_some(0)).collect();
    let mut before = Vec::with_capacity(steps);
    for _ in 0..steps {
        let way = |j: usize| (0..j).filter_map(|i| Some((cost(best[i]?, i, j)?, i))).min();
        let ways: Vec<Option<(u64, usize)>> = (0..n).map(way).collect();
        best = ways.iter().map(|w| w.map(|w| w.0)).collect();
        before.push(ways);
    }
    let mut out = vec![n - 1];
    for ways in before.iter().rev() {
        out.extend(ways[out[out.len() - 1]].map(|w| w.1));
    }
    out.reverse();
    out
}

/// Up to `count` steps, the first and the last among them: half of them evenly spread over the steps, half by how much
/// changes up to them.
fn spread(steps: &[Bits], count: usize) -> Vec<usize> {
    let last = steps.len() - 1;
    if last < count {
        return (0..=last).collect();
    }
    let mut sums = vec![0u64];
    for pair in steps.windows(2) {
        sums.push(sums[sums.len() - 1] + u64::from(differing(&pair[0], &pair[1])));
    }
    let (half, total) = (count / 2, sums[last]);
    let evenly = (0..half).map(|i| i * last / (half - 1));
    let by_change = (0..half as u64).map(|i| sums.partition_point(|s| *s * (half as u64 - 1) < total * i).min(last));
    let mut out: Vec<usize> = evenly.chain(by_change).collect();
    out.sort_unstable();
    out.dedup();
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Steps that have so many texels on, from the first.
    fn filled(counts: &[usize]) -> Vec<Bits> {
        let bits = |n: &usize| (0..4).map(|w| (0..64).filter(|b| w * 64 + b < *n).map(|b| 1u64 << b).sum()).collect();
        counts.iter().map(bits).collect()
    }

    #[test]
    fn layers_are_as_far_apart_as_can_be_had() {
        assert_eq!(choose(&filled(&[0, 1, 2, 3, 4, 5, 6, 7, 8]), 4), [0, 2, 4, 6, 8]);
        // Slow at first, then fast.
        assert_eq!(choose(&filled(&[0, 1, 2, 3, 4, 5, 6, 20, 34, 41, 60]), 3), [0, 7, 9, 10]);
        assert_eq!(choose(&filled(&[0, 0, 0, 0]), 3), [0, 1, 2, 3]);
        assert_eq!(choose(&filled(&[0, 9, 200]), 1), [0, 2]);
    }

    #[test]
    fn of_many_steps_all_layers_are_found_though_few_change_anything() {
        let counts: Vec<usize> = (0..1000).map(|i| if i < 990 { 0 } else { 25 * (i - 990) }).collect();
        let layers = choose(&filled(&counts), 30);
        assert_eq!((layers.len(), layers[0], layers[30]), (31, 0, 999));
        assert!(layers.windows(2).all(|w| w[0] < w[1]));
        let even = choose(&filled(&counts), 3);
        assert_eq!(even, [0, 993, 996, 999]);
    }
}
