//! Minimum cuts along seams, compared where they lie: the border between two patches runs where they differ least.
//!
//! Beyond \[MK03\], after Efros and Freeman (2001) and Kwatra et al. (2003). `cut` compares faces at their centres, which says
//! little of the edges between them where these are several texels long, and nearly all that is unlike the exemplar in a
//! quilt lies along a few long seams: of the 9 x 9 patches of brick-vistex, radishes and wicker on 4608 faces that are
//! farthest from any of the exemplar, 97 of 100 cross one. So around the worst place of a seam a window is laid out in the
//! plane, and each patch in it may take over what lowers the cost of all edges (`seam`) and of overuse of the exemplar;
//! then around the next worst, windows that have nothing in common in one round. Where the surface is curved, a patch is
//! laid out nearly right: a cut is taken only if the true sum falls.
//!
//! Places that are not in the window do not help (the best four by the texton string around it, or shifts by a texel): the
//! cuts came out the same. Windows of 14 or 32 texels instead of 20, squared differences: the same within what seeds differ by.
//! Unaware of: how patches came about.

use std::collections::BTreeSet;

use super::frame::Facets;
use super::seam::{SAME, Seams, box_of};
use super::texton_string::Inside;
use crate::exemplar::TextonMap;
use crate::numerics::mincut::GraphCut;
use crate::numerics::par;
use crate::numerics::vec::Vec2;
use crate::synth::seam_metric::SeamMetrics;
use crate::synth::usage::{Usage, texel_of};
use crate::texture::texel;

/// How far a window reaches, in texels, and most faces of one.
const REACH: f64 = 20.0;
const MOST_FACES: usize = 512;

/// Most patches of a window that are tried.
const PATCHES: usize = 8;

/// A window vouches for the seams in this part of its faces, the innermost.
const INNER: usize = 4;

/// What overuse costs for each texel of a face's area, where a seam of a texel between unrelated places costs 1000. Of
/// basket, brick-vistex, radishes and wicker on 4608 faces of 14 texels swd and coherence_p95 (geometric means, three seeds)
/// are 28.6 and 9.8 without any, 27.5 and 10.2 so, 27.0 and 11.4 at three times as much; 27.9 and 11.5 before.
const OVERUSE: f64 = 0.07;

/// Costs are whole numbers up to this.
const MOST: f64 = 1e8;

/// Moves seams in up to `passes` passes over all of them; returns how many faces went over to another patch.
pub(super) fn reseam(map: &TextonMap, metrics: &SeamMetrics, facets: &Facets, at: &mut [Vec2], passes: u32) -> u64 {
    let job = Job { seams: Seams::new(map, facets), facets };
    let sources: Vec<[u16; 2]> = (0..at.len()).map(|f| job.shown(f as u32, at[f])).collect();
    let mut usage = Usage::new(map.alike().domain(), &metrics.levels[0], 0, sources.into_iter());
    job.sweep(&mut usage, at, passes)
}

struct Job<'a> {
    seams: Seams<'a>,
    facets: &'a Facets,
}

/// Faces, and where they are laid, from the middle on; the faces around them.
struct Window {
    faces: Vec<u32>,
    laid: Vec<Vec2>,
    ring: Vec<u32>,
}

impl Window {
    fn all(&self) -> impl Iterator<Item = u32> + '_ {
        self.faces.iter().chain(&self.ring).copied()
    }

    fn inner(&self) -> &[u32] {
        &self.faces[..self.faces.len().div_ceil(INNER)]
    }

    /// The patches with the most faces, as shifts of the layout. Where the surface is curved one patch has several.
    fn shifts(&self, places: &[Vec2]) -> Vec<Vec2> {
        let mut found: Vec<(usize, Vec2)> = vec![];
        for shift in places.iter().zip(&self.laid).map(|(at, laid)| *at - *laid) {
            match found.iter_mut().find(|(_, s)| (*s - shift).length() <= SAME) {
                Some((count, _)) => *count += 1,
                None => found.push((1, shift)),
            }
        }
        // Stable: the innermost of equals first.
        found.sort_by_key(|(count, _)| std::cmp::Reverse(*count));
        found.into_iter().take(PATCHES).map(|(_, shift)| shift).collect()
    }
}

/// An edge of a window: a face by its number there, its edge, the face beyond and its edge, and that one's number if it is
/// in the window as well.
#[derive(Clone, Copy)]
struct Pair {
    i: usize,
    k: usize,
    beyond: (usize, usize),
    n: Option<usize>,
}

/// The places that a window's faces have, or may take.
struct Work<'a> {
    job: &'a Job<'a>,
    at: &'a [Vec2],
    usage: &'a Usage<'a>,
    window: &'a Window,
    pairs: Vec<Pair>,
    rooms: Vec<Inside>,
}

impl Job<'_> {
    /// Passes over all seams.
    fn sweep(&self, usage: &mut Usage, at: &mut [Vec2], passes: u32) -> u64 {
        let mut moved = 0;
        // Faces that changed in the pass before, and in this one.
        let (mut recent, mut changed) = (vec![true; at.len()], vec![false; at.len()]);
        for _ in 0..passes {
            let before = moved;
            let mut todo = self.worst_first(at);
            let mut done = vec![false; at.len()];
            let mut taken = vec![0u32; at.len()];
            let mut round = 0;
            while !todo.is_empty() {
                round += 1;
                let mut windows = self.apart(&mut todo, round, &mut done, &mut taken);
                windows.retain(|w| w.all().any(|g| recent[g as usize] || changed[g as usize]));
                let (places, used) = (&*at, &*usage);
                let found = par::map_chunks(windows.len(), 1, |some| {
                    let mut cut = GraphCut::default();
                    windows[some].iter().map(|w| self.improve(places, used, w, &mut cut)).collect::<Vec<_>>()
                });
                for (f, to) in found.concat().into_iter().flatten() {
                    let from = std::mem::replace(&mut at[f as usize], to);
                    usage.moved(self.shown(f, from), self.shown(f, to));
                    changed[f as usize] = true;
                    moved += 1;
                }
            }
            if moved == before {
                break;
            }
            recent = std::mem::replace(&mut changed, vec![false; at.len()]);
        }
        moved
    }

    /// Windows of a round that have nothing in common, around the first faces that are still to do; they and what their
    /// windows vouch for are done then.
    fn apart(&self, todo: &mut Vec<u32>, round: u32, done: &mut [bool], taken: &mut [u32]) -> Vec<Window> {
        let mut windows = vec![];
        todo.retain(|&f| {
            if done[f as usize] || taken[f as usize] == round {
                return !done[f as usize];
            }
            let window = self.window(f);
            if window.all().any(|g| taken[g as usize] == round) {
                return true;
            }
            window.all().for_each(|g| taken[g as usize] = round);
            window.inner().iter().for_each(|g| done[*g as usize] = true);
            windows.push(window);
            false
        });
        windows
    }

    /// Faces beside seams, those with the costliest texel first.
    fn worst_first(&self, at: &[Vec2]) -> Vec<u32> {
        let worst = |f: usize| {
            let per_texel = |k: usize| {
                let [a, b] = self.facets.edge(f, k);
                self.seams.cost(at, f, k) / (b - a).length().max(0.1)
            };
            per_texel(0).max(per_texel(1)).max(per_texel(2))
        };
        let costs = par::map(at.len(), worst);
        let mut out: Vec<u32> = (0..at.len() as u32).filter(|f| costs[*f as usize] > 0.0).collect();
        out.sort_unstable_by(|a, b| costs[*b as usize].total_cmp(&costs[*a as usize]).then(a.cmp(b)));
        out
    }

    /// The texel that a face shows at its centre.
    fn shown(&self, f: u32, at: Vec2) -> [u16; 2] {
        let p = at + self.facets.centre(f as usize);
        texel_of(texel(p.x as f32, p.y as f32))
    }

    /// The faces around a first one, breadth first.
    fn window(&self, first: u32) -> Window {
        let origin = self.facets.centre(first as usize);
        let (mut faces, mut laid, mut ring) = (vec![first], vec![Vec2::ZERO], vec![]);
        let mut known = BTreeSet::from([first]);
        let mut next = 0;
        while next < faces.len() {
            let (f, at) = (faces[next] as usize, laid[next]);
            next += 1;
            for (k, (g, j)) in (0..3).filter_map(|k| Some((k, self.facets.opposite(f, k)?))) {
                if !known.insert(g as u32) {
                    continue;
                }
                let to = at + self.facets.middle(f, k) - self.facets.middle(g, j);
                if (to + self.facets.centre(g) - origin).length() <= REACH && faces.len() < MOST_FACES {
                    faces.push(g as u32);
                    laid.push(to);
                } else {
                    ring.push(g as u32);
                }
            }
        }
        Window { faces, laid, ring }
    }

    /// The edges of a window, each once.
    fn pairs(&self, w: &Window) -> Vec<Pair> {
        let mut numbers: Vec<(u32, usize)> = w.faces.iter().copied().zip(0..).collect();
        numbers.sort_unstable();
        let number = |g: usize| numbers.binary_search_by_key(&(g as u32), |n| n.0).ok().map(|at| numbers[at].1);
        let mut pairs = vec![];
        for (i, &f) in w.faces.iter().enumerate() {
            for (k, beyond) in (0..3).filter_map(|k| Some((k, self.facets.opposite(f as usize, k)?))) {
                let n = number(beyond.0);
                if n.is_none_or(|n| n > i) {
                    pairs.push(Pair { i, k, beyond, n });
                }
            }
        }
        pairs
    }

    /// The faces of a window that go over, and where they lie then.
    fn improve(&self, at: &[Vec2], usage: &Usage, window: &Window, cut: &mut GraphCut) -> Vec<(u32, Vec2)> {
        let room = |f: &u32| Inside::new(self.seams.size, box_of(&self.facets.local[*f as usize]));
        let rooms = window.faces.iter().map(room).collect();
        let work = Work { job: self, at, usage, window, pairs: self.pairs(window), rooms };
        let mut own: Vec<Vec2> = window.faces.iter().map(|f| at[*f as usize]).collect();
        let mut costs = work.costs(&own);
        for shift in window.shifts(&own) {
            let to: Vec<Vec2> = window.laid.iter().map(|laid| shift + *laid).collect();
            if let Some((new, after)) = work.expand(&own, &costs, &to, cut) {
                (own, costs) = (new, after);
            }
        }
        let faces = window.faces.iter().copied();
        faces.zip(own).filter(|(f, place)| at[*f as usize] != *place).collect()
    }
}

impl Work<'_> {
    /// What an edge costs in whole numbers.
    fn cost(&self, p: &Pair, a: Vec2, b: Vec2) -> i32 {
        let f = self.window.faces[p.i] as usize;
        (self.job.seams.between(f, p.k, a, p.beyond, b) * 1000.0).min(MOST) as i32
    }

    /// Where the far end of a pair lies.
    fn far(&self, p: &Pair, places: &[Vec2]) -> Vec2 {
        p.n.map_or(self.at[p.beyond.0], |n| places[n])
    }

    fn costs(&self, places: &[Vec2]) -> Vec<i32> {
        self.pairs.iter().map(|p| self.cost(p, places[p.i], self.far(p, places))).collect()
    }

    /// What it costs in overuse that a face moves.
    fn moving(&self, i: usize, from: Vec2, to: Vec2) -> i32 {
        let [_, b, c] = self.job.facets.local[self.window.faces[i] as usize];
        let price = |place: Vec2| {
            let [x, y] = self.job.shown(self.window.faces[i], place);
            f64::from(self.usage.cost_at(texel(x.into(), y.into())))
        };
        let area = 0.5 * b.cross(c).abs();
        (OVERUSE * area * (price(to) - price(from))).clamp(-MOST, MOST) as i32
    }

    /// Gives those faces to a patch, which would have them lie at `to`, for which the sum is least; `None` if it does not
    /// fall.
    fn expand(&self, own: &[Vec2], costs: &[i32], to: &[Vec2], cut: &mut GraphCut) -> Option<(Vec<Vec2>, Vec<i32>)> {
        let may = |i: usize| (to[i] - own[i]).length() > SAME && self.rooms[i].contains(to[i]);
        let free: Vec<bool> = (0..to.len()).map(may).collect();
        cut.reset(to.len());
        for i in (0..to.len()).filter(|i| free[*i]) {
            cut.add_terminal(i, 2 * self.moving(i, own[i], to[i]));
        }
        for (p, stay) in self.pairs.iter().zip(costs) {
            let (i, other) = (p.i, self.far(p, own));
            match (free[i], p.n.filter(|n| free[*n])) {
                (true, Some(n)) => {
                    let (first, second) = (self.cost(p, to[i], other), self.cost(p, own[i], to[n]));
                    let both = self.cost(p, to[i], to[n]);
                    cut.add_move([i, n], [*stay, first, second, both]);
                }
                (true, None) => cut.add_terminal(i, 2 * (self.cost(p, to[i], other) - stay)),
                (false, Some(n)) => cut.add_terminal(n, 2 * (self.cost(p, own[i], to[n]) - stay)),
                (false, None) => {}
            }
        }
        cut.connect();
        cut.cut();
        let goes = |i: usize| free[i] && cut.is_sink(i);
        let used: i64 = (0..to.len()).filter(|i| goes(*i)).map(|i| i64::from(self.moving(i, own[i], to[i]))).sum();
        let new: Vec<Vec2> = (0..to.len()).map(|i| if goes(i) { to[i] } else { own[i] }).collect();
        let after = self.costs(&new);
        let sum = |costs: &[i32]| costs.iter().map(|c| i64::from(*c)).sum::<i64>();
        (sum(&after) + used < sum(costs)).then_some((new, after))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::exemplar::{AnalysisParams, TextonParams, analyse_textons};
    use crate::field::{Field, Symmetry};
    use crate::mesh::zoo;
    use crate::numerics::rng::Key;
    use crate::numerics::vec::{vec2, vec3};
    use crate::texture::{MapKind, MapSet, Texture};

    /// Noise whose right half repeats the left one in columns 12 to 27 alone.
    fn half_alike() -> (TextonMap, SeamMetrics) {
        let t = Texture::from_fn(80, 48, 1, |x, y, out| {
            let x = if (52..68).contains(&x) { x - 40 } else { x };
            out[0] = Key::new(5).with(x.into()).unit(y.into()) as f32;
        });
        let maps = MapSet::new(vec![(MapKind::Height, t)]);
        let params = TextonParams { window: 5, ..TextonParams::default() };
        let map = analyse_textons(&maps, &params).unwrap().0;
        (map, SeamMetrics::new(&maps, &AnalysisParams::default()).unwrap())
    }

    /// A plane of 32 x 32 texels, laid into the left half of the sample up to a column and into the right half beyond.
    fn two_patches(column: f64) -> (Facets, Vec<Vec2>) {
        let m = zoo::plane(12, 12);
        let n = m.positions.len();
        let scale = 32.0 / 12.0;
        let field = Field { up: vec![vec3(0.0, 1.0, 0.0); n], scale: vec![scale; n] };
        let facets = Facets::new(&m, &field, Symmetry::One);
        let place = |f: usize| {
            let p = m.corners(f)[0];
            let at = vec2(p.x * f64::from(scale) + 4.0, 40.0 - p.y * f64::from(scale));
            if at.x + facets.centre(f).x < column { at } else { at + vec2(40.0, 0.0) }
        };
        let at = (0..m.faces.len()).map(place).collect();
        (facets, at)
    }

    fn total(seams: &Seams, at: &[Vec2]) -> f64 {
        (0..at.len()).flat_map(|f| (0..3).map(move |k| (f, k))).map(|(f, k)| seams.cost(at, f, k)).sum::<f64>() * 0.5
    }

    #[test]
    fn a_seam_goes_where_both_sides_agree() {
        let (map, metrics) = half_alike();
        let (facets, mut at) = two_patches(31.0);
        let before = total(&Seams::new(&map, &facets), &at);
        let run = |jobs: usize| {
            let mut at = at.clone();
            par::install(jobs, || reseam(&map, &metrics, &facets, &mut at, 2));
            at
        };
        assert_eq!(run(1), run(3));
        assert!(total(&Seams::new(&map, &facets), &run(1)) < 0.7 * before);
        let job = Job { seams: Seams::new(&map, &facets), facets: &facets };
        let shown: Vec<[u16; 2]> = (0..at.len()).map(|f| job.shown(f as u32, at[f])).collect();
        let mut usage = Usage::new(map.alike().domain(), &metrics.levels[0], 0, shown.into_iter()).ignored();
        let moved = job.sweep(&mut usage, &mut at, 2);
        assert!(moved > 10, "{moved}");
        let left = total(&Seams::new(&map, &facets), &at);
        assert!(left < 0.2 * before, "{before} {left}");
        let rooms = |f: usize| Inside::new([80, 48], box_of(&facets.local[f]));
        assert!((0..at.len()).all(|f| rooms(f).contains(at[f])));
    }

    #[test]
    fn one_patch_stays_as_it_is() {
        let (map, metrics) = half_alike();
        let (facets, at) = two_patches(100.0);
        let mut after = at.clone();
        assert_eq!(reseam(&map, &metrics, &facets, &mut after, 2), 0);
        assert_eq!(after, at);
    }

    #[test]
    fn a_window_has_every_edge_once_and_is_laid_out_flat() {
        let (map, _) = half_alike();
        let (facets, at) = two_patches(100.0);
        let job = Job { seams: Seams::new(&map, &facets), facets: &facets };
        let w = job.window(0);
        assert!(w.faces.len() > 100 && w.faces.len() <= MOST_FACES && !w.ring.is_empty(), "{}", w.faces.len());
        assert!(w.ring.iter().all(|g| !w.faces.contains(g)));
        assert_eq!(w.shifts(&w.faces.iter().map(|f| at[*f as usize]).collect::<Vec<_>>()).len(), 1);
        let inner = w.faces.iter().flat_map(|f| (0..3).filter_map(|k| facets.opposite(*f as usize, k)));
        let (mut half, mut out) = (0, 0);
        inner.for_each(|(g, _)| if w.faces.contains(&(g as u32)) { half += 1 } else { out += 1 });
        assert_eq!(job.pairs(&w).len(), half / 2 + out);
    }
}
