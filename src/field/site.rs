//! Where a constraint acts: the vertex that it sits on, a small disc that it holds, and the area that it reaches.
//!
//! A single point has no weight in a relaxation over a surface: its influence would shrink with the size of the
//! triangles. So a constraint holds a disc of fixed size around its vertex, and the result hardly depends on the mesh.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use super::{Error, Which};
use crate::mesh::{Topology, TriMesh};
use crate::numerics::vec::Vec3;

/// Radius of the disc that a constraint holds, as a part of the mesh's diagonal.
const DISC: f64 = 0.02;

/// A place on the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Site {
    pub vertex: u32,
    /// The face nearest to the wanted point; `vertex` is one of its corners.
    pub face: u32,
    /// Geodesic reach; `None` for the whole component.
    pub radius: Option<f64>,
    /// Radius of the disc it holds.
    pub disc: f64,
}

/// The place of each (constraint, at, radius): the corner nearest to `at` of the face nearest to `at`. The discs of two
/// places at different vertices do not meet, unless one of them has no radius and the other, which comes after it, has
/// one: what acts nearby changes nothing elsewhere.
pub(super) fn sites(mesh: &TriMesh, wanted: &[(Which, Vec3, Option<f64>)]) -> Result<Vec<Site>, Error> {
    let (low, high) = mesh.bounds();
    let diagonal = (high - low).length();
    let mut sites = Vec::with_capacity(wanted.len());
    for &(which, at, radius) in wanted {
        if !at.is_finite() || radius.is_some_and(|r| !r.is_finite()) {
            return Err(Error::NotFinite(which));
        }
        if let Some(radius) = radius.filter(|&r| r <= 0.0) {
            return Err(Error::Radius { which, radius });
        }
        let (vertex, face, distance) = nearest_vertex(mesh, at).ok_or(Error::NoFaces)?;
        if distance > diagonal {
            return Err(Error::TooFar { which, distance, limit: diagonal });
        }
        let disc = radius.map_or(DISC * diagonal, |r| (r * 0.5).min(DISC * diagonal));
        sites.push(Site { vertex, face, radius, disc });
    }
    for i in 0..sites.len() {
        let p = mesh.positions[sites[i].vertex as usize];
        let apart = |s: &Site| (mesh.positions[s.vertex as usize] - p).length();
        let own = sites[i];
        let others = sites.iter().filter(|s| s.vertex != own.vertex && (own.radius.is_some() || s.radius.is_none()));
        let nearest = others.map(apart).fold(f64::INFINITY, f64::min);
        sites[i].disc = sites[i].disc.min(nearest * 0.25);
    }
    Ok(sites)
}

/// The corner nearest to `at` of the nearest face (the first of equals), that face and the distance to it.
fn nearest_vertex(mesh: &TriMesh, at: Vec3) -> Option<(u32, u32, f64)> {
    let mut best: Option<(f64, usize)> = None;
    for f in 0..mesh.faces.len() {
        let [a, b, c] = mesh.corners(f);
        let bound = best.map_or(f64::INFINITY, |(d, _)| d);
        // Distance to the bounding box first.
        let gap = |i: usize| (a[i].min(b[i]).min(c[i]) - at[i]).max(at[i] - a[i].max(b[i]).max(c[i])).max(0.0);
        let (x, y, z) = (gap(0), gap(1), gap(2));
        if x * x + y * y + z * z < bound {
            let d = closest(at, [a, b, c]) - at;
            if d.dot(d) < bound {
                best = Some((d.dot(d), f));
            }
        }
    }
    let (d2, f) = best?;
    let away = |v: u32| {
        let d = mesh.positions[v as usize] - at;
        d.dot(d)
    };
    let vertex = mesh.faces[f].into_iter().min_by(|&a, &b| away(a).total_cmp(&away(b)).then(a.cmp(&b)))?;
    Some((vertex, f as u32, d2.sqrt()))
}

/// The point of a triangle nearest to `p`: inside if `p` projects there, else on the nearest edge.
fn closest(p: Vec3, [a, b, c]: [Vec3; 3]) -> Vec3 {
    let n = (b - a).cross(c - a);
    let inside = |from: Vec3, to: Vec3| (to - from).cross(p - from).dot(n) >= 0.0;
    if let Some(unit) = n.normalized()
        && inside(a, b)
        && inside(b, c)
        && inside(c, a)
    {
        return p - unit * (p - a).dot(unit);
    }
    let on_edge = |from: Vec3, to: Vec3| {
        let e = to - from;
        let l = e.dot(e);
        let t = if l > 0.0 { ((p - from).dot(e) / l).clamp(0.0, 1.0) } else { 0.0 };
        from + e * t
    };
    let candidates = [on_edge(a, b), on_edge(b, c), on_edge(c, a)];
    let away = |q: &Vec3| (*q - p).dot(*q - p);
    candidates.into_iter().fold(candidates[0], |best, q| if away(&q) < away(&best) { q } else { best })
}

/// A vertex reached by [`reach`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Reached {
    pub vertex: u32,
    /// The half-edge towards the vertex before it on its shortest path; `None` for the start.
    pub back: Option<usize>,
}

/// The vertices within `radius` of `start` along edges (Dijkstra 1959), nearest first, ties by index.
pub(super) fn reach(mesh: &TriMesh, topo: &Topology, start: u32, radius: f64) -> Vec<Reached> {
    struct Entry(f64, u32, u32);
    impl PartialEq for Entry {
        fn eq(&self, o: &Self) -> bool {
            self.cmp(o) == Ordering::Equal
        }
    }
    impl Eq for Entry {}
    impl PartialOrd for Entry {
        fn partial_cmp(&self, o: &Self) -> Option<Ordering> {
            Some(self.cmp(o))
        }
    }
    impl Ord for Entry {
        // Reversed: the heap gives the largest, we want the nearest.
        fn cmp(&self, o: &Self) -> Ordering {
            o.0.total_cmp(&self.0).then(o.1.cmp(&self.1)).then(o.2.cmp(&self.2))
        }
    }
    let mut done = vec![false; topo.vertex_count()];
    let mut distance = vec![f64::INFINITY; topo.vertex_count()];
    let mut heap = BinaryHeap::from([Entry(0.0, start, start)]);
    let mut reached = vec![];
    while let Some(Entry(d, v, from)) = heap.pop() {
        if std::mem::replace(&mut done[v as usize], true) {
            continue;
        }
        reached.push(Reached { vertex: v, back: topo.find(v, from) });
        for &n in topo.neighbours(v).iter().filter(|&&n| !done[n as usize]) {
            let to = d + (mesh.positions[n as usize] - mesh.positions[v as usize]).length();
            if to <= radius && to <= distance[n as usize] {
                distance[n as usize] = to;
                heap.push(Entry(to, n, v));
            }
        }
    }
    reached
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::zoo;
    use crate::numerics::vec::vec3;
    use proptest::prelude::*;

    const WHICH: Which = Which { list: "orientation", index: 3 };

    #[test]
    fn the_nearest_corner_of_the_nearest_face() {
        let m = zoo::plane(4, 4);
        let (v, f, d) = nearest_vertex(&m, vec3(2.2, 0.9, 0.5)).unwrap();
        assert_eq!((v, d), (7, 0.5));
        assert!(m.faces[f as usize].contains(&7));
        let (v, _, d) = nearest_vertex(&m, vec3(-3.0, -4.0, 0.0)).unwrap();
        assert_eq!((v, d), (0, 5.0));
        let far = sites(&m, &[(WHICH, vec3(0., 0., 6.), None)]).unwrap_err();
        assert!(far.to_string().starts_with("orientation constraint 3 is 6 units from the surface"), "{far}");
        let fail = |at, r| sites(&m, &[(WHICH, at, r)]).unwrap_err();
        assert_eq!(fail(vec3(f64::NAN, 0., 0.), None), Error::NotFinite(WHICH));
        assert_eq!(fail(Vec3::ZERO, Some(-1.0)), Error::Radius { which: WHICH, radius: -1.0 });
        assert_eq!(sites(&TriMesh::default(), &[(WHICH, Vec3::ZERO, None)]), Err(Error::NoFaces));
    }

    #[test]
    fn discs_keep_apart() {
        let m = zoo::plane(100, 1);
        let s = sites(&m, &[(WHICH, vec3(0., 0., 0.), None), (WHICH, vec3(4., 0., 0.), None)]).unwrap();
        assert_eq!((s[0].vertex, s[1].vertex, s[0].disc), (0, 4, 1.0));
    }

    #[test]
    fn reaching_follows_the_surface() {
        let m = zoo::plane(4, 0x4);
        let near: Vec<u32> = reach(&m, &Topology::new(&m), 0, 1.5).iter().map(|r| r.vertex).collect();
        assert_eq!(near, [0, 1, 5, 6], "by distance: itself, two sides, a diagonal");
        let two = zoo::two_components();
        assert_eq!(reach(&two, &Topology::new(&two), 0, 1e9).len(), 4, "not over to the other component");
    }

    proptest! {
        #[test]
        fn no_sample_of_a_triangle_is_nearer_than_the_closest_point(
            q in prop::array::uniform4(prop::array::uniform3(-1.0f64..1.0)),
        ) {
            let [p, a, b, c] = q.map(Vec3::from);
            let best = (closest(p, [a, b, c]) - p).length();
            for i in 0..=40 {
                for j in 0..=40 - i {
                    let (s, t) = (f64::from(i) / 40.0, f64::from(j) / 40.0);
                    prop_assert!((a + (b - a) * s + (c - a) * t - p).length() >= best - 1e-9);
                }
            }
        }
    }
}
