//! One arm of a draft: its kinematics in the torso's frame, its T-pose, and a home posture.

use super::tree::{moved_links, pose_below};
use crate::arm::ArmShape;
use crate::limbs::{axis_on_side, place_on_side};
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

/// Positions of an arm's joints in their order. Beyond the last one they are zero.
pub(super) type Positions = [f64; ARM_JOINTS];

/// Positions of the limbs' joints, how far the directions of the limbs are off, and how far the positions are outside of their
/// ranges, rad.
#[derive(Clone, Copy, Debug)]
pub(super) struct Posture {
    pub(super) q: Positions,
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
#[derive(Clone, Debug)]
pub(super) struct ArmChain {
    joints: Vec<DraftJoint>,
    shape: ArmShape,
    /// Centre of mass of what the last joint moves, in its frame, m.
    tip: Vector3<f64>,
    /// Directions of the limbs along or against the axes of the joints about which they roll.
    along: [f64; 2],
    /// Position of the elbow at which the arm is straight, and the direction in which it bends.
    straight_rad: f64,
    bends: f64,
}

/// Signs of the right arm: its positions over those of the left arm in the mirrored posture. Zero mirrors zero.
pub(super) fn signs(chains: &[ArmChain; 2]) -> Positions {
    let axes = chains.each_ref().map(|chain| chain.axes(&[0.0; ARM_JOINTS]));
    std::array::from_fn(|i| {
        let [Some(left), Some(right)] = axes.each_ref().map(|axes| axes.get(i)) else { return 1.0 };
        if right.dot(&axis_on_side(1, *left)) < 0.0 { -1.0 } else { 1.0 }
    })
}

impl ArmChain {
    /// The chain of `joints` in the torso frame, which `link_from_torso` turns into the frame of the link `torso`.
    pub(super) fn new(
        tree: &Tree,
        (torso, link_from_torso): (usize, &Matrix3<f64>),
        joints: &[usize],
        shape: ArmShape,
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
        let tip = joints.last().map_or_else(Vector3::zeros, |last| moved_center(tree, *last));
        Self::from_joints((0..shape.joints()).map(joint).collect(), shape, tip)
    }

    /// The mirror image of a right arm, at the same positions: a left arm.
    pub(super) fn as_left(&self) -> Self {
        let flip = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, 1.0));
        let image = |joint: &DraftJoint| {
            let Pose { r, t } = joint.before_from_joint;
            let before_from_joint = Pose { r: flip * r * flip, t: place_on_side(1, t) };
            DraftJoint { before_from_joint, axis: axis_on_side(1, joint.axis), ..*joint }
        };
        Self::from_joints(self.joints.iter().map(image).collect(), self.shape, place_on_side(1, self.tip))
    }

    fn from_joints(joints: Vec<DraftJoint>, shape: ArmShape, tip: Vector3<f64>) -> Self {
        let mut chain = Self { joints, shape, tip, along: [1.0; 2], straight_rad: 0.0, bends: 1.0 };
        let (poses, elbow) = (chain.poses(&[0.0; ARM_JOINTS]), chain.elbow());
        let along = |from: usize, to: usize, axis: usize| {
            let length = (chain.point(&poses, to) - poses[from].t).dot(&(poses[axis].r * chain.joints[axis].axis));
            if length < 0.0 { -1.0 } else { 1.0 }
        };
        let [upper, fore] = chain.rolls();
        let along = [
            if upper { along(1, elbow, elbow - 1) } else { 1.0 },
            if fore { along(elbow, elbow + 2, elbow + 1) } else { 1.0 },
        ];
        chain.along = along;
        // The forearm's direction over the elbow's position q is A cos q + B sin q along the upper arm.
        let direction = |q: f64| {
            let mut bent = [0.0; ARM_JOINTS];
            bent[elbow] = q;
            let [upper, fore] = chain.limbs(&bent);
            upper.dot(&fore)
        };
        let middle = (direction(0.0) + direction(2.0 * FRAC_PI_2)) / 2.0;
        chain.straight_rad = chain.turned(elbow, (direction(FRAC_PI_2) - middle).atan2(direction(0.0) - middle));
        chain
    }

    /// The joint of the elbow.
    fn elbow(&self) -> usize {
        self.shape.upper
    }

    /// Number of joints that turn the limbs.
    fn limb_joints(&self) -> usize {
        self.shape.upper + self.shape.fore
    }

    /// True for a limb, upper arm and forearm, that a joint turns about its own length.
    fn rolls(&self) -> [bool; 2] {
        [self.shape.upper == ArmShape::MOST.upper, self.shape.fore == ArmShape::MOST.fore]
    }

    /// Where the hand grasps, in the frame of the last link, m: the tip of a forearm whose hand no joint turns, or else zero.
    pub(super) fn grasp(&self) -> [f64; 3] {
        if self.shape.hand == 0 { self.tip.map(|x| (x * 1e3).round() / 1e3 + 0.0).into() } else { [0.0; 3] }
    }

    /// The origin of joint `i`, or the tip beyond the last one.
    fn point(&self, poses: &[Pose], i: usize) -> Vector3<f64> {
        poses.get(i).map_or_else(|| poses[poses.len() - 1].transform_point(&self.tip), |pose| pose.t)
    }

    /// Narrows the ranges to those of the arm on the other side, so that each posture has a mirror image.
    pub(super) fn narrow(&mut self, other: &Self, signs: &Positions) {
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
            let q = self.in_order(|i| {
                let share = (f64::from(sample + 1) / GOLDEN.powi(i as i32 + 1)).fract();
                let [low, high] = self.joints[i].range.map(|end| end.clamp(-2.0 * FRAC_PI_2, 2.0 * FRAC_PI_2));
                low + share * (high - low)
            });
            sum + self.poses(&q)[self.joints.len() - 1].t
        });
        sum / f64::from(SAMPLES)
    }

    /// True if the joints turn the limbs as the shape says: those about which a limb rolls lie along it, the elbow lies across
    /// both limbs, and two neighbouring joints of a limb are not parallel.
    pub(super) fn fits(&self) -> bool {
        let zero = [0.0; ARM_JOINTS];
        let (poses, axes, elbow) = (self.poses(&zero), self.axes(&zero), self.elbow());
        let lies_along = |from: usize, to: usize, axis: usize| {
            let limb = self.point(&poses, to) - poses[from].t;
            limb.dot(&axes[axis]).abs() > 0.5 * limb.norm()
        };
        let [upper, fore] = self.rolls();
        let rolls = (!upper || lies_along(1, elbow, elbow - 1)) && (!fore || lies_along(elbow, elbow + 2, elbow + 1));
        // A limb that does not roll must not lie along the joint that swings it.
        let swings = upper || !lies_along(1, elbow, 1);
        let limbs = self.limbs(&zero);
        let across = limbs.iter().all(|limb| limb.dot(&axes[elbow]).abs() < 0.5);
        // 0.95, as a model asks.
        let apart = |a: usize, b: usize| axes[a].dot(&axes[b]).abs() < 0.95;
        rolls && swings && across && apart(0, 1) && (!upper || apart(1, 2)) && (!fore || apart(elbow, elbow + 1))
    }

    /// Positions of the joints that there are.
    fn in_order(&self, position: impl Fn(usize) -> f64) -> Positions {
        std::array::from_fn(|i| if i < self.joints.len() { position(i) } else { 0.0 })
    }

    /// Frames of the joints after their own motion, in the torso's frame.
    fn poses(&self, q: &Positions) -> Vec<Pose> {
        let mut pose = Pose::identity();
        let moved = self.joints.iter().zip(q).map(|(joint, q)| {
            let turned = Pose { r: rotation(&joint.axis, *q), ..Pose::identity() };
            pose = pose.compose(&joint.before_from_joint).compose(&turned);
            pose
        });
        moved.collect()
    }

    fn axes(&self, q: &Positions) -> Vec<Vector3<f64>> {
        self.poses(q).iter().zip(&self.joints).map(|(pose, joint)| pose.r * joint.axis).collect()
    }

    /// Directions of the upper arm and of the forearm: along the axis about which the limb rolls, or else from its first joint
    /// to the next one, across the axis of that joint.
    fn limbs(&self, q: &Positions) -> [Vector3<f64>; 2] {
        let (poses, elbow) = (self.poses(q), self.elbow());
        let axis = |i: usize| poses[i].r * self.joints[i].axis;
        let across = |from: usize| {
            let limb = self.point(&poses, from + 1) - poses[from].t;
            (limb - axis(from) * limb.dot(&axis(from))).normalize()
        };
        let [upper, fore] = self.rolls();
        [
            if upper { axis(elbow - 1) * self.along[0] } else { across(elbow - 1) },
            if fore { axis(elbow + 1) * self.along[1] } else { across(elbow) },
        ]
    }

    /// Solves the T-pose of a left arm: straight out to its side, bending to the front if the upper arm can roll. Positions inside
    /// the ranges come first, and of several those nearest to zero. They decide how the elbow bends, where it bends both ways.
    pub(super) fn reference(&mut self) -> Posture {
        let (elbow, limb_joints, [rolls, _]) = (self.elbow(), self.limb_joints(), self.rolls());
        let [low, high] = self.joints[elbow].range;
        let rooms = high - self.straight_rad - (self.straight_rad - low);
        let mut best = (Posture { q: [0.0; ARM_JOINTS], off: f64::INFINITY, outside: 0.0 }, 1.0, [f64::INFINITY; 3]);
        for bends in [1.0, -1.0].into_iter().filter(|bends| rooms * bends >= 0.0 || rooms.abs() < SAME_ROOM_RAD) {
            let errors = |q: &Positions| {
                let hinge = self.axes(q)[elbow] * bends;
                let upper = self.limbs(q)[0];
                let a = upper - Vector3::y();
                let b = if rolls { hinge.cross(&upper) - Vector3::x() } else { Vector3::zeros() };
                [a.x, a.y, a.z, b.x, b.y, b.z]
            };
            let inside = |i: usize, q: f64| q.clamp(self.joints[i].range[0], self.joints[i].range[1]);
            for start in starts() {
                let mut from = [start[0], start[1], start[2], 0.0, 0.0, 0.0, 0.0, 0.0];
                from[elbow] = self.straight_rad;
                (elbow + 1..limb_joints).for_each(|i| from[i] = inside(i, 0.0));
                for (q, off) in [search(from, elbow, |_, q| q, errors), search(from, elbow, inside, errors)] {
                    let turned = |i: usize| if i < limb_joints { rounded(self.turned(i, rounded(q[i]))) } else { 0.0 };
                    let q: Positions = std::array::from_fn(turned);
                    let outside = (0..limb_joints).map(|i| self.outside(i, q[i])).sum::<f64>();
                    let wide = q[..elbow].iter().map(|q| q.abs()).sum::<f64>();
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
    pub(super) fn home(&self) -> Positions {
        let (elbow, limb_joints) = (self.elbow(), self.limb_joints());
        let wanted = HOME.map(|direction| Vector3::from(direction).normalize());
        let errors = |q: &Positions| {
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
        let mut best = ([0.0; ARM_JOINTS], [f64::INFINITY; 2]);
        for start in starts() {
            let mut from = self.in_order(|i| if i < elbow { start[i] } else { rest(i) });
            from[elbow] = self.straight_rad + self.bends * 1.2;
            let (q, off) = search(from, elbow + 1, inside, errors);
            // Of postures that are as good to a tenth of a degree, the one nearest to zero.
            let rank = [(off * 1e5).round(), (q[..elbow].iter().map(|q| q.abs()).sum::<f64>() * 1e6).round()];
            if rank < best.1 {
                best = (q, rank);
            }
        }
        let mut q = best.0;
        if self.shape.hand == ArmShape::MOST.hand {
            let [first, second] = self.straight_hand(&q, inside);
            (q[limb_joints], q[limb_joints + 1]) = (first, second);
        }
        q.map(|q| (q * 1e3).round() / 1e3)
    }

    /// Positions of the first two of three joints of a hand, at which the last one turns it about the forearm's length. Elsewhere
    /// the first and the last axis may be parallel, and the hand could not turn every way. Of several, those nearest to zero.
    fn straight_hand(&self, q: &Positions, inside: impl Fn(usize, f64) -> f64) -> [f64; 2] {
        let first = self.limb_joints();
        let fore = self.limbs(q)[1];
        let mut best = ([q[first], q[first + 1]], [f64::INFINITY; 2]);
        for (a, b) in (-18..=18).flat_map(|a| (-18..=18).map(move |b| (a, b))) {
            let at = [(0, a), (1, b)].map(|(i, step)| inside(first + i, f64::from(step) * FRAC_PI_2 / 9.0));
            let mut bent = *q;
            (bent[first], bent[first + 1]) = (at[0], at[1]);
            let along = self.axes(&bent)[first + 2].dot(&fore).abs();
            // Of postures that are as straight to four degrees, the one nearest to zero.
            let rank = [((1.0 - along) * 400.0).floor(), at[0].abs() + at[1].abs()];
            if rank < best.1 {
                best = (at, rank);
            }
        }
        best.0
    }
}

/// Centre of mass of all that a joint moves, in the frame of its link, m.
fn moved_center(tree: &Tree, joint: usize) -> Vector3<f64> {
    let poses = super::tree::link_poses(tree, |_| 0.0);
    let own = poses[tree.joints[joint].child];
    let links = moved_links(tree, joint).into_iter().map(|link| tree.inertias[link].seen_from(&poses[link]));
    let whole = links.fold(crate::inertia::Inertia::default(), |sum, link| sum.combined(&link));
    own.r.transpose() * (whole.center - own.t)
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
    from: Positions,
    free: usize,
    inside: impl Fn(usize, f64) -> f64,
    errors: impl Fn(&Positions) -> [f64; 6],
) -> (Positions, f64) {
    let square = |e: &[f64; 6]| e.iter().map(|x| x * x).sum::<f64>();
    let mut q = from;
    (0..free).for_each(|i| q[i] = inside(i, q[i]));
    let (mut damping, mut off) = (1e-3, square(&errors(&q)));
    for _ in 0..STEPS {
        let e = SVector::<f64, 6>::from(errors(&q));
        let mut j = SMatrix::<f64, 6, ARM_JOINTS>::zeros();
        for i in 0..free {
            let mut moved = q;
            moved[i] += 1e-7;
            j.set_column(i, &((SVector::<f64, 6>::from(errors(&moved)) - e) / 1e-7));
        }
        let h = j.transpose() * j + SMatrix::<f64, ARM_JOINTS, ARM_JOINTS>::identity() * (damping + PULL);
        let pull = SVector::<f64, ARM_JOINTS>::from(q) * PULL;
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
