//! Tests engagement over time: what must never happen, and when required actions happen.

use crate::support::{Bench, settings, ticks};
use messages::{Fault, Mode, Transition};
use safety::engage::{Config, ConfigError, Permit, Settings, speed_scale};

#[test]
fn f066_enable_stuck_at_boot_never_engages() {
    let mut bench = Bench::new();
    for _ in 0..ticks(10_000) {
        // Edges without end come from a chattering contact on a handle that was never seen released.
        bench.press();
        assert_eq!(bench.step().mode, Mode::Disengaged);
    }
    bench.input.operator.enable_level = false;
    bench.steps(ticks(200) - 3);
    bench.press();
    assert!(bench.step().refused, "released for less than 200 ms");
    bench.input.operator.enable_level = false;
    bench.steps(ticks(200));
    bench.press();
    assert_eq!(bench.step().mode, Mode::Engaging);
}

#[test]
fn engaging_is_slow_for_first_second_and_ramp_is_smooth() {
    const NS_PER_TICK: u64 = 666_667;
    let mut before = 0.0;
    for n in 0..6000 {
        let scale = speed_scale(n * NS_PER_TICK);
        if n < 1500 {
            assert_eq!(scale, 0.05, "tick {n}");
        } else if n > 4500 {
            assert_eq!(scale, 1.0, "tick {n}");
        }
        // The steepest slope of 0.05 + 0.95 (3 s^2 - 2 s^3) is 0.95 * 1.5 a ramp of 3000 ticks.
        let step = scale - before;
        assert!(n == 0 || (0.0..=0.95 * 1.5 / 3000.0 + 1e-9).contains(&step), "tick {n}: {step}");
        before = scale;
    }
    // The state machine permits exactly this scale, however well the robot is aligned.
    let mut bench = Bench::engaging();
    bench.input.motion.aligned = true;
    for _ in 0..1498 {
        let out = bench.step();
        assert_eq!((out.mode, out.permit), (Mode::Engaging, Permit::Follow { speed_scale: 0.05 }));
    }
    assert!(bench.until(Mode::Engaged, 5) <= 3);
}

#[test]
fn blocked_robot_engages_after_settling_for_500_ms() {
    let mut bench = Bench::engaging();
    bench.input.motion.settled = true;
    let taken = bench.until(Mode::Engaged, ticks(4000));
    assert!((ticks(3500) - 2..=ticks(3500) + 2).contains(&taken), "{taken}");
    let mut bench = Bench::engaging();
    bench.steps(ticks(10_000));
    assert_eq!(bench.state.mode(), Mode::Engaging, "still moving, still not there");
}

/// Number of ticks from the last message of a stream to the mode.
fn silence(stream: fn(&mut Bench) -> &mut bool, mode: Mode) -> u64 {
    let mut bench = Bench::engaged();
    *stream(&mut bench) = false;
    bench.until(mode, ticks(1000))
}

#[test]
fn f021_f036_f051_silence_acts_exactly_at_its_timeout() {
    // The age exceeds n ms at the first tick that lies after it. The stamps differ by the rounding of a tick.
    let cases: [(&str, u64, u64); 5] = [
        ("target", 10, silence(|b| &mut b.alive.target, Mode::Holding)),
        ("state, held", 5, silence(|b| &mut b.alive.state, Mode::Holding)),
        ("state, stopped", 20, silence(|b| &mut b.alive.state, Mode::Faulted)),
        ("input", 100, silence(|b| &mut b.alive.input, Mode::Holding)),
        ("heartbeat", 200, silence(|b| &mut b.alive.heartbeat, Mode::Holding)),
    ];
    for (what, ms, taken) in cases {
        let exact = ms * 1500 / 1000;
        assert!((exact..=exact + 1).contains(&taken), "{what}: {taken} ticks for {ms} ms");
    }
}

#[test]
fn f055_tracking_error_stops_after_100_ms_or_at_once_if_huge() {
    type Set = fn(&mut Bench, f64);
    let rad: Set = |bench, x| bench.input.robot.tracking_error_rad = x;
    let m: Set = |bench, x| bench.input.robot.tracking_error_m = x;
    for (set, small, large, huge) in [(rad, 0.049, 0.051, 0.151), (m, 0.0099, 0.0101, 0.0301)] {
        let mut bench = Bench::engaged();
        set(&mut bench, small);
        assert_eq!(bench.steps(ticks(1000)).mode, Mode::Engaged);
        for _ in 0..3 {
            set(&mut bench, large);
            assert_eq!(bench.steps(140).mode, Mode::Engaged, "93 ms");
            set(&mut bench, small);
            assert_eq!(bench.steps(280).mode, Mode::Engaged, "and well again after twice the time");
        }
        set(&mut bench, large);
        let taken = bench.until(Mode::Faulted, ticks(200));
        assert!((150..=151).contains(&taken), "{taken}");
        assert_eq!(bench.state.cause(), Some(Fault::TrackingError));
        for now in [huge, f64::NAN, f64::INFINITY] {
            let mut bench = Bench::engaged();
            set(&mut bench, now);
            assert_eq!(bench.step().mode, Mode::Faulted, "{now}");
        }
    }
}

/// A joint that swings through its setpoint has a small error there, twice in each swing.
#[test]
fn f055_swinging_tracking_error_stops() {
    for hz in [0.5, 1.0, 2.0, 4.0, 6.0, 8.0, 12.0, 16.0, 20.0_f64] {
        // These are amplitudes from the one on at which the error is large for a third of the time.
        for (amplitude, stops_ms) in [(0.145, Some(250)), (0.1, Some(300)), (0.065, Some(1200)), (0.055, None)] {
            // An error that is large for 100 ms at a time stops the robot, like any other that lasts.
            if stops_ms.is_none() && hz < 2.0 {
                continue;
            }
            for every in [1, 10] {
                let mut bench = Bench::engaged();
                let swung = |n: u64| (amplitude * (std::f64::consts::TAU * hz * n as f64 / 1500.0).sin()).abs();
                let taken = (0..15_000).find(|&n| {
                    // The driver sleeps for 10 ticks now and then. The last sample stays, and is not judged again.
                    bench.input.robot.sample_ns = if n % every == 0 { every * 666_667 } else { 0 };
                    bench.input.robot.tracking_error_rad = swung(n - n % every);
                    bench.step().mode == Mode::Faulted
                });
                // A slow swing takes a quarter of its period to become large.
                let most = stops_ms.map(|ms| ticks(ms + (1000.0 / hz / 4.0) as u64));
                assert_eq!(taken.is_some(), most.is_some(), "{amplitude} rad at {hz} Hz: {taken:?}");
                assert!(taken <= most, "{amplitude} rad at {hz} Hz: {taken:?} ticks, not {most:?}");
                assert!(taken.is_none() || bench.state.cause() == Some(Fault::TrackingError));
            }
        }
    }
}

/// The rest of a long tracking error does not prevent a reset.
#[test]
fn tracking_error_clears_within_41_ms_once_small() {
    let mut bench = Bench::engaged();
    bench.input.robot.tracking_error_rad = 0.1;
    bench.steps(ticks(10_000));
    assert_eq!(bench.state.mode(), Mode::Faulted);
    bench.input.robot.tracking_error_rad = 0.0;
    assert!(!bench.steps(ticks(41)).active.has(Fault::TrackingError));
}

/// The command rests, but the arms swing. Then nothing begins, and nothing ends.
#[test]
fn f055_swinging_robot_is_not_at_rest() {
    let swings = |mut bench: Bench| {
        bench.input.motion.at_rest = true;
        bench.input.robot.at_rest = false;
        bench
    };
    let mut bench = swings(Bench::disengaged(true));
    bench.press();
    assert!(bench.step().refused, "no enable");
    bench.input.operator.enable_level = false;
    bench.input.robot.outside_limits = true;
    bench.press_recovery();
    assert!(bench.step().refused, "no recovery");
    for resumable in [true, false] {
        let mut bench = swings(Bench::holding(resumable));
        assert_eq!(bench.steps(ticks(1000)).mode, Mode::Holding, "no end of the hold, and no motion out of it");
        bench.input.robot.at_rest = true;
        assert_ne!(bench.step().mode, Mode::Holding);
    }
    let mut bench = swings(Bench::faulted());
    bench.let_go();
    bench.step();
    bench.input.operator.reset_edge = true;
    let out = bench.step();
    assert_eq!((out.mode, out.at_rest), (Mode::Faulted, false), "no reset");
    bench.input.robot.at_rest = true;
    bench.input.operator.reset_edge = true;
    let out = bench.step();
    assert_eq!((out.mode, out.at_rest), (Mode::Disengaged, true));
    let mut bench = swings(Bench::recovering());
    bench.input.robot.clear_to_start = true;
    assert_eq!(bench.steps(ticks(1000)).mode, Mode::Recovering, "no end of a recovery");
    bench.input.robot.at_rest = true;
    assert_eq!(bench.step().mode, Mode::Disengaged);
}

/// The cause of the hold says nothing against the person. So the robot goes on from where it rests.
#[test]
fn gap_of_two_seconds_at_most_resumes_at_once() {
    let gaps: [fn(&mut Bench, bool); 3] = [
        |bench, there| bench.input.target.input_fresh = there,
        |bench, there| bench.alive.target = there,
        |bench, there| bench.alive.state = there,
    ];
    for (n, gap) in gaps.into_iter().enumerate() {
        // A longer silence of the robot is a fault.
        for (ms, mode) in [(11, Mode::Engaged), (1900, Mode::Engaged), (2100, Mode::Engaging)] {
            if n == 2 && ms > 11 {
                continue;
            }
            let mut bench = Bench::engaged();
            gap(&mut bench, false);
            assert_eq!(bench.steps(ticks(ms)).mode, Mode::Holding, "{n}, {ms} ms");
            bench.input.motion.at_rest = true;
            gap(&mut bench, true);
            let out = bench.steps(2);
            assert_eq!(out.mode, mode, "{n}, {ms} ms");
        }
    }
    // Here something else was wrong meanwhile.
    let mut bench = Bench::holding(true);
    bench.input.robot.collision_near = true;
    bench.steps(100);
    (bench.input.robot.collision_near, bench.input.motion.at_rest) = (false, true);
    assert_eq!(bench.step().mode, Mode::Engaging);
}

#[test]
fn hold_resumes_slowly_or_ends_after_timeout() {
    let mut bench = Bench::holding_near();
    assert_eq!(bench.steps(100).mode, Mode::Holding, "still moving");
    bench.input.motion.at_rest = true;
    let out = bench.step();
    assert_eq!((out.mode, out.permit), (Mode::Engaging, Permit::Follow { speed_scale: 0.05 }));

    let mut bench = Bench::holding(true);
    bench.input.motion.at_rest = true;
    bench.input.target.input_fresh = false;
    let taken = bench.until(Mode::Disengaged, ticks(6000));
    assert!((ticks(5000) - 2..=ticks(5000) + 2).contains(&taken), "{taken}");
    bench.input.target.input_fresh = true;
    assert_eq!(bench.steps(ticks(1000)).mode, Mode::Disengaged, "the enable is still held, and means nothing");
    bench.press();
    assert_eq!(bench.step().mode, Mode::Engaging);
}

#[test]
fn release_while_holding_ends_hold_despite_new_enable() {
    let mut bench = Bench::holding(true);
    bench.let_go();
    bench.step();
    bench.press();
    bench.step();
    bench.input.motion.at_rest = true;
    assert_eq!(bench.step().mode, Mode::Disengaged);
}

#[test]
fn f061_emergency_stop_at_any_tick_of_engaging_latches() {
    let events: [fn(&mut Bench); 5] = [
        |_| {},
        |b| b.press(),
        |b| b.let_go(),
        |b| b.input.motion.aligned = true,
        |b| b.input.operator.reset_edge = true,
    ];
    let mut engaging = Bench::engaging();
    for n in 0..3000 {
        for event in events {
            let mut bench = engaging.clone();
            event(&mut bench);
            bench.input.operator.estop_edge = true;
            assert_eq!(bench.step().mode, Mode::Faulted, "tick {n}");
            bench.press();
            bench.input.motion.at_rest = true;
            assert_eq!(bench.step().mode, Mode::Faulted, "tick {n}");
        }
        assert_eq!(engaging.step().mode, Mode::Engaging);
    }
}

#[test]
fn f072_reset_needs_an_edge_at_rest_and_engages_nothing() {
    let mut bench = Bench::faulted();
    bench.input.operator.reset_edge = true;
    assert_eq!(bench.step().mode, Mode::Faulted, "moving, enable held");
    bench.input.motion.at_rest = true;
    bench.input.operator.reset_edge = true;
    assert_eq!(bench.step().mode, Mode::Faulted, "enable held");
    bench.input.operator.enable_level = false;
    assert_eq!(bench.step().mode, Mode::Faulted, "no edge");
    bench.input.operator.reset_edge = true;
    let out = bench.step();
    assert_eq!((out.mode, out.reset_count, out.latched.is_empty()), (Mode::Disengaged, 42, true));
    bench.input.operator.reset_edge = true;
    assert_eq!(bench.step().reset_count, 42, "there is nothing to reset any more");
    bench.input.operator.enable_level = true;
    assert_eq!(bench.steps(10).mode, Mode::Disengaged, "a level is no edge");
}

#[test]
fn driver_latch_is_reset_only_after_driver_clears_it() {
    let mut bench = Bench::engaged();
    bench.input.robot.driver_fault = true;
    assert_eq!(bench.step().mode, Mode::Faulted);
    bench.input.motion.at_rest = true;
    bench.input.operator.enable_level = false;
    bench.steps(10);
    bench.input.operator.reset_edge = true;
    let out = bench.step();
    assert_eq!((out.mode, out.reset_count), (Mode::Faulted, 42), "the driver has yet to hear of it");
    bench.steps(5);
    bench.input.robot.driver_fault = false;
    assert_eq!(bench.step().mode, Mode::Disengaged);

    // If the driver takes too long, another press is needed.
    let mut bench = Bench::faulted();
    bench.input.motion.at_rest = true;
    bench.input.operator.enable_level = false;
    bench.input.robot.driver_fault = true;
    bench.input.operator.reset_edge = true;
    bench.steps(ticks(100) + 2);
    bench.input.robot.driver_fault = false;
    assert_eq!(bench.steps(10).mode, Mode::Faulted);
}

#[test]
fn fault_is_counted_once_each_time_it_begins() {
    let mut bench = Bench::disengaged(true);
    let index = Fault::InputStale.index();
    for n in 1..=3 {
        bench.input.target.input_fresh = false;
        bench.steps(10);
        assert_eq!(bench.last.unwrap().fault_counts[index], n);
        bench.input.target.input_fresh = true;
        bench.steps(10);
    }
}

#[test]
fn recovery_runs_only_while_held_and_engages_nothing() {
    // A recovery begins from its reasons alone, whatever data of the person is missing, because it follows no target.
    let mut bench = Bench::outside();
    bench.alive.target = false;
    bench.input.target.input_fresh = false;
    bench.steps(ticks(200));
    bench.press();
    assert!(bench.step().refused, "nobody engages from there");
    bench.input.operator.enable_level = false;
    bench.press_recovery();
    let out = bench.step();
    assert_eq!((out.mode, out.permit), (Mode::Recovering, Permit::Recover));
    bench.input.motion.at_rest = false;
    assert_eq!(bench.steps(ticks(3000)).mode, Mode::Recovering);
    // The operator lets go. The robot stops and stays where it is.
    bench.let_go();
    let out = bench.step();
    assert_eq!((out.mode, out.permit), (Mode::Holding, Permit::Stop));
    bench.input.operator.recover_level = true;
    bench.input.motion.at_rest = true;
    assert_eq!(bench.step().mode, Mode::Disengaged, "a level alone resumes nothing");
    assert_eq!(bench.steps(10).mode, Mode::Disengaged);
    bench.input.operator.recover_level = false;
    bench.press_recovery();
    assert_eq!(bench.step().mode, Mode::Recovering);
    // The robot is back. Recovery ends by itself and reports it. Neither the held recovery nor an old enable engages.
    bench.input.robot.outside_limits = false;
    bench.input.robot.clear_to_start = true;
    bench.alive.target = true;
    bench.input.target.input_fresh = true;
    let out = bench.step();
    assert_eq!(out.transition.map(|t| (t.to, t.why)), Some((Mode::Disengaged as u32, Transition::RECOVERED)));
    bench.input.operator.enable_level = true;
    assert_eq!(bench.steps(ticks(1000)).mode, Mode::Disengaged);
}

#[test]
fn recovery_is_refused_without_its_reason_or_with_other_faults() {
    let refused = |prepare: fn(&mut Bench)| {
        let mut bench = Bench::outside();
        prepare(&mut bench);
        bench.press_recovery();
        let out = bench.step();
        assert!(out.mode != Mode::Recovering && out.permit == Permit::Stop, "{out:?}");
    };
    refused(|b| b.input.robot.outside_limits = false);
    refused(|b| b.input.realtime_ok = false);
    refused(|b| b.input.robot.config_matches = false);
    refused(|b| b.input.robot.commanded = false);
    refused(|b| b.input.motion.at_rest = false);
    refused(|b| b.input.operator.enable_level = true);
    refused(|b| b.input.robot.driver_fault = true);
    refused(|b| b.input.target.incarnation += 1);
    refused(|b| {
        b.alive.heartbeat = false;
        b.steps(ticks(250));
    });
    // A handle that has been stuck since the start does not count.
    let mut bench = Bench::new();
    bench.input.robot.outside_limits = true;
    for _ in 0..ticks(1000) {
        bench.press_recovery();
        assert_eq!(bench.step().mode, Mode::Disengaged);
    }
}

#[test]
fn thresholds_out_of_range_or_order_are_refused() {
    type Change = (&'static str, fn(&mut Settings));
    let changes: [Change; 11] = [
        ("target_stale_ms", |s| s.target_stale_ms = f64::NAN),
        ("state_stale_ms", |s| s.state_stale_ms = 1e9),
        ("input_stale_ms", |s| s.input_stale_ms = -1.0),
        ("operator_silent_ms", |s| s.operator_silent_ms = 0.0),
        ("enable_released_ms", |s| s.enable_released_ms = 0.0),
        ("tracking_error_now_rad", |s| s.tracking_error_now_rad = 3.0),
        ("deadlines_missed_max", |s| s.deadlines_missed_max = 0),
        ("hold_timeout_ms", |s| s.hold_timeout_ms = f64::INFINITY),
        ("stale_factor_without_realtime", |s| s.stale_factor_without_realtime = 0.5),
        ("stale_factor_without_realtime", |s| s.stale_factor_without_realtime = 51.0),
        ("stale_factor_without_realtime", |s| s.stale_factor_without_realtime = f64::NAN),
    ];
    for (key, change) in changes {
        let mut settings = settings();
        change(&mut settings);
        let error = Config::new(&settings).expect_err(key);
        assert!(matches!(error, ConfigError::OutOfRange { .. }) && error.to_string().contains(key), "{error}");
    }
    let swapped = Settings { state_late_ms: 20.0, state_stale_ms: 5.0, ..settings() };
    assert!(matches!(Config::new(&swapped), Err(ConfigError::Order { .. })));
}
