//! Tests which commands of a recovery the gate accepts: only slow ones that lead inward and apart.

use crate::support::motion::{T, joint, resting, set_stopping};
use crate::support::{JOINTS, LEFT_ARM, model};
use judge::joint::Joint;
use messages::{JOINTS_MAX, Stamp};
use robot::{Frames, Model};
use safety::engage::Permit;
use safety::gate::{Check, Config, Denial, Proposed, State, Verdict, tick};
use safety::monitor;

const J: usize = 6;
const JERK: f64 = 50.0;

/// A tick with jerk `j` of joint `joint` from `x`, under `permit`.
fn step(model: &Model, q: &[f64; JOINTS_MAX], joint: usize, x: Joint, j: f64, permit: Permit) -> Proposed {
    let mut proposed = Proposed { permit, ..resting(1, *q) };
    set_stopping(&mut proposed, joint, x.after(j, T), &model.limits[joint]);
    proposed
}

fn verdict(model: &Model, q: &[f64; JOINTS_MAX], proposed: Proposed) -> Verdict {
    let config = Config::new(model).expect("the gate");
    tick(&config, &mut State::at_rest(*q), Stamp(1), proposed).verdict
}

#[test]
fn joint_outside_limits_may_only_move_inward() {
    let model = model();
    for (limit, side) in [(model.limits[J].q_max, 1.0), (model.limits[J].q_min, -1.0)] {
        let mut q = model.home;
        q[J] = limit + side * 0.01;
        let x = Joint { q: q[J], v: 0.0, a: 0.0 };
        let judged = |j: f64, permit| verdict(&model, &q, step(&model, &q, J, x, side * j, permit));
        assert_eq!(judged(-JERK, Permit::Recover), Verdict::Accept);
        let outside = Denial::Joint { joint: J, check: Check::Position };
        assert_eq!(judged(JERK, Permit::Recover), Verdict::Deny(outside), "outward");
        // This is 4.9e-11 rad, which would pass within the slack of every other check.
        assert_eq!(judged(1.0, Permit::Recover), Verdict::Deny(outside), "outward by rounding");
        let follow = Permit::Follow { speed_scale: 1.0 };
        assert_eq!(judged(-JERK, follow), Verdict::Deny(outside), "inward, but nobody recovers");
        assert_eq!(judged(-JERK, Permit::Stop), Verdict::Deny(Denial::Permit));
    }
}

#[test]
fn recovery_faster_than_its_speed_is_denied_for_every_joint() {
    let model = model();
    let config = Config::new(&model).expect("the gate");
    for j in 0..JOINTS {
        let bound = if model.prismatic[j] { 0.01 } else { 0.1 };
        let mut state = State::at_rest(model.home);
        let (mut x, mut fastest, mut denied) = (Joint { q: model.home[j], v: 0.0, a: 0.0 }, 0.0_f64, None);
        for k in 1..1000 {
            // Moves towards the farther limit, with a tenth of the jerk limit, until the gate denies it.
            let away = model.limits[j].q_max - model.home[j] > model.home[j] - model.limits[j].q_min;
            let jerk = if away { 0.1 } else { -0.1 } * model.limits[j].j_max;
            let jerk = if x.a.abs() > 0.1 * model.limits[j].a_max { 0.0 } else { jerk };
            let proposed = Proposed { k, ..step(&model, &model.home, j, x, jerk, Permit::Recover) };
            let decision = tick(&config, &mut state, Stamp(k), proposed);
            if let Verdict::Deny(denial) = decision.verdict {
                denied = Some(denial);
                break;
            }
            x = joint(&decision.motion, j);
            fastest = fastest.max(x.v.abs());
        }
        let speed =
            matches!(denied, Some(Denial::Joint { joint, check: Check::Velocity | Check::PlanLimits }) if joint == j);
        let clear = matches!(denied, Some(Denial::ClearanceAtCommand { .. } | Denial::ClearanceAtRest { .. }));
        assert!(speed || clear, "joint {j}: {denied:?}");
        assert!(fastest <= bound + 1e-9, "joint {j} at {fastest}");
        assert!(clear || fastest > 0.8 * bound, "joint {j}: denied at {fastest} already");
    }
}

#[test]
fn pair_that_is_too_close_may_only_be_opened() {
    let model = model();
    let mut frames = Frames::default();
    let mut least = |q: &[f64; JOINTS_MAX]| monitor::measured_clearance(&model, &mut frames, q).distance_m;
    // Moves both hands towards the middle until a pair is too close.
    let mut q = model.home;
    let mut joint = None;
    'search: for j in LEFT_ARM.rev() {
        for side in [1.0, -1.0] {
            q = model.home;
            while model.limits[j].contains(q[j]) && least(&q) >= model.d_min_m - 2e-3 {
                q[j] += side * 1e-3;
            }
            if model.limits[j].contains(q[j]) {
                joint = Some((j, side));
                break 'search;
            }
        }
    }
    let (j, closer) = joint.expect("some joint of the arm leads into the robot");
    let x = Joint { q: q[j], v: 0.0, a: 0.0 };
    let judged = |jerk: f64, permit| verdict(&model, &q, step(&model, &q, j, x, jerk, permit));
    assert_eq!(judged(-closer * JERK, Permit::Recover), Verdict::Accept, "apart");
    let closing = judged(closer * JERK, Permit::Recover);
    assert!(matches!(closing, Verdict::Deny(Denial::ClearanceAtCommand { .. })), "{closing:?}");
    let follow = judged(-closer * JERK, Permit::Follow { speed_scale: 1.0 });
    assert!(matches!(follow, Verdict::Deny(Denial::ClearanceAtCommand { .. })), "{follow:?}");
    assert_eq!(verdict(&model, &q, resting(1, q)), Verdict::OnPlan, "it may rest");
}
