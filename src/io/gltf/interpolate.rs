//! Vertex attributes inside triangles of the input.
//!
//! Source: linear interpolation by barycentric coordinates; for skins the weighted influences of the corners merged,
//! the greatest kept.
//! In: accessors, and for each new vertex the vertices that it lies between. Out: packed data.
//! Reads as: a vertex of the input comes out bit by bit. Integers that are no numbers but names (joints, custom ids)
//! are taken from the nearest corner. Positions become floats, everything else keeps its type.

use serde_json::Value;

use super::accessor::{Accessor, Component, Format};
use super::document::Document;
use super::primitive::Stream;
use super::refs::index;
use super::validate::Semantic;

/// A point between up to three vertices of a part, these ascending and distinct, their weights positive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Mix {
    vertices: [u32; 3],
    weights: [f32; 3],
    len: u8,
}

impl Mix {
    /// From the corners of a triangle. Corners without weight do not count.
    pub(super) fn new(corners: [u32; 3], bary: [f32; 3]) -> Self {
        // The vertices themselves are most of them, on fine meshes all.
        if let Some(k) = (0..3).find(|k| bary[*k] > 0.0 && bary[(k + 1) % 3] <= 0.0 && bary[(k + 2) % 3] <= 0.0) {
            return Mix { vertices: [corners[k], 0, 0], weights: [1.0, 0.0, 0.0], len: 1 };
        }
        let mut pairs = [0, 1, 2].map(|i| (corners[i], bary[i]));
        pairs.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
        let mut mix = Mix { vertices: [0; 3], weights: [0.0; 3], len: 0 };
        for (v, w) in pairs.into_iter().filter(|p| p.1 > 0.0) {
            let last = usize::from(mix.len);
            if last > 0 && mix.vertices[last - 1] == v {
                mix.weights[last - 1] += w;
            } else {
                (mix.vertices[last], mix.weights[last]) = (v, w);
                mix.len += 1;
            }
        }
        if mix.len == 1 {
            mix.weights[0] = 1.0;
        }
        mix
    }

    /// The vertex, if the point is one.
    pub(super) fn single(&self) -> Option<u32> {
        (self.len < 2).then_some(self.vertices[0])
    }

    /// Vertices with weights that sum to one.
    fn parts(&self) -> impl Iterator<Item = (u32, f64)> + Clone {
        let weights = self.weights.map(f64::from);
        let total = weights[0] + weights[1] + weights[2];
        (0..usize::from(self.len)).map(move |i| (self.vertices[i], weights[i] / total))
    }

    /// The vertex of greatest weight, the first of equals.
    fn nearest(&self) -> u32 {
        let mut best = 0;
        for i in 1..usize::from(self.len) {
            if self.weights[i] > self.weights[best] {
                best = i;
            }
        }
        self.vertices[best]
    }
}

/// All positions of an accessor.
pub(super) fn positions(accessor: &Accessor, packed: &[u8]) -> Vec<[f64; 3]> {
    (0..accessor.count).map(|v| std::array::from_fn(|c| accessor.format.get(packed, v, c))).collect()
}

/// The position at a mix.
pub(super) fn position(positions: &[[f64; 3]], mix: &Mix) -> [f32; 3] {
    std::array::from_fn(|c| mix.parts().map(|(v, w)| positions[v as usize][c] * w).sum::<f64>() as f32)
}

/// An attribute at all new vertices; `delta` for morph targets.
pub(super) fn attribute(doc: &Document, a: usize, semantic: Option<Semantic>, delta: bool, mixes: &[Mix]) -> Stream {
    let accessor = &doc.accessors[a];
    let f = accessor.format;
    let packed = accessor.packed(&doc.buffers);
    if semantic == Some(Semantic::Position) && mixes.iter().any(|m| m.single().is_none()) {
        let all = positions(accessor, &packed);
        let bytes = mixes.iter().flat_map(|m| position(&all, m)).flat_map(f32::to_le_bytes).collect();
        return Stream::new(Some(a), Component::F32, "VEC3", bytes);
    }
    let is_name = f.component != Component::F32 && (!f.normalized && matches!(semantic, Some(Semantic::Custom) | None));
    let discrete =
        is_name || matches!(semantic, Some(Semantic::Joints(_))) || (f.is_matrix() && f.component != Component::F32);
    let mut bytes = Vec::with_capacity(mixes.len() * f.size());
    for mix in mixes {
        let copied = if discrete { Some(mix.nearest()) } else { mix.single() };
        if let Some(v) = copied {
            bytes.extend_from_slice(&packed[v as usize * f.size()..(v as usize + 1) * f.size()]);
            continue;
        }
        let raw = |v: u32, c: usize| f.component.read(&packed[v as usize * f.size() + c * f.component.size()..]);
        let mut values: Vec<f64> = (0..f.width()).map(|c| mix.parts().map(|(v, w)| raw(v, c) * w).sum()).collect();
        if semantic == Some(Semantic::Normal) && !delta {
            renormalise(&mut values, f, &packed, mix.nearest());
        }
        values.into_iter().for_each(|v| f.component.write(v, &mut bytes));
    }
    Stream::New { like: Some(a), format: f, bytes }
}

/// Unit length in the units of the format; where opposite normals cancel, that of the nearest vertex.
fn renormalise(values: &mut [f64], f: Format, packed: &[u8], nearest: u32) {
    let length = values.iter().map(|v| v * v).sum::<f64>().sqrt();
    for (c, v) in values.iter_mut().enumerate() {
        let at = nearest as usize * f.size() + c * f.component.size();
        *v = if length.is_normal() { *v / length * f.component.unit() } else { f.component.read(&packed[at..]) };
    }
}

/// Joints and weights of all sets at all new vertices; empty if the primitive has no skin or its sets do not match.
pub(super) fn skin(doc: &Document, attributes: &Value, mixes: &[Mix]) -> Vec<(String, Stream)> {
    let set = |k: u32| {
        let a = |name: &str| index(attributes, &format!("{name}_{k}"));
        Some((a("JOINTS")?, a("WEIGHTS")?))
    };
    let sets: Vec<(usize, usize)> = (0..).map_while(set).collect();
    let read = |a: usize| (&doc.accessors[a], doc.accessors[a].packed(&doc.buffers));
    let data: Vec<_> = sets.iter().map(|&(j, w)| (read(j), read(w))).collect();
    let mut out: Vec<(Vec<u8>, Vec<u8>)> = vec![Default::default(); sets.len()];
    for mix in mixes {
        let merged = if mix.single().is_some() { Vec::new() } else { influences(&data, mix) };
        for (k, ((joints, packed_joints), (weights, packed_weights))) in data.iter().enumerate() {
            let (to_joints, to_weights) = &mut out[k];
            if let Some(v) = mix.single().map(|v| v as usize) {
                let (js, ws) = (joints.format.size(), weights.format.size());
                to_joints.extend_from_slice(&packed_joints[v * js..(v + 1) * js]);
                to_weights.extend_from_slice(&packed_weights[v * ws..(v + 1) * ws]);
                continue;
            }
            let component = weights.format.component;
            for i in 4 * k..4 * k + 4 {
                let (joint, weight) = merged.get(i).copied().unwrap_or((0, 0.0));
                joints.format.component.write(f64::from(joint), to_joints);
                // Integers were shared out already; floats are the weights themselves.
                component.write(weight, to_weights);
            }
        }
    }
    let named = sets.iter().zip(out).enumerate().flat_map(|(k, (&(j, w), (joints, weights)))| {
        let stream = |a: usize, bytes| Stream::New { like: Some(a), format: doc.accessors[a].format, bytes };
        [(format!("JOINTS_{k}"), stream(j, joints)), (format!("WEIGHTS_{k}"), stream(w, weights))]
    });
    named.collect()
}

type Packed<'a> = (&'a Accessor, Vec<u8>);

/// The greatest influences at a mix, at most four per set; their weights sum to one, or to what integers call one.
fn influences(data: &[(Packed, Packed)], mix: &Mix) -> Vec<(u32, f64)> {
    let mut all: Vec<(u32, f64)> = Vec::new();
    for (v, share) in mix.parts() {
        for ((joints, packed_joints), (weights, packed_weights)) in data {
            for c in 0..4 {
                let weight = weights.format.get(packed_weights, v as usize, c) * share;
                if weight > 0.0 {
                    all.push((joints.format.get(packed_joints, v as usize, c) as u32, weight));
                }
            }
        }
    }
    all.sort_by(|a, b| a.0.cmp(&b.0).then(b.1.total_cmp(&a.1)));
    let mut merged: Vec<(u32, f64)> = Vec::new();
    for (joint, weight) in all {
        match merged.last_mut() {
            Some(last) if last.0 == joint => last.1 += weight,
            _ => merged.push((joint, weight)),
        }
    }
    merged.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    merged.truncate(4 * data.len());
    let total: f64 = merged.iter().map(|m| m.1).sum();
    let component = data.first().map_or(Component::F32, |d| d.1.0.format.component);
    if component == Component::F32 {
        merged.iter_mut().for_each(|m| m.1 /= total);
    } else {
        let mut shares = vec![0; merged.len()];
        share_out(&mut merged.iter().map(|m| m.1).collect::<Vec<_>>(), component.unit() as u32, &mut shares);
        merged.iter_mut().zip(shares).for_each(|(m, s)| m.1 = f64::from(s));
    }
    merged
}

/// Integers in proportion to weights with a sum of exactly `total`: rounded down, then one more for the greatest
/// remainders, the first of equals. All to the first if no weight is positive.
pub(super) fn shares<const N: usize>(weights: [f64; N], total: u32) -> [u32; N] {
    let mut out = [0; N];
    let mut weights = weights;
    share_out(&mut weights, total, &mut out);
    out
}

/// [`shares`] of any number of weights, into as many integers; weights become remainders.
fn share_out(weights: &mut [f64], total: u32, out: &mut [u32]) {
    let sum: f64 = weights.iter().map(|w| w.max(0.0)).sum();
    if sum <= 0.0 || weights.first() == Some(&sum) {
        out.fill(0);
        out.iter_mut().take(1).for_each(|first| *first = total);
        return;
    }
    let mut missing = total;
    for (weight, share) in weights.iter_mut().zip(&mut *out) {
        let exact = weight.max(0.0) / sum * f64::from(total);
        *share = exact.floor() as u32;
        *weight = exact - exact.floor();
        missing -= missing.min(*share);
    }
    // Rounding leaves fewer than one each.
    for _ in 0..missing {
        let greatest = (0..weights.len()).fold(0, |a, b| if weights[b] > weights[a] { b } else { a });
        out[greatest] += 1;
        weights[greatest] -= 1.0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_sum_exactly() {
        assert_eq!(shares([1.0, 1.0, 1.0, 0.0], 255), [85, 85, 85, 0]);
        assert_eq!(shares([1.0, 1.0], 255), [128, 127]);
        assert_eq!(shares([0.0, 0.0, 0.0], 255), [255, 0, 0]);
        assert_eq!(shares([0.0, 0.3, 0.0, 0.0], 65535), [0, 65535, 0, 0]);
        // 1.4, 1.4, 1.4, 2.8 of 7: one more for the last, one for the first of equals.
        assert_eq!(shares([1.0, 1.0, 1.0, 2.0], 7), [2, 1, 1, 3]);
        for i in 0..200 {
            let w = [f64::from(i), 13.7, f64::from(i % 7) * 3.3, 0.01];
            assert_eq!(shares(w, 65535).iter().sum::<u32>(), 65535);
        }
    }

    #[test]
    fn mixes_are_the_same_from_both_sides_of_an_edge() {
        let a = Mix::new([7, 3, 9], [0.25, 0.75, 0.0]);
        let b = Mix::new([3, 7, 2], [0.75, 0.25, 0.0]);
        assert_eq!(a, b);
        assert_eq!(Mix::new([7, 3, 9], [0.0, 0.0, 1.0]).single(), Some(9));
        assert_eq!(Mix::new([5, 5, 1], [0.5, 0.5, 0.0]).single(), Some(5));
        assert_eq!(a.nearest(), 3);
    }
}
