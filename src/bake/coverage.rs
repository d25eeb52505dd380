//! Which point of the synthesis mesh each texel of the atlas shows: computed once, used for every map.
//!
//! A texel belongs to the triangle that its centre lies in; corners are snapped to 1/256 texel and edges decided in
//! integers by the top-left rule, as GPUs do, so neighbours neither overlap nor leave a gap. Of triangles on top of each
//! other the lowest index wins. Texels of the gutter look across the border of their chart: at the place where the
//! surface goes on in the neighbouring chart, found by laying that chart beside the border with the same scale
//! (see `gutter`), or at the nearest point of the border if nothing goes on there.
//!
//! Only the face is stored per texel (4 bytes); barycentric coordinates follow from an affine map per face.
//! Unaware of: textures, blending.

use super::atlas::{Atlas, NO_CHART};
use super::border::{Border, STRAIGHT, Turn, borders, turn, weld};
use super::error::Error;
use super::gutter::{GutterTexel, gutter};
use super::seam::seams;
use super::stitch::Stitches;
use crate::mesh::{Surface, SynthesisMesh};
use crate::numerics::par;
use crate::numerics::vec::Vec2;

/// No face: the texel shows nothing.
pub(crate) const NO_FACE: u32 = u32::MAX;
/// Rows per parallel piece of work.
pub(crate) const STRIP: u32 = 64;
/// Sub-texel steps that corners are snapped to.
const STEPS: f64 = 256.0;

/// From a position on the page to barycentric coordinates of one triangle: exact at its corners up to rounding.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct ToBary {
    origin: [f32; 2],
    /// Gradients of the second and third coordinate per texel.
    pub grad: [[f32; 2]; 2],
}

impl ToBary {
    /// A triangle without area maps everything to its first corner.
    fn new(p: [Vec2; 3]) -> Self {
        let (e1, e2) = (p[1] - p[0], p[2] - p[0]);
        let det = e1.cross(e2);
        if !det.is_normal() {
            return ToBary { origin: [p[0].x as f32, p[0].y as f32], ..Default::default() };
        }
        let g = |x: f64, y: f64| [(x / det) as f32, (y / det) as f32];
        ToBary { origin: [p[0].x as f32, p[0].y as f32], grad: [g(e2.y, -e2.x), g(-e1.y, e1.x)] }
    }

    /// Coordinates at a position in texels; outside the triangle some are negative.
    pub fn at(&self, x: f32, y: f32) -> [f32; 3] {
        let (dx, dy) = (x - self.origin[0], y - self.origin[1]);
        let b = self.grad.map(|g| g[0] * dx + g[1] * dy);
        [1.0 - b[0] - b[1], b[0], b[1]]
    }

    /// How far outside the triangle's edges a position lies, in texels; negative inside.
    fn outside_px(&self, x: f32, y: f32) -> f32 {
        let [g1, g2] = self.grad;
        let slopes = [[-g1[0] - g2[0], -g1[1] - g2[1]], g1, g2];
        let far = |b: f32, g: [f32; 2]| -b / (g[0] * g[0] + g[1] * g[1]).sqrt().max(f32::MIN_POSITIVE);
        let b = self.at(x, y);
        (0..3).map(|k| far(b[k], slopes[k])).fold(f32::MIN, f32::max)
    }
}

/// Widest crack that rounding leaves, with room to spare: four sub-texel steps.
const CRACK_PX: f32 = 4.0 / STEPS as f32;

/// Barycentric coordinates moved into the triangle.
pub(crate) fn clamp_bary(b: [f32; 3]) -> [f32; 3] {
    if b[0] >= 0.0 && b[1] >= 0.0 && b[2] >= 0.0 {
        return b;
    }
    let c = b.map(|x| x.max(0.0));
    let sum = c[0] + c[1] + c[2];
    c.map(|x| x / sum)
}

/// What each texel of an atlas shows.
#[derive(Clone, Debug)]
pub struct Coverage {
    width: u32,
    height: u32,
    /// Synthesis face per texel.
    faces: Vec<u32>,
    to_bary: Vec<ToBary>,
    /// In ascending order of the texel.
    gutter: Vec<GutterTexel>,
    borders: Vec<Border>,
    /// For each border how normals turn that come across it.
    turns: Vec<Turn>,
    stitches: Stitches,
}

impl Coverage {
    /// Rasterises the synthesis mesh over the atlas and surrounds every chart by `gutter_px` texels (at least 2) of the
    /// surface's continuation. `tangents` as made for the atlas. Memory: 4 bytes a texel.
    pub fn new(
        surface: &Surface,
        synthesis: &SynthesisMesh,
        atlas: &Atlas,
        tangents: &[[f32; 4]],
        gutter_px: u32,
    ) -> Result<Self, Error> {
        check(surface, synthesis, atlas, tangents)?;
        let (width, height) = (atlas.width, atlas.height);
        let corners = par::map(synthesis.parent.len(), |f| synthesis_px(synthesis, atlas, f));
        let to_bary: Vec<ToBary> = corners.iter().map(|p| ToBary::new(*p)).collect();
        let charted = |f: usize| atlas.chart[synthesis.parent[f] as usize] != NO_CHART;
        let (faces, _) = rasterise(width, height, &corners, charted);
        let borders = borders(surface, atlas);
        let across = |b: &Border| b.partner.map_or(STRAIGHT, |p| turn(surface, tangents, b.corners, p));
        let turns = borders.iter().map(across).collect();
        let mut coverage = Coverage {
            width,
            height,
            faces,
            to_bary,
            gutter: Vec::new(),
            borders,
            turns,
            stitches: Stitches::default(),
        };
        coverage.close_cracks(synthesis, atlas);
        let seams = seams(atlas, &coverage.borders);
        let turns = seams.iter().map(|s| turn(surface, tangents, s.corners[0], s.corners[1])).collect();
        coverage.stitches = Stitches::new(&seams, turns, width, height, |x, y| coverage.face(x, y).is_some());
        coverage.gutter = gutter(&coverage, synthesis, atlas, gutter_px.clamp(2, 64));
        Ok(coverage)
    }

    /// Texels per row.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// Face of the synthesis mesh whose inside the centre of texel (x, y) shows. Panics outside.
    pub fn face(&self, x: u32, y: u32) -> Option<u32> {
        assert!(x < self.width, "column {x} of {}", self.width);
        let f = self.faces[y as usize * self.width as usize + x as usize];
        (f != NO_FACE).then_some(f)
    }

    /// Share of the texels that charts cover.
    pub fn share(&self) -> f64 {
        self.faces.iter().filter(|&&f| f != NO_FACE).count() as f64 / self.faces.len() as f64
    }

    /// Faces of one row.
    pub(crate) fn row(&self, y: u32) -> &[u32] {
        let w = self.width as usize;
        &self.faces[y as usize * w..(y as usize + 1) * w]
    }

    /// The gutter's texels in some rows.
    pub(crate) fn gutter_in(&self, rows: std::ops::Range<u32>) -> &[GutterTexel] {
        let at = |y: u32| self.gutter.partition_point(|g| u64::from(g.texel) < u64::from(y) * u64::from(self.width));
        &self.gutter[at(rows.start)..at(rows.end)]
    }

    /// What a texel of the gutter looks at.
    pub(crate) fn gutter_at(&self, texel: u32) -> Option<&GutterTexel> {
        self.gutter.binary_search_by_key(&texel, |g| g.texel).ok().map(|i| &self.gutter[i])
    }

    /// The affine map of a synthesis face.
    pub(crate) fn to_bary(&self, face: u32) -> &ToBary {
        &self.to_bary[face as usize]
    }

    /// Number of faces of the synthesis mesh that was rasterised.
    pub(crate) fn face_count(&self) -> usize {
        self.to_bary.len()
    }

    /// How a normal from across a border turns.
    pub(crate) fn turn(&self, g: &GutterTexel) -> Turn {
        self.turns.get(g.across as usize).copied().unwrap_or(STRAIGHT)
    }

    /// The plan for closing seams.
    pub(crate) fn stitches(&self) -> &Stitches {
        &self.stitches
    }

    /// Where charts end.
    pub(crate) fn borders(&self) -> &[Border] {
        &self.borders
    }

    /// The covering face at or next to a position that holds it best, among faces of one chart.
    pub(crate) fn find(
        &self,
        synthesis: &SynthesisMesh,
        atlas: &Atlas,
        p: Vec2,
        chart: u32,
    ) -> Option<(u32, [f32; 3])> {
        let (cx, cy) = (p.x.floor() as i64, p.y.floor() as i64);
        let mut best: Option<(f32, u32, [f32; 3])> = None;
        let mut last = NO_FACE;
        for y in (cy - 1).max(0)..=(cy + 1).min(i64::from(self.height) - 1) {
            for x in (cx - 1).max(0)..=(cx + 1).min(i64::from(self.width) - 1) {
                let f = self.faces[y as usize * self.width as usize + x as usize];
                if f == NO_FACE || f == last || atlas.chart[synthesis.parent[f as usize] as usize] != chart {
                    continue;
                }
                last = f;
                let b = self.to_bary[f as usize].at(p.x as f32, p.y as f32);
                let inside = b[0].min(b[1]).min(b[2]);
                if best.is_none_or(|(i, g, _)| inside > i || (inside == i && f < g)) {
                    best = Some((inside, f, b));
                }
            }
        }
        best.map(|(_, f, b)| (f, clamp_bary(b)))
    }

    /// Gives texels that no triangle claimed though one all but holds them: where two triangles of a chart computed their
    /// common corner from different parents, rounding may leave a crack of one step.
    fn close_cracks(&mut self, synthesis: &SynthesisMesh, atlas: &Atlas) {
        let (w, h) = (self.width as usize, self.height as usize);
        let chart = |f: u32| if f == NO_FACE { NO_CHART } else { atlas.chart[synthesis.parent[f as usize] as usize] };
        let faces = &self.faces;
        let found = par::map_chunks(h, STRIP as usize, |rows| {
            let mut out = Vec::new();
            for y in rows.filter(|&y| y > 0 && y + 1 < h) {
                for i in (y * w + 1..y * w + w - 1).filter(|&i| faces[i] == NO_FACE) {
                    let between = |a: usize, b: usize| faces[a] != NO_FACE && chart(faces[a]) == chart(faces[b]);
                    if between(i - 1, i + 1) || between(i - w, i + w) {
                        let near = [i - 1, i + 1, i - w, i + w].map(|j| faces[j]);
                        let (x, y) = ((i % w) as f32 + 0.5, y as f32 + 0.5);
                        let touches = |f: &u32| *f != NO_FACE && self.to_bary[*f as usize].outside_px(x, y) < CRACK_PX;
                        out.extend(near.into_iter().find(touches).map(|f| (i, f)));
                    }
                }
            }
            out
        });
        found.into_iter().flatten().for_each(|(i, f)| self.faces[i] = f);
    }
}

fn check(surface: &Surface, synthesis: &SynthesisMesh, atlas: &Atlas, tangents: &[[f32; 4]]) -> Result<(), Error> {
    let same = |what, found: usize, expected: usize| match found == expected {
        true => Ok(()),
        false => Err(Error::Mismatch { what, found, expected }),
    };
    same("charts of faces", atlas.chart.len(), surface.mesh.faces.len())?;
    same("corners in the atlas", atlas.corner_uv.len(), 3 * surface.mesh.faces.len())?;
    same("corner normals", surface.corner_normals.len(), 3 * surface.mesh.faces.len())?;
    same("tangents", tangents.len(), 3 * surface.mesh.faces.len())?;
    same("parents of synthesis faces", synthesis.parent.len(), synthesis.mesh.faces.len())?;
    same("barycentric triples of synthesis faces", synthesis.parent_bary.len(), synthesis.mesh.faces.len())?;
    let beyond = synthesis.parent.iter().filter(|&&p| p as usize >= surface.mesh.faces.len()).count();
    same("synthesis faces whose parent does not exist", beyond, 0)
}

/// Corners of a synthesis face on the page, in texels.
pub(crate) fn synthesis_px(synthesis: &SynthesisMesh, atlas: &Atlas, f: usize) -> [Vec2; 3] {
    let parent = synthesis.parent[f] as usize;
    let p = [0, 1, 2].map(|k| atlas.corner_px(3 * parent + k));
    synthesis.parent_bary[f].map(|b| p[0] * f64::from(b[0]) + p[1] * f64::from(b[1]) + p[2] * f64::from(b[2]))
}

/// A snapped triangle in the order that makes its area positive, or `None` without area.
fn snapped(p: [Vec2; 3]) -> Option<[[i64; 2]; 3]> {
    let q = p.map(|v| [(v.x * STEPS).round() as i64, (v.y * STEPS).round() as i64]);
    let area = (q[1][0] - q[0][0]) * (q[2][1] - q[0][1]) - (q[1][1] - q[0][1]) * (q[2][0] - q[0][0]);
    match area.signum() {
        1 => Some(q),
        -1 => Some([q[0], q[2], q[1]]),
        _ => None,
    }
}

/// First row or column whose centre is not before `v` steps.
fn first_centre(v: i64) -> i64 {
    (v - 128 + 255).div_euclid(256)
}

/// Calls `texel(x, y)` for every texel of the rows whose centre lies in the triangle, by the top-left rule.
fn scan(q: &[[i64; 2]; 3], width: i64, rows: std::ops::Range<i64>, mut texel: impl FnMut(i64, i64)) {
    let (lo, hi) = bounds(q);
    let (x0, x1) = (first_centre(lo[0]).max(0), first_centre(hi[0] + 1).min(width));
    let (y0, y1) = (first_centre(lo[1]).max(rows.start), first_centre(hi[1] + 1).min(rows.end));
    if x0 >= x1 || y0 >= y1 {
        return;
    }
    // Edge functions, positive inside; those of right and bottom edges are lowered by one so that zero is outside.
    let mut step = [[0i64; 2]; 3];
    let mut at = [0i64; 3];
    for k in 0..3 {
        let (a, b) = (q[k], q[(k + 1) % 3]);
        let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
        let left_or_top = dy < 0 || (dy == 0 && dx > 0);
        at[k] = dx * (y0 * 256 + 128 - a[1]) - dy * (x0 * 256 + 128 - a[0]) - i64::from(!left_or_top);
        step[k] = [-dy * 256, dx * 256];
    }
    for y in y0..y1 {
        let mut e = at;
        for x in x0..x1 {
            if (e[0] | e[1] | e[2]) >= 0 {
                texel(x, y);
            }
            (0..3).for_each(|k| e[k] += step[k][0]);
        }
        (0..3).for_each(|k| at[k] += step[k][1]);
    }
}

fn bounds(q: &[[i64; 2]; 3]) -> ([i64; 2], [i64; 2]) {
    let lo = [0, 1].map(|i| q[0][i].min(q[1][i]).min(q[2][i]));
    let hi = [0, 1].map(|i| q[0][i].max(q[1][i]).max(q[2][i]));
    (lo, hi)
}

/// Indices `0..n` by the strips of rows that `rows(i)` touches, ascending within a strip.
pub(crate) fn by_strip(height: u32, n: usize, rows: impl Fn(usize) -> Option<(i64, i64)>) -> Vec<Vec<u32>> {
    let mut strips = vec![Vec::new(); height.div_ceil(STRIP) as usize];
    for i in 0..n {
        let Some((y0, y1)) = rows(i) else { continue };
        let (y0, y1) = (y0.max(0), y1.min(i64::from(height)));
        if y0 < y1 {
            let (s0, s1) = (y0 / i64::from(STRIP), (y1 - 1) / i64::from(STRIP));
            (s0..=s1).for_each(|s| strips[s as usize].push(i as u32));
        }
    }
    strips
}

/// The lowest triangle over each texel's centre, and how many texels more than one triangle covers.
fn rasterise(w: u32, h: u32, corners: &[[Vec2; 3]], show: impl Fn(usize) -> bool) -> (Vec<u32>, usize) {
    let strips = by_strip(h, corners.len(), |i| {
        let (lo, hi) = bounds(&snapped(corners[i]).filter(|_| show(i))?);
        Some((first_centre(lo[1]), first_centre(hi[1] + 1)))
    });
    let mut faces = vec![NO_FACE; w as usize * h as usize];
    let doubles = std::sync::atomic::AtomicUsize::new(0);
    par::for_rows(&mut faces, w as usize * STRIP as usize, |s, out| {
        let first = s as i64 * i64::from(STRIP);
        let rows = first..(first + i64::from(STRIP)).min(i64::from(h));
        let mut twice = 0;
        for &i in &strips[s] {
            let Some(q) = snapped(corners[i as usize]) else { continue };
            scan(&q, i64::from(w), rows.clone(), |x, y| {
                let at = &mut out[(y - first) as usize * w as usize + x as usize];
                if *at == NO_FACE {
                    *at = i;
                } else {
                    twice += 1;
                }
            });
        }
        doubles.fetch_add(twice, std::sync::atomic::Ordering::Relaxed);
    });
    (faces, doubles.into_inner())
}

/// Side of the page on which overlaps of kept UVs are counted.
const OVERLAP_SIDE: u32 = 2048;

/// Share of the covered texels that several triangles of the surface cover. Triangles on the same three points in
/// space count once.
pub(crate) fn overlap_share(surface: &Surface, atlas: &Atlas) -> f64 {
    let welded = weld(&surface.mesh.positions);
    let mut keys: Vec<([u32; 3], u32)> = (0..surface.mesh.faces.len() as u32)
        .filter(|&f| atlas.chart[f as usize] != NO_CHART)
        .map(|f| {
            let mut k = surface.mesh.faces[f as usize].map(|v| welded[v as usize]);
            k.sort_unstable();
            (k, f)
        })
        .collect();
    keys.sort_unstable();
    keys.dedup_by_key(|k| k.0);
    let scale = f64::from(OVERLAP_SIDE) / f64::from(atlas.width.max(atlas.height));
    let corners: Vec<_> =
        keys.iter().map(|(_, f)| [0, 1, 2].map(|k| atlas.corner_px(3 * *f as usize + k) * scale)).collect();
    let (faces, twice) = rasterise(OVERLAP_SIDE, OVERLAP_SIDE, &corners, |_| true);
    twice as f64 / faces.iter().filter(|&&f| f != NO_FACE).count().max(1) as f64
}
