//! The command line program of the library. The same program runs as every process that a fault hits, including
//! the client and the operator.

use chaos::cli::{Cli, Command, CommonArgs, SoakArgs, TrialsArgs};
use chaos::figures::Figures;
use chaos::injection::{Injection, Target};
use chaos::rig::Rig;
use chaos::{soak, trial};
use harness::roles;
use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rt::{Exit, Failure, Shutdown};
use serde_json::Value;
use std::path::Path;
use std::process::ExitCode;

/// Counts what the loops allocate after READY, as in the daemon.
#[global_allocator]
static ALLOCATOR: rt::CountingAllocator = rt::CountingAllocator;

/// Number of faults per instance. After that, the instance ends in order and its driver's record is read.
const BLOWS_OF_AN_INSTANCE: usize = 20;

fn main() -> ExitCode {
    rt::abort_on_panic();
    if let Some(ended) = roles::main() {
        return ended;
    }
    let Cli { command, trials } = harness::parse();
    rt::finish(
        "chaos",
        match command {
            None => strike(&trials),
            Some(Command::Soak(args)) => soak(&args),
        },
    )
}

/// Runs all trials, several per instance. Returns true if every promise was kept.
fn strike(options: &TrialsArgs) -> Result<bool, Failure> {
    options.check()?;
    let shutdown = begin(&options.common)?;
    let mut figures = Figures::default();
    for (number, blows) in drawn(options)?.chunks(BLOWS_OF_AN_INSTANCE).enumerate() {
        instance(&options.common.config, blows, &shutdown, &mut figures)?;
        eprintln!("instance {}: {} kills, {} suspensions so far", number + 1, figures.kills(), figures.suspends());
        if shutdown.requested() {
            break;
        }
    }
    end(&options.common, &shutdown, &figures.to_json(), &figures.words())?;
    Ok(figures.complaints().is_empty())
}

/// Returns true if nothing grew, and every promise was kept.
fn soak(options: &SoakArgs) -> Result<bool, Failure> {
    options.check()?;
    let shutdown = begin(&options.common)?;
    let soaked = soak::run(options, &shutdown)?;
    end(&options.common, &shutdown, &soaked.to_json(), &soaked.words())?;
    Ok(soaked.complaints().is_empty())
}

/// Refuses an unwritable file before the run.
fn begin(options: &CommonArgs) -> Result<Shutdown, Failure> {
    options.json.as_deref().map_or(Ok(()), harness::check_writable)?;
    Shutdown::on_signals().map_err(Failure::with(Exit::OsErr))
}

fn end(options: &CommonArgs, shutdown: &Shutdown, figures: &Value, words: &str) -> Result<(), Failure> {
    options.json.as_deref().map_or(Ok(()), |path| harness::write_json(path, figures))?;
    rt::out!("{}", words.trim_end());
    if shutdown.requested() {
        return Err(harness::interrupted());
    }
    Ok(())
}

/// Draws every target equally often, in random order. The driver's deaths come last, because each destroys the
/// driver's record of everything before. The robot's record survives them.
fn drawn(options: &TrialsArgs) -> Result<Vec<Injection>, Failure> {
    let victims = options.victims()?;
    let mut dice = Pcg64Mcg::seed_from_u64(options.seed);
    let mut all = Vec::new();
    for (count, kill) in [(options.kills, true), (options.suspends, false)] {
        let first: usize = dice.random_range(0..victims.len());
        for n in 0..count as usize {
            all.push((victims[(first + n) % victims.len()], kill));
        }
    }
    all.shuffle(&mut dice);
    all.sort_by_key(|&(victim, kill)| kill && victim == Target::Driver);
    Ok(all.into_iter().map(|(victim, kill)| Injection::draw(victim, kill, options.engaged, &mut dice)).collect())
}

fn instance(config: &Path, blows: &[Injection], shutdown: &Shutdown, figures: &mut Figures) -> Result<(), Failure> {
    let (mut rig, witness, settings) = Rig::watched(config)?;
    let (mut outcomes, mut moved) = (Vec::new(), 0);
    for &blow in blows.iter().take_while(|_| !shutdown.requested()) {
        let outcome = match trial::run(&mut rig, &witness, &settings, blow) {
            Err(stuck) if stuck.exit == Exit::Failed => {
                // The next instance continues. The results of this one are kept.
                figures.add_trouble(format!("{stuck}, before or after {blow:?}"));
                break;
            }
            outcome => outcome?,
        };
        // Motion until the next enable is attributed to this fault.
        let moved_before = std::mem::replace(&mut moved, witness.seen().moved_without_enable);
        if moved > moved_before {
            figures.add_trouble(format!("motion without an enable after {outcome:?}"));
        }
        outcomes.push(outcome);
    }
    figures.conclude(rig, witness, &outcomes, &settings);
    Ok(())
}
