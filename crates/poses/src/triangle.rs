//! Three key poses as the corners of a triangle. Every point of it gives a person whose limbs turn like the robot's.

use crate::error::PosesError;
use crate::keys::Keys;
use crate::motions::sway;
use crate::person::standing;
use crate::pose::read_pose;
use crate::trajectory::person;
use messages::{HingeCalibration, RawSkeleton};
use motion::{CalibrationMode, Frame, LoadOptions, Motion};
use retarget::{ARMS, ArmQ, Network};
use robot::Model;

/// Levenberg-Marquardt steps that move the corners toward the human's limbs: as many as in `replay
/// keyposes interpolate`.
const REFINE_STEPS: u32 = 2;

/// Three key poses of ours that are well apart. Every mixture of them keeps the robot free of self-collision.
pub const POSES: [&str; 3] = ["t-pose", "hands-up", "box"];

/// Three key poses and the space between them.
#[derive(Clone, Debug)]
pub struct Triangle {
    names: [String; 3],
    keys: Keys,
    standing: Frame,
    /// A motion of one frame, which every point replaces.
    motion: Motion,
    calibration: HingeCalibration,
}

impl Triangle {
    /// Creates the triangle of exactly three poses, as [`read_pose`] takes them. Hinges of files are calibrated
    /// over their first 10 s.
    pub fn new(model: &Model, network: &Network, poses: &[String]) -> Result<Self, PosesError> {
        let names: &[String; 3] = poses.try_into().map_err(|_| {
            let reason = format!("{} poses; a triangle needs 3", poses.len());
            PosesError::Pose { text: poses.join(","), reason }
        })?;
        let load = LoadOptions::default();
        let limbs = poses
            .iter()
            .map(|text| read_pose(text, CalibrationMode::First10s, &load))
            .collect::<Result<Vec<_>, _>>()?;
        let standing = standing();
        let motion = Motion::generated(&poses.join(","), crate::motions::RATE_HZ, vec![standing]);
        let calibration = motion::calibrate(&motion, CalibrationMode::Rig);
        let keys = Keys::new(model, network, &limbs, REFINE_STEPS);
        Ok(Self { names: names.clone(), keys, standing, motion, calibration })
    }

    /// Returns the names of the poses.
    pub fn names(&self) -> &[String; 3] {
        &self.names
    }

    /// Returns the decoded joint positions 1 to 5 of the left and of the right arm, rad: see
    /// [`Keys::mix_latent`].
    pub fn q(&self, shares: &[f64; 3]) -> [ArmQ; ARMS] {
        self.keys.mix_latent(shares)
    }

    /// Returns the standing person of [`Self::q`] as a client publishes it, `at_s` after its start, with its
    /// own hinges. Header, session and operator are zero, and the caller sets them.
    pub fn raw(&self, shares: &[f64; 3], at_s: f64) -> RawSkeleton {
        let mut frame = person(self.keys.arms(), &self.standing, &self.q(shares));
        sway(&mut frame, at_s);
        let motion = Motion { frames: vec![frame], ..self.motion.clone() };
        motion::raw_frame(&motion, 0, &self.calibration)
    }
}
