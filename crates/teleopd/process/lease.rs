//! A lease of `ingest`: the client that holds it, its session in the core, and the quotas of all clients on shared memory.

use super::Process;
use bus::{PublisherId, Sample};
use doors::{Bucket, draw_nonce};
use ingest::{Authority, ClientIdentity, Door};
use messages::{Service, Stamp};
use std::cmp::Reverse;
use telemetry::Event;

/// Logs the first message of a client without the lease, then every 600th: once in ten seconds at 60 Hz.
const LOGGED_EVERY: u64 = 600;

/// The lease of persons, or that of policies.
pub struct Lease {
    pub authority: Authority,
    /// Session of the lease, drawn at random here. The core knows the lease by it, so no client can continue
    /// another's session.
    pub session_nonce: u64,
    /// Messages of publishers that sent more than their quota.
    pub over_quota: u64,
    /// Token buckets of the publishers on shared memory. There are as many as possible writers.
    publishers: [(Option<PublisherId>, Bucket, Stamp); Service::RawSkeleton.row().writers_max],
    uid: u32,
    timeout_ns: u64,
}

const _: () = assert!(Service::RawSkeleton.row().writers_max == Service::PolicyChunk.row().writers_max);

impl Lease {
    /// Creates a lease that ends after `timeout_ms` of silence.
    pub fn new(timeout_ms: f64) -> Self {
        Self {
            authority: Authority::default(),
            session_nonce: 0,
            over_quota: 0,
            publishers: Default::default(),
            uid: rustix::process::geteuid().as_raw(),
            timeout_ns: (timeout_ms * 1e6) as u64,
        }
    }

    /// Returns true if its holder was heard lately.
    pub fn is_held(&self, now: Stamp) -> bool {
        self.authority.is_held(now, self.timeout_ns)
    }

    /// Returns the sender of a message on shared memory, whose session is `session_nonce`. `None` if it sent more than its
    /// quota. A new publisher replaces the one that was silent longest.
    pub fn claim<M>(&mut self, now: Stamp, sample: &Sample<M>, session_nonce: u64) -> Option<ClientIdentity> {
        let from = Some(sample.publisher);
        let place = self.publishers.iter_mut().max_by_key(|(id, _, heard)| (*id == from, Reverse(*heard)))?;
        *place = (from, if place.0 == from { place.1 } else { Bucket::default() }, now);
        let admitted = place.1.admit(now);
        self.over_quota += u64::from(!admitted);
        let (uid, pid, port) = (self.uid, sample.process, sample.publisher.0);
        admitted.then_some(ClientIdentity { door: Door::SharedMemory, uid, pid, port, session_nonce })
    }

    /// Returns true if a message of `claim` may be used. A new holder gets a new session. `door` is its name in the log.
    pub fn admits(&mut self, process: &mut Process, now: Stamp, claim: ClientIdentity, door: &'static str) -> bool {
        let grants = self.authority.grants();
        if !self.authority.admits_claim(now, claim, self.timeout_ns) {
            let frames = self.authority.frames_refused();
            if frames % LOGGED_EVERY == 1 {
                process.probe.event(Event::WithoutAuthority { frames });
            }
            return false;
        }
        if self.authority.grants() != grants {
            self.session_nonce = draw_nonce();
            process.probe.event(Event::Lease { door, uid: claim.uid, pid: claim.pid });
        }
        true
    }
}
