//! Many connections, one operator: what their requests add up to. Does no IO and reads no clock.

use messages::{OperatorRequest, Stamp};

/// Connections at once.
pub const CLIENTS_MAX: usize = 16;

/// Age of the holder's heartbeat at which the enable is withdrawn: 100 ms, five heartbeats at 50 Hz.
pub const LEASE_NS: u64 = 100_000_000;

/// Edges that one request may count; more is no hand but a broken counter.
const EDGES_MAX: u32 = 1000;

/// What all operators together command. Counters only grow, from the start of the server.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct OperatorView {
    /// Open connections.
    pub connections: u32,
    /// Whether the enable is held: the level of the holder.
    pub enable_level: bool,
    /// When the holder's last heartbeat was received; that of the last holder if there is none.
    pub heartbeat: Stamp,
    /// Enable edges of a holder.
    pub enable_edges: u64,
    /// Release edges of any connection; a holder that merely lowers its level counts as one.
    pub release_edges: u64,
    /// Reset edges of any connection.
    pub reset_edges: u64,
    /// Emergency stop edges of any connection.
    pub estop_edges: u64,
    /// Holders that went away or fell silent while holding.
    pub holders_lost: u64,
    /// Enable edges of connections other than the holder's.
    pub enables_refused: u64,
    /// Requests that made no sense: length, version, level, or a counter that ran back.
    pub requests_refused: u64,
    /// Connections that were turned away because all places were taken.
    pub connections_refused: u64,
}

/// What is remembered of one connection: its last request and when it came.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Seat {
    last: OperatorRequest,
    pub(crate) heard: Stamp,
}

impl Seat {
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
}

impl Merge {
    /// Begins a round: withdraws the enable if its holder has been silent for `lease_ns`.
    pub(crate) fn begin(&mut self, now: Stamp, lease_ns: u64) {
        self.released = false;
        if self.holder.is_some() && now.since(self.view.heartbeat) > lease_ns {
            self.lose();
        }
    }

    /// Takes a request of the connection `index`; `false` if it makes no sense, and then nothing of it counts.
    pub(crate) fn request(&mut self, index: usize, seat: &mut Seat, now: Stamp, request: &OperatorRequest) -> bool {
        let edges = |new: u32, old: u32| Some(new.wrapping_sub(old)).filter(|&n| n <= EDGES_MAX);
        let last = &seat.last;
        let (Some(enables), Some(releases), Some(resets), Some(estops), true) = (
            edges(request.enable_count, last.enable_count),
            edges(request.release_count, last.release_count),
            edges(request.reset_count, last.reset_count),
            edges(request.estop_count, last.estop_count),
            request.sequence > last.sequence,
        ) else {
            self.view.requests_refused += 1;
            return false;
        };
        (seat.last, seat.heard) = (*request, now);
        self.view.estop_edges += u64::from(estops);
        self.view.reset_edges += u64::from(resets);
        let level = request.enable_level == 1;
        let released_by_another = self.released;
        let held = self.holder == Some(index);
        if releases > 0 || (held && !level) {
            self.view.release_edges += u64::from(releases.max(1));
            self.released = true;
            (self.holder, self.view.enable_level) = (None, false);
        }
        // An enable that is already let go again grants nothing: edges grant authority, levels withdraw it.
        if enables > 0 && level {
            // A release of the same request came before the enable, because the level is up.
            self.enable(index, u64::from(enables), released_by_another);
        }
        if self.holder == Some(index) {
            self.view.heartbeat = now;
        }
        true
    }

    fn enable(&mut self, index: usize, edges: u64, released_by_another: bool) {
        if self.holder.is_some_and(|holder| holder != index) || released_by_another {
            self.view.enables_refused += edges;
        } else {
            (self.holder, self.view.enable_level) = (Some(index), true);
            self.view.enable_edges += edges;
        }
    }

    /// The connection `index` is gone.
    pub(crate) fn gone(&mut self, index: usize) {
        if self.holder == Some(index) {
            self.lose();
        }
    }

    fn lose(&mut self) {
        self.view.holders_lost += 1;
        (self.holder, self.view.enable_level) = (None, false);
    }
}
