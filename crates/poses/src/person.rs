//! A standing person with given arms. Key poses are given by angles or by the position of the hand.

use messages::Smpl;
use motion::Frame;
pub use motion::{FOREARM_M, STATURE_M, UPPER_ARM_M, with_limbs};
use nalgebra::{Matrix3, UnitQuaternion, Vector3};

/// Distance from the wrist to the middle of the hand, m: half of a hand's length (Winter: 0.108 of the
/// stature). The hand is in line with the forearm.
pub const HAND_M: f64 = 0.054 * STATURE_M;

/// An arm's pose, degrees: forward swing and lowering of the upper arm from the T-pose, its roll about itself,
/// flexion of the elbow, pronation. A positive roll turns the forearm inwards when the arm hangs. The right arm
/// mirrors the left.
pub type ArmPose = [f64; 5];

/// Returns the rotations of a left arm's upper arm, forearm and hand, as differences from the T-pose. They are
/// U = Rz(-swing) Rx(-lower) Ry(roll), F = U Rz(-flexion), hand = F Ry(-pronation).
fn rotations(pose: &ArmPose) -> [UnitQuaternion<f64>; 3] {
    let [swing, lower, roll, flexion, pronation] = pose.map(f64::to_radians);
    let about = |axis, angle| UnitQuaternion::from_axis_angle(&axis, angle);
    let (x, y, z) = (Vector3::x_axis(), Vector3::y_axis(), Vector3::z_axis());
    let upper = about(z, -swing) * about(x, -lower) * about(y, roll);
    let fore = upper * about(z, -flexion);
    [upper, fore, fore * about(y, -pronation)]
}

/// Returns the pose of a left arm that brings the middle of the hand to `hand_m`. The position is relative to the
/// middle between the shoulders. x points forward, y away from the middle of the body to the arm's own side, z up.
/// `swivel_deg` turns the elbow about the line from shoulder to hand. It turns from below (0) outwards (90, if that
/// line points forward). A hand out of reach is brought as near as a flexion of 2 degrees allows.
pub fn reach(hand_m: [f64; 3], swivel_deg: f64, pronation_deg: f64) -> ArmPose {
    let shoulder = Vector3::new(0.0, SHOULDER_M, 0.0);
    let (upper_length, fore_length) = (UPPER_ARM_M, FOREARM_M + HAND_M);
    let to_hand = Vector3::from(hand_m) - shoulder;
    let along = to_hand.normalize();
    let straight =
        (upper_length.powi(2) + fore_length.powi(2) + 2.0 * upper_length * fore_length * 2_f64.to_radians().cos())
            .sqrt();
    let distance = to_hand.norm().clamp((upper_length - fore_length).abs() + 1e-3, straight);
    // If the line from shoulder to hand is vertical, "below" has no direction on it. Then the front is used.
    let below = -Vector3::z() + Vector3::x() * 1e-3;
    let below = (below - along * along.dot(&below)).normalize();
    let outwards = along.cross(&below);
    let (sin, cos) = swivel_deg.to_radians().sin_cos();
    let foot = (distance * distance + upper_length.powi(2) - fore_length.powi(2)) / (2.0 * distance);
    let height = (upper_length.powi(2) - foot * foot).max(0.0).sqrt();
    let elbow = along * foot + (below * cos + outwards * sin) * height;
    let upper = elbow.normalize();
    let fore = (along * distance - elbow).normalize();
    // The bone is along y and the hinge against z. So flexion is a positive turn about the hinge.
    let z = -upper.cross(&fore).normalize();
    let rotation = Matrix3::from_columns(&[upper.cross(&z), upper, z]);
    let (swing, lower) = (upper.x.atan2(upper.y), (-upper.z).asin());
    let [unrolled, ..] = rotations(&[swing.to_degrees(), lower.to_degrees(), 0.0, 0.0, 0.0]);
    let x = unrolled.inverse() * rotation.column(0);
    let roll = (-x.z).atan2(x.x);
    let flexion = upper.angle(&fore);
    [swing.to_degrees(), lower.to_degrees(), roll.to_degrees(), flexion.to_degrees(), pronation_deg]
}

/// Half of the distance between the shoulders of the built-in motion's person, m.
const SHOULDER_M: f64 = 0.105 * STATURE_M;

/// Returns `frame` with its arms replaced by these, left and right.
pub fn with_arms(frame: &Frame, arms: &[ArmPose; 2]) -> Frame {
    with_limbs(frame, &arms.each_ref().map(rotations))
}

/// Returns the middle of the left and of the right hand, m, in the frame of the positions.
pub fn hands(frame: &Frame) -> [Vector3<f64>; 2] {
    let at = |joint: Smpl| Vector3::from(frame.positions[joint as usize]).cast::<f64>();
    [[Smpl::LeftElbow, Smpl::LeftWrist], [Smpl::RightElbow, Smpl::RightWrist]].map(|[elbow, wrist]| {
        let fore = at(wrist) - at(elbow);
        at(wrist) + fore * (HAND_M / FOREARM_M)
    })
}

/// Returns the middle of the head, m: 0.935 of the stature above the ground, half way from chin to crown
/// (Winter: 0.870 and 1).
pub fn head(frame: &Frame) -> Vector3<f64> {
    let neck = Vector3::from(frame.positions[Smpl::Head as usize]).cast::<f64>();
    neck + Vector3::z() * ((0.935 - 0.91) * STATURE_M)
}

/// Returns a person in T-pose with the trunk and legs of the built-in motion.
pub fn standing() -> Frame {
    let zero = Frame::ZERO;
    let trunk = motion::builtin().frames.first().copied().unwrap_or(zero);
    with_arms(&Frame { rotations: zero.rotations, ..trunk }, &[[0.0; 5]; 2])
}
