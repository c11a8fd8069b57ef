//! The simulated robot as a process sees it: it takes a command and returns the robot's state.

use crate::body::{Body, Port};
use crate::checker::Checker;
use crate::config::Config;
use crate::interface::{Controllers, Interface};
use crate::report::Report;
use driver::{Drive, Driver, Measured, Observer, Setpoint, Step, StepKind};
use messages::{JOINTS_MAX, JointCommand, Layout, Stamp, StopPlan, command_flag, deadline};
use plant::Injection;

pub use driver::{DriveInput as Input, DriveOutput as Output};

/// A driver, the checker of its steps, and the interface between it and the robot's body.
#[derive(Clone, Debug)]
pub struct DriverState {
    drive: Drive,
    checks: Checks,
}

/// The checker's side of a driver, and the simulated interface.
#[derive(Clone, Debug)]
struct Checks {
    /// Absent where the robot takes every setpoint.
    controllers: Option<Controllers>,
    checker: Checker,
    report: Report,
    /// The setpoint that the joints were sent last.
    sent: Setpoint,
    /// The newest measured positions before the tick, rad or m.
    measured: [f64; JOINTS_MAX],
    /// `Mode` of the command that is executed, as its number.
    mode: u32,
}

impl DriverState {
    /// A driver that starts at index `k`. The robot measured `earlier`, and measures `measured` now. Returns `None` if a
    /// number of it is not finite. `seed` is that of the controllers' delays.
    pub fn new(config: &Config, k: u64, earlier: &Measured, measured: &Measured, seed: u64) -> Option<Self> {
        let drive = Drive::new(&config.follower, k, earlier, measured)?;
        let held = drive.follower().setpoint();
        let restarts = config.interface == Interface::Jtc100Restart;
        let controllers = config.interface.has_controllers();
        let controllers = controllers.then(|| Controllers::new(config.plant.body(), &held, seed, restarts));
        let checker = Checker::new(config, held);
        let report = Report::default();
        let measured = measured.q;
        Some(Self { drive, checks: Checks { controllers, checker, report, sent: held, measured, mode: 0 } })
    }

    /// The checker's report of the run so far.
    pub fn report(&self) -> &Report {
        &self.checks.report
    }

    /// The reason why the driver latched first, in words. `None` if it never did.
    pub fn first_latch(&self) -> Option<&'static str> {
        self.drive.first_latch()
    }

    /// Returns the newest measurement of the robot.
    pub fn measured(&self) -> &Measured {
        self.drive.measured()
    }

    /// Returns the follower.
    pub fn follower(&self) -> &driver::State {
        self.drive.follower()
    }

    /// Returns the delay of each controller, s, if the robot has controllers.
    pub fn delays_s(&self) -> Option<Vec<f64>> {
        self.checks.controllers.as_ref().map(Controllers::delays_s)
    }

    /// Returns true if the driver and all controllers are at rest.
    pub fn at_rest(&self) -> bool {
        self.follower().motion.is_at_rest() && self.checks.controllers.as_ref().is_none_or(Controllers::at_rest)
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
    pub fn standing(config: &Config, k: u64, q: &[f64; JOINTS_MAX], seed: u64) -> Option<Self> {
        if q.iter().any(|q| !q.is_finite()) {
            return None;
        }
        let mut body = Body::new(config, deadline(k), q, seed);
        let measured = Port::new(config, &mut body).read(deadline(k));
        Some(Self { driver: DriverState::new(config, k, &measured, &measured, seed)?, body })
    }

    /// Replaces the driver by one that starts at index `k` on the robot as it is. Returns false and changes
    /// nothing if the measurement is no valid posture.
    pub fn restart_driver(&mut self, config: &Config, k: u64, now: Stamp, seed: u64) -> bool {
        let measured = Port::new(config, &mut self.body).read(now);
        let restarted = DriverState::new(config, k, self.driver.drive.measured(), &measured, seed);
        let found = restarted.is_some();
        if let Some(mut restarted) = restarted {
            restarted.checks.report = self.driver.report().clone();
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
    pub fn q(&self) -> &[f64; JOINTS_MAX] {
        &self.body.truth().q
    }

    /// Returns the true motion of the joints.
    pub fn truth(&self) -> &plant::Truth {
        self.body.truth()
    }

    /// Returns the last setpoint of the joints: the driver's setpoint, or the controllers' spline of it.
    pub fn told(&self) -> &Setpoint {
        &self.driver.checks.sent
    }

    /// Returns true if the robot refused the last setpoint.
    pub fn refused(&self) -> bool {
        self.driver.drive.refused()
    }

    /// Returns the delay of each controller, s, if the robot has controllers.
    pub fn delays_s(&self) -> Option<Vec<f64>> {
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

    /// Returns the robot's measurement at `now`, as a driver that is about to start reads it.
    pub fn measure(&mut self, config: &Config, now: Stamp) -> Measured {
        Port::new(config, &mut self.body).read(now)
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

/// Moves the body on to `now`, executes up to the index that is due, and checks every step.
///
/// ```
/// # let read = |kind| std::fs::read_to_string(format!("../../config/robots/tiago_dual.{kind}"));
/// # let model = robot::Model::from_text("tiago_dual.toml", &read("toml")?, "tiago_dual.urdf", &read("urdf")?)?;
/// use sim::{Config, Input, Options, State, tick};
///
/// let config = Config::new(&model, &Options::default())?;
/// let mut state = State::new(&config, 1000, 1);
/// for k in 1001..1100 {
///     tick(&config, &mut state, messages::deadline(k), Input { due_k: k, command: None });
/// }
/// assert!(state.at_rest()); // Nobody commands it.
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn tick(config: &Config, state: &mut State, now: Stamp, input: Input<'_>) -> Output {
    let State { driver, body } = state;
    drive(config, driver, now, input, &mut Port::new(config, body))
}

/// The driver's side of [`tick`], in front of any robot.
pub fn drive(config: &Config, state: &mut DriverState, now: Stamp, input: Input<'_>, port: &mut impl Driver) -> Output {
    let DriverState { drive, checks } = state;
    (checks.mode, checks.measured) = (drive.follower().mode, drive.measured().q);
    driver::drive(&config.follower, drive, now, input, port, &mut Watching { config, checks })
}

/// The checker while the driver's tick runs.
struct Watching<'a> {
    config: &'a Config,
    checks: &'a mut Checks,
}

impl Observer for Watching<'_> {
    fn step(&mut self, step: &Step, command: Option<&JointCommand>) {
        let Self { config, checks: Checks { controllers, checker, report, sent, measured, mode } } = self;
        if step.kind == StepKind::Command {
            *mode = command.map_or(*mode, |command| command.mode);
            if command.is_some_and(|command| command.flags & command_flag::ON_PLAN == 0) {
                checker.obey(config, step.setpoint.k);
            }
        }
        if step.kind == StepKind::Measured {
            // No command asked for it.
            checker.hold(config, &step.setpoint);
            if let Some(controllers) = controllers.as_mut() {
                *sent = controllers.hold(&step.setpoint);
            }
        } else {
            checker.step(config, report, &step.setpoint, *mode);
        }
        match controllers.as_mut() {
            None => *sent = step.setpoint,
            Some(controllers) => controllers.advance(&step.setpoint, measured, |executed| {
                checker.spline(config, report, executed);
                *sent = *executed;
            }),
        }
    }

    /// Trajectory controllers know their points and no stop.
    fn sent<'a>(&'a self, _: &'a Setpoint, plan: &'a StopPlan) -> (&'a Setpoint, &'a StopPlan) {
        (&self.checks.sent, if self.checks.controllers.is_none() { plan } else { &StopPlan::ZERO })
    }
}
