//! Quilting: every face gets its place in the exemplar, grown from a seed so that edges match.
//!
//! Source: \[MK03\] section 3.2.2. In: textons, faces laid flat. Out: for each face where its first corner lies.
//! Reads as:
//! - "Grown on the surface from that initial face": next come the pieces with the greatest share of their border finished,
//!   all of a round at once that are not adjacent (at least `ROUND_SHARE` of the greatest share), so that they can be
//!   searched in parallel. Of 3072 faces of a torus in smooth noise 28 close badly in rounds, 1 by strictly the greatest
//!   share, 43 breadth first, 44 in the order of the mesh; the seams are 2229, 2478, 2103 and 2432, what they differ by
//!   0.204, 0.205, 0.194 and 0.240 of what unrelated texels do (`tests`): rounds keep both low.
//! - "From a randomly selected triangle": its piece lies on the grid of texels through the origin of space, and all that
//!   continue it lie there as far as the surface is flat, so that walls along the axes are not blurred.
//! - Candidates are the m places with the most votes and the places that continue a finished neighbour, which votes would
//!   only find to within a texel. Of those that Eq. 2 ranks best the final choice is by the texels' own vectors: clusters
//!   do not tell a good match from a perfect one.
//!
//! Beyond the paper, with `refine` > 0: pieces of several triangles (`patch`); passes in which every piece is opened again
//! and searched with all its neighbours known, shifts of its present place by up to two texels among the candidates;
//! minimum cuts by faces (`cut`) and along seams (`reseam`). With `refine` = 0 the result is the published method's.
//! Unaware of: positions, colours.

pub mod blend;
mod cut;
pub mod frame;
mod patch;
mod reseam;
mod seam;
pub mod texton_string;

use super::Error;
use super::seam_metric::SeamMetrics;
use crate::exemplar::TextonMap;
use crate::numerics::par;
use crate::numerics::rng::Key;
use crate::numerics::vec::{Vec2, vec2};
use frame::Facets;
use patch::Patches;
use seam::box_of;
use texton_string::{Ballot, Inside, Sample, WholeSteps, error, fine_error, steps, texel_at};

/// How to quilt.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct QuiltParams {
    /// Seed of all random choices.
    pub seed: u64,
    /// Places that are ranked by Eq. 2, m of \[MK03\] 3.2.2; 1..=4096.
    pub candidates: u32,
    /// Passes in which pieces are opened again; 0 is the published method, one triangle at a time.
    pub refine: u32,
    /// How far a piece reaches around its first triangle, as a share of the exemplar's shorter side; positive.
    ///
    /// A sixteenth does best on basket, radishes and wicker over a plane of 4608 triangles: against pieces of an eighth,
    /// mean distance of 9x9 patches to the exemplar's nearest 5.9 (6.9), 7.8 (8.5), 8.0 (12.3); of a thirty-second 9.7,
    /// 11.8 and more.
    pub reach: f64,
}

impl Default for QuiltParams {
    fn default() -> Self {
        QuiltParams { seed: 0, candidates: 64, refine: 2, reach: 0.0625 }
    }
}

/// How often the quilting did what.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct QuiltCounters {
    /// Pieces; without refining as many as faces.
    pub pieces: u64,
    /// Pieces that began without a finished neighbour: one per component.
    pub seeds: u64,
    /// Pieces whose best place goes on from a neighbour.
    pub continued: u64,
    /// Pieces whose neighbours were all finished when they were placed.
    pub closings: u64,
    /// Those of them that fit badly: by more than a third of how much unrelated texels differ.
    pub bad_closings: u64,
    /// Pieces that found a better place when they were opened again.
    pub reopened: u64,
    /// Faces that minimum cuts gave to another patch.
    pub recut: u64,
    /// Faces that went over to the patch on the other side of a seam.
    pub relaxed: u64,
}

/// The result of quilting.
#[derive(Clone, Debug, PartialEq)]
pub struct Quilt {
    /// Where the first corner of each face lies in the exemplar, in texels. The face lies within the outer texel centres.
    pub at: Vec<Vec2>,
    /// How often the quilting did what.
    pub counters: QuiltCounters,
}

/// Pieces per parallel task. Many rounds have a dozen of them, which take ten to twenty microseconds each; of those
/// that are opened again most stay.
const CHUNK: usize = 2;
const REOPENED_CHUNK: usize = 16;
/// Most candidates.
const MAX_CANDIDATES: u32 = 4096;
/// Places that are compared texel by texel.
const FINALISTS: usize = 8;
/// Pieces whose share is at least this part of the greatest one are placed in one round: pieces of several triangles, and
/// single ones. With the lower part these are 12 instead of 6 in a round over a torus of 8192, and edges differ by 0.89 of
/// what they do with the higher (pebbles), over spot by 0.99 (mean of four samples); pieces of several would by 1.02.
const ROUND_SHARE: f64 = 0.75;
const ROUND_SHARE_OF_ONE: f64 = 0.4;
/// Largest part of the exemplar's sides that a piece of several triangles may take.
const MOST_OF_SIDE: f64 = 0.6;
/// Continuations nearer to each other than this, in texels, are one.
const ONE_PLACE: f64 = 1.0;
/// A closing is bad if it differs from its neighbours by more than this part of what unrelated texels do.
const BAD: f64 = 1.0 / 3.0;
/// A reopened piece moves if its error falls below this part of the present one.
const BETTER: f64 = 0.98;

/// Places every face. `metrics`, of the same exemplar, are what minimum cuts compare by where `refine` is above 0; without
/// any nothing is cut. The result is the same for any number of threads; time is linear in the faces.
///
/// Fails if a parameter is out of range or a face does not fit into the exemplar.
pub fn quilt(
    map: &TextonMap,
    facets: &Facets,
    metrics: Option<&SeamMetrics>,
    params: &QuiltParams,
) -> Result<Quilt, Error> {
    quilt_in_order(map, facets, metrics, params, Growth::Rounds)
}

/// Which pieces are placed next.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Growth {
    /// Of those with the greatest finished shares, all that are not adjacent.
    Rounds,
    /// The one with the greatest share.
    #[cfg(test)]
    Share,
    /// All at the front that are not adjacent.
    #[cfg(test)]
    Breadth,
    /// The one that comes first in the mesh.
    #[cfg(test)]
    Listed,
}

/// As [`quilt`], grown in an order.
fn quilt_in_order(
    map: &TextonMap,
    facets: &Facets,
    metrics: Option<&SeamMetrics>,
    params: &QuiltParams,
    growth: Growth,
) -> Result<Quilt, Error> {
    check(map, facets, params)?;
    let sides = [map.width(), map.height()].map(f64::from);
    let patches = match params.refine {
        0 => Patches::single(facets),
        _ => Patches::new(facets, params.reach * sides[0].min(sides[1]), sides.map(|s| (s - 1.0) * MOST_OF_SIDE)),
    };
    let mut job = Job {
        map,
        facets,
        patches: &patches,
        params,
        key: Key::new(params.seed).with_str("quilt"),
        at: vec![vec2(f64::NAN, f64::NAN); facets.len()],
        counters: QuiltCounters { pieces: patches.len() as u64, ..QuiltCounters::default() },
        ballots: par::Scratch::default(),
    };
    job.grow(growth);
    if params.refine > 0 {
        job.reopen();
        if let Some(metrics) = metrics {
            job.counters.recut = cut::recut(map, metrics, facets, &mut job.at, params.refine)?;
            job.counters.relaxed = reseam::reseam(map, metrics, facets, &mut job.at, params.refine);
        }
    }
    Ok(Quilt { at: job.at, counters: job.counters })
}

fn check(map: &TextonMap, facets: &Facets, params: &QuiltParams) -> Result<(), Error> {
    if !(1..=MAX_CANDIDATES).contains(&params.candidates) {
        return Err(Error::Candidates { found: params.candidates, max: MAX_CANDIDATES });
    }
    if !(params.reach > 0.0 && params.reach.is_finite()) {
        return Err(Error::Patch(params.reach));
    }
    let size = [map.width(), map.height()];
    for (face, local) in facets.local.iter().enumerate() {
        let (low, high) = box_of(local);
        // Not `>`: NaN fails as well.
        if !(high.x - low.x <= f64::from(size[0]) - 1.0 && high.y - low.y <= f64::from(size[1]) - 1.0) {
            return Err(Error::FaceTooLarge { face, span: [high.x - low.x, high.y - low.y], exemplar: size });
        }
    }
    Ok(())
}

struct Job<'a> {
    map: &'a TextonMap,
    facets: &'a Facets,
    patches: &'a Patches,
    params: &'a QuiltParams,
    key: Key,
    /// NaN for faces not yet placed.
    at: Vec<Vec2>,
    counters: QuiltCounters,
    ballots: par::Scratch<Ballot>,
}

/// What a search found.
#[derive(Clone, Copy)]
struct Found {
    origin: Vec2,
    continues: bool,
    /// Root of the mean squared distance to what lies along the border, in steps of the texels' vectors.
    error: f64,
}

impl Job<'_> {
    fn size(&self) -> [u32; 2] {
        [self.map.width(), self.map.height()]
    }

    /// The edges of a piece to others, as (face, edge, face beyond, its edge).
    fn border(&self, patch: usize) -> impl Iterator<Item = (usize, usize, usize, usize)> + '_ {
        let edges = self.patches.faces(patch).iter().flat_map(|f| (0..3).map(move |k| (*f as usize, k)));
        edges.filter_map(move |(f, k)| {
            let (g, j) = self.facets.opposite(f, k)?;
            (self.patches.of[g] as usize != patch).then_some((f, k, g, j))
        })
    }

    /// The texton string along the finished edges of a piece, and the places that continue its neighbours, the one with
    /// the longest edges first.
    fn string(&self, patch: usize) -> (Vec<Sample>, Vec<Vec2>) {
        let (mut string, mut places): (Vec<Sample>, Vec<(Vec2, f64)>) = (vec![], vec![]);
        let rotations = self.map.rotations();
        for (f, k, g, j) in self.border(patch).filter(|e| !self.at[e.2].x.is_nan()) {
            let rel = self.patches.rel[f];
            let ([a, b], [d, c]) = (self.facets.edge(f, k), self.facets.edge(g, j));
            let turns = if rotations > 1 { self.facets.turn(f, k) / std::f64::consts::TAU } else { 0.0 };
            let rotation = ((turns * f64::from(rotations)).round() as i64).rem_euclid(i64::from(rotations)) as u32;
            let labels = self.map.labels(rotation);
            let length = (b - a).length();
            let n = steps(length);
            for i in 0..n {
                let t = (f64::from(i) + 0.5) / f64::from(n);
                let texel = texel_at(self.size(), self.at[g] + c + (d - c) * t);
                string.push(Sample { offset: rel + a + (b - a) * t, label: labels[texel as usize], texel });
            }
            let place = self.at[g] + (c + d) * 0.5 - (a + b) * 0.5 - rel;
            match places.iter_mut().find(|(p, _)| (*p - place).length() < ONE_PLACE) {
                Some((p, weight)) => {
                    *weight += length;
                    *p = *p + (place - *p) * (length / weight.max(1e-9));
                }
                None => places.push((place, length)),
            }
        }
        // Stable: equal weights keep their order.
        places.sort_by(|a, b| b.1.total_cmp(&a.1));
        (string, places.into_iter().map(|p| p.0).collect())
    }

    /// The best place of a piece whose neighbours are as they are; `None` if it is best where it is.
    fn search(&self, patch: usize, now: Option<Vec2>, ballot: &mut Ballot) -> Option<Found> {
        let inside = Inside::new(self.size(), self.patches.bounds(self.facets, patch));
        let key = self.key.with(patch as u64);
        let (string, places) = self.string(patch);
        if string.is_empty() {
            let first = self.patches.faces(patch)[0] as usize;
            let (random, phase) = (inside.random(key), self.facets.phase[first] - self.patches.rel[first]);
            let whole = |r: f64, phase: f64| (r - phase).round() + phase;
            let origin = inside.nearest(vec2(whole(random.x, phase.x), whole(random.y, phase.y)));
            return now.is_none().then_some(Found { origin, continues: false, error: 0.0 });
        }
        let per_sample = |error: u64| (error as f64 / string.len() as f64).sqrt();
        let base = now.unwrap_or(places[0]);
        let mut candidates: Vec<Vec2> = places.iter().copied().filter(|p| inside.contains(*p)).collect();
        let continuations = candidates.len();
        // Nothing beats a place where all edges go on: most pieces need no votes.
        let goes_on = |at: &Vec2| fine_error(self.map, &string, *at, 1) == 0;
        if now.is_some_and(|now| goes_on(&now)) {
            return None;
        } else if let Some(&origin) = candidates.iter().find(|at| goes_on(at)) {
            return Some(Found { origin, continues: true, error: 0.0 });
        }
        if let Some(now) = now {
            let steps = [-2.0, -1.0, 0.0, 1.0, 2.0];
            let shifts = steps.iter().flat_map(|y| steps.iter().map(move |x| now + vec2(*x, *y)));
            candidates.extend(shifts.filter(|p| inside.contains(*p)));
        }
        candidates.extend(ballot.best(self.map, &string, &inside, base, self.params.candidates as usize, key));
        if candidates.is_empty() {
            // Nothing like it where there is room.
            let origin = inside.nearest(places[0]);
            let error = per_sample(fine_error(self.map, &string, origin, u64::MAX));
            return now.is_none().then_some(Found { origin, continues: false, error });
        }
        let whole = WholeSteps::new(self.map, &string, base);
        // The first of equals, since those later must be below.
        let mut finalists: Vec<(u64, usize)> = Vec::with_capacity(FINALISTS + 1);
        for (i, at) in candidates.iter().enumerate() {
            let limit = if finalists.len() < FINALISTS { u64::MAX } else { finalists[FINALISTS - 1].0 };
            let e = if i < continuations {
                error(self.map, &string, *at, limit)
            } else {
                whole.error(self.map, *at, limit)
            };
            if e < limit {
                finalists.insert(finalists.partition_point(|f| f.0 <= e), (e, i));
                finalists.truncate(FINALISTS);
            }
        }
        finalists.sort_unstable_by_key(|f| f.1);
        let mut best = (u64::MAX, 0);
        for (_, i) in finalists {
            let e = fine_error(self.map, &string, candidates[i], best.0);
            if e < best.0 {
                best = (e, i);
            }
        }
        let found = Found { origin: candidates[best.1], continues: best.1 < continuations, error: per_sample(best.0) };
        let Some(now) = now else { return Some(found) };
        let present = fine_error(self.map, &string, now, u64::MAX);
        ((best.0 as f64) < present as f64 * BETTER).then_some(found)
    }

    fn place(&mut self, patch: usize, origin: Vec2) {
        for &f in self.patches.faces(patch) {
            self.at[f as usize] = origin + self.patches.rel[f as usize];
        }
    }

    /// Places every piece, from seeds outwards.
    fn grow(&mut self, growth: Growth) {
        let mut front = Front::new(self);
        let bad = BAD * seam::typical_distance(self.map);
        let n = self.patches.len();
        let first = if n > 0 { self.patches.of[self.key.below(0, self.facets.len() as u32) as usize] } else { 0 };
        for seed in std::iter::once(first).chain(0..n as u32) {
            if n == 0 || front.placed[seed as usize] {
                continue;
            }
            self.counters.seeds += 1;
            let mut round = vec![seed];
            while !round.is_empty() {
                let found = par::map_chunks(round.len(), CHUNK, |r| {
                    let find = |ballot: &mut Ballot| {
                        round[r].iter().map(|p| self.search(*p as usize, None, ballot)).collect::<Vec<_>>()
                    };
                    self.ballots.with(find)
                });
                for (&p, found) in round.iter().zip(found.concat()) {
                    let Some(found) = found else { continue };
                    let closes = front.share(p) > 0.999;
                    self.counters.continued += u64::from(found.continues);
                    self.counters.closings += u64::from(closes);
                    self.counters.bad_closings += u64::from(closes && found.error > bad);
                    self.place(p as usize, found.origin);
                }
                for &p in &round {
                    front.finish(self, p);
                }
                round = front.next(self, growth);
            }
        }
    }

    /// Opens every piece again and looks for a better place with all neighbours known.
    fn reopen(&mut self) {
        let neighbours = |p: usize, out: &mut Vec<u32>| out.extend(self.border(p).map(|e| self.patches.of[e.2]));
        let colours = seam::colours(self.patches.len(), neighbours);
        let mut dirty = vec![true; self.patches.len()];
        for _ in 0..self.params.refine {
            let before = self.counters.reopened;
            for colour in &colours {
                let some: Vec<u32> = colour.iter().copied().filter(|p| dirty[*p as usize]).collect();
                let found = par::map_chunks(some.len(), REOPENED_CHUNK, |r| {
                    let origin = |p: usize| {
                        let f = self.patches.faces(p)[0] as usize;
                        self.at[f] - self.patches.rel[f]
                    };
                    self.ballots.with(|ballot| {
                        let again = |p: &u32| self.search(*p as usize, Some(origin(*p as usize)), ballot);
                        some[r].iter().map(again).collect::<Vec<_>>()
                    })
                });
                for (&p, found) in some.iter().zip(found.concat()) {
                    dirty[p as usize] = false;
                    if let Some(found) = found {
                        self.place(p as usize, found.origin);
                        self.counters.reopened += 1;
                        let around: Vec<u32> = self.border(p as usize).map(|e| self.patches.of[e.2]).collect();
                        around.into_iter().for_each(|q| dirty[q as usize] = true);
                    }
                }
            }
            if self.counters.reopened == before {
                break;
            }
        }
    }
}

/// The pieces beside finished ones.
struct Front {
    placed: Vec<bool>,
    /// Finished and whole length of the border to other pieces.
    finished: Vec<f64>,
    whole: Vec<f64>,
    open: Vec<u32>,
    /// The round in which a piece was adjacent to one that was chosen.
    blocked: Vec<u32>,
    round: u32,
}

impl Front {
    fn new(job: &Job) -> Self {
        let n = job.patches.len();
        let length = |p: usize| job.border(p).map(|(f, k, ..)| length(job.facets, f, k)).sum();
        Front {
            placed: vec![false; n],
            finished: vec![0.0; n],
            whole: par::map(n, length),
            open: vec![],
            blocked: vec![0; n],
            round: 0,
        }
    }

    /// The finished share of a piece's border.
    fn share(&self, p: u32) -> f64 {
        let p = p as usize;
        if self.whole[p] > 0.0 { self.finished[p] / self.whole[p] } else { 0.0 }
    }

    fn finish(&mut self, job: &Job, p: u32) {
        self.placed[p as usize] = true;
        for (_, _, g, j) in job.border(p as usize) {
            let q = job.patches.of[g];
            if self.finished[q as usize] == 0.0 && !self.placed[q as usize] {
                self.open.push(q);
            }
            // Never zero, so that a piece joins the front once.
            self.finished[q as usize] += length(job.facets, g, j).max(1e-12);
        }
    }

    /// The pieces to be placed next: those with the greatest shares, none adjacent to another.
    fn next(&mut self, job: &Job, growth: Growth) -> Vec<u32> {
        self.round += 1;
        let placed = &self.placed;
        self.open.retain(|p| !placed[*p as usize]);
        let (by_share, most) = match growth {
            Growth::Rounds => (true, usize::MAX),
            #[cfg(test)]
            Growth::Share => (true, 1),
            #[cfg(test)]
            Growth::Breadth => (false, usize::MAX),
            #[cfg(test)]
            Growth::Listed => (false, 1),
        };
        let least = if job.params.refine > 0 { ROUND_SHARE } else { ROUND_SHARE_OF_ONE };
        let share = |p: u32| if by_share { self.share(p) } else { 1.0 };
        let mut ready: Vec<(f64, u32)> = self.open.iter().map(|p| (share(*p), *p)).collect();
        let greatest = ready.iter().fold(0.0, |m: f64, r| m.max(r.0));
        ready.retain(|r| r.0 >= greatest * least);
        ready.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        let mut chosen = vec![];
        for (_, p) in ready {
            if self.blocked[p as usize] == self.round || chosen.len() >= most {
                continue;
            }
            chosen.push(p);
            job.border(p as usize).for_each(|(.., g, _)| self.blocked[job.patches.of[g] as usize] = self.round);
        }
        chosen
    }
}

fn length(facets: &Facets, f: usize, k: usize) -> f64 {
    let [a, b] = facets.edge(f, k);
    (b - a).length()
}

#[cfg(test)]
mod tests;
