//! Checks whether a target moves as people do.

use messages::{JOINTS_MAX, LIMBS, TICK_S};
use robot::Model;

/// Largest speed of a target's joint, or of a person's limb, that is not a jump, rad/s. The fastest joints of
/// people who throw reach 40 rad/s for some ms in external measurement.
const FASTEST_RAD_S: f64 = 40.0;
/// The same for a prismatic joint, m/s: the speed of the fastest hands.
const FASTEST_M_S: f64 = 10.0;

/// A command farther from its target than this is far behind, rad. It is 15 degrees, more than any tracking error.
const BEHIND_RAD: f64 = 0.26;
/// The same for a prismatic joint, m.
const BEHIND_M: f64 = 0.05;

/// The target that the next one is compared with.
#[derive(Clone, Copy, Debug, Default)]
pub struct TargetSteps {
    last: Option<([f64; JOINTS_MAX], u32, u64)>,
    limbs: Option<[[f64; 4]; LIMBS]>,
}

impl TargetSteps {
    /// Returns true if the target of index `k` lies farther from the previous one than any person moves. Only
    /// joints that are valid in both targets count (`valid_mask`).
    ///
    /// Positions are first clamped to the limits. Positions that are not finite do not count. Where the
    /// person's limbs are followed (x y z w, zero for none), their bones are compared instead, because joints
    /// may spin while a limb stands still.
    pub fn jumped(
        &mut self,
        model: &Model,
        k: u64,
        q: &[f64; JOINTS_MAX],
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
        (0..model.count).filter(|&j| valid_mask & last_mask & 1 << j != 0).any(|j| {
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

/// Returns the direction of a limb's bone, the y axis of its rotation. The twist of a limb may turn over in a
/// frame in which the elbow is straight. But bones move only if a tracker switches to another person.
fn bone(&[x, y, z, w]: &[f64; 4]) -> [f64; 3] {
    [2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)]
}

/// Returns true if a command at `q` is far behind a target, after the target is clamped to the limits.
pub fn far_behind(model: &Model, target: &[f64; JOINTS_MAX], valid_mask: u32, q: &[f64; JOINTS_MAX]) -> bool {
    (0..model.count).filter(|&j| valid_mask & 1 << j != 0).any(|j| {
        let limits = &model.limits[j];
        let far = if model.prismatic[j] { BEHIND_M } else { BEHIND_RAD };
        (target[j].clamp(limits.q_min, limits.q_max) - q[j]).abs() > far
    })
}
