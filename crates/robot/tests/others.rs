//! Tests the shipped robots other than TIAGo++.

use crate::support::with_proved_clear;
use robot::{AllowedReason, CAPSULES_MAX, Frames, Model};

struct Robot {
    name: &'static str,
    toml: &'static str,
    urdf: &'static str,
    count: usize,
    /// q_right = signs * q_left for the mirrored posture.
    signs: &'static [f64],
}

macro_rules! robot {
    ($name:literal, $count:literal, $signs:expr) => {
        Robot {
            name: $name,
            toml: include_str!(concat!("../../../config/robots/", $name, ".toml")),
            urdf: include_str!(concat!("../../../config/robots/", $name, ".urdf")),
            count: $count,
            signs: &$signs,
        }
    };
}

const ROBOTS: [Robot; 5] = [
    robot!("unitree_g1", 17, [1.0, -1.0, -1.0, 1.0, -1.0, 1.0, -1.0]),
    robot!("openarm_v10", 14, [-1.0, -1.0, -1.0, 1.0, -1.0, -1.0, -1.0]),
    robot!("franka_fr3_duo", 14, [-1.0, 1.0, -1.0, 1.0, -1.0, 1.0, -1.0]),
    robot!("rby1a", 22, [1.0, -1.0, -1.0, 1.0, -1.0, 1.0, -1.0]),
    robot!("unitree_h1", 9, [1.0, -1.0, -1.0, 1.0]),
];

fn load(robot: &Robot) -> Model {
    Model::from_text(robot.name, robot.toml, robot.name, robot.urdf).unwrap_or_else(|error| panic!("{error}"))
}

fn at_home(model: &Model) -> Frames {
    let mut frames = Frames::default();
    model.forward(&model.home, &mut frames);
    frames
}

fn axes(model: &Model, side: usize) -> Vec<nalgebra::Vector3<f64>> {
    let frames = at_home(model);
    model.arms[side].range().map(|j| frames.base_from_body[j + 1].r * model.joint_at_zero(j).1).collect()
}

#[test]
fn other_robots_have_their_joints_and_no_lift() {
    for robot in &ROBOTS {
        let model = load(robot);
        assert_eq!((model.name.as_str(), model.count, model.lift), (robot.name, robot.count, None));
        assert_eq!(model.body_count, robot.count - 2 * robot.signs.len(), "{}", robot.name);
        assert_eq!(model.arms[0].range().start, model.body_count, "{}", robot.name);
        assert!(model.capsules.len() <= CAPSULES_MAX && model.capsules.len() >= 20, "{}", model.capsules.len());
    }
}

#[test]
fn other_robots_arms_mirror_by_their_signs() {
    for robot in &ROBOTS {
        let model = load(robot);
        assert_eq!(Vec::from_iter(model.arms[1].joint_signs()), robot.signs, "{}", robot.name);
        let [left, right] = [0, 1].map(|side| model.arms[side].range());
        for ((l, r), sign) in left.zip(right).zip(robot.signs) {
            assert_eq!(model.home[r], sign * model.home[l] + 0.0, "{}: {}", robot.name, model.joint_names[r]);
        }
        // Seen from the mirror, a turn about an axis n becomes one about (-x, y, -z).
        for ((l, r), sign) in axes(&model, 0).iter().zip(axes(&model, 1)).zip(robot.signs) {
            let mirrored = nalgebra::Vector3::new(-l.x, l.y, -l.z) * *sign;
            assert!((mirrored - r).amax() < 1e-6, "{}: {mirrored} {r}", robot.name);
        }
    }
}

/// The closed form of an arm rests on this.
#[test]
fn other_robots_shoulder_and_elbow_axes_are_orthogonal() {
    for robot in &ROBOTS {
        let model = load(robot);
        for side in [0, 1] {
            let axes = axes(&model, side);
            for (a, b) in (1..axes.len().min(5)).map(|b| (b - 1, b)) {
                assert!(axes[a].dot(&axes[b]).abs() < 1e-6, "{} {side}: {a} {b}", robot.name);
            }
        }
    }
}

#[test]
fn other_robots_hands_grasp_at_mirrored_places_between_their_capsules() {
    for robot in &ROBOTS {
        let model = load(robot);
        let frames = at_home(&model);
        let places = [0, 1].map(|side| {
            let body = model.arms[side].hand_body();
            let at = model.hand_center(&frames, side);
            let hand = model.capsules.iter().filter(|capsule| capsule.body == body);
            let ends = hand.flat_map(|capsule| capsule.ends(&frames).map(|end| (end - at).norm()));
            let away_m = ends.fold(f64::INFINITY, f64::min);
            assert!(away_m < 0.1, "{}: the hand grasps {away_m} m from its capsules", robot.name);
            at
        });
        let mirrored = nalgebra::Vector3::new(places[1].x, -places[1].y, places[1].z);
        assert!((places[0] - mirrored).norm() < 1e-3, "{}: {places:?}", robot.name);
    }
}

/// The hands are checked against each other and against the body. Nothing proves them clear.
#[test]
fn other_robots_hands_are_checked_against_hands_and_body() {
    for robot in &ROBOTS {
        let model = load(robot);
        let [left, right] = [0, 1].map(|side| model.arms[side].hand_body());
        let checked = |a: usize, b: usize| {
            model.pairs.iter().any(|pair| {
                let bodies = (model.capsules[pair.a].body, model.capsules[pair.b].body);
                bodies == (a, b) || bodies == (b, a)
            })
        };
        assert!(checked(left, right), "{}", robot.name);
        assert!(checked(model.torso_body, left) && checked(model.torso_body, right), "{}", robot.name);
        let proved = model.allowed.iter().filter(|pair| pair.reason == AllowedReason::ProvedClear);
        let hands = |body: usize| body == left || body == right;
        for pair in proved {
            let (a, b) = (model.capsules[pair.a].body, model.capsules[pair.b].body);
            assert!(!(hands(a) && hands(b)), "{}: {pair:?}", robot.name);
        }
    }
}

#[test]
fn no_pair_called_clear_meets() {
    for robot in &ROBOTS {
        load(robot).check_proved_clear(5_000).unwrap_or_else(|error| panic!("{error}"));
    }
}

/// The 500 samples do not show that these capsules of RB-Y1 meet, by 122 mm. The search from the nearest ones must.
#[test]
fn pair_that_meets_in_rare_postures_is_refused_as_clear() {
    let robot = ROBOTS.iter().find(|robot| robot.name == "rby1a").unwrap();
    let toml = with_proved_clear(robot.toml, "link_torso_2", "link_right_arm_4");
    let model = Model::from_text(robot.name, &toml, robot.name, robot.urdf).unwrap();
    let error = model.check_proved_clear(500).unwrap_err().to_string();
    assert!(error.contains("link_torso_2") && error.contains("link_right_arm_4"), "{error}");
}
