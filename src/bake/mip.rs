//! Mip levels of finished maps: 2x2 boxes in linear light, normals made unit again.
//!
//! Sizes halve rounding down, as GPUs count; of an odd row or column the last is left out.

use crate::numerics::par;
use crate::texture::{MapKind, Texture};

/// Means of 2x2 texels, in whatever space the values are. A side of 1 stays.
pub(crate) fn box_half(map: &Texture) -> Texture {
    let (w, h, c) = (map.width(), map.height(), map.channels() as usize);
    let (dx, dy) = (u32::from(w > 1), u32::from(h > 1));
    Texture::from_fn((w / 2).max(1), (h / 2).max(1), map.channels(), |x, y, out| {
        let (x, y) = (x << dx, y << dy);
        let q = [map.get(x, y), map.get(x + dx, y), map.get(x, y + dy), map.get(x + dx, y + dy)];
        (0..c).for_each(|k| out[k] = (q[0][k] + q[1][k] + q[2][k] + q[3][k]) * 0.25);
    })
}

/// The next mip level of a map: half the size, at least 1.
pub fn next_mip(kind: MapKind, map: &Texture) -> Texture {
    let mut out = box_half(map);
    if kind == MapKind::Normal {
        par::for_rows(out.data_mut(), 3, |_, n| {
            let unit = super::shade::unit_or([n[0], n[1], n[2]], [0.0, 0.0, 1.0]);
            n.copy_from_slice(&unit);
        });
    }
    out
}

/// All mip levels of a map after the first, down to 1x1.
pub fn mip_chain(kind: MapKind, map: &Texture) -> Vec<Texture> {
    let mut levels: Vec<Texture> = Vec::new();
    loop {
        let last = levels.last().unwrap_or(map);
        if last.width() == 1 && last.height() == 1 {
            return levels;
        }
        let next = next_mip(kind, last);
        levels.push(next);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_average_in_linear_light() {
        let t = Texture::from_data(2, 2, 1, vec![0.0, 1.0, 1.0, 0.0]);
        assert_eq!(next_mip(MapKind::Roughness, &t).data(), [0.5]);
    }

    #[test]
    fn normals_stay_unit_and_chains_end_at_one_texel() {
        let t = Texture::from_fn(5, 3, 3, |x, _, n| {
            n.copy_from_slice(if x % 2 == 0 { &[0.6, 0.0, 0.8] } else { &[0.0, 0.0, 1.0] })
        });
        let chain = mip_chain(MapKind::Normal, &t);
        assert_eq!(chain.iter().map(|t| (t.width(), t.height())).collect::<Vec<_>>(), [(2, 1), (1, 1)]);
        for n in chain.iter().flat_map(|t| t.data().chunks(3)) {
            assert!((n[0] * n[0] + n[1] * n[1] + n[2] * n[2] - 1.0).abs() < 1e-6);
        }
    }
}
