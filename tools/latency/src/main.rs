//! The command line program of the library. The same program runs as every process that it measures, and as the probe.

use latency::cli::Cli;
use latency::{reference, report as text, run};
use report::JsonOutput;
use rt::{Exit, Failure, Shutdown};
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
    rt::finish("latency", measure(&report::parse()))
}

fn measure(options: &Cli) -> Result<(), Failure> {
    options.check()?;
    let json = JsonOutput::open(options.json.as_deref())?;
    let shutdown = Shutdown::on_signals().map_err(Failure::with(Exit::Failed))?;
    let measured = run::run(options, &shutdown)?;
    json.write(&text::text(&measured), &measured.to_json(options))
}
