//! Tests reduced speed: problems that need not stop the robot make it slow, and nothing else does.

use crate::support::{Bench, settings, ticks};
use messages::{Fault, Mode, reduced_flag};
use proptest::prelude::*;
use safety::engage::{Output, Permit, SLOW};

const TICK_NS: u64 = 666_667;

fn scale(out: &Output) -> f64 {
    out.permit.speed_scale()
}

#[test]
fn f020_f021_late_skeleton_slows_to_zero_and_then_holds() {
    let mut bench = Bench::engaged();
    assert_eq!(bench.step().permit, Permit::Follow { speed_scale: 1.0 });
    bench.alive.input = false;
    let mut before = 1.0;
    for n in 1.. {
        let out = bench.step();
        let age_ms = (n * TICK_NS) as f64 * 1e-6;
        if out.mode == Mode::Holding {
            assert!((150..=151).contains(&n), "held after {n} ticks");
            assert_eq!((out.permit, out.reduced), (Permit::Stop, 0));
            break;
        }
        let expected = ((100.0 - age_ms) / 50.0).clamp(0.0, 1.0);
        assert!((scale(&out) - expected).abs() < 1e-4 && scale(&out) <= before, "{age_ms} ms: {}", scale(&out));
        let why = if age_ms > 50.0 { reduced_flag::INPUT_LATE } else { 0 };
        assert_eq!(out.reduced, why, "{age_ms} ms");
        before = scale(&out);
    }
    assert!(before < 0.02, "{before}");
}

#[test]
fn f020_speed_rises_slowly_after_late_skeleton_returns() {
    let mut bench = Bench::engaged();
    bench.alive.input = false;
    bench.steps(112);
    let low = scale(&bench.step());
    assert!((0.45..0.55).contains(&low), "{low}");
    bench.alive.input = true;
    let mut before = low;
    let mut taken = 0;
    while before < 1.0 {
        let out = bench.step();
        assert_eq!(
            (out.mode, out.reduced),
            (Mode::Engaged, if scale(&out) < 1.0 { reduced_flag::INPUT_LATE } else { 0 })
        );
        // The speed rises from zero to full in half a second.
        assert!(scale(&out) > before && scale(&out) - before < 1.0 / 749.0, "{before} {}", scale(&out));
        before = scale(&out);
        taken += 1;
    }
    assert!((360..420).contains(&taken), "{taken}");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    /// Cameras of 30 Hz and more whose frames are up to 16 ms late never slow the robot.
    #[test]
    fn f020_camera_jitter_up_to_16_ms_never_slows(rate_hz in 30.0..240.0_f64, late_ms in proptest::collection::vec(0.0..16.0_f64, 40)) {
        let mut bench = Bench::engaged();
        bench.alive.input = false;
        let start = bench.now();
        for n in 0..1500_u64 {
            let since_ms = n as f64 * TICK_NS as f64 * 1e-6;
            let arrived = late_ms.iter().enumerate().map(|(frame, late)| frame as f64 * 1e3 / rate_hz + late);
            let newest = arrived.filter(|at| *at <= since_ms).fold(0.0, f64::max);
            if newest + 49.0 < since_ms {
                break;
            }
            bench.input.target.input_received = start.plus_ns((newest * 1e6) as u64);
            let out = bench.step();
            prop_assert_eq!((out.permit, out.reduced), (Permit::Follow { speed_scale: 1.0 }, 0));
        }
    }

    /// For every sequence of inputs the scale stays within [0, 1], falls as required, and rises at its fixed rate.
    #[test]
    fn f020_f034_f035_f078_speed_scale_rises_at_its_rate_at_most(
        weather in proptest::collection::vec((any::<bool>(), any::<bool>(), any::<bool>(), any::<bool>(), 0_u32..5, 1_u64..90), 40),
    ) {
        let mut bench = Bench::engaged();
        let mut before = 1.0;
        for (target, input, jumped, behind, missed, length) in weather {
            (bench.alive.target, bench.alive.input) = (target, input);
            for n in 0..length {
                bench.input.target.jumped = jumped && n == 0;
                bench.input.motion.behind = behind;
                bench.input.deadlines_missed = if n == 0 { missed } else { 0 };
                bench.input.motion.at_rest = true;
                let out = bench.step();
                if out.mode != Mode::Engaged {
                    prop_assert!(scale(&out) <= 0.05 + 1.0 / 749.0 || out.mode == Mode::Engaging);
                    before = 1.0;
                    continue;
                }
                prop_assert!((0.0..=1.0).contains(&scale(&out)) && scale(&out) - before < 1.0 / 374.0);
                prop_assert_eq!(out.reduced == 0, scale(&out) == 1.0);
                before = scale(&out);
            }
        }
    }
}

#[test]
fn f035_late_target_slows_from_third_tick_and_holds_at_10_ms() {
    let mut bench = Bench::engaged();
    bench.alive.target = false;
    let mut before = 1.0;
    for n in 1..=16 {
        let out = bench.step();
        if n <= 2 {
            assert_eq!((scale(&out), out.reduced), (1.0, 0), "tick {n}");
        } else if out.mode == Mode::Engaged {
            assert!(scale(&out) < before && out.reduced == reduced_flag::TARGET_LATE, "tick {n}");
        }
        before = scale(&out);
        assert_eq!(out.mode, if n < 15 { Mode::Engaged } else { Mode::Holding }, "tick {n}");
    }
}

#[test]
fn f034_jumped_target_that_stays_far_is_followed_slowly() {
    let mut bench = Bench::engaged();
    // A person may be faster than the robot, and the robot may be behind for any time.
    bench.input.motion.behind = true;
    assert_eq!(scale(&bench.steps(ticks(3000))), 1.0);
    bench.input.target.jumped = true;
    bench.input.motion.behind = false;
    assert_eq!(scale(&bench.step()), 1.0);
    bench.input.target.jumped = false;
    bench.input.motion.behind = true;
    let slow_after = (2..=1000).find(|_| scale(&bench.step()) < 1.0);
    assert!(slow_after.is_some_and(|n| (375..=377).contains(&n)), "{slow_after:?}");
    let slow = (Permit::Follow { speed_scale: SLOW }, reduced_flag::TARGET_JUMPED);
    let out = bench.steps(ticks(700));
    assert_eq!((out.permit, out.reduced), slow);
    // A second after the jump, the motion is the person's. The robot may never catch up with it.
    let out = bench.steps(ticks(600));
    assert!(scale(&out) > SLOW, "{:?}", out.permit);
    assert_eq!(scale(&bench.steps(ticks(500))), 1.0, "still behind, without a jump");
    // Another jump slows the robot again, until it has caught up.
    bench.input.target.jumped = true;
    bench.step();
    bench.input.target.jumped = false;
    let out = bench.steps(ticks(500));
    assert_eq!((out.permit, out.reduced), slow);
    bench.input.motion.behind = false;
    let out = bench.step();
    assert!(scale(&out) > SLOW && out.reduced != 0);
    assert_eq!(scale(&bench.steps(ticks(500))), 1.0, "caught up");
    // If the robot catches up with a jump in time, nothing slows it.
    bench.input.target.jumped = true;
    bench.step();
    bench.input.target.jumped = false;
    assert_eq!(scale(&bench.steps(ticks(1000))), 1.0);
}

#[test]
fn f034_target_that_keeps_jumping_holds_after_a_second() {
    let mut bench = Bench::engaged();
    bench.input.motion.behind = true;
    for n in 1_u64.. {
        bench.input.target.jumped = n % 100 == 1;
        let out = bench.step();
        if out.mode == Mode::Holding {
            assert!((1500..=1504).contains(&n), "{n}");
            assert!(out.active.has(Fault::InputImplausible));
            break;
        }
        assert!(n < 2000, "never held");
    }
    // Jumps every 150 ms are not one stream of jumps.
    let mut bench = Bench::engaged();
    for n in 1_u64..6000 {
        bench.input.target.jumped = n % 225 == 1;
        assert_eq!(bench.step().mode, Mode::Engaged, "tick {n}");
    }
}

#[test]
fn f078_missed_deadlines_slow_then_hold_then_stop() {
    let missed = |bench: &mut Bench, count: u32| {
        bench.input.deadlines_missed = count;
        bench.input.k += u64::from(count);
        let out = bench.step();
        bench.input.deadlines_missed = 0;
        out
    };
    let mut bench = Bench::engaged();
    for _ in 0..2 {
        let out = missed(&mut bench, 1);
        assert_eq!((out.mode, scale(&out)), (Mode::Engaged, 1.0), "one is counted");
        assert_eq!(scale(&missed(&mut bench, 2)), 1.0, "two too");
        bench.steps(ticks(1200));
    }
    let out = missed(&mut bench, 3);
    assert_eq!((scale(&out), out.reduced), (SLOW, reduced_flag::DEADLINES_LATE), "three in a row are slow");
    assert_eq!(scale(&bench.steps(ticks(990))), SLOW, "for a second");
    assert_eq!(scale(&bench.steps(ticks(600))), 1.0);
    // Nine late ticks within a second are tolerated, ten are not.
    for (count, mode) in [(9, Mode::Engaged), (10, Mode::Holding)] {
        let mut bench = Bench::engaged();
        for _ in 1..count {
            missed(&mut bench, 1);
            bench.steps(140);
        }
        let out = missed(&mut bench, 1);
        assert_eq!((out.mode, out.active.has(Fault::DeadlinesLate)), (mode, mode == Mode::Holding), "{count}");
    }
    // Ten late ticks within a second and a half never count together.
    let mut bench = Bench::engaged();
    for _ in 0..40 {
        assert_eq!(missed(&mut bench, 1).mode, Mode::Engaged);
        bench.steps(224);
    }
    assert_eq!(missed(&mut bench, settings().deadlines_missed_max - 1).mode, Mode::Engaged);
    let mut bench = Bench::engaged();
    assert_eq!(missed(&mut bench, settings().deadlines_missed_max).mode, Mode::Faulted, "6.7 ms");
    assert_eq!(bench.state.cause(), Some(Fault::DeadlineMissed));
}

#[test]
fn f031_suspension_of_one_second_stops_at_next_tick() {
    let mut bench = Bench::engaged();
    bench.input.k += 1500;
    (bench.input.own_gap_ns, bench.input.deadlines_missed) = (1_000_666_667, 1500);
    let out = bench.step();
    assert_eq!((out.mode, out.permit, bench.state.cause()), (Mode::Faulted, Permit::Stop, Some(Fault::DeadlineMissed)));
}

#[test]
fn f035_robot_slowed_by_late_input_does_not_count_as_settled() {
    let mut bench = Bench::engaging();
    bench.steps(ticks(3000));
    bench.input.motion.settled = true;
    for n in 0..ticks(3000) {
        // A skeleton arrives every 90 ms, so the scale never returns to one.
        bench.alive.input = n % 135 == 0;
        assert_eq!(bench.step().mode, Mode::Engaging, "tick {n}");
    }
    bench.alive.input = true;
    assert!(bench.until(Mode::Engaged, ticks(1100)) > ticks(500));
}

#[test]
fn f060_f062_robot_stop_is_one_event_and_blocks_reset() {
    let mut bench = Bench::engaged();
    // The contact chatters, and the operator sends every request while the robot still moves.
    for n in 0..ticks(300) {
        bench.input.robot.emergency_stop = n % 3 != 1;
        bench.input.operator.reset_edge = n % 2 == 0;
        if n % 5 == 0 {
            bench.press();
        }
        let out = bench.step();
        assert_eq!((out.mode, out.permit), (Mode::Faulted, Permit::Stop), "tick {n}");
        assert_eq!(out.transition.is_some(), n == 0, "one event");
    }
    assert_eq!(bench.state.cause(), Some(Fault::EmergencyStop));
    bench.input.robot.emergency_stop = true;
    bench.input.operator.enable_level = false;
    bench.input.motion.at_rest = true;
    bench.input.operator.reset_edge = true;
    assert_eq!(bench.step().mode, Mode::Faulted, "still pressed");
    bench.input.robot.emergency_stop = false;
    assert_eq!(bench.steps(ticks(500)).mode, Mode::Faulted, "its release resets nothing");
    bench.input.operator.reset_edge = true;
    assert_eq!(bench.step().mode, Mode::Disengaged);
    assert_eq!(bench.steps(ticks(500)).mode, Mode::Disengaged, "and a reset engages nothing");
}

#[test]
fn f067_released_enable_stops_in_same_tick() {
    for level_alone in [false, true] {
        for mut bench in [Bench::engaging(), Bench::engaged()] {
            bench.let_go();
            bench.input.operator.release_edge &= !level_alone;
            let out = bench.step();
            assert_eq!((out.mode, out.permit), (Mode::Holding, Permit::Stop));
            bench.input.operator.enable_level = true;
            bench.input.motion.at_rest = true;
            assert_eq!(bench.step().mode, Mode::Disengaged, "a level engages nothing");
        }
    }
}

#[test]
fn f072_held_reset_is_one_reset() {
    let mut bench = Bench::faulted();
    bench.input.motion.at_rest = true;
    bench.input.operator.enable_level = false;
    let mut resets = 0;
    for n in 0..ticks(1000) {
        // The socket counts presses. One press is one edge, however long it lasts.
        bench.input.operator.reset_edge = n == 0;
        let out = bench.step();
        resets += u32::from(out.transition.is_some());
        assert_eq!((out.mode, out.reset_count), (Mode::Disengaged, 42));
    }
    assert_eq!(resets, 1);
}
