//! Places of the sample chosen texel by texel, instead of by patches of the surface.
//!
//! A node stands for a square of `pitch` x `pitch` texels of the page, or for what a chart has of it: its place is what
//! the texel nearest to the square's centre shows. With more texels of the page than of the sample a node is about one
//! texel of the sample, and between nodes their places are continued and blended linearly; where they are one patch
//! that is the patch. Elsewhere every texel is a node, shown as it is and filtered over its own footprint.
//! Unaware of: how places are chosen.

use super::error::Error;
use super::lie::{Lie, alike, between, moved, step};
use crate::numerics::par;
use crate::texture::Texel;

/// Largest pitch.
const MAX_PITCH: f64 = 32.0;

/// Most nodes: bounds the memory of what corrects them.
pub const MAX_NODES: usize = 1 << 23;

/// Shares below this are not looked up.
const NEGLIGIBLE: f32 = 1e-4;

/// Places of the sample for the texels of an atlas.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TexelSources {
    /// Side of a node's square on the page in texels.
    pub pitch: u32,
    /// For each node the texel that shows its place (row times width plus column); nodes in the order of their squares, row
    /// by row, those of one square by chart.
    pub texels: Vec<u32>,
    /// For each node the place in the sample.
    pub places: Vec<Texel>,
}

impl TexelSources {
    /// What the corner coordinates say: at each node the place of the set that weighs most. Fails if there are more than
    /// [`MAX_NODES`].
    pub(crate) fn of_sets(lie: &Lie) -> Result<TexelSources, Error> {
        let density = lie.sample_per_page();
        let pitch = if density > 0.0 { (1.0 / density).round().clamp(1.0, MAX_PITCH) as u32 } else { 1 };
        let (wide, high) = (lie.atlas.width.div_ceil(pitch), lie.atlas.height.div_ceil(pitch));
        let chunks = par::map_chunks(high as usize, 16, |rows| {
            let mut found = vec![];
            let mut square = vec![];
            for (row, column) in rows.flat_map(|r| (0..wide).map(move |c| (r as u32, c))) {
                nearest_to_centre(lie, pitch, [column, row], &mut square);
                found.extend(square.iter().map(|s: &(u32, u32, u32)| s.2));
            }
            found
        });
        let found: usize = chunks.iter().map(Vec::len).sum();
        if found > MAX_NODES {
            return Err(Error::TooManyNodes { found });
        }
        let texels = chunks.concat();
        let places = par::map(texels.len(), |i| match lie.shown(texels[i]) {
            Some((face, b)) => lie.sets.at(lie.heaviest(face, b), face as usize, b),
            None => Texel::default(),
        });
        Ok(TexelSources { pitch, texels, places })
    }
}

/// The covered texel of each chart that is nearest to the middle of a square, the first of equals: chart, a measure of the
/// distance, texel.
fn nearest_to_centre(lie: &Lie, pitch: u32, [column, row]: [u32; 2], found: &mut Vec<(u32, u32, u32)>) {
    found.clear();
    let (w, h) = (lie.atlas.width, lie.atlas.height);
    for y in row * pitch..((row + 1) * pitch).min(h) {
        for x in column * pitch..((column + 1) * pitch).min(w) {
            let Some(face) = lie.coverage.face(x, y) else { continue };
            let away = |x: u32, c: u32| (2 * (x - c * pitch) + 1).abs_diff(pitch).pow(2);
            let (chart, away) = (lie.chart(face), away(x, column) + away(y, row));
            match found.iter_mut().find(|f| f.0 == chart) {
                Some(best) if best.1 <= away => {}
                Some(best) => (best.1, best.2) = (away, y * w + x),
                None => found.push((chart, away, y * w + x)),
            }
        }
    }
    found.sort_unstable();
}

/// A place of the sample and how much of it is shown, as a shift of the set that shapes it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Layer {
    pub shift: [f32; 2],
    pub weight: f32,
}

/// Sources ready to be looked up.
pub(crate) struct Nodes<'a> {
    pub lie: Lie<'a>,
    pub sources: &'a TexelSources,
    /// Where the nodes of each square start, and at last their number.
    starts: Vec<u32>,
    wide: u32,
    high: u32,
}

impl<'a> Nodes<'a> {
    /// Fails unless the sources are of this page: every texel covered, in order.
    pub fn new(lie: Lie<'a>, sources: &'a TexelSources) -> Result<Self, Error> {
        let TexelSources { pitch, texels, places } = sources;
        let mismatch = |what, found, expected| Err(Error::Mismatch { what, found, expected });
        if places.len() != texels.len() {
            return mismatch("places of nodes", places.len(), texels.len());
        }
        if *pitch == 0 {
            return mismatch("texels between nodes", 0, 1);
        }
        let (width, height) = (lie.atlas.width, lie.atlas.height);
        let (wide, high) = (width.div_ceil(*pitch), height.div_ceil(*pitch));
        let outside = |t: &&u32| **t / width >= height || lie.shown(**t).is_none();
        if let Some(t) = texels.iter().find(outside) {
            return mismatch("texels of nodes that nothing covers", *t as usize, 0);
        }
        let square = |t: u32| ((t / width / pitch) * wide + t % width / pitch) as usize;
        if !texels.is_sorted_by_key(|t| square(*t)) {
            return mismatch("orders of nodes", 0, 1);
        }
        let mut starts = vec![0u32; wide as usize * high as usize + 1];
        texels.iter().for_each(|t| starts[square(*t) + 1] += 1);
        (1..starts.len()).for_each(|i| starts[i] += starts[i - 1]);
        Ok(Nodes { lie, sources, starts, wide, high })
    }

    /// The node of a chart in a square, which may lie beyond the page.
    pub fn find(&self, [column, row]: [i64; 2], chart: u32) -> Option<u32> {
        if !(0..i64::from(self.wide)).contains(&column) || !(0..i64::from(self.high)).contains(&row) {
            return None;
        }
        let square = row as usize * self.wide as usize + column as usize;
        let is_of = |n: &u32| self.face(*n).is_some_and(|f| self.lie.chart(f) == chart);
        (self.starts[square]..self.starts[square + 1]).find(is_of)
    }

    /// The square that a position on the page lies in.
    pub fn square(&self, [x, y]: [f32; 2]) -> [i64; 2] {
        let pitch = self.sources.pitch as f32;
        [(x / pitch).floor() as i64, (y / pitch).floor() as i64]
    }

    /// Where a node is on the page.
    pub fn centre(&self, node: u32) -> [f32; 2] {
        self.lie.centre(self.sources.texels[node as usize])
    }

    /// The synthesis face that a node lies in; every node has one.
    fn face(&self, node: u32) -> Option<u32> {
        self.lie.shown(self.sources.texels[node as usize]).map(|s| s.0)
    }

    /// How the sample lies at a node.
    pub fn jacobian(&self, node: u32) -> super::lie::Jacobian {
        let shown = self.lie.shown(self.sources.texels[node as usize]);
        shown.map_or([[0.0; 2]; 2], |(face, b)| self.lie.jacobian(face, self.lie.heaviest(face, b)))
    }

    /// What is shown at a point: the set that shapes it, and up to four layers whose weights sum to 1. `at` is where the
    /// point lies on the page.
    pub fn layers(&self, face: u32, b: [f32; 3], at: [f32; 2], out: &mut Vec<Layer>) -> usize {
        out.clear();
        let set = self.lie.heaviest(face, b);
        let (here, own) = (self.lie.jacobian(face, set), self.lie.sets.at(set, face as usize, b));
        let pitch = self.sources.pitch as f32;
        let from = at.map(|x| x / pitch - 0.5);
        let (corner, share) = (from.map(f32::floor), from.map(|x| x - x.floor()));
        for (i, j) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let along = |k: usize, side: i64| if side == 1 { share[k] } else { 1.0 - share[k] };
            let weight = along(0, i) * along(1, j);
            if weight < NEGLIGIBLE {
                continue;
            }
            let square = [corner[0] as i64 + i, corner[1] as i64 + j];
            let Some(node) = self.find(square, self.lie.chart(face)) else { continue };
            let there = self.jacobian(node);
            if alike(&here, &there) {
                let c = self.centre(node);
                let by = step(&between(&here, &there), [at[0] - c[0], at[1] - c[1]]);
                let to = moved(self.sources.places[node as usize], by);
                out.push(Layer { shift: [to.x - own.x, to.y - own.y], weight });
            }
        }
        let sum: f32 = out.iter().map(|l| l.weight).sum();
        out.iter_mut().for_each(|l| l.weight /= sum);
        if out.is_empty() {
            out.push(Layer { shift: [0.0; 2], weight: 1.0 });
        }
        set
    }
}
