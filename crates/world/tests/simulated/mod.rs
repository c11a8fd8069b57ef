//! A simulated robot on a bench, and valid commands to it.

mod body;
mod checks;
mod jtc100;

use crate::support::shipped;
use checker::{Checker, Report};
use driver::{DriveInput, DriveOutput, Interface, Setpoint};
use messages::{Header, JointCommand, Layout, Mode, TICK_S, deadline};
use robot::Model;
use std::sync::LazyLock;
use world::simulated::{Config, Options, State, tick};

/// The index at which every bench begins.
pub(crate) const K: u64 = 1000;

/// The shipped robot.
pub(crate) static MODEL: LazyLock<Model> =
    LazyLock::new(|| config::load_model(&shipped("robots/tiago_dual.toml")).expect("the shipped robot").0);

/// Encoders without noise and step, and servos without delay.
pub(crate) fn ideal() -> Options {
    Options { robot: plant::Options { delay_ns: 0, ..exact() }, ..Options::default() }
}

/// Encoders without noise and step.
pub(crate) fn exact() -> plant::Options {
    plant::Options { encoder_noise_rad: 0.0, encoder_step_rad: 0.0, ..plant::Options::default() }
}

/// A driver of a robot with this interface.
pub(crate) fn behind(interface: Interface) -> checker::Options {
    checker::Options { interface, ..checker::Options::default() }
}

/// A stream of commands to a simulated robot, made of constant jerks of one joint.
pub(crate) struct Bench {
    pub(crate) config: Config,
    pub(crate) state: State,
    pub(crate) command: JointCommand,
}

impl Bench {
    pub(crate) fn new(options: &Options, seed: u64) -> Self {
        let config = Config::new(&MODEL, options).unwrap_or_else(|error| panic!("{error}"));
        let state = State::new(&config, K, seed);
        let mut command = JointCommand { robot: MODEL.id(), k: K, seed_k: K, ..JointCommand::ZERO };
        command.header = Header { incarnation: 1, ..Header::ZERO };
        command.q = state.follower().motion.q;
        command.mode = Mode::Engaged as u32;
        Self { config, state, command }
    }

    /// Creates a bench with encoders without noise and step, and servos without delay.
    pub(crate) fn ideal() -> Self {
        Self::new(&ideal(), 1)
    }

    /// Returns the next command: `joint` moves with this jerk for one tick. Its plan is the stop from there.
    pub(crate) fn next(&mut self, joint: usize, jerk: f64) -> JointCommand {
        let c = &mut self.command;
        (c.k, c.header.sequence) = (c.k + 1, c.header.sequence + 1);
        let (v, a) = (c.v[joint], c.a[joint]);
        c.q[joint] += TICK_S * (v + TICK_S * (a / 2.0 + TICK_S * jerk / 6.0));
        c.v[joint] += TICK_S * (a + TICK_S * jerk / 2.0);
        c.a[joint] += TICK_S * jerk;
        self.stop(joint);
        self.command
    }

    /// Gives the command a stop: the acceleration to zero in 30 ms, then the velocity in two phases of 300 ms.
    pub(crate) fn stop(&mut self, joint: usize) {
        let (v, a, d1, d) = (self.command.v[joint], self.command.a[joint], 0.03, 0.3);
        let v1 = v + a * d1 / 2.0;
        self.command.plan.jerk[joint] = [-a / d1, -v1 / (d * d), v1 / (d * d)];
        self.command.plan.duration_s[joint] = [d1, d, d];
    }

    /// Runs the tick in which the command of index `k` is due.
    pub(crate) fn tick(&mut self, k: u64, command: Option<&JointCommand>) -> DriveOutput {
        tick(&self.config, &mut self.state, deadline(k), DriveInput { due_k: k, command })
    }

    /// Sends a command with this jerk for each of `ticks` ticks.
    pub(crate) fn drive(&mut self, joint: usize, jerk: f64, ticks: u64) -> DriveOutput {
        let mut out = None;
        for _ in 0..ticks {
            let command = self.next(joint, jerk);
            let tick = self.tick(command.k, Some(&command));
            assert_eq!(tick.refused, None);
            out = Some(tick);
        }
        out.expect("at least one tick")
    }

    /// Returns the names of the kinds of violation that occurred.
    pub(crate) fn violated(&self) -> Vec<&'static str> {
        self.state.report().violations().iter().filter(|(_, count)| *count > 0).map(|(name, _)| *name).collect()
    }
}

/// The checker alone. It sees setpoints that no driver would take.
pub(crate) struct Judge {
    pub(crate) bench: Bench,
    pub(crate) report: Report,
    checker: Checker,
}

impl Judge {
    pub(crate) fn new(options: &Options) -> Self {
        let bench = Bench::new(options, 1);
        let checker = Checker::new(bench.config.driver(), bench.state.follower().setpoint());
        Self { report: Report::default(), checker, bench }
    }

    pub(crate) fn ideal() -> Self {
        Self::new(&ideal())
    }

    /// Shows the checker a motion of this jerk for each of `ticks` ticks.
    pub(crate) fn drive(&mut self, joint: usize, jerk: f64, ticks: u64) {
        for _ in 0..ticks {
            self.bench.next(joint, jerk);
            self.show();
        }
    }

    /// Shows the checker the command as it is.
    pub(crate) fn show(&mut self) {
        let JointCommand { k, q, v, a, mode, .. } = self.bench.command;
        self.checker.step(self.bench.config.driver(), &mut self.report, &Setpoint { k, q, v, a }, mode);
    }

    /// Returns the names of the kinds of violation that occurred.
    pub(crate) fn violated(&self) -> Vec<&'static str> {
        self.report.violations().iter().filter(|(_, count)| *count > 0).map(|(name, _)| *name).collect()
    }
}
