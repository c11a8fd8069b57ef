//! State from which the next command continues: the chain that `control` sends, compared with what the driver executes.

use driver::{ChainView, CommandChain, PlanPlayback, Seed};
use messages::{JointMotion, RobotState};

/// The sender's record of its command stream. The sender is `control`, or a test program in its place.
#[derive(Clone, Copy, Debug)]
pub struct Stream {
    chain: CommandChain,
    last_k: u64,
    last: JointMotion,
}

/// Action before the command of this tick. The large variant is not boxed, because a box would allocate in the tick.
#[allow(clippy::large_enum_variant)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Continue {
    /// Continue from the own last command: the driver executes it, or still can.
    Own,
    /// Continue from this state instead. Whole-body control and the gate must take it over.
    From(JointMotion),
    /// Nothing to continue from. Either there is no driver, or it moved when this process started, or the index
    /// was already executed.
    Nothing,
}

/// Largest velocity and acceleration at which a driver counts as at rest and may be taken over.
const REST: f64 = driver::REST_TOLERANCE;

impl Stream {
    /// Prepares the command of index `k`. `echo` is the newest robot state, of any age.
    pub fn prepare(stream: &mut Option<Self>, echo: Option<&RobotState>, k: u64, incarnation: u32) -> Continue {
        let Some(echo) = echo else { return Continue::Nothing };
        match *stream {
            // This process has sent nothing yet: it may take over only a driver at rest.
            None => {
                let resting = echo.v.iter().chain(&echo.a).all(|value| value.abs() <= REST);
                if resting { Self::begin(stream, driver::reseed(echo, k), incarnation) } else { Continue::Nothing }
            }
            Some(known) => match driver::on_chain(echo, &known.chain, known.last_k) {
                ChainView::Lost => Self::begin(stream, driver::reseed(echo, k), incarnation),
                ChainView::Following | ChainView::Pending if k == known.last_k + 1 => Continue::Own,
                // Own indices are missing: the driver plays the plan of our last command for them.
                ChainView::Following | ChainView::Pending => {
                    let missing = k.saturating_sub(1).saturating_sub(known.last_k);
                    let mut motion = known.last;
                    motion.play(missing);
                    let seed =
                        (k > known.last_k).then_some(Seed { seed_k: known.last_k, seed_played: missing, motion });
                    Self::begin(stream, seed, incarnation)
                }
            },
        }
    }

    fn begin(stream: &mut Option<Self>, seed: Option<Seed>, incarnation: u32) -> Continue {
        let Some(seed) = seed else { return Continue::Nothing };
        let chain = CommandChain { incarnation, seed_k: seed.seed_k, seed_played: seed.seed_played };
        *stream = Some(Self { chain, last_k: seed.seed_k + seed.seed_played, last: seed.motion });
        Continue::From(seed.motion)
    }

    /// Notes the command of index `k`.
    pub fn sent(&mut self, k: u64, motion: JointMotion) {
        (self.last_k, self.last) = (k, motion);
    }

    /// The chain that is being sent.
    pub fn chain(&self) -> CommandChain {
        self.chain
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::{JOINTS_MAX, Layout};

    #[test]
    fn stream_with_missing_indices_continues_from_plan_that_driver_plays() {
        let mut motion = JointMotion::rest([0.25; JOINTS_MAX]);
        // A stop of one joint: it brakes for 20 ms.
        (motion.v[0], motion.plan.jerk[0][0], motion.plan.duration_s[0][0]) = (0.1, -500.0, 0.02);
        let resting = RobotState { executed_k: 90, ..RobotState::ZERO };
        let mut stream = None;
        Stream::prepare(&mut stream, Some(&resting), 91, 7);
        stream.as_mut().expect("a stream").sent(91, motion);
        // The echo is late: it shows the driver before it took command 91. Commands 92 to 94 were not sent.
        let Continue::From(from) = Stream::prepare(&mut stream, Some(&resting), 95, 7) else {
            panic!("a new chain begins")
        };
        let mut played = motion;
        played.play(3);
        assert_eq!(from, played);
        assert_ne!(from.q, motion.q, "the plan moves");
        assert_eq!(stream.expect("a stream").chain(), CommandChain { incarnation: 7, seed_k: 91, seed_played: 3 });
    }
}
