//! Description of the machine that measured the figures.

use serde::Serialize;
use std::fmt;

/// Processor, cores and load.
#[derive(Clone, Debug, Serialize)]
pub struct Machine {
    /// The processor's name as the system reports it.
    pub processor: String,
    /// Cores that this process may use.
    pub cores: usize,
    /// Load averages before the run, over 1, 5 and 15 minutes.
    pub load_average_before: String,
    /// The same after the run.
    pub load_average_after: String,
}

impl Machine {
    /// Describes this machine before a run.
    pub fn before_run() -> Self {
        let load = load_average();
        Self { processor: processor(), cores: cores(), load_average_before: load.clone(), load_average_after: load }
    }

    /// Returns the description with the present load.
    #[must_use]
    pub fn after_run(self) -> Self {
        Self { load_average_after: load_average(), ..self }
    }
}

impl fmt::Display for Machine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { processor, cores, load_average_before: before, load_average_after: after } = self;
        write!(f, "{processor}, {cores} cores, load average {before} before and {after} after")
    }
}

/// Returns the number of cores that this process may use.
pub fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// Returns the processor's name as the system reports it.
pub fn processor() -> String {
    let text = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let is_name = |line: &&str| ["model name", "cpu model", "Model"].iter().any(|key| line.starts_with(key));
    let name = text.lines().find(is_name).and_then(|line| line.split_once(':'));
    name.map_or("unknown", |(_, name)| name.trim()).to_owned()
}

/// Returns the load averages over 1, 5 and 15 minutes.
pub fn load_average() -> String {
    let text = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
    let three: Vec<&str> = text.split_whitespace().take(3).collect();
    if three.is_empty() { "unknown".into() } else { three.join(" ") }
}
