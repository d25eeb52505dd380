//! How a mesh hangs together: components, borders, places where it is not a manifold.
//!
//! In: any triangle mesh, its topology. Unaware of: textures.

use super::{Topology, TriMesh};

/// Counts for `kiln inspect`. Vertices without a face are counted as loose and nowhere else.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Census {
    /// Vertices with at least one face.
    pub vertices: usize,
    /// Distinct edges.
    pub edges: usize,
    /// Faces.
    pub faces: usize,
    /// Vertices without a face.
    pub loose_vertices: usize,
    /// Connected components (over edges).
    pub components: usize,
    /// Edges with one face.
    pub boundary_edges: usize,
    /// Edges with three or more faces.
    pub non_manifold_edges: usize,
    /// Edges with two faces that run along them in the same direction: the winding flips there.
    pub flipped_edges: usize,
    /// Vertices whose faces form more than one fan.
    pub non_manifold_vertices: usize,
    /// Vertices - edges + faces.
    pub euler: i64,
}

/// Counts what there is.
pub fn census(mesh: &TriMesh, topo: &Topology) -> Census {
    let loose = (0..topo.vertex_count() as u32).filter(|&v| topo.faces(v).is_empty()).count();
    let vertices = topo.vertex_count() - loose;
    let edges = topo.half_edge_count() / 2;
    let (labels, count) = components(topo);
    let loose_components = {
        let mut has_face = vec![false; count];
        labels.iter().enumerate().for_each(|(v, &l)| has_face[l as usize] |= !topo.faces(v as u32).is_empty());
        has_face.iter().filter(|&&h| !h).count()
    };
    let mut census = Census {
        vertices,
        edges,
        faces: mesh.faces.len(),
        loose_vertices: loose,
        components: count - loose_components,
        non_manifold_vertices: (0..topo.vertex_count() as u32).filter(|&v| fans(mesh, topo, v) > 1).count(),
        euler: vertices as i64 - edges as i64 + mesh.faces.len() as i64,
        ..Census::default()
    };
    // Faces of each half-edge in its own direction.
    let mut along = vec![0u32; topo.half_edge_count()];
    for f in &mesh.faces {
        for k in 0..3 {
            if let Some(h) = topo.find(f[k], f[(k + 1) % 3]) {
                along[h] += 1;
            }
        }
    }
    for v in 0..topo.vertex_count() as u32 {
        for h in topo.half_edges(v).filter(|&h| v < topo.target(h)) {
            let back = topo.find(topo.target(h), v).map_or(0, |b| along[b]);
            match (along[h], back) {
                (1, 0) | (0, 1) => census.boundary_edges += 1,
                (2, 0) | (0, 2) => census.flipped_edges += 1,
                (1, 1) => {}
                _ => census.non_manifold_edges += 1,
            }
        }
    }
    census
}

/// The component of each vertex, numbered by their lowest vertices, and their number. A vertex without an edge is a
/// component.
pub fn components(topo: &Topology) -> (Vec<u32>, usize) {
    let mut label = vec![u32::MAX; topo.vertex_count()];
    let (mut count, mut stack) = (0, vec![]);
    for v in 0..topo.vertex_count() as u32 {
        if label[v as usize] != u32::MAX {
            continue;
        }
        label[v as usize] = count;
        stack.push(v);
        while let Some(v) = stack.pop() {
            for &n in topo.neighbours(v) {
                if label[n as usize] == u32::MAX {
                    label[n as usize] = count;
                    stack.push(n);
                }
            }
        }
        count += 1;
    }
    (label, count as usize)
}

/// Groups of faces at a vertex that hang together by edges at that vertex.
pub(crate) fn fans(mesh: &TriMesh, topo: &Topology, v: u32) -> usize {
    let faces = topo.faces(v);
    let mut ends: Vec<(u32, usize)> = vec![];
    for (i, &f) in faces.iter().enumerate() {
        ends.extend(mesh.faces[f as usize].iter().filter(|&&o| o != v).map(|&o| (o, i)));
    }
    ends.sort_unstable();
    let mut root: Vec<usize> = (0..faces.len()).collect();
    let find = |root: &[usize], mut i: usize| {
        while root[i] != i {
            i = root[i];
        }
        i
    };
    let mut groups = faces.len();
    for pair in ends.windows(2).filter(|w| w[0].0 == w[1].0) {
        let (a, b) = (find(&root, pair[0].1), find(&root, pair[1].1));
        if a != b {
            root[a.max(b)] = a.min(b);
            groups -= 1;
        }
    }
    groups
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::zoo;

    fn of(mesh: &TriMesh) -> Census {
        census(mesh, &Topology::new(mesh))
    }

    #[test]
    fn the_zoo_is_what_it_says() {
        let c = of(&zoo::tetrahedron());
        assert_eq!((c.vertices, c.edges, c.faces, c.euler, c.components, c.boundary_edges), (4, 6, 4, 2, 1, 0));
        assert_eq!((of(&zoo::fan()).boundary_edges, of(&zoo::fan()).euler), (6, 1));
        let c = of(&zoo::hourglass());
        assert_eq!((c.non_manifold_vertices, c.non_manifold_edges, c.boundary_edges, c.components), (1, 0, 12, 1));
        let c = of(&zoo::moebius(12));
        assert_eq!((c.flipped_edges, c.euler, c.boundary_edges, c.non_manifold_edges), (1, 0, 24, 0));
        let c = of(&zoo::torus(8, 5));
        assert_eq!((c.euler, c.boundary_edges, c.flipped_edges), (0, 0, 0));
        assert_eq!(of(&zoo::book()).non_manifold_edges, 1);
        assert_eq!(of(&zoo::two_components()).components, 2);
        assert_eq!(of(&zoo::two_components()).euler, 4);
        for m in [zoo::cube(), zoo::icosphere(2)] {
            let c = of(&m);
            assert_eq!((c.euler, c.boundary_edges, c.flipped_edges, c.non_manifold_vertices), (2, 0, 0, 0));
            let outward = (0..m.faces.len()).all(|f| m.area_vector(f).dot(m.corners(f)[0]) > 0.0);
            assert!(outward, "wound counter-clockwise from outside");
        }
    }

    #[test]
    fn loose_vertices_count_as_nothing_else() {
        let mut m = zoo::plane(1, 1);
        m.positions.push(crate::numerics::vec::vec3(9., 9., 9.));
        let c = of(&m);
        assert_eq!((c.vertices, c.loose_vertices, c.components, c.euler), (4, 1, 1, 1));
    }
}
