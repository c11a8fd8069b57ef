//! Holds the enable or the recovery until Ctrl-C, and prints every change as it happens.

use crate::{EFFECT_WITHIN, HEARTBEAT, mode};
use explain::meaning;
use messages::{Faults, Mode, Status, Transition};
use operator::{Client, OperatorError};
use robot::Names;
use rt::{Exit, out};
use std::time::{Duration, Instant};

/// Time after which a press without effect counts as refused. It is many times a poll of the socket and a tick.
const REFUSED_AFTER: Duration = Duration::from_secs(1);

/// Text for a release that this program did not cause.
const ELSEWHERE: &str =
    "Another client released it, the page, or the end of teleopd; or its link or this program was silent";

/// Holds the enable or the recovery at 50 Hz until Ctrl-C. Returns true if the operator released it or the robot
/// recovered.
pub fn hold(client: &mut Client, first: &Status, names: &Names, begins: &str) -> Result<bool, OperatorError> {
    let stop = rt::Shutdown::on_signals().expect("signal handlers can be installed");
    let mut printer = EventPrinter::new(first);
    printer.print(begins);
    let mut beat = printer.begun;
    while !stop.requested() {
        let last = client.heartbeat()?;
        printer.print_news(&last, names);
        let changed = last.transition_count > first.transition_count;
        if changed && has_ended(&last) {
            let newest = explain::newest_transitions(&last, 1).next();
            return Ok(newest.is_some_and(|made| made.why == Transition::RECOVERED));
        }
        if !changed && printer.begun.elapsed() > REFUSED_AFTER {
            refused(&last, names);
            return Ok(false);
        }
        beat += HEARTBEAT;
        std::thread::sleep(beat.saturating_duration_since(Instant::now()));
    }
    client.release();
    printer.let_go = true;
    let give_up = Instant::now() + EFFECT_WITHIN;
    // Control made the reply to the request before it read the request.
    client.heartbeat()?;
    loop {
        std::thread::sleep(HEARTBEAT);
        let last = client.heartbeat()?;
        printer.print_news(&last, names);
        if has_ended(&last) {
            return Ok(mode(&last) != Mode::Faulted);
        }
        if Instant::now() > give_up {
            printer.print(&format!("not released within {} s: {}", EFFECT_WITHIN.as_secs(), mode(&last).name()));
            return Ok(false);
        }
    }
}

/// Holds the clutch, or the arms that it takes over, at 50 Hz until Ctrl-C. Returns true if the robot follows again afterwards. A closed terminal and every
/// other signal end it without letting go, so the robot is released.
pub fn clutch(client: &mut Client, first: &Status, names: &Names, takes_over: bool) -> Result<bool, OperatorError> {
    let stop = rt::Shutdown::on_signals().expect("signal handlers can be installed");
    let mut printer = EventPrinter::new(first);
    printer.print(match takes_over {
        true => "the person leads; Ctrl-C gives back, and the arm waits there for a policy that has seen it",
        false => "the clutch is held; Ctrl-C lets go, and the robot moves slowly to where the person is",
    });
    let (mut beat, mut let_go_at) = (printer.begun, None);
    loop {
        let last = client.heartbeat()?;
        printer.print_news(&last, names);
        if has_ended(&last) {
            return Ok(false);
        }
        if let_go_at.is_some_and(|at: Instant| at.elapsed() > REFUSED_AFTER) {
            // Another clutch, or another cause, may still hold.
            for fault in Faults(last.faults).iter() {
                printer.print(&format!("still held by {}: {}", fault.row().name, meaning(fault, &last, names)));
            }
            return Ok(mode(&last) != Mode::Holding);
        }
        match stop.signal() {
            Some(_) if Exit::after(&stop) != Exit::Interrupted => return Ok(false),
            Some(_) if let_go_at.is_none() => {
                client.clutch(false).take_over([false; 2]);
                printer.print("let go");
                let_go_at = Some(Instant::now());
            }
            _ => {}
        }
        beat += HEARTBEAT;
        std::thread::sleep(beat.saturating_duration_since(Instant::now()));
    }
}

fn has_ended(status: &Status) -> bool {
    matches!(mode(status), Mode::Disengaged | Mode::Faulted)
}

fn refused(status: &Status, names: &Names) {
    out!("refused: {}", mode(status).name());
    for fault in Faults(status.faults | status.latched).iter() {
        out!("{}: {}", fault.row().name, meaning(fault, status, names));
    }
    if let Some(why) = explain::not_at_rest(status, names) {
        out!("{why}");
    }
}

struct EventPrinter {
    begun: Instant,
    /// Number of transitions already printed.
    shown: u32,
    activity: Option<&'static str>,
    /// This program let go of the enable.
    let_go: bool,
}

impl EventPrinter {
    fn new(first: &Status) -> Self {
        Self { begun: Instant::now(), shown: first.transition_count, activity: None, let_go: false }
    }

    fn print(&self, what: &str) {
        out!("{:>6.1} s  {what}", self.begun.elapsed().as_secs_f64());
    }

    fn print_news(&mut self, status: &Status, names: &Names) {
        for made in explain::newest_transitions(status, status.transition_count.saturating_sub(self.shown)) {
            self.print(&change(made, status, names, self.let_go));
        }
        self.shown = self.shown.max(status.transition_count);
        let activity = explain::activity(status);
        if let Some(name) = activity.filter(|_| activity != self.activity) {
            self.print(&format!("{name}: {:.0} mm to go", status.torso_to_go_m.abs() * 1e3));
        }
        self.activity = activity;
    }
}

fn change(made: &Transition, status: &Status, names: &Names, let_go: bool) -> String {
    let why = explain::fault_behind(made, status, names);
    match (Mode::from_u32(made.to), made.why, why) {
        (Some(Mode::Engaging), ..) => "engaging: the robot moves slowly to the posture that it will follow".into(),
        (Some(Mode::Engaged), ..) => "engaged: the robot follows".into(),
        (Some(Mode::Recovering), ..) => "recovering: the robot moves back slowly".into(),
        (Some(Mode::Holding), _, Some(why)) => format!("holding because of {why}"),
        (Some(Mode::Holding), Transition::RELEASED, None) if !let_go => {
            format!("releasing: the robot stops. {ELSEWHERE}")
        }
        (Some(Mode::Holding), _, None) => "releasing: the robot stops".into(),
        (Some(Mode::Disengaged), _, Some(why)) => format!("released because of {why}"),
        (Some(Mode::Disengaged), Transition::RECOVERED, None) => "recovered: the robot may be engaged".into(),
        (Some(Mode::Disengaged), Transition::BLOCKED, None) => "released: the recovery found no path".into(),
        (Some(Mode::Disengaged), Transition::RESET, None) => "reset: the robot may be engaged".into(),
        (Some(Mode::Disengaged), Transition::RELEASED, None) if !let_go => format!("released. {ELSEWHERE}"),
        (Some(Mode::Disengaged), _, None) => "released: the robot is at rest and keeps its posture".into(),
        (Some(Mode::Faulted), _, why) => {
            let why = why.unwrap_or_else(|| format!("{}.", made.why_name()));
            format!("stopped because of {why} `teleopctl reset` clears that, once its cause is gone")
        }
        (None, ..) => format!("in a mode unknown to this program ({})", made.to),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::{Fault, Layout};

    #[test]
    fn mode_changes_are_reported_in_plain_words() {
        let (status, names) = (Status::ZERO, Names::default());
        let described = |from: Mode, to: Mode, why: u32| {
            change(&Transition { k: 1, from: from as u32, to: to as u32, why, about: 0 }, &status, &names, false)
        };
        let stale = Fault::InputStale;
        assert!(described(Mode::Disengaged, Mode::Engaging, Transition::ENABLED).starts_with("engaging: "));
        assert!(described(Mode::Engaging, Mode::Engaged, Transition::ALIGNED).starts_with("engaged: "));
        let held = described(Mode::Engaged, Mode::Holding, stale as u32);
        assert_eq!(held, format!("holding because of InputStale: {}", stale.row().meaning));
        assert!(described(Mode::Engaged, Mode::Holding, Transition::RELEASED).ends_with(ELSEWHERE));
        assert!(described(Mode::Holding, Mode::Disengaged, Transition::RELEASED).ends_with(ELSEWHERE));
        assert!(described(Mode::Holding, Mode::Disengaged, Transition::AT_REST).starts_with("released: "));
        assert!(
            described(Mode::Holding, Mode::Disengaged, Fault::HoldTimeout as u32).starts_with("released because of ")
        );
        assert!(described(Mode::Recovering, Mode::Disengaged, Transition::RECOVERED).starts_with("recovered: "));
        let stopped = described(Mode::Engaged, Mode::Faulted, Fault::EmergencyStop as u32);
        assert!(stopped.starts_with("stopped because of EmergencyStop: ") && stopped.contains("reset"), "{stopped}");
    }
}
