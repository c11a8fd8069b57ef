//! An instance of real processes for a test: its own folder, processes started one by one, an operator, a client
//! and an observer.
#![allow(dead_code)]

pub mod user;

use bus::{Domain, Reader};
use client::{ClientError, PlayOptions, Player, Publisher, Transport};
use instance::Instance;
use messages::{Fault, Faults, Mode, RobotState, Service, Status};
use motion::{CalibrationMode, Motion};
use operator::Client;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::{Condvar, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// The driver's process and its robot's process.
const DRIVER: &str = "sim";
const ROBOT: &str = "robot";

/// Processors per running instance. Its real-time processes share one and use half of it. The kernel throttles
/// two instances on one processor for 50 ms in each second. The driver takes that for a suspension.
const PROCESSORS_EACH: usize = 2;
static RUNNING: (Mutex<usize>, Condvar) = (Mutex::new(0), Condvar::new());

/// A slot for one running instance.
struct Turn;

impl Turn {
    fn take() -> Self {
        let at_a_time = (std::thread::available_parallelism().map_or(1, usize::from) / PROCESSORS_EACH).max(1);
        let running = RUNNING.0.lock().unwrap_or_else(PoisonError::into_inner);
        let waited = RUNNING.1.wait_while(running, |running| *running >= at_a_time);
        *waited.unwrap_or_else(PoisonError::into_inner) += 1;
        Self
    }
}

impl Drop for Turn {
    fn drop(&mut self) {
        *RUNNING.0.lock().unwrap_or_else(PoisonError::into_inner) -= 1;
        RUNNING.1.notify_one();
    }
}

/// Longest time for any expected event. Only a hang comes near it.
pub const SOON: Duration = Duration::from_secs(25);

/// Sends Ctrl-C.
pub fn interrupt(child: &Child) {
    send("INT", child);
}

fn send(signal: &str, child: &Child) {
    let sent = Command::new("kill").args(["-s", signal, &child.id().to_string()]).status();
    assert!(sent.expect("kill(1) runs").success(), "process {} took no {signal}", child.id());
}

pub fn repository() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

pub fn config() -> PathBuf {
    repository().join("config/teleop.toml")
}

/// Processes of an instance. They are killed when the test ends.
pub struct Rig {
    pub instance: Instance,
    children: Vec<(String, Child)>,
    folder: tempfile::TempDir,
    config: PathBuf,
    _turn: Turn,
}

impl Rig {
    /// Creates an instance without processes.
    pub fn empty() -> Self {
        let turn = Turn::take();
        let folder = tempfile::Builder::new().prefix("tp").tempdir().expect("a temporary folder");
        let instance = Instance::new(folder.path()).expect("an instance");
        Self { instance, children: Vec::new(), folder, config: config(), _turn: turn }
    }

    /// Creates an instance without processes, with changed settings. Each change is a line of the file and its
    /// replacement.
    pub fn with_settings(changes: &[(&str, &str)]) -> Self {
        let mut rig = Self::empty();
        let folder = repository().join("config");
        let mut text = std::fs::read_to_string(config()).expect("settings");
        let absolute = format!("\"{}/", folder.display());
        text = text.replace("\"robots/", &format!("{absolute}robots/")).replace("\"../", &format!("{absolute}../"));
        for (line, becomes) in changes {
            assert!(text.contains(line), "the settings have no {line}");
            text = text.replace(line, becomes);
        }
        rig.config = rig.folder.path().join("teleop.toml");
        std::fs::write(&rig.config, text).expect("a settings file");
        rig
    }

    /// Starts all processes, each until READY.
    pub fn whole() -> Self {
        let mut rig = Self::empty();
        for name in teleopd::PROCESSES {
            rig.start(name);
        }
        rig
    }

    pub fn folder(&self) -> &Path {
        self.folder.path()
    }

    fn command(&self, name: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_teleopd"));
        command.arg(name).arg("--config").arg(&self.config).arg("--run-dir").arg(self.folder.path());
        command.arg("--engage-without-realtime");
        command
    }

    /// Starts a process and waits for READY. With the driver it also starts its robot, unless that still runs.
    pub fn start(&mut self, name: &str) {
        if name == DRIVER && !self.children.iter().any(|(running, _)| running == ROBOT) {
            self.start(ROBOT);
        }
        let path = self.folder.path().join(format!("{name}.ready"));
        let _ = std::fs::remove_file(&path);
        let socket = std::os::unix::net::UnixDatagram::bind(&path).expect("a notify socket");
        socket.set_read_timeout(Some(Duration::from_millis(50))).unwrap();
        let log = std::fs::File::create(self.folder.path().join(format!("{name}.log"))).unwrap();
        let mut child = self
            .command(name)
            .env("NOTIFY_SOCKET", &path)
            .stdin(Stdio::null())
            .stdout(log.try_clone().unwrap())
            .stderr(log)
            .spawn()
            .expect("the process starts");
        let (mut text, give_up) = ([0; 256], Instant::now() + SOON);
        loop {
            if let Ok(length) = socket.recv(&mut text)
                && text[..length].starts_with(b"READY=1")
            {
                break;
            }
            let ended = child.try_wait().unwrap();
            assert!(ended.is_none() && Instant::now() < give_up, "{name} is not ready ({ended:?}): {}", self.log(name));
        }
        self.children.push((name.to_owned(), child));
    }

    /// Starts `teleopd up` and waits until its control answers.
    pub fn start_up(&mut self) {
        let child = self.command("up").stdin(Stdio::null()).stdout(Stdio::null()).spawn().expect("up starts");
        self.children.push(("up".into(), child));
        let give_up = Instant::now() + SOON;
        while !self.instance.run_dir().join("core").exists()
            || Client::connect(self.instance.operator_socket()).is_err()
        {
            assert!(Instant::now() < give_up, "up is not ready");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Returns the figures of a process that ended by itself. Waits for them.
    pub fn figures(&self, name: &str) -> serde_json::Value {
        let give_up = Instant::now() + SOON;
        loop {
            let text = std::fs::read_to_string(self.instance.report(name)).unwrap_or_default();
            if let Ok(figures) = serde_json::from_str(&text) {
                return figures;
            }
            assert!(Instant::now() < give_up, "{name} left no figures");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Runs a process that should end by itself, and returns its output.
    pub fn run(&self, name: &str) -> Output {
        self.command(name).stdin(Stdio::null()).output().expect("the process runs")
    }

    pub fn log(&self, name: &str) -> String {
        std::fs::read_to_string(self.folder.path().join(format!("{name}.log"))).unwrap_or_default()
    }

    fn child(&mut self, name: &str) -> &mut Child {
        &mut self.children.iter_mut().find(|(running, _)| running == name).expect("a running process").1
    }

    /// Returns the process id of a running process.
    pub fn id(&mut self, name: &str) -> u32 {
        self.child(name).id()
    }

    /// Sends the signal with this name of kill(1).
    pub fn signal(&mut self, name: &str, signal: &str) {
        send(signal, self.child(name));
    }

    /// Sends SIGKILL and waits until the process has ended.
    pub fn kill(&mut self, name: &str) {
        let child = self.child(name);
        child.kill().expect("the process can be killed");
        child.wait().expect("the process ends");
        self.children.retain(|(running, _)| running != name);
    }

    /// Sends SIGTERM and returns the figures of the process. For the driver, they include those of its robot.
    pub fn end(&mut self, name: &str) -> serde_json::Value {
        let mut figures = self.end_one(name);
        if name == DRIVER && self.children.iter().any(|(running, _)| running == ROBOT) {
            figures[ROBOT] = self.end_one(ROBOT);
        }
        figures
    }

    fn end_one(&mut self, name: &str) -> serde_json::Value {
        rt::terminate(self.child(name).id());
        let status = self.child(name).wait().expect("the process ends");
        assert!(status.success(), "{name} ended with {status}: {}", self.log(name));
        self.children.retain(|(running, _)| running != name);
        let text = std::fs::read_to_string(self.instance.report(name)).expect("figures");
        serde_json::from_str(&text).expect("JSON")
    }

    /// Stops `teleopd up` and its processes.
    pub fn end_up(&mut self) {
        rt::terminate(self.id("up"));
        let status = self.ended("up");
        assert!(status.success(), "up ended with {status}");
    }

    pub fn hand(&self) -> OperatorSession {
        OperatorSession::connect(&self.instance.operator_socket())
    }

    /// Starts a client that publishes `motion`, holding its first frame.
    pub fn client(&self, motion: &Motion, session: u64) -> Publisher {
        let play = PlayOptions { speed: 1.0, looped: true, calibration: CalibrationMode::First10s };
        let player = Player::new(motion, play, session, rt::incarnation());
        Publisher::start(self.instance.input_domain(), player, rt::now).expect("a client")
    }

    /// The same through the skeleton socket. The daemon sets the session.
    pub fn socket_client(&self, motion: &Motion) -> Result<Publisher, ClientError> {
        let play = PlayOptions { speed: 1.0, looped: true, calibration: CalibrationMode::First10s };
        let player = Player::new(motion, play, 0, rt::incarnation());
        Publisher::start_on(Transport::Socket(self.instance.skeleton_socket()), player, rt::now)
    }

    /// Lets other users pass through the folder, like that of an installed instance.
    pub fn open_to_others(&self) {
        let mode = std::os::unix::fs::PermissionsExt::from_mode(0o711);
        std::fs::set_permissions(self.folder(), mode).expect("the folder is ours");
    }

    /// Returns true if a started process still runs.
    pub fn runs(&mut self, name: &str) -> bool {
        self.child(name).try_wait().expect("its state").is_none()
    }

    /// Waits for a process to end by itself, and returns its status.
    pub fn ended(&mut self, name: &str) -> std::process::ExitStatus {
        let give_up = Instant::now() + SOON;
        loop {
            if let Some(status) = self.child(name).try_wait().expect("its state") {
                self.children.retain(|(running, _)| running != name);
                return status;
            }
            assert!(Instant::now() < give_up, "{name} does not end");
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    pub fn eyes(&self) -> StateObserver {
        let domain = Domain::open(self.instance.core_domain(), "eyes").expect("the core domain");
        let states = domain.reader(Service::RobotState).expect("robot states");
        StateObserver { states, latest: None, _domain: domain }
    }
}

impl Drop for Rig {
    fn drop(&mut self) {
        for (_, child) in &mut self.children {
            let _ = child.kill();
            let _ = child.wait();
        }
        self.instance.retire();
    }
}

/// Observes the driver's executed states.
pub struct StateObserver {
    states: Reader<RobotState>,
    latest: Option<RobotState>,
    _domain: Domain,
}

impl StateObserver {
    pub fn robot(&mut self) -> Option<RobotState> {
        self.latest = self.states.latest().or(self.latest);
        self.latest
    }

    /// Waits for a state for which `done` returns true.
    pub fn wait(&mut self, what: &str, done: impl Fn(&RobotState) -> bool) -> RobotState {
        let give_up = Instant::now() + SOON;
        loop {
            if let Some(state) = self.robot().filter(&done) {
                return state;
            }
            assert!(Instant::now() < give_up, "the robot never was {what}");
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    /// Waits until a joint is more than `by`, rad or m, from its old position.
    pub fn wait_moved(&mut self, before: &RobotState, by: f64) -> RobotState {
        self.wait("moving with the person", |state| state.q.iter().zip(&before.q).any(|(q, was)| (q - was).abs() > by))
    }

    pub fn wait_at_rest(&mut self) -> RobotState {
        self.wait("at rest", |state| state.v.iter().chain(&state.a).all(|value| *value == 0.0))
    }
}

/// An operator with heartbeats at 50 Hz, and waits that fail the test.
pub struct OperatorSession(operator::OperatorSession);

impl std::ops::Deref for OperatorSession {
    type Target = operator::OperatorSession;

    fn deref(&self) -> &Self::Target {
        &self.0
    }
}

impl OperatorSession {
    fn connect(socket: &Path) -> Self {
        Self(operator::OperatorSession::connect(socket).expect("the operator socket answers"))
    }

    pub fn wait(&self, what: &str, done: impl Fn(&Status) -> bool) -> Status {
        let give_up = Instant::now() + SOON;
        loop {
            if let Some(status) = self.status().filter(&done) {
                return status;
            }
            if Instant::now() > give_up {
                let status = self.status();
                let faults: Vec<_> =
                    status.iter().flat_map(|s| Faults(s.faults).iter()).map(|f| f.row().name).collect();
                let whys = status.iter().flat_map(|s| s.transitions.iter().take(s.transition_count as usize));
                let whys: Vec<_> = whys.map(messages::Transition::why_name).collect();
                panic!("never {what}: mode {:?}, faults {faults:?}, after {whys:?}", self.mode());
            }
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    pub fn wait_mode(&self, mode: Mode) -> Status {
        self.wait(mode.name(), |status| status.mode == mode as u32)
    }

    /// Waits until nothing inhibits, enables, and waits for `mode`. If the machine pauses meanwhile, the driver
    /// latches. Then the operator resets it and tries again, a few times.
    pub fn engage_until(&self, mode: Mode) {
        let paused = |status: &Status| {
            status.mode == Mode::Faulted as u32 && status.faults == Faults::NONE.with(Fault::DriverFault).0
        };
        for _ in 0..4 {
            // Half a second with the enable released, and a fresh target.
            self.wait("free to engage", |status| status.faults == 0 && status.moving == 0 && status.ticks > 750);
            self.enable();
            if !paused(&self.wait(mode.name(), |status| status.mode == mode as u32 || paused(status))) {
                return;
            }
            self.release();
            self.wait("measured at rest", |status| status.moving == 0);
            self.reset();
            self.wait_mode(Mode::Disengaged);
        }
        panic!("never {}: the machine stands still too often", mode.name());
    }

    pub fn raised(&self, fault: Fault) -> u32 {
        self.status().map_or(0, |status| status.fault_counts[fault.index()])
    }
}

/// Returns the modes of control in order, from its figures. A machine that pauses for a tenth of a second adds
/// holds that end by themselves.
pub fn modes(control: &serde_json::Value) -> Vec<String> {
    let transitions = control["mode_transitions"].as_array().expect("transitions");
    transitions.iter().map(|one| one["to"].as_str().expect("a mode").to_owned()).collect()
}

/// Checks that the simulated robot counted no violation of any kind.
pub fn assert_no_violations(figures: &serde_json::Value) {
    for kind in ["position", "velocity", "acceleration", "jerk", "clearance"] {
        assert_eq!(figures["violations"][kind], 0, "{kind}: {figures:#}");
    }
    let robot = &figures[ROBOT];
    if !robot.is_null() {
        let counts = robot["violations"].as_object().expect("the judge's counts");
        let total: u64 = counts.values().filter_map(serde_json::Value::as_u64).sum();
        assert!(counts.len() == 7 && total == 0, "true motion: {robot:#}");
    }
}
