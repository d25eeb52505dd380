//! `kiln check` and `kiln accept`: bake, then compare with `golden/`, or make it golden.
//!
//! `golden/<recipe>.toml` is the book; beside it, in `golden/<recipe>/`, lies a small picture of every image: renders
//! whole, maps as thumbnails. `.kiln/golden/` keeps the accepted files of this machine under their digests, so that a
//! mismatch can be shown in full where the outputs were accepted here.

mod accept;
mod baked;
mod judge;
mod shelf;
mod twice;

use crate::build::Report;
use crate::golden::report::{Entry, Findings, Status, Times, html, json, junit};
use crate::io::image_file::Limits;
use crate::recipe::Recipe;
use crate::stage::plan::Planned;

use super::args::{Check, Format, Global};
use super::bake::{build, write};
use super::project::{self, Loaded};
use super::{Done, Stop};
use baked::{Known, short};

pub(super) use accept::run as accept;

/// Largest output that is read back, in bytes.
const OUTPUT_LIMIT: u64 = 4 << 30;
/// Outputs may be larger than what is taken from strangers: the file was bounded before.
const OWN_IMAGES: Limits = Limits { max_side: u32::MAX, max_bytes: OUTPUT_LIMIT };
/// Side of the thumbnails of maps.
const THUMB: u32 = 96;
/// Side of a panel of expected / difference / actual.
const PANEL: u32 = 768;

fn failed(what: impl std::fmt::Display) -> Stop {
    Stop::Failed(what.to_string())
}

/// `kiln check`.
pub(super) fn check(global: &Global, check: &Check) -> Result<Done, Stop> {
    if let Some(file) = &check.artefacts {
        return twice::list(global, check, file);
    }
    let mut loaded = project::load(global, &check.recipes.recipes)?;
    if global.dry_run {
        return super::plan::show(global, &loaded, false);
    }
    // Nothing that is remembered is trusted: a step whose revision was forgotten shows.
    loaded.options.force = true;
    // One recipe that fails does not hide how the others stand.
    loaded.options.keep_going = true;
    let report = build(global, &loaded)?;
    let mut success = report.is_success() && loaded.broken.is_empty();
    let (known, mut entries) = (Known::of(&report), Vec::new());
    for (recipe, why) in &loaded.broken {
        entries.push(failure(recipe, why));
    }
    for planned in &loaded.planned {
        if is_built(planned, &loaded, &known) {
            let recipe = recipe_of(&loaded, &planned.name)?;
            entries.extend(judge::judge(planned, recipe, &loaded, &known)?);
        } else {
            entries.push(failure(&planned.name, &why_failed(planned, &loaded, &report)));
        }
    }
    if check.recipes.recipes.is_empty() {
        entries.extend(stale()?);
    }
    if check.twice {
        entries.extend(twice::compare(global, check, &report)?);
    }
    // What was found about a recipe stands together, whoever found it.
    let mut recipes: Vec<String> = Vec::new();
    for entry in &entries {
        if !recipes.contains(&entry.recipe) {
            recipes.push(entry.recipe.clone());
        }
    }
    entries.sort_by_key(|e| recipes.iter().position(|r| *r == e.recipe));
    success &= !entries.iter().any(|e| e.status.is_failure());
    let findings = Findings { entries, times: times(&loaded, &report), seconds: report.elapsed.as_secs_f64() };
    if let Some(path) = &check.report {
        write(path, html(&findings).as_bytes())?;
    }
    if let Some(path) = &check.junit {
        write(path, junit(&findings).as_bytes())?;
    }
    Ok(Done { text: verdicts(global, &findings), success })
}

/// The recipe of a name.
fn recipe_of<'a>(loaded: &'a Loaded, name: &str) -> Result<&'a Recipe, Stop> {
    loaded.recipes.iter().find(|r| r.name == name).ok_or_else(|| failed(format!("{name}: its recipe is gone")))
}

/// A recipe without outputs to compare.
fn failure(recipe: &str, why: &str) -> Entry {
    let (recipe, message) = (recipe.to_string(), why.to_string());
    Entry { recipe, output: "bake".into(), kind: "bake", status: Status::Failed, message, ..Entry::default() }
}

/// Whether all steps of a recipe were done.
fn is_built(planned: &Planned, loaded: &Loaded, known: &Known) -> bool {
    planned.steps.iter().all(|id| known.artefacts.contains_key(loaded.graph.name(*id)))
}

/// The failures of a recipe's steps.
fn why_failed(planned: &Planned, loaded: &Loaded, report: &Report) -> String {
    let of_recipe = |failure: &String| {
        planned.steps.iter().any(|id| failure.starts_with(&format!("step `{}`:", loaded.graph.name(*id))))
    };
    let why: Vec<String> = report.failures().filter(of_recipe).collect();
    [vec!["could not be baked".to_string()], why].concat().join("\n")
}

/// Goldens of what is gone.
fn stale() -> Result<Vec<Entry>, Stop> {
    let entry = |s: shelf::Stale| Entry {
        recipe: s.recipe,
        output: s.file.display().to_string(),
        kind: "golden",
        status: Status::Stale,
        message: format!("{}; remove it by: kiln accept --prune", s.why),
        accept: "kiln accept --prune".into(),
        ..Entry::default()
    };
    Ok(shelf::stale()?.into_iter().map(entry).collect())
}

/// How long the steps of each recipe took; a shared one counts for the first.
fn times(loaded: &Loaded, report: &Report) -> Vec<Times> {
    let mut counted = std::collections::BTreeSet::new();
    let took: std::collections::BTreeMap<&str, f64> =
        report.steps.iter().map(|s| (s.name.as_str(), s.duration.as_secs_f64())).collect();
    let mut of = |planned: &Planned| {
        let new = planned.steps.iter().filter(|id| counted.insert(**id)).map(|id| loaded.graph.name(*id));
        let steps = new.filter_map(|name| Some((short(name).to_string(), *took.get(name)?))).collect();
        Times { recipe: planned.name.clone(), steps }
    };
    loaded.planned.iter().map(&mut of).collect()
}

fn verdicts(global: &Global, findings: &Findings) -> String {
    if global.format == Format::Json {
        return format!("{}\n", json(findings));
    }
    let entries = &findings.entries;
    let mut text = String::new();
    for e in entries.iter().filter(|e| e.status != Status::Same || global.verbose > 0) {
        text += &format!("{:9} {}/{}\n", e.status.name(), e.recipe, e.output);
        for line in e.told().lines() {
            text += &format!("          {line}\n");
        }
    }
    if !global.quiet {
        text += &match entries.iter().filter(|e| e.status.is_failure()).count() {
            0 => format!("{} outputs are as accepted\n", entries.len()),
            n => format!("{n} of {} outputs are not as accepted\n", entries.len()),
        };
    }
    text
}
