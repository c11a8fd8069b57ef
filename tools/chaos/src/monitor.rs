//! What the driver executes, seen over shared memory by a reader of its own and held against the limits by the simulated
//! robot's checker: whatever is seen of it, the steps in between are bounded too. A driver that dies takes its own record
//! with it; this one stays.

use bus::{Domain, DomainConfig};
use driver::Setpoint;
use messages::{JOINTS, Mode, RobotMeasured, RobotState, Service};
use sim::{Checker, Config, Report, ViolationKind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard};
use std::thread::JoinHandle;
use std::time::Duration;

/// Time between two looks: half a tick, so that few states are missed.
const LOOK: Duration = Duration::from_micros(333);

/// Largest noise of a measured speed, rad/s or m/s: eight standard deviations of the simulated drives'.
const NOISE_SPEED: f64 = 0.036;

/// What was seen so far.
#[derive(Clone, Debug, Default)]
pub struct Seen {
    /// The newest state.
    pub latest: Option<RobotState>,
    /// What the robot measured last.
    pub robot: Option<RobotMeasured>,
    /// States looked at.
    pub states: u64,
    /// Violations by kind.
    pub violations: [u64; ViolationKind::ALL.len()],
    /// States with a number that is none.
    pub not_finite: u64,
    /// States in motion while nobody had the right to move the robot.
    pub moved_without_enable: u64,
    /// Whether nobody has that right now.
    pub(crate) must_rest: bool,
}

impl Seen {
    /// The index of the newest state.
    pub fn k(&self) -> u64 {
        self.latest.map_or(0, |state| index(&state))
    }

    /// Whether the robot was last measured standing: no joint faster than noise.
    pub fn robot_stands(&self) -> bool {
        self.robot.is_some_and(|robot| robot.dq.iter().all(|v| v.abs() <= NOISE_SPEED))
    }

    /// Whether the newest state is one of rest.
    pub fn at_rest(&self) -> bool {
        self.latest.is_some_and(|state| stands(&state))
    }
}

/// A thread that looks.
pub struct Monitor {
    seen: Arc<Mutex<Seen>>,
    end: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Monitor {
    /// Begins to look at the driver of `domain`; `config` has the limits, `prismatic` are the joints that slide.
    ///
    /// # Errors
    /// If the shared memory cannot be opened.
    pub fn start(domain: DomainConfig, config: Config, prismatic: [bool; JOINTS]) -> Result<Self, bus::BusError> {
        let (seen, end) = (Arc::new(Mutex::new(Seen::default())), Arc::new(AtomicBool::new(false)));
        let (shared, ended) = (Arc::clone(&seen), Arc::clone(&end));
        let (opened, outcome) = std::sync::mpsc::channel();
        let thread = std::thread::spawn(move || {
            // The port is made here because it cannot change its thread.
            let ports = Domain::open(domain, "witness").and_then(|domain| {
                let states = domain.reader::<RobotState>(Service::RobotState)?;
                Ok((states, domain.reader::<RobotMeasured>(Service::RobotMeasured)?, domain))
            });
            let (mut states, mut robots, _domain) = match ports {
                Ok(ports) => ports,
                Err(error) => return drop(opened.send(Err(error))),
            };
            let _ = opened.send(Ok(()));
            let report = Report::new(prismatic);
            let mut judge = Judge { config, checker: None, report };
            while !ended.load(Ordering::Relaxed) {
                if let Some(state) = states.latest() {
                    judge.look(&mut lock(&shared), &state);
                }
                if let Some(robot) = robots.latest() {
                    lock(&shared).robot = Some(robot);
                }
                std::thread::sleep(LOOK);
            }
        });
        outcome.recv().unwrap_or(Ok(()))?;
        Ok(Self { seen, end, thread: Some(thread) })
    }

    /// What was seen so far.
    pub fn seen(&self) -> Seen {
        lock(&self.seen).clone()
    }

    /// From now on every motion is one without right (`true`), or motion is allowed again.
    pub fn must_rest(&self, must_rest: bool) {
        lock(&self.seen).must_rest = must_rest;
    }
}

impl Drop for Monitor {
    fn drop(&mut self) {
        self.end.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn lock(seen: &Mutex<Seen>) -> MutexGuard<'_, Seen> {
    seen.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
}

/// The checker of the driver that was seen last, and what it counted of all drivers.
struct Judge {
    config: Config,
    checker: Option<(u32, Checker)>,
    report: Report,
}

impl Judge {
    fn look(&mut self, seen: &mut Seen, state: &RobotState) {
        let setpoint = Setpoint { k: index(state), q: state.q, v: state.v, a: state.a };
        let writer = state.header.incarnation;
        let gap = seen.latest.is_some_and(|last| setpoint.k.saturating_sub(index(&last)) > driver::GAP_MAX_TICKS);
        match &mut self.checker {
            // It executes no command, or was suspended: it begins where the robot is measured. The robot's judge looks at that.
            // Modes are control's; here every motion is held against the same limits.
            Some((checked, checker)) if *checked == writer && (state.command_incarnation == 0 || gap) => {
                checker.hold(&self.config, &setpoint);
            }
            Some((checked, checker)) if *checked == writer => {
                checker.step(&self.config, &mut self.report, &setpoint, Mode::Disengaged as u32);
            }
            // A driver that starts begins where it stands.
            checker => *checker = Some((writer, Checker::new(&self.config, setpoint))),
        }
        seen.states += 1;
        seen.not_finite += u64::from(!state.q.iter().chain(&state.v).chain(&state.a).all(|value| value.is_finite()));
        seen.moved_without_enable += u64::from(seen.must_rest && !stands(state));
        seen.violations = ViolationKind::ALL.map(|kind| self.report.violations_of(kind));
        seen.latest = Some(*state);
    }
}

fn index(state: &RobotState) -> u64 {
    state.executed_k.saturating_add(state.plan_ticks_played)
}

fn stands(state: &RobotState) -> bool {
    state.v.iter().chain(&state.a).all(|&value| value == 0.0)
}
