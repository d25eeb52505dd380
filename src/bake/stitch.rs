//! Both sides of a UV seam made to show the same.
//!
//! Two charts sample one edge of the surface on differently placed and turned grids, so even with the right values in
//! all texels, bilinear filtering gives different values along the edge: on high-contrast samples five 8-bit steps in
//! the mean, and more on mip levels. Here the texels that filters touch along seams are moved as little as possible so
//! that both sides agree. Points along the seams are equations "left look-up = right look-up" on mip levels 0 to 3; a
//! texel of a level is the mean of those under it, and a change of it goes to all of them. Kaczmarz' projections (1937)
//! from the baked values, level by level, coarse to fine, in a fixed order: they tend to the nearest solution. Texels
//! outside all charts move more easily than those of the surface.
//!
//! Measured on six samples from bricks to granite, spot at 1024: seams differ by 2.3-5.0 steps without, 0.4-1.4 with;
//! on mip levels 1, 2, 3 by 3.6-15 without, 0.5-3.6 with (a checkerboard, the worst case: 4.2 on level 3). Level by
//! level without returning (one round) leaves 3-6 on the levels; equal ease for all texels moves those of the surface twice as far for the same result.
//!
//! Values are compared as they are stored: colours in sRGB, the rest linear. Normals are turned from the basis of one
//! side into that of the other; across a hard edge what agrees is how they lean away from the surface.
//! Unaware of: which method made the values.

use super::border::Turn;
use super::seam::{Seam, Tap, tap};
use super::shade::tangent_normal;
use crate::numerics::par;
use crate::numerics::vec::Vec2;
use crate::texture::color::{linear_to_srgb, srgb_to_linear};
use crate::texture::{MapKind, Texture};

/// Mip levels that are stitched: 0 to 3. Texels of the last are called blocks.
const LEVELS: u32 = 4;
/// Side of a block in texels of level 0.
const BLOCK: u32 = 1 << (LEVELS - 1);
/// Equations per texel along a seam, on each level.
const PER_TEXEL: f64 = 2.0;
/// How much easier texels outside all charts move than those of the surface: only filters see them.
const GUTTER_EASE: f32 = 4.0;
/// Share of each projection that is taken. The equations contradict each other a little: 0.75 ends closer than 1 or 1.3.
const RELAXATION: f32 = 0.75;
/// Rounds over all levels. 8 leave half as much difference again; 12 a tenth more, which was too much for spot in leopard.
const ROUNDS: usize = 16;

/// Which texels must agree along the seams of an atlas.
#[derive(Clone, Debug, Default)]
pub(crate) struct Stitches {
    /// Blocks with a texel that any equation touches, ascending: row times blocks per row plus column.
    blocks: Vec<u32>,
    /// For each block one bit per texel: on the surface.
    covered: Vec<u64>,
    blocks_wide: u32,
    /// Finest first.
    levels: Vec<Level>,
    /// For each seam how a normal of its second side reads on the first.
    turns: Vec<Turn>,
}

/// Two look-ups that must give the same.
#[derive(Clone, Copy, Debug)]
struct Pair {
    sides: [Tap; 2],
    seam: u32,
}

/// The equations of one mip level.
#[derive(Clone, Debug)]
struct Level {
    /// The texels that equations or finer levels touch, ascending: number of the block times texels per block, plus row
    /// by row within the block.
    texels: Vec<u32>,
    /// The texel of the next level over each; empty on the last.
    parents: Vec<u32>,
    /// How far each moves when the texels under it are pushed by one.
    ease: Vec<f32>,
    /// Their texels are positions in `texels`.
    pairs: Vec<Pair>,
}

/// Look-ups at points along all seams on one level, sides paired; texels numbered row by row.
fn equations(seams: &[Seam], width: u32, height: u32, level: u32) -> Vec<Pair> {
    let shrink = 1.0 / f64::from(1u32 << level);
    let mut pairs = Vec::new();
    for (number, seam) in (0..).zip(seams) {
        let length = seam.px.iter().map(|[a, b]| (*b - *a).length()).fold(0.0, f64::max) * shrink;
        let n = (length * PER_TEXEL).ceil().max(1.0) as usize;
        for i in 0..n {
            let t = (i as f64 + 0.5) / n as f64;
            let side = |[a, b]: [Vec2; 2]| tap((a * (1.0 - t) + b * t) * shrink, width >> level, height >> level);
            pairs.push(Pair { sides: seam.px.map(side), seam: number });
        }
    }
    pairs
}

/// Texels per side of a block on a level, as a shift.
fn shift(level: u32) -> u32 {
    LEVELS - 1 - level
}

/// The texel of the next level over a texel, both within one block.
fn parent(level: u32, inner: u32) -> u32 {
    let (x, y) = (inner & ((1 << shift(level)) - 1), inner >> shift(level));
    (y >> 1) << shift(level + 1) | x >> 1
}

impl Stitches {
    /// `covered(x, y)` tells which texels of the page belong to a chart.
    pub(crate) fn new(
        seams: &[Seam],
        turns: Vec<Turn>,
        width: u32,
        height: u32,
        covered: impl Fn(u32, u32) -> bool + Sync,
    ) -> Self {
        // A level that does not divide the page has no whole texels at its end: leave it.
        let whole = (0..LEVELS).filter(|l| width.is_multiple_of(1 << l) && height.is_multiple_of(1 << l));
        let mut pairs: Vec<_> = whole.map(|l| equations(seams, width, height, l)).collect();
        let blocks_wide = width.div_ceil(BLOCK);
        let place = |level: u32, t: u32| {
            let (x, y) = (t % (width >> level), t / (width >> level));
            let (s, mask) = (shift(level), (1 << shift(level)) - 1);
            ((y >> s) * blocks_wide + (x >> s), (y & mask) << s | (x & mask))
        };
        let mut blocks: Vec<u32> = Vec::new();
        for (level, pairs) in (0..).zip(&pairs) {
            blocks.extend(pairs.iter().flat_map(|p| p.sides).flat_map(|t| t.texels).map(|t| place(level, t).0));
            blocks.sort_unstable();
            blocks.dedup();
        }
        let mask = par::map(blocks.len(), |b| {
            let texels = (0..).zip(block_texels(blocks[b], blocks_wide));
            texels.filter(|(_, (x, y))| *x < width && *y < height && covered(*x, *y)).fold(0, |m, (i, _)| m | 1u64 << i)
        });
        let mut levels: Vec<Level> = Vec::new();
        for (level, mut pairs) in (0..).zip(std::mem::take(&mut pairs)) {
            for tap in pairs.iter_mut().flat_map(|p| &mut p.sides) {
                tap.texels = tap.texels.map(|t| {
                    let (block, inner) = place(level, t);
                    ((blocks.partition_point(|b| *b < block) as u32) << (2 * shift(level))) | inner
                });
            }
            add_level(&mut levels, level, pairs, &mask);
        }
        Stitches { blocks, covered: mask, blocks_wide, levels, turns }
    }

    /// Moves values towards equality of all pairs. Returns what each level pushes the texels under it: their change
    /// over their ease, without what coarser levels push.
    fn solve<const N: usize>(
        &self,
        mut values: Vec<Vec<[f32; N]>>,
        range: (f32, f32),
        turns: &[Turn],
    ) -> Vec<Vec<[f32; N]>> {
        let mut pushes: Vec<Vec<[f32; N]>> = values.iter().map(|v| vec![[0.0; N]; v.len()]).collect();
        // Pushes of a level and those over it in this round.
        let mut round_pushes = pushes.clone();
        for round in 0..ROUNDS {
            for l in (0..self.levels.len()).rev() {
                let level = &self.levels[l];
                let (own, over) = round_pushes.split_at_mut(l + 1);
                let (own, over) = (&mut own[l], over.first());
                let (values, pushes) = (&mut values[l], &mut pushes[l]);
                for (i, v) in values.iter_mut().enumerate() {
                    own[i] = over.map_or([0.0; N], |o| o[level.parents[i] as usize]);
                    (0..N).for_each(|k| v[k] += own[i][k] * level.ease[i]);
                }
                let before = values.clone();
                level.sweep(values, round % 2 == 1, turns);
                let range = if l == 0 { range } else { (f32::MIN, f32::MAX) };
                for (i, v) in values.iter_mut().enumerate() {
                    let less = 1.0 / level.ease[i];
                    for k in 0..N {
                        v[k] = v[k].max(range.0).min(range.1);
                        let push = (v[k] - before[i][k]) * less;
                        pushes[i][k] += push;
                        own[i][k] += push;
                    }
                }
            }
            self.report_up(&mut values, &round_pushes);
        }
        pushes
    }

    /// Adds to every coarser texel the mean of what was pushed under it, but not by it or over it, in this round.
    fn report_up<const N: usize>(&self, values: &mut [Vec<[f32; N]>], round_pushes: &[Vec<[f32; N]>]) {
        let mut below: Vec<[f32; N]> = Vec::new();
        for l in 0..self.levels.len().saturating_sub(1) {
            let (level, over) = (&self.levels[l], &round_pushes[l + 1]);
            let mut up = vec![[0.0; N]; over.len()];
            for (i, push) in round_pushes[l].iter().enumerate() {
                let p = level.parents[i] as usize;
                for k in 0..N {
                    let from_below = if l > 0 { below[i][k] } else { 0.0 };
                    up[p][k] += 0.25 * ((push[k] - over[p][k]) * level.ease[i] + from_below);
                }
            }
            for (v, u) in values[l + 1].iter_mut().zip(&up) {
                (0..N).for_each(|k| v[k] += u[k]);
            }
            below = up;
        }
    }
}

/// Appends a level whose pairs name texels by block; joins it to the finer one.
fn add_level(levels: &mut Vec<Level>, level: u32, mut pairs: Vec<Pair>, covered: &[u64]) {
    let s = 2 * shift(level);
    let up = |t: u32| (t >> (s + 2)) << s | parent(level - 1, t & ((4 << s) - 1));
    let mut texels: Vec<u32> = pairs.iter().flat_map(|p| p.sides).flat_map(|t| t.texels).collect();
    if let Some(finer) = levels.last() {
        texels.extend(finer.texels.iter().map(|&t| up(t)));
    }
    texels.sort_unstable();
    texels.dedup();
    let find = |t: u32| texels.partition_point(|&u| u < t) as u32;
    if let Some(finer) = levels.last_mut() {
        finer.parents = finer.texels.iter().map(|&t| find(up(t))).collect();
    }
    for tap in pairs.iter_mut().flat_map(|p| &mut p.sides) {
        tap.texels = tap.texels.map(find);
    }
    let (side, per_block) = (1u32 << level, 1u32 << shift(level));
    let ease = texels.iter().map(|&t| {
        let (mask, inner) = (covered[(t >> s) as usize], t & ((1 << s) - 1));
        let (x, y) = (inner % per_block * side, inner / per_block * side);
        let bits = (0..side * side).map(|i| mask >> ((y + i / side) * BLOCK + x + i % side) & 1);
        let share = bits.sum::<u64>() as f32 / (side * side) as f32;
        share + (1.0 - share) * GUTTER_EASE
    });
    let ease = ease.collect();
    levels.push(Level { texels, parents: Vec::new(), ease, pairs });
}

impl Level {
    /// One pass of projections over all pairs. With `turns` the first two channels are those of a normal.
    fn sweep<const N: usize>(&self, x: &mut [[f32; N]], backwards: bool, turns: &[Turn]) {
        let n = self.pairs.len();
        for i in (0..n).map(|i| if backwards { n - 1 - i } else { i }) {
            let Pair { sides: [a, b], seam } = &self.pairs[i];
            let turn = turns.get(*seam as usize);
            let (mut norm, mut own, mut other) = (0.0, [0.0; N], [0.0; N]);
            let (mut ea, mut eb) = ([0.0; 4], [0.0; 4]);
            for k in 0..4 {
                let (ta, tb) = (a.texels[k] as usize, b.texels[k] as usize);
                (ea[k], eb[k]) = (a.weights[k] * self.ease[ta], b.weights[k] * self.ease[tb]);
                norm += a.weights[k] * ea[k] + b.weights[k] * eb[k];
                (0..N).for_each(|c| own[c] += a.weights[k] * x[ta][c]);
                (0..N).for_each(|c| other[c] += b.weights[k] * x[tb][c]);
            }
            let scale = RELAXATION / norm;
            let mut step: [f32; N] = std::array::from_fn(|c| own[c] - other[c]);
            if let (Some([p, q]), true) = (turn, N >= 2) {
                (step[0], step[1]) =
                    (own[0] - p[0] * other[0] - p[1] * other[1], own[1] - q[0] * other[0] - q[1] * other[1]);
            }
            for k in 0..4 {
                let va = &mut x[a.texels[k] as usize];
                (0..N).for_each(|c| va[c] -= step[c] * (ea[k] * scale));
            }
            if let (Some([p, q]), true) = (turn, N >= 2) {
                (step[0], step[1]) = (p[0] * step[0] + q[0] * step[1], p[1] * step[0] + q[1] * step[1]);
            }
            for k in 0..4 {
                let vb = &mut x[b.texels[k] as usize];
                (0..N).for_each(|c| vb[c] += step[c] * (eb[k] * scale));
            }
        }
    }
}

/// Columns and rows of the texels of a block; those of the last blocks may lie beyond the page.
fn block_texels(block: u32, blocks_wide: u32) -> impl Iterator<Item = (u32, u32)> {
    let (x, y) = (block % blocks_wide * BLOCK, block / blocks_wide * BLOCK);
    (0..BLOCK * BLOCK).map(move |i| (x + i % BLOCK, y + i / BLOCK))
}

/// From values in memory to values as stored, where they are compared. Interpolated in a table: a tenth of the time of
/// the powers, error below 1e-5.
struct Storage {
    /// sRGB of the square of i / STEPS; empty for linear maps.
    to: Vec<f32>,
    /// Linear light of i / STEPS.
    from: Vec<f32>,
}

/// Steps of the tables.
const STEPS: usize = 2048;

impl Storage {
    fn new(kind: MapKind) -> Self {
        if !kind.is_srgb() {
            return Storage { to: Vec::new(), from: Vec::new() };
        }
        let at = |i: usize| i as f32 / STEPS as f32;
        Storage {
            to: (0..=STEPS).map(|i| linear_to_srgb(at(i) * at(i))).collect(),
            from: (0..=STEPS).map(|i| srgb_to_linear(at(i))).collect(),
        }
    }

    fn look_up(table: &[f32], v: f32) -> f32 {
        let p = v * STEPS as f32;
        let i = (p as usize).min(STEPS - 1);
        table[i] + (table[i + 1] - table[i]) * (p - i as f32)
    }

    /// Values beyond 1 (float images) go on linearly.
    fn encode(&self, v: f32) -> f32 {
        if self.to.is_empty() || v > 1.0 { v } else { Self::look_up(&self.to, v.max(0.0).sqrt()) }
    }

    fn decode(&self, v: f32) -> f32 {
        if self.from.is_empty() || v > 1.0 { v } else { Self::look_up(&self.from, v.max(0.0)) }
    }
}

/// Changes `map` so that both sides of every seam agree.
pub(crate) fn stitch(stitches: &Stitches, kind: MapKind, map: &mut Texture) {
    match map.channels() {
        1 => stitch_channels::<1, 1>(stitches, kind, map),
        _ => stitch_channels::<4, 3>(stitches, kind, map),
    }
}

/// `C` channels, in memory `N`.
fn stitch_channels<const N: usize, const C: usize>(stitches: &Stitches, kind: MapKind, map: &mut Texture) {
    let (w, h) = (map.width() as usize, map.height() as usize);
    let storage = Storage::new(kind);
    let source: &Texture = map;
    let values = (0..).zip(&stitches.levels).map(|(l, level)| {
        let (side, s) = (1u32 << l, shift(l));
        let share = 1.0 / (side * side) as f32;
        par::map(level.texels.len(), |i| {
            let (block, inner) =
                (stitches.blocks[(level.texels[i] >> (2 * s)) as usize], level.texels[i] & ((1 << (2 * s)) - 1));
            let x = block % stitches.blocks_wide * BLOCK + (inner & ((1 << s) - 1)) * side;
            let y = block / stitches.blocks_wide * BLOCK + (inner >> s) * side;
            let mut sum = [0.0; N];
            for (dx, dy) in (0..side).flat_map(|dy| (0..side).map(move |dx| (dx, dy))) {
                let at = (((y + dy) as usize).min(h - 1) * w + ((x + dx) as usize).min(w - 1)) * C;
                (0..C).for_each(|k| sum[k] += storage.encode(source.data()[at + k]));
            }
            sum.map(|s| s * share)
        })
    });
    let values: Vec<Vec<[f32; N]>> = values.collect();
    let Some(finest) = values.first() else { return };
    let range = finest.iter().flatten().fold((0.0f32, 1.0f32), |r, v| (r.0.min(*v), r.1.max(*v)));
    let normals = kind == MapKind::Normal;
    let (low, high) = if normals { (-1.0, 1.0) } else { range };
    let pushes = stitches.solve(values, (low, high), if normals { &stitches.turns } else { &[] });
    par::for_rows(map.data_mut(), w * BLOCK as usize * C, |row, data| {
        let first = row as u32 * stitches.blocks_wide;
        let at = |b: u32| stitches.blocks.partition_point(|c| *c < b);
        for n in at(first)..at(first + stitches.blocks_wide) {
            let push = stitches.block_push(n, &pushes);
            let x0 = (stitches.blocks[n] - first) * BLOCK;
            for (i, push) in push.iter().enumerate().filter(|(_, p)| p.iter().any(|v| *v != 0.0)) {
                let (x, y) = (x0 as usize + i % BLOCK as usize, i / BLOCK as usize);
                let at = (y * w + x) * C;
                if x >= w || at + C > data.len() {
                    continue;
                }
                let ease = if stitches.covered[n] >> i & 1 == 1 { 1.0 } else { GUTTER_EASE };
                for k in 0..C {
                    let v = storage.encode(data[at + k]) + push[k] * ease;
                    data[at + k] = storage.decode(v.max(low).min(high));
                }
                if normals && C == 3 {
                    let unit = tangent_normal([data[at], data[at + 1], data[at + 2]]);
                    data[at..at + 3].copy_from_slice(&unit);
                }
            }
        }
    });
}

impl Stitches {
    /// What all levels push the texels of level 0 of a block.
    fn block_push<const N: usize>(
        &self,
        block: usize,
        pushes: &[Vec<[f32; N]>],
    ) -> [[f32; N]; (BLOCK * BLOCK) as usize] {
        let mut out = [[0.0; N]; (BLOCK * BLOCK) as usize];
        for (l, (level, pushes)) in (0..).zip(self.levels.iter().zip(pushes)) {
            let (s, side) = (shift(l), 1usize << l);
            let at = |b: usize| level.texels.partition_point(|t| ((*t >> (2 * s)) as usize) < b);
            let of_block = at(block)..at(block + 1);
            for (t, push) in level.texels[of_block.clone()].iter().zip(&pushes[of_block]) {
                let inner = (t & ((1 << (2 * s)) - 1)) as usize;
                let (x, y) = ((inner & ((1 << s) - 1)) * side, (inner >> s) * side);
                for (dx, dy) in (0..side).flat_map(|dy| (0..side).map(move |dx| (dx, dy))) {
                    let o = &mut out[(y + dy) * BLOCK as usize + x + dx];
                    (0..N).for_each(|k| o[k] += push[k]);
                }
            }
        }
        out
    }
}
