//! Errors of making or reading a recording.

#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    #[error("the recording cannot be written: {cause}")]
    Write { cause: String },
    #[error("{cause}")]
    Open { cause: String },
    #[error("{file}: {source}")]
    Read { file: String, source: motion::McapError },
    #[error("{file}: {cause}")]
    Lacks { file: String, cause: String },
    #[error("{file}: {cause}")]
    Plot { file: String, cause: String },
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
