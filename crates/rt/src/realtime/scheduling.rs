//! Policy, priority, cores and timer slack of the calling thread.

use super::last_error;
use crate::limits::{Limits, words};

/// Sets SCHED_FIFO, and succeeds only if it then holds. With `inherited`, threads that are started from here get it too.
pub(super) fn set_fifo(priority: u8, inherited: bool) -> Result<String, String> {
    let wanted = libc::c_int::from(priority);
    let parameter = libc::sched_param { sched_priority: wanted };
    let reset = if inherited { 0 } else { libc::SCHED_RESET_ON_FORK };
    // SAFETY: `parameter` is a valid sched_param. pid 0 means the calling thread.
    let rc = unsafe { libc::sched_setscheduler(0, libc::SCHED_FIFO | reset, &parameter) };
    if rc != 0 {
        let error = last_error();
        let limit = words(Limits::of_process().rtprio);
        return Err(format!(
            "SCHED_FIFO priority {priority}: {error}; RLIMIT_RTPRIO is {limit}, grant it with LimitRTPRIO={priority} \
             in the unit, or rtprio in limits.conf"
        ));
    }
    let (policy, now) = scheduling();
    if policy != libc::SCHED_FIFO || now != wanted {
        return Err(format!(
            "SCHED_FIFO priority {priority} was accepted, but policy {policy} priority {now} is in effect"
        ));
    }
    Ok(format!("SCHED_FIFO priority {priority}"))
}

/// Returns the policy and priority of the calling thread, or (-1, -1) if the kernel does not report them.
pub(super) fn scheduling() -> (i32, i32) {
    let mut granted = libc::sched_param { sched_priority: -1 };
    // SAFETY: `granted` is writable. pid 0 means the calling thread.
    let (policy, rc) = unsafe { (libc::sched_getscheduler(0), libc::sched_getparam(0, &mut granted)) };
    if policy < 0 || rc != 0 { (-1, -1) } else { (policy & !libc::SCHED_RESET_ON_FORK, granted.sched_priority) }
}

/// Sets the cores of the calling thread, and of the threads that it starts.
pub(super) fn set_cores(cores: &[usize]) -> Result<String, String> {
    let mut wanted = empty_core_set();
    for &core in cores {
        if core >= libc::CPU_SETSIZE as usize {
            return Err(format!("core {core}: the highest allowed number is {}", libc::CPU_SETSIZE - 1));
        }
        // SAFETY: `core` is below CPU_SETSIZE, so the bit lies inside the set.
        unsafe { libc::CPU_SET(core, &mut wanted) };
    }
    let size = std::mem::size_of::<libc::cpu_set_t>();
    // SAFETY: `wanted` is a valid set of `size` bytes. pid 0 means the calling thread.
    if unsafe { libc::sched_setaffinity(0, size, &wanted) } != 0 {
        let error = last_error();
        return Err(format!("cores {cores:?}: {error}; allowed to this process: {:?}", allowed_cores()));
    }
    let mut asked = cores.to_vec();
    asked.sort_unstable();
    asked.dedup();
    let granted = allowed_cores();
    if granted == asked { Ok(format!("{granted:?}")) } else { Err(format!("cores {cores:?}: {granted:?} hold")) }
}

/// Returns the cores that the calling thread may run on, ascending.
pub(crate) fn allowed_cores() -> Vec<usize> {
    let mut set = empty_core_set();
    // SAFETY: `set` is writable and has the given size. Every index is below CPU_SETSIZE.
    unsafe {
        if libc::sched_getaffinity(0, std::mem::size_of::<libc::cpu_set_t>(), &mut set) != 0 {
            return Vec::new();
        }
        (0..libc::CPU_SETSIZE as usize).filter(|&core| libc::CPU_ISSET(core, &set)).collect()
    }
}

fn empty_core_set() -> libc::cpu_set_t {
    // SAFETY: a cpu_set_t is an array of integers, for which all-zero bits are valid: the empty set.
    unsafe { std::mem::zeroed() }
}

/// Sets the timer slack to 1 ns. The kernel may delay a timer by its slack, which is 50 us by default.
pub(super) fn set_timer_slack() -> Result<String, String> {
    // SAFETY: PR_SET_TIMERSLACK takes one integer, PR_GET_TIMERSLACK none. Neither touches memory.
    let (set, slack_ns) =
        unsafe { (libc::prctl(libc::PR_SET_TIMERSLACK, 1 as libc::c_ulong), libc::prctl(libc::PR_GET_TIMERSLACK)) };
    if set != 0 {
        return Err(format!("PR_SET_TIMERSLACK 1 ns: {}", last_error()));
    }
    // A real-time thread has no slack at all.
    if (0..=1).contains(&slack_ns) { Ok(format!("{slack_ns} ns")) } else { Err(format!("{slack_ns} ns holds")) }
}
