//! Progress on stderr: on a terminal one line that is rewritten, elsewhere plain lines, one per step that was to do.

use std::io::{IsTerminal, Write};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use crate::build::{Outcome, Progress, StepReport};

use super::args::Global;

/// How often the line of a terminal is written anew when nothing happens: times go on.
const TICK: Duration = Duration::from_millis(500);
/// Characters of the line: what fits on a narrow terminal without a break.
const LINE_CHARS: usize = 79;

/// Says on stderr what happens.
pub(super) struct Shown {
    /// Say nothing but failures.
    quiet: bool,
    /// Say why each step runs.
    explain: bool,
    /// Say what is up to date as well.
    verbose: bool,
    /// The line of a terminal.
    live: Option<Arc<Live>>,
}

/// The line that is rewritten; a thread of its own does it, too, until it is over.
struct Live {
    status: Mutex<Status>,
    ended: Condvar,
}

/// How far a run is.
struct Status {
    begun: Instant,
    to_do: usize,
    done: usize,
    running: Vec<String>,
    /// Work of one thread: all that was expected at the beginning, what of it is done, and what of that really ran.
    expected: Duration,
    settled: Duration,
    worked: Duration,
    over: bool,
}

impl Shown {
    pub fn new(global: &Global) -> Self {
        let (quiet, explain, verbose) = (global.quiet, global.explain, global.verbose > 0);
        let terminal = std::io::stderr().is_terminal() && std::env::var_os("CI").is_none();
        let live = (terminal && !quiet && !verbose).then(Live::start);
        Shown { quiet, explain, verbose, live }
    }

    fn say(&self, line: &str) {
        if !self.quiet {
            let _ = writeln!(anstream::stderr(), "{}{line}", if self.live.is_some() { "\r\x1b[2K" } else { "" });
        }
    }
}

impl Drop for Shown {
    fn drop(&mut self) {
        if let Some(live) = &self.live {
            live.lock().over = true;
            live.ended.notify_all();
            let _ = write!(anstream::stderr(), "\r\x1b[2K");
        }
    }
}

impl Live {
    fn start() -> Arc<Live> {
        let live = Arc::new(Live { status: Mutex::new(Status::new(Instant::now())), ended: Condvar::new() });
        let here = live.clone();
        std::thread::spawn(move || {
            let mut status = here.lock();
            while !status.over {
                status.write();
                status = here.ended.wait_timeout(status, TICK).unwrap_or_else(PoisonError::into_inner).0;
            }
        });
        live
    }

    fn lock(&self) -> MutexGuard<'_, Status> {
        self.status.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Status {
    fn new(begun: Instant) -> Self {
        let zero = Duration::ZERO;
        let (expected, settled, worked) = (zero, zero, zero);
        Status { begun, to_do: 0, done: 0, running: Vec::new(), expected, settled, worked, over: false }
    }

    fn write(&self) {
        if self.to_do > 0 && !self.over {
            let mut err = anstream::stderr().lock();
            let _ = write!(err, "\r\x1b[2K{}", self.line(Instant::now()));
            let _ = err.flush();
        }
    }

    /// The time that the rest will take, if it goes on as it went until now. A second of work at the expected speed is
    /// added to what was measured, so that the first steps do not make it jump.
    fn rest(&self, now: Instant) -> Duration {
        let rest = self.expected.saturating_sub(self.settled).as_secs_f64();
        let speed = (self.worked.as_secs_f64() + 1.0) / ((now - self.begun).as_secs_f64() + 1.0);
        // The work that is under way counts as undone, so a single long step would seem to take ever longer.
        Duration::try_from_secs_f64(rest / speed.max(1e-3)).unwrap_or(Duration::MAX)
    }

    /// `[12/87] 0:41, 1:05 to go: knot/rasterise +1`
    fn line(&self, now: Instant) -> String {
        let (elapsed, rest) = (clock(now - self.begun), clock(self.rest(now)));
        let first = self.running.first().map_or("", String::as_str);
        let more = self.running.len().saturating_sub(1);
        let more = if more > 0 { format!(" +{more}") } else { String::new() };
        let line = format!("[{}/{}] {elapsed}, {rest} to go: {first}{more}", self.done, self.to_do);
        line.chars().take(LINE_CHARS).collect()
    }
}

/// `1:05`, `2:00:09`.
fn clock(time: Duration) -> String {
    let s = time.as_secs();
    match s / 3600 {
        0 => format!("{}:{:02}", s / 60, s % 60),
        hours => format!("{hours}:{:02}:{:02}", s / 60 % 60, s % 60),
    }
}

impl Progress for Shown {
    fn begin(&self, up_to_date: usize, to_do: usize, expected: Duration) {
        if self.verbose {
            self.say(&format!("{up_to_date} steps up to date, {to_do} to do"));
        }
        if let Some(live) = &self.live {
            let mut status = live.lock();
            *status = Status { to_do, expected, ..Status::new(Instant::now()) };
        }
    }

    fn start(&self, step: &str, reasons: &[String]) {
        if self.explain {
            self.say(&format!("   why  {step}: {}", reasons.join("; ")));
        }
        if let Some(live) = &self.live {
            let mut status = live.lock();
            status.running.push(step.to_string());
            status.write();
        }
    }

    fn done(&self, step: &StepReport) {
        if let Some(live) = &self.live {
            let mut status = live.lock();
            status.done += 1;
            status.settled += step.expected;
            if matches!(step.outcome, Outcome::Ran | Outcome::Failed(_)) {
                status.worked += step.expected;
            }
            status.running.retain(|name| *name != step.name);
            return status.write();
        }
        let took = step.duration.as_secs_f64();
        match step.outcome {
            Outcome::Ran => self.say(&format!("{took:6.2}s  {}", step.name)),
            Outcome::Restored => self.say(&format!(" cache   {}", step.name)),
            Outcome::UpToDate if self.verbose => self.say(&format!("  same   {}", step.name)),
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rest_follows_from_what_was_done() {
        let begun = Instant::now();
        let secs = Duration::from_secs;
        let mut status = Status { to_do: 8, expected: secs(100), ..Status::new(begun) };
        assert_eq!(status.line(begun), "[0/8] 0:00, 1:40 to go: ");
        // Two threads: 39 seconds of work in 19.
        (status.done, status.settled, status.worked) = (3, secs(39), secs(39));
        status.running = vec!["knot/rasterise".into(), "ring/walk".into()];
        assert_eq!(status.line(begun + secs(19)), "[3/8] 0:19, 0:30 to go: knot/rasterise +1");
        // Up to date after all: less to do, but not quicker.
        status.settled = secs(99);
        assert_eq!(status.rest(begun + secs(39)), secs(1));
        status.running = vec!["x".repeat(200)];
        assert_eq!(status.line(begun).chars().count(), LINE_CHARS);
        assert_eq!(clock(secs(7209)), "2:00:09");
    }
}
