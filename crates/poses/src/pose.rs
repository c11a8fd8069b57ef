//! A pose on the command line: a name, or a frame or an instant of a motion file.

use crate::error::PosesError;
use crate::motions::{named_pose, names};
use motion::{CalibrationMode, EXTENSIONS, LoadOptions, Motion};
use retarget::{ARMS, Limbs};
use std::path::Path;

/// Reads a pose, and returns the limbs of both arms, each as those of a left arm. The text is `file.bvh:frame`
/// (0 is the first frame of motion), `file.bvh@time_s` (the nearest frame) or a name (`t-pose`, `hands-up`,
/// ..., `rest`). Any motion file serves, read with the options `load`. Hinges of files are calibrated by `calibration`.
pub fn read_pose(text: &str, calibration: CalibrationMode, load: &LoadOptions) -> Result<[Limbs; ARMS], PosesError> {
    let refuse = |reason: String| PosesError::Pose { text: text.to_owned(), reason };
    if let Some(frame) = named_pose(text) {
        let motion = Motion::generated(text, crate::motions::RATE_HZ, vec![frame]);
        return limbs_of(&motion, 0, CalibrationMode::Rig).ok_or_else(|| refuse("has no limb rotations".into()));
    }
    let Some(end) = file_end(text) else {
        let allowed = names().join(", ");
        return Err(refuse(format!(
            "must be FILE.bvh:FRAME, FILE.bvh@TIME_S (any motion file), or one of rest, {allowed}"
        )));
    };
    let (file, place) = text.split_at(end);
    let motion = motion::load_with(Path::new(file), load)?;
    let last = motion.frames.len().saturating_sub(1);
    let index = if let Some(frame) = place.strip_prefix(':') {
        let frame = frame.parse::<usize>().ok().filter(|frame| *frame <= last);
        frame.ok_or_else(|| refuse(format!("{:?} is not a frame of 0 to {last}", &place[1..])))?
    } else if let Some(time) = place.strip_prefix('@') {
        let end_s = last as f64 / motion.frame_rate_hz;
        let time = time.parse::<f64>().ok().filter(|time| (0.0..=end_s + 1e-9).contains(time));
        let time = time.ok_or_else(|| refuse(format!("{:?} is not a time of 0 to {end_s:.3} s", &place[1..])))?;
        ((time * motion.frame_rate_hz).round() as usize).min(last)
    } else {
        return Err(refuse("needs a frame or a time: FILE.bvh:FRAME or FILE.bvh@TIME_S".into()));
    };
    limbs_of(&motion, index, calibration).ok_or_else(|| refuse("has no limb rotations in that frame".into()))
}

/// Returns the file of a pose, if it comes from a file.
pub fn file_of(text: &str) -> Option<&Path> {
    named_pose(text).is_none().then(|| file_end(text).map(|end| Path::new(&text[..end]))).flatten()
}

fn file_end(text: &str) -> Option<usize> {
    let text = text.to_ascii_lowercase();
    let end = |extension: &str| Some(text.rfind(&format!(".{extension}"))? + 1 + extension.len());
    EXTENSIONS.into_iter().filter_map(end).max()
}

/// Computes all frames up to `index`. A hinge that is kept over straight elbows depends on the earlier frames.
fn limbs_of(motion: &Motion, index: usize, calibration: CalibrationMode) -> Option<[Limbs; ARMS]> {
    let hinges = motion::calibrate(motion, calibration);
    motion::limbs(motion, &hinges).get(index).and_then(Limbs::from_message)
}
