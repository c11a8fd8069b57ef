//! The skeleton socket: admission, refusals, and protection of each client from the others.

use doors::{
    BURST, CONNECTIONS_MAX, Client, DoorError, FRAME_BYTES, FrameSource, HELLO_WITHIN_NS, Hello, IDLE_NS, LeaseState,
    POLICY_HELLO, Reply, ReplyPacket, Server, encode_frame,
};
use messages::{Feedback, Joints, Layout, RawSkeleton, Stamp};
use rustix::io::Errno;
use rustix::net::{AddressFamily, RecvFlags, SendFlags, SocketAddrUnix, SocketType};
use std::os::fd::OwnedFd;
use std::path::PathBuf;
use tempfile::TempDir;

const MS: u64 = 1_000_000;

/// A server whose clock stands still unless a test moves it. The first session that publishes holds the lease.
struct House {
    folder: TempDir,
    server: Server,
    now: Stamp,
    holder: Option<u64>,
    used: Vec<(FrameSource, u64)>,
}

impl House {
    fn new() -> Self {
        let folder = TempDir::new().unwrap();
        let server = Server::bind(&folder.path().join("skeleton.sock"), None).unwrap();
        Self { folder, server, now: Stamp(1_000_000_000), holder: None, used: Vec::new() }
    }

    fn path(&self) -> PathBuf {
        self.folder.path().join("skeleton.sock")
    }

    fn poll(&mut self) {
        let (holder, used) = (&mut self.holder, &mut self.used);
        self.server.poll(self.now, holder.is_some(), |from, frame| {
            used.push((from, frame.header.sequence));
            let holds = *holder.get_or_insert(from.session_nonce) == from.session_nonce;
            if holds { LeaseState::Holder } else { LeaseState::NotHolder }
        });
    }

    fn later(&mut self, ns: u64) {
        self.now = self.now.plus_ns(ns);
        self.poll();
    }

    fn raw(&self) -> Raw {
        let socket = rustix::net::socket(AddressFamily::UNIX, SocketType::SEQPACKET, None).unwrap();
        rustix::net::connect(&socket, &SocketAddrUnix::new(self.path()).unwrap()).unwrap();
        Raw { socket, nonce: 0, sequence: 0 }
    }

    fn guest(&mut self) -> Raw {
        let mut raw = self.raw();
        raw.send(&Hello::OURS.encode());
        self.poll();
        self.poll();
        let answer = raw.answer().expect("an answer");
        assert!(matches!(answer.word, Reply::Granted | Reply::GrantedButHeld), "{answer:?}");
        raw.nonce = answer.session_nonce;
        raw
    }
}

struct Raw {
    socket: OwnedFd,
    nonce: u64,
    sequence: u64,
}

impl Raw {
    fn send(&self, bytes: &[u8]) {
        rustix::net::send(&self.socket, bytes, SendFlags::NOSIGNAL).unwrap();
    }

    fn frame(&mut self) -> Result<usize, Errno> {
        let mut frame = RawSkeleton { session_nonce: self.nonce, ..RawSkeleton::ZERO };
        frame.header.sequence = self.sequence + 1;
        let flags = SendFlags::NOSIGNAL | SendFlags::DONTWAIT;
        let sent = rustix::net::send(&self.socket, &encode_frame(&frame), flags);
        self.sequence += u64::from(sent.is_ok());
        sent
    }

    fn answer(&self) -> Option<ReplyPacket> {
        let mut bytes = [0; 64];
        for _ in 0..2 {
            match rustix::net::recv(&self.socket, &mut bytes[..], RecvFlags::DONTWAIT) {
                Ok((length, _)) => return ReplyPacket::decode(&bytes[..length]),
                Err(Errno::CONNRESET) => {}
                Err(_) => return None,
            }
        }
        None
    }

    fn last_reply(&self) -> Option<Reply> {
        std::iter::from_fn(|| self.answer()).last().map(|answer| answer.word)
    }

    fn is_closed(&self) -> bool {
        let mut byte = [0; 64];
        loop {
            match rustix::net::recv(&self.socket, &mut byte[..], RecvFlags::DONTWAIT) {
                Ok((0, _)) => return true,
                Err(Errno::AGAIN) => return false,
                Err(Errno::CONNRESET) | Ok(_) => {}
                Err(errno) => panic!("{errno}"),
            }
        }
    }
}

#[test]
fn f070_every_connection_gets_its_own_nonzero_session_number() {
    let mut house = House::new();
    let mut seen: Vec<u64> = (0..100).map(|_| house.guest().nonce).collect();
    assert!(seen.iter().all(|&nonce| nonce != 0));
    seen.sort_unstable();
    seen.dedup();
    assert_eq!(seen.len(), 100);
}

#[test]
fn f068_second_client_gets_not_holder_reply_twice_a_second() {
    let mut house = House::new();
    let (mut first, mut second) = (house.guest(), house.guest());
    let mut replies = Vec::new();
    for _ in 0..100 {
        first.frame().unwrap();
        house.later(10 * MS);
        second.frame().unwrap();
        house.later(10 * MS);
        replies.extend(second.answer().map(|answer| answer.word));
    }
    assert_eq!(first.last_reply(), Some(Reply::Holder));
    assert_eq!(replies, [Reply::NotHolder; 4], "in two seconds");
    assert_eq!(house.used.len(), 200);
    let third = house.raw();
    third.send(&Hello::OURS.encode());
    house.poll();
    house.poll();
    assert_eq!(third.last_reply(), Some(Reply::GrantedButHeld));
}

#[test]
fn f068_client_with_forged_session_number_is_disconnected() {
    let mut house = House::new();
    let (mut holder, mut forger) = (house.guest(), house.guest());
    holder.frame().unwrap();
    house.poll();
    forger.nonce = holder.nonce;
    forger.frame().unwrap();
    house.poll();
    assert_eq!(forger.last_reply(), Some(Reply::ForgedSession));
    assert!(forger.is_closed());
    assert_eq!(house.used.len(), 1, "nothing of it went through");
}

#[test]
fn f018_f111_client_with_invalid_hello_or_frame_is_disconnected() {
    let mut house = House::new();
    // The bytes of an engage request of the operator's socket: a version, a level, counters.
    let mut engage = [0; 32];
    (engage[0], engage[4], engage[8], engage[24]) = (1, 1, 1, 1);
    let other = Hello { layout: 1, ..Hello::OURS };
    let openings: [(&[u8], Reply); 5] = [
        (&engage, Reply::NoHello),
        (b"x", Reply::NoHello),
        (&[0; 65536], Reply::NoHello),
        (&other.encode(), Reply::OtherLayout),
        (&encode_frame(&RawSkeleton::ZERO), Reply::NoHello),
    ];
    for (bytes, word) in openings {
        let raw = house.raw();
        raw.send(bytes);
        house.poll();
        house.poll();
        assert_eq!(raw.last_reply(), Some(word));
        assert!(raw.is_closed());
    }
    for bytes in [&engage[..], &[0; FRAME_BYTES - 1], &[0; FRAME_BYTES + 1], &[0; 65536]] {
        let guest = house.guest();
        guest.send(bytes);
        house.poll();
        assert_eq!(guest.last_reply(), Some(Reply::WrongSize));
        assert!(guest.is_closed());
    }
    assert_eq!((house.used.len(), house.server.connections()), (0, 0));
    assert_eq!(house.server.reply_count(Reply::WrongSize), 4);
}

#[test]
fn f088_ninth_client_is_refused_until_half_open_ones_time_out() {
    let mut house = House::new();
    let silent: Vec<_> = (0..CONNECTIONS_MAX).map(|_| (house.raw(), house.poll()).0).collect();
    let ninth = house.raw();
    house.poll();
    assert_eq!(ninth.last_reply(), Some(Reply::Full));
    house.later(HELLO_WITHIN_NS + 1);
    assert!(silent.iter().all(|raw| raw.last_reply() == Some(Reply::Late) && raw.is_closed()));
    house.guest();
}

#[test]
fn f088_idle_client_is_dropped_for_new_one_and_busy_ones_stay() {
    let mut house = House::new();
    let mut guests: Vec<_> = (0..CONNECTIONS_MAX).map(|_| house.guest()).collect();
    for _ in 0..60 {
        for guest in &mut guests[1..] {
            guest.frame().unwrap();
        }
        house.later(IDLE_NS / 50);
    }
    let late = house.raw();
    late.send(&Hello::OURS.encode());
    house.poll();
    house.poll();
    assert_eq!(late.last_reply(), Some(Reply::GrantedButHeld));
    assert_eq!(guests[0].last_reply(), Some(Reply::Idle));
    assert!(guests[1..].iter().all(|guest| !guest.is_closed()));
    let more = house.raw();
    house.poll();
    assert_eq!(more.last_reply(), Some(Reply::Full), "nobody else was idle");
}

#[test]
fn f088_holder_loses_no_frame_during_a_thousand_connects() {
    let mut house = House::new();
    let mut holder = house.guest();
    for round in 0..1000 {
        let raw = house.raw();
        if round % 3 == 0 {
            drop(raw);
        } else {
            raw.send(&[7; 100]);
        }
        holder.frame().unwrap();
        house.later(10 * MS);
    }
    assert_eq!(house.used.len(), 1000, "every frame of the holder was used in its round");
    house.poll();
    assert_eq!(house.server.connections(), 1);
    assert_eq!(holder.last_reply(), Some(Reply::Holder));
}

#[test]
fn f090_client_that_never_reads_replies_loses_no_frame() {
    let mut house = House::new();
    let (mut holder, mut deaf) = (house.guest(), house.guest());
    for _ in 0..3000 {
        deaf.frame().unwrap();
        holder.frame().unwrap();
        house.later(10 * MS);
    }
    assert_eq!(house.used.len(), 6000);
    assert!(!holder.is_closed());
}

#[test]
fn f023_flood_is_limited_to_250_hz_and_other_client_is_served() {
    let mut house = House::new();
    let (mut holder, mut flood) = (house.guest(), house.guest());
    holder.frame().unwrap();
    house.poll();
    let (mut newest, mut lagged) = (0, 0);
    // Ten seconds of 1 ms rounds. The flood fills the kernel's queue in each, the holder sends at 100 Hz.
    for round in 0..10_000_u64 {
        while flood.frame().is_ok() {}
        let holds = round % 10 == 0;
        if holds {
            holder.frame().unwrap();
        }
        let before = house.used.len();
        house.later(MS);
        let used = &house.used[before..];
        if holds {
            assert!(used.iter().any(|(from, _)| from.session_nonce == holder.nonce), "round {round}");
        }
        for (_, sequence) in used.iter().filter(|(from, _)| from.session_nonce == flood.nonce) {
            assert!(*sequence > newest, "never an older one after a newer one");
            newest = *sequence;
            lagged += u64::from(*sequence < flood.sequence - 40 && round > 100);
        }
    }
    let of = |nonce: u64| house.used.iter().filter(|(from, _)| from.session_nonce == nonce).count() as u64;
    assert_eq!(of(holder.nonce), 1001);
    let most = BURST + 2500;
    assert!((2300..=most).contains(&of(flood.nonce)), "{}", of(flood.nonce));
    assert_eq!(lagged, 0, "what is used is what the kernel's queue held last");
    assert!(house.server.over_quota() > 20_000, "{}", house.server.over_quota());
    assert_eq!(flood.last_reply(), Some(Reply::OverQuota));
    assert_eq!(holder.last_reply(), Some(Reply::Holder));
}

#[test]
fn f025_burst_of_delayed_frames_passes_in_order() {
    let mut house = House::new();
    let mut guest = house.guest();
    for _ in 0..8 {
        guest.frame().unwrap();
    }
    house.poll();
    let sequences: Vec<_> = house.used.iter().map(|(_, sequence)| *sequence).collect();
    assert_eq!(sequences, [1, 2, 3, 4, 5, 6, 7, 8]);
    assert_eq!(house.server.over_quota(), 0);
}

#[test]
fn client_attaches_publishes_and_gets_error_when_server_leaves() {
    let mut house = House::new();
    let path = house.path();
    let attaching = std::thread::spawn(move || Client::attach(path));
    while !attaching.is_finished() {
        house.poll();
        std::thread::yield_now();
    }
    let mut client = attaching.join().unwrap().unwrap();
    client.publish(&RawSkeleton::ZERO).unwrap();
    house.poll();
    client.listen().unwrap();
    assert_eq!((client.last_reply(), house.used.len()), (Reply::Holder, 1));
    assert_eq!(house.used[0].0.session_nonce, client.session_nonce());
    assert_eq!(house.used[0].0.peer.pid, std::process::id());
    let path = house.path();
    drop(house);
    let error = (0..3).find_map(|_| client.publish(&RawSkeleton::ZERO).err()).expect("nobody is there");
    assert!(matches!(error, DoorError::Closed { .. }), "{error}");
    assert!(matches!(Client::attach(path), Err(DoorError::NoSocket { .. })));
}

#[test]
fn feedback_reaches_the_client_that_requests_it_alone() {
    let mut house = House::new();
    let plain = house.guest();
    let path = house.path();
    let attached = std::thread::spawn(move || Client::attach_with_feedback(path));
    while !attached.is_finished() {
        house.poll();
    }
    let mut client = attached.join().unwrap().expect("a seat");
    assert_eq!(client.feedback(), None);
    let mut feedback = Feedback { clearance_m: [0.25, 0.5], ..Feedback::ZERO };
    feedback.set_sentence("The robot follows.");
    house.server.feed_back(&Feedback::ZERO);
    house.server.feed_back(&feedback);
    client.listen().unwrap();
    assert_eq!(client.feedback(), Some(&feedback), "the newest one");
    assert_eq!(plain.answer(), None, "an old client hears nothing that it does not know");
    // A client that never reads loses feedback, and disturbs nobody.
    (0..1000).for_each(|_| house.server.feed_back(&feedback));
    client.publish(&RawSkeleton::ZERO).unwrap();
    house.poll();
    assert_eq!(house.used.len(), 1);
    // What waits for a late client is a few packets, less than half a second.
    let raw = house.raw();
    raw.send(&Hello { requests: doors::REQUESTS_FEEDBACK, ..Hello::OURS }.encode());
    (0..3).for_each(|_| house.poll());
    (0..1000).for_each(|_| house.server.feed_back(&feedback));
    let mut bytes = [0; 1024];
    let waiting = std::iter::from_fn(|| rustix::net::recv(&raw.socket, &mut bytes[..], RecvFlags::DONTWAIT).ok());
    let waiting = waiting.count();
    assert!((2..=10).contains(&waiting), "{waiting} packets");
}

#[test]
fn f023_policy_gets_joints_and_answers_and_messages_beyond_the_rate_are_dropped() {
    let mut house = House::new();
    let refused = house.raw();
    refused.send(POLICY_HELLO);
    (0..2).for_each(|_| house.poll());
    assert_eq!(refused.last_reply(), Some(Reply::NoHello), "a link's end admits no policy");
    house.server = house.server.with_policies();
    let policy = house.raw();
    policy.send(POLICY_HELLO);
    (0..2).for_each(|_| house.poll());
    house.server.send_joints(&Joints::ZERO, &["a".to_owned()]);
    (0..5).for_each(|_| policy.send(b"a chunk"));
    let mut used = Vec::new();
    for round in 0..20 {
        policy.send(b"a chunk");
        house.server.poll_policies(house.now, |_, text| {
            used.push((round, text.is_some()));
            Some("an answer".to_owned())
        });
    }
    assert!(used.iter().copied().eq((0..BURST).map(|round| (round, true)).chain([(BURST, false); 6])), "{used:?}");
    let mut bytes = [0; 4096];
    let heard = std::iter::from_fn(|| rustix::net::recv(&policy.socket, &mut bytes[..], RecvFlags::DONTWAIT).ok());
    assert_eq!(heard.count(), 1 + used.len());
    assert_eq!(bytes[..9], *b"an answer");
    drop(policy);
    house.later(MS * 100);
    (0..4).for_each(|_| house.server.poll_policies(house.now, |_, _| None));
    assert_eq!(house.server.connections(), 0);
}
