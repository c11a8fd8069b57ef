//! A driver that was suspended while the robot moved, or that starts on a moving robot.

use crate::bench::{Bench, CONFIG, K, LIMITS, measured};
use driver::{GAP_MAX_TICKS, Input, PlanPlayback, Refusal, SILENCE_TICKS, State, tick};
use messages::{Fault, Faults, JOINTS_MAX, JointMotion, Layout, RobotId, Stamp, TICK_S, deadline};

/// Returns a measurement at index `k` with joint 3 at `q` and speed `v`.
fn measured_at(k: u64, q: f64, v: f64) -> driver::Measured {
    let mut measured = driver::Measured { stamp: deadline(k), ..measured() };
    (measured.q[3], measured.dq[3]) = (q, v);
    measured
}

#[test]
fn suspended_driver_resumes_from_measured_posture_and_stops() {
    for gap in [GAP_MAX_TICKS + 1, SILENCE_TICKS, SILENCE_TICKS + 1, 600, 2250] {
        let mut bench = Bench::following();
        let before = bench.state.motion.q[3];
        let k = K + 5 + gap;
        let newest = bench.command(k);
        // Behind the last setpoint, and slower than the plan can be by now.
        let (q, v) = (before - 0.02, 0.3);
        // Joint 5 stands: its measured speed is noise.
        let mut now = measured_at(k, q, v);
        now.dq[5] = 0.01;
        let input = Input { due_k: k, command: Some(&newest), port_fault: false, measured: Some(&now) };
        let mut kinds = Vec::new();
        let out = driver::tick_each(&CONFIG, &mut bench.state, deadline(k), input, |step| kinds.push(step.kind));
        assert_eq!((out.executed.q[3], out.executed.v[3]), (q, v), "{gap}: not where the newest command is");
        assert_eq!(out.executed.v[5], 0.0, "{gap}");
        assert_eq!((out.suspended_ticks, out.accepted), (Some(gap), None));
        assert_eq!(kinds, [driver::StepKind::Measured], "{gap}: no missed tick of the plan is played");
        assert_eq!(out.faults.has(Fault::DriverFault), gap > SILENCE_TICKS, "{gap}");
        // From there it stops within the limits, and ends at rest.
        let (mut from, mut ticks) = (bench.state.motion, 0);
        while !bench.state.motion.is_at_rest() {
            ticks += 1;
            bench.tick(k + ticks, None);
            let to = bench.state.motion;
            let (jerk, step) = ((to.a[3] - from.a[3]).abs() / TICK_S, (to.q[3] - from.q[3]).abs());
            assert!(jerk <= LIMITS.j_max + 1e-6 && to.a[3].abs() <= LIMITS.a_max && step <= v * TICK_S, "{to:?}");
            from = to;
        }
        assert!((10..300).contains(&ticks), "{ticks}");
        assert!(bench.state.motion.q[3] > q && bench.state.motion.q[3] < q + 0.05);
    }
}

#[test]
fn suspended_driver_continues_certified_stop_if_robot_played_it() {
    for gap in [GAP_MAX_TICKS + 1, SILENCE_TICKS, SILENCE_TICKS + 1, 40, 600] {
        let mut bench = Bench::following();
        let mut planned = bench.state.motion;
        planned.play(gap);
        let k = K + 5 + gap;
        // A robot lags its setpoints by 8 ms.
        let mut now = measured_at(k, 0.0, 0.0);
        (now.q, now.dq) = (planned.q, planned.v);
        let mut before = bench.state.motion;
        before.play(gap.saturating_sub(12));
        let sooner_s = 12_u64.saturating_sub(gap) as f64 * TICK_S;
        (now.q[3], now.dq[3]) = (before.q[3] - sooner_s * before.v[3], before.v[3]);
        let newest = bench.command(k);
        let input = Input { due_k: k, command: Some(&newest), port_fault: false, measured: Some(&now) };
        let out = tick(&CONFIG, &mut bench.state, deadline(k), input);
        assert_eq!(bench.state.motion, planned, "{gap}");
        assert_eq!((out.suspended_ticks, out.advanced, out.accepted), (Some(gap), gap, None));
        assert_eq!(out.faults.has(Fault::DriverFault), gap > SILENCE_TICKS, "{gap}");
        // If one joint is elsewhere, or has another speed, the driver begins at the measured posture of all joints.
        for (q, v) in [(0.02, 0.0), (-0.02, 0.0), (0.0, 1.0), (0.0, -1.0)] {
            let mut bench = Bench::following();
            let mut elsewhere = now;
            (elsewhere.q[5], elsewhere.dq[5]) = (now.q[5] + q, now.dq[5] + v);
            let out = bench.tick_measuring(k, &elsewhere);
            assert_eq!(out.executed.q, elsewhere.q, "{gap}: {q}, {v}");
        }
    }
}

/// Returns a motion of two joints that stop, the second one later and along another path.
fn both() -> JointMotion {
    let mut motion = JointMotion::rest(measured().q);
    (motion.v[3], motion.v[5]) = (1.0, -1.2);
    (motion.plan.jerk[3], motion.plan.duration_s[3]) = ([-100.0, 100.0, 0.0], [0.1, 0.1, 0.0]);
    (motion.plan.jerk[5], motion.plan.duration_s[5]) = ([50.0, 0.0, -50.0], [0.08, 0.22, 0.08]);
    motion
}

/// The robot braked by itself and fell behind its certified stop. The driver goes on along the path of that stop
/// at the robot's speed, and ends where that stop ends.
#[test]
fn suspended_driver_follows_stop_path_at_speed_of_slower_robot() {
    // The last robot is measured faster than the stop. The driver is no faster than the stop.
    for (gap, behind, share) in
        [(30, 0, 0.5), (60, 40, 0.6), (90, 50, 0.8), (40, 35, 0.9), (120, 60, 0.5), (90, 50, 1.05)]
    {
        let mut bench = Bench::following();
        bench.state.motion = both();
        let (mut way, mut found) = (vec![both()], both());
        for _ in 0..600 {
            let mut next = *way.last().unwrap();
            next.play(1);
            way.push(next);
        }
        found.play(gap - behind);
        let k = K + 5 + gap;
        let now = driver::Measured { stamp: deadline(k), q: found.q, dq: found.v.map(|v| share * v), ..measured() };
        let out = bench.tick_measuring(k, &now);
        assert_eq!(out.executed.q, found.q, "{gap}, {behind}");
        for j in [3, 5] {
            let v = f64::min(share, 1.0) * found.v[j];
            assert!((out.executed.v[j] - v).abs() < 1e-12, "{gap}, {behind}: {}", out.executed.v[j]);
        }
        let mut ticks = 0;
        while !bench.state.motion.is_at_rest() {
            ticks += 1;
            bench.tick(k + ticks, None);
            let q = bench.state.motion.q;
            let (next, at) = (0..way.len()).map(|i| (i, way[i].q[5])).find(|(_, at)| *at <= q[5] + 1e-12).unwrap();
            let before = &way[next.saturating_sub(1)];
            let part = if before.q[5] == at { 0.0 } else { (before.q[5] - q[5]) / (before.q[5] - at) };
            let on_way = before.q[3] + part * (way[next].q[3] - before.q[3]);
            assert!((q[3] - on_way).abs() < 1e-5, "{gap}, {behind}: {} off the way", q[3] - on_way);
        }
        let end = way.last().unwrap();
        assert!((bench.state.motion.q[3] - end.q[3]).abs() < 1e-9 && (bench.state.motion.q[5] - end.q[5]).abs() < 1e-9);
        assert!(f64::from(u32::try_from(ticks).unwrap()) * TICK_S <= 1.0);
    }
}

/// The robot's process was kept from its core as well, so its last measurement is older than the driver's return.
/// The driver compares it with the plan's state at that time.
#[test]
fn suspended_driver_compares_old_measurement_with_plan_then() {
    for (gap, age) in [(16, 14), (40, 14), (16, 2)] {
        let mut bench = Bench::following();
        // The joint was accelerating before at its limit, so 8 ms earlier it was that much slower.
        let behind = 12 + age;
        let (mut before, sooner) = (bench.state.motion, u64::saturating_sub(behind, gap));
        before.play(gap.saturating_sub(behind));
        let sooner_s = sooner as f64 * TICK_S;
        let mut now = measured_at(K + 5 + gap - age, 0.0, 0.0);
        (now.q, now.dq) = (before.q, before.v);
        now.dq[3] -= sooner_s * LIMITS.a_max;
        now.q[3] -= sooner_s * before.v[3] - 0.5 * LIMITS.a_max * sooner_s * sooner_s;
        let mut planned = bench.state.motion;
        planned.play(gap);
        bench.tick_measuring(K + 5 + gap, &now);
        assert_eq!(bench.state.motion, planned, "{gap}, {age}");
    }
}

/// A joint that already brakes when its driver returns goes on braking. Its stop keeps the limits, and is no
/// longer than the stop of a joint that has to begin braking.
#[test]
fn suspended_driver_whose_plan_brakes_continues_braking() {
    let (gap, v) = (30, 1.0);
    let mut bench = Bench::following();
    let mut planned = bench.state.motion;
    planned.play(gap);
    assert!(planned.a[3] < -1.0, "the plan brakes by then: {planned:?}");
    let now = measured_at(K + 5 + gap, bench.state.motion.q[3] - 0.05, v);
    let out = bench.tick_measuring(K + 5 + gap, &now);
    assert_eq!((out.executed.q[3], out.executed.v[3], out.executed.a[3]), (now.q[3], v, planned.a[3]));
    let (mut end, mut largest) = (bench.state.motion, 0.0_f64);
    while !end.is_at_rest() {
        end.play(1);
        largest = largest.max(end.a[3].abs());
    }
    assert!(largest <= LIMITS.a_max + 1e-9);
    // If braking begins without acceleration, the way is v (v / A + A / J) / 2.
    let unbraked = v * (v / LIMITS.a_max + LIMITS.a_max / LIMITS.j_max) / 2.0;
    let way = end.q[3] - now.q[3];
    assert!(way > 0.0 && way < unbraked, "{way}, {unbraked}");
}

#[test]
fn suspended_driver_ignores_stale_or_implausible_measurement() {
    let k = K + 605;
    let old = driver::Measured { stamp: deadline(K + 5), ..measured_at(k, 0.01, 0.0) };
    let stale = driver::Measured { stamp: deadline(k - 16), ..measured_at(k, 0.01, 0.0) };
    for (now, why) in [
        (None, "none"),
        (Some(old), "taken before the pause"),
        (Some(stale), "taken 10.7 ms before"),
        (Some(driver::Measured { stamp: Stamp(u64::MAX), ..old }), "of a clock that is ahead"),
        (Some(measured_at(k, f64::NAN, 0.0)), "NaN"),
        (Some(measured_at(k, 0.01, f64::NAN)), "NaN speed"),
        (Some(measured_at(k, 3.0, 0.0)), "farther than a joint can fall"),
    ] {
        let mut bench = Bench::following();
        let mut end = bench.state.motion;
        end.play(600);
        let input = Input { due_k: k, command: None, port_fault: false, measured: now.as_ref() };
        let out = tick(&CONFIG, &mut bench.state, deadline(k), input);
        assert_eq!((out.executed.q, out.executed.v), (end.q, end.v), "{why}: it goes on with the certified stop");
        assert!(out.faults.has(Fault::DriverFault), "{why}");
    }
}

/// A robot that stopped by itself long ago stands before the end of the certified stop. Nothing moves it there.
#[test]
fn suspended_driver_holds_robot_that_stopped_before_plan_end() {
    for gap in [200, 600, 2250] {
        for short in [0.001, 0.005, 0.01] {
            let mut bench = Bench::following();
            let mut planned = bench.state.motion;
            planned.play(gap);
            assert!(planned.is_at_rest());
            let now = measured_at(K + 5 + gap, planned.q[3] - short, 0.0);
            let out = bench.tick_measuring(K + 5 + gap, &now);
            assert_eq!((out.executed.q, out.executed.v), (now.q, [0.0; JOINTS_MAX]), "{gap}, {short}");
        }
    }
}

#[test]
fn starting_driver_uses_speed_only_if_positions_confirm_it() {
    let elapsed_s = 9.0 * TICK_S;
    let begun = |moved: f64, v: f64| {
        let (earlier, now) = (measured_at(K, 0.5, v), measured_at(K + 9, 0.5 + moved, v));
        State::begin(&CONFIG, K + 9, &earlier, &now).expect("finite").motion
    };
    let moving = begun(1.5 * elapsed_s, 1.5);
    assert_eq!((moving.q[3], moving.v[3]), (0.5 + 1.5 * elapsed_s, 1.5), "it stops from there");
    for (moved, v, why) in [
        (0.0, 1.5, "it stands"),
        (0.0, -50.0, "it stands, and no joint is so fast"),
        (-1.5 * elapsed_s, 1.5, "it goes the other way"),
        (2.6 * elapsed_s, 2.6, "faster than any joint"),
    ] {
        assert_eq!(begun(moved, v), JointMotion::rest(measured_at(K, 0.5 + moved, v).q), "{why}");
    }
    let (earlier, now) = (measured_at(K, 0.5, 1.5), measured_at(K + 9, 0.5 + 1.5 * elapsed_s, 1.5));
    assert!(State::begin(&CONFIG, K + 9, &earlier, &now).unwrap().latched, "nobody proved that stop");
    assert_eq!(
        State::begin(&CONFIG, K + 9, &now, &now).unwrap().motion.v,
        [0.0; JOINTS_MAX],
        "one look confirms nothing"
    );
}

#[test]
fn robot_stands_after_100_ms_without_motion_above_noise() {
    // `moved` says how far the joint has moved after `n` ticks. Returns the first tick at which it stands, if within
    // a second.
    let stands_after = |moved: &dyn Fn(u64) -> f64| {
        let mut standstill = driver::Standstill::new(&measured_at(K, 0.5 + moved(0), 0.0));
        (0..1500).find(|&n| standstill.stands(&measured_at(K + n, 0.5 + moved(n), 0.0)))
    };
    let noise = |n: u64| if n.is_multiple_of(2) { 3.9e-4 } else { 0.0 };
    assert_eq!(stands_after(&|_| 0.0), Some(150));
    assert_eq!(stands_after(&noise), Some(150));
    assert_eq!(stands_after(&|n| if n < 300 { -1e-3 * n as f64 } else { -0.3 }), Some(450), "it braked, then stood");
    assert_eq!(stands_after(&|n| 5e-6 * n as f64), None, "a lift that creeps by 7.5 mm/s");
    assert_eq!(stands_after(&|n| 5e-4 * (n as f64 * TICK_S * 40.0).sin()), None, "it swings, and is back after 157 ms");
    assert_eq!(stands_after(&|_| f64::NAN), None);
    // A stopped robot process measures nothing: the same measurement comes again.
    let mut standstill = driver::Standstill::new(&measured_at(K, 0.5, 2.0));
    assert!((0..10_000).all(|_| !standstill.stands(&measured_at(K, 0.5, 2.0))));
}

#[test]
fn wait_for_standstill_begins_at_first_stamped_measurement() {
    // Returns the tick of the robot's own time at which the wait ends. The robot has not measured at first.
    let waits = |v: f64| {
        let mut standstill = driver::Standstill::new(&measured());
        assert!((0..10).all(|_| !standstill.is_over(&measured())), "a robot without a measurement");
        (0..3000).find(|&n| standstill.is_over(&measured_at(K + n, 0.5 + v * n as f64 * TICK_S, v)))
    };
    assert_eq!(waits(0.0), Some(150), "it stands");
    assert_eq!(waits(0.1), Some(driver::STANDS_WITHIN_TICKS), "it moves on");
}

#[test]
fn starting_driver_limits_speed_of_standing_joint_to_noise() {
    for v in (0..2000).map(|v| f64::from(v) * 1e-3) {
        let begun = State::begin(&CONFIG, K + 9, &measured_at(K, 0.5, v), &measured_at(K + 9, 0.5, v)).unwrap().motion;
        assert!(begun.v[3] <= 0.11, "it stands, and {v} rad/s are reported: {} rad/s", begun.v[3]);
    }
}

#[test]
fn f064_power_returning_in_pause_starts_at_measured_posture() {
    let mut bench = Bench::at_rest();
    let mut resumed = |k: u64, q: f64, powered: bool| {
        let mut now = measured_at(k, q, 0.0);
        now.drives.powered = powered;
        bench.tick_measuring(k, &now).executed.q[3]
    };
    for n in 1..20 {
        resumed(K + n, n as f64 * TICK_S, false);
    }
    // It sinks for 300 ms more.
    assert_eq!(resumed(K + 469, 0.3, true), 0.3);
    assert_eq!(resumed(K + 470, 0.3, true), 0.3);
}

/// Without power a servo may stand a little beyond a limit. The setpoint that returning power finds is no farther
/// than the limit. A robot that stands well beyond the limit is left where it is.
#[test]
fn setpoint_without_power_slightly_beyond_limit_is_clamped() {
    for (beyond, held) in [(0.001, LIMITS.q_max), (0.02, LIMITS.q_max + 0.02)] {
        let begun = State::hold(K, &measured_at(K, LIMITS.q_max + beyond, 0.0).q).unwrap();
        let mut bench = Bench { state: begun, ..Bench::at_rest() };
        for n in 1..20 {
            let mut now = measured_at(K + n, LIMITS.q_max + beyond, 0.0);
            now.drives.powered = false;
            bench.tick_measuring(K + n, &now);
        }
        assert_eq!(bench.state.motion.q[3], held);
    }
}

/// The certified stop of a joint ends just before its limit, and another joint is off its plan.
#[test]
fn suspended_driver_near_limit_resumes_without_speed_step() {
    let limits = driver::JointLimits { a_max: 10.0, j_max: 400.0, ..LIMITS };
    let config = driver::Config::new(RobotId::ZERO, [limits; JOINTS_MAX]);
    for played in [0, 20, 40, 80, 120, 160] {
        for gap in [GAP_MAX_TICKS + 1, 12, 16, 30] {
            let (v, a) = (1.9, limits.a_max);
            let mut stop = JointMotion::rest([0.0; JOINTS_MAX]);
            stop.v[3] = v;
            stop.plan.jerk[3] = [-limits.j_max, 0.0, limits.j_max];
            stop.plan.duration_s[3] = [a / limits.j_max, v / a - a / limits.j_max, a / limits.j_max];
            let mut end = stop;
            end.play(5000);
            stop.q[3] = limits.q_max - 0.001 - end.q[3];
            stop.play(played);
            let mut bench = Bench::at_rest();
            // This makes the robot's position known.
            let there = driver::Measured { stamp: deadline(K + 5), q: stop.q, ..measured() };
            let mut state = State::hold(K + 4, &stop.q).unwrap();
            tick(
                &config,
                &mut state,
                there.stamp,
                Input { due_k: K + 5, command: None, port_fault: false, measured: Some(&there) },
            );
            bench.state = state;
            bench.state.motion = stop;
            let mut robot = stop;
            robot.play(gap - 3);
            let mut now = driver::Measured { stamp: deadline(K + 5 + gap), q: robot.q, dq: robot.v, ..measured() };
            now.q[5] += 0.001;
            let input = Input { due_k: K + 5 + gap, command: None, port_fault: false, measured: Some(&now) };
            let out = tick(&config, &mut bench.state, now.stamp, input);
            let change = (out.executed.v[3] - stop.v[3]).abs();
            assert!(change <= limits.a_max * (gap as f64 * TICK_S + 0.002), "{played}, {gap}: {change} rad/s");
        }
    }
}

#[test]
fn robot_at_rest_stays_through_driver_pause_without_fault() {
    let mut bench = Bench::at_rest();
    for gap in [1, 9, 15, 600, 100_000] {
        let k = bench.state.index() + gap;
        let out = bench.tick(k, None);
        assert_eq!((out.advanced, out.suspended_ticks, out.faults), (gap, None, Faults::NONE));
        // Nor does it jump to where a command stream has gone meanwhile.
        let far = bench.command(k + GAP_MAX_TICKS + 1);
        let input = Input { due_k: k, command: Some(&far), port_fault: false, measured: None };
        let out = tick(&CONFIG, &mut bench.state, deadline(far.k), input);
        assert_eq!(out.refused, Some(Refusal::Gap), "{gap}");
    }
}

#[test]
fn suspended_machine_resumes_at_rest_in_bounded_steps() {
    let mut bench = Bench::following();
    let mut steps = 0;
    let input = Input { due_k: K + (1 << 40), command: None, port_fault: false, measured: None };
    driver::tick_each(&CONFIG, &mut bench.state, deadline(K + (1 << 40)), input, |_| steps += 1);
    // The ticks of a plan of 0.1 s, and one for all the rest.
    assert!(steps <= 152, "{steps}");
    assert_eq!((bench.state.index(), bench.state.motion), (K + (1 << 40), JointMotion::rest(bench.state.motion.q)));
}
