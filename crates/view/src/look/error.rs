//! Errors in a look file or a mesh folder.

/// Reason why a robot's look was rejected. Every text names the file, the key, the value and the bound.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[allow(missing_docs, reason = "the texts name the fields")]
pub enum LookError {
    /// A file or folder cannot be read.
    #[error("{file}: {cause}")]
    Read { file: String, cause: String },
    /// The text is not TOML, or a key is unknown, missing or has the wrong type. The cause names line and key.
    #[error("{file}: {cause}")]
    Syntax { file: String, cause: String },
    /// A name refers to nothing.
    #[error("{file}: {key} = `{name}`, must be {expected}")]
    Unknown { file: String, key: String, name: String, expected: String },
    /// A value is outside its bounds.
    #[error("{file}: {key} = {value}, must be {bound}")]
    Value { file: String, key: String, value: String, bound: String },
}
