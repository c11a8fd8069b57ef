//! The harness for a test: what fails panics.

use crate::operator::Operator;
use crate::running::{Harness, publisher};
use crate::{StateObserver, assert_always, assert_ends, config, soon, wait_until};
use client::{Publisher, Transport};
use messages::{Fault, Mode, Status};
use motion::Motion;
use serde_json::Value;
use std::path::PathBuf;
use std::process::{Child, Command, ExitStatus};
use std::time::Duration;

/// The driver's process.
pub const DRIVER: &str = "driver";
/// The process of its robot.
const ROBOT: &str = "robot";
/// The command that starts the processes of an instance.
const UP: &str = "up";
/// Settings of a robot that a hold releases after 1 s. The shipped ones wait for 5 s.
pub const SHORT_HOLD: &str = "safety.hold_timeout_ms = 1000.0";

/// Sends Ctrl-C.
pub fn interrupt(child: &Child) {
    signal(child.id(), "INT");
}

/// Sends a process the signal with this name of kill(1).
pub fn signal(id: u32, signal: &str) {
    let sent = Command::new("kill").args(["-s", signal, &id.to_string()]).status();
    assert!(sent.expect("kill(1) runs").success(), "process {id} took no {signal}");
}

/// Returns the program whose package is tested. Cargo sets the variable for its tests.
fn program() -> PathBuf {
    std::env::var_os("CARGO_BIN_EXE_teleopd").expect("cargo runs this test").into()
}

/// Processes of an instance. They are killed when the test ends.
pub struct Rig(Harness);

impl std::ops::Deref for Rig {
    type Target = Harness;

    fn deref(&self) -> &Self::Target {
        &self.0
    }
}

impl Rig {
    /// Creates an instance without processes.
    pub fn empty() -> Self {
        Self(Harness::new(program(), &config(), None).expect("an instance"))
    }

    /// Creates an instance without processes, with a copy of the settings. The changes are TOML.
    pub fn with_settings(changes: &str) -> Self {
        Self(Harness::new(program(), &config(), Some(changes)).expect("an instance"))
    }

    /// Creates an instance that never runs. Other instances may run meanwhile. The changes are TOML.
    pub fn idle(changes: &str) -> Self {
        let changes = Some(changes).filter(|changes| !changes.is_empty());
        Self(Harness::idle(program(), &config(), changes).expect("an instance"))
    }

    /// Starts all processes, each until READY.
    pub fn whole() -> Self {
        let mut rig = Self::empty();
        rig.start_all();
        rig
    }

    /// Starts all processes, each until READY.
    pub fn start_all(&mut self) {
        self.0.children.start_all().unwrap_or_else(|failure| panic!("{failure}"));
    }

    /// Starts all processes with [`SHORT_HOLD`], and lets the robot follow the built-in motion until it is in motion. `client`
    /// connects the client, for example [`Rig::shared_memory_client`].
    pub fn moving(client: impl Fn(&Self) -> Publisher) -> (Self, OperatorSession, StateObserver, Publisher) {
        let mut rig = Self::with_settings(SHORT_HOLD);
        rig.start_all();
        let (operator, mut observer, client) = (rig.operator_session(), rig.state_observer(), client(&rig));
        operator.engage_until(Mode::Engaged);
        client.set_engaged(true);
        observer.wait_moving();
        (rig, operator, observer, client)
    }

    /// Starts all processes, and lets the robot follow the built-in motion until a joint moved by `by`, rad or m. The client
    /// publishes, and the operator holds the enable, until they are dropped.
    pub fn follow_builtin(&mut self, by: f64) -> (OperatorSession, StateObserver, Publisher) {
        self.start_all();
        let (operator, mut observer) = (self.operator_session(), self.state_observer());
        let before = observer.wait("there", |_| true);
        let client = self.client(&motion::builtin(), 1);
        operator.engage_until(Mode::Engaged);
        client.set_engaged(true);
        observer.wait_moved(&before, by);
        (operator, observer, client)
    }

    /// Starts a process and waits for READY. With the driver it also starts its robot, unless that still runs.
    pub fn start(&mut self, name: &'static str) {
        if name == DRIVER && self.children.id(ROBOT).is_none() {
            self.start(ROBOT);
        }
        self.0.children.start_one(name).unwrap_or_else(|failure| panic!("{failure}"));
    }

    /// Starts `teleopd up` and waits until its control answers.
    pub fn start_up(&mut self) {
        self.0.children.spawn(UP).expect("up starts");
        let core = self.instance.run_dir().join("core");
        wait_until("ready", || core.exists() && self.operator().is_ok());
    }

    /// Returns the figures of a process that ended by itself. Waits for them.
    pub fn figures(&self, name: &str) -> Value {
        wait_until(&format!("figures of {name}"), || self.report(name).is_some());
        self.report(name).expect("figures")
    }

    /// Runs a process that ends by itself. Checks its exit code, and that its standard error contains all parts.
    #[track_caller]
    pub fn assert_ends(&self, name: &str, code: i32, parts: &[&str]) {
        assert_ends(&mut self.children.command(name), code, parts);
    }

    /// Returns the log of a process.
    pub fn log(&self, name: &str) -> String {
        std::fs::read_to_string(self.children.log(name)).unwrap_or_default()
    }

    /// Returns the process id of a running process.
    pub fn id(&self, name: &str) -> u32 {
        self.children.id(name).expect("a running process")
    }

    /// Sends the signal with this name of kill(1).
    pub fn signal(&self, name: &str, signal: &str) {
        self::signal(self.id(name), signal);
    }

    /// Sends SIGKILL and waits until the process has ended.
    pub fn kill(&mut self, name: &str) {
        assert!(self.children.id(name).is_some(), "{name} does not run");
        self.0.children.kill(name);
    }

    /// Sends SIGTERM and returns the figures of the process. For the driver, they include those of its robot.
    pub fn end(&mut self, name: &str) -> Value {
        assert!(self.children.id(name).is_some(), "{name} does not run");
        let ended = self.0.children.end(name);
        ended.unwrap_or_else(|trouble| panic!("{trouble}: {}", self.log(name)));
        let mut figures = self.report(name).expect("figures");
        if name == DRIVER && self.children.id(ROBOT).is_some() {
            figures[ROBOT] = self.end(ROBOT);
        }
        figures
    }

    /// Ends the driver and its robot, which have counted no violation. Returns their figures.
    pub fn end_without_violations(&mut self) -> Value {
        let figures = self.end(DRIVER);
        assert_no_violations(&figures);
        figures
    }

    /// Stops `teleopd up` and its processes.
    pub fn end_up(&mut self) {
        rt::terminate(self.id(UP));
        let status = self.ended(UP);
        assert!(status.success(), "up ended with {status}");
    }

    /// Connects an operator.
    pub fn operator_session(&self) -> OperatorSession {
        OperatorSession(self.operator().expect("the operator socket answers"))
    }

    /// Starts a client that publishes `motion`, holding its first frame.
    pub fn client(&self, motion: &Motion, session: u64) -> Publisher {
        publisher(Transport::Domain(self.instance.input_domain()), motion, session).expect("a client")
    }

    /// The same for the built-in motion.
    pub fn shared_memory_client(&self) -> Publisher {
        self.client(&motion::builtin(), 1)
    }

    /// The same through the skeleton socket. The daemon sets the session.
    pub fn socket_client(&self) -> Publisher {
        let socket = Transport::Socket(self.instance.skeleton_socket());
        publisher(socket, &motion::builtin(), 0).expect("the socket is open")
    }

    /// Lets other users pass through the folder, like that of an installed instance.
    pub fn open_to_others(&self) {
        let mode = std::os::unix::fs::PermissionsExt::from_mode(0o711);
        std::fs::set_permissions(self.folder(), mode).expect("the folder is ours");
    }

    /// Returns true if a started process still runs.
    pub fn runs(&mut self, name: &str) -> bool {
        self.0.children.runs(name)
    }

    /// Waits for a process to end by itself, and returns its status.
    pub fn ended(&mut self, name: &str) -> ExitStatus {
        assert!(soon(|| !self.runs(name)), "{name} does not end");
        self.0.children.take(name).expect("a started process").wait().expect("its status")
    }

    /// Observes the driver's executed states.
    pub fn state_observer(&self) -> StateObserver {
        StateObserver::open(&self.instance)
    }
}

impl Drop for Rig {
    fn drop(&mut self) {
        self.0.children.kill(UP);
    }
}

/// An operator whose waits fail the test.
pub struct OperatorSession(Operator);

impl std::ops::Deref for OperatorSession {
    type Target = Operator;

    fn deref(&self) -> &Self::Target {
        &self.0
    }
}

impl OperatorSession {
    /// Waits for a status for which `done` returns true.
    pub fn wait(&self, what: &str, done: impl Fn(&Status) -> bool) -> Status {
        let mut found = None;
        let look = || {
            found = self.status().filter(&done);
            found.is_some()
        };
        assert!(soon(look), "never {what}: {}", self.describe());
        found.expect("a status")
    }

    /// Waits until the robot can be engaged.
    pub fn wait_free(&self) -> Status {
        self.wait("free to engage", Operator::is_free)
    }

    /// Waits until the robot holds or is released.
    pub fn wait_stopped(&self) -> Status {
        self.wait("stopped", |status| [Mode::Holding, Mode::Disengaged].iter().any(|&mode| status.mode == mode as u32))
    }

    /// Waits until control has ticked for this time.
    pub fn wait_control(&self, length: Duration) -> Status {
        let end = self.ticks_after(length);
        self.wait("ticking", |status| status.ticks >= end)
    }

    /// Checks that the mode stays while control ticks for this time.
    pub fn assert_stays(&self, mode: Mode, length: Duration) {
        let end = self.ticks_after(length);
        let left = |status: &Status| status.mode != mode as u32;
        let status = self.wait("ticking", |status| left(status) || status.ticks >= end);
        assert!(!left(&status), "not {} any more: {}", mode.name(), self.describe());
    }

    /// Returns the number of control's ticks after this time.
    fn ticks_after(&self, length: Duration) -> u64 {
        let now = self.wait("ticking", |_| true).ticks;
        now + (length.as_secs_f64() * messages::TICK_HZ as f64) as u64
    }

    /// Waits for a mode.
    pub fn wait_mode(&self, mode: Mode) -> Status {
        self.wait(mode.name(), |status| status.mode == mode as u32)
    }

    /// Waits until nothing inhibits, enables, and waits for `mode`. If the machine pauses meanwhile, the driver
    /// latches. Then the operator resets it and tries again, a few times.
    pub fn engage_until(&self, mode: Mode) {
        for _ in 0..4 {
            self.wait_free();
            self.enable();
            let reached = |status: &Status| status.mode == mode as u32 || Operator::is_paused(status);
            if !Operator::is_paused(&self.wait(mode.name(), reached)) {
                return;
            }
            self.release();
            self.wait("measured at rest", |status| status.moving == 0);
            self.reset();
            self.wait_mode(Mode::Disengaged);
        }
        panic!("never {}: the machine stands still too often", mode.name());
    }

    /// Returns the number of times that a fault was raised.
    pub fn raised(&self, fault: Fault) -> u32 {
        self.status().map_or(0, |status| status.fault_counts[fault.index()])
    }
}

/// Returns the modes of control in order, from its figures. A machine that pauses for a tenth of a second adds
/// holds that end by themselves.
pub fn modes(control: &Value) -> Vec<String> {
    let transitions = control["mode_transitions"].as_array().expect("transitions");
    transitions.iter().map(|one| one["to"].as_str().expect("a mode").to_owned()).collect()
}

/// Checks that the simulated robot counted no violation of any kind.
pub fn assert_no_violations(figures: &Value) {
    let counts = figures["violations"].as_object().expect("the driver's counts");
    assert_always(counts.len() > 5 && counts.values().all(|count| *count == 0), format_args!("{figures:#}"));
    let robot = &figures[ROBOT];
    if !robot.is_null() {
        let counts = robot["violations"].as_object().expect("the judge's counts");
        let total: u64 = counts.values().filter_map(Value::as_u64).sum();
        assert_always(counts.len() == 7 && total == 0, format_args!("true motion: {robot:#}"));
    }
}
