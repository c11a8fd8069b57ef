//! The motion of one arm that was chosen last, and its continuation.
//!
//! Nodes stand at whole multiples of [`WAY_NODE_TICKS`], so that they are the same instants from one iteration to the
//! next: what was chosen for an interval is where the next iteration begins for that interval. The first interval, from
//! now to the first node, is shorter.

use crate::arm::ArmVector;
use crate::solver::State;
use crate::{NODES, solver};
use messages::{TICK_S, WAY_NODE_TICKS};

/// Accelerations until the last node, from a state at a tick.
#[derive(Clone, Debug)]
pub(crate) struct Plan {
    /// The tick of `state`.
    k: u64,
    pub(crate) state: State,
    /// The first node after the beginning, in units of `WAY_NODE_TICKS`.
    first: u64,
    input: [ArmVector; NODES],
}

/// The first node after tick `k`.
pub(crate) fn node_after(k: u64) -> u64 {
    k / WAY_NODE_TICKS + 1
}

impl Plan {
    /// To stay at `q` from tick `k` on.
    pub(crate) fn rest(k: u64, q: ArmVector) -> Self {
        let state = State { q, v: ArmVector::zeros() };
        Self { k, state, first: node_after(k), input: [ArmVector::zeros(); NODES] }
    }

    /// From `state` at tick `k` with these accelerations.
    pub(crate) fn new(k: u64, state: State, input: [ArmVector; NODES]) -> Self {
        Self { k, state, first: node_after(k), input }
    }

    /// The acceleration in the tick that follows tick `k`; beyond the last node there is none.
    pub(crate) fn input_at(&self, k: u64) -> ArmVector {
        let interval = node_after(k).saturating_sub(self.first) as usize;
        self.input.get(interval).copied().unwrap_or_else(ArmVector::zeros)
    }

    /// Goes on to tick `k`. The work is that of one tick unless ticks were missed.
    pub(crate) fn advance(&mut self, k: u64) {
        self.state = self.continued(self.state, self.k, k);
        self.k = self.k.max(k);
    }

    /// Where the accelerations lead from `state` at tick `from` to tick `to`.
    pub(crate) fn continued(&self, mut state: State, from: u64, to: u64) -> State {
        let mut k = from;
        // Beyond the horizon nothing changes but the position, and nobody looks so far.
        for _ in 0..=NODES {
            if k >= to {
                break;
            }
            let until = (node_after(k) * WAY_NODE_TICKS).min(to);
            state = state.after(&self.input_at(k), (until - k) as f64 * TICK_S);
            k = until;
        }
        state
    }

    /// The accelerations seen from tick `k`, whose first interval ends at the next node.
    pub(crate) fn inputs_from(&self, k: u64) -> [ArmVector; NODES] {
        let first = node_after(k);
        std::array::from_fn(|i| {
            let interval = (first + i as u64).saturating_sub(self.first) as usize;
            self.input.get(interval).copied().unwrap_or_else(ArmVector::zeros)
        })
    }
}

/// Lengths of the intervals from tick `k` on, s.
pub(crate) fn intervals_s(k: u64) -> [f64; NODES] {
    let first = (node_after(k) * WAY_NODE_TICKS - k) as f64 * TICK_S;
    std::array::from_fn(|i| if i == 0 { first } else { WAY_NODE_TICKS as f64 * TICK_S })
}

/// Whether a state is made of numbers.
pub(crate) fn is_finite(state: &solver::State) -> bool {
    state.q.iter().chain(state.v.iter()).all(|x| x.is_finite())
}
