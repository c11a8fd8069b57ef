//! The interface that a stage's shell needs from any transport.

use crate::error::PublishError;

/// A port that takes messages.
pub trait Publish<M> {
    /// Makes `message` the newest one.
    fn publish(&mut self, message: &M) -> Result<(), PublishError>;
}

/// A port that holds the newest message.
pub trait Latest<M> {
    /// Returns the newest message, if one has arrived since the last call.
    fn latest(&mut self) -> Option<M>;
}
