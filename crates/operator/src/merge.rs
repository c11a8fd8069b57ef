//! Many connections, one operator: what their requests add up to. Does no IO and reads no clock.

use crate::locks::{Locks, ResetRule};
use messages::{HOLDS_ENABLE, HOLDS_RECOVERY, OperatorRequest, PayloadOrder, Stamp, payload_flag};

/// Connections at once.
pub const CLIENTS_MAX: usize = 16;

/// Age of the holder's heartbeat at which the enable is withdrawn: 100 ms, five heartbeats at 50 Hz.
pub const LEASE_NS: u64 = 100_000_000;

/// Edges that one request may count; more is no hand but a broken counter.
const EDGES_MAX: u32 = 1000;

/// What all operators together command. Counters only grow, from the start of the server.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct OperatorView {
    /// Open connections.
    pub connections: u32,
    /// Whether the enable is held: the level of the holder.
    pub enable_level: bool,
    /// Whether the recovery is held, in place of the enable: there is one holder, and he holds one of them.
    pub recover_level: bool,
    /// When the holder's last heartbeat was received; that of the last holder if there is none.
    pub heartbeat: Stamp,
    /// Enable edges of a holder.
    pub enable_edges: u64,
    /// Recovery edges of a holder.
    pub recover_edges: u64,
    /// Release edges of any connection; a holder that merely lowers its level counts as one.
    pub release_edges: u64,
    /// Reset edges that were admitted.
    pub reset_edges: u64,
    /// Reset edges that were refused: another user pressed the emergency stop and has not reset it.
    pub resets_refused: u64,
    /// One more than the number of that user; zero if there is none.
    pub reset_first_by: u32,
    /// Emergency stop edges of any connection.
    pub estop_edges: u64,
    /// How often an operator said what the left and the right hand carry.
    pub payload_edges: [u64; 2],
    /// What was said last of each; none before the first time.
    pub payload: [Option<PayloadOrder>; 2],
    /// Holders that went away or fell silent while holding.
    pub holders_lost: u64,
    /// Enable and recovery edges of connections other than the holder's.
    pub enables_refused: u64,
    /// Requests that made no sense: length, version, level, or a counter that ran back.
    pub requests_refused: u64,
    /// Connections that were turned away because all places were taken.
    pub connections_refused: u64,
}

/// What is remembered of one connection: its last request and when it came.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Connection {
    last: OperatorRequest,
    pub(crate) heard: Stamp,
}

impl Connection {
    /// A connection that has not said anything yet.
    pub(crate) fn new(now: Stamp) -> Self {
        Self { last: messages::Layout::ZERO, heard: now }
    }
}

/// The state of the merge.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Merge {
    pub(crate) view: OperatorView,
    /// The connection that holds the enable.
    pub(crate) holder: Option<usize>,
    /// A release arrived in this round: an enable of the same round does not outlive it, whatever the order of the seats.
    released: bool,
    pub(crate) rule: ResetRule,
    locks: Locks,
}

impl Merge {
    /// Begins a round: withdraws the enable if its holder has been silent for `lease_ns`.
    pub(crate) fn begin(&mut self, now: Stamp, lease_ns: u64) {
        self.released = false;
        if self.holder.is_some() && now.since(self.view.heartbeat) > lease_ns {
            self.lose();
        }
    }

    /// Takes a request of the connection `index` of user `uid`; `false` if it makes no sense, and then nothing of it counts.
    pub(crate) fn request(
        &mut self,
        index: usize,
        uid: u32,
        seat: &mut Connection,
        now: Stamp,
        request: &OperatorRequest,
    ) -> bool {
        let edges = |new: u32, old: u32| Some(new.wrapping_sub(old)).filter(|&n| n <= EDGES_MAX);
        let last = &seat.last;
        let (Some(enables), Some(releases), Some(resets), Some(estops), Some(payloads), true) = (
            edges(request.enable_count, last.enable_count),
            edges(request.release_count, last.release_count),
            edges(request.reset_count, last.reset_count),
            edges(request.estop_count, last.estop_count),
            edges(request.payload_count, last.payload_count),
            request.sequence > last.sequence,
        ) else {
            self.view.requests_refused += 1;
            return false;
        };
        (seat.last, seat.heard) = (*request, now);
        // A stop in the same request comes after the reset: it has to be reset again.
        self.reset(uid, resets);
        self.stop(uid, estops);
        self.payload(payloads, request);
        let released_by_another = self.released;
        let held = self.holder == Some(index);
        let kept = match request.enable_level {
            HOLDS_ENABLE => self.view.enable_level,
            HOLDS_RECOVERY => self.view.recover_level,
            _ => false,
        };
        if releases > 0 || (held && !kept) {
            self.view.release_edges += u64::from(releases.max(1));
            self.released = true;
            self.let_go();
        }
        // What is already let go again grants nothing: edges grant authority, levels withdraw it.
        if enables > 0 && request.enable_level != 0 {
            // A release of the same request came before the edge, because the level is up.
            self.hold(index, request.enable_level, u64::from(enables), released_by_another);
        }
        if self.holder == Some(index) {
            self.view.heartbeat = now;
        }
        true
    }

    /// Takes the emergency stop of a request of who has no place, and nothing else of it; whether it is one.
    pub(crate) fn stop_alone(&mut self, uid: u32, request: &OperatorRequest) -> bool {
        let stops = (1..=EDGES_MAX).contains(&request.estop_count);
        self.stop(uid, if stops { request.estop_count } else { 0 });
        stops
    }

    fn stop(&mut self, uid: u32, edges: u32) {
        self.view.estop_edges += u64::from(edges);
        if edges > 0 && self.rule == ResetRule::Presser {
            self.locks.add(uid);
        }
        self.view.reset_first_by = self.locks.first_by();
    }

    fn reset(&mut self, uid: u32, edges: u32) {
        if edges > 0 {
            self.locks.remove(uid);
        }
        self.view.reset_first_by = self.locks.first_by();
        let admitted = self.locks.are_gone();
        let counted = if admitted { &mut self.view.reset_edges } else { &mut self.view.resets_refused };
        *counted += u64::from(edges);
    }

    /// The newest word about a hand counts, whoever says it.
    fn payload(&mut self, edges: u32, request: &OperatorRequest) {
        if edges == 0 {
            return;
        }
        let has = |flag: u32| request.payload_flags & flag != 0;
        let hand = usize::from(has(payload_flag::RIGHT));
        let numbers = request.payload_centre_m.iter().chain([&request.payload_kg]).all(|number| number.is_finite());
        let order = PayloadOrder {
            mass_kg: request.payload_kg,
            centre_m: has(payload_flag::CENTRE).then_some(request.payload_centre_m),
        };
        // What is no number, or has a flag that is not known, is passed on as a mass that `control` refuses.
        let known = numbers && request.payload_flags <= payload_flag::ALL;
        self.view.payload[hand] = Some(if known { order } else { PayloadOrder { mass_kg: -1.0, centre_m: None } });
        self.view.payload_edges[hand] += u64::from(edges);
    }

    fn hold(&mut self, index: usize, what: u32, edges: u64, released_by_another: bool) {
        if self.holder.is_some_and(|holder| holder != index) || released_by_another {
            self.view.enables_refused += edges;
            return;
        }
        self.holder = Some(index);
        (self.view.enable_level, self.view.recover_level) = (what == HOLDS_ENABLE, what == HOLDS_RECOVERY);
        let counted = if what == HOLDS_ENABLE { &mut self.view.enable_edges } else { &mut self.view.recover_edges };
        *counted += edges;
    }

    fn let_go(&mut self) {
        self.holder = None;
        (self.view.enable_level, self.view.recover_level) = (false, false);
    }

    /// The connection `index` is gone.
    pub(crate) fn gone(&mut self, index: usize) {
        if self.holder == Some(index) {
            self.lose();
        }
    }

    fn lose(&mut self) {
        self.view.holders_lost += 1;
        self.let_go();
    }
}
