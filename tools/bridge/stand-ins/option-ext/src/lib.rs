//! Stands in for the crate of this name, whose licence is not on the list of `deny.toml`.
#![no_std]

/// A question to an `Option`.
pub trait OptionExt<T> {
    /// Returns true for `Some` of a value that equals `x`.
    fn contains<U: PartialEq<T>>(&self, x: &U) -> bool;
}

impl<T> OptionExt<T> for Option<T> {
    fn contains<U: PartialEq<T>>(&self, x: &U) -> bool {
        self.as_ref().is_some_and(|value| x == value)
    }
}
