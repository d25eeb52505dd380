//! The fixed words of a recipe: each enum is one key's list of allowed values.
//!
//! A word has one spelling, used in recipes, in the JSON Schema, on the command line and in reports.
//! Unaware of: tables, files, which words this version can act on.

use crate::texture::MapKind;

/// A value that is one of a short list of words.
pub trait Word: Copy + Send + Sync + 'static {
    /// Every word, in the order in which help shows them.
    const ALL: &'static [Self];
    /// The spelling in recipes.
    fn name(self) -> &'static str;
    /// The word of that spelling.
    fn from_name(name: &str) -> Option<Self> {
        Self::ALL.iter().copied().find(|word| word.name() == name)
    }
}

macro_rules! words {
    ($($(#[doc = $doc:literal])* $name:ident { $($(#[doc = $word_doc:literal])* $word:ident = $text:literal,)* })*) => {$(
        $(#[doc = $doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
        #[derive(serde::Deserialize, serde::Serialize, schemars::JsonSchema)]
        pub enum $name {
            $($(#[doc = $word_doc])* #[serde(rename = $text)] $word,)*
        }

        impl Word for $name {
            const ALL: &'static [Self] = &[$($name::$word),*];

            fn name(self) -> &'static str {
                match self {
                    $($name::$word => $text,)*
                }
            }
        }
    )*};
}

words! {
    /// What a server of the Remote Execution API is used for.
    RemoteMode {
        /// Results are taken from there.
        Read = "read",
        /// Results are taken from there, and those made here are stored there.
        ReadWrite = "read-write",
    }

    /// In which order a flat image is walked (\[ZG02\] section 3.2).
    CanvasOrder {
        /// Row by row, left to right.
        Scanline = "scanline",
        /// Row by row, every other one right to left.
        Serpentine = "serpentine",
        /// Along a Hilbert curve: the best patches.
        Hilbert = "hilbert",
    }

    /// How an atlas shows the sample between its texels.
    AtlasFilter {
        /// Linearly, as graphics hardware does.
        Linear = "linear",
        /// By Catmull-Rom splines: fine detail stays.
        Cubic = "cubic",
    }

    /// A picture that shows how a canvas came about.
    CanvasDebug {
        /// Where in the exemplar each pixel was copied from, as a colour (\[ZG02\] figure 3).
        Patches = "patches",
        /// The same as numbers: 16 bits, red the column and green the row in the exemplar.
        Sources = "sources",
        /// White where a patch begins, grey along its border.
        Jumps = "jumps",
    }

    /// In which order the vertices of a mesh are walked (\[ZG03\] section 4.1).
    WalkOrder {
        /// Nearest to the start first.
        RegionGrowing = "region-growing",
        /// As the triangles are drawn.
        RenderingSequence = "rendering-sequence",
    }

    /// How patches meet.
    Blend {
        /// Weighted mean.
        Linear = "linear",
        /// Weighted mean with the contrast of the sample restored.
        Variance = "variance",
        /// Hard edges.
        None = "none",
    }

    /// Which way the green channel of a normal map points.
    NormalY {
        /// Up the image, as in OpenGL and glTF.
        Up = "up",
        /// Down the image, as in DirectX.
        Down = "down",
    }

    /// How the sample is analysed and put onto the surface.
    Method {
        /// Similar texels, walked over vertices \[ZG02\] \[ZG03\].
        JumpMap = "jump-map",
        /// Clusters of neighbourhoods, quilted over faces \[MK03\].
        Texton = "texton",
        /// A periodic parametrisation and a tile with a material axis \[MST09\].
        MaterialSpace = "material-space",
    }

    /// What textons are clustered by (\[MK03\] section 3.1).
    TextonFeatures {
        /// The window's texels.
        Window = "window",
        /// Responses of a filter bank.
        FilterBank = "filter-bank",
    }

    /// What kind of texture a material-space tile is written as.
    TileShape {
        /// A 3D texture, without mip levels: those would mix materials.
        Volume = "3d",
        /// A 2D array, with mip levels.
        Array = "2d-array",
    }

    /// What a singularity of the orientation field looks like.
    SingularityKind {
        /// "Up" points away from it.
        Source = "source",
        /// "Up" points to it.
        Sink = "sink",
        /// "Up" turns around it.
        Vortex = "vortex",
    }

    /// Lines of a surface that the orientation can be drawn to.
    AlignTo {
        /// Edges at which the surface folds.
        Creases = "creases",
        /// Edges with a triangle on one side only.
        Boundary = "boundary",
        /// The directions in which the surface bends most and least.
        Curvature = "curvature",
    }

    /// The library that lays the atlas out.
    Unwrap {
        /// Pure Rust, fast.
        Uvunwrap = "uvunwrap",
        /// C++, only in a kiln built with the cargo feature `xatlas`.
        Xatlas = "xatlas",
    }

    /// A file format for baked maps.
    ImageFormat {
        /// PNG, 8 bits per channel.
        Png = "png",
        /// PNG, 16 bits per channel.
        Png16 = "png16",
        /// OpenEXR, half float, linear.
        Exr = "exr",
        /// KTX2, BC1: opaque colour, 4 bits per texel.
        Ktx2Bc1 = "ktx2-bc1",
        /// KTX2, BC4: one channel.
        Ktx2Bc4 = "ktx2-bc4",
        /// KTX2, BC5: two channels, normals.
        Ktx2Bc5 = "ktx2-bc5",
        /// KTX2, BC6H: high dynamic range.
        Ktx2Bc6h = "ktx2-bc6h",
        /// KTX2, BC7: colour at 8 bits per texel.
        Ktx2Bc7 = "ktx2-bc7",
        /// KTX2, Basis UASTC: transcodes to every GPU.
        Ktx2Uastc = "ktx2-uastc",
        /// KTX2, Basis ETC1S: smallest.
        Ktx2Etc1s = "ktx2-etc1s",
    }

    /// How hard PNG files are squeezed. Pixels are the same.
    Compression {
        /// Fast to write.
        Fast = "fast",
        /// Smallest: about a quarter smaller, thirty times slower.
        Best = "best",
    }

    /// What a golden view shows.
    Shading {
        /// The base colour as it is.
        Unlit = "unlit",
        /// Lit by the built-in light, with all maps.
        Lit = "lit",
        /// Normals as colours.
        Normal = "normal",
        /// Each patch in its own colour.
        Patches = "patches",
        /// Texture coordinates as colours.
        Uv = "uv",
        /// Strokes along the orientation, thick end up; singularities marked.
        Field = "field",
        /// material-space: the grid of the tile, with poles and T-junctions marked and blended triangles tinted.
        Singularities = "singularities",
        /// texton: triangles that are blended over their edges, by what their sides differ by: green a little, red much.
        Edges = "edges",
    }

    /// A map as a file: one of the exemplar's, or one that goes out.
    MapFile {
        /// Colour.
        BaseColor = "base_color",
        /// Tangent-space normal.
        Normal = "normal",
        /// 0 mirror-like to 1 rough.
        Roughness = "roughness",
        /// 0 dielectric, 1 metal.
        Metallic = "metallic",
        /// Ambient occlusion.
        Occlusion = "occlusion",
        /// Height.
        Height = "height",
        /// 0 transparent to 1 opaque.
        Opacity = "opacity",
        /// Occlusion, roughness and metallic in one file's red, green and blue.
        Orm = "orm",
        /// Light given off.
        Emissive = "emissive",
    }
}

impl MapFile {
    /// The maps that the file holds: three for `orm`, in the order of its channels, else one.
    pub fn kinds(self) -> &'static [MapKind] {
        match self {
            MapFile::BaseColor => &[MapKind::BaseColor],
            MapFile::Normal => &[MapKind::Normal],
            MapFile::Roughness => &[MapKind::Roughness],
            MapFile::Metallic => &[MapKind::Metallic],
            MapFile::Occlusion => &[MapKind::Occlusion],
            MapFile::Height => &[MapKind::Height],
            MapFile::Opacity => &[MapKind::Opacity],
            MapFile::Orm => &[MapKind::Occlusion, MapKind::Roughness, MapKind::Metallic],
            MapFile::Emissive => &[MapKind::Emissive],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn map_files_are_spelled_as_the_maps_they_hold() {
        for &file in MapFile::ALL {
            assert_eq!(MapFile::from_name(file.name()), Some(file));
            if let [kind] = file.kinds() {
                assert_eq!(kind.name(), file.name());
            }
        }
        assert_eq!(MapFile::from_name("feature_mask"), None);
    }
}
