//! The command line program of the library. The same program runs as every process that a fault hits, including
//! the client and the operator.

use chaos::cli::{Cli, Command, CommonArgs, SoakArgs, TrialsArgs};
use chaos::figures::TrialFigures;
use chaos::injection::{Injection, Target};
use chaos::rig::Rig;
use chaos::{soak, trial};
use harness::roles;
use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use report::JsonOutput;
use rt::{Exit, Failure, Shutdown};
use std::path::Path;
use std::process::ExitCode;

/// Counts what the loops allocate after READY, as in the daemon.
#[global_allocator]
static ALLOCATOR: rt::CountingAllocator = rt::CountingAllocator;

/// Number of faults per instance. After that, the instance ends in order and its driver's record is read.
const FAULTS_PER_INSTANCE: usize = 20;

fn main() -> ExitCode {
    rt::abort_on_panic();
    if let Some(ended) = roles::main() {
        return ended;
    }
    let Cli { command, trials } = report::parse();
    let done = match command {
        None => run_trials(&trials),
        Some(Command::Soak(args)) => run_soak(&args),
    };
    rt::finish("chaos", done)
}

/// Runs all trials, several per instance. Returns true if every promise was kept.
fn run_trials(options: &TrialsArgs) -> Result<bool, Failure> {
    options.check()?;
    let (shutdown, json) = begin(&options.common)?;
    let mut figures = TrialFigures::default();
    for (number, faults) in drawn(options)?.chunks(FAULTS_PER_INSTANCE).enumerate() {
        instance(&options.common.config, faults, &shutdown, &mut figures)?;
        eprintln!("instance {}: {} kills, {} suspensions so far", number + 1, figures.kills(), figures.suspends());
        if shutdown.requested() {
            break;
        }
    }
    json.write(&figures.text(), &figures.to_json())?;
    end(&shutdown)?;
    Ok(figures.complaints().is_empty())
}

fn run_soak(options: &SoakArgs) -> Result<bool, Failure> {
    options.check()?;
    let (shutdown, json) = begin(&options.common)?;
    let soaked = soak::run(options, &shutdown)?;
    json.write(&soaked.text(), &soaked.to_json())?;
    end(&shutdown)?;
    Ok(soaked.complaints().is_empty())
}

/// Refuses an unwritable file before the run.
fn begin(options: &CommonArgs) -> Result<(Shutdown, JsonOutput), Failure> {
    let json = JsonOutput::open(options.json.as_deref())?;
    Ok((Shutdown::on_signals().map_err(Failure::with(Exit::OsErr))?, json))
}

fn end(shutdown: &Shutdown) -> Result<(), Failure> {
    if shutdown.requested() { Err(report::interrupted()) } else { Ok(()) }
}

/// Draws every target equally often, in random order. The driver's deaths come last, because each destroys the
/// driver's record of everything before. The robot's record survives them.
fn drawn(options: &TrialsArgs) -> Result<Vec<Injection>, Failure> {
    let targets = options.targets()?;
    let mut dice = Pcg64Mcg::seed_from_u64(options.seed);
    let mut all = Vec::new();
    for (count, kill) in [(options.kills, true), (options.suspends, false)] {
        let first: usize = dice.random_range(0..targets.len());
        for n in 0..count as usize {
            all.push((targets[(first + n) % targets.len()], kill));
        }
    }
    all.shuffle(&mut dice);
    all.sort_by_key(|&(target, kill)| kill && target == Target::Driver);
    Ok(all.into_iter().map(|(target, kill)| Injection::draw(target, kill, options.engaged, &mut dice)).collect())
}

fn instance(
    config: &Path,
    faults: &[Injection],
    shutdown: &Shutdown,
    figures: &mut TrialFigures,
) -> Result<(), Failure> {
    let mut rig = Rig::start(config)?;
    let (mut outcomes, mut moved) = (Vec::new(), 0);
    for &fault in faults.iter().take_while(|_| !shutdown.requested()) {
        let outcome = match trial::run(&mut rig, fault) {
            Err(stuck) if stuck.exit == Exit::Failed => {
                // The next instance continues. The results of this one are kept.
                figures.add_trouble(format!("{stuck}, before or after {fault:?}"));
                break;
            }
            outcome => outcome?,
        };
        // Motion until the next enable is attributed to this fault.
        let moved_before = std::mem::replace(&mut moved, rig.monitor.seen().moved_without_enable);
        if moved > moved_before {
            figures.add_trouble(format!("motion without an enable after {outcome:?}"));
        }
        outcomes.push(outcome);
    }
    figures.conclude(rig, &outcomes);
    Ok(())
}
