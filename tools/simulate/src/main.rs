//! The command line program of the library.

use ::report::{Progress, print};
use clap::Parser;
use rt::{Exit, Failure};
use simulate::campaign::{self, Plan};
use simulate::cli::Cli;
use simulate::subject::Subject;
use simulate::{report, schedule};
use std::process::ExitCode;
use std::time::Instant;

fn main() -> ExitCode {
    rt::abort_on_panic();
    let cli = Cli::parse();
    // The daemon does the same, before any other thread starts.
    let _ = rt::flush_denormals();
    if cli.list {
        print(&Cli::listing());
        return ExitCode::SUCCESS;
    }
    rt::finish("simulate", begin(&cli))
}

fn begin(cli: &Cli) -> Result<bool, Failure> {
    let plan = cli.plan()?;
    let mut subject = Subject::load(&cli.config, cli.robot.as_ref()).map_err(Failure::with(Exit::Config))?;
    (subject.is_camera, subject.is_policy) = (plan.is_camera, plan.is_policy);
    match cli.replay {
        Some(seed) => replay(cli, &plan, &subject, seed),
        None => campaign(cli, &plan, &subject),
    }
}

fn campaign(cli: &Cli, plan: &Plan, subject: &Subject) -> Result<bool, Failure> {
    let progress = Progress::new("simulate", plan.seeds, "runs");
    let start = Instant::now();
    let sum = campaign::run(subject, plan, || progress.add(1)).map_err(Failure::with(Exit::Software))?;
    drop(progress);
    print(&report::text(plan, &sum, &cli.config, start.elapsed().as_secs_f64()));
    Ok(sum.holds())
}

fn replay(cli: &Cli, plan: &Plan, subject: &Subject, seed: u64) -> Result<bool, Failure> {
    let episodes = match &cli.faults {
        Some(text) => {
            schedule::from_text(text).map_err(|cause| Failure::new(Exit::Usage, format!("--faults: {cause}")))?
        }
        None => campaign::drawn(seed, plan),
    };
    println!("{}", schedule::to_text(&episodes));
    let engaged = subject.engaged(plan.is_remote).map_err(Failure::with(Exit::Software))?;
    let outcome = campaign::single(&engaged, subject, seed, plan, &episodes);
    print(&report::replay_text(seed, &outcome));
    Ok(outcome.violation.is_none())
}
