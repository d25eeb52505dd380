//! The texture of one mesh for another that approximates the same surface: levels of detail.
//!
//! Beyond \[ZG03\], which would synthesise every level anew. Each vertex of the coarser mesh takes the patches that show at
//! the nearest point of the finest one, their places and weights. A patch goes on from there along the gradients of its
//! coordinates; at a face's corners patches of different corners that agree are one (`super::layers`). So the levels
//! agree at vertices exactly, and between them as far as the surfaces are the same.
//! Unaware of: fields, jump maps.

use super::layers::{MAX_SETS, Patch, of_faces};
use crate::mesh::TriMesh;
use crate::mesh::nearest::NearestPoint;
use crate::numerics::par;
use crate::numerics::vec::Vec3;
use crate::texture::{Texel, texel};
use crate::uvset::{Blend, UvSets};

/// Patches this near each other, in texels, at the corners of a face continue each other. The two surfaces may be unlike
/// in length by some texels along an edge; jumps are mostly longer.
const CONTINUES: f32 = 4.0;

/// Patches of less weight are left out.
const LEAST: f32 = 0.01;

/// What shows at a vertex: one patch.
#[derive(Clone, Copy)]
struct Shown {
    at: Texel,
    weight: f32,
    /// Change of x and of y in texels per unit of length; both in the plane of the face they were found in.
    gradients: [Vec3; 2],
}

/// Corner coordinates of `level` that show on it what `sets` shows on `finest`.
pub fn transfer(finest: &TriMesh, sets: &UvSets, level: &TriMesh) -> UvSets {
    let grid = NearestPoint::new(finest);
    let normals = level.vertex_normals();
    let shown = par::map(level.positions.len(), |v| {
        let point = grid.find(level.positions[v], normals[v]);
        point.map_or(vec![], |p| shown(finest, sets, p.face as usize, p.bary.map(|b| b as f32)))
    });
    let count = if sets.blend == Blend::Nearest { 1 } else { sets.sets.len().min(MAX_SETS) };
    let [width, height] = sets.exemplar_size.map(|s| s as f32);
    // Beyond the outer texel centres there is nothing to show.
    let inside = |a: Texel| texel(a.x.max(0.5).min(width - 0.5), a.y.max(0.5).min(height - 0.5));
    let (sets_of_level, weights) = of_faces(level.faces.len(), count, CONTINUES, |layers, f| {
        let (face, p) = (level.faces[f], level.corners(f));
        for (k, v) in face.iter().enumerate() {
            for (i, s) in shown[*v as usize].iter().enumerate() {
                let mut patch = Patch::new((k * MAX_SETS + i) as u32);
                (0..3).for_each(|j| patch.place(j, s.moved(p[j] - p[k]), if j == k { s.weight } else { 0.0 }));
                layers.push(patch);
            }
        }
        let mut out = layers.finish(count);
        out.sets.iter_mut().flatten().for_each(|a| *a = inside(*a));
        out
    });
    UvSets { sets: sets_of_level, weights, material: vec![], ..*sets }
}

impl Shown {
    /// The patch's place a step away: the step laid into the plane of the gradients, at its full length.
    fn moved(&self, step: Vec3) -> Texel {
        let [gx, gy] = self.gradients;
        let flat = match gx.cross(gy).normalized() {
            Some(n) => step.reject(n),
            None => step,
        };
        let stretch = if flat.length() > 0.0 { (step.length() / flat.length()).min(2.0) } else { 0.0 };
        let (x, y) = (gx.dot(flat) * stretch, gy.dot(flat) * stretch);
        texel((f64::from(self.at.x) + x) as f32, (f64::from(self.at.y) + y) as f32)
    }
}

/// The patches that show at a point.
fn shown(mesh: &TriMesh, sets: &UvSets, face: usize, bary: [f32; 3]) -> Vec<Shown> {
    let weights = sets.weights_at(face, bary);
    let [a, b, c] = mesh.corners(face);
    let (e1, e2) = (b - a, c - a);
    let n = e1.cross(e2);
    // Gradient of what grows by d1 along e1 and by d2 along e2.
    let gradient = |d1: f32, d2: f32| {
        let area2 = n.dot(n);
        if area2 > 0.0 {
            (e2.cross(n) * f64::from(d1) + n.cross(e1) * f64::from(d2)) * (1.0 / area2)
        } else {
            Vec3::ZERO
        }
    };
    let of = |s: usize| {
        let uv = &sets.sets[s][3 * face..3 * face + 3];
        let gradients =
            [gradient(uv[1].x - uv[0].x, uv[2].x - uv[0].x), gradient(uv[1].y - uv[0].y, uv[2].y - uv[0].y)];
        Shown { at: sets.at(s, face, bary), weight: weights[s], gradients }
    };
    (0..sets.sets.len().min(MAX_SETS)).filter(|s| weights[*s] >= LEAST).map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synth::testing::grid;

    /// A plane of two patches, left and right of x = 20, over a blend of one column of squares.
    fn two_patches() -> (TriMesh, UvSets) {
        let mesh = grid(41, 31, 0.0);
        let place = |c: usize, s: usize| {
            let p = mesh.positions[mesh.faces[c / 3][c % 3] as usize];
            texel(p.x as f32 + 50.0, p.y as f32 + 50.0 + 100.0 * s as f32)
        };
        let corners = 3 * mesh.faces.len();
        let sets = (0..2).map(|s| (0..corners).map(|c| place(c, s)).collect()).collect();
        let left = |c: usize| place(c, 0).x <= 70.0;
        let weight = |c: usize| if left(c) { [1.0, 0.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0, 0.0] };
        let weights = (0..corners).map(weight).collect();
        (
            mesh,
            UvSets { exemplar_size: [256, 256], sets, weights, blend: Blend::Linear, sharpness: 1, material: vec![] },
        )
    }

    #[test]
    fn a_coarser_level_shows_the_same() {
        let (finest, sets) = two_patches();
        // A third of the vertices along each axis, a hair above the surface.
        let mut level = grid(14, 11, 0.0);
        level.positions.iter_mut().for_each(|p| *p = crate::numerics::vec::vec3(p.x * 3.0, p.y * 3.0, 0.01));
        let ours = transfer(&finest, &sets, &level);
        for (c, v) in level.faces.as_flattened().iter().enumerate() {
            let p = level.positions[*v as usize];
            let want = (p.x + 50.0, p.y + 50.0 + if p.x <= 20.0 { 0.0 } else { 100.0 });
            let strongest = (0..2).max_by(|a, b| ours.weights[c][*a].total_cmp(&ours.weights[c][*b])).unwrap();
            let at = ours.sets[strongest][c];
            assert_eq!(ours.weights[c][strongest], 1.0);
            assert!(
                (f64::from(at.x) - want.0).abs() < 1e-3 && (f64::from(at.y) - want.1).abs() < 1e-3,
                "{at:?} {want:?}"
            );
        }
        // Within a patch both sets, of which one counts, are that patch.
        let away = |f: usize| level.corners(f).iter().all(|p| p.x < 15.0);
        for f in (0..level.faces.len()).filter(|f| away(*f)) {
            assert!((0..3).all(|k| ours.weights[3 * f + k] == [1.0, 0.0, 0.0, 0.0]));
        }
    }

    #[test]
    fn a_mesh_is_its_own_level() {
        let (finest, sets) = two_patches();
        let ours = transfer(&finest, &sets, &finest);
        for c in 0..sets.weights.len() {
            let strongest = |s: &UvSets| {
                let i = usize::from(s.weights[c][1] > s.weights[c][0]);
                (s.sets[i][c].x.round(), s.sets[i][c].y.round())
            };
            assert_eq!(strongest(&ours), strongest(&sets));
        }
        assert_eq!(
            transfer(&TriMesh::default(), &UvSets { sets: vec![vec![]], weights: vec![], ..sets }, &finest).sets.len(),
            1
        );
    }
}
