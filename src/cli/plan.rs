//! `kiln plan`: what would run, and why.

use crate::build::{self, State, to_dot, to_json};
use crate::disk::Real;

use super::args::{Format, Global, Plan};
use super::project::{self, Loaded};
use super::{Done, Stop};

/// Shows the plan of recipes.
pub(super) fn run(global: &Global, plan: &Plan) -> Result<Done, Stop> {
    let loaded = project::load(global, &plan.recipes.recipes)?;
    show(global, &loaded, plan.graph)
}

/// The plan as text, JSON or DOT.
pub(super) fn show(global: &Global, loaded: &Loaded, graph: bool) -> Result<Done, Stop> {
    let steps = build::plan(&loaded.graph, &[], &loaded.options, &Real)
        .map_err(|e| Stop::Failed(super::bake::with_causes(&e)))?;
    let mut success = loaded.broken.is_empty();
    if graph || global.format == Format::Json {
        for (_, why) in &loaded.broken {
            use std::io::Write;
            let _ = writeln!(anstream::stderr(), "{why}");
        }
    }
    if graph {
        return Ok(Done { text: to_dot(&steps), success });
    }
    if global.format == Format::Json {
        return Ok(Done { text: to_json(&steps) + "\n", success });
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
    if text.is_empty() {
        text = format!("nothing to do: all {} steps are up to date\n", steps.len());
    }
    Ok(Done { text, success })
}
