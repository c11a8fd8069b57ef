//! What the follower refuses, when it latches, and what a reset does.

use driver::{
    Accepted, Chain, Config, Input, Motion, Output, Refusal, SETTLE_TICKS, SILENCE_TICKS, State, reseed, tick,
};
use messages::{Fault, Faults, Header, JOINTS, JointCommand, Layout, Stamp, StopPlan, TICK_S, deadline, state_flag};

const K: u64 = 1000;
const CONFIG: Config = Config::new([2.0; JOINTS]);

/// A driver and the honest command stream to it.
struct Bench {
    state: State,
    sequence: u64,
    chain: Chain,
}

impl Bench {
    fn new() -> Self {
        let state = State::hold(K, &[0.0; JOINTS]).unwrap();
        Self { state, sequence: 0, chain: Chain { incarnation: 1, seed_k: K, seed_played: 0 } }
    }

    /// A command of index `k`; joint 3 moves at 1 rad/s and stops within 0.1 s.
    fn command(&mut self, k: u64) -> JointCommand {
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

    /// A command of index `k` that continues from the executed state at rest, on a new chain.
    fn fresh(&mut self, k: u64, reset_count: u32) -> JointCommand {
        let echo = self.state.echo(Header::ZERO, &measured());
        let seed = reseed(&echo, k).unwrap();
        (self.chain.seed_k, self.chain.seed_played) = (seed.seed_k, seed.seed_played);
        let honest = self.command(k);
        JointCommand { q: seed.motion.q, v: [0.0; JOINTS], plan: StopPlan::ZERO, reset_count, ..honest }
    }

    /// The driver's tick at index `k`, at its grace.
    fn tick(&mut self, k: u64, command: Option<&JointCommand>) -> Output {
        tick(&CONFIG, &mut self.state, deadline(k), Input { due_k: k, command, port_fault: false, measured: None })
    }

    /// Follows commands up to index `k`.
    fn follow(&mut self, to_k: u64) {
        for k in self.state.index() + 1..=to_k {
            let command = self.command(k);
            assert!(self.tick(k, Some(&command)).accepted.is_some());
        }
    }

    /// Follows to `K + 5`, then silence until the fault is latched and the plan has ended; returns the index.
    fn latch(&mut self) -> u64 {
        self.follow(K + 5);
        for k in K + 6..K + 200 {
            self.tick(k, None);
        }
        assert!(self.state.latched && self.state.motion.at_rest());
        K + 199
    }
}

fn measured() -> driver::Measured {
    driver::Measured { stamp: Stamp::NONE, q: [0.0; JOINTS], dq: [0.0; JOINTS], drives: driver::Drives::SOUND }
}

#[test]
fn f057_f059_every_reason_to_refuse_is_met_and_counted() {
    let far = deadline(K + 6);
    type Break = fn(&mut JointCommand);
    let cases: [(Refusal, Break); 12] = [
        (Refusal::NotFinite, |c| c.q[16] = f64::NAN),
        (Refusal::NotFinite, |c| c.plan.duration_s[0][2] = f64::INFINITY),
        (Refusal::NotAStop, |c| c.plan.duration_s[3][1] = 0.04),
        (Refusal::NotAStop, |c| c.plan.duration_s[0] = [-0.1, 0.1, 0.0]),
        (Refusal::NotAStop, |c| c.plan.duration_s[0] = [4.0, 4.0, 0.0]),
        (Refusal::TooFarAhead, |c| c.k = K + 9),
        (Refusal::TooFarAhead, |c| c.k = u64::MAX),
        (Refusal::TooOld, |c| c.k = K + 3),
        (Refusal::OtherSeed, |c| c.seed_k = K + 4),
        (Refusal::NotAhead, |c| c.k = K + 5),
        (Refusal::NotAhead, |c| (c.seed_k, c.seed_played) = (K + 5, 1)),
        (Refusal::Jump, |c| c.q[3] += 2.1 * TICK_S),
    ];
    for (expected, break_it) in cases {
        let mut bench = Bench::new();
        bench.follow(K + 5);
        let mut command = bench.command(K + 6);
        break_it(&mut command);
        let executed = bench.state.motion;
        let input = Input { due_k: K + 6, command: Some(&command), port_fault: false, measured: None };
        let out = tick(&CONFIG, &mut bench.state, far, input);
        assert_eq!((out.refused, out.accepted), (Some(expected), None), "{command:?}");
        assert_eq!(bench.state.refused[expected as usize], 1);
        let mut on_plan = executed;
        on_plan.play(1);
        assert_eq!(bench.state.motion, on_plan, "the plan is played instead");
        assert_eq!(bench.state.echo(Header::ZERO, &measured()).commands_refused, 1);
    }
}

#[test]
fn a_chain_that_was_left_or_whose_seed_has_passed_is_refused() {
    let mut bench = Bench::new();
    bench.follow(K + 5);
    bench.tick(K + 6, None);
    let late = bench.command(K + 7);
    assert_eq!(bench.tick(K + 7, Some(&late)).refused, Some(Refusal::ChainLeft));
    bench.chain = Chain { seed_k: K + 5, seed_played: 1, ..bench.chain };
    let passed = bench.command(K + 8);
    assert_eq!(bench.tick(K + 8, Some(&passed)).refused, Some(Refusal::SeedPassed));
}

#[test]
fn f059_an_early_command_is_executed_at_once_and_only_once() {
    let mut bench = Bench::new();
    bench.follow(K + 5);
    let early = bench.command(K + 6);
    let out = bench.tick(K + 5, Some(&early));
    assert_eq!((out.executed.k, out.advanced), (K + 6, 1));
    let again = bench.tick(K + 6, Some(&early));
    assert_eq!((again.executed, again.advanced, again.accepted), (out.executed, 0, None));
    assert_eq!(bench.state.refused, [0; Refusal::COUNT], "a sample read twice is judged once");
}

#[test]
fn f058_silence_latches_after_ten_milliseconds_and_not_before() {
    let mut bench = Bench::new();
    for k in K + 1..K + 100 {
        assert_eq!(bench.tick(k, None).faults, Faults::NONE, "silence counts from the first command");
    }
    let mut bench = Bench::new();
    bench.follow(K + 5);
    for n in 1..=SILENCE_TICKS {
        let out = bench.tick(K + 5 + n, None);
        assert_eq!(out.faults.has(Fault::DriverFault), n == SILENCE_TICKS, "tick {n}");
    }
    let flags = bench.state.echo(Header::ZERO, &measured()).flags;
    assert_eq!(flags, state_flag::DRIVER_FAULT | state_flag::COMMANDED);
}

#[test]
fn a_drivers_own_oversleep_is_not_charged_to_control() {
    let mut bench = Bench::new();
    bench.follow(K + 5);
    let out = bench.tick(K + 5 + 3 * SILENCE_TICKS, None);
    assert_eq!((out.advanced, out.faults), (3 * SILENCE_TICKS, Faults::NONE));
    // With the newest command of the same chain there, it is taken straight away.
    let mut bench = Bench::new();
    bench.follow(K + 5);
    let newest = bench.command(K + 50);
    let out = bench.tick(K + 50, Some(&newest));
    assert_eq!((out.executed.k, out.accepted.map(|a| a.k)), (K + 50, Some(K + 50)));
}

#[test]
fn only_a_reset_edge_at_rest_clears_the_latch() {
    let mut bench = Bench::new();
    let k = bench.latch();
    let held = bench.fresh(k + 1, 0);
    assert_eq!(bench.tick(k + 1, Some(&held)).refused, Some(Refusal::Latched), "no edge");
    let reset = bench.fresh(k + 2, 1);
    let out = bench.tick(k + 2, Some(&reset));
    assert!(out.accepted.is_some() && out.faults.is_empty(), "an edge at rest clears, and the same command is taken");
    assert_eq!(bench.state.echo(Header::ZERO, &measured()).reset_count, 1);
}

#[test]
fn a_reset_edge_in_motion_is_spent() {
    let mut bench = Bench::new();
    bench.follow(K + 5);
    for k in K + 6..K + 25 {
        bench.tick(k, None);
    }
    assert!(bench.state.latched && !bench.state.motion.at_rest());
    let mut reset = bench.command(K + 25);
    reset.reset_count = 1;
    assert_eq!(bench.tick(K + 25, Some(&reset)).refused, Some(Refusal::Latched));
    for k in K + 26..K + 200 {
        bench.tick(k, None);
    }
    let held = bench.fresh(K + 200, 1);
    assert_eq!(bench.tick(K + 200, Some(&held)).refused, Some(Refusal::Latched), "the edge came in motion");
    let reset = bench.fresh(K + 201, 2);
    assert!(bench.tick(K + 201, Some(&reset)).accepted.is_some());
}

#[test]
fn a_restarted_control_resets_nothing() {
    let mut bench = Bench::new();
    let k = bench.latch();
    bench.chain.incarnation = 2;
    for n in 1..4 {
        let command = bench.fresh(k + n, 7);
        assert_eq!(bench.tick(k + n, Some(&command)).refused, Some(Refusal::Latched), "its first count is no edge");
    }
    let reset = bench.fresh(k + 4, 8);
    assert!(bench.tick(k + 4, Some(&reset)).accepted.is_some());
}

#[test]
fn f057_a_robot_that_takes_no_setpoints_latches_at_once() {
    let mut bench = Bench::new();
    bench.follow(K + 5);
    let next = bench.command(K + 6);
    let input = Input { due_k: K + 6, command: Some(&next), port_fault: true, measured: None };
    let out = tick(&CONFIG, &mut bench.state, deadline(K + 6), input);
    assert_eq!((out.refused, out.faults), (Some(Refusal::Latched), Faults::NONE.with(Fault::DriverFault)));
}

#[test]
fn f064_power_that_returns_while_a_joint_moves_holds_it_where_it_is_until_it_stands() {
    // Joint 3 goes on at 0.5 rad/s, for a while or for ever.
    for (moves_for, held_for) in [(200, 200), (u64::MAX, SETTLE_TICKS - 1)] {
        let mut bench = Bench::new();
        bench.follow(K + 5);
        let (mut now, mut held_until) = (measured(), 0);
        for n in 0..10 + held_for + 20 {
            let k = K + 6 + n;
            let moves = n < moves_for.saturating_add(10);
            now.drives.emergency_stop = n < 10;
            now.dq[3] = if moves { 0.5 } else { 0.02 };
            now.q[3] += if moves { 0.5 * TICK_S } else { 0.0 };
            // Whoever resets and goes on sending is heard only once the joint stands.
            let command = bench.fresh(k, n as u32 / 2);
            let input = Input { due_k: k, command: Some(&command), port_fault: false, measured: Some(&now) };
            let out = tick(&CONFIG, &mut bench.state, deadline(k), input);
            let holds = bench.state.chain.is_none() && bench.state.executed_k == k;
            if holds {
                assert!(bench.state.latched && out.accepted.is_none(), "tick {n}");
                assert_eq!((out.executed.q, out.executed.v), (now.q, [0.0; JOINTS]), "tick {n}");
                held_until = n;
            }
        }
        assert_eq!(held_until, 9 + held_for, "the joint moved for {moves_for} ticks");
        assert!(!bench.state.latched, "a reset is taken then");
    }
}

/// A torso that sinks at 0.03 m/s is slow beside an arm, and at half of its own largest speed.
#[test]
fn f064_whether_a_joint_stands_is_measured_by_its_own_largest_speed() {
    for (speed, largest, holds) in [(0.03, 0.07, true), (0.010, 0.07, false), (0.03, 0.7, false), (0.11, 0.7, true)] {
        let mut config = CONFIG;
        config.v_max[0] = largest;
        let mut bench = Bench::new();
        bench.follow(K + 5);
        let mut now = measured();
        for n in 0..20 {
            let k = K + 6 + n;
            now.drives.emergency_stop = n < 10;
            now.dq[0] = speed;
            now.q[0] += speed * TICK_S;
            let input = Input { due_k: k, command: None, port_fault: false, measured: Some(&now) };
            tick(&config, &mut bench.state, deadline(k), input);
        }
        let held = bench.state.executed_k == K + 25 && bench.state.motion.q == now.q;
        assert_eq!(held, holds, "{speed} of {largest}");
    }
}

#[test]
fn latencies_are_of_new_origins_and_of_every_target() {
    let mut bench = Bench::new();
    let mut ages = Vec::new();
    for (k, origin) in [(K + 1, 0), (K + 2, 5_000), (K + 3, 5_000), (K + 4, 7_000)] {
        let mut command = bench.command(k);
        command.header.origin = Stamp(origin);
        command.target_stamp = Stamp(deadline(k).0 - 40_000);
        let Some(Accepted { origin_age_ns, target_age_ns, .. }) = bench.tick(k, Some(&command)).accepted else {
            panic!("an honest command")
        };
        assert_eq!(target_age_ns, Some(40_000));
        ages.push(origin_age_ns);
    }
    assert_eq!(ages, [None, Some(deadline(K + 2).0 - 5_000), None, Some(deadline(K + 4).0 - 7_000)]);
}

#[test]
fn a_posture_that_is_no_number_is_not_held() {
    let mut q = [0.0; JOINTS];
    q[7] = f64::NAN;
    assert_eq!(State::hold(K, &q), None);
}

#[test]
fn a_suspended_machine_resumes_at_rest_in_bounded_work() {
    let mut bench = Bench::new();
    bench.follow(K + 5);
    let mut steps = 0;
    let input = Input { due_k: K + (1 << 40), command: None, port_fault: false, measured: None };
    driver::tick_each(&CONFIG, &mut bench.state, deadline(K + (1 << 40)), input, |_| steps += 1);
    assert!(steps < 200, "{steps}");
    assert_eq!((bench.state.index(), bench.state.motion), (K + (1 << 40), Motion::rest(bench.state.motion.q)));
}
