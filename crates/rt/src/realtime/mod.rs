//! Thread and process attributes of the real-time path. Each is set, read back, and reported in words.
#![allow(unsafe_code)]

mod idle;
mod memory;
mod scheduling;

use crate::{cpu_features, flush_denormals};
pub(crate) use scheduling::allowed_cores;
use std::fmt;

/// The scheduling policy to ask for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Policy {
    /// SCHED_FIFO with this priority, 1 to 99.
    Fifo {
        /// The priority. A higher one runs first.
        priority: u8,
    },
    /// The system's default.
    Other,
}

/// The requests of a thread.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RealtimeConfig {
    /// Scheduling policy of the calling thread.
    pub policy: Policy,
    /// Cores that the calling thread may run on. `None` leaves it free.
    pub cores: Option<Vec<usize>>,
    /// Lock the memory of the whole process, now and in future. Heap and stack are touched in advance, lock or not.
    pub lock_memory: bool,
    /// Keep the cores of the machine from sleeping, as long as the process lives.
    pub cpu_dma_latency: bool,
}

/// Result of one request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// It was not requested.
    NotRequested,
    /// It was set and read back.
    Applied(String),
    /// It was refused. The text has the system's reason and the remedy.
    Refused(String),
}

impl Outcome {
    /// Returns true if the request was granted.
    pub fn is_applied(&self) -> bool {
        matches!(self, Self::Applied(_))
    }
}

/// The system's answers to all requests, each with its heading.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RealtimeReport([(&'static str, Outcome); 9]);

impl RealtimeReport {
    /// Returns true if the thread runs under SCHED_FIFO with locked memory on a kernel that bounds its own
    /// delays. Engaging a real robot requires that.
    pub fn is_realtime(&self) -> bool {
        ["scheduling", "memory lock", "kernel"].iter().all(|heading| self.outcome(heading).is_applied())
    }

    /// Returns the answer under this heading.
    ///
    /// # Panics
    /// Panics if there is no such heading.
    pub fn outcome(&self, heading: &str) -> &Outcome {
        let found = self.0.iter().find(|(name, _)| *name == heading);
        found.map(|(_, outcome)| outcome).expect("a heading of the report")
    }

    /// Returns the reasons of all refusals.
    pub fn refusals(&self) -> Vec<String> {
        self.0.iter().filter(|(_, outcome)| matches!(outcome, Outcome::Refused(_))).map(line).collect()
    }

    /// Returns everything that was granted.
    pub fn granted(&self) -> Vec<String> {
        self.0.iter().filter(|(_, outcome)| outcome.is_applied()).map(line).collect()
    }

    /// Returns one line for each request: the granted value, or the reason why it was not granted.
    pub fn lines(&self) -> Vec<String> {
        self.0.iter().map(line).collect()
    }
}

fn line((name, outcome): &(&'static str, Outcome)) -> String {
    match outcome {
        Outcome::NotRequested => format!("{name}: not requested"),
        Outcome::Applied(what) => format!("{name}: {what}"),
        Outcome::Refused(why) => format!("{name}: not granted: {why}"),
    }
}

impl fmt::Display for RealtimeReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.lines().join("\n"))
    }
}

/// The attributes of the calling thread and its process.
#[derive(Debug)]
pub struct Realtime;

impl Realtime {
    /// Makes all requests in `config` and reports the results. Memory is locked first, so that ports created
    /// later are resident. Call it before opening the bus, on the thread that ticks. Threads started later do not
    /// inherit SCHED_FIFO, but they inherit the cores.
    pub fn apply(config: &RealtimeConfig) -> RealtimeReport {
        let asked = |wanted: bool, ask: fn() -> Result<String, String>| {
            if wanted { outcome(ask()) } else { Outcome::NotRequested }
        };
        let memory = asked(config.lock_memory, memory::lock);
        // The slack is set first: newer kernels report and accept no slack once the thread is real-time.
        let timer_slack = outcome(scheduling::set_timer_slack());
        let cores = config.cores.as_deref().map_or(Outcome::NotRequested, Self::keep_to);
        let policy = match config.policy {
            Policy::Other => Outcome::NotRequested,
            Policy::Fifo { priority } => outcome(scheduling::set_fifo(priority, false)),
        };
        let kernel = asked(policy != Outcome::NotRequested, preempt_rt);
        RealtimeReport([
            ("scheduling", policy),
            ("cores", cores),
            ("memory lock", memory),
            ("prefault", asked(config.lock_memory, memory::prefault)),
            ("timer slack", timer_slack),
            ("cpu_dma_latency", asked(config.cpu_dma_latency, idle::hold_awake)),
            ("denormals", outcome(flush_denormals())),
            ("kernel", kernel),
            ("processor", Outcome::Applied(cpu_features())),
        ])
    }

    /// Restricts the calling thread, and the threads that it starts, to `cores`, and reads the setting back.
    pub fn keep_to(cores: &[usize]) -> Outcome {
        outcome(scheduling::set_cores(cores))
    }

    /// Sets SCHED_FIFO for the calling thread, and for the threads that it starts.
    pub fn fifo_with_children(priority: u8) -> Outcome {
        outcome(scheduling::set_fifo(priority, true))
    }

    /// Returns the result of asking for SCHED_FIFO with `priority`. It is set and read back on a thread that then ends.
    pub fn try_fifo(priority: u8) -> Result<String, String> {
        let tried =
            std::thread::Builder::new().name("try-fifo".into()).spawn(move || scheduling::set_fifo(priority, false));
        let thread = tried.map_err(|error| format!("cannot start a test thread: {error}"))?;
        thread.join().unwrap_or_else(|_| Err(String::from("the test thread panicked")))
    }
}

fn outcome(result: Result<String, String>) -> Outcome {
    match result {
        Ok(what) => Outcome::Applied(what),
        Err(why) => Outcome::Refused(why),
    }
}

/// Checks that the kernel is PREEMPT_RT. Without it a system call of any other process may keep SCHED_FIFO off a
/// core for milliseconds. 5 to 10 ms were seen here under a compiler's load (6.18, PREEMPT_DYNAMIC, 2026-11-21).
fn preempt_rt() -> Result<String, String> {
    if is_preempt_rt() {
        return Ok("PREEMPT_RT".into());
    }
    Err("not PREEMPT_RT (/proc/sys/kernel/version): delays of several ms are possible; boot a PREEMPT_RT kernel".into())
}

/// Returns true if the kernel is PREEMPT_RT. Its version says so, as in `uname -v`. Kernels with the patches from
/// before 6.12 also say so in /sys/kernel/realtime.
pub fn is_preempt_rt() -> bool {
    let text = |path| std::fs::read_to_string(path).unwrap_or_default();
    says_preempt_rt(&text("/proc/sys/kernel/version"), &text("/sys/kernel/realtime"))
}

/// Returns true if `version` contains the word `PREEMPT_RT`, or if `realtime` is 1. `PREEMPT_DYNAMIC` is another word.
fn says_preempt_rt(version: &str, realtime: &str) -> bool {
    version.split_whitespace().any(|word| word == "PREEMPT_RT") || realtime.trim() == "1"
}

fn last_error() -> std::io::Error {
    std::io::Error::last_os_error()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plain() -> RealtimeConfig {
        RealtimeConfig { policy: Policy::Other, cores: None, lock_memory: false, cpu_dma_latency: false }
    }

    /// Runs `work` in a thread of its own, because attributes belong to a thread.
    fn in_thread<T: Send>(work: impl FnOnce() -> T + Send) -> T {
        std::thread::scope(|scope| scope.spawn(work).join().expect("the thread does not panic"))
    }

    #[test]
    fn realtime_setting_that_is_not_requested_is_not_changed() {
        let report = in_thread(|| Realtime::apply(&plain()));
        let untouched = ["scheduling", "cores", "memory lock", "prefault", "cpu_dma_latency"];
        let untouched = untouched.map(|heading| report.outcome(heading));
        assert_eq!(untouched, [&Outcome::NotRequested; 5]);
        assert_eq!(report.lines().len(), report.to_string().lines().count(), "a line each: {report}");
        assert!(report.outcome("timer slack").is_applied(), "{report}");
        assert!(!report.is_realtime());
        assert!(report.refusals().is_empty());
    }

    #[test]
    fn preempt_rt_is_detected_by_version_or_realtime_file() {
        let mainline = "#1 SMP PREEMPT_RT Debian 6.12.48-1 (2025-09-20)";
        assert!(says_preempt_rt(mainline, ""));
        assert!(says_preempt_rt("#1 SMP PREEMPT RT", "1\n"), "the patches of old");
        assert!(!says_preempt_rt("#1 SMP PREEMPT_DYNAMIC Debian 6.12.48-1", ""));
        assert!(!says_preempt_rt("", "0\n"));
    }

    #[test]
    fn fifo_is_in_force_exactly_when_reported_applied() {
        let config = RealtimeConfig { policy: Policy::Fifo { priority: 7 }, ..plain() };
        let (report, held) = in_thread(|| (Realtime::apply(&config), scheduling::scheduling()));
        assert_eq!(
            Realtime::try_fifo(7).is_ok(),
            report.outcome("scheduling").is_applied(),
            "trying tells what asking gets: {report}"
        );
        assert_eq!(in_thread(scheduling::scheduling).0, libc::SCHED_OTHER, "neither touches another thread");
        match report.outcome("scheduling") {
            Outcome::Applied(_) => assert_eq!(held, (libc::SCHED_FIFO, 7)),
            Outcome::Refused(why) => {
                assert_eq!(held.0, libc::SCHED_OTHER);
                assert!(why.contains("RLIMIT_RTPRIO"), "{why}");
            }
            Outcome::NotRequested => panic!("it was requested"),
        }
    }

    #[test]
    fn invalid_priority_is_refused_with_its_value() {
        let config = RealtimeConfig { policy: Policy::Fifo { priority: 200 }, ..plain() };
        let report = in_thread(|| Realtime::apply(&config));
        assert!(!report.outcome("scheduling").is_applied());
        assert!(report.refusals()[0].contains("priority 200"), "{report}");
    }

    #[test]
    fn affinity_is_read_back_and_invalid_cores_are_refused() {
        let config = RealtimeConfig { cores: Some(vec![allowed_cores()[0]]), ..plain() };
        let report = in_thread(|| Realtime::apply(&config));
        assert!(report.outcome("cores").is_applied(), "{report}");
        for cores in [vec![], vec![1_000], vec![5_000]] {
            let config = RealtimeConfig { cores: Some(cores), ..plain() };
            let report = in_thread(|| Realtime::apply(&config));
            assert!(matches!(report.outcome("cores"), Outcome::Refused(_)), "{report}");
        }
    }
}
