//! The command line program of the library. The same program runs as every process that it measures, and as the
//! probe.

use clap::Parser;
use latency::cli::Cli;
use latency::error::LatencyError;
use latency::soak::{self, Soak};
use latency::{plot, reference, report, run, watched};
use rt::Shutdown;
use std::io::Write;
use std::path::Path;
use std::process::ExitCode;
use std::time::Duration;

/// Counts what the loops allocate after READY.
#[global_allocator]
static ALLOCATOR: rt::CountingAllocator = rt::CountingAllocator;

/// EX_USAGE of sysexits(3).
const EX_USAGE: u8 = 64;

fn main() -> ExitCode {
    rt::abort_on_panic();
    let role = std::env::args().nth(1).unwrap_or_default();
    if teleopd::PROCESSES.contains(&role.as_str()) || role == "view" {
        return teleopd::main();
    }
    if let Some(ended) = chaos::rig::role_main(std::env::args().skip(1)) {
        return ended;
    }
    if role == reference::PROBE {
        reference::probe_main(std::env::args().skip(1));
        return ExitCode::SUCCESS;
    }
    let options = match Cli::try_parse() {
        Ok(options) => options,
        Err(error) => {
            // Help and version also come this way. They are not errors.
            let _ = error.print();
            return if error.use_stderr() { EX_USAGE.into() } else { ExitCode::SUCCESS };
        }
    };
    match measure(&options) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("latency: {error}");
            error.exit().into()
        }
    }
}

fn measure(options: &Cli) -> Result<(), LatencyError> {
    options.check()?;
    // Open the files before the run, so that an unwritable file is reported now.
    for path in [&options.json, &options.plot].into_iter().flatten() {
        std::fs::OpenOptions::new().append(true).create(true).open(path).map_err(|error| unwritten(path, error))?;
    }
    let shutdown = Shutdown::on_signals().map_err(|error| LatencyError::Invalid(error.to_string()))?;
    if let Some(hours) = options.soak {
        return soaked(options, hours, &shutdown);
    }
    if options.watched {
        let measured = watched::run(options, &shutdown)?;
        if let Some(path) = &options.json {
            std::fs::write(path, format!("{:#}\n", measured.to_json())).map_err(|error| unwritten(path, error))?;
        }
        let _ = std::io::stdout().write_all(measured.words().as_bytes());
        return Ok(());
    }
    let measured = run::run(options, &shutdown)?;
    if let Some(path) = &options.json {
        let text = format!("{:#}\n", measured.to_json(options));
        std::fs::write(path, text).map_err(|error| unwritten(path, error))?;
    }
    if let Some(path) = &options.plot {
        plot::draw(path, &measured).map_err(|cause| unwritten(path, cause))?;
    }
    // The reader may have closed the output. This is not an error.
    let _ = std::io::stdout().write_all(report::words(&measured).as_bytes());
    Ok(())
}

fn soaked(options: &Cli, hours: f64, shutdown: &Shutdown) -> Result<(), LatencyError> {
    let length = Duration::from_secs_f64(hours * 3600.0);
    let soak = Soak { length, every: Duration::from_secs_f64(options.strike_every) };
    let outcome = soak::run(&options.config, soak, shutdown)?;
    if let Some(path) = &options.json {
        std::fs::write(path, format!("{:#}\n", outcome.to_json())).map_err(|error| unwritten(path, error))?;
    }
    let _ = std::io::stdout().write_all(outcome.words().as_bytes());
    if shutdown.requested() {
        return Err(LatencyError::Interrupted);
    }
    let complaints = outcome.complaints();
    if complaints.is_empty() { Ok(()) } else { Err(LatencyError::Invalid(complaints.join("; "))) }
}

fn unwritten(path: &Path, cause: impl std::fmt::Display) -> LatencyError {
    LatencyError::Write { file: path.to_path_buf(), cause: cause.to_string() }
}
