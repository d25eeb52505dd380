//! Ctrl-C and a request to terminate: the first ends the run in order, the second at once.
//!
//! After the first no further step begins; those under way have a moment to end, so that their work is kept. Nothing is
//! ever half-written, whatever the moment: files appear under their names only when they are whole.
//!
//! Unaware of: what is being done.

use std::sync::Arc;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;

/// What a program that Ctrl-C ended returns in a shell: 128 and the signal's number.
pub(super) const EXIT_CODE: i32 = 130;
/// How long steps under way may take to end.
const GRACE: Duration = Duration::from_secs(2);
const LOOK: Duration = Duration::from_millis(20);

/// The flag that is set when somebody asks for the end. From the first call on, signals are ours.
pub(super) fn flag() -> Arc<AtomicBool> {
    static ASKED: OnceLock<Arc<AtomicBool>> = OnceLock::new();
    ASKED.get_or_init(listen).clone()
}

fn listen() -> Arc<AtomicBool> {
    let asked = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM] {
        // In this order: the first sets the flag, the second finds it set. If the system refuses, signals end the
        // program as they always did.
        let _ = flag::register_conditional_shutdown(signal, EXIT_CODE, asked.clone());
        let _ = flag::register(signal, asked.clone());
    }
    let flag = asked.clone();
    std::thread::spawn(move || {
        while !flag.load(Ordering::Relaxed) {
            std::thread::sleep(LOOK);
        }
        std::thread::sleep(GRACE);
        std::process::exit(EXIT_CODE);
    });
    asked
}
