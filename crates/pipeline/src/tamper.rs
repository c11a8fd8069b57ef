//! What may befall a message between its writer and its link, in a simulation.

use messages::{JointCommand, JointTarget, RobotState, Skeleton};

/// Alters messages as they are published, or, answering false, keeps them back.
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

/// Leaves every message as it is.
#[derive(Clone, Copy, Debug, Default)]
pub struct Untampered;

impl Tamper for Untampered {}
