//! Three key poses as the corners of a triangle: for every point of it the person whose limbs turn as the robot's would.

use crate::error::KeyposesError;
use crate::keys::Keys;
use crate::motions::{guesses, sway};
use crate::person::standing;
use crate::pose::read_pose;
use crate::trajectory::person;
use messages::{HingeCalibration, RawSkeleton};
use motion::{CalibrationMode, Frame, Motion};
use retarget::{ARMS, ArmQ, Network};
use robot::Model;

/// Levenberg-Marquardt steps of the corners toward the human's limbs: as many as `keyposes interpolate` takes.
const REFINE_STEPS: u32 = 2;

/// Three key poses of ours that are well apart, and of which every mix keeps the robot clear of itself.
pub const POSES: [&str; 3] = ["t-pose", "hands-up", "box"];

/// Three key poses and what lies between them.
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
    /// The triangle of exactly three poses, as [`read_pose`] takes them; hinges of files are calibrated over their first
    /// 10 s.
    ///
    /// # Errors
    /// Not three poses; a pose that is none, and what is allowed; a file that is refused.
    pub fn of(model: &Model, network: &Network, poses: &[String]) -> Result<Self, KeyposesError> {
        let names: &[String; 3] = poses.try_into().map_err(|_| {
            let reason = format!("{} poses, not the 3 that are the corners of a triangle", poses.len());
            KeyposesError::Pose { text: poses.join(","), reason }
        })?;
        let limbs =
            poses.iter().map(|text| read_pose(text, CalibrationMode::First10s)).collect::<Result<Vec<_>, _>>()?;
        let standing = standing();
        let motion = Motion {
            name: poses.join(","),
            frame_rate_hz: crate::motions::RATE_HZ,
            frames: vec![standing],
            first: None,
            has_rotations: true,
            guesses: guesses(),
        };
        let calibration = motion::calibrate(&motion, CalibrationMode::Rig);
        let keys = Keys::new(model, network, &limbs, REFINE_STEPS);
        Ok(Self { names: names.clone(), keys, standing, motion, calibration })
    }

    /// The poses as they were named.
    pub fn names(&self) -> &[String; 3] {
        &self.names
    }

    /// Joint positions 1 to 5 of the left and of the right arm, rad, that the mix decodes to: see [`Keys::mix_latent`].
    pub fn q(&self, shares: &[f64; 3]) -> [ArmQ; ARMS] {
        self.keys.mix_latent(shares)
    }

    /// The standing person of [`Self::q`] as a client publishes it `at_s` into its life, with its own hinges; header, session
    /// and operator are left zero for the caller.
    pub fn raw(&self, shares: &[f64; 3], at_s: f64) -> RawSkeleton {
        let mut frame = person(self.keys.arm(), &self.standing, &self.q(shares));
        sway(&mut frame, at_s);
        let motion = Motion { frames: vec![frame], ..self.motion.clone() };
        motion::raw_frame(&motion, 0, &self.calibration)
    }
}
