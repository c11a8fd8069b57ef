//! The session of an operator: heartbeats, and the end of one.

use messages::{Layout, Stamp, Status};
use operator::{OperatorSession, OperatorView, Server};
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// Longest wait; only a hang comes near it.
const SOON: Duration = Duration::from_secs(20);
struct House {
    _folder: TempDir,
    server: Server,
    began: Instant,
}

impl House {
    fn new() -> Self {
        let folder = TempDir::new().expect("a folder");
        let server = Server::bind(folder.path().join("control.sock")).expect("a socket");
        Self { _folder: folder, server, began: Instant::now() }
    }

    fn session(&self) -> OperatorSession {
        let path = self._folder.path().join("control.sock");
        OperatorSession::connect(&path).expect("the server listens")
    }

    /// Polls as control does, until `done` returns true of what it sees.
    fn until(&mut self, what: &str, mut done: impl FnMut(&OperatorView) -> bool) {
        let give_up = Instant::now() + SOON;
        loop {
            let now = Stamp(1_000_000_000 + self.began.elapsed().as_nanos() as u64);
            if done(&self.server.poll(now, &Status::ZERO)) {
                return;
            }
            assert!(Instant::now() < give_up, "never {what}");
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    /// Polls for so long, and returns true if the enable was held and never released by an edge.
    fn stays_enabled(&mut self, time: Duration) -> bool {
        let (end, mut stays) = (Instant::now() + time, true);
        self.until("over", |view| {
            stays &= view.enable_level && view.release_edges == 0;
            Instant::now() >= end
        });
        stays
    }
}

#[test]
fn dropped_session_leaves_enable_of_another_connection() {
    let mut house = House::new();
    let (holder, other) = (house.session(), house.session());
    holder.enable();
    house.until("enabled", |view| view.enable_level);
    other.enable();
    assert!(house.stays_enabled(Duration::from_millis(200)), "the second enable is refused");
    let dropping = std::thread::spawn(move || drop(other));
    assert!(house.stays_enabled(Duration::from_millis(300)), "only its own connection ends");
    dropping.join().expect("it ends");
}

#[test]
fn dropped_session_withdraws_its_own_enable() {
    let mut house = House::new();
    let holder = house.session();
    holder.enable();
    house.until("enabled", |view| view.enable_level);
    let dropping = std::thread::spawn(move || drop(holder));
    house.until("withdrawn", |view| !view.enable_level);
    dropping.join().expect("it ends");
}

#[test]
fn emergency_stop_overtakes_waiting_requests() {
    let mut house = House::new();
    let session = house.session();
    house.until("heard", |_| session.status().is_some());
    (0..50).for_each(|_| session.release());
    session.estop();
    let mut released = 0;
    house.until("stopped", |view| {
        released = view.release_edges;
        view.estop_edges > 0
    });
    assert!(released < 5, "after {released} releases");
}
