//! An operator in a thread. Sends heartbeats at 50 Hz, holds or releases the enable, and keeps the newest status.

use crate::exit::{Exit, Failure};
use messages::{Mode, Status};
use operator::Client;
use std::path::Path;
use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Time between two heartbeats: 50 Hz.
const HEARTBEAT: Duration = Duration::from_millis(20);

/// Next request of the virtual operator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Request {
    Enable,
    Release,
    Reset,
}

/// A virtual operator.
pub struct Operator {
    hand: Sender<Request>,
    statuses: Receiver<Status>,
    latest: Option<Status>,
    thread: Option<JoinHandle<()>>,
}

impl Operator {
    /// Connects to the operator socket of an instance. Then sends heartbeats without the enable.
    pub fn connect(socket: &Path) -> Result<Self, Failure> {
        let client = Client::connect(socket).map_err(|error| Failure::new(Exit::Unavailable, error))?;
        let (hand, commands) = channel();
        let (sender, statuses) = channel();
        let thread = std::thread::Builder::new()
            .name("operator".into())
            .spawn(move || heartbeats(client, &commands, &sender))
            .map_err(|error| Failure::new(Exit::Software, error))?;
        Ok(Self { hand, statuses, latest: None, thread: Some(thread) })
    }

    /// Presses the enable and holds it.
    pub fn enable(&self) {
        let _ = self.hand.send(Request::Enable);
    }

    /// Releases the enable.
    pub fn release(&self) {
        let _ = self.hand.send(Request::Release);
    }

    /// Requests a reset of the latched faults.
    pub fn reset(&self) {
        let _ = self.hand.send(Request::Reset);
    }

    /// Returns the newest status. `None` before the first reply.
    pub fn status(&mut self) -> Option<Status> {
        while let Ok(status) = self.statuses.try_recv() {
            self.latest = Some(status);
        }
        self.latest
    }

    /// Returns the mode of the newest status.
    pub fn mode(&mut self) -> Option<Mode> {
        self.status().and_then(|status| Mode::from_u32(status.mode))
    }

    /// Returns true once control no longer answers.
    pub fn is_cut_off(&self) -> bool {
        self.thread.as_ref().is_none_or(JoinHandle::is_finished)
    }

    /// Waits until `done` returns true. Returns false if `within` passes first.
    pub fn wait(&mut self, within: Duration, done: impl Fn(&Status) -> bool) -> bool {
        let give_up = Instant::now() + within;
        while Instant::now() < give_up && !self.is_cut_off() {
            if self.status().is_some_and(|status| done(&status)) {
                return true;
            }
            std::thread::sleep(HEARTBEAT / 4);
        }
        false
    }
}

impl Drop for Operator {
    fn drop(&mut self) {
        let (closed, _) = channel();
        self.hand = closed;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn heartbeats(mut client: Client, commands: &Receiver<Request>, statuses: &Sender<Status>) {
    let mut beat = Instant::now();
    loop {
        match commands.try_recv() {
            Ok(Request::Enable) => _ = client.enable(),
            Ok(Request::Release) => _ = client.release(),
            Ok(Request::Reset) => _ = client.reset(),
            Err(TryRecvError::Empty) => {}
            Err(TryRecvError::Disconnected) => {
                client.release();
                let _ = client.heartbeat();
                return;
            }
        }
        match client.heartbeat() {
            Ok(status) => {
                if statuses.send(status).is_err() {
                    return;
                }
            }
            // One late reply does not end the thread. The socket keeps the connection, and control judges the
            // silence.
            Err(operator::OperatorError::Timeout { .. }) => {}
            Err(_) => return,
        }
        beat += HEARTBEAT;
        std::thread::sleep(beat.saturating_duration_since(Instant::now()));
    }
}
