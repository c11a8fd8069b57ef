//! Following: the command follows the limbs if the target has the person's motion ahead, else the joints.

use crate::Config;
use crate::status::limb_angles;
use crate::target::Target;
use messages::JOINTS_MAX;
use robot::{Model, POINTING_JOINTS};
use safety::{engage, monitor};

/// A command is aligned with its target if no valid joint is farther from it than this, rad: 1.1 degrees. Then the
/// end of the blend cannot be felt. Assumption.
const ALIGNED_RAD: f64 = 0.02;
/// Limbs nearer to the person's than this are aligned, rad: 2 degrees. Retargeting itself leaves as much.
const ALIGNED_LIMBS_RAD: f64 = 0.035;
/// A limb farther from the person's than this is far behind, rad: 15 degrees. A robot that is nearer on average follows already.
const BEHIND_RAD: f64 = 0.26;

/// A command that moves no joint faster than this (rad/s, m/s) has settled. Blocked by an obstacle, it creeps
/// along it. Settling is required for half a second, and in that time it comes at most 1.4 degrees nearer.
const SETTLED_SPEED: f64 = 0.05;
/// Time constants of two averages of the limb error, s. A falling error shows that the robot catches up. Assumptions: a
/// swing of an arm is shorter than the longer one, and a reach across is longer than the shorter one.
const AVERAGES_S: [f64; 2] = [0.5, 1.5];
/// The error no longer falls if the shorter average is at least this share of the longer one, within
/// [`ALIGNED_LIMBS_RAD`].
const FALLEN: f64 = 0.8;

/// Time in which hands and head get their full speed once the arms have theirs, s: as long as the ramp of engaging. Arms
/// are aligned before they get it. A hand or a head may be anywhere, because engaging does not wait for it.
const POINTING_RAMP_S: f64 = engage::RAMP_NS as f64 / 1e9;

/// Share of its speed that the lift uses (assumption).
const LIFT_SPEED: f64 = 0.5;

/// State of the following.
#[derive(Clone, Debug)]
pub(super) struct Following {
    state: follow::State,
    /// Share of the speeds that hands and head may use.
    pointing_scale: f64,
    /// Reference positions of the head's joints, rad. `None` before the first tick.
    head: Option<[f64; POINTING_JOINTS]>,
    /// Reference position of the lift, m. `None` while it has no target.
    lift_m: Option<f64>,
    /// Mean limb error over both of [`AVERAGES_S`], rad. `None` before the first tick at full speed: how far away the
    /// robot was when it began to move slowly says nothing about whether it still catches up.
    averages_rad: Option<[f64; 2]>,
    /// Time for which the arms have had all of their speed, s.
    full_speed_s: f64,
}

impl Default for Following {
    fn default() -> Self {
        Self {
            state: follow::State::default(),
            pointing_scale: engage::SPEED_SCALE_FIRST,
            head: None,
            lift_m: None,
            averages_rad: None,
            full_speed_s: 0.0,
        }
    }
}

/// Motion that whole-body control should reach.
pub(super) struct Reference {
    pub(super) q: [f64; JOINTS_MAX],
    pub(super) dq: [f64; JOINTS_MAX],
    pub(super) ddq: [f64; JOINTS_MAX],
    /// Bit j: joint j is valid.
    pub(super) valid_mask: u32,
}

impl Reference {
    /// Takes the positions and the valid joints of a target, with the velocities `dq`.
    fn from_target(target: &Target, dq: [f64; JOINTS_MAX]) -> Self {
        Self { q: target.q, dq, ddq: [0.0; JOINTS_MAX], valid_mask: target.valid_mask }
    }

    /// Converts it to the input of whole-body control.
    pub(super) fn as_target(&self) -> wbc::Target<'_> {
        wbc::Target { q: &self.q, dq: &self.dq, ddq: &self.ddq, valid_mask: self.valid_mask }
    }
}

/// How near the command is to the target.
pub(super) struct Closeness {
    pub(super) aligned: bool,
    pub(super) behind: bool,
    pub(super) settled: bool,
}

impl Following {
    /// Returns the reference of tick `k`. `None` while there is no target. If `late`, the target is where the person
    /// was, and its velocities are not used.
    pub(super) fn reference(
        &mut self,
        config: &Config,
        k: u64,
        (q, v): (&[f64; JOINTS_MAX], &[f64; JOINTS_MAX]),
        permit: engage::Permit,
        target: Option<&Target>,
        late: bool,
    ) -> Option<Reference> {
        let engage::Permit::Follow { speed_scale } = permit else {
            self.state.forget();
            (self.pointing_scale, self.head, self.averages_rad) = (engage::SPEED_SCALE_FIRST, None, None);
            (self.lift_m, self.full_speed_s) = (None, 0.0);
            return target.map(|target| Reference::from_target(target, [0.0; JOINTS_MAX]));
        };
        self.full_speed_s += messages::TICK_S;
        if speed_scale < 1.0 {
            (self.averages_rad, self.full_speed_s) = (None, 0.0);
        }
        self.pointing_scale = (self.pointing_scale + messages::TICK_S / POINTING_RAMP_S).min(speed_scale);
        let target = target?;
        let Some(ahead) = &target.ahead else {
            let dq = if late { [0.0; JOINTS_MAX] } else { target.dq };
            return Some(Reference::from_target(target, dq));
        };
        let input = follow::Input {
            k,
            limb_trajectory: &ahead.limbs,
            trajectory_first: ahead.first_node,
            valid_mask: target.valid_mask,
            prior: &target.q,
            hands: &ahead.hands,
            places: &ahead.places,
            q,
            v,
            speed_scale,
            wrist_speed_scale: self.pointing_scale,
        };
        let follow::Output { aims } = follow::tick(&config.follow, &mut self.state, input);
        let mut reference = Reference::from_target(target, [0.0; JOINTS_MAX]);
        self.turn_head(config, q, &mut reference);
        self.lift(config, q, speed_scale, &mut reference);
        for (j, aim) in aims.iter().enumerate() {
            if let Some(aim) = aim {
                (reference.q[j], reference.dq[j], reference.ddq[j]) = (aim.q, aim.v, aim.a);
                reference.valid_mask |= 1 << j;
            }
        }
        Some(reference)
    }

    /// Moves the reference of the lift from the command to its target at half of its speed.
    fn lift(&mut self, config: &Config, q: &[f64; JOINTS_MAX], speed_scale: f64, reference: &mut Reference) {
        let Some(j) = config.model.lift.filter(|&j| reference.valid_mask & 1 << j != 0) else {
            self.lift_m = None;
            return;
        };
        let most = LIFT_SPEED * speed_scale * config.model.limits[j].v_max * messages::TICK_S;
        let now = self.lift_m.get_or_insert(q[j]);
        *now = toward(*now, reference.q[j], most);
        reference.q[j] = *now;
    }

    /// Moves the reference of the head from the command to the target, or home without one, at the speed that it has.
    fn turn_head(&mut self, config: &Config, q: &[f64; JOINTS_MAX], reference: &mut Reference) {
        let Some(head) = &config.model.head else { return };
        let positions = self.head.get_or_insert(head.joints.map(|joint| joint.map_or(0.0, |j| q[j])));
        for (now, j) in positions.iter_mut().zip(head.joints).filter_map(|(now, joint)| Some((now, joint?))) {
            let most = self.pointing_scale * config.model.limits[j].v_max * messages::TICK_S;
            let goal = if reference.valid_mask & 1 << j != 0 { reference.q[j] } else { config.model.home[j] };
            *now = toward(*now, goal, most);
            (reference.q[j], reference.valid_mask) = (*now, reference.valid_mask | 1 << j);
        }
    }

    /// Judges how near a command at `q` with velocities `v` is to the target.
    pub(super) fn closeness(
        &mut self,
        config: &Config,
        target: Option<&Target>,
        q: &[f64; JOINTS_MAX],
        v: &[f64; JOINTS_MAX],
    ) -> Closeness {
        let slow = v.iter().all(|v| v.abs() <= SETTLED_SPEED);
        let Some(target) = target else { return Closeness { aligned: false, behind: false, settled: slow } };
        if target.ahead.is_none() {
            return Closeness {
                aligned: joints_aligned(&config.model, target, q),
                behind: monitor::far_behind(&config.model, &target.q, target.valid_mask, q),
                settled: slow,
            };
        }
        let mut sum = 0.0;
        let (mut limbs, mut worst) = (0.0_f64, 0.0_f64);
        for angle in limb_angles(&config.model, &config.arms, &target.limbs, q).into_iter().flatten() {
            (sum, limbs, worst) = (sum + angle, limbs + 1.0, worst.max(angle));
        }
        let mean = sum / limbs.max(1.0);
        let averages = self.averages_rad.get_or_insert([mean; 2]);
        for (average, time_s) in averages.iter_mut().zip(AVERAGES_S) {
            *average += (mean - *average) * messages::TICK_S / time_s;
        }
        let falls = averages[0] + ALIGNED_LIMBS_RAD < FALLEN * averages[1];
        Closeness {
            aligned: limbs > 0.0 && worst <= ALIGNED_LIMBS_RAD,
            behind: worst > BEHIND_RAD,
            // A person who drives no arm that may follow is not followed.
            settled: limbs > 0.0 && (slow || !falls && (mean <= BEHIND_RAD || self.full_speed_s >= AVERAGES_S[0])),
        }
    }
}

/// Returns a position at most `most` from `now` on the way to `goal`. The bounds would make a step down of NaN, so it holds.
fn toward(now: f64, goal: f64, most: f64) -> f64 {
    if goal.is_nan() { now } else { goal.max(now - most).min(now + most) }
}

/// Returns true if every valid joint of a command at `q` is near its target, as far as the limits let it reach the
/// target.
fn joints_aligned(model: &Model, target: &Target, q: &[f64; JOINTS_MAX]) -> bool {
    (0..model.count).filter(|j| target.valid_mask & 1 << j != 0).all(|j| {
        let limits = &model.limits[j];
        (target.q[j].clamp(limits.q_min, limits.q_max) - q[j]).abs() <= ALIGNED_RAD
    })
}
