//! The command line.

use crate::chunk::PART_TICKS;
use crate::stages::Subject;
use clap::{Args, Parser, Subcommand};
use config::RobotChoice;
use report::{check_bounds, cores, out_of_bounds};
use rt::Failure;
use std::path::PathBuf;

/// Longest run: 21 years of robot time. A larger value is a typing error.
const TICKS_MAX: u64 = 1_000_000_000_000;
/// Upper bound on the threads. A larger value is a typing error.
const THREADS_MAX: usize = 1024;

/// Attacks whole-body control and the gate. The simulated robot's checker judges every executed step. Every
/// thousandth stop plan is rolled out to rest and judged by an independent distance computation. Exits with 1
/// if a promise was broken, or if the robot returned home from fewer than 90 % of the goals.
#[derive(Clone, Debug, Parser)]
#[command(version, args_conflicts_with_subcommands = true)]
pub struct Cli {
    #[command(subcommand)]
    pub command: Option<Command>,
    #[command(flatten)]
    pub attack: AttackArgs,
}

/// Other kinds of torture.
#[derive(Clone, Debug, Subcommand)]
pub enum Command {
    /// Compare the longest stop of random and corner states with its closed-form bound. Exits with 1 if it
    /// exceeds the bound.
    StopTimes(StopTimesArgs),
}

/// Options of the attack.
#[derive(Clone, Debug, Args)]
pub struct AttackArgs {
    /// Ticks of control under attack, all parts together. 1500 are one second of the robot. The goals are additional.
    #[arg(long, default_value_t = 1_000_000)]
    pub ticks: u64,
    /// Run only this part of the attack, as a failure names it: 0 for the first 100,000 ticks. Skips the goals.
    #[arg(long, value_name = "N")]
    pub part: Option<u64>,
    /// Number of random safe postures, each to be reached within 8 s of the robot's time, and home again. Each
    /// counts as one, regardless of --ticks. 0 skips them, and so does each change below.
    #[arg(long, default_value_t = 168)]
    pub goals: u64,
    #[command(flatten)]
    pub changes: Changes,
    #[command(flatten)]
    pub common: Common,
}

/// Changes of the attacked stages, to show that the attacks are effective. By default they run as in the daemon.
#[derive(Clone, Copy, Debug, Default, Args)]
pub struct Changes {
    /// Leave certificate and gate out. The same attacks must then find collisions. Finding none is the failure.
    #[arg(long)]
    pub no_certificate: bool,
    /// Leave the proof of torques out. The same attacks must then overload motors. Finding no overload is the failure.
    #[arg(long, conflicts_with = "no_certificate")]
    pub no_torque: bool,
    /// Payload in each of both hands, kg.
    #[arg(long, value_name = "KG", default_value_t = 0.0, conflicts_with_all = ["no_certificate", "no_torque"],
        value_parser = rt::number, allow_negative_numbers = true)]
    pub payload_kg: f64,
    /// Whole-body control does not know the payload. Motors must then be overloaded. Finding no overload is
    /// the failure.
    #[arg(long = "payload-hidden", requires = "payload_kg")]
    pub hidden: bool,
}

/// Options of every command.
#[derive(Clone, Debug, Args)]
pub struct Common {
    /// Settings file, which names the robot and its obstacles.
    #[arg(long, default_value = "config/teleop.toml")]
    pub config: PathBuf,
    /// Another robot than that of the settings: its name, or its robot file.
    #[arg(long, value_name = "NAME|FILE")]
    pub robot: Option<RobotChoice>,
    /// Seed of every random choice. The same seed gives the same figures on any number of threads, except durations.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Number of threads. More threads than idle cores make the durations meaningless.
    #[arg(long, default_value_t = cores())]
    pub threads: usize,
}

/// Options of `stop-times`.
#[derive(Clone, Debug, Args)]
pub struct StopTimesArgs {
    /// Number of random states of all joints.
    #[arg(long, default_value_t = 1_000_000)]
    pub states: u64,
    #[command(flatten)]
    pub common: Common,
}

/// Checks a number of ticks or states, and of threads.
pub fn check_counts(option: &str, count: u64, threads: usize) -> Result<(), Failure> {
    check_bounds(option, count, [1, TICKS_MAX])?;
    check_bounds("--threads", threads, [1, THREADS_MAX])
}

impl AttackArgs {
    pub fn check(&self) -> Result<(), Failure> {
        check_bounds("--payload-kg", self.changes.payload_kg, [0.0, robot::PAYLOAD_MAX_KG])?;
        check_counts("--ticks", self.ticks, self.common.threads)?;
        check_bounds("--goals", self.goals, [0, TICKS_MAX])?;
        let parts = self.ticks.div_ceil(PART_TICKS);
        match self.part.filter(|&part| part >= parts) {
            Some(part) => {
                let bound = format!("below {parts}, the number of parts of {PART_TICKS} ticks in --ticks");
                Err(out_of_bounds("--part", part, bound))
            }
            None => Ok(()),
        }
    }
}

impl Common {
    /// Loads the robot, and the stages with these changes.
    pub fn subject(&self, changes: Changes) -> Result<Subject, Failure> {
        Subject::load(&self.config, self.robot.as_ref(), changes)
    }
}
