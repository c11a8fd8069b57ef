//! The requests of all clients at the operator's machine as the one request that goes up.

use messages::{
    HOLDS_CLUTCH, HOLDS_ENABLE, HOLDS_RECOVERY, LEAVES_OUT, Layout, OPERATOR_VERSION, OperatorRequest, PayloadOrder,
    TAKES_OVER, payload_flag,
};
use operator::OperatorCounts;

/// Heartbeats that carry a payload before the next one may follow: half a second, so that it outlives lost datagrams.
const PAYLOAD_BEATS: u32 = 25;

/// The request that goes up. Its counters count from the start of this program.
pub(super) struct Heartbeat {
    pub(super) request: OperatorRequest,
    seen: OperatorCounts,
    waiting: [Option<PayloadOrder>; 2],
    beats: u32,
}

impl Heartbeat {
    pub(super) fn new() -> Self {
        let request = OperatorRequest { version: OPERATOR_VERSION, ..OperatorRequest::ZERO };
        Self { request, seen: OperatorCounts::default(), waiting: [None; 2], beats: PAYLOAD_BEATS }
    }

    /// Releases, whatever the clients hold.
    pub(super) fn withdraw(&mut self) {
        self.request.enable_level = 0;
        self.request.release_count = self.request.release_count.wrapping_add(1);
    }

    /// Adds the emergency stops of the socket's counts, and nothing else of them. Returns true if there are any.
    pub(super) fn update_stops(&mut self, counts: &OperatorCounts) -> bool {
        let stops = counts.estop_edges.saturating_sub(self.seen.estop_edges) as u32;
        self.request.estop_count = self.request.estop_count.wrapping_add(stops);
        self.seen = *counts;
        self.waiting = [None; 2];
        stops > 0
    }

    /// Adds the socket's counts. Returns true if something was pressed or let go, which must not wait for the next beat.
    pub(super) fn update(&mut self, counts: &OperatorCounts) -> bool {
        let (before, seen) = (self.request, self.seen);
        let add = |count: &mut u32, new: u64, old: u64| *count = count.wrapping_add(new.saturating_sub(old) as u32);
        let request = &mut self.request;
        add(
            &mut request.enable_count,
            counts.enable_edges + counts.recover_edges,
            seen.enable_edges + seen.recover_edges,
        );
        // A client that was lost while it held is a release for the robot.
        add(
            &mut request.release_count,
            counts.release_edges + counts.holders_lost,
            seen.release_edges + seen.holders_lost,
        );
        add(&mut request.reset_count, counts.reset_edges, seen.reset_edges);
        add(&mut request.estop_count, counts.estop_edges, seen.estop_edges);
        let held = |held: bool, bit: u32| if held { bit } else { 0 };
        let [left, right] = counts.held.left_out;
        request.enable_level = held(counts.held.enable_level, HOLDS_ENABLE)
            | held(counts.held.enable_level && left, LEAVES_OUT[0])
            | held(counts.held.enable_level && right && !left, LEAVES_OUT[1])
            | held(counts.held.takes_over[0], TAKES_OVER[0])
            | held(counts.held.takes_over[1], TAKES_OVER[1])
            | held(counts.held.recover_level && !counts.held.enable_level, HOLDS_RECOVERY)
            | held(counts.held.clutch_level, HOLDS_CLUTCH);
        for hand in 0..2 {
            if counts.payload_edges[hand] != seen.payload_edges[hand] {
                self.waiting[hand] = counts.held.payload[hand];
            }
        }
        self.seen = *counts;
        *request != before
    }

    pub(super) fn beat(&mut self) {
        self.request.sequence += 1;
        self.beats = self.beats.saturating_add(1);
        let next = self.waiting.iter().position(Option::is_some).filter(|_| self.beats > PAYLOAD_BEATS);
        if let Some((hand, order)) = next.and_then(|hand| Some((hand, self.waiting[hand].take()?))) {
            let right = if hand == 0 { 0 } else { payload_flag::RIGHT };
            let centre = if order.centre_m.is_some() { payload_flag::CENTRE } else { 0 };
            self.request.payload_flags = right | centre;
            (self.request.payload_kg, self.request.payload_centre_m) =
                (order.mass_kg, order.centre_m.unwrap_or_default());
            self.request.payload_count = self.request.payload_count.wrapping_add(1);
            self.beats = 0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use operator::OperatorView;

    #[test]
    fn presses_count_once_and_withdrawal_is_a_release() {
        let mut heartbeat = Heartbeat::new();
        let counts = OperatorCounts {
            held: OperatorView { enable_level: true, ..Default::default() },
            enable_edges: 1,
            estop_edges: 2,
            ..Default::default()
        };
        assert!(heartbeat.update(&counts) && !heartbeat.update(&counts));
        assert_eq!((heartbeat.request.enable_level, heartbeat.request.enable_count), (HOLDS_ENABLE, 1));
        heartbeat.withdraw();
        assert_eq!((heartbeat.request.enable_level, heartbeat.request.release_count), (0, 1));
        let counts = OperatorCounts {
            held: OperatorView { recover_level: true, ..Default::default() },
            recover_edges: 1,
            ..counts
        };
        assert!(heartbeat.update(&counts));
        let request = heartbeat.request;
        assert_eq!((request.enable_level, request.enable_count, request.estop_count), (HOLDS_RECOVERY, 2, 2));
    }

    #[test]
    fn lost_holder_is_a_release_and_left_out_arm_is_a_bit() {
        let mut heartbeat = Heartbeat::new();
        let held = OperatorCounts {
            held: OperatorView { enable_level: true, left_out: [false, true], ..Default::default() },
            enable_edges: 1,
            ..Default::default()
        };
        heartbeat.update(&held);
        assert_eq!(heartbeat.request.enable_level, HOLDS_ENABLE | LEAVES_OUT[1]);
        heartbeat.update(&OperatorCounts { held: OperatorView::default(), holders_lost: 1, ..held });
        assert_eq!((heartbeat.request.enable_level, heartbeat.request.release_count), (0, 1));
    }

    #[test]
    fn payloads_of_both_hands_follow_one_another() {
        let mut heartbeat = Heartbeat::new();
        let order = |mass_kg| Some(PayloadOrder { mass_kg, centre_m: None });
        heartbeat.update(&OperatorCounts {
            held: OperatorView { payload: [order(1.0), order(2.0)], ..Default::default() },
            payload_edges: [1, 1],
            ..Default::default()
        });
        let mut carried = Vec::new();
        for _ in 0..60 {
            heartbeat.beat();
            carried.push((
                heartbeat.request.payload_count,
                heartbeat.request.payload_kg,
                heartbeat.request.payload_flags,
            ));
        }
        assert_eq!((carried[0], carried[59]), ((1, 1.0, 0), (2, 2.0, payload_flag::RIGHT)));
        assert!(carried.iter().filter(|carried| carried.0 == 1).count() >= PAYLOAD_BEATS as usize);
    }
}
