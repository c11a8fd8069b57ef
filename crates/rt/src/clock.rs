//! CLOCK_MONOTONIC, the one clock of every message.
#![allow(unsafe_code)]

use messages::Stamp;

/// The current instant of CLOCK_MONOTONIC in nanoseconds; answered by the vDSO, without a system call.
pub fn now() -> Stamp {
    let mut time = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: `time` is a valid, writable timespec for the whole call.
    let rc = unsafe { libc::clock_gettime(libc::CLOCK_MONOTONIC, &mut time) };
    assert_eq!(rc, 0, "CLOCK_MONOTONIC exists on every Linux");
    Stamp(time.tv_sec as u64 * 1_000_000_000 + time.tv_nsec as u64)
}

/// Sleeps until `deadline` (absolute, so no drift); returns at once if it has passed. A signal does not shorten it.
pub fn sleep_until(deadline: Stamp) {
    while !sleep_once(deadline) {}
}

/// One absolute sleep; false if a signal ended it early.
pub(crate) fn sleep_once(deadline: Stamp) -> bool {
    let time = libc::timespec {
        tv_sec: (deadline.0 / 1_000_000_000) as libc::time_t,
        tv_nsec: (deadline.0 % 1_000_000_000) as libc::c_long,
    };
    // SAFETY: `time` is a valid timespec with tv_nsec < 1e9; with TIMER_ABSTIME the remainder pointer may be null.
    let rc = unsafe { libc::clock_nanosleep(libc::CLOCK_MONOTONIC, libc::TIMER_ABSTIME, &time, std::ptr::null_mut()) };
    assert!(rc == 0 || rc == libc::EINTR, "clock_nanosleep refused an absolute deadline: errno {rc}");
    rc == 0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_clock_never_runs_backwards_and_agrees_with_the_standard_library() {
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
    fn a_sleep_never_ends_before_its_deadline_and_a_past_deadline_returns() {
        for ahead_ns in [0, 1, 50_000, 2_000_000] {
            let deadline = now().plus_ns(ahead_ns);
            sleep_until(deadline);
            assert!(now() >= deadline);
        }
        sleep_until(Stamp(1));
    }
}
