//! What was probably meant: the nearest of the words that would have been right.

/// Names that other programs give to what kiln calls otherwise.
const OTHER_NAMES: [(&str, &str); 13] = [
    ("albedo", "base_color"),
    ("color", "base_color"),
    ("colour", "base_color"),
    ("diffuse", "base_color"),
    ("ao", "occlusion"),
    ("ambient_occlusion", "occlusion"),
    ("bump", "height"),
    ("displacement", "height"),
    ("emission", "emissive"),
    ("metalness", "metallic"),
    ("nor", "normal"),
    ("rough", "roughness"),
    ("mask", "feature_mask"),
];

/// Longer words are not compared: nobody meant a short one.
const LONGEST: usize = 64;

/// The candidate that `word` was probably meant to be: another name of it, or one that is a slip or two away, or one
/// of which `word` is a good part of the beginning.
pub(super) fn nearest<'a>(word: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    if word.is_empty() || word.len() > LONGEST {
        return None;
    }
    let plain = plain(word);
    let known = known_name(&plain);
    let distance = |candidate: &str| {
        if known == Some(candidate) {
            return 0;
        }
        let slips = strsim::damerau_levenshtein(&plain, candidate);
        if slips <= (candidate.len() / 3).max(1) {
            slips
        } else if plain.len() >= 3 && (candidate.starts_with(&plain) || plain.starts_with(candidate)) {
            LONGEST
        } else {
            usize::MAX
        }
    };
    candidates.into_iter().map(|c| (distance(c), c)).filter(|(d, _)| *d != usize::MAX).min().map(|(_, c)| c)
}

/// kiln's name for a map that others call `name`; `name` in lower case, words joined by `_`.
pub(super) fn known_name(name: &str) -> Option<&'static str> {
    OTHER_NAMES.iter().find(|(other, _)| *other == name).map(|(_, ours)| *ours)
}

/// Lower case, with `_` for every separator and between words of a camelCase name.
pub(super) fn plain(word: &str) -> String {
    let mut out = String::with_capacity(word.len() + 2);
    let mut was_lower = false;
    for c in word.chars() {
        if c.is_ascii_uppercase() && was_lower {
            out.push('_');
        }
        was_lower = c.is_ascii_lowercase();
        out.push(if matches!(c, '-' | ' ' | '.') { '_' } else { c.to_ascii_lowercase() });
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slips_other_spellings_and_other_names_are_understood() {
        let maps = ["base_color", "normal", "roughness", "height"];
        for (word, meant) in [
            ("base_colour", Some("base_color")),
            ("baseColor", Some("base_color")),
            ("Base-Color", Some("base_color")),
            ("albedo", Some("base_color")),
            ("nromal", Some("normal")),
            ("rough", Some("roughness")),
            ("displacement", Some("height")),
            ("xyz", None),
            ("", None),
        ] {
            assert_eq!(nearest(word, maps), meant, "{word}");
        }
        assert_eq!(nearest(&"a".repeat(1 << 20), maps), None);
    }
}
