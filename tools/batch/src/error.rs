//! What can go wrong with one file, or with all.

use std::path::PathBuf;
use thiserror::Error;

/// Why a run or a file of it failed.
#[derive(Debug, Error)]
pub enum BatchError {
    /// The robot or its weights are refused.
    #[error(transparent)]
    Config(#[from] pipeline::ConfigError),
    /// The retargeting refuses its options.
    #[error(transparent)]
    Options(#[from] retarget::ConfigError),
    /// A motion file is refused.
    #[error(transparent)]
    Motion(#[from] motion::MotionError),
    /// The operating system refused.
    #[error("{file}: cannot {action}: {source}", file = .path.display())]
    File {
        /// The file or folder.
        path: PathBuf,
        /// What was tried.
        action: &'static str,
        /// Cause.
        source: std::io::Error,
    },
    /// The output would be read as input next time.
    #[error("--out {out} lies in --input {input}: its files would be taken for motions", out = .out.display(), input = .input.display())]
    OutInInput {
        /// --out.
        out: PathBuf,
        /// --input.
        input: PathBuf,
    },
    /// No motion file at all.
    #[error("--input {input}: no .bvh, .npy or .npz in it{hint}", input = .input.display())]
    NoFiles {
        /// --input.
        input: PathBuf,
        /// What may help.
        hint: &'static str,
    },
    /// Two inputs differ by their extension alone.
    #[error("{file}: its output {out} is already that of {other}", file = .file.display(), out = .out.display(), other = .other.display())]
    SameOutput {
        /// This input.
        file: PathBuf,
        /// The output of both.
        out: PathBuf,
        /// The input that comes first.
        other: PathBuf,
    },
    /// A file stands where an output belongs, and this tool did not write it.
    #[error("{path}: was not written by this tool, or was changed since: --overwrite replaces it", path = .path.display())]
    Foreign {
        /// The file.
        path: PathBuf,
    },
    /// Another run writes into the folder.
    #[error("--out {folder}: another batch is writing there", folder = .folder.display())]
    Busy {
        /// --out.
        folder: PathBuf,
    },
    /// More rows than a file may have.
    #[error("{file}: {rows} rows at {rate_hz} Hz, at most {max} are written", file = .file.display())]
    Rows {
        /// The motion file.
        file: PathBuf,
        /// Rows that it would take.
        rows: usize,
        /// Their rate.
        rate_hz: f64,
        /// The bound.
        max: usize,
    },
    /// Something in a frame that cannot be retargeted.
    #[error("{file}: frame {frame}: {cause}", file = .file.display())]
    Frame {
        /// The motion file.
        file: PathBuf,
        /// The frame, from 0.
        frame: usize,
        /// What is wrong with it.
        cause: &'static str,
    },
    /// Ctrl-C.
    #[error("interrupted")]
    Interrupted,
}

impl BatchError {
    /// For `map_err`.
    pub(crate) fn file(path: &std::path::Path, action: &'static str) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_path_buf();
        move |source| Self::File { path, action, source }
    }
}
