//! What a stage's shell needs of any transport.

use crate::error::PublishError;

/// Something that takes messages.
pub trait Publish<M> {
    /// Makes `message` the newest one.
    fn publish(&mut self, message: &M) -> Result<(), PublishError>;
}

/// Something that holds the newest message.
pub trait Latest<M> {
    /// The newest message, if one has arrived since the last call.
    fn latest(&mut self) -> Option<M>;
}
