//! Whole-body control proposes a command, and the gate accepts or denies it.

use messages::{JOINTS_MAX, JointMotion, PayloadRefusal, Stamp};
use safety::{engage, gate};

/// Whole-body control and the gate, with their state.
#[derive(Clone, Debug)]
pub struct Commander {
    wbc: wbc::State,
    gate: gate::State,
    /// The gate's motion.
    commanded: JointMotion,
}

/// Result of one tick of both.
#[derive(Clone, Copy, Debug)]
pub struct Commanded {
    /// The motion to send.
    pub motion: JointMotion,
    /// Reason of the gate's denial, if it denied the proposal. Then `motion` is the next point of the stored plan.
    pub denied: Option<gate::Denial>,
    /// The proposal of whole-body control.
    pub proposed: wbc::Output,
}

impl Commander {
    /// Creates both at rest at `q` (rad, m).
    pub fn at_rest(config: &wbc::Config, q: [f64; JOINTS_MAX]) -> Self {
        let gate = gate::State::at_rest(q);
        Self { wbc: wbc::State::at_rest(config, q), commanded: gate.motion(), gate }
    }

    /// Continues from the state that the driver executes. Never allocates.
    pub fn reseed(&mut self, motion: &JointMotion) {
        self.wbc.reseed(motion);
        self.gate.reseed(motion);
        self.commanded = self.gate.motion();
    }

    /// Sets the payloads of the hands from now on; see [`wbc::State::carry`].
    ///
    /// # Errors
    /// Returns the reason of a refusal.
    pub fn carry(
        &mut self,
        config: &wbc::Config,
        payload: &[robot::Payload; 2],
    ) -> Result<Option<usize>, PayloadRefusal> {
        self.wbc.carry(config, payload)
    }

    /// Whole-body control with its present state.
    pub fn wbc(&self) -> &wbc::State {
        &self.wbc
    }

    /// The last motion that the gate returned.
    pub const fn commanded(&self) -> &JointMotion {
        &self.commanded
    }

    /// Limits the reference of tick `k`: whole-body control proposes a motion with a certified stop. Never allocates,
    /// blocks, reads a clock or panics.
    pub fn propose(
        &mut self,
        config: &wbc::Config,
        k: u64,
        now: Stamp,
        target: Option<wbc::Target<'_>>,
        permit: engage::Permit,
    ) -> wbc::Output {
        wbc::tick(config, &mut self.wbc, now, wbc::Input { k, target, permit })
    }

    /// Passes the proposal of tick `k` through the gate. Never allocates, blocks, reads a clock or panics.
    pub fn check(
        &mut self,
        gate: &gate::Config,
        k: u64,
        now: Stamp,
        proposed: wbc::Output,
        permit: engage::Permit,
    ) -> Commanded {
        let decision = gate::tick(gate, &mut self.gate, now, gate::Proposed { k, permit, motion: proposed.motion });
        let motion = decision.motion;
        self.commanded = motion;
        let denied = match decision.verdict {
            gate::Verdict::Deny(denial) => Some(denial),
            gate::Verdict::Accept | gate::Verdict::OnPlan => None,
        };
        // A new motion that equals the plan up to rounding is sent as the plan. The difference is too small for
        // one tick, and it would show at the end of a phase.
        let renamed = decision.verdict == gate::Verdict::OnPlan && proposed.candidate != wbc::Candidate::Plan;
        if denied.is_some() || renamed {
            self.wbc.reseed(&motion);
        }
        Commanded { motion, denied, proposed }
    }
}
