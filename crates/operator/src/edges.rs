//! Turns the counters of the operator socket into the edges of one tick.

use safety::engage::OperatorView;

/// Edges since the last tick, and the present level.
#[derive(Clone, Debug, Default)]
pub struct OperatorEdges {
    seen: crate::OperatorView,
    now: OperatorView,
    /// True if the last holder fell silent or disconnected, and no operator has enabled since.
    lost: bool,
}

impl OperatorEdges {
    /// Takes the socket's view. Edges add up until [`OperatorEdges::take`] returns them.
    pub fn note(&mut self, view: &crate::OperatorView) {
        let enabled = view.enable_edges != self.seen.enable_edges;
        let recovers = view.recover_edges != self.seen.recover_edges;
        // A lost holder did not release the hold. The state machine must see silence, not a release.
        self.lost = (self.lost && !enabled && !recovers) || view.holders_lost != self.seen.holders_lost;
        self.now.connected = view.connections > 0 && !self.lost;
        self.now.enable_level = view.enable_level;
        self.now.heartbeat_received = view.heartbeat;
        self.now.enable_edge |= enabled;
        self.now.recover_level = view.recover_level;
        self.now.recover_edge |= recovers;
        self.now.left_out = view.left_out;
        self.now.clutch_level = view.clutch_level;
        self.now.release_edge |= view.release_edges != self.seen.release_edges;
        self.now.reset_edge |= view.reset_edges != self.seen.reset_edges;
        self.now.estop_edge |= view.estop_edges != self.seen.estop_edges;
        for (hand, said) in self.now.payload.iter_mut().enumerate() {
            if view.payload_edges[hand] != self.seen.payload_edges[hand] {
                *said = view.payload[hand];
            }
        }
        self.seen = *view;
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
    pub fn take(&mut self) -> OperatorView {
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
        let mut view = crate::OperatorView { connections: 1, ..Default::default() };
        edges.note(&view);
        view.estop_edges = 1;
        edges.note(&view);
        edges.note(&view);
        assert!(edges.take().estop_edge);
        assert!(!edges.take().estop_edge);
        let said = |mass_kg| [None, Some(PayloadOrder { mass_kg, centre_m: None })];
        (view.payload, view.payload_edges) = (said(0.5), [0, 1]);
        edges.note(&view);
        edges.note(&view);
        assert_eq!(edges.take().payload, said(0.5));
        assert_eq!(edges.take().payload, [None; 2]);
        (view.payload, view.payload_edges) = (said(0.25), [0, 3]);
        edges.note(&view);
        assert_eq!(edges.take().payload, said(0.25));
    }

    #[test]
    fn lost_holder_counts_as_disconnected_and_release_does_not() {
        let mut edges = OperatorEdges::default();
        let mut view =
            crate::OperatorView { connections: 2, enable_level: true, enable_edges: 1, ..Default::default() };
        edges.note(&view);
        assert!(edges.take().connected);
        (view.enable_level, view.release_edges) = (false, 1);
        edges.note(&view);
        let released = edges.take();
        assert!(released.connected && released.release_edge && !released.enable_level);
        (view.enable_level, view.enable_edges) = (true, 2);
        edges.note(&view);
        edges.take();
        (view.enable_level, view.holders_lost) = (false, 1);
        edges.note(&view);
        let lost = edges.take();
        assert!(!lost.connected && !lost.release_edge);
    }
}
