//! Errors of a layout file.

/// Error in a file that describes a layout.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LayoutError {
    /// The file is not TOML, or has an unknown, missing or mistyped key.
    #[error("{file}: {cause}")]
    Syntax {
        /// The file.
        file: String,
        /// Line, key and cause.
        cause: String,
    },
    /// A value is not allowed.
    #[error("{file}: {key} = {value} must be {bound}")]
    Value {
        /// The file.
        file: String,
        /// The key.
        key: String,
        /// The value in the file.
        value: String,
        /// Allowed values.
        bound: String,
    },
}
