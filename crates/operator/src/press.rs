//! A press of the emergency stop that is repeated until it shows.

use crate::{Client, OperatorError};
use messages::{Fault, Faults, Mode, Status};
use std::path::{Path, PathBuf};

/// The emergency stop, pressed again over a new connection whenever one ends, until a status shows that the robot stopped.
pub struct StopPress {
    socket: PathBuf,
    client: Option<Client>,
    heard: bool,
}

impl StopPress {
    /// Creates a press for an operator socket. Nothing is pressed before the first step.
    pub fn new(socket: &Path) -> Self {
        Self { socket: socket.to_owned(), client: None, heard: false }
    }

    /// Presses, or looks whether the press shows. Returns the status that shows the stop. Call it at 50 Hz.
    ///
    /// # Errors
    /// Returns why there is no answer now. The next step presses again.
    pub fn step(&mut self) -> Result<Option<Status>, OperatorError> {
        let mut client = match self.client.take() {
            Some(client) => client,
            None => {
                let mut client = Client::connect(&self.socket)?;
                client.estop();
                client
            }
        };
        let answered = client.heartbeat();
        // One that waits for the robot answers late. Its press counts.
        if matches!(answered, Ok(_) | Err(OperatorError::Timeout { .. })) {
            self.client = Some(client);
        }
        let status = answered?;
        self.heard = true;
        let stopped = Mode::from_u32(status.mode) == Some(Mode::Faulted);
        Ok((stopped && Faults(status.latched).has(Fault::EmergencyStop)).then_some(status))
    }

    /// Returns true once a press was answered.
    pub fn is_heard(&self) -> bool {
        self.heard
    }
}
