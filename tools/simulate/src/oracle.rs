//! Judges what the robot executes, by differences of positions alone, and hashes it. Knows nothing of the
//! arithmetic of the gate, the certificate or the follower.
//!
//! The executed positions q0, q1, q2, q3 belong to four successive ticks of T seconds. Then (q1 - q0) / T is a
//! mean of the velocity. Likewise (q2 - 2 q1 + q0) / T^2 is a mean of the acceleration, and (q3 - 3 q2 + 3 q1 -
//! q0) / T^3 one of the jerk. The weights of these means are nowhere negative and sum to one (B-splines). So
//! each mean is within the limit for every motion that keeps the limit.

use crate::feedback::Feedback;
use crate::inputs::Inputs;
use crate::modes::{Broken, Modes, moves};
use crate::movement::Movement;
use crate::person_judge::PersonJudge;
use crate::policy::PolicySeen;
use crate::rules::Rules;
use crate::true_motion::TrueMotion;
use checker::Report;
use messages::{Fault, Faults, JOINTS_MAX, JointTarget, Mode, RawSkeleton, RobotState, Skeleton, TICK_HZ, TICK_S};
use robot::{JointLimits, Model};
use safety::engage::OperatorView;
use world::Moment;

/// Longest stop, ticks: 500 ms, as the robots promise.
pub const STOP_TICKS: u64 = TICK_HZ / 2;
/// A command is applied at most this many ticks late, and its stop begins with it.
pub const LATE_TICKS: u64 = 2;
/// Ticks from the decision to the driver's output: the command of the next tick, and one more.
const REACTION_TICKS: u64 = 2;
/// Share of the velocity limits in the first second of engaging.
const FIRST_SHARE: f64 = 0.05;
/// Faults that only say that something is missing, and the ticks for which they may hold an engaging robot that then goes on:
/// 2 s, and a margin.
const GAPS: Faults =
    Faults::NONE.with(Fault::InputStale).with(Fault::NoTarget).with(Fault::TargetStale).with(Fault::StateLate);
const GAP_TICKS: u64 = 2 * TICK_HZ + 10;
/// Rounding of a position, rad or m. Positions reach 3, and a plan is advanced by at most 7500 additions.
const ROUNDING_Q: f64 = 1e-9;
/// Rounding of the differences: positions with a rounding of 1e-14, over T, T^2 and T^3, with a margin.
const ROUNDING_V: f64 = 1e-9;
const ROUNDING_A: f64 = 1e-6;
const ROUNDING_J: f64 = 1e-3;
/// Factor on bounds in rad for a prismatic joint, m.
const SLIDES: f64 = 0.2;
/// Largest speed of a robot at rest, rad/s or m/s. A plan may leave that much.
pub const RESTING: f64 = 1e-6;

#[derive(Clone, Debug, PartialEq)]
pub struct Violation {
    pub tick: u64,
    pub invariant: &'static str,
    pub detail: String,
}

/// The person that a frame shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Person {
    pub session: u64,
    /// Number of the person, as `ingest` counts them.
    pub operator: u32,
}

impl Person {
    pub fn new(skeleton: &Skeleton) -> Self {
        Self { session: skeleton.session_nonce, operator: skeleton.operator_id }
    }
}

pub struct Seen<'a> {
    /// Tick of the run.
    pub tick: u64,
    /// Index of the tick on the grid.
    pub k: u64,
    pub moment: &'a Moment,
    /// The view of the operator that control received, if it ran.
    pub operator: Option<OperatorView>,
    /// Persons of the frames that `ingest` passed on, in order.
    pub accepted: &'a [Person],
    pub control_restarted: bool,
    pub policy: PolicySeen,
    pub ingest_restarted: bool,
    pub driver_restarted: bool,
    /// True if the drives do not follow, or did not a moment ago. The driver then holds the measured posture.
    pub undriven: bool,
    /// True if targets are being forged. Their stamps then mean nothing.
    pub forged: bool,
    /// The checker of the commands that were executed.
    pub report: &'a Report,
    /// The judge of the joints' true motion.
    pub judged: &'a plant::Report,
    /// True if a fault of the robot is in force, or was a moment ago. Its joints then move as the fault dictates.
    pub robot_faulty: bool,
    pub refused: [u64; driver::Refusal::COUNT],
    pub truth: [f64; JOINTS_MAX],
    pub sent: &'a [RawSkeleton],
    /// Frames that `ingest` passed on, except the last.
    pub drained: &'a [Skeleton],
    /// True if no motor has power.
    pub unpowered: bool,
    /// True if a fault falsifies the measurements, or the copy of them that control receives.
    pub encoders_lie: bool,
    /// True if no fault is in force any more.
    pub quiet: bool,
    /// True if no fault was ever in force.
    pub calm: bool,
    pub robot: &'a Model,
    /// Time by which its servos lag behind their setpoints, s.
    pub servo_lag_s: f64,
}

impl Seen<'_> {
    /// The target of the policy that leads, or else of the person.
    pub fn target(&self) -> Option<&JointTarget> {
        if self.policy.leads == 0 { self.moment.target_seen.as_ref() } else { self.moment.policy_seen.as_ref() }
    }

    /// Arms that a person leads: those taken over from a policy, or both.
    pub fn led_by_person(&self) -> [bool; 2] {
        let taken = |side: usize| self.operator.is_some_and(|view| view.takes_over[side] && !view.left_out[side]);
        [0, 1].map(|side| self.policy.leads == 0 || taken(side))
    }

    pub fn is_person_leading(&self) -> bool {
        self.led_by_person() != [false; 2]
    }

    /// Factor on bounds in rad for joint `j`.
    pub fn scale(&self, j: usize) -> f64 {
        if self.robot.prismatic[j] { SLIDES } else { 1.0 }
    }
}

#[derive(Clone, Default)]
pub struct Oracle {
    limits: Vec<JointLimits>,
    /// Executed positions of the last successive indices, newest last.
    window: [[f64; JOINTS_MAX]; 4],
    filled: usize,
    index: Option<u64>,
    executed_k: u64,
    /// How far outside its limits the robot was at the start.
    beyond: [[f64; 2]; JOINTS_MAX],
    checked: u64,
    /// Violations of the joints' true motion so far, including those of faulty robots.
    judged: TrueMotion,
    engaging_k: Option<u64>,
    /// Engaging is held after its first second, by nothing but a gap, and the ticks for which control has held it.
    resumes: bool,
    held: u64,
    was: Mode,
    /// The last tick for which a motion was permitted.
    moving_k: u64,
    rest: Option<[f64; JOINTS_MAX]>,
    modes: Modes,
    inputs: Inputs,
    rules: Rules,
    feedback: Feedback,
    movement: Movement,
    likeness: PersonJudge,
    /// Hash over everything that was executed.
    pub hash: u64,
    pub ticks_in: [u64; Mode::ALL.len()],
}

impl Oracle {
    pub fn new(robot: &Model, k: u64) -> Self {
        let limits = &robot.limits;
        Self {
            limits: limits.to_vec(),
            beyond: limits.map(|limits| [limits.q_min, limits.q_max]),
            moving_k: k,
            hash: 0xcbf2_9ce4_8422_2325,
            ..Self::default()
        }
    }

    pub fn check(&mut self, seen: &Seen<'_>) -> Result<(), Violation> {
        self.modes.check(seen).map_err(|(invariant, detail)| Violation { tick: seen.tick, invariant, detail })?;
        if let Some(control) = &seen.moment.control {
            let mode = Mode::from_u32(control.status.mode).unwrap_or(Mode::Faulted);
            self.note_mode(seen.k, mode, Faults(control.status.faults));
        }
        let was = self.was;
        let judged = seen.moment.robot.as_ref().map_or(Ok(()), |robot| self.judge(seen, robot));
        judged
            .and_then(|()| self.true_motion(seen))
            .and_then(|()| self.inputs.check(seen, was))
            .and_then(|()| self.rules.check(seen, was))
            .and_then(|()| self.feedback.check(seen, was))
            .and_then(|()| self.movement.check(seen, was))
            .and_then(|()| self.likeness.check(seen, was))
            .map_err(|(invariant, detail)| Violation { tick: seen.tick, invariant, detail })
    }

    pub fn mode(&self) -> Mode {
        self.was
    }

    fn note_mode(&mut self, k: u64, mode: Mode, faults: Faults) {
        self.ticks_in[mode as usize] += 1;
        match (self.was, mode) {
            (Mode::Engaging, Mode::Holding) => {
                self.resumes = self.engaging_k.is_some_and(|began| k >= began + TICK_HZ);
                self.held = 0;
            }
            // A short gap in a later part of engaging begins nothing.
            (Mode::Holding, Mode::Engaging) if self.resumes => {}
            (Mode::Engaging, Mode::Engaging) => {}
            (_, Mode::Engaging) => self.engaging_k = Some(k),
            (_, Mode::Engaged | Mode::Disengaged | Mode::Faulted) => self.resumes = false,
            _ => {}
        }
        if mode == Mode::Holding {
            self.held += 1;
            self.resumes &= faults.is_in(GAPS) && self.held <= GAP_TICKS;
        }
        if moves(mode) {
            (self.moving_k, self.rest) = (k, None);
        }
        self.was = mode;
    }

    fn judge(&mut self, seen: &Seen<'_>, robot: &RobotState) -> Result<(), Broken> {
        let index = robot.executed_k + robot.plan_ticks_played;
        let follows_measurement = robot.command_incarnation == 0 && robot.plan_ticks_played == 0;
        let gap = self.index.is_some_and(|before| index.saturating_sub(before) > driver::GAP_MAX_TICKS);
        let suspended = follows_measurement && gap && robot.executed_k != self.executed_k;
        if seen.driver_restarted || self.index.is_none() || suspended || (follows_measurement && seen.undriven) {
            self.begin(robot);
        }
        if suspended || seen.driver_restarted {
            // Its stop begins now, whenever the last motion was permitted.
            self.moving_k = self.moving_k.max(index);
        }
        let count = seen.robot.count;
        for x in robot.q[..count].iter().chain(&robot.v[..count]).chain(&robot.a[..count]) {
            self.hash = (self.hash ^ x.to_bits()).wrapping_mul(0x0000_0100_0000_01b3);
        }
        if let Some(x) = robot.q.iter().chain(&robot.v).chain(&robot.a).find(|x| !x.is_finite()) {
            return Err(("finite", format!("{x} is executed")));
        }
        let before = self.index.replace(index).unwrap_or(index);
        if index < before {
            return Err(("order", format!("index {index} is executed after {before}")));
        }
        let age = seen.k.saturating_sub(robot.executed_k);
        if robot.executed_k != self.executed_k && age > LATE_TICKS {
            return Err(("old command", format!("a command of {age} ticks ago was applied")));
        }
        self.executed_k = robot.executed_k;
        self.positions(&robot.q)?;
        self.differences(index - before, &robot.q)?;
        self.first_second(index)?;
        self.resting(index, robot)?;
        self.simulated(seen.report)
    }

    /// A driver that starts holds the posture that it finds, so the positions do not continue.
    fn begin(&mut self, robot: &RobotState) {
        self.index = None;
        (self.filled, self.checked, self.rest) = (0, 0, None);
        self.executed_k = robot.executed_k;
        for (j, limits) in self.limits.iter().enumerate() {
            self.beyond[j] = [limits.q_min.min(robot.q[j]), limits.q_max.max(robot.q[j])];
        }
    }

    fn positions(&mut self, q: &[f64; JOINTS_MAX]) -> Result<(), Broken> {
        for (j, limits) in self.limits.iter().enumerate() {
            let [low, high] = &mut self.beyond[j];
            let inside = q[j] >= *low - ROUNDING_Q && q[j] <= *high + ROUNDING_Q;
            if !inside {
                return Err(("position", format!("joint {j} at {}, allowed {low} to {high}", q[j])));
            }
            // A joint that was found outside its limits may only move inwards.
            (*low, *high) = ((*low).max(limits.q_min.min(q[j])), (*high).min(limits.q_max.max(q[j])));
        }
        Ok(())
    }

    fn differences(&mut self, advanced: u64, q: &[f64; JOINTS_MAX]) -> Result<(), Broken> {
        let last = self.window[3];
        if self.filled > 0 {
            let dt = advanced as f64 * TICK_S;
            for (j, limits) in self.limits.iter().enumerate() {
                let moved = (q[j] - last[j]).abs();
                if moved > limits.v_max * dt + ROUNDING_V * TICK_S {
                    return Err(("velocity", format!("joint {j} moved {moved} in {dt} s, v_max {}", limits.v_max)));
                }
            }
        }
        if advanced == 0 && self.filled > 0 {
            return Ok(());
        }
        if advanced > 1 {
            self.filled = 0;
        }
        self.window.rotate_left(1);
        self.window[3] = *q;
        self.filled = (self.filled + 1).min(4);
        for (j, limits) in self.limits.iter().enumerate() {
            let [q0, q1, q2, q3] = self.window.map(|q| q[j]);
            let a = (q3 - 2.0 * q2 + q1) / TICK_S.powi(2);
            if self.filled >= 3 && a.abs() > limits.a_max + ROUNDING_A {
                return Err(("acceleration", format!("joint {j}: {a}, a_max {}", limits.a_max)));
            }
            let jerk = (q3 - 3.0 * q2 + 3.0 * q1 - q0) / TICK_S.powi(3);
            if self.filled == 4 && jerk.abs() > limits.j_max + ROUNDING_J {
                return Err(("jerk", format!("joint {j}: {jerk}, j_max {}", limits.j_max)));
            }
        }
        Ok(())
    }

    fn first_second(&self, index: u64) -> Result<(), Broken> {
        let young = self.engaging_k.is_some_and(|k| index > k && index < k + TICK_HZ);
        if !young || self.filled < 2 || !matches!(self.was, Mode::Engaging | Mode::Engaged) {
            return Ok(());
        }
        for (j, limits) in self.limits.iter().enumerate() {
            let v = (self.window[3][j] - self.window[2][j]).abs() / TICK_S;
            if v > FIRST_SHARE * limits.v_max + ROUNDING_V / TICK_S {
                return Err(("first second", format!("joint {j} at {v}, v_max {}", limits.v_max)));
            }
        }
        Ok(())
    }

    /// After the longest stop the robot rests, and stays there.
    fn resting(&mut self, index: u64, robot: &RobotState) -> Result<(), Broken> {
        if index <= self.moving_k + LATE_TICKS + STOP_TICKS + REACTION_TICKS {
            return Ok(());
        }
        let Some(rest) = self.rest else {
            self.rest = Some(robot.q);
            let Some(v) = robot.v.iter().find(|v| v.abs() > RESTING) else { return Ok(()) };
            return Err(("stop bound", format!("still at {v} {STOP_TICKS} ticks after the last permit")));
        };
        let left = (0..robot.robot.joint_count as usize).find(|&j| (robot.q[j] - rest[j]).abs() > ROUNDING_Q);
        let Some(j) = left else { return Ok(()) };
        Err(("rest", format!("joint {j} left {} for {} without a permit", rest[j], robot.q[j])))
    }

    /// The true motion of the joints keeps the limits even if processes were suspended, unless the robot itself
    /// is faulty. A simulation that begins with another robot counts from zero.
    fn true_motion(&mut self, seen: &Seen<'_>) -> Result<(), Broken> {
        let new = self.judged.new_violations(seen);
        let Some(first) = seen.judged.first.filter(|_| new > 0) else { return Ok(()) };
        let detail = format!("{}, which {}: {} beyond {}", first.kind.name(), first.which, first.value, first.bound);
        Err(("true motion", format!("{new} new; the first of all: {detail}")))
    }

    fn simulated(&mut self, report: &Report) -> Result<(), Broken> {
        let total = report.violations_total();
        if total == self.checked {
            return Ok(());
        }
        self.checked = total;
        let Some(first) = report.first_violation else { return Ok(()) };
        let (k, which, value, limit) = (first.k, first.which, first.value, first.limit);
        Err((first.kind.name(), format!("executed at index {k}, which {which}: {value} beyond {limit}")))
    }
}
