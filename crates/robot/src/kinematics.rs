//! Forward kinematics and Jacobians of the bodies.

use crate::model::Model;
use crate::pose::Pose;
use messages::JOINTS_MAX;
use nalgebra::{Matrix3, Vector3};

/// Poses of all bodies in the base frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frames {
    /// Body 0 is the base. Body `1 + j` moves with joint `j`.
    pub base_from_body: [Pose; JOINTS_MAX + 1],
}

impl Default for Frames {
    fn default() -> Self {
        Self { base_from_body: [Pose::identity(); JOINTS_MAX + 1] }
    }
}

/// Connection of a body to its parent body.
#[derive(Clone, Copy, Debug)]
pub(crate) struct JointFrame {
    /// The parent body. It always has a smaller index.
    pub(crate) parent: usize,
    /// Unit axis in the body's own frame. The joint's motion does not change it there.
    pub(crate) axis: Vector3<f64>,
    /// Origin of the body at position zero in the parent body's frame, m.
    offset: Vector3<f64>,
    motion: Motion,
}

#[derive(Clone, Copy, Debug)]
enum Motion {
    /// R(q) = fixed + sin(q) sine + cos(q) cosine. It is Rodrigues' formula after the fixed rotation.
    Turn { fixed: Matrix3<f64>, sine: Matrix3<f64>, cosine: Matrix3<f64> },
    /// t(q) = offset + q direction.
    Slide { rotation: Matrix3<f64>, direction: Vector3<f64> },
}

impl JointFrame {
    /// Creates the joint at `parent_from_joint` in body `parent`. It moves about or along the unit `axis` of
    /// its own frame.
    pub(crate) fn new(parent: usize, parent_from_joint: &Pose, axis: Vector3<f64>, prismatic: bool) -> Self {
        let r = parent_from_joint.r;
        let motion = if prismatic {
            Motion::Slide { rotation: r, direction: r * axis }
        } else {
            let along = axis * axis.transpose();
            Motion::Turn { fixed: r * along, sine: r * axis.cross_matrix(), cosine: r * (Matrix3::identity() - along) }
        };
        Self { parent, axis, offset: parent_from_joint.t, motion }
    }
}

impl Model {
    /// Computes the poses of all bodies at the joint positions `q` (rad, m). Never allocates.
    ///
    /// base_from_body = base_from_parent * (parent_from_joint * motion(q)), parents before children.
    pub fn forward(&self, q: &[f64; JOINTS_MAX], out: &mut Frames) {
        out.base_from_body[0] = Pose::identity();
        for (j, q) in q.iter().enumerate().take(self.joint_frames.len()) {
            self.forward_joint(j, *q, out);
        }
    }

    /// Computes the pose of the body of joint `j` at position `q` (rad, m). That of its parent must be right in `out`.
    #[inline]
    pub fn forward_joint(&self, j: usize, q: f64, out: &mut Frames) {
        let joint = &self.joint_frames[j];
        let parent = out.base_from_body[joint.parent];
        out.base_from_body[j + 1] = match &joint.motion {
            Motion::Turn { fixed, sine, cosine } => {
                let (sin, cos) = q.sin_cos();
                Pose { r: parent.r * (fixed + sine * sin + cosine * cos), t: parent.r * joint.offset + parent.t }
            }
            Motion::Slide { rotation, direction } => {
                Pose { r: parent.r * rotation, t: parent.r * (joint.offset + direction * q) + parent.t }
            }
        };
    }

    /// Jacobian of a point that is fixed to `body` and now lies at `point` of the base frame, m. Column j is
    /// the effect of unit speed of joint j. It has the point's linear velocity (m/s) and the body's angular
    /// velocity (rad/s) in the base frame. Never allocates.
    ///
    /// A column is (w x (p - o), w) for a revolute joint and (w, 0) for a prismatic one. It is zero if the
    /// joint does not carry the body.
    pub fn jacobian(&self, frames: &Frames, body: usize, point: &Vector3<f64>) -> [[f64; 6]; JOINTS_MAX] {
        let mut columns = [[0.0; 6]; JOINTS_MAX];
        let mut at = body;
        while at > 0 {
            let j = at - 1;
            let pose = &frames.base_from_body[at];
            let axis = pose.r * self.joint_frames[j].axis;
            columns[j] = if self.prismatic[j] {
                [axis.x, axis.y, axis.z, 0.0, 0.0, 0.0]
            } else {
                let linear = axis.cross(&(point - pose.t));
                [linear.x, linear.y, linear.z, axis.x, axis.y, axis.z]
            };
            at = self.joint_frames[j].parent;
        }
        columns
    }

    /// The links of the URDF: name, body, and pose in the body's frame.
    pub fn links(&self) -> impl Iterator<Item = (&str, usize, &Pose)> {
        self.links.iter().map(|link| (link.name.as_str(), link.body, &link.body_from_link))
    }

    /// Pose in the base frame of any link of the URDF, or `None` if there is no such link. It searches by
    /// name, so do not call it in a tick.
    pub fn link_pose(&self, frames: &Frames, link: &str) -> Option<Pose> {
        let (body, body_from_link) = self.link_body(link)?;
        Some(frames.base_from_body[body].compose(&body_from_link))
    }

    /// The body that carries a link, and the link's pose in that body's frame. It searches by name, so do not
    /// call it in a tick.
    pub fn link_body(&self, link: &str) -> Option<(usize, Pose)> {
        self.links.iter().find(|known| known.name == link).map(|known| (known.body, known.body_from_link))
    }

    /// The parent of `body`. `None` for the base.
    pub fn parent_body(&self, body: usize) -> Option<usize> {
        body.checked_sub(1).map(|j| self.joint_frames[j].parent)
    }

    /// Pose of the body of joint `j` in its parent body's frame at joint position zero, and the joint's unit axis
    /// in the body's own frame.
    pub fn joint_at_zero(&self, j: usize) -> (Pose, Vector3<f64>) {
        let joint = &self.joint_frames[j];
        let r = match &joint.motion {
            Motion::Turn { fixed, cosine, .. } => fixed + cosine,
            Motion::Slide { rotation, .. } => *rotation,
        };
        (Pose { r, t: joint.offset }, joint.axis)
    }
}
