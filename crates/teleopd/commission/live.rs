//! The robot of an instance of its own: the real processes, an operator, and a publisher of joint targets in the place of
//! `retarget`. Nothing here sends a command: control certifies each.

use super::is_ros2;
use super::path::Path;
use super::ports::{Robot, Sample, Stop, Victim};
use crate::children::{Children, Output};
use crate::cli::InstanceArgs;
use crate::process::bus_failure;
use crate::programs::{ROS2, TELEOPD};
use bus::{Domain, Reader};
use client::{PlayOptions, Player, Publisher};
use config::{DriverKind, Loaded};
use instance::Instance;
use messages::{Mode, RobotState, Service, Status, state_flag};
use motion::CalibrationMode;
use operator::OperatorSession;
use robot::Names;
use rt::{Failure, Shutdown};
use serde_json::Value;
use std::io::Write;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::time::Duration;

/// Time between two looks at the driver's state, ns: less than a tick.
const LOOK_NS: u64 = 500_000;
/// Longest time without any state of a running driver, s.
const STATES_WITHIN_S: f64 = 2.0;
/// Longest wait for a mode. Engaging takes 3.5 s at most if nothing is in the way.
const MODE_WITHIN: Duration = Duration::from_secs(10);
/// Longest wait for the effect of one reset. A reset waits for 0.1 s of rest, and for the driver's echo.
const RESET_WITHIN: Duration = Duration::from_millis(500);
/// Resets that are tried. A reset is taken only at rest.
const RESETS: usize = 6;
/// Ticks of control before an enable counts: half a second with the enable released, and a fresh target.
const TICKS_BEFORE_ENABLE: u64 = 750;

pub struct Live<'a> {
    loaded: &'a Loaded,
    place: &'a InstanceArgs,
    instance: Instance,
    shutdown: Shutdown,
    names: Names,
    children: Children,
    targets: Option<(Child, ChildStdin)>,
    person: Option<Publisher>,
    operator: Option<OperatorSession>,
    states: Reader<RobotState>,
    _core: Domain,
}

fn failed(failure: Failure) -> Stop {
    Stop::Failed(failure.text)
}

impl<'a> Live<'a> {
    pub fn new(
        loaded: &'a Loaded,
        place: &'a InstanceArgs,
        instance: Instance,
        shutdown: Shutdown,
    ) -> Result<Self, Failure> {
        let program = std::env::current_exe().map_err(Failure::with(rt::Exit::Software))?;
        let children = Children::none(program, &instance, place, Output::Files)?;
        let core = Domain::open(instance.core_domain(), "commission").map_err(bus_failure)?;
        let states = core.reader(Service::RobotState).map_err(bus_failure)?;
        let names = Names::from_model(&loaded.model);
        let (targets, person, operator) = (None, None, None);
        Ok(Self { loaded, place, instance, shutdown, names, children, targets, person, operator, states, _core: core })
    }

    /// Stops everything with the robot at rest. Returns what went wrong, and the driver's figures.
    pub fn end(mut self) -> (Vec<String>, Option<Value>) {
        let mut trouble = Vec::new();
        if let Some(operator) = &self.operator {
            operator.release();
            if !operator.wait(MODE_WITHIN, |status| is_off(status) && status.moving == 0) {
                trouble.push("control did not say that the robot is at rest".to_owned());
            }
        }
        (self.operator, self.person) = (None, None);
        trouble.extend(self.children.end("ingest").err());
        if let Some((mut child, _)) = self.targets.take() {
            crate::starter::ended_within(&mut child, crate::processes::END_WITHIN);
        }
        trouble.extend(self.children.stop());
        let report = std::fs::read_to_string(self.instance.report("driver"));
        (trouble, report.ok().and_then(|text| serde_json::from_str(&text).ok()))
    }

    /// Starts the publisher of targets. It waits for its first path.
    fn start_targets(&mut self) -> Result<(), Stop> {
        let cannot = |error: std::io::Error| Stop::Failed(format!("the publisher of targets cannot start: {error}"));
        let path = self.children.log("targets");
        let log = std::fs::File::create(&path).map_err(|error| failed(Failure::unwritable(&path, &error)))?;
        let mut command = self.children.command("targets");
        command.stdin(Stdio::piped()).stdout(log.try_clone().map_err(cannot)?).stderr(log);
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        let mut child = command.spawn().map_err(cannot)?;
        let input = child.stdin.take().ok_or_else(|| Stop::Failed("the publisher of targets has no input".into()))?;
        self.targets = Some((child, input));
        Ok(())
    }

    fn connect(&mut self) -> Result<(), Stop> {
        let session = OperatorSession::connect(&self.instance.operator_socket());
        self.operator = Some(session.map_err(|error| Stop::Failed(error.to_string()))?);
        Ok(())
    }

    fn last_complaint(&self) -> Option<String> {
        let log = std::fs::read_to_string(self.children.log("driver")).ok()?;
        let bad = |line: &&str| line.contains("ERROR") || line.contains("WARN");
        log.lines().rev().find(bad).map(|line| line.trim().to_owned())
    }

    fn wait(&self, within: Duration, done: impl Fn(&Status) -> bool) -> Result<bool, Stop> {
        let Some(operator) = &self.operator else { return Ok(false) };
        let came = operator.wait(within, |status| done(status) || self.shutdown.requested());
        if self.shutdown.requested() { Err(Stop::Interrupted) } else { Ok(came) }
    }

    fn check(&mut self) -> Result<(), Stop> {
        if self.shutdown.requested() {
            return Err(Stop::Interrupted);
        }
        match self.children.ended() {
            Some((name, status)) => {
                let log = self.children.log(name);
                Err(Stop::Failed(format!("{name} ended by itself ({status}), its log is {}", log.display())))
            }
            None => Ok(()),
        }
    }

    /// Runs another program to its end. Returns its output, and true if its exit code is one of `good`.
    fn run(&self, mut command: Command, good: &[i32]) -> Result<(String, bool), Stop> {
        let output = command.stdin(Stdio::null()).output().map_err(|error| Stop::Failed(error.to_string()))?;
        let text = [output.stdout, output.stderr].map(|bytes| String::from_utf8_lossy(&bytes).into_owned()).concat();
        Ok((text, output.status.code().is_some_and(|code| good.contains(&code))))
    }
}

fn is_off(status: &Status) -> bool {
    status.mode == Mode::Disengaged as u32 || status.mode == Mode::Faulted as u32
}

fn sample(state: &RobotState) -> Sample {
    let has = |bit: u32| state.flags & bit != 0;
    Sample {
        at_s: state.header.stamp.0 as f64 * 1e-9,
        q: state.q,
        v: state.v,
        q_measured: state.q_measured,
        emergency_stop: has(state_flag::EMERGENCY_STOP),
        driver_fault: has(state_flag::DRIVER_FAULT),
    }
}

impl Robot for Live<'_> {
    fn preflight(&mut self) -> Result<String, Stop> {
        let settings = &self.loaded.settings;
        let mut command = Command::new(if is_ros2(settings) { ROS2 } else { TELEOPD }.path().map_err(failed)?);
        let (name, good): (_, &[i32]) = match settings.driver.kind {
            _ if is_ros2(settings) => ("preflight", &[0]),
            DriverKind::Robot => ("doctor", &[0]),
            // 3: fine for a simulated robot.
            DriverKind::Sim => ("doctor", &[0, 3]),
        };
        command.arg(name).arg("--config").arg(&self.place.config);
        if let Some(robot) = &self.place.robot {
            command.arg("--robot").arg(robot.typed());
        }
        let (text, passed) = self.run(command, good)?;
        let text = text.trim_end();
        if passed { Ok(text.to_owned()) } else { Err(Stop::Failed(format!("{name} found this:\n{text}"))) }
    }

    fn begin(&mut self) -> Result<(), Stop> {
        for name in ["robot", "driver", "control"] {
            self.children.start_one(name).map_err(failed)?;
        }
        self.start_targets()?;
        self.children.start_one("ingest").map_err(failed)?;
        let play = PlayOptions { speed: 1.0, looped: true, calibration: CalibrationMode::First10s };
        let session = u64::from(std::process::id());
        // It holds its first frame. Only its freshness counts, because the targets are our own.
        let player = Player::new(&motion::builtin(), play, session, rt::incarnation());
        let person = Publisher::start(self.instance.input_domain(), player, rt::now);
        self.person = Some(person.map_err(|error| Stop::Failed(error.to_string()))?);
        self.connect()
    }

    fn watch(&mut self, time_s: f64) -> Result<Vec<Sample>, Stop> {
        let (began, mut samples) = (rt::now(), Vec::new());
        self.states.latest();
        loop {
            rt::sleep_until(rt::now().plus_ns(LOOK_NS));
            self.check()?;
            samples.extend(self.states.latest().as_ref().map(sample));
            let passed_s = rt::now().since(began) as f64 * 1e-9;
            if passed_s >= time_s && !samples.is_empty() {
                return Ok(samples);
            }
            if samples.is_empty() && passed_s > STATES_WITHIN_S {
                return Err(Stop::Failed("the driver publishes no state".into()));
            }
        }
    }

    fn engage(&mut self) -> Result<(), Stop> {
        let samples = self.watch(0.1)?;
        self.play(&Path::stand(samples[samples.len() - 1].q))?;
        let free = |status: &Status| status.faults == 0 && status.moving == 0 && status.ticks > TICKS_BEFORE_ENABLE;
        if !self.wait(MODE_WITHIN, free)? {
            return Err(Stop::Failed(format!("the robot cannot be enabled. {}", self.why())));
        }
        if let Some(operator) = &self.operator {
            operator.enable();
        }
        let began = |status: &Status| status.mode == Mode::Engaged as u32 || status.mode == Mode::Faulted as u32;
        if self.wait(MODE_WITHIN, began)? && self.mode() == Some(Mode::Engaged) {
            return Ok(());
        }
        Err(Stop::Failed(format!("the robot did not engage. {}", self.why())))
    }

    fn play(&mut self, path: &Path) -> Result<(), Stop> {
        let (_, input) =
            self.targets.as_mut().ok_or_else(|| Stop::Failed("there is no publisher of targets".into()))?;
        let written = writeln!(input, "{}", path.to_line());
        written.map_err(|error| Stop::Failed(format!("the publisher of targets does not read: {error}")))
    }

    fn release(&mut self) -> Result<(), Stop> {
        if let Some(operator) = &self.operator {
            operator.release();
        }
        if self.wait(MODE_WITHIN, |status| is_off(status) && status.moving == 0)? {
            return Ok(());
        }
        Err(Stop::Failed(format!("the released robot did not come to rest. {}", self.why())))
    }

    fn reset(&mut self) -> Result<bool, Stop> {
        for _ in 0..RESETS {
            if let Some(operator) = &self.operator {
                operator.reset();
            }
            if self.wait(RESET_WITHIN, |status| status.mode == Mode::Disengaged as u32)? {
                return Ok(true);
            }
        }
        Ok(false)
    }

    fn mode(&mut self) -> Option<Mode> {
        self.operator.as_ref().filter(|operator| !operator.is_cut_off())?.mode()
    }

    fn why(&mut self) -> String {
        let status = self.operator.as_ref().and_then(OperatorSession::status);
        let why = status.map_or_else(|| "control does not answer.".into(), |status| explain::why(&status, &self.names));
        self.last_complaint().map_or_else(|| why.clone(), |line| format!("{why} The driver's log ends with: {line}"))
    }

    fn kill(&mut self, victim: Victim) -> Result<f64, Stop> {
        let killed_s = rt::now().0 as f64 * 1e-9;
        match victim {
            Victim::Ingest => self.children.kill("ingest"),
            Victim::Control => self.children.kill("control"),
            Victim::Driver => self.children.kill("driver"),
            Victim::Targets => {
                let (mut child, _) =
                    self.targets.take().ok_or_else(|| Stop::Failed("there is no publisher of targets".into()))?;
                let _ = child.kill();
                let _ = child.wait();
            }
        }
        Ok(killed_s)
    }

    fn restart(&mut self, victim: Victim) -> Result<(), Stop> {
        match victim {
            Victim::Ingest => self.children.start_one("ingest").map_err(failed),
            Victim::Targets => self.start_targets(),
            Victim::Driver => self.children.start_one("driver").map_err(failed),
            Victim::Control => {
                self.operator = None;
                self.children.start_one("control").map_err(failed)?;
                self.connect()
            }
        }
    }

    fn pause(&mut self, time_s: f64) -> Result<(), Stop> {
        let until = rt::now().plus_ns((time_s * 1e9) as u64);
        if self.shutdown.sleep_until(until) { Ok(()) } else { Err(Stop::Interrupted) }
    }

    fn button(&self) -> String {
        match self.children.id("robot") {
            Some(id) if self.loaded.driver_program().is_none() => {
                format!(" (this robot is simulated: kill -USR1 {id} presses it, kill -USR2 {id} releases it)")
            }
            _ => String::new(),
        }
    }
}
