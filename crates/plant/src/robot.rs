//! The simulated robot: joints, grippers and a judge. [`Port`] puts it behind the driver's port, in the driver's own thread
//! and with virtual time. The process `teleopd robot` moves the same robot by its own clock.

use crate::config::Config;
use crate::gripper::Grippers;
use crate::injection::Injection;
use crate::judge::Judge;
use crate::plant::{self, Plant, STEP_NS, Truth};
use crate::report::Report;
use driver::{Driver, Measured, Setpoint};
use messages::{GripperMotion, GripperState, JOINTS_MAX, Stamp, StopPlan};

/// Largest number of calls that bring a robot up to the present, of a second each.
const CATCH_UP_MAX: usize = 10;

/// The joints, the judge of their true motion, and the grippers.
#[derive(Clone, Debug)]
pub struct Robot {
    plant: Plant,
    judge: Judge,
    grippers: Grippers,
}

impl Robot {
    /// Creates a robot at rest at `q` at the time `now`. `seed` is the seed of the noise.
    pub fn new(config: &Config, now: Stamp, q: &[f64; JOINTS_MAX], seed: u64) -> Self {
        let mut plant = Plant::new(config, now, q, seed);
        let judge = Judge::new(config, q);
        let _ = plant.measure(config, now);
        Self { plant, judge, grippers: Grippers::new(now) }
    }

    /// Returns the true motion of the joints.
    pub fn truth(&self) -> &Truth {
        self.plant.truth()
    }

    /// Returns the judge's report.
    pub fn judged(&self) -> &Report {
        self.judge.report()
    }

    /// Moves on to `now`, with at most `CATCH_UP_MAX` calls of the plant. A robot that was not simulated for a
    /// longer time goes on in the next call.
    pub fn advance(&mut self, config: &Config, now: Stamp) {
        for _ in 0..CATCH_UP_MAX {
            self.plant.advance_judged(config, now, &mut self.judge);
            if self.plant.behind_ns(now) < STEP_NS {
                break;
            }
        }
    }

    /// Takes a setpoint at `now`. See [`Plant::receive`].
    pub fn receive(&mut self, config: &Config, now: Stamp, setpoint: &plant::Setpoint) -> bool {
        self.plant.receive_judged(config, now, setpoint, &mut self.judge)
    }

    /// Returns the newest sample at `now`.
    pub fn measure(&mut self, config: &Config, now: Stamp) -> plant::Measured {
        self.advance(config, now);
        self.plant.measure(config, now)
    }

    /// Takes the motion of the grippers.
    pub fn grip(&mut self, grippers: &GripperMotion) {
        self.grippers.receive(grippers);
    }

    /// Returns the grippers at `now`.
    pub fn gripped(&mut self, config: &Config, now: Stamp) -> GripperState {
        self.grippers.measure(&config.options.grippers, config.options.object_width_m, now)
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

/// The robot behind the driver's port.
pub struct Port<'a> {
    config: &'a Config,
    robot: &'a mut Robot,
    /// The grippers as last measured.
    gripped: Option<GripperState>,
}

impl<'a> Port<'a> {
    /// The port of `robot`.
    pub const fn new(config: &'a Config, robot: &'a mut Robot) -> Self {
        Self { config, robot, gripped: None }
    }
}

impl Driver for Port<'_> {
    fn read(&mut self, now: Stamp) -> Measured {
        self.gripped = Some(self.robot.gripped(self.config, now));
        let plant::Measured { stamp, q, dq, drives, .. } = self.robot.measure(self.config, now);
        Measured { stamp, q, dq, drives, unanswered: false, refused: false }
    }

    fn write(&mut self, now: Stamp, setpoint: &Setpoint, plan: &StopPlan) -> bool {
        let &Setpoint { k, q, v, a } = setpoint;
        self.robot.receive(self.config, now, &plant::Setpoint { k, q, v, a, plan: *plan })
    }

    fn grip(&mut self, grippers: &GripperMotion) {
        self.robot.grip(grippers);
    }

    fn gripped(&self) -> Option<GripperState> {
        self.gripped
    }
}
