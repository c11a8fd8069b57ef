//! The bare timer for comparison with the pipeline's wake-up: cyclictest, and our own loop with the same method. Both
//! sleep to absolute deadlines of CLOCK_MONOTONIC, alone, each in a process of its own with locked memory.

use crate::distribution::Distribution;
use clap::Parser;
use messages::{TICK_HZ, deadline, tick_at};
use rt::{Exit, Failure, Policy, Realtime, RealtimeConfig};
use serde::Deserialize;
use serde_json::{Value, json};
use std::fmt::Display;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use telemetry::Series;

/// Number of buckets of cyclictest's histogram. Each is 1 us wide, so the last is at 100 ms.
const CYCLICTEST_BUCKETS: u32 = 100_000;
/// cyclictest reports whole us, rounded down. Half a us is the mean of the lost part.
const CUT_OFF_NS: u64 = 500;
/// First argument that makes this program the probe.
pub const PROBE: &str = "probe";

/// The reference cannot be measured.
pub(crate) fn unmeasured(program: impl Display, cause: impl Display) -> Failure {
    Failure::new(Exit::Software, format!("{program}: {cause}"))
}

pub(crate) fn core_text(cores: &[usize]) -> String {
    cores.iter().map(usize::to_string).collect::<Vec<_>>().join(",")
}

/// Returns the path of cyclictest, if it is on the PATH.
pub fn cyclictest() -> Option<PathBuf> {
    let path = std::env::var_os("PATH")?;
    std::env::split_paths(&path).map(|folder| folder.join("cyclictest")).find(|file| file.is_file())
}

/// Runs cyclictest for `seconds`, at least for one second.
pub fn run_cyclictest(program: &Path, spec: &RealtimeConfig, seconds: f64) -> Result<Distribution, Failure> {
    let interval_us = (1e6 / TICK_HZ as f64).round();
    let mut command = Command::new(program);
    command.args(["-q", "-t", "1", "-i", &interval_us.to_string(), "-h", &CYCLICTEST_BUCKETS.to_string()]);
    command.args(["-D", &(seconds.ceil().max(1.0) as u64).to_string()]);
    match spec.policy {
        Policy::Fifo { priority } => command.args(["-p", &priority.to_string()]),
        Policy::Other => command.args(["--policy=other"]),
    };
    if spec.lock_memory {
        command.arg("-m");
    }
    if !spec.cpu_dma_latency {
        // It keeps cores from sleeping, unless this option leaves the system as it is.
        command.arg("--default-system");
    }
    if let Some(cores) = &spec.cores {
        command.args(["-a", &core_text(cores)]);
    }
    let text = output(command, &program.display().to_string())?;
    parse_cyclictest(&text).map_err(|cause| unmeasured(program.display().to_string(), cause))
}

fn output(mut command: Command, name: &str) -> Result<String, Failure> {
    let output = command.stdin(Stdio::null()).output().map_err(|error| unmeasured(name, error))?;
    if !output.status.success() {
        let stderr = String::from_utf8_lossy(&output.stderr);
        return Err(unmeasured(name, format!("{}: {}", output.status, stderr.trim())));
    }
    Ok(String::from_utf8_lossy(&output.stdout).into_owned())
}

/// Reads cyclictest's histogram. It has lines of `us count`, and comments with the counts beyond the last bucket.
fn parse_cyclictest(text: &str) -> Result<Distribution, String> {
    let mut all = Distribution::default();
    let comment = |name: &str| {
        let line = text.lines().find_map(|line| line.strip_prefix('#')?.trim().strip_prefix(name))?;
        line.trim_start_matches(':').split_whitespace().next()?.parse::<u64>().ok()
    };
    let max_us = comment("Max Latencies").ok_or("its output has no line \"Max Latencies\"")?;
    let overflows = comment("Histogram Overflows").ok_or("its output has no line \"Histogram Overflows\"")?;
    for line in text.lines().filter(|line| !line.starts_with('#') && !line.trim().is_empty()) {
        let mut words = line.split_whitespace().map(str::parse::<u64>);
        match (words.next(), words.next(), words.next()) {
            (Some(Ok(us)), Some(Ok(count)), None) => all.record(us * 1_000 + CUT_OFF_NS, count),
            _ => return Err(format!("unknown line {line:?}")),
        }
    }
    all.record(max_us * 1_000 + CUT_OFF_NS, overflows);
    if all.count() == 0 { Err("it counted nothing".into()) } else { Ok(all) }
}

/// Runs our own probe for `seconds` in a process of its own. Returns its record, and the granted properties.
pub fn run_probe(spec: &RealtimeConfig, seconds: f64) -> Result<(Distribution, Vec<String>), Failure> {
    let program = std::env::current_exe().map_err(|error| unmeasured(PROBE, error))?;
    let mut command = Command::new(program);
    command.args([PROBE, "--seconds", &seconds.to_string()]);
    if let Policy::Fifo { priority } = spec.policy {
        command.args(["--priority", &priority.to_string()]);
    }
    if let Some(cores) = &spec.cores {
        command.args(["--cores", &core_text(cores)]);
    }
    if spec.lock_memory {
        command.arg("--lock-memory");
    }
    if spec.cpu_dma_latency {
        command.arg("--cpu-dma-latency");
    }
    let text = output(command, PROBE)?;
    let value: Value = serde_json::from_str(&text).map_err(|error| unmeasured(PROBE, error))?;
    let all = Distribution::deserialize(&value).map_err(|error| unmeasured(PROBE, error))?;
    let granted = Vec::deserialize(&value["realtime"]).map_err(|error| unmeasured(PROBE, error))?;
    Ok((all, granted))
}

#[derive(Debug, Parser)]
struct Probe {
    #[arg(long)]
    seconds: f64,
    #[arg(long)]
    priority: Option<u8>,
    #[arg(long, value_delimiter = ',')]
    cores: Option<Vec<usize>>,
    #[arg(long)]
    lock_memory: bool,
    #[arg(long)]
    cpu_dma_latency: bool,
}

/// Runs the probe's process: sleeps from deadline to deadline of the tick grid, and prints how late it woke.
pub fn probe_main(arguments: impl Iterator<Item = String>) {
    let probe = Probe::parse_from(arguments);
    rt::die_with_parent();
    let policy = probe.priority.map_or(Policy::Other, |priority| Policy::Fifo { priority });
    let mut series = Series::default();
    let Probe { cores, lock_memory, cpu_dma_latency, .. } = probe;
    let report = Realtime::apply(&RealtimeConfig { policy, cores, lock_memory, cpu_dma_latency });
    let start = rt::now();
    let end = start.plus_ns((probe.seconds * 1e9) as u64);
    let mut k = tick_at(start) + 1;
    loop {
        rt::sleep_until(deadline(k));
        let woke = rt::now();
        series.record(woke, woke.since(deadline(k)));
        if woke >= end {
            break;
        }
        k = tick_at(woke) + 1;
    }
    let mut value = series.into_json();
    value["realtime"] = json!(report.lines());
    println!("{value}");
}

#[cfg(test)]
mod tests {
    use super::*;

    const ANSWER: &str = "# /dev/cpu_dma_latency set to 0us\n# Histogram\n000000 000000\n000019 000002\n000020 000006\n\
                          000057 000001\n# Total: 000000009\n# Min Latencies: 00019\n# Avg Latencies: 00028\n\
                          # Max Latencies: 130000\n# Histogram Overflows: 00001\n# Histogram Overflow at cycle number:\n\
                          # Thread 0: 00004\n\n";

    #[test]
    fn cyclictest_histogram_is_read_with_its_overflows() {
        let all = parse_cyclictest(ANSWER).expect("its form");
        assert_eq!(all.count(), 10);
        assert!((all.quantile_us(0.5).unwrap() - 20.5).abs() < 0.1);
        assert!((all.max_us() - 130_000.5).abs() < 0.1);
    }

    #[test]
    fn unknown_cyclictest_output_is_refused() {
        for (wrong, named) in [
            (ANSWER.replace("000019 000002", "T: 0 (1234) P:70"), "unknown line"),
            (ANSWER.replace("Max", "Largest"), "Max Latencies"),
            (ANSWER.replace("Overflows", "Rest"), "Histogram Overflows"),
            ("# Max Latencies: 0\n# Histogram Overflows: 0\n".to_owned(), "nothing"),
        ] {
            let error = parse_cyclictest(&wrong).expect_err(named);
            assert!(error.contains(named), "{error}");
        }
    }
}
