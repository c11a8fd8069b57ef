//! Which client moves the robot: at most one, the first that is live, and no other by itself.

use messages::{RawSkeleton, Stamp};

/// Sessions that are remembered as refused; older ones fall out, which only lets a client of long ago try again.
const REFUSED_KEPT: usize = 32;

/// Who holds authority over the input.
#[derive(Clone, Debug, Default)]
pub struct Authority {
    holder: Option<u64>,
    last_seen: Stamp,
    refused: [u64; REFUSED_KEPT],
    refused_count: usize,
    frames_refused: u64,
}

impl Authority {
    /// Whether the frame's session holds authority. A session that once was refused stays refused: a client that wants
    /// to take over must start a new session after the holder has left, and `control` then asks for a new enable edge.
    pub fn admits(&mut self, now: Stamp, raw: &RawSkeleton, timeout_ns: u64) -> bool {
        let session = raw.session_nonce;
        if self.holder == Some(session) {
            self.last_seen = now;
            return true;
        }
        let free = self.holder.is_none() || now.since(self.last_seen) > timeout_ns;
        if free && !self.refused.contains(&session) && session != 0 {
            self.holder = Some(session);
            self.last_seen = now;
            return true;
        }
        if !self.refused.contains(&session) {
            self.refused[self.refused_count % REFUSED_KEPT] = session;
            self.refused_count += 1;
        }
        self.frames_refused += 1;
        false
    }

    /// Frames of clients without authority.
    pub fn frames_refused(&self) -> u64 {
        self.frames_refused
    }

    /// The session that holds authority.
    pub fn holder(&self) -> Option<u64> {
        self.holder
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::Layout;

    const TIMEOUT_NS: u64 = 1_000_000_000;

    fn frame(session_nonce: u64) -> RawSkeleton {
        RawSkeleton { session_nonce, ..RawSkeleton::ZERO }
    }

    fn at(ms: u64) -> Stamp {
        Stamp(1 + ms * 1_000_000)
    }

    #[test]
    fn the_first_live_client_keeps_authority() {
        let mut authority = Authority::default();
        assert!(authority.admits(at(0), &frame(7), TIMEOUT_NS));
        assert!(!authority.admits(at(1), &frame(8), TIMEOUT_NS));
        assert!(authority.admits(at(900), &frame(7), TIMEOUT_NS));
        assert!(!authority.admits(at(1800), &frame(8), TIMEOUT_NS));
        assert_eq!(authority.frames_refused(), 2);
    }

    #[test]
    fn a_refused_client_never_takes_over_by_itself() {
        let mut authority = Authority::default();
        assert!(authority.admits(at(0), &frame(7), TIMEOUT_NS));
        assert!(!authority.admits(at(1), &frame(8), TIMEOUT_NS));
        assert!(!authority.admits(at(60_000), &frame(8), TIMEOUT_NS), "its session began while another held");
        assert!(authority.admits(at(60_001), &frame(9), TIMEOUT_NS), "a new session may");
        assert!(!authority.admits(at(60_002), &frame(7), TIMEOUT_NS), "and then the first is a stranger");
    }

    #[test]
    fn a_session_without_nonce_gets_nothing() {
        assert!(!Authority::default().admits(at(0), &frame(0), TIMEOUT_NS));
    }
}
