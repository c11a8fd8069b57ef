//! A substitute for `ingest`, for tests of a page that is a client.

use doors::{LeaseState, Server};
use messages::RawSkeleton;
use std::path::Path;

/// It grants or refuses the lease as the test sets, and keeps the frames. The test's own thread polls it.
pub(crate) struct Ingest {
    server: Server,
    /// Another client holds the lease.
    pub(crate) held: bool,
    pub(crate) holds: LeaseState,
    pub(crate) frames: Vec<RawSkeleton>,
}

impl Ingest {
    pub(crate) fn at(path: &Path) -> Self {
        let server = Server::bind(path, None).expect("a socket");
        Self { server, held: false, holds: LeaseState::Holder, frames: Vec::new() }
    }

    pub(crate) fn poll(&mut self) {
        let (frames, holds) = (&mut self.frames, self.holds);
        self.server.poll(rt::now(), self.held, |_, frame| {
            frames.push(*frame);
            holds
        });
        std::thread::sleep(std::time::Duration::from_millis(1));
    }

    /// Polls until `seen` returns something.
    #[track_caller]
    pub(crate) fn until<T>(&mut self, mut seen: impl FnMut(&Self) -> Option<T>) -> T {
        await_some(|| {
            self.poll();
            seen(self)
        })
    }
}

/// Waits until `seen` returns something.
#[track_caller]
pub(crate) fn await_some<T>(mut seen: impl FnMut() -> Option<T>) -> T {
    let mut found = None;
    wait::wait_until("seen", || {
        found = seen();
        found.is_some()
    });
    found.expect("seen")
}
