//! Judges how near a robot can come to a person: in the built-in motion, in the T-pose, and with arms that hang.

use super::Finding;
use messages::JOINTS_MAX;
use motion::{CalibrationMode, Motion, SMPL_ARMS};
use nalgebra::{UnitQuaternion, Vector3};
use retarget::{ArmModel, ArmQ, Limbs, Weights, oracle, solve_poses};
use robot::{Frames, Model};

/// Every so many frames of the standard motion are judged: it lasts 22 s at 60 Hz.
const EVERY: usize = 12;
/// Largest angle between a limb and the person's that the robot's best posture may leave, degrees. Shipped robots reach 0.0
/// to 2.7 in the built-in motion. Files with exchanged arms or a wrong T-pose leave more than 20 (both measured).
const BEST_MAX_DEG: f64 = 10.0;
/// The same for an arm of which a limb cannot turn about its own length: twice what ideal ones leave (7 to 9 degrees, measured).
const WITHOUT_ROLL_MAX_DEG: f64 = 18.0;
/// Wrists farther apart than this from side to side tell the sides of a person's hands, m (chosen: a shoulder's half width).
const APART_M: f64 = 0.2;
/// Largest share of such frames in which the robot's hands may have changed their sides (chosen).
const CROSSED_SHARE_MAX: f64 = 0.5;
/// Largest angle by which hanging arms may have to be raised to the side until they are clear, degrees. The person of the
/// built-in motion stands so.
const RAISED_MAX_DEG: f64 = 18.0;
/// Angle from hanging arms to the T-pose, degrees.
const T_POSE_DEG: usize = 90;

/// How near the robot's limbs can come to a person's.
#[derive(Clone, Debug)]
pub(super) struct Following {
    /// Mean limb error over the built-in motion: of the best reachable posture, degrees.
    pub(super) best_deg: f64,
    /// The same for the network with two refinement steps. `None` without weights.
    pub(super) solved_deg: Option<f64>,
    /// Share of the frames with hands on different sides in which the robot's hands have changed theirs.
    crossed: f64,
    /// Larger limb error of the best posture for the T-pose, degrees.
    t_pose_deg: f64,
    hanging: Hanging,
    best_max_deg: f64,
}

/// Posture of a person who stands with hanging arms.
#[derive(Clone, Debug)]
struct Hanging {
    /// Least clearance there, m, and the names of what is so near.
    clearance_m: f64,
    names: [String; 2],
    needed_m: f64,
    /// Angle by which the arms must be raised to the side until they are clear, degrees. `None` if they never are.
    raised_deg: Option<usize>,
}

impl Following {
    pub(super) fn measure(model: &Model, weights: Option<&Weights>) -> Self {
        let arms = ArmModel::both(model);
        let motion = motion::builtin();
        let calibration = motion::calibrate(&motion, CalibrationMode::Rig);
        let (mut best_deg, mut solved_deg, mut count) = (0.0, 0.0, 0.0);
        let (mut apart, mut crossed) = (0.0, 0.0);
        let mut previous = arms.each_ref().map(|arm| arm.clamp(&arm.reference));
        for (frame, limbs) in motion::limbs(&motion, &calibration).iter().enumerate().step_by(EVERY) {
            let Some(limbs) = Limbs::from_message(limbs) else { continue };
            let solved = weights.map(|weights| solve_poses(arms.each_ref(), &weights.network, &limbs, 2));
            for (side, (arm, human)) in arms.iter().zip(&limbs).enumerate() {
                previous[side] = oracle(arm, human, &previous[side]).q;
                best_deg += mean_error_deg(arm, &previous[side], human);
                solved_deg += solved.map_or(0.0, |solved| mean_error_deg(arm, &solved[side].q, human));
                count += 1.0;
            }
            if wrists_apart_m(&motion, frame) > APART_M {
                apart += 1.0;
                crossed += if hands_apart_m(model, &posture(model, &previous)) < 0.0 { 1.0 } else { 0.0 };
            }
        }
        let t_pose_deg = arms.each_ref().map(|arm| {
            let t_pose = oracle(arm, &Limbs::identity(), &arm.clamp(&arm.reference)).q;
            let [upper, fore] = arm.limb_error_deg(&t_pose, &Limbs::identity());
            upper.max(fore)
        });
        Self {
            best_deg: best_deg / count,
            solved_deg: weights.map(|_| solved_deg / count),
            crossed: crossed / f64::max(apart, 1.0),
            t_pose_deg: t_pose_deg[0].max(t_pose_deg[1]),
            hanging: Hanging::measure(model, &arms),
            best_max_deg: if arms[0].rolls == [true; 2] { BEST_MAX_DEG } else { WITHOUT_ROLL_MAX_DEG },
        }
    }

    pub(super) fn findings(&self) -> Vec<Finding> {
        let judged = |check, good: bool, found: String, advice: &str| {
            if good { Finding::ok(check, found) } else { Finding::problem(check, found, advice) }
        };
        let (best, bound) = (self.best_deg, format!("at most {} deg", self.best_max_deg));
        let [crossed, crossed_max] = [self.crossed, CROSSED_SHARE_MAX].map(|share| 100.0 * share);
        let hanging = &self.hanging;
        vec![
            judged(
                "limbs",
                best <= self.best_max_deg,
                format!("at best {best:.2} deg from the person's in the built-in motion, {bound}"),
                "compare sides, reference_rad, torso_rpy_rad and ranges with the robot; `robot new` proposes them",
            ),
            judged(
                "sides",
                self.crossed <= CROSSED_SHARE_MAX,
                format!(
                    "the robot's left hand is to the right of its right one while the person's is to the left, for \
                     {crossed:.0} % of the built-in motion, at most {crossed_max} %"
                ),
                "exchange [arms.left] and [arms.right], or turn the torso frame by torso_rpy_rad",
            ),
            judged(
                "T-pose",
                self.t_pose_deg <= self.best_max_deg,
                format!("at best {:.2} deg from a limb of the person's T-pose, {bound}", self.t_pose_deg),
                "bring reference_rad of both arms into their ranges, or widen these; `robot new` proposes it",
            ),
            judged(
                "hanging hands",
                hanging.raised_deg.is_some_and(|raised| raised as f64 <= RAISED_MAX_DEG),
                hanging.sentence(),
                "give base_height_m, the height of base_link above the floor; else move the obstacle, or compare the \
                 capsules with the robot: `collision cover`",
            ),
        ]
    }
}

impl Hanging {
    fn measure(model: &Model, arms: &[ArmModel; 2]) -> Self {
        let mut previous = arms.each_ref().map(|arm| arm.clamp(&arm.reference));
        let mut at = |raised: usize| {
            // The left arm of the T-pose points along y. So it turns about x until it points down.
            let turn =
                UnitQuaternion::from_axis_angle(&Vector3::x_axis(), (raised as f64 - T_POSE_DEG as f64).to_radians());
            previous = [0, 1].map(|side| oracle(&arms[side], &Limbs { upper: turn, fore: turn }, &previous[side]).q);
            nearest(model, &posture(model, &previous))
        };
        let (clearance_m, names) = at(0);
        let clear = |clearance_m: f64| clearance_m >= model.d_min_m;
        let raised_deg = (0..=T_POSE_DEG).find(|raised| clear(at(*raised).0));
        Self { clearance_m, names, needed_m: model.d_min_m, raised_deg }
    }

    fn sentence(&self) -> String {
        let ([a, b], bound) = (&self.names, format!("at most {RAISED_MAX_DEG} deg"));
        let [clearance, needed] = [self.clearance_m, self.needed_m].map(|m| m * 1e3);
        match self.raised_deg {
            Some(0) => format!("{clearance:.0} mm between {a} and {b}, at least {needed:.0} mm"),
            Some(raised) => {
                format!("{clearance:.0} mm between {a} and {b}: clear only if raised by {raised} deg, {bound}")
            }
            None => format!("{clearance:.0} mm between {a} and {b}: not clear anywhere between hanging and T-pose"),
        }
    }
}

fn mean_error_deg(arm: &ArmModel, q: &ArmQ, human: &Limbs) -> f64 {
    arm.limb_error_deg(q, human).iter().sum::<f64>() / 2.0
}

/// Returns the robot at home with these positions of the left arm, and of the left arm that mirrors the right one.
fn posture(model: &Model, arms: &[ArmQ; 2]) -> [f64; JOINTS_MAX] {
    let mut q = model.home;
    for (arm, limbs) in model.arms.iter().zip(arms) {
        arm.set_limbs(&arm.mirrored(limbs), &mut q);
    }
    q
}

/// Returns how far the person's left wrist is to the left of the right one, along the line of the shoulders, m.
fn wrists_apart_m(motion: &Motion, frame: usize) -> f64 {
    let at = |side: usize, joint: usize| {
        Vector3::from(motion.frames[frame].positions[SMPL_ARMS[side][joint] as usize]).map(f64::from)
    };
    let [shoulders, wrists] = [0, 2].map(|joint| at(0, joint) - at(1, joint));
    wrists.dot(&shoulders.normalize())
}

/// Returns how far the robot's left hand is to the left of the right one in the torso frame, m.
fn hands_apart_m(model: &Model, q: &[f64; JOINTS_MAX]) -> f64 {
    let mut frames = Frames::default();
    model.forward(q, &mut frames);
    (model.hand_center(&frames, 0) - model.hand_center(&frames, 1)).dot(&model.base_from_torso(&frames).column(1))
}

/// Returns the least clearance of a posture, m, and the names of what is so near.
fn nearest(model: &Model, q: &[f64; JOINTS_MAX]) -> (f64, [String; 2]) {
    let mut frames = Frames::default();
    model.forward(q, &mut frames);
    let (own_m, pair) = model.clearance(&frames);
    let (outer_m, outer) = model.obstacle_clearance(&frames);
    let pair = match model.pairs.get(pair) {
        Some(pair) if own_m < outer_m => [pair.a, pair.b].map(|capsule| capsule as u32),
        _ => outer,
    };
    (own_m.min(outer_m), pair.map(|shape| model.shape_name(shape).to_owned()))
}

#[cfg(test)]
#[path = "following_tests.rs"]
mod tests;
