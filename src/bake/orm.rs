//! Occlusion, roughness and metallic in one texture, as glTF reads them: red, green, blue.

use crate::texture::Texture;

/// Packs up to three one-channel maps of one size: occlusion (1 where absent), roughness (1), metallic (0).
/// `None` if all are absent. Panics if sizes or channel counts differ.
pub fn pack_orm(
    occlusion: Option<&Texture>,
    roughness: Option<&Texture>,
    metallic: Option<&Texture>,
) -> Option<Texture> {
    let maps = [(occlusion, 1.0), (roughness, 1.0), (metallic, 0.0)];
    let first = maps.iter().find_map(|(m, _)| *m)?;
    let (w, h) = (first.width(), first.height());
    for m in maps.iter().filter_map(|(m, _)| *m) {
        assert_eq!((m.width(), m.height(), m.channels()), (w, h, 1), "a map to be packed");
    }
    Some(Texture::from_fn(w, h, 3, |x, y, out| {
        for (o, (m, absent)) in out.iter_mut().zip(maps) {
            *o = m.map_or(absent, |m| m.get(x, y)[0]);
        }
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn absent_maps_get_what_gltf_assumes() {
        let rough = Texture::from_data(1, 1, 1, vec![0.25]);
        assert_eq!(pack_orm(None, Some(&rough), None).map(|t| t.data().to_vec()), Some(vec![1.0, 0.25, 0.0]));
        assert_eq!(pack_orm(None, None, None), None);
    }
}
