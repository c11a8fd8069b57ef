//! What the follower refuses, when it latches, and what a reset does.

use driver::{
    Accepted, Chain, Config, GAP_MAX_TICKS, Input, JointLimits, Motion, Output, Refusal, SETTLE_TICKS, SILENCE_TICKS,
    STILL_TICKS, State, reseed, tick,
};
use messages::{Fault, Faults, Header, JOINTS, JointCommand, Layout, Stamp, StopPlan, TICK_S, deadline, state_flag};

const K: u64 = 1000;
const LIMITS: JointLimits = JointLimits { q_min: -3.0, q_max: 3.0, v_max: 2.0, a_max: 25.0, j_max: 500.0 };
const CONFIG: Config = Config::new([LIMITS; JOINTS]);

/// A driver and the honest command stream to it.
struct Bench {
    state: State,
    sequence: u64,
    chain: Chain,
}

impl Bench {
    /// Joint 3 moves at 1 rad/s already.
    fn new() -> Self {
        let mut bench = Self::at_rest();
        let command = bench.command(K);
        bench.state.motion = Motion { q: command.q, v: command.v, a: command.a, plan: command.plan };
        bench
    }

    fn at_rest() -> Self {
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

/// Gives joint 0 a speed and an acceleration, and a stop from there.
fn stopping(command: &mut JointCommand, v: f64, a: f64) {
    (command.v[0], command.a[0]) = (v, a);
    let (d1, d) = (0.01, 0.05);
    let v1 = v + a * d1 / 2.0;
    command.plan.jerk[0] = [-a / d1, -v1 / (d * d), v1 / (d * d)];
    command.plan.duration_s[0] = [d1, d, d];
}

#[test]
fn f057_f059_every_reason_to_refuse_is_met_and_counted() {
    let far = deadline(K + 6);
    type Break = fn(&mut JointCommand);
    let cases: [(Refusal, Break); 18] = [
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
        (Refusal::Jump, |c| c.q[3] += 1.2 * 500.0 * TICK_S.powi(3) / 12.0),
        (Refusal::Jump, |c| stopping(c, 1.2 * 500.0 * TICK_S.powi(2) / 4.0, 0.0)),
        (Refusal::Jump, |c| stopping(c, 0.0, 1.2 * 500.0 * TICK_S)),
        (Refusal::OutsideLimits, |c| stopping(c, 2.001, 0.0)),
        (Refusal::OutsideLimits, |c| stopping(c, 0.0, -25.001)),
        (Refusal::OutsideLimits, |c| c.q[0] = 3.001),
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
fn a_driver_that_is_late_by_a_few_ticks_goes_on() {
    let mut bench = Bench::new();
    bench.follow(K + 5);
    let newest = bench.command(K + 5 + GAP_MAX_TICKS);
    let out = bench.tick(newest.k, Some(&newest));
    assert_eq!((out.accepted.map(|a| a.k), out.faults), (Some(newest.k), Faults::NONE));
    let out = bench.tick(newest.k + GAP_MAX_TICKS, None);
    assert_eq!((out.advanced, out.suspended_ticks, out.faults), (GAP_MAX_TICKS, None, Faults::NONE));
    let mut on_plan = Motion { q: newest.q, v: newest.v, a: newest.a, plan: newest.plan };
    on_plan.play(GAP_MAX_TICKS);
    assert_eq!(bench.state.motion, on_plan);
}

/// Joint 3 of the robot at `q` and speed `v`, measured at index `k`.
fn measured_at(k: u64, q: f64, v: f64) -> driver::Measured {
    let mut measured = driver::Measured { stamp: deadline(k), ..measured() };
    (measured.q[3], measured.dq[3]) = (q, v);
    measured
}

#[test]
fn a_suspended_driver_begins_where_the_robot_is_measured() {
    for gap in [GAP_MAX_TICKS + 1, SILENCE_TICKS, SILENCE_TICKS + 1, 600, 2250] {
        let mut bench = Bench::new();
        bench.follow(K + 5);
        let before = bench.state.motion.q[3];
        let k = K + 5 + gap;
        let newest = bench.command(k);
        // Slower than the plan can have become.
        let (q, v) = (before + 0.004, 0.3);
        // Joint 5 stands: what is measured of its speed is noise.
        let mut now = measured_at(k, q, v);
        now.dq[5] = 0.01;
        let input = Input { due_k: k, command: Some(&newest), port_fault: false, measured: Some(&now) };
        let mut kinds = Vec::new();
        let out = driver::tick_each(&CONFIG, &mut bench.state, deadline(k), input, |step| kinds.push(step.kind));
        assert_eq!((out.executed.q[3], out.executed.v[3]), (q, v), "{gap}: not where the newest command is");
        assert_eq!(out.executed.v[5], 0.0, "{gap}");
        assert_eq!((out.suspended_ticks, out.accepted), (Some(gap), None));
        assert_eq!(kinds, [driver::StepKind::Measured], "{gap}: no missed tick of the plan is played");
        assert_eq!(out.faults.has(Fault::DriverFault), gap > SILENCE_TICKS, "{gap}");
        // From there it stops within the limits, and ends at rest.
        let (mut from, mut ticks) = (bench.state.motion, 0);
        while !bench.state.motion.at_rest() {
            ticks += 1;
            bench.tick(k + ticks, None);
            let to = bench.state.motion;
            let (jerk, step) = ((to.a[3] - from.a[3]).abs() / TICK_S, (to.q[3] - from.q[3]).abs());
            assert!(jerk <= LIMITS.j_max + 1e-6 && to.a[3].abs() <= LIMITS.a_max && step <= v * TICK_S, "{to:?}");
            from = to;
        }
        assert!((10..300).contains(&ticks), "{ticks}");
        assert!(bench.state.motion.q[3] > q && bench.state.motion.q[3] < q + 0.05);
    }
}

#[test]
fn a_suspended_driver_whose_robot_carried_on_goes_on_with_the_certified_stop() {
    for gap in [GAP_MAX_TICKS + 1, SILENCE_TICKS, SILENCE_TICKS + 1, 40, 600] {
        let mut bench = Bench::new();
        bench.follow(K + 5);
        let mut planned = bench.state.motion;
        planned.play(gap);
        let k = K + 5 + gap;
        // A robot stays behind its setpoints by 8 ms.
        let mut now = measured_at(k, 0.0, 0.0);
        (now.q, now.dq) = (planned.q, planned.v);
        let mut before = bench.state.motion;
        before.play(gap.saturating_sub(12));
        let sooner_s = 12_u64.saturating_sub(gap) as f64 * TICK_S;
        (now.q[3], now.dq[3]) = (before.q[3] - sooner_s * before.v[3], before.v[3]);
        let newest = bench.command(k);
        let input = Input { due_k: k, command: Some(&newest), port_fault: false, measured: Some(&now) };
        let out = tick(&CONFIG, &mut bench.state, deadline(k), input);
        assert_eq!(bench.state.motion, planned, "{gap}");
        assert_eq!((out.suspended_ticks, out.advanced, out.accepted), (Some(gap), gap, None));
        assert_eq!(out.faults.has(Fault::DriverFault), gap > SILENCE_TICKS, "{gap}");
        // One joint that is elsewhere, or has another speed, and the driver begins where all of them are measured.
        for (q, v) in [(0.02, 0.0), (-0.02, 0.0), (0.0, 0.35), (0.0, -0.35)] {
            let mut bench = Bench::new();
            bench.follow(K + 5);
            let mut elsewhere = now;
            (elsewhere.q[5], elsewhere.dq[5]) = (now.q[5] + q, now.dq[5] + v);
            let input = Input { due_k: k, command: None, port_fault: false, measured: Some(&elsewhere) };
            let out = tick(&CONFIG, &mut bench.state, deadline(k), input);
            assert_eq!(out.executed.q, elsewhere.q, "{gap}: {q}, {v}");
        }
    }
}

/// A joint that brakes already when its driver returns goes on to brake: its stop is no longer than that of a joint that has to
/// begin, and keeps the limits.
#[test]
fn a_suspended_driver_goes_on_braking() {
    let (gap, v) = (30, 1.0);
    let mut bench = Bench::new();
    bench.follow(K + 5);
    let mut planned = bench.state.motion;
    planned.play(gap);
    assert!(planned.a[3] < -1.0, "the plan brakes by then: {planned:?}");
    let now = measured_at(K + 5 + gap, bench.state.motion.q[3] - 0.05, v);
    let input = Input { due_k: K + 5 + gap, command: None, port_fault: false, measured: Some(&now) };
    let out = tick(&CONFIG, &mut bench.state, deadline(K + 5 + gap), input);
    assert_eq!((out.executed.q[3], out.executed.v[3], out.executed.a[3]), (now.q[3], v, planned.a[3]));
    let (mut end, mut largest) = (bench.state.motion, 0.0_f64);
    while !end.at_rest() {
        end.play(1);
        largest = largest.max(end.a[3].abs());
    }
    assert!(largest <= LIMITS.a_max + 1e-9);
    // Begun without acceleration the way is v (v / A + A / J) / 2.
    let unbraked = v * (v / LIMITS.a_max + LIMITS.a_max / LIMITS.j_max) / 2.0;
    let way = end.q[3] - now.q[3];
    assert!(way > 0.0 && way < unbraked, "{way}, {unbraked}");
}

#[test]
fn a_suspended_driver_believes_no_measurement_that_cannot_be() {
    let k = K + 605;
    let old = driver::Measured { stamp: deadline(K + 5), ..measured_at(k, 0.01, 0.0) };
    for (now, why) in [
        (None, "none"),
        (Some(old), "taken before the pause"),
        (Some(measured_at(k, f64::NAN, 0.0)), "NaN"),
        (Some(measured_at(k, 0.01, f64::NAN)), "NaN speed"),
        (Some(measured_at(k, 3.0, 0.0)), "farther than a joint can fall"),
    ] {
        let mut bench = Bench::new();
        bench.follow(K + 5);
        let mut end = bench.state.motion;
        end.play(600);
        let input = Input { due_k: k, command: None, port_fault: false, measured: now.as_ref() };
        let out = tick(&CONFIG, &mut bench.state, deadline(k), input);
        assert_eq!((out.executed.q, out.executed.v), (end.q, end.v), "{why}: it goes on with the certified stop");
        assert!(out.faults.has(Fault::DriverFault), "{why}");
    }
}

/// A robot that stopped by itself long ago stands before the end of the certified stop: nothing moves it there.
#[test]
fn a_suspended_driver_leads_no_robot_to_the_end_of_a_stop_that_it_did_not_play() {
    for gap in [200, 600, 2250] {
        for short in [0.001, 0.005, 0.01] {
            let mut bench = Bench::new();
            bench.follow(K + 5);
            let mut planned = bench.state.motion;
            planned.play(gap);
            assert!(planned.at_rest());
            let now = measured_at(K + 5 + gap, planned.q[3] - short, 0.0);
            let input = Input { due_k: K + 5 + gap, command: None, port_fault: false, measured: Some(&now) };
            let out = tick(&CONFIG, &mut bench.state, now.stamp, input);
            assert_eq!((out.executed.q, out.executed.v), (now.q, [0.0; JOINTS]), "{gap}, {short}");
        }
    }
}

#[test]
fn a_driver_that_starts_believes_a_speed_that_positions_confirm() {
    let elapsed_s = 9.0 * TICK_S;
    let begun = |moved: f64, v: f64| {
        let (earlier, now) = (measured_at(K, 0.5, v), measured_at(K + 9, 0.5 + moved, v));
        State::begin(&CONFIG, K + 9, &earlier, &now).expect("finite").motion
    };
    let moving = begun(1.5 * elapsed_s, 1.5);
    assert_eq!((moving.q[3], moving.v[3]), (0.5 + 1.5 * elapsed_s, 1.5), "it stops from there");
    for (moved, v, why) in [
        (0.0, 1.5, "it stands"),
        (0.0, -50.0, "it stands, and no joint is so fast"),
        (-1.5 * elapsed_s, 1.5, "it goes the other way"),
        (2.6 * elapsed_s, 2.6, "faster than any joint"),
    ] {
        assert_eq!(begun(moved, v), Motion::rest(measured_at(K, 0.5 + moved, v).q), "{why}");
    }
    let (earlier, now) = (measured_at(K, 0.5, 1.5), measured_at(K + 9, 0.5 + 1.5 * elapsed_s, 1.5));
    assert!(State::begin(&CONFIG, K + 9, &earlier, &now).unwrap().latched, "nobody proved that stop");
    assert_eq!(State::begin(&CONFIG, K + 9, &now, &now).unwrap().motion.v, [0.0; JOINTS], "one look confirms nothing");
}

#[test]
fn a_robot_at_rest_bears_any_pause_of_its_driver() {
    let mut bench = Bench::at_rest();
    for gap in [1, 9, 15, 600, 100_000] {
        let k = bench.state.index() + gap;
        let out = bench.tick(k, None);
        assert_eq!((out.advanced, out.suspended_ticks, out.faults), (gap, None, Faults::NONE));
        // Nor does it leap to where a stream has gone meanwhile.
        let far = bench.command(k + GAP_MAX_TICKS + 1);
        let input = Input { due_k: k, command: Some(&far), port_fault: false, measured: None };
        let out = tick(&CONFIG, &mut bench.state, deadline(far.k), input);
        assert_eq!(out.refused, Some(Refusal::Gap), "{gap}");
    }
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
fn a_reset_is_taken_once_the_joints_have_been_measured_standing() {
    // The command stands; joint 3 swings by 0.05 rad at 8 or 20 Hz, drifts, or is away from where it is told to be.
    let swings = |n: f64, hz: f64| 0.05 * (core::f64::consts::TAU * hz * n * TICK_S).sin();
    let moves: [fn(f64) -> f64; 2] = [|n| 0.35 * n * TICK_S - 0.04, |_| 0.2];
    let cases: Vec<Box<dyn Fn(f64) -> f64>> = vec![
        Box::new(move |n| swings(n, 8.0)),
        Box::new(move |n| swings(n, 20.0)),
        Box::new(moves[0]),
        Box::new(moves[1]),
    ];
    for (case, away) in cases.iter().enumerate() {
        let mut bench = Bench::new();
        let from = bench.latch() + 1;
        for n in 0..200 + STILL_TICKS + 10 {
            let k = from + n;
            let mut now = driver::Measured { q: bench.state.motion.q, ..measured() };
            if n < 200 {
                now.q[3] += if n == 0 { 1.0 } else { away(n as f64) };
            }
            let reset = bench.fresh(k, n as u32 + 1);
            let command = Some(&reset).filter(|_| n > 0);
            let input = Input { due_k: k, command, port_fault: false, measured: Some(&now) };
            let out = tick(&CONFIG, &mut bench.state, deadline(k), input);
            if !(200..=200 + STILL_TICKS).contains(&n) {
                assert_eq!(out.accepted.is_some(), n >= 200, "{case}: tick {n}");
            }
        }
    }
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
        let stands_for = if moves_for == u64::MAX { 0 } else { STILL_TICKS + 20 };
        for n in 0..10 + held_for + stands_for {
            let k = K + 6 + n;
            let moves = n < moves_for.saturating_add(10);
            now.drives.emergency_stop = n < 10;
            now.dq[3] = if moves { 0.5 } else { 0.02 };
            now.q[3] += if moves { 0.5 * TICK_S } else { 0.0 };
            // Whoever resets and goes on sending is heard only once the joint has stood.
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
        assert_eq!(bench.state.latched, moves_for == u64::MAX, "a reset is taken once it stands");
    }
}

/// A torso that sinks at 0.03 m/s is slow beside an arm, and at half of its own largest speed.
#[test]
fn f064_whether_a_joint_stands_is_measured_by_its_own_largest_speed() {
    for (speed, largest, holds) in [(0.03, 0.07, true), (0.010, 0.07, false), (0.03, 0.7, false), (0.11, 0.7, true)] {
        let mut config = CONFIG;
        config.limits[0].v_max = largest;
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
    assert!(steps < 3, "{steps}");
    assert_eq!((bench.state.index(), bench.state.motion), (K + (1 << 40), Motion::rest(bench.state.motion.q)));
}
