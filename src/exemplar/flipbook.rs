//! The analysis of a flipbook: from its frames to the jump map in space and time.
//!
//! Source: \[ZG02\] section 2, and section 6, "extend the jump map to temporal textures".
//! In: the frames, parameters. Out: for every texel of every frame up to k jumps to texels of any frame.
//! Reads as: a texel's neighbourhood vector holds its neighbourhoods (of all levels) in its own frame and, at the same
//! place, in the frames before and after, so that what moves alike is alike. Beyond the ends of time lie the end frames
//! again, mirrored, as at the borders in space. The Poisson disc is an ellipsoid: `min_distance` texels in space, as many
//! frames in time as a vector spans (no two matches share a texel of the finest level), but at most a quarter of them.
//! The rest is read as for still exemplars, see `analysis`. The exemplar is no torus, whatever `wrap` says.
//! Unaware of: files, recipes, synthesis.

use super::neighbourhood::feature_planes;
use super::params::{MAX_DIMENSIONS, MAX_MEMORY, MAX_SIDE, MAX_TEXELS};
use super::pyramid::{BLOCK, Pyramid, border_index};
use super::{AnalysisParams, Error, JumpVolume, VolumeJump};
use crate::numerics::knn::{self, Effort, Lists, Neighbours, Points, RANGE};
use crate::numerics::par;
use crate::numerics::pca::{self, Pca};
use crate::numerics::rng::Key;
use crate::texture::{Flipbook, Wrap};
use wide::f32x8;

/// Frames that a neighbourhood vector spans: the one before, its own, the one after.
const SPAN: usize = 3;

/// Vectors from which the principal components are found, one of each of as many runs of texels.
const SAMPLES: usize = 4096;

/// Up to this many texels are searched exhaustively.
const EXHAUSTIVE: usize = 4096;

/// Shorter lists do not carry matches well from texel to texel.
const LEAST_LIST: usize = 15;

/// Clusters probed for lists of [`LEAST_LIST`].
const PROBES: usize = 144;

/// Steps to the texels around, in space and time.
const AROUND: [[i32; 3]; 10] = [
    [-1, 0, 0],
    [1, 0, 0],
    [0, -1, 0],
    [0, 1, 0],
    [0, 0, -1],
    [0, 0, 1],
    [-1, -1, 0],
    [1, 1, 0],
    [1, -1, 0],
    [-1, 1, 0],
];

/// Finds for every texel of every frame up to k texels with similar neighbourhoods in space and time, and the
/// probabilities of jumping there.
///
/// The result is the same for any number of threads. Maps without importance take no part. Fails if a parameter is out
/// of range, there are fewer than two frames, a frame is smaller than the finest neighbourhood, the whole is too large, or
/// a value is not a finite number of reasonable size. Source: \[ZG02\] sections 2 and 6.
pub fn analyse_flipbook(book: &Flipbook, params: &AnalysisParams) -> Result<JumpVolume, Error> {
    check(book, params)?;
    let windows = Windows::new(book, params);
    let pca = windows.components(params.variance);
    check_memory(book, params, pca.basis.len())?;
    let points = windows.project(&pca);
    drop(windows);
    let block = Block::new(book.size(), params);
    let found = matches(&points, &block, params.matches());
    let accepted = par::map(points.len(), |i| accept(&block, &found, i as u32, params));
    let largest = points.length(accepted.iter().flatten().map(|m| m.1).max().unwrap_or(0));
    let counts: Vec<u8> = accepted.iter().map(|a| a.len() as u8).collect();
    let jumps = accepted.iter().flatten().map(|&(to, squared)| {
        let (k, t) = (f64::from(params.jumps), params.alpha * largest);
        let p = if t > 0.0 { (t - points.length(squared)) / (k * t) } else { 1.0 / k };
        VolumeJump::new(block.places[to as usize], p)
    });
    let map = JumpVolume::new(book.size(), &counts, jumps.collect());
    Ok(map.expect("jumps between the flipbook's own texels"))
}

/// Fails if a flipbook of this width, height and number of frames could not be analysed: to be asked before memory is
/// taken for it.
pub fn check_flipbook_size(size: [u32; 3]) -> Result<(), Error> {
    let texels = size.iter().fold(1u64, |n, s| n.saturating_mul(u64::from(*s)));
    let fits = size[2] >= 2 && size.iter().all(|s| *s <= MAX_SIDE) && texels <= MAX_TEXELS;
    if fits { Ok(()) } else { Err(Error::Flipbook { size, max_texels: MAX_TEXELS }) }
}

/// The minimum distance of matches in space: as for stills, by the size of a frame.
fn min_distance([w, h, _]: [u32; 3], params: &AnalysisParams) -> f64 {
    let quarter = f64::from(w.min(h)) / 4.0;
    let finest = f64::from(params.neighbourhoods.first().copied().unwrap_or(1));
    params.min_distance.unwrap_or_else(|| finest.min(quarter).max(1.0))
}

fn check(book: &Flipbook, params: &AnalysisParams) -> Result<(), Error> {
    params.check_numbers()?;
    let size @ [w, h, _] = book.size();
    let min = params.neighbourhoods[0];
    if w.min(h) < min {
        return Err(Error::TooSmall { size: (w, h), min });
    }
    check_flipbook_size(size)?;
    let (distance, max) = (min_distance(size, params), f64::from(w.max(h)));
    if !(1.0..=max).contains(&distance) {
        return Err(Error::MinDistance { found: distance, max });
    }
    params.check_maps(book.strip())?;
    let window: usize = params.neighbourhoods.iter().map(|n| (n * n) as usize).sum();
    let found = SPAN * window * params.channels(book.strip());
    if found > MAX_DIMENSIONS {
        return Err(Error::Dimensions { found, max: MAX_DIMENSIONS });
    }
    check_memory(book, params, 1)
}

/// Fails if vectors of `components`, the lists of matches and the pyramids would not fit.
fn check_memory(book: &Flipbook, params: &AnalysisParams, components: usize) -> Result<(), Error> {
    let [w, h, frames] = book.size().map(u64::from);
    let border = 2 * params.reach() as u64;
    let planes = (params.channels(book.strip()) * params.neighbourhoods.len()) as u64;
    let per_texel = 4 * components as u64 + 12 * params.matches() as u64;
    let bytes = frames * (w * h * per_texel + 4 * planes * (w + border) * (h + border));
    if bytes > MAX_MEMORY { Err(Error::Memory { bytes, max: MAX_MEMORY }) } else { Ok(()) }
}

/// One component of a neighbourhood vector: which of the three frames, which plane, where relative to the texel.
struct Tap {
    frame: i64,
    plane: usize,
    offset: isize,
}

/// The neighbourhood vectors of every texel of every frame.
struct Windows {
    size: [usize; 3],
    frames: Vec<Pyramid>,
    taps: Vec<Tap>,
}

/// Principal directions that are projected on at once.
const GROUP: usize = 4;

impl Windows {
    fn new(book: &Flipbook, params: &AnalysisParams) -> Self {
        let [w, h, count] = book.size();
        let weighed = book.strip().iter().filter(|(kind, _)| params.weight(*kind) > 0.0);
        let planes: Vec<Vec<f32>> =
            weighed.flat_map(|(kind, map)| feature_planes(kind, map, params.weight(kind).sqrt() as f32)).collect();
        let (channels, levels) = (planes.len(), params.neighbourhoods.len());
        let area = w as usize * h as usize;
        let frame = |t: usize| {
            let own = planes.iter().map(|p| p[t * area..(t + 1) * area].to_vec()).collect();
            Pyramid::new(own, w, h, levels, params.reach(), Wrap::Clamp)
        };
        let frames: Vec<Pyramid> = (0..count as usize).map(frame).collect();
        let mut taps = Vec::new();
        for (level, side) in params.neighbourhoods.iter().enumerate() {
            let r = (side / 2) as isize;
            for (dy, dx) in (-r..=r).flat_map(|dy| (-r..=r).map(move |dx| (dy, dx))) {
                let offset = (dy * frames[0].stride as isize + dx) << level;
                let plane = move |frame| (0..channels).map(move |c| Tap { frame, plane: level * channels + c, offset });
                taps.extend([-1, 0, 1].into_iter().flat_map(plane));
            }
        }
        Windows { size: book.size().map(|s| s as usize), frames, taps }
    }

    /// The values of a tap for [`BLOCK`] texels in a row of frame `t`; `at` is the index of the first in its plane.
    #[inline]
    fn values(&self, t: usize, at: usize, tap: &Tap) -> f32x8 {
        let frame = border_index(Wrap::Clamp, t as i64 + tap.frame, self.frames.len() as u32) as usize;
        let from = (at as isize + tap.offset) as usize;
        let mut values = [0.0; BLOCK];
        values.copy_from_slice(&self.frames[frame].planes[tap.plane][from..from + BLOCK]);
        f32x8::new(values)
    }

    /// The principal components of a sample of the vectors.
    fn components(&self, variance: f64) -> Pca {
        let [w, h, frames] = self.size;
        let (len, dims) = (w * h * frames, self.taps.len());
        let count = len.min(SAMPLES.max(4 * dims));
        let key = Key::new(0).with_str("flipbook pca");
        let samples = par::map_chunks(count, 64, |range| {
            let mut vectors = Vec::with_capacity(range.len() * dims);
            for i in range {
                let (start, end) = (i * len / count, (i + 1) * len / count);
                let texel = start + key.below(i as u64, (end - start) as u32) as usize;
                let (t, y, x) = (texel / (w * h), texel / w % h, texel % w);
                let at = self.frames[t].at(x, y);
                vectors.extend(self.taps.iter().map(|tap| self.values(t, at, tap).to_array()[0]));
            }
            vectors
        });
        pca::fit(&samples.concat(), dims, variance)
    }

    /// Projects every vector on the principal directions and rounds to integers.
    fn project(&self, pca: &Pca) -> Points {
        let [w, h, frames] = self.size;
        // No vector is farther from the mean than the farthest before the projection: scaled by it, none saturates.
        let radius = f64::from(self.largest_norm(&pca.mean)).sqrt();
        let scale = if radius > 0.0 { f64::from(RANGE) / radius } else { 1.0 };
        let groups: Vec<_> = pca.basis.chunks(GROUP).map(|basis| self.weights(basis, &pca.mean, scale)).collect();
        let mut points = Points::new(w * h * frames, pca.basis.len(), scale);
        let stride = points.stride();
        par::for_rows(points.data_mut(), stride * w, |row, out| {
            let (t, y) = (row / h, row % h);
            for x in (0..w).step_by(BLOCK) {
                let at = self.frames[t].at(x, y);
                for (g, (start, weights)) in groups.iter().enumerate() {
                    let mut sums = *start;
                    for (tap, weights) in self.taps.iter().zip(weights) {
                        let values = self.values(t, at, tap);
                        for (sum, weight) in sums.iter_mut().zip(weights) {
                            *sum += values * f32x8::splat(*weight);
                        }
                    }
                    for (i, point) in out[x * stride..].chunks_exact_mut(stride).take(BLOCK).enumerate() {
                        for (p, sum) in point[g * GROUP..].iter_mut().zip(&sums) {
                            *p = sum.as_array()[i].round() as i16;
                        }
                    }
                }
            }
        });
        points
    }

    /// Start values and scaled weights, tap by tap, of up to [`GROUP`] principal directions.
    fn weights(&self, basis: &[Vec<f64>], mean: &[f64], scale: f64) -> ([f32x8; GROUP], Vec<[f32; GROUP]>) {
        let component = |f: &dyn Fn(&[f64]) -> f64| -> [f32; GROUP] {
            std::array::from_fn(|j| basis.get(j).map_or(0.0, |b| (f(b) * scale) as f32))
        };
        let start = component(&|b| -b.iter().zip(mean).fold(0.0, |s, (b, m)| s + b * m));
        (start.map(f32x8::splat), (0..self.taps.len()).map(|i| component(&|b| b[i])).collect())
    }

    /// The largest squared distance of a vector from `mean`.
    fn largest_norm(&self, mean: &[f64]) -> f32 {
        let [w, h, frames] = self.size;
        let rows = par::map_chunks(h * frames, 1, |rows| {
            let (t, y) = (rows.start / h, rows.start % h);
            let mut largest = 0.0f32;
            for x in (0..w).step_by(BLOCK) {
                let at = self.frames[t].at(x, y);
                let norms = self.taps.iter().zip(mean).fold(f32x8::ZERO, |norms, (tap, m)| {
                    let d = self.values(t, at, tap) - f32x8::splat(*m as f32);
                    norms + d * d
                });
                largest = norms.to_array().iter().take(w - x).fold(largest, |a, b| a.max(*b));
            }
            largest
        });
        rows.into_iter().fold(0.0, f32::max)
    }
}

/// The texels of all frames and the ellipsoid around each.
struct Block {
    size: [u32; 3],
    /// Column, row and frame of each texel.
    places: Vec<[u16; 3]>,
    /// One over the squared half axes of the ellipsoid, in texels and frames.
    space: f64,
    time: f64,
}

impl Block {
    fn new(size @ [w, h, frames]: [u32; 3], params: &AnalysisParams) -> Self {
        let place = |i: usize| {
            let i = i as u32;
            [(i % w) as u16, (i / w % h) as u16, (i / (w * h)) as u16]
        };
        let (texels, frames) = (min_distance(size, params), (f64::from(frames) / 4.0).clamp(1.0, SPAN as f64));
        let places = par::map((size[0] * size[1] * size[2]) as usize, place);
        Block { size, places, space: 1.0 / (texels * texels), time: 1.0 / (frames * frames) }
    }

    /// True if neither of two texels lies in the other's ellipsoid.
    #[inline]
    fn apart(&self, a: u32, b: u32) -> bool {
        let (a, b) = (self.places[a as usize], self.places[b as usize]);
        let [dx, dy, dt] = [0, 1, 2].map(|i| u32::from(a[i].abs_diff(b[i])));
        f64::from(dx * dx + dy * dy) * self.space + f64::from(dt * dt) * self.time >= 1.0 - 1e-9
    }

    /// The texel at an offset, if there is one.
    #[inline]
    fn shifted(&self, texel: u32, by: [i32; 3]) -> Option<u32> {
        let from = self.places[texel as usize];
        let axis = |i: usize| u32::from(from[i]).checked_add_signed(by[i]).filter(|v| *v < self.size[i]);
        Some((axis(2)? * self.size[1] + axis(1)?) * self.size[0] + axis(0)?)
    }
}

/// The `count` best matches of every texel (or a few more), all outside its ellipsoid: found as those of stills.
fn matches(points: &Points, block: &Block, count: usize) -> Neighbours {
    let length = count.max(LEAST_LIST);
    let apart = |a, b| block.apart(a, b);
    if points.len() <= EXHAUSTIVE {
        return knn::search(points, length, Effort::Exact, apart);
    }
    let mut found = knn::search(points, length, Effort::Probes(PROBES * length / LEAST_LIST), apart);
    found.refine(points, apart, |texel, lists, out| propagate(block, texel, lists, out));
    found.refine(points, apart, relay);
    found.refine(points, apart, |texel, lists, out| propagate(block, texel, lists, out));
    found
}

/// Where the texels around a texel, in space and time, found a match lately, shifted back.
fn propagate(block: &Block, texel: u32, lists: &Lists, out: &mut Vec<u32>) {
    for by in AROUND {
        if let Some(beside) = block.shifted(texel, by) {
            let fresh = lists.row(beside).filter(|m| m.1);
            out.extend(fresh.filter_map(|(m, _)| block.shifted(m, by.map(|d| -d))));
        }
    }
}

/// The matches of matches, if either is new.
fn relay(texel: u32, lists: &Lists, out: &mut Vec<u32>) {
    for (m, fresh) in lists.row(texel) {
        out.extend(lists.row(m).filter(|q| fresh || q.1).map(|q| q.0));
    }
}

/// Poisson-disc filter in space and time: of the best matches those that keep apart from each other, up to k.
fn accept(block: &Block, found: &Neighbours, texel: u32, params: &AnalysisParams) -> Vec<(u32, u32)> {
    let mut accepted: Vec<(u32, u32)> = Vec::with_capacity(params.jumps as usize);
    for (candidate, squared) in found.row(texel).take(params.matches()) {
        if accepted.len() == params.jumps as usize {
            break;
        }
        if accepted.iter().all(|a| block.apart(a.0, candidate)) {
            accepted.push((candidate, squared));
        }
    }
    accepted
}

#[cfg(test)]
#[path = "flipbook_tests.rs"]
mod tests;
