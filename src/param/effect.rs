//! Effect areas: the same coordinates again where the field changed, all else locked.
//!
//! Source: `[MST09]` 2.1: "all variables m, S, s, t associated to the boundary are fixed to their initial value". In:
//! coordinates, the field that they follow and another. Out: what changes in coordinates that follow the other.
//! The open vertices are those where the fields differ. Each connected group of them is solved on a mesh of the faces
//! around it, so that it costs by its area, and no bit of it depends on what happens elsewhere. What can change are
//! angles at open vertices, faces at these, and whether 1-rings of their corners are valid; the rest stays bit for bit.
//! Unaware of: constraints, how the fields came about.

use super::guide::{Guide, Wanted};
use super::{Error, Fault, Parametrization, Phases, Step, check, recover, singular, solve, steps_around};
use crate::field::{Field, Symmetry};
use crate::mesh::{Excerpt, Topology, TriMesh};
use crate::numerics::vec::{Vec2, Vec3};

/// What stays where the field stays.
#[derive(Clone, Copy, Debug)]
pub struct Locked<'a> {
    /// Texels in a period of s and of t.
    pub tile: [u32; 2],
    /// As in [`Parametrization`].
    pub phases: &'a [Phases],
    /// As in [`Parametrization`].
    pub faults: &'a [Fault],
}

/// What becomes of coordinates that follow another field, all by ascending vertices and faces.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Change {
    /// Angles of the open vertices.
    pub phases: Vec<(u32, Phases)>,
    /// Corners of the faces at these, and what is wrong with them.
    pub faces: Vec<(u32, [Vec2; 3], Fault)>,
    /// Whether the 1-rings of their corners hold a face at fault.
    pub invalid: Vec<(u32, bool)>,
    /// Along the edges of those that do.
    pub steps: Vec<Step>,
}

/// Follows another field where it differs from the one that was followed before.
pub fn follow(
    locked: &Locked<'_>,
    mesh: &TriMesh,
    normals: &[Vec3],
    [before, after]: [&Field; 2],
    symmetry: Symmetry,
) -> Result<Change, Error> {
    let (vertices, faces) = (mesh.positions.len(), mesh.faces.len());
    let counts = [
        ("vertices with coordinates", locked.phases.len(), vertices),
        ("faces with coordinates", locked.faults.len(), faces),
        ("normals", normals.len(), vertices),
        ("directions", before.up.len().min(after.up.len()), vertices),
        ("scales", before.scale.len().min(after.scale.len()), vertices),
    ];
    if let Some((what, found, expected)) = counts.into_iter().find(|(_, found, expected)| found != expected) {
        return Err(Error::Mismatch { what, found, expected });
    }
    let differs = |v: usize| before.up[v] != after.up[v] || before.scale[v] != after.scale[v];
    let open: Vec<u32> = (0..vertices as u32).filter(|&v| differs(v as usize)).collect();
    // All faces at corners of faces at open vertices, in the order of the mesh.
    let near = Excerpt::with_neighbours(mesh, &open);
    let of = |field: &Field| Field { up: near.of(&field.up), scale: near.of(&field.scale) };
    let (normals, before, after) = (near.of(normals), of(before), of(after));
    let wanted =
        |field| Wanted { mesh: &near.mesh, topo: &near.topo, normals: &normals, field, symmetry, tile: locked.tile };
    let (before, after) = (wanted(&before), wanted(&after));
    check(&after)?;
    let mut nearby = Nearby {
        steps: before.guide().steps,
        phases: near.of(locked.phases),
        faces: near.faces.iter().map(|&f| (locked.faults[f as usize], None)).collect(),
        invalid: vec![None; near.vertices.len()],
    };
    let open: Vec<u32> = open.iter().filter_map(|&v| near.own(v)).collect();
    for area in groups(&near.topo, &open) {
        nearby.solve(&after, &area);
    }
    Ok(nearby.change(&near, &open))
}

/// Coordinates of the faces around open vertices.
struct Nearby {
    /// Per half-edge.
    steps: Vec<Vec2>,
    phases: Vec<Phases>,
    /// What is wrong with faces, and the corners of those that were laid anew.
    faces: Vec<(Fault, Option<[Vec2; 3]>)>,
    /// Whether 1-rings hold a face at fault, where that was looked at again.
    invalid: Vec<Option<bool>>,
}

impl Nearby {
    /// Solves for a group of vertices, ascending.
    fn solve(&mut self, wanted: &Wanted<'_>, open: &[u32]) {
        let area = Area::new(wanted, open);
        let inner = area.wanted(wanted);
        let mut guide = inner.guide();
        // Between two locked vertices all stays as it was.
        let is_open: Vec<bool> = area.piece.vertices.iter().map(|v| open.binary_search(v).is_ok()).collect();
        let there = |v: u32| area.piece.vertices[v as usize];
        for v in 0..area.piece.vertices.len() as u32 {
            for h in area.piece.topo.half_edges(v) {
                let n = area.piece.topo.target(h);
                let Some(whole) = wanted.topo.find(there(v), there(n)) else { continue };
                if is_open[v as usize] || is_open[n as usize] {
                    self.steps[whole] = guide.steps[h];
                } else {
                    guide.steps[h] = self.steps[whole];
                }
            }
        }
        let mut phases = area.piece.of(&self.phases);
        let inside: Vec<u32> = (0..).zip(&is_open).filter(|(_, open)| **open).map(|(v, _)| v).collect();
        let bounded = is_open.contains(&false);
        // A component that is open as a whole keeps its first vertex, as it did at first.
        let free = if bounded { &inside[..] } else { &inside[1..] };
        solve(&inner, &guide, &|v| is_open[v as usize], free, &mut phases);
        inside.iter().for_each(|&v| self.phases[there(v) as usize] = phases[v as usize]);
        self.lay(wanted, &area, &guide);
    }

    /// Corners of an area's faces.
    fn lay(&mut self, wanted: &Wanted<'_>, area: &Area, guide: &Guide) {
        let Excerpt { mesh, topo, vertices, faces } = &area.piece;
        let at: Vec<Vec2> = vertices.iter().map(|&v| recover::periods(&self.phases[v as usize])).collect();
        let changes = recover::changes(guide, topo, &at);
        for (&face, &there) in mesh.faces.iter().zip(faces) {
            let (corners, around) = recover::corners(guide, topo, &at, &changes, face);
            let distorted = singular::distorted(wanted, there as usize, &corners);
            self.faces[there as usize] = (Fault { distorted, around }, Some(corners));
        }
        for &v in vertices {
            let is_invalid = wanted.topo.faces(v).iter().any(|&f| !self.faces[f as usize].0.none());
            self.invalid[v as usize] = Some(is_invalid);
        }
    }

    /// All that was laid anew, as the whole mesh counts.
    fn change(&self, near: &Excerpt, open: &[u32]) -> Change {
        let there = |v: u32| near.vertices[v as usize];
        let face =
            |(&(fault, corners), &f): (&(Fault, Option<[Vec2; 3]>), &u32)| corners.map(|corners| (f, corners, fault));
        let seen = |(&invalid, &v): (&Option<bool>, &u32)| invalid.map(|invalid| (v, invalid));
        let invalid = (0..near.vertices.len() as u32).filter(|&v| self.invalid[v as usize] == Some(true));
        let steps = invalid.flat_map(|v| steps_around(&near.topo, v, &self.steps));
        Change {
            phases: open.iter().map(|&v| (there(v), self.phases[v as usize])).collect(),
            faces: self.faces.iter().zip(&near.faces).filter_map(face).collect(),
            invalid: self.invalid.iter().zip(&near.vertices).filter_map(seen).collect(),
            steps: steps.map(|s| Step { from: there(s.from), to: there(s.to), ..s }).collect(),
        }
    }
}

impl Parametrization {
    /// Takes a change over. Fails if it is one of a larger mesh.
    pub fn apply(&mut self, change: &Change) -> Result<(), Error> {
        let most = |what, last: Option<u32>, expected: usize| match last.map_or(0, |last| last as usize + 1) {
            found if found > expected => Err(Error::Mismatch { what, found, expected }),
            _ => Ok(()),
        };
        most("vertices with angles", change.phases.iter().map(|v| v.0).max(), self.phases.len())?;
        most("vertices with 1-rings", change.invalid.iter().map(|v| v.0).max(), self.invalid.len())?;
        most("faces", change.faces.iter().map(|f| f.0).max(), self.corners.len())?;
        change.phases.iter().for_each(|&(v, phases)| self.phases[v as usize] = phases);
        for &(f, corners, fault) in &change.faces {
            (self.corners[f as usize], self.faults[f as usize]) = (corners, fault);
        }
        change.invalid.iter().for_each(|&(v, invalid)| self.invalid[v as usize] = invalid);
        self.steps.retain(|s| change.invalid.binary_search_by_key(&s.from, |v| v.0).is_err());
        self.steps.extend(&change.steps);
        self.steps.sort_unstable_by_key(|s| (s.from, s.to));
        Ok(())
    }
}

/// Connected groups of vertices, each ascending, by their lowest.
fn groups(topo: &Topology, open: &[u32]) -> Vec<Vec<u32>> {
    let mut taken = vec![false; open.len()];
    let mut groups = vec![];
    for first in 0..open.len() {
        if std::mem::replace(&mut taken[first], true) {
            continue;
        }
        let (mut group, mut next) = (vec![open[first]], 0);
        while next < group.len() {
            for n in topo.neighbours(group[next]) {
                if let Ok(i) = open.binary_search(n)
                    && !std::mem::replace(&mut taken[i], true)
                {
                    group.push(*n);
                }
            }
            next += 1;
        }
        group.sort_unstable();
        groups.push(group);
    }
    groups
}

/// The faces around some vertices as a mesh of its own, with its field.
struct Area {
    piece: Excerpt,
    normals: Vec<Vec3>,
    field: Field,
}

impl Area {
    fn new(wanted: &Wanted<'_>, open: &[u32]) -> Self {
        let piece = Excerpt::new(wanted.mesh, wanted.topo, open);
        let field = Field { up: piece.of(&wanted.field.up), scale: piece.of(&wanted.field.scale) };
        Area { normals: piece.of(wanted.normals), field, piece }
    }

    fn wanted<'a>(&'a self, whole: &Wanted<'_>) -> Wanted<'a> {
        let Area { piece: Excerpt { mesh, topo, .. }, normals, field } = self;
        Wanted { mesh, topo, normals, field, symmetry: whole.symmetry, tile: whole.tile }
    }
}
