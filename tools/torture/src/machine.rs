//! Description of the machine that measured the figures.

use serde_json::{Value, json};

/// Processor, cores and load.
#[derive(Clone, Debug)]
pub struct Machine {
    /// The processor's name as the system reports it.
    pub processor: String,
    /// Cores that this process may use.
    pub cores: usize,
    /// Load averages before the run, over 1, 5 and 15 minutes.
    pub load_before: String,
}

impl Machine {
    /// Describes this machine now.
    pub fn now() -> Self {
        let text = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
        let line = text.lines().find(|line| line.starts_with("model name") || line.starts_with("Model"));
        let name = line.and_then(|line| line.split_once(':')).map_or("unknown", |(_, name)| name.trim());
        Self { processor: name.to_owned(), cores: cores(), load_before: load() }
    }

    /// Returns the description as JSON, with the present load.
    pub fn to_json(&self) -> Value {
        json!({
            "processor": self.processor,
            "cores": self.cores,
            "load_average_before": self.load_before,
            "load_average_after": load(),
        })
    }
}

impl std::fmt::Display for Machine {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { processor, cores, load_before } = self;
        write!(f, "{processor}, {cores} cores, load average {load_before} before and {} after", load())
    }
}

/// Number of cores that this process may use.
pub fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, std::num::NonZero::get)
}

fn load() -> String {
    let text = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
    let three: Vec<&str> = text.split_whitespace().take(3).collect();
    if three.is_empty() { "unknown".into() } else { three.join(" ") }
}
