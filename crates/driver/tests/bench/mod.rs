//! A driver's follower, and the valid command stream to it.

use driver::{CommandChain, Config, Drives, Input, JointLimits, Measured, Output, State, tick};
use messages::{Header, JOINTS_MAX, JointCommand, Layout, RobotId, Stamp, TICK_S, deadline};

pub(crate) const K: u64 = 1000;
pub(crate) const LIMITS: JointLimits = JointLimits { q_min: -3.0, q_max: 3.0, v_max: 2.0, a_max: 25.0, j_max: 500.0 };
pub(crate) const CONFIG: Config = Config::new(RobotId::ZERO, [LIMITS; JOINTS_MAX]);

/// A driver and the valid command stream to it.
pub(crate) struct Bench {
    pub(crate) state: State,
    pub(crate) sequence: u64,
    pub(crate) chain: CommandChain,
}

impl Bench {
    /// Creates a bench in which joint 3 already moves at 1 rad/s.
    pub(crate) fn new() -> Self {
        let mut bench = Self::at_rest();
        let command = bench.command(K);
        bench.state.motion = command.motion();
        bench
    }

    /// Creates a bench that has followed commands up to `K + 5`.
    pub(crate) fn following() -> Self {
        let mut bench = Self::new();
        bench.follow(K + 5);
        bench
    }

    pub(crate) fn at_rest() -> Self {
        let state = State::hold(K, &[0.0; JOINTS_MAX]).unwrap();
        Self { state, sequence: 0, chain: CommandChain { incarnation: 1, seed_k: K, seed_played: 0 } }
    }

    /// Returns a command of index `k`. Joint 3 moves at 1 rad/s and stops within 0.1 s.
    pub(crate) fn command(&mut self, k: u64) -> JointCommand {
        self.sequence += 1;
        let mut command = JointCommand {
            header: Header { sequence: self.sequence, incarnation: self.chain.incarnation, ..Header::ZERO },
            k,
            seed_k: self.chain.seed_k,
            seed_played: self.chain.seed_played,
            ..JointCommand::ZERO
        };
        command.q[3] = (k - K) as f64 * TICK_S;
        command.v[3] = 1.0;
        command.plan.jerk[3] = [-400.0, 400.0, 0.0];
        command.plan.duration_s[3] = [0.05, 0.05, 0.0];
        command
    }

    /// Runs the driver's tick at index `k`, at its grace.
    pub(crate) fn tick(&mut self, k: u64, command: Option<&JointCommand>) -> Output {
        tick(&CONFIG, &mut self.state, deadline(k), Input { due_k: k, command, port_fault: false, measured: None })
    }

    /// The same without a command, with a measurement.
    pub(crate) fn tick_measuring(&mut self, k: u64, measured: &Measured) -> Output {
        let input = Input { due_k: k, command: None, port_fault: false, measured: Some(measured) };
        tick(&CONFIG, &mut self.state, deadline(k), input)
    }

    /// Follows commands up to index `k`.
    pub(crate) fn follow(&mut self, to_k: u64) {
        for k in self.state.index() + 1..=to_k {
            let command = self.command(k);
            assert!(self.tick(k, Some(&command)).accepted.is_some());
        }
    }
}

pub(crate) fn measured() -> Measured {
    let [q, dq] = [[0.0; JOINTS_MAX]; 2];
    Measured { stamp: Stamp::NONE, q, dq, drives: Drives::SOUND, unanswered: false, refused: false }
}
