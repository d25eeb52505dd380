//! Which faces and vertices meet at each vertex. Works for any mesh, manifold or not.

use super::TriMesh;

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
        let n = mesh.positions.len();
        let corner = |f: &[u32; 3]| [(f[0], f[1]), (f[1], f[2]), (f[2], f[0])];
        let edges = mesh.faces.iter().flat_map(corner).filter(|(a, b)| a != b);
        let (starts, neighbours) = rows(n, edges.flat_map(|(a, b)| [(a, b), (b, a)]));
        let incident = mesh.faces.iter().enumerate().flat_map(|(i, f)| f.map(|v| (v, i as u32)));
        let (face_starts, faces) = rows(n, incident);
        Topology { starts, neighbours, face_starts, faces }
    }

    /// Adjacency without faces: the neighbours of each vertex, ascending, each the other's.
    pub(crate) fn from_rows(rows: Vec<Vec<u32>>) -> Self {
        let ends = rows.iter().scan(0, |end, row| {
            *end += row.len() as u32;
            Some(*end)
        });
        let starts: Vec<u32> = std::iter::once(0).chain(ends).collect();
        Topology { face_starts: vec![0; starts.len()], starts, neighbours: rows.concat(), faces: vec![] }
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

/// Sorted rows without repeats from (row, entry) pairs.
fn rows(n: usize, pairs: impl Iterator<Item = (u32, u32)> + Clone) -> (Vec<u32>, Vec<u32>) {
    let mut starts = vec![0u32; n + 1];
    for (row, _) in pairs.clone() {
        starts[row as usize + 1] += 1;
    }
    for i in 0..n {
        starts[i + 1] += starts[i];
    }
    let mut fill = starts.clone();
    let mut entries = vec![0u32; starts[n] as usize];
    for (row, entry) in pairs {
        entries[fill[row as usize] as usize] = entry;
        fill[row as usize] += 1;
    }
    let (mut packed, mut packed_starts) = (Vec::with_capacity(entries.len()), vec![0u32; n + 1]);
    for v in 0..n {
        let row = &mut entries[starts[v] as usize..starts[v + 1] as usize];
        row.sort_unstable();
        let mut last = None;
        for &e in row.iter() {
            if last != Some(e) {
                packed.push(e);
                last = Some(e);
            }
        }
        packed_starts[v + 1] = packed.len() as u32;
    }
    (packed_starts, packed)
}

#[cfg(test)]
mod tests {
    use super::*;
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
}
