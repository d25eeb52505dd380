//! `kiln bake`: parse, plan, build, report.

use std::path::Path;

use crate::build::{self, Cache, Outcome, Report, chrome_trace, depfile};
use crate::disk::{Disk, Real};

use super::args::{Bake, Format, Global};
use super::progress::Shown;
use super::project::{self, Loaded};
use super::{Done, Stop};

/// Brings the outputs of recipes up to date.
pub(super) fn run(global: &Global, bake: &Bake) -> Result<Done, Stop> {
    let plain = global.format == Format::Text && global.verbose == 0;
    let plain = plain && global.trace.is_none() && global.depfile.is_none() && bake.recipes.recipes.is_empty();
    if let Some(sealed) = plain.then(|| project::sealed(global)).flatten() {
        return Done::ok(match (global.dry_run, global.quiet) {
            (true, _) => super::plan::nothing_to_do(sealed.steps),
            (false, true) => String::new(),
            (false, false) => nothing_to_do(sealed.outputs),
        });
    }
    let mut loaded = project::load(global, &bake.recipes.recipes)?;
    loaded.options.prune = bake.prune;
    if bake.prune && !loaded.options.whole_tree {
        return Err(Stop::Usage("--prune needs all recipes to be right: what is wrong may have outputs too".into()));
    }
    if global.dry_run {
        return super::plan::show(global, &loaded, false);
    }
    let report = build(global, &loaded)?;
    let success = report.is_success() && loaded.broken.is_empty();
    let tidy = report.warnings.is_empty() && (report.dead_outputs.is_empty() || bake.prune);
    if success && tidy && loaded.options.whole_tree {
        project::seal(global, &loaded);
    }
    let text = summary(global, &loaded, &report);
    if loaded.faulty { Err(Stop::Partly(text)) } else { Ok(Done { text, success }) }
}

/// Runs the graph of loaded recipes; failures are said on stderr and stand in the report.
pub(super) fn build(global: &Global, loaded: &Loaded) -> Result<Report, Stop> {
    let broken: Vec<&str> = loaded.broken.iter().map(|(_, why)| why.as_str()).collect();
    if !broken.is_empty() && !loaded.options.keep_going {
        return Err(Stop::Failed(broken.join("\n")));
    }
    let shown = Shown::new(global);
    let report =
        build::run(&loaded.graph, &[], &loaded.options, &Real, &shown).map_err(|e| Stop::Failed(with_causes(&e)))?;
    drop(shown);
    let say = |text: &str| {
        use std::io::Write;
        let _ = writeln!(anstream::stderr(), "{text}");
    };
    broken.iter().for_each(|why| say(why));
    report.failures().for_each(|failure| say(&failure));
    report.warnings.iter().for_each(|warning| say(&format!("warning: {warning}")));
    for path in &report.changed_inputs {
        say(&format!("warning: {} changed during the bake; run again", path.display()));
    }
    if let Some(said) = report.remote.as_ref().filter(|_| !global.quiet) {
        say(said);
    }
    if !loaded.options.prune && !report.dead_outputs.is_empty() {
        let few: Vec<String> = report.dead_outputs.iter().take(3).map(|path| path.display().to_string()).collect();
        let and = if report.dead_outputs.len() > few.len() { ", ..." } else { "" };
        let (count, few) = (report.dead_outputs.len(), few.join(", "));
        say(&format!(
            "warning: no recipe makes {count} earlier outputs ({few}{and}); `kiln bake --prune` removes them"
        ));
    }
    if let Some(path) = &global.trace {
        write(path, chrome_trace(&report).as_bytes())?;
    }
    if let Some(path) = &global.depfile {
        write(path, depfile(&loaded.graph, &[], &loaded.recipe_files).as_bytes())?;
    }
    trim(loaded, &report).into_iter().for_each(|warning| say(&warning));
    if report.interrupted { Err(Stop::Interrupted) } else { Ok(report) }
}

/// Keeps the cache within the bound of `kiln.toml`, after a run that stored something.
fn trim(loaded: &Loaded, report: &Report) -> Option<String> {
    let max_size = loaded.max_cache.filter(|_| report.ran().next().is_some())?;
    let cache = Cache::new(&Real, &loaded.options.cache);
    let used = build::artefacts(&loaded.options, &Real);
    let result = cache.trim(Some(max_size), None, &used);
    result.err().map(|e| format!("warning: {} cannot be trimmed: {e}", loaded.options.cache.display()))
}

/// Writes a file that was asked for on the command line.
pub(super) fn write(path: &Path, bytes: &[u8]) -> Result<(), Stop> {
    Real.write(path, bytes).map_err(|e| Stop::Failed(format!("cannot write {}: {e}", path.display())))
}

/// An error and its causes in one line.
pub(super) fn with_causes(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(c) = cause {
        text += &format!(": {c}");
        cause = c.source();
    }
    text
}

fn nothing_to_do(outputs: u64) -> String {
    format!("nothing to do: all {outputs} outputs are up to date\n")
}

fn summary(global: &Global, loaded: &Loaded, report: &Report) -> String {
    let written: Vec<_> = report.outputs.iter().filter(|o| o.written).collect();
    if global.format == Format::Json {
        let outputs: Vec<_> = report
            .outputs
            .iter()
            .map(|o| serde_json::json!({"path": o.path, "step": o.step, "written": o.written}))
            .collect();
        let ran: Vec<&str> = report.ran().collect();
        let failed: Vec<String> = loaded.broken.iter().map(|(_, why)| why.clone()).chain(report.failures()).collect();
        return format!(
            "{}\n",
            serde_json::json!({"version": 1, "outputs": outputs, "ran": ran, "failed": failed, "dead": report.dead_outputs})
        );
    }
    if global.quiet {
        return String::new();
    }
    let failed = report.steps.iter().filter(|s| matches!(s.outcome, Outcome::Failed(_))).count() + loaded.broken.len();
    if failed > 0 {
        return format!("{failed} failed; {} outputs written\n", written.len());
    }
    let pruned = loaded.options.prune && !report.dead_outputs.is_empty();
    if report.is_noop() && written.is_empty() && !pruned {
        return nothing_to_do(report.outputs.len() as u64);
    }
    let pruned = report.dead_outputs.iter().filter(|_| loaded.options.prune);
    let mut text: String = pruned.map(|path| format!("removed {}\n", path.display())).collect();
    text += &written.iter().map(|o| format!("{}\n", o.path.display())).collect::<String>();
    let ran = report.ran().count();
    text += &format!(
        "{} of {} outputs written, {ran} steps run in {:.1} s\n",
        written.len(),
        report.outputs.len(),
        report.elapsed.as_secs_f64()
    );
    text
}
