//! Reads what the driver executes over shared memory with a reader of its own. The simulated robot's checker
//! compares it with the limits. The checker also bounds the steps between two states that were read. A driver
//! that dies loses its own record, but this record remains.

use bus::{Domain, DomainConfig};
use checker::{Checker, Config, Report, ViolationKind};
use driver::Setpoint;
use messages::{Mode, RobotMeasured, RobotState, Service};
use rt::Background;
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;

/// Time between two reads: half a tick, so that few states are missed.
const LOOK: Duration = Duration::from_micros(333);

/// Largest noise of a measured speed, rad/s or m/s: eight standard deviations of the simulated drives' noise.
const NOISE_SPEED: f64 = 0.036;

#[derive(Clone, Debug, Default)]
pub struct Seen {
    /// The newest state.
    pub latest: Option<RobotState>,
    /// The last measurement of the robot.
    pub robot: Option<RobotMeasured>,
    pub states: u64,
    pub violations: [u64; ViolationKind::ALL.len()],
    /// Number of states with NaN or infinity.
    pub not_finite: u64,
    /// Number of states in motion while the robot was not allowed to move.
    pub moved_without_enable: u64,
    /// True if the robot may not move now.
    pub(crate) must_rest: bool,
}

impl Seen {
    pub fn k(&self) -> u64 {
        self.latest.map_or(0, |state| index(&state))
    }

    /// Returns true if the robot was at rest in the last measurement: no joint was faster than noise.
    pub fn robot_stands(&self) -> bool {
        self.robot.is_some_and(|robot| robot.dq.iter().all(|v| v.abs() <= NOISE_SPEED))
    }

    pub fn at_rest(&self) -> bool {
        self.latest.is_some_and(|state| stands(&state))
    }
}

pub struct Monitor {
    seen: Arc<Mutex<Seen>>,
    _thread: Background,
}

impl Monitor {
    /// Begins to watch the driver of `domain`. `config` has the limits.
    pub fn start(domain: DomainConfig, config: Config) -> Result<Self, bus::BusError> {
        let seen = Arc::new(Mutex::new(Seen::default()));
        let shared = Arc::clone(&seen);
        let open = || {
            let domain = Domain::open(domain, "witness")?;
            let states = domain.reader::<RobotState>(Service::RobotState)?;
            Ok((states, domain.reader::<RobotMeasured>(Service::RobotMeasured)?, domain))
        };
        let thread = Background::opened("witness", open, move |(mut states, mut robots, _domain), ends| {
            let mut judge = Judge { config, checker: None, report: Report::default() };
            while !ends.load(Ordering::Relaxed) {
                if let Some(state) = states.latest() {
                    judge.look(&mut lock(&shared), &state);
                }
                if let Some(robot) = robots.latest() {
                    lock(&shared).robot = Some(robot);
                }
                std::thread::sleep(LOOK);
            }
        })?;
        Ok(Self { seen, _thread: thread })
    }

    pub fn seen(&self) -> Seen {
        lock(&self.seen).clone()
    }

    /// Sets whether the robot must rest. From now on every motion counts as forbidden (`true`), or motion is
    /// allowed again.
    pub fn must_rest(&self, must_rest: bool) {
        lock(&self.seen).must_rest = must_rest;
    }
}

fn lock(seen: &Mutex<Seen>) -> MutexGuard<'_, Seen> {
    seen.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
}

/// The checker of the last driver that was seen, and its counts over all drivers.
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
            // The driver executes no command, or was suspended. So it begins at the measured posture, which the
            // robot's judge checks. The modes belong to control. Here the same limits apply to every motion.
            Some((checked, checker)) if *checked == writer && (state.command_incarnation == 0 || gap) => {
                checker.hold(&self.config, &setpoint);
            }
            Some((checked, checker)) if *checked == writer => {
                checker.step(&self.config, &mut self.report, &setpoint, Mode::Disengaged as u32);
            }
            // A driver that starts begins at the posture where the robot stands.
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
