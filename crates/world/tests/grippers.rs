//! Grippers that follow the person's hands, with control and the simulated robot together.

use crate::support;

use messages::{GripperMotion, Mode, TICK_HZ, TICK_S, command_flag, target_flag};
use support::Bench;

/// Fingers of the shipped robot close at this rate at most, 1/s: 2.6 s (robot file).
const SPEED: f64 = 1.0 / 2.6;
/// Rounding of a closure.
const ROUNDING: f64 = 1e-6;

/// Sets what the person's hands do. The left one is `closure`, the right one is not known.
fn show(bench: &mut Bench, closure: Option<f32>) {
    bench.person.closure = [closure.unwrap_or_default(), 0.0];
    // The bench writes the flags of a target itself, so the closure goes beside them.
    bench.more_flags = if closure.is_some() { target_flag::CLOSURE[0] } else { 0 };
}

fn run(bench: &mut Bench, seconds: f64) -> GripperMotion {
    let mut before = bench.echo().grippers;
    for _ in 0..(seconds * TICK_HZ as f64) as u64 {
        bench.step();
        let now = bench.echo().grippers;
        for side in 0..2 {
            let moved = (now.closure[side] - before.closure[side]).abs();
            assert!(moved <= SPEED * TICK_S + ROUNDING, "a step of {moved}");
            assert!((now.rate[side] - before.rate[side]).abs() <= SPEED / 0.1 * TICK_S + ROUNDING);
        }
        before = now;
    }
    before
}

#[test]
fn f120_gripper_follows_hand_and_holds_without_it() {
    let mut bench = Bench::engaged(1);
    show(&mut bench, Some(0.0));
    run(&mut bench, 0.2);
    show(&mut bench, Some(0.6));
    let closed = run(&mut bench, 3.0);
    assert!((closed.closure[0] - 0.6).abs() < 0.01 && closed.closure[1] == 0.0, "{closed:?}");
    show(&mut bench, None);
    let held = run(&mut bench, 1.0);
    assert!((held.closure[0] - 0.6).abs() < 0.01 && held.rate[0].abs() < 1e-3, "{held:?}");
    // Seen again with another closure, the hand has to meet the gripper first.
    show(&mut bench, Some(0.0));
    let untaken = run(&mut bench, 1.0);
    assert!((untaken.closure[0] - 0.6).abs() < 0.01, "{untaken:?}");
    let measured = bench.echo().grippers_measured;
    assert!((measured.closure[0] - 0.6).abs() < 0.01, "{measured:?}");
    bench.assert_no_violations("gripping");
}

#[test]
fn f120_engaging_with_another_closure_moves_no_finger() {
    let mut bench = Bench::at_home(1);
    show(&mut bench, Some(0.8));
    bench.engage();
    let untaken = run(&mut bench, 1.0);
    assert_eq!(untaken, GripperMotion { closure: [0.0; 2], rate: [0.0; 2] }, "the hands have not met");
    // The person opens the hand. From there on the gripper follows.
    show(&mut bench, Some(0.05));
    run(&mut bench, 0.3);
    show(&mut bench, Some(0.8));
    let followed = run(&mut bench, 4.0);
    assert!((followed.closure[0] - 0.8).abs() < 0.01, "{followed:?}");
}

#[test]
fn stop_keeps_the_grip_and_setting_opens_it() {
    for opens in [false, true] {
        let mut bench = Bench::at_home(1);
        bench.config.open_grippers_when_disengaged = opens;
        show(&mut bench, Some(0.0));
        bench.engage();
        run(&mut bench, 0.2);
        show(&mut bench, Some(1.0));
        assert!(run(&mut bench, 4.0).closure[0] > 0.99);
        bench.let_go();
        let left = run(&mut bench, 4.0);
        assert_eq!(bench.mode(), Mode::Disengaged);
        assert!(if opens { left.closure[0] < 0.01 } else { left.closure[0] > 0.99 }, "{opens}: {left:?}");
    }
}

/// Creates an Engaged robot whose left gripper holds an object of 5 cm with all its force.
fn holding_an_object() -> Bench {
    let loaded = support::loaded();
    let robot = plant::Options { object_width_m: 0.05, ..plant::Options::default() };
    let options = world::simulated::Options { robot, ..Default::default() };
    let mut bench = Bench::with_options(&loaded, &options, 1);
    bench.target = Some(loaded.model.home);
    bench.settle();
    show(&mut bench, Some(0.0));
    bench.engage();
    run(&mut bench, 0.2);
    show(&mut bench, Some(1.0));
    run(&mut bench, 4.0);
    bench
}

#[test]
fn f120_fingers_stop_at_an_object_and_restarted_driver_holds_it() {
    let mut bench = holding_an_object();
    let measured = bench.echo().grippers_measured;
    // 5 cm of the 10 cm of an open hand.
    assert!((measured.closure[0] - 0.5).abs() < 0.01 && (measured.force_n[0] - 20.0).abs() < 0.1, "{measured:?}");
    assert_eq!(measured.force_n[1], 0.0);
    bench.assert_no_violations("an object in the hand");
    bench.let_go();
    run(&mut bench, 1.0);
    assert!(bench.restart_driver());
    for _ in 0..TICK_HZ {
        bench.step();
        let force_n = bench.echo().grippers_measured.force_n[0];
        assert!(force_n > 19.0, "{force_n} N");
    }
}

#[test]
fn f121_denied_gripper_stops_the_robot() {
    let mut bench = Bench::at_home(1);
    // A gate that allows nothing: as if the gripper's law were wrong.
    bench.config.gripper_gate = safety::gripper::Config::default();
    show(&mut bench, Some(0.0));
    bench.engage();
    let elbow = bench.model().arms[0].elbow();
    bench.target = bench.target.map(|mut q| {
        q[elbow] += 0.3;
        q
    });
    run(&mut bench, 0.1);
    show(&mut bench, Some(1.0));
    bench.step();
    assert_eq!(bench.status.gate_denials, 1);
    assert_eq!(bench.command_flags & command_flag::ON_PLAN, 0, "the arms' new motion was not denied");
    let stopped = (0..TICK_HZ).any(|_| {
        bench.step();
        bench.mode() != Mode::Engaged
    });
    assert!(stopped && bench.status.gate_denials > 0, "{:?}", bench.mode());
    assert_eq!(bench.echo().grippers.closure, [0.0; 2]);
    assert!(safety::gate::Denial::meaning(bench.status.denied_why).is_some_and(|why| why.contains("gripper")));
}
