//! The operator's client. It runs unprivileged and talks only to `control`, over its socket. Only `watch` also
//! reads the joints, if it has access. The binary `teleopctl` only calls `main`.

mod calibrate;
mod cli;
mod hold;
mod payload;
mod watch;

use clap::Parser;
use cli::{CalibrateArgs, Cli, Command, Hand};
use explain::meaning;
use messages::{FAULTS, Fault, Faults, Mode, Response, Status, source_flag};
use operator::{Client, OperatorError, StopPress};
use robot::Names;
use rt::{err, out};
use std::path::Path;
use std::process::ExitCode;
use std::time::{Duration, Instant};

/// Time between two heartbeats: 50 Hz.
const HEARTBEAT: Duration = Duration::from_millis(20);

/// Longest wait for the effect of a request: the longest stop, with a margin.
const EFFECT_WITHIN: Duration = Duration::from_secs(5);

/// Time between two presses of a reset that has had no effect yet. `control` resets only at rest, and forgets
/// other presses.
const RESET_EVERY: Duration = Duration::from_millis(100);

/// Runs the command from the command line.
pub fn main() -> ExitCode {
    rt::abort_on_panic();
    let cli = Cli::parse();
    let socket = cli.run_dir.join("operator.sock");
    let outcome = match cli.command {
        Command::Estop => estop(&socket),
        command => Client::connect(&socket).and_then(|mut client| obey(&mut client, &cli.run_dir, command)),
    };
    rt::finish("teleopctl", outcome)
}

fn obey(client: &mut Client, run_dir: &Path, command: Command) -> Result<bool, OperatorError> {
    match command {
        Command::Status(args) => status(client, run_dir, args.json),
        Command::Watch => watch::run(client, run_dir),
        Command::Calibrate(args) => calibrate(client, run_dir, &args),
        Command::Engage { arm } => engage(client, run_dir, arm),
        Command::Clutch => clutch(client, run_dir, None),
        Command::Takeover { arm } => {
            clutch(client, run_dir, Some([Hand::Left, Hand::Right].map(|side| arm.is_none_or(|arm| arm == side))))
        }
        Command::Recover => recover(client, run_dir),
        Command::Release => {
            client.release();
            until(client, "released", |status| matches!(mode(status), Mode::Disengaged | Mode::Faulted))
        }
        Command::Reset => reset(client, run_dir),
        Command::Payload(args) => payload::send(client, run_dir, &args),
        Command::Estop => estop(&run_dir.join("operator.sock")),
    }
}

/// Presses the emergency stop until a status shows that the robot stopped. An answer means that the press counts, even if no
/// connection is left to observe the robot's mode.
fn estop(socket: &Path) -> Result<bool, OperatorError> {
    let give_up = Instant::now() + EFFECT_WITHIN;
    let (mut press, mut is_printed) = (StopPress::new(socket), false);
    loop {
        let is_late = Instant::now() > give_up;
        match press.step() {
            Ok(Some(status)) => {
                out!("stopped: {}", mode(&status).name());
                return Ok(true);
            }
            Ok(None) if is_late => {
                out!("pressed, and answered, but not stopped within {} s", EFFECT_WITHIN.as_secs());
                return Ok(false);
            }
            Ok(None) => {}
            Err(error @ (OperatorError::Closed { .. } | OperatorError::Timeout { .. })) if !is_late => {
                if !std::mem::replace(&mut is_printed, true) {
                    err!("teleopctl: {error}; still pressing");
                }
            }
            Err(error) => return unanswered(socket, error, press.is_heard()),
        }
        std::thread::sleep(HEARTBEAT);
    }
}

/// Says what a press came to that nothing answers any more.
fn unanswered(socket: &Path, error: OperatorError, is_heard: bool) -> Result<bool, OperatorError> {
    let robot = socket.parent().and_then(operator::linked_robot);
    match (error, robot) {
        (OperatorError::Closed { path } | OperatorError::Timeout { path, .. }, Some(robot)) => {
            Err(OperatorError::Unanswered { path, robot, within_s: EFFECT_WITHIN.as_secs() })
        }
        (OperatorError::Closed { .. }, None) if is_heard => {
            out!("pressed, and control received it; all connections are in use, so the mode cannot be shown here");
            Ok(true)
        }
        (error, _) => Err(error),
    }
}

fn mode(status: &Status) -> Mode {
    Mode::from_u32(status.mode).unwrap_or(Mode::Faulted)
}

fn status(client: &mut Client, run_dir: &Path, json: bool) -> Result<bool, OperatorError> {
    let status = client.heartbeat()?;
    let names = instance::read_names(run_dir);
    if json {
        out!("{}", explain::status_json(&status, &names));
        return Ok(true);
    }
    let activity = explain::activity(&status).map_or(String::new(), |name| format!(" ({name})"));
    out!("mode              {}{activity}", mode(&status).name());
    out!("why               {}", explain::why(&status, &names));
    out!("ticks             {} ({} deadlines missed)", status.ticks, status.missed_deadlines);
    match explain::input_age_ms(&status) {
        Some(age_ms) => {
            out!("input age         {age_ms:.1} ms, {:.1} % of the frames lost", 0.1 * f64::from(status.lost_permille));
        }
        None => out!("input             none yet"),
    }
    out!(
        "clearance         {:.1} mm commanded ({}), {:.1} mm measured ({})",
        status.clearance_command_m * 1e3,
        names.pair(status.nearest_pair),
        status.clearance_measured_m * 1e3,
        names.pair(status.nearest_pair_measured)
    );
    let worst = status.tracking_joint.saturating_sub(1) as usize;
    out!("tracking error    {:.4} {} ({})", status.tracking_error, names.unit(worst), names.joint(worst));
    let degrees = |rad: f64| rad.to_degrees();
    if explain::input_age_ms(&status).is_some() {
        out!(
            "limb error        {:.1} deg target, {:.1} deg measured",
            degrees(status.limb_error_target_rad),
            degrees(status.limb_error_measured_rad)
        );
    }
    out!("calibration       {}", explain::calibration_name(&status));
    if status.payload_kg != [0.0; 2] {
        out!("payload           {}", explain::payload(&status));
    }
    out!("real-time         {}", if status.realtime == 1 { "yes" } else { "no" });
    out!("operators         {}", status.operators);
    out!("gate denials      {}", status.gate_denials);
    for fault in Faults(status.faults | status.latched).iter() {
        let latched = if Faults(status.latched).has(fault) { " (latched)" } else { "" };
        out!("fault             {}{latched}: {}", fault.row().name, meaning(fault, &status, &names));
        if let Some(advice) = advice(fault) {
            out!("                  {advice}");
        }
    }
    for row in &FAULTS {
        let count = status.fault_counts[row.fault.index()];
        if count > 0 {
            out!("raised so far     {} x {}", count, row.name);
        }
    }
    Ok(true)
}

fn calibrate(client: &mut Client, run_dir: &Path, args: &CalibrateArgs) -> Result<bool, OperatorError> {
    let folder = match &args.folder {
        Some(folder) => folder.clone(),
        None => match config::load(&args.config, config::Overrides::default()) {
            Ok(loaded) => loaded.operators_dir,
            Err(error) => {
                err!("teleopctl: {error}");
                return Ok(false);
            }
        },
    };
    calibrate::run(client, run_dir, &calibrate::Job { name: &args.name, folder, child_of: args.child_of })
}

/// Explains why a command cannot begin in this mode. Lists the latched faults and how to clear them.
fn only_disengaged(status: &Status, what: &str, names: &Names) -> String {
    let mut text = format!("{}: only a disengaged robot can be {what}", mode(status).name());
    let latched = Faults(status.latched);
    for fault in latched.iter() {
        text += &format!("\n{} (latched): {}", fault.row().name, meaning(fault, status, names));
    }
    match mode(status) {
        Mode::Faulted => {
            text += "\nteleopctl reset first: it clears the latched faults, once their cause is gone and the robot is at \
                 rest";
        }
        Mode::Engaging | Mode::Engaged | Mode::Recovering => {
            text += "\nanother operator moves it; teleopctl release ends that, and the robot stops";
        }
        Mode::Disengaged | Mode::Holding => {}
    }
    text
}

/// Returns advice for a fault whose meaning does not include it.
fn advice(fault: Fault) -> Option<&'static str> {
    (fault == Fault::InputStale).then_some(
        "start a client or a policy: `replay builtin --loop`, with the same --run-dir, plays a motion. If one runs, its camera may \
         see nobody. The log of `ingest` (in the terminal of `up`) says who holds the lease, and why frames were dropped",
    )
}

fn engage(client: &mut Client, run_dir: &Path, arm: Option<Hand>) -> Result<bool, OperatorError> {
    let first = client.heartbeat()?;
    let names = instance::read_names(run_dir);
    if mode(&first) != Mode::Disengaged {
        out!("{}", only_disengaged(&first, "engaged", &names));
        return Ok(false);
    }
    let blocking = Faults(first.faults | first.latched);
    for fault in blocking.iter() {
        out!("cannot engage: {}: {}", fault.row().name, meaning(fault, &first, &names));
        if let Some(advice) = advice(fault) {
            out!("{advice}");
        }
    }
    if !blocking.is_empty() {
        return Ok(false);
    }
    let begins = match arm {
        None => {
            client.enable();
            "the enable is held; Ctrl-C releases it"
        }
        Some(Hand::Left) => {
            client.enable_without(1);
            "the enable is held for the left arm, the right one stays; Ctrl-C releases it"
        }
        Some(Hand::Right) => {
            client.enable_without(0);
            "the enable is held for the right arm, the left one stays; Ctrl-C releases it"
        }
    };
    hold::hold(client, &first, &names, begins)
}

/// Holds the clutch, or takes arms over from a policy, until Ctrl-C, or until nobody holds the enable any more.
fn clutch(client: &mut Client, run_dir: &Path, takes: Option<[bool; 2]>) -> Result<bool, OperatorError> {
    let first = client.heartbeat()?;
    let names = instance::read_names(run_dir);
    if !matches!(mode(&first), Mode::Engaging | Mode::Engaged | Mode::Holding) {
        out!("nothing to hold: {}; this is for a robot that follows (teleopctl engage)", mode(&first).name());
        return Ok(false);
    }
    // Nobody leads while the robot holds, or while both arms wait for the policy.
    let policy = source_flag::POLICY[0] | source_flag::POLICY[1];
    if takes.is_some() && first.sources != 0 && first.sources & policy == 0 {
        out!("nothing to take over: no policy leads an arm (docs: Policies)");
        return Ok(false);
    }
    match takes {
        Some(arms) => _ = client.take_over(arms),
        None => _ = client.clutch(true),
    }
    hold::clutch(client, &first, &names, takes.is_some())
}

/// Holds the recovery until Ctrl-C, or until the robot is back.
fn recover(client: &mut Client, run_dir: &Path) -> Result<bool, OperatorError> {
    let first = client.heartbeat()?;
    let names = instance::read_names(run_dir);
    if mode(&first) != Mode::Disengaged {
        out!("{}", only_disengaged(&first, "recovered", &names));
        return Ok(false);
    }
    let faults = Faults(first.faults);
    if !faults.has(Fault::StartOutsideLimits) && !faults.has(Fault::StartInCollision) {
        out!("nothing to recover from: every joint is inside its limits, and nothing is too close");
        return Ok(true);
    }
    for fault in [Fault::StartOutsideLimits, Fault::StartInCollision].into_iter().filter(|&fault| faults.has(fault)) {
        out!("recovering from {}: {}", fault.row().name, meaning(fault, &first, &names));
    }
    client.recover();
    hold::hold(client, &first, &names, "the recovery is held; Ctrl-C releases it")
}

/// Presses reset repeatedly until it takes effect or the time is up. An emergency stop meanwhile ends it.
fn reset(client: &mut Client, run_dir: &Path) -> Result<bool, OperatorError> {
    let first = client.heartbeat()?;
    if mode(&first) != Mode::Faulted {
        out!("nothing to reset: {}", mode(&first).name());
        return Ok(true);
    }
    let (begun, mut presses, mut beats) = (Instant::now(), 0, 0);
    loop {
        if begun.elapsed() >= RESET_EVERY * presses {
            client.reset();
            presses += 1;
        }
        let status = client.heartbeat()?;
        if stopped_anew(&first, &status) {
            out!("not reset: the robot was stopped again meanwhile");
            return Ok(false);
        }
        if mode(&status) != Mode::Faulted {
            out!("reset: {}", mode(&status).name());
            return Ok(true);
        }
        // Control made this answer before it read the press. The next answer tells.
        if beats > 0
            && let Some(why) = operator::reset_refusal(&status)
        {
            out!("reset refused: {why}");
            return Ok(false);
        }
        beats += 1;
        if begun.elapsed() > EFFECT_WITHIN {
            out!("{}", not_reset(&status, &instance::read_names(run_dir)));
            return Ok(false);
        }
        std::thread::sleep(HEARTBEAT);
    }
}

/// Returns true if someone pressed the emergency stop after `first`, or if something stopped the robot after a reset.
fn stopped_anew(first: &Status, now: &Status) -> bool {
    let pressed = |status: &Status| status.fault_counts[Fault::EmergencyStop.index()];
    let moved_on = now.transition_count != first.transition_count;
    pressed(now) != pressed(first) || moved_on && mode(now) == Mode::Faulted
}

/// Explains why a reset had no effect: the persisting faults, or the missing condition.
fn not_reset(status: &Status, names: &Names) -> String {
    let mut text = format!("not reset within {} s: {}", EFFECT_WITHIN.as_secs(), mode(status).name());
    let persists = Faults(status.faults).with_response(Response::Stop);
    for fault in persists.iter() {
        text += &format!("\n{} persists: {}", fault.row().name, meaning(fault, status, names));
    }
    if persists.is_empty() {
        text += "\nno cause persists, but the robot still moves, or an operator holds the enable (teleopctl release)";
        text.extend(explain::not_at_rest(status, names).map(|why| format!("\n{why}")));
    }
    text
}

/// Repeats the heartbeat until `done`, then prints `word`. Otherwise prints the obstacle.
fn until(client: &mut Client, word: &str, done: impl Fn(&Status) -> bool) -> Result<bool, OperatorError> {
    let give_up = Instant::now() + EFFECT_WITHIN;
    // Control made the reply to the request before it read the request.
    client.heartbeat()?;
    loop {
        std::thread::sleep(HEARTBEAT);
        let status = client.heartbeat()?;
        if done(&status) {
            out!("{word}: {}", mode(&status).name());
            return Ok(true);
        }
        if Instant::now() > give_up {
            out!("not {word} within {} s: {}", EFFECT_WITHIN.as_secs(), mode(&status).name());
            for fault in Faults(status.faults | status.latched).iter() {
                out!("{}: {}", fault.row().name, fault.row().meaning);
            }
            return Ok(false);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::Layout;

    #[test]
    fn refusal_of_faulted_robot_names_fault_and_reset() {
        let latched = Faults::NONE.with(Fault::EmergencyStop).0;
        let status = Status { mode: Mode::Faulted as u32, latched, ..Status::ZERO };
        let sentence = only_disengaged(&status, "engaged", &Names::default());
        let row = Fault::EmergencyStop.row();
        for words in ["Faulted: only a disengaged", row.name, row.meaning, "teleopctl reset first"] {
            assert!(sentence.contains(words), "{words}: {sentence}");
        }
        let engaged = Status { mode: Mode::Engaged as u32, ..Status::ZERO };
        let sentence = only_disengaged(&engaged, "engaged", &Names::default());
        assert!(
            !sentence.contains("reset")
                && sentence.contains("another operator")
                && sentence.contains("teleopctl release"),
            "{sentence}"
        );
    }

    #[test]
    fn failed_reset_names_persisting_fault_or_new_stop() {
        let latched = Faults::NONE.with(Fault::EmergencyStop).0;
        let first = Status { mode: Mode::Faulted as u32, latched, ..Status::ZERO };
        let sentence = not_reset(&first, &Names::default());
        assert!(sentence.contains("still moves") && sentence.contains("teleopctl release"), "{sentence}");
        let silent = Status { faults: Faults::NONE.with(Fault::StateStale).0, ..first };
        let sentence = not_reset(&silent, &Names::default());
        assert!(sentence.contains("StateStale persists: ") && !sentence.contains("still moves"), "{sentence}");
        assert!(!stopped_anew(&first, &silent));
        let mut pressed = first;
        pressed.fault_counts[Fault::EmergencyStop.index()] += 1;
        assert!(stopped_anew(&first, &pressed));
        assert!(stopped_anew(&first, &Status { transition_count: 2, ..first }), "reset, and stopped for another cause");
        let disengaged = Status { mode: Mode::Disengaged as u32, transition_count: 1, ..first };
        assert!(!stopped_anew(&first, &disengaged));
    }
}
