//! One arm of a draft: its kinematics in the torso's frame, its T-pose, and a home posture.

use super::tree::pose_below;
use crate::pose::{Pose, rotation};
use crate::urdf::Tree;
use messages::ARM_JOINTS;
use nalgebra::{SMatrix, SVector, Vector3};
use std::f64::consts::FRAC_PI_2;

/// A posture is found if the sum of its squared direction errors is below this.
pub(super) const REACHED: f64 = 1e-9;
/// Angles from which a posture is searched, rad.
const STARTS_RAD: [f64; 5] = [0.0, 1.2, -1.2, 2.4, -2.4];
/// Steps of a search.
const STEPS: usize = 60;
/// Pull towards zero, so that a joint that does not matter stays there.
const PULL: f64 = 1e-9;
/// Distance of the home posture from the limits, rad.
const ROOM_RAD: f64 = 0.1;
/// Directions of upper arm and forearm at home, torso frame, left arm: hanging a little out, and level to the front.
const HOME: [[f64; 3]; 2] = [[0.17, 0.34, -0.92], [0.99, 0.0, 0.1]];
/// Largest difference between two mirrored positions, rad.
const MIRRORED_RAD: f64 = 1e-5;

/// Positions of joints 1 to 5, and how far the directions of the limbs are off.
#[derive(Clone, Copy, Debug)]
pub(super) struct Posture {
    pub(super) q: [f64; 5],
    pub(super) off: f64,
}

impl Posture {
    /// Takes the left arm's numbers where they mirror this posture's, so that both are equal to the last digit.
    pub(super) fn mirrored_onto(&self, left: &Self) -> Self {
        let same = |(own, left): (f64, f64)| {
            [left, -left].into_iter().find(|other| (other - own).abs() < MIRRORED_RAD).unwrap_or(own)
        };
        Self { q: std::array::from_fn(|i| same((self.q[i], left.q[i]))), ..*self }
    }
}

/// One joint: its frame in the frame of the joint before it, its axis, and its range.
#[derive(Clone, Copy, Debug)]
struct DraftJoint {
    before_from_joint: Pose,
    axis: Vector3<f64>,
    range: [f64; 2],
}

/// The joints of an arm. The first one's frame is in the torso's frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct ArmChain {
    joints: [DraftJoint; ARM_JOINTS],
    /// Directions of the limbs along or against the axes of joints 3 and 5.
    along: [f64; 2],
    /// Position of joint 4 at which the arm is straight, and the direction in which it bends.
    straight_rad: f64,
    bends: f64,
}

/// Signs of the right arm: its positions over those of the left arm in the mirrored posture.
pub(super) fn signs(left: &Posture, right: &Posture, chains: &[ArmChain; 2]) -> [f64; ARM_JOINTS] {
    let axes = [chains[0].axes(&left.q), chains[1].axes(&right.q)];
    std::array::from_fn(|i| {
        let image = Vector3::new(-axes[0][i].x, axes[0][i].y, -axes[0][i].z);
        if axes[1][i].dot(&image) < 0.0 { -1.0 } else { 1.0 }
    })
}

impl ArmChain {
    pub(super) fn new(tree: &Tree, torso: usize, joints: &[usize; ARM_JOINTS]) -> Self {
        let joint = |i: usize| {
            let above = if i == 0 { torso } else { tree.joints[joints[i - 1]].child };
            let joint = &tree.joints[joints[i]];
            DraftJoint {
                before_from_joint: pose_below(tree, above, joints[i]),
                axis: joint.axis,
                range: [joint.limit.lower, joint.limit.upper],
            }
        };
        let mut chain = Self { joints: std::array::from_fn(joint), along: [1.0; 2], straight_rad: 0.0, bends: 1.0 };
        let poses = chain.poses(&[0.0; ARM_JOINTS]);
        let axis = |i: usize| poses[i].r * chain.joints[i].axis;
        let along = [(1, 3, 2), (3, 5, 4)].map(|(from, to, of)| (poses[to].t - poses[from].t).dot(&axis(of)));
        chain.along = along.map(|length| if length < 0.0 { -1.0 } else { 1.0 });
        // The forearm's direction over q4 is A cos q4 + B sin q4 along the upper arm.
        let direction = |q4: f64| {
            let [upper, fore] = chain.limbs(&[0.0, 0.0, 0.0, q4, 0.0]);
            upper.dot(&fore)
        };
        let middle = (direction(0.0) + direction(2.0 * FRAC_PI_2)) / 2.0;
        chain.straight_rad = (direction(FRAC_PI_2) - middle).atan2(direction(0.0) - middle);
        let [low, high] = chain.joints[3].range;
        chain.bends = if high - chain.straight_rad >= chain.straight_rad - low { 1.0 } else { -1.0 };
        chain
    }

    /// Frames of the joints after their own motion, in the torso's frame.
    fn poses(&self, q: &[f64; ARM_JOINTS]) -> [Pose; ARM_JOINTS] {
        let mut pose = Pose::identity();
        std::array::from_fn(|i| {
            let joint = &self.joints[i];
            let turned = Pose { r: rotation(&joint.axis, q[i]), ..Pose::identity() };
            pose = pose.compose(&joint.before_from_joint).compose(&turned);
            pose
        })
    }

    fn axes(&self, q: &[f64; 5]) -> [Vector3<f64>; ARM_JOINTS] {
        let poses = self.poses(&std::array::from_fn(|i| q.get(i).copied().unwrap_or(0.0)));
        std::array::from_fn(|i| poses[i].r * self.joints[i].axis)
    }

    /// Directions of the upper arm and of the forearm.
    fn limbs(&self, q: &[f64; 5]) -> [Vector3<f64>; 2] {
        let axes = self.axes(q);
        [axes[2] * self.along[0], axes[4] * self.along[1]]
    }

    /// Solves the T-pose: the arm straight out to its side, bending to the front.
    pub(super) fn reference(&self, side: usize) -> Posture {
        let out = Vector3::y() * if side == 0 { 1.0 } else { -1.0 };
        let errors = |q: &[f64; 5]| {
            let hinge = self.axes(q)[3] * self.bends;
            let upper = self.limbs(q)[0];
            let (a, b) = (upper - out, hinge.cross(&upper) - Vector3::x());
            [a.x, a.y, a.z, b.x, b.y, b.z]
        };
        let fifth = 0.0_f64.clamp(self.joints[4].range[0], self.joints[4].range[1]);
        let mut best = Posture { q: [0.0, 0.0, 0.0, self.straight_rad, fifth], off: f64::INFINITY };
        let mut size = f64::INFINITY;
        for start in starts() {
            let from = [start[0], start[1], start[2], self.straight_rad, fifth];
            let (q, off) = search(from, 3, |_, q| q, errors);
            let wide = q[..3].iter().map(|q| q.abs()).sum::<f64>();
            // Of several solutions the one nearest to zero is taken.
            if off < best.off - REACHED || (off < best.off + REACHED && wide < size - 1e-6) {
                (best, size) = (Posture { q, off }, wide);
            }
        }
        best.q = best.q.map(rounded);
        best
    }

    /// Solves a posture with bent elbows and hands in front, inside the limits.
    pub(super) fn home(&self, side: usize) -> [f64; ARM_JOINTS] {
        let wanted = HOME.map(|[x, y, z]| Vector3::new(x, if side == 0 { y } else { -y }, z).normalize());
        let errors = |q: &[f64; 5]| {
            let [upper, fore] = self.limbs(q);
            let (a, b) = (upper - wanted[0], fore - wanted[1]);
            [a.x, a.y, a.z, b.x, b.y, b.z]
        };
        let inside = |i: usize, q: f64| {
            let [low, high] = self.joints[i].range;
            let room = ROOM_RAD.min((high - low) / 4.0);
            q.clamp(low + room, high - room)
        };
        let rest = |i: usize| {
            let [low, high] = self.joints[i].range;
            if low + ROOM_RAD <= 0.0 && 0.0 <= high - ROOM_RAD { 0.0 } else { (low + high) / 2.0 }
        };
        let mut best = ([0.0; 5], f64::INFINITY);
        for start in starts() {
            let from = [start[0], start[1], start[2], self.straight_rad + self.bends * 1.2, rest(4)];
            let (q, off) = search(from, 4, inside, errors);
            if off < best.1 - 1e-6 {
                best = (q, off);
            }
        }
        let q = [best.0[0], best.0[1], best.0[2], best.0[3], rest(4), rest(5), rest(6)];
        q.map(|q| (q * 1e3).round() / 1e3)
    }
}

fn starts() -> impl Iterator<Item = [f64; 3]> {
    let all = STARTS_RAD.into_iter();
    all.flat_map(|a| STARTS_RAD.into_iter().flat_map(move |b| STARTS_RAD.into_iter().map(move |c| [a, b, c])))
}

/// The nearest quarter turn if the search stopped beside it, or seven digits. Never a negative zero.
fn rounded(q: f64) -> f64 {
    let quarter = (q / FRAC_PI_2).round() * FRAC_PI_2;
    if (q - quarter).abs() < 1e-6 { quarter + 0.0 } else { (q * 1e7).round() / 1e7 }
}

/// Least squares by Levenberg-Marquardt over the first `free` positions, each kept by `inside`. Returns the positions
/// and the sum of the squared errors.
fn search(
    from: [f64; 5],
    free: usize,
    inside: impl Fn(usize, f64) -> f64,
    errors: impl Fn(&[f64; 5]) -> [f64; 6],
) -> ([f64; 5], f64) {
    let square = |e: &[f64; 6]| e.iter().map(|x| x * x).sum::<f64>();
    let mut q = from;
    (0..free).for_each(|i| q[i] = inside(i, q[i]));
    let (mut damping, mut off) = (1e-3, square(&errors(&q)));
    for _ in 0..STEPS {
        let e = SVector::<f64, 6>::from(errors(&q));
        let mut j = SMatrix::<f64, 6, 5>::zeros();
        for i in 0..free {
            let mut moved = q;
            moved[i] += 1e-7;
            j.set_column(i, &((SVector::<f64, 6>::from(errors(&moved)) - e) / 1e-7));
        }
        let h = j.transpose() * j + SMatrix::<f64, 5, 5>::identity() * (damping + PULL);
        let pull = SVector::<f64, 5>::from(q) * PULL;
        let Some(step) = h.cholesky().map(|h| h.solve(&(j.transpose() * e + pull))) else { break };
        let mut next = q;
        (0..free).for_each(|i| next[i] = inside(i, q[i] - step[i]));
        let then = square(&errors(&next));
        if then < off {
            (q, off, damping) = (next, then, damping * 0.3);
        } else {
            damping = (damping * 10.0).min(1e6);
        }
    }
    (q, off)
}
