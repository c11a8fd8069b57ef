//! The last chosen motion of one arm, and its continuation.
//!
//! Nodes lie at whole multiples of [`TRAJECTORY_NODE_TICKS`], so they are the same instants from one iteration to the
//! next. The next iteration starts an interval with the acceleration that was chosen for it before. The first
//! interval, from now to the first node, is shorter.

use crate::arm::ArmVector;
use crate::solver::State;
use crate::{NODES, solver};
use messages::{TICK_S, TRAJECTORY_NODE_TICKS};

/// Accelerations until the last node, starting from a state at a tick.
#[derive(Clone, Debug)]
pub(crate) struct Plan {
    /// Tick of `state`.
    k: u64,
    pub(crate) state: State,
    /// The first node after the start, in units of `TRAJECTORY_NODE_TICKS`.
    first: u64,
    input: [ArmVector; NODES],
}

/// Returns the first node after tick `k`.
pub(crate) fn node_after(k: u64) -> u64 {
    k / TRAJECTORY_NODE_TICKS + 1
}

impl Plan {
    /// Plans to stay at `q` from tick `k` on.
    pub(crate) fn rest(k: u64, q: ArmVector) -> Self {
        let state = State { q, v: ArmVector::zeros() };
        Self { k, state, first: node_after(k), input: [ArmVector::zeros(); NODES] }
    }

    /// Plans these accelerations from `state` at tick `k`.
    pub(crate) fn new(k: u64, state: State, input: [ArmVector; NODES]) -> Self {
        Self { k, state, first: node_after(k), input }
    }

    /// Returns the acceleration in the tick after tick `k`. It is zero beyond the last node.
    pub(crate) fn input_at(&self, k: u64) -> ArmVector {
        let interval = node_after(k).saturating_sub(self.first) as usize;
        self.input.get(interval).copied().unwrap_or_else(ArmVector::zeros)
    }

    /// Advances to tick `k`. The work is that of one tick unless ticks were missed.
    pub(crate) fn advance(&mut self, k: u64) {
        self.state = self.continued(self.state, self.k, k);
        self.k = self.k.max(k);
    }

    /// Returns the state at tick `to` that the accelerations give from `state` at tick `from`.
    pub(crate) fn continued(&self, mut state: State, from: u64, to: u64) -> State {
        let mut k = from;
        // The loop ends at the horizon. Beyond it only the position changes, and no caller looks so far.
        for _ in 0..=NODES {
            if k >= to {
                break;
            }
            let until = (node_after(k) * TRAJECTORY_NODE_TICKS).min(to);
            state = state.after(&self.input_at(k), (until - k) as f64 * TICK_S);
            k = until;
        }
        state
    }

    /// Returns the accelerations from tick `k` on. Their first interval ends at the next node.
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
    let first = (node_after(k) * TRAJECTORY_NODE_TICKS - k) as f64 * TICK_S;
    std::array::from_fn(|i| if i == 0 { first } else { TRAJECTORY_NODE_TICKS as f64 * TICK_S })
}

/// Returns true if all numbers of the state are finite.
pub(crate) fn is_finite(state: &solver::State) -> bool {
    state.q.iter().chain(state.v.iter()).all(|x| x.is_finite())
}
