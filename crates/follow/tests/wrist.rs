//! Wrists keep hands away from the robot, in time, and only there.

use crate::support::{FIRST, FREE, Robot, arm, distance_m, model};
use follow::arm::{ArmVector, Limbs};
use follow::{LIMB_JOINTS, Weights};
use messages::{HAND_NODES, JOINTS_MAX, TICK_HZ, TICK_S, TRAJECTORY_NODE_TICKS};
use nalgebra::{Rotation3, UnitQuaternion};
use robot::{Frames, Model};
use std::f64::consts::FRAC_PI_2;

/// Hanging arms with slightly bent elbows.
const HANGING: [f64; LIMB_JOINTS] = [0.0, 1.5, FRAC_PI_2, 0.1, 0.0];

/// Smallest distance between a hand and any part outside its wrist, m.
fn hands_clear_m(model: &Model, q: &[f64; JOINTS_MAX]) -> f64 {
    let mut frames = Frames::default();
    model.forward(q, &mut frames);
    let is_hand = |capsule: usize| {
        FIRST.iter().any(|first| model.capsules[capsule].body > first + LIMB_JOINTS)
            && model.capsules[capsule].name.starts_with("hand")
    };
    let pairs = model.pairs.iter().filter(|pair| is_hand(pair.a) != is_hand(pair.b));
    pairs.map(|pair| distance_m(model, &frames, pair)).fold(f64::INFINITY, f64::min)
}

fn wrists(q: &[f64; JOINTS_MAX]) -> [f64; 4] {
    [FIRST[0] + 5, FIRST[0] + 6, FIRST[1] + 5, FIRST[1] + 6].map(|j| q[j])
}

fn with_wrists(q: &[f64; JOINTS_MAX], positions: &[f64; 4]) -> [f64; JOINTS_MAX] {
    let mut q = *q;
    for (j, position) in FIRST.iter().flat_map(|first| [first + 5, first + 6]).zip(positions) {
        q[j] = *position;
    }
    q
}

fn person(q: [f64; LIMB_JOINTS]) -> [Limbs; 2] {
    [arm().limbs(&ArmVector::from(q)); 2]
}

/// Hands of a person at `q`, whose wrists are bent as these joints of the robot.
fn hands(model: &Model, q: [f64; LIMB_JOINTS], wanted: &[f64; 4]) -> [[f32; 4]; 2] {
    [0, 1].map(|side| {
        let (_, fore) = model.arms[side].limb_rotations(&q);
        let hand = fore * model.wrists[side].rotation([wanted[2 * side], wanted[2 * side + 1], 0.0]);
        let hand = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(hand));
        hand.coords.data.0[0].map(|x| x as f32)
    })
}

/// Returns how far the left wrist is from `wanted` after each tick of a swing, and how fast it moves, while `known` nodes of
/// the hand are known. The swing is slower than the joint's limits.
fn swing_off(known: usize) -> f64 {
    let (model, mut robot) = (model(), Robot::at(&FREE, Weights::default()));
    let wanted = |k: u64| [0.3 * (3.0 * k as f64 * TICK_S).sin(), 0.0, 0.0, 0.0];
    let mut most = 0.0_f64;
    for n in 0..2 * TICK_HZ {
        let first = robot.next_first();
        let at = |i: usize| (first + i.min(known) as u64) * TRAJECTORY_NODE_TICKS;
        robot.hands = std::array::from_fn(|i| hands(&model, FREE, &wanted(at(i))));
        robot.step(|_| person(FREE));
        if n > TICK_HZ / 2 {
            most = most.max((wrists(&robot.q)[0] - wanted(robot.k)[0]).abs());
        }
    }
    most
}

#[test]
fn wrist_is_there_when_the_hand_is() {
    let (blind, seeing) = (swing_off(0), swing_off(HAND_NODES));
    println!("{seeing:.4} rad off, {blind:.4} if only the first node is known");
    assert!(seeing < 0.02 && blind > 1.5 * seeing, "{seeing} {blind}");
}

#[test]
fn wrist_turns_hanging_hand_away_and_returns_home_when_raised() {
    let model = model();
    let mut robot = Robot::solid(&FREE, Weights::default());
    robot.propose(&HANGING);
    let (mut least_m, mut at_home_m) = (f64::INFINITY, f64::INFINITY);
    for _ in 0..3 * TICK_HZ {
        let before = wrists(&robot.q);
        robot.step(|_| person(HANGING));
        for (j, (now, before)) in wrists(&robot.q).into_iter().zip(before).enumerate() {
            let most = 0.98 * model.limits[FIRST[0] + 5].v_max * 10.0 * TICK_S;
            assert!((now - before).abs() <= most + 1e-12, "wrist {j} moved {} at once", now - before);
        }
        least_m = least_m.min(hands_clear_m(&model, &robot.q));
        at_home_m = at_home_m.min(hands_clear_m(&model, &with_wrists(&robot.q, &wrists(&model.home))));
    }
    println!("hands {:.1} mm clear on the way down, {:.1} mm with wrists at home", least_m * 1e3, at_home_m * 1e3);
    assert!(at_home_m < 0.025, "the posture needs no wrist: {at_home_m}");
    assert!(least_m > at_home_m + 0.02 && least_m > 0.03, "{least_m} m with wrists, {at_home_m} m without");
    robot.propose(&FREE);
    for _ in 0..3 * TICK_HZ {
        robot.step(|_| person(FREE));
    }
    for (now, home) in wrists(&robot.q).into_iter().zip(wrists(&model.home)) {
        assert!((now - home).abs() < 0.02, "{now}, home is {home}");
    }
}

#[test]
fn wrist_follows_hand_of_person_and_keeps_it_clear() {
    let model = model();
    let mut robot = Robot::solid(&FREE, Weights::default());
    let wanted = [-0.4, -0.3, -0.4, -0.3];
    robot.hands = [hands(&model, FREE, &wanted); HAND_NODES];
    for _ in 0..TICK_HZ {
        robot.step(|_| person(FREE));
    }
    for (now, wanted) in wrists(&robot.q).into_iter().zip(wanted) {
        assert!((now - wanted).abs() < 1e-3, "{now}, the person asks for {wanted}");
    }
    // On the way down the hands turn away from the base instead of as the person's.
    robot.propose(&HANGING);
    robot.hands = [hands(&model, HANGING, &wanted); HAND_NODES];
    let (mut least_m, mut asked_m) = (f64::INFINITY, f64::INFINITY);
    for _ in 0..3 * TICK_HZ {
        robot.step(|_| person(HANGING));
        least_m = least_m.min(hands_clear_m(&model, &robot.q));
        asked_m = asked_m.min(hands_clear_m(&model, &with_wrists(&robot.q, &wanted)));
    }
    println!("hands {:.1} mm clear, {:.1} mm as the person asks", least_m * 1e3, asked_m * 1e3);
    assert!(least_m > asked_m + 0.01, "{least_m} m, {asked_m} m as the person asks");
}
