//! The input lease: at most one client moves the robot. The first live client gets the lease. No other takes it
//! over by itself.

use messages::{RawSkeleton, Stamp};

/// Number of refused sessions that are kept. The oldest is dropped first, so its client may try again.
const REFUSED_KEPT: usize = 32;

/// `ingest` runs at least ten times a second. If more time passes between two rounds, `ingest` was suspended, ns.
const SLEPT_NS: u64 = 200_000_000;

messages::named! {
    /// Door by which a client's frames arrive.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
    pub enum Door {
        /// The input domain in shared memory, for the daemon's own user.
        #[default]
        SharedMemory => "shared memory",
        /// The skeleton socket, for other users.
        Socket => "socket",
    }
}

/// Identity of a session. Two sessions that differ in any field are two clients. A client may choose its session
/// number, so the numbers of the kernel and of the daemon stand beside it. They keep one client from posing as
/// another.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ClientIdentity {
    /// Door by which it arrives.
    pub door: Door,
    /// User of the process. In shared memory it is the daemon's user.
    pub uid: u32,
    /// The process, if it is known.
    pub pid: u32,
    /// The publisher's port on the bus, or the number of the connection.
    pub port: u128,
    /// The session. On the socket the daemon draws it, in shared memory the client does. 0 is no session.
    pub session_nonce: u64,
}

/// Holder of the input lease, and the sessions that were refused. The lease is exclusive across both doors.
#[derive(Clone, Debug, Default)]
pub struct Authority {
    holder: Option<ClientIdentity>,
    last_seen: Stamp,
    last_look: Stamp,
    refused: [ClientIdentity; REFUSED_KEPT],
    refused_count: usize,
    frames_refused: u64,
    grants: u64,
}

impl Authority {
    /// Notes that `ingest` runs at `now`. It is called before the frames of every round. Time in which `ingest`
    /// was suspended does not count as the holder's silence.
    pub fn look(&mut self, now: Stamp) {
        let slept_ns = if self.last_look == Stamp::NONE { 0 } else { now.since(self.last_look) };
        if slept_ns > SLEPT_NS {
            // Not later than now: a frame may have arrived since the last round.
            self.last_seen = self.last_seen.plus_ns(slept_ns).min(now);
        }
        self.last_look = now;
    }

    /// Returns true if the frame's session holds the lease. It identifies a session by the client's number alone.
    pub fn admits(&mut self, now: Stamp, raw: &RawSkeleton, timeout_ns: u64) -> bool {
        self.admits_claim(
            now,
            ClientIdentity { session_nonce: raw.session_nonce, ..ClientIdentity::default() },
            timeout_ns,
        )
    }

    /// Returns true if a frame of `claim` may move the robot. The lease goes to the first session whose frame
    /// arrives after `timeout_ns` without the holder's. A session that was refused once stays refused. A client
    /// that wants to take over must start a new session after the holder has left. `control` then requires a new
    /// enable edge. A holder that returns keeps its lease unless another session has taken it.
    pub fn admits_claim(&mut self, now: Stamp, claim: ClientIdentity, timeout_ns: u64) -> bool {
        if self.holder == Some(claim) {
            self.last_seen = now;
            return true;
        }
        let known = self.refused.contains(&claim);
        if !self.is_held(now, timeout_ns) && !known && claim.session_nonce != 0 {
            self.holder = Some(claim);
            self.last_seen = now;
            self.grants += 1;
            return true;
        }
        if !known {
            self.refused[self.refused_count % REFUSED_KEPT] = claim;
            self.refused_count += 1;
        }
        self.frames_refused += 1;
        false
    }

    /// Returns true if a frame of the holder arrived within the last `timeout_ns`.
    pub fn is_held(&self, now: Stamp, timeout_ns: u64) -> bool {
        self.holder.is_some() && now.since(self.last_seen) <= timeout_ns
    }

    /// Number of frames from clients without the lease.
    pub fn frames_refused(&self) -> u64 {
        self.frames_refused
    }

    /// Number of times the lease was granted.
    pub fn grants(&self) -> u64 {
        self.grants
    }

    /// The session that holds the lease, or held it last.
    pub fn holder(&self) -> Option<ClientIdentity> {
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
    fn lease_does_not_time_out_during_pause_of_ingest() {
        let mut authority = Authority::default();
        authority.look(at(0));
        assert!(authority.admits(at(0), &frame(7), TIMEOUT_NS));
        authority.look(at(100));
        authority.look(at(1100));
        assert!(authority.is_held(at(1100), TIMEOUT_NS), "heard 100 ms ago, as far as ingest ran");
        assert!(!authority.admits(at(1100), &frame(8), TIMEOUT_NS));
        for ms in (1200..=2100).step_by(100) {
            authority.look(at(ms));
        }
        assert!(authority.admits(at(2101), &frame(9), TIMEOUT_NS), "it was silent for a second of ingest's own time");
    }

    #[test]
    fn ingest_pause_before_frame_does_not_extend_lease() {
        let mut authority = Authority::default();
        authority.look(at(0));
        assert!(authority.admits(at(10_000), &frame(7), TIMEOUT_NS), "ingest paused after its look");
        for ms in (10_010..=11_010).step_by(100) {
            authority.look(at(ms));
        }
        assert!(authority.admits(at(11_020), &frame(9), TIMEOUT_NS), "the holder has been silent for a second");
    }

    #[test]
    fn refused_client_gets_lease_only_with_new_session() {
        let mut authority = Authority::default();
        assert!(authority.admits(at(0), &frame(7), TIMEOUT_NS));
        assert!(!authority.admits(at(1), &frame(8), TIMEOUT_NS));
        assert!(!authority.admits(at(60_000), &frame(8), TIMEOUT_NS), "its session began while another held");
        assert!(authority.admits(at(60_001), &frame(9), TIMEOUT_NS), "a new session may");
        assert!(!authority.admits(at(60_002), &frame(7), TIMEOUT_NS), "and then the first is a stranger");
    }

    #[test]
    fn session_without_nonce_gets_no_lease() {
        assert!(!Authority::default().admits(at(0), &frame(0), TIMEOUT_NS));
    }

    fn claim(door: Door, port: u128, session_nonce: u64) -> ClientIdentity {
        ClientIdentity { door, uid: 0, pid: 1, port, session_nonce }
    }

    #[test]
    fn f069_lease_passes_to_new_session_only_after_timeout() {
        let mut authority = Authority::default();
        assert!(authority.admits(at(0), &frame(7), TIMEOUT_NS));
        assert!(authority.is_held(at(1000), TIMEOUT_NS));
        assert!(!authority.is_held(at(1001), TIMEOUT_NS));
        assert!(authority.admits(at(9000), &frame(7), TIMEOUT_NS), "nobody took it");
        assert!(!authority.admits(at(10_000), &frame(8), TIMEOUT_NS));
        assert!(authority.admits(at(10_001), &frame(9), TIMEOUT_NS));
        assert!(!authority.admits(at(10_002), &frame(7), TIMEOUT_NS));
        assert_eq!((authority.grants(), authority.frames_refused()), (2, 2));
    }

    #[test]
    fn f068_lease_has_one_holder_until_timeout_with_random_clients() {
        let mut authority = Authority::default();
        let mut last: Option<(ClientIdentity, Stamp)> = None;
        // A linear congruential generator (Knuth, MMIX) draws the publisher and the time.
        let mut seed = 1_u64;
        let mut draw = |below: u64| {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (seed >> 33) % below
        };
        let mut now = at(0);
        for _ in 0..200_000 {
            now = now.plus_ns(draw(600_000_000) / (1 + draw(20)));
            let door = if draw(2) == 0 { Door::Socket } else { Door::SharedMemory };
            let one = claim(door, u128::from(draw(3)), 1 + draw(200));
            if authority.admits_claim(now, one, TIMEOUT_NS) {
                if let Some((holder, seen)) = last {
                    assert!(holder == one || now.since(seen) > TIMEOUT_NS, "{holder:?} lost it to {one:?}");
                }
                last = Some((one, now));
            }
        }
        assert!(authority.grants() > 100, "{}", authority.grants());
    }
}
