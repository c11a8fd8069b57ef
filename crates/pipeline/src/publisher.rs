//! A client in a thread: publishes a motion through the input domain or the skeleton socket, exactly as any other client
//! would.

mod shared;

use crate::player::Player;
use bus::{BusError, Domain, DomainConfig, Writer};
use doors::DoorError;
use messages::{RawSkeleton, Service, Stamp};
use shared::Shared;
use std::path::PathBuf;
use std::sync::mpsc::{RecvError, channel};
use std::sync::{Arc, Mutex, atomic};
use std::thread::JoinHandle;
use std::time::Duration;

/// What the daemon said last.
type LastReply = Arc<Mutex<Option<String>>>;

/// Where a motion is published to.
#[derive(Clone, Debug)]
pub enum Transport {
    /// The input domain, in shared memory.
    Domain(DomainConfig),
    /// The skeleton socket of `ingest`.
    Socket(PathBuf),
}

/// Why a client cannot publish.
#[derive(Debug, thiserror::Error)]
pub enum ClientError {
    /// The input domain cannot be entered.
    #[error(transparent)]
    Bus(#[from] BusError),
    /// The bus did not take a frame.
    #[error(transparent)]
    Frame(#[from] bus::PublishError),
    /// The door is closed.
    #[error(transparent)]
    Door(#[from] DoorError),
}

/// An open way, for a client whose frames are its own.
pub struct Port(Open);

enum Open {
    Bus(Box<(Writer<RawSkeleton>, Domain)>),
    Socket(doors::Client),
}

impl Port {
    /// Opens `way`; `name` is what the bus calls the client.
    ///
    /// # Errors
    /// The domain cannot be entered, or the door is closed.
    pub fn open(way: Transport, name: &str) -> Result<Self, ClientError> {
        Ok(Self(match way {
            Transport::Domain(config) => {
                let domain = Domain::open(config, name)?;
                Open::Bus(Box::new((domain.writer(Service::RawSkeleton)?, domain)))
            }
            Transport::Socket(path) => Open::Socket(doors::Client::attach(path)?),
        }))
    }

    /// Publishes a frame, with the header and the session that it has; on the socket the session is the one that `ingest` gives.
    ///
    /// # Errors
    /// The frame was not taken.
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

    /// What the daemon said last, where it says anything.
    pub fn told(&self) -> Option<&'static str> {
        match &self.0 {
            Open::Bus(_) => None,
            Open::Socket(client) => Some(client.told().meaning()),
        }
    }
}

/// A motion that is being published.
#[derive(Debug)]
pub struct Publisher {
    shared: Arc<Shared>,
    told: LastReply,
    frames: u64,
    thread: Option<JoinHandle<()>>,
}

impl Publisher {
    /// Starts to publish `player`'s motion into `domain`; `now` reads CLOCK_MONOTONIC.
    pub fn start(domain: DomainConfig, player: Player, now: fn() -> Stamp) -> Result<Self, ClientError> {
        Self::start_on(Transport::Domain(domain), player, now)
    }

    /// As `start`, on any way. On the socket the session is the one that `ingest` gives.
    pub fn start_on(way: Transport, player: Player, now: fn() -> Stamp) -> Result<Self, ClientError> {
        let shared = Arc::new(Shared::default());
        let told = LastReply::default();
        let (frames, twin, said) = (player.progress().1, Arc::clone(&shared), Arc::clone(&told));
        let (opened, outcome) = channel();
        let thread = std::thread::Builder::new()
            .name("client".into())
            .spawn(move || {
                // The port is made here because it cannot change its thread.
                match Port::open(way, "replay") {
                    Ok(port) => {
                        let _ = opened.send(Ok(()));
                        publish(port, player, &twin, &said, now);
                    }
                    Err(error) => _ = opened.send(Err(error)),
                }
            })
            .expect("a thread can be started");
        // The thread always answers: opening a domain ends within 5 s, attaching to a socket within 1 s, in success or not.
        match outcome.recv() {
            Ok(Ok(())) => Ok(Self { shared, told, frames, thread: Some(thread) }),
            Ok(Err(error)) => Err(error),
            Err(RecvError) => unreachable!("the client's thread answers before it ends"),
        }
    }

    /// Says whether the robot follows; the motion begins with the first `true`.
    pub fn set_engaged(&self, engaged: bool) {
        self.shared.set_engaged(engaged);
    }

    /// Whether the last frame has been published; `progress` and `failures` are final then.
    pub fn finished(&self) -> bool {
        self.shared.finished()
    }

    /// Frames of the motion published, and their number.
    pub fn progress(&self) -> (u64, u64) {
        (self.shared.published(), self.frames)
    }

    /// What the daemon said last of this client, or why the last frame was not taken; nothing on shared memory.
    pub fn told(&self) -> Option<String> {
        self.told.lock().unwrap_or_else(|poisoned| poisoned.into_inner()).clone()
    }

    /// Frames that were not taken.
    pub fn failures(&self) -> u64 {
        self.shared.failures()
    }
}

impl Drop for Publisher {
    fn drop(&mut self) {
        self.shared.stop();
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn publish(mut port: Port, mut player: Player, shared: &Shared, told: &LastReply, now: fn() -> Stamp) {
    while !shared.stopped() {
        if let Some((_, frame)) = player.due(now(), shared.engaged()) {
            let outcome = port.publish(&frame);
            shared.publish(player.progress().0, outcome.is_err(), player.finished());
            let said = outcome.err().map(|error| error.to_string()).or_else(|| port.told().map(str::to_owned));
            *told.lock().unwrap_or_else(|poisoned| poisoned.into_inner()) = said;
        }
        let wait_ns = player.next_due().since(now());
        // Short sleeps, so that stopping never waits for a slow frame rate.
        std::thread::sleep(Duration::from_nanos(wait_ns.min(5_000_000)));
    }
}
