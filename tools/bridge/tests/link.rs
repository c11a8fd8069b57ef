//! Both ends of a link as real processes over the loopback, between clients and the sockets of a daemon. The daemon is its
//! two socket servers, which merge requests and check frames as `control` and `ingest` do.

mod cable;
mod relay;
mod router;
mod trust;

use bridge::link::{Keys, Wire, config, key};
use doors::{LeaseState, Reply};
use harness::{Killed, Pace, holds_for, wait_until, within};
use messages::{Fault, Faults, Feedback, Header, Layout, Message, Mode, RawSkeleton, Stamp, Status};
use operator::{OperatorCounts, OperatorSession};
use rt::Background;
use std::io::{BufRead, BufReader};
use std::net::UdpSocket;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// Generous: the machine may be busy.
const SOON: Duration = Duration::from_secs(20);

/// Everything that reached the daemon.
#[derive(Default)]
struct Seen {
    counts: OperatorCounts,
    /// Emergency stops that were reset.
    stops_reset: u64,
    persons: u64,
    /// Another client leads the robot.
    led_by_other: bool,
    /// The greatest age of a person when the robot's end accepted it, us: true, as all clients are on this machine.
    oldest_us: u32,
}

impl Seen {
    fn is_stopped(&self) -> bool {
        self.counts.estop_edges > self.stops_reset
    }
}

/// A person who is seen now. The robot's end writes its own origin, so the number of the person has the true one.
fn person(sequence: u64) -> RawSkeleton {
    let now = rt::now();
    let header = Header { sequence, stamp: now, origin: now, ..Header::ZERO };
    RawSkeleton { header, operator_id: low_us(now), joint_count: 24, ..RawSkeleton::ZERO }
}

/// A time, us, without its high bits. They change every 71 minutes.
fn low_us(at: Stamp) -> u32 {
    (at.0 / 1000) as u32
}

/// The sockets of a daemon.
struct Daemon {
    folder: tempfile::TempDir,
    seen: Arc<Mutex<Seen>>,
    _thread: Background,
}

impl Daemon {
    fn start() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let mut control = operator::Server::bind(folder.path().join("operator.sock")).expect("a socket");
        let mut ingest = doors::Server::bind(&folder.path().join("skeleton.sock"), None).expect("a socket");
        let seen = Arc::new(Mutex::new(Seen::default()));
        let of_thread = Arc::clone(&seen);
        let serve = Background::start("daemon", move |ends| {
            let (mut k, mut pace) = (0, Pace::new(Duration::from_millis(1)));
            while !ends.load(Ordering::Relaxed) {
                k += 1;
                let now = rt::now();
                let header = Header { sequence: k / 20, stamp: now, ..Header::ZERO };
                let mut seen = of_thread.lock().expect("whole");
                let latched = Faults::NONE.with(Fault::EmergencyStop).0;
                let (mode, latched) = if seen.is_stopped() { (Mode::Faulted, latched) } else { (Mode::Holding, 0) };
                seen.counts = control.poll(now, &Status { header, mode: mode as u32, latched, ..Status::ZERO });
                ingest.poll(now, false, |_, frame| {
                    seen.persons += 1;
                    seen.oldest_us = seen.oldest_us.max(low_us(frame.header.stamp).wrapping_sub(frame.operator_id));
                    if seen.led_by_other { LeaseState::NotHolder } else { LeaseState::Holder }
                });
                drop(seen);
                ingest.feed_back(&Feedback { header, mode: 3, ..Feedback::ZERO });
                pace.wait();
            }
        });
        Self { folder, seen, _thread: serve.expect("a thread") }
    }

    fn counts(&self) -> OperatorCounts {
        self.seen.lock().expect("whole").counts
    }

    fn persons(&self) -> u64 {
        self.seen.lock().expect("whole").persons
    }

    fn is_held(&self) -> bool {
        self.counts().held.enable_level
    }

    /// Returns true if nothing is held, and nothing was pressed since there were so many presses.
    fn is_released(&self, presses: u64) -> bool {
        !self.is_held() && self.counts().enable_edges == presses
    }
}

/// A process of `teleop-bridge link` and its lines.
pub(crate) struct End {
    _child: Killed,
    lines: Arc<Mutex<Vec<String>>>,
}

impl End {
    pub(crate) fn start(arguments: &[&str]) -> Self {
        Self::start_by(Command::new(env!("CARGO_BIN_EXE_teleop-bridge")), arguments)
    }

    fn start_by(mut program: Command, arguments: &[&str]) -> Self {
        let mut child = program.arg("link").args(arguments).stdout(Stdio::piped()).spawn().expect("it starts");
        let (lines, output) = (Arc::new(Mutex::new(Vec::new())), child.stdout.take().expect("its output"));
        let of_thread = Arc::clone(&lines);
        std::thread::spawn(move || {
            for line in BufReader::new(output).lines().map_while(Result::ok) {
                of_thread.lock().expect("whole").push(line);
            }
        });
        Self { _child: Killed(child), lines }
    }

    fn wait_line(&self, what: &str) {
        wait_until(what, || self.lines.lock().expect("whole").iter().any(|line| line.contains(what)));
    }
}

fn bridge(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_teleop-bridge")).arg("link").args(arguments).output().expect("it runs")
}

/// A robot with its keys, its daemon and its end of the link.
struct World {
    daemon: Daemon,
    keys: tempfile::TempDir,
    address: String,
    robot: End,
}

impl World {
    fn new(operators: &[&str]) -> Self {
        Self::at("127.0.0.1", operators)
    }

    /// A robot whose end listens at this address.
    fn at(host: &str, operators: &[&str]) -> Self {
        let keys = keys("tiago", operators);
        let daemon = Daemon::start();
        let port = UdpSocket::bind((host, 0)).and_then(|socket| socket.local_addr()).expect("a port").port();
        let address = format!("quic/{host}:{port}");
        let robot = robot_end(&keys, "--listen", &address, &daemon);
        robot.wait_line("admits");
        Self { daemon, keys, address, robot }
    }

    fn bundle(&self, name: &str) -> PathBuf {
        self.keys.path().join(format!("{name}.bundle"))
    }

    fn operator(&self, bundle: &Path, folder: &Path) -> End {
        self.operator_by(Command::new(env!("CARGO_BIN_EXE_teleop-bridge")), bundle, folder)
    }

    fn operator_by(&self, program: Command, bundle: &Path, folder: &Path) -> End {
        let arguments = ["operator", "--bundle", text(bundle), "--connect", &self.address, "--run-dir", text(folder)];
        End::start_by(program, &arguments)
    }
}

/// Starts a robot's end that listens at the address or connects to it.
fn robot_end(keys: &tempfile::TempDir, way: &str, address: &str, daemon: &Daemon) -> End {
    End::start(&["robot", "--keys", text(keys.path()), way, address, "--run-dir", text(daemon.folder.path())])
}

pub(crate) fn text(path: &Path) -> &str {
    path.to_str().expect("text")
}

/// Makes a folder with the keys of a robot and the bundles of operators.
pub(crate) fn keys(robot: &str, operators: &[&str]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let made = bridge(&["pair", "robot", "--name", robot, "--keys", text(folder.path())]);
    assert!(made.status.success(), "{made:?}");
    for name in operators {
        let made = bridge(&["pair", "operator", "--name", name, "--keys", text(folder.path())]);
        assert!(made.status.success(), "{made:?}");
    }
    folder
}

fn opened(settings: &serde_json::Value) -> Wire {
    let shutdown = rt::Shutdown::on_signals().expect("a handler");
    Wire::open(settings, &shutdown, || ()).expect("a session").expect("no signal")
}

/// Connects an operator's client once the socket is there.
fn connect(folder: &Path) -> OperatorSession {
    let socket = folder.join("operator.sock");
    let mut session = None;
    wait_until("the robot answers", || {
        session = OperatorSession::connect(&socket).ok();
        session.is_some()
    });
    session.expect("it answers")
}

/// A client that publishes a person at 50 Hz until it is dropped, and counts feedback.
fn publisher(folder: &Path) -> (Background, Arc<AtomicU64>) {
    let socket = folder.join("skeleton.sock");
    let felt = Arc::new(AtomicU64::new(0));
    let count = Arc::clone(&felt);
    let open = || doors::Client::attach_with_feedback(socket);
    let client = Background::opened("client", open, move |mut client, ends| {
        let (mut sequence, mut pace) = (0, Pace::new(Duration::from_millis(20)));
        while !ends.load(Ordering::Relaxed) {
            sequence += 1;
            if client.publish(&person(sequence)).is_err() {
                break;
            }
            let is_felt = client.feedback().is_some_and(|feedback| feedback.mode == 3);
            count.fetch_add(u64::from(is_felt), Ordering::Relaxed);
            pace.wait();
        }
    });
    (client.expect("the skeleton socket answers"), felt)
}

/// Waits until this many more persons have arrived.
fn follows(world: &World, what: &str, count: u64) {
    let before = world.daemon.persons();
    wait_until(what, || world.daemon.persons() > before + count);
}

/// The most that the robot's end accepts is 100 ms.
fn assert_none_was_old(world: &World) {
    let oldest_us = world.daemon.seen.lock().expect("whole").oldest_us;
    assert!(oldest_us <= 100_000, "{oldest_us} us");
}

#[test]
fn client_hears_that_another_one_leads_the_robot() {
    let world = World::new(&["anna"]);
    let folder = tempfile::tempdir().expect("a folder");
    let _end = world.operator(&world.bundle("anna"), folder.path());
    let _hand = connect(folder.path());
    let mut client = doors::Client::attach(folder.path().join("skeleton.sock")).expect("it answers");
    for (led_by_other, word) in [(false, Reply::Holder), (true, Reply::NotHolder), (false, Reply::Holder)] {
        world.daemon.seen.lock().expect("whole").led_by_other = led_by_other;
        let mut sequence = 0;
        wait_until("the reply", || {
            sequence += 1;
            client.publish(&person(sequence)).expect("it is sent");
            client.last_reply() == word
        });
    }
}

#[test]
fn f130_stranger_and_operator_under_another_name_get_nothing() {
    let world = World::new(&["anna", "bert"]);
    let (stranger, wrong) = (keys("tiago", &["anna"]), tempfile::tempdir().expect("a folder"));
    // The certificate of anna, and the name of bert.
    let own = std::fs::read_to_string(world.bundle("anna")).expect("a bundle");
    let forged = wrong.path().join("forged.bundle");
    std::fs::write(&forged, own.replace("operator: anna", "operator: bert")).expect("written");
    std::fs::set_permissions(&forged, std::os::unix::fs::PermissionsExt::from_mode(0o600)).expect("its mode");
    let folders = [0; 3].map(|_| tempfile::tempdir().expect("a folder"));
    let bundles = [stranger.path().join("anna.bundle"), forged, world.bundle("bert")];
    let ends: Vec<_> =
        bundles.iter().zip(&folders).map(|(bundle, folder)| world.operator(bundle, folder.path())).collect();
    // The rightful one gets a session, though two others try in its name or in another's.
    let hand = connect(folders[2].path());
    world.robot.wait_line("bert: ready");
    press(&world, &hand);
    for end in &ends[..2] {
        end.wait_line("no answer");
    }
    let is_admitted =
        || folders[..2].iter().any(|folder| OperatorSession::connect(&folder.path().join("operator.sock")).is_ok());
    assert!(!within(Duration::from_secs(2), is_admitted));
    let lines = world.robot.lines.lock().expect("whole").join("\n");
    assert!(lines.contains("bert: ready") && !lines.contains("anna:") && !lines.contains("second program"), "{lines}");
}

/// Presses the enable until it arrives: a press in a session whose clocks are not synchronised yet does not count.
fn press(world: &World, hand: &OperatorSession) {
    wait_until("the enable arrives", || {
        hand.release();
        hand.enable();
        within(Duration::from_millis(300), || world.daemon.is_held())
    });
}

/// Sends 10,000 packets, half of which begin as datagrams of a link.
fn flood(to: &[bridge::link::Publisher; 2]) {
    let mut state = 7_u64;
    for n in 0..10_000_usize {
        // Knuth's MMIX generator.
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let mut bytes: Vec<u8> = state.to_le_bytes().into_iter().cycle().take((state >> 40) as usize % 1300).collect();
        if n % 4 < 2 {
            bytes.splice(..12.min(bytes.len()), *b"TPLK\x01\0\0\0\x01\0\0\0");
        }
        bridge::link::send(&to[n % 2], &bytes);
        if n % 50 == 0 {
            // The rate of the flood is the test's input.
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}

#[test]
fn f128_hostile_packets_of_one_operator_leave_another_undisturbed() {
    let world = World::new(&["anna", "bert"]);
    let folder = tempfile::tempdir().expect("a folder");
    let _end = world.operator(&world.bundle("bert"), folder.path());
    let hand = connect(folder.path());
    let _client = publisher(folder.path());
    world.robot.wait_line("bert: ready");
    let own = Keys::read_operator(&world.bundle("anna")).expect("a bundle");
    let wire = opened(&config(&own, &[], std::slice::from_ref(&world.address)));
    let name = own.operator.as_ref().expect("a name");
    let to = ["operator", "person"].map(|what| wire.publisher(key(&own.robot, what, name)).expect("a publisher"));
    let before = world.daemon.persons();
    // A busy machine may cut the link by itself. A flood that cuts it does so every time.
    let undisturbed = (0..5).any(|_| {
        press(&world, &hand);
        let edges = world.daemon.counts().enable_edges;
        flood(&to);
        let counts = world.daemon.counts();
        assert_eq!(
            (counts.enable_edges, counts.estop_edges, counts.reset_edges),
            (edges, 0, 0),
            "nothing of it counts"
        );
        counts.held.enable_level
    });
    assert!(undisturbed);
    world.robot.wait_line("of a wrong length");
    wait_until("persons go on", || world.daemon.persons() > before + 20);
}

#[test]
fn keys_are_private_and_never_replaced() {
    let folder = keys("tiago", &["anna"]);
    for file in ["robot.pem", "authority-key.pem", "anna.bundle"] {
        let about = std::fs::metadata(folder.path().join(file)).expect("a file");
        assert_eq!(std::os::unix::fs::MetadataExt::mode(&about) & 0o777, 0o600, "{file}");
    }
    let keys = text(folder.path());
    for arguments in [["pair", "robot", "--name", "tiago"], ["pair", "operator", "--name", "anna"]] {
        let again = bridge(&[&arguments[..], &["--keys", keys]].concat());
        let text = String::from_utf8_lossy(&again.stderr).into_owned();
        assert!(again.status.code() == Some(73) && text.contains("never replaced"), "{text}");
    }
    let named = bridge(&["pair", "operator", "--name", "../anna", "--keys", keys]);
    assert!(String::from_utf8_lossy(&named.stderr).contains("a name has 1 to 32"), "{named:?}");
    let bundle = folder.path().join("anna.bundle");
    let shown = bridge(&["pair", "show", text(&bundle)]);
    let code = Keys::read_operator(&bundle).expect("a bundle").code();
    assert!(String::from_utf8_lossy(&shown.stdout).contains(&format!("operator anna of robot tiago, code {code}")));
    std::fs::set_permissions(&bundle, std::os::unix::fs::PermissionsExt::from_mode(0o644)).expect("its mode");
    let open = bridge(&["pair", "show", text(&bundle)]);
    assert!(String::from_utf8_lossy(&open.stderr).contains("chmod 600"), "{open:?}");
    let file = text(&bundle);
    for (address, run_dir, why) in [
        ("tcp/127.0.0.1:7447", keys, "not an address of a link"),
        ("quic/127.0.0.1", keys, "not an address of a link"),
        ("quic/127.0.0.1:70000", keys, "not an address of a link"),
        ("quic/127.0.0.1:7447", file, "not a folder"),
    ] {
        let refused = bridge(&["robot", "--keys", keys, "--listen", address, "--run-dir", run_dir]);
        let text = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert!(refused.status.code() == Some(64) && text.contains(why), "{text}");
    }
}

/// Reads one status as any program with a certificate can.
const PYTHON: &str = include_str!("status.py");

#[test]
fn python_peer_with_a_certificate_reads_the_status() {
    let there = Command::new("python3").args(["-c", "import zenoh"]).output().is_ok_and(|done| done.status.success());
    if !there {
        return println!("skipped: this Python has no eclipse-zenoh (pip install eclipse-zenoh==1.10.2)");
    }
    let world = World::new(&["anna"]);
    let own = Keys::read_operator(&world.bundle("anna")).expect("a bundle");
    let settings = config(&own, &[], std::slice::from_ref(&world.address)).to_string();
    let done = Command::new("python3").args(["-c", PYTHON, &settings]).output().expect("it runs");
    let expected = format!("{} {}\n", Status::VERSION, size_of::<Status>());
    assert_eq!(String::from_utf8_lossy(&done.stdout), expected, "{}", String::from_utf8_lossy(&done.stderr));
}
