//! Tests of the analysis as a whole: known by theory, against brute force, and on real samples.

use super::*;
use crate::numerics::det;
use crate::numerics::par::install;
use crate::numerics::rng::Key;
use crate::texture::{MapKind, MapSet, Texture, Wrap, color};

fn heights(width: u32, height: u32, f: impl Fn(u32, u32) -> f32 + Sync) -> MapSet {
    MapSet::new(vec![(MapKind::Height, Texture::from_fn(width, height, 1, |x, y, out| out[0] = f(x, y)))])
}

fn noise(x: u32, y: u32) -> f32 {
    Key::new(4).with(u64::from(y)).unit(u64::from(x)) as f32
}

/// Coloured noise without any repetition.
fn stochastic(width: u32, height: u32) -> MapSet {
    let smooth = |x: u32, y: u32, c: u32| {
        (0..9)
            .map(|i| noise(x + i % 3 + 1000 * c, y + i / 3) * [1.0, 2.0, 1.0, 2.0, 4.0, 2.0, 1.0, 2.0, 1.0][i as usize])
            .sum::<f32>()
    };
    let map = Texture::from_fn(width, height, 3, |x, y, out| {
        out.iter_mut().zip(0..).for_each(|(o, c)| *o = smooth(x, y, c) / 16.0);
    });
    MapSet::new(vec![(MapKind::BaseColor, map)])
}

/// Bricks of 24 x 12 texels with bevels, each second course shifted, under a little noise.
fn bricks(width: u32, height: u32) -> MapSet {
    heights(width, height, |x, y| {
        let x = (x + (y / 12 % 2) * 12) % 24;
        let edge = x.min(23 - x).min(y % 12).min(11 - y % 12);
        edge.min(3) as f32 / 3.0 + 0.05 * noise(x, y)
    })
}

fn with(change: impl FnOnce(&mut AnalysisParams)) -> AnalysisParams {
    let mut params = AnalysisParams::default();
    change(&mut params);
    params
}

fn recall(maps: &MapSet, params: &AnalysisParams, sample_count: usize) -> f64 {
    let (map, report, recall) = analyse_measured(maps, params, sample_count).unwrap();
    assert!((map, report) == analyse(maps, params).unwrap());
    recall
}

fn rows(map: &JumpMap) -> impl Iterator<Item = ((u32, u32), &[Jump])> {
    (0..map.height()).flat_map(move |y| (0..map.width()).map(move |x| ((x, y), map.row(x, y))))
}

#[test]
fn a_constant_exemplar_has_only_perfect_jumps() {
    let (map, report) = analyse(&heights(40, 30, |_, _| 0.3), &AnalysisParams::default()).unwrap();
    assert_eq!((report.max_distance, report.mean_distance, report.kept_variance), (0.0, 0.0, 1.0));
    let third = (65536 / 3) as f32 / 65536.0;
    assert!(rows(&map).flat_map(|r| r.1).all(|j| j.p == third));
    assert!(report.mean_jumps > 2.9, "{report:?}");
    // All destinations tie; they must not all be the same few.
    let mut seen = vec![false; 40 * 30];
    rows(&map).flat_map(|r| r.1).for_each(|j| seen[j.y as usize * 40 + j.x as usize] = true);
    assert!(seen.iter().filter(|s| **s).count() > 900);
}

#[test]
fn a_periodic_exemplar_jumps_by_multiples_of_its_period() {
    let wave = |t: u32, n: u32| det::cos(std::f64::consts::TAU * f64::from(t % n) / f64::from(n)) as f32;
    let maps = heights(70, 55, |x, y| 0.5 + 0.2 * wave(x, 7) + 0.3 * wave(y, 11) + 0.1 * wave(x, 7) * wave(y, 11));
    for wrap in [Wrap::Repeat, Wrap::Clamp] {
        let (map, report) = analyse(&maps, &with(|p| p.wrap = wrap)).unwrap();
        // Next to a border that is not a torus' the mirror image breaks the period.
        let inside = |x: u32, y: u32| wrap == Wrap::Repeat || ((8..62).contains(&x) && (8..47).contains(&y));
        for ((x, y), row) in rows(&map).filter(|((x, y), _)| inside(*x, *y)) {
            assert_eq!(row.len(), 3);
            for j in row {
                let (dx, dy) = (x.abs_diff(u32::from(j.x)), y.abs_diff(u32::from(j.y)));
                assert_eq!((dx % 7, dy % 11), (0, 0), "{wrap:?} ({x}, {y}) to {j:?}, {report:?}");
            }
        }
    }
}

#[test]
fn a_torus_finds_the_copy_across_its_border() {
    let maps = heights(40, 24, |x, y| noise(x % 20, y));
    let (map, _) = analyse(&maps, &with(|p| p.wrap = Wrap::Repeat)).unwrap();
    for ((x, y), row) in rows(&map) {
        assert_eq!((u32::from(row[0].x), u32::from(row[0].y)), ((x + 20) % 40, y));
        assert!(row[1..].iter().all(|j| j.p < row[0].p));
    }
}

#[test]
fn row_weights_sum_to_at_most_one() {
    let (map, report) = analyse(&stochastic(48, 31), &AnalysisParams::default()).unwrap();
    let mut least = 1.0f32;
    for (_, row) in rows(&map) {
        assert!(row.iter().map(|j| j.p).sum::<f32>() <= 1.0);
        assert!(row.windows(2).all(|w| w[0].p >= w[1].p), "best first");
        least = row.iter().fold(least, |l, j| l.min(j.p));
    }
    // Eq. 1 at d = D: (1 - 1 / 1.1) / 3.
    let want = (1.0 - 1.0 / 1.1) / 3.0;
    assert!(least <= want && least > want - 1.0 / 768.0 - 2e-5, "{least}");
    assert!(report.max_distance > report.mean_distance && report.mean_distance > 0.0);
}

#[test]
fn jumps_keep_the_minimum_distance() {
    for (w, h, wrap) in [(16, 16, Wrap::Clamp), (16, 50, Wrap::Repeat), (90, 47, Wrap::Clamp), (90, 47, Wrap::Repeat)] {
        let (map, report) = analyse(&stochastic(w, h), &with(|p| p.wrap = wrap)).unwrap();
        let limit = if w == 16 { 4.0 } else { 9.0 };
        assert_eq!(report.min_distance, limit);
        let along = |a: u32, b: u32, n: u32| {
            let d = a.abs_diff(b);
            f64::from(if wrap == Wrap::Repeat { d.min(n - d) } else { d })
        };
        for ((x, y), row) in rows(&map) {
            let mut places = vec![(x, y)];
            for j in row {
                let to = (u32::from(j.x), u32::from(j.y));
                let least = places.iter().map(|p| (along(p.0, to.0, w), along(p.1, to.1, h)));
                assert!(least.map(|(dx, dy)| (dx * dx + dy * dy).sqrt()).all(|d| d >= limit));
                places.push(to);
            }
        }
        assert!(report.mean_jumps > 2.0, "{report:?}");
    }
}

/// Figure 2 of \[ZG02\] without search structure or principal components: f64, all pairs, one level.
fn naive(maps: &MapSet, side: i64, min_distance: f64, count: usize, k: usize) -> Vec<Vec<(u32, u32, f64)>> {
    let map = maps.get(MapKind::Height).unwrap();
    let (w, h) = (i64::from(map.width()), i64::from(map.height()));
    let reflect = |i: i64, n: i64| {
        if i < 0 {
            -1 - i
        } else if i >= n {
            2 * n - 1 - i
        } else {
            i
        }
    };
    let value = |x, y| f64::from(map.get(reflect(x, w) as u32, reflect(y, h) as u32)[0]);
    let all: Vec<(i64, i64)> = (0..h).flat_map(|y| (0..w).map(move |x| (x, y))).collect();
    let r = side / 2;
    let vector = |(x, y): (i64, i64)| -> Vec<f64> {
        (-r..=r).flat_map(|dy| (-r..=r).map(move |dx| (dx, dy))).map(|(dx, dy)| value(x + dx, y + dy)).collect()
    };
    let vectors: Vec<_> = all.iter().map(|p| vector(*p)).collect();
    let apart =
        |a: (i64, i64), b: (i64, i64)| (((a.0 - b.0).pow(2) + (a.1 - b.1).pow(2)) as f64).sqrt() >= min_distance;
    (0..all.len())
        .map(|p| {
            let distance =
                |q: usize| vectors[p].iter().zip(&vectors[q]).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt();
            let mut near: Vec<_> =
                (0..all.len()).filter(|&q| apart(all[p], all[q])).map(|q| (distance(q), q)).collect();
            near.sort_by(|a, b| a.0.total_cmp(&b.0));
            let mut row: Vec<(u32, u32, f64)> = vec![];
            for &(d, q) in near.iter().take(count) {
                if row.len() < k && row.iter().all(|r| apart((i64::from(r.0), i64::from(r.1)), all[q])) {
                    row.push((all[q].0 as u32, all[q].1 as u32, d));
                }
            }
            row
        })
        .collect()
}

#[test]
fn agrees_with_the_naive_method() {
    let maps = heights(29, 23, noise);
    let params = with(|p| (p.neighbourhoods, p.variance, p.min_distance) = (vec![5], 1.0, Some(4.0)));
    let (map, report) = analyse(&maps, &params).unwrap();
    let want = naive(&maps, 5, 4.0, 15, 3);
    let largest = want.iter().flatten().fold(0.0, |m, j| j.2.max(m));
    assert!((report.max_distance / largest - 1.0).abs() < 2e-3, "{} {largest}", report.max_distance);
    assert_eq!(report.kept_dimensions, 25);
    let mut same = 0;
    for ((_, row), want) in rows(&map).zip(&want) {
        for (j, w) in row.iter().zip(want) {
            if (u32::from(j.x), u32::from(j.y)) == (w.0, w.1) {
                same += 1;
                let p = (1.1 * largest - w.2) / (3.0 * 1.1 * largest);
                assert!((f64::from(j.p) - p + 1.0 / 1536.0).abs() < 1e-3, "{j:?} {w:?}");
            }
        }
    }
    // Rounding to 16 bits swaps matches whose distances differ by less than a thousandth.
    let all = want.iter().map(Vec::len).sum::<usize>();
    assert!(same * 100 >= all * 98, "{same} of {all}");
}

#[test]
fn the_search_finds_most_of_the_true_matches() {
    for (maps, what) in [(stochastic(112, 97), "stochastic"), (bricks(128, 100), "periodic")] {
        for wrap in [Wrap::Clamp, Wrap::Repeat] {
            let found = recall(&maps, &with(|p| p.wrap = wrap), 300);
            assert!(found >= 0.95, "{what} {wrap:?}: {found}");
        }
    }
    assert_eq!(recall(&stochastic(64, 64), &AnalysisParams::default(), 50), 1.0, "exhaustive");
}

#[test]
fn same_bytes_for_any_thread_count() {
    let maps = bricks(96, 70);
    let run = |jobs| install(jobs, || analyse(&maps, &AnalysisParams::default()).unwrap());
    let (map, report) = run(1);
    for jobs in [2, 8] {
        let other = run(jobs);
        assert_eq!((&other.0.to_bytes(), &other.1), (&map.to_bytes(), &report));
    }
}

#[test]
fn maps_weigh_by_their_importance() {
    let steps = Texture::from_fn(40, 40, 1, |x, _, out| out[0] = (x / 20) as f32);
    let colour = stochastic(40, 40).get(MapKind::BaseColor).unwrap().clone();
    let maps = MapSet::new(vec![(MapKind::BaseColor, colour.clone()), (MapKind::FeatureMask, steps)]);
    let crossings = |params: &AnalysisParams| {
        let (map, _) = analyse(&maps, params).unwrap();
        rows(&map).map(|((x, _), r)| r.iter().filter(|j| u32::from(j.x) / 20 != x / 20).count()).sum::<usize>()
    };
    let plain = crossings(&with(|p| p.importance = [(MapKind::BaseColor, 1.0)].into()));
    let masked = crossings(&AnalysisParams::default());
    assert!(plain > 1000 && masked * 10 < plain, "{masked} of {plain} jumps cross the edge of the mask");
    let alone = analyse(&MapSet::new(vec![(MapKind::BaseColor, colour)]), &AnalysisParams::default()).unwrap();
    let unweighted = analyse(&maps, &with(|p| p.importance = [(MapKind::BaseColor, 1.0)].into())).unwrap();
    assert_eq!(alone, unweighted);
}

#[test]
fn bad_input_is_named() {
    let fine = || heights(16, 16, noise);
    let fault = |maps: &MapSet, change: &dyn Fn(&mut AnalysisParams)| {
        analyse(maps, &with(change)).map(|_| ()).unwrap_err().to_string()
    };
    type Change<'a> = &'a dyn Fn(&mut AnalysisParams);
    let cases: [(Change, &str); 15] = [
        (&|p| p.neighbourhoods = vec![], "0 neighbourhoods, expected 1..=8"),
        (&|p| p.neighbourhoods = vec![9, 4], "neighbourhood of 4 texels, expected an odd size in 1..=63"),
        (&|p| p.neighbourhoods = vec![0], "neighbourhood of 0 texels, expected an odd size in 1..=63"),
        (
            &|p| p.neighbourhoods = vec![17],
            "the exemplar is 16x16 texels, the finest neighbourhood needs at least 17x17",
        ),
        (
            &|p| p.neighbourhoods = vec![9, 63],
            "the neighbourhoods of all maps have 4050 values, at most 2048 can be compared",
        ),
        (&|p| p.jumps = 0, "jumps = 0, expected 1..=64"),
        (&|p| p.jumps = 65, "jumps = 65, expected 1..=64"),
        (&|p| p.diversity = 0, "diversity = 0, expected 1..=64"),
        (&|p| p.variance = 0.0, "variance = 0, expected above 0 and at most 1"),
        (&|p| p.variance = f64::NAN, "variance = NaN, expected above 0 and at most 1"),
        (&|p| p.alpha = 1.0, "alpha = 1, expected a finite number above 1"),
        (&|p| p.min_distance = Some(17.0), "min_distance = 17 texels, expected 1..=16 for this exemplar"),
        (&|p| p.min_distance = Some(f64::NAN), "min_distance = NaN texels, expected 1..=16 for this exemplar"),
        (&|p| p.importance = [(MapKind::Height, -1.0)].into(), "importance of height = -1, expected 0..=1000000"),
        (&|p| p.importance.clear(), "no map has an importance above 0; the exemplar has height"),
    ];
    for (change, want) in cases {
        assert_eq!(fault(&fine(), change), want);
    }
    let with_value = |v: f32| heights(16, 16, move |x, y| if (x, y) == (3, 5) { v } else { 0.5 });
    let want = "texel (3, 5) of height holds NaN, expected a number between -1000000 and 1000000";
    assert_eq!(fault(&with_value(f32::NAN), &|_| ()), want);
    assert!(fault(&with_value(f32::INFINITY), &|_| ()).contains("holds inf"));
    let long = fault(&heights(65_537, 9, |_, _| 0.0), &|_| ());
    assert_eq!(long, "the exemplar is 65537x9 texels, at most 65535 per side and 16777216 in all can be analysed");
    let greedy = fault(&heights(512, 512, |_, _| 0.0), &|p| (p.jumps, p.diversity) = (64, 64));
    assert!(greedy.starts_with("the analysis would take 12.0 GiB, at most 8 are allowed"), "{greedy}");
}

#[test]
fn more_jumps_than_the_exemplar_has_room_for() {
    let params = with(|p| (p.jumps, p.diversity) = (64, 5));
    let (map, report) = analyse(&stochastic(16, 16), &params).unwrap();
    assert!(report.mean_jumps > 3.0 && report.jumpless == 0, "{report:?}");
    assert!(JumpMap::from_bytes(&map.to_bytes()).unwrap() == map);
    let far = with(|p| p.min_distance = Some(16.0));
    let (map, report) = analyse(&stochastic(16, 16), &far).unwrap();
    assert!(report.jumpless > 0 && rows(&map).any(|r| r.1.is_empty()));
}

/// A sample of the test data, if it is there.
fn sample(name: &str) -> Option<MapSet> {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data/textures").join(name);
    let Ok(image) = image::open(&path) else {
        println!("skipped: no {}", path.display());
        return None;
    };
    let image = image.to_rgb32f();
    let (w, h) = image.dimensions();
    let data = image.into_raw().into_iter().map(color::srgb_to_linear).collect();
    Some(MapSet::new(vec![(MapKind::BaseColor, Texture::from_data(w, h, 3, data))]))
}

#[test]
fn real_samples_keep_their_recall() {
    for (name, least) in [("wicker_192.png", 0.98), ("carpet_128.png", 0.97), ("leopard_128.png", 0.99)] {
        let Some(maps) = sample(name) else { return };
        let found = recall(&maps, &AnalysisParams::default(), 200);
        assert!(found >= least, "{name}: {found}");
    }
}

/// A sample with a hole of other stuff, and its mask.
fn holed(inside: impl Fn(u32, u32) -> f32 + Sync) -> (MapSet, Texture) {
    let hole = |x: u32, y: u32| (20..34).contains(&x) && (12..30).contains(&y);
    let maps = heights(64, 48, |x, y| if hole(x, y) { inside(x, y) } else { noise(x / 2, y / 2) });
    (maps, Texture::from_fn(64, 48, 1, |x, y, out| out[0] = f32::from(u8::from(!hole(x, y)))))
}

#[test]
fn masked_texels_are_neither_searched_nor_found() {
    let (maps, mask) = holed(noise);
    let sheet = Sheet::new(&[Sample { maps: &maps, mask: Some(&mask) }]).unwrap();
    let (map, report) = analyse_sheet(&sheet, &AnalysisParams::default()).unwrap();
    assert_eq!(map.domain(), sheet.domain());
    for ((x, y), row) in rows(&map) {
        assert!(map.domain().contains(x as i32, y as i32) || row.is_empty());
        assert!(row.iter().all(|j| map.domain().contains(j.x.into(), j.y.into())));
    }
    assert!(report.mean_jumps > 2.0 && report.jumpless == 0, "{report:?}");
    assert!(JumpMap::from_bytes(&map.to_bytes()).unwrap() == map);
}

#[test]
fn what_fills_a_hole_does_not_show_when_holes_are_filled() {
    let jumps = |inside: fn(u32, u32) -> f32, fill: bool| {
        let (maps, mask) = holed(inside);
        let sheet = Sheet::new(&[Sample { maps: &maps, mask: Some(&mask) }]).unwrap();
        let sheet = if fill { sheet.with_holes_filled() } else { sheet };
        analyse_sheet(&sheet, &AnalysisParams::default()).unwrap()
    };
    assert!(jumps(|_, _| 0.0, true) == jumps(|x, _| (x % 2) as f32, true));
    assert!(jumps(|_, _| 0.0, false) != jumps(|x, _| (x % 2) as f32, false));
}

#[test]
fn samples_find_each_other_but_do_not_see_each_other() {
    let left = heights(40, 30, |x, y| noise(x / 2, y / 2));
    let right = heights(24, 33, |x, y| noise(x / 2, y / 2));
    let plain = |maps| Sample { maps, mask: None };
    let sheet = Sheet::new(&[plain(&left), plain(&right)]).unwrap();
    let (map, _) = analyse_sheet(&sheet, &AnalysisParams::default()).unwrap();
    // Inside, each texel of the second is a copy of one of the first. Only the coarse levels see borders.
    for (x, y) in [(8, 8), (12, 14), (9, 20)] {
        let best = map.row(x, 31 + y)[0];
        assert_eq!((u32::from(best.x), u32::from(best.y)), (x, y));
    }
    assert!(map.row(0, 30).is_empty() && map.row(39, 60).is_empty());
    let distances = |maps: &MapSet| analyse(maps, &AnalysisParams::default()).unwrap().1.max_distance;
    let twice = Sheet::new(&[plain(&left), plain(&left)]).unwrap();
    let report = analyse_sheet(&twice, &AnalysisParams::default()).unwrap().1;
    assert!(report.mean_distance < 0.7 * distances(&left), "each texel's best match is its copy: {report:?}");
}

#[test]
fn a_sheet_of_one_sample_is_that_sample() {
    let maps = stochastic(80, 70);
    let sheet = Sheet::new(&[Sample { maps: &maps, mask: None }]).unwrap();
    for wrap in [Wrap::Clamp, Wrap::Repeat] {
        let params = with(|p| p.wrap = wrap);
        assert!(analyse_sheet(&sheet, &params) == analyse(&maps, &params));
    }
}
