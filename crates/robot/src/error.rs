//! What can be wrong with a robot's files.

/// Why a robot was refused. Every text names the file, the key, the value and the bound.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RobotError {
    /// The text is longer than anything that describes a robot.
    #[error("{file}: length: {bytes} bytes, at most {bound} are read")]
    TooLong {
        /// File.
        file: String,
        /// Its length, bytes.
        bytes: usize,
        /// The most that is read, bytes.
        bound: usize,
    },
    /// More of something than is accepted.
    #[error("{file}: {key}: {count}, at most {bound}")]
    TooMany {
        /// File.
        file: String,
        /// What there is too much of.
        key: String,
        /// How many there are.
        count: usize,
        /// How many are accepted.
        bound: usize,
    },
    /// The text is not what its format asks for; the cause names the key.
    #[error("{file}: {cause}")]
    Syntax {
        /// File.
        file: String,
        /// The parser's words.
        cause: String,
    },
    /// A construct that no robot needs and that attackers like.
    #[error("{file}: {construct} is refused")]
    Forbidden {
        /// File.
        file: String,
        /// Which construct.
        construct: String,
    },
    /// The same name twice.
    #[error("{file}: {key} `{name}` occurs twice, names must be unique")]
    Duplicate {
        /// File.
        file: String,
        /// Kind of thing.
        key: String,
        /// Its name.
        name: String,
    },
    /// A name that refers to nothing.
    #[error("{file}: {key}: `{name}` is not {expected}")]
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
    /// The links are not one tree.
    #[error("{file}: roots: {}, exactly one link may have no parent", if roots.is_empty() { "none".to_owned() } else { roots.join(", ") })]
    Roots {
        /// File.
        file: String,
        /// Links without a parent.
        roots: Vec<String>,
    },
    /// A link that cannot be reached from the root, or that has two parents.
    #[error("{file}: link `{link}` is part of a loop or has two parents, the links must form a tree")]
    Loop {
        /// File.
        file: String,
        /// The link.
        link: String,
    },
    /// A joint of a kind that cannot be commanded.
    #[error("{file}: joint `{joint}`: type {value}, {bound}")]
    JointKind {
        /// File.
        file: String,
        /// The joint.
        joint: String,
        /// Its type.
        value: String,
        /// What is accepted.
        bound: String,
    },
    /// A number of a joint out of its bounds.
    #[error("{file}: joint `{joint}`: {key} = {value}, {bound}")]
    Joint {
        /// File.
        file: String,
        /// The joint.
        joint: String,
        /// Which number.
        key: String,
        /// Its value, SI.
        value: f64,
        /// What is accepted.
        bound: String,
    },
    /// Any other value out of its bounds.
    #[error("{file}: {key} = {value}, {bound}")]
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
