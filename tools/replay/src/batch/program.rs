//! Runs the command, and prints its results.

use super::{Cli, Summary, bench, run};
use indicatif::{ProgressBar, ProgressStyle};
use rt::{Exit, Failure, Shutdown};
use std::process::ExitCode;
use std::time::Instant;

/// The shell's exit code for a signal.
const BY_SIGNAL: u8 = 128;

pub fn execute(cli: &Cli) -> ExitCode {
    // The daemon does the same, before any other thread starts.
    let _ = rt::flush_denormals();
    if let Some(poses) = cli.bench {
        return rt::finish("batch", report_bench(cli, poses));
    }
    let (Some(input), Some(out)) = (&cli.input, &cli.out) else {
        return Exit::NoInput.into();
    };
    let shutdown = match Shutdown::on_signals() {
        Ok(shutdown) => shutdown,
        Err(error) => return rt::finish("batch", Err::<(), _>(Failure::new(Exit::Failed, error))),
    };
    let progress = ProgressBar::new(0);
    if let Ok(style) = ProgressStyle::with_template("{wide_bar} {bytes}/{total_bytes}, {elapsed}, {eta} left") {
        progress.set_style(style);
    }
    let begun = Instant::now();
    let outcome = run(cli, input, out, &shutdown, &progress);
    progress.finish_and_clear();
    if let Ok(summary) = &outcome {
        report(cli, summary, begun.elapsed().as_secs_f64());
        if summary.interrupted {
            let signal = shutdown.signal().and_then(|signal| u8::try_from(signal).ok());
            return ExitCode::from(signal.map_or(1, |signal| BY_SIGNAL + signal));
        }
    }
    rt::finish("batch", outcome.map(|summary| summary.failed.is_empty()))
}

fn report(cli: &Cli, summary: &Summary, seconds: f64) {
    let Summary { made, postures, finished, failed, no_motion, interrupted } = summary;
    rt::out!(
        "{made} files made with {postures} postures of both arms in {seconds:.1} s ({:.0} a second), {finished} were finished, {} \
         failed",
        *postures as f64 / seconds.max(1e-9),
        failed.len()
    );
    if !cli.certified && *made > 0 {
        rt::out!("these are postures, not a motion: a robot may not follow them; --certified writes what it may do");
    }
    for (path, reason) in no_motion {
        rt::out!("left out {}: {reason}", path.display());
    }
    for (path, failure) in failed {
        // Most failures name their file.
        if failure.text.contains(&path.display().to_string()) {
            eprintln!("batch: {failure}");
        } else {
            eprintln!("batch: {}: {failure}", path.display());
        }
    }
    if *interrupted {
        eprintln!("batch: interrupted; the same command continues where this one ended");
    }
}

fn report_bench(cli: &Cli, poses: u64) -> Result<(), Failure> {
    let load = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
    let load = load.split_whitespace().next().unwrap_or("unknown");
    let report = bench(cli, poses)?;
    let ratio = report.all_cores_hz / report.one_core_hz;
    println!("{} poses of both arms, {:?}, {} refinement steps", report.poses, cli.method, cli.refine_steps);
    println!(
        "one core      {:>10.0} poses of arms/s, {:.1} us of processor time each",
        report.one_core_hz, report.one_core_cpu_us
    );
    println!(
        "{:>2} threads    {:>10.0} poses of arms/s, {:.1} us of processor time each; {:.0} a thread, {ratio:.2} times one core",
        report.threads,
        report.all_cores_hz,
        report.all_cores_cpu_us,
        report.all_cores_hz / report.threads as f64
    );
    println!(
        "on idle cores {:>10.0} poses of arms/s would be {:.2} times one core, by processor time",
        report.threads as f64 * 1e6 / report.all_cores_cpu_us,
        report.threads as f64 * report.one_core_cpu_us / report.all_cores_cpu_us
    );
    println!("20 M poses    {:>10.1} minutes on {} threads", report.minutes(20e6), report.threads);
    println!("load average before: {load}; medians of alternating rounds, computation alone");
    Ok(())
}
