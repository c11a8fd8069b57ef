//! Gripping: the grippers follow the closure of the person's hands.

use crate::Config;
use crate::target::Target;
use messages::{GripperMotion, Mode, source_flag};
use safety::{gate, gripper};

/// A hand takes its gripper over at this difference of their closures. Assumption: a person does not see less.
const TAKEN_WITHIN: f64 = 0.1;

/// State of the grippers.
#[derive(Clone, Debug, Default)]
pub(super) struct Gripping {
    /// The last motion that was sent.
    sent: GripperMotion,
    /// The hands that have taken their grippers over.
    taken: [bool; 2],
    /// Bits of `source_flag` of the last target. Who leads next has to meet the gripper first.
    sources: u32,
    /// The hands' closures at the last tick of this engagement.
    seen: [Option<f64>; 2],
}

impl Gripping {
    /// Continues from the motion that the driver executes.
    pub(super) fn reseed(&mut self, executed: &GripperMotion) {
        if executed.closure.iter().chain(&executed.rate).all(|value| value.is_finite()) {
            self.sent = *executed;
        }
    }

    /// Returns the motion of this tick, and the reason if the gate denied another one.
    ///
    /// While Engaged, a hand takes its gripper over as soon as their closures meet. So nothing drops at engaging because
    /// the person's hand is open. A hand that is not known holds. Seen again, it has to meet the gripper first. Without a
    /// target, and in every other mode, the grippers hold. A Disengaged robot opens them if the settings say so.
    pub(super) fn tick(
        &mut self,
        config: &Config,
        mode: Mode,
        target: Option<&Target>,
    ) -> (GripperMotion, Option<gate::Denial>) {
        let sources = target.map_or(0, |target| target.sources);
        let changed = sources ^ core::mem::replace(&mut self.sources, sources);
        for side in 0..2 {
            if changed & (source_flag::PERSON[side] | source_flag::POLICY[side]) != 0 {
                (self.taken[side], self.seen[side]) = (false, None);
            }
        }
        let goals = core::array::from_fn(|side| match mode {
            Mode::Engaged => self.follow(side, target),
            _ => {
                (self.taken[side], self.seen[side]) = (false, None);
                (mode == Mode::Disengaged && config.open_grippers_when_disengaged).then_some(0.0)
            }
        });
        let proposed = config.grippers.toward(&self.sent, goals);
        let (passed, denied) = gripper::tick(&config.gripper_gate, &self.sent, &proposed);
        self.sent = passed;
        (passed, denied)
    }

    fn follow(&mut self, side: usize, target: Option<&Target>) -> Option<f64> {
        let Some(closure) = target?.closure[side] else {
            (self.taken[side], self.seen[side]) = (false, None);
            return None;
        };
        let (to_go, before) = (closure - self.sent.closure[side], self.seen[side].replace(closure));
        let passed = before.is_some_and(|before| (before - self.sent.closure[side]) * to_go <= 0.0);
        self.taken[side] |= to_go.abs() <= TAKEN_WITHIN || passed;
        self.taken[side].then_some(closure)
    }
}
