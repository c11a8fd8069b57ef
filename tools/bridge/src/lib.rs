//! Motion capture programs send persons over UDP; this is the client that listens to them and publishes what they send. It is a
//! process of its own: what a network brings is parsed here, and nowhere in the daemon.
//!
//! A packet is never trusted: its length is checked before it is read, what is not of the protocol is refused and counted, and
//! whether a person is believable is judged behind the door of `ingest`, as with every other client.

pub mod cli;
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

/// Why nothing was made of a packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Refused {
    /// It is not of this protocol.
    #[error("not of this protocol")]
    Protocol,
    /// Its length is not what it says.
    #[error("not as long as it says")]
    Length,
    /// It is older than one before.
    #[error("older than the one before")]
    Late,
    /// It has a segment twice.
    #[error("a segment twice")]
    Twice,
    /// A number is none.
    #[error("a number that is none")]
    NotANumber,
    /// Somebody else sends, and only one is listened to at a time.
    #[error("of another sender")]
    Stranger,
    /// Of a character that is not listened to.
    #[error("of another character")]
    Character,
    /// A sender on this machine that is not of a user who may send.
    #[error("of another user of this machine, or of a sender that is gone")]
    User,
}

impl Refused {
    /// All of them; the index is the value.
    pub const ALL: [Self; 8] = [
        Self::Protocol,
        Self::Length,
        Self::Late,
        Self::Twice,
        Self::NotANumber,
        Self::Stranger,
        Self::Character,
        Self::User,
    ];
}

/// What was made of a packet that was not refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Taken {
    /// It says something of the person that is listened to: whoever sent it keeps the turn.
    Person,
    /// It says nothing of that.
    Aside,
}

/// What listens to one protocol.
pub trait Protocol {
    /// Takes a packet, and hands every person that it completes to `publish`.
    ///
    /// # Errors
    /// Nothing was made of it; what was pending stays.
    fn take(&mut self, packet: &[u8], publish: &mut dyn FnMut(&RawSkeleton)) -> Result<Taken, Refused>;

    /// As this one was before its first packet, with the restarts that it counted: for another sender.
    fn anew(&self) -> Self
    where
        Self: Sized;

    /// How often the sender was started anew, as far as its packets tell; the packet that tells it is refused.
    fn restarts(&self) -> u64;
}

/// A frame without anybody in it.
fn empty(layout: SkeletonLayout, joints: usize, flags: u32) -> RawSkeleton {
    RawSkeleton { layout: layout as u32, joint_count: joints as u32, flags, ..RawSkeleton::ZERO }
}
