//! Reads what the driver executes, for a test.

use crate::SOON;
use bus::{Domain, Reader};
use instance::Instance;
use messages::{RobotState, Service};
use std::time::{Duration, Instant};

/// Observes the driver's executed states.
pub struct StateObserver {
    states: Reader<RobotState>,
    latest: Option<RobotState>,
    _domain: Domain,
}

impl StateObserver {
    /// Observes an instance.
    pub fn of(instance: &Instance) -> Self {
        let domain = Domain::open(instance.core_domain(), "eyes").expect("the core domain");
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
        let give_up = Instant::now() + SOON;
        loop {
            if let Some(state) = self.robot().filter(&done) {
                return state;
            }
            assert!(Instant::now() < give_up, "the robot never was {what}");
            std::thread::sleep(Duration::from_millis(2));
        }
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
