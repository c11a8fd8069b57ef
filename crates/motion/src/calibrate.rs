//! Turns a motion into client data: hinge calibration, limb rotations, raw frames.

use crate::{Frame, Motion};
use messages::{
    HingeCalibration, LIMBS, Layout, RAW_JOINTS_MAX, RawSkeleton, SMPL_JOINTS, SkeletonLayout, calibration_flag,
    raw_flag, skeleton_flag, with_closure,
};
use skeleton::{Calibrator, Hold, LimbFrames, limbs_from_positions_rotations};

messages::named! {
    /// Frames from which the hinges are estimated.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum CalibrationMode {
        /// The first 10 s of motion, or the whole clip if it is shorter. A live operator can provide this.
        First10s => "first-10s",
        /// The whole clip. It looks ahead, so use it for figures only.
        Clip => "clip",
        /// No hinges. The current elbow plane is used, and the hinges that `ingest` learns while the motion plays.
        None => "none",
        /// The rig's own hinges. Only for rigs whose joints have no rotation in the T-pose, palms down, such as this
        /// project's own motions. The hinge is -z of the left, +z of the right shoulder and wrist.
        Rig => "rig",
    }
}

impl CalibrationMode {
    /// Returns the mode of this name if it is one of `allowed`. For command lines.
    pub fn among(text: &str, allowed: &[Self]) -> Result<Self, String> {
        let found = allowed.iter().copied().find(|mode| mode.name() == text);
        found.ok_or_else(|| {
            format!("must be one of {}", allowed.iter().map(|mode| mode.name()).collect::<Vec<_>>().join(", "))
        })
    }
}

/// Estimates the hinges of a motion. None is valid if the motion has no rotations or never flexes an elbow.
pub fn calibrate(motion: &Motion, mode: CalibrationMode) -> HingeCalibration {
    let frames = match mode {
        CalibrationMode::Clip => motion.frames.len(),
        CalibrationMode::First10s => (10.0 * motion.frame_rate_hz).round() as usize,
        CalibrationMode::None | CalibrationMode::Rig => 0,
    };
    if !motion.has_rotations {
        return HingeCalibration::ZERO;
    }
    if mode == CalibrationMode::Rig {
        let mut rig = HingeCalibration { flags: calibration_flag::ALL, ..HingeCalibration::ZERO };
        let (left, right) = ([0.0, 0.0, -1.0], [0.0, 0.0, 1.0]);
        rig.hinge[..2].copy_from_slice(&[left; 2]);
        rig.hinge[2..4].copy_from_slice(&[right; 2]);
        return rig;
    }
    let mut calibrator = Calibrator::default();
    for frame in motion.frames.iter().take(frames) {
        calibrator.add(&frame.positions, &frame.rotations, frame.seen());
    }
    calibrator.estimate()
}

/// Returns the four limb rotations of every frame, x y z w, in the order of `messages::Limb`. They are
/// differences from the T-pose in the torso frame. The code is that of the live stage. A limb that is not seen, or has no
/// direction, keeps its rotation. Before its first one it has that, and the identity without one.
pub fn limbs(motion: &Motion, calibration: &HingeCalibration) -> Vec<[[f32; 4]; LIMBS]> {
    let mut hold = Hold::default();
    let limbs = |frame: &Frame| {
        let rotations = motion.has_rotations.then_some(&frame.rotations);
        limbs_from_positions_rotations(&frame.positions, rotations, calibration, frame.seen(), &mut hold)
    };
    let mut all: Vec<_> = motion.frames.iter().map(limbs).collect();
    for (limb, flag) in skeleton_flag::LIMB.into_iter().enumerate() {
        let first = all.iter().find(|frame| frame.flags & flag != 0);
        let mut kept = first.map_or(LimbFrames::NONE.rotations[limb], |frame| frame.rotations[limb]);
        for frame in &mut all {
            kept = if frame.flags & flag != 0 { frame.rotations[limb] } else { kept };
            frame.rotations[limb] = kept;
        }
    }
    all.into_iter().map(|frame| frame.rotations).collect()
}

/// Returns frame `i` (modulo the length) as a client publishes it, with full confidence. Header, session nonce
/// and operator id stay zero, and the caller sets them. A motion without frames gives joints at zero.
pub fn raw_frame(motion: &Motion, i: usize, calibration: &HingeCalibration) -> RawSkeleton {
    let mut raw = RawSkeleton::ZERO;
    raw.layout = SkeletonLayout::Smpl22 as u32;
    raw.joint_count = SMPL_JOINTS as u32;
    raw.flags = if motion.has_rotations { raw_flag::ROTATIONS } else { 0 };
    raw.rotations = [[0.0, 0.0, 0.0, 1.0]; RAW_JOINTS_MAX];
    raw.calibration = *calibration;
    if motion.frames.is_empty() {
        return raw;
    }
    let frame = &motion.frames[i % motion.frames.len()];
    raw.flags = with_closure(raw.flags, frame.closure);
    raw.positions[..SMPL_JOINTS].copy_from_slice(&frame.positions);
    raw.rotations[..SMPL_JOINTS].copy_from_slice(&frame.rotations);
    raw.confidence[..SMPL_JOINTS].fill(1.0);
    raw
}
