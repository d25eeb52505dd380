//! Conforming subdivision: no edge longer than a given length, no cracks, parents known.
//!
//! Every over-long edge is halved, all at once, and the faces follow by the number of their halved edges: one, two or
//! four triangles similar to the parent (three halved), two (one halved, the longest), three (two halved, the quad cut
//! along its shorter diagonal). Repeated until nothing is over-long. Two faces at an edge halve it alike, because the
//! decision looks at the edge alone; its squared length is carried down (quarters are exact) instead of measured
//! anew, so a face's descendants can be counted before any is made. Angles get worse at most once, by a halving of the
//! longest edge; a needle is cut across until it is no needle. Per-edge divisions into n parts would need half as many
//! faces, but their patterns make the slivers that this avoids.

use super::TriMesh;
use crate::numerics::det;
use crate::numerics::vec::Vec3;

/// One triangle of a split: its corners (0..3 the parent's, 3..6 the middle of the edge from corner k - 3 on), and the
/// squared lengths of its edges (k from corner k to the next).
type Child = ([u8; 3], [f64; 3]);

/// Squared length of the median onto edge `a` of a triangle of squared edges `a`, `b`, `c`.
fn median2(a: f64, b: f64, c: f64) -> f64 {
    ((2.0 * (b + c) - a) / 4.0).max(0.0)
}

/// How a triangle of squared edges `l` splits where edges above `max2` are halved; `None` if none is.
fn split(l: [f64; 3], max2: f64) -> Option<([Child; 4], usize)> {
    let long = l.map(|l| l > max2);
    let unused = ([0; 3], [0.0; 3]);
    let q = l.map(|l| l / 4.0);
    match long.iter().filter(|&&m| m).count() {
        0 => None,
        3 => Some(([([0, 3, 5], q), ([3, 1, 4], q), ([5, 4, 2], q), ([3, 4, 5], [q[2], q[0], q[1]])], 4)),
        1 => {
            let a = long.iter().position(|&m| m).unwrap_or(0);
            let (b, c) = ((a + 1) % 3, (a + 2) % 3);
            let cut = median2(l[a], l[b], l[c]);
            let [ca, cb, cc, m] = [a as u8, b as u8, c as u8, a as u8 + 3];
            Some(([([ca, m, cc], [q[a], cut, l[c]]), ([m, cb, cc], [q[a], l[b], cut]), unused, unused], 2))
        }
        _ => {
            // The edge from corner a to b is kept; c is the apex between the halved edges.
            let a = long.iter().position(|&m| !m).unwrap_or(0);
            let (b, c) = ((a + 1) % 3, (a + 2) % 3);
            let [ca, cb, cc, right, left] = [a as u8, b as u8, c as u8, b as u8 + 3, c as u8 + 3];
            let apex = ([left, right, cc], [q[a], q[b], q[c]]);
            let (from_a, from_b) = (median2(l[b], l[a], l[c]), median2(l[c], l[a], l[b]));
            let (lower, upper) = if from_a <= from_b {
                (([ca, cb, right], [l[a], q[b], from_a]), ([ca, right, left], [from_a, q[a], q[c]]))
            } else {
                (([ca, cb, left], [l[a], from_b, q[c]]), ([cb, right, left], [q[b], q[a], from_b]))
            };
            Some(([apex, lower, upper, unused], 3))
        }
    }
}

/// Adds to `total` the triangles that one of squared edges `l` becomes, `times` times; stops once above `limit`.
fn count_face(l: [f64; 3], max2: f64, times: u64, limit: u64, total: &mut u64) {
    if *total > limit {
        return;
    }
    match split(l, max2) {
        None => *total = total.saturating_add(times),
        // Similar triangles split alike: count one for four.
        Some((children, 4)) => count_face(children[0].1, max2, times.saturating_mul(4), limit, total),
        Some((children, n)) => children[..n].iter().for_each(|c| count_face(c.1, max2, times, limit, total)),
    }
}

fn squared_edges(mesh: &TriMesh, face: usize) -> [f64; 3] {
    let p = mesh.corners(face);
    std::array::from_fn(|k| {
        let d = p[(k + 1) % 3] - p[k];
        d.dot(d)
    })
}

/// The number of faces after [`subdivide`], exactly; or any number above `limit` if it is above. Takes no memory and at
/// most about `limit` steps.
pub(super) fn count(mesh: &TriMesh, max_edge: f64, limit: u64) -> u64 {
    let mut total = 0;
    for f in 0..mesh.faces.len() {
        count_face(squared_edges(mesh, f), max_edge * max_edge, 1, limit, &mut total);
    }
    total
}

/// About how many faces there would be, for numbers too large to count: halvings of the shortest and the longest edge.
pub(super) fn estimate(mesh: &TriMesh, max_edge: f64) -> f64 {
    let halvings = |l2: f64| (det::log2(l2.sqrt() / max_edge)).ceil().clamp(0.0, 400.0);
    let of = |f: usize| {
        let l = squared_edges(mesh, f);
        let (least, most) = (l[0].min(l[1]).min(l[2]), l[0].max(l[1]).max(l[2]));
        det::pow(2.0, halvings(least) + halvings(most))
    };
    (0..mesh.faces.len()).map(of).sum()
}

/// A mesh with the face each face came from and where in it.
pub(super) struct Subdivided {
    pub mesh: TriMesh,
    pub parent: Vec<u32>,
    pub bary: Vec<[[f32; 3]; 3]>,
}

/// Halves edges longer than `max_edge` until there are none. Old vertices keep their indices; descendants of a face
/// stay together, in the order of the faces.
pub(super) fn subdivide(mesh: TriMesh, max_edge: f64) -> Subdivided {
    let n = mesh.faces.len();
    let mut edges: Vec<[f64; 3]> = (0..n).map(|f| squared_edges(&mesh, f)).collect();
    let corners = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let mut s = Subdivided { mesh, parent: (0..n as u32).collect(), bary: vec![corners; n] };
    let max2 = max_edge * max_edge;
    while edges.iter().any(|l| l.iter().any(|&l| l > max2)) {
        edges = pass(&mut s, &edges, max2);
    }
    s
}

/// One halving of all over-long edges; gives the squared edges of the new faces.
fn pass(s: &mut Subdivided, edges: &[[f64; 3]], max2: f64) -> Vec<[f64; 3]> {
    let middles = halve(&mut s.mesh, edges, max2);
    let old = std::mem::take(&mut s.mesh.faces);
    let (old_parent, old_bary) = (std::mem::take(&mut s.parent), std::mem::take(&mut s.bary));
    let mut new_edges = Vec::with_capacity(edges.len() * 2);
    for (f, face) in old.iter().enumerate() {
        let bary = old_bary[f];
        let middle = |k: usize| std::array::from_fn(|i| (bary[k][i] + bary[(k + 1) % 3][i]) * 0.5);
        let points: [[f32; 3]; 6] = [bary[0], bary[1], bary[2], middle(0), middle(1), middle(2)];
        let m = &middles[3 * f..3 * f + 3];
        let ids = [face[0], face[1], face[2], m[0], m[1], m[2]];
        let whole = ([([0u8, 1, 2], edges[f]); 4], 1);
        let (children, count) = split(edges[f], max2).unwrap_or(whole);
        for (corners, lengths) in &children[..count] {
            s.mesh.faces.push(corners.map(|c| ids[c as usize]));
            s.bary.push(corners.map(|c| points[c as usize]));
            s.parent.push(old_parent[f]);
            new_edges.push(*lengths);
        }
    }
    new_edges
}

/// Adds the middle of every over-long edge as a vertex, ordered by the edge's ends; gives for each (face, edge) the
/// middle, or `u32::MAX`.
fn halve(mesh: &mut TriMesh, edges: &[[f64; 3]], max2: f64) -> Vec<u32> {
    let mut long: Vec<(u32, u32, u32)> = vec![];
    for (f, l) in edges.iter().enumerate() {
        for k in (0..3).filter(|&k| l[k] > max2) {
            let (a, b) = (mesh.faces[f][k], mesh.faces[f][(k + 1) % 3]);
            long.push((a.min(b), a.max(b), (3 * f + k) as u32));
        }
    }
    long.sort_unstable();
    let mut middles = vec![u32::MAX; edges.len() * 3];
    let mut last = None;
    for (a, b, slot) in long {
        if last != Some((a, b)) {
            last = Some((a, b));
            let p: Vec3 = (mesh.positions[a as usize] + mesh.positions[b as usize]) * 0.5;
            mesh.positions.push(p);
        }
        middles[slot as usize] = mesh.positions.len() as u32 - 1;
    }
    middles
}

/// Every face into four, for the zoo's spheres.
#[cfg(test)]
pub(crate) fn quarter(mesh: &TriMesh) -> TriMesh {
    let edges = vec![[1.0; 3]; mesh.faces.len()];
    let mut s = Subdivided { mesh: mesh.clone(), parent: vec![0; edges.len()], bary: vec![[[0.0; 3]; 3]; edges.len()] };
    pass(&mut s, &edges, 0.5);
    s.mesh
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::check::census;
    use crate::mesh::{Topology, zoo};
    use proptest::prelude::*;

    fn smallest_angle(m: &TriMesh) -> f64 {
        let mut least = f64::INFINITY;
        for f in 0..m.faces.len() {
            let p = m.corners(f);
            for k in 0..3 {
                let (a, b) = (p[(k + 1) % 3] - p[k], p[(k + 2) % 3] - p[k]);
                least = least.min(det::atan2(a.cross(b).length(), a.dot(b)));
            }
        }
        least
    }

    fn longest_edge(m: &TriMesh) -> f64 {
        (0..m.faces.len()).flat_map(|f| squared_edges(m, f)).fold(0.0, f64::max).sqrt()
    }

    #[test]
    fn the_zoo_stays_whole_at_every_length() {
        // The two sides of a sheet share edges but not the vertices inside: `prepare` parts them first.
        for (name, m) in zoo::all().into_iter().filter(|(name, _)| *name != "two-sided") {
            for max_edge in [3.0, 0.7, 0.31, 0.1, 0.043] {
                let (c, area) = (census(&m, &Topology::new(&m)), (0..m.faces.len()).map(|f| m.area(f)).sum::<f64>());
                let expected = count(&m, max_edge, u64::MAX / 8);
                let s = subdivide(m.clone(), max_edge);
                let d = census(&s.mesh, &Topology::new(&s.mesh));
                assert_eq!(s.mesh.faces.len() as u64, expected, "{name} {max_edge}: counted ahead");
                assert!(longest_edge(&s.mesh) <= max_edge * (1.0 + 1e-12), "{name} {max_edge}");
                assert_eq!((c.euler, c.components), (d.euler, d.components), "{name} {max_edge}: no cracks, no holes");
                assert_eq!(c.boundary_edges == 0, d.boundary_edges == 0, "{name} {max_edge}");
                let new_area = (0..s.mesh.faces.len()).map(|f| s.mesh.area(f)).sum::<f64>();
                assert!((new_area - area).abs() < 1e-9 * area, "{name} {max_edge}: {area} {new_area}");
                if !["sliver", "zero-area face"].contains(&name) {
                    assert!(smallest_angle(&s.mesh) > 0.4 * smallest_angle(&m), "{name} {max_edge}: slivers");
                }
                let estimate = estimate(&m, max_edge) / expected as f64;
                assert!((0.3..4.0).contains(&estimate), "{name} {max_edge}: estimate off by {estimate}");
            }
        }
    }

    #[test]
    fn corners_lie_where_their_barycentric_coordinates_say() {
        let m = zoo::torus(7, 5);
        let s = subdivide(m.clone(), 0.11);
        assert!(s.parent.is_sorted());
        for f in 0..s.mesh.faces.len() {
            let p = m.corners(s.parent[f] as usize);
            for (at, b) in s.mesh.corners(f).iter().zip(&s.bary[f]) {
                assert_eq!(b.iter().sum::<f32>(), 1.0, "dyadic fractions are exact");
                let from_bary = p[0] * f64::from(b[0]) + p[1] * f64::from(b[1]) + p[2] * f64::from(b[2]);
                assert!((*at - from_bary).length() < 1e-12);
            }
        }
    }

    #[test]
    fn counting_gives_up_at_the_limit_and_huge_counts_are_estimated() {
        let m = zoo::cube();
        assert!(count(&m, 1e-9, 1000) > 1000);
        let faces = estimate(&m, 2.0 / 1024.0);
        assert!((faces / count(&m, 2.0 / 1024.0, u64::MAX / 8) as f64 - 1.0).abs() < 1.0, "{faces}");
        assert!(estimate(&m, 1e-300).is_finite());
    }

    proptest! {
        #[test]
        fn any_two_triangles_conform_and_needles_are_cut_across(
            p in prop::array::uniform4(prop::array::uniform3(-1.0f64..1.0)), max_edge in 0.05f64..1.0,
            thin in 0.001f64..1.0,
        ) {
            let p = p.map(|q| [q[0], q[1] * thin, q[2] * thin]);
            let m = zoo::mesh(&p, &[[0, 1, 2], [2, 1, 3]]);
            let s = subdivide(m.clone(), max_edge);
            prop_assert_eq!(s.mesh.faces.len() as u64, count(&m, max_edge, u64::MAX / 8));
            prop_assert_eq!(census(&s.mesh, &Topology::new(&s.mesh)).euler, 1);
            prop_assert!(longest_edge(&s.mesh) <= max_edge * (1.0 + 1e-9));
            prop_assert!(smallest_angle(&s.mesh) > 0.3 * smallest_angle(&m) - 1e-9);
        }
    }
}
