//! The command line.

use clap::{Parser, ValueEnum};
use report::check_bounds;
use rt::Failure;
use std::path::PathBuf;
use std::str::FromStr;

/// Shortest run. Each variant needs some skeletons of a moving person.
const SECONDS_MIN: f64 = 2.0;
/// Longest run: a day. The per-second record of a process holds about an hour, and everything else any time.
const SECONDS_MAX: f64 = 86_400.0;
/// Frame rates that `ingest` accepts from live clients.
const RATE_HZ: [f64; 2] = [30.0, 240.0];
/// Upper bound on the busy threads. A larger value is a typing error.
const LOAD_MAX: usize = 1024;
/// Highest core that the settings can name.
const CORE_MAX: usize = 1023;

/// Measures the latency of every hop from a skeleton to the command at the driver, with the real processes.
/// Event-driven and polled runs alternate. The bare timer runs for comparison on the same core, with the same
/// priority and load: cyclictest, and a probe with the same method. Exits with 1 if a run was not valid.
#[derive(Clone, Debug, Parser)]
#[command(name = "latency", version)]
pub struct Cli {
    /// Measured time of all blocks together. Starting and engaging come on top, some seconds per block.
    #[arg(long, value_name = "S", default_value_t = 60.0, value_parser = rt::number, allow_negative_numbers = true)]
    pub seconds: f64,
    /// Number of busy threads (SCHED_OTHER) that walk through memory during all blocks.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub load: usize,
    /// Scheduling of the real-time processes and of the references, instead of realtime.policy.
    #[arg(long, value_enum)]
    pub policy: Option<Policy>,
    /// Cores of the real-time processes and of the references, such as 1 or 2,3. The value free leaves the
    /// choice to the kernel. Used instead of realtime.cores.
    #[arg(long, value_name = "CORES")]
    pub pin: Option<Pin>,
    /// Write the figures to this file as JSON.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Require this reference (exit code 69 if it is not installed). By default cyclictest is used if it is present.
    #[arg(long, value_enum)]
    pub compare: Option<Compare>,
    /// Settings file. The blocks use a copy with the changes of the options. A program installed in /usr/bin
    /// defaults to /etc/teleop/teleop.toml if that exists.
    #[arg(long, value_name = "FILE", default_value_os_t = instance::default_config())]
    pub config: PathBuf,
    /// Skeletons per second. Their phase moves through the whole tick, so that the wait for the deadline is
    /// sampled evenly.
    #[arg(long, value_name = "HZ", default_value_t = 120.0, value_parser = rt::number, allow_negative_numbers = true)]
    pub rate_hz: f64,
}

/// Scheduling policy.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Policy {
    /// SCHED_FIFO.
    Fifo,
    /// SCHED_OTHER.
    Other,
}

/// A reference that must be present.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Compare {
    /// The program cyclictest of rt-tests.
    Cyclictest,
}

/// Placement of the real-time processes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Pin {
    /// The kernel chooses the cores.
    Free,
    /// These cores.
    Cores(Vec<usize>),
}

impl FromStr for Pin {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "free" {
            return Ok(Self::Free);
        }
        let core = |part: &str| match part.trim().parse() {
            Ok(core) if core <= CORE_MAX => Ok(core),
            _ => Err(format!("{part:?} is neither free nor a core from 0 to {CORE_MAX}")),
        };
        text.split(',').map(core).collect::<Result<_, _>>().map(Self::Cores)
    }
}

impl Cli {
    /// Checks the options.
    pub fn check(&self) -> Result<(), Failure> {
        check_bounds("--seconds", self.seconds, [SECONDS_MIN, SECONDS_MAX])?;
        check_bounds("--rate-hz", self.rate_hz, RATE_HZ)?;
        check_bounds("--load", self.load, [0, LOAD_MAX])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pin_option_takes_a_core_list_or_free() {
        assert_eq!("free".parse(), Ok(Pin::Free));
        assert_eq!("1".parse(), Ok(Pin::Cores(vec![1])));
        assert_eq!("2, 3".parse(), Ok(Pin::Cores(vec![2, 3])));
        for wrong in ["", "one", "1,", "-1", "1024"] {
            assert!(wrong.parse::<Pin>().is_err(), "{wrong}");
        }
    }
}
