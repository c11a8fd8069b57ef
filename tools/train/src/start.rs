//! Where training begins. A shoulder has two postures for every direction of the upper arm, one on either side of its
//! gimbal. A network that begins between them learns one for some poses and the other one for others, and what lies
//! between these is wrong.

use crate::evaluation::limbs;
use crate::sampling::Recorded;
use retarget::{ARM_Q, ArmModel, ArmQ, closed_form_branch};

/// Angle of the limits' middle from the gimbal within which training begins on one side of it, degrees.
const BETWEEN_DEG: f64 = 15.0;
/// Recorded poses that choose the side.
const POSES: usize = 2_000;

/// Returns the joint positions at which a network for `arm` begins, normalised to -1..1 over the limits. It is their
/// middle, unless that lies at the gimbal of an arm with a closed form. Then it is the mean posture on the side that comes nearer to the recorded
/// poses.
pub fn start(arm: &ArmModel, recorded: &Recorded) -> [f32; ARM_Q] {
    let mid = arm.mid();
    let upper = arm.forward(&mid).upper * arm.axes[2];
    let poses = recorded.frames.as_flattened();
    if !arm.has_closed_form || upper.cross(&arm.axes[0]).norm() > BETWEEN_DEG.to_radians().sin() || poses.is_empty() {
        return [0.0; ARM_Q];
    }
    let side = |sign: f64| {
        let (mut mean, mut s_gr, mut count): (ArmQ, _, _) = ([0.0; ARM_Q], 0.0, 0.0);
        for pose in poses.iter().step_by(poses.len().div_ceil(POSES)) {
            let human = limbs(pose);
            let q = closed_form_branch(arm, &human, &mid, sign);
            s_gr += arm.s_gr(&q, &human);
            count += 1.0;
            mean.iter_mut().zip(q).for_each(|(mean, q)| *mean += (q - *mean) / count);
        }
        (s_gr, mean)
    };
    let (one, other) = (side(1.0), side(-1.0));
    let mean = if other.0 < one.0 { other.1 } else { one.1 };
    let half = arm.half();
    std::array::from_fn(|j| ((mean[j] - mid[j]) / half[j]) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::procedural;
    use nalgebra::Vector3;
    use rand_pcg::Pcg64;
    use std::f64::consts::FRAC_PI_2;

    /// An arm whose first axis points to the side, as the T-pose. The limits allow `range` of joint 2 about it.
    fn sideways(range: [f64; 2]) -> ArmModel {
        let axes = [Vector3::y(), -Vector3::x(), Vector3::y(), -Vector3::z(), Vector3::y()];
        ArmModel::new(axes, [0.0; ARM_Q], [-3.0, range[0], -3.0, 0.0, -1.5], [3.0, range[1], 3.0, 2.4, 1.5])
    }

    #[test]
    fn start_between_two_sides_moves_to_the_one_that_reaches_more() {
        let mut rng = Pcg64::new(5, 5);
        let recorded = Recorded { frames: (0..300).map(|_| [procedural(&mut rng), procedural(&mut rng)]).collect() };
        let normalised = |range| start(&sideways(range), &recorded)[1];
        assert!(normalised([-1.6, 1.2]) < -0.2, "joint 2 bends further to the negative side");
        assert!(normalised([-1.2, 1.6]) > 0.2, "and here to the positive one");
        assert_eq!(start(&sideways([FRAC_PI_2 - 0.3, FRAC_PI_2 + 0.3]), &recorded), [0.0; ARM_Q], "not between them");
        assert_eq!(start(&sideways([-1.6, 1.2]), &Recorded::default()), [0.0; ARM_Q]);
    }
}
