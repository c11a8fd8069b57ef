//! The command line.

use crate::injection::Target;
use clap::{Args, Parser, Subcommand};
use report::{check_bounds, out_of_bounds};
use rt::Failure;
use std::path::PathBuf;

/// Upper bound on the trials. More would take a month at some seconds each, so a larger value is a typing error.
const TRIALS_MAX: u64 = 1_000_000;

/// Bounds of a soak: 18 s for a test, and a month.
const SOAK_HOURS: [f64; 2] = [0.005, 744.0];
/// Bounds of the time between two faults of a soak. Engaging alone takes some seconds, and at least one fault a
/// day must occur.
const STRIKE_EVERY_S: [f64; 2] = [3.0, 86_400.0];

/// Kills and suspends the real processes, a client and an operator at random moments, and watches the robot
/// come to rest. Exits with 1 if a promise was broken.
#[derive(Clone, Debug, Parser)]
#[command(name = "chaos", version, args_conflicts_with_subcommands = true)]
pub struct Cli {
    #[command(subcommand)]
    pub command: Option<Command>,
    #[command(flatten)]
    pub trials: TrialsArgs,
}

/// Other kinds of chaos.
#[derive(Clone, Debug, Subcommand)]
pub enum Command {
    /// Run for hours, and hit one process with a fault once a minute. Watches memory, file descriptors, threads,
    /// segments, and stops that no fault explains. Exits with 1 if something grew or a promise was broken.
    Soak(SoakArgs),
}

/// Options of both.
#[derive(Clone, Debug, Args)]
pub struct CommonArgs {
    /// Write the figures to this file as JSON.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Settings file.
    #[arg(long, value_name = "FILE", default_value = "config/teleop.toml")]
    pub config: PathBuf,
}

/// Options of a soak.
#[derive(Clone, Debug, Args)]
pub struct SoakArgs {
    /// Length of the soak, h.
    #[arg(long, value_name = "HOURS", default_value_t = 1.0, value_parser = rt::number, allow_negative_numbers = true)]
    pub hours: f64,
    /// Time between two faults, s.
    #[arg(long, value_name = "S", default_value_t = 60.0, value_parser = rt::number, allow_negative_numbers = true)]
    pub strike_every: f64,
    /// Kill control and the driver, too. They are suspended otherwise, so that a slow leak shows.
    #[arg(long)]
    pub kill_all: bool,
    #[command(flatten)]
    pub common: CommonArgs,
}

/// Options of the trials.
#[derive(Clone, Debug, Args)]
pub struct TrialsArgs {
    /// Number of faults with SIGKILL.
    #[arg(long, value_name = "N", default_value_t = 2000)]
    pub kills: u64,
    /// Number of faults with SIGSTOP and SIGCONT.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub suspends: u64,
    /// Seed of the targets and moments. The machine's own timing differs from run to run.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Hit only this one: ingest, retarget, control, driver, client or operator.
    #[arg(long, value_name = "NAME")]
    pub only: Option<String>,
    /// Share of the faults that wait until the robot is engaged. The others occur while it engages.
    #[arg(long, value_name = "SHARE", default_value_t = 0.8, value_parser = rt::number, allow_negative_numbers = true)]
    pub engaged: f64,
    #[command(flatten)]
    pub common: CommonArgs,
}

impl SoakArgs {
    pub fn check(&self) -> Result<(), Failure> {
        check_bounds("--hours", self.hours, SOAK_HOURS)?;
        check_bounds("--strike-every", self.strike_every, STRIKE_EVERY_S)
    }
}

impl TrialsArgs {
    pub fn check(&self) -> Result<(), Failure> {
        let total = self.kills.saturating_add(self.suspends);
        check_bounds("--kills", self.kills, [0, TRIALS_MAX])?;
        check_bounds("--suspends", self.suspends, [0, TRIALS_MAX])?;
        check_bounds("--kills and --suspends", total, [1, TRIALS_MAX])?;
        check_bounds("--engaged", self.engaged, [0.0, 1.0])?;
        self.targets().map(|_| ())
    }

    /// Returns the targets of the faults.
    pub fn targets(&self) -> Result<Vec<Target>, Failure> {
        let Some(name) = &self.only else { return Ok(Target::ALL.to_vec()) };
        let found = Target::ALL.iter().find(|target| target.name() == name);
        let names = "ingest, retarget, control, driver, client or operator";
        found.map(|&target| vec![target]).ok_or_else(|| out_of_bounds("--only", name, names))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rt::Exit;

    #[test]
    fn option_out_of_bounds_is_refused_by_name() {
        for (option, value) in [("--hours", "0"), ("--strike-every", "2")] {
            let parsed = Cli::try_parse_from(["chaos", "soak", option, value]).expect("these options exist");
            let Some(Command::Soak(args)) = parsed.command else { panic!("no soak") };
            let failure = args.check().expect_err(value);
            assert!(failure.text.starts_with(option) && failure.exit == Exit::Usage, "{failure}");
        }
        let none = Cli::try_parse_from(["chaos", "--kills", "0"]).expect("this option exists").trials;
        let failure = none.check().expect_err("no faults");
        assert_eq!(failure.text, "--kills and --suspends = 0: must be 1 to 1000000");
    }
}
