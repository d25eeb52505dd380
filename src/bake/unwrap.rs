//! UV unwrapping: a surface cut into charts, flattened and packed on one page, by an outside library.
//!
//! In: a surface of any topology. Out: an [`Atlas`]. The mesh is cleaned first: vertices at one position are welded (so
//! normals and old UVs that split them leave no seam), triangles without area and repeats of a triangle are left out and
//! get the UVs of their neighbours or of the first one. Positions are moved and scaled into a unit box, so neither a
//! far origin nor tiny or huge units cost the library its f32 precision.
//!
//! `uvunwrap` without its `direct-solver`: plain IEEE arithmetic, same charts on every CPU.
//!
//! Unaware of: textures, files.

use super::atlas::{Atlas, NO_CHART};
use super::border::weld;
use super::error::Error;
use crate::mesh::Surface;
use crate::texture::Uv;

/// Smallest side of a page in texels.
pub(crate) const MIN_SIDE: u32 = 16;
/// Largest side of a page in texels: what GPUs take.
pub(crate) const MAX_SIDE: u32 = 16384;
/// Sides of a page that is not asked for by size are multiples of this, for block compression.
const BLOCK: u32 = 4;

/// How large the atlas becomes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Extent {
    /// A square page of this many texels a side (16..=16384); the density follows.
    Page(u32),
    /// Texels per world unit; the page follows.
    TexelsPerUnit(f64),
}

/// Which library cuts, flattens and packs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Library {
    /// The `uvunwrap` crate.
    #[default]
    Uvunwrap,
    /// The xatlas C++ library; only in builds with the cargo feature `xatlas`.
    Xatlas,
}

/// Parameters of [`unwrap`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UnwrapParams {
    /// Size of the page or density.
    pub extent: Extent,
    /// Free texels around every chart: charts are twice this apart. At most an eighth of the page.
    pub gutter_px: u32,
    /// The library.
    pub library: Library,
}

/// A mesh as both libraries take it: welded, cleaned, in a unit box.
pub(super) struct Clean {
    pub positions: Vec<[f32; 3]>,
    pub indices: Vec<u32>,
    /// For each kept triangle its face of the surface.
    pub faces: Vec<u32>,
    /// For each face of the surface that repeats another one that one.
    repeats: Vec<Option<u32>>,
    /// Units of the box per world unit.
    pub scale: f64,
}

/// What a library gives back: for each kept triangle its chart and UVs (0..1 of the page, v down, not mirrored), or
/// `None` if it was left out.
pub(super) struct Packed {
    pub width: u32,
    pub height: u32,
    pub corners: Vec<Option<(u32, [Uv; 3])>>,
}

/// Gutter with which mip levels 0 to 3 of neighbouring charts share no texel: 10 texels; less on pages below 400, which
/// have few texels to spare. At half of it the sides of seams differ by 7 to 9 steps of 8 bits at mip 3, at 10 by 1 to 2.
pub fn default_gutter_px(size: u32) -> u32 {
    (size / 40).clamp(2, 10)
}

/// Unwraps a surface onto one page. Same result for any number of threads and any CPU.
pub fn unwrap(surface: &Surface, params: &UnwrapParams) -> Result<Atlas, Error> {
    unwrap_watched(surface, params, &|| true)
}

/// [`unwrap`], asking `go_on` now and then whether to go on; if not, fails with [`Error::Cancelled`].
pub fn unwrap_watched(
    surface: &Surface,
    params: &UnwrapParams,
    go_on: &(dyn Fn() -> bool + Sync),
) -> Result<Atlas, Error> {
    check(params)?;
    let clean = clean(surface)?;
    if let Extent::TexelsPerUnit(d) = params.extent {
        let area: f64 = clean.faces.iter().map(|&f| surface.mesh.area(f as usize)).sum();
        let side = area.sqrt() * d;
        if side > f64::from(MAX_SIDE) {
            return Err(Error::TooLarge { side });
        }
    }
    let packed = match params.library {
        Library::Uvunwrap => by_uvunwrap(&clean, params, go_on)?,
        #[cfg(feature = "xatlas")]
        Library::Xatlas => super::xatlas::pack(&clean, params, go_on)?,
        #[cfg(not(feature = "xatlas"))]
        Library::Xatlas => return Err(Error::NotBuilt),
    };
    let (width, height) = page(&packed, params)?;
    let mut atlas = assemble(surface, &clean, &packed, width, height);
    atlas.texels_per_unit = atlas.measured_density(surface);
    Ok(atlas)
}

fn check(params: &UnwrapParams) -> Result<(), Error> {
    match params.extent {
        Extent::Page(size) if !(MIN_SIDE..=MAX_SIDE).contains(&size) => Err(Error::PageSize { size }),
        Extent::Page(size) if params.gutter_px > size / 8 => Err(Error::Gutter { gutter_px: params.gutter_px, size }),
        Extent::TexelsPerUnit(d) if !(d > 0.0 && d.is_finite()) => Err(Error::Density { texels_per_unit: d }),
        Extent::TexelsPerUnit(_) if params.gutter_px > MAX_SIDE / 8 => {
            Err(Error::Gutter { gutter_px: params.gutter_px, size: MAX_SIDE })
        }
        _ => Ok(()),
    }
}

/// Triangles thinner than this share of the mesh's diagonal have no place in f32 UVs (and none in `uvunwrap`).
const MIN_ALTITUDE: f64 = 1e-6;

fn clean(surface: &Surface) -> Result<Clean, Error> {
    let mesh = &surface.mesh;
    let used = mesh.faces.iter().flatten().map(|&v| mesh.positions[v as usize]);
    let (lo, hi) = used.fold((None, None), |(lo, hi): (Option<crate::numerics::vec::Vec3>, Option<_>), p| {
        let (mut a, mut b) = (lo.unwrap_or(p), hi.unwrap_or(p));
        (a.x, a.y, a.z) = (a.x.min(p.x), a.y.min(p.y), a.z.min(p.z));
        (b.x, b.y, b.z) = (b.x.max(p.x), b.y.max(p.y), b.z.max(p.z));
        (Some(a), Some(b))
    });
    let none = Error::NoArea { faces: mesh.faces.len() };
    let (Some(lo), Some(hi)) = (lo, hi) else { return Err(none) };
    let side = (hi.x - lo.x).max(hi.y - lo.y).max(hi.z - lo.z);
    if !side.is_normal() {
        return Err(none);
    }
    let positions: Vec<[f32; 3]> = mesh.positions.iter().map(|&p| ((p - lo) / side).to_f32()).collect();
    let min_altitude = MIN_ALTITUDE * (hi - lo).length();
    let welded = weld(&mesh.positions);
    let (mut indices, mut faces, mut keys) = (Vec::new(), Vec::new(), Vec::new());
    for (f, face) in mesh.faces.iter().enumerate() {
        let [a, b, c] = mesh.corners(f);
        let longest = (b - a).length().max((c - b).length()).max((a - c).length());
        let altitude = mesh.area_vector(f).length() / longest;
        if altitude.is_finite() && altitude > min_altitude {
            let mut key = face.map(|v| welded[v as usize]);
            key.sort_unstable();
            keys.push((key, f as u32));
        }
    }
    keys.sort_unstable();
    let mut repeats = vec![None; mesh.faces.len()];
    for group in keys.chunk_by(|a, b| a.0 == b.0) {
        group[1..].iter().for_each(|(_, f)| repeats[*f as usize] = Some(group[0].1));
    }
    keys.sort_unstable_by_key(|(_, f)| *f);
    for (_, f) in keys.into_iter().filter(|(_, f)| repeats[*f as usize].is_none()) {
        faces.push(f);
        indices.extend(mesh.faces[f as usize].map(|v| welded[v as usize]));
    }
    if faces.is_empty() {
        return Err(none);
    }
    Ok(Clean { positions, indices, faces, repeats, scale: 1.0 / side })
}

fn by_uvunwrap(clean: &Clean, params: &UnwrapParams, go_on: &(dyn Fn() -> bool + Sync)) -> Result<Packed, Error> {
    let density = match params.extent {
        Extent::Page(page_size) => uvunwrap::Density::Auto { page_size },
        Extent::TexelsPerUnit(d) => {
            uvunwrap::Density::Fixed { texels_per_unit: (d / clean.scale) as f32, page_size: None }
        }
    };
    let options = uvunwrap::Options { density, padding: params.gutter_px, ..Default::default() };
    let mesh = uvunwrap::MeshInput::new(&clean.positions, &clean.indices);
    let found = uvunwrap::generate_with_progress(&[mesh], &options, |_| go_on()).map_err(|e| match e {
        uvunwrap::Error::Cancelled => Error::Cancelled,
        uvunwrap::Error::AtlasTooLarge { texels } => Error::TooLarge { side: (texels as f64).sqrt() },
        other => Error::Library { message: other.to_string() },
    })?;
    if found.page_count > 1 {
        let size = if let Extent::Page(size) = params.extent { size } else { found.width };
        return Err(Error::DoesNotFit { charts: found.chart_count, size, gutter_px: params.gutter_px });
    }
    let [out] = &found.meshes[..] else {
        return Err(Error::Mismatch { what: "unwrapped meshes", found: found.meshes.len(), expected: 1 });
    };
    let corners = out.indices.chunks_exact(3).map(|t| {
        let v = [0, 1, 2].map(|k| out.vertices[t[k] as usize]);
        // Its rows grow upwards where faces are to be seen from outside, not mirrored.
        let uv = v.map(|v| Uv { u: v.uv[0], v: 1.0 - v.uv[1] });
        v[0].chart.filter(|_| twice_area(&uv) != 0.0).map(|chart| (chart, uv))
    });
    Ok(Packed { width: found.width, height: found.height, corners: corners.collect() })
}

fn twice_area(uv: &[Uv; 3]) -> f32 {
    (uv[1].u - uv[0].u) * (uv[2].v - uv[0].v) - (uv[1].v - uv[0].v) * (uv[2].u - uv[0].u)
}

/// The page that the packed rectangle is placed on.
fn page(packed: &Packed, params: &UnwrapParams) -> Result<(u32, u32), Error> {
    let (width, height) = match params.extent {
        Extent::Page(size) => (size, size),
        Extent::TexelsPerUnit(_) => {
            let up = |n: u32| n.max(MIN_SIDE).next_multiple_of(BLOCK);
            (up(packed.width), up(packed.height))
        }
    };
    let side = packed.width.max(packed.height);
    if side > MAX_SIDE || side > width.max(height) {
        return Err(Error::TooLarge { side: f64::from(side) });
    }
    Ok((width, height))
}

fn assemble(surface: &Surface, clean: &Clean, packed: &Packed, width: u32, height: u32) -> Atlas {
    let n = surface.mesh.faces.len();
    let (su, sv) = (packed.width as f32 / width as f32, packed.height as f32 / height as f32);
    let mut corner_uv = vec![Uv::default(); 3 * n];
    let mut chart = vec![NO_CHART; n];
    // Charts are numbered by their first face, whatever the library's order.
    let mut number = std::collections::BTreeMap::new();
    for (&f, found) in clean.faces.iter().zip(&packed.corners) {
        let Some((c, uv)) = found else { continue };
        let next = number.len() as u32;
        chart[f as usize] = *number.entry(*c).or_insert(next);
        for k in 0..3 {
            let at = Uv { u: (uv[k].u * su).clamp(0.0, 1.0), v: (uv[k].v * sv).clamp(0.0, 1.0) };
            corner_uv[3 * f as usize + k] = at;
        }
    }
    let welded = weld(&surface.mesh.positions);
    for f in 0..n {
        if let Some(first) = clean.repeats[f] {
            repeat(surface, &welded, f, first as usize, &mut corner_uv);
            chart[f] = chart[first as usize];
        }
    }
    lean_on_neighbours(surface, &welded, &chart, &mut corner_uv);
    Atlas { width, height, corner_uv, chart, chart_count: number.len() as u32, texels_per_unit: 0.0 }
}

/// Gives face `f` the UVs of the face `first` at the same three positions.
fn repeat(surface: &Surface, welded: &[u32], f: usize, first: usize, uv: &mut [Uv]) {
    let at = |f: usize| surface.mesh.faces[f].map(|v| welded[v as usize]);
    let theirs = at(first);
    for (k, v) in at(f).into_iter().enumerate() {
        let i = theirs.iter().position(|&w| w == v).unwrap_or(k);
        uv[3 * f + k] = uv[3 * first + i];
    }
}

/// Gives faces without a chart the UVs of charted neighbours: all from the chart that shares most of its corners, the
/// lowest of equals. Corners that are not on that chart take the place of one that is.
fn lean_on_neighbours(surface: &Surface, welded: &[u32], chart: &[u32], uv: &mut [Uv]) {
    if !chart.contains(&NO_CHART) {
        return;
    }
    let mut at_vertex: Vec<(u32, u32, u32)> = Vec::new();
    for (f, face) in surface.mesh.faces.iter().enumerate().filter(|(f, _)| chart[*f] != NO_CHART) {
        at_vertex.extend((0..3).map(|k| (welded[face[k] as usize], chart[f], (3 * f + k) as u32)));
    }
    at_vertex.sort_unstable();
    at_vertex.dedup_by_key(|e| (e.0, e.1));
    for f in (0..chart.len()).filter(|&f| chart[f] == NO_CHART) {
        let rows = surface.mesh.faces[f].map(|v| {
            let v = welded[v as usize];
            let start = at_vertex.partition_point(|e| e.0 < v);
            let end = at_vertex.partition_point(|e| e.0 <= v);
            &at_vertex[start..end]
        });
        let on = |c: u32, k: usize| rows[k].binary_search_by_key(&c, |e| e.1).ok().map(|i| rows[k][i].2);
        let charts = rows.iter().flat_map(|r| r.iter().map(|e| e.1));
        let shared = |c: u32| (0..3).filter(|&k| on(c, k).is_some()).count();
        let Some(best) = charts.max_by_key(|&c| (shared(c), std::cmp::Reverse(c))) else { continue };
        let found = [0, 1, 2].map(|k| on(best, k));
        let Some(any) = found.iter().flatten().next().copied() else { continue };
        for k in 0..3 {
            let from = found[k].or(found[(k + 1) % 3]).unwrap_or(any);
            uv[3 * f + k] = uv[from as usize];
        }
    }
}
