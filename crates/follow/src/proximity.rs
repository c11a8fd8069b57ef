//! Capsule pairs near an arm: their distances, and the derivatives by the arm's joints.
//!
//! ```text
//! d = |p - o| - r_own - r_other,   dd / dq_i = n . (w_i x (p - c_i))
//!
//! p, o   nearest points on the axes of the arm's capsule and of the other one, m
//! n      unit vector from o to p
//! w_i    axis of joint i through c_i, base frame
//! ```

use messages::ARM_JOINTS;
use nalgebra::Vector3;
use robot::{Arm, CAPSULES_MAX, Frames, Model, segment_distance};

/// Distance below which a pair is evaluated, m. Whole-body control slows an arm whose stop comes nearer than about 30
/// mm. A wrist turns away earlier, because that moves no limb.
pub(crate) const PROXIMITY_M: f64 = 0.06;

/// Capsule `own` is on the arm. `other` is on another body, or nearer to the shoulder on the same arm.
#[derive(Clone, Copy, Debug)]
struct Pair {
    own: usize,
    other: usize,
    radii_m: f64,
    /// Square of twice the distance between the middles of both axes from which on the pair is not evaluated, m^2.
    beyond: f64,
    /// The joints of the arm between both capsules, in the order of messages: from..to.
    from: usize,
    to: usize,
}

/// A pair nearer than [`PROXIMITY_M`] in the evaluated posture.
#[derive(Clone, Copy, Debug)]
pub(crate) struct NearPair {
    /// Distance of the surfaces, m. Below zero they intersect.
    pub(crate) distance_m: f64,
    /// Its derivative by the joint in each slot of the arm, m/rad.
    pub(crate) slope: [f64; ARM_JOINTS],
}

/// Constant data of the pairs of one arm.
#[derive(Clone, Debug)]
pub(crate) struct ArmPairs {
    slots: [Option<usize>; ARM_JOINTS],
    pairs: Vec<Pair>,
    /// Unit axis of the joint in each slot, in the frame of the body that it moves.
    axes: [Vector3<f64>; ARM_JOINTS],
}

impl ArmPairs {
    /// Collects the pairs of an arm.
    pub(crate) fn new(model: &Model, arm: &Arm) -> Self {
        // The joint after the last one of the arm that moves the capsule.
        let joints = |capsule: usize| {
            let joint = model.capsules[capsule].body.checked_sub(1).filter(|joint| arm.range().contains(joint));
            joint.map_or(arm.range().start, |joint| joint + 1)
        };
        let pairs = model.pairs.iter().filter_map(|&robot::Pair { a, b }| {
            let (own, other) = if joints(a) > joints(b) { (a, b) } else { (b, a) };
            let radii_m = model.capsules[a].radius_m + model.capsules[b].radius_m;
            let long_m = [a, b].map(|i| (model.capsules[i].b - model.capsules[i].a).norm());
            // A nanometre more, for the rounding of the ends.
            let beyond = (long_m[0] + long_m[1] + 2.0 * (radii_m + PROXIMITY_M) + 1e-9).powi(2);
            let (from, to) = (joints(other), joints(own));
            (to > from).then_some(Pair { own, other, radii_m, beyond, from, to })
        });
        let axes = arm.slots.map(|slot| slot.map_or_else(Vector3::zeros, |joint| model.joint_at_zero(joint).1));
        Self { slots: arm.slots, pairs: pairs.collect(), axes }
    }

    /// Calls `visit` for every pair nearer than [`PROXIMITY_M`] with the bodies at `frames`. It skips a pair whose distance is
    /// not finite, or whose axes meet.
    pub(crate) fn evaluate(&self, model: &Model, frames: &Frames, mut visit: impl FnMut(&NearPair)) {
        let mut ends = [[Vector3::zeros(); 2]; CAPSULES_MAX];
        for (ends, capsule) in ends.iter_mut().zip(&model.capsules) {
            *ends = capsule.ends(frames);
        }
        for pair in &self.pairs {
            let (own, other) = (&ends[pair.own], &ends[pair.other]);
            if ((own[0] + own[1]) - (other[0] + other[1])).norm_squared() >= pair.beyond {
                continue;
            }
            let nearest = segment_distance(&own[0], &own[1], &other[0], &other[1]);
            let distance_m = nearest.distance_m - pair.radii_m;
            if !(distance_m < PROXIMITY_M && nearest.distance_m > 0.0) {
                continue;
            }
            let point = own[0] + (own[1] - own[0]) * nearest.s;
            let away = (point - (other[0] + (other[1] - other[0]) * nearest.t)) / nearest.distance_m;
            let mut slope = [0.0; ARM_JOINTS];
            for (i, slot) in self.slots.iter().enumerate() {
                let Some(joint) = slot.filter(|joint| (pair.from..pair.to).contains(joint)) else { continue };
                let pose = &frames.base_from_body[joint + 1];
                slope[i] = away.dot(&(pose.r * self.axes[i]).cross(&(point - pose.t)));
            }
            visit(&NearPair { distance_m, slope });
        }
    }
}
