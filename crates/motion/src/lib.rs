//! Reads and writes motion files, and makes built-in motions. It reads any BVH rig, HumanML3D's positions and
//! features, and AMASS. It also reads the skeletons of recordings. All become SMPL-22 with x forward, y left, z
//! up, in metres. It writes BVH. It resamples, loops and calibrates motions. This is a shell crate: it reads and
//! writes files, and prints nothing.
//!
//! [`Motion::guesses`] returns guesses as data: unit, up-axis, missing joints.
mod amass;
mod builtin;
mod bvh;
mod calibrate;
mod canonical;
mod error;
mod files;
mod humanml3d;
mod lengths;
pub mod mcap;
mod mirror;
pub mod npy;
mod parts;
mod resample;
mod rig;
mod scan;
mod write;

pub use builtin::{
    CALIBRATION, FOREARM_M, PICK_AND_PLACE, SMPL_ARMS, STATURE_M, UPPER_ARM_M, builtin, builtin_named, sway, with_limbs,
};
pub use bvh::parse_bvh;
pub use calibrate::{CalibrationMode, calibrate, limbs, raw_frame};
pub use canonical::Up;
pub use error::{ArrayError, BvhError, McapError, MotionError};
pub use files::{EXTENSIONS, Listing, list, motion_files};
pub use mirror::MirrorError;
pub use resample::{loop_blend, mix, resampled, upsample};
pub use write::{save_bvh, write_bvh};

use canonical::Canonical;
use messages::{SMPL_JOINTS, Smpl};
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};

/// Largest file that is read: 128 MiB, a quarter of an hour for a rig of 100 joints at 60 Hz.
pub const FILE_BYTES_MAX: u64 = 1 << 27;
/// Largest recording that is read. It is streamed and never held in memory as a whole. An hour of every message
/// takes about 8 GB.
pub const RECORDING_BYTES_MAX: u64 = 1 << 35;
/// Most frames that are read: 33 minutes at 60 Hz. A frame takes 1.8 kB while it is read. No file therefore takes
/// more than 512 MB, whatever it claims and however it is packed (`tests/bounds.rs`). Split longer recordings
/// into parts.
pub const FRAMES_MAX: usize = 120_000;
/// A slow source may become this many times longer by upsampling, though it then has more than [`FRAMES_MAX`] frames.
const RATIO_MAX: usize = 3;
/// Sources slower than this are upsampled before publication. Their frame period is longer than the delay of
/// target interpolation.
pub const RATE_MIN_HZ: f64 = 30.0;
/// Allowed range of frame rates, Hz: from one frame in 100 s to 100 kHz, which is faster than any camera.
pub const FRAME_RATE_HZ: [f64; 2] = [0.01, 1e5];
/// Frame rate after upsampling of slow sources.
pub const RATE_UPSAMPLED_HZ: f64 = 60.0;

/// A person's posture at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// Global positions, m, x forward, y left, z up.
    pub positions: [[f32; 3]; SMPL_JOINTS],
    /// Global rotations, x y z w, in the same frame. Identity if the source has none.
    pub rotations: [[f32; 4]; SMPL_JOINTS],
    /// Closure of the left and the right hand, from 0 (open) to 1 (closed). `None` if the source has none.
    pub closure: [Option<f32>; 2],
}

impl Frame {
    /// Joints at the origin, without rotations or hands.
    pub const ZERO: Self =
        Self { positions: [[0.0; 3]; SMPL_JOINTS], rotations: [[0.0, 0.0, 0.0, 1.0]; SMPL_JOINTS], closure: [None; 2] };

    /// Returns true if a joint is seen. Zeros stand for one that is not, as in live frames. Only the pelvis may be there.
    pub(crate) fn sees(&self, joint: usize) -> bool {
        joint == Smpl::Pelvis as usize || self.positions[joint] != [0.0; 3]
    }

    /// Returns a bit for each joint that is seen.
    pub(crate) fn seen(&self) -> u32 {
        (0..SMPL_JOINTS).filter(|&joint| self.sees(joint)).map(|joint| 1 << joint).sum()
    }
}

/// Guesses of a reader.
#[derive(Clone, Debug, PartialEq)]
pub struct Guesses {
    /// Metres per unit of the file.
    pub scale_m_per_unit: f64,
    /// Name of that unit, or a note that the person was scaled to 1.75 m.
    pub unit: &'static str,
    /// Stature computed from leg and spine, m.
    pub stature_m: f64,
    /// The file's axis that points up: "+X", "-Y", ...
    pub up: &'static str,
    /// Other warnings of the reader, one sentence each.
    pub warnings: Vec<String>,
    /// Sentence on the loss, if the file is damaged or truncated.
    pub lost: Option<String>,
}

/// A motion of one person.
#[derive(Clone, Debug, PartialEq)]
pub struct Motion {
    /// Name of the file without extension, or name of the built-in motion.
    pub name: String,
    /// Frames per second.
    pub frame_rate_hz: f64,
    /// The frames of motion, without the file's first one.
    pub frames: Vec<Frame>,
    /// First frame of the file. It is often a T-pose that the exporter added, and never motion.
    pub first: Option<Frame>,
    /// True if `rotations` come from the source. Otherwise they are the identity, and twist is unknown.
    pub has_rotations: bool,
    /// Guesses of the reader. Empty for built-in motions.
    pub guesses: Guesses,
}

impl Motion {
    /// Creates a motion of a generated person, for whom nothing is guessed.
    pub fn generated(name: &str, frame_rate_hz: f64, frames: Vec<Frame>) -> Self {
        let guesses = Guesses {
            scale_m_per_unit: 1.0,
            unit: "m",
            stature_m: STATURE_M,
            up: "+Z",
            warnings: Vec::new(),
            lost: None,
        };
        Self { name: name.to_owned(), frame_rate_hz, frames, first: None, has_rotations: true, guesses }
    }

    /// Number of the first frame in which the person stands or sits: a robot follows from there on.
    ///
    /// # Errors
    /// Says so if the person lies all the time.
    pub fn stands_from(&self) -> Result<usize, &'static str> {
        let [left, right] = [Smpl::LeftAnkle, Smpl::RightAnkle].map(|ankle| ankle as usize);
        let stands = |frame: &Frame| skeleton::stands(&frame.positions, frame.sees(left) && frame.sees(right));
        self.frames.iter().position(|frame| stands(frame) == Some(true)).ok_or(
            "in every frame trunk and legs lean by 60 degrees or more, and no robot engages with a person who lies; give a motion \
             with a frame in which they stand or sit, or make postures of it (replay batch)",
        )
    }

    /// Length, s.
    pub fn duration_s(&self) -> f64 {
        self.frames.len() as f64 / self.frame_rate_hz
    }
}

/// Information that a file may lack: the same options in every program that reads motion files.
#[derive(Clone, Debug, Default, PartialEq, clap::Args)]
pub struct LoadOptions {
    /// Mean of normalised HumanML3D features [default: Mean.npy in the file's folder or up to two above].
    #[arg(long, value_name = "FILE", requires = "std")]
    pub mean: Option<PathBuf>,
    /// Standard deviation of normalised HumanML3D features [default: Std.npy beside Mean.npy].
    #[arg(long, value_name = "FILE", requires = "mean")]
    pub std: Option<PathBuf>,
    /// The data are a mirror image: mirror them back, so that left is left.
    #[arg(long)]
    pub mirror: bool,
    /// Frames per second of the file, regardless of what it says. Arrays of positions and features say nothing, and play at
    /// 20 Hz like HumanML3D.
    #[arg(long = "frame-rate", value_name = "HZ", value_parser = rate, allow_negative_numbers = true)]
    pub frame_rate_hz: Option<f64>,
    /// The axis that points up in a .npy (y unless given) or .npz (z unless given). Other files need none.
    #[arg(long, value_name = "y|z")]
    pub up: Option<Up>,
    /// Names of a BVH rig's joints that are not found by themselves: a TOML file with lines such as left_elbow = "Arm2.L".
    #[arg(long, value_name = "FILE.toml")]
    pub map: Option<PathBuf>,
}

impl LoadOptions {
    /// Returns why one of these options cannot be used for this file or built-in motion.
    pub fn refusal(&self, file: &Path) -> Option<MotionError> {
        let extension = file.extension().unwrap_or_default();
        let options: [(&'static str, bool, &[&str]); 5] = [
            ("--up", self.up.is_some(), &["npy", "npz"]),
            ("--mean", self.mean.is_some(), &["npy"]),
            ("--map", self.map.is_some(), &["bvh"]),
            ("--mirror", self.mirror, &EXTENSIONS),
            ("--frame-rate", self.frame_rate_hz.is_some(), &EXTENSIONS),
        ];
        let serves = |extensions: &[&str]| extensions.iter().any(|own| extension.eq_ignore_ascii_case(own));
        let (option, _, extensions) = options.into_iter().find(|(_, given, own)| *given && !serves(own))?;
        Some(MotionError::Unused { file: file.display().to_string(), option, extensions: extensions.join(", .") })
    }
}

fn rate(text: &str) -> Result<f64, String> {
    let [low, high] = FRAME_RATE_HZ;
    let rate = text.parse().ok().filter(|rate| (low..=high).contains(rate));
    rate.ok_or_else(|| format!("must be a number of frames a second within [{low}, {high}], such as 30"))
}

/// Reads a motion file by its extension, like [`load_with`] without options. `.bvh`: any rig. `.npy`: HumanML3D's
/// positions (N, 22, 3) or features (N, 263). `.npz`: AMASS (SMPL-H or SMPL-X). `.mcap`: a recording of `record`.
pub fn load(path: &Path) -> Result<Motion, MotionError> {
    load_with(path, &LoadOptions::default())
}

/// Like [`load`], with information that the file may lack. Rejects a mirror image unless `mirror` is set. Also takes the name of a
/// built-in motion.
pub fn load_with(path: &Path, options: &LoadOptions) -> Result<Motion, MotionError> {
    let file = || path.display().to_string();
    let array = |source| MotionError::Array { file: file(), source };
    if let Some(refusal) = options.refusal(path) {
        return Err(refusal);
    }
    if let Some(motion) = path.to_str().and_then(builtin_named) {
        return Ok(motion);
    }
    if path.is_dir() {
        return Err(MotionError::Folder { file: file() });
    }
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("").to_ascii_lowercase();
    if !EXTENSIONS.contains(&extension.as_str()) {
        return Err(MotionError::UnknownFormat { file: file(), extension });
    }
    let [low, high] = FRAME_RATE_HZ;
    if let Some(value) = options.frame_rate_hz.filter(|rate| !(low..=high).contains(rate)) {
        return Err(array(ArrayError::FrameRate { value, low, high }));
    }
    let most = if extension == "mcap" { RECORDING_BYTES_MAX } else { FILE_BYTES_MAX };
    let source = open(path, most)?;
    let name = path.file_stem().map_or_else(|| "motion".to_owned(), |stem| stem.to_string_lossy().into_owned());
    let mut motion = match extension.as_str() {
        "bvh" => read_bvh(&name, path, source, options)?,
        "mcap" => mcap::parse_mcap(source, &name).map_err(|source| MotionError::Mcap { file: file(), source })?,
        "npy" => read_humanml3d(&name, path, source, options).map_err(array)?,
        _ => amass::read(BufReader::new(source), options)
            .and_then(|sequence| from_array(&name, sequence, options.up.unwrap_or(Up::Z), true))
            .map_err(array)?,
    };
    // The first frame of a BVH shows the same body.
    let has_first = motion.first.is_some();
    motion.frames.splice(0..0, motion.first);
    mirror::settle(&mut motion.frames, options.mirror)
        .map_err(|source| MotionError::Mirror { file: file(), source })?;
    if has_first {
        motion.first = Some(motion.frames.remove(0));
    }
    motion.frame_rate_hz = options.frame_rate_hz.unwrap_or(motion.frame_rate_hz);
    let (frames, rate_hz) = (motion.frames.len(), motion.frame_rate_hz);
    let (resampled, bound) = (resample::upsampled_count(frames, rate_hz), FRAMES_MAX.max(RATIO_MAX * frames));
    if resampled > bound {
        return Err(MotionError::TooLong { file: file(), frames, rate_hz, resampled, bound });
    }
    motion.guesses.warnings.extend(lengths::doubt_of_sight(&motion, has_first.into()));
    motion.guesses.warnings.extend(lengths::doubt_of_place(&motion, has_first.into()));
    motion.guesses.warnings.extend(lengths::even(&mut motion.frames));
    let lies = match motion.stands_from().map(|begins| begins + usize::from(has_first)) {
        Ok(begins) if begins == usize::from(has_first) => None,
        Ok(begins) => Some(format!("the person stands or sits from frame {begins} on: followed from there")),
        Err(_) => Some("the person stands or sits in no frame: no robot follows".to_owned()),
    };
    motion.guesses.warnings.extend(lies);
    motion.guesses.warnings.extend(resample::doubt_of_rate(&motion));
    Ok(motion)
}

/// Opens a regular file that is not too large.
fn open(path: &Path, most: u64) -> Result<std::fs::File, MotionError> {
    let file = || path.display().to_string();
    let io = |source| MotionError::Io { file: file(), source };
    // Checked before opening, because opening a pipe would wait for a writer.
    if !std::fs::metadata(path).map_err(io)?.is_file() {
        return Err(io(std::io::Error::new(std::io::ErrorKind::InvalidInput, "is not a regular file")));
    }
    let source = std::fs::File::open(path).map_err(io)?;
    let bytes = source.metadata().map_err(io)?.len();
    if bytes > most {
        return Err(MotionError::TooLarge { file: file(), bytes, bound: most });
    }
    Ok(source)
}

fn read_bvh(name: &str, path: &Path, source: std::fs::File, options: &LoadOptions) -> Result<Motion, MotionError> {
    let file = || path.display().to_string();
    let mut text = Vec::new();
    // A file may grow while it is read. Never read more than the bound.
    let read = source.take(FILE_BYTES_MAX).read_to_end(&mut text);
    read.map_err(|source| MotionError::Io { file: file(), source })?;
    let named = options.map.as_deref().map_or_else(|| Ok(rig::Named::default()), rig::Named::read)?;
    bvh::parse(name, &text, &named).map_err(|source| MotionError::Bvh { file: file(), source })
}

fn read_humanml3d(name: &str, path: &Path, source: std::fs::File, options: &LoadOptions) -> Result<Motion, ArrayError> {
    let array = npy::read_npy(BufReader::new(source))?;
    let up = if humanml3d::are_features(&array) { Up::Y } else { options.up.unwrap_or(Up::Y) };
    let (positions, mut warnings) = humanml3d::read(path, &array, options)?;
    let rotation = nalgebra::UnitQuaternion::identity();
    let frames: Vec<bvh::RigFrame> =
        positions.iter().map(|frame| frame.map(|position| bvh::Pose { position, rotation })).collect();
    // Freed before the last copy is made, to save memory.
    drop((array, positions));
    let frame_rate_hz = options.frame_rate_hz.unwrap_or(humanml3d::FRAME_RATE_HZ);
    if options.frame_rate_hz.is_none() {
        warnings.push(format!("no rate in the file: {frame_rate_hz} Hz, as in HumanML3D (--frame-rate HZ changes it)"));
    }
    from_array(name, amass::Sequence { frame_rate_hz, frames, warnings }, up, false)
}

/// Returns the motion of an array, whose unit is guessed. Without rotations they are the identity.
fn from_array(name: &str, sequence: amass::Sequence, up: Up, has_rotations: bool) -> Result<Motion, ArrayError> {
    let amass::Sequence { frame_rate_hz, frames, mut warnings } = sequence;
    let canonical = Canonical::known(&frames, frame_rate_hz, up).map_err(|length| ArrayError::NoSize { length })?;
    warnings.extend(canonical.warning.clone());
    let mut frames: Vec<Frame> = frames.iter().map(|frame| canonical.apply(frame)).collect();
    if !has_rotations {
        frames.iter_mut().for_each(|frame| frame.rotations = Frame::ZERO.rotations);
    }
    let guesses = canonical.guesses(warnings);
    Ok(Motion { name: name.to_owned(), frame_rate_hz, frames, first: None, has_rotations, guesses })
}
