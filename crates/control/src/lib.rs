//! The control tick. Engagement decides which motion is allowed, whole-body control proposes a command, and the
//! gate accepts or denies it. Never does IO, never reads a clock, never allocates in a tick.

#![forbid(clippy::disallowed_macros, clippy::disallowed_methods, clippy::disallowed_types)]

mod chain;
mod commander;
mod feedback;
mod following;
mod gripping;
mod limited;
mod one_arm;
mod payload;
mod status;

pub use chain::{Continue, Stream};
pub use commander::{Commanded, Commander};
pub use feedback::feedback;
pub use status::STATUS_EVERY;

use following::{Following, Wish};
use gripping::Gripping;
use messages::{
    Fault, Header, InputStatus, JOINTS_MAX, JointCommand, JointTarget, Layout, Mode, PersonChange, RobotState, Stamp,
    Status, Subject, reduced_flag, state_flag, target_flag,
};
use retarget::ArmModel;
use robot::{Frames, Model};
use safety::engage::{self, MotionView, OperatorView, RobotView, TargetView};
use safety::{gate, gripper, monitor};

/// A command is aligned with its target if no valid joint is farther from it than this, rad: 1.1 degrees. Then the
/// end of the blend cannot be felt. Assumption.
const ALIGNED_RAD: f64 = 0.02;

/// Silence of `ingest` after which its status is ignored, ns: ten of its periods.
const INGEST_GONE_NS: u64 = 1_000_000_000;
/// A frame that was dropped within this time counts as dropped now, ns. The time is as long as `ingest`'s own
/// window.
const DROPPED_NOW_NS: u64 = 1_000_000_000;

/// Rounding of two kinematics that agree to 1e-12 over a reach of a metre, m, with a wide margin.
const CLEARANCE_ROUNDING_M: f64 = 1e-9;

/// Configuration of the control tick, made of the configurations of its stages. Each of them is valid.
#[derive(Clone, Debug)]
pub struct Config {
    /// The robot.
    pub model: Model,
    /// Engagement.
    pub engage: engage::Config,
    /// Whole-body control.
    pub wbc: wbc::Config,
    /// The gate.
    pub gate: gate::Config,
    /// Following.
    pub follow: follow::Config,
    /// The grippers, and the limits that their gate enforces.
    pub grippers: driver::Grippers,
    /// See `grippers`.
    pub gripper_gate: gripper::Config,
    /// A Disengaged robot opens its grippers. Otherwise they hold what they hold.
    pub open_grippers_when_disengaged: bool,
    /// Kinematics of the limbs.
    pub arm: ArmModel,
    /// Known delay from a setpoint to its measurement, s. The command's lead over that delay is no tracking error.
    pub servo_lag_s: f64,
    /// Tracking errors that stop, rad and m. The status names the joint with the largest share of them.
    pub tracking_max: [f64; 2],
    /// Hash of the instance's files, which every message carries.
    pub config_hash: u64,
    /// True if scheduling is real-time.
    pub realtime: bool,
}

/// State between two ticks.
#[derive(Clone, Debug)]
pub struct State {
    incarnation: u32,
    sequence: u64,
    engage: engage::State,
    commander: Commander,
    following: Following,
    anchor: one_arm::Anchor,
    gripping: Gripping,
    near: monitor::Near,
    feedback: monitor::Feedback,
    movement: monitor::Movement,
    /// Movement of the newest robot state.
    moved: monitor::Moved,
    /// The largest errors of tracking, of the revolute and of the prismatic joints.
    tracking: [monitor::Farthest; 2],
    steps: monitor::TargetSteps,
    stream: Option<Stream>,
    last_k: Option<u64>,
    target: Option<(JointTarget, Stamp)>,
    robot: Option<(RobotState, Stamp)>,
    /// Arrival time of a newer robot state that is about another robot.
    stranger: Option<Stamp>,
    /// True if the measurement in the newest robot state is implausible.
    feedback_invalid: bool,
    ingest: Option<(InputStatus, Stamp)>,
    motion: MotionView,
    frames: Frames,
    status: Status,
}

/// Input of a tick: only what is new since the last one.
#[derive(Clone, Copy, Debug)]
pub struct Input<'a> {
    /// Tick index. Each index has one tick, and the index never goes back.
    pub k: u64,
    /// A new target.
    pub target: Option<&'a JointTarget>,
    /// A new robot state.
    pub robot: Option<&'a RobotState>,
    /// The operators, with the edges since the last tick.
    pub operator: OperatorView,
    /// Status of `ingest`. It is shown and influences no decision.
    pub ingest: Option<&'a InputStatus>,
    /// Scheduling is real-time, or the settings allow a simulated robot to engage without it.
    pub realtime_ok: bool,
}

/// Result of a tick.
#[derive(Clone, Copy, Debug)]
pub struct Output {
    /// Command to publish. `None` while there is no driver state to continue from.
    pub command: Option<JointCommand>,
    /// Status to publish, at 50 Hz.
    pub status: Status,
    /// Transition of this tick, if there was one.
    pub transition: Option<messages::Transition>,
}

impl State {
    /// Creates the state of a control process that has just started.
    pub fn new(config: &Config, incarnation: u32) -> Self {
        Self {
            incarnation,
            sequence: 0,
            engage: engage::State::new(),
            commander: Commander::at_rest(&config.wbc, config.model.home),
            following: Following::default(),
            anchor: one_arm::Anchor::default(),
            gripping: Gripping::default(),
            near: monitor::Near::new(),
            feedback: monitor::Feedback::default(),
            movement: monitor::Movement::default(),
            moved: monitor::Moved::default(),
            tracking: [monitor::Farthest::default(); 2],
            steps: monitor::TargetSteps::default(),
            stream: None,
            last_k: None,
            target: None,
            robot: None,
            stranger: None,
            feedback_invalid: false,
            ingest: None,
            motion: MotionView::default(),
            frames: Frames::default(),
            status: Status::ZERO,
        }
    }
}

/// Advances control to tick `k`. Never allocates, blocks, reads a clock or panics.
pub fn tick(config: &Config, state: &mut State, now: Stamp, input: Input<'_>) -> Output {
    let missed = state.last_k.map_or(0, |last| input.k.saturating_sub(last + 1));
    state.last_k = Some(input.k);
    if let Some(target) = input.target {
        state.target = Some((*target, now));
    }
    state.moved.sample_ns = 0;
    if let Some(robot) = input.robot {
        state.take_robot(config, now, robot);
    }
    if let Some(ingest) = input.ingest {
        state.ingest = Some((*ingest, now));
    }
    let echo = state.robot.map(|(echo, _)| echo);
    let from = Stream::prepare(&mut state.stream, echo.as_ref(), input.k, state.incarnation);
    if let Continue::From(motion) = from {
        state.commander.reseed(&motion);
        if let Some(echo) = &echo {
            state.gripping.reseed(&echo.grippers);
        }
    }

    let observed = observe(config, state, &input, missed);
    let mut decided = engage::tick(&config.engage, &mut state.engage, now, observed);
    if let Some(made) = &mut decided.transition
        && let Some(fault) = Fault::from_u32(made.why)
    {
        let change = state.target.map(|(target, _)| Subject::Person(PersonChange::of_flags(target.flags)));
        let about = if fault == Fault::PersonChanged { change } else { state.status.about(fault) };
        made.about = about.map_or(0, Subject::code);
    }
    state.take_payloads(config, &input.operator.payload, &decided);
    let own = |target: &JointTarget| target.flags & target_flag::INPUT_FRESH != 0 && target.robot == config.model.id();
    let shown = |target| one_arm::without(&config.model, target, input.operator.left_out);
    let target = state.target.map(|(target, _)| target).filter(own).map(shown);
    let command = match from {
        Continue::Nothing => None,
        Continue::Own | Continue::From(_) => Some(command(config, state, now, &input, &decided, target.as_ref())),
    };
    state.note(config, now, &input, &decided, missed);
    Output { command, status: state.status, transition: decided.transition }
}

/// Collects the input of the state machine from the newest samples.
fn observe(config: &Config, state: &mut State, input: &Input<'_>, missed: u64) -> engage::Input {
    let target = state.target.map_or(TargetView::default(), |(target, received)| TargetView {
        received,
        incarnation: target.header.incarnation,
        session_nonce: target.session_nonce,
        config_matches: target.header.config_hash == config.config_hash && target.robot == config.model.id(),
        input_fresh: target.flags & target_flag::INPUT_FRESH != 0,
        input_received: target.input_received,
        clutch: target.flags & target_flag::CLUTCH != 0,
        implausible: implausible(&target),
        jumped: input.target.is_some()
            && state.steps.jumped(&config.model, target.k, &target.q, target.valid_mask, following::person(&target)),
    });
    let no_robot = RobotView { received: state.stranger.unwrap_or(Stamp::NONE), ..RobotView::default() };
    let robot = state.robot.map_or(no_robot, |(robot, received)| {
        let clearance = monitor::measured_clearance(&config.model, &mut state.frames, &robot.q_measured);
        // These inhibit a start, and a recovery ends them. In any other motion the certificate and `CollisionNear`
        // protect the robot.
        let may_start = matches!(state.engage.mode(), Mode::Disengaged | Mode::Recovering);
        let outside = monitor::outside_limits(&config.model, &robot.q_measured)
            .or_else(|| monitor::commanded_outside(&config.model, &robot.q))
            .or_else(|| overloaded(config, &state.commander, &robot.q))
            .filter(|_| may_start);
        let in_collision = may_start && too_close_to_start(config, state, &robot, clearance);
        let recovers = state.engage.mode() == Mode::Recovering;
        state.note_measured(clearance, outside);
        let [angle_rad, length_m] = state.tracking;
        state.note_tracking(config, angle_rad, length_m);
        let near = angle_rad.error <= config.tracking_max[0] && length_m.error <= config.tracking_max[1];
        let moved = state.moved;
        RobotView {
            received,
            incarnation: robot.header.incarnation,
            config_matches: robot.header.config_hash == config.config_hash && state.stranger.is_none(),
            commanded: robot.flags & state_flag::COMMANDED != 0,
            driver_fault: robot.flags & state_flag::DRIVER_FAULT != 0,
            emergency_stop: robot.flags & state_flag::EMERGENCY_STOP != 0,
            feedback_invalid: state.feedback_invalid,
            reset_count: robot.reset_count,
            outside_limits: outside.is_some(),
            in_collision,
            clear_to_start: recovers
                && outside.is_none()
                && !in_collision
                && monitor::clear_to_start(&config.model, &mut state.frames, &state.commander.commanded().q),
            collision_near: state.near.update(&config.model, clearance.distance_m),
            sample_ns: moved.sample_ns,
            tracking_error_rad: angle_rad.error,
            tracking_error_m: length_m.error,
            velocity_error: moved.velocity_error.is_some(),
            standstill_lost: moved.standstill_lost.is_some(),
            at_rest: moved.at_rest && near,
        }
    });
    engage::Input {
        k: input.k,
        own_gap_ns: (missed + 1) * 1_000_000_000 / messages::TICK_HZ,
        deadlines_missed: u32::try_from(missed).unwrap_or(u32::MAX),
        realtime_ok: input.realtime_ok,
        operator: input.operator,
        target,
        robot,
        motion: state.motion,
    }
}

/// Returns the joint that needs more than its share of the effort limit to hold the command at rest. It is beyond
/// no position limit, so `by` is zero.
fn overloaded(config: &Config, commander: &Commander, q: &[f64; JOINTS_MAX]) -> Option<monitor::Outside> {
    commander.wbc().overloaded_at_rest(&config.wbc, q).map(|(joint, ..)| monitor::Outside { joint, by: 0.0 })
}

/// Returns true if a start is refused. Either the measured posture is closer than servo error explains, or the
/// commanded one is closer than any certified plan ends. A robot at rest at the very bound may start again:
/// encoder noise alone refuses no start.
fn too_close_to_start(config: &Config, state: &mut State, robot: &RobotState, measured: monitor::Clearance) -> bool {
    let commanded = monitor::measured_clearance(&config.model, &mut state.frames, &robot.q);
    !measured.is_at_least(config.model.d_measured_min_m)
        || !commanded.is_at_least(config.model.d_min_m - CLEARANCE_ROUNDING_M)
}

/// Returns true for values that no retargeting produces: not finite, or far outside any joint's range.
fn implausible(target: &JointTarget) -> bool {
    // Ten turns: no supported joint makes two, and the comparison with limits stays exact.
    let far = 20.0 * core::f64::consts::PI;
    target.q.iter().chain(&target.dq).any(|value| !value.is_finite() || value.abs() > far)
}

/// Builds the command of this tick: whole-body control proposes it, and the gate accepts or denies it.
fn command(
    config: &Config,
    state: &mut State,
    now: Stamp,
    input: &Input<'_>,
    decided: &engage::Output,
    target: Option<&JointTarget>,
) -> JointCommand {
    // A late target is where the person was, not where the person is going.
    let late = decided.reduced & reduced_flag::TARGET_LATE != 0;
    let commanded = state.commander.commanded();
    let from = (&commanded.q, &commanded.v);
    let wish = state.following.wish(config, input.k, from, decided.permit, target, late);
    let wish = state.anchor.hold(&config.model, wish, &commanded.q, input.operator.left_out);
    let wanted = wish.as_ref().map(Wish::target);
    let Commanded { motion, denied, proposed } =
        state.commander.tick((&config.wbc, &config.gate), input.k, now, wanted, decided.permit);
    let (grippers, gripper_denied) = state.gripping.tick(config, decided.mode, target.filter(|_| !late));
    // A denied gripper stops the robot from the next tick on. The arms' motion of this tick was not denied.
    let flags = proposed.command_flags(denied.is_some());
    let denied = denied.or(gripper_denied);
    if let Some(denial) = denied {
        state.status.denied_why = denial.code();
        state.status.denied_about = denial.subject().map_or(0, Subject::code);
    }
    let denied = denied.is_some();
    state.status.gate_denials += u32::from(denied);
    let near = state.following.closeness(config, target, &motion.q, &motion.v);
    state.motion = MotionView {
        at_rest: motion.v.iter().chain(&motion.a).all(|value| value.abs() <= driver::REST_TOLERANCE),
        aligned: near.aligned,
        behind: near.behind,
        settled: near.settled,
        gate_denied: denied,
    };
    state.status.torso_to_go_m = match (decided.mode, &wanted) {
        (Mode::Engaging, Some(wanted)) => status::torso_to_go(&config.model, wanted, &motion.q),
        _ => 0.0,
    };
    (state.status.clearance_command_m, state.status.nearest_pair) = (proposed.clearance_m, proposed.nearest_pair);
    limited::note(&mut state.status, decided.mode == Mode::Engaged, &motion, &config.wbc, &config.model);
    state.status.fallbacks = state.status.fallbacks.wrapping_add(proposed.fallbacks);
    if proposed.fallbacks > 0 {
        // A motion that was refused for a hand's speed concerns no pair.
        let overloaded = proposed.overloaded_joint.map(|joint| Subject::Joint(joint as usize));
        state.status.refused_about = overloaded.or(proposed.refused_pair.map(Subject::Pair)).map_or(0, Subject::code);
    }
    let chain = state.stream.as_mut().map(|stream| {
        stream.sent(input.k, motion);
        stream.chain()
    });
    state.sequence += 1;
    JointCommand {
        header: state.header(config, now, target.map_or(Stamp::NONE, |target| target.header.origin)),
        robot: config.model.id(),
        k: input.k,
        seed_k: chain.map_or(0, |chain| chain.seed_k),
        seed_played: chain.map_or(0, |chain| chain.seed_played),
        q: motion.q,
        v: motion.v,
        a: motion.a,
        plan: motion.plan,
        target_stamp: target.map_or(Stamp::NONE, |target| target.header.stamp),
        mode: decided.mode as u32,
        flags,
        reset_count: decided.reset_count,
        reserved: 0,
        grippers,
    }
}

/// Returns true if every valid joint of the command is near its target, as far as the limits let it reach the
/// target.
fn aligned(model: &Model, target: &JointTarget, q: &[f64; JOINTS_MAX]) -> bool {
    (0..model.count).filter(|j| target.valid_mask & 1 << j != 0).all(|j| {
        let limits = &model.limits[j];
        (target.q[j].clamp(limits.q_min, limits.q_max) - q[j]).abs() <= ALIGNED_RAD
    })
}

impl State {
    /// The header of the next command.
    fn header(&self, config: &Config, stamp: Stamp, origin: Stamp) -> Header {
        let (config_hash, incarnation) = (config.config_hash, self.incarnation);
        Header { sequence: self.sequence, stamp, origin, config_hash, incarnation, reserved: 0 }
    }

    /// Takes a new robot state. A single implausible sample is replaced, and an old one is not judged.
    fn take_robot(&mut self, config: &Config, now: Stamp, robot: &RobotState) {
        // The joints of another robot mean something else. Nothing but the refusal comes of such a message.
        if robot.robot != config.model.id() {
            self.stranger = Some(now);
            return;
        }
        self.stranger = None;
        let mut robot = *robot;
        match self.robot {
            Some((before, _)) if before.header.incarnation != robot.header.incarnation => {
                self.movement = monitor::Movement::default();
            }
            Some((before, seen)) if robot.flags & state_flag::UNSEEN != 0 => {
                // Nothing new is measured, so nothing is judged. The joints would look frozen. The state ages from the last
                // measurement on, and nothing begins.
                robot.q_measured = before.q_measured;
                self.moved.at_rest = false;
                self.robot = Some((robot, seen));
                return;
            }
            _ => {}
        }
        let first_second = self.status.speed_scale <= engage::SPEED_SCALE_FIRST;
        let sample = monitor::Sample {
            k: robot.executed_k.saturating_add(robot.plan_ticks_played),
            q: &robot.q,
            v: &robot.v,
            a: &robot.a,
            q_measured: &robot.q_measured,
            dq_measured: &robot.dq_measured,
            begins: self.engage.mode() == Mode::Engaging && first_second,
        };
        let judged = self.feedback.judge(&config.model, &sample, config.servo_lag_s);
        let believed = monitor::Sample { q_measured: &judged.q_measured, ..sample };
        self.moved = self.movement.judge(&config.model, &believed, config.servo_lag_s);
        (robot.q_measured, self.feedback_invalid) = (judged.q_measured, judged.invalid);
        let (angle_rad, length_m) =
            monitor::tracking_error(&config.model, &robot.q, &robot.v, &robot.q_measured, config.servo_lag_s);
        self.tracking = [angle_rad, length_m];
        self.robot = Some((robot, now));
    }

    /// Writes the clearance and the joint outside its limits into the status.
    fn note_measured(&mut self, clearance: monitor::Clearance, outside: Option<monitor::Outside>) {
        let status = &mut self.status;
        (status.clearance_measured_m, status.nearest_pair_measured) = (clearance.distance_m, clearance.pair);
        status.joint_outside = outside.map_or(0, |outside| outside.joint as u32 + 1);
        status.outside_by = outside.map_or(0.0, |outside| outside.by);
    }

    /// Names the joint with the largest share of the tracking bound, and the joint that does not move as
    /// commanded.
    fn note_tracking(&mut self, config: &Config, angle_rad: monitor::Farthest, length_m: monitor::Farthest) {
        let [angle_max_rad, length_max_m] = config.tracking_max;
        let by_length = length_m.error * angle_max_rad > angle_rad.error * length_max_m;
        let worst = if by_length { length_m } else { angle_rad };
        self.status.tracking_error = worst.error;
        self.status.tracking_joint = worst.joint as u32 + 1;
        let restless = (self.motion.at_rest && !self.moved.at_rest).then_some(self.moved.restless);
        let unsteady = self.moved.velocity_error.or(self.moved.standstill_lost).or(restless);
        self.status.unsteady_joint = unsteady.map_or(0, |joint| joint as u32 + 1);
    }

    fn note(&mut self, config: &Config, now: Stamp, input: &Input<'_>, out: &engage::Output, missed: u64) {
        let status = &mut self.status;
        status.ticks += 1;
        status.missed_deadlines += missed;
        status.header = Header {
            sequence: status.ticks,
            stamp: now,
            origin: Stamp::NONE,
            config_hash: config.config_hash,
            incarnation: self.incarnation,
            reserved: 0,
        };
        status.k = input.k;
        status.mode = out.mode as u32;
        status.faults = out.active.0;
        status.latched = out.latched.0;
        status.fault_counts = out.fault_counts;
        status.moving = u32::from(!out.at_rest);
        status.speed_scale = out.permit.speed_scale();
        status.reduced = out.reduced;
        status.realtime = u32::from(config.realtime);
        payload::note(status, &self.commander.wbc().payload());
        if let Some(transition) = out.transition {
            status.transitions[status.transition_count as usize % messages::TRANSITIONS_KEPT] = transition;
            status.transition_count += 1;
        }
        let ingest = self.ingest.as_ref().filter(|(_, received)| now.since(*received) <= INGEST_GONE_NS);
        let dropped = ingest.filter(|(ingest, _)| now.since(ingest.dropped_at) <= DROPPED_NOW_NS);
        status.input_drop = dropped.map_or(0, |(ingest, _)| ingest.dropped_why);
        status.lost_permille = ingest.map_or(0, |(ingest, _)| ingest.lost_permille);
        let [left, right] = input.operator.left_out.map(u32::from);
        status.left_out = left | right << 1;
        status.calibration = ingest.map_or(0, |(ingest, _)| ingest.calibration);
        if let Some((_, received)) = self.robot {
            status.state_stamp = received;
        }
        if let Some((target, received)) = self.target {
            let target = one_arm::without(&config.model, target, input.operator.left_out);
            status.target_stamp = received;
            status.input_age_ns = now.since(target.input_received);
            status.limb_error_target_rad = status::limb_error(config, &target, &target.q);
            if let Some((robot, _)) = self.robot {
                status.limb_error_measured_rad = status::limb_error(config, &target, &robot.q_measured);
            }
        }
    }
}
