//! One arm of a draft: its kinematics in the torso's frame, its T-pose, and a home posture.

use super::tree::pose_below;
use crate::pose::{Pose, rotation};
use crate::urdf::Tree;
use messages::ARM_JOINTS;
use nalgebra::{Matrix3, SMatrix, SVector, Vector3};
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
/// Two rooms of an elbow, rad, that differ by less are the same: it bends both ways.
const SAME_ROOM_RAD: f64 = 0.1;
/// Postures from which it is seen where a hand can be.
const SAMPLES: u32 = 200;

/// Positions of joints 1 to 5, how far the directions of the limbs are off, and how far the positions are outside of their
/// ranges, rad.
#[derive(Clone, Copy, Debug)]
pub(super) struct Posture {
    pub(super) q: [f64; 5],
    pub(super) off: f64,
    pub(super) outside: f64,
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

/// Signs of the right arm: its positions over those of the left arm in the mirrored posture. Zero mirrors zero.
pub(super) fn signs(chains: &[ArmChain; 2]) -> [f64; ARM_JOINTS] {
    let axes = chains.each_ref().map(|chain| chain.axes(&[0.0; 5]));
    std::array::from_fn(|i| {
        let image = Vector3::new(-axes[0][i].x, axes[0][i].y, -axes[0][i].z);
        if axes[1][i].dot(&image) < 0.0 { -1.0 } else { 1.0 }
    })
}

impl ArmChain {
    /// The chain of `joints` in the torso frame, which `link_from_torso` turns into the frame of the link `torso`.
    pub(super) fn new(
        tree: &Tree,
        (torso, link_from_torso): (usize, &Matrix3<f64>),
        joints: &[usize; ARM_JOINTS],
    ) -> Self {
        let torso_from_link = Pose { r: link_from_torso.transpose(), ..Pose::identity() };
        let joint = |i: usize| {
            let above = if i == 0 { torso } else { tree.joints[joints[i - 1]].child };
            let joint = &tree.joints[joints[i]];
            let pose = pose_below(tree, above, joints[i]);
            DraftJoint {
                before_from_joint: if i == 0 { torso_from_link.compose(&pose) } else { pose },
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
        chain.straight_rad = chain.turned(3, (direction(FRAC_PI_2) - middle).atan2(direction(0.0) - middle));
        chain
    }

    /// Narrows the ranges to those of the arm on the other side, so that each posture has a mirror image.
    pub(super) fn narrow(&mut self, other: &Self, signs: &[f64; ARM_JOINTS]) {
        for ((own, other), sign) in self.joints.iter_mut().zip(&other.joints).zip(signs) {
            let [low, high] = if *sign < 0.0 { [-other.range[1], -other.range[0]] } else { other.range };
            let both = [own.range[0].max(low), own.range[1].min(high)];
            if both[0] < both[1] {
                own.range = both;
            }
        }
    }

    /// The position, or one that differs by a turn, if that is in the range of joint `i`.
    fn turned(&self, i: usize, q: f64) -> f64 {
        let [low, high] = self.joints[i].range;
        [q, q - 4.0 * FRAC_PI_2, q + 4.0 * FRAC_PI_2].into_iter().find(|q| (low..=high).contains(q)).unwrap_or(q)
    }

    /// How far a position is outside of the range of joint `i`, rad.
    fn outside(&self, i: usize, q: f64) -> f64 {
        let [low, high] = self.joints[i].range;
        (low - q).max(q - high).max(0.0)
    }

    /// The middle of where the hand can be, torso frame, m. The hand is the last joint's origin.
    pub(super) fn reach(&self) -> Vector3<f64> {
        // Additive recurrence by the golden ratio of seven dimensions (the root of x^8 = x + 1): evenly spread.
        const GOLDEN: f64 = 1.096_981_557_798_559_8;
        let sum = (0..SAMPLES).fold(Vector3::zeros(), |sum, sample| {
            let q = std::array::from_fn(|i| {
                let share = (f64::from(sample + 1) / GOLDEN.powi(i as i32 + 1)).fract();
                let [low, high] = self.joints[i].range.map(|end| end.clamp(-2.0 * FRAC_PI_2, 2.0 * FRAC_PI_2));
                low + share * (high - low)
            });
            sum + self.poses(&q)[ARM_JOINTS - 1].t
        });
        sum / f64::from(SAMPLES)
    }

    /// True if three orthogonal axes turn the upper arm, and two the forearm, and both limbs lie along their last axes.
    pub(super) fn is_three_and_two(&self) -> bool {
        let axes = self.axes(&[0.0; 5]);
        // 1e-3, as a model asks.
        let orthogonal = [(0, 1), (1, 2), (3, 4)].into_iter().all(|(a, b)| axes[a].dot(&axes[b]).abs() < 1e-3);
        let poses = self.poses(&[0.0; ARM_JOINTS]);
        let limbs = [(1, 3, 2), (3, 5, 4)].map(|(from, to, axis)| {
            let limb = poses[to].t - poses[from].t;
            limb.dot(&axes[axis]).abs() > 0.5 * limb.norm()
        });
        orthogonal && limbs == [true; 2]
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

    /// Solves the T-pose of a left arm: straight out to its side, bending to the front. Positions inside the ranges come
    /// first, and of several those nearest to zero. They decide how the elbow bends, where it bends both ways.
    pub(super) fn reference(&mut self) -> Posture {
        let fifth = 0.0_f64.clamp(self.joints[4].range[0], self.joints[4].range[1]);
        let [low, high] = self.joints[3].range;
        let rooms = high - self.straight_rad - (self.straight_rad - low);
        let mut best = (Posture { q: [0.0; 5], off: f64::INFINITY, outside: 0.0 }, 1.0, [f64::INFINITY; 3]);
        for bends in [1.0, -1.0].into_iter().filter(|bends| rooms * bends >= 0.0 || rooms.abs() < SAME_ROOM_RAD) {
            let errors = |q: &[f64; 5]| {
                let hinge = self.axes(q)[3] * bends;
                let upper = self.limbs(q)[0];
                let (a, b) = (upper - Vector3::y(), hinge.cross(&upper) - Vector3::x());
                [a.x, a.y, a.z, b.x, b.y, b.z]
            };
            let inside = |i: usize, q: f64| q.clamp(self.joints[i].range[0], self.joints[i].range[1]);
            for start in starts() {
                let from = [start[0], start[1], start[2], self.straight_rad, fifth];
                for (q, off) in [search(from, 3, |_, q| q, errors), search(from, 3, inside, errors)] {
                    let q: [f64; 5] = std::array::from_fn(|i| rounded(self.turned(i, rounded(q[i]))));
                    let outside = (0..5).map(|i| self.outside(i, q[i])).sum::<f64>();
                    let wide = q[..3].iter().map(|q| q.abs()).sum::<f64>();
                    let rank = [if off < REACHED { 0.0 } else { off }, (outside * 1e6).round(), (wide * 1e6).round()];
                    if rank < best.2 {
                        best = (Posture { q, off, outside }, bends, rank);
                    }
                }
            }
        }
        self.bends = best.1;
        best.0
    }

    /// Solves a posture of a left arm with bent elbow and the hand in front, inside the limits.
    pub(super) fn home(&self) -> [f64; ARM_JOINTS] {
        let wanted = HOME.map(|direction| Vector3::from(direction).normalize());
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
        let mut best = ([0.0; 5], [f64::INFINITY; 2]);
        for start in starts() {
            let from = [start[0], start[1], start[2], self.straight_rad + self.bends * 1.2, rest(4)];
            let (q, off) = search(from, 4, inside, errors);
            // Of postures that are as good to a tenth of a degree, the one nearest to zero.
            let rank = [(off * 1e5).round(), (q[..3].iter().map(|q| q.abs()).sum::<f64>() * 1e6).round()];
            if rank < best.1 {
                best = (q, rank);
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
