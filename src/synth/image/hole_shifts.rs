//! Shifts by which a hole may be filled: those by which what surrounds a part of it is found again elsewhere.
//!
//! Source: matching of the known surroundings, as in Criminisi et al.: Region Filling and Object Removal (2004); that the
//! matches become the labels of a minimum cut: Pritch et al.: Shift-Map Image Editing (2009).
//! In: sources of the pixels around the hole, differences of texels. Out: offsets from pixels to texels. The hole is looked
//! at in squares of several sides, so that its whole is tried as well as its parts.
//! Unaware of: how shifts are put together.

use super::board::Board;
use super::source_map::EMPTY;
use crate::exemplar::Domain;
use crate::numerics::par;
use crate::synth::seam_metric::{Metric, UNIT};

/// A pixel, a texel, or an offset from one to the other.
type Place = [i32; 2];

/// Side of the smallest squares, in pixels, and how many of them there are at most: else they are larger.
const SIDE: u32 = 32;
const MOST_SQUARES: usize = 64;

/// Pixels up to so many steps away from the hole are compared.
const FAR: u32 = 9;

/// Pixels around a square, and in it, that are looked at.
const PROBES: usize = 96;
const INSIDE: usize = 32;

/// Shifts tried for a square, before the best are looked at more closely.
const TRIED: usize = 1 << 15;

/// Shifts taken of each square, no two of which are nearer than `APART` to each other.
const TAKEN: usize = 4;
const APART: i32 = 4;

/// Cost of a shift that has no texel at a pixel: as of one that looks quite different.
const MISSING: i32 = (4.0 * UNIT) as i32;

/// Part of a hole: some of its pixels, and of those around it with the texels they show.
struct Part {
    inside: Vec<Place>,
    around: Vec<(Place, u32)>,
}

/// At most `count` shifts for the pixels of a board that are not given, those for large parts first.
pub(super) fn hole_shifts(metric: &Metric, domain: &Domain, board: &Board, count: usize) -> Vec<Place> {
    let Some(given) = &board.given else { return vec![] };
    let away = distances(given, board.size, FAR + 1);
    let finest = (0..16).map(|i| SIDE << i).find(|side| squares(board, &away, *side).len() <= MOST_SQUARES);
    let Some(finest) = finest else { return vec![] };
    let longest = board.size[0].max(board.size[1]);
    let sides: Vec<u32> = (0..16).map(|i| finest << i).take_while(|side| *side < longest * 2).collect();
    let mut out: Vec<Place> = vec![];
    for side in sides.into_iter().rev() {
        for [x, y] in squares(board, &away, side) {
            let part = part(board, domain, &away, [x * side, y * side], side);
            for shift in best(metric, domain, &part) {
                if !out.contains(&shift) {
                    out.push(shift);
                }
            }
        }
    }
    out.truncate(count);
    out
}

/// How far each pixel is from those that are not known, in steps along rows and columns, at most `most`.
pub(in crate::synth) fn distances(known: &[bool], [w, h]: [u32; 2], most: u32) -> Vec<u32> {
    let (w, h) = (w as usize, h as usize);
    let mut away: Vec<u32> = known.iter().map(|k| if *k { most } else { 0 }).collect();
    for y in 0..h {
        for x in 0..w {
            let i = y * w + x;
            let before = [(x > 0).then(|| i - 1), (y > 0).then(|| i - w)];
            away[i] = before.into_iter().flatten().fold(away[i], |least, j| least.min(away[j] + 1));
        }
    }
    for y in (0..h).rev() {
        for x in (0..w).rev() {
            let i = y * w + x;
            let after = [(x + 1 < w).then(|| i + 1), (y + 1 < h).then(|| i + w)];
            away[i] = after.into_iter().flatten().fold(away[i], |least, j| least.min(away[j] + 1));
        }
    }
    away
}

/// Columns and rows of the squares that have a part of the hole, in order.
fn squares(board: &Board, away: &[u32], side: u32) -> Vec<[u32; 2]> {
    let [w, h] = board.size;
    let columns = w.div_ceil(side) as usize;
    let mut found = vec![false; columns * h.div_ceil(side) as usize];
    for (i, _) in away.iter().enumerate().filter(|(_, a)| **a == 0) {
        found[(i as u32 / w / side) as usize * columns + (i as u32 % w / side) as usize] = true;
    }
    let place = |i: usize| [(i % columns) as u32, (i / columns) as u32];
    found.iter().enumerate().filter(|(_, f)| **f).map(|(i, _)| place(i)).collect()
}

/// What is in a square and, within half its side, around it.
fn part(board: &Board, domain: &Domain, away: &[u32], [x, y]: [u32; 2], side: u32) -> Part {
    let [w, h] = board.size;
    let more = side / 2;
    let (mut inside, mut around) = (vec![], vec![]);
    for py in y.saturating_sub(more)..(y + side + more).min(h) {
        for px in x.saturating_sub(more)..(x + side + more).min(w) {
            let i = board.index(px, py);
            let place = [px as i32, py as i32];
            let [u, v] = board.sources[i];
            if away[i] == 0 && px >= x && py >= y && px < x + side && py < y + side {
                inside.push(place);
            } else if (1..=FAR).contains(&away[i]) && [u, v] != EMPTY {
                around.push((place, u32::from(v) * domain.width() + u32::from(u)));
            }
        }
    }
    Part { inside: thinned(inside, INSIDE), around: thinned(around, PROBES) }
}

/// About `count` entries, evenly spread.
fn thinned<T>(all: Vec<T>, count: usize) -> Vec<T> {
    let step = all.len().div_ceil(count).max(1);
    all.into_iter().step_by(step).collect()
}

/// The best shifts for a part.
fn best(metric: &Metric, domain: &Domain, part: &Part) -> Vec<Place> {
    let (Some(centre), false) = (part.inside.get(part.inside.len() / 2), part.around.is_empty()) else {
        return vec![];
    };
    let step = (1..).find(|s| domain.len() / (s * s) <= TRIED).unwrap_or(1);
    let on_grid = |t: &[u16; 2]| t.iter().all(|v| usize::from(*v).is_multiple_of(step));
    let coarse: Vec<Place> = domain.texels().filter(on_grid).map(|t| shift(t, *centre)).collect();
    let coarse = apart(rated(metric, domain, part, coarse), TAKEN * 2, APART + step as i32);
    if step == 1 {
        return coarse.into_iter().take(TAKEN).collect();
    }
    let reach = step as i32;
    let near = |[x, y]: &Place| -> Vec<Place> {
        let (x, y) = (*x, *y);
        (-reach..=reach).flat_map(|dy| (-reach..=reach).map(move |dx| [x + dx, y + dy])).collect()
    };
    apart(rated(metric, domain, part, coarse.iter().flat_map(near).collect()), TAKEN, APART)
}

fn shift(texel: [u16; 2], pixel: Place) -> Place {
    [i32::from(texel[0]) - pixel[0], i32::from(texel[1]) - pixel[1]]
}

/// Shifts with what they cost, the best first.
fn rated(metric: &Metric, domain: &Domain, part: &Part, shifts: Vec<Place>) -> Vec<(i64, Place)> {
    let texel = |p: &Place, s: Place| domain.at(p[0] + s[0], p[1] + s[1]);
    let cost = |s: Place| {
        let around = |(p, own): &(Place, u32)| match texel(p, s) {
            Some([u, v]) => metric.difference(*own, u32::from(v) * domain.width() + u32::from(u)).min(MISSING),
            None => MISSING,
        };
        let sum: i64 = part.around.iter().map(|a| i64::from(around(a))).sum();
        let lacking = part.inside.iter().filter(|p| texel(p, s).is_none()).count() as i64;
        sum / part.around.len() as i64 + lacking * i64::from(MISSING) / part.inside.len() as i64
    };
    let mut rated: Vec<(i64, Place)> = par::map(shifts.len(), |i| (cost(shifts[i]), shifts[i]));
    rated.sort_unstable();
    rated
}

/// The first of some that are far enough from those before.
fn apart(rated: Vec<(i64, Place)>, count: usize, least: i32) -> Vec<Place> {
    let mut out: Vec<Place> = vec![];
    for (_, s) in rated {
        if out.len() == count {
            break;
        }
        if out.iter().all(|o| (o[0] - s[0]).abs().max((o[1] - s[1]).abs()) >= least) {
            out.push(s);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::exemplar::AnalysisParams;
    use crate::synth::seam_metric::SeamMetrics;
    use crate::synth::testing::noise;
    use crate::texture::{MapKind, MapSet, Texture, Wrap};

    /// A board that shows the exemplar but for a hole.
    fn board(size: [u32; 2], hole: impl Fn(u32, u32) -> bool) -> Board {
        let mut board = Board::whole(size, false);
        for (i, s) in board.sources.iter_mut().enumerate() {
            let (x, y) = (i as u32 % size[0], i as u32 / size[0]);
            *s = if hole(x, y) { EMPTY } else { [x as u16, y as u16] };
        }
        board.given = Some(board.sources.iter().map(|s| *s != EMPTY).collect());
        board
    }

    #[test]
    fn a_picture_that_is_there_twice_is_found() {
        // The right half shows what the left half does.
        let half = noise(50, 60);
        let t = Texture::from_fn(100, 60, 1, |x, y, out| out[0] = half.get(x % 50, y)[0]);
        let metrics = SeamMetrics::new(&MapSet::new(vec![(MapKind::Height, t)]), &AnalysisParams::default()).unwrap();
        let hole = |x: u32, y: u32| (14..34).contains(&x) && (20..44).contains(&y);
        let domain = Domain::masked(100, 60, Wrap::Clamp, |x, y| !hole(x, y)).unwrap();
        let found = hole_shifts(&metrics.levels[0], &domain, &board([100, 60], hole), 9);
        assert_eq!((found[0], found.len()), ([50, 0], 9));
        let whole = board([100, 60], |_, _| false);
        assert!(hole_shifts(&metrics.levels[0], &domain, &whole, 9).is_empty());
    }

    #[test]
    fn distances_are_steps_to_the_hole() {
        let b = board([6, 4], |x, y| x == 1 && y == 2);
        let away = distances(b.given.as_ref().unwrap(), b.size, FAR + 1);
        assert_eq!(away[..6], [3, 2, 3, 4, 5, 6]);
        assert_eq!((away[2 * 6 + 1], away[3 * 6]), (0, 2));
        assert!(distances(&[true; 6], [3, 2], FAR + 1).iter().all(|a| *a > FAR));
    }

    #[test]
    fn a_large_hole_is_cut_into_few_squares() {
        let b = board([600, 500], |_, y| y > 20);
        let away = distances(b.given.as_ref().unwrap(), b.size, FAR + 1);
        assert_eq!(squares(&b, &away, 512), [[0, 0], [1, 0]]);
        let t = Texture::from_fn(600, 500, 1, |x, y, out| out[0] = ((x * 7 + y * 3) % 11) as f32);
        let metrics = SeamMetrics::new(&MapSet::new(vec![(MapKind::Height, t)]), &AnalysisParams::default()).unwrap();
        let domain = Domain::masked(600, 500, Wrap::Clamp, |_, y| y <= 20).unwrap();
        let found = hole_shifts(&metrics.levels[0], &domain, &b, 40);
        assert!(!found.is_empty() && found.len() <= 40);
    }
}
