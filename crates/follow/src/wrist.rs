//! Turns the hands as the person's, and keeps them clear of the robot. A wrist's two joints turn no limb of the person,
//! so they may turn the hand away during its arm's motion. Then the arm need not leave the person if a turn of the hand is
//! enough.
//!
//! Let w be the positions of joints 6 and 7, and d_p(k, w) the distance of pair p at node k of both arms' plans. h are the
//! positions that come nearest to the person's hand from the forearm that the arm's plan has by then. Without a hand h is
//! home:
//!
//! ```text
//! minimise  sum_k sum_p max(0, (R - d_p(k, w)) / R)^2 + r_h |w - h|^2,   |w'| <= V,  w in its range
//! ```
//!
//! The hand of the person is known for some nodes ahead, at the times t_i. The wrist moves towards h at the constant speed that
//! comes nearest to all of them, so that it starts in time:
//!
//! ```text
//! v = sum_i t_i (h_i - w) / sum_i t_i^2
//! ```
//!
//! A tick evaluates one node of one arm. A Gauss-Newton step follows after the last node. Whole-body control
//! handles obstacles that are not part of the robot.

use crate::arm::ArmVector;
use crate::near::{Near, SEEN_M};
use messages::JOINTS_MAX;
use nalgebra::{Matrix2, Rotation3, UnitQuaternion, Vector2};
use robot::{Arm, Model, TwoAxes};

/// Joints of a wrist.
pub(crate) const WRIST_JOINTS: usize = 2;
/// The first of them within an arm.
pub(crate) const WRIST_FIRST: usize = 5;

/// Weight of the wanted posture, r_h, per rad^2. A pair that is 1 mm inside the range at one node bends the wrist by
/// 0.1 rad.
const WANTED: f64 = 0.003;
/// Distance below which a pair turns a hand that follows the person's, m. Without a person's hand it is [`SEEN_M`]. Six
/// clips chose it: with 25 mm the arms are 0.2 degrees further from the person, with 60 mm the hands 15 degrees.
const LED_RANGE_M: f64 = 0.04;
/// Distance below which a pair turns a hand that may touch, m. With 40 mm a clap of TIAGo++ ended 4.0 cm too far apart, with 20 mm
/// 2.5 cm.
const TOUCHING_RANGE_M: f64 = 0.02;
/// Weight while the person's hand asks for a posture, per rad^2. It is strong enough for a hand near nothing, and weak beside
/// a pair that touches.
const LED: f64 = 0.2;
/// Time in which a wrist that is near nothing goes the way of its speed, s. The cost's h lies so far ahead: two thirds of what is
/// known. 0.05 s gave the same on six clips.
const AHEAD_S: f64 = 0.08;
/// Added to the diagonal of a step's matrix, per rad^2.
const DAMPING: f64 = 0.5;

/// Margin to the position limits, rad. Whole-body control keeps 2 mrad.
const INSET_RAD: f64 = 3e-3;

/// Constant data of one wrist.
#[derive(Clone, Debug)]
pub(crate) struct Wrist {
    /// Index of joint 6.
    first: usize,
    arm: Arm,
    axes: TwoAxes,
    home: Vector2<f64>,
    q_min: Vector2<f64>,
    q_max: Vector2<f64>,
    v_max: Vector2<f64>,
}

/// Distance below which a pair turns a hand, m. `led`: the person's hand asks for a posture. `touching`: it may touch.
pub(crate) fn range_m(led: bool, touching: bool) -> f64 {
    if touching {
        TOUCHING_RANGE_M
    } else if led {
        LED_RANGE_M
    } else {
        SEEN_M
    }
}

/// Wish of one wrist, and its sums over the nodes so far.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Wish {
    /// Wished positions, rad.
    pub(crate) q: [f64; WRIST_JOINTS],
    /// Those before the last step, rad.
    before: [f64; WRIST_JOINTS],
    /// Half of the cost's gradient and Hessian so far.
    gradient: Vector2<f64>,
    hessian: Matrix2<f64>,
}

impl Wish {
    /// Returns position and velocity of its joint `i` at a share of the period after the last step.
    pub(crate) fn at(&self, i: usize, share: f64, period_s: f64) -> (f64, f64) {
        let step = self.q[i] - self.before[i];
        (self.before[i] + share * step, step / period_s)
    }

    /// Adds a pair at a node. Nearer than `range_m` it turns the hand.
    pub(crate) fn add(&mut self, near: &Near, range_m: f64) {
        if near.distance_m >= range_m {
            return;
        }
        let slope = Vector2::new(near.slope[WRIST_FIRST], near.slope[WRIST_FIRST + 1]) / range_m;
        self.gradient -= slope * ((range_m - near.distance_m) / range_m);
        self.hessian += slope * slope.transpose();
    }
}

/// Sums over the nodes for which the person's hand is known.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Course {
    moved: Vector2<f64>,
    squares: f64,
}

impl Course {
    /// Adds that the wrist should be at `wanted` (rad) in `in_s`.
    pub(crate) fn add(&mut self, wish: &Wish, in_s: f64, wanted: [f64; WRIST_JOINTS]) {
        self.moved += (Vector2::from(wanted) - Vector2::from(wish.q)) * in_s;
        self.squares += in_s * in_s;
    }

    /// Returns the speed, rad/s. Zero if nothing lies ahead.
    pub(crate) fn speed(&self) -> Vector2<f64> {
        if self.squares > 0.0 { self.moved / self.squares } else { Vector2::zeros() }
    }
}

impl Wrist {
    /// Creates the wrist of the left (0) or the right arm (1). `v_max`: allowed speeds of all joints, rad/s.
    pub(crate) fn new(model: &Model, side: usize, v_max: &[f64; JOINTS_MAX]) -> Self {
        let arm = model.arms[side];
        let first = arm.joints[WRIST_FIRST];
        let of = |value: &dyn Fn(usize) -> f64| Vector2::from_fn(|i, _| value(first + i));
        Self {
            first,
            arm,
            axes: model.wrists[side],
            home: of(&|j| model.home[j]),
            q_min: of(&|j| model.limits[j].q_min + INSET_RAD),
            q_max: of(&|j| model.limits[j].q_max - INSET_RAD),
            v_max: of(&|j| v_max[j]),
        }
    }

    /// Returns the positions that turn the hand nearest to `hand`, in the torso frame, while the arm is at `q`, rad.
    pub(crate) fn pointing(&self, q: &ArmVector, hand: &UnitQuaternion<f64>) -> [f64; WRIST_JOINTS] {
        let (_, fore) = self.arm.limb_rotations(&(*q).into());
        let fore = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(fore));
        self.axes.nearest(&(fore.inverse() * hand))
    }

    /// Starts at the wrist's commanded position.
    pub(crate) fn begin(&self, q: &[f64; JOINTS_MAX]) -> Wish {
        let q = [q[self.first], q[self.first + 1]];
        Wish { q, before: q, ..Wish::default() }
    }

    /// Takes the step after the last node, `period_s` after the previous step. It is at most `speed_scale` of the
    /// speeds. `speed`: that to the person's hand, rad/s. `None` stands for the way home.
    pub(crate) fn step(&self, wish: &mut Wish, speed: Option<Vector2<f64>>, speed_scale: f64, period_s: f64) {
        wish.before = wish.q;
        let (pull, weight) = match speed {
            Some(speed) => (speed * AHEAD_S, LED),
            None => (self.home - Vector2::from(wish.q), WANTED),
        };
        // A hand that is near nothing moves at its speed. One that is near things gets away at once.
        let hurry = (period_s / AHEAD_S * (1.0 + wish.hessian.trace() / LED)).min(1.0);
        let share = if speed.is_some() { hurry } else { 1.0 };
        let gradient = wish.gradient - pull * weight;
        // Near things the step is damped, because the distances bend.
        let hessian = wish.hessian + Matrix2::identity() * (weight + DAMPING * wish.hessian.trace());
        let step = hessian.cholesky().map_or(Vector2::zeros(), |factor| -factor.solve(&gradient) * share);
        let most = self.v_max * (speed_scale * period_s);
        for i in 0..WRIST_JOINTS {
            // The bounds would make a full step down of NaN. The wrist holds instead.
            let step = if step[i].is_nan() { 0.0 } else { step[i].max(-most[i]).min(most[i]) };
            wish.q[i] = (wish.q[i] + step).max(self.q_min[i]).min(self.q_max[i]);
        }
        (wish.gradient, wish.hessian) = (Vector2::zeros(), Matrix2::zeros());
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
        let mut wish = Wish { gradient: Vector2::repeat(f64::NAN), ..begin };
        wrist.step(&mut wish, None, 1.0, 0.01);
        assert_eq!(wish.q, begin.q);
        // The NaN does not last: the next step pulls a turned wrist back home.
        wish.q = wish.q.map(|q| q + 0.1);
        wrist.step(&mut wish, None, 1.0, 0.01);
        assert!((0..WRIST_JOINTS).all(|i| wish.q[i] < begin.q[i] + 0.1), "{wish:?}");
    }
}
