//! A client in a thread: publishes a motion through the input domain, exactly as any other client would.

mod shared;

use crate::player::Player;
use bus::{BusError, Domain, DomainConfig};
use messages::{RawSkeleton, Service, Stamp};
use shared::Shared;
use std::sync::mpsc::{RecvError, channel};
use std::sync::{Arc, atomic};
use std::thread::JoinHandle;
use std::time::Duration;

/// A motion that is being published.
#[derive(Debug)]
pub struct Publisher {
    shared: Arc<Shared>,
    frames: u64,
    thread: Option<JoinHandle<()>>,
}

impl Publisher {
    /// Starts to publish `player`'s motion into `domain`; `now` reads CLOCK_MONOTONIC.
    pub fn start(domain: DomainConfig, player: Player, now: fn() -> Stamp) -> Result<Self, BusError> {
        let shared = Arc::new(Shared::default());
        let (frames, twin) = (player.progress().1, Arc::clone(&shared));
        let (opened, outcome) = channel();
        let thread = std::thread::Builder::new()
            .name("client".into())
            .spawn(move || {
                // The port is made here because it cannot change its thread.
                let ports = Domain::open(domain, "replay")
                    .and_then(|domain| Ok((domain.writer::<RawSkeleton>(Service::RawSkeleton)?, domain)));
                match ports {
                    Ok((writer, _domain)) => {
                        let _ = opened.send(Ok(()));
                        publish(writer, player, &twin, now);
                    }
                    Err(error) => _ = opened.send(Err(error)),
                }
            })
            .expect("a thread can be started");
        // The thread always answers: opening a domain ends within 5 s, in success or not.
        match outcome.recv() {
            Ok(Ok(())) => Ok(Self { shared, frames, thread: Some(thread) }),
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

    /// Frames that the bus did not take.
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

fn publish(mut writer: bus::Writer<RawSkeleton>, mut player: Player, shared: &Shared, now: fn() -> Stamp) {
    while !shared.stopped() {
        if let Some((_, frame)) = player.due(now(), shared.engaged()) {
            let failed = writer.publish(&frame).is_err() | writer.notify().is_err();
            shared.publish(player.progress().0, failed, player.finished());
        }
        let wait_ns = player.next_due().since(now());
        // Short sleeps, so that stopping never waits for a slow frame rate.
        std::thread::sleep(Duration::from_nanos(wait_ns.min(5_000_000)));
    }
}
