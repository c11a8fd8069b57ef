//! Runs the command, and prints its results.

use super::{Cli, Summary, run};
use indicatif::{ProgressBar, ProgressStyle};
use rt::{Exit, Failure, Shutdown};
use std::process::ExitCode;
use std::time::Instant;

/// The shell's exit code for a signal.
const BY_SIGNAL: u8 = 128;

pub fn execute(cli: &Cli) -> ExitCode {
    // The daemon does the same, before any other thread starts.
    let _ = rt::flush_denormals();
    let shutdown = match Shutdown::on_signals() {
        Ok(shutdown) => shutdown,
        Err(error) => return rt::finish("batch", Err::<(), _>(Failure::new(Exit::Failed, error))),
    };
    let progress = ProgressBar::new(0);
    if let Ok(style) = ProgressStyle::with_template("{wide_bar} {bytes}/{total_bytes}, {elapsed}, {eta} left") {
        progress.set_style(style);
    }
    let begun = Instant::now();
    let outcome = run(cli, &shutdown, &progress);
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
    let Summary { made, postures, finished, failed, no_motion, warned, interrupted } = summary;
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
    for (path, warning) in warned {
        rt::out!("{}: {warning}", path.display());
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
