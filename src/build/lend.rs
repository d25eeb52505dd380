//! Threads that somebody else lends: a pool whose threads join in one by one, as GNU make gives its tokens.
//!
//! All threads are there from the beginning, but each beyond the first is held up in a job of its own until there is a
//! token for it. The tokens go back when the run ends.
//!
//! Unaware of: steps, where tokens come from.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Duration;

use crate::disk::Jobserver;

/// How often a thread asks again. Tokens come when other programs end, which takes longer.
const ASK: Duration = Duration::from_millis(20);

/// Ends the lending when it is dropped.
pub(super) struct Lending {
    jobserver: Arc<Jobserver>,
    over: Arc<AtomicBool>,
    /// How many threads are held up.
    held_up: Arc<AtomicUsize>,
}

impl Drop for Lending {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Release);
        while self.held_up.load(Ordering::Acquire) > 0 {
            std::thread::sleep(ASK / 10);
        }
        self.jobserver.give_back();
    }
}

/// Holds up all threads of an idle pool but the first until `jobserver` lends one for each; `count` is told of each.
/// Waits until they are held up.
pub(super) fn lend(
    pool: &rayon::ThreadPool,
    jobserver: Arc<Jobserver>,
    count: impl Fn() + Send + Sync + 'static,
) -> Lending {
    let over = Arc::new(AtomicBool::new(false));
    let held_up = Arc::new(AtomicUsize::new(0));
    let arrived = Arc::new(AtomicUsize::new(0));
    let lending = Lending { jobserver: jobserver.clone(), over: over.clone(), held_up: held_up.clone() };
    let (here, threads) = (arrived.clone(), pool.current_num_threads());
    pool.spawn_broadcast(move |thread| {
        held_up.fetch_add(1, Ordering::Release);
        here.fetch_add(1, Ordering::Release);
        while thread.index() > 0 && !over.load(Ordering::Acquire) {
            if jobserver.take() {
                count();
                break;
            }
            std::thread::sleep(ASK);
        }
        held_up.fetch_sub(1, Ordering::Release);
    });
    while arrived.load(Ordering::Acquire) < threads {
        std::thread::yield_now();
    }
    lending
}
