//! A recipe to start from, for `kiln init`: what is known is filled in, what is usual is shown as a comment.

use super::hint;
use super::words::{MapFile, Word};
use std::fmt::Write;

/// What is known before there is a recipe. Paths are relative to the recipe that is to be.
#[derive(Clone, Debug, PartialEq)]
pub struct Starter<'a> {
    /// The mesh.
    pub mesh: &'a str,
    /// The maps of the sample, each kind once; at least one.
    pub maps: &'a [(MapFile, String)],
    /// A black and white picture of the features.
    pub feature_mask: Option<&'a str>,
    /// A guess at the texels per mesh unit; `None` writes "auto".
    pub scale: Option<f64>,
}

/// A commented recipe. Reads back without faults if the paths are of the right kinds and the scale is in range.
pub fn template(from: &Starter) -> String {
    let mut maps = String::new();
    for &map in MapFile::ALL {
        if let Some((_, path)) = from.maps.iter().find(|(kind, _)| *kind == map) {
            let _ = writeln!(maps, "{} = {}", map.name(), quoted(path));
            if map == MapFile::Normal {
                maps.push_str("# normal_y = \"down\"                     # if green points down, as DirectX has it\n");
            }
        }
    }
    if let Some(mask) = from.feature_mask {
        let _ = writeln!(maps, "feature_mask = {}", quoted(mask));
    }
    let scale = from.scale.map_or("\"auto\"".into(), |scale| format!("{scale:?}"));
    let scale = format!("{scale:<31}");
    TEMPLATE.replace("{mesh}", &quoted(from.mesh)).replace("{maps}\n", &maps).replace("{scale}", &scale)
}

/// The map that a file probably holds, judged by its name without extension, such as `pebbles_BaseColor_2k`; `None`
/// if the name says nothing. A feature mask is no map: see [`is_feature_mask`].
pub fn guess_map(stem: &str) -> Option<MapFile> {
    const SHORT: [(&str, MapFile); 11] = [
        ("basecolor", MapFile::BaseColor),
        ("col", MapFile::BaseColor),
        ("diff", MapFile::BaseColor),
        ("nrm", MapFile::Normal),
        ("norm", MapFile::Normal),
        ("metal", MapFile::Metallic),
        ("occ", MapFile::Occlusion),
        ("disp", MapFile::Height),
        ("emit", MapFile::Emissive),
        ("arm", MapFile::Orm),
        ("alpha", MapFile::Opacity),
    ];
    let plain = hint::plain(stem);
    let of_word = |word: &str| {
        let short = SHORT.iter().find(|(name, _)| *name == word).map(|(_, map)| *map);
        short.or_else(|| MapFile::from_name(hint::known_name(word).unwrap_or(word)))
    };
    let words: Vec<&str> = plain.split('_').collect();
    // The kind stands at the end, perhaps before a size; two words, such as `base_color`, say more than one.
    (0..words.len()).rev().find_map(|i| {
        let pair = words.get(i + 1).and_then(|next| of_word(&format!("{}_{next}", words[i])));
        pair.or_else(|| of_word(words[i]))
    })
}

/// Whether a file probably holds a feature mask, judged by its name without extension.
pub fn is_feature_mask(stem: &str) -> bool {
    hint::plain(stem).split('_').any(|word| word == "mask")
}

/// Text as a TOML string.
fn quoted(text: &str) -> String {
    toml::Value::String(text.into()).to_string()
}

const TEMPLATE: &str = r##"# A kiln recipe. Paths are relative to this file. What is commented out shows the default.
# `kiln schema > kiln.schema.json` lets editors complete and check: put `#:schema ../kiln.schema.json` on top.
kiln = 1

[mesh]
path = {mesh}
# materials = ["Stone"]                 # only the primitives of these materials; default: all

[exemplar]                              # maps of one sample, all the same size
{maps}
# importance = { base_color = 1.0 }     # weight of each map in the similarity
# tileable = false                      # the sample itself wraps: it has no borders

[analysis]
# method = "jump-map"                   # "texton" for bricks, weaves, fruit: things of the size of some triangles
# neighbourhoods = [9, 5, 3]            # in texels, finest level first; larger features want larger ones
# jumps = 3

[field]
symmetry = 1                            # 1, 2, 4, or "isotropic" if the sample has no preferred direction
# orientation = [                       # "up" of the sample at points of the surface
#   { at = [0.0, 1.0, 0.0], up = [0.0, 0.0, 1.0] },
# ]
# align = []                            # "creases", "boundary", "curvature": run along or across these

[synthesis]
scale = {scale} # texels of the sample per mesh unit, or "auto"
seed = 1                                # another number gives another texture of the same kind
# patch = 1.0                           # 1.0 to 1.5; larger patches repeat more and break up less
# refine = 2                            # correction passes
# blend = "linear"                      # "linear", "variance" or "none"
# sharpness = 1                         # 2 or more: patches blend over less width

[atlas]                                 # finished maps on a UV unwrap; remove when not wanted
size = 2048
# format = "png"                        # "png", "png16" or "exr"; per map: { normal = "png16" }
# unwrap = "uvunwrap"                   # or keep_uv = 0 for the mesh's own texture coordinates
# filter = "cubic"                      # or "linear": softer

# [uv_sets]                             # texture coordinates and weights for a shader, instead of an atlas

[[render]]                              # golden views
view = "turntable-4"
size = 512
shading = "lit"                         # "unlit", "lit", "normal", "patches", "uv", "field" or "edges"
"##;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recipe::{Scale, Target, parse};
    use std::path::Path;

    #[test]
    fn the_template_reads_back_as_what_went_in() {
        let maps = [(MapFile::Normal, "a/n \"1\".png".to_string()), (MapFile::BaseColor, "a/c\\1.png".to_string())];
        for (scale, expected) in [(Some(128.0), Scale::TexelsPerUnit(128.0)), (None, Scale::Auto)] {
            let text = template(&Starter { mesh: "m.glb", maps: &maps, feature_mask: Some("a/mask.png"), scale });
            let recipe = parse(Path::new("r.toml"), text.as_bytes(), None).unwrap_or_else(|f| panic!("{f}\n{text}"));
            let written: Vec<_> = recipe.exemplar.maps.iter().map(|m| m.file.written.as_str()).collect();
            assert_eq!(written, ["a/c\\1.png", "a/n \"1\".png"]);
            assert!(recipe.exemplar.feature_mask.is_some());
            assert!(matches!(recipe.target, Target::Mesh(m) if m.mesh.written == "m.glb" && m.scale == expected));
        }
    }

    #[test]
    fn what_the_template_comments_out_is_right_too() {
        let maps = [(MapFile::BaseColor, "c.png".to_string()), (MapFile::Normal, "n.png".to_string())];
        let text = template(&Starter { mesh: "m.glb", maps: &maps, feature_mask: None, scale: None });
        let all: Vec<&str> = text.lines().skip(2).map(|l| l.strip_prefix("# ").unwrap_or(l)).collect();
        let all = all.join("\n").replace("#   {", "{").replace("\n# ]", "\n]");
        let recipe = parse(Path::new("r.toml"), all.as_bytes(), None).unwrap_or_else(|f| panic!("{}", f.render(false)));
        let plain = parse(Path::new("r.toml"), text.as_bytes(), None).unwrap_or_else(|f| panic!("{f}"));
        assert_eq!(recipe.analysis, plain.analysis);
        assert_eq!(recipe.synthesis, plain.synthesis);
    }

    #[test]
    fn kinds_of_maps_are_known_by_their_names() {
        for (stem, map) in [
            ("base_color", Some(MapFile::BaseColor)),
            ("Rock_BaseColor-2K", Some(MapFile::BaseColor)),
            ("PavingStones_1K-PNG_NormalGL", Some(MapFile::Normal)),
            ("rock_nor_gl", Some(MapFile::Normal)),
            ("metal_plate_rough", Some(MapFile::Roughness)),
            ("ao", Some(MapFile::Occlusion)),
            ("orm", Some(MapFile::Orm)),
            ("moss", None),
            ("", None),
        ] {
            assert_eq!(guess_map(stem), map, "{stem}");
        }
        assert!(is_feature_mask("rock_mask") && !is_feature_mask("rock"));
    }
}
