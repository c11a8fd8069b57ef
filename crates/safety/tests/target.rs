//! Targets that jump are told from people who are fast, joint by joint.

use crate::support;

use messages::{JOINTS, LEFT_ARM, TICK_S, TORSO};
use robot::Model;
use safety::monitor::{TargetSteps, far_behind};
use std::sync::LazyLock;
use support::model;

static MODEL: LazyLock<Model> = LazyLock::new(model);
const ELBOW: usize = LEFT_ARM.start + 3;
const ALL: u32 = (1 << JOINTS) - 1;
/// rad/s and m/s; rad and m.
const FASTEST: [(usize, f64); 2] = [(ELBOW, 40.0), (TORSO, 10.0)];
const FAR: [(usize, f64); 2] = [(ELBOW, 0.26), (TORSO, 0.05)];

/// The home posture with one joint so far from its lower limit.
fn posture(joint: usize, above: f64) -> [f64; JOINTS] {
    let mut q = MODEL.home;
    q[joint] = MODEL.limits[joint].q_min + above;
    q
}

/// Whether the second of two targets jumped.
fn jumped([k, then]: [u64; 2], joint: usize, [from, to]: [f64; 2], [mask, then_mask]: [u32; 2]) -> bool {
    let mut steps = TargetSteps::default();
    assert!(!steps.jumped(&MODEL, k, &posture(joint, from), mask), "the first is compared with nothing");
    steps.jumped(&MODEL, then, &posture(joint, to), then_mask)
}

#[test]
fn f034_a_target_jumps_beyond_the_speed_of_people_for_the_time_that_passed() {
    for (joint, fastest) in FASTEST {
        for (ticks, counted) in [(1, 1.0), (7, 7.0), (0, 1.0)] {
            let (within, beyond) = (0.99 * fastest * counted * TICK_S, 1.01 * fastest * counted * TICK_S);
            for (by, is) in [(within, false), (beyond, true)] {
                assert_eq!(jumped([90, 90 + ticks], joint, [0.0, by], [ALL; 2]), is, "joint {joint} up by {by}");
                assert_eq!(jumped([90, 90 + ticks], joint, [by, 0.0], [ALL; 2]), is, "joint {joint} down by {by}");
            }
        }
        // An index that runs back is one tick later.
        assert!(jumped([90, 10], joint, [0.0, 1.01 * fastest * TICK_S], [ALL; 2]));
        // Each is compared with the one before it, not with the first.
        let (mut steps, step) = (TargetSteps::default(), 0.9 * fastest * TICK_S);
        assert!((0..4).all(|n| !steps.jumped(&MODEL, 90 + n, &posture(joint, n as f64 * step), ALL)));
    }
}

#[test]
fn f034_the_speed_of_people_is_met_to_the_bit() {
    // Of the home posture's joints this one is moved from zero, so that nothing is rounded.
    let q = |to: f64| {
        let mut q = MODEL.home;
        q[LEFT_ARM.start + 6] = to;
        q
    };
    for (to, is) in [(40.0 * TICK_S, false), (40.0 * TICK_S + 1e-12, true)] {
        let mut steps = TargetSteps::default();
        steps.jumped(&MODEL, 1, &q(0.0), ALL);
        assert_eq!(steps.jumped(&MODEL, 2, &q(to), ALL), is);
    }
    for (to, is) in [(0.26, false), (0.26 + 1e-12, true)] {
        assert_eq!(far_behind(&MODEL, &q(to), ALL, &q(0.0)), is);
    }
}

#[test]
fn f034_what_is_not_meant_or_cannot_be_reached_is_no_jump() {
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
fn f034_far_behind_is_farther_than_any_tracking_is_off() {
    for (joint, far) in FAR {
        let at = |above| posture(joint, above);
        for (by, is) in [(0.99 * far, false), (1.01 * far, true)] {
            assert_eq!(far_behind(&MODEL, &at(by), ALL, &at(0.0)), is, "joint {joint} by {by}");
            assert_eq!(far_behind(&MODEL, &at(0.0), ALL, &at(by)), is, "joint {joint} by {by}");
        }
        assert!(!far_behind(&MODEL, &at(3.0 * far), ALL & !(1 << joint), &at(0.0)), "it is not meant");
        assert!(far_behind(&MODEL, &at(3.0 * far), 1 << joint, &at(0.0)), "it alone is meant");
        // Where no limit lets it be reached, the limit is where it can be.
        assert!(!far_behind(&MODEL, &at(-9.0), ALL, &at(0.0)));
    }
}
