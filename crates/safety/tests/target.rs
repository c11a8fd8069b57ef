//! Tests that jumps of a target are distinguished from fast people, joint by joint or limb by limb.

use crate::support::{LEFT_ARM, MODEL, TORSO};
use messages::{JOINTS_MAX, LIMBS, TICK_S};
use safety::monitor::{TargetSteps, far_behind};
use std::f64::consts::PI;

const ELBOW: usize = LEFT_ARM.start + 3;
const ALL: u32 = (1 << JOINTS_MAX) - 1;
/// In rad/s and m/s, then in rad and m.
const FASTEST: [(usize, f64); 2] = [(ELBOW, 40.0), (TORSO, 10.0)];
const FAR: [(usize, f64); 2] = [(ELBOW, 0.26), (TORSO, 0.05)];

/// The home posture, with one joint at `above` over its lower limit.
fn posture(joint: usize, above: f64) -> [f64; JOINTS_MAX] {
    let mut q = MODEL.home;
    q[joint] = MODEL.limits[joint].q_min + above;
    q
}

/// Returns true if the second of two targets jumped.
fn jumped([k, then]: [u64; 2], joint: usize, [from, to]: [f64; 2], [mask, then_mask]: [u32; 2]) -> bool {
    let mut steps = TargetSteps::default();
    assert!(!steps.jumped(&MODEL, k, &posture(joint, from), mask, None), "the first is compared with nothing");
    steps.jumped(&MODEL, then, &posture(joint, to), then_mask, None)
}

#[test]
fn f034_target_faster_than_human_speed_is_a_jump() {
    for (joint, fastest) in FASTEST {
        for (ticks, counted) in [(1, 1.0), (7, 7.0), (0, 1.0)] {
            let (within, beyond) = (0.99 * fastest * counted * TICK_S, 1.01 * fastest * counted * TICK_S);
            for (by, is) in [(within, false), (beyond, true)] {
                assert_eq!(jumped([90, 90 + ticks], joint, [0.0, by], [ALL; 2]), is, "joint {joint} up by {by}");
                assert_eq!(jumped([90, 90 + ticks], joint, [by, 0.0], [ALL; 2]), is, "joint {joint} down by {by}");
            }
        }
        // An index that runs back counts as one tick later.
        assert!(jumped([90, 10], joint, [0.0, 1.01 * fastest * TICK_S], [ALL; 2]));
        // Each target is compared with the previous one, not with the first.
        let (mut steps, step) = (TargetSteps::default(), 0.9 * fastest * TICK_S);
        assert!((0..4).all(|n| !steps.jumped(&MODEL, 90 + n, &posture(joint, n as f64 * step), ALL, None)));
    }
}

#[test]
fn f034_human_speed_bound_is_exact_to_the_bit() {
    // This joint of the home posture starts at zero, so that nothing is rounded.
    let q = |to: f64| {
        let mut q = MODEL.home;
        q[LEFT_ARM.start + 6] = to;
        q
    };
    for (to, is) in [(40.0 * TICK_S, false), (40.0 * TICK_S + 1e-12, true)] {
        let mut steps = TargetSteps::default();
        steps.jumped(&MODEL, 1, &q(0.0), ALL, None);
        assert_eq!(steps.jumped(&MODEL, 2, &q(to), ALL, None), is);
    }
    for (to, is) in [(0.26, false), (0.26 + 1e-12, true)] {
        assert_eq!(far_behind(&MODEL, &q(to), ALL, &q(0.0)), is);
    }
}

#[test]
fn f034_invalid_joint_or_target_beyond_limits_is_no_jump() {
    for (joint, _) in FASTEST {
        let (bit, range) = (1 << joint, MODEL.limits[joint].q_max - MODEL.limits[joint].q_min);
        for masks in [[ALL, ALL & !bit], [ALL & !bit, ALL], [ALL & !bit; 2]] {
            assert!(!jumped([1, 2], joint, [0.0, range], masks), "joint {joint} with {masks:?}");
        }
        assert!(jumped([1, 2], joint, [0.0, range], [bit; 2]), "it alone is meant");
        assert!(!jumped([1, 2], joint, [-1.0, -9.0], [ALL; 2]), "both are the lower limit");
        assert!(!jumped([1, 2], joint, [range, range + 9.0], [ALL; 2]), "both are the upper limit");
        assert!(!jumped([1, 2], joint, [0.0, f64::NAN], [ALL; 2]));
    }
}

#[test]
fn f034_robot_is_far_behind_only_beyond_its_bound() {
    for (joint, far) in FAR {
        let at = |above| posture(joint, above);
        for (by, is) in [(0.99 * far, false), (1.01 * far, true)] {
            assert_eq!(far_behind(&MODEL, &at(by), ALL, &at(0.0)), is, "joint {joint} by {by}");
            assert_eq!(far_behind(&MODEL, &at(0.0), ALL, &at(by)), is, "joint {joint} by {by}");
        }
        assert!(!far_behind(&MODEL, &at(3.0 * far), ALL & !(1 << joint), &at(0.0)), "it is not meant");
        assert!(far_behind(&MODEL, &at(3.0 * far), 1 << joint, &at(0.0)), "it alone is meant");
        // If the limits do not let the target be reached, the limit takes its place.
        assert!(!far_behind(&MODEL, &at(-9.0), ALL, &at(0.0)));
    }
}

type LimbsOf = [[f64; 4]; LIMBS];
const NONE: [f64; 4] = [0.0; 4];

/// A limb (x y z w) turned by an angle about some axis.
fn limb(angle: f64) -> [f64; 4] {
    let (sin, cos) = (0.5 * angle).sin_cos();
    [0.6 * sin, 0.0, -0.8 * sin, cos]
}

/// All limbs are still except one.
fn limbs(which: usize, is: [f64; 4]) -> LimbsOf {
    let mut limbs = [limb(0.3); LIMBS];
    limbs[which] = is;
    limbs
}

/// Returns true if the second of two targets jumped. Its elbow joint jumps by `by`.
fn limbs_jumped([k, then]: [u64; 2], by: f64, before: &LimbsOf, now: Option<&LimbsOf>) -> bool {
    let mut steps = TargetSteps::default();
    assert!(!steps.jumped(&MODEL, k, &posture(ELBOW, 0.0), ALL, Some(before)), "the first is compared with nothing");
    steps.jumped(&MODEL, then, &posture(ELBOW, by), ALL, now)
}

#[test]
fn f034_limb_faster_than_human_turn_is_a_jump() {
    for which in 0..LIMBS {
        for (ticks, counted) in [(1, 1.0), (7, 7.0), (0, 1.0)] {
            for from in [-0.7, 0.0, 3.0] {
                for (share, is) in [(0.99, false), (-0.99, false), (1.01, true), (-1.01, true)] {
                    let to = from + share * 40.0 * counted * TICK_S;
                    let (from, to) = (limb(from), limb(to));
                    let jumped =
                        |from, to| limbs_jumped([90, 90 + ticks], 0.0, &limbs(which, from), Some(&limbs(which, to)));
                    assert_eq!(jumped(from, to), is, "limb {which} by {share} in {ticks} ticks");
                    // Both signs are the same rotation.
                    assert_eq!(jumped(from, to.map(|x| -x)), is, "limb {which} by {share}, the other sign");
                }
            }
        }
    }
}

#[test]
fn f034_joints_spinning_about_still_limb_are_no_jump() {
    let still = limbs(0, limb(0.3));
    assert!(!limbs_jumped([1, 2], 2.0, &still, Some(&still)), "the limbs stand");
    // If the limbs are unknown, the joints are compared.
    assert!(limbs_jumped([1, 2], 2.0, &still, None), "only joints are followed now");
    let mut steps = TargetSteps::default();
    steps.jumped(&MODEL, 1, &posture(ELBOW, 0.0), ALL, None);
    assert!(steps.jumped(&MODEL, 2, &posture(ELBOW, 2.0), ALL, Some(&still)), "only joints were followed before");
    // The joints count again once a target is no longer followed by its limbs.
    assert!(!steps.jumped(&MODEL, 3, &posture(ELBOW, 0.0), ALL, Some(&still)));
    assert!(steps.jumped(&MODEL, 4, &posture(ELBOW, 2.0), ALL, None));
}

#[test]
fn f034_half_turn_of_limb_is_a_jump_within_117_ticks() {
    let (from, to) = (limbs(1, limb(0.0)), limbs(1, limb(PI)));
    // Half a turn at 40 rad/s lasts 118 ticks. Nothing is farther away than half a turn.
    for (ticks, is) in [(1, true), (117, true), (118, false), (1000, false), (u64::MAX - 1, false)] {
        assert_eq!(limbs_jumped([1, 1 + ticks], 0.0, &from, Some(&to)), is, "{ticks} ticks");
    }
    for (from, to) in [(NONE, limb(2.0)), (limb(2.0), NONE), (NONE, NONE), (limb(2.0), [f64::NAN; 4])] {
        assert!(!limbs_jumped([1, 2], 2.0, &limbs(2, from), Some(&limbs(2, to))), "{from:?} to {to:?}");
    }
    // Another limb is judged all the same.
    let (mut from, mut to) = (limbs(2, NONE), limbs(2, limb(1.0)));
    (from[3], to[3]) = (limb(0.0), limb(1.0));
    assert!(limbs_jumped([1, 2], 0.0, &from, Some(&to)));
}
