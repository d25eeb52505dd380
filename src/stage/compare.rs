//! The values by which correction passes compare places of a sample: all maps that count, by their importance.

use std::collections::BTreeMap;

use crate::texture::color::linear_to_srgb;
use crate::texture::{MapKind, MapSet, Texture};

/// One texture of all maps with a positive weight: colours gamma-encoded, so that a step looks as large in the dark as in
/// the light; normals halved, to span 0..1; each scaled by the square root of its weight.
pub fn comparison(maps: &MapSet, importance: &BTreeMap<MapKind, f64>) -> Texture {
    let weight = |kind| importance.get(&kind).copied().unwrap_or(0.0).sqrt() as f32;
    let mut counted: Vec<(MapKind, &Texture, f32)> =
        maps.iter().map(|(kind, map)| (kind, map, weight(kind))).filter(|(.., w)| *w > 0.0).collect();
    if counted.is_empty() {
        counted = maps.iter().map(|(kind, map)| (kind, map, 1.0)).collect();
    }
    let channels = counted.iter().map(|(kind, ..)| kind.channels()).sum();
    Texture::from_fn(maps.width(), maps.height(), channels, |x, y, out| {
        let mut at = 0;
        for (kind, map, weight) in &counted {
            for v in map.get(x, y) {
                let v = match kind {
                    MapKind::Normal => v * 0.5,
                    kind if kind.is_srgb() => linear_to_srgb(*v),
                    _ => *v,
                };
                out[at] = v * weight;
                at += 1;
            }
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_maps_that_count_are_compared() {
        let map = |kind: MapKind, v: f32| (kind, Texture::from_fn(2, 2, kind.channels(), |_, _, out| out.fill(v)));
        let maps =
            MapSet::new(vec![map(MapKind::BaseColor, 1.0), map(MapKind::Height, 0.5), map(MapKind::Roughness, 0.1)]);
        let t = comparison(&maps, &[(MapKind::BaseColor, 1.0), (MapKind::Height, 4.0)].into());
        assert!(t.get(0, 0).len() == 4 && t.get(0, 0).iter().all(|v| (v - 1.0).abs() < 1e-6), "{:?}", t.get(0, 0));
        assert_eq!(comparison(&maps, &BTreeMap::new()).channels(), 5, "with no weights all count");
    }
}
