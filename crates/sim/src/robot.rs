//! The simulated robot as a process sees it: it takes a command and returns the robot's state.

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
    /// `None` if the robot takes every setpoint.
    controllers: Option<Controllers>,
    checker: Checker,
    report: Report,
    sequence: u64,
    port_fault: bool,
    /// The last setpoint was not handed to the robot, because the robot's answer is awaited.
    withheld: bool,
    measured: Measured,
    /// The last setpoint of the joints.
    told: Setpoint,
    /// The reason why the driver latched first. `None` if it never did.
    first_latch: Option<&'static str>,
}

impl DriverState {
    /// Creates a driver that starts at index `k` on a robot that measures `measured` now and measured `earlier`
    /// before. Returns `None` if one of their numbers is not finite. `seed` is the seed of the controllers'
    /// delays.
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

    /// Returns the report on the commands of the run so far.
    pub fn report(&self) -> &Report {
        &self.report
    }

    /// Returns the reason why the driver latched first, in words. `None` if it never did.
    pub fn first_latch(&self) -> Option<&'static str> {
        self.first_latch
    }

    /// Returns the follower.
    pub fn follower(&self) -> &driver::State {
        &self.follower
    }

    /// Returns the delays of torso, head, left arm and right arm, s, if they have controllers of their own.
    pub fn delays_s(&self) -> Option<[f64; CONTROLLERS]> {
        self.controllers.as_ref().map(Controllers::delays_s)
    }

    /// Returns true if the driver and all controllers are at rest.
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
    /// Creates a robot at rest in the initial posture at index `k`. It holds the encoders' readings. `seed` is
    /// the seed of the noise.
    pub fn new(config: &Config, k: u64, seed: u64) -> Self {
        Self::standing(config, k, &config.initial, seed)
            .expect("the initial posture was checked, and the noise is finite")
    }

    /// Creates a driver that starts at index `k` on a robot that stands at `q`, wherever that is. Returns `None`
    /// if a number of `q` or of the measurement is not finite.
    pub fn standing(config: &Config, k: u64, q: &[f64; JOINTS], seed: u64) -> Option<Self> {
        if q.iter().any(|q| !q.is_finite()) {
            return None;
        }
        let mut body = Body::new(config, deadline(k), q, seed);
        let measured = Port { config, body: &mut body }.read(deadline(k));
        Some(Self { driver: DriverState::new(config, k, &measured, &measured, seed)?, body })
    }

    /// Replaces the driver by one that starts at index `k` on the robot as it is. Returns false and changes
    /// nothing if the measurement is no valid posture.
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

    /// Returns the report on the commands of the run so far.
    pub fn report(&self) -> &Report {
        self.driver.report()
    }

    /// Returns the judge's report on the joints' true motion so far.
    pub fn judged(&self) -> &plant::Report {
        self.body.judged()
    }

    /// Returns the driver's follower.
    pub fn follower(&self) -> &driver::State {
        self.driver.follower()
    }

    /// Returns the true positions of the joints, rad or m.
    pub fn q(&self) -> &[f64; JOINTS] {
        &self.body.truth().q
    }

    /// Returns the true motion of the joints.
    pub fn truth(&self) -> &plant::Truth {
        self.body.truth()
    }

    /// Returns the last setpoint of the joints: the driver's setpoint, or the controllers' spline of it.
    pub fn told(&self) -> &Setpoint {
        &self.driver.told
    }

    /// Returns true if the robot refused the last setpoint.
    pub fn refused(&self) -> bool {
        self.driver.port_fault
    }

    /// Returns the delays of torso, head, left arm and right arm, s, if they have controllers of their own.
    pub fn delays_s(&self) -> Option<[f64; CONTROLLERS]> {
        self.driver.delays_s()
    }

    /// Returns true if the driver and all controllers are at rest.
    pub fn at_rest(&self) -> bool {
        self.driver.at_rest()
    }

    /// Lets the robot go on by itself until `now`, while its driver does not run.
    pub fn advance(&mut self, config: &Config, now: Stamp) {
        self.body.advance(config, now);
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

/// Input of a tick.
#[derive(Clone, Copy, Debug)]
pub struct Input<'a> {
    /// The last index whose deadline and grace are not after now.
    pub due_k: u64,
    /// The newest command. A command that was given before is ignored.
    pub command: Option<&'a JointCommand>,
}

/// Result of a tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Output {
    /// The state to be published. In its header, sequence, stamp and origin are filled.
    pub state: RobotState,
    /// Number of indices by which the executed state is newer than before. Zero if nothing was due.
    pub advanced: u64,
    /// The command that was accepted in this tick, and its latencies.
    pub accepted: Option<Accepted>,
    /// The reason why the command of this tick was refused.
    pub refused: Option<Refusal>,
    /// Number of ticks for which the driver was suspended while the robot moved.
    pub suspended_ticks: Option<u64>,
    /// `DriverFault` while latched.
    pub faults: Faults,
}

/// Moves the body on to `now`, executes up to the due index, and checks every step.
pub fn tick(config: &Config, state: &mut State, now: Stamp, input: Input<'_>) -> Output {
    let State { driver, body } = state;
    drive(config, driver, now, input, &mut Port { config, body })
}

/// Runs the driver's side of [`tick`] with any robot.
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
            // No command asked for this motion.
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
        // Trajectory controllers take points but no stop.
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

/// Returns the reason why the driver latched, in words.
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
