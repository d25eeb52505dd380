//! Morphing one feature mask into another.
//!
//! Source: \[MST09\] section 1.1: the features of the first mask are advected along the gradient of the target's distance,
//! in many more steps than there are layers, and helped by interior dilation and sweeping.
//! In: two masks on one torus. Out: a mask for each step; the first is the one given, the last is the other.
//! Reads as:
//! - phi_N and phi_M both mean the target's signed distance. dt = min phi_M / N is negative as printed: the step is the
//!   greatest distance from the target divided by N.
//! - The gradient of a distance leads straight to the nearest texel of the target, at one texel per texel, so N steps along it
//!   are one straight step of their length. What arrives at a texel is looked up there, instead of spreading each texel over
//!   four at every step: nothing is blurred, and nothing is lost where the field spreads (the printed overlap, a sum of
//!   tents, does not even keep the mass; a product would). A texel that no straight line leads to lies behind the flow,
//!   where it comes from a ridge of the distance: phi "tends to zero" there, but keeps the sign that it had on the ridge, until it is
//!   swept. (To take such texels for outside at once tears large features to pieces in the first layer.)
//! - Interior dilation goes at the speed of the sweep whatever N is: a texel when the sweep has gone one farther, a diagonal
//!   one when it has gone the root of two.
//! - Between the ends masks are smoothed a little: lines that end on a ridge fray.
//! - A mask of texels can only move by whole texels: all straight borders would jump at once, and no choice of layers could
//!   be even. So all three are up to a texel ahead or behind, smoothly from place to place ([`phases`]).
//! - On small shapes a distance has few values, and smoothing lets go of many texels at once; a step that moves more than its
//!   share ([`GREATEST_SHARE`]) is taken in several, which move its texels in the order of their distance from the border, up to
//!   a texel ahead or behind as above. So layers can be cut within it.
//! - Sweeping compares |phi_M(s)|, where |phi_0(s)| is printed: only so it begins at the sources of the field, keeps pace
//!   with the advection, and ends with the target's mask (test `what_is_printed_as_phi_0_must_be_phi_m`).
//!
//! Unaware of: layers, textures.

use super::Mask;
use super::distance::{nearest, signed_distance};
use crate::numerics::par;
use crate::numerics::rng::Key;

/// Steps per texel that the sweep goes, at least.
const STEPS_PER_TEXEL: f32 = 4.0;
/// Most steps.
const MOST_STEPS: usize = 1024;
/// Most texels of all steps, one bit each.
const MOST_BITS: usize = 1 << 31;
/// What a step may move at most, where 1 is what differs from end to end, shared out evenly to the least steps: half a layer
/// of 16 steps. (A quarter makes layers hardly more even, and cuts steps of real pairs that need not be.)
const GREATEST_SHARE: usize = 8;
/// A straight line back from the target is longer by no more than that than the distance at its end, in texels, or it has
/// crossed to where another part of the target is nearer.
const SLACK: f32 = 1.0;

/// When a texel that is off comes on.
const NEVER: f32 = f32::INFINITY;
/// Texels in which the phase changes.
const PHASE_TEXELS: u32 = 12;

/// Texels of a mask, 64 in a word.
pub(super) type Bits = Vec<u64>;

/// Texels in which two masks differ.
pub(super) fn differing(a: &Bits, b: &Bits) -> u32 {
    a.iter().zip(b).map(|(a, b)| (a ^ b).count_ones()).sum()
}

/// The masks between `from` and `to`, one for each step, at least `least` steps, of which none moves more than
/// [`GREATEST_SHARE`] times its share.
pub(super) fn morph(from: &Mask, to: &Mask, least: usize) -> Vec<Bits> {
    let advection = Advection::new(from, to);
    let wanted = (STEPS_PER_TEXEL * advection.sup).ceil() as usize;
    let steps = wanted.max(least).min(MOST_STEPS).min(MOST_BITS / from.data().len()).max(least).max(1);
    let mut arrived: Vec<f32> = advection.overlap();
    let mut out = Vec::with_capacity(steps + 1);
    for n in 0..=steps {
        let share = n as f32 / steps as f32;
        let outside = advection.outside(share);
        let travelled = share * advection.sup;
        for (i, at) in arrived.iter_mut().enumerate() {
            if advection.phi[i] <= 0.0 {
                *at = if outside[i] { at.min(travelled) } else { NEVER };
            } else if advection.is_swept(i, share) {
                *at = at.min(travelled);
            }
        }
        // A step is hardly ever a whole texel; where it is more, it takes several rings.
        for _ in 0..(advection.sup / steps as f32).ceil() as usize {
            arrived = advection.dilated(&arrived, travelled);
        }
        let on: Vec<bool> = arrived.iter().map(|at| *at < NEVER).collect();
        out.push(bits_of(&if (1..steps).contains(&n) { smoothed(&on, from, to) } else { on }));
    }
    let most = (GREATEST_SHARE * from.differing(to)).div_ceil(least.max(1)).max(1);
    cut(out, most, &advection.phases, [from.width(), from.height()])
}

/// Steps of which each moves `most` texels or fewer: those that move more are cut in several.
fn cut(steps: Vec<Bits>, most: usize, phases: &[f32], [width, height]: [u32; 2]) -> Vec<Bits> {
    let mut out: Vec<Bits> = Vec::with_capacity(steps.len());
    for next in steps {
        if let Some(before) = out.last().filter(|before| differing(before, &next) as usize > most) {
            let mask = mask_of(before, width, height);
            let border = signed_distance(&mask);
            let changes = |i: &usize| (before[i / 64] ^ next[i / 64]) >> (i % 64) & 1 == 1;
            let mut moved: Vec<(f32, usize)> =
                (0..phases.len()).filter(changes).map(|i| (border[i].abs() + phases[i], i)).collect();
            moved.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            let (pieces, mut between) = (moved.len().div_ceil(most), before.clone());
            for piece in 1..pieces {
                for (_, i) in &moved[(piece - 1) * moved.len() / pieces..piece * moved.len() / pieces] {
                    between[i / 64] ^= 1 << (i % 64);
                }
                out.push(between.clone());
            }
        }
        out.push(next);
    }
    out
}

/// A mask without specks and frayed borders, which the ends have as they are: each texel as most around it are, by a
/// binomial of 3 x 3, but for those that are the same at both ends.
fn smoothed(on: &[bool], from: &Mask, to: &Mask) -> Vec<bool> {
    let (w, h) = (from.width() as usize, from.height() as usize);
    let rows: Vec<u8> = par::map(on.len(), |i| {
        let (row, x) = (i / w * w, i % w);
        let at = |x: usize| u8::from(on[row + x]);
        at((x + w - 1) % w) + 2 * at(x) + at((x + 1) % w)
    });
    par::map(on.len(), |i| {
        if from.data()[i] == to.data()[i] && on[i] == from.data()[i] {
            return on[i];
        }
        let (y, x) = (i / w, i % w);
        let sum = rows[(y + h - 1) % h * w + x] + 2 * rows[i] + rows[(y + 1) % h * w + x];
        if sum == 8 { on[i] } else { sum > 8 }
    })
}

fn bits_of(on: &[bool]) -> Bits {
    let word = |part: &[bool]| part.iter().enumerate().fold(0, |word, (i, on)| word | (u64::from(*on) << i));
    on.chunks(64).map(word).collect()
}

/// The mask that bits stand for.
pub(super) fn mask_of(bits: &Bits, width: u32, height: u32) -> Mask {
    let texels = width as usize * height as usize;
    Mask::new(width, (0..texels).map(|i| bits[i / 64] >> (i % 64) & 1 == 1).collect())
}

/// What pushes features to the target's.
struct Advection {
    width: usize,
    height: usize,
    /// Signed distance of the features that are pushed.
    source: Vec<f32>,
    /// Signed distance of the target.
    phi: Vec<f32>,
    /// Unit vectors to the nearest texel of the target, for texels outside.
    to_target: Vec<[f32; 2]>,
    /// By how much dilation is ahead, advection behind and, halved, sweeping behind, 0..1 texel.
    phases: Vec<f32>,
    /// The greatest distance outside, and of all.
    reach: f32,
    sup: f32,
}

impl Advection {
    fn new(from: &Mask, to: &Mask) -> Self {
        let phi = signed_distance(to);
        let unit = |[x, y]: [i32; 2]| {
            let (x, y) = (x as f32, y as f32);
            let length = (x * x + y * y).sqrt().max(1.0);
            [x / length, y / length]
        };
        let to_target =
            nearest(to, true).map_or_else(|| vec![[0.0, 0.0]; phi.len()], |n| n.step.into_iter().map(unit).collect());
        let reach = phi.iter().fold(0.0, |m: f32, p| m.max(-p));
        let sup = phi.iter().fold(0.0, |m: f32, p| m.max(p.abs()));
        let [width, height] = [to.width(), to.height()].map(|n| n as usize);
        let phases = phases(to.width(), to.height());
        Advection { width, height, source: signed_distance(from), phi, to_target, phases, reach, sup }
    }

    /// When the texels inside the target came on that are so in the beginning.
    fn overlap(&self) -> Vec<f32> {
        let on = |i: usize| self.phi[i] > 0.0 && self.source[i] > 0.0;
        (0..self.phi.len()).map(|i| if on(i) { -self.phases[i] } else { NEVER }).collect()
    }

    /// Whether the sweep has passed a texel after a share of the steps: never in the beginning, everywhere in the end.
    fn is_swept(&self, i: usize, share: f32) -> bool {
        share >= 1.0 || self.phi[i].abs() - 0.5 * self.phases[i] > (1.0 - share) * self.sup
    }

    /// Which texels outside the target are inside an advected feature; false inside the target.
    fn outside(&self, share: f32) -> Vec<bool> {
        par::map(self.phi.len(), |i| {
            let travelled = (share * self.reach - self.phases[i]).max(0.0);
            let distance = -self.phi[i];
            if distance < 0.0 || self.is_swept(i, share) {
                return false;
            }
            let [ux, uy] = self.to_target[i];
            let (x, y) = ((i % self.width) as f32, (i / self.width) as f32);
            let back = |way: f32| [x - ux * way, y - uy * way];
            let is_straight = |way: f32| -self.sample(&self.phi, back(way)) >= distance + way - SLACK;
            let (mut way, mut beyond) = (0.0, travelled);
            if is_straight(travelled) {
                way = travelled;
            }
            while way < travelled && beyond - way > 0.5 {
                let half = 0.5 * (way + beyond);
                *(if is_straight(half) { &mut way } else { &mut beyond }) = half;
            }
            self.sample(&self.source, back(way)) > 0.0
        })
    }

    /// One more ring of texels inside the target, around what came on a texel's way ago.
    fn dilated(&self, arrived: &[f32], travelled: f32) -> Vec<f32> {
        let (w, h) = (self.width, self.height);
        par::map(arrived.len(), |i| {
            if self.phi[i] <= 0.0 || arrived[i] < NEVER {
                return arrived[i];
            }
            let (x, y) = (i % w, i / w);
            let at = |dx: usize, dy: usize| arrived[(y + dy) % h * w + (x + dx) % w];
            let beside = at(1, 0).min(at(w - 1, 0)).min(at(0, 1)).min(at(0, h - 1));
            let across = at(1, 1).min(at(w - 1, 1)).min(at(1, h - 1)).min(at(w - 1, h - 1));
            let from = (beside + 1.0).min(across + std::f32::consts::SQRT_2);
            if from <= travelled { from } else { NEVER }
        })
    }

    /// Bilinear sample on the torus; whole numbers are texel centres.
    fn sample(&self, field: &[f32], [x, y]: [f32; 2]) -> f32 {
        let (x0, y0) = (x.floor(), y.floor());
        let (tx, ty) = (x - x0, y - y0);
        let wrap = |v: f32, n: usize| (v as i64).rem_euclid(n as i64) as usize;
        let (xa, xb) = (wrap(x0, self.width), wrap(x0 + 1.0, self.width));
        let (ya, yb) = (wrap(y0, self.height) * self.width, wrap(y0 + 1.0, self.height) * self.width);
        let top = field[ya + xa] * (1.0 - tx) + field[ya + xb] * tx;
        let bottom = field[yb + xa] * (1.0 - tx) + field[yb + xb] * tx;
        top * (1.0 - ty) + bottom * ty
    }
}

/// Smooth noise on the torus, 0..1.
fn phases(width: u32, height: u32) -> Vec<f32> {
    let key = Key::new(0).with_str("phases of a morph");
    let cells = [width, height].map(|n| (n / PHASE_TEXELS).max(1));
    let corner = |x: u32, y: u32| key.with(u64::from(y % cells[1])).unit(u64::from(x % cells[0])) as f32;
    let place = |i: u32, n: u32, cells: u32| {
        let at = i as f32 * cells as f32 / n as f32;
        (at as u32, at - at.floor())
    };
    let phase = |i: usize| {
        let (x, tx) = place(i as u32 % width, width, cells[0]);
        let (y, ty) = place(i as u32 / width, height, cells[1]);
        let row = |y: u32| corner(x, y) * (1.0 - tx) + corner(x + 1, y) * tx;
        row(y) * (1.0 - ty) + row(y + 1) * ty
    };
    par::map(width as usize * height as usize, phase)
}
