//! One arm with two limb rotations: forward model, residual with analytic Jacobian, and the metric S_GR.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use robot::Limbs;
use robot::limbs::{axis_rotation, rotate, rotation_error};

/// Both arms: left, right.
pub const ARMS: usize = 2;
/// Slots of the joints that turn the two limbs of an arm: three for the upper arm, two for the forearm. An empty slot has no axis.
pub const ARM_Q: usize = 5;
/// Largest cosine between neighbouring axes that the closed form takes for orthogonal: it costs 0.06 degrees of a limb.
const ORTHOGONAL: f64 = 1e-3;
/// Rows of the residual: three for the upper arm, three for the forearm.
pub const RESIDUALS: usize = 6;
/// Inputs of the human encoder: bone and hinge axes of both limbs.
pub const FEATURES: usize = 12;

/// Positions of the joints in these slots, rad. Zero in an empty one.
pub type ArmQ = [f64; ARM_Q];

/// The robot's arm as the retargeting uses it: up to five revolute joints, two limbs.
#[derive(Clone, Debug, PartialEq)]
pub struct ArmModel {
    /// Unit axis of each joint in the torso frame while the arm is at `reference`. Zero for an empty slot.
    pub axes: [Vector3<f64>; ARM_Q],
    /// Joint positions of the T-pose, rad.
    pub reference: ArmQ,
    /// Lower limits, rad.
    pub q_min: ArmQ,
    /// Upper limits, rad.
    pub q_max: ArmQ,
    /// The limbs, upper arm and forearm, that can turn about their own length. The others are matched by their direction.
    pub rolls: [bool; 2],
    /// The axes of each limb are orthogonal, so the closed form holds.
    pub has_closed_form: bool,
}

/// Residual and Jacobian of one posture.
#[derive(Clone, Copy, Debug)]
pub struct Linearization {
    /// imag(q_r q_h^-1) with w >= 0: upper arm, then forearm. Its squared norm is S_GR.
    pub residual: [f64; RESIDUALS],
    /// Column j: derivative of `residual` by joint j, 1/rad.
    pub jacobian: [[f64; RESIDUALS]; ARM_Q],
}

impl ArmModel {
    /// Creates the arm from plain arrays: axes in the torso frame at the reference posture, reference and limits
    /// in rad.
    pub fn new(axes: [Vector3<f64>; ARM_Q], reference: ArmQ, q_min: ArmQ, q_max: ArmQ) -> Self {
        let axes = axes.map(|axis| axis.try_normalize(0.0).unwrap_or_default());
        let rolls = [2, 4].map(|slot: usize| axes[slot] != Vector3::zeros());
        let orthogonal =
            [(0, 1), (1, 2), (3, 4)].iter().all(|(a, b): &(usize, usize)| axes[*a].dot(&axes[*b]).abs() <= ORTHOGONAL);
        Self { axes, reference, q_min, q_max, rolls, has_closed_form: orthogonal && rolls == [true; 2] }
    }

    /// Middle of the limits, rad.
    pub fn mid(&self) -> ArmQ {
        std::array::from_fn(|j| 0.5 * (self.q_min[j] + self.q_max[j]))
    }

    /// Half of the range of the limits, rad.
    pub fn half(&self) -> ArmQ {
        std::array::from_fn(|j| 0.5 * (self.q_max[j] - self.q_min[j]))
    }

    /// Returns `q` moved into the limits, rad.
    pub fn clamp(&self, q: &ArmQ) -> ArmQ {
        std::array::from_fn(|j| q[j].max(self.q_min[j]).min(self.q_max[j]))
    }

    /// Rotations of the limbs: U(q) = R0 R1 R2 and F(q) = U R3 R4 with Ri = Rot(axes i, q i - reference i).
    pub fn forward(&self, q: &ArmQ) -> Limbs {
        let r = self.rotations(q);
        let upper = mul(&mul(&r[0], &r[1]), &r[2]);
        let fore = mul(&mul(&upper, &r[3]), &r[4]);
        Limbs { upper: UnitQuaternion::new_unchecked(upper), fore: UnitQuaternion::new_unchecked(fore) }
    }

    /// S_GR of one arm: sum over its limbs of 1 - <q_h, q_r>^2, dimensionless, 0 to 2. The person's limbs are those of
    /// [`Limbs::target`].
    pub fn s_gr(&self, q: &ArmQ, human: &Limbs) -> f64 {
        let robot = self.forward(q);
        s_gr(&robot, &robot.target(human, self.rolls))
    }

    /// Rotation angles between the robot at `q` and the person's limbs, as [`Limbs::target`] has them, degrees: upper arm, forearm.
    pub fn limb_error_deg(&self, q: &ArmQ, human: &Limbs) -> [f64; 2] {
        let robot = self.forward(q);
        limb_error_deg(&robot, &robot.target(human, self.rolls))
    }

    /// Residual r = imag(q_r q_h^-1), flipped to w >= 0, per limb. |r|^2 = S_GR.
    pub fn residual(&self, q: &ArmQ, human: &Limbs) -> [f64; RESIDUALS] {
        let robot = self.forward(q);
        let human = &robot.target(human, self.rolls);
        let (_, upper) = rotation_error(&robot.upper, &human.upper);
        let (_, fore) = rotation_error(&robot.fore, &human.fore);
        [upper.x, upper.y, upper.z, fore.x, fore.y, fore.z]
    }

    /// Residual and Jacobian. Let q_r = A1 .. An, and w_i the axis of joint i in the torso frame at q. Then d q_r
    /// / d q_i = (0, w_i) q_r / 2. Hence d r / d q_i = (e_w w_i + w_i x e_v) / 2 for e = q_r q_h^-1. Of a limb that cannot
    /// roll, w_i is taken across the limb: the person's roll goes with the robot's.
    pub fn linearize(&self, q: &ArmQ, human: &Limbs) -> Linearization {
        let r = self.rotations(q);
        let r01 = mul(&r[0], &r[1]);
        let upper = mul(&r01, &r[2]);
        let u3 = mul(&upper, &r[3]);
        let fore = mul(&u3, &r[4]);
        let axes = [
            self.axes[0],
            rotate(&r[0], &self.axes[1]),
            rotate(&r01, &self.axes[2]),
            rotate(&upper, &self.axes[3]),
            rotate(&u3, &self.axes[4]),
        ];
        let robot = Limbs { upper: UnitQuaternion::new_unchecked(upper), fore: UnitQuaternion::new_unchecked(fore) };
        let human = &robot.target(human, self.rolls);
        let (uw, uv) = rotation_error(&robot.upper, &human.upper);
        let (fw, fv) = rotation_error(&robot.fore, &human.fore);
        let directions = if self.rolls == [true; 2] { [Vector3::zeros(); 2] } else { robot.directions() };
        let across = |limb: usize, axis: &Vector3<f64>| match self.rolls[limb] {
            true => *axis,
            false => axis - directions[limb] * directions[limb].dot(axis),
        };
        let mut jacobian = [[0.0; RESIDUALS]; ARM_Q];
        for (j, (column, axis)) in jacobian.iter_mut().zip(&axes).enumerate() {
            if j < 3 {
                let axis = across(0, axis);
                let d = (axis * uw + axis.cross(&uv)) * 0.5;
                [column[0], column[1], column[2]] = [d.x, d.y, d.z];
            }
            let axis = across(1, axis);
            let d = (axis * fw + axis.cross(&fv)) * 0.5;
            [column[3], column[4], column[5]] = [d.x, d.y, d.z];
        }
        Linearization { residual: [uv.x, uv.y, uv.z, fv.x, fv.y, fv.z], jacobian }
    }

    pub(crate) fn rotations(&self, q: &ArmQ) -> [Quaternion<f64>; ARM_Q] {
        std::array::from_fn(|j| axis_rotation(&self.axes[j], q[j] - self.reference[j]))
    }
}

fn mul(a: &Quaternion<f64>, b: &Quaternion<f64>) -> Quaternion<f64> {
    a * b
}

/// S_GR between two pairs of limbs: sum of 1 - <q_h, q_r>^2. It is computed as |imag|^2, so small errors keep
/// their digits.
pub fn s_gr(robot: &Limbs, human: &Limbs) -> f64 {
    rotation_error(&robot.upper, &human.upper).1.norm_squared()
        + rotation_error(&robot.fore, &human.fore).1.norm_squared()
}

/// Rotation angles between robot and person, degrees: upper arm, forearm.
pub fn limb_error_deg(robot: &Limbs, human: &Limbs) -> [f64; 2] {
    let degrees = |r, h| {
        let (w, v) = rotation_error(r, h);
        2.0 * v.norm().atan2(w).to_degrees()
    };
    [degrees(&robot.upper, &human.upper), degrees(&robot.fore, &human.fore)]
}

/// Input of the human encoder: bone axis (y column) and hinge axis (-z column) of the upper arm, then of the
/// forearm. They are unit vectors in the torso frame, of a left or mirrored right arm.
pub fn features(human: &Limbs) -> [f32; FEATURES] {
    let mut out = [0.0; FEATURES];
    for (limb, part) in [&human.upper, &human.fore].into_iter().zip(out.chunks_exact_mut(6)) {
        let bone = rotate(limb.quaternion(), &Vector3::y());
        let hinge = rotate(limb.quaternion(), &-Vector3::z());
        for i in 0..3 {
            part[i] = bone[i] as f32;
            part[3 + i] = hinge[i] as f32;
        }
    }
    out
}
