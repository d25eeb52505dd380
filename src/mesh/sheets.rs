//! Two-sided sheets (leaves, cloth): a face and its twin of the other winding on the same three vertices.
//!
//! Welded, the two sides share every vertex and their normals cancel. Here the second side gets vertices of its own,
//! so that either side is a surface with a normal.

/// Gives the faces of second sides copies of their vertices; adds for each copy the vertex copied. Which side is which
/// is decided face by face across edges, the lowest face of each sheet being on the first side.
pub(super) fn part_sides(faces: &mut [[u32; 3]], copied: &mut Vec<u32>, vertex_count: usize) {
    let twins = twins(faces);
    if twins.iter().all(|&t| t == NONE) {
        return;
    }
    let second = second_sides(faces, &twins);
    let mut copy = vec![NONE; vertex_count];
    for f in (0..faces.len()).filter(|&f| second[f]) {
        for v in &mut faces[f] {
            if copy[*v as usize] == NONE {
                copy[*v as usize] = (vertex_count + copied.len()) as u32;
                copied.push(*v);
            }
            *v = copy[*v as usize];
        }
    }
}

const NONE: u32 = u32::MAX;

/// For each face its twin: the first of the other winding on the same vertices with the first, and so on.
fn twins(faces: &[[u32; 3]]) -> Vec<u32> {
    let mut sorted: Vec<([u32; 3], bool, u32)> = Vec::with_capacity(faces.len());
    for (i, f) in faces.iter().enumerate() {
        let mut s = *f;
        s.sort_unstable();
        // Even if the corners are a rotation of the sorted ones.
        let even = (0..3).any(|k| [f[k], f[(k + 1) % 3], f[(k + 2) % 3]] == s);
        sorted.push((s, even, i as u32));
    }
    sorted.sort_unstable();
    let mut twins = vec![NONE; faces.len()];
    for same in sorted.chunk_by(|a, b| a.0 == b.0).filter(|c| c.len() > 1) {
        let (odd, even) = same.split_at(same.partition_point(|s| !s.1));
        for (a, b) in odd.iter().zip(even) {
            twins[a.2 as usize] = b.2;
            twins[b.2 as usize] = a.2;
        }
    }
    twins
}

fn second_sides(faces: &[[u32; 3]], twins: &[u32]) -> Vec<bool> {
    let mut directed: Vec<(u32, u32, u32)> = vec![];
    for (i, f) in faces.iter().enumerate().filter(|&(i, _)| twins[i] != NONE) {
        directed.extend((0..3).map(|k| (f[k], f[(k + 1) % 3], i as u32)));
    }
    directed.sort_unstable();
    let (mut second, mut known) = (vec![false; faces.len()], vec![false; faces.len()]);
    for start in 0..faces.len() as u32 {
        if twins[start as usize] == NONE || known[start as usize] {
            continue;
        }
        let mut first_side = vec![start];
        while let Some(f) = first_side.pop() {
            let (f, twin) = (f as usize, twins[f as usize]);
            if known[f] {
                continue;
            }
            (known[f], known[twin as usize], second[twin as usize]) = (true, true, true);
            for k in 0..3 {
                let (from, to) = (faces[f][(k + 1) % 3], faces[f][k]);
                let at = directed.partition_point(|d| (d.0, d.1) < (from, to));
                let across = directed[at..].iter().take_while(|d| (d.0, d.1) == (from, to)).map(|d| d.2);
                first_side.extend(across.filter(|&g| g != twin && !known[g as usize]));
            }
        }
    }
    second
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::check::census;
    use crate::mesh::{Topology, TriMesh, zoo};

    #[test]
    fn each_side_becomes_a_surface_however_the_faces_are_mixed() {
        let plane = zoo::plane(3, 2);
        let mut faces = vec![];
        for (i, f) in plane.faces.iter().enumerate() {
            let back = [f[2], f[1], f[0]];
            faces.extend(if i % 3 == 0 { [back, *f] } else { [*f, back] });
        }
        let mut copied = vec![];
        part_sides(&mut faces, &mut copied, plane.positions.len());
        assert_eq!(copied.len(), plane.positions.len());
        let mut positions = plane.positions.clone();
        positions.extend(copied.iter().map(|&v| plane.positions[v as usize]));
        let mesh = TriMesh { positions, faces };
        let c = census(&mesh, &Topology::new(&mesh));
        assert_eq!((c.components, c.euler, c.non_manifold_edges, c.flipped_edges), (2, 2, 0, 0));
        assert!(mesh.vertex_normals().iter().all(|n| n.z.abs() == 1.0));
    }

    #[test]
    fn one_sided_meshes_are_left_alone() {
        for (name, m) in zoo::all().into_iter().filter(|(name, _)| *name != "two-sided") {
            let (mut faces, mut copied) = (m.faces.clone(), vec![]);
            part_sides(&mut faces, &mut copied, m.positions.len());
            assert_eq!((faces, copied.len()), (m.faces, 0), "{name}");
        }
    }
}
