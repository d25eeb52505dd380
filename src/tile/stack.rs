//! The tile: layers of maps along the material axis.
//!
//! Source: \[MST09\] section 1: a 3D texture T(s, t, m), periodic in s and t.
//! Unaware of: how its layers were made.

use super::Mask;
use crate::texture::{MapKind, MapSet, Texel, Wrap};

/// A 3D texture in (s, t, m), periodic in s and t, not in m: layers of one size with the same maps, each with its feature
/// mask. The first layer lies at m = 0, the last at m = 1, the others evenly between them; there are at least two.
#[derive(Clone, Debug, PartialEq)]
pub struct Tile {
    layers: Vec<MapSet>,
    masks: Vec<Mask>,
}

impl Tile {
    /// Joins layers and their masks. `None` if there are fewer than two, if sizes or maps differ, or if the layers hold
    /// masks among their maps.
    pub fn new(layers: Vec<MapSet>, masks: Vec<Mask>) -> Option<Self> {
        let kinds = |set: &MapSet| set.iter().map(|(kind, _)| kind).collect::<Vec<_>>();
        let first = layers.first()?;
        let alike =
            |set: &MapSet| (set.width(), set.height()) == (first.width(), first.height()) && kinds(set) == kinds(first);
        let fits = |mask: &Mask| (mask.width(), mask.height()) == (first.width(), first.height());
        let whole = layers.len() >= 2
            && layers.len() == masks.len()
            && layers.iter().all(alike)
            && masks.iter().all(fits)
            && first.get(MapKind::FeatureMask).is_none();
        whole.then_some(Tile { layers, masks })
    }

    /// Texels along s.
    pub fn width(&self) -> u32 {
        self.layers[0].width()
    }

    /// Texels along t.
    pub fn height(&self) -> u32 {
        self.layers[0].height()
    }

    /// Layers along m.
    pub fn depth(&self) -> u32 {
        self.layers.len() as u32
    }

    /// The maps of every layer, from m = 0 to m = 1. The feature mask is not among them.
    pub fn layers(&self) -> &[MapSet] {
        &self.layers
    }

    /// The feature mask of every layer.
    pub fn masks(&self) -> &[Mask] {
        &self.masks
    }

    /// The maps that every layer has, in the order of [`MapKind`].
    pub fn kinds(&self) -> Vec<MapKind> {
        self.layers[0].iter().map(|(kind, _)| kind).collect()
    }

    /// Trilinear sample of a map into `out` (one value per channel), as a GPU filters a 3D texture without mip levels.
    ///
    /// `pos` in texels along s and t, wrapping; `m` in 0..=1, clamped (not a number: 0). The texture coordinate along the
    /// third axis of a 3D texture is `(m * (depth - 1) + 0.5) / depth`. Normals are not made unit length. False, and `out`
    /// as it was, if there is no such map.
    pub fn sample(&self, kind: MapKind, pos: Texel, m: f32, out: &mut [f32]) -> bool {
        let z = if m > 0.0 { m.min(1.0) * (self.layers.len() - 1) as f32 } else { 0.0 };
        let below = (z.floor() as usize).min(self.layers.len() - 2);
        let (Some(a), Some(b)) = (self.layers[below].get(kind), self.layers[below + 1].get(kind)) else {
            return false;
        };
        let share = z - below as f32;
        let mut above = [0.0; 4];
        a.sample(pos, Wrap::Repeat, out);
        b.sample(pos, Wrap::Repeat, &mut above);
        for (o, above) in out.iter_mut().zip(above).take(a.channels() as usize) {
            *o = *o * (1.0 - share) + above * share;
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::texture::{Texture, texel};

    fn layer(value: f32) -> MapSet {
        let map = Texture::from_fn(4, 2, 1, |x, y, out| out[0] = value + (4 * y + x) as f32);
        MapSet::new(vec![(MapKind::Height, map)])
    }

    fn tile() -> Tile {
        let masks = (0..3).map(|m| Mask::from_fn(4, 2, |x, _| x == m)).collect();
        Tile::new(vec![layer(0.0), layer(100.0), layer(300.0)], masks).expect("alike")
    }

    #[test]
    fn samples_wrap_in_s_and_t_and_end_in_m() {
        let tile = tile();
        let at = |x, y, m| {
            let mut out = [f32::NAN];
            assert!(tile.sample(MapKind::Height, texel(x, y), m, &mut out));
            out[0]
        };
        assert_eq!((at(0.5, 0.5, 0.0), at(0.5, 0.5, 0.5), at(0.5, 0.5, 1.0)), (0.0, 100.0, 300.0));
        assert_eq!((at(0.5, 0.5, 0.25), at(0.5, 0.5, 0.75)), (50.0, 200.0));
        assert_eq!((at(4.0, 0.5, 0.0), at(0.0, 0.5, 0.0), at(-8.0, 2.5, 0.0)), (1.5, 1.5, 1.5));
        assert_eq!((at(0.5, 1.0, 0.0), at(0.5, 2.0, 0.0)), (2.0, 2.0));
        assert_eq!((at(1.5, 0.5, 7.0), at(1.5, 0.5, -1.0), at(1.5, 0.5, f32::NAN)), (301.0, 1.0, 1.0));
        assert!(!tile.sample(MapKind::Normal, texel(0.0, 0.0), 0.0, &mut [0.0; 3]));
    }

    #[test]
    fn layers_that_differ_are_no_tile() {
        let mask = || Mask::from_fn(4, 2, |x, _| x == 0);
        assert_eq!(Tile::new(vec![layer(0.0)], vec![mask()]), None);
        assert_eq!(Tile::new(vec![layer(0.0), layer(1.0)], vec![mask()]), None);
        let other = MapSet::new(vec![(MapKind::Roughness, Texture::new(4, 2, 1))]);
        assert_eq!(Tile::new(vec![layer(0.0), other], vec![mask(), mask()]), None);
        assert_eq!(Tile::new(vec![layer(0.0), layer(1.0)], vec![mask(), Mask::from_fn(2, 4, |_, _| true)]), None);
    }
}
