//! Errors of making or reading a recording.

/// An error, in one sentence.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// The file cannot be written.
    #[error("the recording cannot be written: {cause}")]
    Write {
        /// The system's error text.
        cause: String,
    },
    /// The file cannot be opened.
    #[error("{cause}")]
    Open {
        /// The file, the system's error text, and what to do.
        cause: String,
    },
    /// The file is not a recording, or of a kind that is not supported.
    #[error("{file}: {source}")]
    Read {
        /// The file.
        file: String,
        /// The reason.
        source: motion::McapError,
    },
    /// The file lacks required data.
    #[error("{file}: {cause}")]
    Lacks {
        /// The file.
        file: String,
        /// The missing data, and what to do.
        cause: String,
    },
    /// A picture cannot be drawn.
    #[error("{file}: {cause}")]
    Plot {
        /// The picture.
        file: String,
        /// The reason.
        cause: String,
    },
}

impl RecordError {
    pub(crate) fn write(error: mcap::McapError) -> Self {
        // Use the system's own error text, if there is one.
        let cause = match &error {
            mcap::McapError::Io(cause) => cause.to_string(),
            error => error.to_string(),
        };
        Self::Write { cause }
    }
}
