//! The simulated robot as a process sees it: a command in, the robot's state out.

use crate::checker::Checker;
use crate::config::Config;
use crate::injection::Injection;
use crate::interface::{CONTROLLERS, Controllers, Interface};
use crate::plant::{Plant, Port};
use crate::report::Report;
use driver::{Accepted, Driver, Measured, Refusal, Setpoint, StepKind};
use messages::{Faults, Header, JOINTS, JointCommand, Layout, RobotState, Stamp};

/// Everything remembered.
#[derive(Clone, Debug)]
pub struct State {
    follower: driver::State,
    /// Absent where the robot takes every setpoint.
    controllers: Option<Controllers>,
    plant: Plant,
    checker: Checker,
    report: Report,
    sequence: u64,
    port_fault: bool,
    measured: Measured,
}

impl State {
    /// At rest in the initial posture at index `k`, holding what its encoders read; `seed` is that of the noise.
    pub fn new(config: &Config, k: u64, seed: u64) -> Self {
        Self::standing(config, k, &config.initial, seed)
            .expect("the initial posture was checked, and the noise is finite")
    }

    /// A driver that starts at index `k` on a robot that stands at `q`, wherever that is; `None` if a number of it is not
    /// finite.
    pub fn standing(config: &Config, k: u64, q: &[f64; JOINTS], seed: u64) -> Option<Self> {
        let mut plant = Plant::standing(k, q, seed);
        let measured = Port { config, plant: &mut plant }.read(Stamp::NONE);
        let follower = driver::State::hold(k, &measured.q)?;
        let held = follower.setpoint();
        let controllers = (config.interface == Interface::Jtc100).then(|| Controllers::new(&held, seed));
        let checker = Checker::new(config, held);
        let report = Report::new(config.model.prismatic);
        Some(Self { follower, controllers, plant, checker, report, sequence: 0, port_fault: false, measured })
    }

    /// What the run amounts to so far.
    pub fn report(&self) -> &Report {
        &self.report
    }

    /// The driver's side.
    pub fn follower(&self) -> &driver::State {
        &self.follower
    }

    /// Where the joints are in truth, rad or m.
    pub fn q(&self) -> &[f64; JOINTS] {
        self.plant.q()
    }

    /// What the joints were told last: the driver's setpoint, or what controllers made of it.
    pub fn told(&self) -> &Setpoint {
        self.plant.told()
    }

    /// Delays of torso, head, left arm and right arm, s, where they have controllers of their own.
    pub fn delays_s(&self) -> Option<[f64; CONTROLLERS]> {
        self.controllers.as_ref().map(Controllers::delays_s)
    }

    /// Whether the driver and all controllers are at rest.
    pub fn at_rest(&self) -> bool {
        self.follower.motion.at_rest() && self.controllers.as_ref().is_none_or(Controllers::at_rest)
    }

    /// Switches a fault of the robot on.
    pub fn inject(&mut self, fault: Injection) {
        self.plant.inject(fault);
    }

    /// Switches all injected faults off.
    pub fn repair(&mut self) {
        self.plant.repair();
    }
}

/// What a tick is given.
#[derive(Clone, Copy, Debug)]
pub struct Input<'a> {
    /// The last index whose deadline and grace are not after now.
    pub due_k: u64,
    /// The newest command; one that was given before is ignored.
    pub command: Option<&'a JointCommand>,
}

/// What a tick results in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Output {
    /// To be published; of its header, sequence, stamp and origin are filled.
    pub state: RobotState,
    /// Indices by which the executed state is newer than before; zero if nothing was due.
    pub advanced: u64,
    /// The command that was accepted in this tick, and its latencies.
    pub accepted: Option<Accepted>,
    /// Why the command of this tick was refused.
    pub refused: Option<Refusal>,
    /// `DriverFault` while latched.
    pub faults: Faults,
}

/// Executes up to the index that is due, moves the joints, measures, and checks every step.
pub fn tick(config: &Config, state: &mut State, now: Stamp, input: Input<'_>) -> Output {
    let State { follower, controllers, plant, checker, report, port_fault, measured, .. } = state;
    let mut port = Port { config, plant };
    let mut mode = follower.mode;
    let (mut rejected, mut told) = (false, follower.setpoint());
    let follow = driver::Input {
        due_k: input.due_k,
        command: input.command,
        port_fault: *port_fault,
        measured: Some(&*measured),
    };
    let out = driver::tick_each(&config.follower, follower, now, follow, |step| {
        if step.kind == StepKind::Command {
            mode = input.command.map_or(mode, |command| command.mode);
        }
        if step.kind == StepKind::Measured {
            // Nobody commanded that.
            checker.hold(config, &step.setpoint);
            if let Some(controllers) = controllers.as_mut() {
                controllers.hold(&step.setpoint);
            }
        } else {
            checker.step(config, report, &step.setpoint, mode);
        }
        let mut write = |executed: &Setpoint| {
            rejected |= !port.write(now, executed);
            told = *executed;
        };
        match controllers.as_mut() {
            None => write(&step.setpoint),
            Some(controllers) => controllers.advance(&step.setpoint, |executed| {
                checker.spline(config, report, executed);
                write(executed);
            }),
        }
    });
    *measured = port.read(now);
    if out.advanced > 0 {
        *port_fault = rejected;
        report.tracking_samples += 1;
        for j in 0..JOINTS {
            let error = (told.q[j] - measured.q[j]).abs();
            report.tracking_max[j] = report.tracking_max[j].max(error);
            report.tracking_squares[j] += error * error;
        }
    }
    state.sequence += 1;
    let header = Header { sequence: state.sequence, stamp: now, ..Header::ZERO };
    Output {
        state: state.follower.echo(header, &state.measured),
        advanced: out.advanced,
        accepted: out.accepted,
        refused: out.refused,
        faults: out.faults,
    }
}
