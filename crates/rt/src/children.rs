//! Parents and children: a process of an instance must not outlive the process that started it, nor be cut off by it.
#![allow(unsafe_code)]

/// Asks the kernel for SIGTERM when the parent dies, so that `kill -9` of a supervisor still brings the robot to
/// rest. It has no effect if only an init process started us.
pub fn die_with_parent() {
    // SAFETY: PR_SET_PDEATHSIG takes one integer by value and touches no memory of ours.
    unsafe {
        libc::prctl(libc::PR_SET_PDEATHSIG, libc::SIGTERM as libc::c_ulong);
    }
}

/// Returns true if this process was started for the process `child_of`, and that one is no longer its parent.
pub fn is_orphaned(child_of: Option<u32>) -> bool {
    child_of.is_some_and(|id| std::os::unix::process::parent_id() != id)
}

/// Sends SIGTERM to the process `id`. It is no error if the process is gone already.
pub fn terminate(id: u32) {
    send(id, libc::SIGTERM);
}

/// Suspends the process `id` (SIGSTOP), until [`resume`]. It is no error if the process is gone already.
pub fn suspend(id: u32) {
    send(id, libc::SIGSTOP);
}

/// Lets a suspended process go on (SIGCONT). It is no error if the process is gone already.
pub fn resume(id: u32) {
    send(id, libc::SIGCONT);
}

fn send(id: u32, signal: i32) {
    let Ok(pid) = libc::pid_t::try_from(id) else { return };
    // 0 and negative numbers would mean whole groups.
    if pid > 0 {
        // SAFETY: kill takes two integers by value and touches no memory of ours.
        unsafe {
            libc::kill(pid, signal);
        }
    }
}
