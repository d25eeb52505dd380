//! The texels of an atlas as a graph on the surface, with what is to be expected from one to the next.
//!
//! Source: the correction in atlases of Lefebvre and Hoppe 2006 (section 5: samples on a page, offsets by the Jacobian, look-ups
//! that go on in the chart across a border); as a graph for minimum cuts it is ours.
//! Nodes are those of [`TexelSources`]. Neighbours within a chart are the six around a node (right, down, and one diagonal),
//! as on a mesh; beyond a border it is the node nearest to where the surface goes on in the other chart, which the gutter
//! knows. Offsets are in texels of the sample, by the mean of both ends' Jacobians. Where both show one patch it is
//! what that patch has between them, so that a patch costs nothing. Where the sample lies turned, or an edge would
//! take too much of it, there is none.
//! Unaware of: how places are corrected, what the sample looks like.

use super::atlas::Atlas;
use super::coverage::{Coverage, NO_FACE};
use super::error::Error;
use super::gutter::NO_BORDER;
use super::lie::{Lie, alike, alike_along, between, step};
use super::texel_sources::{Nodes, TexelSources};
use crate::mesh::SynthesisMesh;
use crate::numerics::par;
use crate::numerics::vec::{Vec2, vec2};
use crate::uvset::UvSets;

/// An edge spans at most this part of the sample along each axis.
const LONGEST: f32 = 0.125;

/// Ends of an edge whose places differ by this much less or more than expected, in texels, show one patch.
const SAME_PATCH: f32 = 0.25;

/// The neighbours of a node that come after it.
const AFTER: [[i64; 2]; 3] = [[1, 0], [0, 1], [1, 1]];

/// Nodes of an atlas and the offsets between them.
#[derive(Clone, Debug, Default)]
pub struct TexelGraph {
    /// The nodes, with the places that the corner coordinates give them.
    pub sources: TexelSources,
    /// Where each node's edges start, and at last their number.
    pub starts: Vec<u32>,
    /// The node that each edge leads to.
    pub targets: Vec<u32>,
    /// Offset along each edge in texels of the sample; those of the two directions are opposite.
    pub offsets: Vec<Vec2>,
    /// Edges, counted once, that lead from one chart's border to another's.
    pub across: usize,
}

/// Two nodes, the lower first, and the offset between them.
type Edge = (u32, u32, [f32; 2]);

impl TexelGraph {
    /// Makes the graph of a page. Fails if something does not belong together, or if there are more than
    /// [`MAX_NODES`](super::MAX_NODES) nodes.
    pub fn new(
        coverage: &Coverage,
        synthesis: &SynthesisMesh,
        atlas: &Atlas,
        sets: &UvSets,
    ) -> Result<TexelGraph, Error> {
        let (found, expected) = (sets.face_count(), synthesis.mesh.faces.len());
        if found != expected {
            return Err(Error::Mismatch { what: "faces with texture coordinates", found, expected });
        }
        let lie = Lie { coverage, synthesis, atlas, sets };
        let sources = TexelSources::of_sets(&lie)?;
        let nodes = Nodes::new(lie, &sources)?;
        let side = sets.exemplar_size[0].min(sets.exemplar_size[1]).max(1);
        let maker = Maker { nodes, longest: (side - 1) as f32 * LONGEST };
        let chunks = par::map_chunks(sources.texels.len(), 4096, |some| {
            let (mut inner, mut crossing) = (vec![], vec![]);
            for node in some {
                maker.within(node as u32, &mut inner);
                maker.across(node as u32, &mut crossing);
            }
            (inner, crossing)
        });
        let (inner, crossing): (Vec<_>, Vec<_>) = chunks.into_iter().unzip();
        // Both ends may have found an edge, and found it a little different.
        let mut crossing = crossing.concat();
        crossing.sort_unstable_by_key(|e: &Edge| (e.0, e.1, e.2.map(f32::to_bits)));
        crossing.dedup_by_key(|e| (e.0, e.1));
        let across = crossing.len();
        let edges = inner.iter().flatten().chain(&crossing);
        let (starts, targets, offsets) = rows(sources.texels.len(), edges);
        Ok(TexelGraph { starts, targets, offsets, across, sources })
    }
}

/// The edges as rows of both directions.
fn rows<'a>(count: usize, edges: impl Iterator<Item = &'a Edge> + Clone) -> (Vec<u32>, Vec<u32>, Vec<Vec2>) {
    let mut starts = vec![0u32; count + 1];
    for (a, b, _) in edges.clone() {
        starts[*a as usize + 1] += 1;
        starts[*b as usize + 1] += 1;
    }
    (0..count).for_each(|i| starts[i + 1] += starts[i]);
    let (mut fill, halves) = (starts.clone(), starts[count] as usize);
    let (mut targets, mut offsets) = (vec![0; halves], vec![Vec2::ZERO; halves]);
    for (a, b, d) in edges {
        let d = vec2(d[0].into(), d[1].into());
        for (from, to, d) in [(*a, *b, d), (*b, *a, -d)] {
            let slot = &mut fill[from as usize];
            (targets[*slot as usize], offsets[*slot as usize]) = (to, d);
            *slot += 1;
        }
    }
    (starts, targets, offsets)
}

struct Maker<'a> {
    nodes: Nodes<'a>,
    longest: f32,
}

impl Maker<'_> {
    /// Edges to nodes of the same chart that come after.
    fn within(&self, node: u32, out: &mut Vec<Edge>) {
        let (at, chart) = (self.nodes.centre(node), self.chart(node));
        let (here, square) = (self.nodes.jacobian(node), self.nodes.square(at));
        for [dx, dy] in AFTER {
            let Some(other) = self.nodes.find([square[0] + dx, square[1] + dy], chart) else { continue };
            let there = self.nodes.jacobian(other);
            if alike(&here, &there) {
                let to = self.nodes.centre(other);
                self.join(node, other, step(&between(&here, &there), [to[0] - at[0], to[1] - at[1]]), out);
            }
        }
    }

    /// Edges to nodes beyond a border, in the directions in which the chart has none.
    fn across(&self, node: u32, out: &mut Vec<Edge>) {
        let (at, chart) = (self.nodes.centre(node), self.chart(node));
        let square = self.nodes.square(at);
        for [dx, dy] in AFTER.into_iter().flat_map(|[x, y]| [[x, y], [-x, -y]]) {
            if self.nodes.find([square[0] + dx, square[1] + dy], chart).is_none() {
                self.beyond(node, [dx as f32, dy as f32], out);
            }
        }
    }

    /// The edge over the border that lies in a direction, if there is one.
    fn beyond(&self, node: u32, direction: [f32; 2], out: &mut Vec<Edge>) {
        let (lie, at) = (&self.nodes.lie, self.nodes.centre(node));
        let (w, h) = (lie.atlas.width as f32, lie.atlas.height as f32);
        // The first texel outside.
        let line = (1..=2 * self.nodes.sources.pitch).map(|k| direction.map(|d| d * k as f32));
        let first = line.map(|by| (by, [at[0] + by[0], at[1] + by[1]])).find(|(_, p)| {
            let inside = p[0] >= 0.0 && p[1] >= 0.0 && p[0] < w && p[1] < h;
            !inside || lie.coverage.row(p[1] as u32)[p[0] as usize] == NO_FACE
        });
        let Some((by, p)) = first.filter(|(_, p)| p[0] >= 0.0 && p[1] >= 0.0 && p[0] < w && p[1] < h) else { return };
        let texel = p[1] as u32 * lie.atlas.width + p[0] as u32;
        let Some(g) = lie.coverage.gutter_at(texel).filter(|g| g.across != NO_BORDER) else { return };
        // Where that is in the other chart, and the node nearest to it.
        let (place, chart) = (lie.on_page(g.face, g.bary), lie.chart(g.face));
        let Some((other, way)) = self.nearest(place, chart, node) else { return };
        let (here, there) = (self.nodes.jacobian(node), self.nodes.jacobian(other));
        let border = &lie.coverage.borders()[g.across as usize];
        let Some(partner) = border.partner else { return };
        let edge = |c: [u32; 2]| {
            let [a, b] = c.map(|c| lie.atlas.corner_px(c as usize));
            [(b.x - a.x) as f32, (b.y - a.y) as f32]
        };
        // Both charts must agree on how the sample lies along the border.
        if alike_along(step(&here, edge(border.corners)), step(&there, edge(partner))) {
            let (out_of, into) = (step(&here, by), step(&there, way));
            self.join(node, other, [out_of[0] + into[0], out_of[1] + into[1]], out);
        }
    }

    /// The node of a chart nearest to a place on the page, the first of equals, if it is not `but`; and the way to it.
    fn nearest(&self, place: [f32; 2], chart: u32, but: u32) -> Option<(u32, [f32; 2])> {
        let square = self.nodes.square(place);
        let around = (-1..=1).flat_map(|y| (-1..=1).map(move |x| [square[0] + x, square[1] + y]));
        let candidates = around.filter_map(|s| self.nodes.find(s, chart)).map(|n| {
            let c = self.nodes.centre(n);
            (n, [c[0] - place[0], c[1] - place[1]])
        });
        let square = |d: [f32; 2]| d[0] * d[0] + d[1] * d[1];
        candidates.filter(|c| c.0 != but).min_by(|a, b| square(a.1).total_cmp(&square(b.1)).then(a.0.cmp(&b.0)))
    }

    fn chart(&self, node: u32) -> u32 {
        let shown = self.nodes.lie.shown(self.nodes.sources.texels[node as usize]);
        shown.map_or(super::NO_CHART, |s| self.nodes.lie.chart(s.0))
    }

    /// Notes an edge, unless it is too long.
    fn join(&self, a: u32, b: u32, d: [f32; 2], out: &mut Vec<Edge>) {
        if !d.iter().all(|x| x.abs() <= self.longest) {
            return;
        }
        let [p, q] = [a, b].map(|n| self.nodes.sources.places[n as usize]);
        let found = [q.x - p.x, q.y - p.y];
        let same = (0..2).all(|i| (found[i] - d[i]).abs() < SAME_PATCH);
        let d = if same && found.iter().all(|x| x.abs() <= self.longest) { found } else { d };
        out.push(if a < b { (a, b, d) } else { (b, a, d.map(|x| -x)) });
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{Bench, flat_set, plane, refined, scattered, sphere, synthesis};
    use super::super::{Extent, Filter, Inputs, Library, UnwrapParams, bake_map, unwrap};
    use super::*;
    use crate::numerics::rng::Key;
    use crate::texture::{MapKind, Texture, Uv, texel};
    use crate::uvset::Blend;

    impl Bench {
        /// A plane whose right half is a chart of its own, turned by a quarter.
        fn cut_plane(side: u32) -> Bench {
            let mut surface = plane(4);
            for corners in surface.corner_uvs[0].chunks_exact_mut(3) {
                let right = corners.iter().map(|c| c.u).sum::<f32>() > 1.5;
                for c in corners {
                    let (x, y) = (c.u - if right { 0.5 } else { 0.0 }, c.v);
                    *c = if right {
                        Uv { u: 0.02 + 0.45 * y, v: 0.95 - 0.45 * x }
                    } else {
                        Uv { u: 0.45 * x, v: 0.45 * y }
                    };
                }
            }
            let atlas = Atlas::keep(&surface, 0, side).unwrap();
            assert_eq!(atlas.chart_count, 2);
            let synthesis = refined(&surface, 2);
            Bench::new(surface, synthesis, atlas, 2)
        }

        fn small_sphere() -> Bench {
            let surface = sphere(3);
            let params = UnwrapParams { extent: Extent::Page(128), gutter_px: 4, library: Library::Uvunwrap };
            let atlas = unwrap(&surface, &params).unwrap();
            let synthesis = synthesis(&surface);
            Bench::new(surface, synthesis, atlas, 2)
        }

        fn graph(&self, sets: &UvSets) -> TexelGraph {
            TexelGraph::new(&self.coverage, &self.synthesis, &self.atlas, sets).unwrap()
        }
    }

    fn noise(size: u32) -> Texture {
        let key = Key::new(3);
        Texture::from_fn(size, size, 3, |x, y, out| {
            let key = key.with(u64::from(y * size + x));
            (0..).zip(out).for_each(|(k, o)| *o = key.unit(k) as f32);
        })
    }

    #[test]
    fn one_patch_is_continued_along_every_edge_and_across_charts() {
        for (scale, pitch) in [(29.0, 1), (14.0, 2), (7.0, 4)] {
            let bench = Bench::cut_plane(64);
            let sets = flat_set(&bench.synthesis.mesh, [64, 64], scale);
            let g = bench.graph(&sets);
            assert_eq!(g.sources.pitch, pitch);
            // 28.8 texels of the page along the cut.
            assert!(g.across >= 25 / pitch as usize, "{} across at pitch {pitch}", g.across);
            let mut six = 0;
            for v in 0..g.sources.texels.len() {
                let edges = g.starts[v] as usize..g.starts[v + 1] as usize;
                six += usize::from(edges.len() == 6);
                for e in edges {
                    let (a, b) = (g.sources.places[v], g.sources.places[g.targets[e] as usize]);
                    // Expected within a quarter of a texel, so what was found.
                    let gap = [f64::from(b.x - a.x) - g.offsets[e].x, f64::from(b.y - a.y) - g.offsets[e].y];
                    assert!(gap[0].abs() < 1e-4 && gap[1].abs() < 1e-4, "{gap:?} at {v}, pitch {pitch}");
                }
            }
            assert!(pitch > 1 || six * 10 > g.sources.texels.len() * 8, "{six}");
        }
    }

    #[test]
    fn places_of_the_sets_bake_as_the_sets_do() {
        for scale in [29.0, 7.0] {
            let bench = Bench::cut_plane(64);
            let sets = flat_set(&bench.synthesis.mesh, [64, 64], scale);
            let sources = bench.graph(&sets).sources;
            for kind in [MapKind::BaseColor, MapKind::Normal] {
                let (plain, chosen) =
                    (bench.bake(&sets, None, kind, &noise(64)), bench.bake(&sets, Some(&sources), kind, &noise(64)));
                let worst = plain.data().iter().zip(chosen.data()).fold(0.0f32, |m, (a, b)| m.max((a - b).abs()));
                assert!(worst < 1e-2, "{worst} at scale {scale}, {}", kind.name());
            }
            // Moved by whole texels it is the sample from there.
            let places = sources.places.iter().map(|p| texel(p.x + 3.0, p.y - 2.0)).collect();
            let there = bench.bake(&sets, Some(&TexelSources { places, ..sources }), MapKind::BaseColor, &noise(64));
            let mut moved = sets.clone();
            moved.sets[0].iter_mut().for_each(|p| *p = texel(p.x + 3.0, p.y - 2.0));
            let expected = bench.bake(&moved, None, MapKind::BaseColor, &noise(64));
            let worst = there.data().iter().zip(expected.data()).fold(0.0f32, |m, (a, b)| m.max((a - b).abs()));
            assert!(worst < 1e-2, "{worst} at scale {scale}");
        }
    }

    #[test]
    fn no_edge_leads_to_where_the_sample_lies_turned() {
        let bench = Bench::cut_plane(64);
        let straight = flat_set(&bench.synthesis.mesh, [64, 64], 29.0);
        let mut turned = straight.clone();
        for (corners, mesh) in turned.sets[0].chunks_exact_mut(3).zip(&bench.synthesis.mesh.faces) {
            if mesh.iter().map(|v| bench.synthesis.mesh.positions[*v as usize].x).sum::<f64>() > 1.5 {
                corners.iter_mut().for_each(|p| *p = texel(p.y, 64.0 - p.x));
            }
        }
        let [straight, turned] = [straight, turned].map(|sets| bench.graph(&sets));
        assert!(straight.across > 0 && turned.across == 0);
        assert_eq!(straight.targets.len() - turned.targets.len(), 2 * straight.across);
    }

    #[test]
    fn edges_go_both_ways_and_are_short() {
        let bench = Bench::small_sphere();
        let sets = scattered(&bench.synthesis.mesh, [64, 64], bench.atlas.texels_per_unit, Blend::Linear);
        let g = bench.graph(&sets);
        let row = |v: u32| g.starts[v as usize] as usize..g.starts[v as usize + 1] as usize;
        for v in 0..g.sources.texels.len() as u32 {
            for e in row(v) {
                let (w, d) = (g.targets[e], g.offsets[e]);
                assert!(v != w && d.x.abs() < 8.0 && d.y.abs() < 8.0);
                assert!(row(w).any(|b| g.targets[b] == v && g.offsets[b] == -d), "{v} to {w}");
            }
        }
    }

    #[test]
    fn sources_of_another_page_are_refused() {
        let bench = Bench::cut_plane(64);
        let sets = flat_set(&bench.synthesis.mesh, [64, 64], 29.0);
        let good = bench.graph(&sets).sources;
        let bake = |sources: &TexelSources| {
            let Bench { surface, synthesis, atlas, tangents, coverage } = &bench;
            let sources = Some(sources);
            let inputs =
                Inputs { surface, synthesis, atlas, coverage, tangents, sets: &sets, sources, filter: Filter::Linear };
            bake_map(&inputs, MapKind::BaseColor, &noise(64)).map(|_| ()).map_err(|e| e.to_string())
        };
        assert_eq!(bake(&good), Ok(()));
        let few = TexelSources { places: good.places[1..].to_vec(), ..good.clone() };
        assert!(bake(&few).unwrap_err().starts_with("places of nodes"));
        let outside = TexelSources { texels: vec![64 * 64], places: vec![texel(1.0, 1.0)], pitch: 1 };
        assert!(bake(&outside).unwrap_err().contains("nothing covers"));
        let none = TexelSources { pitch: 0, ..good.clone() };
        assert!(bake(&none).unwrap_err().starts_with("texels between nodes"));
        let mut mixed = good;
        mixed.texels.swap(0, 100);
        assert!(bake(&mixed).unwrap_err().starts_with("orders of nodes"));
    }
}
