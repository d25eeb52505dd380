//! Tests of the analysis of flipbooks: known by theory and against the exhaustive search.

use super::*;
use crate::numerics::par::install;
use crate::texture::{MapKind, MapSet, Texture};

fn book(w: u32, h: u32, frames: u32, f: impl Fn(u32, u32, u32) -> f32 + Sync) -> Flipbook {
    let frame = |t| MapSet::new(vec![(MapKind::Height, Texture::from_fn(w, h, 1, |x, y, out| out[0] = f(x, y, t)))]);
    Flipbook::new(&(0..frames).map(frame).collect::<Vec<_>>())
}

fn noise(x: u32, y: u32, t: u32) -> f32 {
    Key::new(4).with(u64::from(t)).with(u64::from(y)).unit(u64::from(x)) as f32
}

/// Noise averaged over 3 x 3 texels and 3 frames.
fn smoke(x: u32, y: u32, t: u32) -> f32 {
    let around = |i: u32| noise(x + i % 3, y + i / 3 % 3, t + i / 9);
    (0..27).map(around).sum::<f32>() / 27.0
}

fn params(neighbourhoods: &[u32]) -> AnalysisParams {
    AnalysisParams { neighbourhoods: neighbourhoods.to_vec(), ..AnalysisParams::default() }
}

fn texels([w, h, frames]: [u32; 3]) -> impl Iterator<Item = [u16; 3]> {
    let row = move |y, t| (0..w as u16).map(move |x| [x, y, t]);
    (0..frames as u16).flat_map(move |t| (0..h as u16).flat_map(move |y| row(y, t)))
}

#[test]
fn a_constant_flipbook_has_only_perfect_jumps() {
    let map = analyse_flipbook(&book(16, 12, 6, |_, _, _| 0.3), &params(&[5, 3])).unwrap();
    let third = f64::from(65536 / 3) / 65536.0;
    assert!(texels(map.size()).all(|at| map.row(at).len() >= 2 && map.row(at).iter().all(|j| j.p() == third)));
    let frames = texels(map.size()).flat_map(|at| map.row(at)).map(|j| j.to()[2]);
    assert_eq!(frames.collect::<std::collections::BTreeSet<_>>().len(), 6, "all frames are jumped to");
}

#[test]
fn what_repeats_in_time_jumps_to_the_same_phase() {
    // Noise in space, so that only the same texel looks alike, in another period of five frames.
    let map = analyse_flipbook(&book(20, 18, 17, |x, y, t| smoke(x, y, 3 * (t % 5))), &params(&[5, 3])).unwrap();
    let inside = |at: &[u16; 3]| (1..16).contains(&at[2]);
    for at in texels(map.size()).filter(inside) {
        let best = map.row(at)[0].to();
        let turned = [at[0], at[1], best[2]];
        assert_eq!((best, (best[2] + 10 - at[2]) % 5), (turned, 0), "{at:?}");
    }
}

#[test]
fn what_drifts_is_found_along_its_drift() {
    // One picture that moves three texels per frame to the right: (x, y, t) looks as (x + 3 n, y, t + n) does.
    let map = analyse_flipbook(&book(48, 16, 12, |x, y, t| smoke(x + 100 - 3 * t, y, 0)), &params(&[5, 3])).unwrap();
    let inside = |at: &[u16; 3]| (12..36).contains(&at[0]) && (4..12).contains(&at[1]) && (2..10).contains(&at[2]);
    for at in texels(map.size()).filter(inside) {
        let best = map.row(at)[0].to();
        let moved = i32::from(best[2]) - i32::from(at[2]);
        assert_eq!(
            [i32::from(best[0]), i32::from(best[1])],
            [i32::from(at[0]) + 3 * moved, i32::from(at[1])],
            "{at:?}"
        );
        assert!(moved != 0);
    }
}

#[test]
fn jumps_keep_apart_in_space_and_time() {
    let map = analyse_flipbook(&book(24, 20, 16, smoke), &params(&[5, 3])).unwrap();
    let far = |a: [u16; 3], b: [u16; 3]| {
        let d = |i: usize| f64::from(a[i].abs_diff(b[i])) / [5.0, 5.0, 3.0][i];
        d(0) * d(0) + d(1) * d(1) + d(2) * d(2) >= 1.0 - 1e-9
    };
    for at in texels(map.size()) {
        let all: Vec<[u16; 3]> = map.row(at).iter().map(VolumeJump::to).chain([at]).collect();
        assert!((0..all.len()).all(|i| (0..i).all(|j| far(all[i], all[j]))), "{all:?}");
        assert!(map.row(at).iter().map(VolumeJump::p).sum::<f64>() <= 1.0);
    }
}

#[test]
fn nearly_all_of_the_true_matches_are_found() {
    let (book, params) = (book(32, 32, 12, smoke), params(&[5, 3]));
    let windows = Windows::new(&book, &params);
    let points = windows.project(&windows.components(params.variance));
    let block = Block::new(book.size(), &params);
    let found = matches(&points, &block, params.matches());
    let (mut hits, mut all) = (0, 0);
    for texel in (0..points.len() as u32).step_by(61) {
        let truth = knn::exhaustive(&points, texel, params.matches(), |a, b| block.apart(a, b));
        let worst = truth.last().map_or(0, |m| m.1);
        hits += found.row(texel).take(truth.len()).filter(|m| m.1 <= worst).count();
        all += truth.len();
    }
    assert!(hits as f64 > 0.9 * all as f64, "{hits} of {all}");
}

#[test]
fn threads_do_not_change_it() {
    let book = book(20, 24, 10, smoke);
    let run = |jobs| install(jobs, || analyse_flipbook(&book, &params(&[5, 3])).unwrap());
    assert_eq!(run(1), run(2));
    assert_eq!(run(1), run(8));
}

#[test]
fn what_cannot_be_analysed_gets_a_sentence() {
    let said = |b: &Flipbook, p: &AnalysisParams| analyse_flipbook(b, p).unwrap_err().to_string();
    let one = said(&book(16, 16, 1, smoke), &params(&[5, 3]));
    assert!(one.starts_with("the flipbook has 1 frames of 16x16 texels; it needs 2 frames at least"), "{one}");
    assert_eq!(
        said(&book(16, 8, 4, smoke), &params(&[9])),
        "the exemplar is 16x8 texels, the finest neighbourhood needs at least 9x9"
    );
    assert_eq!(
        said(&book(40, 40, 3, smoke), &params(&[33])),
        "the neighbourhoods of all maps have 3267 values, at most 2048 can be compared"
    );
    assert!(said(&book(16, 16, 4, smoke), &params(&[4])).contains("odd size"));
    assert!(said(&book(16, 16, 4, |_, _, _| f32::NAN), &params(&[3])).contains("NaN"));
    let far = AnalysisParams { min_distance: Some(17.0), ..params(&[3]) };
    assert!(said(&book(16, 16, 4, smoke), &far).contains("min_distance = 17"));
}
