//! `kiln plan`: what would run, and why.

use std::path::Path;

use crate::build::{self, State, to_dot, to_json};
use crate::disk::Real;

use super::args::{Format, Global, Plan};
use super::project::{self, Loaded};
use super::{Done, Stop};

/// Shows the plan of recipes.
pub(super) fn run(global: &Global, plan: &Plan) -> Result<Done, Stop> {
    // Planning writes nothing.
    let global = &Global { dry_run: true, ..global.clone() };
    let plain = global.format == Format::Text && global.verbose == 0 && !plan.graph;
    if plain
        && plan.recipes.recipes.is_empty()
        && let Some(sealed) = project::sealed(global)
    {
        return Done::ok(nothing_to_do(sealed.steps));
    }
    let loaded = project::load(global, &plan.recipes.recipes)?;
    show(global, &loaded, plan.graph)
}

/// The plan as text, JSON or DOT.
pub(super) fn show(global: &Global, loaded: &Loaded, graph: bool) -> Result<Done, Stop> {
    let steps = build::plan(&loaded.graph, &[], &loaded.options, &Real)
        .map_err(|e| Stop::Failed(super::bake::with_causes(&e)))?;
    let dead = build::dead_outputs(&loaded.graph, &loaded.options, &Real);
    let dead = dead.map_err(|e| Stop::Failed(super::bake::with_causes(&e)))?;
    let mut success = loaded.broken.is_empty();
    if graph || global.format != Format::Text {
        for (_, why) in &loaded.broken {
            use std::io::Write;
            let _ = writeln!(anstream::stderr(), "{why}");
        }
    }
    if graph {
        return Ok(Done { text: to_dot(&steps), success });
    }
    if global.format == Format::Json {
        return Ok(Done { text: to_json(&steps, &dead) + "\n", success });
    }
    if global.format == Format::Ninja {
        return Ok(Done { text: ninja(global, loaded), success });
    }
    let mut text = String::new();
    for (_, why) in &loaded.broken {
        text += &format!("broken   {why}\n");
    }
    for step in &steps {
        let why = match &step.state {
            State::UpToDate if global.verbose == 0 => continue,
            State::Maybe(on) => format!("if {} changes", on.join(" or ")),
            state => state.reasons().join("; "),
        };
        success &= !matches!(step.state, State::Broken(_));
        text += &format!("{:8} {}{}{why}\n", step.state.word(), step.name, if why.is_empty() { "" } else { ": " });
    }
    for path in &dead {
        text += &format!("dead     {}: no recipe makes it; `kiln bake --prune` removes it\n", path.display());
    }
    if text.is_empty() {
        text = nothing_to_do(steps.len() as u64);
    }
    Ok(Done { text, success })
}

pub(super) fn nothing_to_do(steps: u64) -> String {
    format!("nothing to do: all {steps} steps are up to date\n")
}

/// The recipes as rules for Ninja, each with its outputs and all that they are made from. Every rule bakes one recipe
/// with one thread; what recipes share is made by whoever comes first, and the cache hands it to the others.
fn ninja(global: &Global, loaded: &Loaded) -> String {
    let flags = global.cache.as_ref().map_or(String::new(), |cache| format!(" --cache {}", quoted(cache)));
    let mut text = String::from("ninja_required_version = 1.7\n\nrule bake\n");
    text += &format!("  command = kiln bake -q -j 1{flags} -- $recipe\n");
    text += "  description = kiln $recipe\n  restat = 1\n";
    for planned in &loaded.planned {
        let outputs: Vec<String> = planned.outputs.iter().filter_map(|path| escaped(path)).collect();
        let files = loaded.graph.files_of(&planned.steps);
        let shared = loaded.recipe_files.iter().filter(|file| **file == Path::new("kiln.toml"));
        let inputs: Vec<String> = files.chain(shared.map(|file| &**file)).filter_map(escaped).collect();
        let Some(recipe) = escaped(&planned.recipe) else { continue };
        text += &format!("\nbuild {}: bake {recipe} | {}\n", outputs.join(" "), inputs.join(" "));
        text += &format!("  recipe = {}\n", quoted(&planned.recipe).replace('$', "$$"));
    }
    text
}

/// A path in a rule; `None` if Ninja cannot say it.
fn escaped(path: &Path) -> Option<String> {
    let text = path.to_str().filter(|text| !text.contains('\n'))?;
    Some(text.replace('$', "$$").replace(' ', "$ ").replace(':', "$:"))
}

/// A path in a command.
fn quoted(path: &Path) -> String {
    format!("'{}'", path.display().to_string().replace('\'', "'\\''"))
}
