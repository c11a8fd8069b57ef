//! The other end of the protocol: how `control` finds the state to continue from. Shared with `control`, so that what the
//! model test proves is what runs.

use crate::plan::Motion;
use messages::{JointCommand, RobotState};

/// The name of a chain.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Chain {
    /// Incarnation of the writer.
    pub incarnation: u32,
    /// The command at which it begins.
    pub seed_k: u64,
    /// The plan tick of that command after which it begins.
    pub seed_played: u64,
}

impl Chain {
    /// The chain that `command` belongs to.
    pub const fn of(command: &JointCommand) -> Self {
        Self { incarnation: command.header.incarnation, seed_k: command.seed_k, seed_played: command.seed_played }
    }

    /// The chain of the driver's last accepted command; of incarnation 0 if it has accepted none.
    pub const fn executed(echo: &RobotState) -> Self {
        Self { incarnation: echo.command_incarnation, seed_k: echo.seed_k, seed_played: echo.seed_played }
    }
}

/// Where a new chain begins, for a first command of index `seed_k + seed_played + 1`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Seed {
    /// To be written into every command of the chain.
    pub seed_k: u64,
    /// To be written into every command of the chain.
    pub seed_played: u64,
    /// The state that the first command continues from, one tick before it, and what is left of the plan.
    pub motion: Motion,
}

/// The seed for a first command of index `k`: the driver's state advanced along its plan to index `k - 1`.
///
/// `None` if the driver has executed index `k` already: there is nothing to send for it, try the next. The seed rests on
/// the echo alone, so it is right if no command was accepted since the echo; if one was, its identity differs and the
/// driver refuses the chain, which the next echo shows as `ChainView::Lost`. Whether the echo is fresh enough to be
/// trusted, and whether a driver in motion may be taken over (not after a start of `control`), is for the caller.
pub fn reseed(echo: &RobotState, k: u64) -> Option<Seed> {
    let index = echo.executed_k.checked_add(echo.plan_ticks_played)?;
    let missing = k.checked_sub(1)?.checked_sub(index)?;
    let mut motion = Motion { q: echo.q, v: echo.v, a: echo.a, plan: echo.plan };
    motion.play(missing);
    Some(Seed { seed_k: echo.executed_k, seed_played: echo.plan_ticks_played + missing, motion })
}

/// What an echo says of the chain that `control` is sending.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChainView {
    /// The driver executes the chain: continue it.
    Following,
    /// The driver has not taken the chain up yet (or the echo is older than that), but still can: continue it.
    Pending,
    /// The driver can take no further command of the chain: reseed.
    Lost,
}

/// Where the driver stands with `chain`, whose last command sent was of index `last_sent_k`.
///
/// Following is certain: once on a chain, a driver leaves it only by playing its plan, which the next echo shows. Lost is
/// certain too, because an identity never returns: a chain is lost when the driver has played on past its last
/// command, has passed its seed, or executes what the chain does not begin from.
pub fn on_chain(echo: &RobotState, chain: &Chain, last_sent_k: u64) -> ChainView {
    if Chain::executed(echo) == *chain {
        let continues = echo.plan_ticks_played == 0 && echo.executed_k <= last_sent_k;
        return if continues { ChainView::Following } else { ChainView::Lost };
    }
    let ahead = echo.executed_k == chain.seed_k && echo.plan_ticks_played <= chain.seed_played;
    if ahead { ChainView::Pending } else { ChainView::Lost }
}
