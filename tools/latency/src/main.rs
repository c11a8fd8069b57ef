//! The command line program of the library. The same program runs as every process that it measures, and as the
//! probe.

use latency::cli::Cli;
use latency::{plot, reference, report, run, watched};
use rt::{Exit, Failure, Shutdown};
use serde_json::Value;
use std::process::ExitCode;

/// Counts what the loops allocate after READY.
#[global_allocator]
static ALLOCATOR: rt::CountingAllocator = rt::CountingAllocator;

fn main() -> ExitCode {
    rt::abort_on_panic();
    if let Some(ended) = harness::roles::main() {
        return ended;
    }
    let mut arguments = std::env::args().skip(1).peekable();
    if arguments.peek().is_some_and(|role| role == reference::PROBE) {
        reference::probe_main(arguments);
        return ExitCode::SUCCESS;
    }
    rt::finish("latency", measure(&harness::parse()))
}

fn measure(options: &Cli) -> Result<(), Failure> {
    options.check()?;
    for path in [&options.json, &options.plot].into_iter().flatten() {
        harness::check_writable(path)?;
    }
    let shutdown = Shutdown::on_signals().map_err(Failure::with(Exit::Failed))?;
    let put = |figures: &Value| options.json.as_deref().map_or(Ok(()), |path| harness::write_json(path, figures));
    let words = if options.watched {
        let measured = watched::run(options, &shutdown)?;
        put(&measured.to_json())?;
        measured.words()
    } else {
        let measured = run::run(options, &shutdown)?;
        put(&measured.to_json(options))?;
        if let Some(path) = &options.plot {
            let unwritten = |cause| Failure::new(Exit::CantCreate, format!("{}: {cause}", path.display()));
            plot::draw(path, &measured).map_err(unwritten)?;
        }
        report::words(&measured)
    };
    rt::out!("{}", words.trim_end());
    Ok(())
}
