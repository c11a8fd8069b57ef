//! Refusals of the follower, its latch, and its reset.

use crate::bench::{Bench, CONFIG, K, measured};
use driver::{
    Accepted, CommandChain, Config, Drive, DriveInput, Driver, GAP_MAX_TICKS, Input, Measured, PlanPlayback, Refusal,
    SETTLE_TICKS, SILENCE_TICKS, STILL_TICKS, Setpoint, State, drive, reseed, tick,
};
use messages::{
    Fault, Faults, Header, JOINTS_MAX, JointCommand, Layout, Stamp, StopPlan, TICK_S, deadline, state_flag,
};

impl Bench {
    /// Returns a command of index `k` on a new chain that continues from the executed state at rest.
    fn fresh(&mut self, k: u64, reset_count: u32) -> JointCommand {
        let echo = self.state.echo(&CONFIG, Header::ZERO, &measured());
        let seed = reseed(&echo, k).unwrap();
        (self.chain.seed_k, self.chain.seed_played) = (seed.seed_k, seed.seed_played);
        let honest = self.command(k);
        JointCommand { q: seed.motion.q, v: [0.0; JOINTS_MAX], plan: StopPlan::ZERO, reset_count, ..honest }
    }

    /// Follows to `K + 5`, then sends nothing until the fault is latched and the plan has ended. Returns the index.
    fn latch(&mut self) -> u64 {
        self.follow(K + 5);
        for k in K + 6..K + 200 {
            self.tick(k, None);
        }
        assert!(self.state.latched && self.state.motion.is_at_rest());
        K + 199
    }
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
fn f057_f059_bad_command_is_refused_with_its_reason_and_counted() {
    let far = deadline(K + 6);
    type Break = fn(&mut JointCommand);
    let cases: [(Refusal, Break); 21] = [
        (Refusal::OtherRobot, |c| c.robot.hash ^= 1),
        (Refusal::OtherRobot, |c| c.robot.joint_count ^= 1),
        (Refusal::NotFinite, |c| c.q[16] = f64::NAN),
        (Refusal::NotFinite, |c| c.plan.duration_s[0][2] = f64::INFINITY),
        (Refusal::NotAStop, |c| c.plan.duration_s[3][1] = 0.04),
        (Refusal::NotAStop, |c| c.plan.duration_s[0] = [-0.1, 0.1, 0.0]),
        (Refusal::NotAStop, |c| (c.plan.jerk[0], c.plan.duration_s[0]) = ([1e308, -1e308, 0.0], [2.5, 2.5, 0.0])),
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
        let mut bench = Bench::following();
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
        assert_eq!(bench.state.echo(&CONFIG, Header::ZERO, &measured()).commands_refused, 1);
    }
}

#[test]
fn command_with_left_chain_or_passed_seed_is_refused() {
    let mut bench = Bench::following();
    bench.tick(K + 6, None);
    let late = bench.command(K + 7);
    assert_eq!(bench.tick(K + 7, Some(&late)).refused, Some(Refusal::ChainLeft));
    bench.chain = CommandChain { seed_k: K + 5, seed_played: 1, ..bench.chain };
    let passed = bench.command(K + 8);
    assert_eq!(bench.tick(K + 8, Some(&passed)).refused, Some(Refusal::SeedPassed));
}

#[test]
fn f059_early_command_is_executed_at_once_and_only_once() {
    let mut bench = Bench::following();
    let early = bench.command(K + 6);
    let out = bench.tick(K + 5, Some(&early));
    assert_eq!((out.executed.k, out.advanced), (K + 6, 1));
    let again = bench.tick(K + 6, Some(&early));
    assert_eq!((again.executed, again.advanced, again.accepted), (out.executed, 0, None));
    assert_eq!(bench.state.refused, [0; Refusal::COUNT], "a sample read twice is judged once");
}

#[test]
fn f058_driver_without_commands_latches_after_10_ms() {
    let mut bench = Bench::new();
    for k in K + 1..K + 100 {
        assert_eq!(bench.tick(k, None).faults, Faults::NONE, "silence counts from the first command");
    }
    let mut bench = Bench::following();
    for n in 1..=SILENCE_TICKS {
        let out = bench.tick(K + 5 + n, None);
        assert_eq!(out.faults.has(Fault::DriverFault), n == SILENCE_TICKS, "tick {n}");
    }
    let flags = bench.state.echo(&CONFIG, Header::ZERO, &measured()).flags;
    assert_eq!(flags, state_flag::DRIVER_FAULT | state_flag::COMMANDED);
}

#[test]
fn driver_late_by_few_ticks_continues_without_fault() {
    let mut bench = Bench::following();
    let newest = bench.command(K + 5 + GAP_MAX_TICKS);
    let out = bench.tick(newest.k, Some(&newest));
    assert_eq!((out.accepted.map(|a| a.k), out.faults), (Some(newest.k), Faults::NONE));
    let out = bench.tick(newest.k + GAP_MAX_TICKS, None);
    assert_eq!((out.advanced, out.suspended_ticks, out.faults), (GAP_MAX_TICKS, None, Faults::NONE));
    let mut on_plan = newest.motion();
    on_plan.play(GAP_MAX_TICKS);
    assert_eq!(bench.state.motion, on_plan);
}

#[test]
fn latch_clears_only_on_reset_edge_at_rest() {
    let mut bench = Bench::new();
    let k = bench.latch();
    let held = bench.fresh(k + 1, 0);
    assert_eq!(bench.tick(k + 1, Some(&held)).refused, Some(Refusal::Latched), "no edge");
    let reset = bench.fresh(k + 2, 1);
    let out = bench.tick(k + 2, Some(&reset));
    assert!(out.accepted.is_some() && out.faults.is_empty(), "an edge at rest clears, and the same command is taken");
    assert_eq!(bench.state.echo(&CONFIG, Header::ZERO, &measured()).reset_count, 1);
}

#[test]
fn reset_edge_in_motion_clears_nothing_later() {
    let mut bench = Bench::following();
    for k in K + 6..K + 25 {
        bench.tick(k, None);
    }
    assert!(bench.state.latched && !bench.state.motion.is_at_rest());
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
fn reset_is_accepted_only_after_joints_measured_at_rest() {
    // The command stands. Joint 3 swings by 0.05 rad at 8 or 20 Hz, drifts, or is away from its setpoint.
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
fn restarted_control_first_reset_count_is_no_edge() {
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
fn f057_driver_whose_robot_takes_no_setpoints_latches_at_once() {
    let mut bench = Bench::following();
    let next = bench.command(K + 6);
    let input = Input { due_k: K + 6, command: Some(&next), port_fault: true, measured: None };
    let out = tick(&CONFIG, &mut bench.state, deadline(K + 6), input);
    assert_eq!((out.refused, out.faults), (Some(Refusal::Latched), Faults::NONE.with(Fault::DriverFault)));
}

/// A robot with power that refuses setpoints stops by itself. It takes the next setpoint that is near it, and
/// reports that late. Until then the driver must not begin another motion, which would be a jump.
#[test]
fn f057_robot_refusing_setpoints_gets_plan_only_while_near_it() {
    let mut bench = Bench::following();
    let mut planned = bench.state.motion;
    let mut now = measured();
    // The robot stands where it was, and the plan goes on.
    now.q[3] = planned.q[3];
    let mut left = 0;
    for k in K + 6..K + 60 {
        planned.play(1);
        let refuses = Input { due_k: k, command: None, port_fault: true, measured: Some(&now) };
        let out = tick(&CONFIG, &mut bench.state, deadline(k), refuses);
        assert!(out.faults.has(Fault::DriverFault));
        // A robot that follows lags by 20 mrad at 2 rad/s, and encoders err by 0.4 mrad.
        if planned.q[3] - now.q[3] <= 0.0204 {
            assert_eq!((out.executed.q, out.executed.v), (planned.q, planned.v), "tick {k}");
        } else {
            left += 1;
            assert_eq!((out.executed.q, out.executed.v), (now.q, [0.0; JOINTS_MAX]), "tick {k}: where it is");
        }
    }
    assert!(left > 10, "{left}");
}

/// The robot may have taken the last setpoint, and then the held posture would be a jump. So it must answer first.
#[test]
fn f057_robot_off_its_plan_is_held_only_after_it_answers() {
    for (answers_after, takes) in [(3, false), (3, true), (u64::MAX, false)] {
        let mut bench = Bench::following();
        let mut planned = bench.state.motion;
        let mut now = measured();
        now.q[3] = planned.q[3];
        let (mut withheld, mut held) = (0, false);
        for k in K + 6..K + 120 {
            planned.play(1);
            let answered = withheld >= answers_after;
            (now.unanswered, now.refused) = (!answered, !(answered && takes));
            let input = Input { due_k: k, command: None, port_fault: now.refused, measured: Some(&now) };
            let out = tick(&CONFIG, &mut bench.state, deadline(k), input);
            withheld += u64::from(out.withheld);
            held |= out.executed.q == now.q;
            assert!(!(held && out.withheld), "tick {k}");
            if !held {
                assert_eq!(out.executed.q, planned.q, "tick {k}");
            }
        }
        assert_eq!(held, !takes, "{answers_after}");
        assert_eq!(withheld, answers_after.min(30));
    }
}

#[test]
fn f064_moving_joint_is_held_where_measured_when_power_returns() {
    // Joint 3 goes on at 0.5 rad/s, for a while or forever.
    for (moves_for, held_for) in [(200, 200), (u64::MAX, SETTLE_TICKS - 1)] {
        let mut bench = Bench::following();
        let (mut now, mut held_until) = (measured(), 0);
        let stands_for = if moves_for == u64::MAX { 0 } else { STILL_TICKS + 20 };
        for n in 0..10 + held_for + stands_for {
            let k = K + 6 + n;
            let moves = n < moves_for.saturating_add(10);
            now.drives.emergency_stop = n < 10;
            now.dq[3] = if moves { 0.5 } else { 0.02 };
            now.q[3] += if moves { 0.5 * TICK_S } else { 0.0 };
            // A client that resets and goes on sending is accepted only once the joint has stood.
            let command = bench.fresh(k, n as u32 / 2);
            let input = Input { due_k: k, command: Some(&command), port_fault: false, measured: Some(&now) };
            let out = tick(&CONFIG, &mut bench.state, deadline(k), input);
            let holds = bench.state.chain.is_none() && bench.state.executed_k == k;
            if holds {
                assert!(bench.state.latched && out.accepted.is_none(), "tick {n}");
                assert_eq!(out.executed.v, [0.0; JOINTS_MAX], "tick {n}");
                assert!(is_held(&out.executed.q, &now.q), "tick {n}");
                held_until = n;
            }
        }
        assert_eq!(held_until, 9 + held_for, "the joint moved for {moves_for} ticks");
        assert_eq!(bench.state.latched, moves_for == u64::MAX, "a reset is taken once it stands");
    }
}

/// A torso that sinks at 0.03 m/s is slow compared with an arm, but moves at half of its own largest speed.
#[test]
fn f064_standstill_threshold_scales_with_joint_speed_limit() {
    for (speed, largest, holds) in [(0.03, 0.07, true), (0.010, 0.07, false), (0.03, 0.7, false), (0.11, 0.7, true)] {
        let mut config = CONFIG;
        config.limits[0].v_max = largest;
        let mut bench = Bench::following();
        let mut now = measured();
        for n in 0..20 {
            let k = K + 6 + n;
            now.drives.emergency_stop = n < 10;
            now.dq[0] = speed;
            now.q[0] += speed * TICK_S;
            let input = Input { due_k: k, command: None, port_fault: false, measured: Some(&now) };
            tick(&config, &mut bench.state, deadline(k), input);
        }
        let held = bench.state.executed_k == K + 25 && is_held(&bench.state.motion.q, &now.q);
        assert_eq!(held, holds, "{speed} of {largest}");
    }
}

/// Returns true if every joint is held where it is measured, but for the noise of an encoder.
fn is_held(held: &[f64; JOINTS_MAX], measured: &[f64; JOINTS_MAX]) -> bool {
    (0..JOINTS_MAX).all(|j| (held[j] - measured[j]).abs() <= 4e-4 + 1e-12)
}

/// The noise of the torso's encoder is two ticks of its way at full speed.
#[test]
fn f064_held_joint_does_not_follow_encoder_noise() {
    let mut bench = Bench::following();
    let (mut now, mut held) = (measured(), None);
    for n in 0..100 {
        let k = K + 6 + n;
        now.drives.emergency_stop = n < 10;
        (now.dq[3], now.q[3]) = (0.5, now.q[3] + 0.5 * TICK_S);
        now.q[0] = if n % 2 == 0 { 9.6e-5 } else { -9.6e-5 };
        let out = bench.tick_measuring(k, &now);
        if bench.state.executed_k == k {
            assert_eq!(*held.get_or_insert(out.executed.q[0]), out.executed.q[0], "tick {n}");
            assert!(is_held(&out.executed.q, &now.q), "tick {n}");
        }
    }
    assert!(held.is_some());
}

#[test]
fn origin_age_is_given_once_and_target_age_on_every_command() {
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
fn hold_of_nan_posture_is_refused() {
    let mut q = [0.0; JOINTS_MAX];
    q[7] = f64::NAN;
    assert_eq!(State::hold(K, &q), None);
}

/// A port that measured once, or measures late.
struct Silent(Measured);

impl Driver for Silent {
    fn read(&mut self, _: Stamp) -> Measured {
        self.0
    }

    fn write(&mut self, _: Stamp, _: &Setpoint, _: &StopPlan) -> bool {
        true
    }
}

#[test]
fn f052_old_measurement_is_flagged_before_it_latches() {
    let config = Config { unseen_ns: 10_000_000, measured_age_max_ns: 200_000_000, ..CONFIG };
    let start = Measured { stamp: deadline(K), ..measured() };
    let mut state = Drive::new(&config, K, &start, &start).expect("finite");
    for n in 1..400 {
        let (now, input) = (deadline(K + n), DriveInput { due_k: K + n, command: None });
        let out = drive(&config, &mut state, now, input, &mut Silent(start), &mut ());
        let age_ns = now.since(start.stamp);
        assert_eq!(out.state.flags & state_flag::UNSEEN != 0, age_ns > 10_000_000, "{age_ns} ns");
        assert_eq!(out.faults.has(Fault::DriverFault), age_ns > 200_000_000, "{age_ns} ns");
    }
    // New measurements are judged, however late they are.
    let mut state = Drive::new(&config, K, &start, &start).expect("finite");
    for n in 1..400 {
        let (now, input) = (deadline(K + n + 60), DriveInput { due_k: K + n, command: None });
        let late = Measured { stamp: deadline(K + n), ..start };
        let out = drive(&config, &mut state, now, input, &mut Silent(late), &mut ());
        assert_eq!(out.state.flags & state_flag::UNSEEN, 0);
    }
}
