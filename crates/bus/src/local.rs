//! A latest-value slot inside one process.

use crate::error::PublishError;
use crate::port::{Latest, Publish};

/// Holds the newest message until it is read. One value has both ends, for stages that run in turn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Channel<M> {
    newest: Option<M>,
}

impl<M> Default for Channel<M> {
    fn default() -> Self {
        Self { newest: None }
    }
}

impl<M> Channel<M> {
    /// Creates an empty slot.
    pub fn new() -> Self {
        Self::default()
    }
}

impl<M: Copy> Publish<M> for Channel<M> {
    fn publish(&mut self, message: &M) -> Result<(), PublishError> {
        self.newest = Some(*message);
        Ok(())
    }
}

impl<M> Latest<M> for Channel<M> {
    fn latest(&mut self) -> Option<M> {
        self.newest.take()
    }
}
