//! K-means of points with integer coordinates, started from a k-centre.
//!
//! Source: Hochbaum, Shmoys: A best possible heuristic for the k-center problem (1985) for the start; Lloyd's iteration;
//! the bounds are Hamerly's (Making k-means even faster, 2010): a point is compared with all centres only if one may have
//! come nearer.
//! Reads as: the k-centre is found by farthest-first traversal (Gonzalez 1985), which has the same guarantee, twice the
//! best possible radius, and needs no list of all distances.
//! Coordinates and centres are integers (`numerics::knn::Points`), sums are exact, ties go to the lower index: the result
//! is that of the plain algorithm (test `bounds_change_nothing`) for any number of threads.
//! Unaware of: what the points are.

use super::knn::Points;
use super::par;

/// Points per parallel task.
const TASK: usize = 1024;

/// Room for rounding in the bounds, as a factor.
const SLACK: f64 = 1.0 + 1e-9;

/// A clustering.
#[derive(Clone, Debug, PartialEq)]
pub struct Clusters {
    /// The centres, in the points' coordinates.
    pub centres: Points,
    /// For each point its nearest centre, the lowest of equals.
    pub of: Vec<u32>,
    /// Lloyd iterations made.
    pub iterations: u32,
}

/// Clusters `points` into at most `k` (at least one) until `settled` (0..=1) of them keep their cluster, or for `most`
/// iterations. There are fewer clusters if there are fewer distinct points. Panics without points.
pub fn kmeans(points: &Points, k: usize, settled: f64, most: u32) -> Clusters {
    assert!(k > 0 && !points.is_empty(), "{k} clusters of {} points", points.len());
    let mut centres = k_centre(points, k);
    let mut bounds = par::map_chunks(points.len(), TASK, |r| r.map(|i| nearest_two(points, i, &centres)).collect());
    let mut bounds: Vec<Bound> = std::mem::take(&mut bounds).into_iter().flat_map(|v: Vec<Bound>| v).collect();
    let mut iterations = 0;
    while iterations < most {
        iterations += 1;
        let moved = move_centres(points, &bounds, &mut centres);
        let changed = reassign(points, &centres, &moved, &mut bounds);
        if changed as f64 <= (1.0 - settled) * points.len() as f64 {
            break;
        }
    }
    Clusters { centres, of: bounds.iter().map(|b| b.centre).collect(), iterations }
}

/// The nearest of `centres` to each point of `points`, the lowest of equals. Both have the same stride.
pub fn assign(points: &Points, centres: &Points) -> Vec<u32> {
    let parts =
        par::map_chunks(points.len(), TASK, |r| r.map(|i| nearest_two(points, i, centres).centre).collect::<Vec<_>>());
    parts.concat()
}

/// Up to `k` points that are far from each other, the first being point 0: each next is the farthest from those before.
fn k_centre(points: &Points, k: usize) -> Points {
    let mut chosen = vec![0u32];
    let mut distance = vec![u32::MAX; points.len()];
    while chosen.len() < k {
        let last = chosen[chosen.len() - 1];
        par::for_rows(&mut distance, TASK, |c, some| {
            for (i, d) in some.iter_mut().enumerate() {
                *d = (*d).min(points.squared_distance((c * TASK + i) as u32, last));
            }
        });
        let best =
            |r: std::ops::Range<usize>| r.map(|i| (distance[i], i)).fold((0, 0), |a, b| if b.0 > a.0 { b } else { a });
        let parts = par::map_chunks(points.len(), 8 * TASK, best);
        let (farthest, i) = parts.into_iter().fold((0, 0), |a, b| if b.0 > a.0 { b } else { a });
        if farthest == 0 {
            break;
        }
        chosen.push(i as u32);
    }
    let mut centres = points.empty_like(chosen.len());
    let stride = points.stride();
    for (to, &from) in centres.data_mut().chunks_exact_mut(stride).zip(&chosen) {
        to.copy_from_slice(points.point(from));
    }
    centres
}

/// What is known of a point: its centre, at most how far that is, at least how far all others are.
#[derive(Clone, Copy)]
struct Bound {
    centre: u32,
    upper: f64,
    lower: f64,
}

fn root(squared: u32) -> f64 {
    f64::from(squared).sqrt()
}

fn nearest_two(points: &Points, i: usize, centres: &Points) -> Bound {
    let (mut best, mut second, mut centre) = (u32::MAX, u32::MAX, 0);
    let point = points.point(i as u32);
    for c in 0..centres.len() as u32 {
        let d = centres.squared_distance_to(c, point);
        if d < best {
            (second, best, centre) = (best, d, c);
        } else if d < second {
            second = d;
        }
    }
    Bound { centre, upper: root(best), lower: root(second) }
}

/// Moves each centre to the rounded mean of its points (one without points stays); returns how far each went.
fn move_centres(points: &Points, bounds: &[Bound], centres: &mut Points) -> Vec<f64> {
    let (stride, k) = (points.stride(), centres.len());
    let parts = par::map_chunks(points.len(), 16 * TASK, |r| {
        let (mut sums, mut counts) = (vec![0i64; k * stride], vec![0i64; k]);
        for i in r {
            let c = bounds[i].centre as usize;
            counts[c] += 1;
            let sum = &mut sums[c * stride..(c + 1) * stride];
            sum.iter_mut().zip(points.point(i as u32)).for_each(|(s, v)| *s += i64::from(*v));
        }
        (sums, counts)
    });
    let (mut sums, mut counts) = (vec![0i64; k * stride], vec![0i64; k]);
    for (s, n) in parts {
        sums.iter_mut().zip(s).for_each(|(a, b)| *a += b);
        counts.iter_mut().zip(n).for_each(|(a, b)| *a += b);
    }
    let old = centres.clone();
    for (c, row) in centres.data_mut().chunks_exact_mut(stride).enumerate().filter(|(c, _)| counts[*c] > 0) {
        for (v, s) in row.iter_mut().zip(&sums[c * stride..]) {
            // Rounded to the nearest, halves up: a mean of values in range is in range.
            *v = (2 * s + counts[c]).div_euclid(2 * counts[c]) as i16;
        }
    }
    (0..k as u32).map(|c| root(old.squared_distance_to(c, centres.point(c)))).collect()
}

/// Gives every point its nearest centre; returns how many changed.
fn reassign(points: &Points, centres: &Points, moved: &[f64], bounds: &mut [Bound]) -> usize {
    let furthest = moved.iter().copied().fold(0.0, f64::max);
    let changed = std::sync::atomic::AtomicUsize::new(0);
    par::for_rows(bounds, TASK, |chunk, some| {
        let mut here = 0;
        for (i, b) in some.iter_mut().enumerate() {
            b.upper = (b.upper + moved[b.centre as usize]) * SLACK;
            b.lower = (b.lower - furthest) / SLACK;
            if b.upper < b.lower {
                continue;
            }
            let i = chunk * TASK + i;
            b.upper = root(centres.squared_distance_to(b.centre, points.point(i as u32)));
            if b.upper * SLACK < b.lower {
                continue;
            }
            let new = nearest_two(points, i, centres);
            here += usize::from(new.centre != b.centre);
            *b = new;
        }
        changed.fetch_add(here, std::sync::atomic::Ordering::Relaxed);
    });
    changed.into_inner()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::rng::Key;

    fn cloud(n: usize, dims: usize, seed: u64) -> Points {
        let mut p = Points::new(n, dims, 1.0);
        let (stride, key) = (p.stride(), Key::new(seed));
        for (i, row) in p.data_mut().chunks_exact_mut(stride).enumerate() {
            let blob = i as u64 % 5;
            for (d, v) in row.iter_mut().take(dims).enumerate() {
                let centre = key.with(blob).below(d as u64, 2000) as i16;
                *v = centre + key.with(99 + i as u64).below(d as u64, 300) as i16;
            }
        }
        p
    }

    /// Lloyd's iteration as it reads.
    fn naive(points: &Points, mut centres: Points, settled: f64, most: u32) -> Clusters {
        let near = |c: &Points| -> Vec<u32> {
            (0..points.len() as u32)
                .map(|i| (0..c.len() as u32).min_by_key(|j| c.squared_distance_to(*j, points.point(i))).unwrap())
                .collect()
        };
        let (mut of, mut iterations, stride) = (near(&centres), 0, points.stride());
        while iterations < most {
            iterations += 1;
            for c in 0..centres.len() {
                let own: Vec<u32> = (0..of.len() as u32).filter(|i| of[*i as usize] == c as u32).collect();
                for d in 0..stride {
                    let sum: i64 = own.iter().map(|i| i64::from(points.point(*i)[d])).sum();
                    if !own.is_empty() {
                        let mean = (sum as f64 / own.len() as f64 + 0.5).floor();
                        centres.data_mut()[c * stride + d] = mean as i16;
                    }
                }
            }
            let next = near(&centres);
            let changed = next.iter().zip(&of).filter(|(a, b)| a != b).count();
            of = next;
            if changed as f64 <= (1.0 - settled) * points.len() as f64 {
                break;
            }
        }
        Clusters { centres, of, iterations }
    }

    #[test]
    fn bounds_change_nothing() {
        for (n, dims, k) in [(700, 3, 9), (1500, 20, 40), (50, 1, 3)] {
            let p = cloud(n, dims, n as u64);
            for settled in [0.9, 1.0] {
                let run = |jobs| par::install(jobs, || kmeans(&p, k, settled, 50));
                let found = run(1);
                assert_eq!(found, naive(&p, k_centre(&p, k), settled, 50));
                assert_eq!(found, run(4));
                assert_eq!(assign(&p, &found.centres), found.of);
            }
        }
    }

    #[test]
    fn five_blobs_are_five_clusters() {
        let p = cloud(500, 4, 3);
        let c = kmeans(&p, 5, 1.0, 100);
        assert!((0..500).all(|i| c.of[i] == c.of[i % 5]));
        assert!((0..5).all(|i| (0..i).all(|j| c.of[i] != c.of[j])));
    }

    #[test]
    fn a_k_centre_is_within_twice_the_best() {
        // On a line 0..=100 the best radius of 5 centres is 10.
        let mut p = Points::new(101, 1, 1.0);
        let stride = p.stride();
        (0..101).for_each(|i| p.data_mut()[i * stride] = i as i16);
        let c = k_centre(&p, 5);
        let far = (0..101).map(|i| (0..5).map(|j| c.squared_distance_to(j, p.point(i))).min().unwrap()).max();
        assert!(far.unwrap() <= 20 * 20, "{far:?}");
    }

    #[test]
    fn equal_points_are_one_cluster() {
        let p = Points::new(20, 3, 1.0);
        let c = kmeans(&p, 7, 0.99, 10);
        assert_eq!((c.centres.len(), c.of), (1, vec![0; 20]));
    }
}
