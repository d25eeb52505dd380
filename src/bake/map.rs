//! One map of the atlas: shaded texel by texel, dilated, stitched.
//!
//! In: what each texel shows ([`Coverage`]), corner coordinates, one map of the sample. Out: the map on the atlas.
//! An atlas texel that covers more than one texel of the sample takes four taps of a quarter of its area, so moderate
//! minification stays sharp and strong minification goes to mip levels: no aliasing either way.
//!
//! Normals are blended as vectors in the world and written in the basis that engines decode with: `n = x T + y B + z N`,
//! T and N interpolated and not normalised, `B = w cross(N, T)` (MikkTSpace). The gutter holds what the neighbouring
//! chart has there, turned into the own basis as if the surface were unfolded along the border.

use super::atlas::Atlas;
use super::border::Turn;
use super::coverage::{Coverage, NO_FACE, STRIP, clamp_bary};
use super::dilate::dilate;
use super::error::Error;
use super::lie::Lie;
use super::shade::{FaceSets, Filter, Pyramid, Sampled, V3, cross, dot, mix, tangent_normal, unit_or};
use super::stitch::stitch;
use super::texel_sources::{Layer, Nodes, TexelSources};
use crate::mesh::{Surface, SynthesisMesh};
use crate::numerics::par;
use crate::texture::{MapKind, Texture};
use crate::uvset::UvSets;

/// Everything that the maps of one bake share.
#[derive(Clone, Copy)]
pub struct Inputs<'a> {
    /// What is textured.
    pub surface: &'a Surface,
    /// What the corner coordinates belong to.
    pub synthesis: &'a SynthesisMesh,
    /// Where it lies on the page.
    pub atlas: &'a Atlas,
    /// What each texel shows: made from the three above.
    pub coverage: &'a Coverage,
    /// Tangents of the surface's corners in the atlas (see [`tangents`](super::tangents)).
    pub tangents: &'a [[f32; 4]],
    /// Corner coordinates on the synthesis mesh.
    pub sets: &'a UvSets,
    /// Places chosen texel by texel, which go before those of the sets.
    pub sources: Option<&'a TexelSources>,
    /// How the sample is interpolated between its texels.
    pub filter: Filter,
}

impl<'a> Inputs<'a> {
    /// The chosen places ready to be looked up, if there are any.
    fn nodes(&self) -> Result<Option<Nodes<'a>>, Error> {
        let Inputs { coverage, synthesis, atlas, sets, .. } = *self;
        self.sources.map(|s| Nodes::new(Lie { coverage, synthesis, atlas, sets }, s)).transpose()
    }
}

/// Sample texels per atlas texel from which four taps are taken.
const TAP_FROM: f32 = 1.25;

/// Bakes one map of the sample onto the atlas; every texel of the page is filled.
///
/// Colours come out linear, normals in the atlas' tangent space (y up), the rest as in the sample.
/// Panics if `map` has another number of channels than its kind.
pub fn bake_map(inputs: &Inputs, kind: MapKind, map: &Texture) -> Result<Texture, Error> {
    check(inputs, map)?;
    baked(inputs, kind, Sampled::new(kind, map).filtered(inputs.filter))
}

/// Bakes one map of a tile, layer by layer from m = 0 to m = 1. Everything else as [`bake_map`]; the sets must have a
/// material coordinate.
pub fn bake_tile(inputs: &Inputs, kind: MapKind, layers: &[&Texture]) -> Result<Texture, Error> {
    let mismatch = |what, found, expected| Err(Error::Mismatch { what, found, expected });
    if layers.is_empty() {
        return mismatch("layers", 0, 1);
    }
    for layer in layers {
        check(inputs, layer)?;
    }
    let (found, expected) = (inputs.sets.material.len(), 3 * inputs.sets.face_count());
    if found != expected {
        return mismatch("corners with a material", found, expected);
    }
    baked(inputs, kind, Sampled::tile(kind, layers).filtered(inputs.filter))
}

fn baked(inputs: &Inputs, kind: MapKind, map: Sampled) -> Result<Texture, Error> {
    let nodes = inputs.nodes()?;
    let nodes = nodes.as_ref();
    let mut out = match map {
        Sampled::One(p) => shade::<1, 1>(inputs, nodes, kind, |_, s, b| s.sets.value(&p, b, &s.lods)),
        Sampled::Three(p) if kind == MapKind::Normal => {
            shade::<4, 3>(inputs, nodes, kind, |f, s, b| f.normal(&p, s, b))
        }
        Sampled::Three(p) => shade::<4, 3>(inputs, nodes, kind, |_, s, b| s.sets.value(&p, b, &s.lods)),
    };
    dilate(inputs.coverage, &mut out);
    // After the rest is filled: coarse levels look beyond the gutter.
    stitch(inputs.coverage.stitches(), kind, &mut out);
    Ok(out)
}

fn check(inputs: &Inputs, map: &Texture) -> Result<(), Error> {
    let same = |what, found: usize, expected: usize| match found == expected {
        true => Ok(()),
        false => Err(Error::Mismatch { what, found, expected }),
    };
    let (corners, faces) = (3 * inputs.surface.mesh.faces.len(), inputs.synthesis.mesh.faces.len());
    same("faces with texture coordinates", inputs.sets.face_count(), faces)?;
    for set in &inputs.sets.sets {
        same("corners in a set", set.len(), 3 * faces)?;
    }
    if !(1..=4).contains(&inputs.sets.sets.len()) {
        return Err(Error::Mismatch { what: "sets of 1..=4", found: inputs.sets.sets.len(), expected: 1 });
    }
    same("corner normals", inputs.surface.corner_normals.len(), corners)?;
    same("tangents", inputs.tangents.len(), corners)?;
    same("faces under the coverage", inputs.coverage.face_count(), faces)?;
    same("texels per row of the coverage", inputs.coverage.width() as usize, inputs.atlas.width as usize)?;
    same("rows of the coverage", inputs.coverage.height() as usize, inputs.atlas.height as usize)?;
    same("texels per row of the sample", map.width() as usize, inputs.sets.exemplar_size[0] as usize)?;
    same("rows of the sample", map.height() as usize, inputs.sets.exemplar_size[1] as usize)
}

/// Sets of a face, or what goes before them at a texel, and the mip level of each.
struct Shown {
    sets: FaceSets,
    lods: [f32; 4],
}

/// One face of the synthesis mesh, ready for its texels.
struct Face {
    shown: Shown,
    /// Where the taps lie from the texel's centre, as steps of barycentric coordinates; one or four.
    taps: [[f32; 3]; 4],
    tap_count: usize,
    /// Shading normals and tangents at its corners, linear over the face, and the bitangent's sign.
    normals: [V3; 3],
    tangents: [V3; 3],
    sign: f32,
}

impl Face {
    fn new(inputs: &Inputs, face: u32, kind: MapKind) -> Self {
        let f = face as usize;
        let mut sets = FaceSets::new(inputs.sets, f);
        if kind == MapKind::Normal {
            sets = sets.with_frames(&inputs.synthesis.mesh, f);
        }
        let grad = inputs.coverage.to_bary(face).grad;
        let stretch = sets.stretch(grad);
        let most = stretch.iter().fold(0.0f32, |m, s| m.max(*s));
        let four = most > TAP_FROM;
        let lods = FaceSets::lods(if four { stretch.map(|s| s * 0.5) } else { stretch.map(|_| 0.0) });
        let step = |x: f32, y: f32| {
            let b = grad.map(|g| g[0] * x + g[1] * y);
            [-b[0] - b[1], b[0], b[1]]
        };
        let (taps, tap_count) = match four {
            true => ([step(-0.25, -0.25), step(0.25, -0.25), step(-0.25, 0.25), step(0.25, 0.25)], 4),
            false => ([[0.0; 3]; 4], 1),
        };
        let parent = 3 * inputs.synthesis.parent[f] as usize;
        let n = [0, 1, 2].map(|k| inputs.surface.corner_normals[parent + k].to_f32());
        let t = [0, 1, 2].map(|k| inputs.tangents[parent + k]);
        let normals = inputs.synthesis.parent_bary[f].map(|b| mix(&n, b));
        let tangents = inputs.synthesis.parent_bary[f].map(|b| mix(&t.map(|t| [t[0], t[1], t[2]]), b));
        Face { shown: Shown { sets, lods }, taps, tap_count, normals, tangents, sign: t[0][3] }
    }

    /// What was chosen for a point, which lies on the page at `place`, or where the face is.
    fn chosen(&self, nodes: &Nodes, face: u32, b: [f32; 3], place: Option<[f32; 2]>, layers: &mut Vec<Layer>) -> Shown {
        let place = place.unwrap_or_else(|| nodes.lie.on_page(face, b));
        let set = nodes.layers(face, b, place, layers);
        Shown { sets: self.shown.sets.shifted(set, layers), lods: [self.shown.lods[set]; 4] }
    }

    /// The map's normal in the basis of the atlas: the inverse of what engines do.
    fn normal(&self, map: &Pyramid<4>, shown: &Shown, b: [f32; 3]) -> [f32; 4] {
        let (n, t) = (mix(&self.normals, b), mix(&self.tangents, b));
        let world = shown.sets.normal(map, b, &shown.lods, unit_or(n, [0.0, 0.0, 1.0]));
        let bitangent = cross(n, t).map(|x| x * self.sign);
        let rows = [cross(bitangent, n), cross(n, t), cross(t, bitangent)];
        let det = dot(t, rows[0]);
        if !det.is_normal() {
            return [0.0, 0.0, 1.0, 0.0];
        }
        let [x, y, z] = tangent_normal(rows.map(|r| dot(world, r) / det));
        [x, y, z, 0.0]
    }
}

/// Side of the squares that texels are shaded in: neighbours find their face in the cache.
const TILE: u32 = 64;

/// The faces last used, by the low bits of their index.
struct Cache<T>(Vec<Option<(u32, T)>>);

impl<T> Cache<T> {
    fn new() -> Self {
        Cache((0..64).map(|_| None).collect())
    }

    fn get(&mut self, face: u32, make: impl FnOnce() -> T) -> &T {
        let slot = &mut self.0[face as usize % 64];
        if slot.as_ref().is_some_and(|(f, _)| *f != face) {
            *slot = None;
        }
        &slot.get_or_insert_with(|| (face, make())).1
    }
}

/// Calls `put(texel, face, barycentric coordinates)` for the covered texels of some rows, tile by tile.
fn for_covered(coverage: &Coverage, rows: std::ops::Range<u32>, mut put: impl FnMut(usize, u32, [f32; 3])) {
    let w = coverage.width();
    for x0 in (0..w).step_by(TILE as usize) {
        for y in rows.clone() {
            let row = &coverage.row(y)[x0 as usize..(x0 + TILE).min(w) as usize];
            for (x, &f) in (x0 as usize..).zip(row).filter(|(_, f)| **f != NO_FACE) {
                let b = coverage.to_bary(f).at(x as f32 + 0.5, y as f32 + 0.5);
                put(y as usize * w as usize + x, f, clamp_bary(b));
            }
        }
    }
}

/// Shades every covered texel and every texel of the gutter; `C` of the `N` channels are kept.
fn shade<const N: usize, const C: usize>(
    inputs: &Inputs,
    nodes: Option<&Nodes>,
    kind: MapKind,
    value: impl Fn(&Face, &Shown, [f32; 3]) -> [f32; N] + Sync,
) -> Texture {
    let coverage = inputs.coverage;
    let (w, h) = (coverage.width(), coverage.height());
    let at = |face: &Face, shown: &Shown, b: [f32; 3]| {
        if face.tap_count == 1 {
            return value(face, shown, b);
        }
        let mut sum = [0.0; N];
        for tap in &face.taps {
            let v = value(face, shown, clamp_bary([b[0] + tap[0], b[1] + tap[1], b[2] + tap[2]]));
            (0..N).for_each(|k| sum[k] += v[k]);
        }
        let scale = match kind {
            // The mean of unit vectors made unit again.
            MapKind::Normal => 1.0 / sum.iter().map(|s| s * s).sum::<f32>().sqrt().max(1e-6),
            _ => 0.25,
        };
        sum.map(|s| s * scale)
    };
    let mut out = Texture::new(w, h, C as u32);
    par::for_rows(out.data_mut(), (w * STRIP) as usize * C, |strip, data| {
        let rows = strip as u32 * STRIP..(strip as u32 * STRIP + STRIP).min(h);
        let first = rows.start as usize * w as usize;
        let mut cache = Cache::new();
        let mut layers = Vec::new();
        let mut put = |texel: usize, f: u32, b: [f32; 3], place: Option<[f32; 2]>, turn: Option<Turn>| {
            let face = cache.get(f, || Face::new(inputs, f, kind));
            let mut v = match nodes {
                None => at(face, &face.shown, b),
                Some(nodes) => at(face, &face.chosen(nodes, f, b, place, &mut layers), b),
            };
            if let (Some([p, q]), true) = (turn, N >= 2) {
                (v[0], v[1]) = (p[0] * v[0] + p[1] * v[1], q[0] * v[0] + q[1] * v[1]);
            }
            data[(texel - first) * C..][..C].copy_from_slice(&v[..C]);
        };
        for_covered(coverage, rows.clone(), |texel, f, b| {
            let place = [(texel % w as usize) as f32 + 0.5, (texel / w as usize) as f32 + 0.5];
            put(texel, f, b, Some(place), None);
        });
        for g in coverage.gutter_in(rows) {
            let turn = (kind == MapKind::Normal).then(|| coverage.turn(g));
            put(g.texel as usize, g.face, g.bary, None, turn);
        }
    });
    out
}
