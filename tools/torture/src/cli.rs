//! The command line.

use crate::chunk::PART_TICKS;
use crate::error::TortureError;
use crate::machine::cores;
use clap::{Args, Parser, Subcommand};
use messages::TICK_HZ;
use std::path::PathBuf;

/// Longest run: 21 years of robot time; more is a slip of the finger.
const TICKS_MAX: u64 = 1_000_000_000_000;
/// More threads than that are a mistake.
const THREADS_MAX: usize = 1024;

/// Attacks whole-body control and the gate, and judges every executed step by the simulated robot's checker and every
/// thousandth stop plan, rolled out to rest, by other distances. Exits with 1 if a promise was broken.
#[derive(Clone, Debug, Parser)]
#[command(version, args_conflicts_with_subcommands = true)]
pub struct Cli {
    /// Another way of torture.
    #[command(subcommand)]
    pub command: Option<Command>,
    /// The attack.
    #[command(flatten)]
    pub attack: AttackArgs,
}

/// Other ways of torture.
#[derive(Clone, Debug, Subcommand)]
pub enum Command {
    /// The longest stop of random and corner states against its bound in closed form; exits with 1 if it is exceeded.
    StopTimes(StopTimesArgs),
    /// Plays every motion file of a folder through all stages, offline; exits with 1 on a violation or a failed run.
    Motions(MotionsArgs),
    /// The duration of the control tick, smooth in the open and under jumping targets.
    Bench(BenchArgs),
}

/// Options of the attack.
#[derive(Clone, Debug, Args)]
pub struct AttackArgs {
    /// Ticks of control under attack, all parts together; 1500 are a second of the robot. The goals come on top.
    #[arg(long, default_value_t = 1_000_000)]
    pub ticks: u64,
    /// Ticks per second. The rate is built in (`messages::TICK_HZ`): only 1500 is accepted.
    #[arg(long, default_value_t = TICK_HZ)]
    pub rate: u64,
    /// Decides every choice of the attackers; the same seed gives the same figures on any number of threads, but for
    /// durations.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Attack in this part alone, as a failure names it: 0 for the first 100,000 ticks. Goals are left out.
    #[arg(long, value_name = "N")]
    pub part: Option<u64>,
    /// Random safe postures, each to be reached within 8 s of the robot's time, and home again; each counts as one, whatever
    /// --ticks says. 0 leaves them out.
    #[arg(long, default_value_t = 168)]
    pub goals: u64,
    /// Leave certificate and gate out: then the same attacks must find collisions, and not finding one is the failure.
    #[arg(long)]
    pub no_certificate: bool,
    /// With --no-certificate, leave the gate in: what it catches by itself. Not denying anything is then the failure.
    #[arg(long, requires = "no_certificate")]
    pub keep_gate: bool,
    /// Leave the proof of torques out: then the same attacks must overload motors, and not finding one is the failure.
    #[arg(long, conflicts_with = "no_certificate")]
    pub no_torque: bool,
    /// So much in both hands, kg.
    #[arg(long, value_name = "KG", default_value_t = 0.0, conflicts_with_all = ["no_certificate", "no_torque"])]
    pub payload_kg: f64,
    /// Do not tell whole-body control of it: then motors must be overloaded, and not finding one is the failure.
    #[arg(long, requires = "payload_kg")]
    pub untold: bool,
    /// What every command has.
    #[command(flatten)]
    pub common: Common,
    /// Threads; more of them than idle cores makes the durations meaningless.
    #[arg(long, default_value_t = cores())]
    pub threads: usize,
}

/// What every command has.
#[derive(Clone, Debug, Args)]
pub struct Common {
    /// Settings file: its robot among its obstacles.
    #[arg(long, default_value = "config/teleop.toml")]
    pub config: PathBuf,
    /// This robot file instead, without obstacles.
    #[arg(long)]
    pub robot: Option<PathBuf>,
    /// Write the figures here as JSON too; `-` is standard output, with the words on standard error.
    #[arg(long)]
    pub json: Option<PathBuf>,
}

/// Options of `stop-times`.
#[derive(Clone, Debug, Args)]
pub struct StopTimesArgs {
    /// Random states of all joints.
    #[arg(long, default_value_t = 1_000_000)]
    pub states: u64,
    /// Of the random states.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// What every command has.
    #[command(flatten)]
    pub common: Common,
    /// Threads.
    #[arg(long, default_value_t = cores())]
    pub threads: usize,
}

/// Options of `motions`.
#[derive(Clone, Debug, Args)]
pub struct MotionsArgs {
    /// Folder of motion files (.bvh, .npy, .npz).
    pub folder: PathBuf,
    /// Settings file.
    #[arg(long, default_value = "config/teleop.toml")]
    pub config: PathBuf,
    /// Write the figures here as JSON too; `-` is standard output, with the words on standard error.
    #[arg(long)]
    pub json: Option<PathBuf>,
    /// Threads.
    #[arg(long, default_value_t = cores())]
    pub threads: usize,
}

/// Options of `bench`.
#[derive(Clone, Debug, Args)]
pub struct BenchArgs {
    /// Ticks of each kind of motion.
    #[arg(long, default_value_t = 100_000)]
    pub ticks: u64,
    /// Of the jumping targets.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// What every command has.
    #[command(flatten)]
    pub common: Common,
}

/// Refuses numbers out of their bounds.
pub fn check_counts(counts: &[(&'static str, u64)], threads: usize) -> Result<(), TortureError> {
    for &(option, value) in counts {
        if value > TICKS_MAX {
            return Err(TortureError::Option {
                option,
                value: value.to_string(),
                bound: format!("at most {TICKS_MAX}"),
            });
        }
    }
    if threads == 0 || threads > THREADS_MAX {
        let bound = format!("must be 1 to {THREADS_MAX}");
        return Err(TortureError::Option { option: "--threads", value: threads.to_string(), bound });
    }
    Ok(())
}

impl AttackArgs {
    /// Refuses what cannot be done.
    ///
    /// # Errors
    /// Names the option, its value and the bound.
    pub fn check(&self) -> Result<(), TortureError> {
        if self.rate != TICK_HZ {
            let bound =
                format!("must be {TICK_HZ}: the tick rate is built into every stage and message (messages::TICK_HZ)");
            return Err(TortureError::Option { option: "--rate", value: self.rate.to_string(), bound });
        }
        if !(0.0..=robot::PAYLOAD_MAX_KG).contains(&self.payload_kg) {
            let bound = format!("must be 0 to {}", robot::PAYLOAD_MAX_KG);
            return Err(TortureError::Option { option: "--payload-kg", value: self.payload_kg.to_string(), bound });
        }
        if self.ticks == 0 {
            let bound = "must be at least 1".into();
            return Err(TortureError::Option { option: "--ticks", value: "0".into(), bound });
        }
        let parts = self.ticks.div_ceil(PART_TICKS);
        if let Some(part) = self.part.filter(|&part| part >= parts) {
            let bound = format!("must be below {parts}, the number of parts of {PART_TICKS} ticks in --ticks");
            return Err(TortureError::Option { option: "--part", value: part.to_string(), bound });
        }
        check_counts(&[("--ticks", self.ticks), ("--goals", self.goals)], self.threads)
    }
}
