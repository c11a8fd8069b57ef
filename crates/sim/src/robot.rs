//! The simulated robot as a process sees it: a command in, the robot's state out.

use crate::body::{Body, Port};
use crate::checker::Checker;
use crate::config::Config;
use crate::interface::{CONTROLLERS, Controllers, Interface};
use crate::report::Report;
use driver::{Accepted, Driver, Measured, Refusal, Setpoint, StepKind};
use messages::{Faults, Header, JOINTS, JointCommand, Layout, RobotState, Stamp, StopPlan, command_flag, deadline};
use plant::Injection;

/// The driver and everything between it and the robot's body.
#[derive(Clone, Debug)]
pub struct DriverState {
    follower: driver::State,
    /// Absent where the robot takes every setpoint.
    controllers: Option<Controllers>,
    checker: Checker,
    report: Report,
    sequence: u64,
    port_fault: bool,
    /// The last setpoint was not handed to the robot, whose answer is awaited.
    withheld: bool,
    measured: Measured,
    /// What the joints were told last.
    told: Setpoint,
    /// Why the driver latched first; `None` if it never did.
    first_latch: Option<&'static str>,
}

impl DriverState {
    /// A driver that starts at index `k` on a robot that measures this now, and measured that `earlier`; `None` if a number of it
    /// is not finite. `seed` is that of the controllers' delays.
    pub fn new(config: &Config, k: u64, earlier: &Measured, measured: &Measured, seed: u64) -> Option<Self> {
        let follower = driver::State::begin(&config.follower, k, earlier, measured)?;
        let held = follower.setpoint();
        let controllers = (config.interface == Interface::Jtc100).then(|| Controllers::new(&held, seed));
        let checker = Checker::new(config, held);
        let report = Report::new(config.model.prismatic);
        let measured = *measured;
        Some(Self {
            follower,
            controllers,
            checker,
            report,
            sequence: 0,
            port_fault: false,
            withheld: false,
            measured,
            told: held,
            first_latch: None,
        })
    }

    /// What the commands of the run amount to so far.
    pub fn report(&self) -> &Report {
        &self.report
    }

    /// Why the driver latched first, in words; `None` if it never did.
    pub fn first_latch(&self) -> Option<&'static str> {
        self.first_latch
    }

    /// The follower.
    pub fn follower(&self) -> &driver::State {
        &self.follower
    }

    /// Delays of torso, head, left arm and right arm, s, where they have controllers of their own.
    pub fn delays_s(&self) -> Option<[f64; CONTROLLERS]> {
        self.controllers.as_ref().map(Controllers::delays_s)
    }

    /// Whether the driver and all controllers are at rest.
    pub fn at_rest(&self) -> bool {
        self.follower.motion.at_rest() && self.controllers.as_ref().is_none_or(Controllers::at_rest)
    }
}

/// The driver and the body in one thread.
#[derive(Clone, Debug)]
pub struct State {
    driver: DriverState,
    body: Body,
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
        if q.iter().any(|q| !q.is_finite()) {
            return None;
        }
        let mut body = Body::new(config, deadline(k), q, seed);
        let measured = Port { config, body: &mut body }.read(deadline(k));
        Some(Self { driver: DriverState::new(config, k, &measured, &measured, seed)?, body })
    }

    /// Replaces the driver by one that starts at index `k` on the robot as it is; false, and nothing happens, if what it
    /// measures is no posture.
    pub fn restart_driver(&mut self, config: &Config, k: u64, now: Stamp, seed: u64) -> bool {
        let measured = Port { config, body: &mut self.body }.read(now);
        let restarted = DriverState::new(config, k, &self.driver.measured, &measured, seed);
        let found = restarted.is_some();
        if let Some(mut restarted) = restarted {
            restarted.report = self.driver.report.clone();
            self.driver = restarted;
        }
        found
    }

    /// What the commands of the run amount to so far.
    pub fn report(&self) -> &Report {
        self.driver.report()
    }

    /// What the joints truly did so far.
    pub fn judged(&self) -> &plant::Report {
        self.body.judged()
    }

    /// The driver's side.
    pub fn follower(&self) -> &driver::State {
        self.driver.follower()
    }

    /// Where the joints are in truth, rad or m.
    pub fn q(&self) -> &[f64; JOINTS] {
        &self.body.truth().q
    }

    /// What the joints truly do.
    pub fn truth(&self) -> &plant::Truth {
        self.body.truth()
    }

    /// What the joints were told last: the driver's setpoint, or what controllers made of it.
    pub fn told(&self) -> &Setpoint {
        &self.driver.told
    }

    /// Whether the robot refused the last setpoint.
    pub fn refused(&self) -> bool {
        self.driver.port_fault
    }

    /// Delays of torso, head, left arm and right arm, s, where they have controllers of their own.
    pub fn delays_s(&self) -> Option<[f64; CONTROLLERS]> {
        self.driver.delays_s()
    }

    /// Whether the driver and all controllers are at rest.
    pub fn at_rest(&self) -> bool {
        self.driver.at_rest()
    }

    /// The robot goes on by itself until `now`, while its driver does not run.
    pub fn advance(&mut self, config: &Config, now: Stamp) {
        self.body.advance(config, now);
    }

    /// What the robot measures at `now`, to a driver that is about to start.
    pub fn measure(&mut self, config: &Config, now: Stamp) -> Measured {
        Port { config, body: &mut self.body }.read(now)
    }

    /// Switches a fault of the robot on.
    pub fn inject(&mut self, fault: Injection) {
        self.body.inject(fault);
    }

    /// Switches all injected faults off.
    pub fn repair(&mut self) {
        self.body.repair();
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
    /// The driver was suspended for so many ticks while the robot moved.
    pub suspended_ticks: Option<u64>,
    /// `DriverFault` while latched.
    pub faults: Faults,
}

/// Moves the body on to `now`, executes up to the index that is due, and checks every step.
pub fn tick(config: &Config, state: &mut State, now: Stamp, input: Input<'_>) -> Output {
    let State { driver, body } = state;
    drive(config, driver, now, input, &mut Port { config, body })
}

/// The driver's side of [`tick`], before any robot.
pub fn drive(config: &Config, state: &mut DriverState, now: Stamp, input: Input<'_>, port: &mut impl Driver) -> Output {
    let DriverState {
        follower, controllers, checker, report, port_fault, withheld, measured, told, first_latch, ..
    } = state;
    *measured = port.read(now);
    let was_latched = follower.latched;
    let port_refused = if *withheld { measured.refused } else { *port_fault };
    let unheard = measured.apart_ns(now) > config.measured_age_max_ns;
    let mut mode = follower.mode;
    let follow = driver::Input {
        due_k: input.due_k,
        command: input.command,
        port_fault: port_refused || unheard,
        measured: Some(&*measured),
    };
    let mut moved = false;
    let out = driver::tick_each(&config.follower, follower, now, follow, |step| {
        if step.kind == StepKind::Command {
            mode = input.command.map_or(mode, |command| command.mode);
            if input.command.is_some_and(|command| command.flags & command_flag::ON_PLAN == 0) {
                checker.obey(config, step.setpoint.k);
            }
        }
        if step.kind == StepKind::Measured {
            // Nobody commanded that.
            checker.hold(config, &step.setpoint);
            if let Some(controllers) = controllers.as_mut() {
                *told = controllers.hold(&step.setpoint);
            }
        } else {
            checker.step(config, report, &step.setpoint, mode);
        }
        match controllers.as_mut() {
            None => *told = step.setpoint,
            Some(controllers) => controllers.advance(&step.setpoint, |executed| {
                checker.spline(config, report, executed);
                *told = *executed;
            }),
        }
        moved = true;
    });
    *withheld = out.withheld;
    if moved && !out.withheld {
        // Trajectory controllers know their points and no stop.
        let plan = if controllers.is_none() { &follower.motion.plan } else { &StopPlan::ZERO };
        *port_fault = !port.write(now, told, plan);
    }
    if follower.latched && !was_latched {
        let sound = measured.drives.are_sound();
        first_latch.get_or_insert(latch_cause(port_refused, unheard, sound, out.suspended_ticks.is_some()));
    }
    if out.advanced > 0 {
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
        suspended_ticks: out.suspended_ticks,
        faults: out.faults,
    }
}

/// Why the driver latched, in words.
fn latch_cause(port_refused: bool, unheard: bool, sound: bool, suspended: bool) -> &'static str {
    if port_refused {
        "the robot refused a setpoint"
    } else if unheard {
        "nothing was heard of the robot"
    } else if !sound {
        "a drive was not sound, or had no power"
    } else if suspended {
        "the driver stood still for too long, or found no measurement to believe"
    } else {
        "no command came"
    }
}
