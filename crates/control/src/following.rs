//! Following: the command follows the limbs if the target has a way of the person, else the joints.

use crate::status::limb_angles;
use crate::{Config, aligned};
use messages::{JOINTS_MAX, JointTarget, LIMBS, WAY_NODES};
use safety::{engage, monitor};

/// Limbs nearer to the person's than this are aligned, rad: 2 degrees. Retargeting itself leaves as much.
const ALIGNED_LIMBS_RAD: f64 = 0.035;
/// A limb farther from the person's than this is far behind, rad: 15 degrees.
const BEHIND_RAD: f64 = 0.26;

/// A command that moves no joint faster than this (rad/s, m/s) has settled. Blocked by an obstacle, it creeps
/// along it. Settling is required for half a second, and in that time it comes at most 1.4 degrees nearer.
const SETTLED_SPEED: f64 = 0.05;
/// Time constants of two averages of the limb error, s. A falling error shows that the robot catches up.
/// Assumptions: a swing of an arm is shorter than the longer one, and a reach across is longer than the shorter
/// one.
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
    /// Wished positions of the head's joints, rad. `None` before the first tick.
    head: Option<[f64; 2]>,
    /// Wished position of the lift, m. `None` while it has no target.
    lift_m: Option<f64>,
    /// Mean limb error over both of [`AVERAGES_S`], rad. `None` before the first tick.
    averages_rad: Option<[f64; 2]>,
}

impl Default for Following {
    fn default() -> Self {
        Self {
            state: follow::State::default(),
            pointing_scale: engage::SPEED_SCALE_FIRST,
            head: None,
            lift_m: None,
            averages_rad: None,
        }
    }
}

/// Motion that whole-body control should reach.
pub(super) struct Wish {
    pub(super) q: [f64; JOINTS_MAX],
    pub(super) dq: [f64; JOINTS_MAX],
    pub(super) ddq: [f64; JOINTS_MAX],
    /// Bit j: joint j is valid.
    pub(super) valid_mask: u32,
}

impl Wish {
    /// Takes the positions and the valid joints of a target, with the velocities `dq`.
    fn of_target(target: &JointTarget, dq: [f64; JOINTS_MAX]) -> Self {
        Self { q: target.q, dq, ddq: [0.0; JOINTS_MAX], valid_mask: target.valid_mask }
    }

    /// Converts it to the input of whole-body control.
    pub(super) fn target(&self) -> wbc::Target<'_> {
        wbc::Target { q: &self.q, dq: &self.dq, ddq: &self.ddq, valid_mask: self.valid_mask }
    }
}

/// How near the command is to the target.
pub(super) struct Closeness {
    pub(super) aligned: bool,
    pub(super) behind: bool,
    pub(super) settled: bool,
}

/// Returns true if the command follows the limbs.
fn has_way(target: &JointTarget) -> bool {
    target.way_nodes as usize == WAY_NODES
}

impl Following {
    /// Returns the wish of tick `k`. `None` while there is no target. If `late`, the target is where the person
    /// was, and its velocities are not used.
    pub(super) fn wish(
        &mut self,
        config: &Config,
        k: u64,
        (q, v): (&[f64; JOINTS_MAX], &[f64; JOINTS_MAX]),
        permit: engage::Permit,
        target: Option<&JointTarget>,
        late: bool,
    ) -> Option<Wish> {
        let engage::Permit::Follow { speed_scale } = permit else {
            self.state.forget();
            (self.pointing_scale, self.head, self.averages_rad) = (engage::SPEED_SCALE_FIRST, None, None);
            self.lift_m = None;
            return target.map(|target| Wish::of_target(target, [0.0; JOINTS_MAX]));
        };
        self.pointing_scale = (self.pointing_scale + messages::TICK_S / POINTING_RAMP_S).min(speed_scale);
        let target = target?;
        if !has_way(target) {
            let dq = if late { [0.0; JOINTS_MAX] } else { target.dq };
            return Some(Wish::of_target(target, dq));
        }
        let input = follow::Input {
            k,
            way: &target.way,
            way_first: target.way_first,
            valid_mask: target.valid_mask,
            prior: &target.q,
            hands: &target.way_hands,
            places: &target.way_places,
            q,
            v,
            speed_scale,
            wrist_speed_scale: self.pointing_scale,
        };
        let follow::Output { aims } = follow::tick(&config.follow, &mut self.state, input);
        let mut wish = Wish::of_target(target, [0.0; JOINTS_MAX]);
        self.turn_head(config, q, &mut wish);
        self.lift(config, q, speed_scale, &mut wish);
        for (j, aim) in aims.iter().enumerate() {
            if let Some(aim) = aim {
                (wish.q[j], wish.dq[j], wish.ddq[j]) = (aim.q, aim.v, aim.a);
                wish.valid_mask |= 1 << j;
            }
        }
        Some(wish)
    }

    /// Lets the wish of the lift go from the command to its target at half of its speed.
    fn lift(&mut self, config: &Config, q: &[f64; JOINTS_MAX], speed_scale: f64, wish: &mut Wish) {
        let Some(j) = config.model.lift.filter(|&j| wish.valid_mask & 1 << j != 0) else {
            self.lift_m = None;
            return;
        };
        let most = LIFT_SPEED * speed_scale * config.model.limits[j].v_max * messages::TICK_S;
        let now = self.lift_m.get_or_insert(q[j]);
        *now = toward(*now, wish.q[j], most);
        wish.q[j] = *now;
    }

    /// Lets the wish of the head go from the command to the target, or home without one, at the speed that it has.
    fn turn_head(&mut self, config: &Config, q: &[f64; JOINTS_MAX], wish: &mut Wish) {
        let Some(head) = &config.model.head else { return };
        let wished = self.head.get_or_insert(head.joints.map(|j| q[j]));
        for (now, j) in wished.iter_mut().zip(head.joints) {
            let most = self.pointing_scale * config.model.limits[j].v_max * messages::TICK_S;
            let goal = if wish.valid_mask & 1 << j != 0 { wish.q[j] } else { config.model.home[j] };
            *now = toward(*now, goal, most);
            (wish.q[j], wish.valid_mask) = (*now, wish.valid_mask | 1 << j);
        }
    }

    /// Judges how near a command at `q` with velocities `v` is to the target.
    pub(super) fn closeness(
        &mut self,
        config: &Config,
        target: Option<&JointTarget>,
        q: &[f64; JOINTS_MAX],
        v: &[f64; JOINTS_MAX],
    ) -> Closeness {
        let slow = v.iter().all(|v| v.abs() <= SETTLED_SPEED);
        let Some(target) = target else { return Closeness { aligned: false, behind: false, settled: slow } };
        if !has_way(target) {
            return Closeness {
                aligned: aligned(&config.model, target, q),
                behind: monitor::far_behind(&config.model, &target.q, target.valid_mask, q),
                settled: slow,
            };
        }
        let mut sum = 0.0;
        let (mut limbs, mut worst) = (0.0_f64, 0.0_f64);
        for angle in limb_angles(&config.model, &config.arm, target, q).into_iter().flatten() {
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
            settled: limbs > 0.0 && (slow || !falls),
        }
    }
}

/// Returns a position at most `most` from `now` on the way to `goal`. The bounds would make a step down of NaN, so it holds.
fn toward(now: f64, goal: f64, most: f64) -> f64 {
    if goal.is_nan() { now } else { goal.max(now - most).min(now + most) }
}

/// The person's limbs of a target that has a way. Used to compare one target with the next.
pub(super) fn person(target: &JointTarget) -> Option<&[[f64; 4]; LIMBS]> {
    has_way(target).then_some(&target.human_limbs)
}
