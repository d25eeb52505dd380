//! An atlas: where each triangle of a surface lies on the page.
//!
//! In: a surface, and UVs from an unwrapper or from the document. Out: UVs in 0..1 and a chart per triangle.
//! v points down, as in glTF.

use super::border::uv_regions;
use super::coverage::overlap_share;
use super::error::Error;
use super::unwrap::{MAX_SIDE, MIN_SIDE};
use crate::mesh::Surface;
use crate::numerics::vec::{Vec2, vec2};
use crate::texture::Uv;

/// The chart of a triangle that has no place of its own: one without area, or one that the unwrapper left out.
pub const NO_CHART: u32 = u32::MAX;

/// Share of covered texels that may belong to more than one triangle when the document's UVs are kept. Authored
/// layouts touch here and there; mirrored ones are far above.
pub(crate) const MAX_OVERLAP: f64 = 0.01;

/// UVs this far outside 0..1 are rounding and are clamped.
const OUTSIDE: f32 = 1e-6;

/// Where each triangle of a [`Surface`] lies on one page.
#[derive(Clone, Debug, PartialEq)]
pub struct Atlas {
    /// Texels per row of the page.
    pub width: u32,
    /// Rows of the page.
    pub height: u32,
    /// Position on the page of each corner (3 per face of the surface), 0..1, v down.
    pub corner_uv: Vec<Uv>,
    /// Chart of each face, below `chart_count`, or [`NO_CHART`]. The corners of a face without a chart still lie in 0..1,
    /// on a neighbour's corners where it has any.
    pub chart: Vec<u32>,
    /// Number of charts.
    pub chart_count: u32,
    /// Texels per world unit: the square root of texels covered over area, for all charts together.
    pub texels_per_unit: f64,
}

impl Atlas {
    /// Keeps the document's TEXCOORD set `set` as the atlas on a square page of `size` texels.
    ///
    /// Fails if the set is missing, a UV lies outside 0..=1, more than 1 % of the used texels belong to several
    /// triangles (coincident triangles aside), or no triangle has an area on the page.
    pub fn keep(surface: &Surface, set: usize, size: u32) -> Result<Atlas, Error> {
        if !(MIN_SIDE..=MAX_SIDE).contains(&size) {
            return Err(Error::PageSize { size });
        }
        let available = surface.corner_uvs.len();
        let uvs = surface.corner_uvs.get(set).ok_or(Error::NoUvSet { set, available })?;
        let expected = 3 * surface.mesh.faces.len();
        if uvs.len() != expected {
            return Err(Error::Mismatch { what: "corners with texture coordinates", found: uvs.len(), expected });
        }
        let inside = |x: f32| (-OUTSIDE..=1.0 + OUTSIDE).contains(&x);
        if let Some(c) = uvs.iter().position(|p| !inside(p.u) || !inside(p.v)) {
            return Err(Error::UvOutside { face: c / 3, uv: [uvs[c].u, uvs[c].v] });
        }
        let corner_uv: Vec<Uv> = uvs.iter().map(|p| Uv { u: p.u.clamp(0.0, 1.0), v: p.v.clamp(0.0, 1.0) }).collect();
        let (chart, chart_count) = uv_regions(surface, &corner_uv, |f| surface.mesh.area(f) > 0.0);
        let mut atlas = Atlas { width: size, height: size, corner_uv, chart, chart_count, texels_per_unit: 0.0 };
        atlas.texels_per_unit = atlas.measured_density(surface);
        if !atlas.texels_per_unit.is_normal() {
            return Err(Error::NoArea { faces: surface.mesh.faces.len() });
        }
        let share = overlap_share(surface, &atlas);
        if share > MAX_OVERLAP {
            return Err(Error::UvOverlap { share });
        }
        Ok(atlas)
    }

    /// Position of a corner on the page in texels.
    pub fn corner_px(&self, corner: usize) -> Vec2 {
        let uv = self.corner_uv[corner];
        vec2(f64::from(uv.u) * f64::from(self.width), f64::from(uv.v) * f64::from(self.height))
    }

    /// Area of the surface, measured at the atlas' density, as a share of the page: the packing's quality.
    pub fn utilization(&self, surface: &Surface) -> f64 {
        let area: f64 =
            (0..self.chart.len()).filter(|&f| self.chart[f] != NO_CHART).map(|f| surface.mesh.area(f)).sum();
        area * self.texels_per_unit * self.texels_per_unit / (f64::from(self.width) * f64::from(self.height))
    }

    /// Texels per world unit over all charted faces; 0 if they have no area.
    pub(crate) fn measured_density(&self, surface: &Surface) -> f64 {
        let (mut texels, mut area) = (0.0, 0.0);
        for f in (0..self.chart.len()).filter(|&f| self.chart[f] != NO_CHART) {
            let [a, b, c] = [0, 1, 2].map(|k| self.corner_px(3 * f + k));
            texels += (b - a).cross(c - a).abs() * 0.5;
            area += surface.mesh.area(f);
        }
        if area > 0.0 { (texels / area).sqrt() } else { 0.0 }
    }
}
