//! The command line program of the library.

use clap::Parser;
use config::Overrides;
use indicatif::{ProgressBar, ProgressStyle};
use messages::TICK_HZ;
use rt::{Exit, Failure};
use sim::ViolationKind;
use std::process::ExitCode;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;
use torture::cli::{AttackArgs, BenchArgs, Cli, Command, MotionsArgs, StopTimesArgs, check_counts};
use torture::error::TortureError;
use torture::figures::Figures;
use torture::goals::Goals;
use torture::machine::Machine;
use torture::parallel::{derived_seed, in_parallel};
use torture::report;
use torture::stages::Subject;
use torture::{bench, chunk, goals, motions, stop_times};

fn main() -> ExitCode {
    rt::abort_on_panic();
    let cli = Cli::parse();
    // The daemon does the same, before any other thread starts.
    let _ = rt::flush_denormals();
    let done = match &cli.command {
        None => attack(&cli.attack),
        Some(Command::StopTimes(args)) => measure_stops(args),
        Some(Command::Motions(args)) => play(args),
        Some(Command::Bench(args)) => measure_ticks(args),
    };
    rt::finish("torture", done.map_err(|error| Failure::new(exit(&error), error)))
}

fn exit(error: &TortureError) -> Exit {
    match error {
        TortureError::Option { .. } => Exit::Usage,
        TortureError::Config(_) | TortureError::Interface { .. } | TortureError::Stage { .. } => Exit::Config,
        TortureError::Motion(_) | TortureError::NoMotions(_) => Exit::NoInput,
        TortureError::Write { .. } => Exit::CantCreate,
    }
}

/// Time between two redraws of the progress on a terminal, even without progress.
const REDRAWN_EVERY: Duration = Duration::from_secs(10);

fn progress(length: u64, unit: &str) -> ProgressBar {
    let bar = ProgressBar::new(length);
    let template = format!("{{wide_bar}} {{pos}}/{{len}} {unit}{{msg}}, {{elapsed}}, {{eta}} left");
    if let Ok(style) = ProgressStyle::with_template(&template) {
        bar.set_style(style);
    }
    // A part takes long. So the line appears at once, and shows the elapsed time. Without a terminal nothing is
    // drawn.
    bar.tick();
    bar.enable_steady_tick(REDRAWN_EVERY);
    bar
}

/// Result of a job: a part of the attack, or some goals.
enum Outcome {
    Attacked(Box<Figures>),
    Visited(Goals),
}

/// Loads the stages to attack, without those that the options leave out.
fn subject(args: &AttackArgs) -> Result<Subject, TortureError> {
    let mut subject = Subject::load(&args.common.config, args.common.robot.as_deref(), !args.no_certificate)?;
    if args.keep_gate {
        subject = subject.with_gate(&args.common.config)?;
    }
    if args.no_torque {
        subject = subject.without_torque(&args.common.config)?;
    }
    if args.payload_kg > 0.0 {
        subject = subject.with_payload(&args.common.config, args.payload_kg, !args.untold)?;
    }
    Ok(subject)
}

fn attack(args: &AttackArgs) -> Result<bool, TortureError> {
    args.check()?;
    let machine = Machine::now();
    let subject = subject(args)?;
    // With a load, some postures cannot be held.
    let without_goals = args.no_certificate || args.no_torque || args.payload_kg > 0.0 || args.part.is_some();
    let goals = if without_goals { 0 } else { args.goals };
    let parts = args.ticks.div_ceil(chunk::PART_TICKS);
    let jobs = parts + goals.div_ceil(goals::PART_GOALS);
    let (bar, visited) = (progress(args.ticks, "ticks"), AtomicU64::new(0));
    let tell_goals = |more: u64| {
        let visited = visited.fetch_add(more, Ordering::Relaxed) + more;
        bar.set_message(if goals > 0 { format!(", {visited}/{goals} goals") } else { String::new() });
    };
    tell_goals(0);
    let outcomes = in_parallel(args.threads, jobs as usize, |job| {
        let job = job as u64;
        if args.part.is_some_and(|part| part != job) {
            return Outcome::Attacked(Box::default());
        }
        if job < parts {
            let ticks = chunk::PART_TICKS.min(args.ticks - job * chunk::PART_TICKS);
            let figures = chunk::run(&subject, args.seed, job, ticks);
            bar.inc(ticks);
            return Outcome::Attacked(Box::new(figures));
        }
        let part = job - parts;
        let count = goals::PART_GOALS.min(goals - part * goals::PART_GOALS);
        let visited = goals::run(&subject, derived_seed(args.seed, u64::MAX / 2), part, count);
        tell_goals(count);
        Outcome::Visited(visited)
    });
    bar.finish_and_clear();
    let (mut figures, mut visited) = (Figures::default(), Goals::default());
    for outcome in outcomes {
        match outcome {
            Outcome::Attacked(of_part) => figures.merge(*of_part),
            Outcome::Visited(of_part) => visited.merge(of_part),
        }
    }
    let value = report::attack_json(args, &figures, &visited, &subject.model, &machine);
    let words = report::attack_words(args, &figures, &visited, &subject.model, &machine);
    report::put(&words, &value, args.common.json.as_deref())?;
    if args.keep_gate {
        return Ok(figures.denials > 0);
    }
    if args.no_torque || args.untold {
        let overloads = figures.violations_of(ViolationKind::Torque);
        if overloads == 0 {
            eprintln!("torture: no motor was overloaded without the proof, so the attacks prove nothing");
        }
        return Ok(overloads > 0);
    }
    if args.no_certificate {
        let collisions = figures.violations_of(ViolationKind::Clearance);
        if collisions == 0 {
            eprintln!("torture: no collision happened without the certificate, so the attacks prove nothing");
        }
        return Ok(collisions > 0);
    }
    Ok(figures.kept())
}

fn measure_stops(args: &StopTimesArgs) -> Result<bool, TortureError> {
    check_counts(&[("--states", args.states)], args.threads)?;
    let subject = Subject::load(&args.common.config, args.common.robot.as_deref(), true)?;
    let bounds = subject.wbc.bounds();
    let times = stop_times::run(bounds, args.states, args.seed, args.threads);
    let value = report::stop_times_json(&times, bounds, &subject.model, args.seed);
    report::put(&report::stop_times_words(&times, bounds, &subject.model), &value, args.common.json.as_deref())?;
    Ok(times.exceeded() == 0)
}

fn play(args: &MotionsArgs) -> Result<bool, TortureError> {
    check_counts(&[], args.threads)?;
    let machine = Machine::now();
    let loaded = config::load(&args.config, Overrides::default())?;
    let bar = progress(motion::motion_files(&args.folder)?.len() as u64, "files");
    let played = motions::run(&loaded, &args.folder, args.threads, |_| bar.inc(1))?;
    bar.finish_and_clear();
    report::put(&report::motions_words(&played), &report::motions_json(&played, &machine), args.json.as_deref())?;
    Ok(played.iter().all(|one| one.failed.is_none() && one.violations_total() == 0))
}

fn measure_ticks(args: &BenchArgs) -> Result<bool, TortureError> {
    check_counts(&[("--ticks", args.ticks)], 1)?;
    let machine = Machine::now();
    let subject = Subject::load(&args.common.config, args.common.robot.as_deref(), true)?;
    let bench = bench::run(&subject, args.ticks.max(TICK_HZ), args.seed);
    let value = report::bench_json(&bench, args.ticks, &subject.model, &machine);
    let words = report::bench_words(&bench, args.ticks, &subject.model, &machine);
    report::put(&words, &value, args.common.json.as_deref())?;
    Ok(true)
}
