//! The command line.

use crate::error::ChaosError;
use crate::injection::Target;
use clap::Parser;
use std::path::PathBuf;

/// Upper bound on the trials. More would take a month at some seconds each, so a larger value is a typing
/// error.
const TRIALS_MAX: u64 = 1_000_000;

/// Kills and suspends the real processes, a client and an operator at random moments, and watches the robot
/// come to rest. Exits with 1 if a promise was broken.
#[derive(Clone, Debug, Parser)]
#[command(name = "chaos", version)]
pub struct Cli {
    /// Number of faults with SIGKILL.
    #[arg(long, value_name = "N", default_value_t = 2000)]
    pub kills: u64,
    /// Number of faults with SIGSTOP and SIGCONT.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub suspends: u64,
    /// Seed of the targets and moments. The machine's own timing differs from run to run.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Hit only this one: ingest, retarget, control, sim, client or operator.
    #[arg(long, value_name = "NAME")]
    pub only: Option<String>,
    /// Share of the faults that wait until the robot is engaged. The others occur while it engages.
    #[arg(long, value_name = "SHARE", default_value_t = 0.8)]
    pub engaged: f64,
    /// Write the figures to this file as JSON.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Settings file.
    #[arg(long, value_name = "FILE", default_value = "config/teleop.toml")]
    pub config: PathBuf,
}

impl Cli {
    /// Checks the options.
    ///
    /// # Errors
    /// Returns an error that names the option, its value and the bound.
    pub fn check(&self) -> Result<(), ChaosError> {
        let total = self.kills.saturating_add(self.suspends);
        for (option, value, low) in
            [("--kills", self.kills, 0), ("--suspends", self.suspends, 0), ("--kills and --suspends", total, 1)]
        {
            if !(low..=TRIALS_MAX).contains(&value) {
                return Err(ChaosError::Option { option, value, low, high: TRIALS_MAX });
            }
        }
        if !(0.0..=1.0).contains(&self.engaged) {
            return Err(ChaosError::Share { option: "--engaged", value: self.engaged });
        }
        self.victims().map(|_| ())
    }

    /// Returns the targets of the faults.
    ///
    /// # Errors
    /// Returns an error that names an unknown target.
    pub fn victims(&self) -> Result<Vec<Target>, ChaosError> {
        let Some(name) = &self.only else { return Ok(Target::ALL.to_vec()) };
        let found = Target::ALL.iter().find(|victim| victim.name() == name);
        found.map(|&victim| vec![victim]).ok_or_else(|| ChaosError::Target(name.clone()))
    }
}
