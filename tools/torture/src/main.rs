//! The command line program of the library.

use ::report::{Machine, Progress, derived_seed, in_parallel, print};
use checker::ViolationKind;
use clap::Parser;
use rt::Failure;
use std::process::ExitCode;
use std::sync::atomic::{AtomicU64, Ordering};
use torture::cli::{AttackArgs, Changes, Cli, Command, StopTimesArgs, check_counts};
use torture::figures::{RunFigures, merged};
use torture::{chunk, goals, report, stop_times};

fn main() -> ExitCode {
    rt::abort_on_panic();
    let cli = Cli::parse();
    // The daemon does the same, before any other thread starts.
    let _ = rt::flush_denormals();
    let done = match &cli.command {
        None => attack(&cli.attack),
        Some(Command::StopTimes(args)) => measure_stops(args),
    };
    rt::finish("torture", done)
}

fn attack(args: &AttackArgs) -> Result<bool, Failure> {
    args.check()?;
    let machine = Machine::before_run();
    let Changes { no_certificate, no_torque, payload_kg, hidden } = args.changes;
    let subject = args.common.subject(args.changes)?;
    // With a load, some postures cannot be held.
    let without_goals = no_certificate || no_torque || payload_kg > 0.0 || args.part.is_some();
    let goals = if without_goals { 0 } else { args.goals };
    let parts = args.ticks.div_ceil(chunk::PART_TICKS);
    let jobs = parts + goals.div_ceil(goals::PART_GOALS);
    let (bar, visited) = (Progress::new("torture", args.ticks, "ticks"), AtomicU64::new(0));
    let show_goals = |more: u64| {
        let visited = visited.fetch_add(more, Ordering::Relaxed) + more;
        bar.set_message(if goals > 0 { format!(", {visited}/{goals} goals") } else { String::new() });
    };
    show_goals(0);
    let parts_figures = in_parallel(args.common.threads, jobs as usize, |job| {
        let job = job as u64;
        if args.part.is_some_and(|part| part != job) {
            return RunFigures::default();
        }
        if job < parts {
            let ticks = chunk::PART_TICKS.min(args.ticks - job * chunk::PART_TICKS);
            let figures = chunk::run(&subject, args.common.seed, job, ticks);
            bar.add(ticks);
            return figures;
        }
        let part = job - parts;
        let count = goals::PART_GOALS.min(goals - part * goals::PART_GOALS);
        let goals = goals::run(&subject, derived_seed(args.common.seed, u64::MAX / 2), part, count);
        show_goals(count);
        RunFigures { goals, ..RunFigures::default() }
    });
    drop(bar);
    let (figures, machine) = (merged(parts_figures), machine.after_run());
    print(&report::attack_text(args, &figures, &subject.model, &machine));
    // Without a proof, the same attacks must find what it prevents.
    let (found, nothing) = if no_torque || hidden {
        (ViolationKind::Torque, "no motor was overloaded without the proof")
    } else if no_certificate {
        (ViolationKind::Clearance, "no collision happened without the certificate")
    } else {
        let lost = figures.goals.failure();
        lost.iter().for_each(|why| eprintln!("torture: {why}"));
        return Ok(figures.kept() && lost.is_none());
    };
    let found = figures.violations_of(found) > 0;
    if !found {
        eprintln!("torture: {nothing}, so the attacks prove nothing");
    }
    Ok(found)
}

fn measure_stops(args: &StopTimesArgs) -> Result<bool, Failure> {
    check_counts("--states", args.states, args.common.threads)?;
    let subject = args.common.subject(Changes::default())?;
    let bounds = subject.wbc.bounds();
    let bar = Progress::new("torture", args.states, "states");
    let times = stop_times::run(bounds, args.states, args.common.seed, args.common.threads, |states| bar.add(states));
    drop(bar);
    print(&report::stop_times_text(&times, bounds, &subject.model));
    Ok(times.exceeded() == 0)
}
