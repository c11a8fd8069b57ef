//! The command follower: executes commands that continue, plays the plan when there is none, and latches on silence.

use crate::acceptance::{self, GAP_MAX_TICKS, Refusal, Rule};
use crate::chain::CommandChain;
use crate::gripper::Grippers;
use crate::limits::JointLimits;
use crate::plan::play_tick;
use crate::port::{Drives, ENCODER_NOISE, Measured, NOISE, Setpoint};
use messages::{
    Fault, Faults, Header, JOINTS_MAX, JointCommand, JointMotion, Layout, RobotId, RobotState, Stamp, TICK_HZ, TICK_S,
    state_flag,
};

/// Age of a measurement beyond which a robot counts as silent, ns: ten cycles of a port of 1 kHz. Assumption.
pub const MEASURED_AGE_MAX_NS: u64 = 10_000_000;

/// Indices without an acceptable command after which the fault latches: 10 ms. Universal Robots and Franka wait 20 ms.
pub const SILENCE_TICKS: u64 = 15;

/// Ticks in a row without following drives, after which the driver holds the measured posture. By then the robot is
/// off the plan.
pub const UNDRIVEN_TICKS: u64 = 3;

/// The driver waits at most this many ticks for the robot's answer: 20 ms. By then a robot that took the last
/// setpoint stops by itself.
const ANSWER_TICKS: u64 = 30;

/// Once the drives follow again, the driver holds the measured posture for at most this many ticks while a joint
/// moves. The joint would overshoot a fixed setpoint. 500 ms is the longest stop of the robots.
pub const SETTLE_TICKS: u64 = TICK_HZ / 2;

/// A reset needs joints that have stood for this many ticks: 50 ms. That is half of what `control` requires before it
/// passes a reset on.
pub const STILL_TICKS: u64 = TICK_HZ / 20;

/// A standing joint is measured within the way of this many seconds at its largest speed: 0.05 rad for an arm's joint.
const NEAR_S: f64 = 0.06;

/// A joint stands if it is measured slower than this share of its largest speed: 0.1 rad/s for an arm's joint, 0.01
/// m/s for the torso. That is several times the noise of the simulated drives' velocities. A servo of 5 Hz takes such
/// a joint over within some 3 mrad, 0.3 mm. Assumption.
const STANDING: f64 = 0.15;

/// Largest speed of a joint without power, as a multiple of its limit. A measurement farther away is not believed.
/// `safety` uses the same rule.
const FALL_FACTOR: f64 = 3.0;
/// A robot without its driver moves for at most this many ticks: 500 ms.
const MOVES_TICKS: u64 = TICK_HZ / 2;

/// Settings of the follower.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// Indices without an acceptable command after which the fault latches.
    pub silence_ticks: u64,
    /// A command for another robot is refused.
    pub robot: RobotId,
    /// A command beyond these limits is refused. Joints that the robot lacks have [`JointLimits::ABSENT`].
    pub limits: [JointLimits; JOINTS_MAX],
    /// The grippers.
    pub grippers: Grippers,
    /// Delay that the robot's interface adds to the delay of its servos, ticks.
    pub interface_delay_ticks: u64,
    /// Age of a measurement beyond which the robot counts as silent, ns.
    pub measured_age_max_ns: u64,
    /// Age of a repeated measurement beyond which the robot is unseen, ns. Not above `measured_age_max_ns`.
    pub unseen_ns: u64,
}

impl Config {
    /// Creates the settings for a robot with these limits.
    pub const fn new(robot: RobotId, limits: [JointLimits; JOINTS_MAX]) -> Self {
        Self {
            silence_ticks: SILENCE_TICKS,
            robot,
            limits,
            grippers: Grippers([0.0; 2]),
            interface_delay_ticks: 0,
            measured_age_max_ns: MEASURED_AGE_MAX_NS,
            unseen_ns: MEASURED_AGE_MAX_NS,
        }
    }
}

/// State of the follower.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct State {
    /// The executed motion, at index `executed_k + plan_ticks_played`.
    pub motion: JointMotion,
    /// Index of the last accepted command. Before the first one: the index at which holding began.
    pub executed_k: u64,
    /// Plan ticks played since that index.
    pub plan_ticks_played: u64,
    /// Chain of the last accepted command.
    pub chain: Option<CommandChain>,
    /// True while only the plan is executed, until a reset edge at rest.
    pub latched: bool,
    /// Refused commands, by reason.
    pub refused: [u64; Refusal::COUNT],
    /// Accepted commands.
    pub accepted: u64,
    /// Number of the `Mode` of the last accepted command.
    pub mode: u32,
    /// Ticks without an acceptable command since the last one. `None` until the first one, and again after a reset.
    silent: Option<u64>,
    /// Ticks in a row in which the drives did not follow.
    undriven: u64,
    /// Ticks for which the driver has waited for an answer.
    awaited: u64,
    /// True while the driver holds the measured posture: from the drives' first complaint until the joints stand.
    pub(crate) holds_measured: bool,
    /// Ticks for which that may still last after the last complaint.
    settle_ticks: u64,
    /// Ticks for which every joint has been measured standing near its setpoint.
    still_ticks: u64,
    /// Joint positions when that count began.
    still_at: [f64; JOINTS_MAX],
    /// The last posture that was believed, and its index.
    believed: ([f64; JOINTS_MAX], u64),
    /// `origin` of the last accepted command.
    origin: Stamp,
    /// Incarnation and reset count of the last plausible command.
    reset: Option<(u32, u32)>,
    /// Incarnation and sequence of the last command, so that a sample that is read twice is judged once.
    seen: Option<(u32, u64)>,
}

impl State {
    /// Holds the measured posture `q` from index `k` on, and follows the measured posture until the joints stand.
    /// Returns `None` if a number of `q` is not finite. A driver must start at least [`crate::START_AFTER_TICKS`]
    /// after another one ended. Then no identity is given twice.
    pub fn hold(k: u64, q: &[f64; JOINTS_MAX]) -> Option<Self> {
        q.iter().all(|q| q.is_finite()).then_some(Self {
            motion: JointMotion::rest(*q),
            executed_k: k,
            plan_ticks_played: 0,
            chain: None,
            latched: false,
            refused: [0; Refusal::COUNT],
            accepted: 0,
            mode: 0,
            silent: None,
            undriven: 0,
            awaited: 0,
            // A robot whose last driver died may still move.
            holds_measured: true,
            settle_ticks: SETTLE_TICKS,
            still_ticks: 0,
            still_at: *q,
            believed: (*q, k),
            origin: Stamp::NONE,
            reset: None,
            seen: None,
        })
    }

    /// Returns the index of the executed state.
    pub const fn index(&self) -> u64 {
        self.executed_k.saturating_add(self.plan_ticks_played)
    }

    /// Returns the executed state as a setpoint for the robot.
    pub const fn setpoint(&self) -> Setpoint {
        Setpoint { k: self.index(), q: self.motion.q, v: self.motion.v, a: self.motion.a }
    }

    /// Returns the message to publish. It copies `header`, but takes the origin of the executed command.
    pub fn echo(&self, config: &Config, header: Header, measured: &Measured) -> RobotState {
        let chain = self.chain.unwrap_or(CommandChain { incarnation: 0, seed_k: 0, seed_played: 0 });
        let mut flags = 0;
        if self.latched {
            flags |= state_flag::DRIVER_FAULT;
        }
        if self.accepted > 0 {
            flags |= state_flag::COMMANDED;
        }
        if measured.drives.emergency_stop {
            flags |= state_flag::EMERGENCY_STOP;
        }
        RobotState {
            header: Header { origin: self.origin, ..header },
            robot: config.robot,
            executed_k: self.executed_k,
            plan_ticks_played: self.plan_ticks_played,
            seed_k: chain.seed_k,
            seed_played: chain.seed_played,
            command_incarnation: chain.incarnation,
            reset_count: self.reset.map_or(0, |(_, count)| count),
            q_measured: measured.q,
            dq_measured: measured.dq,
            commands_refused: self.refused.iter().sum(),
            flags,
            ..RobotState::ZERO
        }
        .with_motion(&self.motion)
    }
}

/// Input of a tick.
#[derive(Clone, Copy, Debug)]
pub struct Input<'a> {
    /// The index that is due: the last one whose deadline plus grace is not after now. A driver that overslept finds
    /// it several indices ahead. A driver that a command woke finds it unchanged.
    pub due_k: u64,
    /// The newest command. A command that was given before is ignored.
    pub command: Option<&'a JointCommand>,
    /// True if the robot did not take a setpoint. The fault then latches at once.
    pub port_fault: bool,
    /// The newest measurement, if there is one, taken after the driver woke up. Drives that are not sound latch the
    /// fault at once.
    pub measured: Option<&'a Measured>,
}

/// A command that was accepted in this tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Accepted {
    /// Its index.
    pub k: u64,
    /// Now minus its origin, ns, if it is the first executed command of that origin (skeleton_to_command).
    pub origin_age_ns: Option<u64>,
    /// Now minus the publication time of the target behind it, ns, if there is one (target_to_command).
    pub target_age_ns: Option<u64>,
}

/// Result of a tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Output {
    /// The setpoint that is executed now. The caller hands it to the robot if `advanced` is not zero.
    pub executed: Setpoint,
    /// Number of indices by which it is newer than before.
    pub advanced: u64,
    /// True if the caller must not give `executed` to the robot, because the robot's answer to an earlier setpoint is
    /// due.
    pub withheld: bool,
    /// The command that was accepted in this tick.
    pub accepted: Option<Accepted>,
    /// The reason why the command of this tick was refused.
    pub refused: Option<Refusal>,
    /// Number of ticks for which the driver was suspended while the robot moved. The driver went on with the
    /// certified stop, or began again from the measured posture.
    pub suspended_ticks: Option<u64>,
    /// `DriverFault` while latched.
    pub faults: Faults,
}

/// Returns true if every joint is measured slower than the limit for a standing joint.
fn is_slow(config: &Config, measured: &Measured) -> bool {
    (0..JOINTS_MAX).all(|j| measured.dq[j].abs() <= STANDING * config.limits[j].v_max)
}

/// Cause of a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StepKind {
    /// One tick of the plan.
    Plan,
    /// A command was accepted.
    Command,
    /// Any number of indices at rest, as one step.
    Rest,
    /// The robot was on its own, because its drives did not follow or the driver was suspended. It is off its plan,
    /// so the executed motion begins at the measured posture.
    Measured,
}

/// One step of the execution.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// Its cause.
    pub kind: StepKind,
    /// The state after it.
    pub setpoint: Setpoint,
}

/// Advances the execution to `input.due_k`, or to the command's index if the command continues and is ahead of that.
///
/// ```
/// use driver::{Config, Input, JointLimits, State, tick};
/// use messages::{JOINTS_MAX, Layout, RobotId, deadline};
///
/// let limits = JointLimits { q_min: -1.0, q_max: 1.0, v_max: 2.0, a_max: 20.0, j_max: 500.0 };
/// let config = Config::new(RobotId::ZERO, [limits; JOINTS_MAX]);
/// let mut state = State::hold(1000, &[0.0; JOINTS_MAX]).unwrap();
/// let input = Input { due_k: 1001, command: None, port_fault: false, measured: None };
/// let out = tick(&config, &mut state, deadline(1001), input);
/// assert_eq!((out.executed.k, out.executed.q), (1001, [0.0; JOINTS_MAX])); // Without a command it holds.
/// ```
pub fn tick(config: &Config, state: &mut State, now: Stamp, input: Input<'_>) -> Output {
    tick_each(config, state, now, input, |_| {})
}

/// Does the same as [`tick`], and shows every single step of the execution. There are several steps if the driver was
/// late, or if a new chain begins further on the plan.
pub fn tick_each(
    config: &Config,
    state: &mut State,
    now: Stamp,
    input: Input<'_>,
    mut each: impl FnMut(&Step),
) -> Output {
    let index_before = state.index();
    // The posture held before a pause does not show where the robot is now: it may have sunk meanwhile.
    let paused = state.latched && state.holds_measured && input.due_k.saturating_sub(index_before) > GAP_MAX_TICKS;
    let driven = !input.port_fault && input.measured.is_none_or(|measured| measured.drives.are_sound());
    state.latched |= !driven;
    // The driver accepts a command already in the tick in which the joints first stand.
    state.holds_measured &= !(driven && input.measured.is_none_or(|measured| is_slow(config, measured)));
    let suspended_ticks = state.suspension(input.due_k);
    if let Some(ticks) = suspended_ticks {
        state.begin_again(config, now, &input, ticks, &mut each);
    }
    let mut accepted = None;
    let mut refused = None;
    if let Some(command) = state.look_at(input.command) {
        match state.listen(config, now, command, driven) {
            Ok(rule) => accepted = Some(state.execute(now, command, rule, &mut each)),
            Err(reason) => {
                state.refused[reason as usize] += 1;
                refused = Some(reason);
            }
        }
    }
    state.play(input.due_k.saturating_sub(state.index()), &mut each);
    let advanced = state.index() - index_before;
    let mut withheld = false;
    if advanced > 0 {
        state.watch_standing(config, input.measured);
        let standing = input.measured.and_then(|measured| state.believe(config, state.index(), measured));
        withheld = state.hold_undriven(config, &input, standing, paused, &mut each);
    }
    state.mind_silence(config, accepted.is_some(), advanced);
    let faults = if state.latched { Faults::NONE.with(Fault::DriverFault) } else { Faults::NONE };
    Output { executed: state.setpoint(), advanced, withheld, accepted, refused, suspended_ticks, faults }
}

impl State {
    /// Returns the command if it is new.
    fn look_at<'a>(&mut self, command: Option<&'a JointCommand>) -> Option<&'a JointCommand> {
        let command = command?;
        let name = Some((command.header.incarnation, command.header.sequence));
        if self.seen == name {
            return None;
        }
        self.seen = name;
        Some(command)
    }

    /// Judges a new command, after its reset count has acted. The reset clears nothing while the drives do not
    /// follow, nor before the joints have stood for [`STILL_TICKS`].
    fn listen(&mut self, config: &Config, now: Stamp, command: &JointCommand, driven: bool) -> Result<Rule, Refusal> {
        acceptance::plausible(config, now, command)?;
        let incarnation = command.header.incarnation;
        // The first count of a new writer is no edge: a restart of the writer resets nothing.
        let edge = self.reset.is_some_and(|(writer, count)| writer == incarnation && count != command.reset_count);
        self.reset = Some((incarnation, command.reset_count));
        let stands = self.still_ticks >= STILL_TICKS;
        if edge && self.latched && self.motion.is_at_rest() && driven && !self.holds_measured && stands {
            self.latched = false;
            self.silent = None;
        }
        acceptance::judge(config, self, command)
    }

    /// Executes an acceptable command.
    fn execute(&mut self, now: Stamp, command: &JointCommand, rule: Rule, each: &mut impl FnMut(&Step)) -> Accepted {
        if let Rule::New { play_ticks } = rule {
            self.play(play_ticks, each);
        }
        self.motion = command.motion();
        self.executed_k = command.k;
        self.plan_ticks_played = 0;
        self.chain = Some(CommandChain::from_command(command));
        self.accepted += 1;
        self.mode = command.mode;
        let origin = command.header.origin;
        let first_of_origin = origin != Stamp::NONE && origin != self.origin;
        self.origin = origin;
        each(&Step { kind: StepKind::Command, setpoint: self.setpoint() });
        Accepted {
            k: command.k,
            origin_age_ns: first_of_origin.then(|| now.since(origin)),
            target_age_ns: (command.target_stamp != Stamp::NONE).then(|| now.since(command.target_stamp)),
        }
    }

    /// Plays `ticks` ticks of the plan. Ticks at rest count as one step.
    pub(crate) fn play(&mut self, ticks: u64, each: &mut impl FnMut(&Step)) {
        let mut left = ticks;
        while left > 0 {
            let at_rest = self.motion.is_at_rest();
            let (played, kind) = if at_rest { (left, StepKind::Rest) } else { (1, StepKind::Plan) };
            if !at_rest {
                play_tick(&mut self.motion);
            }
            self.plan_ticks_played = self.plan_ticks_played.saturating_add(played);
            left -= played;
            each(&Step { kind, setpoint: self.setpoint() });
        }
    }

    /// Counts the ticks for which every joint is measured near its setpoint and near where the count began. The
    /// second distance is the way of [`STILL_TICKS`] at the speed of a standing joint. Positions alone are used: a
    /// swinging joint comes back to where it was, but leaves it in between.
    fn watch_standing(&mut self, config: &Config, measured: Option<&Measured>) {
        let still_s = STILL_TICKS as f64 * TICK_S;
        let stands = |measured: &Measured, j: usize| {
            let v_max = config.limits[j].v_max;
            (measured.q[j] - self.motion.q[j]).abs() <= NEAR_S * v_max
                && (measured.q[j] - self.still_at[j]).abs() <= STANDING * v_max * still_s + ENCODER_NOISE
        };
        let Some(measured) = measured else {
            self.still_ticks = self.still_ticks.saturating_add(1);
            return;
        };
        if (0..JOINTS_MAX).all(|j| stands(measured, j)) {
            self.still_ticks = self.still_ticks.saturating_add(1);
        } else {
            (self.still_ticks, self.still_at) = (0, measured.q);
        }
    }

    /// Returns the measured posture at index `k` if every joint can have come there since the last posture that was
    /// believed. A wrong encoder must not give the setpoint that the returning power finds.
    pub(crate) fn believe(&mut self, config: &Config, k: u64, measured: &Measured) -> Option<[f64; JOINTS_MAX]> {
        let (last, last_k) = self.believed;
        let dt_s = k.saturating_sub(last_k).clamp(1, MOVES_TICKS) as f64 * TICK_S;
        let reach = |j: usize| FALL_FACTOR * config.limits[j].v_max * dt_s + NOISE;
        // A NaN fails this comparison.
        let can_be = (0..JOINTS_MAX).all(|j| (measured.q[j] - last[j]).abs() <= reach(j));
        can_be.then(|| {
            self.believed = (measured.q, k);
            measured.q
        })
    }

    /// Holds the measured posture if the robot as a whole has not followed for long enough. Holds it once too when a
    /// drive reports a fault and the stop of the others has ended, because that joint has stopped where it could. A
    /// robot that has power and refuses setpoints is sent the stop as long as it is near. It may take a setpoint at
    /// any time, and its answer is late. Once it is not near, the setpoints are withheld until it has answered those
    /// on their way, because it may have taken the last of them. Joints that still move after the last complaint come
    /// to rest first. The state is latched. So at least one plan tick lies between the last accepted command and the
    /// identity given here, and the identity is new.
    ///
    /// Returns true if the setpoint of this tick is withheld.
    fn hold_undriven(
        &mut self,
        config: &Config,
        input: &Input<'_>,
        standing: Option<[f64; JOINTS_MAX]>,
        paused: bool,
        each: &mut impl FnMut(&Step),
    ) -> bool {
        let drives = input.measured.map_or(Drives::SOUND, |measured| measured.drives);
        let powered = drives.powered && !drives.emergency_stop;
        let undriven = input.port_fault || !powered;
        self.undriven = if undriven { self.undriven.saturating_add(1) } else { 0 };
        let complained = undriven || drives.fault;
        let stands = input.measured.is_none_or(|measured| is_slow(config, measured));
        self.settle_ticks = match complained {
            true => SETTLE_TICKS,
            false if stands => 0,
            false => self.settle_ticks.saturating_sub(1),
        };
        self.holds_measured &= self.settle_ticks > 0;
        // A refused setpoint changes nothing here: the setpoint follows the joints until they stand.
        let settles = self.holds_measured && (undriven || !complained);
        let stopped = drives.fault && self.motion.is_at_rest() && !self.holds_measured;
        let is_following = powered
            && !self.motion.is_at_rest()
            && input.measured.is_none_or(|measured| self.is_near(config, measured));
        let left = self.undriven >= UNDRIVEN_TICKS && !is_following;
        let unanswered = powered && input.measured.is_some_and(|measured| measured.unanswered);
        self.awaited = if left { self.awaited.saturating_add(1) } else { 0 };
        let awaits = left && unanswered && self.awaited <= ANSWER_TICKS && !self.holds_measured;
        let held = stopped || settles || (left && !awaits) || paused;
        let Some(standing) = standing.filter(|_| held) else { return awaits };
        let held = if self.holds_measured { self.motion.q } else { standing };
        // Only a deviation larger than the noise moves the held posture.
        let at = |j: usize| held[j].clamp(standing[j] - ENCODER_NOISE, standing[j] + ENCODER_NOISE);
        self.holds_measured = true;
        self.motion = JointMotion::rest(core::array::from_fn(|j| config.limits[j].within(at(j), NOISE)));
        (self.executed_k, self.plan_ticks_played, self.chain) = (self.index(), 0, None);
        each(&Step { kind: StepKind::Measured, setpoint: self.setpoint() });
        false
    }

    /// Counts the ticks without an acceptable command. A tick counts once, however many indices it had to catch up.
    /// So `control` does not pay for a late driver.
    fn mind_silence(&mut self, config: &Config, accepted: bool, advanced: u64) {
        if accepted {
            self.silent = Some(0);
        } else if advanced > 0
            && let Some(ticks) = &mut self.silent
        {
            *ticks = ticks.saturating_add(1);
            self.latched |= *ticks >= config.silence_ticks;
        }
    }
}
