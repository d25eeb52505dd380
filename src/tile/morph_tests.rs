//! What a morph keeps, on shapes whose way is known, on random masks and on the feature pairs.

use proptest::prelude::*;

use super::distance::signed_distance;
use super::layers::choose;
use super::morph::{differing, mask_of, morph};
use super::{Mask, features};
use crate::numerics::par;
use crate::numerics::rng::Key;

/// The layers of a morph, first to last.
fn layers(from: &Mask, to: &Mask, last: usize) -> Vec<Mask> {
    let steps = morph(from, to, 16 * last);
    let chosen = choose(&steps, last);
    assert_eq!((chosen.len(), chosen[0], chosen[last]), (last + 1, 0, steps.len() - 1));
    chosen.into_iter().map(|n| mask_of(&steps[n], from.width(), from.height())).collect()
}

fn discs(size: u32, radius: f64, middles: &[(f64, f64)]) -> Mask {
    Mask::from_fn(size, size, |x, y| {
        middles.iter().any(|(mx, my)| {
            let torus = |a: f64, b: f64| (a - b).abs().min(f64::from(size) - (a - b).abs());
            let (dx, dy) = (torus(f64::from(x) + 0.5, *mx), torus(f64::from(y) + 0.5, *my));
            dx * dx + dy * dy < radius * radius
        })
    })
}

/// Connected parts on the torus, by four neighbours, of at least some texels.
fn parts(mask: &Mask, least: usize) -> usize {
    let (w, h) = (mask.width(), mask.height());
    let mut seen = vec![false; mask.data().len()];
    let mut count = 0;
    for start in 0..seen.len() {
        let (mut open, mut size) = (vec![start], 0);
        while let Some(i) = open.pop() {
            if seen[i] || !mask.data()[i] {
                continue;
            }
            seen[i] = true;
            size += 1;
            let (x, y) = (i as u32 % w, i as u32 / w);
            let beside = [((x + 1) % w, y), ((x + w - 1) % w, y), (x, (y + 1) % h), (x, (y + h - 1) % h)];
            open.extend(beside.map(|(x, y)| (y * w + x) as usize));
        }
        count += usize::from(size >= least);
    }
    count
}

/// Smooth blobs of noise: about a share of the texels.
fn noise(seed: u64, width: u32, height: u32, grain: u32, share: f64) -> Mask {
    let key = Key::new(seed);
    let value = |x: u32, y: u32| key.with(u64::from(y / grain)).unit(u64::from(x / grain));
    let jitter = |x: u32, y: u32| key.with(99).with(u64::from(y)).unit(u64::from(x));
    Mask::from_fn(width, height, |x, y| 0.8 * value(x, y) + 0.2 * jitter(x, y) < share)
}

#[test]
fn a_disc_travels_to_its_target_and_does_not_fade() {
    let (from, to) = (discs(64, 7.0, &[(20.0, 32.0)]), discs(64, 7.0, &[(44.0, 32.0)]));
    let layers = layers(&from, &to, 8);
    for (m, mask) in layers.iter().enumerate() {
        assert_eq!(parts(mask, 4), 1, "layer {m} is one feature");
        // A fade would have the middle of both, or of none.
        let texels = mask.count();
        assert!(texels * 2 > from.count() && texels < 2 * from.count(), "layer {m} has {texels} texels");
    }
    // The middle moves right from layer to layer, wherever the disc is not yet inside its target.
    let middle = |mask: &Mask| {
        let columns = (0..64u32).map(|x| (x, (0..64).filter(|y| mask.get(x, *y)).count()));
        columns.fold(0.0, |s, (x, n)| s + f64::from(x) * n as f64) / mask.count() as f64
    };
    let middles: Vec<f64> = layers.iter().map(middle).collect();
    assert!(middles.windows(2).all(|w| w[1] > w[0]), "{middles:?}");
}

#[test]
fn the_shorter_way_leads_around_the_torus() {
    let (from, to) = (discs(64, 6.0, &[(6.0, 32.0)]), discs(64, 6.0, &[(54.0, 32.0)]));
    let half = &layers(&from, &to, 4)[2];
    let near = (0..64).filter(|y| half.get(0, *y) || half.get(62, *y)).count();
    let far = (16..44).flat_map(|x| (0..64).map(move |y| (x, y))).filter(|(x, y)| half.get(*x, *y)).count();
    assert!(near > 4 && far == 0, "{near} {far}");
}

#[test]
fn features_split_and_merge() {
    let one = discs(96, 12.0, &[(48.0, 48.0)]);
    let two = discs(96, 9.0, &[(24.0, 48.0), (72.0, 48.0)]);
    for (from, to, [first, last]) in [(&one, &two, [1, 2]), (&two, &one, [2, 1])] {
        let layers = layers(from, to, 8);
        let counts: Vec<usize> = layers.iter().map(|mask| parts(mask, 12)).collect();
        assert_eq!((counts[0], counts[8]), (first, last), "{counts:?}");
        assert!(counts.iter().all(|n| (1..=2).contains(n)), "{counts:?}");
        assert!(layers.iter().all(|mask| mask.count() > 60));
    }
}

#[test]
fn what_no_feature_reaches_is_filled_and_what_reaches_nothing_goes() {
    // The target's second disc is far from any source: sweeping fills it.
    let (from, to) = (discs(80, 6.0, &[(20.0, 20.0)]), discs(80, 6.0, &[(22.0, 20.0), (60.0, 60.0)]));
    let there = layers(&from, &to, 8);
    assert_eq!(there[8], to);
    let back = layers(&to, &from, 8);
    assert_eq!(back[8], from);
    assert!(there[1..8].iter().chain(&back[1..8]).all(|mask| mask.count() > 50));
}

#[test]
fn what_is_printed_as_phi_0_must_be_phi_m() {
    // |phi_0| > (1 - n/N) sup |phi_M|: where the source has small distances and the target large ones, everything is
    // swept in the last step or two; the other way round, at once. With |phi_M| the swept part grows throughout.
    let (fine, coarse) = (noise(1, 64, 64, 4, 0.5), discs(64, 10.0, &[(32.0, 32.0)]));
    for (from, to) in [(&fine, &coarse), (&coarse, &fine)] {
        let [source, target] = [from, to].map(|m| signed_distance(m).iter().map(|d| d.abs()).collect::<Vec<f32>>());
        let sup = target.iter().fold(0.0f32, |m, d| m.max(*d));
        let swept = |by: &[f32], share: f32| by.iter().filter(|d| **d > (1.0 - share) * sup).count() as f64 / 4096.0;
        let printed = [swept(&source, 0.2), swept(&source, 0.8)];
        assert!(printed[0] > 0.2 || printed[1] < 0.2, "{printed:?}");
        let read = [0.2, 0.5, 0.8].map(|share| swept(&target, share));
        assert!(read[0] < read[1] && read[1] < read[2] && read[2] < 1.0 && swept(&target, 1.0) == 1.0, "{read:?}");
    }
}

#[test]
fn equal_masks_stay_equal_and_threads_do_not_matter() {
    let mask = noise(5, 40, 30, 5, 0.4);
    assert!(layers(&mask, &mask, 4).iter().all(|m| *m == mask));
    let (from, to) = (noise(6, 40, 30, 5, 0.4), noise(7, 40, 30, 5, 0.6));
    assert_eq!(par::install(1, || layers(&from, &to, 5)), par::install(3, || layers(&from, &to, 5)));
}

/// The largest and the mean number of texels in which layers that follow each other differ.
fn moves(layers: &[Mask]) -> (f64, f64) {
    let moves: Vec<f64> = layers.windows(2).map(|w| w[0].differing(&w[1]) as f64).collect();
    (moves.iter().fold(0.0, |m, v| f64::max(m, *v)), moves.iter().sum::<f64>() / moves.len() as f64)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]
    #[test]
    fn random_masks_become_their_targets_at_an_even_pace(
        seeds in (0u64..10_000, 0u64..10_000),
        size in (20u32..60, 20u32..60),
        grains in (2u32..14, 2u32..14),
        shares in (0.1f64..0.9, 0.1f64..0.9),
    ) {
        let from = noise(seeds.0, size.0, size.1, grains.0, shares.0);
        let to = noise(seeds.1 + 10_000, size.0, size.1, grains.1, shares.1);
        let layers = layers(&from, &to, 6);
        prop_assert_eq!(&layers[0], &from);
        prop_assert_eq!(&layers[6], &to);
        if from.is_mixed() && to.is_mixed() && from != to {
            let (most, mean) = moves(&layers);
            prop_assert!(most <= 1.4 * mean + 6.0, "{} of {}", most, mean);
        }
    }
}

#[test]
fn no_step_moves_more_than_half_a_layer_be_the_masks_ever_so_fine() {
    // One step swept 146 of 185 texels at once.
    for (seeds, shares) in [((1021, 1), (0.8515, 0.557)), ((3, 4), (0.2, 0.88)), ((5, 6), (0.6, 0.35))] {
        let (from, to) = (noise(seeds.0, 20, 20, 2, shares.0), noise(seeds.1 + 10_000, 20, 20, 2, shares.1));
        let most = from.differing(&to).div_ceil(2 * 6);
        let steps = morph(&from, &to, 16 * 6);
        assert!(steps.windows(2).all(|w| differing(&w[0], &w[1]) as usize <= most), "{most}");
        let (largest, mean) = moves(&layers(&from, &to, 6));
        assert!(largest <= 1.4 * mean, "{largest} of {mean}");
    }
}

#[test]
fn steps_are_fine_against_layers() {
    let (from, to) = (discs(64, 7.0, &[(20.0, 32.0)]), discs(64, 7.0, &[(44.0, 32.0)]));
    let steps = morph(&from, &to, 32);
    let largest = steps.windows(2).map(|w| differing(&w[0], &w[1])).max().unwrap_or(0);
    assert!(steps.len() > 100 && (largest as usize) < from.count() / 2, "{} {largest}", steps.len());
}

/// Both masks of a pair of the shared textures.
fn pair(name: &str) -> Option<[Mask; 2]> {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data/textures/pairs").join(name);
    let mut files: Vec<_> = std::fs::read_dir(folder).ok()?.flatten().map(|e| e.path()).collect();
    files.sort();
    let masks = files.iter().filter(|f| f.to_string_lossy().ends_with("_mask.png")).filter_map(|f| {
        let slot = crate::io::image_set::Slot::Map(crate::texture::MapKind::FeatureMask);
        let height = crate::io::image_set::Slot::Map(crate::texture::MapKind::Height);
        let bytes = std::fs::read(f).ok()?;
        let files = [(slot, "mask", &bytes[..]), (height, "height", &bytes[..])];
        let set = crate::io::image_set::load(&files, &Default::default()).ok()?;
        Some(Mask::of_texture(set.get(crate::texture::MapKind::FeatureMask)?))
    });
    <[Mask; 2]>::try_from(masks.collect::<Vec<_>>()).ok()
}

#[test]
fn pairs_of_real_textures_converge_both_ways_at_an_even_pace() {
    for name in ["cracks-to-mortar", "dots-to-holes", "spots-to-stripes", "stones-to-fruit"] {
        let Some([a, b]) = pair(name) else {
            println!("../shared/data/textures/pairs/{name} is not there");
            return;
        };
        for (from, to) in [(&a, &b), (&b, &a)] {
            let layers = layers(from, to, 7);
            assert_eq!((&layers[0], &layers[7]), (from, to));
            let (most, mean) = moves(&layers);
            assert!(most <= 1.2 * mean, "{name}: {most} of {mean}");
        }
    }
}

#[test]
fn found_features_are_masks_to_morph() {
    let maps = |f: &(dyn Fn(u32, u32) -> f32 + Sync)| {
        let map = crate::texture::Texture::from_fn(48, 48, 1, |x, y, out| out[0] = f(x, y));
        crate::texture::MapSet::new(vec![(crate::texture::MapKind::Height, map)])
    };
    let found = |f| features::find_features(&maps(f), &Default::default()).expect("features");
    let stripes = found(&|x: u32, _| if x % 24 < 9 { 0.9 } else { 0.1 });
    let dots = found(&|x, y| if x % 24 < 10 && y % 24 < 10 { 0.1 } else { 0.7 });
    assert_eq!(layers(&stripes, &dots, 5)[5], dots);
}
