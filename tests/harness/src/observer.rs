//! Reads what the driver executes, for a test.

use crate::wait_until;
use bus::{Domain, Reader};
use instance::Instance;
use messages::{RobotState, Service};

/// Observes the driver's executed states.
pub struct StateObserver {
    states: Reader<RobotState>,
    latest: Option<RobotState>,
    _domain: Domain,
}

impl StateObserver {
    /// Observes an instance.
    pub fn open(instance: &Instance) -> Self {
        let domain = Domain::open(instance.core_domain(), "observer").expect("the core domain");
        let states = domain.reader(Service::RobotState).expect("robot states");
        Self { states, latest: None, _domain: domain }
    }

    /// Returns the newest state.
    pub fn robot(&mut self) -> Option<RobotState> {
        self.latest = self.states.latest().or(self.latest);
        self.latest
    }

    /// Waits for a state for which `done` returns true.
    pub fn wait(&mut self, what: &str, done: impl Fn(&RobotState) -> bool) -> RobotState {
        wait_until(what, || self.robot().is_some_and(|state| done(&state)));
        self.latest.expect("the state that was waited for")
    }

    /// Waits until a joint is fast, rad/s or m/s.
    pub fn wait_moving(&mut self) -> RobotState {
        self.wait("moving", |state| state.v.iter().any(|v| v.abs() > 0.2))
    }

    /// Waits until a joint is more than `by`, rad or m, from its old position.
    pub fn wait_moved(&mut self, before: &RobotState, by: f64) -> RobotState {
        self.wait("moving with the person", |state| state.q.iter().zip(&before.q).any(|(q, was)| (q - was).abs() > by))
    }

    /// Waits until the robot is at rest, by the plan.
    pub fn wait_at_rest(&mut self) -> RobotState {
        self.wait("at rest", |state| state.v.iter().chain(&state.a).all(|value| *value == 0.0))
    }
}
