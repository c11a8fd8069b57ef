//! A driver's tick in front of its robot: measure, follow, write.

use crate::follower::{self, Accepted, Config, State, Step};
use crate::{Driver, Measured, Refusal, Setpoint};
use messages::{
    Faults, GripperMotion, GripperState, Header, JointCommand, Layout, RobotState, Stamp, StopPlan, state_flag,
};

/// Sees every step that a driver executes, and may replace what the robot is sent. `()` does neither.
pub trait Observer {
    /// Called for each executed step, in order. `command` is the newest command, executed or not.
    fn step(&mut self, step: &Step, command: Option<&JointCommand>);

    /// The setpoint and stop to send for the executed `setpoint` and its `plan`. A simulated interface that interpolates
    /// points of its own sends those.
    fn sent<'a>(&'a self, setpoint: &'a Setpoint, plan: &'a StopPlan) -> (&'a Setpoint, &'a StopPlan) {
        (setpoint, plan)
    }
}

impl Observer for () {
    fn step(&mut self, _: &Step, _: Option<&JointCommand>) {}
}

/// State of a driver and of its conversation with the robot.
#[derive(Clone, Debug)]
pub struct Drive {
    follower: State,
    /// The grippers. `None` until the robot says where it holds them.
    grippers: Option<GripperMotion>,
    measured: Measured,
    sequence: u64,
    port_fault: bool,
    /// The last setpoint was not sent, because an answer of the robot was awaited.
    withheld: bool,
    first_latch: Option<&'static str>,
}

impl Drive {
    /// A driver that starts at index `k`. The robot measured `earlier`, and measures `measured` now. Returns `None` if a
    /// number of it is not finite.
    pub fn new(config: &Config, k: u64, earlier: &Measured, measured: &Measured) -> Option<Self> {
        let follower = State::begin(config, k, earlier, measured)?;
        let (measured, first_latch) = (*measured, None);
        Some(Self { follower, grippers: None, measured, sequence: 0, port_fault: false, withheld: false, first_latch })
    }

    /// The follower.
    pub const fn follower(&self) -> &State {
        &self.follower
    }

    /// The newest measurement.
    pub const fn measured(&self) -> &Measured {
        &self.measured
    }

    /// Returns true if the robot refused the last setpoint.
    pub const fn refused(&self) -> bool {
        self.port_fault
    }

    /// The reason why the driver latched first, in words. `None` if it never did.
    pub const fn first_latch(&self) -> Option<&'static str> {
        self.first_latch
    }
}

/// Input of [`drive`].
#[derive(Clone, Copy, Debug)]
pub struct DriveInput<'a> {
    /// The last index whose deadline plus grace is not after now.
    pub due_k: u64,
    /// The newest command. A command that was given before is ignored.
    pub command: Option<&'a JointCommand>,
}

/// Output of [`drive`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DriveOutput {
    /// The message to publish. Sequence, stamp and origin of its header are filled in.
    pub state: RobotState,
    /// Indices by which the executed state is newer than before. Zero if nothing was due.
    pub advanced: u64,
    /// The command that was accepted in this tick, and its latencies.
    pub accepted: Option<Accepted>,
    /// The reason why the command of this tick was refused.
    pub refused: Option<Refusal>,
    /// Ticks for which the driver was suspended while the robot moved.
    pub suspended_ticks: Option<u64>,
    /// `DriverFault` while latched.
    pub faults: Faults,
}

/// Reads the robot, executes up to the index that is due, and writes the setpoint if there is a new one.
pub fn drive(
    config: &Config,
    state: &mut Drive,
    now: Stamp,
    input: DriveInput<'_>,
    port: &mut impl Driver,
    observer: &mut impl Observer,
) -> DriveOutput {
    let before = state.measured.stamp;
    state.measured = port.read(now);
    let (measured, was_latched) = (&state.measured, state.follower.latched);
    let port_refused = if state.withheld { measured.refused } else { state.port_fault };
    let apart_ns = measured.apart_ns(now);
    let unseen = measured.stamp == before && apart_ns > config.unseen_ns;
    let unheard = apart_ns > config.measured_age_max_ns;
    let follow = follower::Input {
        due_k: input.due_k,
        command: input.command,
        port_fault: port_refused || unheard,
        measured: Some(measured),
    };
    let mut moved = false;
    let out = follower::tick_each(config, &mut state.follower, now, follow, |step| {
        observer.step(step, input.command);
        moved = true;
    });
    state.withheld = out.withheld;
    let (gripped, limits) = (port.gripped(), &config.grippers);
    let accepted = input.command.filter(|_| out.accepted.is_some()).map(|command| &command.grippers);
    let held = state.grippers.or_else(|| limits.at_rest(&gripped?));
    state.grippers = held.map(|held| limits.after(&held, out.advanced, accepted));
    if let Some(grippers) = &state.grippers {
        port.grip(grippers);
    }
    if moved && !out.withheld {
        let executed = state.follower.setpoint();
        let (setpoint, plan) = observer.sent(&executed, &state.follower.motion.plan);
        state.port_fault = !port.write(now, setpoint, plan);
    }
    if state.follower.latched && !was_latched {
        let sound = state.measured.drives.are_sound();
        state.first_latch.get_or_insert(latch_cause(port_refused, unheard, sound, out.suspended_ticks.is_some()));
    }
    state.sequence += 1;
    let header = Header { sequence: state.sequence, stamp: now, ..Header::ZERO };
    DriveOutput {
        state: completed(state.follower.echo(config, header, &state.measured), unseen, state.grippers, gripped),
        advanced: out.advanced,
        accepted: out.accepted,
        refused: out.refused,
        suspended_ticks: out.suspended_ticks,
        faults: out.faults,
    }
}

/// Adds to the message whether the robot is unseen, and the executed and the measured grippers.
fn completed(
    echo: RobotState,
    unseen: bool,
    executed: Option<GripperMotion>,
    measured: Option<GripperState>,
) -> RobotState {
    let flags = [(unseen, state_flag::UNSEEN), (measured.is_some(), state_flag::GRIPPERS)];
    RobotState {
        grippers: executed.unwrap_or(GripperMotion::ZERO),
        grippers_measured: measured.unwrap_or(GripperState::ZERO),
        flags: flags.iter().filter(|(present, _)| *present).fold(echo.flags, |all, (_, flag)| all | flag),
        ..echo
    }
}

/// The reason for a latch, in words.
fn latch_cause(port_refused: bool, unheard: bool, sound: bool, suspended: bool) -> &'static str {
    if port_refused {
        "the robot refused a setpoint"
    } else if unheard {
        "the robot sent no measurement"
    } else if !sound {
        "a drive reported a fault, or had no power"
    } else if suspended {
        "the driver was suspended for too long, or no measurement was plausible"
    } else {
        "no command arrived"
    }
}
