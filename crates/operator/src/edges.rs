//! Turns the counters of the operator socket into the edges of one tick.

use crate::merge::OperatorCounts;
use safety::engage::OperatorView;

/// Edges since the last tick, and the present level.
#[derive(Clone, Debug, Default)]
pub struct OperatorEdges {
    seen: OperatorCounts,
    now: OperatorView,
    /// True if the last holder fell silent or disconnected, and no operator has enabled since.
    lost: bool,
}

impl OperatorEdges {
    /// Adds the edges since the last counts. They add up until [`OperatorEdges::drain`] returns them.
    pub fn add(&mut self, counts: &OperatorCounts) {
        let (seen, last) = (&self.seen, &self.now);
        let enabled = counts.enable_edges != seen.enable_edges;
        let recovers = counts.recover_edges != seen.recover_edges;
        // A lost holder did not release the hold. The state machine must see silence, not a release.
        self.lost = (self.lost && !enabled && !recovers) || counts.holders_lost != seen.holders_lost;
        let reported = |hand: usize| counts.payload_edges[hand] != seen.payload_edges[hand];
        self.now = OperatorView {
            connected: counts.connections > 0 && !self.lost,
            enable_edge: last.enable_edge || enabled,
            recover_edge: last.recover_edge || recovers,
            release_edge: last.release_edge || counts.release_edges != seen.release_edges,
            reset_edge: last.reset_edge || counts.reset_edges != seen.reset_edges,
            estop_edge: last.estop_edge || counts.estop_edges != seen.estop_edges,
            payload: [0, 1].map(|hand| if reported(hand) { counts.held.payload[hand] } else { last.payload[hand] }),
            ..counts.held
        };
        self.seen = *counts;
    }

    /// Releases the robot because the process is about to end, whatever the operators hold.
    pub fn withdraw(&mut self) {
        self.now.release_edge = true;
        self.now.enable_edge = false;
        self.now.enable_level = false;
        self.now.recover_edge = false;
        self.now.recover_level = false;
    }

    /// Stops the robot at once, as if an operator had pressed the emergency stop.
    pub fn stop(&mut self) {
        self.now.estop_edge = true;
    }

    /// Returns the view for this tick and clears its edges.
    pub fn drain(&mut self) -> OperatorView {
        let view = self.now;
        self.now = OperatorView {
            enable_edge: false,
            recover_edge: false,
            release_edge: false,
            reset_edge: false,
            estop_edge: false,
            payload: [None; 2],
            ..view
        };
        view
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::PayloadOrder;

    #[test]
    fn operator_edge_is_taken_exactly_once() {
        let mut edges = OperatorEdges::default();
        let mut counts = OperatorCounts { connections: 1, ..Default::default() };
        edges.add(&counts);
        counts.estop_edges = 1;
        edges.add(&counts);
        edges.add(&counts);
        assert!(edges.drain().estop_edge);
        assert!(!edges.drain().estop_edge);
        let reported = |mass_kg| [None, Some(PayloadOrder { mass_kg, centre_m: None })];
        (counts.held.payload, counts.payload_edges) = (reported(0.5), [0, 1]);
        edges.add(&counts);
        edges.add(&counts);
        assert_eq!(edges.drain().payload, reported(0.5));
        assert_eq!(edges.drain().payload, [None; 2]);
        (counts.held.payload, counts.payload_edges) = (reported(0.25), [0, 3]);
        edges.add(&counts);
        assert_eq!(edges.drain().payload, reported(0.25));
    }

    #[test]
    fn lost_holder_counts_as_disconnected_and_release_does_not() {
        let mut edges = OperatorEdges::default();
        let mut counts = OperatorCounts { connections: 2, enable_edges: 1, ..Default::default() };
        counts.held.enable_level = true;
        edges.add(&counts);
        assert!(edges.drain().connected);
        (counts.held.enable_level, counts.release_edges) = (false, 1);
        edges.add(&counts);
        let released = edges.drain();
        assert!(released.connected && released.release_edge && !released.enable_level);
        (counts.held.enable_level, counts.enable_edges) = (true, 2);
        edges.add(&counts);
        edges.drain();
        (counts.held.enable_level, counts.holders_lost) = (false, 1);
        edges.add(&counts);
        let lost = edges.drain();
        assert!(!lost.connected && !lost.release_edge);
    }
}
