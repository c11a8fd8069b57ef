//! Errors in a robot's files.

/// The reason why a robot was refused. Every text names the file, the key, the value and the bound.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RobotError {
    /// Returned if the text is longer than any description of a robot.
    #[error("{file}: length: {bytes} bytes, at most {bound} are read")]
    TooLong {
        /// File.
        file: String,
        /// Its length, bytes.
        bytes: usize,
        /// Largest accepted length, bytes.
        bound: usize,
    },
    /// Returned if there are more items of a kind than accepted.
    #[error("{file}: {key}: {count}, at most {bound}")]
    TooMany {
        /// File.
        file: String,
        /// Kind of the items.
        key: String,
        /// Number of items.
        count: usize,
        /// Largest accepted number.
        bound: usize,
    },
    /// Returned if the text does not follow its format. The cause names the key.
    #[error("{file}: {cause}")]
    Syntax {
        /// File.
        file: String,
        /// The parser's message.
        cause: String,
    },
    /// Returned for a construct that no robot needs and that attackers use.
    #[error("{file}: {construct} is not allowed")]
    Forbidden {
        /// File.
        file: String,
        /// Name of the construct.
        construct: String,
    },
    /// Returned if the same name occurs twice.
    #[error("{file}: {key} `{name}` occurs twice, names must be unique")]
    Duplicate {
        /// File.
        file: String,
        /// Kind of the named item.
        key: String,
        /// Its name.
        name: String,
    },
    /// Returned if a name refers to nothing.
    #[error("{file}: {key}: `{name}` is not {expected}")]
    Unknown {
        /// File.
        file: String,
        /// Place of the name.
        key: String,
        /// The name.
        name: String,
        /// Description of the expected name.
        expected: String,
    },
    /// Returned if the links are not one tree.
    #[error(
        "{file}: roots: {}, exactly one link may have no \
         parent", if roots.is_empty() { "none".to_owned() } else { roots.join(", ") }
    )]
    Roots {
        /// File.
        file: String,
        /// Links without a parent.
        roots: Vec<String>,
    },
    /// Returned if a link cannot be reached from the root, or has two parents.
    #[error("{file}: link `{link}` is part of a loop or has two parents, the links must form a tree")]
    Loop {
        /// File.
        file: String,
        /// The link.
        link: String,
    },
    /// Returned if a joint is of a kind that cannot be commanded.
    #[error("{file}: joint `{joint}`: type {value}, {bound}")]
    JointKind {
        /// File.
        file: String,
        /// The joint.
        joint: String,
        /// Its type.
        value: String,
        /// The accepted kinds.
        bound: String,
    },
    /// Returned if a number of a joint is out of its bounds.
    #[error("{file}: joint `{joint}`: {key} = {value}, {bound}")]
    Joint {
        /// File.
        file: String,
        /// The joint.
        joint: String,
        /// Name of the number.
        key: String,
        /// Its value, SI.
        value: f64,
        /// The accepted values.
        bound: String,
    },
    /// Returned if any other value is out of its bounds.
    #[error("{file}: {key} = {value}, {bound}")]
    Value {
        /// File.
        file: String,
        /// The key.
        key: String,
        /// Its value.
        value: String,
        /// The accepted values.
        bound: String,
    },
}
