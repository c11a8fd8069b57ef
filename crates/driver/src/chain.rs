//! The other end of the protocol: how `control` finds the state to continue from.
//! `control` runs this code, so the model test proves the code that runs.

use crate::plan::PlanPlayback;
use messages::{JointCommand, JointMotion, RobotState};

/// The name of a chain.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CommandChain {
    /// Incarnation of the writer.
    pub incarnation: u32,
    /// Index of the command from which the chain continues.
    pub seed_k: u64,
    /// Plan tick of that command after which the chain begins.
    pub seed_played: u64,
}

impl CommandChain {
    /// Returns the chain that `command` belongs to.
    pub const fn from_command(command: &JointCommand) -> Self {
        Self { incarnation: command.header.incarnation, seed_k: command.seed_k, seed_played: command.seed_played }
    }

    /// Returns the chain of the driver's last accepted command. Its incarnation is 0 if the driver has accepted none.
    pub const fn executed(echo: &RobotState) -> Self {
        Self { incarnation: echo.command_incarnation, seed_k: echo.seed_k, seed_played: echo.seed_played }
    }
}

/// The state from which a new chain begins. Its first command has index `seed_k + seed_played + 1`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Seed {
    /// Index of the command from which the chain continues. `control` writes it into every command of the chain.
    pub seed_k: u64,
    /// Plan ticks played after that command. `control` writes it into every command of the chain.
    pub seed_played: u64,
    /// The state that the first command continues from, one tick before it, and the rest of the plan.
    pub motion: JointMotion,
}

/// Returns the seed for a first command of index `k`: the driver's state advanced along its plan to index `k - 1`.
///
/// Returns `None` if the driver has executed index `k` already. Then nothing can be sent for `k`, so try the
/// next index.
///
/// The seed uses the echo alone, so it is right if the driver accepted no command since the echo. If it accepted one,
/// its identity differs and it refuses the chain. The next echo shows that as `ChainView::Lost`. The caller decides if
/// the echo is fresh enough to be trusted. The caller also decides if it may take over a driver in motion. It may not
/// after a start of `control`.
pub fn reseed(echo: &RobotState, k: u64) -> Option<Seed> {
    let index = echo.executed_k.checked_add(echo.plan_ticks_played)?;
    let missing = k.checked_sub(1)?.checked_sub(index)?;
    let mut motion = echo.motion();
    motion.play(missing);
    Some(Seed { seed_k: echo.executed_k, seed_played: echo.plan_ticks_played + missing, motion })
}

/// The state of the chain that `control` is sending, as an echo shows it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChainView {
    /// The driver executes the chain. Continue it.
    Following,
    /// The driver has not taken up the chain, or the echo is older than that. It still can, so continue the chain.
    Pending,
    /// The driver can take no further command of the chain. Reseed.
    Lost,
}

/// Returns the driver's state with respect to `chain`, whose last sent command had index `last_sent_k`.
///
/// `Following` is certain: a driver leaves a chain only by playing its plan, which the next echo shows. `Lost` is
/// certain too, because an identity never returns. A chain is lost in three cases. The driver has played on past its
/// last command, has passed its seed, or executes a state that the chain does not begin from.
pub fn on_chain(echo: &RobotState, chain: &CommandChain, last_sent_k: u64) -> ChainView {
    if CommandChain::executed(echo) == *chain {
        let continues = echo.plan_ticks_played == 0 && echo.executed_k <= last_sent_k;
        return if continues { ChainView::Following } else { ChainView::Lost };
    }
    let ahead = echo.executed_k == chain.seed_k && echo.plan_ticks_played <= chain.seed_played;
    if ahead { ChainView::Pending } else { ChainView::Lost }
}
