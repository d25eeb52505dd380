//! The point of a mesh nearest to another point.
//!
//! A uniform grid over the faces' bounding boxes, searched outwards from the point's cell. Apt for meshes whose faces are
//! of like size, as synthesis meshes are.
//! Unaware of: what lies on the mesh.

use super::TriMesh;
use crate::numerics::vec::Vec3;

/// Most cells along an axis.
const MOST_CELLS: f64 = 1024.0;

/// A point of a mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// The face it lies in.
    pub face: u32,
    /// Barycentric coordinates there, each 0..=1, their sum 1.
    pub bary: [f64; 3],
    /// Distance from the point that was asked for.
    pub distance: f64,
}

/// Finds nearest points of one mesh.
pub struct NearestPoint<'a> {
    mesh: &'a TriMesh,
    low: Vec3,
    cell: f64,
    cells: [i64; 3],
    /// (cell, face), sorted.
    entries: Vec<(u64, u32)>,
}

impl<'a> NearestPoint<'a> {
    /// Sorts the faces into cells of about the mean length of an edge.
    pub fn new(mesh: &'a TriMesh) -> Self {
        let (low, high) = mesh.bounds();
        let edges = (0..mesh.faces.len())
            .map(|f| mesh.corners(f))
            .map(|[a, b, c]| ((b - a).length() + (c - b).length() + (a - c).length()) / 3.0);
        let mean = edges.sum::<f64>() / mesh.faces.len().max(1) as f64;
        let extent = high - low;
        let longest = extent.x.max(extent.y).max(extent.z);
        let cell = mean.max(longest / MOST_CELLS).max(f64::MIN_POSITIVE);
        let cells = [0, 1, 2].map(|i| (extent[i] / cell) as i64 + 1);
        let mut grid = NearestPoint { mesh, low, cell, cells, entries: vec![] };
        for f in 0..mesh.faces.len() {
            let [a, b, c] = mesh.corners(f);
            let from = grid.cell_of([0, 1, 2].map(|i| a[i].min(b[i]).min(c[i])));
            let to = grid.cell_of([0, 1, 2].map(|i| a[i].max(b[i]).max(c[i])));
            for (z, y) in (from[2]..=to[2]).flat_map(|z| (from[1]..=to[1]).map(move |y| (z, y))) {
                for x in from[0]..=to[0] {
                    let key = grid.key([x, y, z]);
                    grid.entries.push((key, f as u32));
                }
            }
        }
        grid.entries.sort_unstable();
        grid
    }

    fn cell_of(&self, p: [f64; 3]) -> [i64; 3] {
        [0, 1, 2].map(|i| (((p[i] - self.low[i]) / self.cell) as i64).clamp(0, self.cells[i] - 1))
    }

    fn key(&self, [x, y, z]: [i64; 3]) -> u64 {
        ((z * self.cells[1] + y) * self.cells[0] + x) as u64
    }

    /// The point nearest to `p`, the lowest face's of equals; of faces that look the way of `normal` if one of those is
    /// hardly further (two sides of a sheet are near each other). `None` for a mesh without faces.
    pub fn find(&self, p: Vec3, normal: Vec3) -> Option<SurfacePoint> {
        let any = self.search(p, |_| true, f64::INFINITY)?;
        let facing = |f: usize| self.mesh.area_vector(f).dot(normal) > 0.0;
        if facing(any.face as usize) {
            return Some(any);
        }
        self.search(p, facing, any.distance + 2.0 * self.cell).or(Some(any))
    }

    fn search(&self, p: Vec3, wanted: impl Fn(usize) -> bool, limit: f64) -> Option<SurfacePoint> {
        let middle = self.cell_of([p.x, p.y, p.z]);
        let mut best: Option<SurfacePoint> = None;
        let furthest = self.cells.into_iter().max().unwrap_or(1);
        // A point outside the box is no nearer to a ring of cells than its foot on the box.
        for ring in 0..=furthest {
            let beyond = (ring - 1) as f64 * self.cell;
            if best.is_some_and(|b| b.distance <= beyond) || beyond > limit {
                break;
            }
            self.visit_ring(middle, ring, |f| {
                if wanted(f) {
                    let (bary, foot) = closest(p, self.mesh.corners(f));
                    let (face, distance) = (f as u32, (foot - p).length());
                    let better = |b: SurfacePoint| distance < b.distance || (distance == b.distance && face < b.face);
                    if distance <= limit && best.is_none_or(better) {
                        best = Some(SurfacePoint { face, bary, distance });
                    }
                }
            });
        }
        best
    }

    /// Calls `f` for all faces in the cells that are `ring` away.
    fn visit_ring(&self, middle: [i64; 3], ring: i64, mut f: impl FnMut(usize)) {
        let range = |i: usize| (middle[i] - ring).max(0)..=(middle[i] + ring).min(self.cells[i] - 1);
        for z in range(2) {
            for y in range(1) {
                let rim = (z - middle[2]).abs() == ring || (y - middle[1]).abs() == ring;
                let step = if rim { 1 } else { (2 * ring).max(1) };
                let mut x = middle[0] - ring;
                while x <= middle[0] + ring {
                    if (0..self.cells[0]).contains(&x) {
                        let key = self.key([x, y, z]);
                        let start = self.entries.partition_point(|e| e.0 < key);
                        self.entries[start..].iter().take_while(|e| e.0 == key).for_each(|e| f(e.1 as usize));
                    }
                    x += step;
                }
            }
        }
    }
}

/// The point of a triangle nearest to `p`: its barycentric coordinates and where it is.
fn closest(p: Vec3, [a, b, c]: [Vec3; 3]) -> ([f64; 3], Vec3) {
    let n = (b - a).cross(c - a);
    let area2 = n.dot(n);
    let part = |from: Vec3, to: Vec3| (to - from).cross(p - from).dot(n);
    let (wa, wb, wc) = (part(b, c), part(c, a), part(a, b));
    if area2 > 0.0 && wa >= 0.0 && wb >= 0.0 && wc >= 0.0 {
        let sum = wa + wb + wc;
        let w = [wa / sum, wb / sum, wc / sum];
        return (w, a * w[0] + b * w[1] + c * w[2]);
    }
    let on_edge = |i: usize, j: usize, from: Vec3, to: Vec3| {
        let e = to - from;
        let l = e.dot(e);
        let t = if l > 0.0 { ((p - from).dot(e) / l).clamp(0.0, 1.0) } else { 0.0 };
        let mut w = [0.0; 3];
        (w[i], w[j]) = (1.0 - t, t);
        (w, from + e * t)
    };
    let away = |q: &([f64; 3], Vec3)| (q.1 - p).dot(q.1 - p);
    let others = [on_edge(1, 2, b, c), on_edge(2, 0, c, a)];
    others.into_iter().fold(on_edge(0, 1, a, b), |best, q| if away(&q) < away(&best) { q } else { best })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::zoo;
    use crate::numerics::rng::Key;
    use crate::numerics::vec::vec3;

    #[test]
    fn it_is_the_nearest_of_all_faces() {
        for (name, mesh) in zoo::all() {
            let grid = NearestPoint::new(&mesh);
            let (low, high) = mesh.bounds();
            for i in 0..60 {
                let draws = Key::new(i);
                let at = |k: usize| low[k] + (draws.unit(k as u64) * 1.6 - 0.3) * (high[k] - low[k]) + 0.01;
                let p = vec3(at(0), at(1), at(2));
                let found = grid.search(p, |_| true, f64::INFINITY).unwrap();
                let brute = (0..mesh.faces.len()).map(|f| (closest(p, mesh.corners(f)).1 - p).length());
                assert_eq!(found.distance, brute.fold(f64::INFINITY, f64::min), "{name} {i}");
                let [a, b, c] = mesh.corners(found.face as usize);
                let foot = a * found.bary[0] + b * found.bary[1] + c * found.bary[2];
                assert!(((foot - p).length() - found.distance).abs() < 1e-9);
                assert!((found.bary.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            }
        }
        assert_eq!(NearestPoint::new(&TriMesh::default()).find(Vec3::ZERO, Vec3::ZERO), None);
    }

    #[test]
    fn of_two_sides_it_takes_the_one_that_looks_the_same_way() {
        let mesh = zoo::two_sided();
        let grid = NearestPoint::new(&mesh);
        let [a, b, c] = mesh.corners(0);
        let p = (a + b + c) * (1.0 / 3.0);
        for normal in [mesh.area_vector(0), -mesh.area_vector(0)] {
            let found = grid.find(p, normal).unwrap();
            assert!(mesh.area_vector(found.face as usize).dot(normal) > 0.0 && found.distance < 1e-9);
        }
    }
}
