//! The limb trajectory of a target: measured nodes, then extrapolated ones.

use crate::support;

use std::f64::consts::TAU;

use messages::{JointTarget, Skeleton, Stamp, TICK_S, TRAJECTORY_NODE_TICKS, TRAJECTORY_NODES, skeleton_flag};
use nalgebra::{UnitQuaternion, Vector3};
use retarget::{Config, FollowingArms, Limbs, Method, Settings, mirror, rotation_from_xyzw};
use support::{START_NS, layers, robot, weights};

const RATE_HZ: f64 = 60.0;
pub(crate) const DELAY_MS: u64 = 120;
/// Error of an angle in single precision, rad.
const SINGLE: f64 = 2e-3;

pub(crate) fn config(delay_ms: u64) -> Config {
    support::config(Method::ClosedForm, delay_ms as f64)
}

pub(crate) type Person = fn(f64) -> [Limbs; 2];

/// A skeleton of both arms, each as a left one, captured and received at `at_ns`.
pub(crate) fn skeleton(sequence: u64, at_ns: u64, person: &[Limbs; 2]) -> Skeleton {
    support::skeleton_of_limbs(sequence, at_ns, at_ns, person)
}

fn source(person: Person, seconds: f64) -> Vec<Skeleton> {
    source_at(person, seconds, RATE_HZ)
}

pub(crate) fn source_at(person: Person, seconds: f64, rate_hz: f64) -> Vec<Skeleton> {
    (0..(seconds * rate_hz) as u64)
        .map(|i| {
            let t_s = i as f64 / rate_hz;
            skeleton(i + 1, START_NS + (t_s * 1e9) as u64, &person(t_s))
        })
        .collect()
}

/// Targets of all ticks for `seconds`, with their times.
pub(crate) fn run(config: &Config, skeletons: &[Skeleton], seconds: f64) -> Vec<(Stamp, JointTarget)> {
    support::run_every(1, config, skeletons, seconds).into_iter().map(|(now, output)| (now, output.target)).collect()
}

pub(crate) fn turn(axis: Vector3<f64>, angle: f64) -> UnitQuaternion<f64> {
    UnitQuaternion::from_scaled_axis(axis * angle)
}

/// The limbs of node `i`, each arm as a left one.
pub(crate) fn node(target: &JointTarget, i: usize) -> [Option<Limbs>; 2] {
    [0, 1].map(|arm| {
        let limb = |limb: usize| {
            let limb = target.limb_trajectory[i][2 * arm + limb].map(f64::from);
            rotation_from_xyzw(if arm == 0 { limb } else { mirror(limb) })
        };
        limb(0).zip(limb(1)).map(|(upper, fore)| Limbs { upper, fore })
    })
}

pub(crate) fn apart(a: &Limbs, b: &Limbs) -> f64 {
    a.upper.angle_to(&b.upper).max(a.fore.angle_to(&b.fore))
}

/// Both arms move differently, smoothly.
pub(crate) fn swings(t_s: f64) -> [Limbs; 2] {
    let wave = |hz: f64, phase: f64| 0.6 * (TAU * hz * t_s + phase).sin();
    [0.0, 1.3].map(|phase| {
        let upper = turn(Vector3::z(), wave(0.5, phase)) * turn(Vector3::x(), -0.5 + wave(0.4, phase));
        Limbs { upper, fore: upper * turn(Vector3::z(), -0.8 + wave(0.6, phase)) }
    })
}

/// Both arms turn at 1.5 and -1 rad/s without end.
fn turns(t_s: f64) -> [Limbs; 2] {
    [1.5, -1.0].map(|speed| {
        let upper = turn(Vector3::new(0.6, 0.0, 0.8), speed * (t_s - 0.5));
        Limbs { upper, fore: upper * turn(Vector3::z(), -0.8) }
    })
}

pub(crate) fn stands(_: f64) -> [Limbs; 2] {
    swings(0.7)
}

/// Time of the person's posture in node `i` of a target made at `now`, s after the start.
pub(crate) fn shown_s(now: Stamp, target: &JointTarget, i: usize) -> f64 {
    let ticks = (target.trajectory_first + i as u64) * TRAJECTORY_NODE_TICKS - target.k;
    (now.0 - START_NS) as f64 * 1e-9 + ticks as f64 * TICK_S - DELAY_MS as f64 * 1e-3
}

/// Time at which the newest skeleton at `now` was received, s after the start.
pub(crate) fn newest_s(skeletons: &[Skeleton], now: Stamp) -> f64 {
    let newest = skeletons.iter().rev().find(|skeleton| skeleton.received <= now).expect("one");
    (newest.received.0 - START_NS) as f64 * 1e-9
}

#[test]
fn seen_nodes_match_slerp_between_skeletons() {
    let skeletons = source(swings, 3.0);
    let mut looked = 0;
    for (now, target) in &run(&config(DELAY_MS), &skeletons, 2.9)[1500..] {
        let newest_s = newest_s(&skeletons, *now);
        // Nodes lie at whole multiples after the tick.
        let first = target.trajectory_first * TRAJECTORY_NODE_TICKS;
        assert!(first > target.k && first <= target.k + TRAJECTORY_NODE_TICKS, "{first} of tick {}", target.k);
        assert_eq!(target.trajectory_nodes as usize, TRAJECTORY_NODES);
        for i in 0..TRAJECTORY_NODES {
            let t_s = shown_s(*now, target, i);
            // Within a microsecond of the newest skeleton a node may count as either.
            if (t_s - newest_s).abs() > 1e-6 {
                let is_measured = i < target.trajectory_measured as usize;
                assert_eq!(is_measured, t_s < newest_s, "node {i} at {t_s} s of {newest_s} s");
            }
            if t_s < newest_s {
                let frame = (t_s * RATE_HZ).floor();
                let (a, b) = (swings(frame / RATE_HZ), swings((frame + 1.0) / RATE_HZ));
                for (arm, limbs) in node(target, i).into_iter().enumerate() {
                    let want = a[arm].slerp(&b[arm], t_s * RATE_HZ - frame);
                    let off = apart(&limbs.expect("both arms are meant"), &want);
                    assert!(off < SINGLE, "node {i}, arm {arm}: {off} rad");
                }
                looked += 1;
            }
        }
        // 120 ms minus the elapsed part of a period of 16.7 ms: five or six nodes of 20 ms.
        assert!((5..=6).contains(&target.trajectory_measured), "{} nodes seen", target.trajectory_measured);
    }
    assert!(looked > 10_000, "{looked} nodes");
}

#[test]
fn nodes_beyond_newest_skeleton_continue_with_fading_turn() {
    let skeletons = source(turns, 3.0);
    for (now, target) in &run(&config(DELAY_MS), &skeletons, 2.9)[1500..] {
        let newest_s = newest_s(&skeletons, *now);
        for i in target.trajectory_measured as usize..TRAJECTORY_NODES {
            let ahead_s = shown_s(*now, target, i) - newest_s;
            // A turn that fades with 0.1 s goes as far as one at full speed for this time.
            let want = turns(newest_s + 0.1 * (1.0 - (-ahead_s / 0.1).exp()));
            for (arm, limbs) in node(target, i).into_iter().enumerate() {
                let off = apart(&limbs.expect("both arms are meant"), &want[arm]);
                assert!(off < SINGLE, "node {i}, {ahead_s} s ahead, arm {arm}: {off} rad");
            }
        }
        let last = node(target, TRAJECTORY_NODES - 1)[0].expect("it is meant");
        let turned = last.upper.angle_to(&turns(newest_s)[0].upper);
        assert!((0.12..0.15).contains(&turned), "1.5 rad/s for 0.1 s and no farther: {turned} rad");
    }
}

#[test]
fn limb_prediction_is_limited_to_2_rad_after_a_glitch() {
    // 60 rad/s, a glitch: a third of it is continued, 2 rad in all.
    fn glitches(t_s: f64) -> [Limbs; 2] {
        let upper = turn(Vector3::y(), 60.0 * (t_s - 0.5).clamp(0.0, 0.034));
        [Limbs { upper, fore: upper }; 2]
    }
    let skeletons = source(glitches, 0.6);
    let mut farthest = 0.0_f64;
    for (now, target) in run(&config(0), &skeletons, 0.55) {
        let newest = skeletons.iter().rev().find(|skeleton| skeleton.received <= now).expect("one");
        let newest = rotation_from_xyzw(newest.limbs[0].map(f64::from)).expect("a rotation");
        let last = node(&target, TRAJECTORY_NODES - 1)[0].expect("it is meant");
        farthest = farthest.max(last.upper.angle_to(&newest));
    }
    assert!(farthest > 1.8 && farthest <= 2.0 + SINGLE, "{farthest} rad");
}

#[test]
fn arm_that_is_not_valid_has_zero_nodes() {
    let mut skeletons = source(swings, 1.0);
    for skeleton in &mut skeletons {
        skeleton.flags &= !skeleton_flag::LIMB[3];
    }
    for (_, target) in &run(&config(DELAY_MS), &skeletons, 0.9)[600..] {
        assert!(target.limb_trajectory.iter().all(|limbs| limbs[2..] == [[0.0; 4]; 2] && limbs[0] != [0.0; 4]));
        assert!((5..=6).contains(&target.trajectory_measured), "the left arm's alone: {}", target.trajectory_measured);
    }
}

#[test]
fn nodes_after_restart_fade_like_target() {
    // Another writer, elsewhere, after a second: 0.25 s of crossfade.
    let mut skeletons = source(swings, 2.0);
    for (i, seen) in skeletons.iter_mut().enumerate().filter(|(i, _)| *i as f64 >= RATE_HZ) {
        let aside = turn(Vector3::y(), 1.2);
        let elsewhere = stands(0.0).map(|limbs| Limbs { upper: aside * limbs.upper, fore: aside * limbs.fore });
        *seen = skeleton(i as u64 - 50, seen.received.0, &elsewhere);
        seen.header.incarnation = 2;
    }
    let outputs = run(&config(DELAY_MS), &skeletons, 1.6);
    let restart = (RATE_HZ * 25.0) as usize;
    let mut faded = 0;
    for (n, (_, target)) in outputs.iter().enumerate().skip(restart - 30).take(500) {
        for i in 0..TRAJECTORY_NODES {
            // The node equals the limbs that the target shows at the node's time, if no newer skeleton changes it.
            let then = ((target.trajectory_first + i as u64) * TRAJECTORY_NODE_TICKS - target.k) as usize;
            let Some((_, shown)) = outputs.get(n + then).filter(|_| n >= restart) else { continue };
            for (arm, limbs) in node(target, i).into_iter().enumerate() {
                let limb = |limb: usize| {
                    let limb = shown.human_limbs[2 * arm + limb];
                    rotation_from_xyzw(if arm == 0 { limb } else { mirror(limb) }).expect("a rotation")
                };
                let off = apart(&limbs.expect("both are meant"), &Limbs { upper: limb(0), fore: limb(1) });
                assert!(off < 0.01, "{} ticks after the restart, node {i}, arm {arm}: {off} rad", n - restart);
            }
            faded += 1;
        }
    }
    assert!(faded > 5000, "{faded} nodes");
    // The next node does not jump from one target to the next, even at the start of the restart.
    for pair in outputs[300..].windows(2).filter(|pair| pair[0].1.trajectory_first == pair[1].1.trajectory_first) {
        for (before, after) in node(&pair[0].1, 0).into_iter().zip(node(&pair[1].1, 0)) {
            let step = apart(&before.expect("it is meant"), &after.expect("it is meant"));
            assert!(step < 0.05, "the next node moved by {step} rad in a tick");
        }
    }
}

#[test]
fn arm_that_does_not_follow_keeps_home() {
    let person: Person = |t_s| {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.5 * (TAU * 0.5 * t_s).sin());
        [Limbs { upper: turn, fore: turn }; 2]
    };
    let closing = source(person, 2.0).into_iter().map(|mut skeleton| {
        skeleton.flags |= skeleton_flag::CLOSURE[0] | skeleton_flag::CLOSURE[1];
        skeleton.closure = [0.5, 0.25];
        skeleton
    });
    let skeletons: Vec<Skeleton> = closing.collect();
    let robot = robot();
    for side in 0..2 {
        let arms = [FollowingArms::Left, FollowingArms::Right][side];
        let settings = Settings { method: Method::ClosedForm, arms, ..Settings::default() };
        let config = Config::for_arms(&robot, Some(weights(&layers(1, 2, 32))), &settings).expect("a configuration");
        let (_, last) = *run(&config, &skeletons, 2.0).last().expect("targets");
        for arm in 0..2 {
            let valid = robot.joints[arm].iter().flatten().all(|&joint| last.valid_mask & 1 << joint != 0);
            let closes = last.flags & messages::target_flag::CLOSURE[arm] != 0;
            assert_eq!((valid, closes), (arm == side, arm == side), "arm {arm} of {side}");
            let at_home = robot.joints[arm].iter().flatten().all(|&joint| last.q[joint] == robot.home[joint]);
            assert_eq!(at_home, arm != side);
        }
        assert_eq!(last.closure[side], [0.5, 0.25][side]);
        assert_ne!(last.flags & messages::target_flag::INPUT_FRESH, 0, "one arm is enough");
    }
}
