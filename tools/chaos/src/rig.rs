//! The processes of an instance, a client and an operator. Each runs in a process of its own that a fault can
//! hit.

use crate::error::ChaosError;
use crate::injection::Target;
use client::{PlayOptions, Player, Publisher};
use instance::Instance;
use messages::{Mode, Status, Transition};
use motion::CalibrationMode;
use operator::OperatorSession;
use serde_json::{Map, Value};
use std::path::Path;
use std::process::{Child, Command, ExitCode, Stdio};
use std::time::Duration;
use teleopd::{Children, Failure, InstanceArgs, Output, PROCESSES};

/// First argument that makes this program the publishing client.
const CLIENT: &str = "client";
/// First argument that makes this program the operator that holds the enable.
const OPERATOR: &str = "operator";

/// Longest wait for a mode that must come. Only a hang takes nearly as long.
const SOON: Duration = Duration::from_secs(20);
/// Ticks of control before the enable. The enable must have been up for `safety.enable_released_ms`.
const TICKS_BEFORE_ENABLE: u64 = 600;
/// Ticks in which an operator's thread has sent all its orders: five heartbeats.
const TICKS_TO_SEND: u64 = 150;

/// Remains of an instance.
pub struct Ended {
    /// Processes that had to be killed, or that failed.
    pub trouble: Vec<String>,
    /// The report that each process wrote about itself.
    pub reports: Map<String, Value>,
}

impl Ended {
    /// Returns the driver's own report.
    pub fn record(&self) -> Option<&Value> {
        self.reports.get(Target::Driver.name())
    }

    /// Returns the judge's report on the joints' true motion.
    pub fn robot(&self) -> Option<&Value> {
        self.reports.get("robot")
    }

    /// Returns true if control had real-time scheduling, and no stale time was relaxed.
    pub fn realtime(&self) -> bool {
        self.reports.get(Target::Control.name()).is_some_and(|control| control["realtime"] == true)
    }
}

/// A running instance, with its client and operator.
pub struct Rig {
    place: InstanceArgs,
    instance: Instance,
    children: Children,
    client: Child,
    clients_begun_anew: u64,
    /// Holds the enable if the operator is the target.
    hand: Option<Child>,
    operator: OperatorSession,
    _folder: tempfile::TempDir,
}

impl Rig {
    /// Starts all processes.
    ///
    /// # Errors
    /// Returns an error if a process does not start.
    pub fn start(config: &Path) -> Result<Self, ChaosError> {
        // The prefix is short because the path of the operator's socket is limited to 107 bytes.
        let folder = tempfile::Builder::new().prefix("chaos-").tempdir();
        let folder = folder.map_err(|error| ChaosError::write(&std::env::temp_dir(), error))?;
        let instance = Instance::new(folder.path()).map_err(|error| ChaosError::write(folder.path(), error))?;
        let place = InstanceArgs {
            config: config.to_path_buf(),
            run_dir: folder.path().to_path_buf(),
            // The driver is simulated, so a kernel without PREEMPT_RT is enough.
            engage_without_realtime: true,
            interface: None,
        };
        let children = Children::start(&instance, &place, Output::Files)?;
        let client = role(CLIENT, &instance)?;
        let operator = OperatorSession::connect(&instance.operator_socket()).map_err(Failure::from)?;
        Ok(Self { place, instance, children, client, clients_begun_anew: 0, hand: None, operator, _folder: folder })
    }

    /// Returns the instance.
    pub fn instance(&self) -> &Instance {
        &self.instance
    }

    /// Returns the arguments that the processes were started with.
    pub fn place(&self) -> &InstanceArgs {
        &self.place
    }

    /// Returns the operator who watches.
    pub fn operator(&mut self) -> &OperatorSession {
        &self.operator
    }

    /// Brings the instance to a state in which it can be engaged: nothing is latched and nothing blocks it.
    ///
    /// # Errors
    /// Returns an error if it does not reach that state.
    pub fn clear(&mut self) -> Result<(), ChaosError> {
        if self.operator.is_cut_off() {
            self.operator = OperatorSession::connect(&self.instance.operator_socket()).map_err(Failure::from)?;
        }
        let then = self.operator.status().map_or(0, |status| status.ticks);
        self.operator.release();
        let moving =
            |status: &Status| !matches!(Mode::from_u32(status.mode), Some(Mode::Disengaged | Mode::Faulted) | None);
        // Wait until every order was sent, because a late release would hit the next enable.
        if !self.operator.wait(SOON, |status| !moving(status) && status.ticks > then + TICKS_TO_SEND) {
            return Err(self.stuck("does not end its motion"));
        }
        // A reset takes effect at rest, after the cause is gone. So it is repeated until it is accepted.
        for _ in 0..SOON.as_millis() / 100 {
            self.mind_client()?;
            if self.operator.mode() == Some(Mode::Faulted) {
                self.operator.reset();
            }
            let ready = |status: &Status| {
                status.mode == Mode::Disengaged as u32
                    && status.faults == 0
                    && status.moving == 0
                    && status.ticks > TICKS_BEFORE_ENABLE
            };
            if self.operator.wait(Duration::from_millis(100), ready) {
                return Ok(());
            }
        }
        Err(self.stuck("cannot be engaged"))
    }

    /// Returns the number of times that a client gave up by itself and was restarted.
    pub fn clients_begun_anew(&self) -> u64 {
        self.clients_begun_anew
    }

    /// Restarts the client if it has given up, as a user would.
    fn mind_client(&mut self) -> Result<(), ChaosError> {
        let ended = self.client.try_wait().map_err(|error| ChaosError::os(CLIENT, error))?;
        if ended.is_some() {
            self.client = role(CLIENT, &self.instance)?;
            self.clients_begun_anew += 1;
        }
        Ok(())
    }

    /// Holds the enable, and waits for `mode`. If the operator is the target, a separate program holds the
    /// enable.
    ///
    /// # Errors
    /// Returns an error if the mode does not come.
    pub fn engage(&mut self, victim: Target, mode: Mode) -> Result<(), ChaosError> {
        if victim == Target::Operator {
            self.hand = Some(role(OPERATOR, &self.instance)?);
        } else {
            self.operator.enable();
        }
        let begun = |status: &Status| status.mode != Mode::Disengaged as u32;
        let ended = |status: &Status| !begun(status) || status.mode == Mode::Faulted as u32;
        if self.operator.wait(SOON, begun)
            && self.operator.wait(SOON, |status| status.mode == mode as u32 || ended(status))
            && self.operator.mode() == Some(mode)
        {
            return Ok(());
        }
        Err(self.stuck(&format!("never was {}", mode.name())))
    }

    /// Returns the process id of one of teleopd's processes, if it runs.
    pub fn process(&self, name: &str) -> Option<u32> {
        self.children.id(name)
    }

    /// Returns the process id of `victim`.
    ///
    /// # Errors
    /// Returns an error if it does not run.
    pub fn id(&self, victim: Target) -> Result<u32, ChaosError> {
        let id = match victim {
            Target::Client => Some(self.client.id()),
            Target::Operator => self.hand.as_ref().map(Child::id),
            process => self.children.id(process.name()),
        };
        id.ok_or_else(|| ChaosError::Stuck(format!("{} does not run", victim.name())))
    }

    /// Kills `victim` with SIGKILL.
    pub fn kill(&mut self, victim: Target) {
        match victim {
            Target::Client => end(&mut self.client),
            Target::Operator => self.let_go(),
            process => self.children.kill(process.name()),
        }
    }

    /// Restarts the killed process. An operator that held the enable does not come back by itself.
    ///
    /// # Errors
    /// Returns an error if it does not start.
    pub fn revive(&mut self, victim: Target) -> Result<(), ChaosError> {
        match victim {
            Target::Client => self.client = role(CLIENT, &self.instance)?,
            Target::Operator => {}
            process => self.children.start_one(process.name(), &self.instance, &self.place, Output::Files)?,
        }
        Ok(())
    }

    /// Releases the enable everywhere.
    pub fn release(&mut self) {
        self.let_go();
        self.operator.release();
    }

    fn let_go(&mut self) {
        if let Some(mut hand) = self.hand.take() {
            end(&mut hand);
        }
    }

    /// Ends all processes in order.
    pub fn end(mut self) -> Ended {
        self.release();
        end(&mut self.client);
        let trouble = self.children.stop();
        let read = |process: &str| -> Option<(String, Value)> {
            let text = std::fs::read_to_string(self.instance.report(process)).ok()?;
            Some((process.to_owned(), serde_json::from_str(&text).ok()?))
        };
        let reports = PROCESSES.iter().filter_map(|process| read(process)).collect();
        self.instance.retire();
        Ended { trouble, reports }
    }

    fn stuck(&mut self, what: &str) -> ChaosError {
        let status = self.operator.status();
        let mode = status.and_then(|status| Mode::from_u32(status.mode)).map_or("unknown", Mode::name);
        let faults = messages::Faults(status.map_or(0, |status| status.faults));
        let faults: Vec<_> = faults.iter().map(|fault| fault.row().name).collect();
        let passed = status.iter().flat_map(|status| explain::newest_transitions(status, u32::MAX));
        let passed: Vec<_> = passed.map(Transition::why_name).collect();
        let (faults, passed) = (faults.join(" "), passed.join(", "));
        ChaosError::Stuck(format!("the robot {what}: {mode} {faults}, after {passed}"))
    }
}

fn end(child: &mut Child) {
    let _ = child.kill();
    let _ = child.wait();
}

/// Starts this program again as client or operator.
fn role(name: &str, instance: &Instance) -> Result<Child, ChaosError> {
    let program = std::env::current_exe().map_err(|error| ChaosError::os("/proc/self/exe", error))?;
    let mut command = Command::new(program);
    command.arg(name).arg(instance.run_dir()).stdin(Stdio::null()).stdout(Stdio::null());
    command.spawn().map_err(|error| ChaosError::os(name, error))
}

/// Runs as client or operator if `arguments` (without the program's name) require it. Returns the exit code
/// then.
pub fn role_main(arguments: impl Iterator<Item = String>) -> Option<ExitCode> {
    let arguments: Vec<_> = arguments.take(2).collect();
    let [role, folder] = arguments.as_slice() else { return None };
    let ended = match role.as_str() {
        CLIENT => client_main(Path::new(folder)),
        OPERATOR => operator_main(Path::new(folder)),
        _ => return None,
    };
    Some(ended.map_or_else(
        |error| {
            eprintln!("{role}: {error}");
            error.exit().into()
        },
        |()| ExitCode::SUCCESS,
    ))
}

/// Runs the client: publishes the built-in motion in a loop until it is killed.
fn client_main(run_dir: &Path) -> Result<(), ChaosError> {
    rt::die_with_parent();
    let instance = Instance::unmade(run_dir);
    let play = PlayOptions { speed: 1.0, looped: true, calibration: CalibrationMode::First10s };
    let session = u64::from(std::process::id());
    let player = Player::new(&motion::builtin(), play, session, rt::incarnation());
    let publisher = Publisher::start(instance.input_domain(), player, rt::now)?;
    publisher.set_engaged(true);
    loop {
        std::thread::park();
    }
}

/// Runs the operator: holds the enable until it is killed.
fn operator_main(run_dir: &Path) -> Result<(), ChaosError> {
    rt::die_with_parent();
    let operator = OperatorSession::connect(&Instance::unmade(run_dir).operator_socket()).map_err(Failure::from)?;
    // An enable that is held when control first sees it does not count. So wait until it was seen released.
    operator.wait(SOON, |_| true);
    operator.enable();
    loop {
        std::thread::park();
    }
}
