//! Texture coordinates of triangle corners from the patches of sites.
//!
//! Source: \[ZG03\] 4.3 and 4.4, with patches that are blended over many triangles instead of one ring (4.4, last sentence;
//! `super::sites`). A face takes the patches that weigh something at one of its corners. Patches that continue each
//! other are one: their coordinates at a vertex are the mean by their weights there, so that a patch is smooth where
//! the offsets of a curved surface do not quite close. Of the rest the three of greatest weight remain. A patch's place at a
//! vertex and its weight there are the same for all faces around: sets agree along every edge, but for what was left out.
//! Unaware of: how patches were found.

use super::sites::Sites;
use crate::numerics::par;
use crate::synth::Error;
use crate::texture::{Texel, texel};
use crate::uvset::{Blend, UvSets};

/// Sets of a face: as many as \[ZG03\] 4.4 has.
pub(super) const MAX_SETS: usize = 3;

/// Patches this near each other at all corners, in texels, continue each other: what does not close around one
/// ring of sites on a moderately curved surface. Real jumps are longer.
const CONTINUES: f32 = 1.0;

/// Corner coordinates and weights (not sharpened) of all faces from the addresses of the sites. Fails if their number is
/// wrong.
pub fn layered_sets(
    faces: &[[u32; 3]],
    sites: &Sites,
    address: &[Texel],
    exemplar_size: [u32; 2],
    blend: Blend,
) -> Result<UvSets, Error> {
    if address.len() != sites.vertices.len() {
        return Err(Error::Count { what: "addresses of sites", found: address.len(), expected: sites.vertices.len() });
    }
    let count = if blend == Blend::Nearest { 1 } else { MAX_SETS };
    let (sets, weights) = of_faces(faces.len(), count, CONTINUES, |layers, f| {
        let [a, b, c] = faces[f].map(|v| sites.reaching(v));
        let (mut reaching, mut known) = ([a.0, b.0, c.0], [a.1, b.1, c.1]);
        loop {
            // Each corner's sites are in order: the lowest of the three next.
            let next = reaching.map(|r| r.first().map_or(u32::MAX, |r| r.site));
            let site = next[0].min(next[1]).min(next[2]);
            if site == u32::MAX {
                break layers.finish(count);
            }
            let a = address[site as usize];
            let mut patch = Patch::new(site);
            for k in 0..3 {
                let from = if next[k] == site { &mut reaching[k] } else { &mut known[k] };
                while let Some((r, rest)) = from.split_first().filter(|(r, _)| r.site <= site) {
                    if r.site == site {
                        patch.place(k, texel(a.x + r.offset[0], a.y + r.offset[1]), r.weight);
                    }
                    *from = rest;
                }
            }
            layers.push(patch);
        }
    });
    Ok(UvSets { exemplar_size, sets, weights, blend, sharpness: 1, material: vec![] })
}

/// Coordinates in each of `count` sets, and weights, of the corners of so many faces. `one` pushes the patches of a face and
/// finishes them; those within `tolerance` of each other are one.
pub(super) fn of_faces(
    faces: usize,
    count: usize,
    tolerance: f32,
    one: impl Fn(&mut Layers, usize) -> FaceSets + Sync,
) -> (Vec<Vec<Texel>>, Vec<[f32; 4]>) {
    const CHUNK: usize = 3 * 4096;
    let mut sets: Vec<Vec<Texel>> = (0..count).map(|_| bytemuck::zeroed_vec(3 * faces)).collect();
    let mut weights: Vec<[f32; 4]> = bytemuck::zeroed_vec(3 * faces);
    let mut places: Vec<_> = sets.iter_mut().map(|s| s.chunks_mut(CHUNK)).collect();
    let part =
        |(i, weights)| (i * CHUNK / 3, weights, places.iter_mut().filter_map(Iterator::next).collect::<Vec<_>>());
    let parts: Vec<(usize, &mut [[f32; 4]], _)> = weights.chunks_mut(CHUNK).enumerate().map(part).collect();
    par::for_each(parts, |(first, weights, mut places)| {
        let mut layers = Layers::new(tolerance);
        for (i, weights) in weights.as_chunks_mut::<3>().0.iter_mut().enumerate() {
            layers.patches.clear();
            let face = one(&mut layers, first + i);
            *weights = face.weights;
            for (places, set) in places.iter_mut().zip(&face.sets) {
                places[3 * i..3 * i + 3].copy_from_slice(set);
            }
        }
    });
    (sets, weights)
}

/// Coordinates of each set at the corners of a face, and each corner's weights.
pub(super) struct FaceSets {
    pub sets: [[Texel; 3]; MAX_SETS],
    weights: [[f32; 4]; 3],
}

/// One patch over a face, or several that continue each other. Two lanes a corner and two that stay zero: loops over all
/// eight take few instructions.
#[derive(Clone)]
pub(super) struct Patch {
    id: u32,
    /// The first one's place at each corner; NaN where it is not known.
    at: [f32; 8],
    /// Places at each corner summed by weight.
    sum: [f32; 8],
    weight: [f32; 4],
}

impl Patch {
    /// A patch that is nowhere yet. Of equal weight the lower number comes first.
    pub fn new(id: u32) -> Self {
        let mut at = [f32::NAN; 8];
        at[6..].fill(0.0);
        Patch { id, at, sum: [0.0; 8], weight: [0.0; 4] }
    }

    /// Says where it is at corner `k` and what it weighs there.
    pub fn place(&mut self, k: usize, at: Texel, weight: f32) {
        (self.at[2 * k], self.at[2 * k + 1], self.weight[k]) = (at.x, at.y, weight);
        (self.sum[2 * k], self.sum[2 * k + 1]) = (at.x * weight, at.y * weight);
    }

    fn total(&self) -> f32 {
        self.weight[0] + self.weight[1] + self.weight[2]
    }

    /// Less, the more it weighs; of equal weight the lower number first. Weights are not negative, so that their bits
    /// are in their order.
    fn rank(&self) -> u64 {
        u64::from(!self.total().to_bits()) << 32 | u64::from(self.id)
    }

    /// Whether `other` is within `tolerance` of it at all corners that both know.
    fn continues(&self, other: &Patch, tolerance: f32) -> bool {
        let mut far = false;
        for i in 0..8 {
            // What is not known is NaN, and not far.
            far |= (self.at[i] - other.at[i]).abs() >= tolerance;
        }
        !far
    }

    fn take_in(&mut self, other: &Patch) {
        for i in 0..8 {
            self.sum[i] += other.sum[i];
            self.at[i] = if self.at[i].is_nan() { other.at[i] } else { self.at[i] };
        }
        for k in 0..4 {
            self.weight[k] += other.weight[k];
        }
    }

    /// The place at each corner.
    fn corners(&self) -> [Texel; 3] {
        let at = |k: usize| texel(self.at[2 * k], self.at[2 * k + 1]);
        std::array::from_fn(|k| {
            let w = self.weight[k];
            if w > 0.0 {
                texel(self.sum[2 * k] / w, self.sum[2 * k + 1] / w)
            } else if at(k).x.is_nan() {
                (0..3).map(at).find(|a| !a.x.is_nan()).unwrap_or_default()
            } else {
                at(k)
            }
        })
    }
}

/// The patches of one face; memory used again from face to face.
pub(super) struct Layers {
    tolerance: f32,
    patches: Vec<Patch>,
    merged: Vec<Patch>,
    /// Patches by [`Patch::rank`], and their places in a list.
    order: Vec<(u64, u32)>,
}

impl Layers {
    /// Patches within `tolerance` texels of each other at all corners will be one.
    fn new(tolerance: f32) -> Self {
        Layers { tolerance, patches: vec![], merged: vec![], order: vec![] }
    }

    /// Takes in a patch, if it weighs anything.
    pub fn push(&mut self, patch: Patch) {
        if patch.total() > 0.0 {
            self.patches.push(patch);
        }
    }

    /// Joins patches that continue each other; the heaviest `count` of the results are the sets, the first of them in
    /// front, the others by number, so that neighbouring faces mostly have them in the same order. Sets without a patch
    /// repeat the first.
    pub fn finish(&mut self, count: usize) -> FaceSets {
        fn by_rank(order: &mut Vec<(u64, u32)>, patches: &[Patch]) {
            order.clear();
            order.extend(patches.iter().enumerate().map(|(i, p)| (p.rank(), i as u32)));
            order.sort_unstable();
        }
        by_rank(&mut self.order, &self.patches);
        self.merged.clear();
        for &(_, i) in &self.order {
            let patch = &self.patches[i as usize];
            match self.merged.iter_mut().find(|m| m.continues(patch, self.tolerance)) {
                Some(whole) => whole.take_in(patch),
                None => self.merged.push(patch.clone()),
            }
        }
        by_rank(&mut self.order, &self.merged);
        self.order.truncate(count);
        let merged = &self.merged;
        if let Some((_, others)) = self.order.split_first_mut() {
            others.sort_unstable_by_key(|r| merged[r.1 as usize].id);
        }
        let chosen = |s: usize| self.order.get(s).map(|r| &merged[r.1 as usize]);
        let first = chosen(0).map_or([Texel::default(); 3], Patch::corners);
        let mut out = FaceSets { sets: [[Texel::default(); 3]; MAX_SETS], weights: [[0.0; 4]; 3] };
        for (s, set) in out.sets.iter_mut().enumerate().take(count) {
            *set = if s == 0 { first } else { chosen(s).map_or(first, Patch::corners) };
        }
        for (k, weights) in out.weights.iter_mut().enumerate() {
            let sum: f32 = (0..count).map_while(chosen).map(|p| p.weight[k]).sum();
            match sum > 0.0 {
                true => (0..count).map_while(chosen).zip(weights).for_each(|(p, w)| *w = p.weight[k] / sum),
                false => weights[0] = 1.0,
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Topology;
    use crate::numerics::rng::Key;
    use crate::synth::testing::{flat_offsets, grid};

    /// Sites of a fine plane, and addresses: in one piece, or each anywhere.
    fn bench(scattered: bool) -> (crate::mesh::TriMesh, Sites, Vec<Texel>) {
        let mesh = grid(50, 40, 0.3);
        let t = Topology::new(&mesh);
        let sites = Sites::new(&t, &flat_offsets(&mesh, &t, 0.8), 5.0, false).unwrap();
        let key = Key::new(4);
        let address = sites.vertices.iter().map(|v| {
            let p = mesh.positions[*v as usize];
            let draws = key.with(u64::from(*v));
            let by = if scattered { [draws.unit(0) * 900.0, draws.unit(1) * 900.0] } else { [0.0; 2] };
            texel((p.x * 0.8 + 20.0 + by[0]) as f32, (p.y * 0.8 + 20.0 + by[1]) as f32)
        });
        let address = address.collect();
        (mesh, sites, address)
    }

    #[test]
    fn one_patch_is_one_set_laid_out_linearly() {
        let (mesh, sites, address) = bench(false);
        let sets = layered_sets(&mesh.faces, &sites, &address, [90, 90], Blend::Linear).unwrap();
        for (c, v) in mesh.faces.as_flattened().iter().enumerate() {
            let p = mesh.positions[*v as usize];
            assert_eq!(sets.weights[c], [1.0, 0.0, 0.0, 0.0]);
            for set in &sets.sets {
                assert!((f64::from(set[c].x) - p.x * 0.8 - 20.0).abs() < 1e-3);
                assert!((f64::from(set[c].y) - p.y * 0.8 - 20.0).abs() < 1e-3);
            }
        }
    }

    /// What a corner shows, whatever the order of its sets: places and weights.
    fn shown(sets: &UvSets, corner: usize) -> Vec<(i64, i64, f32)> {
        let of = |s: usize| {
            let (at, w) = (sets.sets[s][corner], sets.weights[corner][s]);
            ((at.x * 100.0).round() as i64, (at.y * 100.0).round() as i64, w)
        };
        let mut shown: Vec<_> = (0..sets.sets.len()).map(of).filter(|s| s.2 > 0.05).collect();
        shown.sort_unstable_by(|a, b| b.2.total_cmp(&a.2).then((a.0, a.1).cmp(&(b.0, b.1))));
        shown
    }

    #[test]
    fn faces_agree_at_their_corners() {
        let (mesh, sites, address) = bench(true);
        let sets = layered_sets(&mesh.faces, &sites, &address, [999, 999], Blend::Linear).unwrap();
        let mut at: Vec<Vec<usize>> = vec![vec![]; mesh.positions.len()];
        mesh.faces.as_flattened().iter().enumerate().for_each(|(c, v)| at[*v as usize].push(c));
        let (mut same, mut all) = (0, 0);
        for corners in &at {
            for c in corners {
                let sum: f32 = sets.weights[*c].iter().sum();
                assert!((sum - 1.0).abs() < 1e-5);
                all += 1;
                let (a, b) = (shown(&sets, corners[0]), shown(&sets, *c));
                let near =
                    |a: &(i64, i64, f32), b: &(i64, i64, f32)| (a.0, a.1) == (b.0, b.1) && (a.2 - b.2).abs() < 0.1;
                same += usize::from(a.len() == b.len() && a.iter().zip(&b).all(|(a, b)| near(a, b)));
            }
        }
        // With every site a patch of its own, more than three meet here and there.
        assert!(same * 100 > all * 75, "{same} of {all}");
    }

    #[test]
    fn without_a_blend_there_is_one_set() {
        let (mesh, sites, address) = bench(true);
        let sets = layered_sets(&mesh.faces, &sites, &address, [999, 999], Blend::Nearest).unwrap();
        assert_eq!(sets.sets.len(), 1);
        assert!(sets.weights.iter().all(|w| *w == [1.0, 0.0, 0.0, 0.0]));
        let few = layered_sets(&mesh.faces, &sites, &address[1..], [9, 9], Blend::Linear);
        let (found, expected) = (address.len() - 1, address.len());
        assert_eq!(few, Err(Error::Count { what: "addresses of sites", found, expected }));
    }
}
