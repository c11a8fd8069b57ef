//! Tests that no motion needs more than its share of the effort limits. Every plan is sampled with the
//! dynamics of the simulated robot, which share no code with this crate.

use crate::support::{JOINTS, shipped, towards};
use messages::{ALL_JOINTS, JOINTS_MAX, PayloadRefusal, Stamp};
use plant::Links;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use robot::{Model, Payload};
use wbc::torque::SHARE;
use wbc::{
    Config, Input, JointMotion, Options, Parts, Permit, PlannedMotion, State, certify_torque, overloaded_at_rest, tick,
};

/// One value for each joint: rad or m, or N m or N.
type PerJoint = [f64; JOINTS_MAX];

/// Time between two samples of a plan, s.
const STEP_S: f64 = 2e-3;

/// The links with this payload in both hands, by another reader.
fn links(model: &Model, mass_kg: f64) -> Links {
    let texts = &model.texts;
    let (toml, urdf) = ((&*texts.toml_name, &*texts.toml), (&*texts.urdf_name, &*texts.urdf));
    Links::from_text(toml, urdf, [Some(mass_kg); 2]).expect("the shipped robot")
}

/// The largest ratio of a torque to its effort limit, with its joint.
fn share(model: &Model, links: &Links, q: &PerJoint, v: &PerJoint, a: &PerJoint) -> (f64, usize) {
    let torques = links.torques(q, v, a);
    let shares = torques.iter().zip(&model.limits).map(|(torque, limits)| torque.abs() / limits.effort_max);
    shares.enumerate().fold((0.0, 0), |most, (j, share)| if share > most.0 { (share, j) } else { most })
}

/// The largest ratio on the way of a plan.
fn share_of_plan(model: &Model, links: &Links, planned: &JointMotion) -> f64 {
    let mut most = 0.0_f64;
    for n in 0..400 {
        let later = planned.advanced(f64::from(n) * STEP_S);
        most = most.max(share(model, links, &later.q, &later.v, &later.a).0);
        if later.is_at_rest() {
            return most;
        }
    }
    panic!("a plan longer than 0.8 s");
}

/// With empty hands, and with a payload of the robot file.
#[test]
fn torques_match_another_implementation() {
    let model = shipped();
    for mass_kg in [0.0, 0.7] {
        let links = links(&model, mass_kg);
        let mut laden = model.clone();
        laden.payload = payloads(&model, mass_kg).map(Some);
        let config = Config::new(&laden, Options::default()).unwrap();
        let mut rng = Pcg64::seed_from_u64(1);
        for _ in 0..1000 {
            let q = posture(&model, &mut rng);
            let mut within = |most: f64| std::array::from_fn(|_| rng.random_range(-most..most));
            let (v, a) = (within(2.0), within(10.0));
            let ours = wbc::torques(&config, &q, &v, &a).unwrap();
            let theirs = links.torques(&q, &v, &a);
            for j in 0..JOINTS {
                assert!((ours[j] - theirs[j]).abs() < 1e-9, "{}: {} {}", model.joint_names[j], ours[j], theirs[j]);
            }
        }
    }
}

/// A posture anywhere within the limits.
fn posture(model: &Model, rng: &mut Pcg64) -> PerJoint {
    let within = |j: usize, rng: &mut Pcg64| rng.random_range(model.limits[j].q_min..model.limits[j].q_max);
    std::array::from_fn(|j| if j < model.count { within(j, rng) } else { 0.0 })
}

/// Result of following postures that jump.
#[derive(Debug, Default)]
struct Run {
    executed: f64,
    planned: f64,
    ticks: u32,
    refused: u32,
    fresh: u32,
    reached: u32,
    longest_s: f64,
}

/// The same payload in the form that the stage uses.
fn payloads(model: &Model, mass_kg: f64) -> [Payload; 2] {
    model.payload.map(|hand| Payload { mass_kg, ..hand.expect("a centre in the robot file") })
}

/// Follows postures anywhere within the limits or stretched out, each until it is reached or for a moment.
/// The hands really carry `true_kg`, and the stage uses `reported_kg`.
fn follow_laden(model: &Model, options: Options, goals: u32, (true_kg, reported_kg): (f64, f64)) -> Run {
    let links = links(model, true_kg);
    let config = Config::new(model, options).unwrap();
    let mut state = State::at_rest(&config, model.home);
    assert_eq!(state.carry(&config, &payloads(model, reported_kg)), Ok(None), "home can be held");
    let mut rng = Pcg64::seed_from_u64(62);
    let mut run = Run::default();
    for goal in 0..goals {
        let stretched = goal % 3 == 0;
        let q: PerJoint = std::array::from_fn(|j| {
            let l = &model.limits[j];
            if j >= model.count {
                return 0.0;
            }
            let any = rng.random_range(l.q_min..l.q_max);
            if stretched && j >= 3 && (j - 3) % 7 > 2 { 0.0 } else { any }
        });
        let mut on_target = false;
        for _ in 0..rng.random_range(150..900) {
            run.ticks += 1;
            let out = tick(&config, &mut state, Stamp(0), towards(u64::from(run.ticks), &q));
            run.refused += u32::from(out.overloads > 0);
            run.fresh += u32::from(out.on_plan != ALL_JOINTS);
            run.executed = run.executed.max(share(model, &links, &out.motion.q, &out.motion.v, &out.motion.a).0);
            on_target |= out.on_target;
            let lengths = out.motion.plan.duration_s.iter().map(|phases| phases.iter().sum());
            run.longest_s = lengths.fold(run.longest_s, f64::max);
            if run.ticks % 40 == 0 {
                run.planned = run.planned.max(share_of_plan(model, &links, state.planned()));
            }
        }
        run.reached += u32::from(on_target);
    }
    println!("{run:?}");
    run
}

fn follow(model: &Model, options: Options, goals: u32) -> Run {
    follow_laden(model, options, goals, (0.0, 0.0))
}

#[test]
fn plans_keep_torque_within_share() {
    let model = shipped();
    let run = follow(&model, Options::default(), 60);
    assert!(run.executed <= SHARE + 1e-9 && run.planned <= SHARE + 1e-9, "{run:?}");
    assert!(run.planned > 0.8 * SHARE, "the limits were never near: {run:?}");
    assert!(run.longest_s <= model.stop_time_max_s + 1e-9, "{run:?}");
    // A refused motion costs a tick of braking. Few are refused.
    assert!(run.refused * 100 < run.ticks, "{run:?}");
}

#[test]
fn plans_without_torque_proof_overload_motors() {
    let model = shipped();
    let run = follow(&model, Options::without_torque_for_tests(), 20);
    assert!(run.planned > 1.0, "{run:?}");
}

/// The shipped robot with so much more mass in its hands that it cannot hold them out.
fn laden(model: &Model, mass_kg: f64) -> Config {
    let mut parts = Parts::from_model(model).unwrap();
    for body in [10, 17] {
        parts.masses[body].mass_kg += mass_kg;
    }
    Config::from_parts(parts, Options::default()).unwrap()
}

/// The arms reach out to the sides, level.
fn stretched(model: &Model) -> PerJoint {
    let mut q = model.home;
    for arm in [3, 10] {
        q[arm..arm + 7].copy_from_slice(&[0.3, 0.0, 1.57, 0.2, 0.0, 0.0, 0.0]);
    }
    q
}

/// With empty hands every posture can be held. A posture that cannot be held is reported with its joint.
#[test]
fn overloaded_posture_is_reported_with_its_joint() {
    let model = shipped();
    let config = Config::new(&model, Options::default()).unwrap();
    let mut rng = Pcg64::seed_from_u64(5);
    let mut most = 0.0_f64;
    for _ in 0..20_000 {
        let q: PerJoint = posture(&model, &mut rng);
        assert_eq!(overloaded_at_rest(&config, &q), None, "{q:?}");
        let torques = wbc::torques(&config, &q, &[0.0; JOINTS_MAX], &[0.0; JOINTS_MAX]).unwrap();
        let shares = torques.iter().zip(&model.limits).map(|(torque, limits)| torque.abs() / limits.effort_max);
        most = shares.fold(most, f64::max);
    }
    println!("largest share of gravity alone: {most}");
    let (joint, torque, limit) = overloaded_at_rest(&laden(&model, 3.0), &stretched(&model)).expect("too heavy");
    assert_eq!(joint, 4, "the second joint of an arm lifts it");
    assert!(torque.abs() > limit && (limit - SHARE * 43.0).abs() < 1e-12, "{torque} {limit}");
}

/// If the robot's posture cannot be held, the stage takes no decision, not even to recover.
#[test]
fn overloaded_robot_is_not_moved() {
    let model = shipped();
    let config = laden(&model, 3.0);
    let start = stretched(&model);
    for permit in [Permit::Follow { speed_scale: 1.0 }, Permit::Recover] {
        let mut state = State::at_rest(&config, start);
        for k in 0..300 {
            let out = tick(&config, &mut state, Stamp(0), Input { permit, ..towards(k, &model.home) });
            assert_eq!(out.motion.q[3..], start[3..], "{permit:?}");
        }
    }
}

#[test]
fn plan_with_too_much_torque_is_not_certified() {
    let model = shipped();
    let config = Config::new(&model, Options::default()).unwrap();
    let bounds = &config.bounds()[4];
    let mut planned = JointMotion::rest(stretched(&model));
    assert_eq!(certify_torque(&config, &planned).blamed, None);
    // The joint moves down at half the speed, and then stops as sharply as the limits allow.
    let x = wbc::JointState { q: planned.q[4], v: 1.0, a: 0.0 };
    planned.set_joint(4, x, wbc::JointStop::new(x.v, x.a, bounds.a_max, bounds.j_max));
    let down = certify_torque(&config, &planned).blamed;
    planned.set_joint(4, x, wbc::JointStop::new(x.v, x.a, 0.3 * bounds.a_max, bounds.j_max));
    let gently = certify_torque(&config, &planned).blamed;
    let x = wbc::JointState { v: -1.0, ..x };
    planned.set_joint(4, x, wbc::JointStop::new(x.v, x.a, bounds.a_max, bounds.j_max));
    let up = certify_torque(&config, &planned).blamed;
    assert_eq!((down, gently, up), (Some(4), None, None));
}

#[test]
fn reported_payload_keeps_torque_within_share() {
    let model = shipped();
    let run = follow_laden(&model, Options::default(), 40, (0.5, 0.5));
    assert!(run.executed <= SHARE + 1e-9 && run.planned <= SHARE + 1e-9, "{run:?}");
    assert!(run.planned > 0.8 * SHARE, "the limits were never near: {run:?}");
    assert!(run.longest_s <= model.stop_time_max_s + 1e-9, "{run:?}");
    assert!(run.fresh * 10 > run.ticks * 9 && run.refused * 10 < run.ticks, "it hardly moves: {run:?}");
}

#[test]
fn unreported_payload_overloads_motors() {
    let model = shipped();
    let run = follow_laden(&model, Options::default(), 20, (1.0, 0.0));
    assert!(run.planned > 1.0, "{run:?}");
}

/// A payload set at run time has the same effect as one in the robot file: the same torques, and the same
/// decisions bit by bit.
#[test]
fn payload_set_at_run_time_acts_like_one_in_robot_file() {
    let model = shipped();
    let payload = payloads(&model, 0.7);
    let mut laden = model.clone();
    laden.payload = payload.map(Some);
    let configs = [&model, &laden].map(|model| Config::new(model, Options::default()).unwrap());
    let mut states = configs.each_ref().map(|config| State::at_rest(config, model.home));
    states[0].carry(&configs[0], &payload).unwrap();
    assert_eq!(states[0].payload(), states[1].payload());
    let mut rng = Pcg64::seed_from_u64(9);
    let mut overloads = 0;
    for _ in 0..1000 {
        let q = posture(&model, &mut rng);
        let over = overloaded_at_rest(&configs[1], &q);
        assert_eq!(states[0].overloaded_at_rest(&configs[0], &q), over);
        overloads += u32::from(over.is_some());
    }
    assert!(overloads > 0, "some postures are too much for 0.7 kg");
    for k in 0..3_000 {
        let q: PerJoint = std::array::from_fn(|j| model.limits[j].q_max * f64::from(u8::from(k % 900 < 450)));
        let [run_time, file] = std::array::from_fn(|i| tick(&configs[i], &mut states[i], Stamp(0), towards(k, &q)));
        assert_eq!(run_time, file, "tick {k}");
    }
}

#[test]
fn payload_of_1_kg_overloads_joint_of_stretched_arm() {
    let model = shipped();
    let config = Config::new(&model, Options::default()).unwrap();
    let [left, right] = payloads(&model, 1.0);
    for (payload, joint) in [([left, Payload::EMPTY], 4), ([Payload::EMPTY, right], 11)] {
        let mut state = State::at_rest(&config, stretched(&model));
        assert_eq!(state.carry(&config, &payload), Ok(Some(joint)));
        assert_eq!(state.payload(), payload, "it is in the hand all the same");
        assert_eq!(state.overloaded_at_rest(&config, &stretched(&model)).map(|over| over.0), Some(joint));
        let mut at_home = State::at_rest(&config, model.home);
        assert_eq!(at_home.carry(&config, &payload), Ok(None));
        let over = at_home.overloaded_at_rest(&config, &stretched(&model)).expect("too heavy");
        assert_eq!(over.0, joint);
    }
}

#[test]
fn payload_is_refused_in_motion() {
    let model = shipped();
    let config = Config::new(&model, Options::default()).unwrap();
    let mut state = State::at_rest(&config, model.home);
    let out = stretched(&model);
    for (k, permit) in (0..).zip([Permit::Follow { speed_scale: 1.0 }, Permit::Stop].iter().flat_map(|p| [*p; 20])) {
        tick(&config, &mut state, Stamp(0), Input { permit, ..towards(k, &out) });
        let at_rest = state.planned().is_at_rest();
        let refused = state.carry(&config, &payloads(&model, 0.1)) == Err(PayloadRefusal::Moving);
        assert_eq!(refused, !at_rest, "tick {k}");
        assert!(!at_rest || k > 20, "it moves");
    }
}
