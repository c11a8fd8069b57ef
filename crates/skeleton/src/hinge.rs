//! Estimates the elbow's axis in the frames of the joints that carry it, from a person's own movements.

use crate::geometry::{rotate_back, unit, vector};
use crate::limbs::ARMS;
use messages::{HingeCalibration, LIMBS, Layout, Limb, SMPL_JOINTS, calibration_flag};
use nalgebra::{Matrix3, Vector3};

/// Smallest flexion that is used: 10 degrees, twice the noise bound of a straight elbow. A smaller one does not
/// show the axis.
const FLEXED_SIN: f64 = 0.174;
/// Smallest number of flexed frames for an estimate: half a second at 20 Hz, the slowest source.
const SAMPLES_MIN: f64 = 10.0;
/// Mean resultant length below which the shoulder's rotation does not carry the hinge. It is 0.9999 on every CMU
/// clip. A rotation without the twist falls to 0.9 at 25 degrees of spread.
const UPPER_SPREAD_MIN: f64 = 0.9;
/// The same for the hand, which pronates: 0.36 for a pronation uniform over 250 degrees.
const FORE_SPREAD_MIN: f64 = 0.3;
/// Largest spread of the bone in the frame of the shoulder's rotation, as a share of its spread in the world.
/// Above it the rotation does not move with the arm. For a rig the share is zero. For a client that flags
/// rotations without filling them, it is one.
const BONE_SHARE_MAX: f64 = 0.2;
/// Mean resultant length below which the hand's rotation does not show the direction of a straight hand: a hand that
/// turns evenly over 120 degrees. Assumption.
const HAND_SPREAD_MIN: f64 = 0.8;
/// Spread of the bone in the world, as 1 less the mean resultant length. Below this value, 3.6 degrees RMS, the
/// arm has not moved enough for a decision.
const BONE_MOVED_MIN: f64 = 0.002;

/// Estimates a [`HingeCalibration`] from frames in their order. It has a fixed size. Any prefix of the frames
/// gives the causal estimate of that moment.
///
/// Upper arm: h_u = unit(sum of R_s^T (u x f)). These are the normals of the elbow's plane, weighted by
/// sin(flexion), in the frame of the shoulder joint's rotation R_s. u and f are the bones. By construction the
/// sign is that of flexion. Forearm: h_w = unit(sum of R_w^T (I - f f^T) R_s h_u). This is the same hinge in the
/// frame of the hand, R_w, averaged over all frames. So the middle of a person's pronation counts as none, and
/// both ends stay within a robot's range.
#[derive(Clone, Copy, Debug, Default)]
pub struct Calibrator {
    arms: [Arm; 2],
    frames: u32,
}

#[derive(Clone, Copy, Debug, Default)]
struct Arm {
    upper: Vector3<f64>,
    upper_weight: f64,
    /// Sum of the bone's directions in the shoulder's frame, and in the world.
    bone: [Vector3<f64>; 2],
    hand_from_shoulder: Matrix3<f64>,
    /// Sum of the forearm's directions in the hand's frame.
    hand: Vector3<f64>,
    /// Number of flexed frames, and the fading numbers of flexed frames and of all frames in the sums.
    samples: u32,
    flexed: f64,
    frames: f64,
}

impl Calibrator {
    /// Number of frames added so far.
    pub fn frames(&self) -> u32 {
        self.frames
    }

    /// Adds a frame: positions in m, global rotations x y z w, both in any one right-handed frame. It ignores
    /// joints whose bit in `usable` is clear, numbers that are not finite, and quaternions that are no rotations.
    pub fn add(&mut self, positions: &[[f32; 3]; SMPL_JOINTS], rotations: &[[f32; 4]; SMPL_JOINTS], usable: u32) {
        self.frames = self.frames.saturating_add(1);
        for (arm, joints) in self.arms.iter_mut().zip(ARMS) {
            if joints.iter().all(|joint| usable & (1 << joint) != 0) {
                // A frame that cannot be used adds nothing.
                let _ = arm.add(joints, positions, rotations);
            }
        }
    }

    /// Scales the weight of everything added so far by `share`.
    pub(crate) fn fade(&mut self, share: f64) {
        for arm in &mut self.arms {
            arm.upper *= share;
            arm.bone = arm.bone.map(|sum| sum * share);
            arm.hand_from_shoulder *= share;
            arm.hand *= share;
            for sum in [&mut arm.upper_weight, &mut arm.flexed, &mut arm.frames] {
                *sum *= share;
            }
        }
    }

    /// Returns for the left and the right arm whether it moved and its rotations moved with it. A file's rotations
    /// are known to do so. Those of a new client are not.
    pub(crate) fn carried(&self) -> [bool; 2] {
        self.arms.map(|arm| arm.is_carried())
    }

    /// Returns the direction in which the left and the right hand point in their own frames, unit vectors. It is the
    /// forearm's, averaged over all frames. So the middle of a wrist's bends counts as straight.
    pub(crate) fn hands(&self) -> [Option<Vector3<f64>>; 2] {
        self.arms.map(|arm| {
            let shown = arm.frames >= SAMPLES_MIN && arm.hand.norm() >= HAND_SPREAD_MIN * arm.frames;
            if shown && arm.is_carried() { unit(arm.hand) } else { None }
        })
    }

    /// Returns the estimate of everything added so far. A hinge that the frames do not determine is not flagged valid.
    pub fn estimate(&self) -> HingeCalibration {
        let mut out = HingeCalibration::ZERO;
        let limbs = [[Limb::LeftUpper, Limb::LeftFore], [Limb::RightUpper, Limb::RightFore]];
        out.samples = self.arms[0].samples.min(self.arms[1].samples);
        for (arm, [upper, fore]) in self.arms.iter().zip(limbs) {
            let Some(hinge) = arm.upper_hinge() else { continue };
            set(&mut out, upper as usize, hinge);
            if let Some(hinge) = arm.fore_hinge(hinge) {
                set(&mut out, fore as usize, hinge);
            }
        }
        out
    }
}

fn set(out: &mut HingeCalibration, limb: usize, hinge: Vector3<f64>) {
    debug_assert!(limb < LIMBS);
    out.hinge[limb] = [hinge.x as f32, hinge.y as f32, hinge.z as f32];
    out.flags |= calibration_flag::LIMB[limb];
}

impl Arm {
    fn add(
        &mut self,
        [shoulder, elbow, wrist]: [usize; 3],
        positions: &[[f32; 3]; SMPL_JOINTS],
        rotations: &[[f32; 4]; SMPL_JOINTS],
    ) -> Option<()> {
        let at = |joint: usize| vector(positions[joint]);
        let upper = unit(at(elbow) - at(shoulder))?;
        let fore = unit(at(wrist) - at(elbow))?;
        let mut columns = [Vector3::zeros(); 3];
        // Column i of R_w^T (I - f f^T) R_s. R_s e_i is axis i, turned by the shoulder's rotation.
        for (i, column) in columns.iter_mut().enumerate() {
            let axis = crate::geometry::rotate(rotations[shoulder], Vector3::ith(i, 1.0))?;
            *column = rotate_back(rotations[wrist], axis - fore * fore.dot(&axis))?;
        }
        let normal = upper.cross(&fore);
        let local = rotate_back(rotations[shoulder], normal)?;
        self.bone[0] += rotate_back(rotations[shoulder], upper)?;
        self.bone[1] += upper;
        let hand = rotate_back(rotations[wrist], fore)?;
        self.hand_from_shoulder += Matrix3::from_columns(&columns);
        self.hand += hand;
        self.frames += 1.0;
        if normal.norm() > FLEXED_SIN {
            self.upper += local;
            self.upper_weight += normal.norm();
            self.samples = self.samples.saturating_add(1);
            self.flexed += 1.0;
        }
        Some(())
    }

    /// Returns true if the bone moved with the shoulder's rotation.
    fn is_carried(&self) -> bool {
        let [seen, moved] = self.bone.map(|sum| 1.0 - sum.norm() / self.frames);
        moved >= BONE_MOVED_MIN && seen <= BONE_SHARE_MAX * moved
    }

    fn upper_hinge(&self) -> Option<Vector3<f64>> {
        let enough = self.flexed >= SAMPLES_MIN && self.upper.norm() >= UPPER_SPREAD_MIN * self.upper_weight;
        if enough { unit(self.upper) } else { None }
    }

    fn fore_hinge(&self, upper_hinge: Vector3<f64>) -> Option<Vector3<f64>> {
        let sum = self.hand_from_shoulder * upper_hinge;
        if sum.norm() >= FORE_SPREAD_MIN * self.frames { unit(sum) } else { None }
    }
}
