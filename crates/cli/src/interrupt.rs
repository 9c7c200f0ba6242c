//! Ctrl-C and requests to end.

use std::sync::atomic::AtomicBool;
use std::sync::{Arc, OnceLock};

use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag::{register, register_conditional_shutdown};

/// Exit code of a program that a second Ctrl-C ended at once, as shells have it.
const ENDED_AT_ONCE: i32 = 130;

/// From the first call on, Ctrl-C (SIGINT) and SIGTERM set the flag, and a second one ends the program at once.
///
/// SIGHUP keeps its meaning, so that `nohup` does what it should.
pub(crate) fn flag() -> &'static AtomicBool {
    static FLAG: OnceLock<Arc<AtomicBool>> = OnceLock::new();
    FLAG.get_or_init(|| {
        let flag = Arc::new(AtomicBool::new(false));
        for signal in [SIGINT, SIGTERM] {
            // In this order: a signal that finds the flag set is the second one. Where the system refuses,
            // signals end the program as they did before.
            let _ = register_conditional_shutdown(signal, ENDED_AT_ONCE, Arc::clone(&flag))
                .and_then(|_| register(signal, Arc::clone(&flag)));
        }
        flag
    })
}
