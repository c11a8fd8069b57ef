//! The command line program of the library.

use clap::Parser;
use indicatif::{ProgressBar, ProgressStyle};
use rt::{Exit, Failure};
use serde_json::Value;
use simulate::campaign::{self, Plan};
use simulate::cli::Cli;
use simulate::subject::Subject;
use simulate::{report, schedule};
use std::fs::{File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

fn main() -> ExitCode {
    rt::abort_on_panic();
    let cli = Cli::parse();
    // The daemon does the same, before any other thread starts.
    let _ = rt::flush_denormals();
    if cli.list {
        print!("{}", Cli::listing());
        return ExitCode::SUCCESS;
    }
    rt::finish("simulate", begin(&cli))
}

fn begin(cli: &Cli) -> Result<bool, Failure> {
    let plan = cli.plan().map_err(Failure::with(Exit::Usage))?;
    let mut figures = cli.json.as_deref().map(Figures::open).transpose().map_err(Failure::with(Exit::CantCreate))?;
    let subject = Subject::load(&cli.config, cli.robot.as_ref()).map_err(Failure::with(Exit::Config))?;
    match cli.replay {
        Some(seed) => replay(cli, &plan, &subject, seed, figures.as_mut()),
        None => campaign(cli, &plan, &subject, figures.as_mut()),
    }
}

/// The file that receives the figures. It is opened before the run, so that no run is wasted on an unwritable
/// file. Its old content stays until the figures are written.
struct Figures(PathBuf, File);

impl Figures {
    fn open(path: &Path) -> Result<Self, String> {
        let file = OpenOptions::new().write(true).create(true).truncate(false).open(path);
        Ok(Self(path.to_owned(), file.map_err(|error| format!("{}: {error}", path.display()))?))
    }

    fn write(&mut self, figures: &Value) -> Result<(), Failure> {
        let Self(path, file) = self;
        // A pipe or a terminal has no length.
        let regular = file.metadata().is_ok_and(|file| file.is_file());
        let cut = if regular { file.set_len(0) } else { Ok(()) };
        let written = cut.and_then(|()| file.write_all(format!("{figures:#}\n").as_bytes()));
        written.map_err(|error| Failure::new(Exit::CantCreate, format!("{}: {error}", path.display())))
    }
}

fn campaign(cli: &Cli, plan: &Plan, subject: &Subject, figures: Option<&mut Figures>) -> Result<bool, Failure> {
    let bar = ProgressBar::new(plan.seeds);
    if let Ok(style) = ProgressStyle::with_template("{wide_bar} {pos}/{len} runs, {elapsed}, {eta} left") {
        bar.set_style(style);
    }
    let start = Instant::now();
    let sum = campaign::run(subject, plan, || bar.inc(1)).map_err(Failure::with(Exit::Software))?;
    bar.finish_and_clear();
    let wall_s = start.elapsed().as_secs_f64();
    print!("{}", report::words(plan, &sum, &cli.config, wall_s));
    if let Some(figures) = figures {
        figures.write(&report::json(plan, &sum, subject.hash, wall_s))?;
    }
    Ok(sum.holds())
}

fn replay(
    cli: &Cli,
    plan: &Plan,
    subject: &Subject,
    seed: u64,
    figures: Option<&mut Figures>,
) -> Result<bool, Failure> {
    let episodes = match &cli.faults {
        Some(text) => {
            schedule::from_text(text).map_err(|cause| Failure::new(Exit::Usage, format!("--faults: {cause}")))?
        }
        None => campaign::drawn(seed, plan),
    };
    println!("{}", schedule::to_text(&episodes));
    let start = Instant::now();
    let engaged = subject.engaged(plan.is_remote).map_err(Failure::with(Exit::Software))?;
    let outcome = campaign::single(&engaged, subject, seed, plan, &episodes);
    print!("{}", report::replay_words(seed, &outcome));
    let holds = outcome.violation.is_none();
    if let Some(figures) = figures {
        let (plan, sum) = campaign::alone(plan, seed, &episodes, outcome);
        figures.write(&report::json(&plan, &sum, subject.hash, start.elapsed().as_secs_f64()))?;
    }
    Ok(holds)
}
