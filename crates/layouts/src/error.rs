//! Why a layout from a file is refused.

/// What is wrong with a file that describes a layout.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LayoutError {
    /// Not TOML, or an unknown, missing or mistyped key.
    #[error("{file}: {cause}")]
    Syntax {
        /// The file.
        file: String,
        /// Line, key and cause.
        cause: String,
    },
    /// A value that is not allowed.
    #[error("{file}: {key} = {value} must be {bound}")]
    Value {
        /// The file.
        file: String,
        /// The key.
        key: String,
        /// What stands there.
        value: String,
        /// What may stand there.
        bound: String,
    },
}
