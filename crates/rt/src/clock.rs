//! CLOCK_MONOTONIC, the one clock of every message.
#![allow(unsafe_code)]

use messages::Stamp;

/// Returns the current instant of CLOCK_MONOTONIC in nanoseconds. The vDSO gives it, without a system call.
pub fn now() -> Stamp {
    Stamp(read(libc::CLOCK_MONOTONIC))
}

fn read(clock: libc::clockid_t) -> u64 {
    let mut time = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: `time` is a valid, writable timespec for the whole call.
    let rc = unsafe { libc::clock_gettime(clock, &mut time) };
    assert_eq!(rc, 0, "these clocks exist on every Linux");
    time.tv_sec as u64 * 1_000_000_000 + time.tv_nsec as u64
}

/// Returns the user and system time of all threads of this process so far, ns.
pub fn cpu_time_ns() -> u64 {
    read(libc::CLOCK_PROCESS_CPUTIME_ID)
}

/// Shorter sleeps of the machine are ignored, ns. No machine is suspended and back in less. Two clocks that are
/// read one after the other differ by less if nothing interrupts the reading.
const SLEEP_MIN_NS: u64 = 50_000_000;

/// Detects that the machine was suspended. CLOCK_BOOTTIME goes on then. CLOCK_MONOTONIC, by which everything here is
/// timed, does not. It does not detect that only the process was stopped.
#[derive(Debug)]
pub struct SleepWatch {
    /// Upper bound of the amount by which CLOCK_BOOTTIME is ahead, ns.
    ahead_ns: u64,
}

impl Default for SleepWatch {
    fn default() -> Self {
        Self { ahead_ns: read(libc::CLOCK_BOOTTIME).saturating_sub(now().0) }
    }
}

impl SleepWatch {
    /// Returns how long the machine slept since the last call, ns. It is zero if it did not sleep.
    pub fn slept_ns(&mut self) -> u64 {
        let before = now();
        let boot_ns = read(libc::CLOCK_BOOTTIME);
        self.judge(before, boot_ns, now())
    }

    /// Compares the clocks. `boot_ns` was read between the two stamps. They give a lower and an upper bound of
    /// the amount by which it is ahead, whatever time passed between them.
    fn judge(&mut self, before: Stamp, boot_ns: u64, after: Stamp) -> u64 {
        let (least_ns, most_ns) = (boot_ns.saturating_sub(after.0), boot_ns.saturating_sub(before.0));
        let slept_ns = least_ns.saturating_sub(self.ahead_ns);
        if slept_ns < SLEEP_MIN_NS {
            self.ahead_ns = self.ahead_ns.min(most_ns);
            return 0;
        }
        self.ahead_ns = most_ns;
        slept_ns
    }
}

/// Sleeps until `deadline` (absolute, so no drift). Returns at once if it has passed. A signal does not shorten it.
pub fn sleep_until(deadline: Stamp) {
    while !sleep_once(deadline) {}
}

/// Makes one absolute sleep. Returns false if a signal ended it early.
pub(crate) fn sleep_once(deadline: Stamp) -> bool {
    let time = libc::timespec {
        tv_sec: (deadline.0 / 1_000_000_000) as libc::time_t,
        tv_nsec: (deadline.0 % 1_000_000_000) as libc::c_long,
    };
    // SAFETY: `time` is a valid timespec with tv_nsec < 1e9. With TIMER_ABSTIME the remainder pointer may be null.
    let rc = unsafe { libc::clock_nanosleep(libc::CLOCK_MONOTONIC, libc::TIMER_ABSTIME, &time, std::ptr::null_mut()) };
    assert!(rc == 0 || rc == libc::EINTR, "clock_nanosleep refused an absolute deadline: errno {rc}");
    rc == 0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clock_never_runs_backwards_and_agrees_with_std() {
        let mut last = now();
        assert!(last.0 > 0);
        for _ in 0..10_000 {
            let next = now();
            assert!(next >= last);
            last = next;
        }
        let (a, start) = (now(), std::time::Instant::now());
        std::thread::sleep(std::time::Duration::from_millis(5));
        let (elapsed, ours) = (start.elapsed().as_nanos() as u64, now().since(a));
        assert!(ours >= elapsed, "{ours} ns by our clock, at least {elapsed} ns by the library's");
    }

    #[test]
    fn f031_machine_sleep_is_reported_once_and_process_stop_never() {
        let mut watch = SleepWatch { ahead_ns: 1_000 };
        assert_eq!(watch.judge(Stamp(5_000), 6_100, Stamp(5_200)), 0);
        // The process was stopped for a second: between two calls, before the other clock was read, and after.
        assert_eq!(watch.judge(Stamp(1_000_005_000), 1_000_006_100, Stamp(1_000_005_200)), 0);
        assert_eq!(watch.judge(Stamp(1_000_006_000), 2_000_007_000, Stamp(2_000_006_200)), 0);
        assert_eq!(watch.judge(Stamp(2_000_007_000), 2_000_008_000, Stamp(3_000_008_000)), 0);
        // The machine slept for a minute. It is reported once.
        let minute = 60_000_000_000;
        let slept = watch.judge(Stamp(3_000_009_000), 3_000_010_000 + minute, Stamp(3_000_009_100));
        assert!(slept.abs_diff(minute) < 2_000, "{slept}");
        assert_eq!(watch.judge(Stamp(3_000_019_000), 3_000_020_000 + minute, Stamp(3_000_019_100)), 0);
        let mut real = SleepWatch::default();
        assert!((0..1000).all(|_| real.slept_ns() == 0));
    }
}
