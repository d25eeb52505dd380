//! The sample at a point of the synthesis mesh: corner coordinates looked up, filtered and blended.
//!
//! Source: \[ZG03\] section 4.4 (three sets, weights linear over the face); variance-preserving blending about the mean.
//! In: a face, barycentric coordinates, the size of the footprint. Out: the map's value there; for normal maps the
//! normal in the world.
//! Magnified samples are interpolated as [`Filter`] says. Minified ones come from box mip levels of the sample in linear light (normals as
//! vectors), between two levels linearly; positions outside the sample take its border. A tile of several layers
//! (\[MST09\]) wraps instead, and is linear between two layers too, which mip levels never mix.
//!
//! Cubic interpolation: Catmull and Rom 1974. A surface meets the sample's texels anywhere between their centres, where linear
//! interpolation takes away fine detail: what kiln synthesises flat, moved by a quarter of a texel, has 3.8 times
//! the sliced Wasserstein distance to granite, 1.5 times that to leopard skin; cubic 2.2 and 1.04 times.
//! Of irregular planes (edges of 5.3 texels) cubic interpolation makes it 50 after 92 (granite), 39 after 54 (leopard skin),
//! 47 after 61 (bricks), 46 as before (pebbles), for a tenth more time.
//!
//! Unaware of: atlases, cameras.

use super::lie::moved;
use super::texel_sources::Layer;
use crate::mesh::TriMesh;
use crate::numerics::det;
use crate::numerics::vec::Vec3;
use crate::texture::{MapKind, Texel, Texture};
use crate::uvset::{Blend, UvSets};

/// Vector of three in single precision: the inner loops' type.
pub(crate) type V3 = [f32; 3];

pub(crate) fn dot(a: V3, b: V3) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(crate) fn cross(a: V3, b: V3) -> V3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Unit vector; `fallback` where there is no direction.
pub(crate) fn unit_or(a: V3, fallback: V3) -> V3 {
    let l2 = dot(a, a);
    if l2.is_normal() {
        let s = 1.0 / l2.sqrt();
        a.map(|x| x * s)
    } else {
        fallback
    }
}

/// A normal as it can be stored: unit, not looking into the surface, as formats that rebuild z want it.
pub(crate) fn tangent_normal(n: V3) -> V3 {
    unit_or([n[0], n[1], n[2].max(0.0)], [0.0, 0.0, 1.0])
}

/// Value of linear data at barycentric coordinates.
pub(crate) fn mix<const N: usize>(corners: &[[f32; N]; 3], b: [f32; 3]) -> [f32; N] {
    std::array::from_fn(|i| corners[0][i] * b[0] + corners[1][i] * b[1] + corners[2][i] * b[2])
}

/// How places between the centres of texels are filled in, on the finest level.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Filter {
    /// From four texels: what graphics hardware does.
    Linear,
    /// From sixteen, within their range: keeps fine detail that linear interpolation takes away.
    Cubic,
}

/// Shares of the four texels around a place that is `t` (0..=1) past the second: Catmull-Rom.
fn cubic_shares(t: f32) -> [f32; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [-0.5 * t3 + t2 - 0.5 * t, 1.5 * t3 - 2.5 * t2 + 1.0, -1.5 * t3 + 2.0 * t2 + 0.5 * t, 0.5 * t3 - 0.5 * t2]
}

struct Level<const N: usize> {
    width: u32,
    height: u32,
    data: Vec<[f32; N]>,
}

impl<const N: usize> Level<N> {
    /// Clamped to the border.
    #[inline]
    fn sample(&self, x: f32, y: f32, filter: Filter) -> [f32; N] {
        // `max` first: it turns NaN into 0.
        let fx = (x - 0.5).max(0.0).min((self.width - 1) as f32);
        let fy = (y - 0.5).max(0.0).min((self.height - 1) as f32);
        let (x0, y0) = (fx as u32, fy as u32);
        let shares = [fx - x0 as f32, fy - y0 as f32];
        let (x1, y1) = ((x0 + 1).min(self.width - 1), (y0 + 1).min(self.height - 1));
        match filter {
            Filter::Linear => self.mean([x0, x1], [y0, y1], shares),
            Filter::Cubic => {
                let columns = [x0.saturating_sub(1), x0, x1, (x0 + 2).min(self.width - 1)];
                let rows = [y0.saturating_sub(1), y0, y1, (y0 + 2).min(self.height - 1)];
                self.cubic(columns, rows, shares)
            }
        }
    }

    /// Wrapping.
    fn sample_wrapped(&self, x: f32, y: f32, filter: Filter) -> [f32; N] {
        let axis = |x: f32, side: u32| {
            let floor = (x - 0.5).floor();
            let first = (floor as i64).rem_euclid(i64::from(side)) as u32;
            let share = x - 0.5 - floor;
            let after = |x: u32| if x + 1 < side { x + 1 } else { 0 };
            let before = if first > 0 { first - 1 } else { side - 1 };
            let second = after(first);
            ([before, first, second, after(second)], if share.is_finite() { share } else { 0.0 })
        };
        let ((columns, tx), (rows, ty)) = (axis(x, self.width), axis(y, self.height));
        match filter {
            Filter::Linear => self.mean([columns[1], columns[2]], [rows[1], rows[2]], [tx, ty]),
            Filter::Cubic => self.cubic(columns, rows, [tx, ty]),
        }
    }

    /// Cubic in both directions, within the range of the texels.
    #[inline]
    fn cubic(&self, columns: [u32; 4], rows: [u32; 4], [tx, ty]: [f32; 2]) -> [f32; N] {
        let (across, down) = (cubic_shares(tx), cubic_shares(ty));
        let (mut sum, mut low, mut high) = ([0.0; N], [f32::MAX; N], [f32::MIN; N]);
        for (row, down) in rows.into_iter().zip(down) {
            let start = row as usize * self.width as usize;
            for (column, across) in columns.into_iter().zip(across) {
                let (texel, share) = (&self.data[start + column as usize], across * down);
                for k in 0..N {
                    sum[k] += share * texel[k];
                    low[k] = low[k].min(texel[k]);
                    high[k] = high[k].max(texel[k]);
                }
            }
        }
        std::array::from_fn(|k| sum[k].max(low[k]).min(high[k]))
    }

    #[inline]
    fn mean(&self, columns: [u32; 2], rows: [u32; 2], [tx, ty]: [f32; 2]) -> [f32; N] {
        let at = |x: u32, y: u32| &self.data[y as usize * self.width as usize + x as usize];
        let (a, b) = (at(columns[0], rows[0]), at(columns[1], rows[0]));
        let (c, d) = (at(columns[0], rows[1]), at(columns[1], rows[1]));
        std::array::from_fn(|k| {
            let top = a[k] + (b[k] - a[k]) * tx;
            let bottom = c[k] + (d[k] - c[k]) * tx;
            top + (bottom - top) * ty
        })
    }

    /// Half the size, rounded up: means of 2x2 texels, at an odd border of fewer or of those on the other side.
    fn half(&self, wraps: bool) -> Self {
        let (width, height) = (self.width.div_ceil(2), self.height.div_ceil(2));
        let at = |x: u32, y: u32| {
            let end = |x: u32, side: u32| if wraps { x % side } else { x.min(side - 1) };
            let (x, y) = (end(x, self.width), end(y, self.height));
            &self.data[y as usize * self.width as usize + x as usize]
        };
        let texels = (0..height).flat_map(|y| (0..width).map(move |x| (2 * x, 2 * y)));
        let mean = |(x, y)| {
            let q = [at(x, y), at(x + 1, y), at(x, y + 1), at(x + 1, y + 1)];
            std::array::from_fn(|k| (q[0][k] + q[1][k] + q[2][k] + q[3][k]) * 0.25)
        };
        Level { width, height, data: texels.map(mean).collect() }
    }
}

/// A map of the sample with its mip levels, or that of a tile in several layers. `N` is the channels of a texel in memory,
/// at least the map's.
pub struct Pyramid<const N: usize> {
    /// Mip levels of each layer.
    layers: Vec<Vec<Level<N>>>,
    /// A tile: it goes on at the other side.
    wraps: bool,
    filter: Filter,
    mean: [f32; N],
    low: [f32; N],
    high: [f32; N],
}

impl<const N: usize> Pyramid<N> {
    /// Builds the levels of an exemplar's map. Panics if it has more than `N` channels.
    pub fn new(map: &Texture) -> Self {
        Self::of(&[map], false)
    }

    /// Builds the levels of a map of a tile, layer by layer. Panics if there is none, if their sizes differ, or if one has
    /// more than `N` channels.
    pub fn tile(layers: &[&Texture]) -> Self {
        Self::of(layers, true)
    }

    fn of(layers: &[&Texture], wraps: bool) -> Self {
        let size = |t: &Texture| (t.width(), t.height());
        assert!(layers.iter().all(|l| size(l) == size(layers[0])) && !layers.is_empty(), "layers of one size");
        let (mut sum, mut count) = ([0.0f64; N], 0.0f64);
        let (mut low, mut high) = ([0.0f32; N], [1.0f32; N]);
        let mut levels_of = |map: &Texture| {
            let c = map.channels() as usize;
            assert!(c <= N, "{c} channels in texels of {N}");
            let texels = map.data().chunks_exact(c);
            let data: Vec<[f32; N]> = texels.map(|t| std::array::from_fn(|k| if k < c { t[k] } else { 0.0 })).collect();
            for t in &data {
                for k in 0..N {
                    sum[k] += f64::from(t[k]);
                    (low[k], high[k]) = (low[k].min(t[k]), high[k].max(t[k]));
                }
            }
            count += data.len() as f64;
            let mut levels = vec![Level { width: map.width(), height: map.height(), data }];
            while let Some(last) = levels.last().filter(|l| l.width > 1 || l.height > 1) {
                levels.push(last.half(wraps));
            }
            levels
        };
        let layers = layers.iter().map(|map| levels_of(map)).collect();
        let mean = sum.map(|s| (s / count) as f32);
        Pyramid { layers, wraps, filter: Filter::Linear, mean, low, high }
    }

    /// The same with another filter than the linear one.
    pub fn filtered(self, filter: Filter) -> Self {
        Pyramid { filter, ..self }
    }

    /// The value at a position in texels of level 0, in the first layer. `lod` 0 or less is the finest level.
    #[inline]
    pub fn sample(&self, at: Texel, lod: f32) -> [f32; N] {
        self.in_layer(&self.layers[0], at, lod)
    }

    /// The value at a position in texels of level 0 and at `m` (0..=1) between the first layer and the last.
    #[inline]
    pub fn sample_at(&self, at: Texel, m: f32, lod: f32) -> [f32; N] {
        let last = self.layers.len() - 1;
        if last == 0 {
            return self.sample(at, lod);
        }
        // What is not a number is 0.
        let z = if m > 0.0 { m.min(1.0) * last as f32 } else { 0.0 };
        let below = (z as usize).min(last - 1);
        let [a, b] = [below, below + 1].map(|i| self.in_layer(&self.layers[i], at, lod));
        std::array::from_fn(|k| a[k] + (b[k] - a[k]) * (z - below as f32))
    }

    #[inline]
    fn in_layer(&self, levels: &[Level<N>], at: Texel, lod: f32) -> [f32; N] {
        if lod > 0.0 || self.wraps {
            self.between_levels(levels, at, lod)
        } else {
            levels[0].sample(at.x, at.y, self.filter)
        }
    }

    fn between_levels(&self, levels: &[Level<N>], at: Texel, lod: f32) -> [f32; N] {
        let lod = lod.max(0.0).min((levels.len() - 1) as f32);
        let i = lod as usize;
        let t = lod - i as f32;
        let on = |i: usize| {
            let l = &levels[i.min(levels.len() - 1)];
            let (sx, sy) = (l.width as f32 / levels[0].width as f32, l.height as f32 / levels[0].height as f32);
            let (x, y) = (at.x * sx, at.y * sy);
            let filter = if lod > 0.0 { Filter::Linear } else { self.filter };
            if self.wraps { l.sample_wrapped(x, y, filter) } else { l.sample(x, y, filter) }
        };
        let a = on(i);
        if t == 0.0 {
            return a;
        }
        let b = on(i + 1);
        std::array::from_fn(|k| a[k] + (b[k] - a[k]) * t)
    }
}

/// A pyramid of the right width for a kind of map.
pub enum Sampled {
    /// One channel.
    One(Pyramid<1>),
    /// Three channels, padded to four.
    Three(Pyramid<4>),
}

impl Sampled {
    /// Builds the pyramid of a map. Panics if the channel count is not the kind's.
    pub fn new(kind: MapKind, map: &Texture) -> Self {
        assert_eq!(map.channels(), kind.channels(), "{}", kind.name());
        if kind.channels() == 1 { Sampled::One(Pyramid::new(map)) } else { Sampled::Three(Pyramid::new(map)) }
    }

    /// The same with another filter than the linear one.
    pub fn filtered(self, filter: Filter) -> Self {
        match self {
            Sampled::One(p) => Sampled::One(p.filtered(filter)),
            Sampled::Three(p) => Sampled::Three(p.filtered(filter)),
        }
    }

    /// Builds the pyramid of a map of a tile, layer by layer. Panics like [`new`](Self::new) and [`Pyramid::tile`].
    pub fn tile(kind: MapKind, layers: &[&Texture]) -> Self {
        assert!(layers.iter().all(|map| map.channels() == kind.channels()), "{}", kind.name());
        if kind.channels() == 1 { Sampled::One(Pyramid::tile(layers)) } else { Sampled::Three(Pyramid::tile(layers)) }
    }
}

/// Weights below this change no 16-bit value and are left out.
const NEGLIGIBLE: f32 = 1e-6;

/// Places of the sample nearer than this, in texels, are taken to be alike in proportion: a rough width of its detail.
const ALIKE: f32 = 2.0;

/// The corner coordinates of one face, ready to be looked up many times.
pub struct FaceSets {
    count: usize,
    corners: [[Texel; 3]; 4],
    weights: [[f32; 4]; 3],
    /// Position on the material axis; 0 in an exemplar.
    material: [f32; 3],
    /// Directions in the world of the sample's right and up, not orthonormal; zeros where the face has none.
    frames: [[V3; 2]; 4],
    blend: Blend,
    sharpness: u32,
}

impl FaceSets {
    /// Reads a face. Panics if there are more than four sets or the face is not theirs.
    pub fn new(sets: &UvSets, face: usize) -> Self {
        let count = sets.sets.len();
        assert!(count <= 4, "{count} sets");
        let at = 3 * face;
        let mut corners = [[Texel::default(); 3]; 4];
        for (s, set) in sets.sets.iter().enumerate() {
            corners[s].copy_from_slice(&set[at..at + 3]);
        }
        let weights = [sets.weights[at], sets.weights[at + 1], sets.weights[at + 2]];
        let material = sets.material.get(at..at + 3).map_or([0.0; 3], |m| [m[0], m[1], m[2]]);
        FaceSets {
            count,
            corners,
            weights,
            material,
            frames: Default::default(),
            blend: sets.blend,
            sharpness: sets.sharpness,
        }
    }

    /// Adds what [`normal`](Self::normal) needs: how the sample lies on the face in the world.
    pub fn with_frames(mut self, mesh: &TriMesh, face: usize) -> Self {
        let p = mesh.corners(face);
        for s in 0..self.count {
            self.frames[s] = frame(p, &self.corners[s]);
        }
        self
    }

    /// The face in another dress: one of its sets, shifted as each layer says, instead of all its sets.
    pub(crate) fn shifted(&self, set: usize, layers: &[Layer]) -> FaceSets {
        let (mut corners, mut weights) = ([[Texel::default(); 3]; 4], [0.0; 4]);
        for (i, layer) in layers.iter().enumerate().take(4) {
            corners[i] = self.corners[set].map(|c| moved(c, layer.shift));
            weights[i] = layer.weight;
        }
        FaceSets {
            count: layers.len().min(4),
            corners,
            weights: [weights; 3],
            frames: [self.frames[set]; 4],
            material: self.material,
            ..*self
        }
    }

    /// Number of sets.
    pub fn count(&self) -> usize {
        self.count
    }

    /// For each set the greatest number of sample texels that one step in some direction crosses. `grad`: change of the
    /// second and third barycentric coordinate per step along two perpendicular axes.
    pub fn stretch(&self, grad: [[f32; 2]; 2]) -> [f32; 4] {
        std::array::from_fn(|s| {
            let c = &self.corners[s];
            let e = [1, 2].map(|k| [c[k].x - c[0].x, c[k].y - c[0].y]);
            let j = |row: usize, axis: usize| e[0][row] * grad[0][axis] + e[1][row] * grad[1][axis];
            let (a, b, c, d) = (j(0, 0), j(0, 1), j(1, 0), j(1, 1));
            let (sum, diff, mixed) = (a * a + b * b + c * c + d * d, a * a + b * b - c * c - d * d, a * c + b * d);
            ((sum + (diff * diff + 4.0 * mixed * mixed).sqrt()) * 0.5).sqrt()
        })
    }

    /// Mip level of each set for a footprint of so many sample texels.
    pub fn lods(stretch: [f32; 4]) -> [f32; 4] {
        stretch.map(|s| if s > 1.0 && s.is_finite() { det::log2(f64::from(s)) as f32 } else { 0.0 })
    }

    /// Calls `f(weight, set, position)` for each set that counts at a point. Returns the factor that makes the weights
    /// sum to 1 and the gain of what differs from the mean: a weighted mean of samples has the sum of w_i w_j r_ij of the
    /// variance of one sample, r_ij their correlation, which `Variance` gives back. Sets that are at the same place are
    /// wholly correlated, those further apart than [`ALIKE`] not at all.
    #[inline]
    fn each(&self, b: [f32; 3], mut f: impl FnMut(f32, usize, Texel)) -> (f32, f32) {
        let mut w = mix(&self.weights, b);
        if self.blend == Blend::Nearest {
            let best = (1..self.count).fold(0, |best, s| if w[s] > w[best] { s } else { best });
            w = [0.0; 4];
            w[best] = 1.0;
        }
        w = w.map(|w| (1..self.sharpness).fold(w, |p, _| p * w));
        let (mut sum, mut variance) = (0.0, 0.0);
        let mut at = [Texel::default(); 4];
        for s in (0..self.count).filter(|s| w[*s] > NEGLIGIBLE) {
            at[s] = self.position(s, b);
            (sum, variance) = (sum + w[s], variance + w[s] * w[s]);
            f(w[s], s, at[s]);
            if self.blend == Blend::Variance {
                for t in (0..s).filter(|t| w[*t] > NEGLIGIBLE) {
                    variance += 2.0 * w[s] * w[t] * alikeness(at[s], at[t]);
                }
            }
        }
        if sum <= 0.0 {
            f(1.0, 0, self.position(0, b));
            return (1.0, 1.0);
        }
        (1.0 / sum, if self.blend == Blend::Variance { sum / variance.sqrt() } else { 1.0 })
    }

    #[inline]
    fn material_at(&self, b: [f32; 3]) -> f32 {
        self.material[0] * b[0] + self.material[1] * b[1] + self.material[2] * b[2]
    }

    #[inline]
    fn position(&self, set: usize, b: [f32; 3]) -> Texel {
        let c = &self.corners[set];
        Texel { x: c[0].x * b[0] + c[1].x * b[1] + c[2].x * b[2], y: c[0].y * b[0] + c[1].y * b[1] + c[2].y * b[2] }
    }

    /// The value of a colour or scalar map at barycentric coordinates, within the map's own range and 0..1.
    #[inline]
    pub fn value<const N: usize>(&self, map: &Pyramid<N>, b: [f32; 3], lods: &[f32; 4]) -> [f32; N] {
        let mut out = [0.0; N];
        let m = self.material_at(b);
        let (scale, gain) = self.each(b, |w, s, at| {
            let v = map.sample_at(at, m, lods[s]);
            for k in 0..N {
                out[k] += w * v[k];
            }
        });
        std::array::from_fn(|k| {
            let v = map.mean[k] + (out[k] * scale - map.mean[k]) * gain;
            v.max(map.low[k]).min(map.high[k])
        })
    }

    /// The unit normal in the world that a normal map gives at barycentric coordinates; `n` is the unit shading normal.
    /// Wants [`with_frames`](Self::with_frames).
    pub fn normal(&self, map: &Pyramid<4>, b: [f32; 3], lods: &[f32; 4], n: V3) -> V3 {
        let (mut sum, mut mean) = ([0.0; 3], [0.0; 3]);
        let m = self.material_at(b);
        let (_, gain) = self.each(b, |w, s, at| {
            let [t, up] = orthonormal(self.frames[s], n);
            let v = map.sample_at(at, m, lods[s]);
            for k in 0..3 {
                sum[k] += w * (t[k] * v[0] + up[k] * v[1] + n[k] * v[2]);
                mean[k] += w * (t[k] * map.mean[0] + up[k] * map.mean[1] + n[k] * map.mean[2]);
            }
        });
        unit_or(std::array::from_fn(|k| mean[k] + (sum[k] - mean[k]) * gain), n)
    }
}

/// Correlation of the sample's values at two places, from their distance alone.
#[inline]
fn alikeness(a: Texel, b: Texel) -> f32 {
    let (x, y) = (a.x - b.x, a.y - b.y);
    (1.0 - (x * x + y * y).sqrt() / ALIKE).max(0.0)
}

/// Directions in the world in which the sample's x grows and its y falls.
fn frame(p: [Vec3; 3], uv: &[Texel; 3]) -> [V3; 2] {
    let d = |i: usize| (f64::from(uv[i].x) - f64::from(uv[0].x), f64::from(uv[i].y) - f64::from(uv[0].y));
    let ((x1, y1), (x2, y2)) = (d(1), d(2));
    let det = x1 * y2 - x2 * y1;
    let (e1, e2) = (p[1] - p[0], p[2] - p[0]);
    let right = (e1 * y2 - e2 * y1) / det;
    let up = (e1 * x2 - e2 * x1) / det;
    match (right.normalized(), up.normalized()) {
        (Some(r), Some(u)) => [r.to_f32(), u.to_f32()],
        _ => Default::default(),
    }
}

/// Right and up made perpendicular to the unit normal and to each other; up keeps its side.
fn orthonormal([right, up]: [V3; 2], n: V3) -> [V3; 2] {
    let along = dot(right, n);
    let t = unit_or(std::array::from_fn(|k| right[k] - n[k] * along), [0.0; 3]);
    let t = if dot(t, t) > 0.0 { t } else { perpendicular(n) };
    let b = cross(n, t);
    [t, if dot(b, up) < 0.0 { b.map(|x| -x) } else { b }]
}

/// Some unit vector perpendicular to a unit vector.
pub(crate) fn perpendicular(n: V3) -> V3 {
    Vec3::from(n).any_perpendicular().to_f32()
}
