//! `kiln check --twice`: the same steps again in a fresh process with another number of threads, artefact by artefact.
//!
//! The other process bakes into a folder of its own with a cache of its own, so nothing that this one made can reach it.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use crate::build::{self, Cache, Report, Silent};
use crate::disk::{Disk, Real};
use crate::golden::report::{Entry, Status};

use super::baked::{Known, short};
use super::failed;
use crate::cli::args::{Check, Global};
use crate::cli::bake::{with_causes, write};
use crate::cli::project::{OWN, load_into};
use crate::cli::{Done, Stop, jobs};

/// A list of artefacts takes about a hundred bytes for a step.
const LIST_LIMIT: u64 = 1 << 30;

fn folder() -> PathBuf {
    Path::new(OWN).join("twice")
}

/// Compares the steps of a finished bake with what another process makes of them.
pub(super) fn compare(global: &Global, check: &Check, report: &Report) -> Result<Vec<Entry>, Stop> {
    let held = Real.try_lock(&Path::new(OWN).join("twice.lock")).map_err(failed)?;
    if held.is_none() {
        return Err(Stop::Failed("another `kiln check --twice` is at work here; wait for it".into()));
    }
    let threads = match jobs(global) {
        1 => 2,
        n => n / 2,
    };
    if !global.quiet {
        use std::io::Write;
        let _ = writeln!(anstream::stderr(), "baking again in another process with {threads} thread(s)");
    }
    let list = folder().join("artefacts.json");
    let program = std::env::current_exe().map_err(|e| failed(format!("kiln does not find itself: {e}")))?;
    let mut command = Command::new(program);
    command.args(["check", "--quiet", "--jobs", &threads.to_string(), "--artefacts"]).arg(&list).arg("--");
    command.args(&check.recipes.recipes).stdin(Stdio::null()).stdout(Stdio::null());
    let status = command.status().map_err(|e| failed(format!("cannot start kiln again: {e}")))?;
    let found = Real.read(&list, LIST_LIMIT).ok().filter(|_| status.code().is_some_and(|c| c < 2));
    let found = found.and_then(|bytes| serde_json::from_slice::<BTreeMap<String, String>>(&bytes).ok());
    clean()?;
    let found = found.ok_or_else(|| failed(format!("the other process ended with {status} and no list")))?;
    Ok(differing(&Known::of(report).artefacts, &order(report), &found, [jobs(global), threads]))
}

fn order(report: &Report) -> Vec<&str> {
    report.steps.iter().map(|s| s.name.as_str()).collect()
}

/// An entry for each step whose artefact is another one there, in the order of the graph: the first is where it begins.
fn differing(
    here: &BTreeMap<&str, String>,
    order: &[&str],
    there: &BTreeMap<String, String>,
    [threads, others]: [usize; 2],
) -> Vec<Entry> {
    let mut entries: Vec<Entry> = Vec::new();
    for name in order {
        let Some(artefact) = here.get(name) else { continue };
        let said = match there.get(*name) {
            Some(other) if other == artefact => continue,
            Some(other) => {
                format!("gave {artefact} with {threads} thread(s) and {other} with {others} in another process")
            }
            None => "gave nothing in another process".to_string(),
        };
        let recipe = name.split_once('/').map_or("", |(recipe, _)| recipe).to_string();
        let is_first = entries.iter().all(|e| e.recipe != recipe);
        let begins = if is_first { "the first step that is not the same twice\n" } else { "" };
        entries.push(Entry {
            recipe,
            output: format!("step {}", short(name)),
            kind: "step",
            status: Status::Unstable,
            message: format!("{begins}{said}"),
            ..Entry::default()
        });
    }
    entries
}

/// The other process: bakes every step afresh and writes which artefacts they gave.
pub(super) fn list(global: &Global, check: &Check, file: &Path) -> Result<Done, Stop> {
    let mut loaded = load_into(global, &check.recipes.recipes, &folder().join("out"))?;
    loaded.options.cache = folder().join("cache");
    loaded.options.manifest = folder().join("manifest");
    loaded.options.force = true;
    loaded.options.remote = None;
    loaded.options.keep_going = true;
    let report = build::run(&loaded.graph, &[], &loaded.options, &Real, &Silent);
    let report = report.map_err(|e| Stop::Failed(with_causes(&e)))?;
    let list: BTreeMap<&str, String> = Known::of(&report).artefacts;
    write(file, serde_json::to_string(&list).map_err(failed)?.as_bytes())?;
    Ok(Done { text: String::new(), success: report.is_success() })
}

/// Takes away what the other process left.
fn clean() -> Result<(), Stop> {
    let say = |e: std::io::Error| failed(format!("{}: {e}", folder().display()));
    Cache::new(&Real, folder().join("cache")).clear().map_err(say)?;
    Real.list(&folder()).map_err(say)?.iter().try_for_each(|file| Real.remove(file)).map_err(say)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_that_differ_are_named_in_the_order_of_the_graph() {
        let here: BTreeMap<&str, String> =
            [("a/maps", "1"), ("a/walk", "2"), ("a/glb", "3"), ("b/walk", "4")].map(|(n, d)| (n, d.to_string())).into();
        let order = ["a/maps", "a/walk", "a/glb", "b/walk", "b/failed"];
        let same: BTreeMap<String, String> = here.iter().map(|(n, d)| (n.to_string(), d.clone())).collect();
        assert!(differing(&here, &order, &same, [4, 2]).is_empty());
        let mut other = same;
        other.insert("a/walk".into(), "7".into());
        other.insert("a/glb".into(), "8".into());
        other.remove("b/walk");
        let found = differing(&here, &order, &other, [4, 2]);
        let names: Vec<(&str, &str)> = found.iter().map(|e| (e.recipe.as_str(), e.output.as_str())).collect();
        assert_eq!(names, [("a", "step walk"), ("a", "step glb"), ("b", "step walk")]);
        assert!(found[0].message.starts_with("the first step") && found[0].message.contains("2 with 4 thread(s)"));
        assert!(!found[1].message.starts_with("the first step"));
        assert!(found[2].message.contains("gave nothing") && found.iter().all(|e| e.status.is_failure()));
    }
}
