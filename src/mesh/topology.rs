//! Which faces and vertices meet at each vertex. Works for any mesh, manifold or not.

use super::TriMesh;
use crate::numerics::par;

/// Adjacency in compressed rows: the neighbours and faces of a vertex, each sorted, without repeats.
///
/// A half-edge here is an entry (vertex, neighbour) of the neighbour rows: `half_edge(v)` gives the range of indices
/// of v's entries, so per-half-edge data lives in a plain array beside this.
#[derive(Clone, Debug, PartialEq)]
pub struct Topology {
    starts: Vec<u32>,
    neighbours: Vec<u32>,
    face_starts: Vec<u32>,
    faces: Vec<u32>,
}

impl Topology {
    /// Builds the rows in time linear in the faces, but for sorting each row.
    pub fn new(mesh: &TriMesh) -> Self {
        let (face_starts, faces) = faces_at(mesh.positions.len(), &mesh.faces);
        let (starts, neighbours) = neighbours(&mesh.faces, &face_starts, &faces);
        Topology { starts, neighbours, face_starts, faces }
    }

    /// Adjacency without faces: where the row of each vertex starts, and where the last ends; the neighbours of each
    /// vertex, ascending, each the other's.
    pub(crate) fn from_rows(starts: Vec<u32>, neighbours: Vec<u32>) -> Self {
        Topology { face_starts: vec![0; starts.len()], starts, neighbours, faces: vec![] }
    }

    /// Number of vertices.
    pub fn vertex_count(&self) -> usize {
        self.starts.len() - 1
    }

    /// Number of half-edges: twice the number of distinct edges.
    pub fn half_edge_count(&self) -> usize {
        self.neighbours.len()
    }

    /// Indices of a vertex's half-edges, in ascending order of the neighbour.
    pub fn half_edges(&self, v: u32) -> std::ops::Range<usize> {
        self.starts[v as usize] as usize..self.starts[v as usize + 1] as usize
    }

    /// The vertex that a half-edge points to.
    pub fn target(&self, half_edge: usize) -> u32 {
        self.neighbours[half_edge]
    }

    /// Neighbours of a vertex, ascending.
    pub fn neighbours(&self, v: u32) -> &[u32] {
        &self.neighbours[self.half_edges(v)]
    }

    /// The half-edge from `v` to `to`, if they share an edge.
    pub fn find(&self, v: u32, to: u32) -> Option<usize> {
        self.neighbours(v).binary_search(&to).ok().map(|i| self.starts[v as usize] as usize + i)
    }

    /// Faces at a vertex, ascending.
    pub fn faces(&self, v: u32) -> &[u32] {
        &self.faces[self.face_starts[v as usize] as usize..self.face_starts[v as usize + 1] as usize]
    }
}

/// Vertices whose neighbours are gathered at once.
const CHUNK: usize = 4096;

/// The neighbours of each vertex, from the faces at it: where each row starts, and the rows. (Faces at a vertex lie close
/// together in memory; to sort all pairs of neighbours by counting took twice as long.)
fn neighbours(corners: &[[u32; 3]], face_starts: &[u32], faces: &[u32]) -> (Vec<u32>, Vec<u32>) {
    let n = face_starts.len() - 1;
    let chunks = par::map_chunks(n, CHUNK, |vertices| {
        let (mut ends, mut all) = (Vec::with_capacity(vertices.len()), Vec::with_capacity(7 * vertices.len()));
        let mut row: Vec<u32> = vec![];
        for v in vertices {
            row.clear();
            for &f in &faces[face_starts[v] as usize..face_starts[v + 1] as usize] {
                row.extend(corners[f as usize].iter().filter(|&&c| c != v as u32));
            }
            row.sort_unstable();
            row.dedup();
            all.extend_from_slice(&row);
            ends.push(all.len() as u32);
        }
        (ends, all)
    });
    let mut starts = Vec::with_capacity(n + 1);
    starts.push(0);
    for (ends, _) in &chunks {
        let before = starts[starts.len() - 1];
        starts.extend(ends.iter().map(|end| before + end));
    }
    let rows: Vec<&[u32]> = chunks.iter().map(|(_, all)| &all[..]).collect();
    (starts, rows.concat())
}

/// The faces at each of `n` vertices: where each row starts, and the rows.
fn faces_at(n: usize, corners: &[[u32; 3]]) -> (Vec<u32>, Vec<u32>) {
    let mut starts = vec![0u32; n + 1];
    each_corner(corners, |v, _| starts[v as usize + 1] += 1);
    let mut sum = 0;
    for start in &mut starts {
        sum += *start;
        *start = sum;
    }
    let mut fill = starts.clone();
    let mut faces = vec![0u32; starts[n] as usize];
    each_corner(corners, |v, f| {
        faces[fill[v as usize] as usize] = f;
        fill[v as usize] += 1;
    });
    (starts, faces)
}

/// Each vertex of each face, with the face.
fn each_corner(faces: &[[u32; 3]], mut pair: impl FnMut(u32, u32)) {
    for (i, &[a, b, c]) in faces.iter().enumerate() {
        pair(a, i as u32);
        if b != a {
            pair(b, i as u32);
        }
        if c != a && c != b {
            pair(c, i as u32);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use crate::mesh::zoo;
    use crate::numerics::vec::vec3;

    #[test]
    fn two_triangles_share_an_edge() {
        let positions = vec![vec3(0., 0., 0.), vec3(1., 0., 0.), vec3(1., 1., 0.), vec3(0., 1., 0.), vec3(9., 9., 9.)];
        let mesh = TriMesh { positions, faces: vec![[0, 1, 2], [0, 2, 3]] };
        let t = Topology::new(&mesh);
        assert_eq!(t.neighbours(0), [1, 2, 3]);
        assert_eq!(t.neighbours(1), [0, 2]);
        assert!(t.neighbours(4).is_empty());
        assert_eq!(t.faces(2), [0, 1]);
        assert_eq!(t.half_edge_count(), 10);
        assert_eq!(t.target(t.find(2, 3).unwrap()), 3);
        assert_eq!(t.find(1, 3), None);
    }

    #[test]
    fn rows_are_those_of_sets() {
        for (name, m) in zoo::all() {
            let n = m.positions.len();
            let (mut around, mut at) = (vec![BTreeSet::new(); n], vec![BTreeSet::new(); n]);
            for (i, &[a, b, c]) in m.faces.iter().enumerate() {
                for (a, b) in [(a, b), (b, c), (c, a)] {
                    at[a as usize].insert(i as u32);
                    around[a as usize].extend((a != b).then_some(b));
                    around[b as usize].extend((a != b).then_some(a));
                }
            }
            let t = Topology::new(&m);
            for v in 0..n as u32 {
                assert!(t.neighbours(v).iter().eq(&around[v as usize]), "{name}");
                assert!(t.faces(v).iter().eq(&at[v as usize]), "{name}");
            }
            assert_eq!(t.half_edge_count(), around.iter().map(BTreeSet::len).sum::<usize>(), "{name}");
        }
    }
}
