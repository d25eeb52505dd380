//! Where charts end: the edges of the surface whose two sides lie apart in the atlas.
//!
//! In: positions, faces, corner UVs. Out: one [`Border`] per side of such an edge, with the corners of the other side.
//! An edge of more than two faces is closed where two of them agree in the atlas; every other side is paired with the
//! first that differs.

use super::atlas::{Atlas, NO_CHART};
use crate::mesh::Surface;
use crate::numerics::vec::Vec3;
use crate::texture::Uv;

/// Rows of the 2x2 matrix that takes the x and y of a tangent-space normal from one side of a border to the other.
pub(crate) type Turn = [[f32; 2]; 2];

/// No turn.
pub(crate) const STRAIGHT: Turn = [[1.0, 0.0], [0.0, 1.0]];

/// UVs that differ less than this, as a share of the page, are the same place.
const SAME_UV: f32 = 1e-6;

/// Edges of more faces than this are compared with only so many of them: keeps degenerate fans from taking quadratic time.
const MAX_FAN: usize = 64;

/// One side of an edge at which a chart ends. A corner is `3 * face + k`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Border {
    /// Corners at the two ends, in the order of the face.
    pub corners: [u32; 2],
    /// Corners of the other side at the same two places in space; `None` at the mesh's own boundary.
    pub partner: Option<[u32; 2]>,
}

/// A directed side of an edge, keyed by the welded ends in ascending order.
struct Side {
    ends: [u32; 2],
    /// Corners at `ends[0]` and `ends[1]`.
    corners: [u32; 2],
    /// True if the face runs from `ends[0]` to `ends[1]`.
    forward: bool,
}

/// For each vertex the lowest vertex at the same position.
pub(crate) fn weld(positions: &[Vec3]) -> Vec<u32> {
    // Adding zero turns -0.0 into 0.0, which compare differently.
    let key = |v: u32| {
        let p = positions[v as usize];
        [p.x + 0.0, p.y + 0.0, p.z + 0.0]
    };
    let mut order: Vec<u32> = (0..positions.len() as u32).collect();
    order.sort_unstable_by(|&a, &b| {
        let (ka, kb) = (key(a), key(b));
        ka[0].total_cmp(&kb[0]).then(ka[1].total_cmp(&kb[1])).then(ka[2].total_cmp(&kb[2])).then(a.cmp(&b))
    });
    let mut welded = vec![0; positions.len()];
    let mut first = 0;
    for (i, &v) in order.iter().enumerate() {
        if i == 0 || key(v) != key(first) {
            first = v;
        }
        welded[v as usize] = first;
    }
    welded
}

fn same(a: Uv, b: Uv) -> bool {
    (a.u - b.u).abs() <= SAME_UV && (a.v - b.v).abs() <= SAME_UV
}

fn sides(surface: &Surface, use_face: impl Fn(usize) -> bool) -> Vec<Side> {
    let welded = weld(&surface.mesh.positions);
    let mut sides = Vec::new();
    for (f, face) in surface.mesh.faces.iter().enumerate().filter(|(f, _)| use_face(*f)) {
        for k in 0..3 {
            let (i, j) = (k, (k + 1) % 3);
            let (a, b) = (welded[face[i] as usize], welded[face[j] as usize]);
            let (ca, cb) = ((3 * f + i) as u32, (3 * f + j) as u32);
            match a.cmp(&b) {
                std::cmp::Ordering::Less => sides.push(Side { ends: [a, b], corners: [ca, cb], forward: true }),
                std::cmp::Ordering::Greater => sides.push(Side { ends: [b, a], corners: [cb, ca], forward: false }),
                std::cmp::Ordering::Equal => {}
            }
        }
    }
    sides.sort_unstable_by_key(|s| (s.ends, s.corners));
    sides
}

/// All chart borders, in ascending order of the edge's ends, then of the corners.
pub(crate) fn borders(surface: &Surface, atlas: &Atlas) -> Vec<Border> {
    let uv = |c: u32| atlas.corner_uv[c as usize];
    let agree = |a: &Side, b: &Side| (0..2).all(|i| same(uv(a.corners[i]), uv(b.corners[i])));
    let sides = sides(surface, |f| atlas.chart[f] != NO_CHART);
    let mut out = Vec::new();
    for group in sides.chunk_by(|a, b| a.ends == b.ends) {
        for (i, side) in group.iter().enumerate() {
            let near = i.saturating_sub(MAX_FAN)..(i + MAX_FAN).min(group.len());
            let mut others = near.filter(|j| *j != i).map(|j| &group[j]);
            if others.clone().any(|o| agree(side, o) && o.forward != side.forward) {
                continue;
            }
            let partner = others.find(|o| !agree(side, o)).map(|o| o.corners);
            let turn = |c: [u32; 2]| if side.forward { c } else { [c[1], c[0]] };
            out.push(Border { corners: turn(side.corners), partner: partner.map(turn) });
        }
    }
    out
}

/// Labels faces by connected region of the atlas: faces that share an edge with the same UVs. Faces for which
/// `use_face` is false get [`NO_CHART`]. Returns the labels, numbered by first face, and their count.
pub(crate) fn uv_regions(surface: &Surface, uvs: &[Uv], use_face: impl Fn(usize) -> bool) -> (Vec<u32>, u32) {
    let n = surface.mesh.faces.len();
    let mut root: Vec<u32> = (0..n as u32).collect();
    fn find(root: &mut [u32], mut f: u32) -> u32 {
        while root[f as usize] != f {
            root[f as usize] = root[root[f as usize] as usize];
            f = root[f as usize];
        }
        f
    }
    for group in sides(surface, &use_face).chunk_by(|a, b| a.ends == b.ends) {
        for (i, a) in group.iter().enumerate() {
            for b in group[i + 1..].iter().take(MAX_FAN) {
                if (0..2).all(|k| same(uvs[a.corners[k] as usize], uvs[b.corners[k] as usize])) {
                    let (fa, fb) = (find(&mut root, a.corners[0] / 3), find(&mut root, b.corners[0] / 3));
                    root[fa.max(fb) as usize] = fa.min(fb);
                }
            }
        }
    }
    let (mut labels, mut count) = (vec![NO_CHART; n], 0);
    for f in 0..n {
        if !use_face(f) {
            continue;
        }
        let r = find(&mut root, f as u32) as usize;
        if r == f {
            labels[f] = count;
            count += 1;
        } else {
            labels[f] = labels[r];
        }
    }
    (labels, count)
}

/// How a tangent-space normal of the partner's side reads on the own side, the surface unfolded along the border: the
/// parts along the edge and across it stay the same.
pub(crate) fn turn(surface: &Surface, tangents: &[[f32; 4]], own: [u32; 2], partner: [u32; 2]) -> Turn {
    let at = |c: u32| surface.mesh.positions[surface.mesh.faces[c as usize / 3][c as usize % 3] as usize];
    let edge = at(own[1]) - at(own[0]);
    let axes = |corners: [u32; 2]| {
        let [a, b] = corners.map(|c| c as usize);
        let n = (surface.corner_normals[a] + surface.corner_normals[b]).normalized()?;
        let [t0, t1] = [a, b].map(|c| Vec3::from([tangents[c][0], tangents[c][1], tangents[c][2]]));
        let t = (t0 + t1).reject(n).normalized()?;
        let b = n.cross(t) * f64::from(tangents[a][3]);
        let along = edge.reject(n).normalized()?;
        let across = n.cross(along);
        Some([[along.dot(t), along.dot(b)], [across.dot(t), across.dot(b)]])
    };
    let (Some(o), Some(p)) = (axes(own), axes(partner)) else { return STRAIGHT };
    [0, 1].map(|i| [0, 1].map(|j| (o[0][i] * p[0][j] + o[1][i] * p[1][j]) as f32))
}
