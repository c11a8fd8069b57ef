//! Errors of motion files.

use crate::mirror::MirrorError;
use thiserror::Error;

/// Reason why a file gave no motion.
#[derive(Debug, Error)]
#[allow(missing_docs, reason = "the texts name the fields")]
pub enum MotionError {
    /// The operating system cannot open or read the file.
    #[error("{file}: {source}")]
    Io { file: String, source: std::io::Error },
    /// There is no reader for this extension.
    #[error("{file}: extension \"{extension}\" is unknown; motion files are .bvh, .npy, .npz and .mcap")]
    UnknownFormat { file: String, extension: String },
    /// The path is a folder.
    #[error("{file} is a folder; name one motion file in it (.bvh, .npy, .npz or .mcap)")]
    Folder { file: String },
    /// The file is too large. It was not read.
    #[error("{file}: {bytes} bytes, at most {bound}")]
    TooLarge { file: String, bytes: u64, bound: u64 },
    /// The file is not a usable BVH.
    #[error("{file}: {source}")]
    Bvh { file: String, source: BvhError },
    /// The file has no usable array.
    #[error("{file}: {source}")]
    Array { file: String, source: ArrayError },
    /// The file is not a playable recording.
    #[error("{file}: {source}")]
    Mcap { file: String, source: McapError },
    /// Left and right of the person are not reliable.
    #[error("{file}: {source}")]
    Mirror { file: String, source: MirrorError },
}

/// Errors of a .mcap file.
#[derive(Clone, Debug, Error, PartialEq)]
#[allow(missing_docs, reason = "the texts name the fields")]
pub enum McapError {
    /// The file is of another kind.
    #[error("is not an MCAP file: {cause}")]
    NotMcap { cause: String },
    /// The file cannot be read.
    #[error("cannot be read: {cause}")]
    Read { cause: String },
    /// The file has too many channels or schemas.
    #[error("names more than {bound} channels or schemas")]
    Channels { bound: usize },
    /// A chunk is too large.
    #[error("the chunk at byte {offset} claims to decompress to {bytes} bytes; the limit is {bound}")]
    Chunk {
        /// Start of the chunk in the file.
        offset: u64,
        /// Its length before compression.
        bytes: u64,
        bound: u64,
    },
    /// The chunks unpack to more than a file of this length may hold.
    #[error("decompresses to {bytes} bytes within the first {offset}; the limit is {bound}")]
    Unpacked {
        /// Bytes read so far: the start of the chunk that is too much.
        offset: u64,
        /// Unpacked bytes, including this chunk.
        bytes: u64,
        bound: u64,
    },
    /// The motion is too long.
    #[error("holds more than {bound} skeletons")]
    Frames { bound: usize },
    /// The recording holds something else, or messages of another version.
    #[error("holds {count} skeletons of the layout {layout}, at least 2 are needed; its topics are {topics}")]
    NoSkeletons {
        count: usize,
        layout: &'static str,
        /// Topics of the file, the first 16.
        topics: String,
    },
}

/// Errors of a .npy or .npz file.
#[derive(Clone, Debug, Error, PartialEq)]
#[allow(missing_docs, reason = "the texts name the fields")]
pub enum ArrayError {
    /// The file is not a .npy.
    #[error("is not a .npy file (it does not begin with \\x93NUMPY and a version)")]
    NotNpy,
    /// The file is not a .npz.
    #[error("is not a .npz file: {cause}")]
    NotZip { cause: String },
    /// The header is not valid.
    #[error("the .npy header is damaged: {cause}")]
    Header { cause: String },
    /// The number type is not supported. Objects are pickles.
    #[error("numbers of type {found} are not supported; f4, f8 and integers are (objects are pickles, and never read)")]
    Type { found: String },
    /// The array is too large.
    #[error("shape {shape:?} has more than {bound} numbers")]
    TooLarge { shape: Vec<usize>, bound: usize },
    /// The motion is too long.
    #[error("{frames} frames, at most {bound} are allowed")]
    TooManyFrames { frames: usize, bound: usize },
    /// The file ends before the array does.
    #[error("shape {shape:?} needs {claimed} bytes, and {found} follow")]
    Short { shape: Vec<usize>, found: u64, claimed: u64 },
    /// The file cannot be read to its end.
    #[error("is damaged: {cause}")]
    Damaged { cause: String },
    /// An error in an array of an archive, or in another file.
    #[error("{key}: {source}")]
    Key { key: String, source: Box<ArrayError> },
    /// The archive holds no motion.
    #[error("has no {missing}; its keys are {}", .found.join(", "))]
    MissingKeys {
        missing: &'static str,
        /// Keys of the archive, the first 40.
        found: Vec<String>,
    },
    /// The shape is not one of a motion.
    #[error("has shape {found:?}, expected {expected}")]
    Shape { found: Vec<usize>, expected: &'static str },
    /// The array has no frames.
    #[error("has shape {shape:?}, which has no frame")]
    Empty { shape: Vec<usize> },
    /// A number is infinite, NaN or implausibly large.
    #[error("frame {frame}, number {column}: {value} is not within +-{bound}")]
    Number { frame: usize, column: usize, value: f64, bound: f64 },
    /// The frame rate is implausible.
    #[error("frame rate {value} Hz is not within [{low}, {high}]")]
    FrameRate { value: f64, low: f64, high: f64 },
    /// The bones have no length.
    #[error("legs and spine have no length ({length} m)")]
    NoSize { length: f64 },
    /// The file is a Mean.npy or Std.npy, not motion.
    #[error("has shape [263]: the statistics of features (Mean.npy or Std.npy), not motion, which is (N, 263)")]
    Statistics,
    /// The features are normalised, and Mean and Std are missing.
    #[error(
        "the features look normalised ({signs}), and no Mean.npy and Std.npy lie beside the file or up to {levels} \
         folders above; give the options `mean` and `std`"
    )]
    NeedsStatistics { signs: String, levels: usize },
    /// Only one of the options `mean` and `std` is given.
    #[error("one of the options `mean` and `std` is missing; give both or neither")]
    HalfOfStatistics,
    /// The statistics do not lead to a plausible person.
    #[error("with {mean} and its Std the features are not a plausible person ({after}); as stored: {before}")]
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
    /// The file holds only white space.
    #[error("the file is empty")]
    Empty,
    /// The file ends too early.
    #[error("line {line}: the file ends, expected {expected}")]
    Truncated { line: usize, expected: &'static str },
    /// The grammar requires another word here.
    #[error("line {line}: \"{found}\", expected {expected}")]
    Unexpected { line: usize, found: String, expected: &'static str },
    /// The word is not a number.
    #[error("line {line}: \"{found}\" is not a number ({what})")]
    NotANumber { line: usize, found: String, what: &'static str },
    /// A number is infinite, NaN or implausibly large.
    #[error("line {line}: {what} {value} is not within +-{bound}")]
    OutOfRange { line: usize, what: &'static str, value: f64, bound: f64 },
    /// The time between two frames is implausible.
    #[error(
        "line {line}: Frame Time: {value_s} is outside [{low_s}, {high_s}] s; write the seconds from one frame to the \
         next, such as 0.0333333 for 30 frames a second"
    )]
    FrameTime { line: usize, value_s: f64, low_s: f64, high_s: f64 },
    /// The rig has too many joints, or its nesting is too deep.
    #[error("line {line}: {what}: {value}, at most {bound}")]
    TooMany { line: usize, what: &'static str, value: u64, bound: u64 },
    /// The header claims more than the file can hold.
    #[error(
        "line {line}: {claimed} frames of {channels} numbers (at least 18) do not fit in the remaining {bytes} bytes"
    )]
    FrameCount { line: usize, claimed: u64, channels: usize, bytes: usize },
    /// There are fewer than two frames. The first one is a pose, not motion.
    #[error("line {line}: {frames} frame(s); at least 2 are needed, because the first is a pose, not motion")]
    TooFewFrames { line: usize, frames: u64 },
    /// Text follows the last frame.
    #[error("line {line}: more numbers than the {frames} frames of the header")]
    Trailing { line: usize, frames: u64 },
    /// The rig lacks these joints.
    #[error("the rig has no joint for {}; it has {}", sought(.missing), .found.join(", "))]
    MissingJoints {
        /// SMPL-22 names.
        missing: Vec<&'static str>,
        /// The rig's names, the first 40.
        found: Vec<String>,
    },
    /// The bones have no length.
    #[error("legs and spine have no length ({length} units), so the scale cannot be estimated")]
    NoSize {
        /// Length of leg and spine, units of the file.
        length: f64,
    },
    /// Left and right of the person are not reliable.
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
