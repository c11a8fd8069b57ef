//! The operator socket. Connections come and go and send any bytes to a server that is polled.

use crate::bytes::Bytes;
use messages::{HOLDS_ENABLE, Layout, OPERATOR_VERSION, OperatorRequest, Stamp, Status};
use operator::{CLIENTS_MAX, LEASE_NS, OperatorCounts, REQUEST_BYTES, Server};
use rustix::net::{AddressFamily, SendFlags, SocketAddrUnix, SocketFlags, SocketType};
use std::os::fd::OwnedFd;
use std::path::Path;

/// Connections that the input may open at once: more than the server accepts.
const SOCKETS: usize = CLIENTS_MAX + 2;
const STEPS_MAX: usize = 128;

struct Peer {
    socket: OwnedFd,
    request: OperatorRequest,
}

impl Peer {
    fn connect(path: &Path) -> Option<Self> {
        let flags = SocketFlags::NONBLOCK | SocketFlags::CLOEXEC;
        let socket = rustix::net::socket_with(AddressFamily::UNIX, SocketType::SEQPACKET, flags, None).ok()?;
        rustix::net::connect(&socket, &SocketAddrUnix::new(path).ok()?).ok()?;
        Some(Self { socket, request: OperatorRequest { version: OPERATOR_VERSION, ..OperatorRequest::ZERO } })
    }

    /// The server may have closed this peer, or may not read fast enough. Both are fine.
    fn send(&self, bytes: &[u8]) {
        let _ = rustix::net::send(&self.socket, bytes, SendFlags::DONTWAIT | SendFlags::NOSIGNAL);
    }
}

/// Runs the input. Each step is an action, a peer, and the data that the action needs.
pub(crate) fn run(input: &[u8]) {
    codec(input);
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("control.sock");
    let mut server = Server::bind(&path).expect("a socket in a folder of its own");
    let mut peers: [Option<Peer>; SOCKETS] = [const { None }; SOCKETS];
    let mut now = Stamp(1_000_000_000);
    let mut last = OperatorCounts::default();
    let mut bytes = Bytes::new(input);
    for _ in 0..STEPS_MAX {
        if bytes.is_empty() {
            break;
        }
        let (action, who) = (bytes.u8() % 8, usize::from(bytes.u8()) % SOCKETS);
        match (action, &mut peers[who]) {
            (0, peer) => *peer = None,
            (1, Some(peer)) => {
                let length = usize::from(bytes.u8());
                peer.send(bytes.take(length));
            }
            (2 | 3, Some(peer)) => {
                change(&mut peer.request, &mut bytes);
                peer.send(&operator::encode_request(&peer.request));
            }
            (4, Some(peer)) => {
                let request = &mut peer.request;
                (request.enable_level, request.enable_count) = (HOLDS_ENABLE, request.enable_count.wrapping_add(1));
                request.sequence = request.sequence.wrapping_add(1);
                peer.send(&operator::encode_request(&peer.request));
            }
            (1..=4, peer) => *peer = Peer::connect(&path),
            _ => {
                now = Stamp(now.0.saturating_add(if action == 5 { bytes.u64() } else { 666_667 }));
                let counts = server.poll(now, &Status::ZERO);
                check(now, &last, &counts);
                last = counts;
            }
        }
    }
}

/// Checks that decoding is the inverse of encoding, for any bytes.
fn codec(input: &[u8]) {
    if let Some(request) = operator::decode_request(input) {
        assert_eq!(operator::encode_request(&request), input);
    }
    if let Some(status) = operator::decode_status(input) {
        assert_eq!(operator::encode_status(&status), input);
    }
    let head = &input[..input.len().min(REQUEST_BYTES)];
    assert!(head.len() == REQUEST_BYTES || operator::decode_request(head).is_none(), "a short request was read");
}

fn change(request: &mut OperatorRequest, bytes: &mut Bytes<'_>) {
    request.sequence = request.sequence.wrapping_add(1);
    let (field, value) = (bytes.u8(), u32::from(bytes.u8()));
    let step = |count: &mut u32| *count = count.wrapping_add(value);
    match field % 10 {
        0 => request.enable_level = value % 4,
        1 => step(&mut request.enable_count),
        2 => step(&mut request.release_count),
        3 => step(&mut request.reset_count),
        4 => step(&mut request.estop_count),
        5 => request.sequence = bytes.u64(),
        6 => request.enable_count = bytes.u32(),
        7 => step(&mut request.payload_count),
        8 => (request.payload_flags, request.payload_kg) = (value % 5, f64::from_bits(bytes.u64())),
        _ => request.version = value,
    }
}

/// Invariants after every poll.
fn check(now: Stamp, last: &OperatorCounts, counts: &OperatorCounts) {
    assert!(counts.connections as usize <= CLIENTS_MAX);
    assert!(!(counts.held.enable_level && counts.held.recover_level), "both are held");
    if counts.held.enable_level || counts.held.recover_level {
        assert!(now.since(counts.held.heartbeat_received) <= LEASE_NS, "held beyond the lease");
    }
    let increasing = |v: &OperatorCounts| {
        [v.enable_edges, v.recover_edges, v.release_edges, v.reset_edges, v.estop_edges, v.holders_lost]
    };
    for (hand, reported) in counts.held.payload.iter().enumerate() {
        assert!(last.payload_edges[hand] <= counts.payload_edges[hand], "{last:?} {counts:?}");
        assert_eq!(reported.is_some(), counts.payload_edges[hand] > 0, "{counts:?}");
        assert!(reported.is_none_or(|reported| reported.mass_kg.is_finite()), "{counts:?}");
    }
    assert!(increasing(last).iter().zip(increasing(counts)).all(|(last, now)| *last <= now), "{last:?} {counts:?}");
    let pressed = counts.enable_edges > last.enable_edges || counts.recover_edges > last.recover_edges;
    let held = |v: &OperatorCounts| v.held.enable_level || v.held.recover_level;
    assert!(held(last) || !held(counts) || pressed, "held without an edge");
}
