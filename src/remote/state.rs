//! What became of a server in the course of a run: whether it is still asked, what it did, what is on the way to it.
//!
//! Unaware of: messages, connections.

use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

use super::link::Trouble;
use super::{FAILURES, Settings};
use crate::build::Finished;

/// Uploads on the way hold so many bytes at most, or one artefact.
const ON_THE_WAY: u64 = 64 << 20;

/// What was done, in numbers.
#[derive(Clone, Copy, Debug, Default)]
pub struct Counts {
    pub asked: u64,
    pub found: u64,
    pub stored: u64,
    pub executed: u64,
    /// Bytes that came.
    pub down: u64,
    /// Bytes that went.
    pub up: u64,
}

#[derive(Debug, Default)]
struct Books {
    counts: Counts,
    warnings: Vec<String>,
    uploads: u64,
    upload_bytes: u64,
    failures: u32,
}

/// An upload; it ends when this is dropped, however that comes about.
pub struct OnTheWay {
    state: Arc<State>,
    bytes: u64,
    result: Result<(), Trouble>,
}

impl OnTheWay {
    /// Ends the upload.
    pub fn end(mut self, result: Result<(), Trouble>) {
        self.result = result;
    }
}

impl Drop for OnTheWay {
    fn drop(&mut self) {
        self.state.end_upload(self.bytes, std::mem::replace(&mut self.result, Ok(())));
    }
}

/// The state of a server.
#[derive(Debug)]
pub struct State {
    url: String,
    down: AtomicBool,
    no_uploads: AtomicBool,
    no_work: AtomicBool,
    /// Slow answers so far.
    pub slow: AtomicU32,
    books: Mutex<Books>,
    arrived: Condvar,
}

impl State {
    pub fn new(settings: &Settings) -> Self {
        State {
            url: settings.url.clone(),
            down: AtomicBool::new(false),
            no_uploads: AtomicBool::new(!settings.upload),
            no_work: AtomicBool::new(!settings.execute),
            slow: AtomicU32::new(0),
            books: Mutex::default(),
            arrived: Condvar::new(),
        }
    }

    fn books(&self) -> MutexGuard<'_, Books> {
        self.books.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub fn is_down(&self) -> bool {
        self.down.load(Ordering::SeqCst)
    }

    /// Whether results are stored there.
    pub fn uploads(&self) -> bool {
        !self.is_down() && !self.no_uploads.load(Ordering::SeqCst)
    }

    /// Whether workers are asked.
    pub fn works(&self) -> bool {
        !self.is_down() && !self.no_work.load(Ordering::SeqCst)
    }

    /// Asks the server for nothing more; the first reason is the one that is told.
    pub fn give_up(&self, why: &str) {
        self.stop(&self.down, why, "going on without it");
    }

    /// Stores nothing more there.
    pub fn stop_uploads(&self, why: &str) {
        self.stop(&self.no_uploads, why, "storing nothing there");
    }

    /// Asks workers for nothing more.
    pub fn stop_work(&self, why: &str) {
        self.stop(&self.no_work, why, "doing all steps here");
    }

    fn stop(&self, what: &AtomicBool, why: &str, so: &str) {
        if !what.swap(true, Ordering::SeqCst) {
            self.books().warnings.push(format!("{}: {why}; {so}", self.url));
        }
    }

    /// A step came to nothing on a worker.
    pub fn failed(&self, step: &str, trouble: &Trouble) {
        let failures = {
            let mut books = self.books();
            books.failures += 1;
            books.failures
        };
        match trouble {
            Trouble::Lost(_) => self.stop_work(&format!("{step}: {trouble}")),
            _ if failures < FAILURES => {
                self.books().warnings.push(format!("{}: {step}: {trouble}; done here", self.url));
            }
            _ => self.stop_work(&format!("{step}: {trouble}")),
        }
    }

    pub fn count(&self, add: impl FnOnce(&mut Counts)) {
        add(&mut self.books().counts);
    }

    /// Waits for room for an upload of so many bytes.
    pub fn begin_upload(state: &Arc<Self>, bytes: u64) -> OnTheWay {
        let mut books = state.books();
        while books.uploads > 0 && books.upload_bytes + bytes > ON_THE_WAY {
            books = state.arrived.wait(books).unwrap_or_else(PoisonError::into_inner);
        }
        books.uploads += 1;
        books.upload_bytes += bytes;
        let lost = Trouble::Lost("an upload came to no end".to_string());
        OnTheWay { state: state.clone(), bytes, result: Err(lost) }
    }

    fn end_upload(&self, bytes: u64, result: Result<(), Trouble>) {
        match result {
            Ok(()) => {}
            Err(trouble @ (Trouble::Missing | Trouble::Refused(_))) => self.stop_uploads(&trouble.to_string()),
            Err(trouble) => self.give_up(&trouble.to_string()),
        }
        let mut books = self.books();
        books.uploads -= 1;
        books.upload_bytes -= bytes;
        self.arrived.notify_all();
    }

    /// Every upload has a deadline, so this ends.
    pub fn wait_for_uploads(&self) {
        let mut books = self.books();
        while books.uploads > 0 {
            books = self.arrived.wait(books).unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Nothing is said of a server that was not needed.
    pub fn finished(&self) -> Finished {
        let mut books = self.books();
        let Counts { asked, found, stored, executed, down, up } = books.counts;
        let mib = |bytes: u64| bytes as f64 / (1024.0 * 1024.0);
        let said = format!(
            "{}: {found} of {asked} found, {stored} stored, {executed} done by workers; {:.1} MiB down, {:.1} MiB up",
            self.url,
            mib(down),
            mib(up)
        );
        let needed = asked + stored + executed > 0;
        Finished { said: needed.then_some(said), warnings: std::mem::take(&mut books.warnings) }
    }
}
