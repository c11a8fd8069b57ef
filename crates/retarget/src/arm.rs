//! One arm with two limb rotations: forward model, residual with analytic Jacobian, and the metric S_GR.

use messages::LIMBS;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

/// Both arms: left, right.
pub const ARMS: usize = 2;
/// Joints of an arm that the two limbs determine. Joints 6 and 7 are left free.
pub const ARM_Q: usize = 5;
/// Rows of the residual: three for the upper arm, three for the forearm.
pub const RESIDUALS: usize = 6;
/// Inputs of the human encoder: bone and hinge axes of both limbs.
pub const FEATURES: usize = 12;

/// Joint positions 1 to 5 of one arm, rad.
pub type ArmQ = [f64; ARM_Q];

/// Rotations of one arm's two limbs in the torso frame (x forward, y left, z up), as differences from the T-pose.
/// A right arm is mirrored to a left one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limbs {
    /// Shoulder to elbow.
    pub upper: UnitQuaternion<f64>,
    /// Elbow to wrist.
    pub fore: UnitQuaternion<f64>,
}

impl Limbs {
    /// The T-pose.
    pub fn identity() -> Self {
        Self { upper: UnitQuaternion::identity(), fore: UnitQuaternion::identity() }
    }

    /// Takes the upper arm and the forearm (x y z w) of the left (0) or the right (1) arm. `None` if one of them is no
    /// rotation.
    pub fn of_arm(arm: usize, limbs: [[f64; 4]; 2]) -> Option<Self> {
        let [upper, fore] = limbs.map(|limb| rotation_of_arm(arm, limb));
        Some(Self { upper: upper?, fore: fore? })
    }

    /// Takes the limbs of both arms, indexed by `messages::Limb`. `None` if one of them is no rotation.
    pub fn of_both(limbs: &[[f32; 4]; LIMBS]) -> Option<[Self; ARMS]> {
        let [left_upper, left_fore, right_upper, right_fore] = limbs.map(|limb| limb.map(f64::from));
        Some([Self::of_arm(0, [left_upper, left_fore])?, Self::of_arm(1, [right_upper, right_fore])?])
    }

    /// Interpolates both limbs at `s` between `self` (0) and `other` (1), each along the shorter arc.
    pub fn slerp(&self, other: &Self, s: f64) -> Self {
        Self { upper: slerp(&self.upper, &other.upper, s), fore: slerp(&self.fore, &other.fore, s) }
    }

    /// As [`Limbs::slerp`], but keeps the quaternions' signs.
    pub(crate) fn between(&self, other: &Self, s: f64) -> Self {
        Self { upper: slerp_signed(&self.upper, &other.upper, s), fore: slerp_signed(&self.fore, &other.fore, s) }
    }
}

/// Two quaternions closer than this (1 - |dot|) are interpolated linearly. The error stays below 1e-12 rad, and no
/// division by the sine of a vanishing angle occurs.
const SLERP_LINEAR: f64 = 1e-8;

/// Rotation at `s` between `a` (0) and `b` (1) on the shorter arc. q and -q are the same rotation.
pub fn slerp(a: &UnitQuaternion<f64>, b: &UnitQuaternion<f64>, s: f64) -> UnitQuaternion<f64> {
    slerp_signed(a, &align(b, a), s)
}

/// Returns `q` or -q, the one nearer to `reference` on the sphere. Both are the same rotation.
pub(crate) fn align(q: &UnitQuaternion<f64>, reference: &UnitQuaternion<f64>) -> UnitQuaternion<f64> {
    if q.coords.dot(&reference.coords) < 0.0 { UnitQuaternion::new_unchecked(-q.into_inner()) } else { *q }
}

/// Slerp on the sphere that keeps the signs. It is continuous in all arguments while a and b are not opposite.
fn slerp_signed(a: &UnitQuaternion<f64>, b: &UnitQuaternion<f64>, s: f64) -> UnitQuaternion<f64> {
    let dot = a.coords.dot(&b.coords).clamp(-1.0, 1.0);
    if dot < SLERP_LINEAR - 1.0 {
        return if s < 0.5 { *a } else { *b };
    }
    let (wa, wb) = if dot > 1.0 - SLERP_LINEAR {
        (1.0 - s, s)
    } else {
        let angle = dot.acos();
        let sin = angle.sin();
        (((1.0 - s) * angle).sin() / sin, (s * angle).sin() / sin)
    };
    UnitQuaternion::new_normalize(Quaternion::from(a.coords * wa + b.coords * wb))
}

/// The robot's arm as the retargeting uses it: five revolute joints, two limbs.
#[derive(Clone, Debug, PartialEq)]
pub struct ArmModel {
    /// Unit axis of each joint in the torso frame while the arm is at `reference`.
    pub axes: [Vector3<f64>; ARM_Q],
    /// Joint positions of the T-pose, rad.
    pub reference: ArmQ,
    /// Lower limits, rad.
    pub q_min: ArmQ,
    /// Upper limits, rad.
    pub q_max: ArmQ,
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
        Self { axes: axes.map(|axis| axis.normalize()), reference, q_min, q_max }
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

    /// S_GR of one arm: sum over its limbs of 1 - <q_h, q_r>^2, dimensionless, 0 to 2.
    pub fn s_gr(&self, q: &ArmQ, human: &Limbs) -> f64 {
        s_gr(&self.forward(q), human)
    }

    /// Residual r = imag(q_r q_h^-1), flipped to w >= 0, per limb. |r|^2 = S_GR.
    pub fn residual(&self, q: &ArmQ, human: &Limbs) -> [f64; RESIDUALS] {
        let robot = self.forward(q);
        let (_, upper) = error(&robot.upper, &human.upper);
        let (_, fore) = error(&robot.fore, &human.fore);
        [upper.x, upper.y, upper.z, fore.x, fore.y, fore.z]
    }

    /// Residual and Jacobian. Let q_r = A1 .. An, and w_i the axis of joint i in the torso frame at q. Then d q_r
    /// / d q_i = (0, w_i) q_r / 2. Hence d r / d q_i = (e_w w_i + w_i x e_v) / 2 for e = q_r q_h^-1.
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
        let (uw, uv) = error(&UnitQuaternion::new_unchecked(upper), &human.upper);
        let (fw, fv) = error(&UnitQuaternion::new_unchecked(fore), &human.fore);
        let mut jacobian = [[0.0; RESIDUALS]; ARM_Q];
        for (j, (column, axis)) in jacobian.iter_mut().zip(&axes).enumerate() {
            if j < 3 {
                let d = (axis * uw + axis.cross(&uv)) * 0.5;
                [column[0], column[1], column[2]] = [d.x, d.y, d.z];
            }
            let d = (axis * fw + axis.cross(&fv)) * 0.5;
            [column[3], column[4], column[5]] = [d.x, d.y, d.z];
        }
        Linearization { residual: [uv.x, uv.y, uv.z, fv.x, fv.y, fv.z], jacobian }
    }

    pub(crate) fn rotations(&self, q: &ArmQ) -> [Quaternion<f64>; ARM_Q] {
        std::array::from_fn(|j| {
            let (sin, cos) = (0.5 * (q[j] - self.reference[j])).sin_cos();
            let axis = &self.axes[j];
            Quaternion::new(cos, axis.x * sin, axis.y * sin, axis.z * sin)
        })
    }
}

fn mul(a: &Quaternion<f64>, b: &Quaternion<f64>) -> Quaternion<f64> {
    a * b
}

/// Rotates v by the unit quaternion q: v + 2 w (u x v) + 2 u x (u x v).
fn rotate(q: &Quaternion<f64>, v: &Vector3<f64>) -> Vector3<f64> {
    let u = Vector3::new(q.i, q.j, q.k);
    let t = u.cross(v) * 2.0;
    v + t * q.w + u.cross(&t)
}

/// (w, imag) of q_r q_h^-1 with w >= 0.
fn error(robot: &UnitQuaternion<f64>, human: &UnitQuaternion<f64>) -> (f64, Vector3<f64>) {
    let e = robot.quaternion() * human.quaternion().conjugate();
    let v = Vector3::new(e.i, e.j, e.k);
    if e.w < 0.0 { (-e.w, -v) } else { (e.w, v) }
}

/// S_GR between two pairs of limbs: sum of 1 - <q_h, q_r>^2. It is computed as |imag|^2, so small errors keep
/// their digits.
pub fn s_gr(robot: &Limbs, human: &Limbs) -> f64 {
    error(&robot.upper, &human.upper).1.norm_squared() + error(&robot.fore, &human.fore).1.norm_squared()
}

/// Rotation angles between robot and person, degrees: upper arm, forearm.
pub fn limb_error_deg(robot: &Limbs, human: &Limbs) -> [f64; 2] {
    let degrees = |r, h| {
        let (w, v) = error(r, h);
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

/// Mirrors a limb rotation at the plane between left and right: (x, y, z, w) -> (-x, y, -z, w). It turns a right
/// arm into a left arm and back.
pub fn mirror(limb: [f64; 4]) -> [f64; 4] {
    [-limb[0], limb[1], -limb[2], limb[3]]
}

/// Returns the rotation x y z w of the left (0) or the right (1) arm as that of a left one. `None` if it is no rotation.
pub(crate) fn rotation_of_arm(arm: usize, xyzw: [f64; 4]) -> Option<UnitQuaternion<f64>> {
    rotation_from_xyzw(if arm == 0 { xyzw } else { mirror(xyzw) })
}

/// Returns the rotation of a left arm as that of the left (0) or the right (1) arm, and the other way round.
pub(crate) fn on_side(arm: usize, rotation: &UnitQuaternion<f64>) -> UnitQuaternion<f64> {
    if arm == 0 { *rotation } else { mirrored(rotation) }
}

/// As [`mirror`], for a rotation.
pub(crate) fn mirrored(rotation: &UnitQuaternion<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::new_unchecked(Quaternion::new(rotation.w, -rotation.i, rotation.j, -rotation.k))
}

/// Largest deviation of a limb quaternion's squared norm from one. `ingest` normalises in f64, so a larger
/// deviation means no rotation.
const NORM_TOLERANCE: f64 = 1e-3;

/// Returns the rotation of x y z w. `None` if it is not finite or not of unit length.
pub fn rotation_from_xyzw(limb: [f64; 4]) -> Option<UnitQuaternion<f64>> {
    let squared: f64 = limb.iter().map(|c| c * c).sum();
    let unit = (squared - 1.0).abs() <= NORM_TOLERANCE;
    unit.then(|| UnitQuaternion::new_normalize(Quaternion::new(limb[3], limb[0], limb[1], limb[2])))
}

/// Returns x y z w of a rotation.
pub fn xyzw_from_rotation(rotation: &UnitQuaternion<f64>) -> [f64; 4] {
    let q = rotation.quaternion();
    [q.i, q.j, q.k, q.w]
}
