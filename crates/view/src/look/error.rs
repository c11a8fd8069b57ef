//! Errors in a look file or a mesh folder.

/// Reason why a robot's look was rejected. Every text names the file, the key, the value and the bound.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[allow(missing_docs, reason = "the texts name the fields")]
pub enum LookError {
    #[error("{file}: {cause}")]
    Read { file: String, cause: String },
    #[error("{file}: {cause}")]
    Syntax { file: String, cause: String },
    #[error("{file}: {key} = `{name}`, must be {expected}")]
    Unknown { file: String, key: String, name: String, expected: String },
    #[error("{file}: {key} = {value}, must be {bound}")]
    Value { file: String, key: String, value: String, bound: String },
}
