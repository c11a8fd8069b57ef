//! Tests the state machine's figures at their edges. They would reveal one wrong sign or one wrong comparison.

use crate::support::{Alive, Bench, settings, ticks};
use messages::{FAULTS, Fault, Mode, Stamp, deadline, reduced_flag};
use safety::engage::{Output, Permit};

#[test]
fn writer_never_seen_gives_only_its_missing_fault() {
    let mut bench = Bench::new();
    (bench.alive.target, bench.alive.input, bench.alive.state) = (false, false, false);
    (bench.input.target.config_matches, bench.input.robot.config_matches) = (false, false);
    (bench.input.target.input_fresh, bench.input.target.implausible) = (false, true);
    (bench.input.robot.outside_limits, bench.input.robot.in_collision) = (true, true);
    (bench.input.robot.collision_near, bench.input.robot.driver_fault) = (true, true);
    bench.input.robot.tracking_error_rad = f64::NAN;
    for _ in 0..ticks(1000) {
        let active = bench.step().active;
        let named: Vec<Fault> = active.iter().collect();
        assert_eq!(named, [Fault::NoRobotState, Fault::NoTarget]);
    }
}

/// Steps in which stream `n` (target, input, state, heartbeat) is always `age_ns` old when it is judged.
fn always_as_old(bench: &mut Bench, n: usize, age_ns: u64, count: u64) -> Output {
    let [target, input, state, heartbeat] = std::array::from_fn(|stream| stream != n);
    bench.alive = Alive { target, input, state, heartbeat };
    let mut out = None;
    for _ in 0..count {
        let at = Stamp(deadline(bench.input.k + 1).0 - age_ns);
        let (target, robot, operator) = (&mut bench.input.target, &mut bench.input.robot, &mut bench.input.operator);
        match n {
            0 => target.received = at,
            1 => target.input_received = at,
            2 => robot.received = at,
            _ => operator.heartbeat_received = at,
        }
        out = Some(bench.step());
    }
    out.expect("at least a step")
}

/// Ages are exact. A message that arrives exactly as old as allowed is not stale, and one nanosecond more is stale.
#[test]
fn stream_age_limits_are_exact_to_the_nanosecond() {
    let ns = |ms: f64| (ms * 1e6) as u64;
    let streams = [
        (0, ns(settings().target_stale_ms), Fault::TargetStale),
        (1, ns(settings().input_stale_ms), Fault::InputStale),
        (2, ns(settings().state_late_ms), Fault::StateLate),
        (2, ns(settings().state_stale_ms), Fault::StateStale),
    ];
    for (n, most_ns, fault) in streams {
        for (age_ns, stale) in [(most_ns, false), (most_ns + 1, true)] {
            let active = always_as_old(&mut Bench::new(), n, age_ns, 20).active;
            assert_eq!(active.has(fault), stale, "{fault:?} at {age_ns} ns");
        }
    }
    let most_ns = ns(settings().operator_silent_ms);
    for (age_ns, mode) in [(most_ns, Mode::Engaging), (most_ns + 1, Mode::Disengaged)] {
        let mut bench = Bench::new();
        always_as_old(&mut bench, 3, age_ns, ticks(200) + 1);
        bench.press();
        assert_eq!(always_as_old(&mut bench, 3, age_ns, 1).mode, mode, "a heartbeat {age_ns} ns ago");
    }
}

/// A tick that is late by its whole length is charged in full, and a longer sleep is not.
#[test]
fn own_gap_is_charged_up_to_two_ticks() {
    for (gap_ns, most) in [(666_667, 16), (1_333_333, 9), (50_000_000, 9)] {
        let mut bench = Bench::engaged();
        bench.alive.target = false;
        let took = (1..100).find(|_| {
            bench.input.own_gap_ns = gap_ns;
            bench.step().mode == Mode::Holding
        });
        assert!(took.is_some_and(|took| took >= most - 2 && took <= most + 1), "{gap_ns}: {took:?}");
    }
}

/// A lesser tracking error is tolerated for exactly the configured time, and not a tick longer.
#[test]
fn tracking_error_is_tolerated_exactly_for_its_time() {
    let mut bench = Bench::engaged();
    bench.input.robot.tracking_error_rad = 0.1;
    let most = settings().tracking_error_ms as u64;
    for n in 1..=most + 1 {
        assert_eq!(step_of_1_ms(&mut bench).active.has(Fault::TrackingError), n > most, "after {n} ms");
    }
}

/// Each writer has an identity of its own. A client that has left does not count as a new one.
#[test]
fn change_of_each_writer_gives_its_own_fault() {
    type Change = fn(&mut Bench);
    let changes: [(Change, Option<Fault>); 5] = [
        (|_| (), None),
        (|bench| bench.input.target.incarnation += 1, Some(Fault::WriterRestarted)),
        (|bench| bench.input.robot.incarnation += 1, Some(Fault::WriterRestarted)),
        (|bench| bench.input.target.session_nonce += 1, Some(Fault::PersonChanged)),
        (|bench| bench.input.target.session_nonce = 0, None),
    ];
    for (n, (change, fault)) in changes.into_iter().enumerate() {
        let mut bench = Bench::engaged();
        change(&mut bench);
        assert_eq!(bench.step().active.iter().next(), fault, "change {n}");
        assert!(bench.step().active.is_empty(), "known from the next tick on");
    }
}

/// Steps by one millisecond, given as the gap of this process.
fn step_of_1_ms(bench: &mut Bench) -> Output {
    bench.input.own_gap_ns = 1_000_000;
    bench.input.robot.sample_ns = 1_000_000;
    bench.step()
}

/// A recovery that stands still finds no way after half a second, and not a millisecond sooner.
#[test]
fn recovery_at_standstill_is_blocked_after_exactly_500_ms() {
    let mut bench = Bench::recovering();
    bench.input.motion.at_rest = true;
    for n in 1..=501 {
        let mode = if n <= 500 { Mode::Recovering } else { Mode::Disengaged };
        assert_eq!(step_of_1_ms(&mut bench).mode, mode, "after {n} ms");
    }
}

/// After a jump the robot catches up at full speed for exactly the configured time.
#[test]
fn f034_jumped_target_slows_after_exactly_its_time() {
    let mut bench = Bench::engaged();
    bench.input.target.jumped = true;
    let most = settings().target_jump_slow_ms as u64;
    for n in 1..=most + 1 {
        let slow = step_of_1_ms(&mut bench).permit.speed_scale() < 1.0;
        assert_eq!(slow, n > most, "after {n} ms");
        (bench.input.target.jumped, bench.input.motion.behind) = (false, true);
    }
}

/// Jumps are tolerated for exactly the configured time from the first one on, also just after the process has started.
#[test]
fn f034_jumps_are_tolerated_exactly_for_their_time() {
    let debounce = u64::from(FAULTS[Fault::InputImplausible.index()].debounce_ticks);
    let most = settings().target_jump_hold_ms as u64 + debounce - 1;
    for young_ms in [0, 50] {
        let mut bench = Bench::new();
        for _ in 0..young_ms {
            step_of_1_ms(&mut bench);
        }
        bench.input.target.jumped = true;
        for n in 1..=most + 1 {
            let implausible = step_of_1_ms(&mut bench).active.has(Fault::InputImplausible);
            assert_eq!(implausible, n > most, "after {n} ms, born {young_ms} ms before");
        }
    }
}

/// A speed that returns to full within the tick is no longer reduced.
#[test]
fn full_speed_clears_the_reduced_reason() {
    let mut bench = Bench::engaged();
    let late_ns = (settings().input_late_ms * 1e6) as u64 + 1000;
    // No message arrives for 50 ms, so that the next one is both new and old.
    bench.alive.input = false;
    bench.steps(75);
    // 1 us of 50 ms removes a share of 2e-5, and 10 us of 500 ms restore it, to the bit.
    let out = always_as_old(&mut bench, 1, late_ns, 1);
    assert_eq!((out.permit, out.reduced), (Permit::Follow { speed_scale: 0.99998 }, reduced_flag::INPUT_LATE));
    bench.alive.input = true;
    bench.input.own_gap_ns = 10_000;
    let out = bench.step();
    assert_eq!((out.permit, out.reduced), (Permit::Follow { speed_scale: 1.0 }, 0));
}

/// If speed falls again while it returns, the reason stays the same.
#[test]
fn reduced_reason_stays_when_speed_falls_again() {
    let mut bench = Bench::engaged();
    bench.alive.input = false;
    bench.steps(100);
    let late_ns = (settings().input_late_ms * 1e6) as u64 + 1000;
    let out = always_as_old(&mut bench, 1, late_ns, 1);
    assert!(out.permit.speed_scale() < 0.9, "it rises slowly");
    assert_eq!(out.reduced, reduced_flag::INPUT_LATE);
}
