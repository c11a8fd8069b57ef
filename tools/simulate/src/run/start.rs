//! Restarts processes, and judges the start of a driver.

use super::{OperatorModel, ProcessId, Run, UNDRIVEN, Violation};
use crate::processes::Started;

/// Largest true speed of a robot on which a driver starts, rad/s or m/s. It stays within 0.4 mrad for 100 ms, which at
/// 20 Hz is 0.05 rad/s.
const STANDS: f64 = 0.06;

impl Run<'_> {
    pub(super) fn start(&mut self, started: Started) -> Result<(), Violation> {
        if started[ProcessId::Ingest as usize] {
            self.world.restart_ingest();
        }
        if started[ProcessId::Retarget as usize] {
            self.world.restart_retarget();
        }
        if started[ProcessId::Control as usize] {
            self.world.restart_control(&self.subject.config);
            // The operator connects again.
            self.hand = OperatorModel::new();
            self.remote.iter_mut().for_each(|remote| remote.reconnect());
        }
        if started[ProcessId::Driver as usize] {
            self.check_that_robot_stands(self.k)?;
            let to = self.processes.moved_to.take();
            let seed = self.seed ^ self.k;
            if !self.world.restart_driver(&self.subject.config, to.as_ref(), seed) {
                self.world.restart_driver(&self.subject.config, Some(&self.subject.model().home), seed);
            }
            self.injected.clear();
            self.change_robot();
            // The driver holds the measured posture until the joints are at rest.
            self.undriven_until = self.undriven_until.max(self.k + UNDRIVEN);
        }
        Ok(())
    }

    /// A driver that waited for less than a second starts on a robot that truly stands, if its encoders say where it is.
    fn check_that_robot_stands(&mut self, k: u64) -> Result<(), Violation> {
        if self.processes.gave_up_waiting() || self.processes.moved_to.is_some() || self.encoders_lie() {
            return Ok(());
        }
        let truth = self.world.robot_mut().truth().v;
        let Some(j) = truth.iter().position(|v| v.abs() > STANDS) else { return Ok(()) };
        let detail = format!("joint {j} moves at {}", truth[j]);
        Err(Violation { tick: k, invariant: "driver starts", detail })
    }
}
