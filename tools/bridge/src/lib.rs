//! Client for motion capture programs that send persons over UDP. It receives their packets and publishes the
//! persons. It is a process of its own. Network data is parsed here, and nowhere in the daemon.
//!
//! A packet is never trusted. Its length is checked before it is read. A packet of another protocol is rejected
//! and counted. `ingest` judges whether a person is plausible, as for every other client.

#![allow(missing_docs, reason = "the library of a program: only the program, tests and other tools use it")]

pub mod cli;
pub mod link;
mod mvn;
mod senders;
mod users;
mod vmc;

pub use mvn::Mvn;
pub use senders::{SenderChange, Senders, canonical};
pub use users::Users;
pub use vmc::Vmc;

use messages::{Layout, RawSkeleton, SkeletonLayout};

/// Longest packet that is read, bytes. A person of MVN takes 760, one of VMC with all fingers some 4,000.
pub const PACKET_MAX: usize = 16 << 10;

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, thiserror::Error)]
pub enum Refused {
    #[error("from another protocol")]
    Protocol,
    /// A message of VMC. Its address, the bone or the empty text, the value's name, and what stands there.
    #[error("with {3} for {2} of {0} {1}, where a number must be")]
    Value(&'static str, &'static str, &'static str, &'static str),
    #[error("whose first value of {0} is no name")]
    Name(&'static str),
    #[error("of a length that differs from its header")]
    Length,
    #[error("older than the previous one")]
    Late,
    #[error("with a repeated segment")]
    Twice,
    /// Another sender holds the turn. Only one is accepted at a time.
    #[error("from another sender")]
    Stranger,
    #[error("for another character")]
    Character,
    /// The sender is on this machine and belongs to a user who may not send.
    #[error("from another user of this machine, or from a sender that has ended")]
    User,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Taken {
    /// It has no data of the selected person.
    Aside,
    /// It has such data. Its sender keeps the turn.
    Person,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Restarts of the sender, as far as its packets show them. A packet that shows a restart is rejected.
    pub restarts: u64,
    /// Persons that were not published: without hips, arms or tracking, or with lost packets.
    pub unfinished: u64,
}

pub trait Protocol {
    /// Takes a packet, and passes every person that it completes to `publish`. A rejected packet changes no person.
    fn decode(&mut self, packet: &[u8], publish: &mut dyn FnMut(&RawSkeleton)) -> Result<Taken, Refused>;

    /// Returns a receiver for another sender. It is in its initial state, except for its counts.
    fn for_new_sender(&self) -> Self
    where
        Self: Sized;

    /// Returns what did not become a person.
    fn counts(&self) -> Counts;
}

fn empty(layout: SkeletonLayout, joints: usize, flags: u32) -> RawSkeleton {
    RawSkeleton { layout: layout as u32, joint_count: joints as u32, flags, ..RawSkeleton::ZERO }
}

#[cfg(test)]
fn taken(protocol: &mut dyn Protocol, packet: &[u8]) -> (Result<Taken, Refused>, Vec<RawSkeleton>) {
    let mut frames = Vec::new();
    let outcome = protocol.decode(packet, &mut |frame| frames.push(*frame));
    (outcome, frames)
}
