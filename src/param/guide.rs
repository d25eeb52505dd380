//! What the coordinates are wanted to do: their gradients on each triangle, and their change along each edge.
//!
//! Source: `[MST09]` 2.3, Eq. 1 and 3. In: a mesh and a field. Out: per face two gradients in periods per world unit, per
//! half-edge the wanted change of (s, t) in periods.
//! Reads as: Eq. 1 is printed with s_i on both sides, the left one is s_j. S^T is the size of a period, so the mean of
//! its corners' sizes is the harmonic mean of their scales. The direction of a triangle is the mean of its corners',
//! laid into its plane; d_s is the sample's right, and t grows down, against the field's up. At the boundary Eq. 3's
//! mean is that of the one triangle there is; of three and more at an edge it is that of all.
//! Of a sample that looks the same after half or quarter turns, every vertex has coordinates in its own frame, and
//! what is carried to a neighbour is turned by the quarters that bring the frames nearest to each other.
//! Unaware of: the coordinates that come of it.

use crate::field::{Field, Symmetry, cotangent_weights};
use crate::mesh::{Topology, TriMesh};
use crate::numerics::par;
use crate::numerics::vec::{Vec2, Vec3, vec2};

/// Coordinates (right, down) in a frame that was turned by so many quarters counter-clockwise, as seen from the frame
/// itself.
pub(super) fn from_turned(c: Vec2, quarters: u8) -> Vec2 {
    match quarters % 4 {
        0 => c,
        // Turned up is left and turned right is up.
        1 => vec2(c.y, -c.x),
        2 => vec2(-c.x, -c.y),
        _ => vec2(-c.y, c.x),
    }
}

/// Mesh, field and size of the tile.
#[derive(Clone, Copy)]
pub(super) struct Wanted<'a> {
    pub mesh: &'a TriMesh,
    pub topo: &'a Topology,
    pub normals: &'a [Vec3],
    pub field: &'a Field,
    pub symmetry: Symmetry,
    /// Texels in a period of s and of t.
    pub tile: [u32; 2],
}

/// The wanted change along edges, per half-edge.
#[derive(Clone, Debug)]
pub(super) struct Guide {
    /// Change of (s, t) in periods from its vertex to its target, in the vertex's frame.
    pub steps: Vec<Vec2>,
    /// Quarter turns counter-clockwise that bring the target's frame nearest to the vertex's.
    pub quarters: Vec<u8>,
    /// Cotangent weight of the edge, positive.
    pub weights: Vec<f64>,
}

impl Guide {
    /// Coordinates in the frame of a half-edge's target, seen from that of its vertex.
    pub fn seen(&self, half_edge: usize, c: Vec2) -> Vec2 {
        // Theirs is ours, turned by as much the other way round.
        from_turned(c, 4 - self.quarters[half_edge])
    }
}

impl Wanted<'_> {
    /// Quarter turns that bring the frame of `j` nearest to that of `i`, among those that the symmetry allows.
    pub fn quarters(&self, i: u32, j: u32) -> u8 {
        if self.symmetry.directions() == 1 {
            return 0;
        }
        let (low, high) = (i.min(j) as usize, i.max(j) as usize);
        let step = 4 / self.symmetry.directions() as u8;
        let (to, to_right) = (self.field.up[low], self.field.up[low].cross(self.normals[low]));
        let nearness = |quarters: u8| {
            let up = self.up(high, quarters);
            up.dot(to) + up.cross(self.normals[high]).dot(to_right)
        };
        let (mut best, mut most) = (0, nearness(0));
        for quarters in (1..self.symmetry.directions() as u8).map(|k| k * step) {
            let near = nearness(quarters);
            if near > most {
                (best, most) = (quarters, near);
            }
        }
        if i < j { best } else { (4 - best) % 4 }
    }

    /// Up of a vertex, turned counter-clockwise.
    fn up(&self, v: usize, quarters: u8) -> Vec3 {
        let up = self.field.up[v];
        match quarters {
            0 => up,
            1 => self.normals[v].cross(up),
            2 => -up,
            _ => up.cross(self.normals[v]),
        }
    }

    /// Wanted gradients of s and t on a face in periods per world unit, in the frame of its corner `i`.
    pub fn gradients(&self, face: usize, i: u32) -> [Vec3; 2] {
        let corners = self.mesh.faces[face];
        let own = self.normals[i as usize];
        let n = self.mesh.area_vector(face).normalized().unwrap_or(own);
        let (mut sum, mut size) = (Vec3::ZERO, 0.0);
        for c in corners {
            let up = self.up(c as usize, self.quarters(i, c)).reject(n);
            sum += up.normalized().unwrap_or(Vec3::ZERO);
            size += 1.0 / f64::from(self.field.scale[c as usize]);
        }
        let up = sum.normalized().or_else(|| self.field.up[i as usize].reject(n).normalized());
        let up = up.unwrap_or(n.any_perpendicular());
        let scale = 3.0 / size;
        let [w, h] = self.tile.map(f64::from);
        [up.cross(n) * (scale / w), up * (-scale / h)]
    }

    /// The wanted change along every edge.
    pub fn guide(&self) -> Guide {
        let (mesh, topo) = (self.mesh, self.topo);
        let weights = cotangent_weights(mesh, topo);
        // From the lower end, in its frame.
        let of = |v: u32, n: u32| {
            let edge = mesh.positions[n as usize] - mesh.positions[v as usize];
            let (mut step, mut faces) = (Vec2::ZERO, 0.0);
            for &f in topo.faces(v).iter().filter(|&&f| mesh.faces[f as usize].contains(&n)) {
                let [s, t] = self.gradients(f as usize, v);
                step += vec2(edge.dot(s), edge.dot(t));
                faces += 1.0;
            }
            (step / f64::max(faces, 1.0), self.quarters(v, n))
        };
        let starts = |r: std::ops::Range<usize>| {
            r.flat_map(|v| topo.neighbours(v as u32).iter().map(move |&n| (v as u32, n)))
                .map(|(v, n)| if v < n { of(v, n) } else { (Vec2::ZERO, 0) })
                .collect::<Vec<_>>()
        };
        let rows: Vec<_> = par::map_chunks(topo.vertex_count(), 1024, starts).into_iter().flatten().collect();
        let mut guide =
            Guide { steps: rows.iter().map(|r| r.0).collect(), quarters: rows.iter().map(|r| r.1).collect(), weights };
        for v in 0..topo.vertex_count() as u32 {
            for h in topo.half_edges(v).filter(|&h| topo.target(h) < v) {
                let Some(back) = topo.find(topo.target(h), v) else { continue };
                guide.quarters[h] = (4 - guide.quarters[back]) % 4;
                guide.steps[h] = guide.seen(h, -guide.steps[back]);
            }
        }
        guide
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::zoo;
    use crate::numerics::vec::vec3;

    #[test]
    fn a_constant_field_on_a_plane_steps_by_the_edges() {
        let mesh = zoo::plane(5, 4);
        let (topo, normals) = (Topology::new(&mesh), mesh.vertex_normals());
        let n = mesh.positions.len();
        // Every vertex in a frame of its own: quarter turns of one.
        let ups = [vec3(0., 1., 0.), vec3(-1., 0., 0.), vec3(0., -1., 0.), vec3(1., 0., 0.)];
        for symmetry in [Symmetry::One, Symmetry::Two, Symmetry::Four] {
            let turn = |v: usize| v * 7 % 5 * (4 / symmetry.directions() as usize) % 4;
            let field = Field { up: (0..n).map(|v| ups[turn(v)]).collect(), scale: vec![16.0; n] };
            let wanted =
                Wanted { mesh: &mesh, topo: &topo, normals: &normals, field: &field, symmetry, tile: [64, 64] };
            let guide = wanted.guide();
            for v in 0..n {
                for h in topo.half_edges(v as u32) {
                    let e = mesh.positions[topo.target(h) as usize] - mesh.positions[v];
                    // What the turned frame sees, seen from the frame of the world.
                    let seen = from_turned(guide.steps[h], turn(v) as u8);
                    assert!((seen - vec2(e.x, -e.y) * 0.25).length() < 1e-12, "right is right, down is down");
                    let other = turn(topo.target(h) as usize) as u8 + guide.quarters[h];
                    assert_eq!(other % 4, turn(v) as u8);
                }
            }
        }
    }

    #[test]
    fn frames_turn_there_and_back() {
        let c = vec2(2.0, 3.0);
        for q in 0..4 {
            assert_eq!(from_turned(from_turned(c, q), 4 - q), c);
        }
    }
}
