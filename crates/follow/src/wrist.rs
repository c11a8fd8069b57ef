//! Wrist control: the two wrist joints point the hand as the person's hand, and keep it clear of the robot.
//!
//! ```text
//! minimise over w   sum_k sum_p max(0, (R - d_p(k, w)) / R)^2 + r_h |w - h|^2,   |w'| <= V,   w_min <= w <= w_max
//!
//! w         positions of joints 6 and 7, rad
//! h         positions that point the robot's hand as the person's at the plan's forearm, rad. Home without a hand.
//! d_p(k, w) distance of the capsule pair p at node k of both arms' plans, m
//! R         range within which a pair turns the hand, m
//! r_h       weight of the wanted positions, 1/rad^2
//! V         speed limit of the wrist joints, rad/s
//! ```
//!
//! The wrist joints turn no limb of the person. So a turned hand often clears the robot while both limbs keep following.
//!
//! The person's hand is known at the first nodes, at the times t_i with the wanted positions h_i. The wrist moves at the
//! constant speed that fits them best, so it starts in time:
//!
//! ```text
//! v = argmin sum_i |w + t_i v - h_i|^2 = sum_i t_i (h_i - w) / sum_i t_i^2
//! ```
//!
//! One tick evaluates one node of one arm. After the last node the wrist takes one Gauss-Newton step. Whole-body control
//! handles obstacles that are not part of the robot.

use crate::LIMB_JOINTS;
use crate::arm::ArmVector;
use crate::proximity::{NearPair, PROXIMITY_M};
use messages::JOINTS_MAX;
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use robot::{Arm, Model, POINTING_JOINTS, PointingJoints};

/// Most joints of a wrist. Where it has fewer, the rest stays at zero.
pub(crate) const WRIST_JOINTS: usize = POINTING_JOINTS;
/// Slot of the first wrist joint within an arm.
const WRIST_FIRST: usize = LIMB_JOINTS;

/// Weight r_h of the home position, 1/rad^2. A pair that is 1 mm inside the range at one node bends the wrist by 0.1 rad.
const HOME_WEIGHT: f64 = 0.003;
/// Weight r_h of the person's hand, 1/rad^2. It dominates where no pair is near, and yields to a pair in contact.
const HAND_WEIGHT: f64 = 0.2;
/// Range R while the wrist follows a person's hand, m. Without a person's hand R is [`PROXIMITY_M`]. Six clips chose it: with
/// 25 mm the arms are 0.2 degrees further from the person, with 60 mm the hands 15 degrees.
const HAND_RANGE_M: f64 = 0.04;
/// Range R of a hand that may touch something, m. With 40 mm a clap of TIAGo++ ended 4.0 cm too far apart, with 20 mm
/// 2.5 cm.
const TOUCHING_RANGE_M: f64 = 0.02;
/// Look-ahead of the fitted speed, s: h = w + v * AHEAD_S. It is two thirds of the time for which hands are known. 0.05 s gave
/// the same on six clips.
const AHEAD_S: f64 = 0.08;
/// Damping of the Gauss-Newton step, as a share of the trace of the pairs' Hessian.
const DAMPING: f64 = 0.5;

/// Margin to the position limits, rad. Whole-body control keeps 2 mrad.
const INSET_RAD: f64 = 3e-3;

/// Constant data of one wrist.
#[derive(Clone, Debug)]
pub(crate) struct Wrist {
    arm: Arm,
    axes: PointingJoints,
    home: Vector3<f64>,
    q_min: Vector3<f64>,
    q_max: Vector3<f64>,
    v_max: Vector3<f64>,
}

/// Returns the range R, m. `follows_hand`: the person's hand is known. `touching`: the hand may touch something.
pub(crate) fn range_m(follows_hand: bool, touching: bool) -> f64 {
    if touching {
        TOUCHING_RANGE_M
    } else if follows_hand {
        HAND_RANGE_M
    } else {
        PROXIMITY_M
    }
}

/// Target of one wrist, and the sums of its cost over the nodes so far.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct WristTarget {
    /// Positions after the last step, rad.
    pub(crate) q: [f64; WRIST_JOINTS],
    /// Positions before the last step, rad.
    before: [f64; WRIST_JOINTS],
    /// Half of the gradient of the pairs' cost so far.
    gradient: Vector3<f64>,
    /// Half of its Hessian so far.
    hessian: Matrix3<f64>,
}

impl WristTarget {
    /// Returns position (rad) and velocity (rad/s) of wrist joint `i`, at a share of the period after the last step.
    pub(crate) fn at(&self, i: usize, share: f64, period_s: f64) -> (f64, f64) {
        let step = self.q[i] - self.before[i];
        (self.before[i] + share * step, step / period_s)
    }

    /// Adds the cost of a pair at a node, ((R - d) / R)^2 for d < R = `range_m`.
    pub(crate) fn add(&mut self, pair: &NearPair, range_m: f64) {
        if pair.distance_m >= range_m {
            return;
        }
        let slope = Vector3::from_fn(|i, _| pair.slope[WRIST_FIRST + i]) / range_m;
        self.gradient -= slope * ((range_m - pair.distance_m) / range_m);
        self.hessian += slope * slope.transpose();
    }
}

/// Least-squares fit of a constant wrist speed to the person's hand.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct SpeedFit {
    /// Sum of t_i (h_i - w), rad s.
    moments: Vector3<f64>,
    /// Sum of t_i^2, s^2.
    squares: f64,
}

impl SpeedFit {
    /// Adds the wanted positions h_i (rad) at the time t_i = `in_s`.
    pub(crate) fn add(&mut self, target: &WristTarget, in_s: f64, wanted: [f64; WRIST_JOINTS]) {
        self.moments += (Vector3::from(wanted) - Vector3::from(target.q)) * in_s;
        self.squares += in_s * in_s;
    }

    /// Returns the fitted speed, rad/s. Zero without a node ahead.
    pub(crate) fn speed(&self) -> Vector3<f64> {
        if self.squares > 0.0 { self.moments / self.squares } else { Vector3::zeros() }
    }
}

impl Wrist {
    /// Creates the wrist of the left (0) or the right arm (1). `v_max`: allowed speeds of all joints, rad/s.
    pub(crate) fn new(model: &Model, side: usize, v_max: &[f64; JOINTS_MAX]) -> Self {
        let arm = model.arms[side];
        let axes = model.wrists[side];
        let each = |value: &dyn Fn(usize) -> f64| Vector3::from_fn(|i, _| axes.joints[i].map_or(0.0, value));
        Self {
            arm,
            axes,
            home: each(&|j| model.home[j]),
            q_min: each(&|j| model.limits[j].q_min + INSET_RAD),
            q_max: each(&|j| model.limits[j].q_max - INSET_RAD),
            v_max: each(&|j| v_max[j]),
        }
    }

    /// Returns the positions that turn the hand nearest to `hand`, in the torso frame, while the arm is at `q` and the wrist at
    /// `from`, rad.
    pub(crate) fn pointing(
        &self,
        q: &ArmVector,
        hand: &UnitQuaternion<f64>,
        from: [f64; WRIST_JOINTS],
    ) -> [f64; WRIST_JOINTS] {
        let (_, fore) = self.arm.limb_rotations(&(*q).into());
        let fore = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(fore));
        self.axes.nearest(&(fore.inverse() * hand), from)
    }

    /// The joints, and their places in the wrist.
    pub(crate) fn joints(&self) -> impl Iterator<Item = (usize, usize)> + use<> {
        self.axes.joints.into_iter().enumerate().filter_map(|(i, joint)| Some((i, joint?)))
    }

    /// Returns the target that equals the wrist's commanded position.
    pub(crate) fn begin(&self, q: &[f64; JOINTS_MAX]) -> WristTarget {
        let q = self.axes.joints.map(|joint| joint.map_or(0.0, |joint| q[joint]));
        WristTarget { q, before: q, ..WristTarget::default() }
    }

    /// Takes the Gauss-Newton step after the last node, `period_s` after the previous step. It is at most `speed_scale` of the
    /// speed limits. `speed`: fitted speed of the person's hand, rad/s. Without it the wrist returns home.
    pub(crate) fn step(&self, target: &mut WristTarget, speed: Option<Vector3<f64>>, speed_scale: f64, period_s: f64) {
        target.before = target.q;
        let (pull, weight) = match speed {
            Some(speed) => (speed * AHEAD_S, HAND_WEIGHT),
            None => (self.home - Vector3::from(target.q), HOME_WEIGHT),
        };
        // Far from all pairs, the hand moves at the fitted speed. The nearer a pair, the larger the share of the whole step.
        let hand_share = (period_s / AHEAD_S * (1.0 + target.hessian.trace() / HAND_WEIGHT)).min(1.0);
        let share = if speed.is_some() { hand_share } else { 1.0 };
        let gradient = target.gradient - pull * weight;
        // Near a pair the step is damped, because the distance is not linear in w.
        let hessian = target.hessian + Matrix3::identity() * (weight + DAMPING * target.hessian.trace());
        let step = hessian.cholesky().map_or(Vector3::zeros(), |factor| -factor.solve(&gradient) * share);
        let most = self.v_max * (speed_scale * period_s);
        for i in 0..WRIST_JOINTS {
            // `max` and `min` would turn NaN into a full step down. The wrist holds its position instead.
            let step = if step[i].is_nan() { 0.0 } else { step[i].max(-most[i]).min(most[i]) };
            target.q[i] = (target.q[i] + step).max(self.q_min[i]).min(self.q_max[i]);
        }
        (target.gradient, target.hessian) = (Vector3::zeros(), Matrix3::zeros());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wrist_holds_on_nan() {
        let toml = include_str!("../../../config/robots/tiago_dual.toml");
        let urdf = include_str!("../../../config/robots/tiago_dual.urdf");
        let model = Model::from_text("toml", toml, "urdf", urdf).unwrap();
        let wrist = Wrist::new(&model, 0, &model.limits.map(|limits| limits.v_max));
        let begin = wrist.begin(&model.home);
        let mut target = WristTarget { gradient: Vector3::repeat(f64::NAN), ..begin };
        wrist.step(&mut target, None, 1.0, 0.01);
        assert_eq!(target.q, begin.q);
        // The next step discards the NaN and moves the wrist back home.
        target.q = target.q.map(|q| q + 0.1);
        wrist.step(&mut target, None, 1.0, 0.01);
        assert!((0..WRIST_JOINTS).all(|i| target.q[i] < begin.q[i] + 0.1), "{target:?}");
    }
}
