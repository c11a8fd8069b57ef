//! Selects the sender: one at a time.

use crate::Refused;
use messages::Stamp;
use std::net::{IpAddr, SocketAddr};

/// Silence after which another sender is accepted, ns. It equals the time for which `ingest` keeps a silent
/// client's lease.
const SILENT_NS: u64 = 1_000_000_000;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SenderChange {
    Same,
    New,
}

#[derive(Clone, Debug)]
pub struct Senders {
    /// The only address that may send, if one is configured.
    only: Option<IpAddr>,
    present: Option<(SocketAddr, Stamp)>,
}

impl Senders {
    pub fn new(only: Option<IpAddr>) -> Self {
        Self { only: only.map(|only| only.to_canonical()), present: None }
    }

    /// Returns whether the sender changes if the packet that comes from `sender` at `now` is accepted.
    pub fn whose(&self, sender: SocketAddr, now: Stamp) -> Result<SenderChange, Refused> {
        if self.only.is_some_and(|only| only != sender.ip()) {
            return Err(Refused::Stranger);
        }
        match self.present {
            Some((present, _)) if present == sender => Ok(SenderChange::Same),
            Some((_, heard)) if now.since(heard) < SILENT_NS => Err(Refused::Stranger),
            _ => Ok(SenderChange::New),
        }
    }

    /// Notes that the packet was accepted. `sender` then holds the turn.
    pub fn heard(&mut self, sender: SocketAddr, now: Stamp) {
        self.present = Some((sender, now));
    }
}

/// Returns an IPv4 address in its own form, not in that of IPv6. A socket that listens to both sees the IPv6 form.
pub fn canonical(sender: SocketAddr) -> SocketAddr {
    match sender.ip().to_canonical() {
        IpAddr::V4(ip) => SocketAddr::new(ip.into(), sender.port()),
        IpAddr::V6(_) => sender,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn second_sender_is_refused_until_one_second_of_silence() {
        let sender = |port| SocketAddr::from(([127, 0, 0, 1], port));
        let at = |ms: u64| Stamp(1 + ms * 1_000_000);
        let mut senders = Senders::new(None);
        for (port, ms, expected) in [
            (1, 0, Ok(SenderChange::New)),
            (1, 10, Ok(SenderChange::Same)),
            (2, 20, Err(Refused::Stranger)),
            (2, 1009, Err(Refused::Stranger)),
            (2, 1010, Ok(SenderChange::New)),
            (1, 1020, Err(Refused::Stranger)),
            (2, 9000, Ok(SenderChange::Same)),
        ] {
            let turn = senders.whose(sender(port), at(ms));
            assert_eq!(turn, expected, "port {port} at {ms} ms");
            if turn.is_ok() {
                senders.heard(sender(port), at(ms));
            }
        }
        let only = Senders::new(Some([10, 0, 0, 1].into()));
        assert_eq!(only.whose(sender(1), at(0)), Err(Refused::Stranger));
        assert_eq!(only.whose(SocketAddr::from(([10, 0, 0, 1], 5)), at(0)), Ok(SenderChange::New));
    }

    #[test]
    fn sender_without_valid_packets_does_not_block_others() {
        let sender = |port| SocketAddr::from(([127, 0, 0, 1], port));
        let mut senders = Senders::new(None);
        assert_eq!(senders.whose(sender(1), Stamp(1)), Ok(SenderChange::New));
        assert_eq!(senders.whose(sender(2), Stamp(2)), Ok(SenderChange::New), "the first was not heard");
        senders.heard(sender(2), Stamp(2));
        assert_eq!(senders.whose(sender(2), Stamp(SILENT_NS)), Ok(SenderChange::Same));
        assert_eq!(senders.whose(sender(1), Stamp(2 + SILENT_NS)), Ok(SenderChange::New), "nothing good for a second");
    }

    #[test]
    fn ipv4_sender_matches_its_ipv6_mapped_address() {
        let mapped: SocketAddr = "[::ffff:127.0.0.1]:7".parse().expect("an address");
        for only in ["127.0.0.1", "::ffff:127.0.0.1"] {
            let senders = Senders::new(Some(only.parse().expect("an address")));
            assert_eq!(senders.whose(canonical(mapped), Stamp(1)), Ok(SenderChange::New), "--from {only}");
        }
        let six: SocketAddr = "[fe80::1%3]:7".parse().expect("an address");
        assert_eq!(canonical(six), six);
    }
}
