//! Errors of making a plant.

/// Returned when the texts or the options are refused. Every message names the file, the key, the value and the
/// allowed values.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[allow(missing_docs, reason = "the texts name the fields")]
pub enum PlantError {
    /// The text cannot be parsed.
    #[error("{file}: {cause}")]
    Syntax { file: String, cause: String },
    /// A required entry is missing.
    #[error("{file}: {key}: missing, it is required; add it")]
    Missing { file: String, key: String },
    /// A name refers to nothing.
    #[error("{file}: {key}: `{name}` is not {expected}; correct the name")]
    Unknown { file: String, key: String, name: String, expected: String },
    /// A value is out of its bounds.
    #[error("{file}: {key} = {value}: {bound}")]
    Value { file: String, key: String, value: String, bound: String },
}

impl PlantError {
    pub(crate) fn value(file: &str, key: &str, value: impl ToString, bound: impl Into<String>) -> Self {
        Self::Value { file: file.into(), key: key.into(), value: value.to_string(), bound: bound.into() }
    }

    pub(crate) fn missing(file: &str, key: impl Into<String>) -> Self {
        Self::Missing { file: file.into(), key: key.into() }
    }

    pub(crate) fn unknown(file: &str, key: impl Into<String>, name: &str, expected: &str) -> Self {
        Self::Unknown { file: file.into(), key: key.into(), name: name.into(), expected: expected.into() }
    }
}
