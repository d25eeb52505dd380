//! Edge offsets: what walking along an edge of the mesh means in the exemplar.
//!
//! Source: `[ZG03]` section 4.2.2 and figure 4, boxes 4.2.4. "We then average the vertex u vectors, and retain the
//! portion of the average v vectors perpendicular to the average u vector ... The edge is then projected into this
//! plane, and finally scaled". Read as: u and v of the edge are normalised after averaging; v is u x n, which is
//! "right" seen from outside; the scale of the edge is the mean of its ends'. The projected length is kept as the paper
//! has it, though it is shorter than the edge where the surface bends away from the plane: stretching it back would
//! push a bent 1-ring out of shape. Rows of a texture go down, so "up" is -y.
//!
//! Where directions oppose (at a singularity the averages may vanish) the end of the lower index gives the basis alone.
//! Unaware of: the exemplar's size and content.

use super::{Field, Symmetry};
use crate::mesh::{Topology, TriMesh};
use crate::numerics::par;
use crate::numerics::vec::{Vec2, Vec3, vec2};

/// Sums of unit vectors shorter than this say nothing of their direction.
const LEAST_SUM: f64 = 1e-3;

/// The offset of each half-edge in texels: x right, y down, from its vertex to its target.
///
/// For [`Symmetry::One`] the offset of the opposite half-edge is the exact negative. For symmetry two and four the
/// basis of the farther end is first turned to match the nearer one's best, so an offset is in the frame of its
/// half-edge's vertex, and the opposite one is the negative, turned. All finite, if positions are.
pub fn edge_offsets(mesh: &TriMesh, topo: &Topology, normals: &[Vec3], field: &Field, symmetry: Symmetry) -> Vec<Vec2> {
    let bases = par::map(normals.len(), |v| Basis { u: field.up[v], v: field.up[v].cross(normals[v]) });
    // In the frame of `a`; always asked with a < b.
    let from_lower = |a: usize, b: usize| {
        let (basis, _) = bases[b].turned_to(&bases[a], symmetry);
        let edge = mesh.positions[b] - mesh.positions[a];
        let scale = (f64::from(field.scale[a]) + f64::from(field.scale[b])) * 0.5;
        let plane = bases[a].mean(&basis, normals[a], normals[b]);
        vec2(edge.dot(plane.v) * scale, -(edge.dot(plane.u) * scale))
    };
    let vertices = topo.vertex_count();
    let start = |v: usize| if v < vertices { topo.half_edges(v as u32).start } else { topo.half_edge_count() };
    let mut offsets = vec![Vec2::ZERO; topo.half_edge_count()];
    par::fill_rows(&mut offsets, vertices, 1024, start, |some, part| {
        let first = start(some.start);
        for v in some {
            for h in topo.half_edges(v as u32) {
                let n = topo.target(h) as usize;
                if v < n {
                    part[h - first] = from_lower(v, n);
                }
            }
        }
    });
    // Neighbours ascend within a row, so what leads back from a vertex to lower ones comes in the order met here.
    let mut back: Vec<usize> = (0..vertices).map(start).collect();
    for v in 0..vertices {
        for h in topo.half_edges(v as u32) {
            let n = topo.target(h) as usize;
            if v < n {
                // Their basis, turned by so much, was ours: turn what was seen here back into theirs.
                let (_, quarters) = bases[n].turned_to(&bases[v], symmetry);
                offsets[back[n]] = (0..quarters).fold(-offsets[h], |o, _| quarter_from_turned(o));
                back[n] += 1;
            }
        }
    }
    offsets
}

/// The box (least, greatest corner) of the offsets of a vertex's half-edges and of 0, per vertex: an address is valid
/// if the box around it lies in the exemplar. Source: `[ZG03]` 4.2.4.
pub fn validity_boxes(topo: &Topology, offsets: &[Vec2]) -> Vec<[Vec2; 2]> {
    par::map(topo.vertex_count(), |v| {
        offsets[topo.half_edges(v as u32)].iter().fold([Vec2::ZERO; 2], |[low, high], o| {
            [vec2(low.x.min(o.x), low.y.min(o.y)), vec2(high.x.max(o.x), high.y.max(o.y))]
        })
    })
}

/// Up and right in a tangent plane.
#[derive(Clone, Copy)]
struct Basis {
    u: Vec3,
    v: Vec3,
}

impl Basis {
    /// This basis turned by the number of quarter turns, among those the symmetry allows, that brings it nearest to
    /// `to`.
    fn turned_to(self, to: &Basis, symmetry: Symmetry) -> (Basis, u32) {
        let step = 4 / symmetry.directions();
        let nearness = |b: &Basis| b.u.dot(to.u) + b.v.dot(to.v);
        let (mut best, mut next) = ((self, 0), self);
        for k in 1..symmetry.directions() {
            for _ in 0..step {
                // Counter-clockwise seen from outside: up becomes left, right becomes up.
                next = Basis { u: -next.v, v: next.u };
            }
            if nearness(&next) > nearness(&best.0) {
                best = (next, k * step);
            }
        }
        best
    }

    /// The edge's basis: normalised mean up, and what of the mean right is perpendicular to it.
    fn mean(&self, other: &Basis, normal: Vec3, other_normal: Vec3) -> Basis {
        let unit = |v: Vec3| v.normalized().filter(|_| v.length() > LEAST_SUM);
        let u = unit(self.u + other.u).unwrap_or(self.u);
        let v = unit((self.v + other.v).reject(u));
        // Right vectors that cancel: right of the mean up in the mean plane, or in the first end's.
        let v = v.or_else(|| unit(u.cross(normal + other_normal))).or_else(|| unit(u.cross(normal)));
        Basis { u, v: v.unwrap_or(u.any_perpendicular()) }
    }
}

/// An offset seen from a basis turned by a quarter (counter-clockwise), as seen from the basis itself.
fn quarter_from_turned(o: Vec2) -> Vec2 {
    // Turned up is left and turned right is up: x steps right are x up, which is -y; y steps down are y right.
    vec2(o.y, -o.x)
}

#[cfg(test)]
mod tests {
    use super::super::orientation;
    use super::*;
    use crate::mesh::zoo;
    use crate::numerics::vec::vec3;

    fn constant(m: &TriMesh, up: Vec3, scale: f32) -> Field {
        Field { up: vec![up; m.positions.len()], scale: vec![scale; m.positions.len()] }
    }

    fn default(m: &TriMesh, symmetry: Symmetry) -> (Topology, Vec<Vec3>, Field) {
        let (topo, normals) = (Topology::new(m), m.vertex_normals());
        let up = orientation(m, &topo, &normals, &[], &[], &[], symmetry).unwrap();
        let scale = (0..up.len()).map(|v| 10.0 + (v % 3) as f32).collect();
        (topo, normals, Field { up, scale })
    }

    #[test]
    fn a_plane_with_one_direction_maps_linearly() {
        let m = zoo::plane(5, 4);
        let (topo, normals) = (Topology::new(&m), m.vertex_normals());
        let offsets = edge_offsets(&m, &topo, &normals, &constant(&m, vec3(0., 1., 0.), 8.0), Symmetry::One);
        for v in 0..topo.vertex_count() as u32 {
            for h in topo.half_edges(v) {
                let e = m.positions[topo.target(h) as usize] - m.positions[v as usize];
                assert_eq!(offsets[h], vec2(8.0 * e.x, -8.0 * e.y), "right is right, up is up");
            }
        }
        let boxes = validity_boxes(&topo, &offsets);
        assert_eq!(boxes[0], [vec2(0., -8.), vec2(8., 0.)], "a corner reaches right and up");
        assert_eq!(boxes[7], [vec2(-8., -8.), vec2(8., 8.)]);
        let tilted = vec3(-0.6, 0.8, 0.);
        let offsets = edge_offsets(&m, &topo, &normals, &constant(&m, tilted, 5.0), Symmetry::One);
        for f in &m.faces {
            let o = |i: usize, j: usize| offsets[topo.find(f[i], f[j]).unwrap()];
            let (around, e) = (o(0, 1) + o(1, 2) + o(2, 0), m.positions[f[1] as usize] - m.positions[f[0] as usize]);
            assert!(around.length() < 1e-12);
            let want = vec2(e.dot(vec3(0.8, 0.6, 0.)), -e.dot(tilted)) * 5.0;
            assert!((o(0, 1) - want).length() < 1e-12);
        }
    }

    #[test]
    fn opposite_half_edges_are_opposite() {
        for (name, m) in zoo::all() {
            for symmetry in [Symmetry::One, Symmetry::Two, Symmetry::Four, Symmetry::Isotropic] {
                let (topo, normals, field) = default(&m, symmetry);
                let offsets = edge_offsets(&m, &topo, &normals, &field, symmetry);
                for v in 0..topo.vertex_count() as u32 {
                    for h in topo.half_edges(v) {
                        let t = topo.target(h);
                        let back = offsets[topo.find(t, v).unwrap()];
                        let o = offsets[h];
                        assert!(o.x.is_finite() && o.y.is_finite(), "{name}");
                        let edge = (m.positions[t as usize] - m.positions[v as usize]).length();
                        assert!(o.length() <= edge * 12.0 * (1.0 + 1e-9), "{name}: a projection shortens");
                        let negative = [-back, vec2(back.y, -back.x), back, vec2(-back.y, back.x)];
                        let allowed = 4 / symmetry.directions() as usize;
                        assert!(
                            negative.iter().step_by(allowed).any(|n| *n == o),
                            "{name} {symmetry:?}: {o:?} {back:?}"
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn equivalent_directions_give_the_offsets_of_the_first_end() {
        let m = zoo::plane(3, 3);
        let (topo, normals) = (Topology::new(&m), m.vertex_normals());
        let up = [vec3(0., 1., 0.), vec3(-1., 0., 0.), vec3(0., -1., 0.), vec3(1., 0., 0.)];
        let turned: Vec<Vec3> = (0..16).map(|v| up[v * 7 % 4]).collect();
        let field = Field { up: turned, scale: vec![2.0; 16] };
        let offsets = edge_offsets(&m, &topo, &normals, &field, Symmetry::Four);
        for v in 0..16u32 {
            for h in topo.half_edges(v) {
                let e = m.positions[topo.target(h) as usize] - m.positions[v as usize];
                let u = field.up[v as usize];
                assert_eq!(offsets[h], vec2(e.dot(u.cross(normals[v as usize])), -e.dot(u)) * 2.0);
            }
        }
    }

    #[test]
    fn opposed_ends_fall_back_to_the_lower() {
        let m = zoo::plane(1, 1);
        let (topo, normals) = (Topology::new(&m), m.vertex_normals());
        let (up, down) = (vec3(0., 1., 0.), vec3(0., -1., 0.));
        let field = Field { up: vec![up, down, up, up], scale: vec![1.0; 4] };
        let offsets = edge_offsets(&m, &topo, &normals, &field, Symmetry::One);
        assert_eq!(offsets[topo.find(0, 1).unwrap()], vec2(1., 0.));
        assert_eq!(offsets[topo.find(1, 0).unwrap()], vec2(-1., 0.));
        assert_eq!(offsets[topo.find(1, 3).unwrap()], vec2(0., 1.), "1 has the lower index: its up is down");
    }

    #[test]
    fn triangles_nearly_close_on_real_meshes_and_time_is_moderate() {
        use std::time::Instant;
        for name in ["stanford-bunny", "beetle", "cow", "spot", "cheburashka", "teapot", "non-manifold-wrap"] {
            let Some(m) = zoo::obj(&format!("{name}.obj")) else { return };
            let start = Instant::now();
            let params = crate::mesh::PrepareParams::new(1e-3, [256, 256]);
            let m = crate::mesh::prepare(&zoo::surface(m), &params).unwrap().mesh;
            let prepared = start.elapsed();
            let (topo, normals) = (Topology::new(&m), m.vertex_normals());
            let start = Instant::now();
            let up = orientation(&m, &topo, &normals, &[], &[], &[], Symmetry::One).unwrap();
            let oriented = start.elapsed();
            let good = |(u, n): (&Vec3, &Vec3)| (u.length() - 1.0).abs() < 1e-12 && u.dot(*n).abs() < 1e-12;
            assert!(up.iter().zip(&normals).all(good), "{name}");
            let start = Instant::now();
            let field = Field { scale: vec![100.0; up.len()], up };
            let offsets = edge_offsets(&m, &topo, &normals, &field, Symmetry::One);
            let offset = start.elapsed();
            assert!(offsets.iter().all(|o| o.x.is_finite() && o.y.is_finite()), "{name}");
            let gap = |f: &[u32; 3]| {
                let o = |i: usize, j: usize| offsets[topo.find(f[i], f[j]).unwrap()];
                let longest = o(0, 1).length().max(o(1, 2).length()).max(o(2, 0).length());
                (o(0, 1) + o(1, 2) + o(2, 0)).length() / longest.max(1e-9)
            };
            let mut gaps: Vec<f64> = m.faces.iter().map(gap).collect();
            gaps.sort_unstable_by(f64::total_cmp);
            let (median, most) = (gaps[gaps.len() / 2], gaps[gaps.len() * 95 / 100]);
            let singular = super::super::singularities(&m, &topo, &normals, &field.up, Symmetry::One).len();
            println!(
                "{name}: {} vertices; prepared in {prepared:?}, oriented in {oriented:?}, offsets in {offset:?}; gaps: \
                 median {median:.4}, 95% {most:.3}; {singular} singular faces",
                m.positions.len()
            );
            assert!(median < 0.1, "{name}: {median}");
        }
    }
}
