//! All stages in one thread with virtual time. The ticks are those of the processes, in the same order, over links
//! that may be faulty. `replay --offline` and `simulate` use it.

use crate::simulated;
use crate::stages::simulated_config;
use crate::tamper::{Tamper, Untampered};
use bus::{FaultCounts, FaultPlan, Faulty, Latest, Publish};
use config::{ConfigError, Loaded};
use driver::DriveInput;
use ingest::{Authority, ClientIdentity, PolicyState};
use messages::{
    ChunkDrop, Header, JOINTS_MAX, JointCommand, JointTarget, PolicyChunk, RawSkeleton, RobotState, Skeleton, Stamp,
    deadline,
};
use retarget::policy;
use safety::engage::OperatorView;

/// Virtual time from a tick's deadline to its target, its command, and its execution, ns. The order is that of the
/// live system, with some of its delays: each stage works tens of microseconds.
const TARGET_AFTER_NS: u64 = 20_000;
const COMMAND_AFTER_NS: u64 = 60_000;
const EXECUTION_AFTER_NS: u64 = 120_000;

/// Tick at which virtual time begins. It is not zero, because a stamp of zero means "never".
const FIRST_TICK: u64 = 1500;

/// Incarnations of the virtual processes. A restart takes the next one.
#[derive(Clone, Copy, Debug, Default)]
struct Incarnations {
    last: u32,
}

impl Incarnations {
    fn draw(&mut self) -> u32 {
        self.last += 1;
        self.last
    }
}

/// The configuration of every stage.
#[derive(Clone, Debug)]
pub struct WorldConfig {
    input: ingest::Config,
    retarget: retarget::Config,
    policy: policy::Config,
    /// Configuration of the control tick.
    pub control: control::Config,
    robot: simulated::Config,
    config_hash: u64,
    authority_timeout_ns: u64,
}

impl WorldConfig {
    /// Builds the configuration of one virtual instance, with the stale times of a real-time machine.
    pub fn new(loaded: &Loaded) -> Result<Self, ConfigError> {
        Ok(Self {
            input: crate::input_config(
                &loaded.settings.ingest,
                loaded.layouts.clone(),
                &loaded.operators,
                loaded.lifter.clone(),
            ),
            retarget: crate::retarget_config(loaded)?,
            policy: crate::policy_config(loaded),
            control: crate::control_config(loaded, true)?,
            robot: simulated_config(loaded, false)?,
            config_hash: loaded.hash,
            authority_timeout_ns: (loaded.settings.ingest.authority_timeout_ms * 1e6) as u64,
        })
    }

    /// As [`WorldConfig::new`], but the robot may be outside its limits or too close to itself when its driver
    /// starts. That is no violation. Going further out is one.
    pub fn recoverable(loaded: &Loaded) -> Result<Self, ConfigError> {
        Ok(Self { robot: simulated_config(loaded, true)?, ..Self::new(loaded)? })
    }
}

/// Faults of each link.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Links {
    /// Client to ingest.
    pub raw: FaultPlan,
    /// Ingest to retarget.
    pub skeleton: FaultPlan,
    /// Retarget to control.
    pub target: FaultPlan,
    /// Control to driver.
    pub command: FaultPlan,
    /// Driver to control.
    pub state: FaultPlan,
}

/// Processes that run in this tick. One that does not run is stopped, not dead: it keeps its state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Running {
    /// `ingest`.
    pub ingest: bool,
    /// `retarget`.
    pub retarget: bool,
    /// `control`.
    pub control: bool,
    /// The driver.
    pub driver: bool,
}

impl Running {
    /// All processes run.
    pub const ALL: Self = Self { ingest: true, retarget: true, control: true, driver: true };
}

/// State of all stages and links at one instant.
#[derive(Clone, Debug)]
pub struct World {
    k: u64,
    first_k: u64,
    incarnations: Incarnations,
    authority: Authority,
    input: ingest::State,
    skeleton_header: Header,
    /// On the heap, as the two below: a stack of 2 MiB holds few copies of a world.
    retarget: Box<retarget::State>,
    retarget_header: Header,
    /// The policy, once one has published. It has one client and no faulty links.
    policy: Option<Box<(PolicyState, policy::State)>>,
    policy_authority: Authority,
    chunk: Option<Box<PolicyChunk>>,
    control: Box<control::State>,
    robot: Box<simulated::State>,
    driver_header: Header,
    raw: Faulty<RawSkeleton>,
    skeletons: Faulty<Skeleton>,
    targets: Faulty<JointTarget>,
    commands: Faulty<JointCommand>,
    states: Faulty<RobotState>,
}

/// Events of one tick.
#[derive(Clone, Copy, Debug)]
pub struct Moment {
    /// Tick, counted from the start of the world.
    pub k: u64,
    /// Skeleton that `ingest` published, if any.
    pub skeleton: Option<Skeleton>,
    /// Target that control received in this tick.
    pub target_seen: Option<JointTarget>,
    /// Policy's target that control received in this tick.
    pub policy_seen: Option<JointTarget>,
    /// Robot state that control received in this tick.
    pub state_seen: Option<RobotState>,
    /// Target of this tick, if retarget ran.
    pub target: Option<JointTarget>,
    /// Control's output, if it ran.
    pub control: Option<control::Output>,
    /// The robot after this tick, if the driver ran.
    pub robot: Option<RobotState>,
}

impl World {
    /// Creates a world at rest in the home posture. `seed` determines every fault and all noise.
    pub fn new(config: &WorldConfig, seed: u64, links: Links) -> Self {
        let mut incarnations = Incarnations::default();
        let header = |incarnations: &mut Incarnations| Header {
            sequence: 0,
            stamp: Stamp::NONE,
            origin: Stamp::NONE,
            config_hash: config.config_hash,
            incarnation: incarnations.draw(),
            reserved: 0,
        };
        Self {
            k: FIRST_TICK,
            first_k: FIRST_TICK,
            authority: Authority::default(),
            input: ingest::State::default(),
            skeleton_header: header(&mut incarnations),
            retarget: Box::default(),
            retarget_header: header(&mut incarnations),
            policy: None,
            policy_authority: Authority::default(),
            chunk: None,
            control: Box::new(control::State::new(&config.control, incarnations.draw())),
            robot: Box::new(simulated::State::new(&config.robot, FIRST_TICK - 1, seed)),
            driver_header: header(&mut incarnations),
            raw: Faulty::new(links.raw, seed ^ 1),
            skeletons: Faulty::new(links.skeleton, seed ^ 2),
            targets: Faulty::new(links.target, seed ^ 3),
            commands: Faulty::new(links.command, seed ^ 4),
            states: Faulty::new(links.state, seed ^ 5),
            incarnations,
        }
    }

    /// Virtual time at the deadline of the next tick.
    pub fn now(&self) -> Stamp {
        deadline(self.k)
    }

    /// Ticks since the start.
    pub fn ticks(&self) -> u64 {
        self.k - self.first_k
    }

    /// Publishes a client's frame now.
    pub fn publish(&mut self, raw: &RawSkeleton) {
        let _ = self.raw.publish(raw);
    }

    /// Publishes a policy's chunk now.
    ///
    /// # Errors
    /// Returns the reason for which `ingest` drops it.
    pub fn publish_chunk(&mut self, config: &WorldConfig, chunk: &PolicyChunk) -> Result<(), ChunkDrop> {
        let now = self.now();
        let claim = ClientIdentity { session_nonce: chunk.session_nonce, ..ClientIdentity::default() };
        if !self.policy_authority.admits_claim(now, claim, config.authority_timeout_ns) {
            return Err(ChunkDrop::Lease);
        }
        let (state, _) = &mut **self.policy.get_or_insert_default();
        let chunk = state.judge(config.control.model.id(), now, chunk)?;
        // Another `ingest` draws another session.
        let session_nonce = chunk.session_nonce ^ u64::from(self.skeleton_header.incarnation) << 32;
        self.chunk = Some(Box::new(PolicyChunk { session_nonce, ..chunk }));
        Ok(())
    }

    /// Changes the faults of the links.
    pub fn set_links(&mut self, links: Links) {
        self.raw.set_plan(links.raw);
        self.skeletons.set_plan(links.skeleton);
        self.targets.set_plan(links.target);
        self.commands.set_plan(links.command);
        self.states.set_plan(links.state);
    }

    /// Counts of the links' faults so far, in the order of [`Links`].
    pub fn link_counts(&self) -> [FaultCounts; 5] {
        let (raw, skeleton) = (self.raw.counts(), self.skeletons.counts());
        [raw, skeleton, self.targets.counts(), self.commands.counts(), self.states.counts()]
    }

    /// Gives the links new random seeds, so that copied worlds diverge.
    pub fn reseed_links(&mut self, seed: u64) {
        self.raw.reseed(seed ^ 1);
        self.skeletons.reseed(seed ^ 2);
        self.targets.reseed(seed ^ 3);
        self.commands.reseed(seed ^ 4);
        self.states.reseed(seed ^ 5);
    }

    /// Kills and restarts `ingest`.
    pub fn restart_ingest(&mut self) {
        (self.authority, self.policy_authority) = (Authority::default(), Authority::default());
        self.input = ingest::State::default();
        self.policy.iter_mut().for_each(|policy| policy.0 = PolicyState::default());
        self.skeleton_header.incarnation = self.incarnations.draw();
        self.skeleton_header.sequence = 0;
    }

    /// Kills and restarts `control`.
    pub fn restart_control(&mut self, config: &WorldConfig) {
        *self.control = control::State::new(&config.control, self.incarnations.draw());
    }

    /// Kills and restarts `retarget`.
    pub fn restart_retarget(&mut self) {
        *self.retarget = retarget::State::default();
        self.chunk = None;
        if let Some(policy) = &mut self.policy {
            policy.1 = policy::State::default();
        }
        self.retarget_header.incarnation = self.incarnations.draw();
        self.retarget_header.sequence = 0;
    }

    /// Restarts the driver after at least [`driver::START_AFTER_TICKS`] without it. The robot keeps its posture,
    /// or has the posture `q` if it was moved meanwhile. Returns false and changes nothing if the robot measures
    /// no valid posture or `q` is none.
    pub fn restart_driver(&mut self, config: &WorldConfig, q: Option<&[f64; JOINTS_MAX]>, seed: u64) -> bool {
        let (k, now) = (self.k - 1, deadline(self.k - 1).plus_ns(EXECUTION_AFTER_NS));
        let started = match q {
            None => self.robot.restart_driver(&config.robot, k, now, seed),
            Some(q) => simulated::State::standing(&config.robot, k, q, seed).map(|robot| *self.robot = robot).is_some(),
        };
        if !started {
            return false;
        }
        self.driver_header.incarnation = self.incarnations.draw();
        self.driver_header.sequence = 0;
        true
    }

    /// Returns the robot's current measurement, as a driver that is about to start reads it.
    pub fn measure_robot(&mut self, config: &WorldConfig) -> driver::Measured {
        self.robot.measure(&config.robot, self.now())
    }

    /// The checker's report of the executed commands.
    pub fn report(&self) -> &checker::Report {
        self.robot.report()
    }

    /// Judgement of the joints' true motion.
    pub fn judged(&self) -> &plant::Report {
        self.robot.judged()
    }

    /// The simulated robot, so that tests can inject its faults.
    pub fn robot_mut(&mut self) -> &mut simulated::State {
        &mut self.robot
    }

    /// Lets `ingest` take the newest frame now. A client that publishes faster than the tick needs it for every
    /// frame, because the link keeps only the newest one.
    pub fn drain_raw(&mut self, config: &WorldConfig) -> Option<Skeleton> {
        let now = deadline(self.k);
        self.raw.advance(now);
        self.skeletons.advance(now);
        self.ingest(config, now, &mut Untampered)
    }

    /// Advances the world by one tick.
    pub fn step(&mut self, config: &WorldConfig, operator: &OperatorView, running: Running) -> Moment {
        self.step_tampered(config, operator, running, &mut Untampered)
    }

    /// As [`World::step`], with messages that `tamper` may alter when they are published.
    pub fn step_tampered(
        &mut self,
        config: &WorldConfig,
        operator: &OperatorView,
        running: Running,
        tamper: &mut impl Tamper,
    ) -> Moment {
        let (k, start) = (self.k, deadline(self.k));
        self.raw.advance(start);
        self.skeletons.advance(start);
        let skeleton = if running.ingest { self.ingest(config, start, tamper) } else { None };
        self.skeletons.advance(start.plus_ns(1));
        let target = running.retarget.then(|| self.retarget(config, start.plus_ns(TARGET_AFTER_NS), tamper));
        let command_at = start.plus_ns(COMMAND_AFTER_NS);
        self.targets.advance(command_at);
        self.states.advance(command_at);
        let (mut target_seen, mut policy_seen, mut state_seen, mut control) = (None, None, None, None);
        if running.control {
            (target_seen, state_seen) = (self.targets.latest(), self.states.latest());
            policy_seen = running.retarget.then(|| self.lead(config, start.plus_ns(TARGET_AFTER_NS))).flatten();
            let seen = (target_seen.as_ref(), policy_seen.as_ref(), state_seen.as_ref());
            control = Some(self.control(config, command_at, operator, seen, tamper));
        }
        let execution_at = start.plus_ns(EXECUTION_AFTER_NS);
        self.commands.advance(execution_at);
        let robot = if running.driver {
            Some(self.drive(config, execution_at, tamper))
        } else {
            self.robot.advance(&config.robot, execution_at);
            None
        };
        self.k += 1;
        Moment { k: k - self.first_k, skeleton, target_seen, policy_seen, state_seen, target, control, robot }
    }

    fn ingest(&mut self, config: &WorldConfig, now: Stamp, tamper: &mut impl Tamper) -> Option<Skeleton> {
        self.authority.look(now);
        self.policy_authority.look(now);
        let raw = self.raw.latest()?;
        if !self.authority.admits(now, &raw, config.authority_timeout_ns) {
            return None;
        }
        let out = ingest::tick(&config.input, &mut self.input, now, &raw);
        let mut skeleton = out.skeleton?;
        self.skeleton_header.sequence += 1;
        skeleton.header = Header { stamp: now, origin: skeleton.header.origin, ..self.skeleton_header };
        let mut sent = skeleton;
        if tamper.skeleton(&mut sent) {
            let _ = self.skeletons.publish(&sent);
        }
        Some(skeleton)
    }

    fn retarget(&mut self, config: &WorldConfig, now: Stamp, tamper: &mut impl Tamper) -> JointTarget {
        let skeleton = self.skeletons.latest();
        let input = retarget::Input { k: self.k, skeleton: skeleton.as_ref() };
        let mut target = retarget::tick(&config.retarget, &mut self.retarget, now, input).target;
        self.retarget_header.sequence += 1;
        target.header = Header { stamp: now, origin: target.header.origin, ..self.retarget_header };
        let mut sent = target;
        if tamper.target(&mut sent) {
            let _ = self.targets.publish(&sent);
        }
        target
    }

    /// The policy's target of this tick.
    fn lead(&mut self, config: &WorldConfig, now: Stamp) -> Option<JointTarget> {
        let (_, state) = &mut **self.policy.as_mut()?;
        let mut target = policy::tick(&config.policy, state, now, self.k, self.chunk.take().as_deref());
        target.header = Header { stamp: now, origin: target.header.origin, ..self.retarget_header };
        Some(target)
    }

    fn control(
        &mut self,
        config: &WorldConfig,
        now: Stamp,
        operator: &OperatorView,
        (target, policy, robot): (Option<&JointTarget>, Option<&JointTarget>, Option<&RobotState>),
        tamper: &mut impl Tamper,
    ) -> control::Output {
        let input =
            control::Input { k: self.k, target, policy, robot, operator: *operator, ingest: None, realtime_ok: true };
        let out = control::tick(&config.control, &mut self.control, now, input);
        if let Some(mut command) = out.command
            && tamper.command(&mut command)
        {
            let _ = self.commands.publish(&command);
        }
        out
    }

    fn drive(&mut self, config: &WorldConfig, now: Stamp, tamper: &mut impl Tamper) -> RobotState {
        let command = self.commands.latest();
        let input = DriveInput { due_k: self.k, command: command.as_ref() };
        let mut state = simulated::tick(&config.robot, &mut self.robot, now, input).state;
        self.driver_header.sequence += 1;
        state.header = Header { stamp: now, origin: state.header.origin, ..self.driver_header };
        let mut sent = state;
        if tamper.state(&mut sent) {
            let _ = self.states.publish(&sent);
        }
        state
    }
}
