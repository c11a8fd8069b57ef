//! The operator's client: unprivileged, talks to `control` over its socket and to nothing else.

use clap::{Args, Parser, Subcommand};
use messages::{FAULTS, Fault, Faults, Mode, Status, TRANSITIONS_KEPT, Transition};
use operator::{Client, OperatorError};
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::{Duration, Instant};

/// Time between two heartbeats: 50 Hz.
const HEARTBEAT: Duration = Duration::from_millis(20);

/// EX_UNAVAILABLE of sysexits(3): nobody answers.
const EX_UNAVAILABLE: u8 = 69;

/// How long the effect of a request is waited for: the longest stop and some.
const EFFECT_WITHIN: Duration = Duration::from_secs(5);

/// Commands of an operator to a running teleopd.
#[derive(Debug, Parser)]
#[command(name = "teleopctl", version, about)]
struct Cli {
    /// Folder of the instance.
    #[arg(long, value_name = "DIR", default_value = pipeline::DEFAULT_RUN_DIR, global = true)]
    run_dir: PathBuf,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Prints what control says of itself.
    Status(StatusArgs),
    /// Engages, and holds the enable until Ctrl-C; then releases.
    Engage,
    /// Withdraws the enable, whoever holds it: the robot stops and keeps its posture.
    Release,
    /// Clears a latched stop, once its cause is gone and the robot is at rest. Never engages.
    Reset,
    /// Stops the robot now, and latches.
    Estop,
}

#[derive(Args, Debug)]
struct StatusArgs {
    /// As JSON.
    #[arg(long)]
    json: bool,
}

fn main() -> ExitCode {
    let cli = Cli::parse();
    let socket = cli.run_dir.join("operator.sock");
    let outcome = Client::connect(&socket).and_then(|mut client| match cli.command {
        Command::Status(args) => status(&mut client, args.json),
        Command::Engage => engage(&mut client),
        Command::Release => {
            client.release();
            until(&mut client, "released", |status| mode(status) == Mode::Disengaged || mode(status) == Mode::Faulted)
        }
        Command::Reset => {
            client.reset();
            until(&mut client, "reset", |status| mode(status) != Mode::Faulted)
        }
        Command::Estop => {
            client.estop();
            until(&mut client, "stopped", |status| mode(status) == Mode::Faulted)
        }
    });
    match outcome {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("teleopctl: {error}");
            ExitCode::from(EX_UNAVAILABLE)
        }
    }
}

fn mode(status: &Status) -> Mode {
    Mode::from_u32(status.mode).unwrap_or(Mode::Faulted)
}

fn status(client: &mut Client, json: bool) -> Result<bool, OperatorError> {
    let status = client.heartbeat()?;
    if json {
        println!("{}", pipeline::status_json(&status));
        return Ok(true);
    }
    println!("mode              {}", mode(&status).name());
    println!("ticks             {} ({} deadlines missed)", status.ticks, status.missed_deadlines);
    println!("input age         {:.1} ms", status.input_age_ns as f64 * 1e-6);
    println!(
        "clearance         {:.1} mm commanded, {:.1} mm measured",
        status.clearance_command_m * 1e3,
        status.clearance_measured_m * 1e3
    );
    println!("tracking error    {:.4} rad", status.tracking_error);
    let degrees = |rad: f64| rad.to_degrees();
    println!(
        "limb error        {:.1} deg target, {:.1} deg measured",
        degrees(status.limb_error_target_rad),
        degrees(status.limb_error_measured_rad)
    );
    println!("real-time         {}", if status.realtime == 1 { "yes" } else { "no" });
    println!("operators         {}", status.operators);
    println!("gate denials      {}", status.gate_denials);
    for fault in Faults(status.faults | status.latched).iter() {
        let latched = if Faults(status.latched).has(fault) { " (latched)" } else { "" };
        println!("fault             {}{latched}: {}", fault.row().name, fault.row().meaning);
    }
    for row in &FAULTS {
        let count = status.fault_counts[row.fault.index()];
        if count > 0 {
            println!("raised so far     {} x {}", count, row.name);
        }
    }
    Ok(true)
}

/// Holds the enable at 50 Hz until Ctrl-C, and says every change of mode.
fn engage(client: &mut Client) -> Result<bool, OperatorError> {
    let stop = rt::Shutdown::on_signals().expect("signal handlers can be installed");
    let first = client.heartbeat()?;
    let mut shown = first.transition_count;
    let mut mode_shown = mode(&first);
    if mode_shown != Mode::Disengaged {
        println!("{}: only a disengaged robot can be engaged", mode_shown.name());
        return Ok(false);
    }
    let blocking = Faults(first.faults | first.latched);
    if !blocking.is_empty() {
        for fault in blocking.iter() {
            println!("cannot engage: {}: {}", fault.row().name, fault.row().meaning);
        }
        return Ok(false);
    }
    client.enable();
    let mut beat = Instant::now();
    while !stop.requested() {
        let status = client.heartbeat()?;
        show_transitions(&status, &mut shown);
        mode_shown = mode(&status);
        if shown > first.transition_count && matches!(mode_shown, Mode::Disengaged | Mode::Faulted) {
            return Ok(false);
        }
        beat += HEARTBEAT;
        std::thread::sleep(beat.saturating_duration_since(Instant::now()));
    }
    client.release();
    until(client, "released", |status| !matches!(mode(status), Mode::Engaging | Mode::Engaged | Mode::Holding))?;
    Ok(mode_shown != Mode::Faulted)
}

fn show_transitions(status: &Status, shown: &mut u32) {
    let kept = TRANSITIONS_KEPT as u32;
    *shown = (*shown).max(status.transition_count.saturating_sub(kept));
    while *shown < status.transition_count {
        let transition = status.transitions[(*shown % kept) as usize];
        let name = |mode: u32| Mode::from_u32(mode).map_or("?", Mode::name);
        println!("{} -> {}: {}", name(transition.from), name(transition.to), why(&transition));
        *shown += 1;
    }
}

fn why(transition: &Transition) -> &'static str {
    match Fault::from_u32(transition.why) {
        Some(fault) => fault.row().meaning,
        None => transition.why_name(),
    }
}

/// Repeats the heartbeat until `done`, and prints `word` then; says what stands in the way otherwise.
fn until(client: &mut Client, word: &str, done: impl Fn(&Status) -> bool) -> Result<bool, OperatorError> {
    let give_up = Instant::now() + EFFECT_WITHIN;
    // The reply to the request itself was made before the request was read.
    client.heartbeat()?;
    loop {
        std::thread::sleep(HEARTBEAT);
        let status = client.heartbeat()?;
        if done(&status) {
            println!("{word}: {}", mode(&status).name());
            return Ok(true);
        }
        if Instant::now() > give_up {
            println!("not {word} within {} s: {}", EFFECT_WITHIN.as_secs(), mode(&status).name());
            for fault in Faults(status.faults | status.latched).iter() {
                println!("{}: {}", fault.row().name, fault.row().meaning);
            }
            return Ok(false);
        }
    }
}
