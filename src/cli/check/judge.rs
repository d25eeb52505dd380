//! How the outputs and analyses of one recipe stand to its golden book.

use std::collections::BTreeMap;
use std::path::Path;

use crate::disk::{Disk, Real};
use crate::golden::book::{Book, Kind, Outcome, Output, compare_book};
use crate::golden::change::{Change, first_change};
use crate::golden::compare::{beside, compare, panels};
use crate::golden::compare_glb::compare_glb;
use crate::golden::digest::digest_pixels;
use crate::golden::flip::flip;
use crate::golden::report::{Entry, Figures, Pictures, Status};
use crate::golden::thumbnail;
use crate::io::Pixels;
use crate::recipe::Recipe;
use crate::stage::plan::Planned;

use super::baked::{Baked, Known};
use super::shelf::{copy_path, picture_path, png, read_book, read_image};
use super::{OUTPUT_LIMIT, PANEL, THUMB};
use crate::cli::Stop;
use crate::cli::bake::write;
use crate::cli::project::{Loaded, OUT, OWN};

/// Compares one recipe with its book.
pub(super) fn judge(planned: &Planned, recipe: &Recipe, loaded: &Loaded, known: &Known) -> Result<Vec<Entry>, Stop> {
    let baked = Baked::read(planned, loaded, known)?;
    let expected = read_book(&planned.name)?.unwrap_or_default();
    let change = first_change(&expected, &baked.book);
    let mut entries = Vec::new();
    for verdict in compare_book(&expected, &baked.book) {
        let [old, new] = [&expected, &baked.book].map(|book| book.output(&verdict.name));
        let image = baked.images.get(&verdict.name);
        let mut entry = Entry {
            recipe: planned.name.clone(),
            output: verdict.name.clone(),
            kind: new.or(old).map_or("", |o| o.kind.name()),
            ..Entry::default()
        };
        match &verdict.outcome {
            Outcome::Same => {
                let known = old.into_iter().flat_map(|o| &o.quality);
                entry.quality = known.map(|(k, v)| (k.clone(), (Some(*v), Some(*v)))).collect();
            }
            Outcome::New => {
                entry.status = Status::New;
                entry.message = "not accepted yet".into();
                entry.pictures.actual = image.map(|p| thumbnail(p, PANEL));
            }
            Outcome::Missing => {
                entry.status = Status::Missing;
                entry.message = "no longer an output".into();
                entry.pictures.expected = read_image(&picture_path(&planned.name, &verdict.name));
            }
            Outcome::Different { expected, actual } => {
                let found = Difference::of(&planned.name, expected, actual, image);
                let mut message = vec![found.said];
                if let [Some(a), Some(d), Some(b)] =
                    [&found.pictures.expected, &found.pictures.difference, &found.pictures.actual]
                {
                    let name = Path::new(&planned.name).join(&verdict.name);
                    let path = Path::new(OWN).join("check").join(name).with_extension("png");
                    write(&path, &png(&beside(&[a.clone(), d.clone(), b.clone()]))?)?;
                    message.push(format!("expected, difference, actual: {}", path.display()));
                }
                entry.status = if found.is_tolerated { Status::Tolerated } else { Status::Different };
                entry.message = message.join("\n");
                (entry.figures, entry.pictures) = (found.figures, found.pictures);
                entry.change = change.clone();
            }
        }
        if entry.status != Status::Same {
            entry.accept = accept_command(&planned.name, Some(&verdict.name));
            entry.quality = quality(old, new.map(|o| baked.figures(recipe, o)));
        }
        entries.push(entry);
    }
    let mut steps = steps(planned, &baked, &expected, change.as_ref());
    // Where outputs may differ, as on a machine that cannot be exact, what they are made of may, too.
    let is_tolerant =
        entries.iter().any(|e| e.status == Status::Tolerated) && !entries.iter().any(|e| e.status.is_failure());
    steps
        .iter_mut()
        .filter(|e| is_tolerant && e.status == Status::Different)
        .for_each(|e| e.status = Status::Tolerated);
    entries.extend(steps);
    Ok(entries)
}

/// Analyses are golden too; and a step that gives something else for the same reasons lacks a new revision.
fn steps(planned: &Planned, baked: &Baked, expected: &Book, change: Option<&Change>) -> Vec<Entry> {
    let entry = |step: &str, kind, status, message: &str| Entry {
        recipe: planned.name.clone(),
        output: format!("step {step}"),
        kind,
        status,
        message: message.into(),
        change: change.filter(|_| status != Status::Same).cloned(),
        accept: if status == Status::Same { String::new() } else { accept_command(&planned.name, None) },
        ..Entry::default()
    };
    let mut entries = Vec::new();
    let forgotten = change.filter(|c| c.is_unexplained && !baked.output_steps.contains(&c.step));
    for name in &baked.analyses {
        let [old, new] = [expected, &baked.book].map(|book| book.step(name));
        let (Some(old), Some(new)) = (old, new) else { continue };
        if old.artefact == new.artefact {
            entries.push(entry(name, "analysis", Status::Same, ""));
        } else if forgotten.is_none_or(|c| c.step != *name) {
            entries.push(entry(name, "analysis", Status::Different, "the analysis is another one"));
        }
    }
    entries
        .extend(forgotten.map(|c| entry(&c.step, "step", Status::Different, "gives another artefact than accepted")));
    entries
}

/// The command that accepts a recipe or one of its outputs, as a shell takes it.
pub(super) fn accept_command(recipe: &str, output: Option<&str>) -> String {
    let name = output.map_or(recipe.to_string(), |output| format!("{recipe}/{output}"));
    let plain = name.chars().all(|c| c.is_alphanumeric() || "-_./+=:@%,".contains(c)) && !name.starts_with('-');
    if plain { format!("kiln accept {name}") } else { format!("kiln accept -- '{}'", name.replace('\'', "'\\''")) }
}

/// Figures before and after, by name.
pub(super) fn quality(
    old: Option<&Output>,
    new: Option<BTreeMap<String, f64>>,
) -> BTreeMap<String, (Option<f64>, Option<f64>)> {
    let mut both = BTreeMap::new();
    for (name, value) in old.into_iter().flat_map(|o| &o.quality) {
        both.insert(name.clone(), (Some(*value), None));
    }
    for (name, value) in new.into_iter().flatten() {
        both.entry(name).or_insert((None, None)).1 = Some(value);
    }
    both
}

/// How an output differs: in figures, and to be looked at as far as the expected one is still there.
pub(super) struct Difference {
    pub said: String,
    pub is_tolerated: bool,
    pub figures: Option<Figures>,
    pub pictures: Pictures,
}

impl Difference {
    pub fn of(recipe: &str, old: &Output, new: &Output, image: Option<&Pixels>) -> Difference {
        let plain =
            |said: &str, pictures| Difference { said: said.into(), is_tolerated: false, figures: None, pictures };
        let Some(actual) = image else {
            return plain(&of_file(recipe, old, new), Pictures::default());
        };
        let is_whole = |p: &Pixels| digest_pixels(p) == old.blake3;
        let whole = read_image(&copy_path(&old.blake3)).filter(is_whole);
        let beside_book = || read_image(&picture_path(recipe, &old.name));
        let Some(expected) = whole.or_else(|| beside_book().filter(is_whole)) else {
            return without_expected(old, new, actual, beside_book());
        };
        let [a, d, b] = panels(&expected, actual, PANEL).map(Some);
        let pictures = Pictures { expected: a, difference: d, actual: b };
        match compare(&expected, actual) {
            Err(unlike) => plain(&unlike.to_string(), pictures),
            Ok(difference) => {
                let flip = flip(&expected, actual);
                let is_tolerated = old.tolerance.as_ref().is_some_and(|t| t.allows(&difference, flip));
                let (max, mean) = (difference.max, difference.mean);
                let figures = Figures { max, mean, share: difference.differing_share, flip, worst: difference.worst };
                let said = format!("{difference}, to the eye (FLIP) {flip:.5}");
                Difference { said, is_tolerated, figures: Some(figures), pictures }
            }
        }
    }
}

/// How something that is no image differs.
fn of_file(recipe: &str, old: &Output, new: &Output) -> String {
    let read = |path: &Path| Real.read(path, OUTPUT_LIMIT).ok();
    let both = read(&copy_path(&old.blake3)).zip(read(&Path::new(OUT).join(recipe).join(&new.name)));
    let said = match (old.kind, new.kind, both) {
        (Kind::Mesh, Kind::Mesh, Some((a, b))) => compare_glb(&a, &b).unwrap_or_default(),
        _ => Vec::new(),
    };
    // More than this says no more.
    let more = (said.len() > 8).then(|| format!("and {} more", said.len() - 8));
    let lines = ["the content differs".to_string()].into_iter().chain(said.into_iter().take(8)).chain(more);
    lines.collect::<Vec<_>>().join("\n")
}

/// Where only a thumbnail of what was accepted is here, or not even that.
fn without_expected(old: &Output, new: &Output, actual: &Pixels, small: Option<Pixels>) -> Difference {
    let only = |said: String, pictures| Difference { said, is_tolerated: false, figures: None, pictures };
    let alone = |side| Pictures { actual: Some(thumbnail(actual, side)), ..Pictures::default() };
    if let (Some([w, h]), Some([now_w, now_h])) = (old.size, new.size)
        && (w, h) != (now_w, now_h)
    {
        return only(format!("expected {w}x{h}, found {now_w}x{now_h}"), alone(PANEL));
    }
    let Some(expected) = small else {
        return only("the content differs; the accepted picture is not here".into(), alone(PANEL));
    };
    let actual = if old.kind == Kind::Render { actual.clone() } else { thumbnail(actual, THUMB) };
    let unjudged = if old.tolerance.is_some() { "; accept again to keep what its tolerance is judged by" } else { "" };
    let said = match compare(&expected, &actual) {
        Ok(d) => format!("the content differs; its thumbnail {d}{unjudged}"),
        Err(_) => format!("the content differs{unjudged}"),
    };
    let [a, d, b] = panels(&expected, &actual, PANEL).map(Some);
    only(said, Pictures { expected: a, difference: d, actual: b })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_can_be_pasted() {
        assert_eq!(accept_command("knot", Some("render/turntable-1.png")), "kiln accept knot/render/turntable-1.png");
        assert_eq!(accept_command("old knot's", None), r"kiln accept -- 'old knot'\''s'");
    }
}
