//! Thread and process attributes of the real-time path: each is set, read back, and reported in words.
#![allow(unsafe_code)]

use std::fmt;

/// Stack that is touched in advance: an eighth of a Rust thread's 2 MiB; a tick holds a few messages of at most 3.6 KB.
const STACK_PREFAULT_BYTES: usize = 256 * 1024;
/// Distance of two touches: the smallest page of the platforms we run on.
const PAGE_BYTES: usize = 4096;
/// Bit of CAP_IPC_LOCK (linux/capability.h): with it RLIMIT_MEMLOCK does not apply.
const CAP_IPC_LOCK: u64 = 14;

/// The scheduling policy to ask for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Policy {
    /// SCHED_FIFO with this priority, 1 to 99.
    Fifo {
        /// Higher runs first.
        priority: u8,
    },
    /// The system's default.
    Other,
}

/// What a thread asks for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RealtimeConfig {
    /// Scheduling policy of the calling thread.
    pub policy: Policy,
    /// Cores that the calling thread may run on; nothing leaves it free.
    pub cores: Option<Vec<usize>>,
    /// Lock the memory of the whole process, now and in future.
    pub lock_memory: bool,
}

/// What became of one request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// Not asked for.
    NotRequested,
    /// Set and read back.
    Applied(String),
    /// Refused, with the system's reason and what would help.
    Refused(String),
}

impl Outcome {
    /// Whether it holds.
    pub fn is_applied(&self) -> bool {
        matches!(self, Self::Applied(_))
    }
}

/// What the system granted.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RealtimeReport {
    /// Scheduling policy.
    pub policy: Outcome,
    /// Affinity.
    pub cores: Outcome,
    /// Memory lock.
    pub memory: Outcome,
    /// Timer slack of 1 ns.
    pub timer_slack: Outcome,
    /// A kernel with PREEMPT_RT.
    pub kernel: Outcome,
}

impl RealtimeReport {
    /// Whether the thread runs under SCHED_FIFO with locked memory on a kernel that bounds its own delays: what engaging
    /// a real robot asks for.
    pub fn is_realtime(&self) -> bool {
        self.policy.is_applied() && self.memory.is_applied() && self.kernel.is_applied()
    }

    /// The reasons of everything that was refused.
    pub fn refusals(&self) -> Vec<String> {
        let named = self.named();
        named.into_iter().filter(|(_, outcome)| matches!(outcome, Outcome::Refused(_))).map(line).collect()
    }

    fn named(&self) -> [(&'static str, &Outcome); 5] {
        [
            ("scheduling", &self.policy),
            ("cores", &self.cores),
            ("memory lock", &self.memory),
            ("timer slack", &self.timer_slack),
            ("kernel", &self.kernel),
        ]
    }
}

fn line((name, outcome): (&str, &Outcome)) -> String {
    match outcome {
        Outcome::NotRequested => format!("{name}: not requested"),
        Outcome::Applied(what) => format!("{name}: {what}"),
        Outcome::Refused(why) => format!("{name}: REFUSED: {why}"),
    }
}

impl fmt::Display for RealtimeReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.named().map(line).join("\n"))
    }
}

/// The attributes of the calling thread and its process.
#[derive(Debug)]
pub struct Realtime;

impl Realtime {
    /// Asks for everything in `config` and reports what holds. Memory is locked first, so that ports created later
    /// are resident; call it before opening the bus, on the thread that ticks. Threads started later do not inherit
    /// SCHED_FIFO; they do inherit the affinity.
    pub fn apply(config: &RealtimeConfig) -> RealtimeReport {
        let memory = if config.lock_memory { outcome(lock_memory()) } else { Outcome::NotRequested };
        // The slack first: newer kernels report and accept no slack once the thread is real-time.
        let timer_slack = outcome(set_timer_slack());
        let cores = config.cores.as_deref().map_or(Outcome::NotRequested, |cores| outcome(set_cores(cores)));
        let policy = match config.policy {
            Policy::Other => Outcome::NotRequested,
            Policy::Fifo { priority } => outcome(set_fifo(priority)),
        };
        prefault_stack();
        let kernel = match config.policy {
            Policy::Other => Outcome::NotRequested,
            Policy::Fifo { .. } => outcome(preempt_rt()),
        };
        RealtimeReport { policy, cores, memory, timer_slack, kernel }
    }
}

fn outcome(result: Result<String, String>) -> Outcome {
    match result {
        Ok(what) => Outcome::Applied(what),
        Err(why) => Outcome::Refused(why),
    }
}

/// Without PREEMPT_RT a system call of any other process may keep SCHED_FIFO off a core for milliseconds: 5 to 10 ms were
/// seen here under a compiler's load (6.18, PREEMPT_DYNAMIC, 2026-11-21).
fn preempt_rt() -> Result<String, String> {
    match std::fs::read_to_string("/sys/kernel/realtime") {
        Ok(text) if text.trim() == "1" => Ok("PREEMPT_RT".into()),
        _ => {
            Err("not PREEMPT_RT (/sys/kernel/realtime): delays of several ms are possible; boot a PREEMPT_RT kernel"
                .into())
        }
    }
}

fn last_error() -> std::io::Error {
    std::io::Error::last_os_error()
}

fn set_fifo(priority: u8) -> Result<String, String> {
    let wanted = libc::c_int::from(priority);
    let parameter = libc::sched_param { sched_priority: wanted };
    // SAFETY: `parameter` is a valid sched_param; pid 0 means the calling thread.
    let rc = unsafe { libc::sched_setscheduler(0, libc::SCHED_FIFO | libc::SCHED_RESET_ON_FORK, &parameter) };
    if rc != 0 {
        let error = last_error();
        let limit = resource_limit(libc::RLIMIT_RTPRIO);
        return Err(format!(
            "SCHED_FIFO priority {priority}: {error}; RLIMIT_RTPRIO is {limit}, grant it with LimitRTPRIO={priority} \
             in the unit, or rtprio in limits.conf"
        ));
    }
    let mut granted = libc::sched_param { sched_priority: 0 };
    // SAFETY: `granted` is writable; pid 0 means the calling thread.
    let (policy, rc) = unsafe { (libc::sched_getscheduler(0), libc::sched_getparam(0, &mut granted)) };
    if rc != 0 || policy & !libc::SCHED_RESET_ON_FORK != libc::SCHED_FIFO || granted.sched_priority != wanted {
        let now = granted.sched_priority;
        return Err(format!("SCHED_FIFO priority {priority} was accepted, but policy {policy} priority {now} holds"));
    }
    Ok(format!("SCHED_FIFO priority {priority}"))
}

fn set_cores(cores: &[usize]) -> Result<String, String> {
    let mut wanted = empty_core_set();
    for &core in cores {
        if core >= libc::CPU_SETSIZE as usize {
            return Err(format!("core {core}: the highest that can be named is {}", libc::CPU_SETSIZE - 1));
        }
        // SAFETY: `core` is below CPU_SETSIZE, so the bit lies inside the set.
        unsafe { libc::CPU_SET(core, &mut wanted) };
    }
    let size = std::mem::size_of::<libc::cpu_set_t>();
    // SAFETY: `wanted` is a valid set of `size` bytes; pid 0 means the calling thread.
    if unsafe { libc::sched_setaffinity(0, size, &wanted) } != 0 {
        let online = std::thread::available_parallelism().map_or(0, usize::from);
        return Err(format!("cores {cores:?}: {}; {online} core(s) are available to this process", last_error()));
    }
    let mut granted = empty_core_set();
    // SAFETY: `granted` is writable and `size` bytes long; both sets are valid for the comparison.
    let same = unsafe { libc::sched_getaffinity(0, size, &mut granted) == 0 && libc::CPU_EQUAL(&wanted, &granted) };
    if same { Ok(format!("cores {cores:?}")) } else { Err(format!("cores {cores:?}: only a part was granted")) }
}

fn empty_core_set() -> libc::cpu_set_t {
    // SAFETY: a cpu_set_t is an array of integers, for which all-zero bits are valid: the empty set.
    unsafe { std::mem::zeroed() }
}

fn lock_memory() -> Result<String, String> {
    let limit = resource_limit(libc::RLIMIT_MEMLOCK);
    if limit != libc::RLIM_INFINITY && !has_capability(CAP_IPC_LOCK) {
        // A lock that fits today makes tomorrow's mappings fail, in the middle of the run.
        return Err(format!(
            "RLIMIT_MEMLOCK is {limit} bytes, later mappings would fail; grant it with LimitMEMLOCK=infinity in the \
             unit, or memlock in limits.conf"
        ));
    }
    // SAFETY: the call takes flags only.
    if unsafe { libc::mlockall(libc::MCL_CURRENT | libc::MCL_FUTURE) } != 0 {
        return Err(format!("mlockall: {}", last_error()));
    }
    keep_heap();
    let locked = status_line("VmLck:");
    match locked.as_deref().map(str::trim) {
        None | Some("0 kB") => Err(String::from("mlockall was accepted, but /proc/self/status shows no locked memory")),
        Some(amount) => Ok(format!("{amount} locked, and all that is mapped later")),
    }
}

/// Keeps freed memory in the process: returned pages would fault again when they are next needed.
fn keep_heap() {
    #[cfg(target_env = "gnu")]
    // SAFETY: mallopt takes two integers and changes tuning values of the allocator only.
    unsafe {
        libc::mallopt(libc::M_TRIM_THRESHOLD, -1);
        libc::mallopt(libc::M_MMAP_MAX, 0);
    }
}

fn set_timer_slack() -> Result<String, String> {
    // SAFETY: PR_SET_TIMERSLACK takes one integer, PR_GET_TIMERSLACK none; neither touches memory.
    let (set, slack_ns) =
        unsafe { (libc::prctl(libc::PR_SET_TIMERSLACK, 1 as libc::c_ulong), libc::prctl(libc::PR_GET_TIMERSLACK)) };
    if set != 0 {
        return Err(format!("PR_SET_TIMERSLACK 1 ns: {}", last_error()));
    }
    // A real-time thread has none at all.
    if (0..=1).contains(&slack_ns) { Ok(format!("{slack_ns} ns")) } else { Err(format!("{slack_ns} ns holds")) }
}

#[inline(never)]
fn prefault_stack() {
    let mut stack = [0u8; STACK_PREFAULT_BYTES];
    for byte in stack.iter_mut().step_by(PAGE_BYTES) {
        *byte = 1;
    }
    std::hint::black_box(&mut stack);
}

fn resource_limit(resource: libc::__rlimit_resource_t) -> libc::rlim_t {
    let mut limit = libc::rlimit { rlim_cur: 0, rlim_max: 0 };
    // SAFETY: `limit` is writable and of the right type.
    if unsafe { libc::getrlimit(resource, &mut limit) } == 0 { limit.rlim_cur } else { 0 }
}

fn has_capability(bit: u64) -> bool {
    let effective = status_line("CapEff:").and_then(|text| u64::from_str_radix(text.trim(), 16).ok());
    effective.is_some_and(|bits| bits >> bit & 1 == 1)
}

fn status_line(key: &str) -> Option<String> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    status.lines().find_map(|line| line.strip_prefix(key)).map(str::to_owned)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plain() -> RealtimeConfig {
        RealtimeConfig { policy: Policy::Other, cores: None, lock_memory: false }
    }

    /// Attributes belong to a thread: each test asks in a thread of its own.
    fn in_thread<T: Send>(work: impl FnOnce() -> T + Send) -> T {
        std::thread::scope(|scope| scope.spawn(work).join().expect("the thread does not panic"))
    }

    fn stat_policy() -> (i32, i32) {
        let mut parameter = libc::sched_param { sched_priority: 0 };
        // SAFETY: `parameter` is writable; pid 0 means the calling thread.
        let policy = unsafe {
            libc::sched_getparam(0, &mut parameter);
            libc::sched_getscheduler(0)
        };
        (policy & !libc::SCHED_RESET_ON_FORK, parameter.sched_priority)
    }

    #[test]
    fn what_is_not_requested_is_not_touched() {
        let report = in_thread(|| Realtime::apply(&plain()));
        assert_eq!([&report.policy, &report.cores, &report.memory], [&Outcome::NotRequested; 3]);
        assert!(report.timer_slack.is_applied(), "{report}");
        assert!(!report.is_realtime());
        assert!(report.refusals().is_empty());
    }

    #[test]
    fn fifo_holds_exactly_where_it_is_reported() {
        let config = RealtimeConfig { policy: Policy::Fifo { priority: 7 }, ..plain() };
        let (report, held) = in_thread(|| (Realtime::apply(&config), stat_policy()));
        match &report.policy {
            Outcome::Applied(_) => assert_eq!(held, (libc::SCHED_FIFO, 7)),
            Outcome::Refused(why) => {
                assert_eq!(held.0, libc::SCHED_OTHER);
                assert!(why.contains("RLIMIT_RTPRIO"), "{why}");
            }
            Outcome::NotRequested => panic!("it was requested"),
        }
    }

    #[test]
    fn a_priority_that_does_not_exist_is_refused_in_words() {
        let config = RealtimeConfig { policy: Policy::Fifo { priority: 200 }, ..plain() };
        let report = in_thread(|| Realtime::apply(&config));
        assert!(!report.policy.is_applied());
        assert!(report.refusals()[0].contains("priority 200"), "{report}");
    }

    #[test]
    fn affinity_is_read_back_and_impossible_cores_are_refused() {
        let config = RealtimeConfig { cores: Some(vec![first_allowed_core()]), ..plain() };
        let report = in_thread(|| Realtime::apply(&config));
        assert!(report.cores.is_applied(), "{report}");
        for cores in [vec![], vec![1_000], vec![5_000]] {
            let config = RealtimeConfig { cores: Some(cores), ..plain() };
            let report = in_thread(|| Realtime::apply(&config));
            assert!(matches!(report.cores, Outcome::Refused(_)), "{report}");
        }
    }

    fn first_allowed_core() -> usize {
        let mut set = empty_core_set();
        // SAFETY: `set` is writable and of the size that is named; every index is below CPU_SETSIZE.
        unsafe {
            libc::sched_getaffinity(0, std::mem::size_of::<libc::cpu_set_t>(), &mut set);
            (0..libc::CPU_SETSIZE as usize).find(|&core| libc::CPU_ISSET(core, &set)).expect("a core to run on")
        }
    }
}
