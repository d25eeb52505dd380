//! The artefact form of each type that steps exchange.

use std::collections::BTreeMap;

use super::{Artefact, Damaged, Reader, Writer, check};
use crate::bake::Atlas;
use crate::field::{Field, Laid, Singularity, Symmetry};
use crate::io::{Pixels, Samples};
use crate::mesh::{Part, Surface, SynthesisMesh, TriMesh};
use crate::numerics::vec::Vec3;
use crate::texture::{Flipbook, MapKind, MapSet, Texel, Texture, Uv};
use crate::uvset::{Blend, UvSets};

fn write_texture(t: &Texture, w: &mut Writer) {
    w.put([t.width(), t.height(), t.channels()]);
    w.slice(t.data());
}

fn read_texture(r: &mut Reader<'_>) -> Result<Texture, Damaged> {
    let [width, height, channels] = r.get::<[u32; 3]>()?;
    let data: Vec<f32> = r.slice()?;
    let len = u128::from(width) * u128::from(height) * u128::from(channels);
    check(len > 0 && len == data.len() as u128, "a texture's length is not its size")?;
    Ok(Texture::from_data(width, height, channels, data))
}

impl Artefact for MapSet {
    const TAG: [u8; 4] = *b"maps";

    fn write(&self, w: &mut Writer) {
        w.put(self.iter().count() as u32);
        for (kind, texture) in self.iter() {
            w.text(kind.name());
            write_texture(texture, w);
        }
    }

    fn read(r: &mut Reader<'_>) -> Result<Self, Damaged> {
        let mut maps: Vec<(MapKind, Texture)> = Vec::new();
        for _ in 0..r.get::<u32>()? {
            let name = r.text()?;
            let kind = MapKind::ALL.into_iter().find(|k| k.name() == name);
            let kind = kind.ok_or_else(|| Damaged(format!("no map is called {name}")))?;
            let t = read_texture(r)?;
            let fits = maps.first().is_none_or(|(_, f)| (f.width(), f.height()) == (t.width(), t.height()));
            check(fits && t.channels() == kind.channels(), "maps that do not fit each other")?;
            check(maps.iter().all(|(k, _)| *k != kind), "a map comes twice")?;
            maps.push((kind, t));
        }
        check(!maps.is_empty(), "a set without maps")?;
        Ok(MapSet::new(maps))
    }
}

impl Artefact for Flipbook {
    const TAG: [u8; 4] = *b"flip";

    fn write(&self, w: &mut Writer) {
        w.put(self.size()[2]);
        self.strip().write(w);
    }

    fn read(r: &mut Reader<'_>) -> Result<Self, Damaged> {
        let frames = r.get()?;
        let book = Flipbook::from_strip(MapSet::read(r)?, frames);
        book.ok_or_else(|| Damaged(format!("a strip that is not {frames} frames")))
    }
}

fn write_mesh(m: &TriMesh, w: &mut Writer) {
    w.slice(&m.positions);
    w.slice(&m.faces);
}

pub(crate) fn read_mesh(r: &mut Reader<'_>) -> Result<TriMesh, Damaged> {
    let mesh = TriMesh { positions: r.slice()?, faces: r.slice()? };
    let n = mesh.positions.len() as u64;
    check(mesh.faces.iter().flatten().all(|&v| u64::from(v) < n), "an index beyond the vertices")?;
    Ok(mesh)
}

impl Artefact for Surface {
    const TAG: [u8; 4] = *b"surf";

    fn write(&self, w: &mut Writer) {
        write_mesh(&self.mesh, w);
        w.slice(&self.corner_normals);
        w.put(u8::from(self.has_normals));
        w.put(self.corner_uvs.len() as u32);
        for set in &self.corner_uvs {
            w.slice(set);
        }
        w.put(self.parts.len() as u32);
        for Part { mesh, primitive, vertices, faces, to_world } in &self.parts {
            w.put([*mesh, *primitive, vertices.start, vertices.end, faces.start, faces.end]);
            w.put(*to_world);
        }
    }

    fn read(r: &mut Reader<'_>) -> Result<Self, Damaged> {
        let mesh = read_mesh(r)?;
        let corners = mesh.faces.len() * 3;
        let corner_normals: Vec<_> = r.slice()?;
        check(corner_normals.len() == corners, "one normal per corner")?;
        let has_normals = r.get::<u8>()? != 0;
        let mut corner_uvs = Vec::new();
        for _ in 0..r.get::<u32>()? {
            let set: Vec<_> = r.slice()?;
            check(set.len() == corners, "one UV per corner")?;
            corner_uvs.push(set);
        }
        let mut parts = Vec::new();
        for _ in 0..r.get::<u32>()? {
            let [m, primitive, v0, v1, f0, f1] = r.get::<[u32; 6]>()?;
            let fits = v0 <= v1 && v1 as usize <= mesh.positions.len() && f0 <= f1 && f1 as usize <= mesh.faces.len();
            check(fits, "a part beyond the mesh")?;
            parts.push(Part { mesh: m, primitive, vertices: v0..v1, faces: f0..f1, to_world: r.get()? });
        }
        Ok(Surface { mesh, corner_normals, has_normals, corner_uvs, parts })
    }
}

/// Points of a parent that 16 bits tell apart.
const FEW: usize = 1 << 16;

impl Artefact for SynthesisMesh {
    const TAG: [u8; 4] = *b"msh2";

    fn write(&self, w: &mut Writer) {
        write_mesh(&self.mesh, w);
        w.slice(&self.parent);
        // Faces are cut alike: their corners are few different points of their parents.
        let mut known: BTreeMap<[u32; 3], u32> = BTreeMap::new();
        let mut index = |point: [f32; 3]| {
            let new = known.len() as u32;
            *known.entry(point.map(f32::to_bits)).or_insert(new)
        };
        let corners: Vec<[u32; 3]> = self.parent_bary.iter().map(|face| face.map(&mut index)).collect();
        let mut points = vec![[0; 3]; known.len()];
        known.iter().for_each(|(point, i)| points[*i as usize] = *point);
        w.slice(&points);
        match points.len() <= FEW {
            true => w.slice(&corners.iter().map(|face| face.map(|i| i as u16)).collect::<Vec<_>>()),
            false => w.slice(&corners),
        }
    }

    fn read(r: &mut Reader<'_>) -> Result<Self, Damaged> {
        let (mesh, parent): (_, Vec<u32>) = (read_mesh(r)?, r.slice()?);
        let points: Vec<[f32; 3]> = r.slice()?;
        let corners: Vec<[u32; 3]> = match points.len() <= FEW {
            true => r.slice()?.into_iter().map(|face: [u16; 3]| face.map(u32::from)).collect(),
            false => r.slice()?,
        };
        check([parent.len(), corners.len()] == [mesh.faces.len(); 2], "one parent per face")?;
        check(corners.as_flattened().iter().all(|&i| (i as usize) < points.len()), "corners at known points")?;
        let parent_bary = corners.iter().map(|face| face.map(|i| points[i as usize])).collect();
        Ok(SynthesisMesh { mesh, parent, parent_bary })
    }
}

/// Writes where a field turns: faces with their indices, and points.
pub(crate) fn write_turning(turning: &[(u32, f64)], singularities: &[Singularity], w: &mut Writer) {
    w.pairs(turning.iter().copied());
    w.put(singularities.len() as u64);
    for Singularity { at, index, face } in singularities {
        w.put(*at);
        w.put(*index);
        w.put(*face);
    }
}

/// Faces with their indices, and the points where a field turns.
type Turning = (Vec<(u32, f64)>, Vec<Singularity>);

/// What [`write_turning`] wrote.
pub(crate) fn read_turning(r: &mut Reader<'_>) -> Result<Turning, Damaged> {
    let turning = r.pairs()?.collect();
    let mut singularities = Vec::new();
    for _ in 0..r.get::<u64>()? {
        singularities.push(Singularity { at: r.get()?, index: r.get()?, face: r.get()? });
    }
    Ok((turning, singularities))
}

impl Artefact for Laid {
    const TAG: [u8; 4] = *b"fld3";

    fn write(&self, w: &mut Writer) {
        w.slice(&self.field.up);
        w.slice(&self.field.scale);
        w.slice(&self.normals);
        w.put(match self.symmetry {
            Symmetry::One => 1u8,
            Symmetry::Two => 2,
            Symmetry::Four => 4,
            Symmetry::Isotropic => 0,
        });
        w.put(u8::from(self.euler.is_some()));
        w.put(self.euler.unwrap_or(0));
        write_turning(&self.turning, &self.singularities, w);
    }

    fn read(r: &mut Reader<'_>) -> Result<Self, Damaged> {
        let field = Field { up: r.slice()?, scale: r.slice()? };
        let normals: Vec<Vec3> = r.slice()?;
        check([field.scale.len(), normals.len()] == [field.up.len(); 2], "one scale and one normal per vertex")?;
        let symmetry = match r.get::<u8>()? {
            0 => Symmetry::Isotropic,
            1 => Symmetry::One,
            2 => Symmetry::Two,
            4 => Symmetry::Four,
            n => return Err(Damaged(format!("a field of {n} directions"))),
        };
        let (is_closed, euler) = (r.get::<u8>()? != 0, r.get()?);
        let (turning, singularities) = read_turning(r)?;
        Ok(Laid { field, normals, symmetry, turning, singularities, euler: is_closed.then_some(euler) })
    }
}

impl Artefact for Atlas {
    const TAG: [u8; 4] = *b"atl1";

    fn write(&self, w: &mut Writer) {
        w.put([self.width, self.height, self.chart_count]);
        w.put(self.texels_per_unit);
        w.slice(&self.corner_uv);
        w.slice(&self.chart);
    }

    fn read(r: &mut Reader<'_>) -> Result<Self, Damaged> {
        let [width, height, chart_count] = r.get::<[u32; 3]>()?;
        let texels_per_unit = r.get()?;
        let (corner_uv, chart): (Vec<_>, Vec<_>) = (r.slice()?, r.slice()?);
        check(corner_uv.len() == 3 * chart.len() && width > 0 && height > 0, "three corners per face")?;
        Ok(Atlas { width, height, corner_uv, chart, chart_count, texels_per_unit })
    }
}

/// How many vertices, faces and parts the surface has that these bytes are.
pub(crate) fn surface_counts(bytes: &[u8]) -> Result<[usize; 3], Damaged> {
    let mut r = Surface::open(bytes)?;
    let (vertices, faces) = (r.pass::<Vec3>()?, r.pass::<[u32; 3]>()?);
    r.pass::<Vec3>()?;
    r.get::<u8>()?;
    for _ in 0..r.get::<u32>()? {
        r.pass::<Uv>()?;
    }
    Ok([vertices, faces, r.get::<u32>()? as usize])
}

/// How a face of [`UvSets`] is stored. Most faces lie in one patch: their sets repeat the first, and all weight is its.
#[derive(Clone, Copy)]
struct Kind {
    /// Sets from this on repeat the first and weigh nothing, 1..=4.
    distinct: usize,
    /// The first set has all weight at all corners, and weights are left out.
    plain: bool,
}

impl Kind {
    fn of(sets: &UvSets, face: usize) -> Self {
        let corners = 3 * face..3 * face + 3;
        let set = |s: usize| sets.sets.get(s).map(|s| bytemuck::cast_slice::<_, u32>(&s[corners.clone()]));
        let weights = &sets.weights[corners.clone()];
        let repeats =
            |s: usize| set(s).is_none_or(|c| Some(c) == set(0)) && weights.iter().all(|w| w[s].to_bits() == 0);
        let distinct = 1 + (1..4).rposition(|s| !repeats(s)).map_or(0, |s| s + 1);
        Kind { distinct, plain: distinct == 1 && weights.iter().all(|w| w[0] == 1.0) }
    }

    fn code(self) -> u8 {
        self.distinct as u8 | if self.plain { 8 } else { 0 }
    }

    fn from_code(code: u8) -> Option<Self> {
        let kind = Kind { distinct: usize::from(code & 7), plain: code & 8 != 0 };
        ((1..=4).contains(&kind.distinct) && kind.code() == code && (kind.distinct == 1 || !kind.plain)).then_some(kind)
    }

    /// Weights stored per corner.
    fn weights(self) -> usize {
        if self.plain { 0 } else { self.distinct }
    }
}

/// Size of the exemplar, blend, sharpness, number of sets.
fn read_sets_head(r: &mut Reader<'_>) -> Result<([u32; 2], Blend, u32, usize), Damaged> {
    let exemplar_size = r.get()?;
    let blend = match r.get::<u8>()? {
        0 => Blend::Linear,
        1 => Blend::Variance,
        2 => Blend::Nearest,
        b => return Err(Damaged(format!("blend {b}"))),
    };
    let [sharpness, n] = r.get::<[u32; 2]>()?;
    check((1..=4).contains(&n) && sharpness > 0, "one to four sets")?;
    Ok((exemplar_size, blend, sharpness, n as usize))
}

/// How many sets the [`UvSets`] have that come next.
pub(crate) fn set_count(r: &mut Reader<'_>) -> Result<usize, Damaged> {
    Ok(read_sets_head(r)?.3)
}

impl Artefact for UvSets {
    const TAG: [u8; 4] = *b"uvs3";

    fn write(&self, w: &mut Writer) {
        w.put(self.exemplar_size);
        w.put(match self.blend {
            Blend::Linear => 0u8,
            Blend::Variance => 1,
            Blend::Nearest => 2,
        });
        let n = self.sets.len();
        w.put([self.sharpness, n as u32]);
        debug_assert_eq!(self.weights.len() % 3, 0, "three corners per face");
        let kinds: Vec<Kind> = (0..self.face_count()).map(|f| Kind::of(self, f)).collect();
        let places: usize = kinds.iter().map(|k| 3 * k.distinct.min(n)).sum();
        let weights: usize = kinds.iter().map(|k| 3 * k.weights()).sum();
        w.reserve(kinds.len() + 8 * places + 4 * weights + 4 * self.material.len() + 32);
        w.slice(&kinds.iter().map(|k| k.code()).collect::<Vec<_>>());
        w.put(places as u64);
        for (f, kind) in kinds.iter().enumerate() {
            self.sets.iter().take(kind.distinct).for_each(|s| w.part(&s[3 * f..3 * f + 3]));
        }
        w.put(weights as u64);
        for (f, kind) in kinds.iter().enumerate() {
            self.weights[3 * f..3 * f + 3].iter().for_each(|c| w.part(&c[..kind.weights()]));
        }
        w.slice(&self.material);
    }

    fn read(r: &mut Reader<'_>) -> Result<Self, Damaged> {
        let (exemplar_size, blend, sharpness, n) = read_sets_head(r)?;
        let codes: Vec<u8> = r.slice()?;
        let (places, rest): (Vec<Texel>, Vec<f32>) = (r.slice()?, r.slice()?);
        let (mut places, mut rest) = (&places[..], &rest[..]);
        let mut sets: Vec<Vec<Texel>> = (0..n).map(|_| Vec::with_capacity(3 * codes.len())).collect();
        let mut weights = Vec::with_capacity(3 * codes.len());
        for code in codes {
            let kind = Kind::from_code(code).ok_or_else(|| Damaged(format!("a face of kind {code}")))?;
            let (own, left) = places
                .split_at_checked(3 * kind.distinct.min(n))
                .ok_or_else(|| Damaged("a face without coordinates".into()))?;
            places = left;
            let (own, _) = own.as_chunks::<3>();
            for (s, set) in sets.iter_mut().enumerate() {
                set.extend_from_slice(own.get(s).unwrap_or(&own[0]));
            }
            let (own, left) =
                rest.split_at_checked(3 * kind.weights()).ok_or_else(|| Damaged("a corner without weights".into()))?;
            rest = left;
            let padded = |w: &[f32]| std::array::from_fn(|s| w.get(s).map_or(0.0, |w| *w));
            match kind.plain {
                true => weights.extend_from_slice(&[[1.0, 0.0, 0.0, 0.0]; 3]),
                false => weights.extend(own.chunks_exact(kind.weights()).map(padded)),
            }
        }
        check(places.is_empty() && rest.is_empty(), "coordinates without a face")?;
        let material: Vec<f32> = r.slice()?;
        check(material.is_empty() || material.len() == weights.len(), "one material per corner")?;
        Ok(UvSets { exemplar_size, sets, weights, blend, sharpness, material })
    }
}

impl Artefact for Pixels {
    const TAG: [u8; 4] = *b"pix1";

    fn write(&self, w: &mut Writer) {
        w.put([self.width, self.height, self.channels]);
        match &self.samples {
            Samples::U8(s) => {
                w.put(0u8);
                w.slice(s);
            }
            Samples::U16(s) => {
                w.put(1u8);
                w.slice(s);
            }
            Samples::F32(s) => {
                w.put(2u8);
                w.slice(s);
            }
        }
    }

    fn read(r: &mut Reader<'_>) -> Result<Self, Damaged> {
        let [width, height, channels] = r.get::<[u32; 3]>()?;
        let (len, samples) = match r.get::<u8>()? {
            0 => r.slice().map(|s| (s.len(), Samples::U8(s)))?,
            1 => r.slice().map(|s| (s.len(), Samples::U16(s)))?,
            2 => r.slice().map(|s| (s.len(), Samples::F32(s)))?,
            t => return Err(Damaged(format!("sample type {t}"))),
        };
        check(len as u128 == u128::from(width) * u128::from(height) * u128::from(channels), "samples of another size")?;
        Ok(Pixels { width, height, channels, samples })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::vec::vec3;
    use crate::texture::texel;

    fn sets() -> UvSets {
        UvSets {
            exemplar_size: [8, 9],
            sets: vec![vec![texel(1.0, 2.0); 3]; 2],
            weights: vec![[0.5, 0.5, 0.0, 0.0]; 3],
            blend: Blend::Variance,
            sharpness: 2,
            material: vec![0.0, 0.25, 1.0],
        }
    }

    #[test]
    fn values_survive_the_round_trip() {
        let s = sets();
        assert_eq!(UvSets::from_bytes(&s.to_bytes()), Ok(s));
        let maps = MapSet::new(vec![
            (MapKind::Height, Texture::from_data(2, 1, 1, vec![0.25, 1.0])),
            (MapKind::BaseColor, Texture::new(2, 1, 3)),
        ]);
        assert_eq!(MapSet::from_bytes(&maps.to_bytes()), Ok(maps));
        let mesh = TriMesh { positions: vec![vec3(0.0, 0.0, 1.0); 3], faces: vec![[0, 1, 2]; 3] };
        let m = SynthesisMesh { mesh, parent: vec![0, 0, 1], parent_bary: vec![[[1.0, 0.0, 0.0]; 3]; 3] };
        assert_eq!(SynthesisMesh::from_bytes(&m.to_bytes()), Ok(m));
        // So many points that 16 bits do not tell them apart.
        let n = 70_000;
        let mesh = TriMesh { positions: vec![Vec3::ZERO; 3], faces: vec![[0, 1, 2]; n] };
        let point = |i: usize| [i as f32 / n as f32, -0.0, 1.0];
        let bary = |f: usize| [point(f), point(f / 2), point(0)];
        let m = SynthesisMesh { mesh, parent: vec![0; n], parent_bary: (0..n).map(bary).collect() };
        assert_eq!(SynthesisMesh::from_bytes(&m.to_bytes()), Ok(m));
        let found = Singularity { at: vec3(1.0, 2.0, 3.0), index: -0.5, face: 7 };
        let field = Field { up: vec![vec3(0.0, 1.0, 0.0)], scale: vec![2.0] };
        let normals = vec![vec3(0.0, 0.0, 1.0)];
        let (turning, singularities) = (vec![(7, -0.5)], vec![found]);
        let l = Laid { field, normals, symmetry: Symmetry::Two, turning, singularities, euler: Some(2) };
        assert_eq!(Laid::from_bytes(&l.to_bytes()), Ok(l));
        let p = Pixels { width: 1, height: 2, channels: 1, samples: Samples::U16(vec![1, 65535]) };
        assert_eq!(Pixels::from_bytes(&p.to_bytes()), Ok(p));
    }

    #[test]
    fn damage_is_an_error_wherever_it_is() {
        let bytes = sets().to_bytes();
        for cut in 0..bytes.len() {
            assert!(UvSets::from_bytes(&bytes[..cut]).is_err(), "cut at {cut}");
        }
        assert!(Laid::from_bytes(&bytes).is_err(), "another type");
        let mut long = bytes.clone();
        long[21..29].copy_from_slice(&u64::MAX.to_le_bytes()); // the length of the first set
        assert!(UvSets::from_bytes(&long).is_err(), "an absurd length must not be allocated");
    }

    /// Faces of every kind: one patch, sets that differ, weight on a set that repeats the first, a sign that counts.
    #[test]
    fn faces_of_all_kinds_survive() {
        let at = |x: f32| vec![texel(x, 1.0), texel(x, 2.0), texel(x + 1.0, 1.0)];
        let (one, two) = ([1.0, 0.0, 0.0, 0.0], [0.25, 0.75, 0.0, 0.0]);
        let whole = UvSets {
            exemplar_size: [8, 9],
            sets: vec![
                [at(1.0), at(2.0), at(3.0), at(4.0), at(0.0)].concat(),
                [at(1.0), at(5.0), at(3.0), at(4.0), at(-0.0)].concat(),
                [at(1.0), at(2.0), at(6.0), at(4.0), at(0.0)].concat(),
            ],
            weights: [[one; 3], [two; 3], [one; 3], [one, two, one], [one; 3]].concat(),
            blend: Blend::Linear,
            sharpness: 1,
            material: vec![],
        };
        let bytes = whole.to_bytes();
        let back = UvSets::from_bytes(&bytes).unwrap();
        assert_eq!(back, whole);
        assert!(back.sets[1][12].x.is_sign_negative());
        // 3 x (1 + 2 + 3 + 2 + 2) places and 3 x (0 + 2 + 3 + 2 + 2) weights.
        assert_eq!(bytes.len(), 8 + 8 + 1 + 8 + (8 + 5) + (8 + 8 * 30) + (8 + 4 * 27) + 8);
        for at in 0..bytes.len() {
            let mut damaged = bytes.clone();
            damaged[at] ^= 0x10;
            // Whatever it is now, it has as many weights as coordinates.
            if let Ok(sets) = UvSets::from_bytes(&damaged) {
                assert!(sets.sets.iter().all(|s| s.len() == sets.weights.len()));
            }
            assert!(UvSets::from_bytes(&bytes[..at]).is_err());
        }
    }
}
