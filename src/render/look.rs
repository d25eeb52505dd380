//! How a surface looks at a point: through finished atlas maps, or straight through its UV sets.

use std::collections::BTreeMap;

use crate::bake::{Atlas, FaceSets, Pyramid, Sampled};
use crate::mesh::{SynthesisMesh, TriMesh};
use crate::numerics::det;
use crate::texture::{MapKind, MapSet, Texel, Texture, texel};
use crate::uvset::UvSets;

type V3 = [f32; 3];

/// A point's material, linear.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Appearance {
    /// Base colour.
    pub color: V3,
    /// Unit normal in the world.
    pub normal: V3,
    /// 0..1.
    pub roughness: f32,
    /// 0..1.
    pub metallic: f32,
    /// 0 dark to 1 open.
    pub occlusion: f32,
    /// Light given off.
    pub emissive: V3,
}

impl Default for Appearance {
    fn default() -> Self {
        let normal = [0.0, 0.0, 1.0];
        Appearance { color: [0.8; 3], normal, roughness: 1.0, metallic: 0.0, occlusion: 1.0, emissive: [0.0; 3] }
    }
}

/// A point of a face as the rasteriser meets it.
#[derive(Clone, Copy, Debug)]
pub struct Hit {
    /// The face.
    pub face: usize,
    /// Barycentric coordinates in it.
    pub bary: V3,
    /// Change of the second and third coordinate per pixel, across and down.
    pub grad: [[f32; 2]; 2],
    /// Unit shading normal in the world, turned to the viewer.
    pub normal: V3,
    /// Whether the front is seen; behind, the whole frame of the relief is turned round, as engines do.
    pub front: bool,
}

/// How the triangles of a scene look.
pub trait Look: Sync {
    /// The material at a point.
    fn appearance(&self, hit: &Hit) -> Appearance;
    /// Whether there is anything at a point: false where the opacity is below a half.
    fn is_there(&self, _face: usize, _bary: V3) -> bool {
        true
    }
    /// Position in the exemplar as shares of its sides, for pictures of patches; `None` if not known.
    fn source(&self, _face: usize, _bary: V3) -> Option<[f32; 2]> {
        None
    }
    /// Texture coordinates in texels and the side of a checker's field, for pictures of UVs; by default one field.
    fn checker(&self, _face: usize, _bary: V3) -> (Texel, f32) {
        (texel(0.0, 0.0), 1.0)
    }
}

/// The look of a synthesis mesh through its UV sets.
pub struct SetsLook<'a> {
    sets: &'a UvSets,
    faces: Vec<FaceSets>,
    maps: BTreeMap<MapKind, Sampled>,
}

impl<'a> SetsLook<'a> {
    /// Faces are those of the synthesis mesh.
    pub fn new(mesh: &TriMesh, sets: &'a UvSets, maps: &MapSet) -> Self {
        Self::of(mesh, sets, maps.iter().map(|(kind, map)| (kind, Sampled::new(kind, map))).collect())
    }

    /// Through a tile: its layers from m = 0 to m = 1, all with the same maps, at least one.
    pub fn tile(mesh: &TriMesh, sets: &'a UvSets, layers: &[MapSet]) -> Self {
        let of = |kind| layers.iter().filter_map(|layer| layer.get(kind)).collect::<Vec<_>>();
        let kinds = layers.iter().take(1).flat_map(|first| first.iter());
        Self::of(mesh, sets, kinds.map(|(kind, _)| (kind, Sampled::tile(kind, &of(kind)))).collect())
    }

    fn of(mesh: &TriMesh, sets: &'a UvSets, maps: BTreeMap<MapKind, Sampled>) -> Self {
        let faces = (0..mesh.faces.len()).map(|f| FaceSets::new(sets, f).with_frames(mesh, f)).collect();
        SetsLook { sets, faces, maps }
    }

    fn number(&self, kind: MapKind, hit: &Hit, lods: &[f32; 4]) -> Option<f32> {
        match self.maps.get(&kind)? {
            Sampled::One(p) => Some(self.faces[hit.face].value(p, hit.bary, lods)[0]),
            Sampled::Three(_) => None,
        }
    }

    fn color(&self, kind: MapKind, hit: &Hit, lods: &[f32; 4]) -> Option<V3> {
        match self.maps.get(&kind)? {
            Sampled::Three(p) => {
                let [r, g, b, _] = self.faces[hit.face].value(p, hit.bary, lods);
                Some([r, g, b])
            }
            Sampled::One(_) => None,
        }
    }

    /// The set of greatest weight at a point (the first of equals).
    fn strongest(&self, face: usize, bary: V3) -> usize {
        let w = self.sets.weights_at(face, bary);
        (1..self.sets.sets.len()).fold(0, |best, s| if w[s] > w[best] { s } else { best })
    }
}

impl Look for SetsLook<'_> {
    fn appearance(&self, hit: &Hit) -> Appearance {
        let face = &self.faces[hit.face];
        let lods = FaceSets::lods(face.stretch(hit.grad));
        let plain = Appearance::default();
        let normal = match self.maps.get(&MapKind::Normal) {
            Some(Sampled::Three(p)) => {
                let turn = |n: V3| if hit.front { n } else { n.map(|x| -x) };
                turn(face.normal(p, hit.bary, &lods, turn(hit.normal)))
            }
            _ => hit.normal,
        };
        Appearance {
            color: self.color(MapKind::BaseColor, hit, &lods).unwrap_or(plain.color),
            normal,
            roughness: self.number(MapKind::Roughness, hit, &lods).unwrap_or(plain.roughness),
            metallic: self.number(MapKind::Metallic, hit, &lods).unwrap_or(plain.metallic),
            occlusion: self.number(MapKind::Occlusion, hit, &lods).unwrap_or(plain.occlusion),
            emissive: self.color(MapKind::Emissive, hit, &lods).unwrap_or(plain.emissive),
        }
    }

    fn is_there(&self, face: usize, bary: V3) -> bool {
        match self.maps.get(&MapKind::Opacity) {
            Some(Sampled::One(p)) => self.faces[face].value(p, bary, &[0.0; 4])[0] >= 0.5,
            _ => true,
        }
    }

    fn source(&self, face: usize, bary: V3) -> Option<[f32; 2]> {
        let at = self.sets.at(self.strongest(face, bary), face, bary);
        let [w, h] = self.sets.exemplar_size.map(|s| s as f32);
        let share = [at.x / w, at.y / h];
        // A tile goes on at the other side.
        Some(if self.sets.material.is_empty() { share } else { share.map(|s| s - s.floor()) })
    }

    fn checker(&self, face: usize, bary: V3) -> (Texel, f32) {
        (self.sets.at(self.strongest(face, bary), face, bary), 16.0)
    }
}

/// Finished maps of an atlas, linear, as an engine would read them.
#[derive(Default)]
pub struct AtlasMaps {
    /// RGB or RGBA.
    pub base_color: Option<Texture>,
    /// Tangent space, -1..1.
    pub normal: Option<Texture>,
    /// Occlusion, roughness, metallic.
    pub orm: Option<Texture>,
    /// RGB.
    pub emissive: Option<Texture>,
}

/// The look of a surface through its atlas.
pub struct AtlasLook<'a> {
    atlas: &'a Atlas,
    tangents: &'a [[f32; 4]],
    corner_normals: Vec<V3>,
    has_alpha: bool,
    base_color: Option<Pyramid<4>>,
    normal: Option<Pyramid<4>>,
    orm: Option<Pyramid<4>>,
    emissive: Option<Pyramid<4>>,
}

impl<'a> AtlasLook<'a> {
    /// Faces are those of the surface; tangents and normals are its corners'.
    pub fn new(
        atlas: &'a Atlas,
        tangents: &'a [[f32; 4]],
        corner_normals: &[crate::numerics::vec::Vec3],
        maps: &AtlasMaps,
    ) -> Self {
        let pyramid = |t: &Option<Texture>| t.as_ref().map(Pyramid::new);
        AtlasLook {
            atlas,
            tangents,
            corner_normals: corner_normals.iter().map(|n| n.to_f32()).collect(),
            has_alpha: maps.base_color.as_ref().is_some_and(|t| t.channels() == 4),
            base_color: pyramid(&maps.base_color),
            normal: pyramid(&maps.normal),
            orm: pyramid(&maps.orm),
            emissive: pyramid(&maps.emissive),
        }
    }

    /// Position on the page in texels.
    fn position(&self, face: usize, bary: V3) -> Texel {
        let c: [_; 3] = std::array::from_fn(|i| self.atlas.corner_uv[3 * face + i]);
        let u = c[0].u * bary[0] + c[1].u * bary[1] + c[2].u * bary[2];
        let v = c[0].v * bary[0] + c[1].v * bary[1] + c[2].v * bary[2];
        texel(u * self.atlas.width as f32, v * self.atlas.height as f32)
    }

    /// Mip level for a footprint, as GPUs choose it: by the longer of the two steps.
    fn lod(&self, hit: &Hit) -> f32 {
        let origin = self.position(hit.face, [1.0, 0.0, 0.0]);
        let e: [_; 2] = [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|b| {
            let p = self.position(hit.face, b);
            [p.x - origin.x, p.y - origin.y]
        });
        let step = |axis: usize| {
            let d: [f32; 2] = std::array::from_fn(|k| e[0][k] * hit.grad[0][axis] + e[1][k] * hit.grad[1][axis]);
            d[0] * d[0] + d[1] * d[1]
        };
        let longest = step(0).max(step(1)).sqrt();
        if longest > 1.0 && longest.is_finite() { det::log2(f64::from(longest)) as f32 } else { 0.0 }
    }

    /// A tangent-space normal in the world, decoded as engines do: x T + y B + z N, T and N interpolated.
    fn to_world(&self, hit: &Hit, v: [f32; 4]) -> V3 {
        let mixed = |get: &dyn Fn(usize) -> V3| -> V3 {
            std::array::from_fn(|k| (0..3).map(|i| get(3 * hit.face + i)[k] * hit.bary[i]).sum())
        };
        let n = mixed(&|c| self.corner_normals[c]);
        let t = mixed(&|c| [self.tangents[c][0], self.tangents[c][1], self.tangents[c][2]]);
        let w = self.tangents[3 * hit.face][3];
        let b = [n[1] * t[2] - n[2] * t[1], n[2] * t[0] - n[0] * t[2], n[0] * t[1] - n[1] * t[0]].map(|x| x * w);
        let out: V3 = std::array::from_fn(|k| t[k] * v[0] + b[k] * v[1] + n[k] * v[2]);
        if hit.front { out } else { out.map(|x| -x) }
    }
}

impl Look for AtlasLook<'_> {
    fn appearance(&self, hit: &Hit) -> Appearance {
        let at = self.position(hit.face, hit.bary);
        let lod = self.lod(hit);
        let plain = Appearance::default();
        let get = |p: &Option<Pyramid<4>>| p.as_ref().map(|p| p.sample(at, lod));
        let rgb = |v: [f32; 4]| [v[0], v[1], v[2]];
        let orm = get(&self.orm).unwrap_or([plain.occlusion, plain.roughness, plain.metallic, 0.0]);
        Appearance {
            color: get(&self.base_color).map_or(plain.color, rgb),
            normal: get(&self.normal).map_or(hit.normal, |v| self.to_world(hit, v)),
            occlusion: orm[0],
            roughness: orm[1],
            metallic: orm[2],
            emissive: get(&self.emissive).map_or(plain.emissive, rgb),
        }
    }

    fn is_there(&self, face: usize, bary: V3) -> bool {
        match &self.base_color {
            Some(p) if self.has_alpha => p.sample(self.position(face, bary), 0.0)[3] >= 0.5,
            _ => true,
        }
    }

    fn checker(&self, face: usize, bary: V3) -> (Texel, f32) {
        (self.position(face, bary), self.atlas.width as f32 / 32.0)
    }
}

/// Shading normals of a synthesis mesh's corners: linear over the parent face, so that subdivision does not show.
pub fn synthesis_normals(
    synthesis: &SynthesisMesh,
    corner_normals: &[crate::numerics::vec::Vec3],
) -> Vec<crate::numerics::vec::Vec3> {
    let corner = |f: usize, i: usize| {
        let parent = 3 * synthesis.parent[f] as usize;
        let b = synthesis.parent_bary[f][i].map(f64::from);
        let n = (0..3).fold(crate::numerics::vec::Vec3::ZERO, |s, k| s + corner_normals[parent + k] * b[k]);
        n.normalized().unwrap_or(corner_normals[parent])
    };
    (0..synthesis.parent.len()).flat_map(|f| (0..3).map(move |i| (f, i))).map(|(f, i)| corner(f, i)).collect()
}
