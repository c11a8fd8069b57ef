//! Tests what a draft guesses of robots that are built otherwise, and what it refuses.

use crate::support::{HERON, drafted, edit, with_capsule};
use robot::{Model, draft};
use std::f64::consts::FRAC_PI_2;

fn first_joints(model: &Model) -> [&str; 2] {
    model.arms.map(|arm| arm.range().start).map(|joint| model.joint_names[joint].as_str())
}

fn named() -> String {
    HERON.replace("port_", "left_").replace("starleft_", "right_").replace("starboard_", "right_")
}

/// Both shoulders in the middle of the chest, each with a long yoke to its side: only the hands are apart.
#[test]
fn sides_are_where_the_hands_can_be_and_not_where_the_arms_begin() {
    let middle = |text: &str, side: &str, y: &str, yoke: &str, far: &str| {
        let text = edit(text, &format!("{side}_a\""), &format!("xyz=\"0 {y} 0.18\""), "xyz=\"0 0 0.18\"");
        edit(&text, &format!("{side}_b\""), &format!("xyz=\"0 {yoke} 0\""), &format!("xyz=\"0 {far} 0\""))
    };
    let urdf = middle(HERON, "port", "0.17", "0.09", "0.3");
    let urdf = middle(&urdf, "starboard", "-0.17", "-0.09", "-0.3");
    assert_eq!(first_joints(&drafted(&urdf)), ["port_a", "starboard_a"]);
}

#[test]
fn chest_that_is_turned_gets_a_frame_of_its_own() {
    let mut urdf = named();
    // The chest's link turned by a quarter to the left, and what hangs on it turned back.
    urdf = edit(&urdf, "\"twist\"", "rpy=\"0 0 0\"", "rpy=\"0 0 1.5707963267948966\"");
    for (joint, from, to) in [
        ("left_a\"", "0 0.17 0.18\" rpy=\"0 0 0", "0.17 0 0.18\" rpy=\"0 0 -1.5707963267948966"),
        ("right_a\"", "0 -0.17 0.18\" rpy=\"0 0 0", "-0.17 0 0.18\" rpy=\"0 0 -1.5707963267948966"),
        ("neck_nod\"", "rpy=\"0 0 0", "rpy=\"0 0 -1.5707963267948966"),
    ] {
        urdf = edit(&urdf, joint, from, to);
    }
    let (turned, plain) = (drafted(&urdf), drafted(&named()));
    assert_eq!(first_joints(&turned), ["left_a", "right_a"]);
    for side in [0, 1] {
        assert_eq!(turned.arms[side].reference, plain.arms[side].reference);
        for (own, other) in turned.arms[side].axes.iter().zip(&plain.arms[side].axes) {
            assert!((own - other).amax() < 1e-9, "{own} {other}");
        }
    }
    let toml = draft("r.urdf", &urdf).unwrap().toml;
    assert!(toml.contains("torso_rpy_rad = [0.0, 0.0, -1.57"), "{toml}");
    assert!(
        with_capsule(&toml.replace("torso_rpy_rad", "# "), &urdf).is_err(),
        "these arms mirror in that frame alone"
    );
}

#[test]
fn elbow_that_bends_both_ways_bends_as_the_arm_hangs() {
    let both = |text: &str, joint| edit(text, joint, "lower=\"-2.4\" upper=\"0.05\"", "lower=\"-2.3\" upper=\"2.3\"");
    let model = drafted(&both(&both(HERON, "port_d\""), "starboard_d\""));
    assert_eq!(model.arms[0].reference, [0.0, FRAC_PI_2, 0.0, 0.0, 0.0]);
    assert_eq!(model.arms[1].reference, [0.0, -FRAC_PI_2, 0.0, 0.0, 0.0]);
    let home = model.arms.map(|arm| Vec::from_iter(arm.range().map(|joint| model.home[joint])));
    assert!(home[0][3] < -1.0, "{home:?}");
    let mirrored = model.arms[1].joint_signs().zip(&home[0]).map(|(sign, q)| sign * q + 0.0);
    assert_eq!(home[1], Vec::from_iter(mirrored));
}

/// The T-pose lies at plus or minus half a turn of the first joint. Only one of them is in the range.
#[test]
fn t_pose_is_inside_the_ranges_and_mirrored() {
    let raised = |text: &str, side: &str, y: &str| {
        let text = edit(
            text,
            &format!("{side}_a\""),
            &format!("xyz=\"0 {y} 0.18\" rpy=\"0 0 0\""),
            &format!("xyz=\"0 {y} 0.18\" rpy=\"0 3.141592653589793 0\""),
        );
        edit(&text, &format!("{side}_a\""), "lower=\"-3.0\" upper=\"1.5\"", "lower=\"-4.2\" upper=\"1.0\"")
    };
    let model = drafted(&raised(&raised(HERON, "port", "0.17"), "starboard", "-0.17"));
    for arm in &model.arms {
        for i in 0..5 {
            let inside = arm.q_min[i] - 0.02 <= arm.reference[i] && arm.reference[i] <= arm.q_max[i] + 0.02;
            assert!(inside, "{:?} in {:?} {:?}", arm.reference, arm.q_min, arm.q_max);
        }
    }
}

/// Puts a joint between the chest and an arm.
fn with_collar(text: &str, side: &str, y: &str) -> String {
    let old = format!("<parent link=\"chest\"/>\n    <child link=\"{side}_yoke\"/>\n    <origin xyz=\"0 {y} 0.18\"");
    let new =
        format!("<parent link=\"{side}_clavicle\"/>\n    <child link=\"{side}_yoke\"/>\n    <origin xyz=\"0 {y} 0\"");
    let text = edit(text, &format!("{side}_a\""), &old, &new);
    let collar = format!(
        "<link name=\"{side}_clavicle\"/><joint name=\"{side}_shrug\" type=\"revolute\"><parent link=\"chest\"/>\
         <child link=\"{side}_clavicle\"/><origin xyz=\"0 0 0.18\"/><axis xyz=\"0 0 1\"/>\
         <limit lower=\"-0.3\" upper=\"0.3\" velocity=\"1\" effort=\"60\"/></joint></robot>"
    );
    text.replacen("</robot>", &collar, 1)
}

#[test]
fn joint_before_the_seven_of_an_arm_is_held() {
    let urdf = with_collar(&with_collar(HERON, "port", "0.17"), "starboard", "-0.17");
    let model = drafted(&urdf);
    assert_eq!(first_joints(&model), ["port_a", "starboard_a"]);
    let draft = draft("r.urdf", &urdf).unwrap();
    assert!(draft.decisions.iter().any(|note| note.contains("port_shrug") && note.contains("held")));
    assert!(draft.toml.contains("port_shrug = 0.0"), "{}", draft.toml);
}

#[test]
fn joint_of_a_gripper_is_no_joint_of_an_arm() {
    let tip = |side: &str, name: &str, more: &str| {
        format!(
            "<link name=\"{side}_{name}\"/><joint name=\"{side}_{name}_hinge\" type=\"revolute\">\
             <parent link=\"{side}_knuckle\"/><child link=\"{side}_{name}\"/><axis xyz=\"1 0 0\"/>\
             <limit lower=\"0\" upper=\"0.8\" velocity=\"2\" effort=\"5\"/>{more}</joint>"
        )
    };
    let with = |tips: &dyn Fn(&str) -> String, last: &str| {
        let text = HERON.replace("_g\"", &format!("_{last}\""));
        text.replacen("</robot>", &format!("{}{}</robot>", tips("port"), tips("starboard")), 1)
    };
    let rows: [(String, &str); 3] = [
        (with(&|_| String::new(), "jaw"), "`port_jaw` is a gripper's by its name"),
        (with(&|side| tip(side, "other", ""), "g"), "hangs beside"),
        (with(&|side| tip(side, "other", &format!("<mimic joint=\"{side}_g\"/>")), "g"), "is led by `port_g`"),
    ];
    for (urdf, why) in rows {
        let draft = draft("r.urdf", &urdf).expect("arms of six joints");
        assert!(draft.guesses.iter().any(|guess| guess.contains(why)), "{:?}", draft.guesses);
        let shape = "3 turn the upper arm, 2 the forearm and 1 the hand";
        assert!(draft.guesses.iter().any(|guess| guess.contains(shape)), "{:?}", draft.guesses);
        let model = with_capsule(&draft.toml, &urdf).expect("arms of six joints");
        assert_eq!((model.arms[0].range().len(), model.arms[0].slots[6]), (6, None));
    }
    let wrist = HERON.replace("_g\"", "_gripper_yaw\"");
    assert_eq!(drafted(&wrist).joint_names.last().map(String::as_str), Some("starboard_gripper_yaw"));
}

#[test]
fn leg_is_no_arm() {
    let error = draft("r.urdf", &HERON.replace("_b\"", "_hip\"")).unwrap_err().to_string();
    assert!(error.contains("5 joints (starboard_c"), "{error}");
}

#[test]
fn acceleration_is_what_weak_motors_can_do() {
    let draft = |urdf: &str| {
        let file: toml::Table = draft("r.urdf", urdf).unwrap().toml.parse().unwrap();
        let group = &file["limits"]["groups"]["arm_1_to_4"];
        ["acceleration_max_rad_per_s2", "velocity_max_rad_per_s"].map(|key| group[key].as_float().unwrap())
    };
    let [strong, weak] = [draft(HERON), draft(&HERON.replace("effort=\"60\"", "effort=\"12\""))];
    assert!(strong[0] == 10.0 && weak[0] < 8.0 && weak[0] >= 1.0, "{strong:?} {weak:?}");
    assert!(weak[1] < strong[1] && strong[1] <= 0.93 * 3.0, "{strong:?} {weak:?}");
}

#[test]
fn height_of_the_base_is_written_and_asked() {
    let stilts = "<link name=\"stilt\"/><joint name=\"stilts\" type=\"fixed\"><parent link=\"floor_plate\"/>\
                  <child link=\"stilt\"/><origin xyz=\"0 0 -0.61\"/></joint></robot>";
    let draft = draft("r.urdf", &HERON.replacen("</robot>", stilts, 1)).unwrap();
    assert!(draft.toml.contains("base_height_m = 0.61   # decide"), "{}", draft.toml);
    assert!(draft.decisions.iter().any(|note| note.contains("base_height_m = 0.61")));
}

#[test]
fn what_a_later_step_would_refuse_is_said_at_once() {
    let urdf = edit(HERON, "starboard_c\"", "<limit lower=\"", "<limit lower=\"-0.9\" upper=\"0.9\" was=\"");
    let urdf = edit(&urdf, "was=\"", "upper=", "were=");
    let urdf = edit(&urdf, "link name=\"port_ulna\"", "<inertial>", "<!--");
    let urdf = edit(&urdf, "link name=\"port_ulna\"", "</inertial>", "-->");
    let draft = draft("mine.urdf", &urdf).unwrap();
    assert!(draft.refusals.is_empty() && draft.toml.contains("mirrored = false"), "{:?}", draft.refusals);
    let why = "do not mirror each other (mine.toml: joint `starboard_c`: position min";
    assert!(draft.decisions.iter().any(|note| note.contains(why)), "{:?}", draft.decisions);
    assert!(draft.decisions.iter().any(|note| note.contains("no <inertial>: port_ulna")), "{:?}", draft.decisions);
}

#[test]
fn body_joint_with_a_placeholder_is_held() {
    let draft = draft("r.urdf", &edit(HERON, "neck_nod", "velocity=\"2.0\"", "velocity=\"1e9\"")).unwrap();
    let file: toml::Table = draft.toml.parse().unwrap();
    assert_eq!(file["held_rad"]["neck_nod"].as_float(), Some(0.0));
    assert!(draft.decisions.iter().any(|note| note.contains("neck_nod") && note.contains("[supply]")));
}
