//! The kinematic tree for the certificate: forward kinematics of any subset of bodies, and bounds on the reach.
//!
//! Body 0 is the base. Body 1 + j moves with joint j. A joint's parent always has a smaller index.

use crate::config::WbcError;
use messages::JOINTS_MAX;
use nalgebra::{Matrix3, Vector3};

/// Number of bodies.
pub const BODIES: usize = JOINTS_MAX + 1;

/// Set of joints. Bit j is joint j.
pub type JointSet = u32;

/// Iterates over the joints of a set, ascending.
pub(crate) fn joints(set: JointSet) -> impl Iterator<Item = usize> {
    let mut left = set;
    std::iter::from_fn(move || {
        let j = (left != 0).then(|| left.trailing_zeros() as usize)?;
        left &= left - 1;
        Some(j)
    })
}

/// A rigid pose: x in the reference frame is `r` x + `t`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// Rotation.
    pub r: Matrix3<f64>,
    /// Translation, m.
    pub t: Vector3<f64>,
}

impl Placement {
    /// The identity.
    pub fn identity() -> Self {
        Self { r: Matrix3::identity(), t: Vector3::zeros() }
    }

    /// Returns the point `p` of the moving frame in the reference frame.
    #[inline]
    pub fn point(&self, p: &Vector3<f64>) -> Vector3<f64> {
        self.r * p + self.t
    }

    /// Returns `self` composed with `inner`: a_from_c = a_from_b.then(b_from_c).
    pub fn then(&self, inner: &Self) -> Self {
        Self { r: self.r * inner.r, t: self.r * inner.t + self.t }
    }

    /// The inverse pose.
    pub fn inverse(&self) -> Self {
        let r = self.r.transpose();
        Self { r, t: -(r * self.t) }
    }
}

/// One joint of the tree.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KinematicLink {
    /// Body relative to which the joint moves.
    pub parent: usize,
    /// Pose of the joint's own body in its parent's frame at position zero. Its origin lies on the axis.
    pub parent_from_body: Placement,
    /// Unit axis in the joint's own frame.
    pub axis: Vector3<f64>,
    /// True if the joint slides along the axis, false if it turns about it.
    pub prismatic: bool,
    /// Largest magnitude of its position, m. It bounds the reach of a prismatic joint.
    pub stroke: f64,
}

/// Joint j's rotation is m0 + sin(q) m1 + (1 - cos(q)) m2. This combines the fixed offset and Rodrigues' formula.
#[derive(Clone, Copy, Debug)]
struct Turn {
    m0: Matrix3<f64>,
    m1: Matrix3<f64>,
    m2: Matrix3<f64>,
}

/// A joint in one posture: rotation and origin of its body in its parent's frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Turned {
    pub(crate) r: Matrix3<f64>,
    pub(crate) t: Vector3<f64>,
}

/// All joints in one posture. Kinematics and dynamics share them.
pub(crate) type TurnedJoints = [Turned; JOINTS_MAX];

/// Joints that are not turned yet.
pub(crate) const UNTURNED: TurnedJoints =
    [Turned { r: Matrix3::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), t: Vector3::new(0.0, 0.0, 0.0) };
        JOINTS_MAX];

/// Computes the joints of `set` at `q`. The other entries stay as they are.
pub(crate) fn turn_joints(chain: &KinematicChain, q: impl Fn(usize) -> f64, set: JointSet, turned: &mut TurnedJoints) {
    for j in joints(set) {
        turned[j] = chain.joint(j, q(j));
    }
}

/// Number of joints of each arm, and of those up to its elbow.
#[derive(Clone, Copy, Debug)]
pub struct ArmCounts {
    /// All joints of an arm.
    pub joints: usize,
    /// Joints up to the elbow, which is one of them.
    pub to_elbow: usize,
}

/// The tree, with precomputed values for its forward kinematics.
#[derive(Clone, Debug)]
pub struct KinematicChain {
    /// Number of joints. The arrays are longer: the entries beyond it are not used.
    count: usize,
    arm: ArmCounts,
    links: [KinematicLink; JOINTS_MAX],
    turns: [Turn; JOINTS_MAX],
    /// Joints between the base and each body.
    ancestors: [JointSet; BODIES],
}

/// Poses of all bodies in the base frame.
pub type Placements = [Placement; BODIES];

impl KinematicChain {
    /// Creates the tree of these joints: body, left arm, right arm. Each parent must be a body of smaller index than
    /// the joint's own.
    pub fn new(given: &[KinematicLink], arm: ArmCounts) -> Result<Self, WbcError> {
        let count = given.len();
        let arms_fit = arm.to_elbow <= arm.joints && 2 * arm.joints <= count;
        if !(arms_fit && count <= JOINTS_MAX) {
            return Err(WbcError::Kinematics {
                joint: count,
                what: "is not there: two arms need all of their joints, and a robot has at most 24",
            });
        }
        let none = KinematicLink {
            parent: 0,
            parent_from_body: Placement::identity(),
            axis: Vector3::z(),
            prismatic: false,
            stroke: 0.0,
        };
        let links: [KinematicLink; JOINTS_MAX] = std::array::from_fn(|j| given.get(j).copied().unwrap_or(none));
        let turns = links.map(|link| {
            let r = link.parent_from_body.r;
            let k = link.axis.cross_matrix();
            Turn { m0: r, m1: r * k, m2: r * k * k }
        });
        let mut ancestors = [0; BODIES];
        for (j, link) in links.iter().enumerate() {
            if link.parent > j {
                return Err(WbcError::Kinematics {
                    joint: j,
                    what: "is attached to a body that comes later in the joint order",
                });
            }
            ancestors[j + 1] = ancestors[link.parent] | 1 << j;
        }
        Ok(Self { count, arm, links, turns, ancestors })
    }

    /// The joints.
    pub fn links(&self) -> &[KinematicLink] {
        &self.links[..self.count]
    }

    /// Number of joints.
    #[inline]
    pub fn count(&self) -> usize {
        self.count
    }

    /// All joints.
    #[inline]
    pub fn all(&self) -> JointSet {
        (1 << self.count) - 1
    }

    /// The joints of the left and the right arm.
    #[inline]
    pub fn arms(&self) -> [JointSet; 2] {
        let arm = (1 << self.arm.joints) - 1;
        [arm << (self.count - 2 * self.arm.joints), arm << (self.count - self.arm.joints)]
    }

    /// The bodies of the left and the right hand. The last joint of each arm moves them.
    pub fn hands(&self) -> [usize; 2] {
        [self.count - self.arm.joints, self.count]
    }

    /// Returns true if the joint is an arm's behind its elbow.
    pub(crate) fn is_behind_elbow(&self, j: usize) -> bool {
        let behind = self.arm.joints - self.arm.to_elbow;
        self.hands().iter().any(|hand| (hand - behind..*hand).contains(&j))
    }

    /// Joints between the base and `body`.
    #[inline]
    pub fn ancestors(&self, body: usize) -> JointSet {
        self.ancestors[body]
    }

    /// Computes the poses in the base frame of the bodies that the joints of `set` move. `set` must contain
    /// the ancestors of each of its joints. Other entries of `out` stay as they are.
    pub fn forward(&self, q: &[f64; JOINTS_MAX], set: JointSet, out: &mut Placements) {
        for j in joints(set) {
            let parent = out[self.links[j].parent];
            let Turned { r, t } = self.joint(j, q[j]);
            out[j + 1] = Placement { r: parent.r * r, t: parent.point(&t) };
        }
    }

    /// The poses of all bodies, as by [`forward`](Self::forward), from the joints `turned`.
    pub(crate) fn place(&self, turned: &TurnedJoints, out: &mut Placements) {
        for (j, Turned { r, t }) in turned.iter().enumerate().take(self.count) {
            let parent = out[self.links[j].parent];
            out[j + 1] = Placement { r: parent.r * r, t: parent.point(t) };
        }
    }

    /// Rotation and origin of the body of joint `j` in its parent's frame at position `q`.
    #[inline]
    fn joint(&self, j: usize, q: f64) -> Turned {
        let link = &self.links[j];
        let offset = &link.parent_from_body;
        if link.prismatic {
            return Turned { r: offset.r, t: offset.t + offset.r * link.axis * q };
        }
        let turn = &self.turns[j];
        let (sin, cos) = q.sin_cos();
        Turned { r: turn.m0 + turn.m1 * sin + turn.m2 * (1.0 - cos), t: offset.t }
    }

    /// The deepest body that carries both `a` and `b`.
    pub fn common_body(&self, a: usize, b: usize) -> usize {
        let shared = self.ancestors[a] & self.ancestors[b];
        // Joint indices grow along a chain, so the last shared joint is the deepest.
        if shared == 0 { 0 } else { JOINTS_BITS - shared.leading_zeros() as usize }
    }

    /// Reach of joint `joint` to a point of `body`, a body that the joint moves. It is the largest distance
    /// of the point from the joint's axis over all configurations. For a prismatic joint it is 1.
    ///
    /// For a revolute joint it is at most a sum of lengths. The first is the distance of the next joint's
    /// origin, a fixed point of the joint's body, from the axis. The others are all later offsets, the
    /// strokes, and the point's distance from its own body's origin.
    pub fn reach(&self, joint: usize, body: usize, point: &Vector3<f64>) -> f64 {
        let own = &self.links[joint];
        if own.prismatic {
            return 1.0;
        }
        let mut tail = 0.0;
        let mut at = body;
        let mut first = *point;
        while at != joint + 1 {
            let link = &self.links[at - 1];
            tail += first.norm() + if link.prismatic { link.stroke } else { 0.0 };
            first = link.parent_from_body.t;
            at = link.parent;
        }
        own.axis.cross(&first).norm() + tail
    }
}

const JOINTS_BITS: usize = JointSet::BITS as usize;
