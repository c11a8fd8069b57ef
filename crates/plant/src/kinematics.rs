//! Poses of the bodies.

use crate::description::{Body, Joint, JointKind};
use crate::pose::{Pose, turn};
use messages::JOINTS_MAX;
use nalgebra::Vector3;

/// Poses of all bodies in the base frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frames {
    /// Body 0 is the base, body `1 + j` moves with joint `j`.
    pub base_from_body: [Pose; JOINTS_MAX + 1],
}

impl Default for Frames {
    fn default() -> Self {
        Self { base_from_body: [Pose::identity(); JOINTS_MAX + 1] }
    }
}

impl Joint {
    /// Returns the body's frame in the parent body's frame at position `q`, rad or m.
    pub(crate) fn parent_from_moved(&self, q: f64) -> Pose {
        let motion = match self.kind {
            JointKind::Revolute => Pose { r: turn(&self.axis, q), t: Vector3::zeros() },
            JointKind::Prismatic => Pose { t: self.axis * q, ..Pose::identity() },
        };
        self.parent_from_body.then(&motion)
    }
}

impl Body {
    /// Computes the poses of all bodies at the posture `q` (rad, m).
    pub fn forward(&self, q: &[f64; JOINTS_MAX], out: &mut Frames) {
        out.base_from_body[0] = Pose::identity();
        for (j, joint) in self.joints.iter().enumerate() {
            out.base_from_body[j + 1] = out.base_from_body[joint.parent].then(&joint.parent_from_moved(q[j]));
        }
    }
}
