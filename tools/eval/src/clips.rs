//! Recorded motion as input of the methods: the selected clips of a folder, and the motion of both arms in
//! them.

use crate::error::EvalError;
use messages::{LIMBS, Limb, SMPL_JOINTS};
use motion::{CalibrationMode, Motion};
use nalgebra::{Quaternion, UnitQuaternion};
use retarget::{Limbs, mirror};
use std::fmt::Write;
use std::path::Path;
use train::clips::{VALIDATION_EVERY, is_validation, limb_frames, motion_files};

/// Both arms as left arms: the left one, and the right one mirrored at the plane between left and right.
pub type Human = [Limbs; 2];

/// One clip.
#[derive(Clone, Debug)]
pub struct Clip {
    /// File name without extension.
    pub name: String,
    /// Measured frames per second: the file's rate divided by the stride.
    pub rate_hz: f64,
    /// Limb rotations in the torso frame. Every method receives them.
    pub human: Vec<Human>,
    /// Rotation of the torso. The frame is upright and faces the person's heading in the clip's first frame.
    pub torso: Vec<UnitQuaternion<f64>>,
    /// Joint positions, m, x forward, y left, z up.
    pub positions: Vec<[[f32; 3]; SMPL_JOINTS]>,
}

/// A file that was not used, and the reason.
pub type Skipped = (String, String);

/// Selection of the measured clips of a folder.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Selection {
    /// Every fifth starting with the third, or all of them if there are fewer than five.
    Validation,
    /// All.
    All,
    /// The clips with these names.
    Named(Vec<String>),
}

impl Selection {
    /// Parses `all`, or names separated by commas. Without text it selects the validation clips.
    #[must_use]
    pub fn parse(text: Option<&str>) -> Self {
        match text {
            None => Self::Validation,
            Some("all") => Self::All,
            Some(names) => Self::Named(names.split(',').map(|name| name.trim().to_owned()).collect()),
        }
    }
}

/// Reads the clips of `folder`, sorted by name, reduced to every `stride`-th frame. Also returns (file, reason)
/// of those skipped.
///
/// # Errors
/// Returns an error if the folder cannot be listed, nothing in it can be used, or a named clip cannot be used.
pub fn read(
    folder: &Path,
    selection: &Selection,
    calibration: CalibrationMode,
    stride: usize,
) -> Result<(Vec<Clip>, Vec<Skipped>), EvalError> {
    let files = motion_files(folder)?;
    let stem = |file: &Path| file.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
    if let Selection::Named(names) = selection
        && let Some(name) = names.iter().find(|name| !files.iter().any(|file| stem(file) == **name))
    {
        let reason = format!("{} has no motion file of this name", folder.display());
        return Err(EvalError::Clip { name: name.clone(), reason });
    }
    let (mut clips, mut skipped) = (Vec::new(), Vec::new());
    for (index, file) in files.iter().enumerate() {
        let wanted = match selection {
            Selection::All => true,
            Selection::Validation => files.len() < VALIDATION_EVERY || is_validation(index),
            Selection::Named(names) => names.contains(&stem(file)),
        };
        if !wanted {
            continue;
        }
        let clip = motion::load(file).map_err(|error| error.to_string());
        match clip.and_then(|motion| clip_of(&motion, calibration, stride)) {
            Ok(clip) => clips.push(clip),
            Err(reason) if matches!(selection, Selection::Named(_)) => {
                return Err(EvalError::Clip { name: stem(file), reason });
            }
            Err(reason) => skipped.push((file.display().to_string(), reason)),
        }
    }
    if clips.is_empty() {
        let mut reasons = String::new();
        for (file, reason) in &skipped {
            // Writing to a String cannot fail.
            let _ = write!(reasons, "\n  {file}: {reason}");
        }
        return Err(EvalError::NoClips { folder: folder.to_path_buf(), found: files.len(), reasons });
    }
    Ok((clips, skipped))
}

/// Returns true if training leaves the measured clips of this folder out. Otherwise the measured clips may be
/// all that exist.
#[must_use]
pub fn has_training_clips(folder: &Path, selection: &Selection) -> bool {
    *selection == Selection::Validation && motion_files(folder).is_ok_and(|files| files.len() >= VALIDATION_EVERY)
}

/// Extracts the arms of a motion, every `stride`-th frame.
///
/// # Errors
/// Returns a sentence as error if the motion has no rotations (unless `calibration` is none), no frames, or
/// rotations that are not finite.
pub fn clip_of(motion: &Motion, calibration: CalibrationMode, stride: usize) -> Result<Clip, String> {
    if !motion.has_rotations && calibration != CalibrationMode::None {
        return Err(
            "has no rotations, so the twist of its limbs is unknown; --calibration none estimates it from the \
            elbow's plane"
                .into(),
        );
    }
    let frames = limb_frames(motion, calibration)?;
    let stride = stride.max(1);
    let positions: Vec<_> = motion.frames.iter().step_by(stride).map(|frame| frame.positions).collect();
    Ok(Clip {
        name: motion.name.clone(),
        rate_hz: motion.frame_rate_hz / stride as f64,
        human: frames.iter().step_by(stride).map(both_arms).collect(),
        torso: torso(&positions),
        positions,
    })
}

pub(crate) fn both_arms(limbs: &[[f32; 4]; LIMBS]) -> Human {
    let rotation = |limb: Limb, right: bool| {
        let q = limbs[limb as usize].map(f64::from);
        let [x, y, z, w] = if right { mirror(q) } else { q };
        UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z))
    };
    [
        Limbs { upper: rotation(Limb::LeftUpper, false), fore: rotation(Limb::LeftFore, false) },
        Limbs { upper: rotation(Limb::RightUpper, true), fore: rotation(Limb::RightFore, true) },
    ]
}

/// Returns torso rotations without the heading of the first frame. Where shoulders and hips coincide, the
/// previous rotation is kept.
fn torso(positions: &[[[f32; 3]; SMPL_JOINTS]]) -> Vec<UnitQuaternion<f64>> {
    let mut heading = None;
    let mut held = UnitQuaternion::identity();
    let rotation = |frame: &[[f32; 3]; SMPL_JOINTS]| {
        if let Some(matrix) = skeleton::torso_rotation(frame) {
            let yaw: f64 = *heading.get_or_insert_with(|| matrix[(1, 0)].atan2(matrix[(0, 0)]));
            held = UnitQuaternion::from_euler_angles(0.0, 0.0, -yaw) * UnitQuaternion::from_matrix(&matrix);
        }
        held
    };
    positions.iter().map(rotation).collect()
}

/// Returns the mirror image of a rotation at the plane between left and right.
fn mirrored(rotation: &UnitQuaternion<f64>) -> UnitQuaternion<f64> {
    let q = rotation.quaternion();
    UnitQuaternion::new_unchecked(Quaternion::new(q.w, -q.i, q.j, -q.k))
}

impl Clip {
    /// Returns the limb rotations in space, including the torso's own rotation, again with both arms as left
    /// arms. The robot's torso is upright and faces forward, so its limb rotations are the same in both frames.
    #[must_use]
    pub fn global(&self) -> Vec<Human> {
        let turned = |turn: &UnitQuaternion<f64>, arm: &Limbs| Limbs { upper: turn * arm.upper, fore: turn * arm.fore };
        let both = |(human, torso): (&Human, &UnitQuaternion<f64>)| {
            [turned(torso, &human[0]), turned(&mirrored(torso), &human[1])]
        };
        self.human.iter().zip(&self.torso).map(both).collect()
    }
}
