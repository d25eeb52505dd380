//! The maps of one sample: colour, normal, roughness and the rest, all of one size, synthesised together.

use super::Texture;

/// What a map holds. The order is the order of a set, of channels in the analysis and of outputs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum MapKind {
    /// Linear RGB, not premultiplied.
    BaseColor,
    /// Tangent-space normal, components -1..=1, x right, y up (OpenGL), z out of the surface, unit length.
    Normal,
    /// 0 mirror-like to 1 rough.
    Roughness,
    /// 0 dielectric, 1 metal.
    Metallic,
    /// Ambient occlusion: 0 dark to 1 open.
    Occlusion,
    /// Height, 0..1.
    Height,
    /// Linear RGB.
    Emissive,
    /// 0 transparent to 1 opaque.
    Opacity,
    /// Binary: where the sample's features are. Weighs in the analysis; never an output.
    FeatureMask,
}

impl MapKind {
    /// Every kind, in order.
    pub const ALL: [MapKind; 9] = [
        MapKind::BaseColor,
        MapKind::Normal,
        MapKind::Roughness,
        MapKind::Metallic,
        MapKind::Occlusion,
        MapKind::Height,
        MapKind::Emissive,
        MapKind::Opacity,
        MapKind::FeatureMask,
    ];

    /// The name used in recipes and file names.
    pub fn name(self) -> &'static str {
        match self {
            MapKind::BaseColor => "base_color",
            MapKind::Normal => "normal",
            MapKind::Roughness => "roughness",
            MapKind::Metallic => "metallic",
            MapKind::Occlusion => "occlusion",
            MapKind::Height => "height",
            MapKind::Emissive => "emissive",
            MapKind::Opacity => "opacity",
            MapKind::FeatureMask => "feature_mask",
        }
    }

    /// Values per texel: 3 for colours and normals, else 1.
    pub fn channels(self) -> u32 {
        match self {
            MapKind::BaseColor | MapKind::Normal | MapKind::Emissive => 3,
            _ => 1,
        }
    }

    /// True if an 8- or 16-bit file of this map holds sRGB values.
    pub fn is_srgb(self) -> bool {
        matches!(self, MapKind::BaseColor | MapKind::Emissive)
    }
}

/// The maps of one sample, in the order of [`MapKind`], at least one, all of the same size.
#[derive(Clone, Debug, PartialEq)]
pub struct MapSet {
    maps: Vec<(MapKind, Texture)>,
}

impl MapSet {
    /// Sorts the maps by kind. Panics if there is none, a kind comes twice, sizes differ or a channel count is not the
    /// kind's: whoever reads files checks and says so first.
    pub fn new(mut maps: Vec<(MapKind, Texture)>) -> Self {
        maps.sort_by_key(|(kind, _)| *kind);
        assert!(!maps.is_empty(), "a set without maps");
        assert!(maps.windows(2).all(|w| w[0].0 != w[1].0), "a map comes twice");
        let (w, h) = (maps[0].1.width(), maps[0].1.height());
        for (kind, t) in &maps {
            assert_eq!((t.width(), t.height(), t.channels()), (w, h, kind.channels()), "{}", kind.name());
        }
        MapSet { maps }
    }

    /// Texels per row of every map.
    pub fn width(&self) -> u32 {
        self.maps[0].1.width()
    }

    /// Rows of every map.
    pub fn height(&self) -> u32 {
        self.maps[0].1.height()
    }

    /// The map of a kind, if the set has it.
    pub fn get(&self, kind: MapKind) -> Option<&Texture> {
        self.maps.iter().find(|(k, _)| *k == kind).map(|(_, t)| t)
    }

    /// All maps, in the order of [`MapKind`].
    pub fn iter(&self) -> impl Iterator<Item = (MapKind, &Texture)> {
        self.maps.iter().map(|(k, t)| (*k, t))
    }
}
