//! Errors in a look file or a mesh folder.

/// Reason why a robot's look was rejected. Every text names the file, the key, the value and the bound.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum LookError {
    /// A file or folder cannot be read.
    #[error("{file}: {cause}")]
    Read {
        /// The file or folder.
        file: String,
        /// The system's error text.
        cause: String,
    },
    /// The text is not TOML, or a key is unknown, missing or has the wrong type. The cause names line and key.
    #[error("{file}: {cause}")]
    Syntax {
        /// File.
        file: String,
        /// The parser's error text.
        cause: String,
    },
    /// A name refers to nothing.
    #[error("{file}: {key} = `{name}`, must be {expected}")]
    Unknown {
        /// File.
        file: String,
        /// Key at which the name stands.
        key: String,
        /// The name.
        name: String,
        /// Allowed names.
        expected: String,
    },
    /// A value is outside its bounds.
    #[error("{file}: {key} = {value}, must be {bound}")]
    Value {
        /// File.
        file: String,
        /// The key.
        key: String,
        /// Its value.
        value: String,
        /// Allowed values.
        bound: String,
    },
}
