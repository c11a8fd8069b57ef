//! One arm with two limb rotations: kinematics, and the rotation from the person's limbs to the robot's.

use crate::LIMB_JOINTS;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use robot::limbs::{axis_rotation, place_on_side, rotate, rotation_error};
use robot::{Frames, Model};

pub use robot::Limbs;

/// Positions, velocities or accelerations of the joints that turn the limbs of one arm, by slot. Zero in an empty one.
pub type ArmVector = nalgebra::SVector<f64, LIMB_JOINTS>;

/// Rows of an error: three for the upper arm, three for the forearm.
pub const ROWS: usize = 6;

/// Up to five revolute joints that turn two limbs. Slots 1 to 3 turn the upper arm, 4 and 5 the forearm.
#[derive(Clone, Debug, PartialEq)]
pub struct Arm {
    /// Unit axis of each joint in the torso frame while the arm is at `reference`.
    axes: [Vector3<f64>; LIMB_JOINTS],
    /// Joint positions of the T-pose, rad.
    reference: [f64; LIMB_JOINTS],
    /// From the origin of each joint to that of the next one, while the arm is at `reference`, torso frame, m. The last one ends in
    /// the middle of the hand, with the wrist at home.
    links_m: [Vector3<f64>; LIMB_JOINTS],
    /// The limbs, upper arm and forearm, that can turn about their own length. The others are matched by their direction.
    rolls: [bool; 2],
}

/// Error of the robot's limbs, and its derivative by the joints.
#[derive(Clone, Copy, Debug)]
pub struct Error {
    /// log(R_robot R_person^-1) of both limbs, torso frame, rad.
    pub rotation: [f64; ROWS],
    /// Column j: derivative by joint j.
    pub jacobian: [[f64; ROWS]; LIMB_JOINTS],
}

impl Arm {
    /// Creates an arm from unit axes in the torso frame at the reference posture (rad). `links_m`: from each joint to the next
    /// one, and from the last one to the middle of the hand, in that frame and posture, m.
    pub fn new(
        axes: [Vector3<f64>; LIMB_JOINTS],
        reference: [f64; LIMB_JOINTS],
        links_m: [Vector3<f64>; LIMB_JOINTS],
    ) -> Self {
        let axes = axes.map(|axis| axis.try_normalize(0.0).unwrap_or_default());
        let rolls = [2, 4].map(|slot: usize| axes[slot] != Vector3::zeros());
        Self { axes, reference, links_m, rolls }
    }

    /// Takes the left (0) or the right arm (1) of `model`. A right arm is taken as the left arm that mirrors it, in the
    /// right arm's own joint positions: an axis of the sign -1 points the other way.
    pub fn from_model(model: &Model, side: usize) -> Self {
        let (left, arm, measured) = (model.as_left(side), &model.arms[side], model.measured_side(side));
        let mut frames = Frames::default();
        model.forward(&model.t_pose(), &mut frames);
        let origins = model.limb_places(&frames, measured);
        let torso_from_base = model.base_from_torso(&frames).transpose();
        let link = |j: usize| place_on_side(measured, torso_from_base * (origins[j + 1] - origins[j]));
        let links_m = std::array::from_fn(link);
        Self::new(std::array::from_fn(|j| left.axes[j] * arm.signs[j]), arm.reference, links_m)
    }

    /// Rotations of the limbs: U = R1 R2 R3 and F = U R4 R5 with Ri = Rot(axis i, q i - reference i).
    pub fn limbs(&self, q: &ArmVector) -> Limbs {
        let turn = |j: usize| self.turn(j, q);
        let upper = turn(0) * turn(1) * turn(2);
        let fore = upper * turn(3) * turn(4);
        Limbs { upper: UnitQuaternion::new_unchecked(upper), fore: UnitQuaternion::new_unchecked(fore) }
    }

    /// Angles between the robot's limbs at `q` and the person's, rad: upper arm, forearm.
    pub fn angles(&self, q: &ArmVector, person: &Limbs) -> [f64; 2] {
        let robot = self.limbs(q);
        robot.angles(&robot.target(person, self.rolls))
    }

    /// Errors of both limbs with their Jacobian. Let w_j be the axis of joint j in the torso frame. Then d log(R
    /// P^-1) / d q_j = J_l^-1(log) w_j, with J_l the left Jacobian of SO(3) (Sola, Deray, Atchuthan 2018, equation
    /// 146). Of a limb that cannot roll, w_j is taken across the limb, and the person's limb is that of [`Limbs::target`].
    pub fn error(&self, q: &ArmVector, person: &Limbs) -> Error {
        let turns: [_; LIMB_JOINTS] = std::array::from_fn(|j| self.turn(j, q));
        let mut so_far = Quaternion::identity();
        let mut upper = so_far;
        let axes: [_; LIMB_JOINTS] = std::array::from_fn(|j| {
            let axis = rotate(&so_far, &self.axes[j]);
            so_far *= turns[j];
            if j == 2 {
                upper = so_far;
            }
            axis
        });
        let mut error = Error { rotation: [0.0; ROWS], jacobian: [[0.0; ROWS]; LIMB_JOINTS] };
        let robot = Limbs { upper: UnitQuaternion::new_unchecked(upper), fore: UnitQuaternion::new_unchecked(so_far) };
        let person = robot.target(person, self.rolls);
        let directions = if self.rolls == [true; 2] { [Vector3::zeros(); 2] } else { robot.directions() };
        let limbs = [(robot.upper, person.upper, 3), (robot.fore, person.fore, LIMB_JOINTS)];
        for (limb, (robot, person, joints)) in limbs.into_iter().enumerate() {
            let (w, v) = rotation_error(&robot, &person);
            let sine = v.norm();
            let half = sine.atan2(w);
            // Below 1e-6 the logarithm is twice the vector, and its Jacobian is the identity, to 1e-12.
            let (rotation, direction, c) = if sine < 1e-6 {
                (v * 2.0, Vector3::zeros(), 1.0)
            } else {
                (v * (2.0 * half / sine), v / sine, half * w / sine)
            };
            error.rotation[3 * limb..3 * limb + 3].copy_from_slice(rotation.as_slice());
            for j in 0..joints {
                let along =
                    if self.rolls[limb] { Vector3::zeros() } else { directions[limb] * directions[limb].dot(&axes[j]) };
                let axis = axes[j] - along;
                let column = axis * c + direction * ((1.0 - c) * direction.dot(&axis)) - rotation.cross(&axis) * 0.5;
                error.jacobian[j][3 * limb..3 * limb + 3].copy_from_slice(column.as_slice());
            }
        }
        error
    }

    /// Place of the middle of the hand with the wrist at home, torso frame, from the origin of the first joint, m: the sum of the
    /// links, each turned by the joints before it.
    pub fn hand_center(&self, q: &ArmVector) -> Vector3<f64> {
        let (mut so_far, mut at) = (Quaternion::identity(), Vector3::zeros());
        for j in 0..LIMB_JOINTS {
            so_far *= self.turn(j, q);
            at += rotate(&so_far, &self.links_m[j]);
        }
        at
    }

    /// That place, and its derivative by each joint, m/rad: w_j x (hand - c_j) for the axis w_j of joint j through c_j.
    pub fn hand_jacobian(&self, q: &ArmVector) -> (Vector3<f64>, [Vector3<f64>; LIMB_JOINTS]) {
        let (mut so_far, mut at) = (Quaternion::identity(), Vector3::zeros());
        let turned: [_; LIMB_JOINTS] = std::array::from_fn(|j| {
            let (axis, origin) = (rotate(&so_far, &self.axes[j]), at);
            so_far *= self.turn(j, q);
            at += rotate(&so_far, &self.links_m[j]);
            (axis, origin)
        });
        (at, turned.map(|(axis, origin)| axis.cross(&(at - origin))))
    }

    fn turn(&self, j: usize, q: &ArmVector) -> Quaternion<f64> {
        axis_rotation(&self.axes[j], q[j] - self.reference[j])
    }
}
