//! One run: the world, the person, the operator, the faults of a schedule and the oracle, tick by tick.

mod receive;
mod start;

use crate::active::{Active, Faults};
use crate::camera::Camera;
use crate::client::Client;
use crate::kinds::{self, Content, Fault, KIND_COUNT, KINDS, LinkFault, Process, ProcessId, Robot, by_name};
use crate::operator_model::OperatorModel;
use crate::oracle::{Oracle, Person, Seen, Violation};
use crate::policy::Policy;
use crate::processes::Processes;
use crate::remote::Remote;
use crate::schedule::{Episode, QUIET_TICKS, RECOVERY_TICKS};
use crate::subject::Subject;
use crate::tampered::{Memory, Tampering};
use bus::FaultPlan;
use messages::{Mode, RawSkeleton, Skeleton, TICK_HZ, Transition, tick_at};
use plant::Injection;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use robot::JointLimits;
use world::{Links, Moment, World};

/// An engagement is "from elsewhere" if a joint is farther than this from its target, rad. That is ten times
/// the bound for aligned.
const ELSEWHERE_RAD: f64 = 0.2;

/// Ticks for which the measured posture may still be held after the drives follow again.
const UNDRIVEN: u64 = 3 + driver::SETTLE_TICKS;
/// Ticks for which a joint may still move because of a fault that has ended: 2 s, twice the longest stop and settling.
const FAULTY: u64 = 3000;

/// Lowest and highest frequency of a joint that oscillates, Hz, and its range of speeds as a share of the
/// joint's limit.
const SWING_HZ: [f64; 2] = [0.1, 20.0];
const SWING_SPEED: [f64; 2] = [0.08, 2.0];

/// A bug that a test plants on purpose, to see that the oracle finds it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bug {
    /// Control misses the emergency stop while the link of targets is bad.
    DeafWhileTargetsAreLost,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// The first broken promise. It ends the run.
    pub violation: Option<Violation>,
    /// Hash over everything that was executed.
    pub hash: u64,
    pub fired: [u64; KIND_COUNT],
    pub ticks_in: [u64; Mode::ALL.len()],
    pub ticks: u64,
    /// Ticks from the end of the faults until the robot follows again. None if it followed throughout.
    pub back_after: Option<u64>,
    pub transitions: Vec<(u64, Transition)>,
}

#[derive(Clone)]
pub struct Run<'a> {
    subject: &'a Subject,
    world: World,
    client: Client,
    hand: OperatorModel,
    /// The way of the person and the operator to the robot, if they are at another machine.
    remote: Option<Box<Remote>>,
    policy: Option<Box<Policy>>,
    faults: Faults,
    processes: Processes,
    memory: Memory,
    oracle: Oracle,
    bug: Option<Bug>,
    links_before: [bus::FaultCounts; 5],
    frames: Vec<RawSkeleton>,
    accepted: Vec<Person>,
    /// Frames in `accepted`, except the last.
    drained: Vec<Skeleton>,
    /// Robot faults in force, as they were injected.
    injected: Vec<Episode>,
    undriven_until: u64,
    faulty_until: u64,
    forged_until: u64,
    /// From this tick on there are no faults.
    quiet_from: u64,
    seed: u64,
    k: u64,
    transitions: Vec<(u64, Transition)>,
    followed_since: Option<u64>,
    /// The last tick of a recovery.
    recovered_at: u64,
    /// Index of the kind that counts engagements far from the person's posture.
    elsewhere: usize,
}

impl<'a> Run<'a> {
    /// Creates a run with a robot at rest at home, and an operator about to engage. With `is_remote`, the operator and the
    /// person are at another machine.
    pub fn cold(subject: &'a Subject, seed: u64, is_remote: bool) -> Self {
        let world = World::new(&subject.config, seed, Links::default());
        Self {
            oracle: Oracle::new(subject.model(), tick_at(world.now())),
            world,
            subject,
            client: Client::new(subject.player.clone(), subject.is_camera.then(|| Camera::new(seed))),
            hand: OperatorModel::new(),
            remote: is_remote.then(|| Box::new(Remote::new(seed))),
            policy: subject.is_policy.then(Box::default),
            faults: Faults::new(&[]),
            processes: Processes::default(),
            memory: Memory::default(),
            bug: None,
            links_before: Default::default(),
            frames: Vec::new(),
            accepted: Vec::new(),
            drained: Vec::new(),
            injected: Vec::new(),
            undriven_until: 0,
            faulty_until: 0,
            forged_until: 0,
            quiet_from: u64::MAX,
            seed,
            k: 0,
            transitions: Vec::new(),
            followed_since: None,
            recovered_at: 0,
            elsewhere: by_name("engage-elsewhere").unwrap_or(0),
        }
    }

    pub fn quiet(self) -> Self {
        Self { quiet_from: 0, ..self }
    }

    /// Returns a copy with its own future, whose ticks are counted from zero.
    pub fn branch(&self, seed: u64) -> Self {
        let mut run = self.clone();
        run.world.reseed_links(seed);
        run.remote.iter_mut().for_each(|remote| remote.reseed(seed));
        run.client.rebase();
        run.policy.iter_mut().for_each(|policy| policy.rebase());
        run.oracle.ticks_in = Default::default();
        (run.seed, run.k, run.quiet_from, run.recovered_at) = (seed, 0, u64::MAX, 0);
        run.transitions.clear();
        run
    }

    pub fn run(mut self, episodes: &[Episode], ticks: u64, bug: Option<Bug>) -> Outcome {
        self.faults = Faults::new(episodes);
        self.bug = bug;
        self.quiet_from = ticks.saturating_sub(QUIET_TICKS);
        let mut violation = None;
        let mut end = ticks;
        while self.k < end && violation.is_none() {
            violation = self.tick().err();
            end = self.end(ticks, end);
            violation = violation.or_else(|| self.alive(end));
        }
        Outcome {
            violation,
            hash: self.oracle.hash,
            fired: self.faults.fired,
            ticks_in: self.oracle.ticks_in,
            ticks: self.k,
            back_after: self.followed_since.map(|k| k.saturating_sub(self.quiet_from)),
            transitions: self.transitions,
        }
    }

    /// Returns the end of a run of `ticks` that would end at `end`: after a slow recovery, the operator has time too.
    fn end(&mut self, ticks: u64, end: u64) -> u64 {
        if self.oracle.mode() == Mode::Recovering {
            self.recovered_at = self.k;
        }
        if self.k < end || self.followed_since.is_some() {
            return end;
        }
        (self.recovered_at + QUIET_TICKS).clamp(end, ticks + RECOVERY_TICKS)
    }

    /// Once the faults are over, the robot follows again in time, and stays engaged.
    fn alive(&mut self, ticks: u64) -> Option<Violation> {
        let (tick, mode) = (self.k - 1, self.oracle.mode());
        // A camera that loses the person stops the robot without any other fault.
        if tick < self.quiet_from || self.subject.is_camera {
            self.followed_since = None;
            return None;
        }
        let broken = |invariant, detail| Some(Violation { tick, invariant, detail });
        let follows = matches!(mode, Mode::Engaging | Mode::Engaged);
        match self.followed_since {
            None if follows => self.followed_since = Some(tick),
            None if tick + 1 == ticks => {
                return broken("liveness", format!("still {} at the end", mode.name()));
            }
            // The effect of an earlier fault may still appear during the tenth of a second in which inputs go
            // stale. An operator who releases a robot that held a moment ago stops it on purpose. So does a policy that
            // comes or goes.
            Some(_)
                if !follows
                    && (tick < self.quiet_from + TICK_HZ / 2
                        || self.hand.has_let_go()
                        || self.policy.as_ref().is_some_and(|policy| policy.is_away(tick))) =>
            {
                self.followed_since = None;
            }
            Some(since) if !follows => {
                return broken("false stop", format!("{} without any fault, engaged since {since}", mode.name()));
            }
            _ => {}
        }
        None
    }

    pub fn tick(&mut self) -> Result<(), Violation> {
        let (k, now) = (self.k, self.world.now());
        let grid = tick_at(now);
        if self.faults.advance(k) {
            self.change_links();
            self.change_robot();
        }
        self.begin_episodes(k);
        if self.processes.awaits_rest(k) {
            let measured = self.world.measure_robot(&self.subject.config);
            self.processes.await_rest(k, &measured);
        }
        let (running, started) = self.processes.at(k);
        self.start(started)?;
        self.receive(running.ingest);
        let view = self.operate(now, running.control)?;
        let [mut requested, done] = view.unwrap_or_default();
        requested.estop_edge &= !self.is_deaf();
        let mut tampering = Tampering { faults: &mut self.faults, memory: &mut self.memory, subject: self.subject };
        let moment = self.world.step_tampered(&self.subject.config, &requested, running, &mut tampering);
        self.accepted.extend(moment.skeleton.as_ref().map(Person::new));
        self.count_links();
        self.client.listen(k, !self.accepted.is_empty());
        if let Some(control) = &moment.control {
            self.hand.read(k, &control.status);
            self.transitions.extend(control.transition.map(|made| (k, made)));
            let engages = control.transition.is_some_and(|made| made.why == Transition::ENABLED);
            if engages && self.is_elsewhere(&moment) {
                self.faults.count(self.elsewhere, 1);
            }
        }
        let policy = self.policy.as_mut().map(|policy| policy.read(k, &moment, started, now)).unwrap_or_default();
        self.k += 1;
        if self.has(|_| true) {
            self.faulty_until = k + FAULTY;
        }
        let robot = self.world.robot_mut();
        if robot.driver().refused() {
            // After a pause of its driver a robot may carry on by itself, whatever its setpoint.
            self.undriven_until = self.undriven_until.max(k + UNDRIVEN);
        }
        let (truth, refused) = (*robot.q(), robot.follower().refused);
        let seen = Seen {
            tick: k,
            k: grid,
            moment: &moment,
            operator: view.map(|_| done),
            accepted: &self.accepted,
            control_restarted: started[ProcessId::Control as usize],
            policy,
            ingest_restarted: started[ProcessId::Ingest as usize],
            driver_restarted: started[ProcessId::Driver as usize],
            undriven: k < self.undriven_until,
            forged: k < self.forged_until,
            report: self.world.report(),
            judged: self.world.judged(),
            robot_faulty: k < self.faulty_until,
            truth,
            refused,
            sent: &self.frames,
            drained: &self.drained,
            unpowered: self.has(|robot| matches!(robot, Robot::PowerReturns | Robot::Stopped)),
            encoders_lie: self.encoders_lie(),
            quiet: k >= self.quiet_from && !self.subject.is_camera,
            calm: self.quiet_from == 0,
            robot: self.subject.model(),
            servo_lag_s: self.subject.config.control.servo_lag_s,
        };
        self.oracle.check(&seen)
    }

    /// Returns true if the person's posture is far from the robot's.
    fn is_elsewhere(&self, moment: &Moment) -> bool {
        let (Some(target), Some(robot)) = (&moment.target, &moment.robot) else { return false };
        (0..self.subject.model().count)
            .any(|j| target.valid_mask & 1 << j != 0 && (target.q[j] - robot.q[j]).abs() > ELSEWHERE_RAD)
    }

    /// Returns true if a fault of the robot that `is` accepts is in force.
    fn has(&self, is: impl Fn(Robot) -> bool) -> bool {
        self.faults.active.iter().any(|active| matches!(active.fault, Fault::Robot(robot) if is(robot)))
    }

    /// Returns true if the measurements, or the reported copy of them, are wrong.
    fn encoders_lie(&self) -> bool {
        let measured = |robot| {
            use Robot::{EncoderJump, EncoderSpike, Frozen, Inverted, Nan, Swapped};
            matches!(robot, EncoderJump | EncoderSpike | Frozen | Nan | Inverted | Swapped)
        };
        let raw = |content| {
            matches!(content, Content::StateSwapped | Content::StateNan | Content::StateFrozen | Content::StateSilent)
        };
        self.faults.active.iter().any(|active| match active.fault {
            Fault::Robot(robot) => measured(robot),
            Fault::Content(content) => raw(content),
            _ => false,
        })
    }

    fn is_deaf(&self) -> bool {
        let lost = |fault| matches!(fault, Fault::Link(2, LinkFault::Drop));
        self.bug == Some(Bug::DeafWhileTargetsAreLost) && self.faults.active.iter().any(|active| lost(active.fault))
    }

    fn begin_episodes(&mut self, k: u64) {
        let (processes, subject) = (&mut self.processes, self.subject);
        let (forged_until, undriven_until) = (&mut self.forged_until, &mut self.undriven_until);
        let faults = &mut self.faults;
        faults.each(
            |fault| if let Fault::Process(process) = fault { Some(process) } else { None },
            |active, process| befall(processes, subject, k, active, process),
        );
        for active in
            faults.active.iter_mut().filter(|a| a.age == 0 && a.fault == Fault::Operator(kinds::OperatorFault::Stuck))
        {
            processes.kill(ProcessId::Control, k, active.rng.random_range(4..120));
        }
        for active in &faults.active {
            match active.fault {
                Fault::Content(_) if KINDS[active.episode.kind].name.ends_with("-target") => *forged_until = k + 300,
                Fault::Content(Content::TargetBits) => *forged_until = k + 300,
                Fault::Robot(Robot::Rejected | Robot::DriveFault | Robot::Stopped | Robot::PowerReturns) => {
                    *undriven_until = k + UNDRIVEN;
                }
                _ => {}
            }
        }
        let robots = |fault| if let Fault::Robot(robot) = fault { Some(robot) } else { None };
        let count = self.subject.model().count;
        let simulated = self.world.robot_mut();
        faults.each(robots, |active, robot| {
            if robot == Robot::EncoderSpike && active.acts() {
                let (joint, by) = (active.rng.random_range(0..count), active.rng.random_range(-0.5..0.5));
                simulated.inject(Injection::EncoderSpike { joint, by });
                return true;
            }
            robot != Robot::EncoderSpike
        });
    }

    /// Applies the faults of the links that are in force. The worst of each kind counts.
    fn change_links(&mut self) {
        let mut plans = [FaultPlan::default(); 5];
        for active in &self.faults.active {
            if let Fault::Link(link, badness) = active.fault {
                let (plan, strength) = (&mut plans[link], active.strength);
                match badness {
                    LinkFault::Drop => plan.drop = plan.drop.max(0.05 + 0.95 * strength * strength),
                    LinkFault::Double => plan.duplicate = plan.duplicate.max(0.3 + 0.7 * strength),
                    LinkFault::Reorder => {
                        plan.reorder = plan.reorder.max(0.1 + 0.5 * strength);
                        plan.reorder_ns = if link < 2 { 60_000_000 } else { 3_000_000 };
                    }
                    LinkFault::Delay => {
                        plan.delay_max_ns = plan.delay_max_ns.max(100_000 + (20e6 * strength * strength) as u64);
                    }
                }
            }
        }
        let [raw, skeleton, target, command, state] = plans;
        self.world.set_links(Links { raw, skeleton, target, command, state });
    }

    fn count_links(&mut self) {
        let counts = self.world.link_counts();
        for active in &self.faults.active {
            if let Fault::Link(link, badness) = active.fault {
                let (now, before) = (&counts[link], &self.links_before[link]);
                self.faults.fired[active.episode.kind] += match badness {
                    LinkFault::Drop => now.dropped - before.dropped,
                    LinkFault::Double => now.duplicated - before.duplicated,
                    LinkFault::Reorder => now.reordered - before.reordered,
                    LinkFault::Delay => now.published - before.published,
                };
            }
        }
        self.links_before = counts;
    }

    /// Repairs robot faults that ended, and injects those in force.
    fn change_robot(&mut self) {
        let wanted: Vec<Episode> =
            self.faults.active.iter().filter(|a| matches!(a.fault, Fault::Robot(_))).map(|a| a.episode).collect();
        if wanted == self.injected {
            return;
        }
        self.world.robot_mut().repair();
        let model = self.subject.model();
        for active in &self.faults.active {
            inject(self.world.robot_mut(), &model.limits[..model.count], active);
        }
        self.undriven_until = self.undriven_until.max(self.k + UNDRIVEN);
        self.injected = wanted;
    }

    pub fn mode(&self) -> Mode {
        self.oracle.mode()
    }
}

fn inject(simulated: &mut world::simulated::State, limits: &[JointLimits], active: &Active) {
    let Fault::Robot(robot) = active.fault else { return };
    let (param, strength) = (active.episode.param, active.strength);
    let mut rng = Pcg64Mcg::seed_from_u64(param ^ 1);
    let (joint, with) = (rng.random_range(0..limits.len()), rng.random_range(0..limits.len()));
    simulated.inject(match robot {
        Robot::EncoderSpike => return,
        Robot::EncoderJump => Injection::EncoderJump { joint, by: strength - 0.5 },
        Robot::Frozen if param.is_multiple_of(2) => Injection::FrozenEncoder { joint },
        Robot::Frozen => Injection::FrozenFeedback,
        Robot::Nan => Injection::NanFeedback { joint },
        Robot::Inverted => Injection::FeedbackInverted { joint },
        Robot::Swapped => Injection::FeedbackSwapped { joint, with },
        Robot::NotFollowed => Injection::NotFollowed { joint },
        Robot::SignInverted => Injection::SignSwapped { joint },
        Robot::Swing => swing(joint, limits[joint].v_max, strength, &mut rng),
        Robot::Rejected => Injection::SetpointsRejected,
        Robot::DriveFault => Injection::DriveFault { joint },
        Robot::Stopped => Injection::EmergencyStopPressed,
        Robot::PowerReturns => {
            Injection::PowerLost { sag: if param.is_multiple_of(2) { 0.0 } else { 0.05 * strength } }
        }
    });
}

/// Creates an oscillation of any frequency that a drive may have. Its speed ranges from a tolerated one to twice the
/// limit of the joint. Slow oscillations are drawn more often, because only the tracking error detects them.
fn swing(joint: usize, v_max: f64, strength: f64, rng: &mut Pcg64Mcg) -> Injection {
    let frequency = SWING_HZ[0] * (SWING_HZ[1] / SWING_HZ[0]).powf(rng.random());
    let speed = SWING_SPEED[0] * (SWING_SPEED[1] / SWING_SPEED[0]).powf(strength * strength) * v_max;
    Injection::Swing { joint, amplitude: speed / (std::f64::consts::TAU * frequency), frequency }
}

/// Applies a fault of a process. Returns true if the fault acted in this tick.
fn befall(processes: &mut Processes, subject: &Subject, k: u64, active: &mut Active, process: Process) -> bool {
    let first = active.age == 0;
    match process {
        Process::Kill(who) => {
            // Once at the beginning, and at random times during the episode.
            if !first && active.rng.random_range(0..100) != 0 {
                return false;
            }
            // A driver that starts waits before it reads the robot.
            let least = if who == ProcessId::Driver { driver::START_AFTER_TICKS } else { 4 };
            let dead = active.rng.random_range(least..120);
            processes.kill(who, k, dead);
        }
        Process::Stop(who) => processes.stop(who, k, 1),
        Process::PauseAll => {
            for who in [ProcessId::Ingest, ProcessId::Retarget, ProcessId::Control, ProcessId::Driver] {
                processes.stop(who, k, 1);
            }
        }
        Process::ControlLate => {
            if active.rng.random_range(0..20) != 0 {
                return false;
            }
            processes.stop(ProcessId::Control, k, active.rng.random_range(1..4));
        }
        Process::FoundOutside | Process::FoundClose => {
            if !first {
                return false;
            }
            processes.kill(ProcessId::Driver, k, active.episode.ticks.max(driver::START_AFTER_TICKS));
            let postures = if process == Process::FoundClose { &subject.close } else { &subject.outside };
            processes.moved_to = Some(postures[active.rng.random_range(0..postures.len())]);
        }
    }
    true
}
