//! The first guess of the nearest neighbours: all pairs of points of similar clusters.
//!
//! Source: balanced random projection trees (Dasgupta, Freund 2008), their directions improved as in two-means; probing
//! the nearest clusters is the inverted file of vector quantisation (Jegou et al. 2011).
//! A cluster's points are compared with another's as a small matrix product over data that is contiguous: one pair costs
//! a tenth of one that is fetched from anywhere in memory, which is why so many pairs can be afforded.

use super::{Neighbours, Points, key, squared_distance};
use crate::numerics::par;
use crate::numerics::rng::Key;
use wide::{i16x8, i32x4};

/// Most points of a cluster.
const CLUSTER: usize = 32;
/// Vectors of four candidates in a cluster.
const VECTORS: usize = CLUSTER / 4;
/// Clusters that are ranked together, neighbours in the tree.
const GROUP: usize = 16;
/// Groups whose clusters are ranked hold this many times the clusters that are probed.
const RANKED: usize = 4;
/// Probing ends when this many clusters in a row brought nothing nearer to any point of the cluster; one more for each
/// doubling of the points from [`FEW`] on, or the share of neighbours that are found falls.
const PATIENCE: usize = 5;
/// As many points as [`PATIENCE`] is for.
const FEW: usize = 1 << 14;

/// How far to search.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effort {
    /// Compare all pairs.
    Exact,
    /// Compare each cluster with this many of the nearest, fewer when they bring nothing.
    Probes(usize),
}

/// The `k` nearest neighbours of every point among the pairs that are `allowed` (a point never is its own).
/// Panics if `k` is zero or there are 2^31 points or more.
pub fn search(points: &Points, k: usize, effort: Effort, allowed: impl Fn(u32, u32) -> bool + Sync) -> Neighbours {
    assert!(k > 0 && points.len() < 1 << 31, "k {k} of {} points", points.len());
    let mut keys = vec![key::NONE; points.len() * k];
    let clusters = clusters(points);
    let groups: Vec<Vec<i16>> =
        clusters.chunks(GROUP).map(|g| mean(g.iter().map(|c| &c.mean[..]), points.stride())).collect();
    // A limited number of clusters in flight: their lists are copied into place between.
    for (batch, part) in clusters.chunks(1024).enumerate() {
        let found = par::map_chunks(part.len(), 1, |r| {
            let cluster = batch * 1024 + r.start;
            let order = probe_order(&clusters, &groups, cluster, effort);
            probe(points, &clusters, cluster, &order, k, effort, &allowed)
        });
        for (cluster, lists) in part.iter().zip(&found) {
            for (&id, list) in cluster.ids.iter().zip(lists.chunks_exact(k)) {
                keys[id as usize * k..][..k].copy_from_slice(list);
            }
        }
    }
    Neighbours { k, keys }
}

/// Points that lie together, transposed: `pairs[j][v]` holds components 2j and 2j + 1 of candidates 4v..4v + 4.
struct Cluster {
    ids: Vec<u32>,
    pairs: Vec<[i16x8; VECTORS]>,
    /// Squared norms.
    norms: [i32; CLUSTER],
    mean: Vec<i16>,
}

impl Cluster {
    fn new(points: &Points, ids: Vec<u32>) -> Self {
        let stride = points.stride();
        let mut pairs = vec![[[0i16; 8]; VECTORS]; points.dims.div_ceil(2)];
        // Places without a point are so far away that they never come into a list.
        let mut norms = [i32::MAX / 2; CLUSTER];
        for (i, &id) in ids.iter().enumerate() {
            let point = points.point(id);
            norms[i] = point.iter().map(|v| i32::from(*v) * i32::from(*v)).sum();
            for (pair, v) in pairs.iter_mut().zip(point.chunks_exact(2)) {
                pair[i / 4][i % 4 * 2..][..2].copy_from_slice(v);
            }
        }
        let mean = mean(ids.iter().map(|&id| points.point(id)), stride);
        Cluster { ids, pairs: pairs.iter().map(|p| p.map(i16x8::new)).collect(), norms, mean }
    }

    /// Scalar products of a query, each of its component pairs repeated four times, with all points.
    #[inline]
    fn dots(&self, query: &[i16x8]) -> [i32x4; VECTORS] {
        let mut sums = [i32x4::ZERO; VECTORS];
        for (q, pairs) in query.iter().zip(&self.pairs) {
            for (sum, pair) in sums.iter_mut().zip(pairs) {
                *sum += q.dot(*pair);
            }
        }
        sums
    }
}

/// Component-wise mean.
fn mean<'a>(rows: impl Iterator<Item = &'a [i16]>, stride: usize) -> Vec<i16> {
    let (mut sums, mut count) = (vec![0i32; stride], 0);
    for row in rows {
        sums.iter_mut().zip(row).for_each(|(s, v)| *s += i32::from(*v));
        count += 1;
    }
    sums.iter().map(|s| (s / count.max(1)) as i16).collect()
}

/// The clusters to compare a cluster with, nearest mean first.
fn probe_order(clusters: &[Cluster], groups: &[Vec<i16>], cluster: usize, effort: Effort) -> Vec<u32> {
    let Effort::Probes(probes) = effort else { return (0..clusters.len() as u32).collect() };
    let mean = &clusters[cluster].mean;
    let nearest = |mut ranked: Vec<(u32, u32)>, count: usize| -> Vec<u32> {
        if count < ranked.len() {
            ranked.select_nth_unstable(count);
            ranked.truncate(count);
        }
        ranked.sort_unstable();
        ranked.iter().map(|r| r.1).collect()
    };
    let ranked = groups.iter().enumerate().map(|(i, g)| (squared_distance(mean, g), i as u32)).collect();
    let groups = nearest(ranked, (RANKED * probes).div_ceil(GROUP));
    let members = groups.iter().flat_map(|&g| g as usize * GROUP..((g as usize + 1) * GROUP).min(clusters.len()));
    nearest(members.map(|i| (squared_distance(mean, &clusters[i].mean), i as u32)).collect(), probes)
}

/// The lists of a cluster's points, from the clusters of `order`.
fn probe(
    points: &Points,
    clusters: &[Cluster],
    cluster: usize,
    order: &[u32],
    k: usize,
    effort: Effort,
    allowed: &(impl Fn(u32, u32) -> bool + Sync),
) -> Vec<u64> {
    let own = &clusters[cluster];
    let mut lists = vec![key::NONE; own.ids.len() * k];
    let queries: Vec<Vec<i16x8>> = own.ids.iter().map(|&id| spread(points.point(id))).collect();
    let patience = PATIENCE + (points.len() / FEW).max(1).ilog2() as usize;
    let mut idle = 0;
    for &other in order {
        let other = &clusters[other as usize];
        let mut nearer = false;
        for (i, list) in lists.chunks_exact_mut(k).enumerate() {
            nearer |= compare(own.ids[i], own.norms[i], &queries[i], other, list, allowed);
        }
        idle = if nearer { 0 } else { idle + 1 };
        if idle == patience && effort != Effort::Exact {
            break;
        }
    }
    lists
}

/// Each pair of components four times.
fn spread(point: &[i16]) -> Vec<i16x8> {
    point.chunks_exact(2).map(|p| i16x8::new([p[0], p[1], p[0], p[1], p[0], p[1], p[0], p[1]])).collect()
}

/// Offers all points of a cluster to a list; true if one was nearer than the last of the list.
#[inline]
fn compare(
    point: u32,
    norm: i32,
    query: &[i16x8],
    other: &Cluster,
    list: &mut [u64],
    allowed: &(impl Fn(u32, u32) -> bool + Sync),
) -> bool {
    let last = list.len() - 1;
    let mut nearer = false;
    // |a - b|^2 = |a|^2 + |b|^2 - 2 ab; ties pass.
    let limit = |list: &[u64]| i32x4::splat((key::squared(list[last]) as i32).saturating_sub(norm).saturating_add(1));
    let mut within = limit(list);
    for (v, dots) in other.dots(query).into_iter().enumerate() {
        let norms: [i32; 4] = std::array::from_fn(|i| other.norms[4 * v + i]);
        let rest = i32x4::new(norms) - (dots + dots);
        let mut mask = within.simd_gt(rest).to_bitmask();
        while mask != 0 {
            let lane = mask.trailing_zeros() as usize;
            mask &= mask - 1;
            let Some(&id) = other.ids.get(4 * v + lane) else { continue };
            let squared = (rest.to_array()[lane] + norm) as u32;
            let worst = key::squared(list[last]);
            if squared > worst || id == point || !allowed(point, id) {
                continue;
            }
            nearer |= squared < worst;
            key::offer(list, key::new(point, id, squared));
            within = limit(list);
        }
    }
    nearer
}

/// Cuts the points into clusters, in the order of the tree.
fn clusters(points: &Points) -> Vec<Cluster> {
    let mut items: Vec<u64> = (0..points.len() as u64).collect();
    let mut nodes: Vec<&mut [u64]> = vec![&mut items];
    let mut level = 0;
    while nodes.iter().any(|n| n.len() > CLUSTER) {
        let seed = Key::new(0).with_str("cluster").with(level);
        par::for_rows(&mut nodes, 1, |i, node| {
            if node[0].len() > CLUSTER {
                split(points, seed.with(i as u64), node[0]);
            }
        });
        // Cut between whole clusters: only the last one may not be full.
        let middle = |n: &[u64]| n.len().div_ceil(CLUSTER) / 2 * CLUSTER;
        nodes = nodes.into_iter().flat_map(|n| <[_; 2]>::from(n.split_at_mut(middle(n)))).collect();
        nodes.retain(|n| !n.is_empty());
        level += 1;
    }
    par::map(nodes.len(), |i| Cluster::new(points, nodes[i].iter().map(|item| *item as u32).collect()))
}

/// Sorts a node's items along a direction in which they spread.
fn split(points: &Points, seed: Key, items: &mut [u64]) {
    let direction = direction(points, seed, items);
    let salt = seed.bits(0) as u32;
    par::for_rows(items, 1024, |_, items| {
        for item in items {
            let id = *item as u32;
            // Equal points come in random order: by index they would come in rows, which fill a cluster with pairs that
            // are too close together to be allowed.
            let order = (dot(points.point(id), &direction) as u32) ^ (1 << 31);
            *item = (u64::from(order) << 32) | u64::from(key::rank(salt, id));
        }
    });
    items.sort_unstable();
    items.iter_mut().for_each(|item| *item = u64::from(key::neighbour(salt, u64::from(*item as u32) << 1)));
}

/// Scalar product.
fn dot(a: &[i16], b: &[i16]) -> i32 {
    let ((a, _), (b, _)) = (a.as_chunks::<8>(), b.as_chunks::<8>());
    a.iter().zip(b).fold(i32x4::ZERO, |s, (a, b)| s + i16x8::new(*a).dot(i16x8::new(*b))).reduce_add()
}

/// A direction in which the items spread: between two distant ones, turned a few times towards the means of the halves
/// of a sample (two-means; without it a third fewer of the true neighbours are found by equal work).
fn direction(points: &Points, seed: Key, items: &[u64]) -> Vec<i16> {
    const SAMPLE: usize = 128;
    const TURNS: usize = 3;
    let len = items.len() as u32;
    let pick = |draw| items[seed.below(draw, len) as usize] as u32;
    let far = (1..4).map(|t| (pick(2 * t), pick(2 * t + 1))).max_by_key(|(a, b)| points.squared_distance(*a, *b));
    let (a, b) = far.unwrap_or((0, 0));
    let mut direction: Vec<i16> = points.point(a).iter().zip(points.point(b)).map(|(a, b)| a - b).collect();

    let count = items.len().min(SAMPLE);
    let mut sample: Vec<(i32, u32)> = (0..count).map(|i| (0, items[i * items.len() / count] as u32)).collect();
    for _ in 0..TURNS {
        sample.iter_mut().for_each(|s| s.0 = dot(points.point(s.1), &direction));
        sample.sort_unstable();
        let (low, high) = sample.split_at(count / 2);
        let half = |part: &[(i32, u32)]| mean(part.iter().map(|s| points.point(s.1)), points.stride());
        direction = half(high).iter().zip(half(low)).map(|(h, l)| h - l).collect();
    }
    direction
}
