//! Runs the blocks in order, and merges their results.

use crate::blocks::{self, Kind};
use crate::cli::{Cli, Compare, Pin, Policy};
use crate::distribution::Distribution;
use crate::figures::VariantFigures;
use crate::host::Host;
use crate::load::Load;
use crate::measured::Measured;
use crate::processes::{self, Outcome, Setup};
use crate::reference::{self, unmeasured};
use crate::settings::Changes;
use config::Overrides;
use rt::{Exit, Failure, RealtimeConfig, Shutdown};

/// Runs every block and merges the results.
pub fn run(options: &Cli, shutdown: &Shutdown) -> Result<Measured, Failure> {
    options.check()?;
    let mut spec = spec(options)?;
    // Under SCHED_OTHER cyclictest keeps the default timer slack of 50 us, but the loops do not. So the two are
    // not comparable.
    let cyclictest = reference::cyclictest().filter(|_| spec.policy != rt::Policy::Other);
    if options.compare == Some(Compare::Cyclictest) && cyclictest.is_none() {
        let text = "cyclictest is not on the PATH, or the policy is not fifo; install the package rt-tests, or omit \
                    --compare";
        return Err(Failure::new(Exit::Unavailable, text));
    }
    let changes = Changes { policy: options.policy, pin: options.pin.clone() };
    let setup = Setup { config: options.config.clone(), changes, rate_hz: options.rate_hz };
    let (host, blocks) = (Host::now(), blocks::plan(options.seconds, cyclictest.is_some()));
    let load = Load::start(options.load).map_err(|error| unmeasured("load", error))?;
    let start = rt::now();
    let mut outcomes: Vec<Outcome> = Vec::new();
    let (mut bare, mut probe, mut probe_realtime) = (Distribution::default(), Distribution::default(), Vec::new());
    for (i, block) in blocks.iter().enumerate() {
        eprintln!("latency: block {} of {}: {:?}, {:.1} s", i + 1, blocks.len(), block.kind, block.seconds);
        match (block.kind, &cyclictest) {
            (Kind::Cyclictest, Some(program)) => {
                bare.merge(&unless_ended(reference::run_cyclictest(program, &spec, block.seconds), shutdown)?);
            }
            (Kind::Cyclictest | Kind::Probe, _) => {
                let (all, granted) = unless_ended(reference::run_probe(&spec, block.seconds), shutdown)?;
                probe.merge(&all);
                probe_realtime = granted;
            }
            (Kind::Events | Kind::Polled, _) => {
                let outcome = processes::run(&setup, *block, shutdown)?;
                if matches!(options.pin, Some(Pin::Cores(_))) && outcome.cores().is_none() {
                    let text = "--pin: the system refused these cores (teleopd doctor)";
                    return Err(Failure::new(Exit::Failed, text));
                }
                // The references run on the cores of the processes.
                spec.cores = outcome.cores();
                outcomes.push(outcome);
            }
        }
        unless_ended(Ok(()), shutdown)?;
    }
    drop(load);
    let of = |kind| {
        let mine: Vec<_> = outcomes.iter().filter(|outcome| outcome.kind == kind).cloned().collect();
        VariantFigures::merge(&mine)
    };
    let (events, polled, cyclictest) = (of(Kind::Events)?, of(Kind::Polled)?, (bare.count() > 0).then_some(bare));
    Ok(Measured { events, polled, cyclictest, probe, probe_realtime, host, blocks, start })
}

/// Maps errors to an interruption if shutdown was requested. Ctrl-C reaches a reference too, so its error then
/// is not its own.
fn unless_ended<T>(result: Result<T, Failure>, shutdown: &Shutdown) -> Result<T, Failure> {
    if shutdown.requested() { Err(::report::interrupted()) } else { result }
}

/// Specification of the references. It requests the same properties as retarget. The cores are known after the
/// first block.
fn spec(options: &Cli) -> Result<RealtimeConfig, Failure> {
    let settings = config::load(&options.config, Overrides::default());
    let settings = settings.map_err(Failure::with(Exit::Config))?.settings.realtime;
    let is_fifo = options.policy.map_or(settings.policy == config::Policy::Fifo, |policy| policy == Policy::Fifo);
    let fifo = rt::Policy::Fifo { priority: settings.priority_retarget as u8 };
    Ok(RealtimeConfig {
        policy: if is_fifo { fifo } else { rt::Policy::Other },
        cores: None,
        lock_memory: settings.lock_memory,
        cpu_dma_latency: settings.cpu_dma_latency,
    })
}
