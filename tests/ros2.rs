//! The driver `teleopd-ros2` against a peer that another program plays, over DDS. See tools/peer.

mod driven;
mod grippers;
mod interfaces;
mod states;

use harness::{Cable, DRIVER, Killed, Rig, holds_for, repository, shell, soon, wait_until};
use messages::Mode;
use serde_json::Value;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::time::{Duration, Instant};

/// Domains of these tests. Tests of one program run at the same time.
const DOMAINS: [u32; 8] = [41, 42, 43, 121, 122, 123, 124, 125];
/// Longest time in which the robot is at rest after its driver was killed: the longest stop, the delay of its controllers
/// and two rows of the trace, s.
const REST_WITHIN_S: f64 = 0.5 + 0.025 + 0.04;

/// Returns the interpreter of a virtual environment for the peer. The error says why there is none.
fn python() -> Result<PathBuf, String> {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("python-peer");
    let required =
        std::fs::read_to_string(repository().join("tools/peer/requirements.txt")).expect("in the repository");
    // Nothing else is needed without the physics.
    let needed = |line: &&str| ["cyclonedds", "numpy", "rosbags", "pytest"].iter().any(|name| line.starts_with(name));
    let wire = required.lines().filter(needed);
    harness::python(&folder, &wire.collect::<Vec<_>>())
}

/// Waits until a peer printed `text` into its log.
fn wait_for(peer: &mut Child, log: &Path, text: &str) {
    wait_until(&format!("{text:?} of the peer"), || {
        assert!(peer.try_wait().expect("a child").is_none(), "the peer has ended");
        std::fs::read_to_string(log).unwrap_or_default().contains(text)
    });
}

/// Runs `teleopd preflight`. Returns its exit code, and what it prints on its two outputs.
fn preflight(config: &Path) -> (Option<i32>, [String; 2]) {
    let output = Command::new(env!("CARGO_BIN_EXE_teleopd")).args(["preflight", "--config"]).arg(config).output();
    let output = output.expect("it runs");
    let printed = [output.stdout, output.stderr].map(|text| String::from_utf8_lossy(&text).into_owned());
    (output.status.code(), printed)
}

/// Waits until `teleopd preflight` refuses a robot in these sentences. A fault of the peer takes a moment.
fn wait_refusal(config: &Path, sentences: &[&str]) {
    let mut refusal = (None, String::new());
    let is_refused = soon(|| {
        let (code, printed) = preflight(config);
        refusal = (code, printed.concat());
        code == Some(1) && sentences.iter().all(|sentence| refusal.1.contains(sentence))
    });
    assert!(is_refused, "{refusal:?}");
}

/// Exit status of a peer that is too late for a robot: EX_TEMPFAIL of sysexits(3).
const TOO_LATE: i32 = 75;

/// A robot that another program plays. It ends with the test.
struct Peer {
    child: Killed,
    faults: Option<ChildStdin>,
    folder: tempfile::TempDir,
}

impl Peer {
    /// Starts it on the loopback interface. Prints why there is none.
    fn start(domain: u32, more: &[&str]) -> Option<Self> {
        Self::start_by(&[], "lo", domain, more)
    }

    /// Starts it by a command that takes a command, and waits until its topics exist.
    fn start_by(by: &[&str], interface: &str, domain: u32, more: &[&str]) -> Option<Self> {
        let python = python().map_err(|why| println!("skipped: no peer on ROS 2: {why}")).ok()?;
        let folder = tempfile::tempdir().expect("a folder");
        let file = |name: &str| folder.path().join(name);
        let words: Vec<&std::ffi::OsStr> = by.iter().map(std::ffi::OsStr::new).chain([python.as_os_str()]).collect();
        let mut command = Command::new(words[0]);
        command.args(&words[1..]);
        command.arg(repository().join("tools/peer/peer.py")).args([
            "--no-physics",
            "--interface",
            interface,
            "--stdin",
        ]);
        command.args(["--domain", &domain.to_string()]).args(more);
        command.arg("--report").arg(file("report.json")).arg("--trace").arg(file("trace.csv"));
        let log = std::fs::File::create(file("log")).expect("writable");
        let mut child = Killed(command.stdin(Stdio::piped()).stdout(log).spawn().expect("it starts"));
        wait_for(&mut child, &file("log"), "ready");
        let faults = child.stdin.take();
        Some(Self { child, faults, folder })
    }

    /// Waits until it prints this.
    fn wait(&mut self, line: &str) {
        wait_for(&mut self.child, &self.folder.path().join("log"), line);
    }

    /// Begins a fault.
    fn fault(&mut self, text: &str) {
        writeln!(self.faults.as_mut().expect("it runs"), "{text}").expect("the peer reads");
    }

    /// Ends it, and returns its judgement and the rows of its trace.
    fn end(self) -> (Value, Vec<Vec<f64>>) {
        self.end_in_time().expect("the peer was in time")
    }

    /// The same. None if the peer gave up because it was too late for a robot.
    fn end_in_time(mut self) -> Option<(Value, Vec<Vec<f64>>)> {
        drop(self.faults.take());
        let status = self.child.wait().expect("a child");
        if status.code() == Some(TOO_LATE) {
            return None;
        }
        assert!(status.success(), "the peer failed");
        let text = |name: &str| std::fs::read_to_string(self.folder.path().join(name)).expect("written at the end");
        let number = |field: &str| field.parse().unwrap_or(f64::NAN);
        let rows = text("trace.csv").lines().skip(1).map(|row| row.split(',').map(number).collect()).collect();
        Some((serde_json::from_str(&text("report.json")).expect("JSON"), rows))
    }
}

/// Waits longer than a robot may move after the end of its driver. Only the peer's trace, which it writes at its end, shows
/// the motion.
fn outlive_stop() {
    std::thread::sleep(Duration::from_millis(1500));
}

/// An instance whose robot is in this domain.
fn rig(domain: u32) -> Rig {
    rig_at("lo", domain)
}

/// The same behind a network interface.
fn rig_at(interface: &str, domain: u32) -> Rig {
    rig_with(interface, domain, "\nros2.servo_lag_ms = 10.0")
}

/// The same with more settings.
fn rig_with(interface: &str, domain: u32, more: &str) -> Rig {
    Rig::with_settings(&settings(interface, domain, more))
}

/// Returns the settings of a robot in this domain.
fn settings(interface: &str, domain: u32, more: &str) -> String {
    let beside = PathBuf::from(env!("CARGO_BIN_EXE_teleopd")).with_file_name("teleopd-ros2");
    assert!(beside.exists(), "{}: build it with cargo build --release -p ros2", beside.display());
    format!(
        "driver.program = \"teleopd-ros2\"\ndriver.measured_age_max_ms = 100.0\ndriver.interface = \"jtc100\"\n\
         ros2.interface = \"{interface}\"\nros2.domain_id = {domain}{more}"
    )
}

/// True if every controller took every message.
fn took_all(report: &Value) -> bool {
    let controllers = report["controllers"].as_object().expect("controllers");
    controllers.values().all(|one| one["accepted"] == one["received"] && one["accepted"].as_u64() > Some(100))
}

#[test]
#[ignore = "two cores do not hold a robot, its peer and other tests in time: cargo test --release --test system ros2 -- --ignored"]
fn f114_robot_on_ros2_plays_the_certified_stop_when_its_driver_is_killed() {
    harness::in_real_time(|| {
        let Some(peer) = Peer::start(DOMAINS[1], &[]) else { return };
        let mut rig = rig(DOMAINS[1]);
        rig.start_all();
        let (operator, mut observer) = (rig.operator_session(), rig.state_observer());
        let client = rig.client(&motion::builtin(), 1);
        operator.engage_until(Mode::Engaged);
        client.set_engaged(true);
        observer.wait("fast", |robot| robot.v.iter().any(|v| v.abs() > 0.5));
        rig.kill("driver");
        let killed_s = rt::now().0 as f64 * 1e-9;
        outlive_stop();
        let (_, trace) = peer.end();
        let moves =
            |pair: &[Vec<f64>]| (2..pair[0].len()).any(|column| (pair[1][column] - pair[0][column]).abs() > 1e-6);
        let moved: Vec<f64> = trace.windows(2).filter(|pair| moves(pair)).map(|pair| pair[1][0]).collect();
        let last_s = moved.last().expect("it moved") - killed_s;
        println!("the peer's robot was at rest {:.0} ms after kill -9 of its driver", last_s * 1e3);
        assert!(last_s > -0.1 && last_s < REST_WITHIN_S, "at rest {last_s} s after the driver's end");
    });
}

#[test]
fn preflight_of_no_robot_has_one_sentence_on_the_likeliest_cause() {
    let (code, [printed, _]) = preflight(&Rig::idle(&settings("lo", DOMAINS[6], "")).place.config);
    let failed: Vec<&str> = printed.lines().filter(|line| line.starts_with("failed: ")).collect();
    let sentence = format!("nothing was heard of a robot in domain {} on network interface `lo`", DOMAINS[6]);
    assert!(code == Some(1) && failed.len() == 1 && failed[0].contains(&sentence), "{printed}");
    let (code, printed) = preflight(&Rig::idle(&settings("nothing0", DOMAINS[6], "")).place.config);
    let printed = printed.concat();
    assert!(code == Some(69) && printed.contains("this machine has no such network interface, only "), "{printed}");
}

#[test]
#[ignore = "two cores do not hold a robot, its peer and other tests in time: cargo test --release --test system ros2 -- --ignored"]
fn f115_robot_on_ros2_that_is_not_ready_is_refused_with_a_sentence() {
    let Some(mut peer) = Peer::start(DOMAINS[2], &["--fault", "second/head_controller"]) else { return };
    peer.fault("emergency");
    peer.fault("inactive/torso_controller");
    let rig = rig(DOMAINS[2]);
    wait_refusal(
        &rig.folder().join("teleop.toml"),
        &[
            "controller `torso_controller` publishes no state: activate it",
            "another program may send to /head_controller/joint_trajectory",
            "the emergency stop is pressed",
        ],
    );
    rig.assert_ends("driver", 69, &["the robot is not ready"]);
}

#[test]
#[ignore = "two cores do not hold a robot, its peer and other tests in time: cargo test --release --test system ros2 -- --ignored"]
fn f114_nothing_is_sent_once_the_publisher_of_the_emergency_stop_left() {
    harness::in_real_time(|| {
        let Some(mut peer) = Peer::start(DOMAINS[6], &[]) else { return };
        let mut rig = rig(DOMAINS[6]);
        rig.start_all();
        // Longer than the time between two of its messages.
        let left = "its publisher left";
        let silent = holds_for(Duration::from_millis(1500), || !rig.log(DRIVER).contains(left));
        assert!(silent, "{}", rig.log(DRIVER));
        peer.fault("unwatched");
        // Twice the lease of a participant of Cyclone DDS.
        assert!(soon(|| rig.log(DRIVER).contains(left)), "it goes on: {}", rig.log(DRIVER));
    });
}

/// Lets the robot follow the built-in motion for so long, and engages it again after each stop. Returns the number of stops,
/// the driver's reasons and the peer's judgement.
fn drive(peer: Peer, mut rig: Rig, length: Duration) -> (u32, Vec<String>, Option<Value>) {
    rig.start_all();
    let client = rig.client(&motion::builtin(), 1);
    client.set_engaged(true);
    let mut operator = rig.operator().expect("it answers");
    let end = Instant::now() + length;
    let mut stops = 0;
    while Instant::now() < end {
        let held = operator
            .clear(&mut || Ok(()))
            .and_then(|()| {
                operator.enable();
                operator.reach(Mode::Engaged, &mut || Ok(()))
            })
            .and_then(|()| operator.hold(end.saturating_duration_since(Instant::now()), &mut || Ok(())));
        stops += u32::from(held.is_err());
    }
    operator.release();
    rig.state_observer().wait_at_rest();
    let why = |line: &str| line.split_once("nothing is sent to the robot: ").map(|(_, why)| why.to_owned());
    let whys = rig.log("driver").lines().filter_map(why).collect();
    rig.end("driver");
    (stops, whys, peer.end_in_time().map(|(report, _)| report))
}

#[test]
#[ignore = "needs root, ip(8), nft(8) and minutes: cargo test --release --test system lossy -- --ignored --nocapture"]
fn robot_behind_a_lossy_network_goes_on_following() {
    let cable = match Cable::lay("teleopd-loss", ["teleopd-here", "teleopd-there"], 7) {
        Ok(cable) => cable,
        Err(why) => return println!("skipped: no lossy network: {why}"),
    };
    let seconds = 22;
    println!("| packets lost, % | robot's readers | stops in {seconds} s | largest gap, ms | acceleration, share |");
    for (reader, name) in [(&[][..], "reliable"), (&["--best-effort"][..], "best effort")] {
        for percent in [0, 1, 5, 10] {
            cable.lose(percent).expect("rules");
            let Some(peer) = Peer::start_by(&cable.prefix(), cable.ends[1], DOMAINS[3], reader) else { return };
            let rig = rig_at(cable.ends[0], DOMAINS[3]);
            let (stops, whys, report) = drive(peer, rig, Duration::from_secs(seconds));
            let report = report.expect("the peer was in time");
            let controllers = report["controllers"].as_object().expect("controllers").values();
            let gap_ms = controllers.filter_map(|one| one["gap_max_ms"].as_f64()).fold(0.0, f64::max);
            let acceleration = report["command"]["acceleration_share"]["worst"].as_f64().expect("a number");
            println!("| {percent} | {name} | {stops} | {gap_ms} | {acceleration:.3} |");
            // A machine that pauses stops the robot, too. It says so in other words.
            assert!(!whys.iter().any(|why| why.contains("messages were lost")), "{percent} % lost: {whys:?}");
        }
    }
}

/// A robot on Fast DDS that a program in C++ plays. It ends with the test.
struct FastPeer {
    child: Killed,
    log: PathBuf,
    _folder: tempfile::TempDir,
}

impl FastPeer {
    /// Builds and starts it. Prints why there is none.
    fn start(domain: u32, reliability: &str) -> Option<Self> {
        let program = Self::build().map_err(|why| println!("skipped: no peer on Fast DDS: {why}")).ok()?;
        let folder = tempfile::tempdir().expect("a folder");
        let log = folder.path().join("log");
        let robots = repository().join("config/robots");
        let mut command = Command::new(program);
        command.arg("--robot").arg(robots.join("tiago_dual.toml")).arg("--urdf").arg(robots.join("tiago_dual.urdf"));
        command.args(["--domain", &domain.to_string(), "--address", "127.0.0.1", "--reliability", reliability]);
        let file = std::fs::File::create(&log).expect("writable");
        let mut child = Killed(command.stdin(Stdio::piped()).stdout(file).spawn().expect("it starts"));
        wait_for(&mut child, &log, "ready");
        Some(Self { child, log, _folder: folder })
    }

    fn build() -> Result<PathBuf, String> {
        static ONE: std::sync::Mutex<()> = std::sync::Mutex::new(());
        let _one = ONE.lock();
        shell(
            "for tool in make g++ fastddsgen; do command -v $tool >/dev/null || { echo no $tool >&2; exit 1; }; done",
        )?;
        for header in ["fastdds/dds/domain/DomainParticipant.hpp", "fastcdr/Cdr.h"] {
            let path = Path::new("/usr/include").join(header);
            path.exists().then_some(()).ok_or_else(|| format!("no {}", path.display()))?;
        }
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("peer-fastdds");
        let makefile = repository().join("tools/peer/fastdds/Makefile");
        shell(&format!("make -s -f {} OUT={} CXXFLAGS=-O0", makefile.display(), folder.display())).expect("it builds");
        Ok(folder.join("peer"))
    }

    /// Ends it, and returns its report.
    fn end(mut self) -> Value {
        drop(self.child.stdin.take());
        assert!(self.child.wait().expect("a child").success(), "the peer failed");
        let text = std::fs::read_to_string(&self.log).expect("a log");
        serde_json::from_str(text.lines().last().expect("a report")).expect("JSON")
    }
}

#[test]
fn robot_on_fast_dds_may_be_driven() {
    for reliability in ["best-effort", "reliable"] {
        let Some(peer) = FastPeer::start(DOMAINS[4], reliability) else { return };
        let rig = rig(DOMAINS[4]);
        let (code, [printed, _]) = preflight(&rig.folder().join("teleop.toml"));
        assert!(code == Some(0) && printed.contains("may be driven"), "{reliability}: {printed}");
        let report = peer.end();
        assert_eq!(report["arm_left_controller"]["messages"], 0, "a preflight sends nothing: {report}");
    }
}

#[test]
#[ignore = "two cores do not hold a robot, its peer and other tests in time: cargo test --release --test system ros2 -- --ignored"]
fn robot_on_fast_dds_gets_trajectories_that_continue_and_end_at_rest() {
    harness::in_real_time(|| {
        for reliability in ["best-effort", "reliable"] {
            let Some(peer) = FastPeer::start(DOMAINS[5], reliability) else { return };
            let mut rig = rig(DOMAINS[5]);
            let (operator, mut observer, _client) = rig.follow_builtin(0.2);
            operator.release();
            operator.wait_mode(Mode::Disengaged);
            observer.wait_at_rest();
            rig.end("driver");
            let report = peer.end();
            println!("{reliability}: {report}");
            for one in report.as_object().expect("controllers").values() {
                assert!(one["messages"].as_u64() > Some(100), "{report}");
                for promise in ["increasing", "rests", "complete"] {
                    assert_eq!(one[promise], true, "{promise}: {report}");
                }
                // The fastest joint makes 2.35 rad/s: 24 mrad in one update of 10 ms, or twice that if the peer is late.
                assert!(one["step_max"].as_f64() < Some(0.05), "{report}");
            }
            assert!(report["arm_left_controller"]["step_max"].as_f64() > Some(1e-3), "it moved: {report}");
        }
    });
}
