//! The robot's state as the monitors judge it.

use crate::{Commander, Config};
use messages::{JOINTS_MAX, Mode, RobotState, Stamp, state_flag};
use robot::{Frames, Model};
use safety::engage::RobotView;
use safety::monitor;

/// Rounding of two kinematics that agree to 1e-12 over a reach of a metre, m, with a wide margin.
const CLEARANCE_ROUNDING_M: f64 = 1e-9;

/// The newest state of the robot, and what the monitors found in it.
#[derive(Clone, Debug)]
pub(super) struct Robot {
    newest: Option<(RobotState, Stamp)>,
    /// Arrival time of a newer state that is about another robot.
    stranger: Option<Stamp>,
    /// True if the measurement in the newest state is implausible.
    feedback_invalid: bool,
    feedback: monitor::Feedback,
    movement: monitor::Movement,
    /// Movement of the newest state.
    pub(super) moved: monitor::Moved,
    /// The largest errors of tracking, of the revolute and of the prismatic joints.
    pub(super) tracking: [monitor::Farthest; 2],
    near: monitor::Near,
    frames: Frames,
    distances: monitor::Distances,
}

/// Clearance of the measured posture, and the joint that inhibits a start.
pub(super) struct Posture {
    pub(super) clearance: monitor::Clearance,
    /// The joint outside its limits, where that inhibits a start.
    pub(super) outside: Option<monitor::Outside>,
}

impl Robot {
    /// Before the first state.
    pub(super) fn new(model: &Model) -> Self {
        Self {
            newest: None,
            stranger: None,
            feedback_invalid: false,
            feedback: monitor::Feedback::default(),
            movement: monitor::Movement::default(),
            moved: monitor::Moved::default(),
            tracking: [monitor::Farthest::default(); 2],
            near: monitor::Near::new(),
            frames: Frames::default(),
            distances: monitor::Distances::new(model),
        }
    }

    /// The newest state, of any age.
    pub(super) fn state(&self) -> Option<&RobotState> {
        self.newest.as_ref().map(|(state, _)| state)
    }

    /// Arrival time of the newest state.
    pub(super) fn received(&self) -> Option<Stamp> {
        self.newest.as_ref().map(|(_, received)| *received)
    }

    /// Judges a new state. A single implausible sample is replaced, and an old one is not judged. `begins` is true in
    /// the first second of engaging.
    pub(super) fn receive(&mut self, config: &Config, now: Stamp, state: Option<&RobotState>, begins: bool) {
        self.moved.sample_ns = 0;
        let Some(state) = state else { return };
        // The joints of another robot mean something else. Nothing but the refusal comes of such a message.
        if state.robot != config.model.id() {
            self.stranger = Some(now);
            return;
        }
        self.stranger = None;
        let mut state = *state;
        match self.newest {
            Some((before, _)) if before.header.incarnation != state.header.incarnation => {
                self.movement = monitor::Movement::default();
            }
            Some((before, seen)) if state.flags & state_flag::UNSEEN != 0 => {
                // Nothing new is measured, so nothing is judged. The joints would look frozen. The state ages from the last
                // measurement on, and nothing begins.
                state.q_measured = before.q_measured;
                self.moved.at_rest = false;
                self.newest = Some((state, seen));
                return;
            }
            _ => {}
        }
        let sample = monitor::Sample {
            k: state.executed_k.saturating_add(state.plan_ticks_played),
            q: &state.q,
            v: &state.v,
            a: &state.a,
            q_measured: &state.q_measured,
            dq_measured: &state.dq_measured,
            begins,
        };
        let judged = self.feedback.judge(&config.model, &sample, config.servo_lag_s);
        let believed = monitor::Sample { q_measured: &judged.q_measured, ..sample };
        self.moved = self.movement.judge(&config.model, &believed, config.servo_lag_s);
        (state.q_measured, self.feedback_invalid) = (judged.q_measured, judged.invalid);
        let (angle_rad, length_m) =
            monitor::tracking_error(&config.model, &state.q, &state.v, &state.q_measured, config.servo_lag_s);
        self.tracking = [angle_rad, length_m];
        self.newest = Some((state, now));
    }

    /// Returns the robot in `mode` as engagement sees it, and its posture. There is no posture before the first state.
    pub(super) fn view(&mut self, config: &Config, mode: Mode, commander: &Commander) -> (RobotView, Option<Posture>) {
        let Some((state, received)) = self.newest else {
            return (RobotView { received: self.stranger.unwrap_or(Stamp::NONE), ..RobotView::default() }, None);
        };
        let model = &config.model;
        let clearance = self.distances.clearance(model, &state.q_measured);
        // These inhibit a start, and a recovery ends them. In any other motion the certificate and `CollisionNear`
        // protect the robot.
        let may_start = matches!(mode, Mode::Disengaged | Mode::Recovering);
        let outside = || {
            monitor::outside_limits(model, &state.q_measured)
                .or_else(|| monitor::commanded_outside(model, &state.q))
                .or_else(|| overloaded(config, commander, &state.q))
        };
        let outside = may_start.then(outside).flatten();
        let in_collision = may_start && self.too_close_to_start(config, &state, clearance);
        let [angle_rad, length_m] = self.tracking;
        let is_tracked = angle_rad.error <= config.tracking_max[0] && length_m.error <= config.tracking_max[1];
        let moved = self.moved;
        let view = RobotView {
            received,
            incarnation: state.header.incarnation,
            config_matches: state.header.config_hash == config.config_hash && self.stranger.is_none(),
            commanded: state.flags & state_flag::COMMANDED != 0,
            driver_fault: state.flags & state_flag::DRIVER_FAULT != 0,
            emergency_stop: state.flags & state_flag::EMERGENCY_STOP != 0,
            feedback_invalid: self.feedback_invalid,
            reset_count: state.reset_count,
            outside_limits: outside.is_some(),
            in_collision,
            clear_to_start: mode == Mode::Recovering
                && outside.is_none()
                && !in_collision
                && monitor::clear_to_start(model, &mut self.frames, &commander.commanded().q),
            collision_near: self.near.update(model, clearance.distance_m),
            sample_ns: moved.sample_ns,
            tracking_error_rad: angle_rad.error,
            tracking_error_m: length_m.error,
            velocity_error: moved.velocity_error.is_some(),
            standstill_lost: moved.standstill_lost.is_some(),
            at_rest: moved.at_rest && is_tracked,
        };
        (view, Some(Posture { clearance, outside }))
    }

    /// Returns true if a start is refused. Either the measured posture is closer than servo error explains, or the
    /// commanded one is closer than any certified plan ends. A robot at rest at the very bound may start again:
    /// encoder noise alone refuses no start.
    fn too_close_to_start(&mut self, config: &Config, state: &RobotState, measured: monitor::Clearance) -> bool {
        let commanded = self.distances.clearance(&config.model, &state.q);
        !measured.is_at_least(config.model.d_measured_min_m)
            || !commanded.is_at_least(config.model.d_min_m - CLEARANCE_ROUNDING_M)
    }
}

/// Returns the joint that needs more than its share of the effort limit to hold the command at rest. It is beyond
/// no position limit, so `by` is zero.
fn overloaded(config: &Config, commander: &Commander, q: &[f64; JOINTS_MAX]) -> Option<monitor::Outside> {
    commander.wbc().overloaded_at_rest(&config.wbc, q).map(|(joint, ..)| monitor::Outside { joint, by: 0.0 })
}
