//! Driver and body together: delays, deaths and failures, and the joints' true motion after them.

use super::{Bench, behind};
use crate::support::ELBOW;
use driver::{GAP_MAX_TICKS, Interface};
use messages::{TICK_HZ, deadline};
use plant::Reaction;
use world::simulated::Options;

/// Accelerates the elbow to 0.12 rad/s, by 2.4 rad/s^2, and keeps its speed for 0.2 s.
fn cruise(bench: &mut Bench) {
    for (jerk, ticks) in [(200.0, 18), (0.0, 57), (-200.0, 18), (0.0, 300)] {
        bench.drive(ELBOW, jerk, ticks);
    }
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
