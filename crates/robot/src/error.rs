//! Errors in a robot's files.

/// The reason why a robot was refused. Every text names the file, the key, the value and the bound. Numbers are SI.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[allow(missing_docs, reason = "the texts name the fields")]
pub enum RobotError {
    #[error("{file}: length: {bytes} bytes, at most {bound} are read")]
    TooLong { file: String, bytes: usize, bound: usize },
    #[error("{file}: {key}: {count}, at most {bound}")]
    TooMany { file: String, key: String, count: usize, bound: usize },
    #[error("{file}: {cause}")]
    Syntax { file: String, cause: String },
    #[error("{file}: {construct} is not allowed")]
    Forbidden { file: String, construct: String },
    #[error("{file}: {key} `{name}` occurs twice, names must be unique")]
    Duplicate { file: String, key: String, name: String },
    #[error("{file}: {key}: `{name}` is not {expected}")]
    Unknown { file: String, key: String, name: String, expected: String },
    #[error(
        "{file}: roots: {}, exactly one link may have no \
         parent", if roots.is_empty() { "none".to_owned() } else { roots.join(", ") }
    )]
    Roots { file: String, roots: Vec<String> },
    #[error("{file}: link `{link}` is part of a loop or has two parents, the links must form a tree")]
    Loop { file: String, link: String },
    #[error("{file}: joint `{joint}`: type {value}, {bound}")]
    JointKind { file: String, joint: String, value: String, bound: String },
    #[error("{file}: joint `{joint}`: {key} = {}, {bound}", schema::short(*.value))]
    Joint { file: String, joint: String, key: String, value: f64, bound: String },
    #[error("{file}: {key}: edited after the fit: {advice}")]
    Edited { file: String, key: String, advice: String },
    #[error("{file}: {key} = {value}, {bound}")]
    Value { file: String, key: String, value: String, bound: String },
    #[error("{}", errors.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n"))]
    Several { errors: Vec<RobotError> },
}

impl RobotError {
    /// Returns the value, or adds the error to the others.
    pub(crate) fn keep<T>(read: Result<T, Self>, errors: &mut Vec<Self>) -> Option<T> {
        read.map_err(|error| errors.push(error)).ok()
    }

    /// Refuses for all errors at once.
    pub(crate) fn all(mut errors: Vec<Self>) -> Result<(), Self> {
        match errors.len() {
            0 => Ok(()),
            1 => Err(errors.remove(0)),
            _ => Err(Self::Several { errors }),
        }
    }

    pub(crate) fn value(
        file: &str,
        key: impl Into<String>,
        value: impl Into<String>,
        bound: impl Into<String>,
    ) -> Self {
        Self::Value { file: file.into(), key: key.into(), value: value.into(), bound: bound.into() }
    }

    pub(crate) fn unknown(file: &str, key: impl Into<String>, name: &str, expected: &str) -> Self {
        Self::Unknown { file: file.into(), key: key.into(), name: name.into(), expected: expected.into() }
    }

    pub(crate) fn duplicate(file: &str, key: &str, name: &str) -> Self {
        Self::Duplicate { file: file.into(), key: key.into(), name: name.into() }
    }
}
