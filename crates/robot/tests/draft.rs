//! Tests the draft of a robot file from a URDF alone.

use crate::support::drafted;
use robot::draft;

const TIAGO: &str = include_str!("../../../config/robots/tiago_dual.urdf");
const G1: &str = include_str!("../../../config/robots/unitree_g1.urdf");
const OPENARM: &str = include_str!("../../../config/robots/openarm_v10.urdf");
const FR3: &str = include_str!("../../../config/robots/franka_fr3_duo.urdf");
const RBY1: &str = include_str!("../../../config/robots/rby1a.urdf");

#[test]
fn drafts_of_five_robots_load_with_their_arms_and_signs() {
    let rows: [(&str, usize, usize, &str, [f64; 7]); 5] = [
        (TIAGO, 17, 3, "arm_left_1_joint", [1.0; 7]),
        (G1, 17, 3, "left_shoulder_pitch_joint", [1.0, -1.0, -1.0, 1.0, -1.0, 1.0, -1.0]),
        (OPENARM, 14, 0, "openarm_left_joint1", [-1.0, -1.0, -1.0, 1.0, -1.0, -1.0, -1.0]),
        (FR3, 14, 0, "left_fr3v2_joint1", [-1.0, 1.0, -1.0, 1.0, -1.0, 1.0, -1.0]),
        (RBY1, 22, 8, "left_arm_0", [1.0, -1.0, -1.0, 1.0, -1.0, 1.0, -1.0]),
    ];
    for (urdf, count, body_count, first, signs) in rows {
        let model = drafted(urdf);
        assert_eq!(
            (model.count, model.body_count, Vec::from_iter(model.arms[1].joint_signs())),
            (count, body_count, signs.to_vec()),
            "{}",
            model.name
        );
        assert_eq!(model.joint_names[model.arms[0].range().start], first);
    }
    assert_eq!((drafted(TIAGO).lift, drafted(G1).lift), (Some(0), None));
}

/// In the T-pose the axes of upper arm and forearm point to the side, and the elbow's bends the arm to the front. At
/// home the hands are in front of the torso.
#[test]
fn drafted_t_pose_is_straight_and_home_has_hands_in_front() {
    for urdf in [TIAGO, G1, OPENARM, FR3, RBY1] {
        let model = drafted(urdf);
        for (side, arm) in [1.0, -1.0].into_iter().zip(&model.arms) {
            let [upper, elbow, fore] = [2, 3, 4].map(|i| arm.axes[i]);
            assert!(upper.y.abs() > 1.0 - 1e-6 && fore.y.abs() > 1.0 - 1e-6, "{}: {upper} {fore}", model.name);
            assert!(elbow.z.abs() > 1.0 - 1e-6, "{}: {elbow}", model.name);
            // Bending by half a radian towards the middle of the range moves the forearm's direction to the front.
            let mut q = arm.reference;
            q[3] += 0.5 * ((arm.q_min[3] + arm.q_max[3]) / 2.0 - q[3]).signum();
            let forearm = arm.limb_rotations(&q).1 * nalgebra::Vector3::new(0.0, side, 0.0);
            assert!(forearm.x > 0.4, "{}: {forearm}", model.name);
            let home = arm.limb_values(&model.home);
            let (upper, fore) = arm.limb_rotations(&home);
            let [upper, fore] = [upper, fore].map(|r| r * nalgebra::Vector3::new(0.0, side, 0.0));
            assert!(upper.z < -0.6 && fore.x > 0.6, "{}: {upper} {fore}", model.name);
        }
    }
}

#[test]
fn urdf_without_two_arms_is_refused_with_reason() {
    let one = G1.replace(
        "<joint name=\"right_elbow_joint\" type=\"revolute\">",
        "<joint name=\"right_elbow_joint\" type=\"fixed\">",
    );
    let error = draft("r.urdf", &one).unwrap_err().to_string();
    assert!(error.contains("r.urdf") && error.contains("two chains of four to eight joints"), "{error}");
    assert!(error.contains("6 joints (right_shoulder_pitch_joint"), "{error}");
    assert!(draft("r.urdf", "<robot").is_err());
}

#[test]
fn joint_without_range_is_refused_before_it_is_solved() {
    let wrong = ["", "lower=\"1\" upper=\"-1\"", "lower=\"nan\" upper=\"1\""];
    let new = |range: &&str| {
        if range.is_empty() { String::new() } else { format!("<limit {range} velocity=\"1\" effort=\"1\"/>") }
    };
    let joints = ["left_shoulder_roll_joint", "left_elbow_joint", "left_wrist_roll_joint"];
    for (joint, new) in joints.iter().flat_map(|joint| wrong.iter().map(new).map(move |new| (*joint, new))) {
        let at = G1.find(&format!("<joint name=\"{joint}\"")).unwrap();
        let limit = &G1[at + G1[at..].find("<limit").unwrap()..];
        let limit = &limit[..limit.find("/>").unwrap() + 2];
        let urdf = format!("{}{}", &G1[..at], G1[at..].replacen(limit, &new, 1));
        let error = draft("r.urdf", &urdf).unwrap_err().to_string();
        assert!(error.contains("r.urdf") && error.contains(joint), "{new}: {error}");
    }
}

#[test]
fn names_of_the_urdf_cannot_write_keys_of_the_draft() {
    let urdf = G1.replacen("<robot name=\"", "<robot name=\"x&quot;&#10;base_height_m = 2.5&#10;#", 1);
    let file: toml::Table = draft("a\"b.urdf", &urdf).unwrap().toml.parse().unwrap();
    assert!(file["base_height_m"].as_float() == Some(0.76) && file["name"].as_str().unwrap().contains("base_height_m"));
    assert_eq!(file["urdf"].as_str(), Some("a\"b.urdf"));
}

#[test]
fn notes_name_what_was_guessed_and_what_to_decide() {
    let draft = draft("g1.urdf", G1).unwrap();
    let has_note = |notes: &[String], words: &str| notes.iter().any(|note| note.contains(words));
    assert!(has_note(&draft.guesses, "The left arm is left_shoulder_pitch_joint"), "{:?}", draft.guesses);
    assert!(has_note(&draft.guesses, "waist_yaw_joint") && has_note(&draft.guesses, "left_knee_joint"));
    assert!(has_note(&draft.decisions, "torso_link") && has_note(&draft.decisions, "assumptions"));
}

fn retyped(joint: &str, kind: &str) -> String {
    let open = format!("<joint name=\"{joint}\" type=\"");
    let at = G1.find(&open).unwrap_or_else(|| panic!("{joint}")) + open.len();
    let end = at + G1[at..].find('"').unwrap();
    format!("{}{kind}{}", &G1[..at], &G1[end..])
}

#[test]
fn endless_joint_of_the_body_is_noted_as_standing() {
    let draft = draft("r.urdf", &retyped("waist_yaw_joint", "continuous")).unwrap();
    let note = draft.decisions.iter().find(|note| note.contains("without end")).expect("a note");
    assert!(note.contains(": waist_yaw_joint.") && note.contains("at 0"), "{note}");
    let file: toml::Table = draft.toml.parse().unwrap();
    assert_eq!(file["held_rad"]["waist_yaw_joint"].as_float(), Some(0.0));
    assert!(!file["body_joints"].as_array().unwrap().iter().any(|name| name.as_str() == Some("waist_yaw_joint")));
}

#[test]
fn joint_that_nothing_can_command_is_refused_by_name() {
    for (joint, kind, why) in [
        ("left_knee_joint", "floating", "a joint must have at most one axis"),
        ("left_knee_joint", "planar", "a joint must have at most one axis"),
    ] {
        let error = draft("r.urdf", &retyped(joint, kind)).unwrap_err().to_string();
        assert!(error.contains(&format!("`{joint}`: type {kind}, {why}")), "{error}");
    }
}
