//! One part of an attack: runs the stages, the driver's follower and the simulated robot's checker for some ticks.

use crate::figures::{Least, Merge, Most, RunFigures};
use crate::stages::{Stages, Subject, permit, target};
use crate::stop_times;
use checker::{TOLERANCE_CLEARANCE_M, ViolationKind};
use control::{Continue, Stream};
use driver::Refusal;
use judge::Attacker;
use messages::{Header, JOINTS_MAX, JointCommand, JointMotion, Layout, Mode, RobotState, TICK_S, deadline, state_flag};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use report::derived_seed;
use robot::Frames;
use safety::engage::Permit;
use safety::gate::Denial;
use safety::monitor;
use world::simulated;

/// Ticks of one part. Parts are independent, so the figures do not depend on how many threads run them.
pub const PART_TICKS: u64 = 100_000;

/// The first tick. It is not zero, because a stamp of zero means "never".
const FIRST_K: u64 = 1500;

/// Mean number of ticks per disturbance.
const DISTURBED_EVERY: u32 = 400;
/// Mean number of disturbances per silence that latches the driver's fault.
const LATCHED_EVERY: u32 = 100;
/// Mean number of commands per plan that is rolled out to rest.
const ROLLED_EVERY: u32 = 1000;
/// A command is near the boundary if its clearance is within this of d_min, m.
const NEAR_M: f64 = 1e-3;

/// Formats a denial without the joint or the pair.
fn reason(denial: &Denial) -> String {
    match denial {
        Denial::Joint { check, .. } => format!("{check:?}"),
        other => format!("{other:?}").split([' ', '(']).take(1).collect(),
    }
}

/// An interruption of control or of the driver.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Disturbance {
    /// Ticks in which control does not run.
    control_ticks: u64,
    /// Ticks in which the driver does not run. It catches up with all of them at once.
    driver_ticks: u64,
    /// True if the command of this tick never arrives.
    lost: bool,
}

impl Disturbance {
    fn draw(subject: &Subject, rng: &mut Pcg64) -> Self {
        if rng.random_range(0..DISTURBED_EVERY) != 0 {
            return Self::default();
        }
        if rng.random_range(0..LATCHED_EVERY) == 0 {
            return Self { control_ticks: rng.random_range(16..400), ..Self::default() };
        }
        let ticks = rng.random_range(1..driver::GAP_MAX_TICKS);
        match rng.random_range(0..4) {
            0 => Self { control_ticks: ticks, driver_ticks: ticks, ..Self::default() },
            1 => Self { lost: true, ..Self::default() },
            2 if subject.pauses => {
                Self { driver_ticks: rng.random_range(driver::GAP_MAX_TICKS..driver::SILENCE_TICKS), ..Self::default() }
            }
            _ => Self { control_ticks: ticks, ..Self::default() },
        }
    }
}

/// A stop that is timed from the tick in which the permit ended.
#[derive(Clone, Copy, Debug)]
struct Watched {
    began_k: u64,
    bound_s: f64,
    /// True at rest. Nothing is timed then until the next permit.
    done: bool,
}

struct Part<'a> {
    part: u64,
    subject: &'a Subject,
    stages: Stages<'a>,
    robot: simulated::State,
    attacker: Attacker<'a>,
    rng: Pcg64,
    stream: Option<Stream>,
    echo: RobotState,
    sequence: u64,
    reset_count: u32,
    disturbance: Disturbance,
    watched: Option<Watched>,
    /// True if the robot stopped by itself and rests closer than a start allows. The operator then recovers it.
    recovers: bool,
    frames: Frames,
    last_q: [f64; JOINTS_MAX],
    figures: RunFigures,
}

/// Runs part `part` of an attack with seed `seed` over `ticks` ticks, from rest in the home posture.
pub fn run(subject: &Subject, seed: u64, part: u64, ticks: u64) -> RunFigures {
    let seed = derived_seed(seed, part);
    let mut run = Part::new(subject, part, seed);
    for k in FIRST_K + 1..=FIRST_K + ticks {
        run.tick(k);
    }
    let mut figures = run.figures;
    let report = run.robot.report();
    figures.violations = ViolationKind::ALL.map(|kind| report.violations_of(kind));
    figures.violations.merge(figures.rollout_violations);
    figures.min_clearance_m.merge(Least(report.min_proved_clearance_m));
    figures.min_unproved_clearance_m = Least(report.min_clearance_m);
    figures.torque_share_max = Most(report.largest_torque_share().0);
    let judged = run.robot.judged();
    figures.true_violations = judged.counts;
    figures.true_speed_ratio_max = Most(judged.speed_ratio_max.into_iter().fold(0.0, f64::max));
    figures.true_clearance_min_m = Least(judged.clearance_min_m);
    figures.first_true = judged.first.map(|first| (first, part));
    figures.first = report.first_violation.map(|violation| (violation, part));
    figures
}

impl<'a> Part<'a> {
    fn new(subject: &'a Subject, part: u64, seed: u64) -> Self {
        let mut robot = simulated::State::new(&subject.simulated, FIRST_K, seed);
        let input = driver::DriveInput { due_k: FIRST_K, command: None };
        let echo = simulated::tick(&subject.simulated, &mut robot, deadline(FIRST_K), input).state;
        let q = robot.follower().motion.q;
        Self {
            part,
            subject,
            stages: Stages::at_rest(subject, q),
            robot,
            attacker: Attacker::new(&subject.robot, Pcg64::seed_from_u64(derived_seed(seed, 1))),
            rng: Pcg64::seed_from_u64(derived_seed(seed, 2)),
            stream: None,
            echo,
            sequence: 0,
            reset_count: 0,
            disturbance: Disturbance::default(),
            watched: None,
            recovers: false,
            frames: Frames::default(),
            last_q: q,
            figures: RunFigures::default(),
        }
    }

    fn tick(&mut self, k: u64) {
        let before = self.violations();
        let v_before = self.robot.follower().motion.v;
        self.attacker.next(k, &self.last_q);
        if self.disturbance == Disturbance::default() {
            self.disturbance = Disturbance::draw(self.subject, &mut self.rng);
        }
        let runs = self.disturbance.control_ticks == 0;
        let command = if runs { self.control(k) } else { None };
        self.figures.missed += u64::from(!runs);
        let asleep = self.disturbance.driver_ticks > 0;
        let lost = std::mem::take(&mut self.disturbance.lost);
        self.figures.lost += u64::from(lost && command.is_some());
        if asleep {
            self.figures.overslept += 1;
        } else {
            self.drive(k, command.filter(|_| !lost).as_ref());
        }
        self.disturbance.control_ticks = self.disturbance.control_ticks.saturating_sub(1);
        self.disturbance.driver_ticks = self.disturbance.driver_ticks.saturating_sub(1);
        self.watch(k, asleep, &v_before);
        let after = self.violations();
        let of_attack = &mut self.figures.attacks[self.attacker.attack as usize];
        of_attack.ticks += 1;
        of_attack.violations += after - before;
        self.figures.ticks += 1;
    }

    fn violations(&self) -> u64 {
        self.robot.report().violations_total() + self.figures.rollout_violations.iter().sum::<u64>()
    }

    fn latched(&self) -> bool {
        self.echo.flags & state_flag::DRIVER_FAULT != 0
    }

    /// The permit of engagement: a stop while the driver's fault is latched, and recovery alone where a start
    /// is refused.
    fn permit(&self) -> Permit {
        match (self.latched(), self.recovers) {
            (true, _) => Permit::Stop,
            (false, true) => Permit::Recover,
            (false, false) => permit(&self.attacker),
        }
    }

    /// A robot that stopped by itself, on an unproved path, may rest too close to start. Recovery moves it apart.
    fn watch_start(&mut self) {
        let model = &self.subject.model;
        if self.recovers {
            self.recovers = !monitor::clear_to_start(model, &mut self.frames, &self.echo.q);
        } else if self.is_own_motion() && self.echo.v == [0.0; JOINTS_MAX] {
            let clearance = monitor::measured_clearance(model, &mut self.frames, &self.echo.q);
            self.recovers = !clearance.is_at_least(model.d_min_m - TOLERANCE_CLEARANCE_M);
            self.figures.recoveries += u64::from(self.recovers);
        }
    }

    /// Returns true if the driver executes a motion of its own, which no command began.
    fn is_own_motion(&self) -> bool {
        self.echo.command_incarnation == 0
    }

    /// Runs the control tick as the daemon composes it.
    fn control(&mut self, k: u64) -> Option<JointCommand> {
        let from = Stream::prepare(&mut self.stream, Some(&self.echo), k, 1);
        match from {
            Continue::Nothing => return None,
            Continue::Own => {}
            Continue::From(motion) => {
                self.stages.reseed(&motion);
                self.figures.reseeds += 1;
            }
        }
        if self.subject.gate.is_some() {
            self.watch_start();
        }
        let resting = self.echo.v.iter().chain(&self.echo.a).all(|x| *x == 0.0);
        if self.latched() && resting && self.echo.reset_count == self.reset_count {
            self.reset_count += 1;
        }
        let now = deadline(k);
        let (out, ns) = self.stages.tick(k, now, target(&self.attacker), self.permit());
        let figures = &mut self.figures;
        let of_attack = &mut figures.attacks[self.attacker.attack as usize];
        figures.tick.0.record_ns(ns);
        of_attack.tick.0.record_ns(ns);
        figures.fallbacks += u64::from(out.proposed.fallbacks);
        of_attack.fallbacks += u64::from(out.proposed.fallbacks);
        figures.overloads += u64::from(out.proposed.overloads);
        of_attack.near += u64::from(out.proposed.clearance_m < self.subject.model.d_min_m + NEAR_M);
        if let Some(denial) = out.denied {
            figures.denials += 1;
            of_attack.denials += 1;
            figures.denied_for.count(reason(&denial), || format!("part {}, tick {k}: {denial:?}", self.part));
        }
        let flags = out.proposed.command_flags(out.denied.is_some());
        let longest = out.motion.plan.duration_s.iter().map(|phases| phases.iter().sum::<f64>()).fold(0.0, f64::max);
        figures.worst_stop_s.merge(Most(longest));
        let proved = !self.recovers && !self.is_own_motion();
        if self.rng.random_range(0..ROLLED_EVERY) == 0 && proved {
            self.roll(&out.motion);
        }
        let stream = self.stream.as_mut()?;
        stream.sent(k, out.motion);
        let chain = stream.chain();
        self.sequence += 1;
        let command = JointCommand {
            header: Header { sequence: self.sequence, stamp: now, incarnation: chain.incarnation, ..Header::ZERO },
            robot: self.subject.model.id(),
            k,
            seed_k: chain.seed_k,
            seed_played: chain.seed_played,
            mode: if self.recovers { Mode::Recovering } else { Mode::Engaged } as u32,
            reset_count: self.reset_count,
            flags,
            ..JointCommand::ZERO
        };
        Some(command.with_motion(&out.motion))
    }

    fn roll(&mut self, motion: &JointMotion) {
        let offset = self.rng.random_range(0.0..1.0);
        let rolled =
            judge::roll(&self.subject.robot, self.subject.simulated.driver(), wbc::torque::SHARE, motion, offset);
        self.figures.rollouts += 1;
        self.figures.min_clearance_m.merge(Least(rolled.min_clearance_m));
        self.figures.rollout_torque_share.merge(Most(rolled.torque_share));
        self.figures.rollout_violations.merge(rolled.violations);
    }

    /// The driver executes the due command, and the simulated robot's checker judges every step of it.
    fn drive(&mut self, k: u64, command: Option<&JointCommand>) {
        let was_latched = self.latched();
        let input = driver::DriveInput { due_k: k, command };
        let out = simulated::tick(&self.subject.simulated, &mut self.robot, deadline(k), input);
        self.echo = out.state;
        self.figures.latches += u64::from(!was_latched && self.latched());
        // A driver that was suspended rightly takes no command of its old chain.
        let suspended = out.advanced > driver::GAP_MAX_TICKS;
        let refused = out.refused.filter(|&refusal| refusal != Refusal::Latched && !suspended);
        if let Some(refusal) = refused {
            self.figures.refusals += 1;
            self.figures.refused_for.count(format!("{refusal:?}"), || format!("part {}, tick {k}", self.part));
        }
        for j in (0..self.subject.model.count).filter(|&j| !self.subject.model.prismatic[j]) {
            self.figures.travelled_rad += (out.state.q[j] - self.last_q[j]).abs();
        }
        self.last_q = out.state.q;
    }

    /// Times the stop that begins with the end of a permit, from the last executed state before it to exact
    /// rest. A suspended driver shows no rest, so that time is not counted.
    fn watch(&mut self, k: u64, asleep: bool, v_before: &[f64; JOINTS_MAX]) {
        if asleep || !matches!(self.permit(), Permit::Stop) {
            self.watched = None;
            return;
        }
        let at_rest = self.robot.follower().motion.is_at_rest();
        let bound_s = stop_times::stop_bound_s(self.subject.wbc.bounds(), v_before);
        let watched = *self.watched.get_or_insert(Watched { began_k: k - 1, bound_s, done: at_rest });
        if at_rest && !watched.done {
            let took_s = (k - watched.began_k) as f64 * TICK_S;
            self.figures.stops += 1;
            self.figures.worst_watched_stop_s.merge(Most(took_s));
            // If the motors have little reserve, a stop is gentler. It may then take as long as the robot file says.
            let latest_s = stop_times::reaction_s() + self.subject.model.stop_time_max_s;
            self.figures.late_stops += u64::from(took_s > watched.bound_s.max(latest_s));
            self.figures.gentle_stops += u64::from(took_s > watched.bound_s);
            self.watched = Some(Watched { done: true, ..watched });
        }
    }
}
