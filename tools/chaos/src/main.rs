//! The command line program of the library. The same program runs as every process that a fault hits, including
//! the client and the operator.

use chaos::cli::Cli;
use chaos::error::ChaosError;
use chaos::figures::Figures;
use chaos::injection::{Injection, Target};
use chaos::monitor::Monitor;
use chaos::rig::{self, Rig};
use chaos::trial;
use clap::Parser;
use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rt::Shutdown;
use std::process::ExitCode;

/// Counts what the loops allocate after READY, as in the daemon.
#[global_allocator]
static ALLOCATOR: rt::CountingAllocator = rt::CountingAllocator;

/// EX_USAGE of sysexits(3).
const EX_USAGE: u8 = 64;
/// Number of faults per instance. After that, the instance ends in order and its driver's record is read.
const BLOWS_OF_AN_INSTANCE: usize = 20;

fn main() -> ExitCode {
    rt::abort_on_panic();
    if std::env::args().nth(1).is_some_and(|role| teleopd::PROCESSES.contains(&role.as_str())) {
        return teleopd::main();
    }
    if let Some(ended) = rig::role_main(std::env::args().skip(1)) {
        return ended;
    }
    let options = match Cli::try_parse() {
        Ok(options) => options,
        Err(error) => {
            // Help and version also come this way. They are not errors.
            let _ = error.print();
            return if error.use_stderr() { EX_USAGE.into() } else { ExitCode::SUCCESS };
        }
    };
    match strike(&options) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("chaos: {error}");
            error.exit().into()
        }
    }
}

/// Runs all trials, several per instance. Returns true if every promise was kept.
fn strike(options: &Cli) -> Result<bool, ChaosError> {
    options.check()?;
    if let Some(path) = &options.json {
        // Open the file before the run, so that an unwritable file is reported now.
        let opened = std::fs::OpenOptions::new().append(true).create(true).open(path);
        opened.map_err(|error| ChaosError::write(path, error))?;
    }
    let shutdown = Shutdown::on_signals().map_err(|error| ChaosError::os("signals", error))?;
    let mut figures = Figures::default();
    for (number, blows) in drawn(options)?.chunks(BLOWS_OF_AN_INSTANCE).enumerate() {
        instance(options, blows, &shutdown, &mut figures)?;
        eprintln!("instance {}: {} kills, {} suspensions so far", number + 1, figures.kills(), figures.suspends());
        if shutdown.requested() {
            break;
        }
    }
    if let Some(path) = &options.json {
        std::fs::write(path, format!("{:#}\n", figures.to_json())).map_err(|error| ChaosError::write(path, error))?;
    }
    print!("{}", figures.words());
    if shutdown.requested() {
        return Err(ChaosError::Interrupted);
    }
    Ok(figures.complaints().is_empty())
}

/// Draws every target equally often, in random order. The driver's deaths come last, because each destroys the
/// driver's record of everything before. The robot's record survives them.
fn drawn(options: &Cli) -> Result<Vec<Injection>, ChaosError> {
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

fn instance(options: &Cli, blows: &[Injection], shutdown: &Shutdown, figures: &mut Figures) -> Result<(), ChaosError> {
    let mut rig = Rig::start(&options.config)?;
    let loaded = config::load(&rig.place().config, rig.place().overrides())?;
    let safety = &loaded.settings.safety;
    let limits = pipeline::sim_config(&loaded, true)?;
    let witness = Monitor::start(rig.instance().core_domain(), limits)?;
    let (mut outcomes, mut moved) = (Vec::new(), 0);
    for &blow in blows.iter().take_while(|_| !shutdown.requested()) {
        let outcome = match trial::run(&mut rig, &witness, &loaded.settings, blow) {
            Err(ChaosError::Stuck(what)) => {
                // The next instance continues. The results of this one are kept.
                figures.add_trouble([format!("{what}, before or after {blow:?}")]);
                break;
            }
            outcome => outcome?,
        };
        if !outcome.rested {
            figures.add_trouble([format!("no rest after {blow:?}")]);
        }
        // Motion until the next enable is attributed to this fault.
        let moved_before = std::mem::replace(&mut moved, witness.seen().moved_without_enable);
        if moved > moved_before {
            figures.add_trouble([format!("motion without an enable after {outcome:?}")]);
        }
        outcomes.push(outcome);
    }
    let seen = witness.seen();
    drop(witness);
    figures.add_seen(&seen);
    figures.add_clients_begun_anew(rig.clients_begun_anew());
    let ended = rig.end();
    let factor = if ended.realtime() { 1.0 } else { safety.stale_factor_without_realtime };
    for outcome in &outcomes {
        figures.add(outcome, outcome.blow.victim.rest_within_ticks(safety, factor));
    }
    match ended.record() {
        Some(record) => figures.add_record(record),
        None => figures.add_trouble(["a driver wrote no record".to_owned()]),
    }
    match ended.robot() {
        Some(record) => figures.add_robot(record),
        None => figures.add_trouble(["a robot wrote no record".to_owned()]),
    }
    figures.add_trouble(ended.trouble);
    Ok(())
}
