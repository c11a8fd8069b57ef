//! The command line program of the library.

use checker::ViolationKind;
use clap::Parser;
use config::Overrides;
use messages::TICK_HZ;
use rt::{Exit, Failure};
use std::process::ExitCode;
use std::sync::atomic::{AtomicU64, Ordering};
use torture::cli::{
    AttackArgs, BenchArgs, Changes, Cli, Command, MotionsArgs, StopTimesArgs, check_counts, check_threads,
};
use torture::figures::{Figures, merged};
use torture::machine::Machine;
use torture::parallel::{derived_seed, in_parallel};
use torture::progress::Progress;
use torture::report;
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
    rt::finish("torture", done)
}

fn attack(args: &AttackArgs) -> Result<bool, Failure> {
    args.check()?;
    let machine = Machine::now();
    let Changes { no_certificate, keep_gate, no_torque, payload_kg, untold } = args.changes;
    let subject = args.common.subject(args.changes)?;
    // With a load, some postures cannot be held.
    let without_goals = no_certificate || no_torque || payload_kg > 0.0 || args.part.is_some();
    let goals = if without_goals { 0 } else { args.goals };
    let parts = args.ticks.div_ceil(chunk::PART_TICKS);
    let jobs = parts + goals.div_ceil(goals::PART_GOALS);
    let (bar, visited) = (Progress::new(args.ticks, "ticks"), AtomicU64::new(0));
    let tell_goals = |more: u64| {
        let visited = visited.fetch_add(more, Ordering::Relaxed) + more;
        bar.note(if goals > 0 { format!(", {visited}/{goals} goals") } else { String::new() });
    };
    tell_goals(0);
    let of_parts = in_parallel(args.threads, jobs as usize, |job| {
        let job = job as u64;
        if args.part.is_some_and(|part| part != job) {
            return Figures::default();
        }
        if job < parts {
            let ticks = chunk::PART_TICKS.min(args.ticks - job * chunk::PART_TICKS);
            let figures = chunk::run(&subject, args.seed, job, ticks);
            bar.add(ticks);
            return figures;
        }
        let part = job - parts;
        let count = goals::PART_GOALS.min(goals - part * goals::PART_GOALS);
        let goals = goals::run(&subject, derived_seed(args.seed, u64::MAX / 2), part, count);
        tell_goals(count);
        Figures { goals, ..Figures::default() }
    });
    drop(bar);
    let figures = merged(of_parts);
    let value = report::attack_json(args, &figures, &subject.model, &machine);
    let words = report::attack_words(args, &figures, &subject.model, &machine);
    report::put(&words, &value, args.common.json.as_deref())?;
    // Without a proof, the same attacks must find what it prevents.
    let (found, nothing) = if keep_gate {
        return Ok(figures.denials > 0);
    } else if no_torque || untold {
        (ViolationKind::Torque, "no motor was overloaded without the proof")
    } else if no_certificate {
        (ViolationKind::Clearance, "no collision happened without the certificate")
    } else {
        return Ok(figures.kept());
    };
    let found = figures.violations_of(found) > 0;
    if !found {
        eprintln!("torture: {nothing}, so the attacks prove nothing");
    }
    Ok(found)
}

fn measure_stops(args: &StopTimesArgs) -> Result<bool, Failure> {
    check_counts("--states", args.states, args.threads)?;
    let subject = args.common.subject(Changes::default())?;
    let bounds = subject.wbc.bounds();
    let bar = Progress::new(args.states, "states");
    let times = stop_times::run(bounds, args.states, args.seed, args.threads, |states| bar.add(states));
    drop(bar);
    let value = report::stop_times_json(&times, bounds, &subject.model, args.seed);
    report::put(&report::stop_times_words(&times, bounds, &subject.model), &value, args.common.json.as_deref())?;
    Ok(times.exceeded() == 0)
}

fn play(args: &MotionsArgs) -> Result<bool, Failure> {
    check_threads(args.threads)?;
    let machine = Machine::now();
    let loaded =
        config::load(&args.config, Overrides::robot(args.robot.as_ref())).map_err(Failure::with(Exit::Config))?;
    let bar =
        Progress::new(motion::motion_files(&args.folder).map_err(Failure::with(Exit::NoInput))?.len() as u64, "files");
    let played = motions::run(&loaded, &args.folder, args.threads, |_| bar.add(1))?;
    drop(bar);
    report::put(&report::motions_words(&played), &report::motions_json(&played, &machine), args.json.as_deref())?;
    Ok(played.iter().all(|one| one.failed.is_none() && one.violations_total() == 0))
}

fn measure_ticks(args: &BenchArgs) -> Result<bool, Failure> {
    check_counts("--ticks", args.ticks, 1)?;
    let machine = Machine::now();
    let subject = args.common.subject(Changes::default())?;
    let bar = Progress::new(1, "runs");
    let bench = bench::run(&subject, args.ticks.max(TICK_HZ), args.seed);
    drop(bar);
    let value = report::bench_json(&bench, args.ticks, &subject.model, &machine);
    let words = report::bench_words(&bench, args.ticks, &subject.model, &machine);
    report::put(&words, &value, args.common.json.as_deref())?;
    Ok(true)
}
