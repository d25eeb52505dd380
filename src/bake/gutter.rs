//! What the texels around a chart show: the surface beyond the chart's border.
//!
//! A texel outside all charts belongs to the nearest border within reach. The chart on the other side of that border is
//! laid beside it - turned, scaled and if need be mirrored so that the common edge coincides - and the texel shows what
//! lies there. So filters that reach over a border, and mip levels, see the same on both sides of a seam. Where nothing
//! lies there (the mesh's own boundary, a chart narrower than the reach) the texel shows the nearest point of the border.
//!
//! Source: the gutter of \[MK03\] 3.3.1 is a plain dilation; the unfolding is ours.
//! Unaware of: textures.

use super::atlas::{Atlas, NO_CHART};
use super::border::Border;
use super::coverage::{Coverage, NO_FACE, STRIP, by_strip, clamp_bary};
use crate::mesh::SynthesisMesh;
use crate::numerics::par;
use crate::numerics::vec::{Vec2, vec2};

/// A texel outside all charts but near one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct GutterTexel {
    /// Index of the texel: row times width plus column.
    pub texel: u32,
    /// Face of the synthesis mesh that the texel shows.
    pub face: u32,
    /// Where in that face.
    pub bary: [f32; 3],
    /// The border it looks across, or [`NO_BORDER`] if it shows a point of its own side.
    pub across: u32,
}

/// Not a border.
pub(crate) const NO_BORDER: u32 = u32::MAX;

/// A border on the page, in texels.
struct Line {
    a: Vec2,
    b: Vec2,
    len2: f64,
}

impl Line {
    fn new(atlas: &Atlas, corners: [u32; 2]) -> Line {
        let [a, b] = corners.map(|c| atlas.corner_px(c as usize));
        Line { a, b, len2: (b - a).dot(b - a) }
    }

    /// Share of the way from `a` to `b` of the nearest point.
    fn nearest(&self, p: Vec2) -> f64 {
        if self.len2 > 0.0 { ((p - self.a).dot(self.b - self.a) / self.len2).clamp(0.0, 1.0) } else { 0.0 }
    }

    fn at(&self, t: f64) -> Vec2 {
        self.a + (self.b - self.a) * t
    }

    /// Distance from the line to the left of `a -> b` as seen with y up, in lengths of the line.
    fn left(&self, p: Vec2) -> f64 {
        (self.b - self.a).cross(p - self.a) / self.len2
    }
}

/// All gutter texels within `reach` texels of a border, in ascending order.
pub(crate) fn gutter(coverage: &Coverage, synthesis: &SynthesisMesh, atlas: &Atlas, reach: u32) -> Vec<GutterTexel> {
    let context = Context { coverage, synthesis, atlas, children: children(synthesis, atlas.chart.len()) };
    let lines: Vec<Line> = coverage.borders().iter().map(|b| Line::new(atlas, b.corners)).collect();
    let reach = f64::from(reach);
    let strips = by_strip(coverage.height(), lines.len(), |i| {
        let (lo, hi) = (lines[i].a.y.min(lines[i].b.y), lines[i].a.y.max(lines[i].b.y));
        Some(((lo - reach).floor() as i64, (hi + reach).ceil() as i64 + 1))
    });
    let found = par::map_chunks(strips.len(), 1, |s| {
        let rows = s.start as u32 * STRIP..(s.end as u32 * STRIP).min(coverage.height());
        let owner = nearest_borders(coverage, &lines, &strips[s.start], rows.clone(), reach);
        let w = coverage.width() as usize;
        let texels = owner.iter().enumerate().filter(|(_, b)| **b != NO_FACE);
        texels
            .filter_map(|(i, &b)| {
                let p = vec2((i % w) as f64 + 0.5, f64::from(rows.start) + (i / w) as f64 + 0.5);
                let (line, border) = (&lines[b as usize], &coverage.borders()[b as usize]);
                let texel = rows.start * w as u32 + i as u32;
                if let Some((face, bary)) = context.across(p, line, border) {
                    return Some(GutterTexel { texel, face, bary, across: b });
                }
                let (face, bary) = context.beside(line.at(line.nearest(p)), border.corners[0] / 3)?;
                Some(GutterTexel { texel, face, bary, across: NO_BORDER })
            })
            .collect::<Vec<_>>()
    });
    found.into_iter().flatten().collect()
}

/// For each texel of some rows the nearest border within reach, if the texel is free; the lowest of equals.
fn nearest_borders(
    coverage: &Coverage,
    lines: &[Line],
    candidates: &[u32],
    rows: std::ops::Range<u32>,
    reach: f64,
) -> Vec<u32> {
    let w = coverage.width() as usize;
    let mut best = vec![(reach * reach, NO_FACE); w * rows.len()];
    for &i in candidates {
        let line = &lines[i as usize];
        let (lo, hi) = (line.a.y.min(line.b.y) - reach, line.a.y.max(line.b.y) + reach);
        let y0 = (lo.floor() as i64).max(i64::from(rows.start)) as u32;
        let y1 = (hi.ceil() as i64).min(i64::from(rows.end)).max(0) as u32;
        for y in y0..y1 {
            let (x0, x1) = span(line, f64::from(y) + 0.5, reach);
            let (x0, x1) = ((x0.floor() as i64).max(0) as usize, (x1.ceil() as i64).clamp(0, w as i64) as usize);
            let faces = coverage.row(y);
            let out = &mut best[(y - rows.start) as usize * w..][..w];
            for x in x0..x1 {
                if faces[x] != NO_FACE {
                    continue;
                }
                let p = vec2(x as f64 + 0.5, f64::from(y) + 0.5);
                let d = p - line.at(line.nearest(p));
                let d2 = d.dot(d);
                if d2 < out[x].0 {
                    out[x] = (d2, i);
                }
            }
        }
    }
    best.into_iter().map(|(_, i)| i).collect()
}

/// Columns that can lie within reach of a line in the row at `y`.
fn span(line: &Line, y: f64, reach: f64) -> (f64, f64) {
    let (dy, dx) = (line.b.y - line.a.y, line.b.x - line.a.x);
    let (lo, hi) = (line.a.x.min(line.b.x), line.a.x.max(line.b.x));
    if dy.abs() <= reach {
        return (lo - reach, hi + reach);
    }
    let t = |y: f64| ((y - line.a.y) / dy).clamp(0.0, 1.0);
    let (xa, xb) = (line.a.x + dx * t(y - reach), line.a.x + dx * t(y + reach));
    (xa.min(xb) - reach, xa.max(xb) + reach)
}

struct Context<'a> {
    coverage: &'a Coverage,
    synthesis: &'a SynthesisMesh,
    atlas: &'a Atlas,
    /// Synthesis faces of each face of the surface: rows of starts and entries.
    children: (Vec<u32>, Vec<u32>),
}

impl Context<'_> {
    /// The place in the neighbouring chart when its edge is laid on the border.
    fn across(&self, p: Vec2, line: &Line, border: &Border) -> Option<(u32, [f32; 3])> {
        let partner = border.partner?;
        let other = Line::new(self.atlas, partner);
        let chart = self.atlas.chart[partner[0] as usize / 3];
        if chart == NO_CHART || line.len2 <= 0.0 || other.len2 <= 0.0 {
            return None;
        }
        let side = |l: &Line, c: [u32; 2]| l.left(self.atlas.corner_px(third(c))).signum();
        let out = -side(line, border.corners) * line.left(p);
        let along = (p - line.a).dot(line.b - line.a) / line.len2;
        let (e, inward) = (other.b - other.a, side(&other, partner) * out);
        let place = other.at(along) + vec2(-e.y, e.x) * inward;
        self.coverage.find(self.synthesis, self.atlas, place, chart)
    }

    /// A place on or next to a face of the surface, in the synthesis face that holds it best.
    fn beside(&self, p: Vec2, face: u32) -> Option<(u32, [f32; 3])> {
        let chart = self.atlas.chart[face as usize];
        self.coverage.find(self.synthesis, self.atlas, p, chart).or_else(|| {
            let (starts, entries) = &self.children;
            let row = &entries[starts[face as usize] as usize..starts[face as usize + 1] as usize];
            let inside = |b: [f32; 3]| b[0].min(b[1]).min(b[2]);
            let all = row.iter().map(|&f| (f, self.coverage.to_bary(f).at(p.x as f32, p.y as f32)));
            let best = all.max_by(|a, b| inside(a.1).total_cmp(&inside(b.1)).then(b.0.cmp(&a.0)));
            best.map(|(f, b)| (f, clamp_bary(b)))
        })
    }
}

/// The corner of the same face that is neither of two.
fn third(corners: [u32; 2]) -> usize {
    let base = corners[0] / 3 * 3;
    (3 * base + 3 - corners[0] - corners[1]) as usize
}

fn children(synthesis: &SynthesisMesh, parents: usize) -> (Vec<u32>, Vec<u32>) {
    let mut starts = vec![0u32; parents + 1];
    synthesis.parent.iter().for_each(|&p| starts[p as usize + 1] += 1);
    (0..parents).for_each(|i| starts[i + 1] += starts[i]);
    let (mut fill, mut entries) = (starts.clone(), vec![0u32; synthesis.parent.len()]);
    for (f, &p) in synthesis.parent.iter().enumerate() {
        entries[fill[p as usize] as usize] = f as u32;
        fill[p as usize] += 1;
    }
    (starts, entries)
}
