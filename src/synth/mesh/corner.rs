//! Texture coordinates of triangle corners from addresses of vertices.
//!
//! Source: \[ZG03\] 4.3 and 4.4. A jump over an edge puts its two ends into different places of the exemplar, so a
//! triangle's corners take the address of one base vertex and the offsets of the edges leaving it. Three sets, one per
//! base, are blended with a linear ramp: weight one at the base corner, zero at the others. Along an edge the set based
//! opposite has no weight and the other two are the same on both sides: the blend has no seams.
//! Unaware of: how addresses were found.

use super::walk::shifted;
use crate::mesh::Topology;
use crate::numerics::par;
use crate::numerics::rng::Key;
use crate::numerics::vec::Vec2;
use crate::synth::Error;
use crate::texture::Texel;
use crate::uvset::{Blend, UvSets};

/// Which vertices the sets are based at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Base {
    /// Three sets: set i is based at corner i (\[ZG03\] 4.4).
    Three,
    /// One set, based at a random corner of each face (\[ZG03\] 4.3).
    Random {
        /// Seed of the choice.
        seed: u64,
    },
}

/// Corner coordinates and weights of all faces.
///
/// `offsets` as for the walk; `address` of every vertex, valid for its room, so that all corners lie within the outer
/// texel centres. A corner that repeats its face's base vertex gets the base's address. Weights are not sharpened. Fails if a
/// count is wrong.
pub fn corner_sets(
    faces: &[[u32; 3]],
    topology: &Topology,
    offsets: &[Vec2],
    address: &[Texel],
    exemplar_size: [u32; 2],
    base: Base,
    blend: Blend,
) -> Result<UvSets, Error> {
    if offsets.len() != topology.half_edge_count() {
        return Err(Error::OffsetCount { found: offsets.len(), expected: topology.half_edge_count() });
    }
    if address.len() != topology.vertex_count() {
        let (found, expected) = (address.len(), topology.vertex_count());
        return Err(Error::Count { what: "addresses of vertices", found, expected });
    }
    let corners = |face: [u32; 3], i: usize| {
        let from = face[i];
        let a = address[from as usize];
        face.map(|to| topology.find(from, to).map_or(a, |h| shifted(a, offsets[h])))
    };
    let (sets, weights) = match base {
        Base::Three => {
            let based = |i: usize| par::map(faces.len(), |f| corners(faces[f], i)).into_flattened();
            let one_hot = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
            (vec![based(0), based(1), based(2)], vec![one_hot; faces.len()].into_flattened())
        }
        Base::Random { seed } => {
            let key = Key::new(seed).with_str("base corner");
            let set = par::map(faces.len(), |f| corners(faces[f], key.below(f as u64, 3) as usize)).into_flattened();
            (vec![set], vec![[1.0, 0.0, 0.0, 0.0]; 3 * faces.len()])
        }
    };
    Ok(UvSets { exemplar_size, sets, weights, blend, sharpness: 1, material: vec![] })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::vec::vec2;
    use crate::synth::testing::{flat_offsets, grid};
    use crate::texture::texel;

    #[test]
    fn a_triangle_is_laid_out_from_each_corner() {
        let mut mesh = grid(2, 2, 0.0);
        mesh.faces = vec![[0, 1, 2]];
        let t = Topology::new(&mesh);
        // Vertices at (0, 0), (1, 0), (0, 1); ten texels per unit; each at an address of its own.
        let offsets = flat_offsets(&mesh, &t, 10.0);
        assert_eq!(offsets[t.find(0, 1).unwrap()], vec2(10.0, 0.0));
        let address = [texel(20.0, 20.0), texel(50.0, 20.0), texel(70.0, 70.0), Texel::default()];
        let uv = corner_sets(&mesh.faces, &t, &offsets, &address, [90, 90], Base::Three, Blend::Linear).unwrap();
        assert_eq!(uv.sets[0], [texel(20.0, 20.0), texel(30.0, 20.0), texel(20.0, 30.0)]);
        assert_eq!(uv.sets[1], [texel(40.0, 20.0), texel(50.0, 20.0), texel(40.0, 30.0)]);
        assert_eq!(uv.sets[2], [texel(70.0, 60.0), texel(80.0, 60.0), texel(70.0, 70.0)]);
        assert_eq!(uv.weights, [[1., 0., 0., 0.], [0., 1., 0., 0.], [0., 0., 1., 0.]]);
        let base = Base::Random { seed: 5 };
        let one = corner_sets(&mesh.faces, &t, &offsets, &address, [90, 90], base, Blend::Linear).unwrap();
        assert_eq!(one.sets.len(), 1);
        assert!(uv.sets.contains(&one.sets[0]));
        assert_eq!(one.weights, [[1., 0., 0., 0.]; 3]);
    }

    #[test]
    fn wrong_counts_are_errors() {
        let mesh = grid(2, 2, 0.0);
        let t = Topology::new(&mesh);
        let offsets = flat_offsets(&mesh, &t, 1.0);
        let few = corner_sets(&mesh.faces, &t, &offsets, &[], [9, 9], Base::Three, Blend::Linear);
        assert_eq!(few, Err(Error::Count { what: "addresses of vertices", found: 0, expected: 4 }));
        let none = corner_sets(&mesh.faces, &t, &[], &[Texel::default(); 4], [9, 9], Base::Three, Blend::Linear);
        assert_eq!(none, Err(Error::OffsetCount { found: 0, expected: 10 }));
    }
}
