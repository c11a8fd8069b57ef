//! The processes of an instance in a temporary folder.

use crate::operator::Operator;
use crate::{pause, settings};
use client::{ClientError, PlayOptions, Player, Publisher, Transport};
use instance::Instance;
use motion::{CalibrationMode, Motion};
use rt::{Exit, Failure};
use serde_json::{Map, Value};
use std::path::{Path, PathBuf};
use std::sync::{Condvar, Mutex, PoisonError};
use teleopd::{Children, InstanceArgs, Output, PROCESSES};

/// Processors per running instance. On two processors, instances run one at a time. Some tests load every
/// processor, and would disturb another instance.
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
        pause::forget();
        Self
    }
}

impl Drop for Turn {
    fn drop(&mut self) {
        *RUNNING.0.lock().unwrap_or_else(PoisonError::into_inner) -= 1;
        RUNNING.1.notify_one();
    }
}

/// An instance and its processes. A drop kills them, and removes the folder and the shared memory.
pub struct Harness {
    /// The instance.
    pub instance: Instance,
    /// The arguments with which the processes start.
    pub place: InstanceArgs,
    /// The processes.
    pub children: Children,
    folder: tempfile::TempDir,
    _turn: Option<Turn>,
}

impl Harness {
    /// Creates an instance without processes. They will start from `program`, with the settings `config`. With
    /// `changes`, in TOML, they get a changed copy of the settings.
    pub fn new(program: PathBuf, config: &Path, changes: Option<&str>) -> Result<Self, Failure> {
        let turn = Turn::take();
        let mut harness = Self::idle(program, config, changes)?;
        harness._turn = Some(turn);
        Ok(harness)
    }

    /// The same for an instance that never runs. It waits for no other one.
    pub fn idle(program: PathBuf, config: &Path, changes: Option<&str>) -> Result<Self, Failure> {
        // The prefix is short because the path of the operator's socket is limited to 107 bytes.
        let folder = tempfile::Builder::new().prefix("tp").tempdir();
        let folder = folder.map_err(|error| Failure::unwritable(&std::env::temp_dir(), &error))?;
        let run_dir = folder.path().to_path_buf();
        let instance = Instance::new(&run_dir).map_err(|error| Failure::unwritable(&run_dir, &error))?;
        let mut config = config.to_path_buf();
        if let Some(changes) = changes {
            let copy = run_dir.join("teleop.toml");
            settings::write(&config, changes, &copy)?;
            config = copy;
        }
        // The driver is simulated, so a kernel without PREEMPT_RT is enough.
        let place = InstanceArgs { config, run_dir, engage_without_realtime: true, interface: None, robot: None };
        let children = Children::none(program, &instance, &place, Output::Files)?;
        Ok(Self { instance, place, children, folder, _turn: None })
    }

    /// Creates an instance and starts all of its processes from this program, see [`crate::roles::main`].
    pub fn start(config: &Path, changes: Option<&str>) -> Result<Self, Failure> {
        let program = std::env::current_exe().map_err(Failure::with(Exit::Software))?;
        let mut harness = Self::new(program, config, changes)?;
        harness.children.start_all()?;
        Ok(harness)
    }

    /// Returns the instance's folder.
    pub fn folder(&self) -> &Path {
        self.folder.path()
    }

    /// Connects an operator.
    pub fn operator(&self) -> Result<Operator, Failure> {
        Operator::connect(self.instance.operator_socket())
    }

    /// Fails if a process ended by itself.
    pub fn watch(&mut self) -> Result<(), Failure> {
        match self.children.ended() {
            Some((name, status)) => Err(Failure::new(Exit::Failed, format!("{name} ended by itself ({status})"))),
            None => Ok(()),
        }
    }

    /// Returns the figures that a process wrote when it ended, if there are any.
    pub fn report(&self, name: &str) -> Option<Value> {
        serde_json::from_str(&std::fs::read_to_string(self.instance.report(name)).ok()?).ok()
    }

    /// Returns the figures of all processes that wrote some.
    pub fn reports(&self) -> Map<String, Value> {
        PROCESSES.iter().filter_map(|name| Some(((*name).to_owned(), self.report(name)?))).collect()
    }
}

impl Drop for Harness {
    fn drop(&mut self) {
        for name in PROCESSES {
            self.children.kill(name);
        }
        self.instance.retire();
    }
}

/// Starts a client that publishes `motion` in a loop, holding its first frame.
pub fn publisher(to: Transport, motion: &Motion, session: u64) -> Result<Publisher, ClientError> {
    let play = PlayOptions { speed: 1.0, looped: true, calibration: CalibrationMode::First10s };
    Publisher::start_on(to, Player::new(motion, play, session, rt::incarnation()), rt::now)
}
