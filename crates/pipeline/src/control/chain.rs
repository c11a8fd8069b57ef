//! Where the next command continues from: the chain that `control` is sending, kept true to what the driver executes.

use driver::{Chain, ChainView, Motion, Seed};
use messages::RobotState;

/// What `control`, or whoever stands in for it, knows of the stream it sends.
#[derive(Clone, Copy, Debug)]
pub struct Stream {
    chain: Chain,
    last_k: u64,
    last: Motion,
}

/// What to do before the command of this tick. A box for the large variant would allocate in the tick.
#[allow(clippy::large_enum_variant)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Continue {
    /// Continue from the own last command: the driver executes it, or still can.
    Own,
    /// Continue from this state instead: whole-body control and the gate must take it over.
    From(Motion),
    /// There is nothing to continue from: no driver, a driver in motion at our start, or an index already executed.
    Nothing,
}

/// At rest for the purpose of taking over a driver: below what a certified plan leaves as rounding.
const REST: f64 = driver::REST_TOLERANCE;

impl Stream {
    /// Prepares the command of index `k`. `echo` is the newest robot state, of any age.
    pub fn prepare(stream: &mut Option<Self>, echo: Option<&RobotState>, k: u64, incarnation: u32) -> Continue {
        let Some(echo) = echo else { return Continue::Nothing };
        match *stream {
            // Nothing this process has sent: only a driver at rest may be taken over.
            None => {
                let resting = echo.v.iter().chain(&echo.a).all(|value| value.abs() <= REST);
                if resting { Self::begin(stream, driver::reseed(echo, k), incarnation) } else { Continue::Nothing }
            }
            Some(known) => match driver::on_chain(echo, &known.chain, known.last_k) {
                ChainView::Lost => Self::begin(stream, driver::reseed(echo, k), incarnation),
                ChainView::Following | ChainView::Pending if k == known.last_k + 1 => Continue::Own,
                // Indices of our own are missing: the driver plays the plan of our last command for them.
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
        let chain = Chain { incarnation, seed_k: seed.seed_k, seed_played: seed.seed_played };
        *stream = Some(Self { chain, last_k: seed.seed_k + seed.seed_played, last: seed.motion });
        Continue::From(seed.motion)
    }

    /// Notes the command of index `k`.
    pub fn sent(&mut self, k: u64, motion: Motion) {
        (self.last_k, self.last) = (k, motion);
    }

    /// The chain that is being sent.
    pub fn chain(&self) -> Chain {
        self.chain
    }
}
