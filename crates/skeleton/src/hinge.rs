//! Where the elbow's axis lies in the frames of the joints that carry it, estimated from a person's own movements.

use crate::geometry::{rotate_back, unit, vector};
use crate::limbs::ARMS;
use messages::{HingeCalibration, LIMBS, Layout, Limb, SMPL_JOINTS, calibration_flag};
use nalgebra::{Matrix3, Vector3};

/// Flexions below this one say nothing about the axis (10 degrees, twice the noise bound of a straight elbow).
const FLEXED_SIN: f64 = 0.174;
/// Flexed frames below which there is no estimate: half a second at 20 Hz, the slowest source.
const SAMPLES_MIN: u32 = 10;
/// Mean resultant length below which the shoulder's rotation does not carry the hinge. 0.9999 on every CMU clip; a
/// rotation without the twist falls to 0.9 at 25 degrees of spread.
const UPPER_SPREAD_MIN: f64 = 0.9;
/// The same for the hand, which pronates: 0.36 for a pronation uniform over 250 degrees.
const FORE_SPREAD_MIN: f64 = 0.3;

/// Estimates a [`HingeCalibration`] from frames, in their order and of fixed size, so that any prefix gives the causal
/// estimate of that moment.
///
/// Upper arm: h_u = unit(sum of R_s^T (u x f)), the normals of the elbow's plane, weighted by sin(flexion), in the frame of
/// the shoulder joint's rotation R_s; u and f are the bones. The sign is that of flexion by construction.
/// Forearm: h_w = unit(sum of R_w^T (I - f f^T) R_s h_u): the same hinge seen from the hand, R_w, averaged over every frame,
/// so that the middle of a person's pronation counts as none and both ends stay within a robot's range.
#[derive(Clone, Copy, Debug)]
pub struct Calibrator {
    arms: [Arm; 2],
    frames: u32,
}

#[derive(Clone, Copy, Debug)]
struct Arm {
    upper: Vector3<f64>,
    upper_weight: f64,
    hand_from_shoulder: Matrix3<f64>,
    samples: u32,
    frames: u32,
}

impl Default for Calibrator {
    fn default() -> Self {
        Self::new()
    }
}

impl Calibrator {
    /// An estimate that rests on no frame yet.
    pub fn new() -> Self {
        let arm = Arm {
            upper: Vector3::zeros(),
            upper_weight: 0.0,
            hand_from_shoulder: Matrix3::zeros(),
            samples: 0,
            frames: 0,
        };
        Self { arms: [arm; 2], frames: 0 }
    }

    /// Frames added so far.
    pub fn frames(&self) -> u32 {
        self.frames
    }

    /// Adds a frame: positions in m, global rotations x y z w, both in any one right-handed frame. Frames that are not
    /// finite or have no rotations are ignored.
    pub fn add(&mut self, positions: &[[f32; 3]; SMPL_JOINTS], rotations: &[[f32; 4]; SMPL_JOINTS]) {
        self.frames = self.frames.saturating_add(1);
        for (arm, joints) in self.arms.iter_mut().zip(ARMS) {
            // A frame that cannot be used adds nothing.
            let _ = arm.add(joints, positions, rotations);
        }
    }

    /// The estimate of everything added so far; a hinge that the frames do not determine is not flagged valid.
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
        // Column i of R_w^T (I - f f^T) R_s, where R_s e_i is what the shoulder's rotation does to axis i.
        for (i, column) in columns.iter_mut().enumerate() {
            let axis = crate::geometry::rotate(rotations[shoulder], Vector3::ith(i, 1.0))?;
            *column = rotate_back(rotations[wrist], axis - fore * fore.dot(&axis))?;
        }
        let normal = upper.cross(&fore);
        let local = rotate_back(rotations[shoulder], normal)?;
        self.hand_from_shoulder += Matrix3::from_columns(&columns);
        self.frames = self.frames.saturating_add(1);
        if normal.norm() > FLEXED_SIN {
            self.upper += local;
            self.upper_weight += normal.norm();
            self.samples = self.samples.saturating_add(1);
        }
        Some(())
    }

    fn upper_hinge(&self) -> Option<Vector3<f64>> {
        let enough = self.samples >= SAMPLES_MIN && self.upper.norm() >= UPPER_SPREAD_MIN * self.upper_weight;
        if enough { unit(self.upper) } else { None }
    }

    fn fore_hinge(&self, upper_hinge: Vector3<f64>) -> Option<Vector3<f64>> {
        let sum = self.hand_from_shoulder * upper_hinge;
        if sum.norm() >= FORE_SPREAD_MIN * f64::from(self.frames) { unit(sum) } else { None }
    }
}
