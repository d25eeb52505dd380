//! Effect areas: the same coordinates again where the field changed, all else locked.
//!
//! Source: `[MST09]` 2.1: "all variables m, S, s, t associated to the boundary are fixed to their initial value". In:
//! coordinates, the field that they follow and another. Out: coordinates that follow the other.
//! The open vertices are those where the fields differ. Each connected group of them is solved on a mesh of the faces
//! around it, so that it costs by its area, and no bit of it depends on what happens elsewhere. What can change are
//! angles at open vertices, faces at these, and whether 1-rings of their corners are valid; the rest stays bit for bit.
//! Unaware of: constraints, how the fields came about.

use super::guide::{Guide, Wanted};
use super::{Error, Fault, Parametrization, check, periodic, recover, singular, solve};
use crate::field::{Field, Symmetry};
use crate::mesh::{Excerpt, Topology, TriMesh};
use crate::numerics::vec::Vec3;

impl Parametrization {
    /// Follows another field where it differs from the one that was followed before. Returns the number of open
    /// vertices. Panics if `topo` is not the mesh's.
    pub fn follow(
        &mut self,
        mesh: &TriMesh,
        topo: &Topology,
        normals: &[Vec3],
        [before, after]: [&Field; 2],
        symmetry: Symmetry,
    ) -> Result<usize, Error> {
        let wanted = Wanted { mesh, topo, normals, field: after, symmetry, tile: self.tile };
        check(&wanted)?;
        if self.at.len() != mesh.positions.len() || before.up.len() != mesh.positions.len() {
            let (found, expected) = (self.at.len().min(before.up.len()), mesh.positions.len());
            return Err(Error::Mismatch { what: "vertices with coordinates", found, expected });
        }
        let differs = |v: usize| before.up[v] != after.up[v] || before.scale[v] != after.scale[v];
        let open: Vec<u32> = (0..mesh.positions.len() as u32).filter(|&v| differs(v as usize)).collect();
        for area in groups(topo, &open) {
            self.solve(&wanted, &area);
        }
        Ok(open.len())
    }

    /// Solves for a group of vertices, ascending.
    fn solve(&mut self, wanted: &Wanted<'_>, open: &[u32]) {
        let area = Area::new(wanted, open);
        let inner = area.wanted(wanted);
        let mut guide = inner.guide();
        // Between two locked vertices all stays as it was.
        let is_open: Vec<bool> = area.piece.vertices.iter().map(|v| open.binary_search(v).is_ok()).collect();
        let global =
            |v: u32, n: u32| wanted.topo.find(area.piece.vertices[v as usize], area.piece.vertices[n as usize]);
        let mut edges = vec![];
        for v in 0..area.piece.vertices.len() as u32 {
            for h in area.piece.topo.half_edges(v) {
                let n = area.piece.topo.target(h);
                let Some(there) = global(v, n) else { continue };
                let free = is_open[v as usize] || is_open[n as usize];
                edges.push((h, there, free));
                if !free {
                    guide.steps[h] = self.steps[there];
                }
            }
        }
        edges.iter().filter(|e| e.2).for_each(|&(h, there, _)| self.steps[there] = guide.steps[h]);
        let mut phases = area.piece.of(&self.phases);
        let inside: Vec<u32> = (0..).zip(&is_open).filter(|(_, open)| **open).map(|(v, _)| v).collect();
        let bounded = is_open.contains(&false);
        // A component that is open as a whole keeps its first vertex, as it did at first.
        let free = if bounded { &inside[..] } else { &inside[1..] };
        solve(&inner, &guide, &|v| is_open[v as usize], free, &mut phases);
        self.write(wanted, &area, &guide, &inside, phases);
    }

    fn write(
        &mut self,
        wanted: &Wanted<'_>,
        area: &Area,
        guide: &Guide,
        inside: &[u32],
        phases: Vec<periodic::Phases>,
    ) {
        for &v in inside {
            let there = area.piece.vertices[v as usize] as usize;
            self.phases[there] = phases[v as usize];
            self.at[there] = recover::periods(&phases[v as usize]);
        }
        let at = area.piece.of(&self.at);
        let changes = recover::changes(guide, &area.piece.topo, &at);
        for (f, &face) in area.piece.mesh.faces.iter().enumerate() {
            let there = area.piece.faces[f] as usize;
            let (corners, around) = recover::corners(guide, &area.piece.topo, &at, &changes, face);
            self.faults[there] = Fault { distorted: singular::distorted(wanted, there, &corners), around };
            self.corners[there] = corners;
        }
        for &v in &area.piece.vertices {
            self.invalid[v as usize] = wanted.topo.faces(v).iter().any(|&f| !self.faults[f as usize].none());
        }
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
