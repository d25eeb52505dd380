//! The command line: what was typed becomes a call, what came of it becomes text and an exit code.
//!
//! Results go to stdout, everything else to stderr. Exit codes: 0 done or up to date, 1 a bake or a golden failed, 2 the
//! command or a recipe is wrong, 130 interrupted. One file per verb.

pub mod args;
mod bake;
mod cache;
mod check;
mod farm;
mod init;
mod inspect;
mod interrupt;
mod marker;
mod plan;
mod progress;
mod project;
mod shader;
mod synth;
pub mod synth_inputs;
mod watch;

use std::io::Write;
use std::process::ExitCode;

use clap::{CommandFactory, Parser};

use args::{Cli, Color, Format, Global, Verb};

/// Why a verb ended without its result.
enum Stop {
    /// The command or a recipe is wrong; what to say on stderr.
    Usage(String),
    /// The work failed; what to say on stderr.
    Failed(String),
    /// A recipe is wrong, and the others were gone on with; what to say on stdout.
    Partly(String),
    /// Somebody asked for the end.
    Interrupted,
}

/// What a verb came to: text for stdout and whether all is well.
struct Done {
    text: String,
    success: bool,
}

impl Done {
    fn ok(text: impl Into<String>) -> Result<Done, Stop> {
        Ok(Done { text: text.into(), success: true })
    }
}

/// Runs the command line and returns its exit code.
pub fn main() -> ExitCode {
    let cli = Cli::parse();
    let global = &cli.global;
    match global.color {
        Color::Auto => {}
        Color::Always => anstream::ColorChoice::Always.write_global(),
        Color::Never => anstream::ColorChoice::Never.write_global(),
    }
    // A panic is a bug; one line says where, the engine says in which step.
    std::panic::set_hook(Box::new(|info| {
        let _ = writeln!(anstream::stderr(), "kiln: {info}");
    }));
    if let Some(folder) = &global.directory
        && let Err(e) = std::env::set_current_dir(folder)
    {
        return stop(Stop::Usage(format!("cannot go to {}: {e}", folder.display())));
    }
    if global.format == Format::Ninja && !matches!(cli.verb, Verb::Plan(_)) {
        return stop(Stop::Usage("only `kiln plan` has the form `ninja`; expected text or json".into()));
    }
    let result = match &cli.verb {
        Verb::Bake(bake) => bake::run(global, bake),
        Verb::Watch(recipes) => watch::run(global, recipes),
        Verb::Check(check) => check::check(global, check),
        Verb::Accept(accept) => check::accept(global, accept),
        Verb::Plan(plan) => plan::run(global, plan),
        Verb::Synth(synth) => synth::run(global, synth),
        Verb::Init(init) => init::run(global, init),
        Verb::Inspect(inspect) => inspect::run(global, inspect),
        Verb::Cache(cache) => cache::run(global, cache),
        Verb::Step(step) => farm::step(&step.key),
        Verb::Schema => Done::ok(crate::recipe::json_schema() + "\n"),
        Verb::Shader(language) => shader::run(language.language),
        Verb::Completions(completions) => {
            let mut text = Vec::new();
            clap_complete::generate(completions.shell, &mut Cli::command(), "kiln", &mut text);
            Done::ok(String::from_utf8_lossy(&text))
        }
    };
    match result {
        Ok(done) => {
            let mut out = anstream::stdout().lock();
            match out.write_all(done.text.as_bytes()).and_then(|()| out.flush()) {
                // A closed pipe (such as of `kiln plan | head`) is no failure.
                Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => {
                    stop(Stop::Failed(format!("cannot write to standard output: {e}")))
                }
                _ if done.success => ExitCode::SUCCESS,
                _ => ExitCode::from(1),
            }
        }
        Err(why) => stop(why),
    }
}

fn stop(why: Stop) -> ExitCode {
    let (text, code) = match why {
        Stop::Usage(text) => (text, 2),
        Stop::Failed(text) => (text, 1),
        Stop::Interrupted => ("interrupted; what is done is kept".to_string(), interrupt::EXIT_CODE),
        Stop::Partly(text) => {
            let _ = anstream::stdout().write_all(text.as_bytes());
            (String::new(), 2)
        }
    };
    let mut err = anstream::stderr().lock();
    for line in text.trim_end().lines() {
        let _ = writeln!(err, "{line}");
    }
    ExitCode::from(code as u8)
}

/// How many threads to use.
fn jobs(global: &Global) -> usize {
    global.jobs.map_or_else(|| std::thread::available_parallelism().map_or(1, usize::from), usize::from)
}
