//! Why a recording cannot be made or read.

/// What is wrong, in one sentence.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// The file cannot be written.
    #[error("the recording cannot be written: {cause}")]
    Write {
        /// What the system says.
        cause: String,
    },
    /// The file cannot be opened.
    #[error("{cause}")]
    Open {
        /// The file, what the system says, and what to do.
        cause: String,
    },
    /// The file is no recording, or one that is not read.
    #[error("{file}: {source}")]
    Read {
        /// The file.
        file: String,
        /// Why.
        source: motion::McapError,
    },
    /// The file lacks what is asked of it.
    #[error("{file}: {cause}")]
    Lacks {
        /// The file.
        file: String,
        /// What is missing, and what to do.
        cause: String,
    },
    /// A picture cannot be drawn.
    #[error("{file}: {cause}")]
    Plot {
        /// The picture.
        file: String,
        /// Why.
        cause: String,
    },
}

impl RecordError {
    pub(crate) fn write(error: mcap::McapError) -> Self {
        // The system's own words, if it has any.
        let cause = match &error {
            mcap::McapError::Io(cause) => cause.to_string(),
            error => error.to_string(),
        };
        Self::Write { cause }
    }
}
