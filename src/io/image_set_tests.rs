//! Tests of reading sets: small literal images, round trips, faults, and whatever `../shared/data` holds.

use super::*;
use crate::io::SampleType;
use crate::io::image_file::{Compression, Transfer, encode_exr, encode_png};
use crate::io::image_quantise::{Encoding, quantise};
use std::path::{Path, PathBuf};

fn png(side: u32, channels: u32, f: impl Fn(u32) -> u8) -> Vec<u8> {
    let samples = Samples::U8((0..side * side * channels).map(f).collect());
    let pixels = Pixels { width: side, height: side, channels, samples };
    encode_png(&pixels, Compression::Fast, Transfer::Unstated).unwrap()
}

fn exr(channels: u32, f: impl Fn(u32) -> f32) -> Vec<u8> {
    let samples = Samples::F32((0..256 * channels).map(f).collect());
    encode_exr(&Pixels { width: 16, height: 16, channels, samples }).unwrap()
}

const BASE: Slot = Slot::Map(MapKind::BaseColor);
const NORMAL: Slot = Slot::Map(MapKind::Normal);

fn one(slot: Slot, bytes: &[u8]) -> Result<MapSet, Vec<SetError>> {
    load(&[(slot, "file", bytes)], &Options::default())
}

fn fault(slot: Slot, bytes: &[u8]) -> String {
    let errors = one(slot, bytes).unwrap_err();
    assert_eq!(errors.len(), 1, "{errors:?}");
    errors[0].to_string()
}

#[test]
fn eight_and_sixteen_bit_colour_is_srgb_and_exr_is_linear() {
    let values = [0u8, 1, 10, 11, 127, 188, 254, 255];
    let set = one(BASE, &png(16, 3, |i| values[i as usize % 8])).unwrap();
    let map = set.get(MapKind::BaseColor).unwrap();
    for (i, v) in map.data().iter().enumerate() {
        assert_eq!(*v, srgb_to_linear(f32::from(values[i % 8]) / 255.0));
    }
    let wide =
        Pixels { width: 16, height: 16, channels: 1, samples: Samples::U16((0..256).map(|i| i * 257).collect()) };
    let set = one(BASE, &encode_png(&wide, Compression::Fast, Transfer::Srgb).unwrap()).unwrap();
    assert_eq!(set.get(MapKind::BaseColor).unwrap().get(11, 3), [srgb_to_linear(59.0 / 255.0); 3], "grey is widened");
    let set = one(BASE, &exr(3, |i| i as f32 - 4.0)).unwrap();
    assert_eq!(set.get(MapKind::BaseColor).unwrap().get(1, 0), [-1.0, 0.0, 1.0]);
}

// What goes in comes out: every 8-bit value of every kind of encoding survives decoding and quantising.
#[test]
fn quantising_is_the_inverse_of_reading() {
    for (kind, channels) in [(MapKind::BaseColor, 3), (MapKind::Height, 1), (MapKind::Emissive, 3)] {
        let bytes = png(16, channels, |i| (i % 256) as u8);
        let set = one(Slot::Map(kind), &bytes).unwrap();
        let back = quantise(set.get(kind).unwrap(), Encoding::of(kind), SampleType::U8).unwrap();
        assert_eq!(back, decode_pixels(&bytes, &Limits::default()).unwrap(), "{}", kind.name());
    }
}

#[test]
fn normals_are_unit_vectors_with_y_up() {
    let bytes = png(16, 3, |i| [128, 255, 128, 128, 128, 255, 0, 128, 128][i as usize % 9]);
    let up = one(NORMAL, &bytes).unwrap();
    let down = load(&[(NORMAL, "n", &bytes)], &Options { normal_y: NormalY::Down }).unwrap();
    let (up, down) = (up.get(MapKind::Normal).unwrap(), down.get(MapKind::Normal).unwrap());
    for (a, b) in up.data().chunks_exact(3).zip(down.data().chunks_exact(3)) {
        assert!((a.iter().map(|v| v * v).sum::<f32>() - 1.0).abs() < 1e-6);
        assert_eq!([a[0], a[1], a[2]], [b[0], -b[1], b[2]]);
    }
    assert!(up.get(0, 0)[1] > 0.999 && up.get(1, 0)[2] > 0.999 && up.get(2, 0)[0] < -0.999);
    // A flat map comes back as the usual 128, 128, 255.
    let flat = one(NORMAL, &png(16, 3, |i| [128, 128, 255][i as usize % 3])).unwrap();
    let back = quantise(flat.get(MapKind::Normal).unwrap(), Encoding::Normal, SampleType::U8).unwrap();
    assert_eq!(back.samples, Samples::U8([128, 128, 255].repeat(256)));
    // No direction at all.
    let none = one(NORMAL, &exr(3, |_| 0.5)).unwrap();
    assert_eq!(none.get(MapKind::Normal).unwrap().get(3, 3), [0.0, 0.0, 1.0]);
}

#[test]
fn orm_fills_what_has_no_file_of_its_own() {
    let orm = png(16, 3, |i| [51, 102, 153][i as usize % 3]);
    let rough = png(16, 1, |_| 255);
    let set = load(&[(Slot::Orm, "orm", &orm), (Slot::Map(MapKind::Roughness), "rough", &rough)], &Options::default());
    let set = set.unwrap();
    let value = |kind| set.get(kind).map(|t: &Texture| t.get(5, 5)[0]);
    assert_eq!(value(MapKind::Occlusion), Some(0.2));
    assert_eq!(value(MapKind::Roughness), Some(1.0));
    assert_eq!(value(MapKind::Metallic), Some(0.6));
    assert_eq!(set.iter().count(), 3);
    assert!(fault(Slot::Orm, &png(16, 2, |_| 0)).contains("has 2 channel(s); it needs 3"));
}

#[test]
fn alpha_becomes_opacity_unless_opaque_or_given() {
    let clear = png(16, 4, |i| if i == 43 { 0 } else { 255 });
    let set = one(BASE, &clear).unwrap();
    let opacity = set.get(MapKind::Opacity).unwrap();
    assert_eq!((opacity.get(10, 0)[0], opacity.get(11, 0)[0]), (0.0, 1.0));
    assert!(one(BASE, &png(16, 4, |_| 255)).unwrap().get(MapKind::Opacity).is_none());
    let given = png(16, 1, |_| 51);
    let set = load(&[(Slot::Map(MapKind::Opacity), "o", &given), (BASE, "c", &clear)], &Options::default()).unwrap();
    assert_eq!(set.get(MapKind::Opacity).unwrap().get(10, 0), [0.2]);
}

#[test]
fn masks_are_binary_and_must_mark_something() {
    let mask = Slot::Map(MapKind::FeatureMask);
    let base = png(16, 3, |_| 9);
    let with = |bytes: &[u8]| load(&[(BASE, "base", &base), (mask, "mask", bytes)], &Options::default());
    let set = with(&png(16, 1, |i| [0, 127, 128, 255][i as usize % 4])).unwrap();
    assert_eq!(set.get(MapKind::FeatureMask).unwrap().data()[..4], [0.0, 0.0, 1.0, 1.0]);
    let black = with(&png(16, 1, |_| 0)).unwrap_err()[0].to_string();
    assert!(black.contains("`mask` is black everywhere"), "{black}");
    assert!(with(&png(16, 1, |_| 200)).is_err());
    assert_eq!(one(mask, &base), Err(vec![SetError::NoMaps]));
}

#[test]
fn values_that_are_no_numbers_are_named() {
    let height = Slot::Map(MapKind::Height);
    let message = fault(height, &exr(1, |i| if i == 35 { f32::NAN } else { 0.0 }));
    assert_eq!(message, "height `file` holds NaN at texel (3, 2); values must be finite");
    assert!(fault(BASE, &exr(3, |i| if i == 7 { f32::NEG_INFINITY } else { 0.0 })).contains("-inf at texel (2, 0)"));
    let message = fault(NORMAL, &exr(3, |i| if i == 9 { -0.5 } else { 0.5 }));
    assert!(message.contains("-0.5 at texel (3, 0)") && message.contains("0.5 means 0"), "{message}");
    // Shares are clamped, heights are not.
    let metal = one(Slot::Map(MapKind::Metallic), &exr(1, |_| 1.01)).unwrap();
    assert_eq!(metal.get(MapKind::Metallic).unwrap().get(0, 0), [1.0]);
    assert_eq!(one(height, &exr(1, |_| -3.0)).unwrap().get(MapKind::Height).unwrap().get(0, 0), [-3.0]);
}

#[test]
fn every_fault_is_told_with_its_file() {
    let (small, large) = (png(16, 3, |_| 1), png(20, 3, |_| 1));
    let rough = Slot::Map(MapKind::Roughness);
    let errors =
        load(&[(rough, "r.png", b"text"), (NORMAL, "n.png", &large), (BASE, "c.png", &small)], &Options::default());
    let messages: Vec<String> = errors.unwrap_err().iter().map(|e| e.to_string()).collect();
    assert_eq!(messages.len(), 2, "{messages:?}");
    assert!(messages[0].starts_with("roughness `r.png`: not a PNG"), "{messages:?}");
    assert!(messages[1].starts_with("`c.png` is 16x16, but `n.png` is 20x20"), "{messages:?}");
    assert_eq!(load(&[], &Options::default()), Err(vec![SetError::NoMaps]));
    assert!(load(&[(BASE, "a", &small), (BASE, "b", &small)], &Options::default()).is_err());
}

#[test]
fn sides_have_a_least_and_a_greatest_length() {
    assert!(one(BASE, &png(16, 3, |i| i as u8)).is_ok());
    assert!(one(BASE, &png(8, 3, |i| i as u8)).is_ok());
    assert_eq!(fault(BASE, &png(1, 3, |_| 0)), "`file` is 1x1; each side of a sample may have 8 to 4096 texels");
    let long = Pixels { width: 4097, height: 8, channels: 1, samples: Samples::U8(vec![0; 4097 * 8]) };
    let bytes = encode_png(&long, Compression::Fast, Transfer::Unstated).unwrap();
    assert!(fault(BASE, &bytes).contains("4097x8"));
}

/// Image files below a folder of `../shared/data`; empty, with a line, where it is absent.
fn shared(folder: &str) -> Vec<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data").join(folder);
    let Ok(entries) = std::fs::read_dir(&root) else {
        println!("skipped: no {}", root.display());
        return Vec::new();
    };
    let image = |p: &PathBuf| p.extension().is_some_and(|e| e == "png" || e == "jpg");
    let mut files: Vec<PathBuf> = entries.filter_map(|e| Some(e.ok()?.path())).filter(image).collect();
    files.sort();
    files
}

#[test]
fn every_sound_image_of_the_shared_data_is_read() {
    for folder in ["textures", "textures/formats", "materials/bark", "materials/facade"] {
        for path in shared(folder) {
            let bytes = std::fs::read(&path).unwrap();
            let result = one(BASE, &bytes);
            assert!(result.is_ok(), "{}: {result:?}", path.display());
        }
    }
}

#[test]
fn every_broken_image_of_the_shared_data_gets_its_sentence() {
    let expected = [
        ("flat.png", ""),
        ("image_1x1.png", "1x1"),
        ("image_5x200.png", "5x200"),
        ("image_bad_crc.png", "damaged"),
        ("image_bomb.png", "65000x65000"),
        ("image_empty.png", "empty"),
        ("image_is_text.png", "starts with"),
        ("image_png_named.jpg", ""),
        ("image_truncated.jpg", "ends early"),
        ("image_truncated.png", "ends early"),
        ("mask_all_black.png", ""),
        ("mask_wrong_size.png", ""),
    ];
    for path in shared("broken") {
        let name = path.file_name().unwrap().to_string_lossy();
        let (_, words) = expected.iter().find(|(n, _)| *n == name).unwrap_or_else(|| panic!("unexpected {name}"));
        match one(BASE, &std::fs::read(&path).unwrap()) {
            Ok(_) => assert!(words.is_empty(), "{name} should be refused"),
            Err(e) => assert!(!words.is_empty() && e[0].to_string().contains(words), "{name}: {e:?}"),
        }
    }
    let files: Vec<(PathBuf, Vec<u8>)> =
        shared("broken/set_size_mismatch").into_iter().map(|p| (p.clone(), std::fs::read(p).unwrap())).collect();
    if let [(_, albedo), (_, normal)] = files.as_slice() {
        let error = load(&[(BASE, "albedo.png", albedo), (NORMAL, "normal.png", normal)], &Options::default());
        assert!(error.unwrap_err()[0].to_string().contains("`albedo.png` is 256x256, but `normal.png` is 200x256"));
    }
}
