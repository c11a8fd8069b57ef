//! The session of an operator: heartbeats, and the end of one.

use messages::{Layout, Stamp, Status};
use operator::{OperatorCounts, OperatorSession, Server};
use std::time::{Duration, Instant};
use tempfile::TempDir;

struct Rig {
    _folder: TempDir,
    server: Server,
    began: Instant,
}

impl Rig {
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
    fn until(&mut self, what: &str, mut done: impl FnMut(&OperatorCounts) -> bool) {
        wait::wait_until(what, || {
            let now = Stamp(1_000_000_000 + self.began.elapsed().as_nanos() as u64);
            done(&self.server.poll(now, &Status::ZERO))
        });
    }

    /// Polls for so long, and returns true if the enable was held and never released by an edge.
    fn stays_enabled(&mut self, time: Duration) -> bool {
        let (end, mut stays) = (Instant::now() + time, true);
        self.until("over", |counts| {
            stays &= counts.held.enable_level && counts.release_edges == 0;
            Instant::now() >= end
        });
        stays
    }
}

#[test]
fn dropped_session_leaves_enable_of_another_connection() {
    let mut rig = Rig::new();
    let (holder, other) = (rig.session(), rig.session());
    holder.enable();
    rig.until("enabled", |counts| counts.held.enable_level);
    other.enable();
    assert!(rig.stays_enabled(Duration::from_millis(200)), "the second enable is refused");
    let dropping = std::thread::spawn(move || drop(other));
    assert!(rig.stays_enabled(Duration::from_millis(300)), "only its own connection ends");
    dropping.join().expect("it ends");
}

#[test]
fn dropped_session_withdraws_its_own_enable() {
    let mut rig = Rig::new();
    let holder = rig.session();
    holder.enable();
    rig.until("enabled", |counts| counts.held.enable_level);
    let dropping = std::thread::spawn(move || drop(holder));
    rig.until("withdrawn", |counts| !counts.held.enable_level);
    dropping.join().expect("it ends");
}

#[test]
fn emergency_stop_overtakes_waiting_requests() {
    let mut rig = Rig::new();
    let session = rig.session();
    rig.until("heard", |_| session.status().is_some());
    (0..50).for_each(|_| session.release());
    session.estop();
    let mut released = 0;
    rig.until("stopped", |counts| {
        released = counts.release_edges;
        counts.estop_edges > 0
    });
    assert!(released < 5, "after {released} releases");
}
