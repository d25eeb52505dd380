//! A piece of a mesh as a mesh of its own, so that what concerns a small area need not look at the whole.
//!
//! In: a mesh and some of its vertices. Out: the faces at these, and all their vertices, in the order in which the mesh
//! has them. Sums over what lies around a vertex that was asked for are therefore the same to the last bit. Unaware of:
//! what is done with it.

use super::{Topology, TriMesh};

/// The faces around some vertices of a mesh.
#[derive(Clone, Debug)]
pub(crate) struct Excerpt {
    pub mesh: TriMesh,
    pub topo: Topology,
    /// Its vertices in the whole mesh, ascending.
    pub vertices: Vec<u32>,
    /// Its faces in the whole mesh, ascending.
    pub faces: Vec<u32>,
}

impl Excerpt {
    /// The faces at `around`, in any order.
    pub fn new(mesh: &TriMesh, topo: &Topology, around: &[u32]) -> Self {
        let faces = sorted(around.iter().flat_map(|&v| topo.faces(v)).copied());
        Excerpt::of_faces(mesh, faces, around)
    }

    /// The faces at `around` and at their neighbours, found without the mesh's topology by going through all faces.
    pub fn with_neighbours(mesh: &TriMesh, around: &[u32]) -> Self {
        let mut near = vec![false; mesh.positions.len()];
        around.iter().for_each(|&v| near[v as usize] = true);
        let at = |near: &[bool]| {
            let is_near = |&f: &u32| mesh.faces[f as usize].iter().any(|&v| near[v as usize]);
            (0..mesh.faces.len() as u32).filter(is_near).collect::<Vec<u32>>()
        };
        for f in at(&near) {
            mesh.faces[f as usize].iter().for_each(|&v| near[v as usize] = true);
        }
        Excerpt::of_faces(mesh, at(&near), around)
    }

    /// Some faces, ascending, and the vertices `around`.
    fn of_faces(mesh: &TriMesh, faces: Vec<u32>, around: &[u32]) -> Self {
        let corners = |&f: &u32| mesh.faces[f as usize];
        let vertices = sorted(faces.iter().flat_map(corners).chain(around.iter().copied()));
        let own = |v: u32| vertices.partition_point(|&u| u < v) as u32;
        let piece = TriMesh {
            positions: vertices.iter().map(|&v| mesh.positions[v as usize]).collect(),
            faces: faces.iter().map(|f| corners(f).map(own)).collect(),
        };
        Excerpt { topo: Topology::new(&piece), mesh: piece, vertices, faces }
    }

    /// What each of its vertices has of `values`, one per vertex of the whole.
    pub fn of<T: Copy>(&self, values: &[T]) -> Vec<T> {
        self.vertices.iter().map(|&v| values[v as usize]).collect()
    }

    /// Its own number for a vertex of the whole, if it has it.
    pub fn own(&self, vertex: u32) -> Option<u32> {
        self.vertices.binary_search(&vertex).ok().map(|i| i as u32)
    }
}

/// Ascending, without repeats.
fn sorted(items: impl Iterator<Item = u32>) -> Vec<u32> {
    let mut items: Vec<u32> = items.collect();
    items.sort_unstable();
    items.dedup();
    items
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::zoo;

    #[test]
    fn it_has_all_that_touches_its_vertices_as_the_mesh_has_it() {
        for (name, mesh) in zoo::all() {
            let topo = Topology::new(&mesh);
            let around: Vec<u32> = (0..topo.vertex_count() as u32).rev().step_by(5).collect();
            let piece = Excerpt::new(&mesh, &topo, &around);
            assert_eq!(piece.of(&mesh.positions), piece.mesh.positions, "{name}");
            for (f, face) in piece.faces.iter().zip(&piece.mesh.faces) {
                assert_eq!(mesh.faces[*f as usize], face.map(|v| piece.vertices[v as usize]), "{name}");
            }
            for &v in &around {
                let own = piece.own(v).expect("asked for");
                let faces: Vec<u32> = piece.topo.faces(own).iter().map(|&f| piece.faces[f as usize]).collect();
                assert_eq!(faces, topo.faces(v), "{name} {v}");
                let near: Vec<u32> = piece.topo.neighbours(own).iter().map(|&n| piece.vertices[n as usize]).collect();
                assert_eq!(near, topo.neighbours(v), "{name} {v}");
            }
        }
    }

    #[test]
    fn neighbours_are_found_without_the_topology() {
        for (name, mesh) in zoo::all() {
            let topo = Topology::new(&mesh);
            let around: Vec<u32> = (0..topo.vertex_count() as u32).step_by(7).collect();
            let near = around.iter().flat_map(|&v| topo.neighbours(v)).chain(&around).copied();
            let (all, found) = (sorted(near), Excerpt::with_neighbours(&mesh, &around));
            let expected = Excerpt::new(&mesh, &topo, &all);
            assert_eq!((found.faces, found.vertices), (expected.faces, expected.vertices), "{name}");
        }
    }
}
