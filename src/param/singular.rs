//! Where the coordinates are not valid, and what is shown there.
//!
//! Source: `[MST09]` section 3. In: coordinates at corners. Out: invalid 1-rings, and up to three sets of coordinates.
//! Reads as: the printed bound |grad s - g_s|^2 > 0.5 has a unit, that of one over a squared length; taken relative to
//! |g_s|^2, so that a mesh in millimetres has the same singularities as in metres. The second criterion, coordinates
//! that mismatch across an edge, is that of a triangle around which they wind (`recover`). At the boundary there is
//! nothing to mismatch with.
//! Unaware of: how the coordinates were found.

use super::guide::Wanted;
use super::{Around, Error, Parametrization, recover};
use crate::mesh::{Topology, TriMesh};
use crate::numerics::par;
use crate::numerics::vec::{Vec2, Vec3};
use crate::texture::texel;
use crate::uvset::{Blend, UvSets};

/// Bound of the first criterion, as a share of the wanted gradient's square.
const DISTORTED: f64 = 0.5;

/// What is wrong with a face.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Fault {
    /// The gradient of s or t is too far from the wanted one.
    pub distorted: bool,
    /// What is left over around it.
    pub around: Around,
}

impl Fault {
    /// Nothing is wrong.
    pub fn none(&self) -> bool {
        !self.distorted && self.around.closes()
    }
}

/// Whether the gradient of s or t on a face is beyond the bound. `at`: coordinates in the frame of its first corner.
pub(super) fn distorted(wanted: &Wanted<'_>, face: usize, at: &[Vec2; 3]) -> bool {
    off(wanted.mesh, face, &wanted.gradients(face, wanted.mesh.faces[face][0]), at) > DISTORTED
}

/// How far the gradients of s and t on a face are from the wanted ones: the square of the greater difference, as a share
/// of the wanted one's.
pub(super) fn off(mesh: &TriMesh, face: usize, wanted: &[Vec3; 2], at: &[Vec2; 3]) -> f64 {
    let [a, b, c] = mesh.corners(face);
    let (e, f) = (b - a, c - a);
    let normal = e.cross(f);
    let double_area2 = normal.dot(normal);
    if double_area2 <= 0.0 {
        // A face without area has no gradients, and shows nothing.
        return 0.0;
    }
    let (p, q) = (at[1] - at[0], at[2] - at[0]);
    let off = wanted.iter().zip([(p.x, q.x), (p.y, q.y)]).map(|(g, (along_e, along_f))| {
        // What the coordinate has beyond the wanted gradient, linear over the face: its gradient.
        let (u, v) = (along_e - g.dot(e), along_f - g.dot(f));
        let beyond = (f.cross(normal) * u + normal.cross(e) * v) / double_area2;
        beyond.dot(beyond) / g.dot(*g)
    });
    off.fold(0.0, f64::max)
}

/// A place where the coordinates are not valid: faults whose 1-rings touch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Singularity {
    /// Mean of the faces' centres.
    pub at: Vec3,
    /// What it is.
    pub kind: Kind,
    /// Whole periods that s and t wind around all of it.
    pub periods: [i32; 2],
    /// Faces at fault.
    pub faces: u32,
}

/// Kinds of singular places.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// The field has no direction there: all lines of s or of t meet, or a corner of the grid is missing.
    Pole,
    /// Lines end: there are more of them on one side than on the other.
    TJunction,
    /// Nothing winds in all, but the gradients are far from the wanted ones.
    Distortion,
}

impl Kind {
    /// Its name in lists.
    pub fn name(self) -> &'static str {
        match self {
            Kind::Pole => "pole",
            Kind::TJunction => "t-junction",
            Kind::Distortion => "distortion",
        }
    }
}

/// Faces at fault that share a vertex, as one place each; by first face. `field` names the faces around which the field
/// turns.
pub fn singular_places(mesh: &TriMesh, topo: &Topology, faults: &[Fault], field: &[u32]) -> Vec<Singularity> {
    let mut seen = vec![false; faults.len()];
    let mut places = vec![];
    for first in 0..faults.len() {
        if faults[first].none() || std::mem::replace(&mut seen[first], true) {
            continue;
        }
        let (mut members, mut next) = (vec![first], 0);
        while next < members.len() {
            for &v in &mesh.faces[members[next]] {
                for &f in topo.faces(v) {
                    let f = f as usize;
                    if !faults[f].none() && !std::mem::replace(&mut seen[f], true) {
                        members.push(f);
                    }
                }
            }
            next += 1;
        }
        places.push(place(mesh, topo, faults, field, &members));
    }
    places
}

fn place(mesh: &TriMesh, topo: &Topology, faults: &[Fault], field: &[u32], members: &[usize]) -> Singularity {
    let centre = |f: usize| mesh.corners(f).into_iter().fold(Vec3::ZERO, |s, p| s + p) / 3.0;
    let at = members.iter().fold(Vec3::ZERO, |s, &f| s + centre(f)) / members.len() as f64;
    let mut periods = [0; 2];
    for &f in members {
        (0..2).for_each(|k| periods[k] += faults[f].around.periods[k]);
    }
    let turns = |f: usize| faults[f].around.quarters != 0 || field.binary_search(&(f as u32)).is_ok();
    let near = |f: usize| mesh.faces[f].iter().flat_map(|&v| topo.faces(v)).any(|&g| turns(g as usize));
    let kind = if members.iter().any(|&f| near(f)) {
        Kind::Pole
    } else if periods != [0; 2] {
        Kind::TJunction
    } else {
        Kind::Distortion
    };
    Singularity { at, kind, periods, faces: members.len() as u32 }
}

impl Parametrization {
    /// The coordinates for every output: one set where all three 1-rings are valid, else three, each as its corner sees
    /// it and weighed by the barycentric coordinate. `material` is m at the vertices.
    pub fn sets(&self, mesh: &TriMesh, material: &[f32]) -> Result<UvSets, Error> {
        let (found, expected) = (mesh.faces.len(), self.corners.len());
        if found != expected {
            return Err(Error::Mismatch { what: "faces", found, expected });
        }
        if material.len() != self.phases.len() {
            return Err(Error::Mismatch { what: "materials", found: material.len(), expected: self.phases.len() });
        }
        let three = (0..found).any(|f| self.look_ups(mesh, f) == 3);
        let count = if three { 3 } else { 1 };
        let [w, h] = self.tile.map(f64::from);
        let rows = par::map(found, |f| {
            let views: [[Vec2; 3]; 3] = std::array::from_fn(|k| near_zero(self.seen_from(mesh, f, k)));
            let shown = self.look_ups(mesh, f);
            std::array::from_fn::<_, 3, _>(|corner| {
                let at = std::array::from_fn::<_, 3, _>(|set| {
                    let view = if shown == 3 { &views[set] } else { &near_zero(self.corners[f]) };
                    texel((view[corner].x * w) as f32, (view[corner].y * h) as f32)
                });
                let set = if shown == 3 { corner } else { 0 };
                (at, std::array::from_fn::<_, 4, _>(|s| if s == set { 1.0f32 } else { 0.0 }))
            })
        });
        let corners = || rows.iter().flatten();
        Ok(UvSets {
            exemplar_size: self.tile,
            sets: (0..count).map(|s| corners().map(|c| c.0[s]).collect()).collect(),
            weights: corners().map(|c| c.1).collect(),
            blend: Blend::Linear,
            sharpness: 1,
            material: mesh.faces.iter().flat_map(|f| f.map(|v| material[v as usize])).collect(),
        })
    }

    /// Coordinates that a face is shown with: three where a corner's 1-ring is not valid, else one.
    pub fn look_ups(&self, mesh: &TriMesh, face: usize) -> usize {
        if mesh.faces[face].iter().any(|&v| self.invalid[v as usize]) { 3 } else { 1 }
    }

    /// Coordinates of a face as its corner `k` sees them: those of the face, or of the corner's own 1-ring.
    fn seen_from(&self, mesh: &TriMesh, face: usize, k: usize) -> [Vec2; 3] {
        let corners = mesh.faces[face];
        let v = corners[k];
        if !self.invalid[v as usize] {
            return self.corners[face];
        }
        let at = recover::periods(&self.phases[v as usize]);
        let step = |c: u32| {
            self.steps.binary_search_by_key(&(v, c), |s| (s.from, s.to)).map_or(Vec2::ZERO, |i| self.steps[i].by)
        };
        corners.map(|c| at + step(c))
    }
}

/// Moved by whole periods so that the least coordinates lie in 0..1: faces that do not cross a border of the tile share
/// their corners.
fn near_zero(at: [Vec2; 3]) -> [Vec2; 3] {
    let least = at.iter().fold(at[0], |l, p| Vec2 { x: l.x.min(p.x), y: l.y.min(p.y) });
    let whole = Vec2 { x: least.x.floor(), y: least.y.floor() };
    at.map(|p| p - whole)
}
