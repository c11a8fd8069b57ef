//! See the library.

use clap::Parser;
use indicatif::{ProgressBar, ProgressStyle};
use simulate::campaign::{self, Plan};
use simulate::cli::Cli;
use simulate::subject::Subject;
use simulate::{known, report, schedule};
use std::process::ExitCode;
use std::time::Instant;

/// Exit codes of sysexits(3).
const EX_USAGE: u8 = 64;
const EX_SOFTWARE: u8 = 70;
const EX_CANTCREAT: u8 = 73;
const EX_CONFIG: u8 = 78;

fn main() -> ExitCode {
    let cli = Cli::parse();
    // As the daemon does, before any other thread starts.
    let _ = rt::flush_denormals();
    if cli.list {
        print!("{}", Cli::listing());
        return ExitCode::SUCCESS;
    }
    match begin(&cli) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err((code, cause)) => {
            eprintln!("simulate: {cause}");
            ExitCode::from(code)
        }
    }
}

fn begin(cli: &Cli) -> Result<bool, (u8, String)> {
    let plan = cli.plan().map_err(|cause| (EX_USAGE, cause))?;
    match &cli.known_bug {
        _ if cli.known_bugs => return known::hunt(cli).map_err(|cause| (EX_USAGE, cause)),
        Some(name) if cli.replay.is_none() => return known::hunt_one(cli, name).map_err(|cause| (EX_USAGE, cause)),
        Some(name) => known::plant(name).map_err(|cause| (EX_USAGE, cause))?,
        None => {}
    }
    let subject = Subject::load(&cli.config).map_err(|error| (EX_CONFIG, error.to_string()))?;
    match cli.replay {
        Some(seed) => replay(cli, &plan, &subject, seed),
        None => campaign(cli, &plan, &subject),
    }
}

fn campaign(cli: &Cli, plan: &Plan, subject: &Subject) -> Result<bool, (u8, String)> {
    let bar = ProgressBar::new(plan.seeds);
    if let Ok(style) = ProgressStyle::with_template("{wide_bar} {pos}/{len} runs, {elapsed}, {eta} left") {
        bar.set_style(style);
    }
    let start = Instant::now();
    let sum = campaign::run(subject, plan, || bar.inc(1)).map_err(|cause| (EX_SOFTWARE, cause))?;
    bar.finish_and_clear();
    let wall_s = start.elapsed().as_secs_f64();
    print!("{}", report::words(plan, &sum, wall_s));
    if let Some(path) = &cli.json {
        let text = format!("{:#}\n", report::json(plan, &sum, wall_s));
        std::fs::write(path, text).map_err(|error| (EX_CANTCREAT, format!("{}: {error}", path.display())))?;
    }
    Ok(sum.holds())
}

fn replay(cli: &Cli, plan: &Plan, subject: &Subject, seed: u64) -> Result<bool, (u8, String)> {
    let episodes = match &cli.faults {
        Some(text) => schedule::from_text(text).map_err(|cause| (EX_USAGE, format!("--faults: {cause}")))?,
        None => campaign::drawn(seed, plan),
    };
    println!("{}", schedule::to_text(&episodes));
    let engaged = subject.engaged().map_err(|cause| (EX_SOFTWARE, cause))?;
    let outcome = campaign::single(&engaged, subject, seed, plan, &episodes);
    print!("{}", report::replay_words(seed, &outcome));
    Ok(outcome.violation.is_none())
}
