//! Errors of a layout file.

/// Error in a file that describes a layout.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[allow(missing_docs, reason = "the texts name the fields")]
pub enum LayoutError {
    /// The file is not TOML, or has an unknown, missing or mistyped key.
    #[error("{file}: {cause}")]
    Syntax { file: String, cause: String },
    /// A value is not allowed.
    #[error("{file}: {key} = {value} must be {bound}")]
    Value { file: String, key: String, value: String, bound: String },
}
