//! Receives what arrives from the person and the operator.

use super::{Run, Violation};
use crate::oracle::Person;
use messages::{Mode, Stamp};
use safety::engage::OperatorView;

impl Run<'_> {
    /// Delivers the person's frames of this tick. `ingest` is draining when frames after the first arrive.
    pub(super) fn receive(&mut self, ingest_runs: bool) {
        let engaged = self.oracle.mode() == Mode::Engaged;
        let now = self.world.now();
        self.accepted.clear();
        self.drained.clear();
        self.client.tick(self.k, now, engaged, &mut self.faults, &mut self.frames);
        if let Some(policy) = &mut self.policy {
            policy.tick(self.subject, self.k, &mut self.world, ingest_runs, &mut self.faults);
            self.hand.take_over(policy.takes_over);
        }
        if let Some(remote) = &mut self.remote {
            remote.change(self.k, now, self.k >= self.quiet_from);
            remote.carry(self.k, now, &mut self.frames);
        }
        for (n, raw) in self.frames.iter().enumerate() {
            if n > 0 && ingest_runs {
                let passed = self.world.drain_raw(&self.subject.config);
                self.accepted.extend(passed.as_ref().map(Person::new));
                self.drained.extend(passed);
            }
            self.world.publish(raw);
        }
    }

    /// Lets the operator act, and returns the views of [`OperatorModel::tick`]. The error says what the link passed on too
    /// late.
    ///
    /// [`OperatorModel::tick`]: crate::operator_model::OperatorModel::tick
    pub(super) fn operate(&mut self, now: Stamp, control_runs: bool) -> Result<Option<[OperatorView; 2]>, Violation> {
        let views = self.hand.tick(self.k, now, control_runs, &mut self.faults, self.remote.as_deref_mut());
        let broken = self.remote.as_mut().and_then(|remote| remote.broken.take());
        broken.map_or(Ok(views), |(invariant, detail)| Err(Violation { tick: self.k, invariant, detail }))
    }
}
