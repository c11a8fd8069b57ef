//! Whether a target moves as people do.

use messages::{JOINTS, LIMBS, TICK_S};
use robot::Model;

/// The fastest that a joint of a target, or a limb of a person, turns without being a jump, rad/s: the fastest joints of
/// people who throw reach 40 rad/s for some ms in external measurement.
const FASTEST_RAD_S: f64 = 40.0;
/// The same of a prismatic joint, m/s: the fastest hands.
const FASTEST_M_S: f64 = 10.0;

/// Farther from its target than this is far behind, rad: 15 degrees, of which no tracking of a target is off.
const BEHIND_RAD: f64 = 0.26;
/// The same of a prismatic joint, m.
const BEHIND_M: f64 = 0.05;

/// The target that the next one is compared with.
#[derive(Clone, Copy, Debug, Default)]
pub struct TargetSteps {
    last: Option<([f64; JOINTS], u32, u64)>,
    limbs: Option<[[f64; 4]; LIMBS]>,
}

impl TargetSteps {
    /// Whether the target of index `k` lies farther from the one before than anybody moves, in a joint that both mean
    /// (`valid_mask`). Positions count as far as the limits let them be reached; those that are not finite do not. Where the
    /// person's limbs are followed (x y z w, zero for none), their bones are compared instead: joints spin where a limb stands.
    pub fn jumped(
        &mut self,
        model: &Model,
        k: u64,
        q: &[f64; JOINTS],
        valid_mask: u32,
        limbs: Option<&[[f64; 4]; LIMBS]>,
    ) -> bool {
        let limbs_before = std::mem::replace(&mut self.limbs, limbs.copied());
        let before = self.last.replace((*q, valid_mask, k));
        let Some((last, last_mask, last_k)) = before else { return false };
        let dt_s = k.saturating_sub(last_k).max(1) as f64 * TICK_S;
        if let Some((limbs, before)) = limbs.zip(limbs_before) {
            let farthest = (FASTEST_RAD_S * dt_s).min(core::f64::consts::PI).cos();
            return limbs.iter().zip(&before).any(|(now, before)| {
                let both = is_rotation(now) && is_rotation(before);
                both && bone(now).iter().zip(bone(before)).map(|(a, b)| a * b).sum::<f64>() < farthest
            });
        }
        (0..JOINTS).filter(|&j| valid_mask & last_mask & 1 << j != 0).any(|j| {
            let limits = &model.limits[j];
            let reached = |q: f64| q.clamp(limits.q_min, limits.q_max);
            let fastest = if model.prismatic[j] { FASTEST_M_S } else { FASTEST_RAD_S };
            (reached(q[j]) - reached(last[j])).abs() > fastest * dt_s
        })
    }
}

fn is_rotation(limb: &[f64; 4]) -> bool {
    (limb.iter().map(|x| x * x).sum::<f64>() - 1.0).abs() < 1e-3
}

/// The direction of a limb's bone, the y axis of its rotation. Its twist may turn over in a frame where the elbow is
/// straight; a tracker that takes another person moves bones.
fn bone(&[x, y, z, w]: &[f64; 4]) -> [f64; 3] {
    [2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)]
}

/// Whether a command at `q` is far behind a target, as far as the limits let that be reached.
pub fn far_behind(model: &Model, target: &[f64; JOINTS], valid_mask: u32, q: &[f64; JOINTS]) -> bool {
    (0..JOINTS).filter(|&j| valid_mask & 1 << j != 0).any(|j| {
        let limits = &model.limits[j];
        let far = if model.prismatic[j] { BEHIND_M } else { BEHIND_RAD };
        (target[j].clamp(limits.q_min, limits.q_max) - q[j]).abs() > far
    })
}
