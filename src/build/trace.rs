//! A run as a Chrome trace: opens in Perfetto and in chrome://tracing.
//!
//! Unaware of: anything but the report.

use std::time::Duration;

use serde_json::{Value, json};

use super::report::{Outcome, Report, StepReport};

/// Trace of a run, in the JSON object form. One complete event (`X`) per step that was not simply up to date: name,
/// kind as category, microseconds, thread; `args` tell whether it came from the cache, why, how many bytes it has
/// and what it counted.
pub fn chrome_trace(report: &Report) -> String {
    let worked = |step: &&StepReport| step.duration > Duration::ZERO;
    let mut events: Vec<Value> = report.steps.iter().filter(worked).map(event).collect();
    let mut threads: Vec<usize> = report.steps.iter().filter(worked).map(|step| step.thread).collect();
    threads.sort_unstable();
    threads.dedup();
    for thread in threads {
        let name = json!({"name": format!("worker {thread}")});
        events.push(json!({"name": "thread_name", "ph": "M", "pid": 1, "tid": thread, "args": name}));
    }
    json!({"displayTimeUnit": "ms", "traceEvents": events}).to_string()
}

fn event(step: &StepReport) -> Value {
    let from_cache = matches!(step.outcome, Outcome::UpToDate | Outcome::Restored);
    json!({
        "name": step.name,
        "cat": step.kind,
        "ph": "X",
        "ts": step.start.as_micros() as u64,
        "dur": step.duration.as_micros() as u64,
        "pid": 1,
        "tid": step.thread,
        "args": {
            "from_cache": from_cache,
            "failed": matches!(step.outcome, Outcome::Failed(_)),
            "reasons": step.reasons,
            "bytes": step.len,
            "counters": step.counters.iter().map(|(name, n)| (name.to_string(), json!(n))).collect::<serde_json::Map<_, _>>(),
        },
    })
}
