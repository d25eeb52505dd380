//! Patches of several triangles, each laid flat as one piece.
//!
//! Source: \[MK03\] section 4: a block of the quilt should be about as large as the features, and "it's quite reasonable to
//! extend the algorithm to quilt patches of triangles". A patch grows breadth first from a face to a reach in texels. Its
//! faces keep their own rotations, so each stays similar; a face is laid beside the one from which it was reached so that
//! the middle of their edge is at one place.
//! Unaware of: what is in the exemplar.

use std::collections::VecDeque;

use super::frame::Facets;
use crate::numerics::vec::{Vec2, vec2};

/// Patches with less than this share of the mean number of faces join a neighbour.
const SMALL: f64 = 0.34;

/// A partition of the faces.
pub(super) struct Patches {
    starts: Vec<u32>,
    faces: Vec<u32>,
    /// Of each face: its patch, and where it lies in it.
    pub of: Vec<u32>,
    pub rel: Vec<Vec2>,
}

/// Marks faces without a patch.
const NONE: u32 = u32::MAX;

impl Patches {
    /// Every face by itself.
    pub fn single(facets: &Facets) -> Self {
        let n = facets.len() as u32;
        Patches {
            starts: (0..=n).collect(),
            faces: (0..n).collect(),
            of: (0..n).collect(),
            rel: vec![Vec2::ZERO; n as usize],
        }
    }

    /// Patches that reach `reach` texels around their first face and fit into `most` texels in x and y.
    pub fn new(facets: &Facets, reach: f64, most: [f64; 2]) -> Self {
        let mut of = vec![NONE; facets.len()];
        let mut rel = vec![Vec2::ZERO; facets.len()];
        let mut count = 0;
        let mut seeds = VecDeque::new();
        for first in 0..facets.len() {
            seeds.push_back(first);
            while let Some(seed) = seeds.pop_front() {
                if of[seed] == NONE {
                    let near = |c: Vec2| c.length() <= reach;
                    lay(facets, seed, &mut rel, &mut of, count, near, |g| seeds.push_back(g));
                    count += 1;
                }
            }
        }
        let Merged { of: same, by } = merged(facets, of, count);
        let (mut of, mut next) = (vec![NONE; facets.len()], 0);
        // Laid out as they are now; what is no longer one piece is several, what is too large falls apart.
        for &f in by.iter().flatten() {
            if of[f as usize] != NONE {
                continue;
            }
            let laid = lay_same(facets, f as usize, &same, &mut rel, &mut of, next);
            next += 1;
            let (low, high) = bounds(facets, &rel, &laid);
            if high.x - low.x <= most[0] && high.y - low.y <= most[1] {
                continue;
            }
            for &g in &laid[1..] {
                of[g as usize] = next;
                rel[g as usize] = Vec2::ZERO;
                next += 1;
            }
        }
        Self::sorted(of, rel, next as usize)
    }

    fn sorted(of: Vec<u32>, rel: Vec<Vec2>, count: usize) -> Self {
        let mut starts = vec![0u32; count + 1];
        of.iter().for_each(|p| starts[*p as usize + 1] += 1);
        (0..count).for_each(|p| starts[p + 1] += starts[p]);
        let (mut next, mut faces) = (starts.clone(), vec![0; of.len()]);
        for (f, p) in of.iter().enumerate() {
            faces[next[*p as usize] as usize] = f as u32;
            next[*p as usize] += 1;
        }
        Patches { starts, faces, of, rel }
    }

    /// Number of patches.
    pub fn len(&self) -> usize {
        self.starts.len() - 1
    }

    /// The faces of a patch, ascending.
    pub fn faces(&self, patch: usize) -> &[u32] {
        &self.faces[self.starts[patch] as usize..self.starts[patch + 1] as usize]
    }

    /// The box of a patch around its origin.
    pub fn bounds(&self, facets: &Facets, patch: usize) -> (Vec2, Vec2) {
        bounds(facets, &self.rel, self.faces(patch))
    }
}

/// The box of some faces as they are laid out.
fn bounds(facets: &Facets, rel: &[Vec2], faces: &[u32]) -> (Vec2, Vec2) {
    let corners = faces.iter().flat_map(|f| facets.local[*f as usize].map(|c| c + rel[*f as usize]));
    let far = vec2(f64::INFINITY, f64::INFINITY);
    corners.fold((far, -far), |(l, h), c| (vec2(l.x.min(c.x), l.y.min(c.y)), vec2(h.x.max(c.x), h.y.max(c.y))))
}

/// Where a face lies that continues another across its edge.
fn beside(facets: &Facets, f: usize, k: usize, g: usize, j: usize, at: Vec2) -> Vec2 {
    at + facets.middle(f, k) - facets.middle(g, j)
}

/// Lays faces without a patch out around a seed while their centres, seen from its own, are `near`; marks them `to` and
/// reports the faces beyond.
fn lay(
    facets: &Facets,
    seed: usize,
    rel: &mut [Vec2],
    of: &mut [u32],
    to: u32,
    near: impl Fn(Vec2) -> bool,
    mut beyond: impl FnMut(usize),
) {
    let origin = facets.centre(seed);
    (rel[seed], of[seed]) = (Vec2::ZERO, to);
    let mut queue = VecDeque::from([seed]);
    while let Some(f) = queue.pop_front() {
        for k in 0..3 {
            let Some((g, j)) = facets.opposite(f, k).filter(|(g, _)| of[*g] == NONE) else { continue };
            let at = beside(facets, f, k, g, j, rel[f]);
            if near(at + facets.centre(g) - origin) {
                (rel[g], of[g]) = (at, to);
                queue.push_back(g);
            } else {
                beyond(g);
            }
        }
    }
}

/// Lays the faces that `same` gives the seed's mark out around it; marks them `to` and returns them, the seed first.
fn lay_same(facets: &Facets, seed: usize, same: &[u32], rel: &mut [Vec2], of: &mut [u32], to: u32) -> Vec<u32> {
    (rel[seed], of[seed]) = (Vec2::ZERO, to);
    let mut laid = vec![seed as u32];
    let mut next = 0;
    while next < laid.len() {
        let f = laid[next] as usize;
        next += 1;
        for k in 0..3 {
            let Some((g, j)) = facets.opposite(f, k) else { continue };
            if of[g] == NONE && same[g] == same[seed] {
                (rel[g], of[g]) = (beside(facets, f, k, g, j, rel[f]), to);
                laid.push(g as u32);
            }
        }
    }
    laid
}

struct Merged {
    of: Vec<u32>,
    by: Vec<Vec<u32>>,
}

/// Small patches joined to the neighbour with which they share the most edges (the lowest of equals).
fn merged(facets: &Facets, mut of: Vec<u32>, count: u32) -> Merged {
    let mut by = vec![vec![]; count as usize];
    of.iter().enumerate().for_each(|(f, p)| by[*p as usize].push(f as u32));
    let small = (facets.len() as f64 / f64::from(count.max(1)) * SMALL) as usize;
    for p in 0..count as usize {
        if by[p].len() > small {
            continue;
        }
        let edges = by[p].iter().flat_map(|f| (0..3).filter_map(|k| facets.opposite(*f as usize, k)));
        let mut beyond: Vec<u32> = edges.map(|(g, _)| of[g]).filter(|q| *q as usize != p).collect();
        beyond.sort_unstable();
        let most = beyond.chunk_by(|a, b| a == b).fold(&[][..], |m, c| if c.len() > m.len() { c } else { m });
        if let Some(&q) = most.first() {
            let faces = std::mem::take(&mut by[p]);
            faces.iter().for_each(|f| of[*f as usize] = q);
            by[q as usize].extend(faces);
        }
    }
    Merged { of, by }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::field::{Field, Symmetry};
    use crate::mesh::zoo;
    use crate::numerics::vec::vec3;

    #[test]
    fn patches_partition_the_faces_and_fit() {
        for (name, m) in zoo::all() {
            let up = m.vertex_normals().iter().map(|n| n.any_perpendicular()).collect();
            let facets = Facets::new(&m, &Field { up, scale: vec![10.0; m.positions.len()] }, Symmetry::One);
            for reach in [0.0, 5.0, 1e9] {
                let p = Patches::new(&facets, reach, [40.0, 40.0]);
                let mut all: Vec<u32> = (0..p.len()).flat_map(|i| p.faces(i).to_vec()).collect();
                all.sort_unstable();
                assert_eq!(all, (0..facets.len() as u32).collect::<Vec<_>>(), "{name}");
                for i in (0..p.len()).filter(|i| p.faces(*i).len() > 1) {
                    let (low, high) = p.bounds(&facets, i);
                    assert!(high.x - low.x <= 40.0 && high.y - low.y <= 40.0, "{name}");
                }
            }
        }
    }

    #[test]
    fn a_patch_of_a_plane_is_the_plane() {
        let m = zoo::plane(6, 6);
        let n = m.positions.len();
        let facets = Facets::new(&m, &Field { up: vec![vec3(0., 1., 0.); n], scale: vec![3.0; n] }, Symmetry::One);
        let p = Patches::new(&facets, 1e9, [1e9; 2]);
        assert_eq!(p.len(), 1);
        for f in 0..facets.len() {
            let (a, b) = (m.corners(f)[0], m.corners(0)[0]);
            let want = vec2((a.x - b.x) * 3.0, (b.y - a.y) * 3.0);
            assert!((p.rel[f] - p.rel[0] - want).length() < 1e-9);
        }
    }
}
