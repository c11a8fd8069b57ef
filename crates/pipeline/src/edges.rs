//! Turns the operator socket's counters into the edges of one tick.

use safety::engage::OperatorView;

/// Edges gathered since the last tick, and the level now.
#[derive(Clone, Debug, Default)]
pub struct OperatorEdges {
    seen: operator::OperatorView,
    now: OperatorView,
}

impl OperatorEdges {
    /// Takes the socket's view; edges add up until they are taken.
    pub fn note(&mut self, view: &operator::OperatorView) {
        self.now.connected = view.enable_level;
        self.now.enable_level = view.enable_level;
        self.now.heartbeat_received = view.heartbeat;
        self.now.enable_edge |= view.enable_edges != self.seen.enable_edges;
        self.now.release_edge |= view.release_edges != self.seen.release_edges;
        self.now.reset_edge |= view.reset_edges != self.seen.reset_edges;
        self.now.estop_edge |= view.estop_edges != self.seen.estop_edges;
        self.seen = *view;
    }

    /// The process is to end: whatever the operator holds, authority is withdrawn.
    pub fn withdraw(&mut self) {
        self.now.release_edge = true;
        self.now.enable_edge = false;
        self.now.enable_level = false;
    }

    /// The view for this tick; its edges are gone afterwards.
    pub fn take(&mut self) -> OperatorView {
        let view = self.now;
        self.now = OperatorView {
            enable_edge: false,
            release_edge: false,
            reset_edge: false,
            estop_edge: false,
            ..view
        };
        view
    }
}
