//! Recorded motion as input of the methods: the selected clips of a folder, and the motion of both arms in
//! them.

use messages::SMPL_JOINTS;
use motion::{CalibrationMode, Motion};
use nalgebra::UnitQuaternion;
use retarget::Limbs;
use rt::{Exit, Failure};
use std::path::{Path, PathBuf};
use train::clips::{VALIDATION_EVERY, is_validation, limb_frames, motion_files};
use train::evaluation::turned;

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

/// The failure of a clip that `--clips` names.
fn unusable_clip(name: &str, reason: String) -> Failure {
    Failure::new(Exit::Usage, format!("--clips names {name}: {reason}"))
}

/// Returns the motion files of `folder`, sorted by name. If `names` are given, separated by commas, only those with
/// such a name.
///
/// # Errors
/// Returns an error if the folder cannot be listed, or has no file of a given name.
pub fn chosen(folder: &Path, names: Option<&str>) -> Result<Vec<PathBuf>, Failure> {
    let mut files = motion_files(folder)?;
    if let Some(names) = names.filter(|names| *names != "all") {
        let names: Vec<&str> = names.split(',').map(str::trim).collect();
        if let Some(name) = names.iter().find(|name| !files.iter().any(|file| stem(file) == **name)) {
            return Err(unusable_clip(name, format!("{} has no motion file of this name", folder.display())));
        }
        files.retain(|file| names.contains(&stem(file).as_str()));
    }
    Ok(files)
}

/// Returns the name of a file without its extension.
pub(crate) fn stem(file: &Path) -> String {
    file.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default()
}

/// Reads the clips of `folder` with these names, or `all`, reduced to every `stride`-th frame. Without names it reads
/// the clips that training leaves out, or all if there are fewer than five. Also returns (file, reason) of those
/// skipped.
///
/// # Errors
/// Returns an error if the folder cannot be listed, nothing in it can be used, or a named clip cannot be used.
pub fn read(
    folder: &Path,
    names: Option<&str>,
    calibration: CalibrationMode,
    stride: usize,
) -> Result<(Vec<Clip>, Vec<Skipped>), Failure> {
    let files = chosen(folder, names)?;
    let (mut clips, mut skipped) = (Vec::new(), Vec::new());
    for (index, file) in files.iter().enumerate() {
        if names.is_none() && files.len() >= VALIDATION_EVERY && !is_validation(index) {
            continue;
        }
        let clip = motion::load(file).map_err(|error| error.to_string());
        match clip.and_then(|motion| clip_of(&motion, calibration, stride)) {
            Ok(clip) => clips.push(clip),
            Err(reason) if names.is_some_and(|names| names != "all") => {
                return Err(unusable_clip(&stem(file), reason));
            }
            Err(reason) => skipped.push((file.display().to_string(), reason)),
        }
    }
    if clips.is_empty() {
        let reasons: String = skipped.iter().map(|(file, reason)| format!("\n  {file}: {reason}")).collect();
        let (folder, found) = (folder.display(), files.len());
        let text = format!("{folder}: none of {found} motion files can be used{reasons}");
        return Err(Failure::new(Exit::DataErr, text));
    }
    Ok((clips, skipped))
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
    let human: Option<Vec<Human>> = frames.iter().step_by(stride).map(Limbs::from_message).collect();
    let positions: Vec<_> = motion.frames.iter().step_by(stride).map(|frame| frame.positions).collect();
    Ok(Clip {
        name: motion.name.clone(),
        rate_hz: motion.frame_rate_hz / stride as f64,
        human: human.ok_or("has limb rotations that are not of unit length")?,
        torso: torso(&positions),
        positions,
    })
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

impl Clip {
    /// Returns the limb rotations in space, including the torso's own rotation, again with both arms as left
    /// arms. The robot's torso is upright and faces forward, so its limb rotations are the same in both frames.
    #[must_use]
    pub fn global(&self) -> Vec<Human> {
        self.human.iter().zip(&self.torso).map(|(human, torso)| turned(torso, human)).collect()
    }
}
