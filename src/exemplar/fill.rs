//! A smooth continuation of a plane into its holes.
//!
//! Source: pull-push (Gortler, Grzeszczuk, Szeliski, Cohen: The lumigraph, 1996, section 3.4): means of what is known on
//! ever coarser grids; from the coarsest on, what is unknown takes the interpolation of the next coarser grid.
//! Unaware of: what the planes hold.

/// Replaces the values whose `known` is false. Does nothing if none is known. Panics if the lengths differ.
pub(crate) fn fill_holes(plane: &mut [f32], known: &[bool], width: usize) {
    assert_eq!(plane.len(), known.len(), "one flag per value");
    if known.iter().all(|k| *k) || known.iter().all(|k| !*k) {
        return;
    }
    let (coarse, coarse_known, w) = pull(plane, known, width);
    let mut coarse = coarse;
    fill_holes(&mut coarse, &coarse_known, w);
    push(plane, known, width, &coarse, w);
}

/// Means of the known values of squares of 2 x 2; those at an odd border are smaller.
fn pull(plane: &[f32], known: &[bool], width: usize) -> (Vec<f32>, Vec<bool>, usize) {
    let (w, h) = (width.div_ceil(2), (plane.len() / width).div_ceil(2));
    let (mut sums, mut counts) = (vec![0.0f32; w * h], vec![0.0f32; w * h]);
    for (i, (v, _)) in plane.iter().zip(known).enumerate().filter(|(_, (_, k))| **k) {
        let at = i / width / 2 * w + i % width / 2;
        sums[at] += v;
        counts[at] += 1.0;
    }
    let means = sums.iter().zip(&counts).map(|(s, n)| s / n.max(1.0)).collect();
    (means, counts.iter().map(|n| *n > 0.0).collect(), w)
}

/// Gives the unknown values the bilinear interpolation of the coarser plane.
fn push(plane: &mut [f32], known: &[bool], width: usize, coarse: &[f32], w: usize) {
    let h = coarse.len() / w;
    // The centres of fine values lie a quarter of a coarse step from the nearest coarse centre.
    let axis = |i: usize, n: usize| {
        let near = i / 2;
        let far = if i % 2 == 1 { (near + 1).min(n - 1) } else { near.saturating_sub(1) };
        [(near, 0.75f32), (far, 0.25)]
    };
    for (i, (v, _)) in plane.iter_mut().zip(known).enumerate().filter(|(_, (_, k))| !**k) {
        let (columns, rows) = (axis(i % width, w), axis(i / width, h));
        let row = |y: usize| columns.iter().fold(0.0, |s, (x, t)| s + t * coarse[y * w + x]);
        *v = rows.iter().fold(0.0, |s, (y, t)| s + t * row(*y));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_constant_continues_and_a_slope_nearly() {
        let (w, h) = (23, 17);
        let known: Vec<bool> =
            (0..w * h).map(|i| !((5..16).contains(&(i % w)) && (4..12).contains(&(i / w)))).collect();
        let mut plane: Vec<f32> = known.iter().map(|k| if *k { 0.5 } else { 1e6 }).collect();
        fill_holes(&mut plane, &known, w);
        assert!(plane.iter().all(|v| *v == 0.5));
        let slope = |i: usize| (i % w) as f32;
        let mut plane: Vec<f32> = (0..w * h).map(|i| if known[i] { slope(i) } else { -1e6 }).collect();
        fill_holes(&mut plane, &known, w);
        for i in 0..w * h {
            assert!((plane[i] - slope(i)).abs() <= if known[i] { 0.0 } else { 4.0 }, "{i}: {}", plane[i]);
        }
    }

    #[test]
    fn one_known_value_is_everywhere() {
        let mut known = vec![false; 35];
        known[17] = true;
        let mut plane: Vec<f32> = (0..35).map(|i| i as f32).collect();
        fill_holes(&mut plane, &known, 7);
        assert!(plane.iter().all(|v| *v == 17.0));
        let mut unknown = vec![3.0; 4];
        fill_holes(&mut unknown, &[false; 4], 2);
        assert_eq!(unknown, [3.0; 4]);
    }
}
