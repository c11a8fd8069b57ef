//! Recorded motion as input of the methods: the selected clips of a folder, and the motion of both arms in them.

use messages::SMPL_JOINTS;
use motion::{CalibrationMode, LoadOptions, Motion};
use retarget::Limbs;
use rt::{Exit, Failure};
use std::path::{Path, PathBuf};
use train::clips::{VALIDATION_EVERY, is_validation, limb_frames};

/// Both arms as left arms: the left one, and the right one mirrored at the plane between left and right.
pub type Human = [Limbs; 2];

#[derive(Clone, Debug)]
pub struct Clip {
    pub name: String,
    pub rate_hz: f64,
    /// Limb rotations in the torso frame. Every method receives them.
    pub human: Vec<Human>,
    /// Joint positions, m, x forward, y left, z up.
    pub positions: Vec<[[f32; 3]; SMPL_JOINTS]>,
}

pub type Skipped = (String, String);

fn unusable_clip(name: &str, reason: String) -> Failure {
    Failure::new(Exit::Usage, format!("--clips names {name}: {reason}"))
}

/// Returns the motion files of `folder`, sorted by name. If `names` are given, separated by commas, only those with
/// such a name.
pub fn chosen(folder: &Path, names: Option<&str>) -> Result<Vec<PathBuf>, Failure> {
    let mut files = motion::motion_files(folder).map_err(Failure::with(Exit::NoInput))?;
    if let Some(names) = names.filter(|names| *names != "all") {
        let names: Vec<&str> = names.split(',').map(str::trim).collect();
        if let Some(name) = names.iter().find(|name| !files.iter().any(|file| stem(file) == **name)) {
            return Err(unusable_clip(name, format!("{} has no motion file of this name", folder.display())));
        }
        files.retain(|file| names.contains(&stem(file).as_str()));
    }
    Ok(files)
}

pub(crate) fn stem(file: &Path) -> String {
    file.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default()
}

/// Reads the clips of `folder` with these names, or `all`. Without names it reads the clips that training leaves out,
/// or all if there are fewer than five. Also returns (file, reason) of those skipped.
pub fn read(
    folder: &Path,
    names: Option<&str>,
    calibration: CalibrationMode,
    load: &LoadOptions,
) -> Result<(Vec<Clip>, Vec<Skipped>), Failure> {
    let files = chosen(folder, names)?;
    let (mut clips, mut skipped) = (Vec::new(), Vec::new());
    for (index, file) in files.iter().enumerate() {
        if names.is_none() && files.len() >= VALIDATION_EVERY && !is_validation(index) {
            continue;
        }
        let clip = motion::load_with(file, load).map_err(|error| error.to_string());
        match clip.and_then(|motion| clip_of(&motion, calibration)) {
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

pub fn clip_of(motion: &Motion, calibration: CalibrationMode) -> Result<Clip, String> {
    if !motion.has_rotations && calibration != CalibrationMode::None {
        return Err(
            "has no rotations, so the twist of its limbs is unknown; --calibration none estimates it from the \
            elbow's plane"
                .into(),
        );
    }
    let frames = limb_frames(motion, calibration)?;
    let human: Option<Vec<Human>> = frames.iter().map(Limbs::from_message).collect();
    let positions: Vec<_> = motion.frames.iter().map(|frame| frame.positions).collect();
    Ok(Clip {
        name: motion.name.clone(),
        rate_hz: motion.frame_rate_hz,
        human: human.ok_or("has limb rotations that are not of unit length")?,
        positions,
    })
}
