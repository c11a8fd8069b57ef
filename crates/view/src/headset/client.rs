//! A page whose headset leads the robot: it publishes the person, and its press holds the enable.

use super::Headset;
use crate::operator_worker::{OperatorCommand, OperatorWorker};
use crate::webcam::{CameraReport, CameraRequest, Webcam};
use instance::Instance;

/// The headset of a page. Dropping it ends the person.
pub struct HeadsetClient {
    publisher: Webcam,
    state: Headset,
    /// True while the page is the client. Only then its press counts.
    leads: bool,
}

impl HeadsetClient {
    pub fn new(instance: &Instance) -> std::io::Result<Self> {
        Ok(Self { publisher: Webcam::headset(instance)?, state: Headset::default(), leads: false })
    }

    /// Starts or ends the person. Either one releases a press.
    pub fn turn(&mut self, on: bool, operator: &OperatorWorker) {
        self.release(operator);
        self.state.reset();
        self.leads = false;
        self.publisher.ask(if on { CameraRequest::Start(0) } else { CameraRequest::Stop });
    }

    /// Takes a message. Each one repeats a held press, so the press ends with the messages.
    pub fn see(&mut self, bytes: &[u8], operator: &OperatorWorker) {
        let now = rt::now();
        let before = self.state.is_held();
        let sight = self.state.step(bytes, now);
        match (before, self.state.is_held()) {
            (false, true) if self.leads => operator.ask(OperatorCommand::Engage { left_out: None }),
            (false, true) => drop(self.state.lose_press()),
            (true, true) if !self.state.repeats_press() => {}
            (true, true) => operator.ask(OperatorCommand::Keep),
            (true, false) => operator.ask(OperatorCommand::Release),
            (false, false) => {}
        }
        self.publisher.ask(CameraRequest::Image(now, sight));
    }

    /// Returns the next report of the publisher. A person that ended releases the press.
    pub fn answer(&mut self, operator: &OperatorWorker) -> Option<CameraReport> {
        let report = self.publisher.answer()?;
        self.leads = report.on;
        if !report.on {
            self.release(operator);
        }
        Some(report)
    }

    /// Returns true if the headset holds the enable. Then only its messages repeat the press.
    pub fn is_held(&self) -> bool {
        self.state.is_held()
    }

    /// Notes that the enable is not held. The hand must open before it can press again. A press that is on its way at that
    /// moment is taken back, so that the hand does not let go of nothing.
    pub fn release(&mut self, operator: &OperatorWorker) {
        if self.state.lose_press() {
            operator.ask(OperatorCommand::Release);
        }
    }
}
