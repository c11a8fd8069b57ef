//! Checks that a step of the execution continues the one before, from the records of `control` and closed forms alone.

use super::Tally;
use super::control::{Control, Made};
use driver::{CommandChain, Setpoint, State, Step, StepKind};
use messages::{JOINTS_MAX, JointCommand, JointMotion, TICK_S};

/// Rounding of a few hundred additions of numbers around 1.
const ROUNDING: f64 = 1e-9;

#[derive(Clone)]
pub(crate) struct Oracle {
    /// Motion of the last accepted command or of the start, its index, and its chain.
    base: JointMotion,
    base_k: u64,
    chain: Option<CommandChain>,
    /// Plan ticks since then.
    played: u64,
    last: Setpoint,
}

impl Oracle {
    pub(crate) fn new(follower: &State) -> Self {
        Self { base: follower.motion, base_k: follower.executed_k, chain: None, played: 0, last: follower.setpoint() }
    }

    pub(crate) fn step(&mut self, control: &Control, step: &Step, command: Option<&JointCommand>, tally: &mut Tally) {
        assert!(step.setpoint.k > self.last.k, "an index is executed once: {} after {}", step.setpoint.k, self.last.k);
        match step.kind {
            StepKind::Plan | StepKind::Rest => {
                let ticks = step.setpoint.k - self.last.k;
                assert!(step.kind == StepKind::Rest || ticks == 1, "the plan is played tick by tick");
                self.played += ticks;
                tally.plan_ticks += ticks;
                assert_eq!(step.setpoint.k, self.base_k + self.played);
                same(&step.setpoint, &on_plan(&self.base, self.played), "the plan");
            }
            // The drives of this world always follow, so the driver was suspended, and the records begin again.
            StepKind::Measured => {
                let ticks = step.setpoint.k - self.last.k;
                assert!(ticks > driver::GAP_MAX_TICKS, "{ticks} ticks are no suspension");
            }
            StepKind::Command => {
                let command = command.expect("a command was executed");
                tally.commands += 1;
                assert_eq!(step.setpoint.k, command.k);
                self.lineage(control, command);
                same(&step.setpoint, &command.motion(), "the command");
                (self.base, self.base_k, self.played) = (command.motion(), command.k, 0);
                self.chain = Some(CommandChain::from_command(command));
            }
        }
        self.last = step.setpoint;
    }

    /// Follows the records of `control` from `command` back to the executed state, tick by tick.
    fn lineage(&self, control: &Control, command: &JointCommand) {
        let (mut sent, mut made) = control.sent[&(command.header.incarnation, command.k)];
        loop {
            assert_eq!(CommandChain::from_command(&sent), CommandChain::from_command(command), "one chain has no gap");
            let first = sent.k == sent.seed_k + sent.seed_played + 1;
            let after_base = self.chain == Some(CommandChain::from_command(command)) && sent.k == self.base_k + 1;
            if first || after_base {
                break;
            }
            let before = control.sent.get(&(sent.header.incarnation, sent.k - 1));
            let &(before, before_made) = before.expect("a chain is contiguous back to what is executed");
            continues(&sent, &made, &before.motion(), 0);
            (sent, made) = (before, before_made);
        }
        assert_eq!(sent.k, self.last.k + 1, "the first of what was skipped continues the executed index");
        continues(&sent, &made, &self.base, self.played);
    }
}

/// Checks that `sent` is what `made` makes of plan tick `played` of `base`.
fn continues(sent: &JointCommand, made: &Made, base: &JointMotion, played: u64) {
    let setpoint = Setpoint { k: sent.k, q: sent.q, v: sent.v, a: sent.a };
    let expected = match made {
        Made::OnPlan => on_plan(base, played + 1),
        Made::Jerk(jerk) => {
            let from = on_plan(base, played);
            let mut to = from;
            for (j, jerk) in jerk.iter().enumerate() {
                to.q[j] += from.v[j] * TICK_S + from.a[j] * TICK_S.powi(2) / 2.0 + jerk * TICK_S.powi(3) / 6.0;
                to.v[j] += from.a[j] * TICK_S + jerk * TICK_S.powi(2) / 2.0;
                to.a[j] += jerk * TICK_S;
            }
            to
        }
    };
    same(&setpoint, &expected, "what control made");
}

/// Returns the state `ticks` ticks along the plan of `base`, in closed form from its beginning.
fn on_plan(base: &JointMotion, ticks: u64) -> JointMotion {
    let mut out = *base;
    if ticks == 0 {
        return out;
    }
    for j in 0..JOINTS_MAX {
        let mut left = ticks as f64 * TICK_S;
        let (mut q, mut v, mut a) = (base.q[j], base.v[j], base.a[j]);
        for (jerk, duration) in base.plan.jerk[j].iter().zip(&base.plan.duration_s[j]) {
            let t = left.min(*duration);
            (q, v, a) = (
                q + v * t + a * t.powi(2) / 2.0 + jerk * t.powi(3) / 6.0,
                v + a * t + jerk * t.powi(2) / 2.0,
                a + jerk * t,
            );
            left -= t;
        }
        (out.q[j], out.v[j], out.a[j]) = (q, v, a);
    }
    out
}

fn same(executed: &Setpoint, expected: &JointMotion, what: &str) {
    for j in 0..JOINTS_MAX {
        let near = |x: f64, y: f64, scale: f64| (x - y).abs() <= ROUNDING * scale;
        let equal = near(executed.q[j], expected.q[j], 1.0)
            && near(executed.v[j], expected.v[j], 1.0)
            && near(executed.a[j], expected.a[j], 100.0);
        assert!(equal, "index {}, joint {j}: executed does not continue {what}: {executed:?} {expected:?}", executed.k);
    }
}
