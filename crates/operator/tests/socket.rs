//! The commands of the socket that count.

use messages::{
    HOLDS_ENABLE, HOLDS_RECOVERY, Layout, OPERATOR_VERSION, OperatorRequest, PayloadOrder, Stamp, Status, payload_flag,
};
use operator::{CLIENTS_MAX, Client, LEASE_NS, OperatorCounts, OperatorError, REQUEST_BYTES, Server};
use rustix::net::{AddressFamily, SendFlags, SocketAddrUnix, SocketType};
use std::io::{BufRead, BufReader, Lines, Write};
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use tempfile::TempDir;

/// Gives the path of the socket to the crowd in a process of its own.
const CROWD_AT: &str = "TELEOP_TEST_CROWD_AT";

/// A server in a folder of its own. Its clock stands still unless a test moves it.
struct Rig {
    _folder: TempDir,
    path: PathBuf,
    server: Server,
    now: Stamp,
}

impl Rig {
    fn new() -> Self {
        let folder = TempDir::new().unwrap();
        let path = folder.path().join("control.sock");
        let server = Server::bind(&path).unwrap();
        Self { _folder: folder, path, server, now: Stamp(1_000_000_000) }
    }

    /// Creates a server with `count` connections, of which the first `forgotten` have been silent for a second.
    fn with_forgotten(count: usize, forgotten: usize) -> (Self, Vec<Raw>) {
        let mut rig = Self::new();
        let mut clients: Vec<Raw> = (0..count).map(|_| rig.raw()).collect();
        clients.iter_mut().for_each(|client| client.send(|_| {}));
        rig.poll();
        rig.now = Stamp(rig.now.0 + 1_000_000_000);
        clients.iter_mut().skip(forgotten).for_each(|client| client.send(|_| {}));
        rig.poll();
        (rig, clients)
    }

    fn poll(&mut self) -> OperatorCounts {
        self.server.poll(self.now, &Status { k: 42, ..Status::ZERO })
    }

    fn raw(&self) -> Raw {
        Raw::connect(&self.path)
    }
}

/// A client that does not wait for replies, so that one thread can play both sides.
struct Raw {
    socket: OwnedFd,
    request: OperatorRequest,
}

impl Raw {
    fn connect(path: &Path) -> Self {
        let socket = rustix::net::socket(AddressFamily::UNIX, SocketType::SEQPACKET, None).unwrap();
        rustix::net::connect(&socket, &SocketAddrUnix::new(path).unwrap()).unwrap();
        Self { socket, request: OperatorRequest { version: OPERATOR_VERSION, ..OperatorRequest::ZERO } }
    }

    fn is_kept(&self) -> bool {
        use rustix::net::{RecvFlags, recv};
        let mut bytes = [0; operator::STATUS_BYTES];
        loop {
            match recv(&self.socket, &mut bytes[..], RecvFlags::DONTWAIT) {
                Ok((0, _)) => return false,
                Ok(_) => {}
                Err(error) => return error == rustix::io::Errno::AGAIN,
            }
        }
    }

    /// Faults in the newest reply. `None` if none waits.
    fn reply(&self) -> Option<u64> {
        let mut bytes = [0; operator::STATUS_BYTES];
        let (length, _) = rustix::net::recv(&self.socket, &mut bytes[..], rustix::net::RecvFlags::DONTWAIT).ok()?;
        operator::decode_status(&bytes[..length]).map(|status| status.latched)
    }

    fn send(&mut self, change: impl Fn(&mut OperatorRequest)) {
        change(&mut self.request);
        self.request.sequence += 1;
        self.send_bytes(&operator::encode_request(&self.request));
    }

    fn send_bytes(&self, bytes: &[u8]) {
        rustix::net::send(&self.socket, bytes, SendFlags::empty()).unwrap();
    }

    fn press(&mut self) {
        self.send(|r| (r.enable_level, r.enable_count) = (1, r.enable_count + 1));
    }
}

/// Connections of another process. It sends requests on all of them when the test orders it.
struct ConnectionFlood {
    process: Child,
    orders: ChildStdin,
    answers: Lines<BufReader<ChildStdout>>,
}

impl ConnectionFlood {
    fn at(path: &Path) -> Self {
        let mut command = Command::new(std::env::current_exe().unwrap());
        command.args(["--exact", "socket::child_process_that_floods_connections", "--nocapture", "--test-threads=1"]);
        command.env(CROWD_AT, path).stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut process = command.spawn().unwrap();
        let (orders, answers) = (process.stdin.take().unwrap(), process.stdout.take().unwrap());
        Self { process, orders, answers: BufReader::new(answers).lines() }
    }

    /// Opens `count` more connections and sends a request on all that the server keeps. Returns their number.
    fn come(&mut self, count: usize) -> usize {
        writeln!(self.orders, "{count}").unwrap();
        let mut lines = self.answers.by_ref().map(|line| line.unwrap());
        lines.find_map(|line| line.strip_prefix("kept ")?.parse().ok()).expect("the crowd has come")
    }
}

impl Drop for ConnectionFlood {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

#[test]
fn child_process_that_floods_connections() {
    let Some(path) = std::env::var_os(CROWD_AT) else { return };
    let mut all: Vec<Raw> = Vec::new();
    for line in std::io::stdin().lines() {
        let count: usize = line.unwrap().parse().unwrap();
        all.extend((0..count).map(|_| Raw::connect(Path::new(&path))));
        all.retain(Raw::is_kept);
        all.iter_mut().for_each(|client| client.send(|_| {}));
        println!("\nkept {}", all.len());
    }
}

#[test]
fn process_with_all_connections_yields_one_to_each_other() {
    let mut rig = Rig::new();
    let mut crowd = ConnectionFlood::at(&rig.path);
    crowd.come(CLIENTS_MAX);
    assert_eq!(rig.poll().connections, CLIENTS_MAX as u32);
    let mut others = [ConnectionFlood::at(&rig.path), ConnectionFlood::at(&rig.path)];
    let mut own = rig.raw();
    own.send(|r| r.reset_count += 1);
    // More connections of the process with all places come before and after them.
    crowd.come(5);
    others.iter_mut().for_each(|other| assert_eq!(other.come(1), 1));
    crowd.come(5);
    let counts = rig.poll();
    assert_eq!((counts.connections, counts.reset_edges), (CLIENTS_MAX as u32, 1));
    // However long it goes on, a client with one place keeps it and is served, also after a second of silence.
    for round in 1..=20 {
        rig.now = Stamp(rig.now.0 + 1_000_000_000);
        crowd.come(10);
        own.send(|r| r.reset_count += 1);
        let counts = rig.poll();
        assert!(own.is_kept(), "round {round}");
        assert_eq!((counts.connections, counts.reset_edges), (CLIENTS_MAX as u32, 1 + round));
    }
    let mut second = rig.raw();
    second.send(|_| {});
    rig.poll();
    assert!(own.is_kept() && second.is_kept(), "the crowd still has more than two");
    others.iter_mut().for_each(|other| assert_eq!(other.come(0), 1));
    assert_eq!(crowd.come(0), CLIENTS_MAX - 4);
}

#[test]
fn first_enable_edge_holds_and_second_client_is_refused() {
    let mut rig = Rig::new();
    let (mut first, mut second) = (rig.raw(), rig.raw());
    first.press();
    second.send(|_| {});
    let counts = rig.poll();
    assert_eq!((counts.connections, counts.held.enable_level, counts.enable_edges), (2, true, 1));
    second.press();
    let counts = rig.poll();
    assert_eq!((counts.held.enable_level, counts.enable_edges, counts.enables_refused), (true, 1, 1));
    // A client may release a grip that it does not hold. A level that stays up grants nothing.
    first.send(|r| (r.enable_level, r.release_count) = (0, 1));
    assert!(!rig.poll().held.enable_level);
    second.send(|_| {});
    let counts = rig.poll();
    assert_eq!((counts.held.enable_level, counts.enable_edges, counts.release_edges), (false, 1, 1));
    second.press();
    let counts = rig.poll();
    assert_eq!((counts.held.enable_level, counts.enable_edges), (true, 2));
}

#[test]
fn client_holds_either_recovery_or_enable() {
    let mut rig = Rig::new();
    let (mut first, mut second) = (rig.raw(), rig.raw());
    first.send(|r| (r.enable_level, r.enable_count) = (HOLDS_RECOVERY, 1));
    let counts = rig.poll();
    assert_eq!(
        (counts.held.recover_level, counts.recover_edges, counts.held.enable_level, counts.enable_edges),
        (true, 1, false, 0)
    );
    second.press();
    let counts = rig.poll();
    assert_eq!(
        (counts.held.recover_level, counts.held.enable_level, counts.enables_refused),
        (true, false, 1),
        "there is one holder"
    );
    // A changed level without an edge is a release. With an edge it is a new grip.
    first.send(|r| r.enable_level = HOLDS_ENABLE);
    let counts = rig.poll();
    assert_eq!((counts.held.recover_level, counts.held.enable_level, counts.release_edges), (false, false, 1));
    first.send(|r| (r.enable_level, r.enable_count) = (HOLDS_RECOVERY, 2));
    assert!(rig.poll().held.recover_level);
    first.press();
    let counts = rig.poll();
    assert_eq!(
        (counts.held.recover_level, counts.held.enable_level, counts.release_edges, counts.enable_edges),
        (false, true, 2, 1)
    );
    first.send(|r| (r.enable_level, r.enable_count) = (HOLDS_RECOVERY, r.enable_count + 1));
    rig.poll();
    drop(first);
    let counts = rig.poll();
    assert_eq!((counts.held.recover_level, counts.holders_lost), (false, 1));
}

#[test]
fn any_client_may_stop_reset_and_release() {
    let mut rig = Rig::new();
    let (mut holder, mut other) = (rig.raw(), rig.raw());
    holder.press();
    rig.poll();
    other.send(|r| r.estop_count += 1);
    other.send(|r| r.reset_count += 2);
    let counts = rig.poll();
    assert_eq!((counts.estop_edges, counts.reset_edges, counts.held.enable_level), (1, 2, true));
    other.send(|r| r.release_count += 1);
    let counts = rig.poll();
    assert_eq!((counts.release_edges, counts.held.enable_level, counts.holders_lost), (1, false, 0));
}

#[test]
fn release_wins_over_enable_of_same_round_in_any_order() {
    for releaser_first in [true, false] {
        let mut rig = Rig::new();
        let (mut a, mut b) = (rig.raw(), rig.raw());
        a.send(|_| {});
        rig.poll();
        let (releaser, presser) = if releaser_first { (&mut a, &mut b) } else { (&mut b, &mut a) };
        releaser.send(|r| r.release_count += 1);
        presser.press();
        let counts = rig.poll();
        assert_eq!((counts.held.enable_level, counts.release_edges), (false, 1), "{releaser_first}");
    }
}

#[test]
fn enable_released_before_its_heartbeat_grants_nothing() {
    let mut rig = Rig::new();
    let mut client = rig.raw();
    client.send(|r| (r.enable_count, r.release_count) = (1, 1));
    let counts = rig.poll();
    assert_eq!((counts.held.enable_level, counts.enable_edges, counts.release_edges), (false, 0, 1));
    // The client released and pressed between two heartbeats. Both edges count, and it holds the enable.
    client.send(|r| (r.enable_level, r.enable_count, r.release_count) = (1, 2, 2));
    let counts = rig.poll();
    assert_eq!((counts.held.enable_level, counts.enable_edges, counts.release_edges), (true, 1, 2));
}

#[test]
fn holder_that_disconnects_or_falls_silent_loses_enable() {
    let mut rig = Rig::new();
    let mut client = rig.raw();
    client.press();
    rig.poll();
    drop(client);
    let counts = rig.poll();
    assert_eq!(
        (counts.held.enable_level, counts.release_edges, counts.holders_lost, counts.connections),
        (false, 0, 1, 0)
    );

    let mut client = rig.raw();
    client.press();
    assert!(rig.poll().held.enable_level);
    let received = rig.now;
    rig.now = Stamp(received.0 + LEASE_NS);
    assert!(rig.poll().held.enable_level, "a heartbeat as old as the lease is not too old");
    rig.now = Stamp(received.0 + LEASE_NS + 1);
    let counts = rig.poll();
    assert_eq!((counts.held.enable_level, counts.held.heartbeat_received, counts.holders_lost), (false, received, 2));
    client.send(|_| {});
    assert!(!rig.poll().held.enable_level, "after a lapse it takes a new edge");
    client.press();
    assert!(rig.poll().held.enable_level);
}

#[test]
fn last_request_of_client_that_left_replies_unread_counts() {
    let mut rig = Rig::new();
    let mut client = rig.raw();
    client.send(|_| {});
    rig.poll();
    client.send(|r| r.estop_count += 1);
    drop(client);
    let counts = rig.poll();
    assert_eq!((counts.estop_edges, counts.connections), (1, 0));
}

#[test]
fn invalid_request_is_refused_counted_and_disconnected() {
    let rig = &mut Rig::new();
    let good = OperatorRequest { version: OPERATOR_VERSION, sequence: 1, ..OperatorRequest::ZERO };
    let bytes = operator::encode_request(&good);
    let long = [0_u8; REQUEST_BYTES * 40];
    let old = operator::encode_request(&OperatorRequest { version: OPERATOR_VERSION + 1, ..good });
    let level = operator::encode_request(&OperatorRequest { enable_level: 7, ..good });
    let stuck = operator::encode_request(&OperatorRequest { sequence: 0, ..good });
    let back = operator::encode_request(&OperatorRequest { reset_count: u32::MAX, ..good });
    let nonsense: [&[u8]; 7] = [&bytes[..31], &bytes[..1], &long, &old, &level, &stuck, &back];
    for (count, bytes) in nonsense.into_iter().enumerate() {
        let client = rig.raw();
        client.send_bytes(bytes);
        let counts = rig.poll();
        assert_eq!((counts.requests_refused, counts.connections), (count as u64 + 1, 0), "{} bytes", bytes.len());
        assert_eq!((counts.reset_edges, counts.held.enable_level), (0, false));
    }
}

#[test]
fn full_server_drops_idlest_client_and_never_holder() {
    let mut rig = Rig::new();
    let mut clients: Vec<Raw> = (0..CLIENTS_MAX).map(|_| rig.raw()).collect();
    clients.iter_mut().for_each(|client| client.send(|_| {}));
    clients[0].press();
    assert_eq!(rig.poll().connections, CLIENTS_MAX as u32);
    // Fifteen busy clients do not keep an emergency stop out, and the last request of the displaced one counts.
    rig.now = Stamp(rig.now.0 + 20_000_000);
    clients.iter_mut().skip(2).for_each(|client| client.send(|_| {}));
    rig.poll();
    rig.now = Stamp(rig.now.0 + 10_000_000);
    clients[1].send(|r| r.reset_count += 1);
    let mut late = rig.raw();
    late.send(|r| r.estop_count += 1);
    let counts = rig.poll();
    let seen = (
        counts.connections,
        counts.connections_refused,
        counts.estop_edges,
        counts.reset_edges,
        counts.held.enable_level,
    );
    assert_eq!(seen, (CLIENTS_MAX as u32, 0, 1, 1, true));
    // One of a waiting crowd gets in. A stop of the others counts, and nothing else.
    let mut crowd: Vec<Raw> = (0..8).map(|_| rig.raw()).collect();
    crowd.iter_mut().for_each(|client| client.send(|r| (r.estop_count, r.reset_count, r.release_count) = (1, 1, 1)));
    let counts = rig.poll();
    let seen = (
        counts.connections_refused,
        counts.estop_edges,
        counts.reset_edges,
        counts.release_edges,
        counts.held.enable_level,
    );
    assert_eq!(seen, (7, 9, 2, 1, false));
    // A stop counts in a later request than the first, too.
    let mut crowd: Vec<Raw> = (0..8).map(|_| rig.raw()).collect();
    crowd.iter_mut().for_each(|client| {
        client.send(|_| {});
        client.send(|r| r.estop_count += 1);
    });
    assert_eq!(rig.poll().estop_edges, 9 + 8);
}

/// A stop counts from a client that loses its place in the same round. An enable that it pressed there passes to
/// nobody.
#[test]
fn displaced_client_loses_enable_but_its_stop_counts() {
    let (mut rig, mut clients) = Rig::with_forgotten(CLIENTS_MAX - 1, 2);
    // One place is free, so no client is served before the server accepts.
    clients[0].send(|r| r.estop_count += 1);
    clients[1].press();
    let _crowd: Vec<Raw> = (0..3).map(|_| rig.raw()).collect();
    let counts = rig.poll();
    assert_eq!((counts.connections_refused, counts.estop_edges, counts.enable_edges), (0, 1, 1));
    assert_eq!((counts.held.enable_level, counts.holders_lost), (false, 1));
}

#[test]
fn idle_clients_are_dropped_for_as_many_new_clients() {
    let (mut rig, _clients) = Rig::with_forgotten(CLIENTS_MAX, 3);
    let mut crowd: Vec<Raw> = (0..3).map(|_| rig.raw()).collect();
    crowd.iter_mut().for_each(|client| client.send(|r| r.estop_count += 1));
    let counts = rig.poll();
    assert_eq!((counts.connections, counts.connections_refused, counts.estop_edges), (CLIENTS_MAX as u32, 0, 3));
}

#[test]
fn client_gets_status_for_each_heartbeat() {
    let mut rig = Rig::new();
    let mut client = Client::connect(&rig.path).unwrap();
    let asking = std::thread::spawn(move || {
        client.enable();
        let first = client.heartbeat();
        let second = client.reset().heartbeat();
        (client, first, second)
    });
    while !asking.is_finished() {
        rig.poll();
        std::thread::yield_now();
    }
    let (_client, first, second) = asking.join().unwrap();
    assert_eq!((first.unwrap().k, second.unwrap().operators), (42, 1));
    let counts = rig.poll();
    assert_eq!((counts.enable_edges, counts.reset_edges, counts.held.enable_level), (1, 1, true));
}

#[test]
fn late_reply_is_dropped_by_next_request() {
    let mut rig = Rig::new();
    let mut client = Client::connect_within(&rig.path, 20).unwrap();
    assert!(matches!(client.heartbeat(), Err(OperatorError::Timeout { timeout_ms: 20, .. })));
    rig.poll();
    assert!(matches!(client.heartbeat(), Err(OperatorError::Timeout { .. })), "the reply to the first is dropped");
    drop(rig);
    let error = client.heartbeat().unwrap_err();
    assert!(matches!(error, OperatorError::Closed { .. } | OperatorError::Timeout { .. }), "{error}");
}

#[test]
fn payload_of_each_hand_is_newest_report_of_any_client() {
    let mut rig = Rig::new();
    let mut clients = [rig.raw(), rig.raw()];
    let send = |client: &mut Raw, flags: u32, kg: f64| {
        client.send(|r| (r.payload_count, r.payload_flags, r.payload_kg) = (r.payload_count + 1, flags, kg));
    };
    send(&mut clients[0], 0, 0.5);
    send(&mut clients[1], payload_flag::RIGHT | payload_flag::CENTRE, 0.25);
    let order = |mass_kg, centre_m| Some(PayloadOrder { mass_kg, centre_m });
    let counts = rig.poll();
    assert_eq!((counts.payload_edges, counts.held.payload), ([1, 1], [order(0.5, None), order(0.25, Some([0.0; 3]))]));
    assert!(!counts.held.enable_level && counts.enable_edges == 0);
    send(&mut clients[1], 0, 0.75);
    clients[0].send(|_| {});
    let counts = rig.poll();
    assert_eq!((counts.payload_edges, counts.held.payload[0]), ([2, 1], order(0.75, None)));
}

#[test]
fn while_nobody_answers_only_a_stop_counts_and_its_reply_comes_with_the_next_request() {
    let mut rig = Rig::new();
    let (mut holder, idle) = (rig.raw(), rig.raw());
    holder.press();
    assert!(rig.poll().held.enable_level);
    holder.send(|_| ());
    let latched = Status { latched: 7, ..Status::ZERO };
    let before = rig.server.poll_stops(rig.now, Some(&latched), true);
    assert!(!before.held.enable_level && !holder.is_kept() && !idle.is_kept(), "all connections end");
    let (mut holder, mut presser) = (rig.raw(), rig.raw());
    rig.server.poll_stops(rig.now, None, false);
    holder.press();
    presser.send(|r| r.estop_count += 1);
    let counts = rig.server.poll_stops(rig.now, Some(&latched), false);
    assert_eq!((counts.estop_edges, counts.held.enable_level), (1, false));
    assert!(!holder.is_kept(), "an enable has no place here");
    assert_eq!(presser.reply(), None, "a stop that was heard is not this one");
    presser.send(|_| ());
    rig.server.poll_stops(rig.now, None, false);
    assert_eq!(presser.reply(), None);
    presser.send(|_| ());
    let counts = rig.server.poll_stops(rig.now, Some(&latched), false);
    assert_eq!((presser.reply(), counts.estop_edges), (Some(7), 1));
    rig.now = Stamp(rig.now.0 + 1_000_000_000);
    rig.server.poll_stops(rig.now, None, false);
    assert!(!presser.is_kept(), "a client that fell silent");
}
