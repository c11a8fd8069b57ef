//! A client in a thread. It publishes a motion through the input domain or the skeleton socket, like any other client.

mod shared;

use crate::player::Player;
use bus::{BusError, Domain, DomainConfig, Writer};
use doors::DoorError;
use messages::{RawSkeleton, Service, Stamp};
use rt::Background;
use shared::Shared;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, atomic};
use std::time::Duration;

/// The daemon's last reply.
type LastReply = Arc<Mutex<Option<String>>>;

/// Destination of the frames.
#[derive(Clone, Debug)]
pub enum Transport {
    /// The input domain, in shared memory.
    Domain(DomainConfig),
    /// The skeleton socket of `ingest`.
    Socket(PathBuf),
}

/// Reason for which a client cannot publish.
#[derive(Debug, thiserror::Error)]
pub enum ClientError {
    /// The client cannot open the input domain.
    #[error(transparent)]
    Bus(#[from] BusError),
    /// The bus did not take a frame.
    #[error(transparent)]
    Frame(#[from] bus::PublishError),
    /// The skeleton socket refused the client.
    #[error(transparent)]
    Door(#[from] DoorError),
}

/// An open connection, for a client that sends its own frames.
pub struct Port(Open);

enum Open {
    Bus(Box<(Writer<RawSkeleton>, Domain)>),
    Socket(doors::Client),
}

impl Port {
    /// Opens `way`. `name` is the client's name on the bus.
    ///
    /// # Errors
    /// Returns an error if the domain cannot be opened or the socket refuses the client.
    pub fn open(way: Transport, name: &str) -> Result<Self, ClientError> {
        Ok(Self(match way {
            Transport::Domain(config) => {
                let domain = Domain::open(config, name)?;
                Open::Bus(Box::new((domain.writer(Service::RawSkeleton)?, domain)))
            }
            Transport::Socket(path) => Open::Socket(doors::Client::attach(path)?),
        }))
    }

    /// Publishes a frame with its own header and session. On the socket `ingest` assigns the session.
    ///
    /// # Errors
    /// Returns an error if the frame was not taken.
    pub fn publish(&mut self, frame: &RawSkeleton) -> Result<(), ClientError> {
        match &mut self.0 {
            Open::Bus(port) => {
                port.0.publish(frame)?;
                port.0.notify()?;
            }
            Open::Socket(client) => client.publish(frame)?,
        }
        Ok(())
    }

    /// The daemon's last reply. `None` in shared memory, where the daemon does not reply.
    pub fn last_reply(&self) -> Option<&'static str> {
        match &self.0 {
            Open::Bus(_) => None,
            Open::Socket(client) => Some(client.last_reply().meaning()),
        }
    }
}

/// A motion that is being published.
#[derive(Debug)]
pub struct Publisher {
    shared: Arc<Shared>,
    last_reply: LastReply,
    frames: u64,
    _thread: Background,
}

impl Publisher {
    /// Starts to publish `player`'s motion into `domain`. `now` reads CLOCK_MONOTONIC.
    pub fn start(domain: DomainConfig, player: Player, now: fn() -> Stamp) -> Result<Self, ClientError> {
        Self::start_on(Transport::Domain(domain), player, now)
    }

    /// As `start`, with any destination. On the socket `ingest` assigns the session.
    pub fn start_on(way: Transport, player: Player, now: fn() -> Stamp) -> Result<Self, ClientError> {
        let shared = Arc::new(Shared::default());
        let last_reply = LastReply::default();
        let (frames, thread_shared, thread_reply) = (player.progress().1, Arc::clone(&shared), Arc::clone(&last_reply));
        // Opening a domain ends within 5 s, attaching to a socket within 1 s.
        let open = || Port::open(way, "replay");
        let thread = Background::opened("client", open, move |port, _| {
            publish(port, player, &thread_shared, &thread_reply, now);
        })?;
        Ok(Self { shared, last_reply, frames, _thread: thread })
    }

    /// Tells the client whether the robot follows. The motion begins with the first `true`.
    pub fn set_engaged(&self, engaged: bool) {
        self.shared.set_engaged(engaged);
    }

    /// Returns true if the last frame has been published, or the daemon has closed the socket. Then `progress`, `failures` and
    /// `last_reply` are final.
    pub fn finished(&self) -> bool {
        self.shared.finished()
    }

    /// Frames of the motion published, and their total number.
    pub fn progress(&self) -> (u64, u64) {
        (self.shared.published(), self.frames)
    }

    /// The daemon's last reply to this client, or the reason for which the last frame was not taken. In shared
    /// memory there are no replies.
    pub fn last_reply(&self) -> Option<String> {
        self.last_reply.lock().unwrap_or_else(|poisoned| poisoned.into_inner()).clone()
    }

    /// Number of frames that were not taken.
    pub fn failures(&self) -> u64 {
        self.shared.failures()
    }
}

impl Drop for Publisher {
    fn drop(&mut self) {
        self.shared.stop();
    }
}

fn publish(mut port: Port, mut player: Player, shared: &Shared, last_reply: &LastReply, now: fn() -> Stamp) {
    while !shared.stopped() {
        if let Some((_, frame)) = player.due(now(), shared.engaged()) {
            let outcome = port.publish(&frame);
            // A socket that the daemon has closed takes no other frame.
            let closed = matches!(outcome, Err(ClientError::Door(DoorError::Closed { .. })));
            shared.publish(player.progress().0, outcome.is_err(), player.finished() || closed);
            let reply = outcome.err().map(|error| error.to_string()).or_else(|| port.last_reply().map(str::to_owned));
            *last_reply.lock().unwrap_or_else(|poisoned| poisoned.into_inner()) = reply;
            if closed {
                return;
            }
        }
        let wait_ns = player.next_due().since(now());
        // Short sleeps, so stopping never waits for a slow frame rate.
        std::thread::sleep(Duration::from_nanos(wait_ns.min(5_000_000)));
    }
}
