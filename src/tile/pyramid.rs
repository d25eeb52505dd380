//! A key exemplar at one resolution, as constrained synthesis compares it.
//!
//! Source: \[MST09\] section 1.2; Lefebvre, Hoppe: Appearance-space texture synthesis (2006), whose stack of blurred but not
//! decimated exemplars this is: at every resolution any texel of the key can be referred to.
//! In: planes of the maps, the mask. Out: for each texel a vector of 16 numbers; its most similar texels; the texels by
//! their place in or between features.
//! Reads as: section 1.2 has 3 x 3 neighbourhoods reduced to 8 numbers, section 4 has 5 x 5 texels of colours reduced to 5
//! and 3 x 3 of the mask reduced to 3: the latter says what the eight are. Here 5 x 5 of the maps become [`MAP_DIMS`], since a
//! set has more than colours, and 3 x 3 of the mask [`MASK_DIMS`]: sixteen compare as fast as nine. Both parts are means over
//! their window, the mask scaled by two as printed.
//! Unaware of: layers, what is synthesised.

use super::Mask;
use super::distance::signed_distance;
use super::planes::Planes;
use crate::numerics::knn::{self, Effort, Points};
use crate::numerics::par;
use crate::numerics::pca::{self, Pca};
use crate::numerics::rng::Key;

/// Numbers that the neighbourhood in the maps is reduced to.
pub(super) const MAP_DIMS: usize = 10;
/// Numbers that the neighbourhood in the mask is reduced to.
pub(super) const MASK_DIMS: usize = 6;
/// Both.
pub(super) const DIMS: usize = MAP_DIMS + MASK_DIMS;
/// Texels around the middle of a window of maps, of the mask.
const MAP_REACH: i32 = 2;
const MASK_REACH: i32 = 1;
/// What the mask is scaled by.
const MASK_SCALE: f32 = 2.0;
/// Similar texels that are known of each texel.
pub(super) const SIMILAR: usize = 3;
/// Clusters in which those are looked for.
const PROBES: usize = 6;
/// Texels from which principal directions are found.
const SAMPLES: usize = 2048;
/// No component of a vector is larger: sixteen such stay within the range of points.
const LARGEST: f32 = 4095.0;
/// Distances from a border, in texels of the level, beyond which places are alike.
const DEEP: i32 = 4;
/// Directions of the border that are told apart.
const DIRECTIONS: i32 = 8;

/// A principal projection: rows of numbers per value of a window.
pub(super) struct Projection<const N: usize> {
    start: [f32; N],
    rows: Vec<[f32; N]>,
}

impl<const N: usize> Projection<N> {
    fn new(pca: &Pca, scale: f64) -> Self {
        let column = |f: &dyn Fn(&[f64]) -> f64| -> [f32; N] {
            std::array::from_fn(|j| pca.basis.get(j).map_or(0.0, |b| (f(b) * scale) as f32))
        };
        let start = column(&|b| -b.iter().zip(&pca.mean).fold(0.0, |s, (b, m)| s + b * m));
        let rows = (0..pca.mean.len()).map(|t| column(&|b| b[t])).collect();
        Projection { start, rows }
    }

    /// The reduced values of a window.
    #[inline]
    pub fn of(&self, values: impl Iterator<Item = f32>) -> [f32; N] {
        let mut sums = self.start;
        for (row, v) in self.rows.iter().zip(values) {
            sums.iter_mut().zip(row).for_each(|(s, r)| *s += v * r);
        }
        sums
    }
}

/// The steps of a window around its middle.
pub(super) fn window(reach: i32) -> impl Iterator<Item = [i32; 2]> {
    (-reach..=reach).flat_map(move |y| (-reach..=reach).map(move |x| [x, y]))
}

/// Sides of the torus of a key and of its grid at a level: every `step`-th texel, also where that does not divide a side.
#[derive(Clone, Copy)]
pub(super) struct Grid {
    pub width: usize,
    pub height: usize,
    pub step: usize,
}

impl Grid {
    /// Columns and rows of the grid.
    pub fn size(&self) -> [usize; 2] {
        [self.width.div_ceil(self.step), self.height.div_ceil(self.step)]
    }

    /// The texel of the key at some grid steps from another.
    #[inline(always)]
    pub fn stepped(&self, texel: u32, [dx, dy]: [i32; 2]) -> u32 {
        let (x, y) = (texel as usize % self.width, texel as usize / self.width);
        let wrap = |v: usize, d: i32, n: usize| {
            let v = v as i32 + d * self.step as i32;
            let n = n as i32;
            // Steps are shorter than a side, but for tiny keys.
            (if v < 0 || v >= n { v.rem_euclid(n) } else { v }) as usize
        };
        (wrap(y, dy, self.height) * self.width + wrap(x, dx, self.width)) as u32
    }

    /// The texel at a place of the grid.
    #[inline(always)]
    pub fn texel(&self, place: usize) -> u32 {
        let columns = self.size()[0];
        (place / columns * self.step * self.width + place % columns * self.step) as u32
    }

    /// The place in the grid at some steps from another, around its own torus.
    #[inline(always)]
    pub fn place(&self, place: usize, [dx, dy]: [i32; 2]) -> usize {
        let [columns, rows] = self.size();
        let wrap = |v: usize, d: i32, n: usize| (v as i32 + d).rem_euclid(n as i32) as usize;
        wrap(place / columns, dy, rows) * columns + wrap(place % columns, dx, columns)
    }
}

/// A key at one resolution.
pub(super) struct Level {
    pub grid: Grid,
    pub planes: Planes,
    pub maps: Projection<MAP_DIMS>,
    pub mask: Projection<MASK_DIMS>,
    pub points: Points,
    /// [`SIMILAR`] texels for each.
    pub similar: Vec<u32>,
    /// Mean squared distance of a texel from its most similar one.
    pub spread: f64,
    pub places: Places,
}

impl Level {
    /// `planes` of the maps and `mask` are blurred for the level; `phi` is the signed distance of the mask as it is.
    pub fn new(grid: Grid, planes: Vec<Vec<f32>>, mask: &[f32], phi: &[f32]) -> Self {
        let planes = Planes::joined(&planes);
        let texels = grid.width * grid.height;
        let maps_at = |t: usize| map_window(&planes, move |d| grid.stepped(t as u32, d));
        let mask_at = |t: usize| mask_window(&grid, mask, t as u32);
        let key = Key::new(0).with_str("principal directions");
        let count = SAMPLES.min(texels);
        let sampled = |i: usize| {
            let (start, end) = (i * texels / count, (i + 1) * texels / count);
            start + key.below(i as u64, (end - start) as u32) as usize
        };
        let of_maps: Vec<f32> = (0..count).flat_map(|i| maps_at(sampled(i)).collect::<Vec<_>>()).collect();
        let of_mask: Vec<f32> = (0..count).flat_map(|i| mask_at(sampled(i)).collect::<Vec<_>>()).collect();
        let (map_len, mask_len) = (of_maps.len() / count, of_mask.len() / count);
        let maps = pca::fit_up_to(&of_maps, map_len, 1.0, MAP_DIMS);
        let mask_pca = pca::fit_up_to(&of_mask, mask_len, 1.0, MASK_DIMS);
        // Means over the windows: per texel of them, all channels of a texel together.
        let scales = [(f64::from(MAP_REACH * 2 + 1)).recip(), f64::from(MASK_SCALE) / f64::from(MASK_REACH * 2 + 1)];
        let (maps, mask_projection) = (Projection::new(&maps, scales[0]), Projection::new(&mask_pca, scales[1]));
        let vectors = par::map(texels, |t| joined(maps.of(maps_at(t)), mask_projection.of(mask_at(t))));
        let largest = vectors.iter().flatten().fold(0.0f32, |m, v| m.max(v.abs()));
        let scale = if largest > 0.0 { LARGEST / largest } else { 1.0 };
        let mut points = Points::new(texels, DIMS, f64::from(scale));
        let stride = points.stride();
        for (point, vector) in points.data_mut().chunks_exact_mut(stride).zip(&vectors) {
            point[..DIMS].copy_from_slice(&rounded(vector, scale));
        }
        let (similar, spread) = similar(&points);
        Level { grid, planes, maps, mask: mask_projection, points, similar, spread, places: Places::new(&grid, phi) }
    }

    /// A vector as a point.
    #[inline]
    pub fn point(&self, maps: [f32; MAP_DIMS], mask: [f32; MASK_DIMS]) -> [i16; DIMS] {
        rounded(&joined(maps, mask), self.points.scale() as f32)
    }
}

fn joined(maps: [f32; MAP_DIMS], mask: [f32; MASK_DIMS]) -> [f32; DIMS] {
    std::array::from_fn(|i| if i < MAP_DIMS { maps[i] } else { mask[i - MAP_DIMS] })
}

#[inline]
fn rounded(vector: &[f32; DIMS], scale: f32) -> [i16; DIMS] {
    vector.map(|v| (v * scale).round().clamp(-LARGEST, LARGEST) as i16)
}

/// The values of a window of the maps, whose texels `texel` says by their steps from the middle.
#[inline]
pub(super) fn map_window<'a>(
    planes: &'a Planes,
    texel: impl Fn([i32; 2]) -> u32 + 'a,
) -> impl Iterator<Item = f32> + 'a {
    window(MAP_REACH).flat_map(move |d| planes.at(texel(d) as usize).iter().copied())
}

/// The values of a window of a blurred mask.
pub(super) fn mask_window<'a>(grid: &'a Grid, mask: &'a [f32], texel: u32) -> impl Iterator<Item = f32> + 'a {
    window(MASK_REACH).map(move |d| mask[grid.stepped(texel, d) as usize])
}

/// The most similar texels of each, and the mean squared distance of the first.
fn similar(points: &Points) -> (Vec<u32>, f64) {
    let found = knn::search(points, SIMILAR, Effort::Probes(PROBES), |_, _| true);
    let rows: Vec<(u32, [u32; SIMILAR])> = par::map(points.len(), |t| {
        // Fewer only where there are hardly any texels.
        let (mut row, mut nearest) = ([t as u32; SIMILAR], 0);
        for (i, (to, squared)) in found.row(t as u32).enumerate() {
            row[i] = to;
            nearest = if i == 0 { squared } else { nearest };
        }
        (nearest, row)
    });
    let sum: f64 = rows.iter().map(|r| f64::from(r.0)).sum();
    (rows.iter().flat_map(|r| r.1).collect(), sum / points.len() as f64)
}

/// Texels by how deep they lie in or between features, and on which side of them.
pub(super) struct Places {
    /// First texel of each kind of place; kinds without any have those of the nearest kind that has some.
    ranges: Vec<[u32; 2]>,
    texels: Vec<u32>,
}

impl Places {
    fn new(grid: &Grid, phi: &[f32]) -> Self {
        let kinds = kinds(grid, phi);
        let mut texels: Vec<u32> = (0..kinds.len() as u32).collect();
        texels.sort_by_key(|t| (kinds[*t as usize], *t));
        let count = ((2 * DEEP + 1) * DIRECTIONS) as usize;
        let bound = |kind: usize| texels.partition_point(|t| usize::from(kinds[*t as usize]) < kind) as u32;
        let own: Vec<[u32; 2]> = (0..count).map(|k| [bound(k), bound(k + 1)]).collect();
        let nearest = |kind: usize| {
            let directions = DIRECTIONS as usize;
            let apart = |k: &usize| ((k / directions).abs_diff(kind / directions), k.abs_diff(kind));
            let filled = (0..count).filter(|k| own[*k][0] < own[*k][1]);
            filled.min_by_key(apart).map_or([0, 0], |k| own[k])
        };
        Places { ranges: (0..count).map(nearest).collect(), texels }
    }

    /// A random texel in a kind of place.
    #[inline]
    pub fn draw(&self, kind: u8, key: Key, draw: u64) -> u32 {
        let [start, end] = self.ranges[usize::from(kind)];
        self.texels[(start + key.below(draw, end - start)) as usize]
    }
}

/// The kind of place of each texel: its depth in steps of the grid, and near borders the direction of the nearest.
pub(super) fn kinds(grid: &Grid, phi: &[f32]) -> Vec<u8> {
    par::map(phi.len(), |t| {
        let at = |d: [i32; 2]| phi[Grid { step: 1, ..*grid }.stepped(t as u32, d) as usize];
        let deep = ((phi[t] / grid.step as f32).round() as i32).clamp(-DEEP, DEEP);
        let (dx, dy) = (at([1, 0]) - at([-1, 0]), at([0, 1]) - at([0, -1]));
        // Octants by signs and by which is longer.
        let octant = i32::from(dx > 0.0) + 2 * i32::from(dy > 0.0) + 4 * i32::from(dx.abs() > dy.abs());
        let octant = if deep.abs() == DEEP { 0 } else { octant };
        ((deep + DEEP) * DIRECTIONS + octant) as u8
    })
}

/// Signed distances and blurred mask of a feature mask, one blurred for each level, finest first.
pub(super) struct Features {
    pub phi: Vec<f32>,
    pub blurred: Vec<Vec<f32>>,
}

impl Features {
    pub fn new(mask: &Mask, levels: usize) -> Self {
        let plane = mask.data().iter().map(|on| f32::from(u8::from(*on))).collect();
        Features { phi: signed_distance(mask), blurred: stack(vec![plane], mask.width(), mask.height(), levels) }
    }
}

/// The planes of each level, finest first: `out[level * planes.len() + plane]`.
pub(super) fn stack(planes: Vec<Vec<f32>>, width: u32, height: u32, levels: usize) -> Vec<Vec<f32>> {
    let wrap = crate::texture::Wrap::Repeat;
    let pyramid = crate::exemplar::Pyramid::new(planes, width, height, levels, 0, wrap);
    let cropped =
        |p: &Vec<f32>| p.chunks_exact(pyramid.stride).flat_map(|row| &row[..width as usize]).copied().collect();
    pyramid.planes.iter().map(cropped).collect()
}
