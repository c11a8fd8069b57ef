//! Tests that a page receives the values of the messages.

use messages::{
    JOINTS_MAX, JointCommand, JointTarget, Layout, Mode, RobotState, SMPL_JOINTS, Skeleton, Stamp, Status, deadline,
    skeleton_flag,
};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use robot::{Frames, Model};
use std::path::Path;
use view::{FIELDS, Field, LatestMessages, POSE, RobotView, TURNS, encode, length, present, scene};

pub fn loaded() -> config::Loaded {
    let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/teleop.toml");
    config::load(&config, config::Overrides::default()).expect("settings")
}

pub fn model() -> Model {
    loaded().model
}

/// Returns the shipped robot as a page shows it.
pub fn shown() -> RobotView {
    RobotView::load(&loaded(), None).expect("a look")
}

fn encoded(model: &Model, heard: &LatestMessages) -> Vec<f32> {
    let mut out = vec![1; 3];
    encode(model, &mut Frames::default(), heard, 2.5, &mut out);
    let numbers: Vec<_> = out.chunks_exact(4).map(|four| f32::from_le_bytes(four.try_into().unwrap())).collect();
    assert_eq!((numbers.len(), out.len()), (length(model.count), 4 * length(model.count)));
    numbers
}

/// TIAGo++: the number of its joints and of its bodies.
const JOINTS: usize = 17;
const BODIES: usize = 18;
/// Start of the lists: the nearest places, the person, hands and head, three robots, four lists of joints.
const PERSON: usize = FIELDS + 12;
const HANDS: usize = PERSON + 3 * SMPL_JOINTS;
const ROBOTS: usize = HANDS + TURNS;
const LISTS: usize = ROBOTS + 3 * BODIES * POSE;

fn poses_are_those_of(model: &Model, numbers: &[f32], q: &[f64; JOINTS_MAX], what: &str) {
    let mut frames = Frames::default();
    model.forward(q, &mut frames);
    for (body, seven) in numbers.chunks_exact(POSE).take(BODIES).enumerate() {
        let pose = &frames.base_from_body[body];
        let seven: Vec<f64> = seven.iter().map(|&x| f64::from(x)).collect();
        let turn = UnitQuaternion::from_quaternion(Quaternion::new(seven[6], seven[3], seven[4], seven[5]));
        assert!((Vector3::new(seven[0], seven[1], seven[2]) - pose.t).norm() < 1e-6, "{what}: body {body}");
        assert!((turn.to_rotation_matrix().matrix() - pose.r).norm() < 1e-5, "{what}: body {body}");
    }
}

#[test]
fn frame_without_instance_shows_robot_at_home_only() {
    let model = model();
    let numbers = encoded(&model, &LatestMessages::default());
    assert_eq!(numbers[Field::Present as usize], 0.0);
    assert_eq!(numbers[Field::AtS as usize], 2.5);
    poses_are_those_of(&model, &numbers[ROBOTS..], &model.home, "home");
}

#[test]
fn frame_carries_measured_target_and_command_postures() {
    let model = model();
    let shifted =
        |by: f64| -> [f64; JOINTS_MAX] { core::array::from_fn(|j| model.home[j] + by * (j as f64 + 1.0) / 20.0) };
    let (mut state, mut command, mut target) = (RobotState::ZERO, JointCommand::ZERO, JointTarget::ZERO);
    (state.q_measured, command.q, target.q) = (shifted(0.2), shifted(-0.2), shifted(0.1));
    (state.robot, command.robot, target.robot) = (model.id(), model.id(), model.id());
    state.dq_measured = shifted(0.3);
    (command.k, command.header.stamp) = (7, deadline(7).plus_ns(123_000));
    target.valid_mask = 0b11_1000;
    let mut status = Status::ZERO;
    (status.mode, status.header.stamp, status.input_age_ns) = (Mode::Engaged as u32, Stamp(10_000_000_000), 12_500_000);
    (status.target_stamp, status.nearest_pair_measured) =
        (Stamp(5), [model.pairs[0].a as u32, model.pairs[0].b as u32]);
    let mut skeleton = Skeleton::ZERO;
    skeleton.positions = core::array::from_fn(|n| [n as f32, -1.0, 0.5]);
    let heard = LatestMessages {
        skeleton: Some(skeleton),
        state: Some(state),
        command: Some(command),
        target: Some(target),
        status: Some(status),
    };
    let numbers = encoded(&model, &heard);
    let at = |field: Field| numbers[field as usize];
    let all = present::PERSON | present::MEASURED | present::TARGET | present::COMMAND | present::PAIR | present::LAG;
    assert_eq!(at(Field::Present), all as f32);
    assert_eq!(
        (at(Field::Mode), at(Field::InputAgeMs), at(Field::TickLateUs)),
        (Mode::Engaged as u32 as f32, 12.5, 123.0)
    );
    assert_eq!(numbers[PERSON + 3 * 4..][..3], [4.0, -1.0, 0.5]);
    // A joint without a target is drawn where it is measured.
    let target: [f64; JOINTS_MAX] =
        core::array::from_fn(|j| if (3..6).contains(&j) { shifted(0.1)[j] } else { shifted(0.2)[j] });
    for (n, (q, what)) in
        [(shifted(0.2), "measured"), (target, "target"), (shifted(-0.2), "command")].iter().enumerate()
    {
        poses_are_those_of(&model, &numbers[ROBOTS + n * BODIES * POSE..], q, what);
        let encoded: Vec<f32> = q[..JOINTS].iter().map(|&x| x as f32).collect();
        assert_eq!(numbers[LISTS + n * JOINTS..][..JOINTS], encoded, "{what}");
    }
    assert_eq!(numbers[LISTS + 3 * JOINTS], shifted(0.3)[0] as f32);
    // The two places of each arm are as far from each other as its smallest clearance of all checked pairs.
    let mut frames = Frames::default();
    model.forward(&shifted(0.2), &mut frames);
    for (side, places) in numbers[FIELDS..][..12].chunks_exact(6).enumerate() {
        let on_arm = |index: usize| model.arms[side].range().any(|j| j + 1 == model.capsules[index].body);
        let apart = model.pairs.iter().filter(|pair| on_arm(pair.a) || on_arm(pair.b)).map(|pair| {
            let (one, other) = (&model.capsules[pair.a], &model.capsules[pair.b]);
            let ([a, b], [c, d]) = (one.ends(&frames), other.ends(&frames));
            robot::segment_distance(&a, &b, &c, &d).distance_m - one.radius_m - other.radius_m
        });
        let least = apart.fold(f64::INFINITY, f64::min);
        let at = |n: usize| Vector3::from_row_slice(&places[n..n + 3]).cast::<f64>();
        let encoded = (at(0) - at(3)).norm();
        assert!(encoded <= least.abs() + 1e-6, "arm {side}: {encoded} and {least}");
        let near = model.nearest_to_arm(&frames, side).expect("a pair");
        assert!((encoded - near.clearance_m.abs()).abs() < 1e-6 && near.clearance_m <= least + 1e-9, "{near:?}");
    }
}

/// The joints of another robot are other joints, even if there are as many.
#[test]
fn messages_of_another_robot_are_not_shown() {
    let model = model();
    let (mut state, mut command) = (RobotState::ZERO, JointCommand::ZERO);
    (state.robot, command.robot) = (model.id(), model.id());
    command.robot.hash ^= 1;
    state.q_measured = [0.5; JOINTS_MAX];
    let skeleton = Some(Skeleton { flags: messages::skeleton_flag::ONE_CAMERA, ..Skeleton::ZERO });
    let heard = LatestMessages { state: Some(state), command: Some(command), skeleton, ..LatestMessages::default() };
    let numbers = encoded(&model, &heard);
    assert_eq!(numbers[Field::Present as usize] as u32, present::OTHER_ROBOT | present::PERSON | present::ONE_CAMERA);
    poses_are_those_of(&model, &numbers[ROBOTS..], &model.home, "home");
}

#[test]
fn hands_and_head_are_there_where_they_are_known() {
    let mut skeleton = Skeleton::ZERO;
    skeleton.hands = [[0.1, 0.2, 0.3, 0.9], [0.4, 0.5, 0.6, 0.8]];
    (skeleton.closure, skeleton.head) = ([0.25, 0.75], [0.0, 0.0, 0.6, 0.8]);
    skeleton.flags = skeleton_flag::HAND[1] | skeleton_flag::CLOSURE[0];
    let heard = LatestMessages { skeleton: Some(skeleton), ..LatestMessages::default() };
    let known = [0.0, 0.0, 0.0, 0.0, 0.25, 0.4, 0.5, 0.6, 0.8, 0.0, 0.0, 0.0, 0.0, 0.0];
    assert_eq!(encoded(&model(), &heard)[HANDS..ROBOTS], known);
    skeleton.flags = skeleton_flag::HEAD;
    let heard = LatestMessages { skeleton: Some(skeleton), ..LatestMessages::default() };
    assert_eq!(encoded(&model(), &heard)[HANDS + 10..ROBOTS], skeleton.head);
}

#[test]
fn frame_of_nan_or_infinite_input_is_finite() {
    let model = model();
    let mut state = RobotState::ZERO;
    (state.robot, state.q_measured) = (model.id(), [f64::NAN; JOINTS_MAX]);
    let mut skeleton = Skeleton::ZERO;
    skeleton.positions = [[f32::INFINITY; 3]; SMPL_JOINTS];
    let heard = LatestMessages { state: Some(state), skeleton: Some(skeleton), ..LatestMessages::default() };
    assert!(encoded(&model, &heard).iter().all(|number| number.is_finite()));
}

#[test]
fn scene_names_every_joint_capsule_and_shape() {
    let (model, view) = (model(), shown());
    let encoded = scene(&view);
    let count = |key: &str| encoded[key].as_array().map_or(0, Vec::len);
    assert_eq!((count("joints"), count("capsules")), (JOINTS, model.capsules.len()));
    assert_eq!(count("shapes"), model.visuals().count());
    assert!(count("shapes") > 10);
    assert_eq!(encoded["modes"][Mode::Engaged as usize], Mode::Engaged.name());
    assert_eq!(encoded["obstacles"].as_array().map(Vec::len), Some(model.obstacles.len()));
    assert_eq!((count("parts"), count("meshes")), (view.look.parts.len(), 0));
    assert!(count("parts") > 50);
    assert_eq!(encoded["limits"]["delays_ms"], serde_json::json!([120.0, 180.0]));
    assert_eq!(encoded["limits"]["clearance_mm"], model.d_min_m * 1e3);
    // In the T-pose the capsule of the hand of TIAGo++ reaches 1.25 m from its middle.
    assert!((encoded["half_span"].as_f64().expect("a length") - 1.25).abs() < 0.01, "{}", encoded["half_span"]);
    assert_eq!(
        encoded["shoulders"],
        serde_json::json!([model.arms[0].range().start + 1 + 1, model.arms[1].range().start + 1 + 1])
    );
}

#[test]
fn capsule_of_the_urdf_is_drawn_with_both_ends() {
    let mut view = shown();
    let texts = view.model.texts.clone();
    let round = texts.urdf.replace("<box size=\"0.5 0.4996 0.275\"/>", "<capsule radius=\"0.2\" length=\"0.4\"/>");
    view.model = Model::from_text(&texts.toml_name, &texts.toml, &texts.urdf_name, &round).expect("a robot");
    let encoded = scene(&view);
    let shapes = encoded["shapes"].as_array().expect("shapes");
    let capsule = shapes.iter().find(|shape| shape["form"] == "capsule").expect("a capsule");
    assert_eq!((&capsule["radius"], &capsule["top"]), (&0.2.into(), &0.2.into()));
    assert_eq!((&capsule["a"][2], &capsule["b"][2]), (&(-0.2).into(), &0.2.into()));
}

#[test]
fn lag_is_time_of_joints_behind_command_while_moving() {
    let model = model();
    let (mut state, mut command) = (RobotState::ZERO, JointCommand::ZERO);
    (state.robot, command.robot, state.q_measured) = (model.id(), model.id(), model.home);
    state.dq_measured = core::array::from_fn(|j| 0.1 * (j as f64 - 8.0));
    command.q = core::array::from_fn(|j| state.q_measured[j] + 0.021 * state.dq_measured[j]);
    let encoded = |state, command| {
        let heard = LatestMessages { state: Some(state), command: Some(command), ..LatestMessages::default() };
        let numbers = encoded(&model, &heard);
        (numbers[Field::Present as usize] as u32 & present::LAG != 0, numbers[Field::LagMs as usize])
    };
    let (is_there, lag_ms) = encoded(state, command);
    assert!(is_there && (lag_ms - 21.0).abs() < 0.01, "{lag_ms}");
    // A robot that stands still has no lag.
    state.dq_measured = [1e-3; JOINTS_MAX];
    assert_eq!(encoded(state, command), (false, 0.0));
}
