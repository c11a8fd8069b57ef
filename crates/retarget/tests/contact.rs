//! Hands that touch: their limbs, and the limbs of hands that touch nothing.

use crate::support::{ROBOTS, START_NS, robot, shipped};
use messages::{SMPL_JOINTS, Smpl, TRAJECTORY_NODES};
use nalgebra::{UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use retarget::contact::{Correction, Memory, PersonGeometry, Proportions};
use retarget::{ARM_Q, ArmModel, Config, Limbs, Method, Settings};
use robot::limbs::place_on_side;

/// Lengths of the person's arms, shoulder to elbow and elbow to wrist, and half of the distance of the shoulders, m.
const UPPER_M: f64 = 0.3;
const FORE_M: f64 = 0.25;
const SHOULDER_M: f64 = 0.18;

/// Standard deviation of a tracker's joints, m.
const NOISE_M: f64 = 0.005;

/// The frame of a person whose torso leans and faces anywhere, as positions. `limbs`: of both arms, as left arms.
fn person(limbs: &[Limbs; 2], torso: &UnitQuaternion<f64>) -> [[f32; 3]; SMPL_JOINTS] {
    let mut positions = [[0.0; 3]; SMPL_JOINTS];
    let mut set = |joint: Smpl, at: Vector3<f64>| {
        positions[joint as usize] = (Vector3::new(1.0, 2.0, 1.4) + torso * at).cast::<f32>().into();
    };
    for (side, joints) in [
        [Smpl::LeftShoulder, Smpl::LeftElbow, Smpl::LeftWrist],
        [Smpl::RightShoulder, Smpl::RightElbow, Smpl::RightWrist],
    ]
    .into_iter()
    .enumerate()
    {
        let shoulder = Vector3::y() * SHOULDER_M;
        let elbow = shoulder + limbs[side].upper * Vector3::y() * UPPER_M;
        let places = [shoulder, elbow, elbow + limbs[side].fore * Vector3::y() * FORE_M];
        joints.into_iter().zip(places).for_each(|(joint, at)| set(joint, place_on_side(side, at)));
    }
    set(Smpl::Head, Vector3::new(0.03, 0.0, 0.2));
    positions
}

fn turned(forward: f64, down: f64, flexion: f64) -> Limbs {
    let about = |axis, angle| UnitQuaternion::from_axis_angle(&axis, angle);
    let upper = about(Vector3::z_axis(), -forward) * about(Vector3::x_axis(), -down);
    Limbs { upper, fore: upper * about(Vector3::z_axis(), -flexion) }
}

/// Hands before the chest.
fn touching() -> Limbs {
    turned(0.5, 1.0, 2.1)
}

/// Limbs and geometry of an upright person.
fn upright(limbs: &[Limbs; 2]) -> ([Option<Limbs>; 2], PersonGeometry) {
    let seen = limbs.map(Some);
    (seen, PersonGeometry::measure(&person(limbs, &UnitQuaternion::identity()), &seen).expect("a person"))
}

fn correction() -> Correction {
    Correction { robot: robot().proportions, weight: 1.0 }
}

fn distance_deg(a: &Limbs, b: &Limbs) -> f64 {
    a.upper.angle_to(&b.upper).max(a.fore.angle_to(&b.fore)).to_degrees()
}

#[test]
fn geometry_does_not_depend_on_facing_or_lean() {
    let limbs = touching();
    let (seen, standing) = upright(&[limbs; 2]);
    let head = standing.head.expect("a head");
    assert!((head - Vector3::new(0.03, 0.0, 0.2 + 0.3 * 0.025 / 0.186)).norm() < 1e-5, "{head}");
    for (roll, pitch, yaw) in [(0.0, 0.4, 0.0), (0.3, -0.2, 2.5), (-0.4, 0.1, -1.2)] {
        let torso = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
        let geometry = PersonGeometry::measure(&person(&[limbs; 2], &torso), &seen).expect("a person");
        assert!((geometry.head.expect("a head") - head).norm() < 1e-5, "{geometry:?}");
        assert!((geometry.hands[0].expect("a hand") - standing.hands[0].expect("a hand")).norm() < 1e-5);
    }
}

#[test]
fn child_touches_as_an_adult() {
    let (arm, limbs) = (robot().arms[0].clone(), touching());
    let seen = [Some(limbs); 2];
    let adult = person(&[limbs; 2], &UnitQuaternion::identity());
    let corrected = [1.0, 0.5].map(|size| {
        let positions = adult.map(|at| if at == [0.0; 3] { at } else { at.map(|x| x * size) });
        let (geometry, mut memory) = (PersonGeometry::measure(&positions, &seen).expect("a person"), Memory::default());
        let all = (0..60).map(|_| correction().apply([&arm; 2], &geometry, (&seen, &[None; 2]), 0.02, &mut memory));
        all.last().expect("frames")[0].expect("an arm")
    });
    assert!(distance_deg(&corrected[0], &corrected[1]) < 0.01, "{corrected:?}");
    assert!(distance_deg(&corrected[0], &limbs) > 5.0, "nothing was corrected");
}

#[test]
fn limbs_of_hands_that_touch_nothing_stay_to_the_last_bit() {
    let arm = robot().arms[0].clone();
    let limbs = turned(0.2, 0.3, 0.4);
    let (seen, geometry) = upright(&[limbs; 2]);
    let mut memory = Memory::default();
    for _ in 0..10 {
        assert_eq!(correction().apply([&arm; 2], &geometry, (&seen, &[None; 2]), 0.02, &mut memory), seen);
    }
}

#[test]
fn correction_comes_and_goes_without_a_step() {
    let (arm, limbs) = (robot().arms[0].clone(), touching());
    let (seen, geometry) = upright(&[limbs; 2]);
    let unseen = PersonGeometry { head: None, ..geometry };
    let (mut memory, mut before, mut most_deg) = (Memory::default(), limbs, 0.0_f64);
    for k in 0..150 {
        let person = if k < 75 { &geometry } else { &unseen };
        let [left, _] = correction().apply([&arm; 2], person, (&seen, &[None; 2]), 0.01, &mut memory);
        let left = left.expect("an arm");
        most_deg = most_deg.max(distance_deg(&left, &limbs));
        let step_deg = distance_deg(&left, &before);
        assert!(step_deg < 4.0, "{step_deg} degrees in 10 ms at {k}");
        before = left;
    }
    assert!(most_deg > 5.0, "nothing was corrected: {most_deg} degrees");
}

/// Clearance of the arms from each other, m: hands and forearms.
fn arms_apart_m(model: &robot::Model, q: &[f64; messages::JOINTS_MAX]) -> f64 {
    let mut frames = robot::Frames::default();
    model.forward(q, &mut frames);
    let of = |side: usize| {
        let bodies: [usize; 2] = [3, 6].map(|j| model.arms[side].range().start + j + 1);
        model.capsules.iter().filter(move |capsule| (bodies[0]..=bodies[1]).contains(&capsule.body))
    };
    let gaps = of(0).flat_map(|left| of(1).map(move |right| (left, right))).map(|(left, right)| {
        let ([a, b], [c, d]) = (left.ends(&frames), right.ends(&frames));
        robot::segment_distance(&a, &b, &c, &d).distance_m - left.radius_m - right.radius_m
    });
    gaps.fold(f64::INFINITY, f64::min)
}

/// TIAGo++, and a person whose arms cross before the chest. The left one is above.
fn crossing() -> (robot::Model, Correction, [Option<Limbs>; 2], PersonGeometry) {
    let model = shipped("tiago_dual");
    let correction = Correction::from_model(&model, 1.0);
    let limbs = [turned(1.6, 0.5, 1.5), turned(1.6, 0.6, 1.5)];
    let (limbs, geometry) = upright(&limbs);
    (model, correction, limbs, geometry)
}

#[test]
fn forearms_of_crossed_arms_stay_apart_with_the_left_one_on_the_persons_side() {
    let (model, correction, limbs, geometry) = crossing();
    let arm = ArmModel::from_model(&model, 0);
    let posture = |geometry: &PersonGeometry| {
        let mut memory = Memory::default();
        (0..60).for_each(|_| {
            correction.apply([&arm; 2], geometry, (&limbs, &[None; 2]), 0.02, &mut memory);
        });
        let mut q = model.home;
        for (arm, posture) in model.arms.iter().zip(memory.postures()) {
            let own = arm.mirrored(&posture.expect("a hand that touches").0);
            arm.set_limbs(&own, &mut q);
        }
        q
    };
    let q = posture(&geometry);
    let mut frames = robot::Frames::default();
    model.forward(&q, &mut frames);
    let [left, right] = [0, 1].map(|side| frames.base_from_body[model.arms[side].hand_body()].t);
    let apart_m = arms_apart_m(&model, &q);
    assert!(apart_m > 0.02, "{apart_m} m apart");
    assert!(left.z > right.z + 0.05, "the left hand is at {left}, the right one at {right}");
    // Nobody knows how forearms without elbows lie.
    let blind_m = arms_apart_m(&model, &posture(&PersonGeometry { elbows: [None; 2], ..geometry }));
    assert!(blind_m < -0.05, "these arms do not need the correction: {blind_m} m apart");
}

/// Limbs of a left arm whose elbow hangs and whose wrist lies at this place in the torso frame.
fn folded(wrist: Vector3<f64>) -> Limbs {
    let shoulder = Vector3::y() * SHOULDER_M;
    // Shoulder, elbow and wrist form a triangle.
    let reach = wrist - shoulder;
    let along_m = (reach.norm_squared() + UPPER_M * UPPER_M - FORE_M * FORE_M) / (2.0 * reach.norm());
    let down = (-Vector3::z() + reach * (reach.z / reach.norm_squared())).normalize();
    let elbow = shoulder + reach.normalize() * along_m + down * (UPPER_M * UPPER_M - along_m * along_m).sqrt();
    limbs_of(elbow - shoulder, wrist - elbow)
}

/// Limbs of a left arm with these ways from shoulder to elbow and from elbow to wrist, in the torso frame.
fn limbs_of(upper: Vector3<f64>, fore: Vector3<f64>) -> Limbs {
    let hinge = fore.cross(&upper).normalize();
    let frame = |along: Vector3<f64>| {
        let y = along.normalize();
        UnitQuaternion::from_matrix(&nalgebra::Matrix3::from_columns(&[y.cross(&hinge), y, hinge]))
    };
    Limbs { upper: frame(upper), fore: frame(fore) }
}

/// Arms whose forearms lie in line, upright beside each other, and crossed over the head.
fn in_line() -> Vec<[Limbs; 2]> {
    let of = |elbow: [f64; 3], wrist: [f64; 3]| {
        let (elbow, wrist) = (Vector3::from(elbow), Vector3::from(wrist));
        limbs_of(elbow - Vector3::y() * SHOULDER_M, wrist - elbow)
    };
    let stacked = |x: f64, z: f64, by: f64| [by, -by].map(|by| of([x, 0.15, z + by], [x, -0.08, z + 0.02 + by]));
    let upright = [of([0.2, 0.06, -0.25], [0.35, 0.06, -0.02]); 2];
    vec![
        stacked(0.15, -0.12, 0.025),
        stacked(0.25, -0.12, 0.025),
        stacked(-0.05, 0.28, 0.05),
        stacked(0.05, 0.28, 0.05),
        upright,
    ]
}

#[test]
fn still_person_whose_arms_cross_has_still_limbs() {
    for name in ROBOTS {
        let model = shipped(name);
        let arm = ArmModel::from_model(&model, 0);
        let correction = Correction::from_model(&model, 1.0);
        for (fold, limbs) in folds().chain(in_line()).enumerate() {
            for rate_hz in [20.0, 60.0] {
                let (limbs, geometry) = upright(&limbs);
                let (mut memory, mut before, mut most_deg) = (Memory::default(), limbs, 0.0_f64);
                for k in 0..300 {
                    let out = correction.apply([&arm; 2], &geometry, (&limbs, &[None; 2]), 1.0 / rate_hz, &mut memory);
                    for (now, before) in out.iter().flatten().zip(before.iter().flatten()).filter(|_| k >= 200) {
                        most_deg = most_deg.max(distance_deg(now, before));
                    }
                    before = out;
                }
                // TIAGo++'s arms above its head swing: see the documentation of `contact`.
                let known = name == "tiago_dual" && (29..31).contains(&fold);
                assert!(most_deg < 0.1 || known, "{name}, {fold} at {rate_hz} Hz: {most_deg} degrees a frame");
            }
        }
    }
}

/// Places of the left wrist of a person who folds the arms. The left one is above the right one by the last number, m.
fn folds() -> impl Iterator<Item = [Limbs; 2]> {
    let of = |values: [f64; 3]| values.into_iter();
    let places = of([0.24, 0.28, 0.32])
        .flat_map(move |x| of([0.02, 0.08, 0.14]).flat_map(move |y| of([0.04, 0.08, 0.12]).map(move |z| [x, y, z])));
    // Each wrist lies beyond the middle.
    places.map(|[ahead, across, above]| {
        [above, -above].map(|above| folded(Vector3::new(ahead, -across, -0.14 + above / 2.0)))
    })
}

#[test]
fn arms_that_cross_over_the_head_do_not_leave_the_torso() {
    let model = shipped("unitree_g1");
    let (arm, robot) = (ArmModel::from_model(&model, 0), Proportions::from_model(&model, 0));
    let [with, without] = [robot.torso_m, [-9.0, 0.0]].map(|torso_m| {
        let correction = Correction { robot: [Proportions { torso_m, ..robot }; 2], weight: 1.0 };
        [2, 3].map(|over| {
            let (limbs, geometry) = upright(&in_line()[over]);
            correction.apply([&arm; 2], &geometry, (&limbs, &[None; 2]), 0.02, &mut Memory::default())
        })
    });
    assert_eq!(with, without);
}

#[test]
fn noise_of_folded_arms_is_not_magnified() {
    // The H1 cannot turn its forearms about their length, which counts here.
    for name in ROBOTS.into_iter().filter(|name| *name != "unitree_h1") {
        let model = shipped(name);
        let (arm, correction) = (ArmModel::from_model(&model, 0), Correction::from_model(&model, 1.0));
        let mut rng = Pcg64::seed_from_u64(5);
        let (mut seen, mut turned) = (Vec::new(), Vec::new());
        for clean in folds() {
            let (mut memory, mut before) = (Memory::default(), None);
            for k in 0..100 {
                let limbs = clean.map(|limbs| {
                    // The sum of twelve is close to a normal distribution.
                    let mut noise =
                        || Vector3::from_fn(|_, _| (0..12).map(|_| rng.random_range(-0.5..0.5)).sum::<f64>() * NOISE_M);
                    let (elbow, wrist) = (noise(), noise());
                    let fore = limbs.fore * Vector3::y() * FORE_M + wrist - elbow;
                    limbs_of(limbs.upper * Vector3::y() * UPPER_M + elbow, fore)
                });
                let (limbs, geometry) = upright(&limbs);
                let out = correction.apply([&arm; 2], &geometry, (&limbs, &[None; 2]), 1.0 / 60.0, &mut memory);
                let now = [limbs, out].map(|limbs| limbs.map(|limbs| limbs.expect("an arm")));
                if let Some([limbs, out]) = before.replace(now).filter(|_| k >= 40) {
                    for side in 0..2 {
                        seen.push(distance_deg(&now[0][side], &limbs[side]));
                        turned.push(distance_deg(&now[1][side], &out[side]));
                    }
                }
            }
        }
        let of = |values: &mut Vec<f64>, percent: usize| {
            values.sort_by(f64::total_cmp);
            values[values.len() * percent / 100]
        };
        for (percent, times) in [(50, 1.25), (99, 2.25)] {
            let (seen, turned) = (of(&mut seen, percent), of(&mut turned, percent));
            assert!(turned < times * seen, "{name}: {turned} degrees a frame of {seen}, at {percent} %");
        }
    }
}

#[test]
fn trajectory_has_places_of_touching_hands() {
    let person_at: crate::limb_trajectory::Person = |t_s| [turned(0.5, 1.0, 1.8 + 0.4 * (3.0 * t_s).sin()); 2];
    let model = shipped("tiago_dual");
    let settings = Settings { method: Method::ClosedForm, contact_weight: 1.0, ..Settings::default() };
    let config = Config::new(&model, None, &settings).expect("a configuration");
    let (arm, correction) = (ArmModel::from_model(&model, 0), Correction::from_model(&model, 1.0));
    let chain = &correction.robot[0].chain;
    let mut memory = Memory::default();
    let (mut skeletons, mut places) = (crate::limb_trajectory::source_at(person_at, 3.0, 60.0), Vec::new());
    for skeleton in &mut skeletons {
        let t_s = (skeleton.received.0 - START_NS) as f64 * 1e-9;
        skeleton.positions = person(&person_at(t_s), &UnitQuaternion::identity());
        let limbs = person_at(t_s).map(Some);
        let geometry = PersonGeometry::measure(&skeleton.positions, &limbs).expect("a person");
        correction.apply([&arm; 2], &geometry, (&limbs, &[None; 2]), 1.0 / 60.0, &mut memory);
        let (q, share) = memory.postures()[0].expect("a hand that touches");
        places.push((t_s, chain.hand_center(&arm, &q) - chain.joints[0], share));
    }
    let (mut seen, mut partial, mut ahead_m, mut still_m) = (0, 0, Vec::new(), Vec::new());
    for (now, target) in &crate::limb_trajectory::run(&config, &skeletons, 2.4)[1500..] {
        for i in 0..TRAJECTORY_NODES {
            let t_s = crate::limb_trajectory::shown_s(*now, target, i);
            let after = places.partition_point(|place| place.0 < t_s);
            let ((from_s, from, first), (to_s, to, last)) = (places[after - 1], places[after]);
            let along = (t_s - from_s) / (to_s - from_s);
            let (expected, share) = (from + (to - from) * along, first + (last - first) * along);
            let [left, right] = target.hand_places[i].map(|[x, y, z, _]| Vector3::new(x, y, z).cast::<f64>());
            assert!((left - place_on_side(1, right)).norm() < 1e-5, "a person who is a mirror image: {left} {right}");
            let off_m = (left - expected).norm();
            if i < target.trajectory_measured as usize {
                let weight = f64::from(target.hand_places[i][0][3]);
                assert!((weight - share * share).abs() < 0.01, "node {i}: {weight}");
                assert!(off_m < 2e-3, "node {i}: {off_m} m off");
                seen += 1;
                partial += u32::from(share < 0.7);
            } else if i == target.trajectory_measured as usize + 4 {
                ahead_m.push(off_m);
                let newest = target.hand_places[target.trajectory_measured as usize - 1][0];
                still_m.push((Vector3::new(newest[0], newest[1], newest[2]).cast::<f64>() - expected).norm());
            }
        }
    }
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let (ahead_m, still_m) = (mean(&ahead_m), mean(&still_m));
    assert!(
        seen > 1000 && partial > 1000 && ahead_m < 0.7 * still_m,
        "100 ms ahead: {ahead_m} m, of a hand that stands {still_m} m"
    );
}

#[test]
fn arm_that_is_seen_or_lost_all_at_once_across_the_other_one_turns_it_without_a_step() {
    let (model, correction, limbs, geometry) = crossing();
    let arm = ArmModel::from_model(&model, 0);
    let alone = PersonGeometry { hands: [geometry.hands[0], None], elbows: [geometry.elbows[0], None], ..geometry };
    let (mut memory, mut before, mut begun) = (Memory::default(), None, None);
    let mut most_deg = 0.0_f64;
    for k in 0..150 {
        let (person, seen) = if (50..100).contains(&k) { (&geometry, limbs) } else { (&alone, [limbs[0], None]) };
        let [left, _] = correction.apply([&arm; 2], person, (&seen, &[None; 2]), 0.01, &mut memory);
        let left = left.expect("an arm");
        if k >= 50 {
            let step_deg = distance_deg(&left, &before.expect("a frame before"));
            assert!(step_deg < 4.0, "{step_deg} degrees in 10 ms at {k}");
            most_deg = most_deg.max(distance_deg(&left, begun.get_or_insert(left)));
        }
        before = Some(left);
    }
    assert!(most_deg > 5.0, "the other arm turned this one by {most_deg} degrees alone");
}

#[test]
fn hand_that_is_nowhere_or_not_finite_leaves_the_limbs() {
    let limbs = touching();
    let seen = [Some(limbs); 2];
    let right = person(&[limbs; 2], &UnitQuaternion::identity());
    assert_eq!(PersonGeometry::measure(&[[0.0; 3]; SMPL_JOINTS], &seen), None);
    assert_eq!(PersonGeometry::measure(&right, &[None; 2]), None);
    for joint in [Smpl::LeftShoulder, Smpl::RightShoulder, Smpl::LeftElbow, Smpl::LeftWrist, Smpl::Head] {
        for wrong in [f32::NAN, f32::INFINITY] {
            let mut positions = right;
            positions[joint as usize][1] = wrong;
            assert_eq!(PersonGeometry::measure(&positions, &seen), None, "{joint:?} {wrong}");
        }
    }
    let one = [Some(limbs), None];
    let geometry = PersonGeometry::measure(&right, &one).expect("a person");
    let corrected =
        correction().apply(robot().arms.each_ref(), &geometry, (&one, &[None; 2]), 0.02, &mut Memory::default());
    assert!(corrected[0].is_some() && corrected[1].is_none());
}

#[test]
fn chain_ends_where_the_robots_kinematics_have_the_hand() {
    for name in ["tiago_dual", "unitree_g1", "rby1a"] {
        let model = shipped(name);
        let (arm, robot) = (ArmModel::from_model(&model, 0), Proportions::from_model(&model, 0));
        let mut frames = robot::Frames::default();
        for shift in [0.0, 0.2, -0.3] {
            let left: [f64; ARM_Q] = std::array::from_fn(|j| arm.mid()[j] + shift * arm.half()[j]);
            let mut q = model.home;
            model.arms[0].set_limbs(&left, &mut q);
            model.forward(&q, &mut frames);
            let body = |joint: usize| frames.base_from_body[model.arms[0].range().start + joint + 1];
            let torso = frames.base_from_body[model.torso_body].r.transpose();
            let seen = torso * (model.hand_center(&frames, 0) - body(0).t);
            let chain = robot.chain.hand_center(&arm, &left) - robot.chain.joints[0];
            assert!((seen - chain).norm() < 1e-6, "{name}: {seen} {chain}");
        }
    }
}
