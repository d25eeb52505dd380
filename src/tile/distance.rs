//! Signed distance fields on the torus, exact, in linear time.
//!
//! Source: \[MST09\] section 1, step 1: phi > 0 inside features. In: a mask. Out: Euclidean distances.
//! Reads as: the paper takes distances by neighbourhood sequences (Yamashita, Ibaraki 1986), which are near the Euclidean
//! ones; these are the Euclidean ones themselves, by columns and then by lower envelopes of parabolas along rows
//! (Meijster, Roerdink, Hesselink 2000), each row unrolled to three periods. Distances are between texel centres, less a
//! half, so that phi is 0 on the border between two texels and changes by one across it.
//! Unaware of: what the mask shows.

use super::Mask;
use crate::numerics::par;

/// For every texel, where the nearest texel of some set is.
pub(super) struct Nearest {
    /// Squared distance of the centres.
    pub squared: Vec<u32>,
    /// Steps to it, right and down.
    pub step: Vec<[i32; 2]>,
}

/// The nearest texel of the mask that is `on`, for every texel; `None` if there is none.
pub(super) fn nearest(mask: &Mask, on: bool) -> Option<Nearest> {
    let (w, h) = (mask.width() as usize, mask.height() as usize);
    if !mask.data().contains(&on) {
        return None;
    }
    let columns: Vec<Vec<Option<i32>>> =
        par::map_chunks(w, 16, |r| r.map(|x| column(mask, x, on)).collect::<Vec<_>>()).into_iter().flatten().collect();
    let rows = par::map_chunks(h, 16, |r| {
        let mut parabolas = Parabolas::default();
        r.flat_map(|y| parabolas.row(&columns, y)).collect::<Vec<_>>()
    });
    let step: Vec<[i32; 2]> = rows.concat();
    let squared = step.iter().map(|[x, y]| (x * x + y * y) as u32).collect();
    Some(Nearest { squared, step })
}

/// Steps down a column to the nearest texel of the set, the one above if two are as near.
fn column(mask: &Mask, x: usize, on: bool) -> Vec<Option<i32>> {
    let (w, h) = (mask.width() as usize, mask.height() as usize);
    let mut out: Vec<Option<i32>> = vec![None; h];
    // Twice around, so that what is found wraps.
    let mut last = None;
    for i in 0..2 * h {
        let y = i % h;
        if mask.data()[y * w + x] == on {
            last = Some(i);
        }
        if let (Some(last), true) = (last, i >= h) {
            out[y] = Some(last as i32 - i as i32);
        }
    }
    last = None;
    for i in (0..2 * h).rev() {
        let y = i % h;
        if mask.data()[y * w + x] == on {
            last = Some(i);
        }
        if let (Some(last), true) = (last, i < h) {
            let step = last as i32 - i as i32;
            out[y] = out[y].filter(|up| -up <= step).or(Some(step));
        }
    }
    out
}

/// The lower envelope of parabolas: apex, height, steps down, and where each begins.
#[derive(Default)]
struct Parabolas(Vec<(i64, i64, i32, i64)>);

impl Parabolas {
    fn row(&mut self, columns: &[Vec<Option<i32>>], y: usize) -> Vec<[i32; 2]> {
        let w = columns.len() as i64;
        self.0.clear();
        for u in -w..2 * w {
            let Some(down) = columns[u.rem_euclid(w) as usize][y] else { continue };
            let g = i64::from(down) * i64::from(down);
            let mut begin = i64::MIN;
            while let Some(&(a, ga, _, first)) = self.0.last() {
                // The first place where the new one is strictly lower.
                begin = (u * u - a * a + g - ga).div_euclid(2 * (u - a)) + 1;
                if begin > first {
                    break;
                }
                self.0.pop();
                begin = i64::MIN;
            }
            self.0.push((u, g, down, begin));
        }
        let mut at = 0;
        let step = |x: i64| {
            while self.0.get(at + 1).is_some_and(|next| next.3 <= x) {
                at += 1;
            }
            [(self.0[at].0 - x) as i32, self.0[at].2]
        };
        (0..w).map(step).collect()
    }
}

/// Signed distance of every texel's centre from the border of the features, in texels, above 0 inside. Where the mask has
/// no border, a distance longer than the torus.
pub(super) fn signed_distance(mask: &Mask) -> Vec<f32> {
    let far = (mask.width() + mask.height()) as f32;
    let [inside, outside] = [false, true].map(|on| nearest(mask, on));
    let length =
        |field: &Option<Nearest>, i: usize| field.as_ref().map_or(far, |field| (field.squared[i] as f32).sqrt() - 0.5);
    let signed = |(i, on): (usize, &bool)| if *on { length(&inside, i) } else { -length(&outside, i) };
    mask.data().iter().enumerate().map(signed).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_dot_is_surrounded_by_circles_that_wrap() {
        let mask = Mask::from_fn(7, 5, |x, y| (x, y) == (0, 0));
        let phi = signed_distance(&mask);
        let at = |x: usize, y: usize| phi[y * 7 + x];
        assert_eq!((at(0, 0), at(1, 0), at(6, 0), at(0, 4)), (0.5, -0.5, -0.5, -0.5));
        assert_eq!((at(3, 0), at(4, 0), at(0, 2), at(0, 3)), (-2.5, -2.5, -1.5, -1.5));
        assert_eq!(at(4, 3), -(13f32.sqrt() - 0.5));
    }

    #[test]
    fn without_a_border_everything_is_far() {
        assert!(signed_distance(&Mask::from_fn(9, 8, |_, _| true)).iter().all(|d| *d == 17.0));
        assert!(signed_distance(&Mask::from_fn(9, 8, |_, _| false)).iter().all(|d| *d == -17.0));
    }

    proptest! {
        #[test]
        fn distances_are_those_of_all_pairs(w in 1u32..14, h in 1u32..14, bits in proptest::collection::vec(0u8..6, 196)) {
            let mask = Mask::from_fn(w, h, |x, y| bits[(y * 14 + x) as usize] == 0);
            let Some(found) = nearest(&mask, true) else { return Ok(()) };
            let torus = |a: u32, b: u32, n: u32| a.abs_diff(b).min(n - a.abs_diff(b));
            for (i, [dx, dy]) in found.step.iter().enumerate() {
                let (x, y) = (i as u32 % w, i as u32 / w);
                let to = |(u, v): (u32, u32)| torus(x, u, w).pow(2) + torus(y, v, h).pow(2);
                let all = (0..h).flat_map(|v| (0..w).map(move |u| (u, v))).filter(|(u, v)| mask.get(*u, *v));
                prop_assert_eq!(Some(found.squared[i]), all.map(to).min());
                let there = [(x as i32 + dx).rem_euclid(w as i32), (y as i32 + dy).rem_euclid(h as i32)];
                prop_assert!(mask.get(there[0] as u32, there[1] as u32));
            }
        }
    }
}
