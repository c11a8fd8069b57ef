//! The command line.

use crate::error::LatencyError;
use clap::{Parser, ValueEnum};
use std::path::PathBuf;
use std::str::FromStr;

/// Shortest run: each variant needs some skeletons of a moving person.
const SECONDS_MIN: f64 = 2.0;
/// Longest run, a day: the per-second record of a process holds about an hour, everything else any time.
const SECONDS_MAX: f64 = 86_400.0;
/// A soak: 18 s for a test, a month at most.
const SOAK_HOURS: [f64; 2] = [0.005, 744.0];
/// Blows: engaging alone takes some seconds; one a day at least.
const STRIKE_EVERY_S: [f64; 2] = [8.0, 86_400.0];
/// Rates at which `ingest` takes live frames.
const RATE_HZ: [f64; 2] = [30.0, 240.0];
/// More busy threads than that are a mistake.
const LOAD_MAX: usize = 1024;
/// Highest core that the settings can name.
const CORE_MAX: usize = 1023;

/// Measures the latency of every hop from a skeleton to the command at the driver, with the real processes: woken by
/// events and polled, in turns, beside the bare timer (cyclictest, and a probe of equal method) on the same core, with
/// the same priority and load. Exits with 1 if a run was not valid.
#[derive(Clone, Debug, Parser)]
#[command(name = "latency", version)]
pub struct Cli {
    /// Measured time of all blocks together; starting and engaging come on top, some seconds a block.
    #[arg(long, value_name = "S", default_value_t = 60.0)]
    pub seconds: f64,
    /// Busy threads, SCHED_OTHER, that walk through memory during all blocks alike.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub load: usize,
    /// Scheduling of the real-time processes and of the references, in place of realtime.policy.
    #[arg(long, value_enum)]
    pub policy: Option<Policy>,
    /// Cores of the real-time processes and of the references, such as 1 or 2,3; free leaves it to the kernel. In place
    /// of realtime.cores.
    #[arg(long, value_name = "CORES")]
    pub pin: Option<Pin>,
    /// Write the figures here as JSON.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Draw distributions and jitter over time here, a PNG of 1600 x 1200.
    #[arg(long, value_name = "FILE.png")]
    pub plot: Option<PathBuf>,
    /// Insist on this reference (69 if it is not installed); without, cyclictest is used if it is there.
    #[arg(long, value_enum)]
    pub compare: Option<Compare>,
    /// Settings; the blocks use a copy with what the options change. A program installed in /usr/bin defaults to
    /// /etc/teleop/teleop.toml if that exists.
    #[arg(long, value_name = "FILE", default_value_os_t = pipeline::default_config())]
    pub config: PathBuf,
    /// Skeletons per second; their phase walks through the whole tick, so that the wait for the deadline is sampled evenly.
    #[arg(long, value_name = "HZ", default_value_t = 120.0)]
    pub rate_hz: f64,
    /// Instead of measuring: run so many hours, strike somebody once a minute, and watch memory, file descriptors,
    /// threads, segments, and stops that no blow explains.
    #[arg(long, value_name = "HOURS", conflicts_with_all = ["seconds", "load", "policy", "pin", "plot", "compare", "rate_hz"])]
    pub soak: Option<f64>,
    /// Instead of comparing with polling and the bare timer: with and without a page (`teleopd view`) and a recorder (`record
    /// --full`, to be built before) beside the instance, in turns.
    #[arg(long, conflicts_with_all = ["soak", "plot", "compare"])]
    pub watched: bool,
    /// Time between two blows of a soak, s.
    #[arg(long, value_name = "S", default_value_t = 60.0, requires = "soak", conflicts_with = "watched")]
    pub strike_every: f64,
}

/// Scheduling policy.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Policy {
    /// SCHED_FIFO.
    Fifo,
    /// SCHED_OTHER.
    Other,
}

/// A reference that is insisted on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Compare {
    /// Of rt-tests.
    Cyclictest,
}

/// Where the real-time processes run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Pin {
    /// Wherever the kernel likes.
    Free,
    /// On these cores.
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
    /// Refuses what cannot be done.
    ///
    /// # Errors
    /// Names the option, its value and the bound.
    pub fn check(&self) -> Result<(), LatencyError> {
        let bounds = [
            ("--seconds", self.seconds, SECONDS_MIN, SECONDS_MAX),
            ("--rate-hz", self.rate_hz, RATE_HZ[0], RATE_HZ[1]),
            ("--load", self.load as f64, 0.0, LOAD_MAX as f64),
            ("--soak", self.soak.unwrap_or(SOAK_HOURS[1]), SOAK_HOURS[0], SOAK_HOURS[1]),
            ("--strike-every", self.strike_every, STRIKE_EVERY_S[0], STRIKE_EVERY_S[1]),
        ];
        for (option, value, low, high) in bounds {
            // Written so that NaN is refused too.
            if !(value >= low && value <= high) {
                let bound = format!("must be from {low} to {high}");
                return Err(LatencyError::Option { option, value: value.to_string(), bound });
            }
        }
        match &self.plot {
            Some(path) if path.extension().is_none_or(|extension| extension != "png") => Err(LatencyError::Option {
                option: "--plot",
                value: path.display().to_string(),
                bound: "must end in .png".into(),
            }),
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(arguments: &[&str]) -> Cli {
        Cli::try_parse_from(["latency"].iter().chain(arguments)).expect("these options exist")
    }

    #[test]
    fn cores_are_a_list_or_free() {
        assert_eq!("free".parse(), Ok(Pin::Free));
        assert_eq!("1".parse(), Ok(Pin::Cores(vec![1])));
        assert_eq!("2, 3".parse(), Ok(Pin::Cores(vec![2, 3])));
        for wrong in ["", "one", "1,", "-1", "1024"] {
            assert!(wrong.parse::<Pin>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn what_is_out_of_bounds_is_refused_by_name() {
        assert!(parsed(&[]).check().is_ok());
        for (option, value) in [
            ("--seconds", "1"),
            ("--seconds", "NaN"),
            ("--seconds", "inf"),
            ("--rate-hz", "29"),
            ("--load", "2000"),
            ("--plot", "a.svg"),
            ("--soak", "0"),
        ] {
            let error = parsed(&[option, value]).check().expect_err(value);
            assert!(error.to_string().starts_with(option) && error.exit() == 64, "{error}");
        }
    }
}
