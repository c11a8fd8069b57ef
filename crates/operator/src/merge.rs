//! Merges the requests of many connections into the commands of one operator. Does no IO and reads no clock.

use crate::locks::{Locks, ResetRule};
use messages::{
    EDGES_MAX, HOLDS_CLUTCH, HOLDS_ENABLE, HOLDS_RECOVERY, LEAVES_OUT, OperatorRequest, PayloadOrder, Stamp,
    TAKES_OVER, payload_flag,
};
use safety::engage::OperatorView;

/// Largest number of connections at once.
pub const CLIENTS_MAX: usize = 16;

/// Age of the holder's heartbeat at which the enable is withdrawn: 100 ms, five heartbeats at 50 Hz.
pub const LEASE_NS: u64 = 100_000_000;

/// Bits of a level that every connection may hold, with or without the enable.
pub(crate) const CLUTCHES: u32 = HOLDS_CLUTCH | TAKES_OVER[0] | TAKES_OVER[1];

/// The commands of all operators together. Counters only grow, from the start of the server.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct OperatorCounts {
    /// Levels that the operators hold now. One client at a time is the holder. It holds the enable or the recovery. The
    /// heartbeat is the holder's. Without a holder it is the last holder's. Each hand's payload is its last report. The
    /// edge fields are false, because the counters below count edges.
    pub held: OperatorView,
    /// Open connections.
    pub connections: u32,
    /// Enable edges of a holder.
    pub enable_edges: u64,
    /// Recovery edges of a holder.
    pub recover_edges: u64,
    /// Release edges of any connection. A holder that merely lowers its level counts as one.
    pub release_edges: u64,
    /// Reset edges that were admitted.
    pub reset_edges: u64,
    /// Reset edges that were refused because another user pressed the emergency stop and has not reset it.
    pub resets_refused: u64,
    /// The number of that user plus one. Zero if there is none.
    pub reset_first_by: u32,
    /// Emergency stop edges of any connection.
    pub estop_edges: u64,
    /// Number of payload reports for the left and the right hand.
    pub payload_edges: [u64; 2],
    /// Holders that disconnected or timed out while holding.
    pub holders_lost: u64,
    /// Enable and recovery edges of connections other than the holder's.
    pub enables_refused: u64,
    /// Invalid requests: wrong length, version or level, or a counter that ran back.
    pub requests_refused: u64,
    /// Connections that were refused because the process is not admitted or got no place.
    pub connections_refused: u64,
}

/// State of one connection: its last request and its time.
#[derive(Clone, Copy, Debug)]
pub struct Connection {
    last: OperatorRequest,
    pub(crate) heard: Stamp,
}

impl Connection {
    /// Creates the state of a connection that has sent nothing yet.
    pub fn new(now: Stamp) -> Self {
        Self { last: messages::Layout::ZERO, heard: now }
    }

    /// Returns true if the connection has sent nothing yet.
    pub(crate) fn is_new(&self) -> bool {
        self.last.sequence == 0
    }

    /// Returns true if the connection has pressed the emergency stop and holds nothing.
    pub(crate) fn has_pressed_stop(&self) -> bool {
        self.last.estop_count > 0 && self.last.enable_level == 0
    }
}

/// The state of the merge.
#[derive(Clone, Copy, Debug, Default)]
pub struct Merge {
    /// The commands of all operators together.
    pub counts: OperatorCounts,
    /// The connection that holds the enable.
    pub(crate) holder: Option<usize>,
    /// `HOLDS_CLUTCH` and bits of `TAKES_OVER` that each connection holds, and its last heartbeat.
    clutches: [(u32, Stamp); CLIENTS_MAX],
    /// True if a release arrived in this round. It cancels an enable of the same round, whatever the order of the
    /// seats.
    released: bool,
    pub(crate) rule: ResetRule,
    locks: Locks,
}

impl Merge {
    /// Begins a round. It withdraws the enable if its holder has been silent for longer than `lease_ns`.
    pub fn begin(&mut self, now: Stamp, lease_ns: u64) {
        self.released = false;
        if self.holder.is_some() && now.since(self.counts.held.heartbeat_received) > lease_ns {
            self.lose();
        }
        for index in 0..CLIENTS_MAX {
            if now.since(self.clutches[index].1) > lease_ns {
                self.lose_clutch(index);
            }
        }
    }

    /// Takes a request of the connection `index` of user `uid`. Returns `false` if it is invalid. Then no part of
    /// it counts.
    pub fn request(
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
            self.counts.requests_refused += 1;
            return false;
        };
        (seat.last, seat.heard) = (*request, now);
        // A stop in the same request comes after the reset, so it needs another reset.
        self.reset(uid, resets);
        self.stop(uid, estops);
        self.payload(payloads, request);
        let released_by_another = self.released;
        let held = self.holder == Some(index);
        let left_out = LEAVES_OUT.map(|bit| request.enable_level & bit != 0);
        let level = request.enable_level & (HOLDS_ENABLE | HOLDS_RECOVERY);
        let kept = match level {
            HOLDS_ENABLE => self.counts.held.enable_level && left_out == self.counts.held.left_out,
            HOLDS_RECOVERY => self.counts.held.recover_level,
            _ => false,
        };
        if releases > 0 || (held && !kept) {
            self.counts.release_edges += u64::from(releases.max(1));
            self.released = true;
            self.let_go();
        }
        // A grip that is already released grants nothing: edges grant authority, levels withdraw it.
        if enables > 0 && level != 0 {
            // A release of the same request came before the edge, because the level is up.
            self.hold(index, level, u64::from(enables), released_by_another, left_out);
        }
        self.set_clutch(index, (request.enable_level & CLUTCHES, now));
        if self.holder == Some(index) {
            self.counts.held.heartbeat_received = now;
        }
        true
    }

    /// Takes only the emergency stop of a request from a client without a place. Returns true if there is one.
    pub fn stop_alone(&mut self, uid: u32, request: &OperatorRequest) -> bool {
        let stops = (1..=EDGES_MAX).contains(&request.estop_count);
        self.stop(uid, if stops { request.estop_count } else { 0 });
        stops
    }

    fn stop(&mut self, uid: u32, edges: u32) {
        self.counts.estop_edges += u64::from(edges);
        if edges > 0 && self.rule == ResetRule::Presser {
            self.locks.add(uid);
        }
        self.counts.reset_first_by = self.locks.first_by();
    }

    fn reset(&mut self, uid: u32, edges: u32) {
        if edges > 0 {
            self.locks.remove(uid);
        }
        self.counts.reset_first_by = self.locks.first_by();
        let admitted = self.locks.are_gone();
        let counted = if admitted { &mut self.counts.reset_edges } else { &mut self.counts.resets_refused };
        *counted += u64::from(edges);
    }

    /// Takes a payload report. The newest report counts, from whichever client.
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
        // A report with a NaN, an infinity or an unknown flag is passed on as a mass that `control` refuses.
        let known = numbers && request.payload_flags <= payload_flag::ALL;
        self.counts.held.payload[hand] =
            Some(if known { order } else { PayloadOrder { mass_kg: -1.0, centre_m: None } });
        self.counts.payload_edges[hand] += u64::from(edges);
    }

    fn hold(&mut self, index: usize, what: u32, edges: u64, released_by_another: bool, left_out: [bool; 2]) {
        if self.holder.is_some_and(|holder| holder != index) || released_by_another {
            self.counts.enables_refused += edges;
            return;
        }
        self.holder = Some(index);
        self.counts.held.left_out = left_out;
        (self.counts.held.enable_level, self.counts.held.recover_level) =
            (what == HOLDS_ENABLE, what == HOLDS_RECOVERY);
        let counted = if what == HOLDS_ENABLE { &mut self.counts.enable_edges } else { &mut self.counts.recover_edges };
        *counted += edges;
    }

    fn set_clutch(&mut self, index: usize, held: (u32, Stamp)) {
        self.clutches[index] = held;
        let all = self.clutches.iter().fold(0, |all, (bits, _)| all | bits);
        self.counts.held.clutch_level = all & HOLDS_CLUTCH != 0;
        self.counts.held.takes_over = TAKES_OVER.map(|bit| all & bit != 0);
    }

    /// Handles the loss of a connection that may hold the clutch or an arm. Nobody let go of it, so the robot must not go on by
    /// itself: the enable is released, too.
    fn lose_clutch(&mut self, index: usize) {
        if self.clutches[index].0 != 0 {
            self.set_clutch(index, (0, Stamp::NONE));
            self.counts.release_edges += 1;
            self.released = true;
            self.let_go();
        }
    }

    fn let_go(&mut self) {
        self.holder = None;
        (self.counts.held.enable_level, self.counts.held.recover_level, self.counts.held.left_out) =
            (false, false, [false; 2]);
    }

    /// Handles the end of the connection `index`.
    pub fn gone(&mut self, index: usize) {
        if self.holder == Some(index) {
            self.lose();
        }
        self.lose_clutch(index);
    }

    fn lose(&mut self) {
        self.counts.holders_lost += 1;
        self.let_go();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::Layout;

    #[derive(Default)]
    struct Clients {
        merge: Merge,
        seats: Vec<(Connection, OperatorRequest)>,
        now: Stamp,
    }

    impl Clients {
        fn new(seats: usize) -> Self {
            let seat = (Connection::new(Stamp::NONE), OperatorRequest::ZERO);
            Self { seats: vec![seat; seats], ..Self::default() }
        }

        fn send(&mut self, index: usize, change: impl Fn(&mut OperatorRequest)) -> OperatorCounts {
            self.now = self.now.plus_ns(20_000_000);
            self.merge.begin(self.now, LEASE_NS);
            let (seat, request) = &mut self.seats[index];
            request.sequence += 1;
            change(request);
            assert!(self.merge.request(index, 0, seat, self.now, &request.clone()));
            self.merge.counts
        }
    }

    fn enable(request: &mut OperatorRequest) {
        request.enable_level = HOLDS_ENABLE;
        request.enable_count += 1;
    }

    #[test]
    fn f119_robot_stands_while_any_client_holds_the_clutch() {
        let mut clients = Clients::new(2);
        clients.send(0, enable);
        let view = clients.send(1, |r| r.enable_level = HOLDS_CLUTCH);
        assert_eq!((view.held.enable_level, view.held.clutch_level, view.release_edges), (true, true, 0));
        // The holder of the enable may hold both.
        clients.send(0, |r| r.enable_level = HOLDS_ENABLE | HOLDS_CLUTCH);
        let view = clients.send(1, |r| r.enable_level = 0);
        assert_eq!((view.held.enable_level, view.held.clutch_level, view.release_edges), (true, true, 0));
        let view = clients.send(0, |r| r.enable_level = HOLDS_ENABLE);
        assert_eq!((view.held.enable_level, view.held.clutch_level, view.release_edges), (true, false, 0));
    }

    #[test]
    fn arms_are_taken_over_while_any_client_holds_them_and_its_loss_is_a_release() {
        let mut clients = Clients::new(2);
        clients.send(0, enable);
        let view = clients.send(1, |r| r.enable_level = TAKES_OVER[1]);
        assert_eq!((view.held.enable_level, view.held.takes_over, view.release_edges), (true, [false, true], 0));
        let view = clients.send(1, |r| r.enable_level = 0);
        assert_eq!((view.held.enable_level, view.held.takes_over, view.release_edges), (true, [false; 2], 0));
        clients.send(1, |r| r.enable_level = TAKES_OVER[0]);
        clients.merge.gone(1);
        let view = clients.merge.counts;
        assert_eq!((view.held.enable_level, view.held.takes_over, view.release_edges), (false, [false; 2], 1));
    }

    #[test]
    fn arm_is_left_out_from_the_edge_on_and_a_change_is_a_release() {
        let mut clients = Clients::new(1);
        let view = clients.send(0, |r| {
            r.enable_level = HOLDS_ENABLE | LEAVES_OUT[1];
            r.enable_count += 1;
        });
        assert_eq!((view.held.enable_level, view.held.left_out), (true, [false, true]));
        let view = clients.send(0, |r| r.enable_level = HOLDS_ENABLE | LEAVES_OUT[1] | HOLDS_CLUTCH);
        assert_eq!((view.held.enable_level, view.held.left_out, view.release_edges), (true, [false, true], 0));
        let view = clients.send(0, |r| r.enable_level = HOLDS_ENABLE);
        assert_eq!((view.held.enable_level, view.held.left_out, view.release_edges), (false, [false; 2], 1));
        let view = clients.send(0, enable);
        assert_eq!((view.held.enable_level, view.held.left_out, view.release_edges), (true, [false; 2], 1));
    }

    #[test]
    fn f119_clutch_whose_client_is_lost_releases_the_robot() {
        for dies in [true, false] {
            let mut clients = Clients::new(2);
            // The holder of the enable holds the clutch, too, and lets go of it after the other one was lost.
            clients.send(0, enable);
            clients.send(0, |r| r.enable_level = HOLDS_ENABLE | HOLDS_CLUTCH);
            assert!(clients.send(1, |r| r.enable_level = HOLDS_CLUTCH).held.clutch_level);
            if dies {
                clients.merge.gone(1);
            }
            // The other client goes on. The lost one is silent for longer than the lease.
            for _ in 0..LEASE_NS / 20_000_000 + 1 {
                clients.send(0, |_| ());
            }
            clients.send(0, |r| r.enable_level = HOLDS_ENABLE);
            let view = clients.merge.counts;
            assert_eq!(
                (view.held.enable_level, view.held.clutch_level, view.release_edges),
                (false, false, 1),
                "dies: {dies}"
            );
        }
    }
}
