//! CPU time of this process.
#![allow(unsafe_code)]

/// Returns the user and system time of all threads of this process so far, ns (CLOCK_PROCESS_CPUTIME_ID).
pub fn cpu_time_ns() -> u64 {
    let mut time = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: `time` is a valid, writable timespec for the whole call.
    let rc = unsafe { libc::clock_gettime(libc::CLOCK_PROCESS_CPUTIME_ID, &mut time) };
    assert_eq!(rc, 0, "CLOCK_PROCESS_CPUTIME_ID exists on every Linux");
    time.tv_sec as u64 * 1_000_000_000 + time.tv_nsec as u64
}
