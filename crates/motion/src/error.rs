//! Errors of motion files.

use crate::mirror::MirrorError;
use thiserror::Error;

/// Reason why a file gave no motion.
#[derive(Debug, Error)]
#[allow(missing_docs, reason = "the texts name the fields")]
pub enum MotionError {
    #[error("{file}: {source}")]
    Io { file: String, source: std::io::Error },
    #[error(
        "{file}: extension \"{extension}\" is unknown; motion files are .bvh, .npy, .npz and .mcap, and `replay` plays .csv, too: \
         export it as BVH, or save positions (N, 22, 3) by numpy.save"
    )]
    UnknownFormat { file: String, extension: String },
    #[error("{file}: {option} is for .{extensions} files; leave it out")]
    Unused { file: String, option: &'static str, extensions: String },
    #[error("{file} is a folder; name one motion file in it")]
    Folder { file: String },
    #[error("{file}: {bytes} bytes, at most {bound} are read; split it into parts")]
    TooLarge { file: String, bytes: u64, bound: u64 },
    #[error("{file}: {source}")]
    Bvh { file: String, source: BvhError },
    #[error("{file}: {source}")]
    Array { file: String, source: ArrayError },
    #[error("{file}: {source}")]
    Mcap { file: String, source: McapError },
    #[error("{file}: {source}")]
    Mirror { file: String, source: MirrorError },
    #[error(
        "{file}: {frames} frames at {rate_hz} Hz become {resampled} at 60 Hz, at most {bound}; give the true rate \
         (--frame-rate HZ), or split the file"
    )]
    TooLong { file: String, frames: usize, rate_hz: f64, resampled: usize, bound: usize },
    #[error("{file}: {cause}; it names joints so: left_elbow = \"ForeArm.L\"")]
    Map { file: String, cause: String },
}

/// Errors of a .mcap file.
#[derive(Clone, Debug, Error, PartialEq)]
#[allow(missing_docs, reason = "the texts name the fields")]
pub enum McapError {
    #[error("is not an MCAP file: {cause}; `record` writes one")]
    NotMcap { cause: String },
    #[error("cannot be read: {cause}; copy it to another disk")]
    Read { cause: String },
    #[error(
        "names more than {bound} channels or schemas, or their names have more than {bytes} bytes; `pymcap-cli filter` \
         leaves topics out"
    )]
    Channels { bound: usize, bytes: usize },
    #[error(
        "decompresses to {bytes} bytes within the first {offset}; the limit is {bound}; `pymcap-cli decompress` writes it \
         without compression"
    )]
    Unpacked {
        /// Bytes read so far: the start of the chunk that is too much.
        offset: u64,
        /// Unpacked bytes, including this chunk.
        bytes: u64,
        bound: u64,
    },
    #[error(
        "its messages are not in the order of their time: {bytes} bytes would wait for earlier ones, and the limit is {bound}; \
         `pymcap-cli sort` writes them in that order"
    )]
    Disorder { bytes: u64, bound: u64 },
    #[error("holds more than {bound} skeletons; `pymcap-cli split` writes parts")]
    Frames { bound: usize },
    #[error(
        "holds {count} skeletons of the schema {layout} (`record` writes them), at least 2 are needed; its topics are {topics}{broken}"
    )]
    NoSkeletons {
        count: usize,
        layout: &'static str,
        /// Topics of the file with their schemas, the first 16.
        topics: String,
        /// Why the file ended early. Empty if it did not.
        broken: String,
    },
}

/// Errors of a .npy or .npz file.
#[derive(Clone, Debug, Error, PartialEq)]
#[allow(missing_docs, reason = "the texts name the fields")]
pub enum ArrayError {
    #[error("is not a .npy file (it does not begin with \\x93NUMPY and a version); numpy.save writes one")]
    NotNpy,
    #[error("is not a .npz file, or was cut: {cause}; copy it again, or write one by numpy.savez")]
    NotZip { cause: String },
    #[error("the .npy header is damaged: {cause}; save the array again, with numpy.save")]
    Header { cause: String },
    #[error(
        "numbers of type {found} are not supported; save f2, f4, f8 or integers (objects are pickles, and never read)"
    )]
    Type { found: String },
    #[error("shape {shape:?} has more than {bound} numbers; split it into parts")]
    TooLarge { shape: Vec<usize>, bound: usize },
    #[error(
        "shape {shape:?} has more than {bound} numbers, the most that an archive of {bytes} bytes may unpack to; save it without \
         compression (numpy.savez)"
    )]
    Packed { shape: Vec<usize>, bound: usize, bytes: u64 },
    #[error("{frames} frames, at most {bound} are allowed; split the file")]
    TooManyFrames { frames: usize, bound: usize },
    #[error("shape {shape:?} needs {claimed} bytes, and {found} follow: the file was cut; copy or save it again")]
    Short { shape: Vec<usize>, found: u64, claimed: u64 },
    #[error("is damaged: {cause}; copy or save it again")]
    Damaged { cause: String },
    #[error("{key}: {source}")]
    Key { key: String, source: Box<ArrayError> },
    #[error("has no {missing}; its keys are {}; save it with them, by numpy.savez", .found.join(", "))]
    MissingKeys {
        missing: &'static str,
        /// Keys of the archive, the first 40.
        found: Vec<String>,
    },
    #[error("has shape {found:?}, expected {expected}; save it in that one")]
    Shape { found: Vec<usize>, expected: &'static str },
    #[error(
        "has 322 columns, the parameters of Motion-X, and not positions; save columns 0 to 3 as root_orient, 3 to 66 as \
         pose_body and 309 to 312 as trans, with mocap_frame_rate, to an .npz"
    )]
    Parameters,
    #[error("has shape {shape:?}, which has no frame; save at least one")]
    Empty { shape: Vec<usize> },
    #[error("frame {frame}, number {column}: {value:?} is not within +-{bound}; cut this frame out, or repair it")]
    Number { frame: usize, column: usize, value: f64, bound: f64 },
    #[error("frame rate {value:?} Hz is not within [{low}, {high}]; give the true one: --frame-rate HZ")]
    FrameRate { value: f64, low: f64, high: f64 },
    #[error("legs and spine have no length ({length} m); the first 22 joints must be those of SMPL, in its order")]
    NoSize { length: f64 },
    #[error(
        "has shape [263]: the statistics of features (Mean.npy or Std.npy), not motion, which is (N, 263); give that file"
    )]
    Statistics,
    #[error(
        "the features look normalised ({signs}), and no Mean.npy and Std.npy lie beside the file or up to {levels} \
         folders above; give --mean FILE and --std FILE"
    )]
    NeedsStatistics { signs: String, levels: usize },
    #[error("one of --mean and --std is missing; give both or neither")]
    HalfOfStatistics,
    #[error(
        "with {mean} and its Std the features are not a plausible person ({after}); as stored: {before}; give those of their \
         data set: --mean FILE and --std FILE"
    )]
    WrongStatistics { mean: String, before: String, after: String },
}

impl ArrayError {
    /// Wraps the error as one of this array in an archive.
    pub(crate) fn in_key(self, key: &str) -> Self {
        Self::Key { key: key.to_owned(), source: Box::new(self) }
    }
}

/// Errors in the text of a BVH. Lines count from 1.
#[derive(Clone, Debug, Error, PartialEq)]
#[allow(missing_docs, reason = "the texts name the fields")]
pub enum BvhError {
    #[error("line 1: the file is empty; export it again")]
    Empty,
    #[error("line {line}: the file ends, expected {expected}: it was cut; copy or export it again")]
    Truncated { line: usize, expected: &'static str },
    #[error("line {line}: \"{found}\", expected {expected}; the file is damaged, or no BVH: export it again, as BVH")]
    Unexpected { line: usize, found: String, expected: &'static str },
    #[error("line {line}: \"{found}\" is not a number ({what}); write one there")]
    NotANumber { line: usize, found: String, what: &'static str },
    #[error("line {line}: {what} {value:?} is not within +-{bound}; repair it, or export again")]
    OutOfRange { line: usize, what: &'static str, value: f64, bound: f64 },
    #[error(
        "line {line}: Frame Time: {value_s:?} is outside [{low_s}, {high_s}] s; write the seconds from one frame to the \
         next, such as 0.0333333 for 30 frames a second"
    )]
    FrameTime { line: usize, value_s: f64, low_s: f64, high_s: f64 },
    #[error("line {line}: {what}: {value}, at most {bound}; export fewer")]
    TooMany { line: usize, what: &'static str, value: u64, bound: u64 },
    #[error("line {line}: {what}: \"{found}\" is not a whole number from {low} to {high}; correct it, or export again")]
    NotACount { line: usize, what: &'static str, found: String, low: u64, high: u64 },
    #[error(
        "line {line}: a frame has {channels} numbers, and a moving root with four limbs at least {bound}; export the joints with \
         their rotations"
    )]
    TooFewChannels { line: usize, channels: usize, bound: usize },
    #[error("line {line} has {found} numbers, and a frame {channels}; correct the line, or export again")]
    FrameLine { line: usize, found: usize, channels: usize },
    #[error(
        "line {line}: the file ends after {whole} of {claimed} frames: it was cut; copy or export it again, or correct the count \
         behind Frames:"
    )]
    Cut { line: usize, whole: usize, claimed: u64 },
    #[error("line {line}: more numbers than the {frames} frames of the header; correct the count behind Frames:")]
    Trailing { line: usize, frames: u64 },
    #[error("the map gives {joint} the name {name:?}, which no joint has; give one of {}", .found.join(", "))]
    UnknownName {
        /// SMPL-22 name.
        joint: &'static str,
        name: String,
        /// The rig's names, the first 40.
        found: Vec<String>,
    },
    #[error(
        "the rig has no joint for {}; it has {}; name those that are meant in a file for --map, such as {} = \"NAME\"",
        sought(.missing), .found.join(", "), .missing.first().unwrap_or(&"left_elbow")
    )]
    MissingJoints {
        /// SMPL-22 names.
        missing: Vec<&'static str>,
        /// The rig's names, the first 40.
        found: Vec<String>,
    },
    #[error(
        "legs and spine have no length ({length} units), so there is no scale; export the skeleton with its offsets"
    )]
    NoSize {
        /// Length of leg and spine, units of the file.
        length: f64,
    },
    #[error(transparent)]
    Mirror(MirrorError),
}

/// Returns the joints' names. Adds the usual name for joints that many rigs name differently.
fn sought(missing: &[&str]) -> String {
    let called = |name: &&str| match *name {
        "left_foot" | "right_foot" => format!("{name} (the toes: ToeBase)"),
        name => name.to_owned(),
    };
    missing.iter().map(called).collect::<Vec<_>>().join(", ")
}
