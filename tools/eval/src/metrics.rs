//! Definitions of the measured figures.
//!
//! - *S_GR*: the paper's metric, sum over the four limbs of 1 - <q_h, q_r>^2, mean over frames.
//! - *Limb degrees*: rotation angle between a human limb and the robot's, over all limbs and frames.
//! - *Direction degrees*: angle between the bones alone. No calibration of hinges can change it.
//! - *Joint MSE*: mean squared difference to the oracle's joint positions, rad^2, joints 1 to 5 of both arms.
//!   An arm's frame is masked if the oracle's upper arm lies within 5 degrees of the first joint's axis. On
//!   TIAGo++ that is joint 2 within 5 degrees of 90. Joints 1 and 3 then turn the same way, and only their
//!   sum is determined.
//! - *Jerk ratio*: RMS third difference of the joint positions divided by the oracle's over the same windows of
//!   four contiguous frames of one arm. The oracle solves frame by frame, given its previous posture, so it is
//!   as smooth as the optimum itself. Where the optimum is not smooth, it is no yardstick. So windows with a
//!   masked frame, or in which the oracle jumps, count for neither. A jump is a joint that moves more than
//!   [`FLIP_JOINT_RAD`] between frames. Windows in which the method jumps do not count either. Seven of 11,659
//!   would make up 85 % of the sum of squares, and they are flips, which are counted separately. The ratio
//!   including the method's jumps is `jerk_ratio_with_jumps` of the JSON.
//! - *Flips*: frames of an arm in which a joint moves more than [`FLIP_JOINT_RAD`] since the previous frame.
//!   Neither limb of the human turned more than [`FLIP_HUMAN_RAD`] meanwhile. They are counted per 1000 frames
//!   of an arm.
//! - *Reachable*: limb degrees over the frames of an arm that the oracle solves to less than 2 degrees in both limbs.

use crate::clips::Clip;
use crate::methods::Posture;
use nalgebra::{UnitQuaternion, Vector3};
use retarget::{ARM_Q, ArmModel, ArmQ, Limbs, limb_error_deg};

/// 30 degrees. At 60 frames/s this is 31 rad/s, which no arm reaches.
pub const FLIP_JOINT_RAD: f64 = 30.0 * std::f64::consts::PI / 180.0;
/// 5 degrees. At 60 frames/s this is 5.2 rad/s, a fast human arm.
pub const FLIP_HUMAN_RAD: f64 = 5.0 * std::f64::consts::PI / 180.0;
/// Distance from the gimbal below which joints 1 and 3 are not distinguished.
pub const GIMBAL_RAD: f64 = 5.0 * std::f64::consts::PI / 180.0;
/// Error of the oracle below which a pose counts as reachable.
pub const REACHABLE_DEG: f64 = 2.0;

/// A clip with its references. All lists have one entry per frame.
#[derive(Clone, Debug)]
pub struct Task {
    pub clip: Clip,
    pub oracle: Vec<Posture>,
}

#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct MethodFigures {
    pub s_gr: f64,
    pub limb_deg_mean: f64,
    pub limb_deg_p95: f64,
    pub direction_deg: f64,
    /// Joint MSE against the oracle, rad^2. None if every frame is masked.
    pub joint_mse_rad2: Option<f64>,
    /// Joint MSE including the masked frames, rad^2. None if there is no frame.
    pub joint_mse_all_rad2: Option<f64>,
    /// Jerk ratio between jumps. None where it is not defined.
    pub jerk_ratio: Option<f64>,
    pub jerk_ratio_with_jumps: Option<f64>,
    pub flips_per_1000: Option<f64>,
    /// Mean limb error of reachable frames, degrees. None if no frame is reachable.
    pub reachable_deg_mean: Option<f64>,
    pub reachable_deg_p99: Option<f64>,
    pub reachable_share: f64,
    /// Mean error of left upper arm, left forearm, right upper arm, right forearm, degrees.
    pub by_limb_deg: [f64; 4],
}

#[derive(Default)]
struct Tally {
    frames: usize,
    degrees: Vec<f64>,
    reachable: Vec<f64>,
    s_gr: f64,
    direction: f64,
    by_limb: [f64; 4],
    joint: Mean,
    joint_all: Mean,
    /// Sums of squares of method and oracle, rad^2/s^6: between jumps, and including the method's jumps.
    jerk: [[f64; 2]; 2],
    flips: usize,
    transitions: usize,
}

#[derive(Default)]
struct Mean {
    sum: f64,
    count: usize,
}

impl Mean {
    /// Adds the sum of the squares of an arm's joints.
    fn add(&mut self, squares: f64) {
        self.sum += squares;
        self.count += ARM_Q;
    }

    fn value(&self) -> Option<f64> {
        (self.count > 0).then(|| self.sum / self.count as f64)
    }
}

pub fn measure(arms: [&ArmModel; 2], tasks: &[Task], postures: &[Vec<Posture>]) -> MethodFigures {
    let mut tally = Tally::default();
    for (task, postures) in tasks.iter().zip(postures) {
        tally.errors(arms, task, postures);
        tally.motion(arms, task, postures);
    }
    tally.figures()
}

impl Tally {
    fn errors(&mut self, arms: [&ArmModel; 2], task: &Task, postures: &[Posture]) {
        for ((human, posture), oracle) in task.clip.human.iter().zip(postures).zip(&task.oracle) {
            self.frames += 1;
            for (side, arm) in arms.into_iter().enumerate() {
                let (human_seen, q, best) = (human[side], &posture[side], &oracle[side]);
                let robot = arm.forward(q);
                let human = &robot.target(&human_seen, arm.rolls);
                let degrees = limb_error_deg(&robot, human);
                self.s_gr += retarget::s_gr(&robot, human);
                self.direction += direction_deg(&robot, human).iter().sum::<f64>();
                self.degrees.extend(degrees);
                for (sum, error) in self.by_limb[2 * side..].iter_mut().zip(degrees) {
                    *sum += error;
                }
                if arm.limb_error_deg(best, &human_seen).iter().all(|error| *error < REACHABLE_DEG) {
                    self.reachable.extend(degrees);
                }
                let squares: f64 = q.iter().zip(best).map(|(a, b)| (a - b) * (a - b)).sum();
                self.joint_all.add(squares);
                if !near_gimbal(arm, best) {
                    self.joint.add(squares);
                }
            }
        }
    }

    fn motion(&mut self, arms: [&ArmModel; 2], task: &Task, postures: &[Posture]) {
        for (side, arm) in arms.into_iter().enumerate() {
            let postures: Vec<ArmQ> = postures.iter().map(|both| both[side]).collect();
            let oracle: Vec<ArmQ> = task.oracle.iter().map(|both| both[side]).collect();
            for (q, human) in postures.windows(2).zip(task.clip.human.windows(2)) {
                let [before, after] = [&human[0][side], &human[1][side]];
                let still = turn_rad(&before.upper, &after.upper).max(turn_rad(&before.fore, &after.fore));
                self.transitions += 1;
                self.flips += usize::from(jumps(&q[0], &q[1]) && still < FLIP_HUMAN_RAD);
            }
            for (q, best) in postures.windows(4).zip(oracle.windows(4)) {
                let jump = |q: &[ArmQ]| q.windows(2).any(|w| jumps(&w[0], &w[1]));
                if best.iter().any(|q| near_gimbal(arm, q)) || jump(best) {
                    continue;
                }
                let scale = task.clip.rate_hz.powi(6);
                for jerk in &mut self.jerk[usize::from(jump(q))..] {
                    jerk[0] += third_difference_squared(q) * scale;
                    jerk[1] += third_difference_squared(best) * scale;
                }
            }
        }
    }

    fn figures(mut self) -> MethodFigures {
        let frames = self.frames.max(1) as f64;
        self.degrees.sort_by(f64::total_cmp);
        self.reachable.sort_by(f64::total_cmp);
        let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
        let some = !self.reachable.is_empty();
        let [between, all] = self.jerk.map(|[method, oracle]| (oracle > 0.0).then(|| (method / oracle).sqrt()));
        MethodFigures {
            s_gr: self.s_gr / frames,
            limb_deg_mean: self.degrees.iter().sum::<f64>() / (4.0 * frames),
            limb_deg_p95: percentile(&self.degrees, 95),
            direction_deg: self.direction / (4.0 * frames),
            joint_mse_rad2: self.joint.value(),
            joint_mse_all_rad2: self.joint_all.value(),
            jerk_ratio: between,
            jerk_ratio_with_jumps: all,
            flips_per_1000: (self.transitions > 0).then(|| 1e3 * self.flips as f64 / self.transitions as f64),
            reachable_deg_mean: some.then(|| mean(&self.reachable)),
            reachable_deg_p99: some.then(|| percentile(&self.reachable, 99)),
            reachable_share: self.reachable.len() as f64 / (4.0 * frames),
            by_limb_deg: self.by_limb.map(|sum| sum / frames),
        }
    }
}

/// Returns the value below which `percent` of the sorted values lie. 0 if there are no values.
fn percentile(sorted: &[f64], percent: usize) -> f64 {
    sorted.get(sorted.len() * percent / 100).copied().unwrap_or(0.0)
}

/// Returns the angles between the bones of robot and human, degrees: upper arm, forearm.
pub fn direction_deg(robot: &Limbs, human: &Limbs) -> [f64; 2] {
    let y = Vector3::y();
    let angle = |r: &UnitQuaternion<f64>, h: &UnitQuaternion<f64>| {
        let (a, b) = (r * y, h * y);
        a.cross(&b).norm().atan2(a.dot(&b)).to_degrees()
    };
    [angle(&robot.upper, &human.upper), angle(&robot.fore, &human.fore)]
}

/// Returns true if the upper arm lies within [`GIMBAL_RAD`] of the first joint's axis, in either direction.
pub fn near_gimbal(arm: &ArmModel, q: &ArmQ) -> bool {
    let turn = UnitQuaternion::new(arm.axes[1] * (q[1] - arm.reference[1]));
    let upper = turn * arm.axes[2];
    arm.axes[0].cross(&upper).norm() < GIMBAL_RAD.sin()
}

fn jumps(before: &ArmQ, after: &ArmQ) -> bool {
    before.iter().zip(after).any(|(a, b)| (a - b).abs() > FLIP_JOINT_RAD)
}

/// Returns the rotation angle between two rotations, rad. q and -q are the same rotation.
fn turn_rad(a: &UnitQuaternion<f64>, b: &UnitQuaternion<f64>) -> f64 {
    let turn = a.inverse() * b;
    2.0 * turn.imag().norm().atan2(turn.w.abs())
}

fn third_difference_squared(q: &[ArmQ]) -> f64 {
    let [a, b, c, d] = q else { return 0.0 };
    (0..ARM_Q).map(|j| (d[j] - 3.0 * c[j] + 3.0 * b[j] - a[j]).powi(2)).sum()
}
