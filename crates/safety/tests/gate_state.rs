//! Tests the gate's reports: the state last sent, the figures of a decision, and the unit of every denial.

use crate::support::motion::{NO_PLAN, T, joint, resting, set_stopping};
use crate::support::{JOINTS, model};
use judge::joint::{Joint, stop_of};
use messages::{JOINTS_MAX, JointMotion, Stamp};
use safety::clearance::clearance;
use safety::engage::Permit;
use safety::gate::{Check, Config, Denial, Proposed, State, Verdict, tick};

/// All joints move, each at its own speed, with the stops from there.
fn moving(model: &robot::Model, k: u64) -> Proposed {
    let mut p = resting(k, model.home);
    for j in 0..JOINTS {
        let l = &model.limits[j];
        let share = 0.02 + 0.01 * j as f64;
        let x = Joint { q: model.home[j], v: -share * l.v_max, a: share * l.a_max };
        set_stopping(&mut p, j, x, l);
    }
    p
}

/// Returns the proposal with positions that are no numbers.
fn nowhere(p: &Proposed) -> Proposed {
    Proposed { motion: JointMotion { q: [f64::NAN; JOINTS_MAX], ..p.motion }, ..*p }
}

fn seeded(p: &Proposed) -> State {
    let mut state = State::at_rest([0.0; JOINTS_MAX]);
    state.reseed(&p.motion);
    state
}

/// Returns `p` one tick later. Every joint continues with zero jerk.
fn going_on(model: &robot::Model, p: &Proposed) -> Proposed {
    let mut next = Proposed { k: p.k + 1, ..*p };
    for j in 0..JOINTS {
        set_stopping(&mut next, j, joint(&p.motion, j).after(0.0, T), &model.limits[j]);
    }
    next
}

#[test]
fn gate_state_matches_last_sent_command() {
    let model = model();
    let config = Config::new(&model).unwrap();
    let seed = moving(&model, 5);
    let mut state = seeded(&seed);
    let is_at = |state: &State, p: &Proposed| {
        let JointMotion { q, v, a, plan } = state.motion();
        for j in 0..JOINTS {
            assert!(
                (q[j] - p.motion.q[j]).abs() < 1e-11
                    && (v[j] - p.motion.v[j]).abs() < 1e-11
                    && (a[j] - p.motion.a[j]).abs() < 1e-11
            );
            for (got, expected) in stop_of(&plan, j).into_iter().zip(stop_of(&p.motion.plan, j)) {
                assert!((got.0 - expected.0).abs() < 1e-11 && (got.1 - expected.1).abs() < 1e-13);
            }
        }
    };
    is_at(&state, &seed);
    let next = going_on(&model, &seed);
    let decision = tick(&config, &mut state, Stamp(0), next);
    assert_eq!((decision.verdict, state.denials()), (Verdict::Accept, 0));
    is_at(&state, &next);
    let mut frames = robot::Frames { base_from_body: [robot::Pose::identity(); JOINTS_MAX + 1] };
    let expected = clearance(&model, &mut frames, &next.motion.q).distance_m;
    assert!((decision.clearance_m - expected).abs() < 1e-12, "of the command, not of where it rests");
}

/// With each denial all joints go on along the stored plan, to its end, and no clearance is measured.
#[test]
fn denial_makes_all_joints_play_stored_plan_together() {
    let model = model();
    let config = Config::new(&model).unwrap();
    let seed = moving(&model, 5);
    let (mut state, next) = (seeded(&seed), going_on(&model, &seed));
    assert!(tick(&config, &mut state, Stamp(0), next).accepted());
    for n in 1..1500 {
        let mut bad = Proposed { k: next.k + n, ..next };
        bad.motion.v[4] = f64::NAN;
        let decision = tick(&config, &mut state, Stamp(0), bad);
        assert_eq!(decision.verdict, Verdict::Deny(Denial::Joint { joint: 4, check: Check::Finite }));
        assert!(!decision.accepted() && decision.clearance_m.is_nan() && state.denials() == n);
        assert_eq!(decision.motion, state.motion());
        for j in 0..JOINTS {
            let stop = stop_of(&next.motion.plan, j);
            let (got, expected) = (joint(&decision.motion, j), joint(&next.motion, j).play(&stop, n as f64 * T));
            assert!(
                (got.q - expected.q).abs() < 1e-11 && (got.v - expected.v).abs() < 1e-10,
                "{n} {j} {got:?} {expected:?}"
            );
            let rest = got.play(&stop_of(&decision.motion.plan, j), 1e3).q;
            assert!((rest - joint(&next.motion, j).play(&stop, 1e3).q).abs() < 1e-10, "{n} {j}");
        }
    }
    assert!(state.motion().is_at_rest());
}

/// The plan is played for all ticks that have passed since the last one.
#[test]
fn late_command_is_denied_and_plan_is_played_on() {
    let model = model();
    let config = Config::new(&model).unwrap();
    let first = moving(&model, 5);
    for late in [2, 3, 40, 400] {
        let mut state = seeded(&first);
        let next = going_on(&model, &first);
        assert!(tick(&config, &mut state, Stamp(0), next).accepted());
        let decision = tick(&config, &mut state, Stamp(0), Proposed { k: next.k + late, ..next });
        assert_eq!(decision.verdict, Verdict::Deny(Denial::Index));
        for j in 0..JOINTS {
            let expected = joint(&next.motion, j).play(&stop_of(&next.motion.plan, j), late as f64 * T);
            assert!((decision.motion.q[j] - expected.q).abs() < 1e-9, "{late}");
            assert!((decision.motion.v[j] - expected.v).abs() < 1e-9, "{late}");
        }
        // An index that has passed plays the plan neither forward nor back.
        let before = state.motion().q;
        let decision = tick(&config, &mut state, Stamp(0), Proposed { k: next.k, ..next });
        assert_eq!((decision.verdict, decision.motion.q), (Verdict::Deny(Denial::Index), before));
    }
}

/// All seventeen joints count. One joint off its plan makes a new motion, and one wrong joint denies all.
#[test]
fn every_single_joint_off_its_plan_denies_all() {
    let model = model();
    let config = Config::new(&model).unwrap();
    let seed = moving(&model, 5);
    for j in 0..JOINTS {
        let mut on_plan = Proposed { k: seed.k + 1, permit: Permit::Stop, ..seed };
        let mut state = seeded(&seed);
        // The command that the gate itself would send is the plan's next point.
        let plan = tick(&config, &mut state.clone(), Stamp(0), nowhere(&on_plan));
        on_plan.motion = plan.motion;
        assert_eq!(tick(&config, &mut state.clone(), Stamp(0), on_plan).verdict, Verdict::OnPlan);
        let mut off = on_plan;
        off.motion.v[j] += 1e-9;
        assert_eq!(tick(&config, &mut state.clone(), Stamp(0), off).verdict, Verdict::Deny(Denial::Permit), "{j}");
        let mut longer = on_plan;
        longer.motion.plan.duration_s[j] = [0.1; 3];
        assert_eq!(tick(&config, &mut state.clone(), Stamp(0), longer).verdict, Verdict::Deny(Denial::Permit), "{j}");
        let mut wrong = going_on(&model, &seed);
        wrong.motion.v[j] += 1e-9;
        let decision = tick(&config, &mut state, Stamp(0), wrong);
        assert_eq!(decision.verdict, Verdict::Deny(Denial::Joint { joint: j, check: Check::Step }));
        assert_eq!((decision.motion.q, decision.motion.v), (plan.motion.q, plan.motion.v), "joint {j} denies all");
    }
}

/// A seed that does not come to rest is refused as a whole, for any joint. The place of rest need not be home.
#[test]
fn seed_with_one_invalid_joint_is_refused_as_a_whole() {
    let model = model();
    let config = Config::new(&model).unwrap();
    let seed = moving(&model, 5);
    for j in 0..JOINTS {
        let mut state = seeded(&seed);
        let mut endless = seed;
        endless.motion.plan.duration_s[j] = [0.0; 3];
        state.reseed(&endless.motion);
        let next = going_on(&model, &seed);
        assert_eq!(tick(&config, &mut state, Stamp(0), next).verdict, Verdict::Deny(Denial::Seed), "{j}");
    }
    let mut nowhere = model.home;
    nowhere[7] = f64::NAN;
    let mut state = State::at_rest(nowhere);
    assert_eq!(
        (state.motion().q[7], state.motion().q[0], state.motion().plan),
        (0.0, State::at_rest(model.home).motion().q[0], NO_PLAN)
    );
    let resting = resting(1, state.motion().q);
    let verdict = tick(&config, &mut state, Stamp(0), resting).verdict;
    assert_eq!(verdict, Verdict::Deny(Denial::Seed), "nothing passes before a position that is one");
}

/// The recovery step that moves only joint `j`, from rest at `q` with `jerk`, and the place where its stop rests.
fn recovery(model: &robot::Model, q: [f64; JOINTS_MAX], j: usize, jerk: f64) -> (Proposed, [f64; JOINTS_MAX]) {
    let (mut next, mut rest) = (Proposed { permit: Permit::Recover, ..resting(1, q) }, q);
    let to = Joint { q: q[j], v: 0.0, a: 0.0 }.after(jerk, T);
    let stop = set_stopping(&mut next, j, to, &model.limits[j]);
    rest[j] = to.play(&stop, 1e3).q;
    (next, rest)
}

/// A recovery that begins too close may leave the least clearance as it is, and may not reduce it. So a joint
/// that does not affect it may move.
#[test]
fn recovery_that_reduces_least_clearance_is_denied() {
    let model = model();
    let config = Config::new(&model).unwrap();
    let mut frames = robot::Frames { base_from_body: [robot::Pose::identity(); JOINTS_MAX + 1] };
    let mut distance = |q: &[f64; JOINTS_MAX]| clearance(&model, &mut frames, q).distance_m;
    let (mut left, mut closed) = (0, 0);
    for (j, step) in (3..JOINTS).flat_map(|j| (-100..100).map(move |step| (j, step))) {
        let (mut q, l) = (model.home, &model.limits[j]);
        q[j] += f64::from(step) * 0.02;
        let least = distance(&q);
        if q[j] <= l.q_min || q[j] >= l.q_max || !(0.001..model.d_min_m - 0.001).contains(&least) {
            continue;
        }
        for (joint, jerk) in [(2, 10.0), (j, l.j_max / 2.0), (j, -l.j_max / 2.0)] {
            let (next, rest) = recovery(&model, q, joint, jerk);
            let verdict = tick(&config, &mut State::at_rest(q), Stamp(0), next).verdict;
            let after = distance(&next.motion.q).min(distance(&rest));
            if after == least {
                assert_eq!(verdict, Verdict::Accept);
                left += 1;
            } else if after < least - 1e-9 {
                let denied = matches!(
                    verdict,
                    Verdict::Deny(
                        Denial::ClearanceAtCommand { .. }
                            | Denial::ClearanceAtRest { .. }
                            | Denial::ClearanceOnTheWay { .. }
                    )
                );
                assert!(denied, "{verdict:?}: {after} m after {least} m");
                closed += 1;
            }
        }
    }
    assert!(left > 0 && closed > 0, "some posture is too close, and not by the head: {left}, {closed}");
}

/// A value for a joint that the robot does not have denies the command.
#[test]
fn joint_that_the_robot_lacks_takes_no_value() {
    type Break = fn(&mut Proposed);
    let cases: [Break; 6] = [
        |p| p.motion.q[JOINTS] = 0.1,
        |p| p.motion.v[JOINTS] = 0.1,
        |p| p.motion.a[JOINTS] = -0.1,
        |p| p.motion.plan.jerk[JOINTS][2] = 1.0,
        |p| p.motion.plan.duration_s[JOINTS][0] = 0.1,
        |p| p.motion.q[JOINTS] = f64::NAN,
    ];
    let model = model();
    let config = Config::new(&model).unwrap();
    for (n, break_it) in cases.into_iter().enumerate() {
        let seed = moving(&model, 0);
        let mut state = seeded(&seed);
        let mut next = going_on(&model, &seed);
        break_it(&mut next);
        let decision = tick(&config, &mut state, Stamp(0), next);
        let expected = Verdict::Deny(Denial::Joint { joint: JOINTS, check: Check::Absent });
        assert_eq!(decision.verdict, expected, "case {n}");
        assert_eq!(
            (decision.motion.q[JOINTS], decision.motion.v[JOINTS], decision.motion.a[JOINTS]),
            (0.0, 0.0, 0.0),
            "case {n}"
        );
    }
}
