//! The command line.

use crate::campaign::Plan;
use crate::kinds::{self, KINDS, named};
use crate::schedule::TICKS_MIN;
use clap::Parser;
use config::RobotChoice;
use report::{check_bounds, cores, out_of_bounds};
use rt::Failure;
use std::path::PathBuf;

/// Longest run: 19 hours of robot time. A larger value is a typing error.
const TICKS_MAX: u64 = 100_000_000;
/// Default settings file.
pub const CONFIG: &str = "config/teleop.toml";
/// Upper bound on the threads. A larger value is a typing error.
const JOBS_MAX: usize = 1024;

/// Runs all stages in virtual time under faults that a seed decides. An independent oracle judges every tick.
/// Exits with 1 if a promise was broken or a fault that had to occur did not.
#[derive(Clone, Debug, Parser)]
#[command(version)]
pub struct Cli {
    /// Number of runs, one per seed.
    #[arg(long, default_value_t = 100)]
    pub seeds: u64,
    /// Ticks of each run, at least 8,250. The last 7,500 (5 s) have no faults.
    #[arg(long, default_value_t = 60_000)]
    pub ticks: u64,
    /// The first seed.
    #[arg(long, default_value_t = 1)]
    pub first_seed: u64,
    /// Number of threads. The results do not depend on it.
    #[arg(long, default_value_t = cores())]
    pub jobs: usize,
    /// Stop at the first seed that breaks a promise, and print its schedule as it was drawn.
    #[arg(long, conflicts_with = "replay")]
    pub until_found: bool,
    /// Use only faults with these names or identities.
    #[arg(long, value_name = "ID", num_args = 1..)]
    pub fault: Vec<String>,
    /// Run this seed alone, and print what happens.
    #[arg(long, value_name = "SEED")]
    pub replay: Option<u64>,
    /// Use this schedule instead of the one that the seed draws. The format is the one that a failure prints.
    #[arg(long, value_name = "LIST", requires = "replay")]
    pub faults: Option<String>,
    /// Put the operator and the person at another machine. The wires of their link lose, delay, reorder, repeat and break
    /// besides, and the clocks drift and jump.
    #[arg(long)]
    pub link: bool,
    /// Show the person to one camera: landmarks with the errors of a landmarker, which loses people and exchanges sides.
    #[arg(long)]
    pub camera: bool,
    /// Let a policy lead, with faults in its chunks and a person who takes over. A `--fault` of a policy implies it.
    #[arg(long)]
    pub policy: bool,
    /// Settings file.
    #[arg(long, default_value = CONFIG)]
    pub config: PathBuf,
    /// Another robot than that of the settings: its name, or its robot file.
    #[arg(long, value_name = "NAME|FILE")]
    pub robot: Option<RobotChoice>,
    /// List all faults with their identities.
    #[arg(long)]
    pub list: bool,
}

impl Cli {
    /// Returns the runs to do.
    pub fn plan(&self) -> Result<Plan, Failure> {
        check_bounds("--seeds", self.seeds, [1, 1_000_000_000])?;
        check_bounds("--ticks", self.ticks, [TICKS_MIN, TICKS_MAX])?;
        check_bounds("--jobs", self.jobs, [1, JOBS_MAX])?;
        let mut kinds = vec![];
        for text in &self.fault {
            let found = named(text);
            if found.is_empty() {
                return Err(out_of_bounds("--fault", text, "a name or an identity of --list"));
            }
            kinds.extend(found);
        }
        kinds.sort_unstable();
        kinds.dedup();
        if self.fault.is_empty() {
            kinds = kinds::all(self.policy);
        }
        let &Self { first_seed, seeds, ticks, jobs, until_found, link: is_remote, camera: is_camera, .. } = self;
        let is_policy = self.policy || kinds.iter().any(|&kind| kinds::is_policy(kind));
        Ok(Plan { first_seed, seeds, ticks, jobs, until_found, kinds, is_remote, is_camera, is_policy, bug: None })
    }

    /// Lists all faults.
    pub fn listing() -> String {
        let row = |kind: &crate::kinds::Kind| format!("{:20} {}\n", kind.name, kind.ids.join(" "));
        KINDS.iter().map(row).collect()
    }
}
