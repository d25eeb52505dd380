//! The sample at a point of the synthesis mesh: corner coordinates looked up, filtered and blended.
//!
//! Source: \[ZG03\] section 4.4 (three sets, weights linear over the face); variance-preserving blending about the mean.
//! In: a face, barycentric coordinates, the size of the footprint. Out: the map's value there; for normal maps the
//! normal in the world.
//! Magnified samples are bilinear. Minified ones come from box mip levels of the sample in linear light (normals as
//! vectors), between two levels linearly; positions outside the sample take its border.
//!
//! Unaware of: atlases, cameras.

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

struct Level<const N: usize> {
    width: u32,
    height: u32,
    data: Vec<[f32; N]>,
}

impl<const N: usize> Level<N> {
    /// Bilinear, clamped to the border.
    #[inline]
    fn sample(&self, x: f32, y: f32) -> [f32; N] {
        // `max` first: it turns NaN into 0.
        let fx = (x - 0.5).max(0.0).min((self.width - 1) as f32);
        let fy = (y - 0.5).max(0.0).min((self.height - 1) as f32);
        let (x0, y0) = (fx as u32, fy as u32);
        let (tx, ty) = (fx - x0 as f32, fy - y0 as f32);
        let (dx, dy) = ((x0 + 1 < self.width) as usize, (y0 + 1 < self.height) as usize);
        let i = y0 as usize * self.width as usize + x0 as usize;
        let j = i + dy * self.width as usize;
        let (a, b, c, d) = (&self.data[i], &self.data[i + dx], &self.data[j], &self.data[j + dx]);
        std::array::from_fn(|k| {
            let top = a[k] + (b[k] - a[k]) * tx;
            let bottom = c[k] + (d[k] - c[k]) * tx;
            top + (bottom - top) * ty
        })
    }

    /// Half the size, rounded up: means of 2x2 texels, of fewer at an odd border.
    fn half(&self) -> Self {
        let (width, height) = (self.width.div_ceil(2), self.height.div_ceil(2));
        let at = |x: u32, y: u32| {
            let (x, y) = (x.min(self.width - 1), y.min(self.height - 1));
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

/// A map of the sample with its mip levels. `N` is the channels of a texel in memory, at least the map's.
pub struct Pyramid<const N: usize> {
    levels: Vec<Level<N>>,
    mean: [f32; N],
    low: [f32; N],
    high: [f32; N],
}

impl<const N: usize> Pyramid<N> {
    /// Builds the levels. Panics if the map has more than `N` channels.
    pub fn new(map: &Texture) -> Self {
        let c = map.channels() as usize;
        assert!(c <= N, "{c} channels in texels of {N}");
        let texels = map.data().chunks_exact(c);
        let data: Vec<[f32; N]> = texels.map(|t| std::array::from_fn(|k| if k < c { t[k] } else { 0.0 })).collect();
        let mut sum = [0.0f64; N];
        let (mut low, mut high) = ([0.0f32; N], [1.0f32; N]);
        for t in &data {
            for k in 0..N {
                sum[k] += f64::from(t[k]);
                (low[k], high[k]) = (low[k].min(t[k]), high[k].max(t[k]));
            }
        }
        let mean = sum.map(|s| (s / data.len() as f64) as f32);
        let mut levels = vec![Level { width: map.width(), height: map.height(), data }];
        while let Some(last) = levels.last().filter(|l| l.width > 1 || l.height > 1) {
            levels.push(last.half());
        }
        Pyramid { levels, mean, low, high }
    }

    /// The value at a position in texels of level 0. `lod` 0 or less is bilinear on the finest level.
    #[inline]
    pub fn sample(&self, at: Texel, lod: f32) -> [f32; N] {
        if lod <= 0.0 { self.levels[0].sample(at.x, at.y) } else { self.between_levels(at, lod) }
    }

    fn between_levels(&self, at: Texel, lod: f32) -> [f32; N] {
        let lod = lod.min((self.levels.len() - 1) as f32);
        let i = lod as usize;
        let t = lod - i as f32;
        let on = |i: usize| {
            let l = &self.levels[i.min(self.levels.len() - 1)];
            let (sx, sy) =
                (l.width as f32 / self.levels[0].width as f32, l.height as f32 / self.levels[0].height as f32);
            l.sample(at.x * sx, at.y * sy)
        };
        let (a, b) = (on(i), on(i + 1));
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
        FaceSets { count, corners, weights, frames: Default::default(), blend: sets.blend, sharpness: sets.sharpness }
    }

    /// Adds what [`normal`](Self::normal) needs: how the sample lies on the face in the world.
    pub fn with_frames(mut self, mesh: &TriMesh, face: usize) -> Self {
        let p = mesh.corners(face);
        for s in 0..self.count {
            self.frames[s] = frame(p, &self.corners[s]);
        }
        self
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
    fn position(&self, set: usize, b: [f32; 3]) -> Texel {
        let c = &self.corners[set];
        Texel { x: c[0].x * b[0] + c[1].x * b[1] + c[2].x * b[2], y: c[0].y * b[0] + c[1].y * b[1] + c[2].y * b[2] }
    }

    /// The value of a colour or scalar map at barycentric coordinates, within the map's own range and 0..1.
    #[inline]
    pub fn value<const N: usize>(&self, map: &Pyramid<N>, b: [f32; 3], lods: &[f32; 4]) -> [f32; N] {
        let mut out = [0.0; N];
        let (scale, gain) = self.each(b, |w, s, at| {
            let v = map.sample(at, lods[s]);
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
        let (_, gain) = self.each(b, |w, s, at| {
            let [t, up] = orthonormal(self.frames[s], n);
            let v = map.sample(at, lods[s]);
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
