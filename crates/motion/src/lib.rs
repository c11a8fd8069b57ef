//! Motion files and built-in motions: reads any rig of BVH into SMPL-22, x forward, y left, z up, metres; writes BVH;
//! resamples, loops and calibrates. A shell crate: it reads and writes files, and prints nothing.
//!
//! What had to be guessed (unit, up-axis, missing joints) is returned as data in [`Motion::guesses`].
mod builtin;
mod bvh;
mod calibrate;
mod canonical;
mod error;
mod resample;
mod rig;
mod scan;
mod write;

pub use builtin::builtin;
pub use bvh::parse_bvh;
pub use calibrate::{CalibrationMode, calibrate, limbs, raw_frame};
pub use error::{BvhError, MotionError};
pub use resample::{loop_blend, upsample};
pub use write::{save_bvh, write_bvh};

use messages::SMPL_JOINTS;
use std::io::Read;
use std::path::Path;

/// Largest file that is read: 1 GiB, five hours of a rig of 100 joints at 60 Hz.
pub const FILE_BYTES_MAX: u64 = 1 << 30;
/// Sources slower than this are upsampled before they are published, because engaging needs at least 25 Hz.
pub const RATE_MIN_HZ: f64 = 30.0;
/// The rate that slow sources are upsampled to.
pub const RATE_UPSAMPLED_HZ: f64 = 60.0;

/// One instant of a person.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// Global positions, m, x forward, y left, z up.
    pub positions: [[f32; 3]; SMPL_JOINTS],
    /// Global rotations, x y z w, in the same frame; identity where the source has none.
    pub rotations: [[f32; 4]; SMPL_JOINTS],
}

/// What a reader had to guess.
#[derive(Clone, Debug, PartialEq)]
pub struct Guesses {
    /// Metres per unit of the file.
    pub scale_m_per_unit: f64,
    /// Name of that unit, or that the person was scaled to 1.75 m.
    pub unit: &'static str,
    /// Stature that follows, from leg and spine, m.
    pub stature_m: f64,
    /// The file's axis that points up: "+X", "-Y", ...
    pub up: &'static str,
    /// What else the reader made do with, a sentence each.
    pub warnings: Vec<String>,
}

/// A motion of one person.
#[derive(Clone, Debug, PartialEq)]
pub struct Motion {
    /// The file's name without extension, or the built-in's name.
    pub name: String,
    /// Frames per second.
    pub frame_rate_hz: f64,
    /// The frames of motion, without the file's first one.
    pub frames: Vec<Frame>,
    /// The file's first frame: often a T-pose that the exporter added, never motion.
    pub first: Option<Frame>,
    /// Whether `rotations` are the source's (else identity, and twist is unknown).
    pub has_rotations: bool,
    /// What was guessed; nothing for built-in motions.
    pub guesses: Guesses,
}

impl Motion {
    /// Length, s.
    pub fn duration_s(&self) -> f64 {
        self.frames.len() as f64 / self.frame_rate_hz
    }
}

/// Reads a motion file, by its extension (`.bvh`).
///
/// # Errors
/// Names the file, the line and the cause; a file above [`FILE_BYTES_MAX`] is refused before it is read.
pub fn load(path: &Path) -> Result<Motion, MotionError> {
    let file = || path.display().to_string();
    let io = |source| MotionError::Io { file: file(), source };
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("").to_ascii_lowercase();
    if extension != "bvh" {
        return Err(MotionError::UnknownFormat { file: file(), extension });
    }
    // Before it is opened: opening a pipe would wait for whoever writes into it.
    if !std::fs::metadata(path).map_err(io)?.is_file() {
        return Err(io(std::io::Error::new(std::io::ErrorKind::InvalidInput, "is not a regular file")));
    }
    let mut source = std::fs::File::open(path).map_err(io)?;
    let bytes = source.metadata().map_err(io)?.len();
    if bytes > FILE_BYTES_MAX {
        return Err(MotionError::TooLarge { file: file(), bytes, bound: FILE_BYTES_MAX });
    }
    let mut text = Vec::with_capacity(usize::try_from(bytes).unwrap_or(0));
    // A device or a pipe has no length: never more than the bound is taken from it.
    source.by_ref().take(FILE_BYTES_MAX).read_to_end(&mut text).map_err(io)?;
    let name = path.file_stem().map_or_else(|| "motion".to_owned(), |stem| stem.to_string_lossy().into_owned());
    parse_bvh(&name, &text).map_err(|source| MotionError::Bvh { file: file(), source })
}
