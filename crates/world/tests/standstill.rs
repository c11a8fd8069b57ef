//! A robot that moves without a command: swings and sagging arms, with control and the simulated driver together.

use crate::support::{Bench, ELBOW, JOINTS};
use messages::{Fault, Faults, Mode, Response, RobotState, TICK_HZ, TICK_S};
use plant::Injection;
use std::f64::consts::TAU;

/// Measurement of an elbow that swings about its command, `n` ticks after the start.
fn swinging(amplitude: f64, hz: f64, n: u64) -> impl Fn(&mut RobotState) {
    let (angle, omega) = (TAU * hz * n as f64 * TICK_S, TAU * hz);
    move |state| {
        state.q_measured[ELBOW] += amplitude * angle.sin();
        state.dq_measured[ELBOW] += amplitude * omega * angle.cos();
    }
}

#[test]
fn f055_arm_swinging_about_steady_command_is_stopped() {
    for hz in [0.5, 1.0, 2.0, 4.0, 6.0, 8.0, 12.0, 16.0, 20.0] {
        for amplitude in [0.145, 0.08] {
            let mut bench = Bench::engaged(1);
            let taken = (1..2 * TICK_HZ).find(|&n| {
                bench.step_measuring(swinging(amplitude, hz, n));
                bench.mode() == Mode::Faulted
            });
            // The time that the monitor takes, and a tick each way.
            let most = if amplitude < 0.1 { TICK_HZ * 7 / 10 } else { TICK_HZ * 3 / 10 };
            assert!(taken.is_some_and(|n| n <= most + 2), "{amplitude} rad at {hz} Hz: {taken:?}");
            // If the speed exceeds three times the limit, it looks like a jump of the encoder.
            let jumps = bench.last_why() == Fault::FeedbackInvalid as u32;
            assert!(jumps || bench.joint_of_last() == Some(ELBOW), "{amplitude} rad at {hz} Hz: names the joint");
        }
    }
}

#[test]
fn f055_swinging_arm_is_neither_enabled_nor_reset() {
    // 0.67 rad/s: below every speed that stops in one swing.
    for hz in [1.0, 2.0, 4.0] {
        let amplitude = 0.67 / (TAU * hz);
        let mut bench = Bench::at_home(1);
        for n in 1..4 * TICK_HZ {
            if n.is_multiple_of(TICK_HZ / 3) {
                bench.press_enable();
            } else if n.is_multiple_of(TICK_HZ / 5) {
                bench.let_go();
                bench.hand.reset_edge = true;
            }
            bench.step_measuring(swinging(amplitude, hz, n));
            assert!(n < TICK_HZ / 10 || bench.status.moving == 1, "{hz} Hz: at rest after {n} ticks");
            let reset = bench.last_why() == messages::Transition::RESET;
            assert!(matches!(bench.mode(), Mode::Disengaged | Mode::Faulted) && !reset, "{hz} Hz, after {n} ticks");
        }
        assert_eq!(bench.mode(), Mode::Faulted, "and it is said");
        // At rest it can be reset and enabled.
        bench.let_go();
        bench.steps(2 * TICK_HZ);
        bench.reset();
        assert_eq!((bench.mode(), bench.status.moving), (Mode::Disengaged, 0), "{hz} Hz");
    }
}

#[test]
fn f055_arm_pushed_at_standstill_faults() {
    for by in [0.03, -0.03] {
        let mut bench = Bench::at_home(1);
        // Pushed within 0.3 s: slower than every speed that stops, and not as far as a tracking error.
        let pushed = |n: u64| by * (n as f64 / (0.3 * TICK_HZ as f64)).min(1.0);
        let taken = (1..TICK_HZ).find(|&n| {
            bench.step_measuring(|state| state.q_measured[ELBOW] += pushed(n));
            bench.mode() == Mode::Faulted
        });
        assert!(taken.is_some_and(|n| n < TICK_HZ / 3), "{taken:?}");
        assert_eq!(bench.last_why(), Fault::StandstillLost as u32);
        assert_eq!(bench.joint_of_last(), Some(ELBOW));
    }
}

#[test]
fn f064_arm_sinking_without_power_faults_and_is_not_reset() {
    for sag in [0.01, 0.05, 0.2] {
        let mut bench = Bench::at_home(1);
        bench.robot.inject(Injection::PowerLost { sag });
        for n in 0..3 * TICK_HZ {
            bench.hand.reset_edge = n.is_multiple_of(TICK_HZ / 10);
            bench.step();
            assert!(n < 4 || bench.mode() == Mode::Faulted, "{sag}: {n}");
        }
        let faults = Faults(bench.status.faults);
        assert!(faults.has(Fault::StandstillLost) && faults.has(Fault::DriverFault), "{sag}: {faults:?}");
        assert_eq!(bench.status.moving, 1, "{sag}");
        // The command moved with the arm, so the returning power finds it there.
        bench.robot.inject(Injection::PowerReturned);
        bench.steps(TICK_HZ / 2);
        let there = *bench.robot.q();
        bench.reset();
        assert_eq!(bench.mode(), Mode::Faulted, "{sag}: it has stood for half a second");
        bench.steps(2 * TICK_HZ);
        let stops = Faults(bench.status.faults).with_response(Response::Stop);
        assert_eq!(stops, Faults::NONE.with(Fault::DriverFault), "{sag}");
        bench.reset();
        bench.steps(TICK_HZ / 10);
        assert_eq!(bench.mode(), Mode::Disengaged, "{sag}");
        let moved = (0..JOINTS).map(|j| (bench.robot.q()[j] - there[j]).abs()).fold(0.0, f64::max);
        assert!(moved < 1e-3, "{sag}: {moved}");
    }
}

/// Stops from full speed in every phase of a motion. The end of a stop never counts as a lost standstill.
#[test]
fn stop_ends_at_rest_without_standstill_fault() {
    for stopped_at in (0..3).map(|n| TICK_HZ * (4 + n) / 4) {
        let mut bench = Bench::engaged(1);
        for k in 0..stopped_at {
            let mut target = bench.model().home;
            target[ELBOW] += 0.2 * (k as f64 * TICK_S * 3.0).sin();
            bench.target = Some(target);
            bench.step();
        }
        bench.let_go();
        let ended = (0..TICK_HZ).find(|_| {
            bench.step();
            bench.mode() == Mode::Disengaged
        });
        assert!(ended.is_some(), "{stopped_at}: {:?}", bench.mode());
        for _ in 0..4 * TICK_HZ {
            bench.step();
            assert_eq!((bench.mode(), bench.status.moving), (Mode::Disengaged, 0), "{:?}", Faults(bench.status.faults));
        }
        assert_eq!(bench.status.fault_counts[Fault::VelocityError.index()], 0);
    }
}
