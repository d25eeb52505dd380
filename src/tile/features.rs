//! Feature masks made from image gradients.
//!
//! Source: \[MST09\] section 1: texture features are "painted by the user or constructed automatically using image
//! gradients"; how, it does not say. Here a picture is divided in two at one level: the mean level weighted by the
//! gradient, which is the level at which most and strongest edges lie (Kittler, Illingworth, Foglein 1985). The picture is
//! the first principal component of the maps, slightly blurred; features are what there is less of.
//! In: maps that wrap. Out: a mask, or nothing if the maps look the same everywhere. Unaware of: painted masks.

use std::collections::BTreeMap;

use super::Mask;
use super::planes::{Planes, planes};
use crate::exemplar::Pyramid;
use crate::numerics::{par, pca};
use crate::texture::{MapKind, MapSet, Wrap};

/// Level of the pyramid that is divided: two binomial blurs, which leave out grain but no feature of some texels.
const LEVEL: usize = 2;

/// Finds features in maps that wrap, of which `importance` says what each weighs; a mask among them is not looked at. `None` if all texels look alike.
pub fn find_features(maps: &MapSet, importance: &BTreeMap<MapKind, f64>) -> Option<Mask> {
    let (w, h) = (maps.width() as usize, maps.height() as usize);
    let planes = planes(maps, importance, false);
    let channels = planes.len();
    let mut pyramid = Pyramid::new(planes, w as u32, h as u32, LEVEL + 1, 0, Wrap::Repeat);
    let stride = pyramid.stride;
    let blurred: Vec<Vec<f32>> = pyramid.planes.split_off(LEVEL * channels);
    let cropped = blurred.iter().map(|p| p.chunks_exact(stride).flat_map(|row| &row[..w]).copied().collect());
    let joined = Planes::joined(&cropped.collect::<Vec<Vec<f32>>>());
    let pca = pca::fit_up_to(joined.values(), channels, 1.0, 1);
    let shade = |i: usize| {
        let parts = joined.at(i).iter().zip(&pca.mean).zip(&pca.basis[0]);
        parts.fold(0.0, |s, ((v, mean), b)| s + (f64::from(*v) - mean) * b)
    };
    let shades = par::map(w * h, shade);
    let at = |x: usize, y: usize| shades[y % h * w + x % w];
    let (mut weight, mut sum) = (0.0, 0.0);
    for (x, y) in (0..h).flat_map(|y| (0..w).map(move |x| (x, y))) {
        let (dx, dy) = (at(x + 1, y) - at(x + w - 1, y), at(x, y + 1) - at(x, y + h - 1));
        let gradient = (dx * dx + dy * dy).sqrt();
        weight += gradient;
        sum += gradient * at(x, y);
    }
    // Rounding leaves gradients of that size in a constant picture.
    if weight <= 1e-6 * (w * h) as f64 {
        return None;
    }
    let level = sum / weight;
    let above = shades.iter().filter(|v| **v > level).count();
    let less_above = 2 * above <= w * h;
    let on: Vec<bool> = shades.iter().map(|v| (*v > level) == less_above).collect();
    (on.contains(&true) && on.contains(&false)).then(|| Mask::new(w as u32, on))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::rng::Key;
    use crate::texture::Texture;

    fn gray(w: u32, h: u32, f: impl Fn(u32, u32) -> f32 + Sync) -> MapSet {
        MapSet::new(vec![(MapKind::Height, Texture::from_fn(w, h, 1, |x, y, out| out[0] = f(x, y)))])
    }

    #[test]
    fn bright_or_dark_discs_are_found_under_noise() {
        let disc = |x: u32, y: u32| {
            let [dx, dy] = [x, y].map(|v| f64::from(v % 32) - 15.5);
            dx * dx + dy * dy < 81.0
        };
        let key = Key::new(3);
        for (inside, outside) in [(0.8, 0.3), (0.2, 0.6)] {
            let value = |x, y| {
                let noise = key.with(u64::from(y)).unit(u64::from(x)) as f32 - 0.5;
                (if disc(x, y) { inside } else { outside }) + 0.2 * noise
            };
            let mask = find_features(&gray(64, 64, value), &BTreeMap::new()).expect("features");
            let wrong = mask.differing(&Mask::from_fn(64, 64, disc));
            assert!(wrong < 64 * 64 / 25, "{wrong} texels");
        }
    }

    #[test]
    fn what_looks_the_same_everywhere_has_none() {
        assert_eq!(find_features(&gray(20, 9, |_, _| 0.3), &BTreeMap::new()), None);
    }
}
