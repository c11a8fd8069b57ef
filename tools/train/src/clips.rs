//! Recorded motion from a folder: training clips, validation clips, and the motion of each arm in them.

use crate::kinematics::Limbs;
use crate::sampling::Recorded;
use messages::LIMBS;
use motion::{CalibrationMode, LoadOptions, Motion};
use rt::{Exit, Failure};
use std::path::Path;

/// Distance between validation files. Of the files sorted by name, every fifth starting with the third is kept
/// for validation. So figures of different versions are comparable.
pub const VALIDATION_EVERY: usize = 5;
const VALIDATION_FIRST: usize = 2;

/// Returns true if the file at this index, sorted by name, is kept for validation.
pub const fn is_validation(index: usize) -> bool {
    index % VALIDATION_EVERY == VALIDATION_FIRST
}

#[derive(Clone, Debug)]
pub struct Clip {
    pub name: String,
    pub frame_rate_hz: f64,
    /// Frames of the left arm, then of the mirrored right arm, x y z w.
    pub arms: [Vec<Limbs>; 2],
}

impl Clip {
    pub fn frames(&self) -> impl Iterator<Item = [Limbs; 2]> {
        self.arms[0].iter().zip(&self.arms[1]).map(|(left, right)| [*left, *right])
    }
}

#[derive(Clone, Debug)]
pub struct Clips {
    pub training: Vec<Clip>,
    pub validation: Vec<Clip>,
    /// Files that could not be used: name and reason.
    pub skipped: Vec<(String, String)>,
}

impl Clips {
    /// Reads all motion files of the folders. The first one's have the validation clips. A file that cannot be read, or has
    /// no rotations, is skipped and listed.
    pub fn read(
        folders: &[impl AsRef<Path>],
        calibration: CalibrationMode,
        load: &LoadOptions,
    ) -> Result<Self, Failure> {
        let mut clips = Self { training: Vec::new(), validation: Vec::new(), skipped: Vec::new() };
        let (mut found, mut names) = (0, Vec::new());
        for (place, folder) in folders.iter().enumerate() {
            let files = motion::motion_files(folder.as_ref()).map_err(Failure::with(Exit::NoInput))?;
            found += files.len();
            names.push(folder.as_ref().display().to_string());
            for (index, file) in files.iter().enumerate() {
                match read_clip(file, calibration, load) {
                    Err(reason) => clips.skipped.push((file.display().to_string(), reason)),
                    Ok(clip) if place == 0 && is_validation(index) => clips.validation.push(clip),
                    Ok(clip) => clips.training.push(clip),
                }
            }
        }
        if clips.training.is_empty() || clips.validation.is_empty() {
            let reasons: String = clips.skipped.iter().map(|(file, reason)| format!("\n  {file}: {reason}")).collect();
            let usable = clips.training.len() + clips.validation.len();
            let (folder, needed) = (names.join(", "), VALIDATION_FIRST + 1);
            let text = format!("{usable} of {found} motion files are usable, at least {needed} are needed{reasons}");
            return Err(Failure::new(Exit::DataErr, format!("{folder}: {text}")));
        }
        Ok(clips)
    }

    pub fn recorded(&self) -> Recorded {
        Recorded { frames: self.training.iter().flat_map(Clip::frames).collect() }
    }

    /// Returns at most `count` frames, spread evenly over the validation clips.
    pub fn validation_sample(&self, count: usize) -> Vec<[Limbs; 2]> {
        let all: Vec<[Limbs; 2]> = self.validation.iter().flat_map(Clip::frames).collect();
        let stride = all.len().div_ceil(count.max(1)).max(1);
        all.into_iter().step_by(stride).collect()
    }
}

fn read_clip(file: &Path, calibration: CalibrationMode, load: &LoadOptions) -> Result<Clip, String> {
    let motion = motion::load_with(file, load).map_err(|error| error.to_string())?;
    if !motion.has_rotations {
        return Err("has no rotations, so the twist of its limbs is unknown".into());
    }
    let frames = limb_frames(&motion, calibration)?;
    Ok(Clip { name: motion.name, frame_rate_hz: motion.frame_rate_hz, arms: arms(&frames) })
}

/// Returns the limb rotations of every frame, x y z w, indexed by `messages::Limb`.
pub fn limb_frames(motion: &Motion, calibration: CalibrationMode) -> Result<Vec<[[f32; 4]; LIMBS]>, String> {
    let frames = motion::limbs(motion, &motion::calibrate(motion, calibration));
    if frames.is_empty() {
        return Err("has no frame of motion".into());
    }
    if frames.iter().flatten().flatten().any(|value| !value.is_finite()) {
        return Err("has limb rotations that are not finite".into());
    }
    Ok(frames)
}

/// Returns both arms as left arms. The right one is mirrored at the plane between left and right.
fn arms(frames: &[[[f32; 4]; LIMBS]]) -> [Vec<Limbs>; 2] {
    let mirror = |[x, y, z, w]: [f32; 4]| [-x, y, -z, w];
    let arms = frames.iter().map(|[upper, fore, right @ ..]| ([*upper, *fore], right.map(mirror)));
    let (left, right) = arms.unzip();
    [left, right]
}
