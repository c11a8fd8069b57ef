//! Whole-body control proposes, the gate disposes.

use driver::Motion;
use messages::{JOINTS, PayloadRefusal, Stamp};
use safety::{engage, gate};

/// Both stages with all that they remember.
#[derive(Clone, Debug)]
pub struct Commander {
    wbc: wbc::State,
    gate: gate::State,
}

/// What a tick of both stages results in.
#[derive(Clone, Copy, Debug)]
pub struct Commanded {
    /// What is sent.
    pub motion: Motion,
    /// Why the gate denied the proposal, if it did: then `motion` is the next point of the stored plan.
    pub denied: Option<gate::Denial>,
    /// What whole-body control proposed and says of it.
    pub proposed: wbc::Output,
}

impl Commander {
    /// Both at rest at `q` (rad, m).
    pub fn at_rest(config: &wbc::Config, q: [f64; JOINTS]) -> Self {
        Self { wbc: wbc::State::at_rest(config, q), gate: gate::State::at_rest(q) }
    }

    /// Continues from what the driver executes. Never allocates.
    pub fn reseed(&mut self, motion: &Motion) {
        self.wbc.reseed(&planned(motion));
        self.gate.reseed(&motion.q, &motion.v, &motion.a, &motion.plan);
    }

    /// What the hands carry from now on; see [`wbc::State::carry`].
    ///
    /// # Errors
    /// Why it is not taken.
    pub fn carry(
        &mut self,
        config: &wbc::Config,
        payload: &[robot::Payload; 2],
    ) -> Result<Option<usize>, PayloadRefusal> {
        self.wbc.carry(config, payload)
    }

    /// Whole-body control, as it stands.
    pub fn wbc(&self) -> &wbc::State {
        &self.wbc
    }

    /// What the gate let through last.
    pub fn commanded(&self) -> Motion {
        Motion { q: self.gate.q(), v: self.gate.v(), a: self.gate.a(), plan: self.gate.plan() }
    }

    /// A tick of whole-body control alone: a proposal that nothing has checked.
    pub fn propose(
        &mut self,
        config: &wbc::Config,
        k: u64,
        now: Stamp,
        target: Option<wbc::Target<'_>>,
        permit: engage::Permit,
    ) -> wbc::Output {
        let permit = match permit {
            engage::Permit::Follow { speed_scale } => wbc::Permit::Follow { speed_scale },
            engage::Permit::Recover => wbc::Permit::Recover,
            engage::Permit::Stop => wbc::Permit::Stop,
        };
        wbc::tick(config, &mut self.wbc, now, wbc::Input { k, target, permit })
    }

    /// The command of tick `k`. Never allocates, blocks, reads a clock or panics.
    pub fn tick(
        &mut self,
        (wbc, gate): (&wbc::Config, &gate::Config),
        k: u64,
        now: Stamp,
        target: Option<wbc::Target<'_>>,
        permit: engage::Permit,
    ) -> Commanded {
        let proposed = self.propose(wbc, k, now, target, permit);
        let wbc::Output { q, v, a, plan, .. } = proposed;
        let decision = gate::tick(gate, &mut self.gate, now, gate::Proposed { k, permit, q, v, a, plan });
        let motion = Motion { q: decision.q, v: decision.v, a: decision.a, plan: decision.plan };
        let denied = match decision.verdict {
            gate::Verdict::Deny(denial) => Some(denial),
            gate::Verdict::Accept | gate::Verdict::OnPlan => None,
        };
        // A new motion that is the plan up to rounding is sent as the plan: the difference is too small for one tick, and would
        // show at the end of a phase.
        let renamed = decision.verdict == gate::Verdict::OnPlan && proposed.candidate != wbc::Candidate::Plan;
        if denied.is_some() || renamed {
            self.wbc.reseed(&planned(&motion));
        }
        Commanded { motion, denied, proposed }
    }
}

fn planned(motion: &Motion) -> wbc::Planned {
    wbc::Planned { q: motion.q, v: motion.v, a: motion.a, plan: motion.plan }
}
