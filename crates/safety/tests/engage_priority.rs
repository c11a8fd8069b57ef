//! Tests every state with every combination of edges, levels and faults. A stop wins, and only transitions of
//! the diagram occur.

use crate::support::{Bench, ticks};
use messages::{Fault, Faults, Mode, Response};
use safety::engage::{Output, Permit, SPEED_SCALE_FIRST};

const BITS: u32 = 19;

/// The input to which the operator's edge and level (bits 12 and 15) belong.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Hand {
    Enable,
    Recovery,
}

/// Applies one event for each bit. The debounced ones were prepared up to the tick before they act.
fn apply(bench: &mut Bench, hand: Hand, set: u32) {
    let has = |bit: u32| set & 1 << bit != 0;
    let input = &mut bench.input;
    input.operator.estop_edge = has(0);
    input.robot.tracking_error_rad = if has(1) { 0.2 } else { 0.0 };
    input.deadlines_missed = if has(2) { 10 } else { 0 };
    input.robot.driver_fault = has(3);
    input.motion.gate_denied = has(4);
    input.target.input_fresh = !has(5);
    input.robot.collision_near = has(6);
    input.target.implausible = has(7);
    input.operator.connected = !has(8);
    input.robot.incarnation += u32::from(has(9));
    input.realtime_ok = !has(10);
    input.robot.outside_limits = has(11);
    input.robot.clear_to_start = hand == Hand::Recovery && has(17) && !has(11);
    (input.operator.enable_edge, input.operator.enable_level) = (false, false);
    (input.operator.recover_edge, input.operator.recover_level) = (false, false);
    let operator = &mut input.operator;
    let (edge, level) = match hand {
        Hand::Enable => (&mut operator.enable_edge, &mut operator.enable_level),
        Hand::Recovery => (&mut operator.recover_edge, &mut operator.recover_level),
    };
    (*edge, *level) = (has(12), has(15));
    input.operator.release_edge = has(13);
    input.operator.reset_edge = has(14);
    input.motion.at_rest = has(16);
    input.motion.aligned = has(17);
    input.motion.settled = has(18);
}

/// Brings the debounced faults to the tick before they act.
fn prepared(mut bench: Bench) -> Bench {
    let at_rest = bench.input.motion.at_rest;
    if bench.state.mode() == Mode::Holding {
        bench.input.motion.at_rest = false;
    }
    bench.input.robot.collision_near = true;
    for n in 0..Fault::CollisionNear.row().debounce_ticks - 1 {
        let late = n >= Fault::CollisionNear.row().debounce_ticks - 3;
        bench.input.motion.gate_denied = late;
        bench.input.target.implausible = late;
        bench.step();
    }
    bench.input.motion.at_rest = at_rest;
    bench
}

/// The faults that end a recovery.
fn monitored(out: &Output) -> Faults {
    let borne = [
        Fault::StartOutsideLimits,
        Fault::StartInCollision,
        Fault::CollisionNear,
        Fault::NoTarget,
        Fault::InputStale,
        Fault::InputImplausible,
        Fault::TargetStale,
    ];
    out.active.iter().filter(|fault| !borne.contains(fault)).fold(Faults::NONE, Faults::with)
}

fn legal(hand: Hand, set: u32, from: Mode, out: &Output, pending: bool) -> bool {
    let has = |bit: u32| set & 1 << bit != 0;
    let (level, at_rest) = (has(15), has(16));
    let stop = !out.active.with_response(Response::Stop).is_empty();
    match (from, out.mode) {
        (from, to) if from == to => true,
        (_, Mode::Faulted) => stop,
        (Mode::Disengaged, Mode::Engaging) => {
            hand == Hand::Enable && has(12) && level && !has(13) && at_rest && out.active.is_empty()
        }
        (Mode::Engaging, Mode::Engaged) => has(17) || has(18),
        (Mode::Engaging | Mode::Engaged, Mode::Holding) => {
            has(13)
                || !level
                || hand == Hand::Recovery
                || !out
                    .active
                    .with_response(Response::Hold)
                    .union(out.active.with_response(Response::Release))
                    .is_empty()
        }
        (Mode::Disengaged, Mode::Recovering) => {
            let asked = hand == Hand::Recovery && has(12) && level && !has(13);
            asked && at_rest && out.active.has(Fault::StartOutsideLimits) && monitored(out).is_empty()
        }
        (Mode::Recovering, Mode::Holding) => {
            let faults = monitored(out);
            let withdrawn = faults.with_response(Response::Hold).union(faults.with_response(Response::Release));
            has(13) || !level || hand == Hand::Enable || !withdrawn.is_empty()
        }
        (Mode::Recovering, Mode::Disengaged) => at_rest && has(17) && !has(11),
        (Mode::Holding, Mode::Disengaged) => at_rest,
        (Mode::Holding, Mode::Engaging | Mode::Engaged) => {
            hand == Hand::Enable && at_rest && level && !has(13) && out.active.is_empty()
        }
        (Mode::Faulted, Mode::Disengaged) => (has(14) || pending) && at_rest && !level && !stop,
        _ => false,
    }
}

#[test]
fn f071_stop_wins_in_every_combination_of_events() {
    let mut blocked = Bench::engaging();
    blocked.steps(ticks(3000));
    let mut at_rest = Bench::holding(true);
    at_rest.input.motion.at_rest = true;
    let mut near_at_rest = Bench::holding_near();
    near_at_rest.input.motion.at_rest = true;
    let mut reset_passed_on = Bench::faulted();
    reset_passed_on.input.motion.at_rest = true;
    reset_passed_on.input.operator.enable_level = false;
    reset_passed_on.input.robot.driver_fault = true;
    reset_passed_on.input.operator.reset_edge = true;
    let states = [
        (Bench::disengaged(false), false),
        (Bench::disengaged(true), false),
        (Bench::engaging(), false),
        (blocked, false),
        (Bench::engaged(), false),
        (Bench::holding(true), false),
        (at_rest, false),
        (near_at_rest, false),
        (Bench::holding(false), false),
        (Bench::faulted(), false),
        (reset_passed_on, true),
        (Bench::outside(), false),
        (Bench::recovering(), false),
    ];
    let mut seen = [[0_u64; Mode::ALL.len()]; Mode::ALL.len()];
    for ((bench, pending), hand) in states.iter().flat_map(|state| [(state, Hand::Enable), (state, Hand::Recovery)]) {
        let bench = prepared(bench.clone());
        let from = bench.state.mode();
        for set in 0..1 << BITS {
            let mut bench = bench.clone();
            apply(&mut bench, hand, set);
            let out = bench.step();
            seen[from as usize][out.mode as usize] += 1;
            let context = || format!("{from:?} {hand:?} {set:019b} {out:?}");
            let wanted_stop = set & 0b1_1111 != 0;
            assert_eq!(wanted_stop, !out.active.with_response(Response::Stop).is_empty(), "{}", context());
            if wanted_stop {
                assert!(out.mode == Mode::Faulted && out.permit == Permit::Stop, "{}", context());
                assert!(from == Mode::Faulted || set & 1 == 0 || bench.state.cause() == Some(Fault::EmergencyStop));
            }
            if out.permit == Permit::Recover {
                let held = bench.input.operator.recover_level && set & (1 << 13 | 1 << 8) == 0;
                assert!(out.mode == Mode::Recovering && held && !bench.input.operator.enable_level, "{}", context());
                let calm = [Response::Hold, Response::Release]
                    .into_iter()
                    .all(|r| monitored(&out).with_response(r).is_empty());
                assert!(calm, "{}", context());
            } else if out.permit != Permit::Stop {
                assert!(matches!(out.mode, Mode::Engaging | Mode::Engaged), "{}", context());
                assert!(bench.input.operator.enable_level && set & (1 << 13 | 1 << 8) == 0, "{}", context());
                let calm =
                    [Response::Hold, Response::Release].into_iter().all(|r| out.active.with_response(r).is_empty());
                assert!(calm, "{}", context());
            }
            assert!(legal(hand, set, from, &out, *pending), "{}", context());
            assert_eq!(out.transition.is_some(), from != out.mode, "{}", context());
        }
    }
    println!("from (row) to (column): {seen:?}");
    let engaged_to_engaging = seen[Mode::Engaged as usize][Mode::Engaging as usize];
    assert!(seen[Mode::Disengaged as usize][Mode::Engaging as usize] > 0 && engaged_to_engaging == 0);
    assert!(seen[Mode::Disengaged as usize][Mode::Recovering as usize] > 0);
    assert_eq!(seen[Mode::Recovering as usize][Mode::Engaging as usize], 0);
}

/// After the slow second an engaging robot goes on as fast as it was, but not after 2 s or another cause.
#[test]
fn short_gap_does_not_begin_the_engaging_again() {
    let scale = |out: Output| match out.permit {
        Permit::Follow { speed_scale } => speed_scale,
        other => panic!("{other:?}"),
    };
    for (engaging_ms, gap_ms, near, kept) in [
        (900, 100, false, false),
        (2000, 100, false, true),
        (2000, 1900, false, true),
        (2000, 2100, false, false),
        (2000, 100, true, false),
    ] {
        let context = format!("{engaging_ms} ms, gap of {gap_ms} ms, near {near}");
        let mut bench = Bench::engaging();
        let before = scale(bench.steps(ticks(engaging_ms)));
        bench.input.target.input_fresh = false;
        bench.until(Mode::Holding, 10);
        bench.input.robot.collision_near = near;
        bench.steps(ticks(gap_ms));
        bench.input.robot.collision_near = false;
        (bench.input.target.input_fresh, bench.input.motion.at_rest) = (true, true);
        let out = bench.steps(2);
        assert_eq!(out.mode, Mode::Engaging, "{context}");
        let after = scale(out);
        if kept {
            assert!(before > 0.3 && (after - before).abs() < 0.01, "{context}: {before} then {after}");
        } else {
            assert_eq!(after, SPEED_SCALE_FIRST, "{context}");
        }
    }
}
