//! Permissions of this process: resource limits and capabilities.
#![allow(unsafe_code)]

/// Bit of CAP_IPC_LOCK (linux/capability.h): with it RLIMIT_MEMLOCK does not apply.
const CAP_IPC_LOCK: u64 = 14;
/// Bit of CAP_SYS_NICE: with it RLIMIT_RTPRIO does not apply.
const CAP_SYS_NICE: u64 = 23;

/// The soft limits of this process that real-time work depends on. `None` means unlimited.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Highest real-time priority (RLIMIT_RTPRIO).
    pub rtprio: Option<u64>,
    /// Bytes that may be locked (RLIMIT_MEMLOCK).
    pub memlock_bytes: Option<u64>,
    /// Open files (RLIMIT_NOFILE).
    pub nofile: Option<u64>,
    /// CAP_SYS_NICE: the process may set any priority, whatever `rtprio` is.
    pub any_priority: bool,
    /// CAP_IPC_LOCK: the process may lock any memory, whatever `memlock_bytes` is.
    pub any_lock: bool,
}

impl Limits {
    /// Returns the limits in force.
    pub fn of_process() -> Self {
        Self {
            rtprio: limit(libc::RLIMIT_RTPRIO),
            memlock_bytes: limit(libc::RLIMIT_MEMLOCK),
            nofile: limit(libc::RLIMIT_NOFILE),
            any_priority: has_capability(CAP_SYS_NICE),
            any_lock: has_capability(CAP_IPC_LOCK),
        }
    }
}

/// Returns a limit in words.
pub(crate) fn words(limit: Option<u64>) -> String {
    limit.map_or_else(|| String::from("unlimited"), |limit| limit.to_string())
}

/// Returns one line of /proc/self/status, without its key.
pub(crate) fn status_line(key: &str) -> Option<String> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    status.lines().find_map(|line| line.strip_prefix(key)).map(|rest| rest.trim().to_owned())
}

fn limit(resource: libc::__rlimit_resource_t) -> Option<u64> {
    let mut limit = libc::rlimit { rlim_cur: 0, rlim_max: 0 };
    // SAFETY: `limit` is writable and of the right type.
    let rc = unsafe { libc::getrlimit(resource, &mut limit) };
    let soft = if rc == 0 { limit.rlim_cur } else { 0 };
    (soft != libc::RLIM_INFINITY).then_some(soft)
}

fn has_capability(bit: u64) -> bool {
    let effective = status_line("CapEff:").and_then(|text| u64::from_str_radix(&text, 16).ok());
    effective.is_some_and(|bits| bits >> bit & 1 == 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn process_limits_match_proc_self_limits() {
        let shown = std::fs::read_to_string("/proc/self/limits").expect("Linux shows them");
        let soft = |name: &str| {
            let row = shown.lines().find_map(|line| line.strip_prefix(name)).expect("a row");
            row.split_whitespace().next().expect("a soft limit").parse().ok()
        };
        let limits = Limits::of_process();
        assert_eq!(limits.rtprio, soft("Max realtime priority"));
        assert_eq!(limits.memlock_bytes, soft("Max locked memory"));
        assert_eq!(limits.nofile, soft("Max open files"));
        assert_eq!((words(None), words(Some(7))), ("unlimited".into(), "7".into()));
    }
}
