//! What can be wrong with a look file or a folder of meshes.

/// Why a robot's look was refused. Every text names the file, the key, the value and the bound.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum LookError {
    /// A file or folder cannot be read.
    #[error("{file}: {cause}")]
    Read {
        /// The file or folder.
        file: String,
        /// What the system says.
        cause: String,
    },
    /// The text is not TOML, or a key is unknown, missing or mistyped; the cause names line and key.
    #[error("{file}: {cause}")]
    Syntax {
        /// File.
        file: String,
        /// The parser's words.
        cause: String,
    },
    /// A name that refers to nothing.
    #[error("{file}: {key} = `{name}`, must be {expected}")]
    Unknown {
        /// File.
        file: String,
        /// Where the name stands.
        key: String,
        /// The name.
        name: String,
        /// What it should have been.
        expected: String,
    },
    /// A value out of its bounds.
    #[error("{file}: {key} = {value}, must be {bound}")]
    Value {
        /// File.
        file: String,
        /// Which key.
        key: String,
        /// Its value.
        value: String,
        /// What is accepted.
        bound: String,
    },
}
