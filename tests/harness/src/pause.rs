//! Pauses of this machine. A test of real time that fails because the machine paused runs again.

use std::cell::RefCell;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Period of the thread that measures the pauses.
const PERIOD: Duration = Duration::from_millis(5);
/// Pause that every test bears. It is the shortest silence that changes a motion without real-time scheduling
/// (`safety.input_late_ms`).
const BEARABLE: Duration = Duration::from_millis(50);
/// Number of times that a test runs.
const RUNS_MAX: u32 = 4;

thread_local! {
    /// The meter of the test that this thread runs.
    static METER: RefCell<Option<Arc<Meter>>> = const { RefCell::new(None) };
}

/// The longest pause so far.
#[derive(Default)]
struct Meter {
    longest_ns: AtomicU64,
    end: AtomicBool,
    /// The failure stands, whatever the pauses were.
    is_final: AtomicBool,
}

impl Meter {
    /// Sleeps to absolute deadlines from `deadline` to `end`, and keeps the longest oversleep.
    fn measure(&self, mut deadline: Instant) {
        while !self.end.load(Ordering::Relaxed) {
            deadline += PERIOD;
            // The oversleep is what is measured here.
            std::thread::sleep(deadline.saturating_duration_since(Instant::now()));
            let late = deadline.elapsed();
            self.longest_ns.fetch_max(late.as_nanos() as u64, Ordering::Relaxed);
            deadline += late;
        }
        // A pause may lie between the last look and the end.
        self.longest_ns.fetch_max(deadline.elapsed().as_nanos() as u64, Ordering::Relaxed);
    }

    fn longest(&self) -> Duration {
        Duration::from_nanos(self.longest_ns.load(Ordering::Relaxed))
    }
}

/// Forgets the pauses before now, because the test of this thread begins only now.
pub(crate) fn forget() {
    METER.with_borrow(|meter| meter.iter().for_each(|meter| meter.longest_ns.store(0, Ordering::Relaxed)));
}

/// Asserts what must hold beside any pause. A robot that broke a limit is never excused, and the test never runs again.
#[track_caller]
pub fn assert_always(is_met: bool, text: impl std::fmt::Display) {
    if !is_met {
        METER.with_borrow(|meter| meter.iter().for_each(|meter| meter.is_final.store(true, Ordering::Relaxed)));
        panic!("{text}");
    }
}

/// Runs the body of a test of real time. If it fails after a pause of this machine that no test bears, it says so and
/// runs again, `RUNS_MAX` times in all. A failure without such a pause stands, and one of [`assert_always`].
pub fn in_real_time(body: impl Fn()) {
    let run = || {
        let meter = Arc::new(Meter::default());
        let (measured, begun) = (meter.clone(), Instant::now());
        let thread = std::thread::spawn(move || measured.measure(begun));
        METER.set(Some(meter.clone()));
        let outcome = catch_unwind(AssertUnwindSafe(&body));
        METER.set(None);
        meter.end.store(true, Ordering::Relaxed);
        let _ = thread.join();
        let excuse = if meter.is_final.load(Ordering::Relaxed) { Duration::ZERO } else { meter.longest() };
        (outcome, excuse)
    };
    repeat(run);
}

/// Repeats a run that failed after a pause. A run returns its outcome and the longest pause.
fn repeat(run: impl Fn() -> (std::thread::Result<()>, Duration)) {
    for number in 1..=RUNS_MAX {
        let (Err(failure), longest) = run() else { return };
        if longest <= BEARABLE || number == RUNS_MAX {
            resume_unwind(failure);
        }
        let (longest, bearable) = (longest.as_millis(), BEARABLE.as_millis());
        println!("this machine paused for {longest} ms, and the test bears {bearable} ms: run {} of it", number + 1);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SOON;
    use std::cell::Cell;
    use std::process::Command;

    /// Returns the number of runs of a body that always fails, and true if its failure came out.
    fn runs_with_pauses_of(pause: Duration) -> (u32, bool) {
        let runs = Cell::new(0);
        let run = || {
            runs.set(runs.get() + 1);
            (catch_unwind(|| panic!("as every run")), pause)
        };
        let failed = catch_unwind(AssertUnwindSafe(|| repeat(run))).is_err();
        (runs.get(), failed)
    }

    #[test]
    fn failure_without_a_pause_stands_and_one_with_a_pause_is_repeated() {
        assert_eq!(runs_with_pauses_of(BEARABLE), (1, true));
        assert_eq!(runs_with_pauses_of(2 * BEARABLE), (RUNS_MAX, true));
    }

    #[test]
    fn failure_of_a_robot_stands_beside_any_pause() {
        let runs = Cell::new(0);
        let failed = catch_unwind(AssertUnwindSafe(|| {
            in_real_time(|| {
                runs.set(runs.get() + 1);
                METER.with_borrow(|meter| {
                    let meter = meter.as_ref().expect("the meter of this test");
                    meter.longest_ns.fetch_max(u64::MAX, Ordering::Relaxed);
                });
                assert_always(false, "a limit is broken");
            });
        }));
        assert!(failed.is_err() && runs.get() == 1, "{} runs", runs.get());
    }

    #[test]
    fn test_that_fails_once_beside_a_pause_succeeds() {
        let (runs, paused) = (Cell::new(0), Duration::from_millis(200));
        in_real_time(|| {
            runs.set(runs.get() + 1);
            let id = std::process::id();
            let line = format!("kill -STOP {id}; sleep {}; kill -CONT {id}", paused.as_secs_f64());
            let begun = Instant::now();
            assert!(Command::new("sh").args(["-c", &line]).status().expect("a shell").success());
            assert!(begun.elapsed() < SOON && runs.get() > 1, "the first run fails");
        });
        assert_eq!(runs.get(), 2);
    }
}
