//! The arm as two limb rotations, and their metric, in f32 with an analytic gradient.
//!
//! U(q) = R(a1, q1 - r1) R(a2, q2 - r2) R(a3, q3 - r3), F(q) = U R(a4, q4 - r4) R(a5, q5 - r5). All axes are in
//! the torso frame at the reference posture. Quaternions are x, y, z, w.

/// Slots of the joints that the limb rotations of an arm depend on. An empty slot has no axis and no range.
pub const ARM: usize = 5;
/// Number of inputs of the human encoder: bone and hinge axes of upper arm and forearm.
pub const FEATURES: usize = 12;

/// A unit quaternion, x, y, z, w.
pub type Quaternion = [f32; 4];
/// Rotations of the upper arm and the forearm relative to the torso, as differences from the T-pose.
pub type Limbs = [Quaternion; 2];

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arm {
    /// Unit joint axes at the reference posture, torso frame.
    pub axes: [[f32; 3]; ARM],
    /// Joint positions of the reference posture, rad.
    pub reference: [f32; ARM],
    /// Middle of each joint's range, rad.
    pub mid: [f32; ARM],
    /// Half of each joint's range, rad.
    pub half: [f32; ARM],
    /// The limbs, upper arm and forearm, that can turn about their own length. The others are matched by their direction.
    pub rolls: [bool; 2],
}

/// Returns the Hamilton product.
#[inline]
pub fn product(a: Quaternion, b: Quaternion) -> Quaternion {
    let ([ax, ay, az, aw], [bx, by, bz, bw]) = (a, b);
    [
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    ]
}

#[inline]
pub fn about(axis: [f32; 3], angle_rad: f32) -> Quaternion {
    let (s, c) = (0.5 * angle_rad).sin_cos();
    [axis[0] * s, axis[1] * s, axis[2] * s, c]
}

/// Returns `v` rotated by `q`: v + 2 u x (u x v + w v).
#[inline]
pub fn rotate(q: Quaternion, v: [f32; 3]) -> [f32; 3] {
    let u = [q[0], q[1], q[2]];
    let t = cross(u, v);
    let t = [t[0] + q[3] * v[0], t[1] + q[3] * v[1], t[2] + q[3] * v[2]];
    let t = cross(u, t);
    [v[0] + 2.0 * t[0], v[1] + 2.0 * t[1], v[2] + 2.0 * t[2]]
}

#[inline]
pub(crate) fn cross(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Returns (imag, real) of a b^-1: the error rotation between two limb rotations.
#[inline]
fn error(a: Quaternion, b: Quaternion) -> ([f32; 3], f32) {
    let [x, y, z, w] = product(a, [-b[0], -b[1], -b[2], b[3]]);
    ([x, y, z], w)
}

/// Returns `robot` turned by the shortest rotation that lets its limb point as that of `human`. Half a turn stays as it is.
fn pointed_as(robot: Quaternion, human: Quaternion) -> Quaternion {
    let [from, to] = [robot, human].map(|limb| rotate(limb, [0.0, 1.0, 0.0]));
    let ([x, y, z], w) = (cross(from, to), 1.0 + from[0] * to[0] + from[1] * to[1] + from[2] * to[2]);
    let length = (x * x + y * y + z * z + w * w).sqrt();
    if length < 1e-6 { human } else { product([x, y, z, w].map(|v| v / length), robot) }
}

/// Returns S_GR of an arm: the sum over both limbs of 1 - <q_a, q_b>^2 (ImitationNet, equation 1). It is
/// computed as |imag(q_a q_b^-1)|^2, which keeps its digits near zero.
pub fn s_gr(a: &Limbs, b: &Limbs) -> f32 {
    (0..2).map(|limb| error(a[limb], b[limb]).0.iter().map(|v| v * v).sum::<f32>()).sum()
}

/// Returns the rotation angle between two limb rotations, in degrees, 0..=180.
pub fn limb_degrees(a: Quaternion, b: Quaternion) -> f32 {
    let (imag, real) = error(a, b);
    let sine = imag.iter().map(|v| v * v).sum::<f32>().sqrt();
    2.0 * sine.atan2(real.abs()).to_degrees()
}

/// Returns the human encoder's input for the upper arm, then for the forearm: bone axis R (0, 1, 0) and hinge
/// axis R (0, 0, -1).
pub fn features(limbs: &Limbs) -> [f32; FEATURES] {
    let mut out = [0.0; FEATURES];
    for (limb, q) in limbs.iter().enumerate() {
        out[6 * limb..6 * limb + 3].copy_from_slice(&rotate(*q, [0.0, 1.0, 0.0]));
        out[6 * limb + 3..6 * limb + 6].copy_from_slice(&rotate(*q, [0.0, 0.0, -1.0]));
    }
    out
}

/// eps of the smoothed angle: S_GR of half a degree. Closer than that to 0 and 180 degrees the angle becomes quadratic.
pub const ANGLE_SMOOTHING: f32 = 2e-5;

/// Distance of an arm from the human's limbs, and its gradient.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fit {
    /// S_GR of both limbs, 0..=2.
    pub s_gr: f32,
    /// Smoothed angles of both limbs, rad, 0..pi each.
    pub angle: f32,
    /// Gradient of the weighted sum over the joint positions, 1/rad.
    pub gradient: [f32; ARM],
}

impl Arm {
    /// Returns the limb rotations at joint positions `q` (rad).
    pub fn forward(&self, q: &[f32; ARM]) -> Limbs {
        self.forward_with_axes(q).0
    }

    /// Returns the limb rotations and the present joint axes, torso frame.
    #[inline]
    fn forward_with_axes(&self, q: &[f32; ARM]) -> (Limbs, [[f32; 3]; ARM]) {
        let mut rotation = [0.0, 0.0, 0.0, 1.0];
        let mut limbs = [rotation; 2];
        let mut axes = [[0.0; 3]; ARM];
        for joint in 0..ARM {
            axes[joint] = rotate(rotation, self.axes[joint]);
            rotation = product(rotation, about(self.axes[joint], q[joint] - self.reference[joint]));
            if joint == 2 {
                limbs[0] = rotation;
            }
        }
        limbs[1] = rotation;
        (limbs, axes)
    }

    /// Returns S_GR and the smoothed angle between the human limbs and the arm at `q`, each summed over both
    /// limbs. Also returns the gradient over `q` (1/rad) of `square` S_GR + `angle` times the angle.
    ///
    /// Let e = q_h q_r^-1 = (v, s), and w_i the present axis of joint i. Then dq_r/dq_i = (w_i/2) q_r, so
    /// d<q_h, q_r>/dq_i = v . w_i / 2 and dS/dq_i = -s v . w_i. The angle of a limb is a = 2 atan(sqrt(S + eps)
    /// / sqrt(1 - S + eps)), rad, with da/dS = 1 / sqrt((S + eps) (1 - S + eps)).
    pub fn fit_with_gradient(&self, human: &Limbs, q: &[f32; ARM], square: f32, angle: f32) -> Fit {
        let (limbs, axes) = self.forward_with_axes(q);
        let mut fit = Fit { s_gr: 0.0, angle: 0.0, gradient: [0.0; ARM] };
        let human = self.target(human, &limbs);
        for (limb, joints) in [(0, 3), (1, ARM)] {
            let (v, s) = error(human[limb], limbs[limb]);
            let s_gr = v[0] * v[0] + v[1] * v[1] + v[2] * v[2];
            let (sine, cosine) = ((s_gr + ANGLE_SMOOTHING).sqrt(), (s * s + ANGLE_SMOOTHING).sqrt());
            fit.s_gr += s_gr;
            fit.angle += 2.0 * sine.atan2(cosine);
            let slope = -s * (square + angle / (sine * cosine));
            for (g, w) in fit.gradient[..joints].iter_mut().zip(&axes) {
                *g += slope * (v[0] * w[0] + v[1] * w[1] + v[2] * w[2]);
            }
        }
        fit
    }

    /// Returns the human limbs as a target for those of the robot. A limb that cannot roll is turned from the robot's by the
    /// shortest rotation that lets it point as the human's. Then v of its error is across the limb, and so is the gradient.
    pub fn target(&self, human: &Limbs, robot: &Limbs) -> Limbs {
        std::array::from_fn(|limb| if self.rolls[limb] { human[limb] } else { pointed_as(robot[limb], human[limb]) })
    }

    /// Converts positions normalised to -1..1 over the limits to joint positions (rad).
    pub fn denormalised(&self, n: &[f32; ARM]) -> [f32; ARM] {
        std::array::from_fn(|j| self.mid[j] + self.half[j] * n[j])
    }
}

impl From<&retarget::ArmModel> for Arm {
    fn from(arm: &retarget::ArmModel) -> Self {
        let single = |values: [f64; ARM]| values.map(|v| v as f32);
        Self {
            axes: arm.axes.map(|axis| [axis.x as f32, axis.y as f32, axis.z as f32]),
            reference: single(arm.reference),
            mid: single(arm.mid()),
            half: single(arm.half()),
            rolls: arm.rolls,
        }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use std::f32::consts::FRAC_PI_2;

    /// Returns a left arm similar to TiaGo's: axes and reference of the T-pose reach, limits of the same order.
    pub(crate) fn example_arm() -> Arm {
        Arm {
            axes: [[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [0.0, -1.0, 0.0]],
            reference: [0.0, 0.0, FRAC_PI_2, 0.0, 0.0],
            mid: [0.2, 0.0, 1.2, 1.0, 0.0],
            half: [1.3, 1.1, 2.3, 1.3, 2.0],
            rolls: [true; 2],
        }
    }

    fn pose(t: f32) -> [f32; ARM] {
        std::array::from_fn(|j| (t * (j as f32 + 1.3)).sin() * 1.4)
    }

    #[test]
    fn metric_gradient_agrees_with_finite_differences() {
        let arm = example_arm();
        for i in 0..50 {
            let human = arm.forward(&pose(0.37 * i as f32 + 1.0));
            let q = pose(0.91 * i as f32);
            for (square, angle) in [(1.0, 0.0), (0.0, 1.0), (2.0, 0.5)] {
                let fit = |q: &[f32; ARM]| arm.fit_with_gradient(&human, q, square, angle);
                let value = |q: &[f32; ARM]| square * fit(q).s_gr + angle * fit(q).angle;
                assert!((fit(&q).s_gr - s_gr(&human, &arm.forward(&q))).abs() < 1e-5);
                for joint in 0..ARM {
                    let h = 2e-3;
                    let (mut up, mut down) = (q, q);
                    up[joint] += h;
                    down[joint] -= h;
                    let numeric = (value(&up) - value(&down)) / (2.0 * h);
                    let ours = fit(&q).gradient[joint];
                    assert!((numeric - ours).abs() < 3e-3, "joint {joint}: {numeric} {ours}");
                }
            }
        }
    }

    #[test]
    fn reference_posture_is_the_t_pose_and_flexion_points_forward() {
        let arm = example_arm();
        let limbs = arm.forward(&arm.reference);
        assert!(limbs.iter().all(|q| limb_degrees(*q, [0.0, 0.0, 0.0, 1.0]) < 1e-3));
        let mut flexed = arm.reference;
        flexed[3] += FRAC_PI_2;
        let bone = rotate(arm.forward(&flexed)[1], [0.0, 1.0, 0.0]);
        assert!(bone[0] > 0.999, "the forearm points forward: {bone:?}");
        assert_eq!(features(&limbs)[..6], [0.0, 1.0, 0.0, 0.0, 0.0, -1.0]);
    }
}
