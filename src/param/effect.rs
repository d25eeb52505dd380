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
use crate::mesh::{Topology, TriMesh};
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
        let is_open: Vec<bool> = area.vertices.iter().map(|v| open.binary_search(v).is_ok()).collect();
        let global = |v: u32, n: u32| wanted.topo.find(area.vertices[v as usize], area.vertices[n as usize]);
        let mut edges = vec![];
        for v in 0..area.vertices.len() as u32 {
            for h in area.topo.half_edges(v) {
                let n = area.topo.target(h);
                let Some(there) = global(v, n) else { continue };
                let free = is_open[v as usize] || is_open[n as usize];
                edges.push((h, there, free));
                if !free {
                    guide.steps[h] = self.steps[there];
                }
            }
        }
        edges.iter().filter(|e| e.2).for_each(|&(h, there, _)| self.steps[there] = guide.steps[h]);
        let mut phases: Vec<_> = area.vertices.iter().map(|&v| self.phases[v as usize]).collect();
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
            let there = area.vertices[v as usize] as usize;
            self.phases[there] = phases[v as usize];
            self.at[there] = recover::periods(&phases[v as usize]);
        }
        let at: Vec<_> = area.vertices.iter().map(|&v| self.at[v as usize]).collect();
        let changes = recover::changes(guide, &area.topo, &at);
        for (f, &face) in area.mesh.faces.iter().enumerate() {
            let there = area.faces[f] as usize;
            let (corners, around) = recover::corners(guide, &area.topo, &at, &changes, face);
            self.faults[there] = Fault { distorted: singular::distorted(wanted, there, &corners), around };
            self.corners[there] = corners;
        }
        for &v in &area.vertices {
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

/// The faces around some vertices as a mesh of its own.
struct Area {
    mesh: TriMesh,
    topo: Topology,
    normals: Vec<Vec3>,
    field: Field,
    /// Its vertices and faces in the whole mesh, ascending.
    vertices: Vec<u32>,
    faces: Vec<u32>,
}

impl Area {
    fn new(wanted: &Wanted<'_>, open: &[u32]) -> Self {
        let mut faces: Vec<u32> = open.iter().flat_map(|&v| wanted.topo.faces(v)).copied().collect();
        faces.sort_unstable();
        faces.dedup();
        let corners = |&f: &u32| wanted.mesh.faces[f as usize];
        let mut vertices: Vec<u32> = faces.iter().flat_map(corners).chain(open.iter().copied()).collect();
        vertices.sort_unstable();
        vertices.dedup();
        let own = |v: u32| vertices.partition_point(|&u| u < v) as u32;
        let mesh = TriMesh {
            positions: vertices.iter().map(|&v| wanted.mesh.positions[v as usize]).collect(),
            faces: faces.iter().map(|f| corners(f).map(own)).collect(),
        };
        let (up, scale) = (&wanted.field.up, &wanted.field.scale);
        Area {
            topo: Topology::new(&mesh),
            normals: vertices.iter().map(|&v| wanted.normals[v as usize]).collect(),
            field: Field {
                up: vertices.iter().map(|&v| up[v as usize]).collect(),
                scale: vertices.iter().map(|&v| scale[v as usize]).collect(),
            },
            mesh,
            vertices,
            faces,
        }
    }

    fn wanted<'a>(&'a self, whole: &Wanted<'_>) -> Wanted<'a> {
        let Area { mesh, topo, normals, field, .. } = self;
        Wanted { mesh, topo, normals, field, symmetry: whole.symmetry, tile: whole.tile }
    }
}
