//! Samples of a recipe: their files, whether they go together, and the guides that need them.
//!
//! Part of [`super::validate`], for `[exemplar]` and each `[[exemplar.more]]` alike.
//! Unaware of: what the files hold.

use super::fault::{listing, printable};
use super::frame_pattern::FramePattern;
use super::schema;
use super::validate::Context;
use super::values::*;
use super::words::{MapFile, Word};
use crate::texture::MapKind;

/// Weight of a guide that does not say.
const GUIDE_WEIGHT: f64 = 1.0;

/// Converts a sample written at `key`; of a flipbook, `frames` is the pattern of its base colour's files.
pub(super) fn sample_of(key: &str, from: schema::Sample, frames: Option<String>, context: &mut Context) -> Sample {
    let schema::Sample {
        base_color,
        normal,
        normal_y,
        roughness,
        metallic,
        occlusion,
        height,
        opacity,
        orm,
        emissive,
        feature_mask,
        mask,
        guide,
    } = from;
    let is_flipbook = frames.is_some();
    let named = [
        (MapFile::BaseColor, frames.or(base_color)),
        (MapFile::Normal, normal),
        (MapFile::Roughness, roughness),
        (MapFile::Metallic, metallic),
        (MapFile::Occlusion, occlusion),
        (MapFile::Height, height),
        (MapFile::Opacity, opacity),
        (MapFile::Orm, orm),
        (MapFile::Emissive, emissive),
    ];
    let mut maps = Vec::new();
    for (map, written) in named {
        if let Some(written) = written {
            let name = if is_flipbook && map == MapFile::BaseColor { "frames" } else { map.name() };
            let file = context.file(&format!("{key}.{name}"), written);
            let frames = if is_flipbook { pattern_of(&file, context) } else { None };
            maps.push(ExemplarMap { map, file, frames });
        }
    }
    let mut file =
        |name: &str, written: Option<String>| written.map(|written| context.file(&format!("{key}.{name}"), written));
    let feature_mask = file("feature_mask", feature_mask);
    let (mask, guide) = (file("mask", mask), file("guide", guide));
    Sample { maps, feature_mask, normal_y, mask, guide }
}

/// The pattern that the last part of a path must be.
fn pattern_of(file: &FileRef, context: &mut Context) -> Option<FramePattern> {
    let name = file.path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
    FramePattern::parse(name)
        .map_err(|why| {
            let fault = context.fault(&file.key, format!("the file name of `{}` {why}", file.key));
            let allowed = "one `%d`, or `%04d` for four digits, such as \"smoke_%04d.png\"";
            context.findings.push(fault.found(printable(&file.written)).allowed(allowed));
        })
        .ok()
}

/// Reports samples of a table that have other maps than the first, and guides that only some have.
pub(super) fn check_alike(table: &str, first: &Sample, more: &[Sample], context: &mut Context) {
    // A mask may be given for some keys and found for others.
    let counts = |kind: &MapKind| table == "exemplar.more" || *kind != MapKind::FeatureMask;
    for (i, sample) in more.iter().enumerate() {
        let key = format!("{table}[{i}]");
        let names = |kinds: Vec<MapKind>| kinds.iter().filter(|k| counts(k)).map(|k| k.name()).collect::<Vec<_>>();
        let [ours, theirs] = [first.kinds(), sample.kinds()].map(names);
        if ours != theirs && !ours.is_empty() && !theirs.is_empty() {
            let message = format!("`{key}` has other maps than [exemplar]");
            let fault = context.fault(&key, message).found(listing(&theirs, "`", "and"));
            context.findings.push_unless_due_to(&["exemplar", &key], fault.allowed(listing(&ours, "`", "and")));
        }
        if table == "exemplar.more" && first.guide.is_some() != sample.guide.is_some() {
            let (with, without) =
                if first.guide.is_some() { ("[exemplar]", key.as_str()) } else { (key.as_str(), "[exemplar]") };
            let message = format!("{with} has a `guide`, and {without} has none");
            let fault = context.fault(&key, message).hint("give every sample a guide, or none".to_string());
            context.findings.push_unless_due_to(&["exemplar.guide", &format!("{key}.guide")], fault);
        }
    }
}

/// The guide of a canvas.
pub(super) fn guide_of(
    written: Option<String>,
    weight: Option<f64>,
    exemplar: &Exemplar,
    context: &mut Context,
) -> Option<CanvasGuide> {
    const KEY: &str = "canvas.guide";
    let file = written.map(|written| context.file(KEY, written));
    if file.is_none() && context.tree.entry("canvas.sources").is_none() {
        let own = [(weight.is_some(), "canvas.guide_weight"), (exemplar.guide.is_some(), "exemplar.guide")];
        for (there, key) in own {
            if !there || !context.is_own(key) {
                continue;
            }
            let fault = context.fault(key, format!("`{key}` is of no use without `{KEY}`"));
            let hint = "add the guide of the canvas, or remove this".to_string();
            context.findings.push_unless_due_to(&[KEY, "canvas.sources"], fault.hint(hint));
        }
    }
    file.map(|file| CanvasGuide { file, weight: weight.unwrap_or(GUIDE_WEIGHT) })
}
