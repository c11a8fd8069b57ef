//! The joints follow, lag, saturate, and fail as told.

mod support;

use messages::{Fault, JOINTS, TICK_S};
use sim::{Injection, Options};
use support::{Bench, ELBOW, K, others};

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

fn error(bench: &Bench) -> f64 {
    bench.command.q[ELBOW] - bench.state.q()[ELBOW]
}

#[test]
fn a_joint_lags_by_its_delay() {
    for delay_ticks in [0, 2, 15] {
        let mut bench = Bench::new(&Options { delay_ticks, ..Options::default() }, 1);
        cruise(&mut bench);
        let v = bench.command.v[ELBOW];
        assert!(v > 0.1);
        let expected = v * f64::from(delay_ticks) * TICK_S;
        // A quarter of a tick more or less: the servo integrates in steps.
        assert!((error(&bench) - expected).abs() < 0.25 * v * TICK_S, "{delay_ticks}: {} {expected}", error(&bench));
        for j in others(ELBOW) {
            assert!((bench.state.q()[j] - bench.config.initial()[j]).abs() < 1e-3, "joint {j} stays");
        }
    }
}

#[test]
fn the_servo_settles_with_its_natural_frequency() {
    // A step that the plant sees through the port, without the follower in between. At critical damping the error of a
    // step is (1 + w t) exp(-w t): at w t = 2 it is 0.406.
    let bench = Bench::ideal();
    let hz = Options::default().natural_frequency_hz;
    let mut plant = sim::Plant::new(&bench.config, K, 1);
    let mut target = *bench.config.initial();
    target[ELBOW] += 1e-4;
    let mut port = sim::Port { config: &bench.config, plant: &mut plant };
    let ticks = (2.0 / (std::f64::consts::TAU * hz) / TICK_S).round() as u64;
    for n in 1..=ticks {
        let setpoint = driver::Setpoint { k: K + n, q: target, v: [0.0; JOINTS], a: [0.0; JOINTS] };
        assert!(driver::Driver::write(&mut port, messages::Stamp(1), &setpoint));
    }
    let wt = ticks as f64 * TICK_S * std::f64::consts::TAU * hz;
    let expected = (1.0 + wt) * (-wt).exp();
    let left = (target[ELBOW] - plant.q()[ELBOW]) / 1e-4;
    assert!((left - expected).abs() < 0.05, "{left} {expected}");
}

#[test]
fn the_same_seed_is_the_same_run() {
    let run = |seed| {
        let mut bench = Bench::new(&Options::default(), seed);
        cruise(&mut bench);
        bench.drive(ELBOW, 0.0, 1).state
    };
    assert_eq!(run(5), run(5));
    assert_ne!(run(5).q_measured, run(6).q_measured);
}

#[test]
fn measurements_are_whole_encoder_steps_near_the_truth() {
    let options = Options { encoder_step_rad: 3e-4, encoder_noise_rad: 1e-4, ..Options::default() };
    let mut bench = Bench::new(&options, 1);
    for k in K + 1..K + 200 {
        let state = bench.tick(k, None).state;
        for j in 0..JOINTS {
            let steps = state.q_measured[j] / 3e-4;
            assert!((steps - steps.round()).abs() < 1e-6, "{steps}");
            assert!((state.q_measured[j] - bench.state.q()[j]).abs() < 1.5e-4 + 8.0 * 1e-4);
        }
    }
    let report = bench.state.report();
    assert!(report.tracking_error_rms_rad() > 0.0 && report.tracking_error_max_rad() < 3e-3);
}

#[test]
fn a_driver_that_overslept_simulates_the_same_motion() {
    let mut steady = Bench::ideal();
    let mut sleepy = Bench::ideal();
    cruise(&mut steady);
    accelerate(&mut sleepy);
    for n in 1..=300 {
        let command = sleepy.next(ELBOW, 0.0);
        if n % 20 == 0 {
            let out = sleepy.tick(command.k, Some(&command));
            assert_eq!((out.advanced, out.refused), (20, None));
        }
    }
    let apart = (steady.state.q()[ELBOW] - sleepy.state.q()[ELBOW]).abs();
    assert!(apart < 1e-6, "{apart}");
    assert_eq!(sleepy.violated(), [""; 0]);
}

#[test]
fn f058_without_commands_the_plan_is_played_without_a_violation() {
    let mut bench = Bench::ideal();
    cruise(&mut bench);
    let k = bench.command.k;
    for n in 1..=1500 {
        bench.tick(k + n, None);
    }
    let stopped = bench.tick(k + 1501, None);
    assert!(stopped.faults.has(Fault::DriverFault) && stopped.state.v == [0.0; JOINTS]);
    assert_eq!(bench.violated(), [""; 0], "{:?}", bench.state.report().first_violation());
    assert!((bench.state.q()[ELBOW] - stopped.state.q[ELBOW]).abs() < 1e-6);
}

#[test]
fn injected_faults_show_where_they_should() {
    let measured_error = |fault: Injection| {
        let mut bench = Bench::ideal();
        bench.drive(ELBOW, 0.0, 10);
        bench.state.inject(fault);
        cruise(&mut bench);
        let out = bench.drive(ELBOW, 0.0, 1);
        (out.state.q[ELBOW] - out.state.q_measured[ELBOW], out.state.q[ELBOW] - bench.config.initial()[ELBOW], bench)
    };
    let (error, travel, _) = measured_error(Injection::NotFollowed { joint: ELBOW });
    assert!((error - travel).abs() < 1e-6 && travel > 0.02, "{error} {travel}");
    let (error, travel, _) = measured_error(Injection::SignSwapped { joint: ELBOW });
    assert!((error - 2.0 * travel).abs() < 1e-3, "{error} {travel}");
    let (error, travel, bench) = measured_error(Injection::FrozenFeedback);
    assert!((error - travel).abs() < 1e-6 && (bench.state.q()[ELBOW] - bench.command.q[ELBOW]).abs() < 1e-3);
    let (error, _, bench) = measured_error(Injection::EncoderJump { joint: ELBOW, by: 0.3 });
    assert!((error + 0.3).abs() < 1e-3 && (bench.state.q()[ELBOW] - bench.command.q[ELBOW]).abs() < 1e-3);
}

#[test]
fn a_robot_that_rejects_setpoints_is_a_driver_fault() {
    let mut bench = Bench::ideal();
    bench.drive(ELBOW, 100.0, 10);
    bench.state.inject(Injection::SetpointsRejected);
    let out = bench.drive(ELBOW, 0.0, 1);
    assert!(out.faults.is_empty(), "it shows with the next setpoint");
    let k = bench.command.k;
    assert!(bench.tick(k + 1, None).faults.has(Fault::DriverFault));
}
