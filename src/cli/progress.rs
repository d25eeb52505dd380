//! Progress on stderr: plain lines, one per step that was to do.

use std::io::Write;

use crate::build::{Outcome, Progress, StepReport};

use super::args::Global;

/// Says on stderr what happens.
pub(super) struct Lines {
    /// Say nothing but failures.
    pub quiet: bool,
    /// Say why each step runs.
    pub explain: bool,
    /// Say what is up to date as well.
    pub verbose: bool,
}

impl Lines {
    pub fn new(global: &Global) -> Self {
        Lines { quiet: global.quiet, explain: global.explain, verbose: global.verbose > 0 }
    }

    fn say(&self, line: &str) {
        if !self.quiet {
            let _ = writeln!(anstream::stderr(), "{line}");
        }
    }
}

impl Progress for Lines {
    fn begin(&self, up_to_date: usize, to_do: usize) {
        if self.verbose {
            self.say(&format!("{up_to_date} steps up to date, {to_do} to do"));
        }
    }

    fn start(&self, step: &str, reasons: &[String]) {
        if self.explain {
            self.say(&format!("   why  {step}: {}", reasons.join("; ")));
        }
    }

    fn done(&self, step: &StepReport) {
        let took = step.duration.as_secs_f64();
        match step.outcome {
            Outcome::Ran => self.say(&format!("{took:6.2}s  {}", step.name)),
            Outcome::Restored => self.say(&format!(" cache   {}", step.name)),
            Outcome::UpToDate if self.verbose => self.say(&format!("  same   {}", step.name)),
            _ => {}
        }
    }
}
