//! The grippers of a robot on ROS 2: they follow the person's hands, and hold.

use super::{Peer, outlive_stop, preflight, rig, took_all};
use harness::{Operator, StateObserver};
use messages::{Mode, RobotState, state_flag};
use motion::Motion;
use serde_json::Value;
use std::time::{Duration, Instant};

/// Domains of these tests. Tests of one program run at the same time.
const DOMAINS: [u32; 3] = [131, 132, 133];
/// Fingers of both hands of TIAGo++ with Hey5 hands, and their positions when a hand is closed, rad.
#[expect(clippy::approx_constant, reason = "the robot file has 6.28")]
const CLOSED: [f64; 3] = [6.28, 6.8, 9.25];
/// Least time in which a hand closes, s. Source: the robot file.
const CLOSING_S: f64 = 2.6;
/// Longest time in which fingers rest after their driver was killed: the ramp of a gripper, the delay of the robot, two
/// messages and two rows of the trace, s.
const REST_WITHIN_S: f64 = 0.1 + 0.025 + 0.022 + 0.04;

/// The built-in motion of a person whose hands are open, then closed so far, and seen no more at the end.
fn gripping(closure: f32) -> Motion {
    let mut motion = motion::builtin();
    let at = |s: f64| (s * motion.frame_rate_hz) as usize;
    let (closes, lost) = (at(2.0), at(8.0));
    for (number, frame) in motion.frames.iter_mut().enumerate() {
        let seen = if number < closes { 0.0 } else { closure };
        frame.closure = [(number < lost).then_some(seen); 2];
    }
    motion
}

/// Commanded closures of the left hand's fingers in a row of the trace. The last columns are the fingers', in pairs.
fn closures(row: &[f64]) -> [f64; 3] {
    let first = row.len() - 4 * CLOSED.len();
    std::array::from_fn(|i| row[first + 2 * i] / CLOSED[i])
}

/// Checks what the peer says of the grippers, and that the arms' figures are those without them.
fn assert_sound(report: &Value) {
    for (name, operator) in report["hands"].as_object().expect("hands") {
        assert!(operator["exceeded_updates"] == serde_json::json!({"position": 0, "speed": 0}), "{name}: {operator:#}");
        assert!(
            operator["accepted"] == operator["received"] && operator["accepted"].as_u64() > Some(50),
            "{name}: {operator:#}"
        );
    }
    assert!(took_all(report), "{report:#}");
    assert_eq!(report["command"]["position_excess"]["exceeded_updates"], 0, "{report:#}");
    let acceleration = report["command"]["acceleration_share"]["worst"].as_f64();
    assert!(acceleration < Some(1.1), "{acceleration:?}");
}

/// Holds the enable until the robot is so, and engages it again after each stop. Returns the number of stops.
fn engage_until(operator: &mut Operator, observer: &mut StateObserver, done: impl Fn(&RobotState) -> bool) -> u32 {
    let (give_up, mut stops) = (Instant::now() + Duration::from_secs(90), 0);
    let mut is_done = || observer.robot().is_some_and(|robot| done(&robot));
    while !is_done() {
        assert!(Instant::now() < give_up, "{stops} stops");
        operator.clear(&mut || Ok(())).expect("cleared");
        operator.enable();
        if operator.reach(Mode::Engaged, &mut || Ok(())).is_ok() {
            while !is_done() && operator.hold(Duration::from_millis(20), &mut || Ok(())).is_ok() {}
        }
        stops += u32::from(!is_done());
    }
    stops
}

#[test]
#[ignore = "two cores do not hold a robot, its peer and other tests in time: cargo test --release --test system ros2 -- --ignored"]
fn grippers_on_ros2_close_with_the_hands_and_hold() {
    harness::in_real_time(|| {
        let Some(peer) = Peer::start(DOMAINS[0], &["--object-width-m", "0.05"]) else { return };
        let mut rig = rig(DOMAINS[0]);
        rig.start_all();
        let (mut operator, mut observer) = (rig.operator().expect("it answers"), rig.state_observer());
        let client = rig.client(&gripping(0.7), 1);
        client.set_engaged(true);
        let known = observer.wait("known", |robot| robot.flags & state_flag::GRIPPERS != 0);
        assert_eq!(known.grippers_measured.setpoint, [0.0; 2]);
        let mut stops = engage_until(&mut operator, &mut observer, |robot| robot.grippers.closure[0] > 0.69);
        let held = observer.robot().expect("it was heard").grippers.closure[0];
        // The object stops the fingers half-way, and they press.
        observer.wait("pressing", |robot| {
            let [closures, forces_n] = [robot.grippers_measured.closure, robot.grippers_measured.force_n];
            let pressing = |side: usize| (closures[side] - 0.5).abs() < 0.01 && (forces_n[side] - 20.0).abs() < 0.5;
            pressing(0) && pressing(1)
        });
        // Until the person's hands are seen no more, and then some.
        let until = Instant::now() + Duration::from_millis(5500);
        stops += engage_until(&mut operator, &mut observer, |_| Instant::now() > until);
        let later = observer.robot().expect("it was heard");
        assert!((later.grippers.closure[0] - held).abs() < 0.02, "{:?}", later.grippers);
        assert!(later.grippers_measured.force_n[0] > 19.0, "{:?}", later.grippers_measured);
        operator.release();
        observer.wait_at_rest();
        rig.end_without_violations();
        let (report, trace) = peer.end();
        println!("{:#}", report["hands"]);
        assert_sound(&report);
        let left: Vec<(f64, [f64; 3])> = trace.iter().map(|row| (row[0], closures(row))).collect();
        let first = |most: f64| left.iter().find(|(_, at)| at.iter().all(|one| *one > most)).expect("it closes").0;
        let took_s = first(0.69) - first(0.01);
        println!("closed by 0.68 in {took_s:.2} s, {stops} stops");
        // A machine that is busy stops the robot, and it goes on later.
        let slowest_s = if stops == 0 { 0.68 * CLOSING_S + 0.8 } else { f64::INFINITY };
        assert!((0.68 * CLOSING_S - 0.05..slowest_s).contains(&took_s), "{took_s} s");
        let (_, end) = left.last().expect("rows");
        assert!(end.iter().all(|one| (one - 0.7).abs() < 0.01), "they hold: {end:?}");
    });
}

#[test]
#[ignore = "two cores do not hold a robot, its peer and other tests in time: cargo test --release --test system ros2 -- --ignored"]
fn f122_grippers_hold_when_their_driver_is_killed() {
    harness::in_real_time(|| {
        let Some(peer) = Peer::start(DOMAINS[1], &[]) else { return };
        let mut rig = rig(DOMAINS[1]);
        rig.start_all();
        let (mut operator, mut observer) = (rig.operator().expect("it answers"), rig.state_observer());
        let client = rig.client(&gripping(1.0), 1);
        client.set_engaged(true);
        engage_until(&mut operator, &mut observer, |robot| {
            robot.grippers.closure[0] > 0.3 && robot.grippers.rate[0] > 0.3
        });
        rig.kill("driver");
        let killed_s = rt::now().0 as f64 * 1e-9;
        outlive_stop();
        let (report, trace) = peer.end();
        assert_sound(&report);
        let moves = |pair: &[Vec<f64>]| closures(&pair[0]) != closures(&pair[1]);
        let last_s = trace.windows(2).rfind(|pair| moves(pair)).expect("they moved")[1][0] - killed_s;
        let end = closures(trace.last().expect("rows"));
        println!("the fingers rested {:.0} ms after kill -9 of the driver, at {end:.3?}", last_s * 1e3);
        assert!(last_s > -0.1 && last_s < REST_WITHIN_S, "at rest {last_s} s after the driver's end");
        assert!(end.iter().all(|one| (0.3..0.9).contains(one)), "{end:?}");
    });
}

#[test]
#[ignore = "two cores do not hold a robot, its peer and other tests in time: cargo test --release --test system ros2 -- --ignored"]
fn f122_robot_without_fingers_may_be_driven_and_says_so() {
    for (more, sentence) in [
        (&[][..], "hand_left_controller: the gripper may be driven"),
        (&["--without-fingers"], "the gripper is not driven: /robot_description has no joint `hand_left_index_joint`"),
        (&["--fault", "second/hand_left_controller"], "another program may send to /hand_left_controller/joint_traj"),
    ] {
        let Some(peer) = Peer::start(DOMAINS[2], more) else { return };
        let (code, [printed, _]) = preflight(&rig(DOMAINS[2]).folder().join("teleop.toml"));
        assert!(
            code == Some(0) && printed.contains(sentence) && printed.contains("tiago_dual may be driven"),
            "{printed}"
        );
        peer.end();
    }
}
