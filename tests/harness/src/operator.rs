//! An operator that engages and holds, and says why it could not.

use crate::SOON;
use messages::{Fault, Faults, Mode, Status, Transition};
use operator::OperatorSession;
use rt::{Exit, Failure};
use std::path::PathBuf;
use std::time::Duration;
use wait::within_by;

/// Ticks of control before the enable: half a second with the enable released, and a fresh target.
const TICKS_BEFORE_ENABLE: u64 = 750;
/// Ticks in which an operator's thread has sent all its orders: five heartbeats.
const TICKS_TO_SEND: u64 = 150;
/// Time between two looks at the instance while a change is expected.
const LOOK: Duration = Duration::from_millis(5);
/// Time between two looks at an instance that is held. A look must not disturb what is measured meanwhile.
const HELD_LOOK: Duration = Duration::from_millis(50);
/// Time between two presses of a reset.
const RESET_EVERY: Duration = Duration::from_millis(100);

/// Called at every look at the instance. Its error ends the wait.
pub type Look<'a> = &'a mut dyn FnMut() -> Result<(), Failure>;

/// An operator with heartbeats at 50 Hz.
pub struct Operator {
    session: OperatorSession,
    socket: PathBuf,
}

impl std::ops::Deref for Operator {
    type Target = OperatorSession;

    fn deref(&self) -> &Self::Target {
        &self.session
    }
}

impl Operator {
    /// Connects to an operator socket.
    pub fn connect(socket: PathBuf) -> Result<Self, Failure> {
        Ok(Self { session: OperatorSession::connect(&socket)?, socket })
    }

    /// Returns true if nothing inhibits the enable.
    pub fn is_free(status: &Status) -> bool {
        status.faults == 0 && status.moving == 0 && status.ticks > TICKS_BEFORE_ENABLE
    }

    /// Returns true if the machine paused. Then the driver has latched.
    pub fn is_paused(status: &Status) -> bool {
        status.mode == Mode::Faulted as u32 && status.faults == Faults::NONE.with(Fault::DriverFault).0
    }

    /// Brings the instance from any state to one in which it can be engaged: nothing is latched and nothing blocks it.
    pub fn clear(&mut self, look: Look) -> Result<(), Failure> {
        if self.is_cut_off() {
            self.session = OperatorSession::connect(&self.socket)?;
        }
        let then = self.status().map_or(0, |status| status.ticks);
        self.release();
        let moving =
            |status: &Status| !matches!(Mode::from_u32(status.mode), Some(Mode::Disengaged | Mode::Faulted) | None);
        // Wait until every order was sent, because a late release would hit the next enable.
        if !self.wait_with(SOON, LOOK, look, |status| !moving(status) && status.ticks > then + TICKS_TO_SEND)? {
            return Err(self.stuck("does not end its motion"));
        }
        // A reset takes effect at rest, after the cause is gone. So it is repeated until it is accepted.
        for _ in 0..SOON.as_millis() / RESET_EVERY.as_millis() {
            if self.mode() == Some(Mode::Faulted) {
                self.reset();
            }
            let ready = |status: &Status| status.mode == Mode::Disengaged as u32 && Self::is_free(status);
            if self.wait_with(RESET_EVERY, LOOK, look, ready)? {
                return Ok(());
            }
        }
        Err(self.stuck("cannot be engaged"))
    }

    /// Waits for `mode` after the enable, which this operator or another one holds.
    pub fn reach(&self, mode: Mode, look: Look) -> Result<(), Failure> {
        let begun = |status: &Status| status.mode != Mode::Disengaged as u32;
        let ended = |status: &Status| !begun(status) || status.mode == Mode::Faulted as u32;
        if self.wait_with(SOON, LOOK, look, begun)?
            && self.wait_with(SOON, LOOK, look, |status| status.mode == mode as u32 || ended(status))?
            && self.mode() == Some(mode)
        {
            return Ok(());
        }
        Err(self.stuck(&format!("never was {}", mode.name())))
    }

    /// Holds the enable of a robot that moves, for this time.
    pub fn hold(&self, length: Duration, look: Look) -> Result<(), Failure> {
        let ended =
            |status: &Status| matches!(Mode::from_u32(status.mode), Some(Mode::Faulted | Mode::Disengaged) | None);
        if self.wait_with(length, HELD_LOOK, look, ended)? || self.is_cut_off() {
            return Err(self.stuck("did not move until the end"));
        }
        Ok(())
    }

    /// Returns the mode, the faults and the last transitions, in words.
    pub fn describe(&self) -> String {
        let status = self.status();
        let mode = self.mode().map_or("unknown", Mode::name);
        let faults = Faults(status.map_or(0, |status| status.faults));
        let faults: Vec<_> = faults.iter().map(|fault| fault.row().name).collect();
        let passed = status.iter().flat_map(|status| explain::newest_transitions(status, u32::MAX));
        let passed: Vec<_> = passed.map(Transition::why_name).collect();
        format!("{mode} {}, after {}", faults.join(" "), passed.join(", "))
    }

    fn stuck(&self, what: &str) -> Failure {
        Failure::new(Exit::Failed, format!("the robot {what}: {}", self.describe()))
    }

    /// Waits until `done` returns true, and looks once `every` time. Returns false if `within` passes first, or if
    /// control no longer answers.
    fn wait_with(
        &self,
        within: Duration,
        every: Duration,
        look: Look,
        done: impl Fn(&Status) -> bool,
    ) -> Result<bool, Failure> {
        let (mut failure, mut reached) = (None, false);
        within_by(within, every, || {
            reached = self.status().is_some_and(|status| done(&status));
            failure = if reached { None } else { look().err() };
            reached || failure.is_some() || self.is_cut_off()
        });
        failure.map_or(Ok(reached), Err)
    }
}
