//! Where a vertex may lie in the exemplar so that all its edges fit in.
//!
//! Source: \[ZG03\] 4.2.4: the bounding box of the offsets of all incident edges, centred at the address, must remain
//! inside the texture. The box holds the address itself, too. "Inside" is taken as the rectangle between the outer texel
//! centres, 0.5 to side - 0.5: there bilinear sampling reads only texels that exist, so nothing is clamped or wrapped.
//! Bounds are rounded inwards to f32, so an address that passes is exactly inside.
//! Unaware of: jumps, weights.

use crate::mesh::Topology;
use crate::numerics::par;
use crate::numerics::rng::Key;
use crate::numerics::vec::Vec2;
use crate::synth::Error;
use crate::texture::{Texel, texel};

/// The rectangle of valid addresses of a vertex; never empty of those that [`rooms`] gives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::synth) struct Room {
    min: [f32; 2],
    max: [f32; 2],
}

impl Room {
    /// Room of a vertex with these offsets in an exemplar of this size.
    pub fn new(offsets: &[Vec2], size: [u32; 2]) -> Self {
        let (low, high) = spans(offsets);
        let side = size.map(f64::from);
        Room {
            min: [at_least(0.5 - low.x), at_least(0.5 - low.y)],
            max: [at_most(side[0] - 0.5 - high.x), at_most(side[1] - 0.5 - high.y)],
        }
    }

    /// True if no address is valid.
    pub fn is_empty(&self) -> bool {
        self.min[0] > self.max[0] || self.min[1] > self.max[1]
    }

    /// True if the whole box fits in around `at`.
    pub fn contains(&self, at: Texel) -> bool {
        (self.min[0] <= at.x) & (at.x <= self.max[0]) & (self.min[1] <= at.y) & (at.y <= self.max[1])
    }

    /// The valid address nearest to `at`.
    pub fn nearest(&self, at: Texel) -> Texel {
        texel(at.x.clamp(self.min[0], self.max[0]), at.y.clamp(self.min[1], self.max[1]))
    }

    /// 0 on the border of the room, rising linearly to 1 at `band` of the room's extent from it.
    pub fn depth(&self, at: Texel, band: f64) -> f64 {
        let along = |p: f32, min: f32, max: f32| {
            let reach = band * (f64::from(max) - f64::from(min));
            let depth = f64::from((p - min).min(max - p));
            if depth >= reach { 1.0 } else { depth / reach }
        };
        along(at.x, self.min[0], self.max[0]).min(along(at.y, self.min[1], self.max[1]))
    }

    /// A random address in the room, between whole texels if the room has any such: draws 0 and 1 of the key.
    ///
    /// Jumps are whole texels, so all that follows from an address keeps its fraction of a texel. Where the surface is flat
    /// and baked texel by texel, none is blurred.
    pub fn random(&self, draws: Key) -> Texel {
        let along = |i: usize| {
            let (min, max) = (f64::from(self.min[i]), f64::from(self.max[i]));
            let at = min + draws.unit(i as u64) * (max - min);
            let whole = at.round().clamp(min.ceil(), max.floor().max(min.ceil()));
            (if whole <= max { whole } else { at } as f32).clamp(self.min[i], self.max[i])
        };
        texel(along(0), along(1))
    }
}

/// The least and greatest offset along each axis, zero included.
fn spans(offsets: &[Vec2]) -> (Vec2, Vec2) {
    let (mut low, mut high) = (Vec2::ZERO, Vec2::ZERO);
    for d in offsets {
        low = Vec2 { x: low.x.min(d.x), y: low.y.min(d.y) };
        high = Vec2 { x: high.x.max(d.x), y: high.y.max(d.y) };
    }
    (low, high)
}

/// The least f32 that is not below `v`.
fn at_least(v: f64) -> f32 {
    let r = v as f32;
    if f64::from(r) < v { r.next_up() } else { r }
}

/// The greatest f32 that is not above `v`.
fn at_most(v: f64) -> f32 {
    -at_least(-v)
}

/// The rooms of all vertices: of their edges, or of `boxes` (least and greatest offset) where more than that must fit.
///
/// Checks that there is one finite offset per half-edge and that every vertex has room; the error names the vertex
/// whose box is largest in relation to the exemplar, so that one change of scale heals the whole mesh.
pub(in crate::synth) fn rooms(
    topology: &Topology,
    offsets: &[Vec2],
    boxes: Option<&[[Vec2; 2]]>,
    size: [u32; 2],
) -> Result<Vec<Room>, Error> {
    if offsets.len() != topology.half_edge_count() {
        return Err(Error::OffsetCount { found: offsets.len(), expected: topology.half_edge_count() });
    }
    let vertices = topology.vertex_count();
    if let Some(found) = boxes.map(<[_]>::len).filter(|n| *n != vertices) {
        return Err(Error::Count { what: "boxes of vertices", found, expected: vertices });
    }
    let room = |v: u32| {
        let edges = topology.half_edges(v);
        let around = &offsets[edges.clone()];
        if let Some(i) = around.iter().position(|d| !(d.x.is_finite() && d.y.is_finite())) {
            return Err((f64::INFINITY, Error::Offset { from: v, to: topology.target(edges.start + i) }));
        }
        let extent = boxes.map_or(around, |b| &b[v as usize]);
        let room = Room::new(extent, size);
        if !room.is_empty() {
            return Ok(room);
        }
        let (low, high) = spans(extent);
        let span = [high.x - low.x, high.y - low.y];
        let excess = (0..2).map(|i| span[i] / f64::from(size[i].max(2) - 1)).fold(0.0, f64::max);
        Err((excess, Error::BoxTooLarge { vertex: v, span, exemplar: size }))
    };
    let chunks = par::map_chunks(vertices, 4096, |some| {
        let (mut rooms, mut worst) = (Vec::with_capacity(some.len()), None);
        for v in some {
            match room(v as u32) {
                Ok(room) => rooms.push(room),
                Err(e) => worst = Some(worse(worst, e)),
            }
        }
        worst.map_or(Ok(rooms), Err)
    });
    let worst = chunks.iter().filter_map(|c| c.as_ref().err().cloned()).fold(None, |w, e| Some(worse(w, e)));
    worst.map_or(Ok(()), |(_, e)| Err(e))?;
    Ok(chunks.into_iter().flatten().flatten().collect())
}

/// The greater excess, the first of equals.
fn worse(a: Option<(f64, Error)>, b: (f64, Error)) -> (f64, Error) {
    match a {
        Some(a) if a.0 >= b.0 => a,
        _ => b,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::vec::vec2;

    #[test]
    fn the_box_keeps_the_address_off_the_borders() {
        let room = Room::new(&[vec2(2.0, 0.0), vec2(-1.0, 3.0)], [10, 8]);
        assert_eq!(room, Room { min: [1.5, 0.5], max: [7.5, 4.5] });
        assert!(room.contains(texel(1.5, 4.5)));
        assert!(!room.contains(texel(1.49, 4.0)) && !room.contains(texel(2.0, 4.6)));
        assert!(!room.contains(texel(f32::NAN, 1.0)));
        assert_eq!(room.depth(texel(1.5, 2.0), 0.25), 0.0);
        assert_eq!(room.depth(texel(2.25, 2.5), 0.25), 0.5);
        assert_eq!(room.depth(texel(4.5, 2.5), 0.25), 1.0);
        assert_eq!(room.depth(texel(1.5, 0.5), 0.0), 1.0);
    }

    #[test]
    fn bounds_are_rounded_inwards() {
        for v in [0.1, 1.0 / 3.0, 100.7, -0.3, 2.5] {
            assert!(f64::from(at_least(v)) >= v && f64::from(at_most(v)) <= v);
            assert!(f64::from(at_least(v).next_down()) < v && f64::from(at_most(v).next_up()) > v);
        }
    }

    #[test]
    fn random_addresses_fill_the_room() {
        let room = Room::new(&[vec2(3.0, 1.0)], [5, 4]);
        for i in 0..100 {
            let at = room.random(Key::new(i));
            assert!(room.contains(at) && at.x == at.x.round() && at.y == at.y.round());
        }
        let point = Room::new(&[vec2(-2.0, -1.5), vec2(2.0, 1.5)], [5, 4]);
        assert_eq!(point.random(Key::new(1)), texel(2.5, 2.0));
    }
}
