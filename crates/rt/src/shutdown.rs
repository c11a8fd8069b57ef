//! A request to shut down, from a signal or from the program.

use crate::clock::{now, sleep_once};
use crate::error::RtError;
use messages::Stamp;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Longest single sleep. A signal that another thread receives is noticed within 20 ms.
const SLICE_NS: u64 = 20_000_000;
/// Value if the program asked for the shutdown and no signal did.
const BY_PROGRAM: usize = usize::MAX;

/// A flag that SIGINT, SIGTERM or the program raise. Clones share it. The default is one that only the program raises.
#[derive(Clone, Debug, Default)]
pub struct Shutdown {
    cause: Arc<AtomicUsize>,
}

impl Shutdown {
    /// Creates a flag that SIGINT, SIGTERM and SIGHUP (a closed terminal) raise instead of ending the process.
    pub fn on_signals() -> Result<Self, RtError> {
        let shutdown = Self::default();
        for signal in [libc::SIGINT, libc::SIGTERM, libc::SIGHUP] {
            signal_hook::flag::register_usize(signal, Arc::clone(&shutdown.cause), signal as usize)
                .map_err(|source| RtError::Signal { signal, source })?;
        }
        Ok(shutdown)
    }

    /// Raises the flag.
    pub fn request(&self) {
        let _ = self.cause.compare_exchange(0, BY_PROGRAM, Ordering::Relaxed, Ordering::Relaxed);
    }

    /// Returns true if a shutdown was requested.
    pub fn requested(&self) -> bool {
        self.cause.load(Ordering::Relaxed) != 0
    }

    /// Returns the signal that requested it. A process that SIGINT ends exits with 128 + 2.
    pub fn signal(&self) -> Option<i32> {
        match self.cause.load(Ordering::Relaxed) {
            0 | BY_PROGRAM => None,
            signal => Some(signal as i32),
        }
    }

    /// Sleeps until `deadline`. Returns false if a shutdown was requested before or during the sleep.
    pub fn sleep_until(&self, deadline: Stamp) -> bool {
        loop {
            if self.requested() {
                return false;
            }
            let slice_end = deadline.min(now().plus_ns(SLICE_NS));
            if sleep_once(slice_end) && slice_end == deadline {
                return true;
            }
        }
    }

    /// Watches the clock until `deadline`. Returns false if a shutdown was requested before or meanwhile.
    pub(crate) fn spin_until(&self, deadline: Stamp) -> bool {
        loop {
            if self.requested() {
                return false;
            }
            if now() >= deadline {
                return true;
            }
            std::hint::spin_loop();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shutdown_request_ends_long_sleep() {
        let shutdown = Shutdown::default();
        let other = shutdown.clone();
        let sleeper = std::thread::spawn(move || other.sleep_until(now().plus_ns(3_600_000_000_000)));
        shutdown.request();
        assert!(!sleeper.join().expect("the sleeper does not panic"));
        assert!(shutdown.requested());
        assert_eq!(shutdown.signal(), None);
    }

    #[test]
    fn undisturbed_sleep_reaches_its_deadline() {
        let deadline = now().plus_ns(SLICE_NS + SLICE_NS / 2);
        assert!(Shutdown::default().sleep_until(deadline));
        assert!(now() >= deadline);
    }

    #[test]
    fn signal_requests_shutdown_and_is_remembered() {
        let shutdown = Shutdown::on_signals().expect("handlers can be installed");
        assert!(!shutdown.requested());
        signal_hook::low_level::raise(libc::SIGTERM).expect("a process may signal itself");
        assert!(shutdown.requested());
        assert_eq!(shutdown.signal(), Some(libc::SIGTERM));
        shutdown.request();
        assert_eq!(shutdown.signal(), Some(libc::SIGTERM), "the first cause stays");
    }
}
