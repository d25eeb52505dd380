//! The look of a field of directions: strokes along it, and a mark at each singular point.
//!
//! Source: line integral convolution (Cabral, Leedom 1993) of solid noise, along the straight line through the point in
//! its tangent plane, which over a stroke's length hardly leaves the streamline; one-way directions by a kernel that
//! thickens towards their head (oriented line integral convolution, Wegenkittl et al. 1997). Marks are red for positive
//! indices and blue for negative ones, a ring of white around both.
//! Unaware of: what the directions mean, where they come from.

use super::look::{Appearance, Hit, Look};
use crate::mesh::TriMesh;
use crate::numerics::rng::Key;
use crate::numerics::vec::Vec3;

type V3 = [f32; 3];

/// A cell of the noise, half a stroke and a mark's radius, as parts of the mesh's diagonal.
const CELL: f64 = 1.0 / 420.0;
const HALF_STROKE: f64 = 0.02;
const MARK: f64 = 0.011;
/// Samples along half a stroke.
const STEPS: i32 = 10;
/// Share of the noise's cells that are bright where strokes have a head: so that single ones can be seen.
const SPARSE: f64 = 0.15;

/// The look of a mesh with a direction at each vertex.
pub struct Strokes<'a> {
    mesh: &'a TriMesh,
    up: &'a [Vec3],
    /// Equivalent directions.
    ways: u32,
    /// Singular points and their indices.
    marks: &'a [(Vec3, f64)],
    diagonal: f64,
}

impl<'a> Strokes<'a> {
    /// `up` has a unit vector per vertex, one of `ways` (1, 2 or 4) that are equivalent.
    pub fn new(mesh: &'a TriMesh, up: &'a [Vec3], ways: u32, marks: &'a [(Vec3, f64)]) -> Self {
        let (low, high) = mesh.bounds();
        Strokes { mesh, up, ways, marks, diagonal: (high - low).length().max(f64::MIN_POSITIVE) }
    }

    /// The direction at a point: the corners' vectors, turned to match the nearest corner's, and interpolated.
    fn direction(&self, face: usize, bary: V3) -> Vec3 {
        let corners = self.mesh.faces[face].map(|v| self.up[v as usize]);
        let nearest = (1..3).fold(0, |best, i| if bary[i] > bary[best] { i } else { best });
        let normal = self.mesh.area_vector(face).normalized().unwrap_or(corners[0].any_perpendicular());
        let to = corners[nearest];
        let matched = |mut u: Vec3| {
            let mut best = u;
            for _ in 1..self.ways {
                u = if self.ways == 2 { -u } else { normal.cross(u) };
                if u.dot(to) > best.dot(to) {
                    best = u;
                }
            }
            best
        };
        let sum = (0..3).fold(Vec3::ZERO, |s, i| s + matched(corners[i]) * f64::from(bary[i]));
        sum.reject(normal).normalized().unwrap_or(to)
    }

    /// Noise along a line, 0..1 of even spread.
    fn stroke(&self, at: Vec3, along: Vec3) -> f64 {
        let (mut sum, mut weights) = (0.0, 0.0);
        for i in -STEPS..=STEPS {
            let t = f64::from(i) / f64::from(STEPS);
            // What lies ahead of a point is the tail of its stroke.
            let weight = if self.ways == 1 { 0.5 - 0.5 * t } else { 1.0 - 0.5 * t.abs() };
            let p = (at + along * (t * HALF_STROKE * self.diagonal)) / (CELL * self.diagonal);
            let cell = [p.x, p.y, p.z].map(|c| c.floor() as i64 as u64);
            let value = Key::new(7).with(cell[0]).with(cell[1]).unit(cell[2]);
            let value = if self.ways == 1 { f64::from(u8::from(value < SPARSE)) } else { value };
            sum += weight * value;
            weights += weight;
        }
        let mean = sum / weights;
        if self.ways == 1 { mean * 2.2 } else { (mean - 0.5) * 2.4 + 0.5 }
    }
}

impl Look for Strokes<'_> {
    fn appearance(&self, hit: &Hit) -> Appearance {
        let corners = self.mesh.corners(hit.face);
        let at = (0..3).fold(Vec3::ZERO, |s, i| s + corners[i] * f64::from(hit.bary[i]));
        let plain = Appearance { normal: hit.normal, ..Appearance::default() };
        for &(point, index) in self.marks {
            let away = (at - point).length() / (MARK * self.diagonal);
            if away < 1.3 {
                let tint = if index > 0.0 { [0.75, 0.05, 0.02] } else { [0.02, 0.1, 0.8] };
                return Appearance { color: if away < 1.0 { tint } else { [1.0; 3] }, ..plain };
            }
        }
        let up = self.direction(hit.face, hit.bary);
        let mut value = self.stroke(at, up);
        if self.ways == 4 {
            let normal = self.mesh.area_vector(hit.face).normalized().unwrap_or(up.any_perpendicular());
            value = value.max(self.stroke(at, normal.cross(up)));
        }
        let v = value.clamp(0.0, 1.0) as f32;
        Appearance { color: [0.06 + 0.74 * v, 0.08 + 0.66 * v, 0.12 + 0.5 * v], ..plain }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::zoo;
    use crate::numerics::vec::vec3;

    fn color(look: &Strokes<'_>, x: f64, y: f64) -> V3 {
        // On the plane of the zoo, face 2 (y w + x) holds the lower right half of a square.
        let (i, j) = (x.floor() as usize, y.floor() as usize);
        let (s, t) = (x - x.floor(), y - y.floor());
        assert!(t <= s);
        let bary = [1.0 - s, s - t, t].map(|b| b as f32);
        let hit = Hit { face: 2 * (j * 8 + i), bary, grad: [[0.0; 2]; 2], normal: [0.0, 0.0, 1.0], front: true };
        look.appearance(&hit).color
    }

    #[test]
    fn strokes_run_along_the_field_and_marks_cover_them() {
        let m = zoo::plane(8, 8);
        let up = vec![vec3(0.0, 1.0, 0.0); m.positions.len()];
        let marks = [(vec3(2.5, 2.5, 0.0), 1.0), (vec3(6.5, 2.2, 0.0), -0.5)];
        for ways in [1, 2] {
            let look = Strokes::new(&m, &up, ways, &marks);
            let change = |dx: f64, dy: f64| -> f32 {
                let at = |i: usize| (3.2 + 0.7 * (i as f64 / 99.0), 0.02 * (i % 7) as f64);
                (0..100).map(at).map(|(x, y)| (color(&look, x, y)[0] - color(&look, x + dx, y + dy)[0]).abs()).sum()
            };
            assert!(change(0.03, 0.0) > 2.0 * change(0.0, 0.03), "{ways}: smooth along, rough across");
            assert_eq!(color(&look, 2.5, 2.5), [0.75, 0.05, 0.02]);
            assert_eq!(color(&look, 6.5, 2.2), [0.02, 0.1, 0.8]);
        }
    }

    #[test]
    fn equivalent_directions_look_alike() {
        let m = zoo::plane(8, 8);
        let quarters = [vec3(0., 1., 0.), vec3(-1., 0., 0.), vec3(0., -1., 0.), vec3(1., 0., 0.)];
        let one: Vec<Vec3> = m.positions.iter().map(|_| quarters[0]).collect();
        let mixed: Vec<Vec3> = (0..m.positions.len()).map(|v| quarters[v * 3 % 4]).collect();
        let (a, b) = (Strokes::new(&m, &one, 4, &[]), Strokes::new(&m, &mixed, 4, &[]));
        for i in 0..40 {
            let (x, y) = (0.1 + 0.19 * f64::from(i), 3.02);
            let (s, t) = (x - x.floor(), 0.02);
            if t <= s {
                let (p, q) = (color(&a, x, y), color(&b, x, y));
                assert!((0..3).all(|k| (p[k] - q[k]).abs() < 1e-6), "{p:?} {q:?}");
            }
        }
    }
}
