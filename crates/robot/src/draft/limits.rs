//! Limits that a draft proposes: accelerations from effort and inertia, and what the URDF has a placeholder for.

use super::tree::{link_poses, moved_links};
use crate::effective::stated;
use crate::inertia::Inertia;
use crate::pose::Pose;
use crate::urdf::Tree;
use std::collections::BTreeMap;
use urdf_rs::JointType;

/// Standard gravity, m/s^2.
const GRAVITY: f64 = 9.806_65;
/// Share of what gravity leaves of an effort that one joint's acceleration may need. Assumption: the other half is for
/// the motion of the other joints.
const SHARE: f64 = 0.5;
/// Least proposed acceleration, rad/s^2. Assumption: slower arms cannot follow a person.
const LEAST: f64 = 1.0;
/// Proposed speed of a joint for which the URDF states none, rad/s. Assumption: half of what the slowest arms turn with.
const SPEED: f64 = 1.0;
/// Proposed effort of such a joint, as a multiple of what holds the arm level. Assumption.
const EFFORT: f64 = 2.0;

/// The load of a joint in a posture: the inertia of all that it moves about the axis (kg m^2), and the torques that hold it
/// against gravity: in this attitude, and in the worst one (N m).
#[derive(Clone, Copy, Debug)]
pub(super) struct Load {
    inertia: f64,
    gravity: f64,
    gravity_most: f64,
}

/// A posture by the indices of joints. Joints that are not there stand at zero.
pub(super) type Posture = BTreeMap<usize, f64>;

impl Load {
    pub(super) fn new(tree: &Tree, joint: usize, posture: &Posture) -> Self {
        let poses = link_poses(tree, |joint| posture.get(&joint).copied().unwrap_or(0.0));
        let whole = moved_links(tree, joint)
            .into_iter()
            .fold(Inertia::default(), |sum, link| sum.combined(&tree.inertias[link].seen_from(&poses[link])));
        let Pose { r, t } = poses[tree.joints[joint].child];
        let axis = r * tree.joints[joint].axis;
        // Torque about the axis per unit of weight, m: the lever of a weight that points anywhere.
        let lever = (whole.center - t).cross(&axis);
        let weight = whole.mass_kg * GRAVITY;
        Self {
            inertia: axis.dot(&(whole.about(&t) * axis)),
            gravity: weight * lever.z.abs(),
            gravity_most: weight * lever.norm(),
        }
    }

    /// The acceleration that the effort leaves, rad/s^2, with two digits and at most `most`.
    pub(super) fn acceleration(&self, effort: f64, most: f64) -> f64 {
        let left = SHARE * (effort - self.gravity) / self.inertia;
        let left = if left.is_finite() { left } else { most };
        ((left * 10.0).floor() / 10.0).clamp(LEAST.min(most), most)
    }
}

/// A limit that the URDF does not state, and the draft's proposal.
#[derive(Clone)]
pub(super) struct Supplied {
    pub(super) joint: usize,
    pub(super) key: &'static str,
    pub(super) value: f64,
    /// The URDF's word on it.
    pub(super) stated: String,
}

/// Writes proposals into the tree where it has placeholders for arms' joints, and returns them. A range is only proposed for a
/// joint that turns without end: any is right.
pub(super) fn supply(tree: &mut Tree, joints: &[usize]) -> Vec<Supplied> {
    let mut all = Vec::new();
    for &joint in joints {
        let [_, driven, strong] = stated(&tree.joints[joint]);
        let load = Load::new(tree, joint, &Posture::new());
        let own = &mut tree.joints[joint];
        let mut add = |key, value, stated| all.push(Supplied { joint, key, value, stated });
        if own.kind == JointType::Continuous {
            let half = (std::f64::consts::PI * 1e2).floor() / 1e2;
            own.kind = JointType::Revolute;
            (own.limit.lower, own.limit.upper) = (-half, half);
            add("position_min_rad", -half, "turns without end (continuous)".to_owned());
            add("position_max_rad", half, "turns without end (continuous)".to_owned());
        }
        if !driven {
            add("velocity_max_rad_per_s", SPEED, format!("velocity = {}", own.limit.velocity));
            own.limit.velocity = SPEED;
        }
        if !strong {
            let effort = (EFFORT * load.gravity_most).max(1.0).ceil();
            add("effort_max_n_m", effort, format!("effort = {}", own.limit.effort));
            own.limit.effort = effort;
        }
    }
    all
}
