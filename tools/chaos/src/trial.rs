//! One fault and its outcome.

use crate::figures::has_robot;
use crate::injection::{Injection, Kind, Target};
use crate::monitor::Monitor;
use crate::rig::Rig;
use harness::within_by;
use messages::{Mode, TICK_HZ, state_flag, tick_at};
use rt::{Exit, Failure};
use std::time::{Duration, Instant};

/// Longest wait for a rest that must come. Only a robot that does not stop takes nearly as long.
const REST_WITHIN: Duration = Duration::from_secs(5);
/// Time between two looks at the monitor.
const LOOK: Duration = Duration::from_millis(1);
/// Number of attempts to engage. A busy machine starves heartbeats, and then control rightly revokes the enable.
const TRIES_MAX: u32 = 5;
/// Time for which a restarted or resumed process is watched: longer than any stale time of a real-time stream.
const WATCHED: Duration = Duration::from_millis(250);

#[derive(Clone, Copy, Debug)]
pub struct Outcome {
    pub fault: Injection,
    /// True if the robot moved in the tick of the fault.
    pub moving: bool,
    /// Ticks from the fault to rest, by the driver's own count. None if the driver died, or if nothing had to stop.
    pub rest_after_ticks: Option<u64>,
    /// True if the robot came to rest, or did not have to.
    pub rested: bool,
}

/// Brings the instance to `mode`, from any earlier state.
pub fn engage(rig: &mut Rig, target: Target, mode: Mode) -> Result<(), Failure> {
    let mut tries = 0;
    loop {
        rig.clear()?;
        rig.monitor.must_rest(false);
        match rig.engage(target, mode) {
            Err(failure) if failure.exit == Exit::Failed && tries < TRIES_MAX => tries += 1,
            engaged => return engaged,
        }
        rig.release();
    }
}

/// Engages, injects the fault, and watches.
pub fn run(rig: &mut Rig, fault: Injection) -> Result<Outcome, Failure> {
    engage(rig, fault.target, if fault.engaged { Mode::Engaged } else { Mode::Engaging })?;
    std::thread::sleep(fault.phase);
    let mut outcome = Outcome { fault, moving: !rig.monitor.seen().at_rest(), rest_after_ticks: None, rested: true };
    match fault.kind {
        Kind::Kill { held_on } => kill(rig, &mut outcome, held_on)?,
        Kind::Suspend { length } => suspend(rig, &mut outcome, length)?,
    }
    rig.release();
    Ok(outcome)
}

fn kill(rig: &mut Rig, outcome: &mut Outcome, held_on: Duration) -> Result<(), Failure> {
    let target = outcome.fault.target;
    let struck = tick_at(rt::now());
    rig.kill(target);
    if target == Target::Driver {
        // The robot stops by itself, and control detects the fault.
        let faulted = rig.operator.wait(REST_WITHIN, |status| status.mode == Mode::Faulted as u32);
        outcome.rested = faulted && (!has_robot(&rig.settings) || robot_stands(&rig.monitor));
    } else {
        wait_rest(rig, outcome, struck);
    }
    // The robot must stay at rest when the process returns, even though the enable is still held.
    rig.monitor.must_rest(outcome.rested);
    std::thread::sleep(held_on);
    if target == Target::Client {
        // `ingest` refuses for good a session that begins while another one still holds the lease.
        std::thread::sleep(Duration::from_secs_f64(rig.settings.ingest.authority_timeout_ms * 1e-3));
    }
    rig.revive(target)?;
    std::thread::sleep(WATCHED);
    Ok(())
}

fn suspend(rig: &mut Rig, outcome: &mut Outcome, length: Duration) -> Result<(), Failure> {
    let safety = &rig.settings.safety;
    let target = outcome.fault.target;
    let bound_ticks = target.rest_within_ticks(safety, safety.stale_factor_without_realtime);
    let id = rig.id(target)?;
    let struck = tick_at(rt::now());
    rt::suspend(id);
    // A suspended driver executes nothing. For any other target, a long suspension is a silence like that of a death.
    let must_rest = target != Target::Driver && length.as_secs_f64() * TICK_HZ as f64 > bound_ticks as f64;
    let resume_at = Instant::now() + length;
    if must_rest {
        wait_rest(rig, outcome, struck);
    }
    std::thread::sleep(resume_at.saturating_duration_since(Instant::now()));
    rt::resume(id);
    std::thread::sleep(WATCHED);
    Ok(())
}

fn robot_stands(monitor: &Monitor) -> bool {
    within_by(REST_WITHIN, LOOK, || monitor.seen().robot_stands())
}

/// Waits until the driver reports rest at a tick after the fault was detected. Earlier rest does not count: an engaged robot rests
/// while its person stands still, and the driver still executes commands from before the detection.
fn wait_rest(rig: &mut Rig, outcome: &mut Outcome, struck: u64) {
    let mut noticed = None;
    outcome.rested = within_by(REST_WITHIN, LOOK, || {
        let seen = rig.monitor.seen();
        noticed = noticed.or_else(|| {
            if outcome.fault.target == Target::Control {
                return seen.latest.filter(|state| state.flags & state_flag::DRIVER_FAULT != 0).map(|_| seen.k());
            }
            let status = rig.operator.status()?;
            let moves = matches!(Mode::from_u32(status.mode), Some(Mode::Engaging | Mode::Engaged) | None);
            (!moves).then_some(status.k)
        });
        if seen.at_rest() && noticed.is_some_and(|noticed| seen.k() >= noticed.max(struck + 1)) {
            outcome.rest_after_ticks = Some(seen.k() - struck);
        }
        outcome.rest_after_ticks.is_some()
    });
}
