//! Control's end of the driver's protocol: from which state the next command continues.

use driver::{Chain, ChainView, Motion, Seed};
use messages::RobotState;

/// What control knows of the stream it sends.
#[derive(Clone, Copy, Debug)]
pub struct Stream {
    chain: Chain,
    last_k: u64,
    last: Motion,
}

/// What to do before the command of a tick.
#[allow(clippy::large_enum_variant, reason = "a box would allocate in the tick")]
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Continue {
    /// Continue from the own last command.
    Own,
    /// Both stages must take this state over.
    From(Motion),
    /// The driver has executed this index already.
    Nothing,
}

impl Stream {
    /// Prepares the command of index `k`; `echo` is the newest robot state, of any age.
    pub fn prepare(stream: &mut Option<Self>, echo: &RobotState, k: u64, incarnation: u32) -> Continue {
        let seed = match *stream {
            None => driver::reseed(echo, k),
            Some(known) => match driver::on_chain(echo, &known.chain, known.last_k) {
                ChainView::Lost => driver::reseed(echo, k),
                ChainView::Following | ChainView::Pending if k == known.last_k + 1 => return Continue::Own,
                // Indices of our own are missing: the driver plays the plan of our last command for them.
                ChainView::Following | ChainView::Pending => {
                    let missing = k.saturating_sub(1).saturating_sub(known.last_k);
                    let mut motion = known.last;
                    motion.play(missing);
                    Some(Seed { seed_k: known.last_k, seed_played: missing, motion })
                }
            },
        };
        let Some(Seed { seed_k, seed_played, motion }) = seed else { return Continue::Nothing };
        let chain = Chain { incarnation, seed_k, seed_played };
        *stream = Some(Self { chain, last_k: seed_k + seed_played, last: motion });
        Continue::From(motion)
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
