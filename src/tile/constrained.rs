//! Tiles of one key exemplar whose features lie where masks say.
//!
//! Source: \[MST09\] section 1.2. In: a key, a mask for each layer. Out: indirection maps, the texel of the key that each texel
//! of a layer shows, and how often the key is used.
//! Reads as:
//! - The coarsest resolution is the one of at least 32 texels a side; 20 iterations there and 3 at the others (section 4
//!   has 4).
//! - "Taken in random order" one after the other would depend on the order. Texels fall at random into [`CLASSES`], anew in
//!   each iteration; those of a class see the others as they are before their turn.
//! - The approximate nearest neighbour is the best of: where the texels around point to, the texels most similar to those,
//!   where the layer before points to, and some texels that lie in or between features as the mask wants it here.
//! - The penalty is [`USAGE`] times the distance that similar texels have, for each time that a part of the key is used by
//!   others, against the times due to it inside, or outside, features (a mask that grows uses its features more).
//!
//! Unaware of: the other key, how layers are blended.

use super::Mask;
use super::planes::Planes;
use super::pyramid::{DIMS, Features, Grid, Level, SIMILAR, kinds, map_window, mask_window, stack, window};
use crate::numerics::par;
use crate::numerics::rng::Key;

/// Shorter side of the coarsest resolution, at least.
const COARSEST: usize = 32;
/// Iterations at the coarsest resolution.
const COARSE_ITERATIONS: usize = 20;
/// Iterations at the others.
const ITERATIONS: usize = 3;
/// Groups of texels that take turns.
const CLASSES: u32 = 4;
/// What a use costs where one is due, against the mean distance of similar texels. With it the histograms of the layers
/// between real pairs are a tenth to a fifth nearer to their keys' (`tests/quality/README.md`), those of a grain that
/// hardly moves more than half; most of what is left is what the masks ask for. Forty gives no more, and specks show from
/// 8 on.
pub(super) const USAGE: f64 = 4.0;
/// Texels tried that lie as the mask wants it.
const DRAWN: u64 = 3;
/// One over by how much the distance of a texel counts more that continues nothing around it (kappa of Lefebvre, Hoppe:
/// Parallel controllable texture synthesis, 2005): without, single texels stand out as specks.
const STRANGER: u64 = 4;
/// Texels of a class that are updated together.
const TASK: usize = 512;

/// A key exemplar at all resolutions.
pub(super) struct Stack {
    /// Coarsest first.
    levels: Vec<Level>,
    mask: Mask,
}

/// How layers are synthesised.
#[derive(Clone, Copy)]
pub(super) struct Wish {
    /// Of every random number.
    pub key: Key,
    /// What use of the key costs; [`USAGE`].
    pub usage: f64,
    /// Layers must not show texels of the key that lie no farther than this from where they are, and begin anew: as many
    /// different tiles of one mask.
    pub apart: Option<f64>,
}

impl Stack {
    /// Of planes of the maps, and the mask.
    pub fn new(planes: Vec<Vec<f32>>, mask: &Mask) -> Self {
        let (w, h) = (mask.width() as usize, mask.height() as usize);
        let mut count = 1;
        while w.min(h) >> count >= COARSEST {
            count += 1;
        }
        let channels = planes.len();
        let features = Features::new(mask, count);
        let blurred = stack(planes, mask.width(), mask.height(), count);
        let level = |l: usize| {
            let grid = Grid { width: w, height: h, step: 1 << l };
            Level::new(grid, blurred[l * channels..][..channels].to_vec(), &features.blurred[l], &features.phi)
        };
        Stack { levels: (0..count).rev().map(level).collect(), mask: mask.clone() }
    }

    /// The texels that each layer shows, layer by layer; the first is initialised by the key as it is.
    pub fn synthesise(&self, masks: &[Mask], wish: &Wish) -> Vec<Vec<u32>> {
        let mut before: Vec<Vec<u32>> = self.levels.iter().map(|l| identity(&l.grid)).collect();
        let mut out = Vec::with_capacity(masks.len());
        for (m, mask) in masks.iter().enumerate() {
            let wish = Wish { key: wish.key.with(m as u64), ..*wish };
            before = self.layer(mask, &before, &wish);
            out.extend(before.last().cloned());
        }
        out
    }

    /// The indirection maps of a layer at all resolutions, coarsest first.
    fn layer(&self, mask: &Mask, before: &[Vec<u32>], wish: &Wish) -> Vec<Vec<u32>> {
        let features = Features::new(mask, self.levels.len());
        let mut maps: Vec<Vec<u32>> = Vec::with_capacity(self.levels.len());
        for (r, level) in self.levels.iter().enumerate() {
            let wish = Wish { key: wish.key.with(r as u64), ..*wish };
            let task = Task::new(level, &self.mask, mask, &features, &before[r], self.levels.len() - 1 - r, &wish);
            let begun = match (maps.last(), wish.apart) {
                (Some(coarser), _) => upsampled(&self.levels[r - 1].grid, &level.grid, coarser),
                (None, None) => before[0].clone(),
                (None, Some(_)) => task.drawn(),
            };
            let iterations = if r == 0 { COARSE_ITERATIONS } else { ITERATIONS };
            maps.push(task.optimised(begun, iterations));
        }
        maps
    }
}

/// Every place shows itself.
fn identity(grid: &Grid) -> Vec<u32> {
    let [columns, rows] = grid.size();
    (0..columns * rows).map(|place| grid.texel(place)).collect()
}

/// Each place of the finer grid continues what the coarser one shows.
fn upsampled(coarse: &Grid, fine: &Grid, map: &[u32]) -> Vec<u32> {
    let [columns, rows] = fine.size();
    let of = |place: usize| {
        let (x, y) = (place % columns, place / columns);
        let from = map[y / 2 * coarse.size()[0] + x / 2];
        fine.stepped(from, [(x % 2) as i32, (y % 2) as i32])
    };
    (0..columns * rows).map(of).collect()
}

/// One resolution of a layer.
struct Task<'a> {
    level: &'a Level,
    before: &'a [u32],
    /// Reduced neighbourhoods of the mask, place by place.
    wanted: Vec<[f32; super::pyramid::MASK_DIMS]>,
    /// Kind of place of each.
    kinds: Vec<u8>,
    usage: Usage,
    wish: Wish,
}

impl<'a> Task<'a> {
    fn new(
        level: &'a Level,
        key_mask: &Mask,
        mask: &Mask,
        features: &Features,
        before: &'a [u32],
        finer: usize,
        wish: &Wish,
    ) -> Self {
        let grid = &level.grid;
        let places = before.len();
        let blurred = &features.blurred[finer];
        let wanted = par::map(places, |p| level.mask.of(mask_window(grid, blurred, grid.texel(p))));
        let all = kinds(grid, &features.phi);
        let of_places = (0..places).map(|p| all[grid.texel(p) as usize]).collect();
        let usage = Usage::new(grid, key_mask, mask, level.spread * wish.usage);
        Task { level, before, wanted, kinds: of_places, usage, wish: *wish }
    }

    /// Random texels that lie as the mask wants it.
    fn drawn(&self) -> Vec<u32> {
        let key = self.wish.key.with_str("drawn");
        let draw = |p: usize| {
            let drawn = |i| self.level.places.draw(self.kinds[p], key.with(p as u64), i);
            (0..8).map(drawn).find(|t| self.may_show(p, *t)).unwrap_or_else(|| drawn(8))
        };
        par::map(self.before.len(), draw)
    }

    /// Whether a place may show a texel.
    #[inline(always)]
    fn may_show(&self, place: usize, texel: u32) -> bool {
        let Some(apart) = self.wish.apart else { return true };
        let grid = &self.level.grid;
        let own = grid.texel(place);
        let torus = |a: u32, b: u32, n: usize| f64::from(a.abs_diff(b).min(n as u32 - a.abs_diff(b)));
        let w = grid.width as u32;
        let (dx, dy) = (torus(own % w, texel % w, grid.width), torus(own / w, texel / w, grid.height));
        dx * dx + dy * dy > apart * apart
    }

    /// Improves an indirection map.
    fn optimised(mut self, mut map: Vec<u32>, iterations: usize) -> Vec<u32> {
        map.iter().for_each(|t| self.usage.add(*t));
        for iteration in 0..iterations {
            let key = self.wish.key.with_str("iteration").with(iteration as u64);
            let mut classes: Vec<Vec<u32>> = vec![Vec::new(); CLASSES as usize];
            for p in 0..map.len() as u32 {
                classes[key.below(p.into(), CLASSES) as usize].push(p);
            }
            for class in classes {
                let found = par::map_chunks(class.len(), TASK, |r| {
                    class[r].iter().map(|p| self.best(*p as usize, &map, key)).collect::<Vec<_>>()
                });
                for (p, texel) in class.iter().zip(found.into_iter().flatten()) {
                    let old = std::mem::replace(&mut map[*p as usize], texel);
                    self.usage.remove(old);
                    self.usage.add(texel);
                }
            }
        }
        map
    }

    /// The texel that suits a place best.
    fn best(&self, place: usize, map: &[u32], key: Key) -> u32 {
        let Level { grid, planes, points, similar, .. } = self.level;
        let own = map[place];
        let query = self.query(place, map, grid, planes);
        let mut best = (u64::MAX, own);
        let mut offer = |texel: u32, continues: bool| {
            if texel == own || self.may_show(place, texel) {
                let squared = u64::from(points.squared_distance_to(texel, &query));
                let squared = if continues { squared } else { squared + squared / STRANGER };
                let cost = squared + self.usage.cost(texel, texel == own);
                if cost < best.0 {
                    best = (cost, texel);
                }
            }
        };
        offer(own, false);
        for d in window(1) {
            let around = map[grid.place(place, d)];
            let continued = grid.stepped(around, d.map(|v| -v));
            if d != [0, 0] {
                offer(continued, true);
            }
            similar[continued as usize * SIMILAR..][..SIMILAR].iter().for_each(|t| offer(*t, false));
        }
        if self.wish.apart.is_none() {
            offer(self.before[place], false);
        }
        let key = key.with(place as u64).with_str("drawn");
        for i in 0..DRAWN {
            offer(self.level.places.draw(self.kinds[place], key, i), false);
        }
        best.1
    }

    /// What the neighbourhood of a place shows, and what the mask wants there.
    #[inline]
    fn query(&self, place: usize, map: &[u32], grid: &Grid, planes: &Planes) -> [i16; DIMS] {
        let maps = self.level.maps.of(map_window(planes, |d| map[grid.place(place, d)]));
        self.level.point(maps, self.wanted[place])
    }
}

/// How often each part of the key is used, in cells of a grid step.
struct Usage {
    grid: Grid,
    counts: Vec<u32>,
    /// What one use costs, texel by texel of the key: more where fewer uses are due.
    price: [u64; 2],
    on: Vec<bool>,
}

impl Usage {
    fn new(grid: &Grid, key: &Mask, wanted: &Mask, price: f64) -> Self {
        let [columns, rows] = grid.size();
        let texels = key.data().len() as f64;
        let due = |on: f64, wanted: f64| if on > 0.0 { (wanted / on).max(1.0 / 16.0) } else { 1.0 };
        let (on, wanted) = (key.count() as f64, wanted.count() as f64);
        let price = [due(texels - on, texels - wanted), due(on, wanted)].map(|due| (price / due) as u64);
        Usage { grid: *grid, counts: vec![0; columns * rows], price, on: key.data().to_vec() }
    }

    #[inline(always)]
    fn cell(&self, texel: u32) -> usize {
        let (x, y) = (texel as usize % self.grid.width, texel as usize / self.grid.width);
        y / self.grid.step * self.grid.size()[0] + x / self.grid.step
    }

    fn add(&mut self, texel: u32) {
        let cell = self.cell(texel);
        self.counts[cell] += 1;
    }

    fn remove(&mut self, texel: u32) {
        let cell = self.cell(texel);
        self.counts[cell] -= 1;
    }

    /// What it costs to show a texel, of which one use may be one's own.
    #[inline(always)]
    fn cost(&self, texel: u32, mine: bool) -> u64 {
        let others = self.counts[self.cell(texel)] - u32::from(mine);
        u64::from(others) * self.price[usize::from(self.on[texel as usize])]
    }
}
