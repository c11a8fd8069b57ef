//! All processes of teleopd with their simulated robot, led over a link by the clients of an operator's machine. Each end of
//! the link is killed, and the emergency stop is pressed.

use client::Transport;
use harness::{Harness, Killed, Operator, StateObserver, assert_no_violations, publisher, wait_until, within};
use messages::Mode;
use std::net::UdpSocket;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};
use std::time::Duration;

/// Time for which nothing may engage by itself.
const WATCHED: Duration = Duration::from_secs(2);
/// Presses of the enable at most.
const PRESSES: usize = 8;
/// Time between two looks at a robot that is led.
const HELD: Duration = Duration::from_millis(20);
/// A driver that the machine suspended goes on from the measured posture. The encoders' noise is far below this, rad or m.
const NOISE: f64 = 1e-3;
/// A joint that is this far from where it was has followed, rad or m.
const MOVED: f64 = 0.2;

/// A process of `teleop-bridge link`. At its end it cannot say goodbye.
struct End(Killed);

impl End {
    fn start(arguments: &[&str]) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_teleop-bridge"));
        Self(Killed(command.arg("link").args(arguments).stdout(Stdio::null()).spawn().expect("it starts")))
    }

    /// Suspends the process for longer than a session lasts without it, and for less than the lease of its person.
    fn pause(&self, length: Duration) {
        for signal in ["STOP", "CONT"] {
            harness::signal(self.0.id(), signal);
            // The length of the suspension is the test's input.
            std::thread::sleep(if signal == "STOP" { length } else { Duration::ZERO });
        }
    }
}

fn text(path: &Path) -> &str {
    path.to_str().expect("text")
}

/// The operator's machine: the folder of its end, and the person there.
struct Place {
    folder: tempfile::TempDir,
    bundle: PathBuf,
    address: String,
}

impl Place {
    fn start(&self) -> End {
        let (bundle, folder) = (text(&self.bundle), text(self.folder.path()));
        End::start(&["operator", "--bundle", bundle, "--connect", &self.address, "--run-dir", folder])
    }

    /// Connects an operator, once the link is there.
    fn connect(&self) -> Operator {
        let mut operator = None;
        wait_until("an operator socket", || {
            operator = Operator::connect(self.folder.path().join("operator.sock")).ok();
            operator.is_some()
        });
        operator.expect("a connection")
    }

    /// A new client lets the robot follow the built-in motion. Then this returns the operator who holds the enable, and the
    /// client.
    fn lead(&self, observer: &mut StateObserver) -> (Operator, client::Publisher) {
        let person = Transport::Socket(self.folder.path().join("skeleton.sock"));
        drop(self.connect());
        let client = publisher(person, &motion::builtin(), 0).expect("the skeleton socket answers");
        let before = observer.wait("there", |_| true);
        let hand = self.engage(|| {
            client.set_engaged(true);
            let robot = observer.robot().expect("a state");
            robot.q.iter().zip(&before.q).any(|(q, was)| (q - was).abs() > MOVED)
        });
        (hand, client)
    }

    /// Presses the enable, and holds it until `done` returns true. A machine that pauses ends an engagement.
    fn engage(&self, mut done: impl FnMut() -> bool) -> Operator {
        let mut hand = self.connect();
        let mut press = || {
            hand.clear(&mut || Ok(()))?;
            hand.enable();
            hand.reach(Mode::Engaged, &mut || Ok(()))?;
            let mut held = Ok(());
            wait_until("moving with the person", || {
                held = hand.hold(HELD, &mut || Ok(()));
                held.is_err() || done()
            });
            held
        };
        let failures: Vec<_> = (0..PRESSES).map_while(|_| press().err()).collect();
        assert!(failures.len() < PRESSES, "{failures:?}");
        hand
    }
}

/// Asserts that the robot is released, comes to rest, and stays so.
fn assert_released(local: &Operator, observer: &mut StateObserver, what: &str) {
    let released = |mode| !matches!(mode, Some(Mode::Engaged | Mode::Engaging));
    wait_until(&format!("{what}: a release"), || released(local.mode()));
    let at = observer.wait_at_rest();
    assert!(!within(WATCHED, || !released(local.mode())), "{what}: it engaged by itself");
    let then = observer.wait("there", |state| state.header.sequence > at.header.sequence);
    let moved = at.q.iter().zip(&then.q).map(|(at, then)| (at - then).abs()).fold(0.0, f64::max);
    assert!(moved < NOISE, "{what}: it moved by {moved}");
}

fn robot_is_led_over_a_link() {
    let mut robot = Harness::start(&harness::config(), None).expect("it starts");
    let (keys, folder) = (tempfile::tempdir().expect("a folder"), tempfile::tempdir().expect("a folder"));
    for words in [["robot", "--name", "tiago"], ["operator", "--name", "anna"]] {
        let mut pair = Command::new(env!("CARGO_BIN_EXE_teleop-bridge"));
        pair.args(["link", "pair"]).args(words).args(["--keys", text(keys.path())]).stdout(Stdio::null());
        assert!(pair.status().expect("it runs").success());
    }
    let port = UdpSocket::bind("127.0.0.1:0").and_then(|socket| socket.local_addr()).expect("a port").port();
    let address = format!("quic/127.0.0.1:{port}");
    let run_dir = robot.folder().to_owned();
    let of_robot =
        || End::start(&["robot", "--keys", text(keys.path()), "--listen", &address, "--run-dir", text(&run_dir)]);
    let place = Place { folder, bundle: keys.path().join("anna.bundle"), address: address.clone() };
    let (local, mut observer) = (robot.operator().expect("it answers"), StateObserver::open(&robot.instance));

    let (far, near) = (of_robot(), place.start());
    let (hand, client) = place.lead(&mut observer);
    near.pause(Duration::from_millis(400));
    assert_released(&local, &mut observer, "the operator's end paused");
    drop(hand);
    // The same client goes on, because nobody else has taken its lease.
    let led = (place.engage(|| true), client);
    drop(near);
    assert_released(&local, &mut observer, "the operator's end was killed");
    drop(led);

    let near = place.start();
    let led = place.lead(&mut observer);
    drop(far);
    assert_released(&local, &mut observer, "the robot's end was killed");
    let far = of_robot();
    assert_released(&local, &mut observer, "the robot's end is back");
    drop(led);

    let (hand, _client) = place.lead(&mut observer);
    hand.estop();
    wait_until("a fault", || local.mode() == Some(Mode::Faulted));
    observer.wait_at_rest();
    drop((near, far));
    robot.children.end("driver").expect("it ends");
    let mut figures = robot.report("driver").expect("its figures");
    robot.children.end("robot").expect("it ends");
    figures["robot"] = robot.report("robot").expect("its figures");
    assert_no_violations(&figures);
}

fn main() -> ExitCode {
    if let Some(ended) = harness::roles::main() {
        return ended;
    }
    // Runners such as cargo-nextest ask for the names of the tests first, and for those of ignored ones.
    let is_asked = |option: &str| std::env::args().any(|argument| argument == option);
    if !is_asked("--list") {
        robot_is_led_over_a_link();
        println!("test robot_is_led_over_a_link ... ok");
    } else if !is_asked("--ignored") {
        println!("robot_is_led_over_a_link: test");
    }
    ExitCode::SUCCESS
}
