//! Tampering with messages between their writer and their link, in a simulation.

use messages::{JointCommand, JointTarget, RobotState, Skeleton};

/// Alters messages when they are published. A method that returns false drops the message.
pub trait Tamper {
    /// Ingest to retarget.
    fn skeleton(&mut self, _skeleton: &mut Skeleton) -> bool {
        true
    }

    /// Retarget to control.
    fn target(&mut self, _target: &mut JointTarget) -> bool {
        true
    }

    /// Control to driver.
    fn command(&mut self, _command: &mut JointCommand) -> bool {
        true
    }

    /// Driver to control.
    fn state(&mut self, _state: &mut RobotState) -> bool {
        true
    }
}

/// Leaves every message unchanged.
#[derive(Clone, Copy, Debug, Default)]
pub struct Untampered;

impl Tamper for Untampered {}
