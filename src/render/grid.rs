//! The look of periodic coordinates: lines where s and t are whole, and what is not valid.
//!
//! Faces that are shown by three look-ups are tinted; their own lines may break there. Marks are red where the field is
//! singular (poles) and blue where lines end (T-junctions), a ring of white around both.
//! Unaware of: how the coordinates came about, what is in the tile.

use super::look::{Appearance, Hit, Look};
use crate::mesh::TriMesh;
use crate::numerics::vec::{Vec2, Vec3};
use crate::texture::{Texel, texel};

type V3 = [f32; 3];

/// Half a line as a part of the period, and a mark's radius as a part of the mesh's diagonal.
const LINE: f64 = 0.035;
const MARK: f64 = 0.006;

/// The look of a mesh with coordinates at the corners of its faces.
pub struct Grid<'a> {
    mesh: &'a TriMesh,
    corners: &'a [[Vec2; 3]],
    blended: &'a [bool],
    marks: &'a [(Vec3, f64)],
    diagonal: f64,
}

impl<'a> Grid<'a> {
    /// `corners` in periods; `blended` per face; `marks`: points, red if the number is positive.
    pub fn new(mesh: &'a TriMesh, corners: &'a [[Vec2; 3]], blended: &'a [bool], marks: &'a [(Vec3, f64)]) -> Self {
        let (low, high) = mesh.bounds();
        Grid { mesh, corners, blended, marks, diagonal: (high - low).length().max(f64::MIN_POSITIVE) }
    }

    fn at(&self, face: usize, bary: V3) -> Vec2 {
        (0..3).fold(Vec2::ZERO, |sum, i| sum + self.corners[face][i] * f64::from(bary[i]))
    }
}

impl Look for Grid<'_> {
    fn appearance(&self, hit: &Hit) -> Appearance {
        let plain = Appearance { normal: hit.normal, ..Appearance::default() };
        let corners = self.mesh.corners(hit.face);
        let point = (0..3).fold(Vec3::ZERO, |s, i| s + corners[i] * f64::from(hit.bary[i]));
        for &(mark, sign) in self.marks {
            let away = (point - mark).length() / (MARK * self.diagonal);
            if away < 1.3 {
                let tint = if sign > 0.0 { [0.75, 0.05, 0.02] } else { [0.02, 0.1, 0.8] };
                return Appearance { color: if away < 1.0 { tint } else { [1.0; 3] }, ..plain };
            }
        }
        let at = self.at(hit.face, hit.bary);
        let on_line = |x: f64| (x - x.round()).abs() < LINE;
        let ground = if self.blended[hit.face] { [0.85, 0.55, 0.2] } else { [0.55, 0.55, 0.5] };
        let color = match (on_line(at.x), on_line(at.y)) {
            (true, _) => [0.03, 0.12, 0.25],
            (_, true) => [0.25, 0.06, 0.03],
            _ => ground,
        };
        Appearance { color, ..plain }
    }

    fn source(&self, face: usize, bary: V3) -> Option<[f32; 2]> {
        let at = self.at(face, bary);
        Some([at.x - at.x.floor(), at.y - at.y.floor()].map(|x| x as f32))
    }

    fn checker(&self, face: usize, bary: V3) -> (Texel, f32) {
        let at = self.at(face, bary);
        (texel(at.x as f32, at.y as f32), 0.25)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::zoo;
    use crate::numerics::vec::{vec2, vec3};

    #[test]
    fn lines_lie_at_whole_periods_and_marks_cover_them() {
        let m = zoo::plane(2, 1);
        let corners: Vec<[Vec2; 3]> = (0..4).map(|f| m.corners(f).map(|p| vec2(p.x, p.y + 0.5))).collect();
        let marks = [(vec3(1.6, 0.2, 0.0), 1.0)];
        let grid = Grid::new(&m, &corners, &[false, true, false, false], &marks);
        let color = |face: usize, bary: V3| {
            grid.appearance(&Hit { face, bary, grad: [[0.0; 2]; 2], normal: [0.0, 0.0, 1.0], front: true }).color
        };
        assert_eq!(color(0, [1.0, 0.0, 0.0]), [0.03, 0.12, 0.25], "s = 0");
        assert_eq!(color(0, [0.5, 0.0, 0.5]), [0.25, 0.06, 0.03], "t = 1");
        assert_eq!(color(0, [0.5, 0.5, 0.0]), [0.55, 0.55, 0.5]);
        assert_eq!(color(1, [0.2, 0.4, 0.4]), [0.85, 0.55, 0.2], "blended");
        // Face 2 is (1, 0), (2, 0), (2, 1).
        assert_eq!(color(2, [0.4, 0.4, 0.2]), [0.75, 0.05, 0.02]);
    }
}
