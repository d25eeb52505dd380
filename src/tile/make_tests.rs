//! Tiles of made-up keys: what must hold for any, and what bad keys are told.

use super::*;
use crate::numerics::par;
use crate::numerics::rng::Key;
use crate::texture::{MapKind, MapSet, Texture};

const SIDE: u32 = 48;

/// Discs or stripes with grain, an index map, normals and a mask; all wrap.
fn key(seed: u64, inside: impl Fn(u32, u32) -> bool + Sync, colours: [f32; 2]) -> MapSet {
    let grain = |x: u32, y: u32| Key::new(seed).with(u64::from(y)).unit(u64::from(x)) as f32;
    let height = Texture::from_fn(SIDE, SIDE, 1, |x, y, out| {
        out[0] = colours[usize::from(inside(x, y))] + 0.1 * grain(x, y);
    });
    let normal = Texture::from_fn(SIDE, SIDE, 3, |x, y, out| {
        let tilt = 0.5 * (grain(x, y) - 0.5);
        out.copy_from_slice(&[tilt, 0.0, (1.0 - tilt * tilt).sqrt()]);
    });
    let mask = Texture::from_fn(SIDE, SIDE, 1, |x, y, out| out[0] = f32::from(u8::from(inside(x, y))));
    MapSet::new(vec![(MapKind::Height, height), (MapKind::Normal, normal), (MapKind::FeatureMask, mask)])
}

fn spots(x: u32, y: u32) -> bool {
    let [dx, dy] = [x, y].map(|v| (v % 16) as i32 - 8);
    dx * dx + dy * dy < 24
}

fn stripes(x: u32, _: u32) -> bool {
    x % 24 < 10
}

fn dark() -> MapSet {
    key(1, spots, [0.1, 0.3])
}

fn bright() -> MapSet {
    key(2, stripes, [0.6, 0.9])
}

fn wrapping(maps: &MapSet) -> KeyTile<'_> {
    KeyTile { maps, tileable: true }
}

fn params(layers: u32) -> TileParams {
    TileParams { layers, ..TileParams::default() }
}

fn without_mask(maps: &MapSet) -> MapSet {
    let others = maps.iter().filter(|(kind, _)| *kind != MapKind::FeatureMask);
    MapSet::new(others.map(|(kind, map)| (kind, map.clone())).collect())
}

#[test]
fn a_tile_begins_and_ends_with_its_keys() {
    let (a, b) = (dark(), bright());
    let (tile, report) = make(&[wrapping(&a), wrapping(&b)], &params(5)).expect("a tile");
    assert_eq!((tile.width(), tile.height(), tile.depth()), (SIDE, SIDE, 5));
    assert_eq!(tile.kinds(), [MapKind::Normal, MapKind::Height]);
    assert_eq!(tile.layers()[0], without_mask(&a));
    assert_eq!(tile.layers()[4], without_mask(&b));
    assert_eq!(
        (&tile.masks()[0], &tile.masks()[4]),
        (&Mask::from_fn(SIDE, SIDE, spots), &Mask::from_fn(SIDE, SIDE, stripes))
    );
    let layers: Vec<u32> = report.keys.iter().map(|k| k.layer).collect();
    assert_eq!((layers, report.layers.len()), (vec![0, 4], 5));
    for normal in tile.layers().iter().filter_map(|l| l.get(MapKind::Normal)) {
        assert!(normal.data().chunks(3).all(|n| (n.iter().map(|v| v * v).sum::<f32>() - 1.0).abs() < 1e-4));
    }
}

#[test]
fn layers_show_features_where_their_masks_are() {
    let (a, b) = (dark(), bright());
    let (tile, _) = make(&[wrapping(&a), wrapping(&b)], &params(6)).expect("a tile");
    for (m, (maps, mask)) in tile.layers().iter().zip(tile.masks()).enumerate() {
        // What each key shows in and between features, blended.
        let share = m as f32 / 5.0;
        let level = |a: f32, b: f32| a * (1.0 - share) + b * share + 0.05;
        let middle = 0.5 * (level(0.1, 0.6) + level(0.3, 0.9));
        let height = maps.get(MapKind::Height).expect("the map").data();
        let right = height.iter().zip(mask.data()).filter(|(h, on)| (**h > middle) == **on).count();
        assert!(right as f64 > 0.95 * height.len() as f64, "layer {m}: {right} of {}", height.len());
    }
}

#[test]
fn a_penalty_for_use_keeps_the_histogram() {
    // The grain of a key whose features hardly move: without a penalty its smoothest parts are shown again and again.
    let (a, b) = (dark(), bright());
    let far = |usage| {
        let made = make(&[wrapping(&a), wrapping(&b)], &TileParams { usage, ..params(5) }).expect("a tile");
        made.1.layers.iter().map(|l| l.histogram).sum::<f64>()
    };
    let (with, without) = (far(1.0), far(0.0));
    println!("histogram distance with the penalty {with}, without {without}");
    assert!(with < without, "{with} {without}");
}

/// Both keys of a pair of the shared textures, with their masks; of large ones a part.
fn pair(name: &str) -> Option<[MapSet; 2]> {
    use crate::io::image_set::{Slot, load};
    const MOST: u32 = 128;
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data/textures/pairs").join(name);
    let mut files: Vec<_> = std::fs::read_dir(folder).ok()?.flatten().map(|e| e.path()).collect();
    files.sort();
    let keys = files.chunks(2).filter_map(|files| {
        let [colour, mask] = [0, 1].map(|i| std::fs::read(files.get(i)?).ok());
        let (colour, mask) = (colour?, mask?);
        let slots = [(MapKind::BaseColor, "colour", &colour[..]), (MapKind::FeatureMask, "mask", &mask[..])];
        let maps = load(&slots.map(|(kind, name, bytes)| (Slot::Map(kind), name, bytes)), &Default::default()).ok()?;
        let part = |map: &Texture| {
            let (w, h) = (map.width().min(MOST), map.height().min(MOST));
            Texture::from_fn(w, h, map.channels(), |x, y, out| out.copy_from_slice(map.get(x, y)))
        };
        Some(MapSet::new(maps.iter().map(|(kind, map)| (kind, part(map))).collect()))
    });
    <[MapSet; 2]>::try_from(keys.collect::<Vec<_>>()).ok()
}

#[test]
fn a_penalty_for_use_keeps_the_histograms_of_real_pairs() {
    for name in ["cracks-to-mortar", "spots-to-stripes"] {
        let Some([a, b]) = pair(name) else {
            println!("../shared/data/textures/pairs/{name} is not there");
            return;
        };
        let keys = [&a, &b].map(|maps| KeyTile { maps, tileable: false });
        let far = |usage| {
            let made = make(&keys, &TileParams { usage, ..params(4) }).expect("a tile");
            made.1.layers.iter().map(|l| l.histogram).sum::<f64>() / 2.0
        };
        let (with, without) = (far(1.0), far(0.0));
        println!("{name}: histogram distance of the layers between with the penalty {with:.4}, without {without:.4}");
        assert!(with < without, "{name}: {with} {without}");
    }
}

#[test]
fn threads_do_not_matter_and_seeds_do() {
    let (a, b) = (dark(), bright());
    let keys = [KeyTile { maps: &a, tileable: false }, wrapping(&b)];
    let run = |jobs, seed| par::install(jobs, || make(&keys, &TileParams { seed, ..params(4) }).expect("a tile"));
    let one = run(1, 1);
    assert_eq!(run(3, 1), one);
    assert_ne!(run(2, 2).0, one.0);
}

#[test]
fn chains_pass_through_every_key() {
    let (a, b, c) = (dark(), bright(), key(3, |x, y| !spots(x + 4, y + 4), [0.2, 0.8]));
    let keys = [wrapping(&a), wrapping(&b), wrapping(&c)];
    let (tile, report) = make(&keys, &params(6)).expect("a tile");
    assert_eq!(report.keys.iter().map(|k| k.layer).collect::<Vec<_>>(), [0, 3, 5]);
    assert_eq!(tile.layers()[3], without_mask(&b));
    assert_eq!(tile.layers()[5], without_mask(&c));
    let (least, _) = make(&keys, &params(3)).expect("a tile");
    assert_eq!(least.layers()[1], without_mask(&b));
}

#[test]
fn one_key_gives_layers_of_one_mask_that_differ() {
    let a = dark();
    let (tile, report) = make(&[wrapping(&a)], &params(4)).expect("a tile");
    assert!(tile.masks().iter().all(|mask| *mask == tile.masks()[0]));
    assert_eq!(tile.layers()[0], without_mask(&a));
    assert!(report.layers.iter().all(|l| l.moved == 0.0));
    let heights: Vec<&[f32]> = tile.layers().iter().filter_map(|l| l.get(MapKind::Height)).map(Texture::data).collect();
    for (i, j) in [(0, 1), (0, 3), (1, 2), (2, 3)] {
        let same = heights[i].iter().zip(heights[j]).filter(|(a, b)| a == b).count();
        assert!(same < heights[i].len() / 8, "{same} texels are the same in layers {i} and {j}");
    }
}

#[test]
fn bad_keys_are_told_what_is_wrong() {
    let (a, b) = (dark(), bright());
    let fails = |keys: &[&MapSet], layers| {
        let keys: Vec<KeyTile> = keys.iter().map(|maps| wrapping(maps)).collect();
        make(&keys, &params(layers)).expect_err("no tile").to_string()
    };
    assert_eq!(fails(&[], 8), "a tile needs a key exemplar, and there is none");
    assert_eq!(fails(&[&a, &b, &a], 2), "layers = 2, expected 3..=256: at least two, and one for each key exemplar");
    assert!(fails(&[&a], 1).starts_with("layers = 1, expected 2..=256"));
    let gray = |w, h, v: f32| MapSet::new(vec![(MapKind::Height, Texture::from_fn(w, h, 1, |_, _, out| out[0] = v))]);
    assert_eq!(
        fails(&[&gray(32, 32, 0.5), &gray(32, 16, 0.5)], 8),
        "key 2 is 32x16 texels, and key 1 is 32x32: the keys of a tile are of one size"
    );
    assert_eq!(
        fails(&[&a, &gray(SIDE, SIDE, 0.5)], 8),
        "key 2 has height, and key 1 has normal, height: the keys of a tile have the same maps"
    );
    assert!(fails(&[&gray(32, 32, 0.5)], 8).starts_with("no features are found in key 1"));
    assert!(fails(&[&gray(7, 32, 0.5)], 8).contains("sides of at least 8"));
    assert!(fails(&[&gray(1024, 1024, 0.5)], 64).contains("at most 33554432 texels"));
    assert_eq!(fails(&[&gray(8, 8, f32::NAN)], 8), "key 1: height is NaN at (0, 0), expected finite values");
    let masked = |on| key(1, move |_, _| on, [0.1, 0.3]);
    assert!(fails(&[&a, &masked(true)], 8).starts_with("the feature mask of key 2 is on everywhere"));
    assert!(fails(&[&a, &masked(false)], 8).starts_with("the feature mask of key 2 is off everywhere"));
}

#[test]
fn small_and_odd_keys_work() {
    let small = |w, h, phase: u32| {
        let map = Texture::from_fn(w, h, 1, |x, y, out| out[0] = f32::from(u8::from((x + phase) % 5 < 2 && y % 4 < 2)));
        MapSet::new(vec![(MapKind::Height, map)])
    };
    for (w, h) in [(8, 8), (9, 13), (67, 65)] {
        let (a, b) = (small(w, h, 0), small(w, h, 2));
        let keys = [&a, &b].map(|maps| KeyTile { maps, tileable: false });
        assert_eq!(make(&keys, &params(4)).expect("a tile").0.depth(), 4);
        assert_eq!(make(&keys[..1], &params(3)).expect("a tile").0.depth(), 3);
    }
}
