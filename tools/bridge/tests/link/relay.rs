//! Both ends with a UDP relay between them that delays, reorders, loses and breaks the wire, from a seed.

use super::*;
use operator::StopPress;
use std::net::SocketAddr;
use std::sync::atomic::AtomicBool;

/// Faults of the wire, the same in both ways.
#[derive(Clone, Copy, Default)]
struct Faults {
    delay_ms: u64,
    /// A datagram takes up to this much longer. So it may overtake others.
    jitter_ms: u64,
    loss_percent: u64,
    is_cut: bool,
}

/// A relay in front of the robot's end.
struct Relay {
    address: String,
    faults: Arc<Mutex<Faults>>,
    _thread: Background,
}

impl Relay {
    fn start(to: &str, faults: Faults) -> Self {
        let to: SocketAddr = to.strip_prefix("quic/").expect("an address").parse().expect("an address");
        let near = socket();
        let address = format!("quic/{}", near.local_addr().expect("its address"));
        let faults = Arc::new(Mutex::new(faults));
        let of_thread = Arc::clone(&faults);
        let thread = Background::start("relay", move |ends| carry(&near, to, &of_thread, ends));
        Self { address, faults, _thread: thread.expect("a thread") }
    }

    fn set(&self, faults: Faults) {
        *self.faults.lock().expect("whole") = faults;
    }
}

fn socket() -> UdpSocket {
    let socket = UdpSocket::bind("127.0.0.1:0").expect("a port");
    socket.set_nonblocking(true).expect("its mode");
    socket
}

/// Carries datagrams until the end. Each address of an operator's end has a socket of its own towards the robot's.
fn carry(near: &UdpSocket, to: SocketAddr, faults: &Mutex<Faults>, until: &AtomicBool) {
    let mut peers: Vec<(SocketAddr, UdpSocket)> = Vec::new();
    let mut flying: Vec<(Instant, usize, bool, Vec<u8>)> = Vec::new();
    let (mut dice, mut bytes) = (20_261_127_u64, [0; 2048]);
    while !until.load(Ordering::Relaxed) {
        let now = faults.lock().expect("whole").to_owned();
        let mut send = |peer: usize, up: bool, bytes: &[u8]| {
            // Knuth's MMIX generator.
            dice = dice.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            if !now.is_cut && (dice >> 33) % 100 >= now.loss_percent {
                let jitter_us = (dice >> 20) % (now.jitter_ms * 1000 + 1);
                let due = Instant::now() + Duration::from_micros(now.delay_ms * 1000 + jitter_us);
                flying.push((due, peer, up, bytes.to_vec()));
            }
        };
        while let Ok((length, from)) = near.recv_from(&mut bytes) {
            let known = peers.iter().position(|(address, _)| *address == from);
            let peer = known.unwrap_or(peers.len());
            if known.is_none() {
                peers.push((from, socket()));
            }
            send(peer, true, &bytes[..length]);
        }
        for (n, (_, far)) in peers.iter().enumerate() {
            while let Ok((length, _)) = far.recv_from(&mut bytes) {
                send(n, false, &bytes[..length]);
            }
        }
        flying.sort_by_key(|(due, ..)| *due);
        let due = flying.partition_point(|(due, ..)| *due <= Instant::now());
        for (_, peer, up, bytes) in flying.drain(..due) {
            let (address, far) = &peers[peer];
            let _ = if up { far.send_to(&bytes, to) } else { near.send_to(&bytes, address) };
        }
        // The relay reads two sockets of each peer in turn. No wait covers them all.
        std::thread::sleep(Duration::from_micros(500));
    }
}

/// Presses until it arrives. A client whose connection ends with the link's session connects again.
pub fn engage(world: &World, folder: &Path) -> OperatorSession {
    let give_up = Instant::now() + SOON;
    loop {
        let hand = connect(folder);
        hand.enable();
        if within(Duration::from_millis(500), || world.daemon.is_held()) {
            return hand;
        }
        assert!(Instant::now() < give_up, "{:?}, {:?}", world.daemon.counts(), world.robot.lines);
    }
}

#[test]
fn f125_bad_wire_follows_and_partition_of_five_seconds_is_a_release_that_heals_unengaged() {
    harness::in_real_time(|| {
        let faults = Faults { delay_ms: 5, jitter_ms: 30, loss_percent: 5, is_cut: false };
        let mut world = World::new(&["anna"]);
        let relay = Relay::start(&world.address, faults);
        world.address.clone_from(&relay.address);
        let folder = tempfile::tempdir().expect("a folder");
        let _end = world.operator(&world.bundle("anna"), folder.path());
        world.robot.wait_line("anna: ready");
        let (_client, felt) = publisher(folder.path());
        let before = engage(&world, folder.path());
        follows(&world, "persons go on", 50);
        relay.set(Faults { is_cut: true, ..faults });
        wait_until("released", || !world.daemon.is_held());
        let edges = world.daemon.counts().enable_edges;
        assert!(holds_for(Duration::from_secs(5), || world.daemon.is_released(edges)), "by itself");
        assert!(before.is_cut_off(), "clients see that the link is cut");
        let persons = world.daemon.persons();
        relay.set(faults);
        // The connection is made again without anybody's help. The enable is not.
        wait_until("persons go on after it", || world.daemon.persons() > persons + 50);
        assert!(world.daemon.is_released(edges), "by itself");
        let after = engage(&world, folder.path());
        after.estop();
        wait_until("the emergency stop arrives", || world.daemon.counts().estop_edges >= 1);
        assert!(felt.load(Ordering::Relaxed) > 0, "feedback came back");
        assert_none_was_old(&world);
    });
}

#[test]
fn f127_long_way_engages_nothing_until_it_is_short() {
    harness::in_real_time(|| {
        for delay_ms in [50, 150] {
            let mut world = World::new(&["anna"]);
            let relay = Relay::start(&world.address, Faults { delay_ms, ..Faults::default() });
            world.address.clone_from(&relay.address);
            let folder = tempfile::tempdir().expect("a folder");
            let _end = world.operator(&world.bundle("anna"), folder.path());
            let socket = folder.path().join("operator.sock");
            let is_engaged = || {
                // Over such a distance the socket comes and goes.
                let hand = OperatorSession::connect(&socket).ok();
                hand.is_some_and(|hand| {
                    hand.enable();
                    within(Duration::from_millis(200), || world.daemon.counts().enable_edges > 0)
                })
            };
            assert!(!within(Duration::from_secs(5), is_engaged), "{delay_ms} ms");
            assert!(!world.robot.lines.lock().expect("whole").join("\n").contains(": ready"), "{delay_ms} ms");
            relay.set(Faults { delay_ms: 2, ..Faults::default() });
            world.robot.wait_line("anna: ready");
            engage(&world, folder.path());
        }
    });
}

/// Presses the emergency stop until it shows. Returns the times until the robot latched it and until it showed, ms.
fn stop(world: &World, folder: &Path) -> [u128; 2] {
    let (mut press, begun, mut latched) = (StopPress::new(&folder.join("operator.sock")), Instant::now(), None);
    let mut pace = Pace::new(Duration::from_millis(20));
    loop {
        let shown = press.step().is_ok_and(|status| status.is_some());
        let mut seen = world.daemon.seen.lock().expect("whole");
        latched = latched.or(seen.is_stopped().then(|| begun.elapsed().as_millis()));
        if let (true, Some(latched)) = (shown, latched) {
            seen.stops_reset = seen.counts.estop_edges;
            return [latched, begun.elapsed().as_millis()];
        }
        drop(seen);
        assert!(begun.elapsed() < SOON, "latched after {latched:?} ms, not shown");
        pace.wait();
    }
}

#[test]
fn emergency_stop_is_repeated_until_the_robot_answers() {
    let mut world = World::new(&["anna"]);
    let half = Faults { delay_ms: 5, jitter_ms: 5, loss_percent: 50, is_cut: false };
    let relay = Relay::start(&world.address, Faults { loss_percent: 0, ..half });
    world.address.clone_from(&relay.address);
    let folder = tempfile::tempdir().expect("a folder");
    let end = world.operator(&world.bundle("anna"), folder.path());
    end.wait_line("clients find the robot");
    // The first one is pressed before there is a session.
    println!("without a session, latched and answered after {:?} ms", stop(&world, folder.path()));
    relay.set(half);
    let count = std::env::var("TELEOPD_STOPS").map_or(5, |count| count.parse().expect("a count"));
    for _ in 0..count {
        println!("half of the datagrams lost, latched and answered after {:?} ms", stop(&world, folder.path()));
        wait_until("the status that showed it is gone", || {
            let client = operator::Client::connect(folder.path().join("operator.sock"));
            !client.and_then(|mut client| client.heartbeat()).is_ok_and(|status| status.latched != 0)
        });
    }
}
