//! Errors of one file, or of all.

use std::path::PathBuf;
use thiserror::Error;

/// An error of a run, or of one file in it.
#[derive(Debug, Error)]
pub enum BatchError {
    /// The robot or its weights are invalid.
    #[error(transparent)]
    Config(#[from] config::ConfigError),
    /// Retargeting rejects its options.
    #[error(transparent)]
    Options(#[from] retarget::ConfigError),
    /// A motion file is invalid.
    #[error(transparent)]
    Motion(#[from] motion::MotionError),
    /// A system call failed.
    #[error("{file}: cannot {action}: {source}", file = .path.display())]
    File {
        /// The file or folder.
        path: PathBuf,
        /// The attempted action.
        action: &'static str,
        /// Cause.
        source: std::io::Error,
    },
    /// The next run would read the output as input.
    #[error(
        "--out {out} lies in --input {input}, so its files would be read as motions; give another \
         --out", out = .out.display(), input = .input.display()
    )]
    OutInInput {
        /// --out.
        out: PathBuf,
        /// --input.
        input: PathBuf,
    },
    /// There is no motion file.
    #[error("--input {input}: no .bvh, .npy or .npz in it{hint}", input = .input.display())]
    NoFiles {
        /// --input.
        input: PathBuf,
        /// A hint.
        hint: &'static str,
    },
    /// Two inputs differ only in their extension.
    #[error(
        "{file}: its output {out} is already that of \
         {other}", file = .file.display(), out = .out.display(), other = .other.display()
    )]
    SameOutput {
        /// This input.
        file: PathBuf,
        /// The output of both.
        out: PathBuf,
        /// The input that comes first.
        other: PathBuf,
    },
    /// A file is in the place of an output, and this tool did not write it.
    #[error(
        "{path}: was not written by this tool, or was changed since; --overwrite replaces it", path = .path.display()
    )]
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
    /// A file would have too many rows.
    #[error("{file}: {rows} rows at {rate_hz} Hz, at most {max} are written", file = .file.display())]
    Rows {
        /// The motion file.
        file: PathBuf,
        /// Number of rows that it would have.
        rows: usize,
        /// Their rate.
        rate_hz: f64,
        /// The bound.
        max: usize,
    },
    /// A frame cannot be retargeted.
    #[error("{file}: frame {frame}: {cause}", file = .file.display())]
    Frame {
        /// The motion file.
        file: PathBuf,
        /// The frame, from 0.
        frame: usize,
        /// The problem.
        cause: &'static str,
    },
    /// Ctrl-C was pressed.
    #[error("interrupted")]
    Interrupted,
}

impl BatchError {
    /// Returns a function for `map_err`.
    pub(crate) fn file(path: &std::path::Path, action: &'static str) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_path_buf();
        move |source| Self::File { path, action, source }
    }
}
