//! Faults of the robot itself, injected into the simulated one. The tests check how control and the driver react
//! together.

use driver::PlanPlayback;

use crate::support::{Bench, ELBOW, JOINTS, LEFT_ARM, loaded};
use messages::{Fault, Faults, Mode, TICK_HZ, TICK_S, state_flag};
use plant::Injection;
use std::sync::LazyLock;

/// The right elbow. The left one has most of the injected faults.
const OTHER: usize = 13;
/// Longest stop, ticks.
const STOP_TICKS: u64 = TICK_HZ / 2;

/// Ticks of swinging after which both elbows are fastest.
const FAST: u64 = TICK_HZ * 21 / 10;

/// Swings both elbows about home by 0.15 rad.
fn swing(bench: &mut Bench, k: u64) {
    let mut target = bench.model().home;
    for joint in [ELBOW, OTHER] {
        target[joint] += 0.15 * (k as f64 * TICK_S * 3.0).sin();
    }
    bench.target = Some(target);
    bench.step();
}

/// A bench that is engaged, with both elbows at 0.45 rad/s.
fn moving() -> Bench {
    static MOVING: LazyLock<Bench> = LazyLock::new(|| {
        let mut bench = Bench::engaged(1);
        for k in 0..FAST {
            swing(&mut bench, k);
            assert_eq!(bench.mode(), Mode::Engaged, "{:?}", Faults(bench.status.faults));
        }
        for joint in [ELBOW, OTHER] {
            assert!(bench.commanded().v[joint].abs() > 0.4, "{}", bench.commanded().v[joint]);
        }
        bench
    });
    MOVING.clone()
}

/// Runs until Faulted. Then the whole robot comes to rest in time and stays at rest, without a violation.
fn stops(mut bench: Bench, within: u64, fault: Fault) -> Bench {
    let taken = (1..=within).find(|k| {
        swing(&mut bench, FAST + k);
        bench.mode() == Mode::Faulted
    });
    assert!(taken.is_some(), "{fault:?}: {:?} after {within} ticks, {}", bench.mode(), bench.status.tracking_error);
    assert!(Faults(bench.status.latched).has(fault), "{:?}", Faults(bench.status.latched));
    for k in 0..=STOP_TICKS {
        swing(&mut bench, k);
    }
    let motion = bench.commanded();
    assert!(motion.v.iter().chain(&motion.a).all(|x| *x == 0.0), "{fault:?}: still moving");
    bench.assert_no_violations(fault.row().name);
    bench
}

#[test]
fn f052_f053_f054_implausible_measurement_stops_robot() {
    let cases = [
        (Injection::FrozenFeedback, 90),
        (Injection::FrozenEncoder { joint: ELBOW }, 90),
        (Injection::EncoderJump { joint: ELBOW, by: 0.1 }, 4),
        (Injection::EncoderJump { joint: OTHER, by: -0.04 }, 4),
        (Injection::NanFeedback { joint: ELBOW }, 3),
    ];
    for (injection, within) in cases {
        let mut bench = moving();
        bench.robot.inject(injection);
        let bench = stops(bench, within, Fault::FeedbackInvalid);
        if let Injection::NanFeedback { joint } = injection {
            let sentences = explain::why(&bench.status, &robot::Names::from_model(bench.model()));
            let expected = format!("The position of {} is not finite.", bench.model().joint_names[joint]);
            let shown = sentences.contains("NaN mm") || sentences.contains("NaN rad");
            assert!(sentences.contains(&expected) && !shown, "{sentences}");
        }
    }
}

/// Resets and engages again. Nothing moves before.
fn recovers(mut bench: Bench) {
    let still = *bench.robot.q();
    bench.target = Some(bench.model().home);
    bench.let_go();
    bench.steps(TICK_HZ / 10);
    assert_eq!(bench.mode(), Mode::Faulted, "nothing resets itself");
    bench.reset();
    bench.steps(TICK_HZ / 2);
    assert_eq!(bench.mode(), Mode::Disengaged, "{:?}", Faults(bench.status.faults));
    for (j, (now, then)) in bench.robot.q().iter().zip(&still).enumerate() {
        assert!((now - then).abs() < 1e-3, "joint {j} moved by {} without anybody's leave", now - then);
    }
    bench.engage();
}

#[test]
fn f063_drive_fault_of_one_joint_stops_all_joints_at_once() {
    let mut bench = moving();
    bench.robot.inject(Injection::DriveFault { joint: ELBOW });
    // The state of this tick shows it, and from the next tick the driver plays the plan of all joints.
    swing(&mut bench, FAST);
    let mut plan = bench.commanded();
    for k in 1..STOP_TICKS {
        swing(&mut bench, FAST + k);
        plan.play(1);
        if plan.is_at_rest() {
            // From here on the joint is held where its brake has stopped it.
            break;
        }
        let executed = bench.commanded();
        let off = (0..JOINTS).map(|j| (executed.q[j] - plan.q[j]).abs()).fold(0.0, f64::max);
        assert!(off < 1e-9, "tick {k}: {off} off the plan of the last command");
    }
    let mut bench = stops(bench, 1, Fault::DriverFault);
    bench.robot.repair();
    recovers(bench);
}

#[test]
fn f050_stop_continues_plan_of_last_command() {
    // An encoder with a small offset, which would show a stop towards the measurement.
    for (off, stop) in [(0.0, 0), (0.004, 0), (0.004, 1), (0.0, 2)] {
        let mut bench = Bench::engaged(1);
        bench.robot.inject(Injection::EncoderJump { joint: ELBOW, by: off });
        for k in 0..FAST {
            swing(&mut bench, k);
        }
        let mut plan = bench.commanded();
        let engaged_at = plan.q[ELBOW];
        assert!(plan.v[ELBOW].abs() > 0.4);
        match stop {
            0 => bench.hand.estop_edge = true,
            1 => bench.let_go(),
            _ => bench.target = None,
        }
        let target = bench.target;
        let mut held = 0;
        for _ in 0..STOP_TICKS + TICK_HZ / 2 {
            bench.target = target;
            bench.step();
            let holds = matches!(bench.mode(), Mode::Faulted | Mode::Holding | Mode::Disengaged);
            if !holds {
                plan = bench.commanded();
                continue;
            }
            held += 1;
            plan.play(1);
            let executed = bench.commanded();
            for j in 0..JOINTS {
                // Not towards zeros, not to the measurement, not to an earlier posture.
                assert!((executed.q[j] - plan.q[j]).abs() < 1e-9, "stop {stop}: joint {j} left its plan");
            }
        }
        assert!(held > STOP_TICKS, "stop {stop}");
        let rest = bench.commanded();
        assert!(rest.is_at_rest() && (rest.q[ELBOW] - engaged_at).abs() > 0.01, "it went on, and came to rest");
        bench.assert_no_violations("a stop");
        // A new engagement starts there, not where the last one started.
        bench.let_go();
        bench.step();
        bench.target = Some(bench.model().home);
        bench.reset();
        bench.steps(TICK_HZ / 4);
        bench.press_enable();
        bench.step();
        assert_eq!(bench.mode(), Mode::Engaging, "stop {stop}: {:?}", Faults(bench.status.faults));
        let first = (0..JOINTS).map(|j| (bench.commanded().q[j] - rest.q[j]).abs()).fold(0.0, f64::max);
        assert!(first < 1e-7, "stop {stop}: {first}");
    }
}

#[test]
fn f055_tracking_error_of_one_joint_stays_within_clearance() {
    let loaded = loaded();
    let (model, safety) = (&loaded.model, &loaded.settings.safety);
    // The largest distance of a capsule from the axis of one joint of an arm, over postures on a grid of joints 2
    // and 4.
    let mut reach_m = 0.0_f64;
    let mut frames = robot::Frames::default();
    for n in 0..400 {
        let mut q = model.home;
        for (j, share) in [(1, f64::from(n % 20) / 19.0), (3, f64::from(n / 20) / 19.0)] {
            let limits = &model.limits[LEFT_ARM.start + j];
            q[LEFT_ARM.start + j] = limits.q_min + share * (limits.q_max - limits.q_min);
        }
        model.forward(&q, &mut frames);
        for capsule in model.capsules.iter() {
            if !(LEFT_ARM.start + 1..=LEFT_ARM.end).contains(&capsule.body) {
                continue;
            }
            for end in [capsule.a, capsule.b] {
                let point = frames.base_from_body[capsule.body].transform_point(&end);
                let columns = model.jacobian(&frames, capsule.body, &point);
                for [x, y, z, ..] in &columns[LEFT_ARM] {
                    reach_m = reach_m.max((x * x + y * y + z * z).sqrt());
                }
            }
        }
    }
    assert!((0.6..1.0).contains(&reach_m), "{reach_m} m");
    let margin_m = model.d_min_m - model.d_measured_min_m;
    assert!(reach_m * safety.tracking_error_now_rad <= margin_m, "{reach_m} m, {margin_m} m");
    assert!(safety.tracking_error_now_m <= margin_m);
}

/// A driver of another robot writes the state. Its joints mean something else, so nothing of it is believed.
#[test]
fn state_of_another_robot_is_refused_and_not_believed() {
    let strange = |state: &mut messages::RobotState| {
        state.robot.hash ^= 1;
        (state.q_measured, state.dq_measured) = ([0.7; messages::JOINTS_MAX], [9.0; messages::JOINTS_MAX]);
        state.flags |= state_flag::EMERGENCY_STOP;
    };
    let mut bench = Bench::at_home(1);
    let clearance_m = bench.status.clearance_measured_m;
    for _ in 0..10 {
        bench.step_measuring(strange);
    }
    let faults = Faults(bench.status.faults | bench.status.latched);
    assert!(faults.has(Fault::ConfigMismatch), "{faults:?}");
    for fault in [Fault::EmergencyStop, Fault::FeedbackInvalid, Fault::StartOutsideLimits] {
        assert!(!faults.has(fault), "{faults:?}");
    }
    assert!((bench.status.clearance_measured_m - clearance_m).abs() < 1e-3, "{}", bench.status.clearance_measured_m);
    // The own driver is heard again.
    bench.settle();
    bench.engage();
}
