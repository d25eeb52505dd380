//! Unwrapping by the xatlas C++ library (cargo feature `xatlas`).
//!
//! In: a cleaned mesh. Out: charts on one page. The binding is safe to call; no `unsafe` here.
//! Ways around its habits: `resolution` is a hint only, so the density is searched until the page fits; random
//! placement is off; faces it leaves out come with atlas index -1; its progress callback must outlive everything, so
//! cancelling waits for the end of a phase. The C++ flags in `.cargo/config.toml` (no assertions that abort, one thread,
//! no fused multiply-add) belong to this file.

use super::error::Error;
use super::unwrap::{Clean, Extent, Packed, UnwrapParams};
use crate::texture::Uv;
use xatlas_rs_v2::{ChartOptions, IndexData, MeshData, MeshDecl, PackOptions, Xatlas};

/// Packings tried for a page of a given size.
const TRIES: usize = 12;
/// First guess of the share of the page that charts cover.
const FIRST_SHARE: f64 = 0.7;

pub(super) fn pack(clean: &Clean, params: &UnwrapParams, go_on: &(dyn Fn() -> bool + Sync)) -> Result<Packed, Error> {
    let positions: Vec<f32> = clean.positions.iter().flatten().copied().collect();
    let decl = MeshDecl {
        vertex_position_data: MeshData::Contiguous(&positions),
        index_data: Some(IndexData::U32(&clean.indices)),
        face_count: clean.faces.len() as u32,
        ..Default::default()
    };
    let mut library = Xatlas::new();
    library.add_mesh(&decl).map_err(|e| Error::Library { message: format!("{e:?}") })?;
    library.add_mesh_join();
    library.compute_charts(&ChartOptions::default());
    if !go_on() {
        return Err(Error::Cancelled);
    }
    let page = match params.extent {
        Extent::TexelsPerUnit(d) => pack_at(&mut library, params, d / clean.scale)?,
        Extent::Page(size) => pack_into(&mut library, params, size, clean, go_on)?,
    };
    let [mesh] = &library.meshes()[..] else {
        return Err(Error::Mismatch { what: "unwrapped meshes", found: library.mesh_count() as usize, expected: 1 });
    };
    let corners = mesh.index_array.chunks_exact(3).map(|t| {
        let v = [0, 1, 2].map(|k| &mesh.vertex_array[t[k] as usize]);
        if v.iter().any(|v| v.atlas_index != 0 || v.chart_index < 0) {
            return None;
        }
        let uv = v.map(|v| Uv { u: v.uv[0] / page.0 as f32, v: 1.0 - v.uv[1] / page.1 as f32 });
        Some((v[0].chart_index as u32, uv))
    });
    Ok(Packed { width: page.0, height: page.1, corners: corners.collect() })
}

/// Packs at a density in texels per unit of the box; the page that came out.
fn pack_at(library: &mut Xatlas, params: &UnwrapParams, texels_per_unit: f64) -> Result<(u32, u32), Error> {
    library.pack_charts(&PackOptions {
        padding: 2 * params.gutter_px,
        texels_per_unit: texels_per_unit as f32,
        brute_force: true,
        ..Default::default()
    });
    match (library.width(), library.height()) {
        (0, _) | (_, 0) => Err(Error::Library { message: "it packed nothing".to_owned() }),
        page => Ok(page),
    }
}

/// Packs as densely as a square page allows: bisection of the density, ending on the densest that fitted.
fn pack_into(
    library: &mut Xatlas,
    params: &UnwrapParams,
    size: u32,
    clean: &Clean,
    go_on: &(dyn Fn() -> bool + Sync),
) -> Result<(u32, u32), Error> {
    let area: f64 = clean
        .indices
        .chunks_exact(3)
        .map(|t| {
            let [a, b, c] = [0, 1, 2].map(|k| crate::numerics::vec::Vec3::from(clean.positions[t[k] as usize]));
            (b - a).cross(c - a).length() * 0.5
        })
        .sum();
    let mut density = f64::from(size) * (FIRST_SHARE / area).sqrt();
    let (mut fits, mut too_dense) = (0.0, f64::INFINITY);
    for _ in 0..TRIES {
        if !go_on() {
            return Err(Error::Cancelled);
        }
        let (w, h) = pack_at(library, params, density)?;
        if w.max(h) <= size {
            fits = density;
        } else {
            too_dense = density;
        }
        if too_dense - fits < 0.005 * fits {
            break;
        }
        let towards = density * f64::from(size) / f64::from(w.max(h));
        let middle = if too_dense.is_finite() { 0.5 * (fits + too_dense) } else { density * 1.1 };
        density = if towards > fits && towards < too_dense && towards != density { towards } else { middle };
    }
    match fits > 0.0 {
        true => pack_at(library, params, fits),
        false => Err(Error::DoesNotFit { charts: library.chart_count(), size, gutter_px: params.gutter_px }),
    }
}
