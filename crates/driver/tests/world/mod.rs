//! Two processes, two slots of shared memory and one clock of quarter ticks. Anything may be late.

mod control;
mod oracle;

use crate::bench::measured;
pub(crate) use control::Control;
use driver::{Config, Input, JointLimits, Measured, State, StepKind, tick_each};
use messages::{Header, JOINTS_MAX, JointCommand, Layout, RobotId, RobotState, Stamp, TICK_HZ, deadline};
use oracle::Oracle;

/// Quarters of a tick after its deadline at which a command is due.
const GRACE_QUARTERS: u64 = 2;
/// The index at which every run begins.
pub(crate) const FIRST_K: u64 = 1000;
/// Largest joint speed, rad/s. The motions of `Control` stay below it.
pub(crate) const V_MAX: f64 = 3.0;

/// Limits that every motion and plan of `Control` keeps. Its commands have up to 1e4 rad/s^3, its plans up to v / d^2.
const LIMITS: JointLimits = JointLimits { q_min: -100.0, q_max: 100.0, v_max: V_MAX, a_max: 1e3, j_max: 2e5 };

/// Events of one tick.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Moment {
    /// The quarter in which `control` wakes, or never.
    pub(crate) control: Option<u64>,
    /// The quarters in which the driver wakes, as bits.
    pub(crate) driver: u8,
    /// Quarters that a command takes to arrive.
    pub(crate) command_delay: u64,
    /// Quarters that an echo takes to arrive.
    pub(crate) echo_delay: u64,
}

impl Moment {
    /// All processes and messages on time.
    pub(crate) const CALM: Self = Self { control: Some(0), driver: 0b1111, command_delay: 0, echo_delay: 0 };
}

/// Result of a tick.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Tally {
    pub(crate) commands: u64,
    pub(crate) plan_ticks: u64,
    pub(crate) refused: u64,
    pub(crate) suspensions: u64,
}

#[derive(Clone)]
pub(crate) struct World {
    pub(crate) config: Config,
    pub(crate) control: Control,
    pub(crate) follower: State,
    pub(crate) tally: Tally,
    pub(crate) oracle: Oracle,
    quarter: u64,
    commands: Slot<JointCommand>,
    echoes: Slot<RobotState>,
}

/// A slot of shared memory: holds the newest of what has arrived.
#[derive(Clone)]
struct Slot<T> {
    under_way: Vec<(u64, T)>,
    held: Option<T>,
}

impl<T: Copy> Slot<T> {
    fn new() -> Self {
        Self { under_way: Vec::with_capacity(16), held: None }
    }

    fn read(&mut self, quarter: u64) -> Option<T> {
        // A message that was sent later but arrived earlier is overwritten by the last arrival: reordering.
        while let Some(next) = (0..self.under_way.len())
            .filter(|&i| self.under_way[i].0 <= quarter)
            .min_by_key(|&i| (self.under_way[i].0, i))
        {
            self.held = Some(self.under_way.remove(next).1);
        }
        self.held
    }
}

impl World {
    /// Creates a driver that has held a posture for a while, and a `control` that has just started.
    pub(crate) fn new(seed: u64) -> Self {
        let follower = State::hold(FIRST_K, &[0.1; JOINTS_MAX]).expect("finite");
        Self {
            config: Config::new(RobotId::ZERO, [LIMITS; JOINTS_MAX]),
            control: Control::new(seed, 1),
            oracle: Oracle::new(&follower),
            follower,
            tally: Tally::default(),
            quarter: 4 * (FIRST_K + 1),
            commands: Slot::new(),
            echoes: Slot::new(),
        }
    }

    /// Runs the next tick.
    pub(crate) fn run(&mut self, moment: &Moment) -> Tally {
        self.tally = Tally::default();
        for quarter in 0..4 {
            if moment.control == Some(quarter) {
                let echo = self.echoes.read(self.quarter);
                if let Some(command) = self.control.tick(self.quarter / 4, echo.as_ref()) {
                    self.commands.under_way.push((self.quarter + moment.command_delay, command));
                }
            }
            if moment.driver & (1 << quarter) != 0 {
                self.drive(moment.echo_delay);
            }
            self.quarter += 1;
        }
        self.tally
    }

    fn drive(&mut self, echo_delay: u64) {
        let now = Stamp(deadline(self.quarter / 4).0 + (self.quarter % 4) * 1_000_000_000 / TICK_HZ / 4 + 1);
        let command = self.commands.read(self.quarter);
        // The robot stands at the last setpoint of its driver.
        let setpoint = self.follower.setpoint();
        let robot = Measured { stamp: now, q: setpoint.q, ..measured() };
        let input = Input {
            due_k: (self.quarter - GRACE_QUARTERS) / 4,
            command: command.as_ref(),
            port_fault: false,
            measured: Some(&robot),
        };
        let (oracle, control, tally) = (&mut self.oracle, &self.control, &mut self.tally);
        let mut begun_again = false;
        let out = tick_each(&self.config, &mut self.follower, now, input, |step| {
            begun_again |= step.kind == StepKind::Measured;
            oracle.step(control, step, command.as_ref(), tally);
        });
        tally.refused += u64::from(out.refused.is_some());
        tally.suspensions += u64::from(out.suspended_ticks.is_some());
        // A robot that is measured on the plan leaves the records as they are.
        assert!(!begun_again || out.suspended_ticks.is_some());
        if begun_again {
            assert_eq!(out.executed.q, robot.q, "it begins where it is measured");
            self.oracle = Oracle::new(&self.follower);
        }
        assert_eq!(out.executed, self.follower.setpoint());
        assert!(self.follower.index() >= input.due_k, "what is due is executed");
        let measured = Measured { q: out.executed.q, dq: out.executed.v, ..robot };
        let echo = self.follower.echo(&self.config, Header::ZERO, &measured);
        self.echoes.under_way.push((self.quarter + echo_delay, echo));
    }

    /// Replaces the driver by one that has just started and holds the posture of the last one.
    pub(crate) fn restart_driver(&mut self) {
        let q = self.follower.motion.q;
        self.follower = State::hold(self.quarter / 4, &q).expect("finite");
        self.oracle = Oracle::new(&self.follower);
        self.echoes = Slot::new();
    }

    /// Replaces `control` by one that has just started.
    pub(crate) fn restart_control(&mut self) {
        self.control.restart();
    }
}
