//! In every state, for every combination of edges, levels and faults: stop wins, and nothing but the diagram happens.

mod support;

use messages::{Fault, Mode, Response};
use safety::engage::{Output, Permit};
use support::{Bench, ticks};

const BITS: u32 = 19;

/// One bit, one event. The debounced ones were prepared up to the tick before they act.
fn apply(bench: &mut Bench, set: u32) {
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
    input.operator.enable_edge = has(12);
    input.operator.release_edge = has(13);
    input.operator.reset_edge = has(14);
    input.operator.enable_level = has(15);
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

fn legal(set: u32, from: Mode, out: &Output, pending: bool) -> bool {
    let has = |bit: u32| set & 1 << bit != 0;
    let (level, at_rest) = (has(15), has(16));
    let stop = !out.active.of(Response::Stop).is_empty();
    match (from, out.mode) {
        (from, to) if from == to => true,
        (_, Mode::Faulted) => stop,
        (Mode::Disengaged, Mode::Engaging) => has(12) && level && !has(13) && at_rest && out.active.is_empty(),
        (Mode::Engaging, Mode::Engaged) => has(17) || has(18),
        (Mode::Engaging | Mode::Engaged, Mode::Holding) => {
            has(13) || !level || !out.active.of(Response::Hold).union(out.active.of(Response::Release)).is_empty()
        }
        (Mode::Holding, Mode::Disengaged) => at_rest,
        (Mode::Holding, Mode::Engaging) => at_rest && level && !has(13) && out.active.is_empty(),
        (Mode::Faulted, Mode::Disengaged) => (has(14) || pending) && at_rest && !level && !stop,
        _ => false,
    }
}

#[test]
fn a_stop_beats_everything_in_every_combination() {
    let mut blocked = Bench::engaging();
    blocked.steps(ticks(3000));
    let mut at_rest = Bench::holding(true);
    at_rest.input.motion.at_rest = true;
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
        (Bench::holding(false), false),
        (Bench::faulted(), false),
        (reset_passed_on, true),
    ];
    let mut seen = [[0_u64; 5]; 5];
    for (bench, pending) in states {
        let bench = prepared(bench);
        let from = bench.state.mode();
        for set in 0..1 << BITS {
            let mut bench = bench.clone();
            apply(&mut bench, set);
            let out = bench.step();
            seen[from as usize][out.mode as usize] += 1;
            let context = || format!("{from:?} {set:019b} {out:?}");
            let wanted_stop = set & 0b1_1111 != 0;
            assert_eq!(wanted_stop, !out.active.of(Response::Stop).is_empty(), "{}", context());
            if wanted_stop {
                assert!(out.mode == Mode::Faulted && out.permit == Permit::Stop, "{}", context());
                assert!(from == Mode::Faulted || set & 1 == 0 || bench.state.cause() == Some(Fault::EmergencyStop));
            }
            if out.permit != Permit::Stop {
                assert!(matches!(out.mode, Mode::Engaging | Mode::Engaged), "{}", context());
                assert!(bench.input.operator.enable_level && set & (1 << 13 | 1 << 8) == 0, "{}", context());
                let calm = [Response::Hold, Response::Release].into_iter().all(|r| out.active.of(r).is_empty());
                assert!(calm, "{}", context());
            }
            assert!(legal(set, from, &out, pending), "{}", context());
            assert_eq!(out.transition.is_some(), from != out.mode, "{}", context());
        }
    }
    println!("from (row) to (column): {seen:?}");
    let engaged_to_engaging = seen[Mode::Engaged as usize][Mode::Engaging as usize];
    assert!(seen[Mode::Disengaged as usize][Mode::Engaging as usize] > 0 && engaged_to_engaging == 0);
}
