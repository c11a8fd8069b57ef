//! What can be wrong with a motion file.

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
    #[error("{file}: extension \"{extension}\" is not known; motion files are .bvh")]
    UnknownFormat {
        /// Path.
        file: String,
        /// Extension in lower case.
        extension: String,
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
    #[error("the rig has no joint for {}; it has {}", .missing.join(", "), .found.join(", "))]
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
    /// Left and right are swapped.
    #[error("the body is a mirror image or its left and right are swapped (sides {sides:.2}, front {front:.2})")]
    Mirrored {
        /// Mean cosine between shoulders and hips.
        sides: f64,
        /// Mean evidence of feet and knees, negative for a mirror image.
        front: f64,
    },
}
