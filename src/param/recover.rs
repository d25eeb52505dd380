//! Coordinates at the corners of triangles, from angles at the vertices and the whole periods between them.
//!
//! Source: `[MST09]` 2.3, Eq. 4. In: angles, the wanted change along edges. Out: per half-edge the change that the angles
//! make nearest to the wanted one, per face its corners' coordinates.
//! Reads as: Eq. 4 mixes turns with radians and calls one integer p and n: all is in periods, and p_j minimises
//! |s_j + p_j - s_i - alpha_ij / 2 pi|. As printed the third edge of a triangle is left out, and which one is an accident
//! of the order of its corners; here every edge has its integer, the same for both triangles, and a triangle whose three
//! do not sum to zero is one around which the coordinates wind ([`Around`]). Its corners are taken from the first.
//! Unaware of: positions.

use super::guide::Guide;
use super::periodic::Phases;
use crate::mesh::Topology;
use crate::numerics::vec::{Vec2, vec2};
use crate::numerics::{det, par};

/// What is left over after going around a triangle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Around {
    /// Whole periods of s and t.
    pub periods: [i32; 2],
    /// Quarter turns of the frame: the field is singular there.
    pub quarters: u8,
}

impl Around {
    /// Nothing is left over.
    pub fn closes(&self) -> bool {
        *self == Around::default()
    }
}

/// Angles in periods, -0.5..=0.5.
pub(super) fn periods(z: &Phases) -> Vec2 {
    let [s, t] = z.map(|z| det::atan2(z.im, z.re) / std::f64::consts::TAU);
    vec2(s, t)
}

/// The change of (s, t) along each half-edge in periods, in the frame of its vertex: that of the angles, and as many
/// whole periods as come nearest to what is wanted.
pub(super) fn changes(guide: &Guide, topo: &Topology, at: &[Vec2]) -> Vec<Vec2> {
    let nearest = |x: f64, wanted: f64| x + (wanted - x).round();
    // From the lower end, so that both half-edges agree.
    let from = |v: u32, h: usize| {
        let there = guide.seen(h, at[topo.target(h) as usize]);
        let (bare, wanted) = (there - at[v as usize], guide.steps[h]);
        vec2(nearest(bare.x, wanted.x), nearest(bare.y, wanted.y))
    };
    let of = |v: u32, h: usize| {
        if v < topo.target(h) {
            return from(v, h);
        }
        match topo.find(topo.target(h), v) {
            Some(back) => guide.seen(h, -from(topo.target(h), back)),
            None => Vec2::ZERO,
        }
    };
    let rows = par::map_chunks(topo.vertex_count(), 1024, |r| {
        r.flat_map(|v| topo.half_edges(v as u32).map(move |h| of(v as u32, h))).collect::<Vec<_>>()
    });
    rows.into_iter().flatten().collect()
}

/// A face's coordinates in periods, in the frame of its first corner, and what is left over around it.
pub(super) fn corners(
    guide: &Guide,
    topo: &Topology,
    at: &[Vec2],
    changes: &[Vec2],
    [a, b, c]: [u32; 3],
) -> ([Vec2; 3], Around) {
    let first = at[a as usize];
    let (Some(ab), Some(bc), Some(ac)) = (topo.find(a, b), topo.find(b, c), topo.find(a, c)) else {
        return ([first; 3], Around::default());
    };
    let onwards = guide.seen(ab, changes[bc]);
    let around = changes[ab] + onwards - changes[ac];
    let quarters = (guide.quarters[ab] + guide.quarters[bc] + 4 - guide.quarters[ac]) % 4;
    let around = Around { periods: [around.x.round() as i32, around.y.round() as i32], quarters };
    ([first, first + changes[ab], first + changes[ac]], around)
}
