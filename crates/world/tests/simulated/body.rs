//! Driver and body together: delays, deaths and failures, and the joints' true motion after them.

use super::{Bench, ELBOW, behind};
use driver::{GAP_MAX_TICKS, Interface};
use messages::{Fault, JOINTS_MAX, TICK_HZ, deadline};
use plant::{Injection, Reaction};
use world::simulated::Options;

/// Accelerates the elbow to 0.12 rad/s, by 2.4 rad/s^2.
fn accelerate(bench: &mut Bench) {
    bench.drive(ELBOW, 200.0, 18);
    bench.drive(ELBOW, 0.0, 57);
    bench.drive(ELBOW, -200.0, 18);
}

/// Accelerates the elbow and keeps its speed for 0.2 s.
fn cruise(bench: &mut Bench) {
    accelerate(bench);
    bench.drive(ELBOW, 0.0, 300);
}

#[test]
fn same_seed_gives_same_run() {
    let run = |seed| {
        let mut bench = Bench::new(&Options::default(), seed);
        cruise(&mut bench);
        bench.drive(ELBOW, 0.0, 1).state
    };
    assert_eq!(run(5), run(5));
    assert_ne!(run(5).q_measured, run(6).q_measured);
}

#[test]
fn late_driver_simulates_same_motion() {
    let mut steady = Bench::ideal();
    let mut sleepy = Bench::ideal();
    accelerate(&mut steady);
    accelerate(&mut sleepy);
    steady.drive(ELBOW, 0.0, 300 / GAP_MAX_TICKS * GAP_MAX_TICKS);
    for n in 1..=300 / GAP_MAX_TICKS * GAP_MAX_TICKS {
        let command = sleepy.next(ELBOW, 0.0);
        if n % GAP_MAX_TICKS == 0 {
            let out = sleepy.tick(command.k, Some(&command));
            assert_eq!((out.advanced, out.refused), (GAP_MAX_TICKS, None));
        }
    }
    let apart = (steady.state.q()[ELBOW] - sleepy.state.q()[ELBOW]).abs();
    // The drives carry on by themselves between two setpoints.
    assert!(apart < 1e-4, "{apart}");
    assert_eq!(sleepy.violated(), [""; 0]);
}

#[test]
fn f058_driver_without_commands_plays_plan_without_violation() {
    let mut bench = Bench::ideal();
    cruise(&mut bench);
    let k = bench.command.k;
    for n in 1..=1500 {
        bench.tick(k + n, None);
    }
    let stopped = bench.tick(k + 1501, None);
    assert!(stopped.faults.has(Fault::DriverFault) && stopped.state.v == [0.0; JOINTS_MAX]);
    assert_eq!(bench.violated(), [""; 0], "{:?}", bench.state.report().first_violation());
    assert!((bench.state.q()[ELBOW] - stopped.state.q[ELBOW]).abs() < 1e-3);
    assert_eq!(bench.state.judged().total(), 0, "{:?}", bench.state.judged().first);
}

#[test]
fn injected_faults_appear_in_measurement_or_motion() {
    let measured_error = |fault: Injection| {
        let mut bench = Bench::ideal();
        bench.drive(ELBOW, 0.0, 10);
        bench.state.inject(fault);
        cruise(&mut bench);
        let out = bench.drive(ELBOW, 0.0, 1);
        (out.state.q[ELBOW] - out.state.q_measured[ELBOW], out.state.q[ELBOW] - bench.config.initial()[ELBOW], bench)
    };
    let (error, travel, _) = measured_error(Injection::NotFollowed { joint: ELBOW });
    assert!((error - travel).abs() < 2e-3 && travel > 0.02, "{error} {travel}");
    let (error, travel, _) = measured_error(Injection::SignSwapped { joint: ELBOW });
    assert!((error - 2.0 * travel).abs() < 2e-3, "{error} {travel}");
    let (error, travel, bench) = measured_error(Injection::FrozenFeedback);
    assert!((error - travel).abs() < 1e-6 && (bench.state.q()[ELBOW] - bench.command.q[ELBOW]).abs() < 2e-3);
    let (error, _, bench) = measured_error(Injection::EncoderJump { joint: ELBOW, by: 0.3 });
    assert!((error + 0.3).abs() < 2e-3 && (bench.state.q()[ELBOW] - bench.command.q[ELBOW]).abs() < 2e-3);
}

/// A driver is suspended for some time while the elbow moves. The next setpoint begins where the robot is, and
/// the joints' true motion breaks no limit.
#[test]
fn suspended_driver_resumes_at_robot_position_without_violation() {
    let (direct, jtc100) = (Interface::Direct, Interface::Jtc100);
    for (reaction, interface) in
        [(Reaction::Hold, direct), (Reaction::Damp, direct), (Reaction::Play, direct), (Reaction::Hold, jtc100)]
    {
        for gap in [2, 8, 9, 14, 16, 30, 83, 150, 600, 2250] {
            let robot = plant::Options { reaction, ..plant::Options::default() };
            let mut bench = Bench::new(&Options { driver: behind(interface), robot, initial: None }, gap);
            cruise(&mut bench);
            for _ in 0..gap {
                bench.next(ELBOW, 0.0);
            }
            let newest = bench.command;
            let before = bench.state.sent().q[ELBOW];
            let out = bench.tick(newest.k, Some(&newest));
            assert_eq!(bench.state.sent().k, newest.k, "{interface:?} {gap}: the setpoint is that of before the pause");
            let step = (bench.state.sent().q[ELBOW] - bench.state.q()[ELBOW]).abs();
            assert!(step < 2e-3, "{reaction:?} {gap}: the setpoint is {step} rad from the robot, from {before}");
            assert_eq!(out.suspended_ticks.is_some(), gap > GAP_MAX_TICKS);
            for n in 1..TICK_HZ {
                bench.tick(newest.k + n, None);
            }
            let judged = bench.state.judged();
            assert_eq!(judged.total(), 0, "{reaction:?} {gap}: {:?}", judged.first);
            let (sent, truth) = (bench.state.sent(), bench.state.truth());
            assert!(bench.state.at_rest() && truth.v.iter().all(|v| v.abs() < 1e-3), "{reaction:?} {gap}: {truth:?}");
            assert!((sent.q[ELBOW] - truth.q[ELBOW]).abs() < 2e-3, "{reaction:?} {gap}");
        }
    }
}

/// The same at 1.8 rad/s, where the certified stop brakes as hard as allowed, and behind trajectory controllers
/// too. The robot's own stop is left as it is: nothing leads the robot on once it stands.
#[test]
fn suspended_driver_moves_no_fast_robot_that_has_stopped() {
    let (brake, jerk) = (9.8, 392.0);
    for interface in [Interface::Direct, Interface::Jtc100] {
        for gap in [9, 12, 15, 16, 20, 30, 45, 90, 150, 400, 600, 2250] {
            let mut bench = Bench::new(&Options { driver: behind(interface), ..Options::default() }, gap);
            bench.drive(ELBOW, 390.0, 37);
            bench.drive(ELBOW, 0.0, 250);
            bench.drive(ELBOW, -390.0, 37);
            bench.command.a[ELBOW] = 0.0;
            bench.drive(ELBOW, 0.0, 30);
            bench.next(ELBOW, 0.0);
            let (v, ramp_s) = (bench.command.v[ELBOW], brake / jerk);
            assert!(v > 1.7);
            bench.command.plan.jerk[ELBOW] = [-jerk, 0.0, jerk];
            bench.command.plan.duration_s[ELBOW] = [ramp_s, v / brake - ramp_s, ramp_s];
            let command = bench.command;
            assert_eq!(bench.tick(command.k, Some(&command)).refused, None);
            let k = command.k + gap;
            bench.state.advance(&bench.config, deadline(k));
            let stood = *bench.state.truth();
            let out = bench.tick(k, None);
            assert_eq!(out.suspended_ticks, Some(gap));
            for n in 1..TICK_HZ {
                bench.tick(k + n, None);
            }
            let judged = bench.state.judged();
            assert_eq!(judged.total(), 0, "{interface:?} {gap}: {:?}", judged.first);
            let truth = bench.state.truth();
            assert!(truth.v.iter().all(|v| v.abs() < 1e-3), "{interface:?} {gap}: {truth:?}");
            let moved = (truth.q[ELBOW] - stood.q[ELBOW]).abs();
            let rested = stood.v[ELBOW].abs() < 1e-3;
            assert!(!rested || moved < 1e-3, "{interface:?} {gap}: it stood, and was led on by {moved} rad");
        }
    }
}

#[test]
fn robot_whose_driver_died_stops_by_itself() {
    for reaction in [Reaction::Hold, Reaction::Damp, Reaction::Play] {
        let robot = plant::Options { reaction, ..plant::Options::default() };
        let mut bench = Bench::new(&Options { robot, ..Options::default() }, 3);
        cruise(&mut bench);
        let (k, from) = (bench.command.k, bench.state.q()[ELBOW]);
        assert!(bench.state.truth().v[ELBOW] > 0.1);
        bench.state.advance(&bench.config, deadline(k + 2 * TICK_HZ));
        let truth = bench.state.truth();
        assert!(truth.v.iter().all(|v| v.abs() < 1e-3), "{reaction:?}: {truth:?}");
        assert!(truth.q[ELBOW] > from && truth.q[ELBOW] < from + 0.06, "{reaction:?}");
        assert_eq!(bench.state.judged().total(), 0, "{reaction:?}: {:?}", bench.state.judged().first);
        // A new driver holds the measured posture, and nothing moves.
        let now = deadline(k + 2 * TICK_HZ + 1);
        assert!(bench.state.restart_driver(&bench.config, k + 2 * TICK_HZ, now, 4));
        let stood = bench.state.truth().q;
        for n in 1..TICK_HZ / 2 {
            bench.tick(k + 2 * TICK_HZ + n, None);
        }
        for (j, (now, then)) in bench.state.q().iter().zip(&stood).enumerate() {
            assert!((now - then).abs() < 1e-3, "{reaction:?}: joint {j}");
        }
    }
}

#[test]
fn robot_that_rejects_setpoints_gives_driver_fault() {
    let mut bench = Bench::ideal();
    bench.drive(ELBOW, 100.0, 10);
    bench.state.inject(Injection::SetpointsRejected);
    let out = bench.drive(ELBOW, 0.0, 1);
    assert!(out.faults.is_empty(), "it shows with the next setpoint");
    let k = bench.command.k;
    assert!(bench.tick(k + 1, None).faults.has(Fault::DriverFault));
}
