//! Who is listened to: one sender at a time.

use crate::Refused;
use messages::Stamp;
use std::net::{IpAddr, SocketAddr};

/// Silence after which another sender is listened to, ns: as long as `ingest` keeps a silent client's authority.
const SILENT_NS: u64 = 1_000_000_000;

/// Whose turn it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Turn {
    /// The sender of before.
    Same,
    /// Another one, or the first.
    New,
}

/// The sender that is listened to.
#[derive(Clone, Debug)]
pub struct Senders {
    /// The only address that may send, if one is named.
    only: Option<IpAddr>,
    present: Option<(SocketAddr, Stamp)>,
}

impl Senders {
    /// Nobody has been heard yet.
    pub fn new(only: Option<IpAddr>) -> Self {
        Self { only, present: None }
    }

    /// Whether a packet that comes from `sender` at `now` is listened to.
    ///
    /// # Errors
    /// It is not the address that may send, or another sender was heard within the last second.
    pub fn admit(&mut self, sender: SocketAddr, now: Stamp) -> Result<Turn, Refused> {
        if self.only.is_some_and(|only| only != sender.ip()) {
            return Err(Refused::Stranger);
        }
        let same = self.present.is_some_and(|(present, _)| present == sender);
        if !same && self.present.is_some_and(|(_, heard)| now.since(heard) < SILENT_NS) {
            return Err(Refused::Stranger);
        }
        self.present = Some((sender, now));
        Ok(if same { Turn::Same } else { Turn::New })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn another_sender_waits_for_a_second_of_silence() {
        let sender = |port| SocketAddr::from(([127, 0, 0, 1], port));
        let at = |ms: u64| Stamp(1 + ms * 1_000_000);
        let mut senders = Senders::new(None);
        for (port, ms, expected) in [
            (1, 0, Ok(Turn::New)),
            (1, 10, Ok(Turn::Same)),
            (2, 20, Err(Refused::Stranger)),
            (2, 1009, Err(Refused::Stranger)),
            (2, 1010, Ok(Turn::New)),
            (1, 1020, Err(Refused::Stranger)),
            (2, 9000, Ok(Turn::Same)),
        ] {
            assert_eq!(senders.admit(sender(port), at(ms)), expected, "port {port} at {ms} ms");
        }
        let mut only = Senders::new(Some([10, 0, 0, 1].into()));
        assert_eq!(only.admit(sender(1), at(0)), Err(Refused::Stranger));
        assert_eq!(only.admit(SocketAddr::from(([10, 0, 0, 1], 5)), at(0)), Ok(Turn::New));
    }
}
