//! Keeps the hands clear of the robot. A wrist's two joints turn no limb of the person, so they are free to turn
//! the hand away during its arm's motion. Then the arm need not stop if a turn of the hand is enough.
//!
//! Let w be the positions of joints 6 and 7, and d_p(k, w) the distance of pair p. One capsule of each pair is on
//! the wrist. The posture is that of both arms' plans at node k:
//!
//! ```text
//! minimise  sum_k sum_p max(0, (R - d_p(k, w)) / R)^2 + r_h |w - home|^2,   |w'| <= V,  w in its range
//! ```
//!
//! A tick evaluates one node of one arm. A Gauss-Newton step follows after the last node. Whole-body control
//! handles obstacles that are not part of the robot.

use crate::NODES;
use messages::{JOINTS_MAX, TICK_S};
use nalgebra::{Matrix2, Vector2, Vector3};
use robot::{Frames, Model, segment_distance};

/// Joints of a wrist.
pub(crate) const WRIST_JOINTS: usize = 2;
/// The first of them within an arm.
pub(crate) const WRIST_FIRST: usize = 5;

/// Nodes that are evaluated: half a second ahead, a tenth apart.
const WATCHED: [usize; 5] = [0, 5, 11, 17, NODES - 1];

/// Distance below which a pair counts, R, m. Whole-body control slows an arm whose stop comes nearer than about 30
/// mm.
const RANGE_M: f64 = 0.06;
/// Weight of the home posture, r_h, per rad^2. A pair that is 1 mm inside the range at one node bends the wrist by
/// 0.1 rad.
const HOME: f64 = 0.003;
/// Added to the diagonal of a step's matrix, per rad^2.
const DAMPING: f64 = 0.5;

/// Margin to the position limits, rad. Whole-body control keeps 2 mrad.
const INSET_RAD: f64 = 3e-3;

/// Capsule `hand` is on the arm's wrist, `other` is not.
#[derive(Clone, Copy, Debug)]
struct Pair {
    hand: usize,
    other: usize,
    radii_m: f64,
}

/// Constant data of one wrist.
#[derive(Clone, Debug)]
pub(crate) struct Wrist {
    /// Index of joint 6.
    first: usize,
    pairs: Vec<Pair>,
    /// Unit axes of both joints, each in the frame of the body that it moves.
    axes: [Vector3<f64>; WRIST_JOINTS],
    home: Vector2<f64>,
    q_min: Vector2<f64>,
    q_max: Vector2<f64>,
    v_max: Vector2<f64>,
}

/// Wish of one wrist, and its sums over the nodes so far.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Wish {
    /// Wished positions, rad.
    pub(crate) q: [f64; WRIST_JOINTS],
    /// Half of the cost's gradient and Hessian so far.
    gradient: Vector2<f64>,
    hessian: Matrix2<f64>,
}

/// Ticks from one step of a wrist to the next, while its nodes are evaluated in turn.
pub(crate) const STEP_TICKS: u64 = WATCHED.len() as u64;

/// Returns the node that tick `step` of [`STEP_TICKS`] evaluates.
pub(crate) fn watched(step: u64) -> usize {
    WATCHED[(step % STEP_TICKS) as usize]
}

impl Wrist {
    /// Creates the wrist of the arm that begins with joint `arm_first`. `v_max`: allowed speeds of all joints,
    /// rad/s.
    pub(crate) fn new(model: &Model, arm_first: usize, v_max: &[f64; JOINTS_MAX]) -> Self {
        let first = arm_first + WRIST_FIRST;
        let is_hand = |capsule: usize| (first + 1..=first + WRIST_JOINTS).contains(&model.capsules[capsule].body);
        let pair = |hand: usize, other: usize| {
            let radii_m = model.capsules[hand].radius_m + model.capsules[other].radius_m;
            Pair { hand, other, radii_m }
        };
        let pairs = model.pairs.iter().filter_map(|&robot::Pair { a, b }| match (is_hand(a), is_hand(b)) {
            (true, false) => Some(pair(a, b)),
            (false, true) => Some(pair(b, a)),
            _ => None,
        });
        let of = |value: &dyn Fn(usize) -> f64| Vector2::from_fn(|i, _| value(first + i));
        Self {
            first,
            pairs: pairs.collect(),
            axes: [0, 1].map(|i| model.joint_at_zero(first + i).1),
            home: of(&|j| model.home[j]),
            q_min: of(&|j| model.limits[j].q_min + INSET_RAD),
            q_max: of(&|j| model.limits[j].q_max - INSET_RAD),
            v_max: of(&|j| v_max[j]),
        }
    }

    /// Starts at the wrist's commanded position.
    pub(crate) fn begin(&self, q: &[f64; JOINTS_MAX]) -> Wish {
        Wish { q: [q[self.first], q[self.first + 1]], ..Wish::default() }
    }

    /// Adds the pairs of the robot's posture with the bodies at `frames`. A pair whose distance is not finite adds
    /// nothing.
    pub(crate) fn look(&self, model: &Model, frames: &Frames, wish: &mut Wish) {
        let end = |capsule: usize| {
            let capsule = &model.capsules[capsule];
            let pose = &frames.base_from_body[capsule.body];
            [pose.transform_point(&capsule.a), pose.transform_point(&capsule.b)]
        };
        for pair in &self.pairs {
            let (hand, other) = (end(pair.hand), end(pair.other));
            let spheres = ((hand[0] + hand[1]) - (other[0] + other[1])).norm() / 2.0;
            let halves = ((hand[0] - hand[1]).norm() + (other[0] - other[1]).norm()) / 2.0;
            if spheres - halves - pair.radii_m >= RANGE_M {
                continue;
            }
            let nearest = segment_distance(&hand[0], &hand[1], &other[0], &other[1]);
            let point = hand[0] + (hand[1] - hand[0]) * nearest.s;
            let apart = point - (other[0] + (other[1] - other[0]) * nearest.t);
            let inside = (RANGE_M + pair.radii_m - nearest.distance_m) / RANGE_M;
            if !(inside > 0.0 && nearest.distance_m > 0.0) {
                continue;
            }
            let away = apart / nearest.distance_m;
            let joints = model.capsules[pair.hand].body - self.first;
            let slope = Vector2::from_fn(|i, _| {
                let pose = &frames.base_from_body[self.first + i + 1];
                // Joint 7 does not move a capsule on joint 6.
                if i < joints { away.dot(&(pose.r * self.axes[i]).cross(&(point - pose.t))) / RANGE_M } else { 0.0 }
            });
            wish.gradient -= slope * inside;
            wish.hessian += slope * slope.transpose();
        }
    }

    /// Takes the step after the last node, `period_s` after the previous step. It is at most `speed_scale` of the
    /// speeds.
    pub(crate) fn step(&self, wish: &mut Wish, speed_scale: f64, period_s: f64) {
        let q = Vector2::from(wish.q);
        let gradient = wish.gradient + (q - self.home) * HOME;
        let hessian = wish.hessian + Matrix2::identity() * (HOME + DAMPING * wish.hessian.trace().max(HOME));
        let step = hessian.cholesky().map_or(Vector2::zeros(), |factor| -factor.solve(&gradient));
        let most = self.v_max * (speed_scale * period_s);
        for i in 0..WRIST_JOINTS {
            // Unlike `clamp`, this accepts NaN.
            let step = step[i].max(-most[i]).min(most[i]);
            wish.q[i] = (wish.q[i] + step).max(self.q_min[i]).min(self.q_max[i]);
        }
        (wish.gradient, wish.hessian) = (Vector2::zeros(), Matrix2::zeros());
    }
}

/// Time between two steps of a wrist, s, if `arms` take turns.
pub(crate) fn period_s(arms: usize) -> f64 {
    (arms as u64 * STEP_TICKS) as f64 * TICK_S
}
