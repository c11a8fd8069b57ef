//! An operator in a thread. Sends heartbeats at 50 Hz, holds or releases the enable, and keeps the newest status.

use crate::{Client, OperatorError};
use messages::{Mode, Status};
use rt::Background;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Time between two heartbeats: 50 Hz.
const HEARTBEAT: Duration = Duration::from_millis(20);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Request {
    Enable,
    Release,
    Reset,
    Clutch(bool),
}

#[derive(Default)]
struct Shared {
    status: Mutex<Option<Status>>,
    silent: AtomicBool,
    estop: AtomicBool,
}

/// An operator's connection with its heartbeat. Dropping it closes the connection, and with it goes the enable that it
/// holds. Requests that wait are dropped, but for the emergency stop.
pub struct OperatorSession {
    requests: Sender<Request>,
    shared: Arc<Shared>,
    thread: Background,
}

impl OperatorSession {
    /// Connects to the operator socket of an instance. Then sends heartbeats without the enable.
    ///
    /// # Errors
    /// Returns an error if nothing answers. A late first reply is no error: `control` judges the silence.
    pub fn connect(socket: &Path) -> Result<Self, OperatorError> {
        let mut client = Client::connect(socket)?;
        match client.heartbeat() {
            Ok(_) | Err(OperatorError::Timeout { .. }) => {}
            Err(error) => return Err(error),
        }
        let (requests, received) = channel();
        let shared = Arc::new(Shared::default());
        let of_thread = Arc::clone(&shared);
        let thread = Background::start("operator", move |closes| heartbeats(client, &received, &of_thread, closes));
        let thread = thread.map_err(|cause| OperatorError::Thread { cause: cause.to_string() })?;
        Ok(Self { requests, shared, thread })
    }

    fn request(&self, request: Request) {
        // An ended thread shows in `is_cut_off`.
        let _ = self.requests.send(request);
    }

    /// Presses the enable and holds it.
    pub fn enable(&self) {
        self.request(Request::Enable);
    }

    /// Releases the enable.
    pub fn release(&self) {
        self.request(Request::Release);
    }

    /// Requests a reset of the latched faults.
    pub fn reset(&self) {
        self.request(Request::Reset);
    }

    /// Holds the clutch, or lets go of it.
    pub fn clutch(&self, held: bool) {
        self.request(Request::Clutch(held));
    }

    /// Presses the emergency stop. It overtakes other requests.
    pub fn estop(&self) {
        self.shared.estop.store(true, Ordering::Relaxed);
    }

    /// Stops the heartbeats, as a client that hangs would.
    pub fn fall_silent(&self) {
        self.shared.silent.store(true, Ordering::Relaxed);
    }

    /// Returns the newest status. `None` before the first reply.
    pub fn status(&self) -> Option<Status> {
        *self.shared.status.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns the mode of the newest status.
    pub fn mode(&self) -> Option<Mode> {
        self.status().and_then(|status| Mode::from_u32(status.mode))
    }

    /// Returns true once control no longer answers.
    pub fn is_cut_off(&self) -> bool {
        self.thread.has_ended()
    }

    /// Waits until `done` returns true. Returns false if `within` passes first, or if control no longer answers.
    pub fn wait(&self, within: Duration, done: impl Fn(&Status) -> bool) -> bool {
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

fn heartbeats(mut client: Client, requests: &Receiver<Request>, shared: &Shared, closes: &AtomicBool) {
    let mut beat = Instant::now();
    loop {
        let closing = closes.load(Ordering::Acquire);
        let stops = shared.estop.swap(false, Ordering::Relaxed);
        if closing && !stops {
            return;
        }
        if stops {
            client.estop();
        } else {
            // One request per heartbeat, so that the server sees each alone.
            match requests.try_recv() {
                Ok(Request::Enable) => _ = client.enable(),
                Ok(Request::Release) => _ = client.release(),
                Ok(Request::Reset) => _ = client.reset(),
                Ok(Request::Clutch(held)) => _ = client.clutch(held),
                Err(TryRecvError::Empty | TryRecvError::Disconnected) => {}
            }
        }
        if !shared.silent.load(Ordering::Relaxed) {
            match client.heartbeat() {
                Ok(status) => *shared.status.lock().unwrap_or_else(PoisonError::into_inner) = Some(status),
                // One late reply does not end the thread. The socket keeps the connection, and control judges the
                // silence.
                Err(OperatorError::Timeout { .. }) => {}
                Err(_) => return,
            }
        }
        beat += HEARTBEAT;
        std::thread::sleep(beat.saturating_duration_since(Instant::now()));
    }
}
