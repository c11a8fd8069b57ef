//! What can be wrong with a motion file.

use crate::mirror::MirrorError;
use thiserror::Error;

/// Why a file gave no motion.
#[derive(Debug, Error)]
pub enum MotionError {
    /// The operating system refused.
    #[error("{file}: {source}")]
    Io {
        /// Path.
        file: String,
        /// Cause.
        source: std::io::Error,
    },
    /// No reader for this extension.
    #[error("{file}: extension \"{extension}\" is not known; motion files are .bvh, .npy, .npz and .mcap")]
    UnknownFormat {
        /// Path.
        file: String,
        /// Extension in lower case.
        extension: String,
    },
    /// A folder.
    #[error("{file} is a folder; name one motion file in it (.bvh, .npy, .npz or .mcap)")]
    Folder {
        /// Path.
        file: String,
    },
    /// Refused before reading.
    #[error("{file}: {bytes} bytes, at most {bound}")]
    TooLarge {
        /// Path.
        file: String,
        /// Length of the file.
        bytes: u64,
        /// Bound.
        bound: u64,
    },
    /// Not a BVH that can be used.
    #[error("{file}: {source}")]
    Bvh {
        /// Path.
        file: String,
        /// Cause.
        source: BvhError,
    },
    /// Not an array that can be used.
    #[error("{file}: {source}")]
    Array {
        /// Path.
        file: String,
        /// Cause.
        source: ArrayError,
    },
    /// Not a recording that can be played.
    #[error("{file}: {source}")]
    Mcap {
        /// Path.
        file: String,
        /// Cause.
        source: McapError,
    },
    /// Left and right cannot be trusted.
    #[error("{file}: {source}")]
    Mirror {
        /// Path.
        file: String,
        /// Cause.
        source: MirrorError,
    },
}

/// What is wrong with a .mcap.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum McapError {
    /// Another kind of file.
    #[error("is not an MCAP file: {cause}")]
    NotMcap {
        /// What its reader says.
        cause: String,
    },
    /// The file cannot be read.
    #[error("cannot be read: {cause}")]
    Read {
        /// What the system says.
        cause: String,
    },
    /// More channels or schemas than are read.
    #[error("names more than {bound} channels or schemas")]
    Channels {
        /// Bound.
        bound: usize,
    },
    /// A larger chunk than is read.
    #[error("the chunk at byte {offset} says that it unpacks to {bytes} bytes, at most {bound} are read")]
    Chunk {
        /// Where it begins.
        offset: u64,
        /// Its length before compression.
        bytes: u64,
        /// Bound.
        bound: u64,
    },
    /// More comes out of the chunks than such a file may hold.
    #[error("up to byte {offset} it unpacks to {bytes} bytes, at most {bound} are read of that much of a file")]
    Unpacked {
        /// How far the file was read: where the chunk begins that is too much.
        offset: u64,
        /// What it unpacks to with this chunk.
        bytes: u64,
        /// Bound.
        bound: u64,
    },
    /// A longer motion than is read.
    #[error("holds more than {bound} skeletons")]
    Frames {
        /// Bound.
        bound: usize,
    },
    /// A recording of something else, or of another version.
    #[error("holds {count} skeletons of the layout {layout}, at least 2 are needed; its topics are {topics}")]
    NoSkeletons {
        /// How many were found.
        count: usize,
        /// Their schema.
        layout: &'static str,
        /// Topics of the file, the first 16.
        topics: String,
    },
}

/// What is wrong with a .npy or .npz.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum ArrayError {
    /// Another kind of file.
    #[error("is not a .npy file (it does not begin with \\x93NUMPY and a version)")]
    NotNpy,
    /// Another kind of file.
    #[error("is not a .npz file: {cause}")]
    NotZip {
        /// What the archive's reader says.
        cause: String,
    },
    /// A header that says nothing useful.
    #[error("the .npy header is damaged: {cause}")]
    Header {
        /// What is wrong.
        cause: String,
    },
    /// Numbers of a type that is not read; objects are pickles.
    #[error("numbers of type {found} are not read; f4, f8 and integers are (objects are pickles and never read)")]
    Type {
        /// NumPy's name of the type.
        found: String,
    },
    /// An array beyond the bound.
    #[error("shape {shape:?} is more than {bound} numbers")]
    TooLarge {
        /// Shape claimed.
        shape: Vec<usize>,
        /// Bound, numbers.
        bound: usize,
    },
    /// A longer motion than is read.
    #[error("{frames} frames, at most {bound} are read")]
    TooManyFrames {
        /// Frames of the array.
        frames: usize,
        /// Bound.
        bound: usize,
    },
    /// The file ends before the array does.
    #[error("shape {shape:?} needs {claimed} bytes, and {found} follow")]
    Short {
        /// Shape claimed.
        shape: Vec<usize>,
        /// Bytes that follow the header.
        found: u64,
        /// Bytes needed.
        claimed: u64,
    },
    /// The file cannot be read to its end.
    #[error("is damaged: {cause}")]
    Damaged {
        /// What the reader says.
        cause: String,
    },
    /// Something in an array of an archive, or in another file.
    #[error("{key}: {source}")]
    Key {
        /// The key or file.
        key: String,
        /// What is wrong there.
        source: Box<ArrayError>,
    },
    /// An archive without motion.
    #[error("has no {missing}; its keys are {}", .found.join(", "))]
    MissingKeys {
        /// What is missing.
        missing: &'static str,
        /// Keys of the archive, the first 40.
        found: Vec<String>,
    },
    /// Another shape than motion has.
    #[error("has shape {found:?}, expected is {expected}")]
    Shape {
        /// Shape found.
        found: Vec<usize>,
        /// Shapes that are read.
        expected: &'static str,
    },
    /// No frames.
    #[error("has shape {shape:?}: no frame")]
    Empty {
        /// Shape found.
        shape: Vec<usize>,
    },
    /// A number that is infinite, NaN or out of every proportion.
    #[error("frame {frame}, number {column}: {value} is not within +-{bound}")]
    Number {
        /// Frame, from 0.
        frame: usize,
        /// Number in the frame, from 0.
        column: usize,
        /// Value.
        value: f64,
        /// Bound of its magnitude.
        bound: f64,
    },
    /// A frame rate that no camera has.
    #[error("frame rate {value} Hz is not within [{low}, {high}]")]
    FrameRate {
        /// Value, Hz.
        value: f64,
        /// Lowest, Hz.
        low: f64,
        /// Highest, Hz.
        high: f64,
    },
    /// Bones without length.
    #[error("legs and spine have no length ({length} m)")]
    NoSize {
        /// Leg and spine.
        length: f64,
    },
    /// A Mean.npy or Std.npy, not motion.
    #[error("has shape [263]: the statistics of features (Mean.npy or Std.npy), not motion, which is (N, 263)")]
    Statistics,
    /// Normalised features without Mean and Std.
    #[error(
        "the features look normalised ({signs}), and there is no Mean.npy and Std.npy beside the file or up to {levels} \
         folders above: give the options `mean` and `std`"
    )]
    NeedsStatistics {
        /// Why they look so.
        signs: String,
        /// Folders above that were looked at.
        levels: usize,
    },
    /// One option without the other.
    #[error("the options `mean` and `std` go together, one is missing")]
    HalfOfStatistics,
    /// Statistics that do not lead to a person.
    #[error("with {mean} and its Std the features are no person ({after}); as stored: {before}")]
    WrongStatistics {
        /// The file with the mean.
        mean: String,
        /// Signs before.
        before: String,
        /// Signs after.
        after: String,
    },
}

impl ArrayError {
    /// The same, of one array of an archive.
    pub(crate) fn in_key(self, key: &str) -> Self {
        Self::Key { key: key.to_owned(), source: Box::new(self) }
    }
}

/// What is wrong with the text of a BVH; lines count from 1.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum BvhError {
    /// Nothing but white space.
    #[error("the file is empty")]
    Empty,
    /// The file ends too early.
    #[error("line {line}: the file ends where {expected} should follow")]
    Truncated {
        /// Last line.
        line: usize,
        /// What is missing.
        expected: &'static str,
    },
    /// Another word stands where the grammar wants this one.
    #[error("line {line}: \"{found}\" where {expected} should stand")]
    Unexpected {
        /// Line.
        line: usize,
        /// The word, shortened.
        found: String,
        /// What the grammar wants.
        expected: &'static str,
    },
    /// Not a number.
    #[error("line {line}: \"{found}\" is not a number ({what})")]
    NotANumber {
        /// Line.
        line: usize,
        /// The word, shortened.
        found: String,
        /// What the number is for.
        what: &'static str,
    },
    /// A number that is infinite, NaN or out of every proportion.
    #[error("line {line}: {what} {value} is not within +-{bound}")]
    OutOfRange {
        /// Line.
        line: usize,
        /// What the number is for.
        what: &'static str,
        /// Value.
        value: f64,
        /// Bound of its magnitude.
        bound: f64,
    },
    /// A time between two frames that no motion has.
    #[error(
        "line {line}: Frame Time: {value_s} is outside [{low_s}, {high_s}] s; write the seconds from one frame to the \
         next, such as 0.0333333 for 30 frames a second"
    )]
    FrameTime {
        /// Line of `Frame Time:`.
        line: usize,
        /// Value, s.
        value_s: f64,
        /// Shortest time, s.
        low_s: f64,
        /// Longest time, s.
        high_s: f64,
    },
    /// Joints nested or counted beyond any body.
    #[error("line {line}: {what}: {value}, at most {bound}")]
    TooMany {
        /// Line.
        line: usize,
        /// What there is too much of.
        what: &'static str,
        /// How many.
        value: u64,
        /// Bound.
        bound: u64,
    },
    /// The header claims more than the file can hold.
    #[error(
        "line {line}: {claimed} frames of {channels} numbers (at least 18) do not fit in the remaining {bytes} bytes"
    )]
    FrameCount {
        /// Line of `Frames:`.
        line: usize,
        /// Frames claimed.
        claimed: u64,
        /// Numbers in a frame.
        channels: usize,
        /// Bytes that follow.
        bytes: usize,
    },
    /// Fewer than two frames: the first is a pose, not motion.
    #[error("line {line}: {frames} frame(s); at least 2 are needed, because the first is a pose, not motion")]
    TooFewFrames {
        /// Line of `Frames:`.
        line: usize,
        /// Frames claimed.
        frames: u64,
    },
    /// Text after the last frame.
    #[error("line {line}: more numbers than the {frames} frames of the header")]
    Trailing {
        /// Line.
        line: usize,
        /// Frames claimed.
        frames: u64,
    },
    /// The rig has no joint for these.
    #[error("the rig has no joint for {}; it has {}", sought(.missing), .found.join(", "))]
    MissingJoints {
        /// SMPL-22 names.
        missing: Vec<&'static str>,
        /// The rig's names, the first 40.
        found: Vec<String>,
    },
    /// Bones without length.
    #[error("legs and spine have no length ({length} units): no scale can be guessed")]
    NoSize {
        /// Leg and spine, units of the file.
        length: f64,
    },
    /// Left and right cannot be trusted.
    #[error(transparent)]
    Mirror(MirrorError),
}

/// The joints' names, and what else those are called that many rigs call otherwise.
fn sought(missing: &[&str]) -> String {
    let called = |name: &&str| match *name {
        "left_foot" | "right_foot" => format!("{name} (the toes: ToeBase)"),
        name => name.to_owned(),
    };
    missing.iter().map(called).collect::<Vec<_>>().join(", ")
}
