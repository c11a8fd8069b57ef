//! The driver's tick, with the checker of its steps and the controllers between it and the robot.

use crate::checker::Checker;
use crate::config::Config;
use crate::controllers::Controllers;
use crate::report::Report;
use driver::{Drive, DriveInput, DriveOutput, Driver, Measured, Observer, Setpoint, Step, StepKind};
use messages::{JOINTS_MAX, JointCommand, Layout, Stamp, StopPlan, command_flag};

/// A driver, the checker of its steps, and the controllers between it and the robot.
#[derive(Clone, Debug)]
pub struct State {
    drive: Drive,
    checks: Checks,
}

/// The checker's side of a driver, and the simulated controllers.
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

impl State {
    /// A driver that starts at index `k`. The robot measured `earlier`, and measures `measured` now. Returns `None` if a
    /// number of it is not finite. `seed` is that of the controllers' delays.
    pub fn new(config: &Config, k: u64, earlier: &Measured, measured: &Measured, seed: u64) -> Option<Self> {
        let drive = Drive::new(&config.follower, k, earlier, measured)?;
        let held = drive.follower().setpoint();
        let controllers = Controllers::new(config.interface, config.links.body(), &held, seed);
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

    /// Returns the last setpoint that the joints were sent: the driver's setpoint, or the controllers' spline of it.
    pub const fn sent(&self) -> &Setpoint {
        &self.checks.sent
    }

    /// Returns true if the robot refused the last setpoint.
    pub const fn refused(&self) -> bool {
        self.drive.refused()
    }

    /// Returns a driver that takes this one's place at index `k`, on the robot that measures `measured` now. It keeps the
    /// report. Returns `None` if a measured number is not finite.
    pub fn restarted(&self, config: &Config, k: u64, measured: &Measured, seed: u64) -> Option<Self> {
        let mut restarted = Self::new(config, k, self.measured(), measured, seed)?;
        restarted.checks.report = self.checks.report.clone();
        Some(restarted)
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

/// Reads the robot, executes up to the index that is due, checks every step, and writes the setpoint. See [`driver::drive`].
pub fn drive(
    config: &Config,
    state: &mut State,
    now: Stamp,
    input: DriveInput<'_>,
    port: &mut impl Driver,
) -> DriveOutput {
    let State { drive, checks } = state;
    (checks.mode, checks.measured) = (drive.follower().mode, drive.measured().q);
    driver::drive(&config.follower, drive, now, input, port, &mut CheckingObserver { config, checks })
}

/// The checker while the driver's tick runs.
struct CheckingObserver<'a> {
    config: &'a Config,
    checks: &'a mut Checks,
}

impl Observer for CheckingObserver<'_> {
    fn step(&mut self, step: &Step, command: Option<&JointCommand>) {
        let Self { config, checks: Checks { controllers, checker, report, sent, measured, mode } } = self;
        if step.kind == StepKind::Command {
            *mode = command.map_or(*mode, |command| command.mode);
            if command.is_some_and(|command| command.flags & command_flag::ON_PLAN == 0) {
                checker.accept(config, step.setpoint.k);
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
