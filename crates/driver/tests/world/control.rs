//! A `control` that moves at random and records every command that it sent.

use super::V_MAX;
use driver::{ChainView, CommandChain, PlanPlayback, Seed, on_chain, reseed};
use messages::{Header, JOINTS_MAX, JointCommand, JointMotion, Layout, RobotState, StopPlan, TICK_S, state_flag};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::collections::HashMap;

/// How a command was made from the state before it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Made {
    /// Made with this constant jerk over the tick.
    Jerk([f64; JOINTS_MAX]),
    /// Made as the next point of the plan.
    OnPlan,
}

#[derive(Clone)]
pub(crate) struct Control {
    pub(crate) incarnation: u32,
    /// If true, continues from its own last command instead of the echo after it missed an index.
    pub(crate) trusts_itself: bool,
    pub(crate) sent: HashMap<(u32, u64), (JointCommand, Made)>,
    pub(crate) reset_count: u32,
    rng: Pcg64,
    sequence: u64,
    stream: Option<(CommandChain, u64, JointMotion)>,
}

impl Control {
    pub(crate) fn new(seed: u64, incarnation: u32) -> Self {
        Self {
            incarnation,
            trusts_itself: seed % 2 == 1,
            sent: HashMap::new(),
            reset_count: 0,
            rng: Pcg64::seed_from_u64(seed),
            sequence: 0,
            stream: None,
        }
    }

    pub(crate) fn restart(&mut self) {
        self.incarnation += 1;
        (self.sequence, self.stream, self.reset_count) = (0, None, 0);
    }

    /// Returns the command of index `k`, given the newest echo.
    pub(crate) fn tick(&mut self, k: u64, echo: Option<&RobotState>) -> Option<JointCommand> {
        let echo = echo?;
        let still = echo.v.iter().chain(&echo.a).all(|&x| x == 0.0);
        if echo.flags & state_flag::DRIVER_FAULT != 0 && still && k.is_multiple_of(5) {
            self.reset_count += 1;
        }
        let seed = match self.stream {
            None => Some(still.then(|| reseed(echo, k)).flatten()?),
            Some((chain, last_k, last)) => match on_chain(echo, &chain, last_k) {
                ChainView::Lost => Some(reseed(echo, k)?),
                ChainView::Following | ChainView::Pending if k == last_k + 1 => None,
                ChainView::Following | ChainView::Pending if self.trusts_itself => {
                    let mut motion = last;
                    motion.play(k - 1 - last_k);
                    Some(Seed { seed_k: last_k, seed_played: k - 1 - last_k, motion })
                }
                ChainView::Following | ChainView::Pending => Some(reseed(echo, k)?),
            },
        };
        if let Some(seed) = seed {
            let chain =
                CommandChain { incarnation: self.incarnation, seed_k: seed.seed_k, seed_played: seed.seed_played };
            self.stream = Some((chain, k - 1, seed.motion));
        }
        let (chain, _, base) = self.stream.expect("set above or before");
        let (motion, made) = self.next(&base);
        self.stream = Some((chain, k, motion));
        self.sequence += 1;
        let command = JointCommand {
            header: Header { sequence: self.sequence, incarnation: self.incarnation, ..Header::ZERO },
            k,
            seed_k: chain.seed_k,
            seed_played: chain.seed_played,
            reset_count: self.reset_count,
            ..JointCommand::ZERO
        }
        .with_motion(&motion);
        assert!(motion.v.iter().all(|v| v.abs() < V_MAX), "the test's own motion is honest");
        self.sent.insert((self.incarnation, k), (command, made));
        Some(command)
    }

    fn next(&mut self, base: &JointMotion) -> (JointMotion, Made) {
        let mut motion = *base;
        if self.rng.random_range(0..10) == 0 {
            motion.play(1);
            return (motion, Made::OnPlan);
        }
        let (d1, d) = (self.rng.random_range(0.003..0.02), self.rng.random_range(0.005..0.04));
        let mut jerk = [0.0; JOINTS_MAX];
        // Three joints move, which is enough to tell states apart.
        for j in [0, 5, 16] {
            let (v, a) = (base.v[j], base.a[j]);
            jerk[j] = self.rng.random_range(-5e3..5e3) - 60.0 * a - 900.0 * v;
            motion.q[j] += TICK_S * (v + TICK_S * (a / 2.0 + TICK_S * jerk[j] / 6.0));
            motion.v[j] += TICK_S * (a + TICK_S * jerk[j] / 2.0);
            motion.a[j] += TICK_S * jerk[j];
        }
        motion.plan = stop(&motion.v, &motion.a, d1, d);
        (motion, Made::Jerk(jerk))
    }
}

/// Returns a stop: `a` goes to zero in `d1` seconds, then the rest of the velocity in two phases of `d` seconds.
fn stop(v: &[f64; JOINTS_MAX], a: &[f64; JOINTS_MAX], d1: f64, d: f64) -> StopPlan {
    let mut plan = StopPlan::ZERO;
    for j in 0..JOINTS_MAX {
        if v[j] != 0.0 || a[j] != 0.0 {
            let v1 = v[j] + a[j] * d1 / 2.0;
            plan.jerk[j] = [-a[j] / d1, -v1 / (d * d), v1 / (d * d)];
            plan.duration_s[j] = [d1, d, d];
        }
    }
    plan
}
